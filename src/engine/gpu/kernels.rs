//! THE TABLE: one row a kernel. `tests/shaders.rs` checks every row without a GPU.

use super::{
    kernel::{Binding, BindingKind, Kernel, Source},
    params,
};
use crate::plan::Pass;

macro_rules! source {
    ($path:literal) => {
        Source {
            path: concat!("shaders/", $path, ".wgsl"),
            text: include_str!(concat!("../../../shaders/", $path, ".wgsl")),
        }
    };
}

/// `hdr/merge_bracket`: one invocation for four pixels (three words of packed bytes).
pub const MERGE_BRACKET: Kernel = Kernel {
    pass: Pass::MergeBracket,
    sources: &[source!("hdr/merge_bracket")],
    entries: &["merge"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("pictures", BindingKind::Read),
        Binding::new("tables", BindingKind::Read),
        Binding::new("radiance", BindingKind::Write),
        Binding::new("flags", BindingKind::Write),
    ],
    structs: &[params::MergeParams::LAYOUT],
};

/// `light/unwrap_ball`: one invocation a pixel of the ball's region.
pub const UNWRAP_BALL: Kernel = Kernel {
    pass: Pass::UnwrapBall,
    sources: &[source!("light/unwrap_ball")],
    entries: &["unwrap"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("corner_rays", BindingKind::Read),
        Binding::new("cells", BindingKind::Write),
    ],
    structs: &[params::UnwrapParams::LAYOUT],
};

/// `light/project_sh`: partial sums of 256 samples each, then one workgroup for each coefficient.
pub const PROJECT_SH: Kernel = Kernel {
    pass: Pass::ProjectSh,
    sources: &[source!("shared/sh_basis"), source!("light/project_sh")],
    entries: &["partial_sums", "total"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("directions", BindingKind::Read),
        Binding::new("radiance", BindingKind::Read),
        Binding::new("partials", BindingKind::Write),
        Binding::new("coefficients", BindingKind::Write),
    ],
    structs: &[params::ProjectParams::LAYOUT],
};

/// `visibility/shadow_maps`: depth along the light, as bits in an integer target.
pub const SHADOW_MAPS: Kernel = Kernel {
    pass: Pass::ShadowMaps,
    sources: &[source!("shared/shadow_camera"), source!("visibility/shadow_maps")],
    entries: &["vertex", "fragment"],
    bindings: &[Binding::new("camera", BindingKind::UniformAtOffset)],
    structs: &[params::ShadowCamera::LAYOUT],
};

/// `compose/soft_shadow`: the nearest real surface at the centres of a coarse picture; `fragment` is the rung `directions`.
/// At vertices the vertex stages evaluate, and `interpolated` hands on.
pub const SOFT_SHADOW: Kernel = Kernel {
    pass: Pass::SoftShadow,
    sources: &[
        source!("shared/lens"),
        source!("shared/sh_basis"),
        source!("shared/facet"),
        source!("shared/sh_product"),
        source!("shared/blockers"),
        source!("compose/soft_shadow"),
    ],
    entries: &["vertex", "fragment", "ladder", "vertex_directions", "vertex_ladder", "interpolated"],
    bindings: &[
        Binding::new("view", BindingKind::Uniform),
        Binding::new("soft", BindingKind::Uniform),
        Binding::new("blockers", BindingKind::Uniform),
        Binding::new("tables", BindingKind::Uniform),
        Binding::new("planes", BindingKind::Uniform),
    ],
    structs: &[
        params::View::LAYOUT,
        params::SoftTerms::LAYOUT,
        params::BLOCKER_TERMS,
        params::BLOCKER_TABLES,
        params::PlaneTerms::LAYOUT,
    ],
};

/// `visibility/point_maps`: depths of the stand-ins from many lights at once, an instance and a tile each.
pub const POINT_MAPS: Kernel = Kernel {
    pass: Pass::PointMaps,
    sources: &[source!("shared/point_camera"), source!("visibility/point_maps")],
    entries: &["vertex", "fragment"],
    bindings: &[
        Binding::new("cameras", BindingKind::Uniform),
        Binding::new("page", BindingKind::UniformAtOffset),
        Binding::new("lights", BindingKind::Uniform),
    ],
    structs: &[
        params::PointCamera::LAYOUT,
        params::PointCameras::LAYOUT,
        params::PointPage::LAYOUT,
        params::PointLights::LAYOUT,
    ],
};

