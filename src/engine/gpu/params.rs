//! Structs that the host fills and a shader reads. Each is written once here; `tests/shaders.rs` compares every
//! member's name, offset and size with what naga reads from the WGSL struct of the same name.

use crate::{
    compose::reflected::{MOST_SPHERES, MOST_TRIANGLES},
    model::light::MAX_HARD_LIGHTS,
    nearfield::frame::MOST_LIGHTS,
    visibility::blockers::{BlockerTables, BlockerTerms},
};

/// Normals of flat receivers that `PlaneTerms` holds.
pub const PLANES: usize = 3;

/// Where one member lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Member {
    /// As the shader spells it.
    pub name: &'static str,
    /// Bytes from the start of the struct.
    pub offset: usize,
    /// Bytes.
    pub size: usize,
}

/// The layout of a struct as Rust lays it out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StructLayout {
    /// Its name, here and in WGSL.
    pub name: &'static str,
    /// Bytes.
    pub size: usize,
    /// In order.
    pub members: &'static [Member],
}

macro_rules! shared_struct {
    ($(#[$doc:meta])* $name:ident { $($(#[$member_doc:meta])* $member:ident: $kind:ty,)* }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name { $($(#[$member_doc])* pub $member: $kind,)* }

        impl $name {
            /// As Rust lays it out.
            pub const LAYOUT: StructLayout = StructLayout {
                name: stringify!($name),
                size: size_of::<Self>(),
                members: &[$(Member {
                    name: stringify!($member),
                    offset: std::mem::offset_of!($name, $member),
                    size: size_of::<$kind>(),
                },)*],
            };
        }
    };
}

shared_struct! {
    /// `hdr/merge_bracket`.
    MergeParams {
        /// Groups of four pixels.
        quads: u32,
        /// Pictures in the bracket.
        pictures: u32,
        /// 32-bit words from one picture to the next.
        picture_words: u32,
        /// Invocations in one row of the dispatch.
        row: u32,
    }
}

shared_struct! {
    /// `light/unwrap_ball`.
    UnwrapParams {
        /// From the ball's centre to the camera, metres.
        eye_from_centre: [f32; 3],
        /// Metres.
        radius: f32,
        /// Square of the largest distance between ray and centre that still counts.
        rim_squared: f32,
        /// Columns of the region.
        width: u32,
        /// Rows of the region.
        height: u32,
        /// 1: only the part of each cell with z > 0 counts.
        above_horizon: u32,
    }
}

shared_struct! {
    /// `light/project_sh`.
    ProjectParams {
        /// Samples in this part.
        samples: u32,
        /// Order of the light, 1 to 6.
        order: u32,
        /// Rows of partial sums before this part's.
        first_partial: u32,
        /// Rows of partial sums in all.
        partials: u32,
        /// Rounds of 64 samples that one workgroup sums.
        rounds: u32,
        /// Groups of 4 samples in a round.
        groups: u32,
        /// To a whole 16 bytes.
        unused: [u32; 2],
    }
}

shared_struct! {
    /// Camera and lens, `shared/lens`.
    View {
        /// Camera's position, world frame, metres.
        eye: [f32; 4],
        /// Row of camera_from_world.
        right: [f32; 4],
        /// Row of camera_from_world.
        down: [f32; 4],
        /// Row of camera_from_world.
        forward: [f32; 4],
        /// fx, fy, cx, cy in pixels.
        focal: [f32; 4],
        /// Width, height in pixels, near distance in metres, largest squared radius or angle of the model.
        frame: [f32; 4],
        /// k1 k2 p1 p2, or k1 k2 k3 k4.
        distortion: [f32; 4],
        /// k3 k4 k5 k6.
        distortion_more: [f32; 4],
        /// 0 pinhole, 1 radial-tangential, 2 equidistant.
        model: [u32; 4],
    }
}

shared_struct! {
    /// The light of a frame, `shared/soft_light`. Twin: `compose::shade_object::LightTerms`.
    LightTerms {
        /// Order of the tables; hard lights in use.
        order_hard: [u32; 4],
        /// Multiplies the radiance of objects, so that 16-bit floats hold it.
        exposure: [f32; 4],
        /// irradiance / pi of the soft half.
        soft_rgb: [[f32; 4]; 36],
        /// L_g.
        global_rgb: [[f32; 4]; 36],
        /// L_g + sum of E_k y(w_k).
        total_rgb: [[f32; 4]; 36],
        /// Hard lights: unit vector towards it (world frame), and irradiance.
        hard: [[[f32; 4]; 2]; MAX_HARD_LIGHTS],
    }
}

shared_struct! {
    /// The shadow map's camera, `shared/shadow_lookup`. Twin: `visibility::shadow_maps::ShadowCamera`.
    ShadowCamera {
        /// World metres to column, texels.
        column: [f32; 4],
        /// World metres to row, texels.
        row: [f32; 4],
        /// World metres to depth.
        depth: [f32; 4],
        /// Side of a texel in metres, metres for a depth of 1.
        texel_depth_m: [f32; 4],
        /// Texels a side (0: no map), taps a side of the filter.
        texels_taps: [u32; 4],
    }
}

shared_struct! {
    /// The cameras of all hard lights.
    ShadowCameras {
        /// One for each.
        cameras: [ShadowCamera; MAX_HARD_LIGHTS],
    }
}

shared_struct! {
    /// `compose/soft_shadow`. Twins: `visibility::blockers`, `compose::soft_shadow::Transfer`.
    SoftTerms {
        /// Directions, 0, 0, 0.
        counts: [u32; 4],
        /// h, sin(h/2), 4 pi / N, 0.
        softness: [f32; 4],
        /// Lambert's lobe, bands 0 to 3.
        bands_low: [f32; 4],
        /// Bands 4 and 5.
        bands_high: [f32; 4],
        /// Unit directions, four by four: x of four of them, y, z.
        directions: [[[f32; 4]; 3]; 64],
        /// Means of y_i over the directions.
        means: [[f32; 4]; 9],
        /// M^{L_g}, rows i, columns k <= i.
        matrix: [[f32; 4]; 666],
    }
}

shared_struct! {
    /// Flat receivers of `compose/soft_shadow`. Twin: `visibility::blockers::BlockedPlane`.
    PlaneTerms {
        /// Normals, 0, 0, 0.
        counts: [u32; 4],
        /// Unit, world frame.
        normals: [[f32; 4]; PLANES],
        /// Of each, what a blocked direction or coefficient takes, r, g, b.
        weights: [[[f32; 4]; 256]; PLANES],
    }
}

macro_rules! members_of {
    ($kind:ident: $($member:ident),*) => {
        &[$(Member {
            name: stringify!($member),
            offset: std::mem::offset_of!($kind, $member),
            size: bytes_of_what(|terms: &$kind| &terms.$member),
        },)*]
    };
}

const fn bytes_of_what<Whole, Part>(_: fn(&Whole) -> &Part) -> usize {
    size_of::<Part>()
}

/// The spheres and boxes of `shared/blockers`, which `visibility` lays out.
pub const BLOCKER_TERMS: StructLayout = StructLayout {
    name: "BlockerTerms",
    size: size_of::<BlockerTerms>(),
    members: members_of!(BlockerTerms: spheres, bodies, counts, boxes, box_bodies),
};

/// The tables of `shared/blockers`, likewise.
pub const BLOCKER_TABLES: StructLayout = StructLayout {
    name: "BlockerTables",
    size: size_of::<BlockerTables>(),
    members: members_of!(BlockerTables: counts, response, logarithms, logarithms_high, rings),
};

shared_struct! {
    /// Where `compose/shade_surface` finds the soft shadows.
    SoftPicture {
        /// Columns, rows, pixels from one to the next, 1 where there is one.
        size_step: [u32; 4],
    }
}

shared_struct! {
    /// A near light's camera, `shared/point_camera`. Twin: `visibility::point_maps::PointCamera`.
    PointCamera {
        /// World metres to column times w, texels.
        column: [f32; 4],
        /// World metres to row times w, texels.
        row: [f32; 4],
        /// World metres to w, metres along the axis.
        forward: [f32; 4],
        /// The light's place, and the near plane's distance (0: no map), metres.
        place_near: [f32; 4],
    }
}

shared_struct! {
    /// The cameras of all near lights.
    PointCameras {
        /// One for each.
        cameras: [PointCamera; MOST_LIGHTS],
    }
}

shared_struct! {
    /// The maps that one pass of `visibility/point_maps` draws.
    PointPage {
        /// First light, tiles a side, texels a side of a tile, 0.
        first_tiles_texels: [u32; 4],
    }
}

shared_struct! {
    /// The places of all near lights, `shared/point_camera`. Twin: `visibility::point_maps::PointCamera`.
    PointLights {
        /// Tiles a side of a page, maps a page, texels a side of a map, places a side of each light.
        tiles_maps_texels_side: [u32; 4],
        /// Half axes in the camera's axes, metres; the first one's fourth is the texel's side one metre off, metres, the
        /// second one's how far a view is shifted, texels for a metre aside.
        half_axes: [[[f32; 4]; 2]; MOST_LIGHTS],
    }
}

shared_struct! {
    /// Which light a pass of `nearfield/subtract` takes away.
    Turn {
        /// Its number, or 0xffff for the suns; 0, 0, 0.
        light: [u32; 4],
    }
}

shared_struct! {
    /// The suns of a known room, `nearfield/subtract`. Twin: `nearfield::sun_shadows`.
    SunTerms {
        /// Suns, 0, 0, 0.
        counts: [u32; 4],
        /// Unit vector towards each (world frame), and its irradiance; in the last w 1 + the number of the sun whose map of the
        /// objects it is hidden by, or 0.
        suns: [[[f32; 4]; 2]; MAX_HARD_LIGHTS],
    }
}

shared_struct! {
    /// A material, `compose/shade_object`. Twin: `compose::geometry::MaterialTerms`.
    MaterialTerms {
        /// Diffuse albedo.
        albedo_rgb: [f32; 4],
        /// Reflectance of lobe or mirror, and the exponent.
        specular_exponent: [f32; 4],
        /// Zonal factors of the lobe, bands 0 to 3.
        lobe_low: [f32; 4],
        /// Bands 4 and 5, the body.
        lobe_high: [f32; 4],
    }
}

shared_struct! {
    /// `shared/surroundings`. Twins: `compose::reflected`, `model::environment`.
    Surroundings {
        /// Spheres, triangles, levels, flags.
        counts: [u32; 4],
        /// 1 for the paper's Phong norm, 0, 0, 0.
        settings: [f32; 4],
        /// First row and texels a side of the picture and its levels.
        levels: [[u32; 4]; 12],
        /// Place, colour and body.
        spheres: [[[f32; 4]; 2]; MOST_SPHERES],
        /// Corner, two edges, albedo.
        triangles: [[[f32; 4]; 4]; MOST_TRIANGLES],
    }
}

shared_struct! {
    /// `compose/composite`.
    CompositeParams {
        /// Columns and rows of the picture; first column and row of the object layer.
        size_origin: [u32; 4],
        /// Multiplies the object layer's colours.
        layer_scale: f32,
        /// Bit 0: there is an object layer; bit 1: there are ratios.
        present: u32,
        /// Zeros.
        unused: [u32; 2],
    }
}

shared_struct! {
    /// `compose/tonemap`.
    TonemapParams {
        /// Groups of four pixels.
        quads: u32,
        /// The first cell of the start table.
        first_cell: u32,
        /// Seconds of the shown exposure, at unit gain.
        exposure_s: f32,
        /// 32-bit floats of the picture.
        floats: u32,
    }
}

/// A vertex of a virtual object.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct ObjectVertex {
    /// World frame, metres.
    pub position: [f32; 3],
    /// Unit.
    pub normal: [f32; 3],
    /// Linear RGB, and the share of the hemisphere that is open.
    pub tint_openness: [f32; 4],
    /// Soft light on what is matt, as in `Transferred::soft`.
    pub soft: [f32; 4],
    /// Soft light on what is glossy, as in `Transferred::gloss`.
    pub gloss: [f32; 3],
}

/// A vertex of a real surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct SurfaceVertex {
    /// World frame, metres; the fourth is 1 where virtual shadows fall on it.
    pub position: [f32; 4],
    /// Unit.
    pub normal: [f32; 3],
}

/// A corner of a triangle of a real surface; triangles share none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct RoomVertex {
    /// World frame, metres.
    pub position: [f32; 3],
    /// The facet's, unit.
    pub normal: [f32; 3],
    /// All light of the room that arrives, irradiance over pi.
    pub gathered: [f32; 3],
    /// Weights of the triangle's first two corners.
    pub weights: [f32; 2],
    /// Number of the triangle in the room, `u32::MAX` elsewhere.
    pub triangle: u32,
}
