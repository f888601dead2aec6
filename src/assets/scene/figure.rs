//! How the objects of a scene file move, and how many spheres stand for them.

use super::walk::{Section, numbers};
use crate::animate::walk::{MAX_TURN_DEG, MIN_SIDE_M, round_corners};
use crate::gltf::DEFAULT_SPHERES;
use crate::model::animation::{
    AnimationChannel, Attachment, Clip, Figure, FigurePart, Interpolation, Joint, Moves, Playing, Skeleton,
    SkeletonNode, Transform, Walk,
};
use crate::model::limits::MAX_PLACE_M;
use glam::{Affine3A, Vec2, Vec4};

/// Clips that a message names at most.
const MOST_NAMED: usize = 30;

/// What `[[object]]` says about movement.
pub struct Movement {
    /// A clip's name, and how it is played.
    pub animation: Option<String>,
    from_s: f64,
    speed: f64,
    /// The way that it walks round and round.
    pub walk: Option<Walk>,
    /// Where it is carried: its moving, as a clip of the one node of a body that keeps its shape.
    pub carried: Option<Clip>,
    sphere_count: usize,
}

/// Reads the keys `animation`, `animation_speed`, `animation_start_s`, `path`, `path_speed_m_s` and `spheres`.
pub fn movement(section: &Section<'_>) -> Movement {
    let animation = section.text("animation").map(str::to_owned);
    let speed = section.number("animation_speed", -100.0, 100.0);
    let from_s = section.number("animation_start_s", -1e6, 1e6);
    if animation.is_none() {
        for (key, given) in [("animation_speed", speed.is_some()), ("animation_start_s", from_s.is_some())] {
            if given {
                section.refuse(key, "left out where there is no animation");
            }
        }
    }
    let legs = section.read(
        "path",
        &format!(
            "at least 3 corners of two numbers within {MAX_PLACE_M} m of 0, {MIN_SIDE_M} m or more apart, none of which turns by more than {MAX_TURN_DEG} degrees"
        ),
        |v| {
            let corner = |p: &toml::Value| {
                numbers(p)
                    .filter(|l| l.len() == 2 && l.iter().all(|x| x.abs() <= MAX_PLACE_M))
                    .map(|l| Vec2::new(l[0] as f32, l[1] as f32))
            };
            let corners: Vec<Vec2> = v.as_array()?.iter().map(corner).collect::<Option<_>>()?;
            round_corners(&corners)
        },
    );
    let speed_m_s = section.number("path_speed_m_s", 0.0, 100.0);
    if section.has("path") && !section.has("path_speed_m_s") {
        section.refuse("path_speed_m_s", "given with path, metres a second");
    }
    if section.has("path_speed_m_s") && !section.has("path") {
        section.refuse("path_speed_m_s", "left out where there is no path");
    }
    if section.has("path") && section.has("position") {
        section.refuse("position", "left out where there is a path");
    }
    let walk = legs.zip(speed_m_s).map(|(legs, speed_m_s)| Walk { legs, speed_m_s });
    let carried = section.read(
        "carry",
        "at least 2 rows of four numbers, time_s, x, y and z, times from 0 on, rising, all within 10000 of 0",
        |v| carried(&v.as_array()?.iter().map(numbers).collect::<Option<Vec<_>>>()?),
    );
    for key in ["path", "position", "animation"] {
        if section.has("carry") && section.has(key) {
            section.refuse(key, "left out where there is carry");
        }
    }
    let sphere_count = section.read("spheres", "a whole number within 4..=64", |v| {
        usize::try_from(v.as_integer()?).ok().filter(|n| (4..=64).contains(n))
    });
    Movement {
        animation,
        from_s: from_s.unwrap_or(0.0),
        speed: speed.unwrap_or(1.0),
        walk,
        carried,
        sphere_count: sphere_count.unwrap_or(DEFAULT_SPHERES),
    }
}

