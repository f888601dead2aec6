//! The virtual room: its solids, its lights, and the radiance along a ray.

use super::{
    bake::{FaceLight, Fineness, bake},
    furnish,
    options::SyntheticSubject,
    paint::Paint,
    shapes::{Meeting, SyntheticShape, passes},
};
use crate::model::rig::MirrorBall;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// Whether the mirror ball is there. Without it the table is lit as if it had never been there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyntheticBallView {
    /// The room as the camera sees it.
    Present,
    /// The room without the ball and without its shadow on the table.
    Absent,
}

/// What a face is, for the fineness of its light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The surface that things stand on.
    TableTop,
    /// Something on the table.
    OnTable,
    /// Everything else.
    Far,
}

/// One thing of the room.
#[derive(Clone, Debug)]
pub struct Solid {
    /// Its form.
    pub shape: SyntheticShape,
    /// The paint of each face (the last one repeats).
    pub paints: Vec<Paint>,
    /// The lamp.
    pub shines: bool,
    /// The mirror ball.
    pub mirror: bool,
    /// Whether it stands on the table.
    pub on_table: bool,
    /// Irradiance of each face.
    pub light: Vec<FaceLight>,
    /// The box around it, and the ball around that.
    pub(super) bounds: (DVec3, DVec3),
    pub(super) middle: DVec3,
    pub(super) reach: f64,
}

impl Solid {
    /// A solid of one form and some paints.
    pub fn new(shape: SyntheticShape, paints: &[Paint]) -> Self {
        let bounds = shape.bounds();
        Self {
            light: vec![FaceLight::default(); shape.faces()],
            middle: (bounds.0 + bounds.1) / 2.0,
            reach: (bounds.1 - bounds.0).length() / 2.0,
            bounds,
            shape,
            paints: paints.to_vec(),
            shines: false,
            mirror: false,
            on_table: false,
        }
    }

    fn paint(&self, face: usize) -> Paint {
        self.paints[face.min(self.paints.len() - 1)]
    }
}

/// A globe that shines like a spotlight: its radiance depends on the direction in which it leaves.
#[derive(Clone, Copy, Debug)]
pub struct Lamp {
    /// Its middle.
    pub centre: DVec3,
    /// Metres; above 0.
    pub radius: f64,
    /// Where it is aimed, unit.
    pub axis: DVec3,
    /// Linear RGB along the axis.
    pub radiance: DVec3,
}

impl Lamp {
    /// Radiance that leaves in a direction: full within 8 degrees of the axis, a seventh beyond 40.
    pub fn radiance(&self, leaving: DVec3) -> DVec3 {
        const INNER: f64 = 0.990_27;
        const SPILL: f64 = 0.14;
        const OUTER: f64 = 0.766_04;
        let t = ((leaving.dot(self.axis) - OUTER) / (INNER - OUTER)).clamp(0.0, 1.0);
        self.radiance * (SPILL + (1.0 - SPILL) * t * t * (3.0 - 2.0 * t))
    }
}

/// An opening in the wall at the smallest x, with a sky outside at infinity.
#[derive(Clone, Copy, Debug)]
pub struct RoomWindow {
    /// Lower corner: the wall's x, smallest y and z.
    pub low: DVec3,
    /// Lengths along y and z.
    pub size: DVec2,
    /// Scale of the sky's radiance.
    pub radiance: f64,
}

impl RoomWindow {
    /// A point of the opening.
    pub fn point(&self, uv: DVec2) -> DVec3 {
        self.low + DVec3::new(0.0, uv.x * self.size.x, uv.y * self.size.y)
    }

    /// The middle of the opening.
    pub fn middle(&self) -> DVec3 {
        self.point(DVec2::splat(0.5))
    }

    /// Half its diagonal.
    pub fn reach(&self) -> f64 {
        self.size.length() / 2.0
    }

    /// Square metres.
    pub fn area(&self) -> f64 {
        self.size.x * self.size.y
    }

    /// Whether a point of the wall lies in the opening.
    fn holds(&self, p: DVec3) -> bool {
        let q = DVec2::new(p.y - self.low.y, p.z - self.low.z);
        q.cmpge(DVec2::ZERO).all() && q.cmple(self.size).all()
    }

    /// What is seen through it in a direction: sky that is brighter towards the sun behind thin cloud, trees below.
    pub fn radiance(&self, d: DVec3) -> DVec3 {
        let glow_towards = DVec3::new(-0.80, 0.10, 0.59);
        let glow = (14.0 * (d.dot(glow_towards) - 1.0)).exp();
        let sky = DVec3::new(0.80, 0.95, 1.12) * (0.75 + 0.5 * d.z.clamp(0.0, 1.0))
            + DVec3::new(1.06, 1.0, 0.90) * (1.1 * glow);
        let trees = DVec3::new(0.10, 0.15, 0.06);
        let line = 0.02 + 0.03 * (d.y * 9.0).sin() + 0.015 * (d.y * 31.0 + 1.0).sin();
        let blend = ((d.z - line) / 0.02).clamp(0.0, 1.0);
        trees.lerp(sky, blend) * self.radiance
    }
}

