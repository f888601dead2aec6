//! `--format`: the light as JSON, in our own shape and in those of other programs.

use super::MeasuredPlace;
use crate::light::exported::without;
use crate::light::foreign::{MainLight, Phase, YUpLight, nine_y_up, y_up_light};
use crate::model::light::MAX_LIGHTS;
use serde_json::{Value, json};

/// Shapes of JSON.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightFormat {
    /// Our own, as --json prints it.
    Json,
    /// The structures of the OpenXR extension XR_ANDROID_light_estimation.
    AndroidXr,
    /// An XRLightEstimate of WebXR, with the sign that three.js takes.
    Webxr,
    /// The same with the sign that Chromium passes on, which Babylon.js takes.
    Babylon,
    /// A scene that ObjectLoader of three.js reads.
    #[value(name = "threejs")]
    ThreeJs,
}

impl LightFormat {
    /// Whether it is for other programs.
    pub fn is_foreign(self) -> bool {
        self != Self::Json
    }

    /// Directional lights that it holds at most.
    pub fn most_lights(self) -> usize {
        if self == Self::ThreeJs { MAX_LIGHTS } else { 1 }
    }
}

/// The light in a shape.
pub fn of(measured: &MeasuredPlace, shape: LightFormat) -> Value {
    let y_up = |phase| y_up_light(&measured.total, &measured.split, phase);
    match shape {
        LightFormat::Json => own(measured),
        LightFormat::AndroidXr => android_xr(&y_up(Phase::CondonShortley), STILL_NS),
        LightFormat::Webxr => webxr(&y_up(Phase::Plain)),
        LightFormat::Babylon => webxr(&y_up(Phase::CondonShortley)),
        LightFormat::ThreeJs => three_js(measured),
    }
}

/// Time of a still, which has none.
const STILL_NS: i64 = 0;
/// The function of band 0, 1 / sqrt(4 pi).
const BAND_0: f32 = 0.282_094_8;

fn own(measured: &MeasuredPlace) -> Value {
    let direct = measured.split.direct;
    let flags = &measured.flags;
    json!({
        "format": crate::cli::JSON_FORMAT,
        "order": measured.total.order,
        "sh_rgb": measured.total.rows(),
        "to_light": direct.map(|d| d.to_light_world),
        "irradiance_rgb": direct.map_or([0.0; 3], |d| d.irradiance_rgb),
        "residual_sh_rgb": measured.split.global.rows(),
        "cone95_rad": measured.cone95_rad,
        "flags": {
            "filled_share": flags.filled_share,
            "saturated_texels": flags.saturated_texels,
            "not_finite_texels": flags.not_finite_texels,
            "texels": flags.texels,
        },
    })
}

fn vector([x, y, z]: [f32; 3]) -> Value {
    json!({ "x": x, "y": y, "z": z })
}

/// XrLightEstimateANDROID with what is chained to it. Without a main light its intensity is 0 and it comes from straight
/// above: Chromium drops the whole estimate where one of its structures is invalid.
fn android_xr(light: &YUpLight, updated_ns: i64) -> Value {
    let state = |valid: bool| {
        let word = if valid { "VALID" } else { "INVALID" };
        format!("XR_LIGHT_ESTIMATE_STATE_{word}_ANDROID")
    };
    let finite = |rows: &[[f32; 3]]| rows.iter().flatten().all(|c| c.is_finite());
    let harmonics = |kind: &str, rows: &[[f32; 3]; 9]| {
        json!({
            "kind": format!("XR_SPHERICAL_HARMONICS_KIND_{kind}_ANDROID"),
            "state": state(finite(rows)),
            "coefficients": rows,
        })
    };
    let main = light.main.as_ref();
    json!({
        "XrLightEstimateANDROID": {
            "state": state(finite(&light.total_rgb)),
            "lastUpdatedTime": updated_ns,
        },
        "XrDirectionalLightANDROID": {
            "state": state(true),
            "intensity": vector(main.map_or([0.0; 3], |m| m.irradiance_rgb)),
            "direction": vector(main.map_or([0.0, 1.0, 0.0], |m| m.to_light_y_up)),
        },
        // The mean radiance of the ambient light. It has its colour already: nothing is left to correct.
        "XrAmbientLightANDROID": {
            "state": state(finite(&light.ambient_rgb)),
            "intensity": vector(light.ambient_rgb[0].map(|c| (c * BAND_0).max(0.0))),
            "colorCorrection": vector([1.0; 3]),
        },
        "XrSphericalHarmonicsANDROID": [
            harmonics("TOTAL", &light.total_rgb),
            harmonics("AMBIENT", &light.ambient_rgb),
        ],
    })
}

/// XRLightEstimate. Without a main light it comes from straight above and is dark, as the specification wants it.
fn webxr(light: &YUpLight) -> Value {
    let point = |[x, y, z]: [f32; 3], w: f32| json!({ "x": x, "y": y, "z": z, "w": w });
    let (to_light, irradiance) =
        light.main.map_or(([0.0, 1.0, 0.0], [0.0; 3]), |m| (m.to_light_y_up, m.irradiance_rgb));
    json!({
        "sphericalHarmonicsCoefficients": light.ambient_rgb.as_flattened(),
        "primaryLightDirection": point(to_light, 0.0),
        "primaryLightIntensity": point(irradiance, 1.0),
    })
}

/// A group that lights a scene of three.js: the probe, and directional lights shining at the origin. three.js keeps colours
/// of lights in 8 bits through sRGB; the exact irradiance is in `userData`.
fn three_js(measured: &MeasuredPlace) -> Value {
    let ambient = nine_y_up(&without(&measured.total, &measured.lights), Phase::Plain);
    let mut children = vec![json!({
        "type": "LightProbe",
        "name": "ambient",
        "intensity": 1.0,
        "sh": ambient.as_flattened(),
    })];
    for (index, light) in measured.lights.iter().map(MainLight::from).enumerate() {
        let strongest = light.irradiance_rgb.iter().fold(0.0f32, |most, &e| most.max(e));
        let colour = light.irradiance_rgb.iter().fold(0u32, |hex, &e| {
            let share = if strongest > 0.0 { (e / strongest).clamp(0.0, 1.0) } else { 1.0 };
            (hex << 8) | (255.0 * crate::math::color::srgb_encode(share)).round() as u32
        });
        let [x, y, z] = light.to_light_y_up;
        children.push(json!({
            "type": "DirectionalLight",
            "name": if index == 0 { "main".to_owned() } else { format!("light {}", index + 1) },
            "color": colour,
            "intensity": strongest,
            // Column by column: only its place, which is what gives the direction.
            "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1],
            "userData": { "irradiance_rgb": light.irradiance_rgb },
        }));
    }
    json!({
        "metadata": { "version": 4.6, "type": "Object", "generator": "halflight" },
        "object": { "type": "Group", "name": "light", "children": children },
    })
}
