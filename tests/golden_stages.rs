//! The shared golden numbers for the stages: factorisation, shading and the merge of brackets, in f64 and in f32.
//! Kernels that frames run in f32 alone are held to the f32 tolerances besides.

#[path = "support/golden.rs"]
mod golden;
mod support;

use glam::{DVec3, Vec3};
use golden::{Entry, Precision, numbers};
use halflight::compose::geometry::MaterialTerms;
use halflight::compose::{
    reflected::Reflected,
    shade_object::{LightTerms, ObjectPoint, Surroundings, shade},
};
use halflight::hdr::merge_bracket::{MergeReal, merge_bracket, merge_pixels};
use halflight::light::project_sh::project_sh;
use halflight::light::split::{Estimator, SplitOptions, factor, irradiance, split};
use halflight::math::quadrature;
use halflight::math::sh::{MAX_COEFFICIENTS, basis, zonal};
use halflight::model::frame::Exposure;
use halflight::model::image::{HdrImage, Image, LOWER_BOUND, UPPER_BOUND};
use halflight::model::light::{RadianceSamples, RadianceSh};
use halflight::model::response::Response;
use halflight::model::scene::Material;

/// The file's L_rgb, three lists, as rows of r, g, b.
fn rows<T: Precision>(entry: &Entry) -> Vec<[T; 3]> {
    let flat = entry.list::<T>("L_rgb");
    let count = flat.len() / 3;
    (0..count).map(|i| [flat[i], flat[count + i], flat[2 * count + i]]).collect()
}

fn weights<T: Precision>(entry: &Entry) -> [T; 3] {
    let weights = entry.list::<T>("gray_weights");
    [weights[0], weights[1], weights[2]]
}

fn factorisation<T: Precision>(entry: &Entry) {
    let order = entry.count("order");
    let light = rows::<T>(entry);
    let got = factor(order, &light, weights(entry), entry.number("anisotropy_threshold"));
    let direction = got.dominant.direction;
    assert_eq!(direction.is_some(), entry.expected["dominant"] == true, "{}", entry.id);
    entry.check_key("direction", direction.as_ref().map(|d| &d[..]));
    let residual: Vec<T> =
        (0..3).flat_map(|c| got.residual_rgb[..light.len()].iter().map(move |row| row[c])).collect();
    let Some(direction) = direction else {
        entry.check("E_d", &entry.expected["E_d"]["band1"], Some(&got.irradiance_rgb));
        entry.check("residual", &entry.expected["residual"]["band1"], Some(&residual));
        return;
    };
    entry.check_key("anisotropy", Some(&[got.dominant.anisotropy]));
    entry.check("E_d", &entry.expected["E_d"]["band1_clamped"], Some(&got.irradiance_rgb));
    let alpha = zonal::alpha::<T>(order);
    for (name, estimator) in
        [("band1", Estimator::Band1), ("all", Estimator::AllBands), ("nonDC", Estimator::NonConstant)]
    {
        let e = irradiance(order, &light, direction, estimator);
        entry.check(name, &entry.expected["E_d"][name], Some(&e));
        entry.check(name, &entry.expected["c_paper"][name], Some(&e.map(|e| e / alpha)));
    }
    // The file takes out E_d before it is clamped. Where clamping changed nothing it must be our residual; where it
    // did, nothing was taken out and ours is the light itself.
    let unclamped = irradiance(order, &light, direction, Estimator::Band1);
    let mut y = [T::zero(); MAX_COEFFICIENTS];
    basis::evaluate(order, direction, &mut y);
    let mut as_in_file = residual.clone();
    for c in 0..3 {
        let channel = &mut as_in_file[c * light.len()..(c + 1) * light.len()];
        if unclamped[c] < T::zero() {
            for (i, value) in channel.iter_mut().enumerate() {
                assert_eq!(*value, light[i][c], "{}: a clamped channel keeps its light", entry.id);
                *value = light[i][c] - unclamped[c] * y[i];
            }
        }
    }
    entry.check("residual", &entry.expected["residual"]["band1"], Some(&as_in_file));
}

/// The lobe of a shaded point.
enum Lobe {
    Lambert { albedo: f64 },
    Phong { exponent: f64, norm: zonal::PhongNorm },
}

impl Lobe {
    /// As "lambert albedo 1" or "phong s=40, norm (s+2)/2pi, axis=w_r" say.
    fn of(entry: &Entry) -> Self {
        let brdf = entry.text("brdf");
        let after = |word: &str| -> Option<f64> {
            let rest = brdf.split_once(word)?.1.trim_start();
            rest.split([',', ' ']).next()?.parse().ok()
        };
        match (after("lambert albedo"), after("phong s=")) {
            (Some(albedo), None) => Self::Lambert { albedo },
            (None, Some(exponent)) if brdf.contains("(s+2)") => {
                Self::Phong { exponent, norm: zonal::PhongNorm::Paper }
            }
            (None, Some(exponent)) if brdf.contains("(s+1)") => {
                Self::Phong { exponent, norm: zonal::PhongNorm::EnergySafe }
            }
            _ => entry.unknown(&format!("its brdf is {brdf}")),
        }
    }
}

