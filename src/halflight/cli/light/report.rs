//! What `halflight light` tells: text, JSON, picture.

use super::{
    CliError, LightArguments, MeasuredPlace,
    formats::{self, LightFormat},
};
use crate::assets::pictures;
use crate::cli::{GlobalOptions, output::OutputFormat};
use crate::lab::{digest::PixelDigest, open_exr::save_exr_f32};
use crate::light::maps;
use crate::math::color::{luminance, srgb_encode};
use crate::model::{
    image::{RadianceImage, Rgb8Image},
    light::RadianceSamples,
};

/// Writes the light as a picture; gives its digest where that is asked for.
pub fn picture(
    arguments: &LightArguments,
    global: &GlobalOptions,
    format: Option<OutputFormat>,
    samples: &RadianceSamples,
) -> Result<Option<String>, CliError> {
    if format.is_none() && !global.digest {
        return Ok(None);
    }
    let picture = maps::equirect_of_samples(samples, usize::from(arguments.out_height))
        .ok_or_else(|| CliError("--out: there are no samples to draw".into()))?;
    let mut digest = PixelDigest::default();
    let shown = match format {
        Some(OutputFormat::Png) => Some(display(&picture)),
        _ => None,
    };
    match &shown {
        Some(shown) => digest.add_bytes(shown.pixels()),
        None => digest.add_floats(picture.pixels()),
    }
    if let (Some(out), Some(format)) = (&arguments.out, format) {
        match (format, &shown) {
            (OutputFormat::Exr, _) => save_exr_f32(out, &picture),
            (OutputFormat::Png, Some(shown)) => pictures::save_png(out, shown),
            (OutputFormat::Hdr | OutputFormat::Png, _) => pictures::save_hdr(out, &picture),
        }?;
    }
    Ok(global.digest.then(|| digest.hex()))
}

/// 8 bits through sRGB, scaled so that nine tenths of the pixels lie below 0.8.
fn display(radiance: &RadianceImage) -> Rgb8Image {
    let mut lights: Vec<f32> = radiance.pixels().iter().map(|c| luminance(*c)).collect();
    lights.sort_unstable_by(f32::total_cmp);
    let bright = lights.get(lights.len() * 9 / 10).copied().unwrap_or(0.0);
    let scale = if bright > 0.0 { 0.8 / bright } else { 1.0 };
    let pixels = radiance
        .pixels()
        .iter()
        .map(|c| c.map(|c| (255.0 * srgb_encode((c * scale).clamp(0.0, 1.0))).round() as u8))
        .collect();
    Rgb8Image::from_pixels(radiance.width(), radiance.height(), pixels).unwrap_or_default()
}

/// The light as JSON, alone on standard output.
pub fn json(measured: &MeasuredPlace, shape: LightFormat) {
    let report = formats::of(measured, shape);
    for note in measured.notes.iter().filter(|note| note.starts_with("warning")) {
        eprintln!("{note}");
    }
    println!("{report}");
}

/// The same for people.
pub fn text(arguments: &LightArguments, measured: &MeasuredPlace) {
    for note in &measured.notes {
        if note.starts_with("warning") { eprintln!("{note}") } else { println!("{note}") }
    }
    let degrees = |rad: f64| rad.to_degrees();
    match measured.split.direct {
        Some(direct) => {
            let [x, y, z] = direct.to_light_world;
            let elevation = f64::from(z).atan2(f64::from(x.hypot(y)));
            let azimuth = f64::from(y).atan2(f64::from(x));
            println!("to light    {x:+.5} {y:+.5} {z:+.5} (world frame, unit)");
            println!(
                "            elevation {:.2} deg above the horizon, azimuth {:.2} deg from +x towards +y",
                degrees(elevation),
                degrees(azimuth)
            );
            println!(
                "cone 95     {:.2} deg around it (from what had to be guessed)",
                degrees(measured.cone95_rad)
            );
            let [r, g, b] = direct.irradiance_rgb;
            let most = r.max(g).max(b).max(f32::MIN_POSITIVE);
            println!("E_d         {r:.5} {g:.5} {b:.5} (irradiance of a surface that faces it)");
            println!("            colour {:.3} {:.3} {:.3}", r / most, g / most, b / most);
            if direct.fade < 1.0 {
                println!("            faded in by {:.2} only: the light is nearly uniform", direct.fade);
            }
        }
        None => println!("to light    none: no direction stands out"),
    }
    println!("anisotropy  {:.4} (0 uniform, 1 a single point)", measured.anisotropy);
    let flags = &measured.flags;
    println!(
        "texels      {}: {} saturated, {} not finite or negative (replaced); {:.2} % of the sphere filled",
        flags.texels,
        flags.saturated_texels,
        flags.not_finite_texels,
        100.0 * flags.filled_share
    );
    println!("\nSH of radiance, order {} (left: all of it; right: what E_d leaves)", measured.total.order);
    let rows = measured.total.rows().iter().zip(measured.split.global.rows());
    let mut band = 0i32;
    for (i, (all, rest)) in rows.enumerate() {
        let i = i as i32;
        if i >= (band + 1) * (band + 1) {
            band += 1;
        }
        println!(
            "  l={band} m={:+}  {:+12.6} {:+12.6} {:+12.6}   {:+12.6} {:+12.6} {:+12.6}",
            i - band * (band + 1),
            all[0],
            all[1],
            all[2],
            rest[0],
            rest[1],
            rest[2]
        );
    }
    if let Some(out) = &arguments.out {
        println!("\nwrote {}", out.display());
    }
}