impl Movement {
    /// The figure, playing what was asked for; a mistake where it does not have that clip.
    pub fn figure(self, section: &Section<'_>, mut figure: Figure, name: String, place: Affine3A) -> Figure {
        figure.name = name;
        figure.world_from_figure = place;
        figure.walk = self.walk;
        figure.sphere_count = self.sphere_count;
        if let Some(mut clip) = self.carried {
            // Its places are the world's, its node's are the figure's.
            let figure_from_world = place.matrix3.inverse();
            for value in clip.channels.iter_mut().flat_map(|c| &mut c.values) {
                *value = (figure_from_world * value.truncate()).extend(0.0);
            }
            figure.clips = vec![clip];
            figure.playing = Some(Playing { clip: 0, from_s: 0.0, speed: 1.0, looped: false });
        }
        if let Some(wanted) = self.animation {
            match figure.clips.iter().position(|clip| clip.name == wanted) {
                Some(clip) => {
                    let (from_s, speed) = (self.from_s, self.speed);
                    figure.playing = Some(Playing { clip, from_s, speed, looped: true });
                }
                None if figure.clips.is_empty() => {
                    section.refuse("animation", "left out: the file has no animation");
                }
                None => {
                    let names = figure.clips.iter().take(MOST_NAMED).map(|c| format!("{:?}", c.name));
                    let names: Vec<String> = names.collect();
                    let more = figure.clips.len() - names.len();
                    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                    section.refuse("animation", format!("one of {}{more}", names.join(", ")));
                }
            }
        }
        figure
    }
}

/// A smooth way through places at times: at each the velocity of the straight line between its neighbours, at rest at both ends.
/// `None` where rows are not four numbers, fewer than 2, not finite, or their times do not rise.
fn carried(rows: &[Vec<f64>]) -> Option<Clip> {
    let sound = |r: &Vec<f64>| r.len() == 4 && r.iter().all(|v| v.abs() <= MAX_PLACE_M);
    if rows.len() < 2 || !rows.iter().all(sound) || rows.windows(2).any(|w| w[1][0] - w[0][0] < 1e-3) {
        return None;
    }
    let mut rows = rows.to_vec();
    if rows[0][0] < 0.0 {
        return None;
    }
    if rows[0][0] > 0.0 {
        // It waits where it is first.
        rows.insert(0, vec![0.0, rows[0][1], rows[0][2], rows[0][3]]);
    }
    let place = |k: usize| Vec4::new(rows[k][1] as f32, rows[k][2] as f32, rows[k][3] as f32, 0.0);
    let mut values = Vec::with_capacity(3 * rows.len());
    for k in 0..rows.len() {
        let slope = if k == 0 || k + 1 == rows.len() {
            Vec4::ZERO
        } else {
            (place(k + 1) - place(k - 1)) / (rows[k + 1][0] - rows[k - 1][0]) as f32
        };
        values.extend([slope, place(k), slope]);
    }
    let (first, last) = (rows[0][0], rows[rows.len() - 1][0]);
    let channel = AnimationChannel {
        node: 0,
        moves: Moves::Translation,
        interpolation: Interpolation::CubicSpline,
        times_s: rows.iter().map(|r| r[0] as f32).collect(),
        values,
    };
    Some(Clip {
        name: "carried".into(),
        start_s: first as f32,
        duration_s: (last - first) as f32,
        channels: vec![channel],
    })
}

/// A body that keeps its shape: one node, on which `objects` objects hang as they are.
pub fn static_figure(objects: usize) -> Figure {
    let node = SkeletonNode { name: "body".into(), parent: None, rest: Transform::IDENTITY };
    let part = |object| FigurePart { object, attachment: Attachment::Rigid { joint: 0 } };
    Figure {
        name: String::new(),
        skeleton: Skeleton {
            nodes: vec![node],
            joints: vec![Joint { node: 0, node_from_bind: Affine3A::IDENTITY }],
            figure_from_root: Affine3A::IDENTITY,
        },
        clips: Vec::new(),
        parts: (0..objects).map(part).collect(),
        world_from_figure: Affine3A::IDENTITY,
        playing: None,
        walk: None,
        sphere_count: DEFAULT_SPHERES,
        spheres: Vec::new(),
        boxes: Vec::new(),
    }
}
