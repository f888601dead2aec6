//! THE TABLE of passes: every fact about a pass stands here once, and everything else asks it. A pass has a name, and by
//! that name a twin `src/core/NAME.rs` and a shader `shaders/NAME.wgsl`.

use super::{decision::Effect, work::Amounts};
use crate::model::quality::{NearForm, Quality};

/// What passes hand on to each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Product {
    /// The camera's picture in linear radiance.
    LinearPicture,
    /// Directions with the radiance that arrives from them.
    LightSamples,
    /// Measured light as a spherical harmonic series.
    MeasuredLight,
    /// Depths along each hard light.
    ShadowMaps,
    /// What spheres take of the soft light on real surfaces, in a coarse picture.
    SoftShadows,
    /// Depths from each light of a known room.
    PointMaps,
    /// What virtual objects leave of the light on real surfaces, for each pixel.
    Ratios,
    /// Virtual objects over nothing: premultiplied radiance and coverage.
    ObjectLayer,
    /// The composed picture, linear.
    Radiance,
    /// The composed picture in 8 bits.
    Display,
}

impl Product {
    /// All, in the order in which a frame makes them.
    pub const ALL: [Self; 10] = [
        Self::LinearPicture,
        Self::LightSamples,
        Self::MeasuredLight,
        Self::ShadowMaps,
        Self::SoftShadows,
        Self::PointMaps,
        Self::Ratios,
        Self::ObjectLayer,
        Self::Radiance,
        Self::Display,
    ];

    /// The passes that make it; a frame runs one of them at most.
    pub const fn makers(self) -> PassSet {
        let (mut set, mut i) = (PassSet(0), 0);
        while i < FACTS.len() {
            if FACTS[i].writes as u8 == self as u8 {
                set.insert(Pass::ALL[i]);
            }
            i += 1;
        }
        set
    }
}

/// What a shader of a pass does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShaderKind {
    /// It computes.
    Compute,
    /// It draws triangles of its own.
    Draw,
    /// It draws triangles of the scene.
    DrawScene,
}

/// One of several ways to draw an effect, of which the settings choose one.
#[derive(Debug)]
pub struct PassForm {
    /// Whether it is chosen.
    pub is_chosen: fn(&Quality) -> bool,
    /// Why it runs; `None`: because its effect is called for.
    pub reason: Option<&'static str>,
    /// Why it is left out where another form is chosen.
    pub otherwise: &'static str,
}

/// All that is to be known of a pass.
#[derive(Debug)]
pub struct PassFacts {
    /// The kernel's name: stem of the twin and of the shader.
    pub name: &'static str,
    /// The effect that calls for it.
    pub effect: Effect,
    /// Where the effect can be drawn in several ways: which one this is.
    pub form: Option<PassForm>,
    /// Whether it measures the light rather than draws: engines have calls of their own for those.
    pub measures: bool,
    /// Results of other passes that it reads where they are there.
    pub reads: &'static [Product],
    /// Its result.
    pub writes: Product,
    /// Whether it is done for each pixel of the picture: a device that cannot hold such a picture leaves it to the twin.
    pub per_pixel: bool,
    /// What its shader does.
    pub shader: ShaderKind,
    /// Why the result of an earlier frame will do, where that can be; `None`: it is made in every frame.
    pub kept_because: Option<&'static str>,
    /// How much work it is, in the units of `plan::work`.
    pub work: fn(&Amounts) -> f32,
}