/// The room, furnished and lit.
#[derive(Clone, Debug)]
pub struct SyntheticRoom {
    /// All solids; the walls come first.
    pub solids: Vec<Solid>,
    /// The lamp; one of the solids has its form.
    pub lamp: Lamp,
    /// A wide light.
    pub window: RoomWindow,
    /// Solid and face of the table's top.
    pub table_top: (usize, usize),
    /// The table's light without the ball.
    pub bare_table: FaceLight,
    ball: usize,
    ball_facts: MirrorBall,
    lamp_solid: usize,
    groups: Vec<SolidGroup>,
}

/// Solids that stand together (all after the walls), with the box around them.
#[derive(Clone, Debug)]
struct SolidGroup {
    bounds: (DVec3, DVec3),
    members: std::ops::Range<usize>,
}

impl SolidGroup {
    fn of(solids: &[Solid], members: std::ops::Range<usize>) -> Self {
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let bounds = solids[members.clone()]
            .iter()
            .fold(empty, |(low, high), s| (low.min(s.bounds.0), high.max(s.bounds.1)));
        Self { bounds, members }
    }
}

/// Where a ray ends.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Which solid.
    pub solid: usize,
    /// Where on it.
    pub meeting: Meeting,
}

impl SyntheticRoom {
    /// The furnished room with all its light baked.
    pub fn new(view: SyntheticSubject, fineness: Fineness) -> Self {
        let plan = furnish::furnish(view);
        let position = |test: &dyn Fn(&Solid) -> bool| plan.solids.iter().position(test).unwrap_or(0);
        let mut room = Self {
            table_top: (plan.table, 5),
            ball: position(&|s| s.mirror),
            lamp_solid: position(&|s| s.shines),
            lamp: plan.lamp,
            window: plan.window,
            bare_table: FaceLight::default(),
            ball_facts: plan.ball,
            groups: plan.groups.windows(2).map(|w| SolidGroup::of(&plan.solids, w[0]..w[1])).collect(),
            solids: plan.solids,
        };
        bake(&mut room, fineness);
        room
    }

    /// Where it stands on the table, and how large it is.
    pub fn ball(&self) -> MirrorBall {
        self.ball_facts
    }

    /// What a face is.
    pub fn role(&self, solid: usize, face: usize) -> Role {
        match self.solids[solid].on_table {
            _ if (solid, face) == self.table_top => Role::TableTop,
            true => Role::OnTable,
            false => Role::Far,
        }
    }

    /// The nearest meeting of a ray with the room.
    pub fn trace(&self, origin: DVec3, direction: DVec3, ball: SyntheticBallView) -> Option<Hit> {
        let inverse = direction.recip();
        let walls = self.solids[0].shape.meet(origin, direction, 1e-6, f64::INFINITY);
        let mut best = walls.map(|meeting| Hit { solid: 0, meeting });
        let mut limit = best.map_or(f64::INFINITY, |hit| hit.meeting.t);
        for group in self.groups.iter().filter(|g| passes(&g.bounds, origin, inverse, f64::INFINITY)) {
            for index in group.members.clone() {
                let solid = &self.solids[index];
                if (index == self.ball && ball == SyntheticBallView::Absent)
                    || !passes(&solid.bounds, origin, inverse, limit)
                {
                    continue;
                }
                if let Some(meeting) = solid.shape.meet(origin, direction, 1e-6, limit) {
                    limit = meeting.t;
                    best = Some(Hit { solid: index, meeting });
                }
            }
        }
        best
    }

    /// Whether anything but walls and lamp stands between the origin and `distance`.
    pub fn occluded(&self, origin: DVec3, direction: DVec3, distance: f64, ball: SyntheticBallView) -> bool {
        let inverse = direction.recip();
        self.groups.iter().filter(|g| passes(&g.bounds, origin, inverse, distance)).any(|group| {
            group.members.clone().any(|index| {
                let solid = &self.solids[index];
                index != self.lamp_solid
                    && !(index == self.ball && ball == SyntheticBallView::Absent)
                    && passes(&solid.bounds, origin, inverse, distance)
                    && solid.shape.meet(origin, direction, 1e-6, distance).is_some()
            })
        })
    }