/// E_d by the entry's estimator, and the light without it.
fn taken_out<T: Precision>(
    entry: &Entry,
    order: usize,
    light: &[[T; 3]],
    direction: [T; 3],
) -> ([T; 3], Vec<[T; 3]>) {
    let estimator = match entry.text("estimator") {
        "band1" | "band1_clamped" => Estimator::Band1,
        "all" => Estimator::AllBands,
        "nonDC" => Estimator::NonConstant,
        other => entry.unknown(&format!("its estimator is {other}")),
    };
    let taken = irradiance(order, light, direction, estimator).map(|e| e.max(T::zero()));
    let mut y = [T::zero(); MAX_COEFFICIENTS];
    basis::evaluate(order, direction, &mut y);
    let left = light.iter().zip(y).map(|(row, y)| std::array::from_fn(|c| row[c] - taken[c] * y));
    (taken, left.collect())
}

fn shading<T: Precision>(entry: &Entry) {
    let order = entry.count("order");
    let light = rows::<T>(entry);
    let axis = entry.direction::<T>("axis");
    let got = factor(order, &light, weights(entry), T::of(1e-3));
    let direction = got.dominant.direction.unwrap_or_else(|| panic!("{}: no direction", entry.id));
    let cosine = axis[0] * direction[0] + axis[1] * direction[1] + axis[2] * direction[2];
    let mut zonal_lobe = vec![T::zero(); order];
    // The lobe towards the light, and without its norm.
    let (lobe, bare) = match Lobe::of(entry) {
        Lobe::Lambert { albedo } => {
            zonal::lambert(order, &mut zonal_lobe);
            zonal_lobe.iter_mut().for_each(|z| *z = *z * T::of(albedo));
            let bare = T::of(albedo) * cosine.max(T::zero());
            (bare / T::PI(), bare)
        }
        Lobe::Phong { exponent, norm } => {
            let exponent = T::of(exponent);
            zonal::phong(order, exponent, norm, &mut zonal_lobe);
            let bare = zonal::phong_lobe(cosine, exponent);
            (zonal::phong_scale(exponent, norm) * bare, bare)
        }
    };
    let mut f = vec![T::zero(); order * order];
    zonal::rotate(&zonal_lobe, axis, &mut f);
    let under = |light: &[[T; 3]]| -> [T; 3] {
        std::array::from_fn(|c| light.iter().zip(&f).fold(T::zero(), |sum, (row, f)| sum + row[c] * *f))
    };
    let (irradiance, residual) = taken_out(entry, order, &light, direction);
    let direct = irradiance.map(|e| e * lobe);
    let indirect = under(&residual);
    let total: [T; 3] = std::array::from_fn(|c| direct[c] + indirect[c]);
    entry.check_key("direct", Some(&direct));
    entry.check_key("indirect", Some(&indirect));
    entry.check_key("total", Some(&total));
    entry.check_key("sh_only", Some(&under(&light)));
    // c max(0, cos)^s with neither alpha nor the lobe's norm: the pair that Table 1 prints, and that we do not use.
    let alpha = zonal::alpha::<T>(order);
    entry.check_key("direct_paper_literal", Some(&irradiance.map(|e| e / alpha * bare)));
}

/// The kernel that the frames run, which is in f32: the whole way from SH to the shade.
fn shading_kernel(entry: &Entry) {
    // Frames know no other estimator.
    if !entry.text("estimator").starts_with("band1") {
        return;
    }
    let mut light = RadianceSh::zero(entry.count("order"));
    for (slot, row) in light.rgb.iter_mut().zip(rows::<f32>(entry)) {
        *slot = row;
    }
    let split = split(&light, &SplitOptions { gray_weights: weights(entry), ..SplitOptions::default() });
    let axis = Vec3::from(entry.direction::<f32>("axis"));
    // Seen along the normal the mirrored view is the normal, so that it is the axis of both lobes.
    let point = ObjectPoint {
        position_world: Vec3::ZERO,
        normal: axis,
        to_eye: axis,
        tint_openness: [1.0; 4],
        soft: [0.0; 4],
        gloss: [1.0; 3],
    };
    let (material, norm) = match Lobe::of(entry) {
        Lobe::Lambert { albedo } => {
            (Material::Lambert { albedo_rgb: [albedo as f32; 3] }, zonal::PhongNorm::Paper)
        }
        Lobe::Phong { exponent, norm } => {
            let exponent = exponent as f32;
            (Material::Phong { albedo_rgb: [0.0; 3], specular_rgb: [1.0; 3], exponent }, norm)
        }
    };
    let light = LightTerms::of(&split.into());
    let nothing = Reflected::default();
    let surroundings = Surroundings::new(None, &nothing, norm, light.order);
    let got = shade(&light, &surroundings, &MaterialTerms::of(&material), &point, |_, _, _| 1.0);
    entry.check_key("total", Some(&got));
}

