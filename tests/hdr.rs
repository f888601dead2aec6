//! Exposures to radiance, on real and on known input.

mod support;

use halflight::{
    assets::pictures,
    hdr::{
        attribute::{Tolerance, Verdict, check_exposures},
        merge_bracket::merge_bracket,
        response::{Origin, SolveOptions, solve},
    },
    model::{
        frame::Exposure,
        image::{HdrImage, Rgb8Image},
        response::Response,
    },
};
use std::path::Path;

fn seconds(times_s: &[f64]) -> Vec<Exposure> {
    times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect()
}

fn load(folder: &Path, names: &[&str]) -> Vec<Rgb8Image> {
    names.iter().map(|name| pictures::load_rgb8(&folder.join(name)).unwrap()).collect()
}

#[test]
fn explore() {
    let Some(shared) = support::shared("explore") else { return };
    let look = |name: &str, pics: &[Rgb8Image], times: &[f64]| {
        let pics: Vec<_> = pics.iter().collect();
        let exposures = seconds(times);
        let t0 = std::time::Instant::now();
        let solved = solve(&pics, &exposures, &SolveOptions::default());
        println!("{name}: {:?} {:?}", solved.origin, t0.elapsed());
        for z in [5, 10, 30, 64, 128, 200, 245, 250] {
            let s = Response::srgb();
            print!(
                " z{z}: {:?} srgb {:.2};",
                solved.response.log_exposure().map(|g| (g[z] * 100.).round() / 100.),
                s.log_exposure()[0][z] - s.log_exposure()[0][128]
            );
        }
        println!();
        for (n, r, tol) in [
            ("srgb", &Response::srgb(), Tolerance::GUESSED_RESPONSE),
            ("solved", &solved.response, Tolerance::KNOWN_RESPONSE),
        ] {
            let t0 = std::time::Instant::now();
            let c = check_exposures(&pics, &exposures, r, tol);
            println!("  {n} sound {} {:?}", c.sound(), t0.elapsed());
            for r in c.reports() {
                println!("    {r:?} log ratio {:.3}", r.measured_ratio.ln() / r.stated_ratio.ln());
            }
        }
    };
    let data = shared.join("data");
    let m = data.join("brackets/memorial");
    let names: Vec<String> = (61..=76).map(|i| format!("memorial{i:04}.png")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let times: Vec<f64> = (0..16).map(|k| 32.0 / f64::from(1 << k)).collect();
    let mem = load(&m, &names);
    let crop = |p: &Rgb8Image| {
        let (x0, y0, x1, y1) = (14, 34, 496, 714);
        Rgb8Image::from_pixels(x1 - x0, y1 - y0, (y0..y1).flat_map(|y| p.row(y)[x0..x1].to_vec()).collect())
            .unwrap()
    };
    let memc: Vec<_> = mem.iter().map(crop).collect();
    look("memorial crop", &memc, &times);
    if false {
        for y in [0, 10, 20, 25, 30, 40, 384, 700, 720, 730, 740, 750, 760, 767] {
            println!(
                "row {y}: {:?}",
                [0, 1, 2, 3, 4, 5, 10, 250, 500, 505, 508, 509, 510, 511].map(|x| mem[5].at(x, y))
            );
        }
    }
    look("memorial", &mem, &times);
    let l = data.join("brackets/living_room1_negative");
    look("living", &load(&l, &["DSC_0071.png", "DSC_0073.png", "DSC_0075.png"]), &[4.0, 1.0, 0.25]);
    look(
        "ola",
        &load(&data.join("mirrorball"), &["ola_raw1.jpg", "ola_raw2.jpg", "ola_raw3.jpg"]),
        &[0.1, 1.0 / 40.0, 1.0 / 160.0],
    );
    for f in ["overcast_city", "room_windows", "studio_lamps", "sun_beach"] {
        let d = shared.join(format!("reference/f5_{f}"));
        look(f, &load(&d, &["exposure0.png", "exposure1.png", "exposure2.png"]), &[0.004, 0.016, 0.064]);
    }
    let _ = (
        HdrImage::default(),
        merge_bracket as fn(&[&Rgb8Image], &[Exposure], &Response, &mut HdrImage) -> _,
        Origin::Fallback { why: String::new() },
        Verdict::Consistent,
    );
}