/// `nearfield/subtract`: the nearest triangle of the room at each pixel's centre, as a ratio. `fragment` loops over its
/// lights; the others draw one light after the other, as in [Gib03].
pub const SUBTRACT: Kernel = Kernel {
    pass: Pass::Subtract,
    sources: &[
        source!("shared/lens"),
        source!("shared/shadow_camera"),
        source!("shared/shadow_lookup"),
        source!("shared/point_camera"),
        source!("shared/point_lookup"),
        source!("nearfield/subtract"),
    ],
    entries: &["vertex", "fragment", "depth_alone", "nearest_room", "one_light", "after_all"],
    bindings: &[
        Binding::new("view", BindingKind::Uniform),
        Binding::new("cameras_near", BindingKind::Uniform),
        Binding::new("lights", BindingKind::Uniform),
        Binding::new("point_maps", BindingKind::UintLayers),
        Binding::new("ranges", BindingKind::Uints),
        Binding::new("listed", BindingKind::Floats),
        Binding::new("suns", BindingKind::Uniform),
        Binding::new("cameras", BindingKind::Uniform),
        Binding::new("shadow_maps", BindingKind::UintLayers),
        Binding::new("room_cameras", BindingKind::Uniform),
        Binding::new("room_maps", BindingKind::UintLayers),
        Binding::new("turn", BindingKind::UniformAtOffset),
        Binding::new("taken", BindingKind::Floats),
    ],
    structs: &[
        params::View::LAYOUT,
        params::PointCamera::LAYOUT,
        params::PointCameras::LAYOUT,
        params::PointLights::LAYOUT,
        params::SunTerms::LAYOUT,
        params::Turn::LAYOUT,
        params::ShadowCamera::LAYOUT,
        params::ShadowCameras::LAYOUT,
    ],
};

/// `nearfield/subtract_displayed`: what the display shows of the room, one light after the other subtracted from it, and what
/// is left as a ratio; with the functions of `nearfield/subtract`, whose own fragment stages are not used.
pub const SUBTRACT_DISPLAYED: Kernel = Kernel {
    pass: Pass::SubtractDisplayed,
    sources: &[
        source!("shared/lens"),
        source!("shared/shadow_camera"),
        source!("shared/shadow_lookup"),
        source!("shared/point_camera"),
        source!("shared/point_lookup"),
        source!("nearfield/subtract"),
        source!("nearfield/subtract_displayed"),
    ],
    entries: &[
        "vertex",
        "fragment",
        "depth_alone",
        "nearest_room",
        "one_light",
        "after_all",
        "shown_room",
        "one_displayed",
        "after_displayed",
    ],
    bindings: &[
        Binding::new("view", BindingKind::Uniform),
        Binding::new("cameras_near", BindingKind::Uniform),
        Binding::new("lights", BindingKind::Uniform),
        Binding::new("point_maps", BindingKind::UintLayers),
        Binding::new("ranges", BindingKind::Uints),
        Binding::new("listed", BindingKind::Floats),
        Binding::new("suns", BindingKind::Uniform),
        Binding::new("cameras", BindingKind::Uniform),
        Binding::new("shadow_maps", BindingKind::UintLayers),
        Binding::new("room_cameras", BindingKind::Uniform),
        Binding::new("room_maps", BindingKind::UintLayers),
        Binding::new("turn", BindingKind::UniformAtOffset),
        Binding::new("taken", BindingKind::Floats),
        Binding::new("before", BindingKind::Floats),
        Binding::new("exposures", BindingKind::Floats),
        Binding::new("display", BindingKind::Floats),
    ],
    structs: &[
        params::View::LAYOUT,
        params::PointCamera::LAYOUT,
        params::PointCameras::LAYOUT,
        params::PointLights::LAYOUT,
        params::SunTerms::LAYOUT,
        params::Turn::LAYOUT,
        params::ShadowCamera::LAYOUT,
        params::ShadowCameras::LAYOUT,
    ],
};