/// The merge's kernel in either precision; in f32 also through the whole merge, which must give the same bits.
fn merging<T: Precision + MergeReal>(entry: &Entry) {
    entry.require("response", "g(z)=2.2 ln(max(z,0.5)/255)");
    entry.require("weight", "hat: z<=127?z:255-z");
    let table: [f64; 256] = std::array::from_fn(|z| 2.2 * (z as f64).max(0.5).ln() - 2.2 * 255.0_f64.ln());
    let values: Vec<u8> = numbers(&entry.inputs["pixels"]).into_iter().map(|z| z as u8).collect();
    let exposures: Vec<_> = numbers(&entry.inputs["exposure_s"])
        .into_iter()
        .map(|time_s| Exposure { time_s, gain: 1.0 })
        .collect();
    let pixels: Vec<_> = values.iter().map(|z| [[*z; 3]]).collect();
    let pixels: Vec<&[[u8; 3]]> = pixels.iter().map(|p| &p[..]).collect();
    let (mut radiance, mut flags) = ([[T::zero(); 3]], [0]);
    merge_pixels(&pixels, &exposures, &[table.map(T::of); 3], &mut radiance, &mut flags)
        .unwrap_or_else(|| panic!("{}: refused", entry.id));
    let flag = match entry.expected["flag"].as_str() {
        Some("ok") => 0,
        Some("underexposed_upper_bound") => UPPER_BOUND,
        Some("saturated_lower_bound" | "overexposed_lower_bound") => LOWER_BOUND,
        other => entry.unknown(&format!("its flag is {other:?}")),
    };
    assert_eq!(flags, [flag], "{}", entry.id);
    for channel in radiance[0] {
        entry.check_key("E", Some(&[channel]));
        entry.check_key("lnE", Some(&[channel.ln()]));
    }
    if T::NAME == "f32" {
        let response = Response::new([table.map(|g| g as f32); 3]);
        let response = response.unwrap_or_else(|| panic!("{}: response", entry.id));
        let pictures: Vec<_> = values.iter().map(|z| Image::filled(1, 1, [*z; 3])).collect();
        let mut out = HdrImage::default();
        merge_bracket(&pictures.iter().collect::<Vec<_>>(), &exposures, &response, &mut out)
            .unwrap_or_else(|e| panic!("{}: {e}", entry.id));
        assert_eq!(
            (out.radiance.at(0, 0).map(f64::from), *out.flags.at(0, 0)),
            (radiance[0].map(T::wide), flag)
        );
    }
}

/// The kernel's fixed tree over samples, which is in f32.
fn projection_kernel(entry: &Entry) {
    entry.require("env", "exp(kappa*(w.a-1))");
    let kappa = entry.number::<f64>("kappa");
    let axis = DVec3::from(entry.direction::<f64>("axis"));
    let mut samples = RadianceSamples::default();
    // Converged long before f32's rounding: bands fall as exp(-l^2 / (2 kappa)).
    for (direction, weight) in quadrature::sphere(60.max((60.0 * kappa).sqrt() as usize + 12)) {
        let [x, y, z] = direction.map(|v| v as f32);
        let lobe = (kappa * (DVec3::from(direction).dot(axis) - 1.0)).exp() as f32;
        samples.directions.push([x, y, z, weight as f32]);
        samples.radiance.push([lobe, 2.0 * lobe, 0.0, 0.0]);
    }
    let got = project_sh(&samples, entry.count("order"));
    let channel = |c: usize, scale: f32| got.rows().iter().map(|row| row[c] / scale).collect::<Vec<_>>();
    entry.check_key("sh", Some(&channel(0, 1.0)));
    entry.check_key("sh", Some(&channel(1, 2.0)));
    assert!(channel(2, 1.0).iter().all(|v| *v == 0.0), "{}: a dark channel stays dark", entry.id);
}

#[test]
fn golden_stages() {
    let Some(shared) = support::shared("golden_stages") else { return };
    golden::run(
        &shared,
        &[
            ("factor", factorisation::<f64>, factorisation::<f32>),
            ("shade", shading::<f64>, shading::<f32>),
            ("hdr", merging::<f64>, merging::<f32>),
        ],
    );
    golden::run_f32(&shared, &[("shade", shading_kernel), ("project", projection_kernel)]);
}
