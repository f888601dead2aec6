//! What is shown.

use super::{
    image::{RadianceImage, Rgb8Image},
    time::Timestamp,
};

/// A finished picture. `display` is always filled; `radiance` where linear output was asked for.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    /// Time of the camera frame under it.
    pub t: Timestamp,
    /// 8-bit RGB, back through the camera's response.
    pub display: Rgb8Image,
    /// Linear radiance before the response; same size.
    pub radiance: RadianceImage,
}

/// Which part of the work is shown in place of the picture, as Figures 3, 4 and 5 of [Now11] show them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PictureView {
    /// The light, equirectangular: as measured, all of it in SH, its hard half, its soft half.
    Light,
    /// Objects, and real surfaces in gray, in the hard half alone.
    Direct,
    /// The same in the soft half alone.
    Global,
    /// What virtual objects leave of the light on real surfaces, on white; the objects themselves are left out.
    Cast,
    /// Objects in white under an even sky: what they hide from themselves and from each other.
    SelfShadow,
    /// The picture with every object matt.
    Lambert,
    /// The picture with every object glossy.
    Phong,
    /// The picture with every object a mirror.
    Mirror,
    /// The spheres that stand for the objects where these block soft light.
    Blockers,
    /// The shadow maps, near white to far gray.
    Maps,
    /// The picture.
    #[default]
    Final,
}

impl PictureView {
    /// In the order of the names that `from_name` knows.
    pub const ALL: [Self; 11] = [
        Self::Light,
        Self::Direct,
        Self::Global,
        Self::Cast,
        Self::SelfShadow,
        Self::Lambert,
        Self::Phong,
        Self::Mirror,
        Self::Blockers,
        Self::Maps,
        Self::Final,
    ];

    /// Their names, in the order of [`Self::ALL`].
    pub const NAMES: [&str; 11] = [
        "light", "direct", "global", "cast", "self", "lambert", "phong", "mirror", "blockers", "maps",
        "final",
    ];

    /// As in settings.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().zip(Self::NAMES).find(|(view, _)| **view == self).map_or("final", |(_, name)| name)
    }

    /// Parses a name; `None` for one that is not known.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().zip(Self::NAMES).find(|(_, n)| *n == name).map(|(view, _)| view)
    }
}

#[cfg(test)]
mod tests {
    use super::PictureView;

    #[test]
    fn views_come_back_from_their_names() {
        for view in PictureView::ALL {
            assert_eq!(PictureView::from_name(view.name()), Some(view));
        }
        assert_eq!(PictureView::from_name("Final"), None);
        assert_eq!((PictureView::default().name(), PictureView::SelfShadow.name()), ("final", "self"));
    }
}