/// `compose/shade_object`: real surfaces and objects into the depth, then objects, four samples a pixel.
pub const SHADE_OBJECT: Kernel = Kernel {
    pass: Pass::ShadeObject,
    sources: &[
        source!("shared/lens"),
        source!("shared/sh_basis"),
        source!("shared/soft_light"),
        source!("shared/shadow_camera"),
        source!("shared/shadow_lookup"),
        source!("shared/facet"),
        source!("shared/surroundings"),
        source!("compose/shade_object"),
    ],
    entries: &["vertex", "fragment", "depth_vertex", "surface_vertex", "depth_fragment"],
    bindings: &[
        Binding::new("view", BindingKind::Uniform),
        Binding::new("light", BindingKind::Uniform),
        Binding::new("cameras", BindingKind::Uniform),
        Binding::new("material", BindingKind::UniformAtOffset),
        Binding::new("shadow_maps", BindingKind::UintLayers),
        Binding::new("surroundings", BindingKind::Uniform),
        Binding::new("environment", BindingKind::Floats),
    ],
    structs: &[
        params::View::LAYOUT,
        params::LightTerms::LAYOUT,
        params::ShadowCamera::LAYOUT,
        params::ShadowCameras::LAYOUT,
        params::MaterialTerms::LAYOUT,
        params::Surroundings::LAYOUT,
    ],
};

/// `compose/shade_surface`: the nearest real surface at each pixel's centre, as a ratio.
pub const SHADE_SURFACE: Kernel = Kernel {
    pass: Pass::ShadeSurface,
    sources: &[
        source!("shared/lens"),
        source!("shared/sh_basis"),
        source!("shared/soft_light"),
        source!("shared/shadow_camera"),
        source!("shared/shadow_lookup"),
        source!("shared/facet"),
        source!("compose/shade_surface"),
    ],
    entries: &["vertex", "fragment"],
    bindings: &[
        Binding::new("view", BindingKind::Uniform),
        Binding::new("light", BindingKind::Uniform),
        Binding::new("cameras", BindingKind::Uniform),
        Binding::new("shadow_maps", BindingKind::UintLayers),
        Binding::new("soft", BindingKind::Uniform),
        Binding::new("soft_picture", BindingKind::Uints),
    ],
    structs: &[
        params::View::LAYOUT,
        params::LightTerms::LAYOUT,
        params::ShadowCamera::LAYOUT,
        params::ShadowCameras::LAYOUT,
        params::SoftPicture::LAYOUT,
    ],
};

/// `compose/composite`: one invocation a pixel.
pub const COMPOSITE: Kernel = Kernel {
    pass: Pass::Composite,
    sources: &[source!("compose/composite")],
    entries: &["composite"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("background", BindingKind::Read),
        Binding::new("object_layer", BindingKind::Floats),
        Binding::new("ratios", BindingKind::Uints),
        Binding::new("radiance", BindingKind::Write),
    ],
    structs: &[params::CompositeParams::LAYOUT],
};

/// `compose/tonemap`: one invocation for four pixels.
pub const TONEMAP: Kernel = Kernel {
    pass: Pass::Tonemap,
    sources: &[source!("compose/tonemap")],
    entries: &["tonemap"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("thresholds", BindingKind::Floats),
        Binding::new("starts", BindingKind::Uints),
        Binding::new("radiance", BindingKind::Read),
        Binding::new("display", BindingKind::Write),
    ],
    structs: &[params::TonemapParams::LAYOUT],
};

/// Every kernel, in the order of `Pass::ALL`.
pub const TABLE: [&Kernel; 12] = [
    &MERGE_BRACKET,
    &UNWRAP_BALL,
    &PROJECT_SH,
    &SHADOW_MAPS,
    &SOFT_SHADOW,
    &POINT_MAPS,
    &SUBTRACT,
    &SUBTRACT_DISPLAYED,
    &SHADE_OBJECT,
    &SHADE_SURFACE,
    &COMPOSITE,
    &TONEMAP,
];