/// Declares the passes in the order in which a frame runs them.
macro_rules! passes {
    ($($(#[$doc:meta])* $pass:ident: $facts:expr;)*) => {
        /// A pass that an engine knows.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Pass {
            $($(#[$doc])* $pass,)*
        }

        impl Pass {
            /// All passes in the order in which a frame runs them.
            pub const ALL: [Self; [$(stringify!($pass)),*].len()] = [$(Self::$pass),*];
        }

        const FACTS: &[PassFacts; Pass::ALL.len()] = &[$($facts),*];
    };
}

/// Nothing that counts has changed since.
const UNCHANGED: Option<&str> = Some("neither light nor camera nor objects have changed");

passes! {
    /// Exposures of one view become one picture of linear radiance.
    MergeBracket: PassFacts {
        name: "hdr/merge_bracket",
        effect: Effect::BracketMerge,
        form: None,
        measures: true,
        reads: &[],
        writes: Product::LinearPicture,
        per_pixel: false,
        shader: ShaderKind::Compute,
        kept_because: None,
        work: |a| 4.0 * a.pixels() * a.brackets as f32,
    };
    /// The mirror ball is read out of the picture.
    UnwrapBall: PassFacts {
        name: "light/unwrap_ball",
        effect: Effect::BallUnwrap,
        form: None,
        measures: true,
        reads: &[Product::LinearPicture],
        writes: Product::LightSamples,
        per_pixel: false,
        shader: ShaderKind::Compute,
        kept_because: None,
        work: |_| 30.0 * Amounts::BALL_SAMPLES,
    };
    /// Measured light becomes spherical harmonics.
    ProjectSh: PassFacts {
        name: "light/project_sh",
        effect: Effect::ShProjection,
        form: None,
        measures: true,
        reads: &[Product::LightSamples],
        writes: Product::MeasuredLight,
        per_pixel: false,
        shader: ShaderKind::Compute,
        kept_because: None,
        work: |a| 0.5 * Amounts::BALL_SAMPLES * a.coefficients as f32,
    };
    /// The shadow maps of hard lights.
    ShadowMaps: PassFacts {
        name: "visibility/shadow_maps",
        effect: Effect::ShadowMaps,
        form: None,
        measures: false,
        reads: &[],
        writes: Product::ShadowMaps,
        per_pixel: false,
        shader: ShaderKind::DrawScene,
        kept_because: Some("neither objects nor lights nor what the maps are fitted to have changed"),
        work: |a| a.maps as f32 * (0.2 * (a.map_texels as f32).powi(2) + 10.0 * a.vertices as f32),
    };
    /// What virtual objects, as spheres, take of the soft light on real surfaces.
    SoftShadow: PassFacts {
        name: "compose/soft_shadow",
        effect: Effect::SoftShadows,
        form: None,
        measures: false,
        reads: &[],
        writes: Product::SoftShadows,
        per_pixel: true,
        shader: ShaderKind::DrawScene,
        kept_because: UNCHANGED,
        work: |a| 5.0 * a.pixels() / (a.soft_step_px.max(1) as f32).powi(2) * a.spheres as f32,
    };
    /// The shadow maps of a known room's lights.
    PointMaps: PassFacts {
        name: "visibility/point_maps",
        effect: Effect::NearMaps,
        form: None,
        measures: false,
        reads: &[],
        writes: Product::PointMaps,
        per_pixel: false,
        shader: ShaderKind::Draw,
        kept_because: Some(
            "neither objects nor the room's lights nor what the maps are fitted to have changed",
        ),
        work: |a| a.near_lights as f32 * (0.2 * (a.near_texels as f32).powi(2) + 2.0 * a.vertices as f32),
    };
    /// What virtual objects leave of a known room's light, as a ratio for each pixel.
    Subtract: PassFacts {
        name: "nearfield/subtract",
        effect: Effect::NearShadows,
        form: Some(PassForm {
            is_chosen: |quality| quality.near_form == NearForm::Ratio,
            reason: None,
            otherwise: "the known room's light is taken from 8-bit values",
        }),
        measures: false,
        reads: &[Product::ShadowMaps, Product::PointMaps],
        writes: Product::Ratios,
        per_pixel: true,
        shader: ShaderKind::DrawScene,
        kept_because: UNCHANGED,
        work: Amounts::near_light,
    };
    /// The same, taken from 8-bit values light by light; it depends on the camera's picture.
    SubtractDisplayed: PassFacts {
        name: "nearfield/subtract_displayed",
        effect: Effect::NearShadows,
        form: Some(PassForm {
            is_chosen: |quality| quality.near_form == NearForm::Ldr,
            reason: Some("virtual objects stand in a known room, and 8-bit values were asked for"),
            otherwise: "the known room's light is taken in linear light, as a ratio",
        }),
        measures: false,
        reads: &[Product::ShadowMaps, Product::PointMaps],
        writes: Product::Ratios,
        per_pixel: true,
        shader: ShaderKind::DrawScene,
        kept_because: None,
        work: Amounts::near_light,
    };
    /// Objects into a layer of premultiplied radiance and coverage, hidden by real surfaces.
    ShadeObject: PassFacts {
        name: "compose/shade_object",
        effect: Effect::Objects,
        form: None,
        measures: false,
        reads: &[Product::ShadowMaps, Product::PointMaps],
        writes: Product::ObjectLayer,
        per_pixel: true,
        shader: ShaderKind::DrawScene,
        kept_because: UNCHANGED,
        work: |a| 3.0 * a.pixels() + a.vertex_light(),
    };
    /// What virtual objects leave of the light on real surfaces, as a ratio for each pixel.
    ShadeSurface: PassFacts {
        name: "compose/shade_surface",
        effect: Effect::SurfaceShadows,
        form: None,
        measures: false,
        reads: &[Product::ShadowMaps, Product::SoftShadows],
        writes: Product::Ratios,
        per_pixel: true,
        shader: ShaderKind::DrawScene,
        kept_because: UNCHANGED,
        work: |a| 6.0 * a.pixels() + 2.0 * a.pixels() * a.maps as f32,
    };
    /// Background x ratio under the object layer.
    Composite: PassFacts {
        name: "compose/composite",
        effect: Effect::Composition,
        form: None,
        measures: false,
        reads: &[Product::Ratios, Product::ObjectLayer],
        writes: Product::Radiance,
        per_pixel: true,
        shader: ShaderKind::Compute,
        kept_because: None,
        work: Amounts::pixels,
    };
    /// Back through the camera's response.
    Tonemap: PassFacts {
        name: "compose/tonemap",
        effect: Effect::ToneMapping,
        form: None,
        measures: false,
        reads: &[Product::Radiance],
        writes: Product::Display,
        per_pixel: true,
        shader: ShaderKind::Compute,
        kept_because: None,
        work: |a| 3.0 * a.pixels(),
    };
}

impl Pass {
    /// All names, in the order of [`Pass::ALL`].
    pub const NAMES: [&'static str; Self::ALL.len()] = {
        let (mut names, mut i) = ([""; Self::ALL.len()], 0);
        while i < names.len() {
            names[i] = FACTS[i].name;
            i += 1;
        }
        names
    };

    /// Its row of the table.
    pub const fn facts(self) -> &'static PassFacts {
        &FACTS[self as usize]
    }

    /// The kernel's name: stem of the twin and of the shader.
    pub const fn name(self) -> &'static str {
        self.facts().name
    }

    /// Whether it measures the light rather than draws: engines have calls of their own for those.
    pub const fn is_measuring(self) -> bool {
        self.facts().measures
    }

    /// Whether its shader has vertex and fragment stages.
    pub const fn draws_triangles(self) -> bool {
        !matches!(self.facts().shader, ShaderKind::Compute)
    }

    /// Whether its shader draws triangles of the scene.
    pub const fn draws_scene(self) -> bool {
        matches!(self.facts().shader, ShaderKind::DrawScene)
    }

    /// The passes whose results it reads where they are there.
    pub const fn reads(self) -> PassSet {
        let (mut set, mut i) = (PassSet(0), 0);
        while i < self.facts().reads.len() {
            set = set.join(self.facts().reads[i].makers());
            i += 1;
        }
        set
    }
}

/// Some of the passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PassSet(u16);

impl PassSet {
    /// These.
    pub const fn of(passes: &[Pass]) -> Self {
        let (mut set, mut i) = (Self(0), 0);
        while i < passes.len() {
            set.insert(passes[i]);
            i += 1;
        }
        set
    }

    /// Those of which something is true.
    pub fn where_true(is: impl Fn(Pass) -> bool) -> Self {
        let mut set = Self::default();
        Pass::ALL.into_iter().filter(|pass| is(*pass)).for_each(|pass| set.insert(pass));
        set
    }

    /// Adds one.
    pub const fn insert(&mut self, pass: Pass) {
        self.0 |= 1 << pass as u16;
    }

    /// Whether one is among them.
    pub const fn has(self, pass: Pass) -> bool {
        self.0 >> pass as u16 & 1 == 1
    }

    /// Those that are in both.
    pub const fn meet(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Those that are in either.
    pub const fn join(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether one of them makes this product.
    pub const fn make(self, product: Product) -> bool {
        self.meet(product.makers()).0 != 0
    }

    /// In the order of a frame.
    pub fn iter(self) -> impl Iterator<Item = Pass> {
        Pass::ALL.into_iter().filter(move |pass| self.has(*pass))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pass_reads_what_an_earlier_one_wrote() {
        for pass in Pass::ALL {
            for product in pass.facts().reads {
                assert!(product.makers().iter().all(|maker| maker < pass), "{pass:?} reads {product:?}");
                assert!(product.makers().iter().next().is_some(), "nobody makes {product:?}");
            }
        }
        assert!(Product::ALL.into_iter().enumerate().all(|(i, product)| product as usize == i));
    }

    #[test]
    fn sets_of_passes_are_the_table_s() {
        use Pass::{Composite, PointMaps, ShadeObject, ShadeSurface, ShadowMaps, SoftShadow, Subtract};
        assert_eq!(ShadeSurface.reads(), PassSet::of(&[ShadowMaps, SoftShadow]));
        assert_eq!(
            Composite.reads(),
            PassSet::of(&[ShadeObject, ShadeSurface]).join(Product::Ratios.makers())
        );
        assert!(PassSet::of(&[Subtract]).make(Product::Ratios));
        assert!(!PassSet::of(&[ShadeObject, PointMaps]).make(Product::Ratios));
        assert!(!PointMaps.draws_scene() && PointMaps.draws_triangles() && ShadowMaps.draws_scene());
    }

    #[test]
    fn only_what_depends_on_no_new_picture_is_kept() {
        // The camera's picture is new in every frame; what reads it, or what is made from it, is made anew.
        let depends = PassSet::of(&[Pass::SubtractDisplayed, Pass::Composite, Pass::Tonemap]);
        for pass in Pass::ALL {
            let is_new = pass.is_measuring() || depends.has(pass);
            assert_eq!(pass.facts().kept_because.is_none(), is_new, "{pass:?}");
        }
    }

    #[test]
    fn of_the_forms_of_an_effect_the_settings_choose_one() {
        for near_form in [NearForm::Ratio, NearForm::Ldr] {
            let quality = Quality { near_form, ..Quality::default() };
            for effect in Effect::ALL.into_iter().filter(|effect| effect.pass().is_some()) {
                let chosen = |pass: &Pass| {
                    let facts = pass.facts();
                    facts.effect == effect
                        && facts.form.as_ref().is_none_or(|form| (form.is_chosen)(&quality))
                };
                assert_eq!(Pass::ALL.iter().filter(|pass| chosen(pass)).count(), 1, "{effect:?}");
            }
        }
    }
}