    /// The solids that come nearer than `reach` to a segment, as a set of bits (a solid above the 63rd has none).
    pub fn near_segment(&self, from: DVec3, to: DVec3, reach: f64, ball: SyntheticBallView) -> RoomBlockers {
        let along = to - from;
        let length = along.length_squared();
        let mut set = 0u64;
        for (index, solid) in self.solids.iter().enumerate().skip(1) {
            if index == self.lamp_solid || (index == self.ball && ball == SyntheticBallView::Absent) {
                continue;
            }
            let t = ((solid.middle - from).dot(along) / length).clamp(0.0, 1.0);
            // The shaft from a point to the lamp widens evenly.
            let near = reach * t + solid.reach;
            if (from + along * t - solid.middle).length_squared() < near * near {
                set |= 1 << index.min(63);
            }
        }
        RoomBlockers(set)
    }

    /// Whether the ball comes nearer than `reach` to a segment.
    pub fn ball_near_segment(&self, from: DVec3, to: DVec3, reach: f64) -> bool {
        self.near_segment(from, to, reach, SyntheticBallView::Present).0 >> self.ball.min(63) & 1 == 1
    }

    /// Whether one of these solids stands between the origin and `distance`.
    pub fn blocked(&self, origin: DVec3, direction: DVec3, distance: f64, blockers: &RoomBlockers) -> bool {
        let inverse = direction.recip();
        let mut set = blockers.0;
        while set != 0 {
            let solid = &self.solids[set.trailing_zeros() as usize];
            set &= set - 1;
            if passes(&solid.bounds, origin, inverse, distance)
                && solid.shape.meet(origin, direction, 1e-6, distance).is_some()
            {
                return true;
            }
        }
        false
    }

    /// Radiance that a surface sends out; lamps and the window count only where `with_lights`.
    fn sent(
        &self,
        hit: &Hit,
        direction: DVec3,
        point: DVec3,
        ball: SyntheticBallView,
        with_lights: bool,
    ) -> DVec3 {
        let solid = &self.solids[hit.solid];
        if solid.shines {
            return if with_lights { self.lamp.radiance(-direction) } else { DVec3::ZERO };
        }
        let face = hit.meeting.face;
        if hit.solid == 0 && face == 0 && self.window.holds(point) {
            return if with_lights { self.window.radiance(direction) } else { DVec3::ZERO };
        }
        let light = if ball == SyntheticBallView::Absent && (hit.solid, face) == self.table_top {
            &self.bare_table
        } else {
            &solid.light[face]
        };
        let albedo = solid.paint(face).albedo(hit.meeting.uv, solid.shape.face_size(face), point);
        albedo * light.sample(hit.meeting.uv) / PI
    }

    fn along(
        &self,
        origin: DVec3,
        direction: DVec3,
        ball: SyntheticBallView,
        with_lights: bool,
    ) -> (DVec3, usize) {
        let Some(hit) = self.trace(origin, direction, ball) else { return (DVec3::ZERO, usize::MAX) };
        let point = origin + direction * hit.meeting.t;
        if !self.solids[hit.solid].mirror {
            return (self.sent(&hit, direction, point, ball, with_lights), hit.solid);
        }
        let n = hit.meeting.normal;
        let reflected = direction - n * (2.0 * direction.dot(n));
        let start = point + n * 1e-7;
        let reflectance = glam::Vec3::from(self.ball_facts.reflectance_rgb).as_dvec3();
        let Some(second) = self.trace(start, reflected, ball) else { return (DVec3::ZERO, hit.solid) };
        let there = start + reflected * second.meeting.t;
        (reflectance * self.sent(&second, reflected, there, ball, with_lights), hit.solid)
    }

    /// Radiance that comes back along a ray, with one reflection on the ball, and which solid is seen.
    pub fn radiance(&self, origin: DVec3, direction: DVec3, ball: SyntheticBallView) -> (DVec3, usize) {
        self.along(origin, direction, ball, true)
    }

    /// The same without the lights themselves: what bounces.
    pub fn bounced(&self, origin: DVec3, direction: DVec3, ball: SyntheticBallView) -> DVec3 {
        self.along(origin, direction, ball, false).0
    }

    /// Whether this solid is the ball.
    pub fn is_ball(&self, solid: usize) -> bool {
        solid == self.ball
    }

    /// Radiance of the table's top at a point of the plane z = 0, as if the ball had never been there;
    /// `None` beside the table.
    pub fn bare_table_radiance(&self, point: DVec2) -> Option<DVec3> {
        let (table, face) = self.table_top;
        let solid = &self.solids[table];
        let size = solid.shape.face_size(face);
        let uv = (point - solid.bounds.0.truncate()) / size;
        let inside = uv.cmpge(DVec2::ZERO).all() && uv.cmple(DVec2::ONE).all();
        inside
            .then(|| solid.paint(face).albedo(uv, size, point.extend(0.0)) * self.bare_table.sample(uv) / PI)
    }
}

/// A set of solids.
#[derive(Clone, Copy, Debug)]
pub struct RoomBlockers(u64);

impl RoomBlockers {
    /// Whether there is none.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }
}
