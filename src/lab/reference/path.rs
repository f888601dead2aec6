//! Light along one camera ray, with and without the virtual bodies at once.
//!
//! From every matt or glossy point one direction is drawn, from a mixture of what lights it (environment, shining
//! triangles) and of what it reflects, and what is seen along it is divided by the density of the whole mixture: multiple
//! importance sampling by the balance heuristic, with a single ray. Both pictures share all numbers and, up to the first
//! virtual body, all rays: the picture without costs next to nothing more, and the difference has noise only where it is
//! not zero.

use super::{
    emitters::Emitters,
    environment::Sky,
    reflect::{Reflects, mirror},
    scene::{Emission, TraceScene},
    sequence::Sequence,
    world::{Bodies, MetBody, SurfaceMeeting},
};
use crate::math::{
    bvh::PreparedRay,
    lens::{Distortion, Lens},
    sh::zonal::PhongNorm,
};
use crate::model::scene::Material;
use glam::{DVec2, Mat3, Vec3};

/// Mirrors that the camera sees one in the other at most.
const MOST_MIRRORS: u32 = 16;

/// Which of the two pictures light belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PictureSide {
    Both,
    With,
    Without,
}

/// Radiance in the two pictures.
#[derive(Clone, Copy, Debug, Default)]
pub struct RadiancePair {
    /// With the virtual bodies.
    pub with: Vec3,
    /// Without them.
    pub without: Vec3,
}

impl RadiancePair {
    fn of(side: PictureSide, light: Vec3) -> Self {
        let keep = |wanted: bool| if wanted { light } else { Vec3::ZERO };
        Self { with: keep(side != PictureSide::Without), without: keep(side != PictureSide::With) }
    }

    fn add(&mut self, factor: Vec3, other: Self) {
        self.with += factor * other.with;
        self.without += factor * other.without;
    }
}

/// What one camera ray gave.
#[derive(Clone, Copy, Debug, Default)]
pub struct RaySample {
    /// In both pictures.
    pub light: RadiancePair,
    /// Whether the ray met a virtual body first.
    pub covered: bool,
}

/// The scene made ready.
#[derive(Debug)]
pub struct PreparedTrace {
    eye: Vec3,
    rays: CameraRays,
    real: Bodies,
    objects: Bodies,
    sky: Sky,
    emitters: Emitters,
    /// Unit direction and irradiance.
    suns: Vec<(Vec3, Vec3)>,
    /// No real body sends light out: whatever hides the sky is black.
    only_sky: bool,
    has_apertures: bool,
    norm: PhongNorm,
    bounces: u32,
}

/// Rays of the camera, world frame.
#[derive(Debug)]
enum CameraRays {
    Pinhole {
        lens: Lens,
        world_from_camera: Mat3,
    },
    /// Unit rays through the corners of the pixels, (width + 1) x (height + 1); bilinear between.
    Corners {
        columns: usize,
        list: Vec<Option<Vec3>>,
    },
}

impl CameraRays {
    fn new(scene: &TraceScene) -> Self {
        let (lens, pose) = (scene.lens, &scene.world_from_camera);
        if lens.distortion == Distortion::None {
            return Self::Pinhole { lens, world_from_camera: Mat3::from_quat(pose.rotation.as_quat()) };
        }
        let columns = lens.width as usize + 1;
        let list = (0..columns * (lens.height as usize + 1)).map(|i| {
            let corner = DVec2::new((i % columns) as f64, (i / columns) as f64);
            lens.unproject(corner).map(|ray| pose.rotate(ray).as_vec3())
        });
        Self::Corners { columns, list: list.collect() }
    }

    /// Through a place of a pixel; `None` beyond what the lens sees.
    #[inline]
    fn through(&self, column: u32, row: u32, [x, y]: [f32; 2]) -> Option<Vec3> {
        match self {
            Self::Pinhole { lens, world_from_camera } => {
                let x = (f64::from(column) + f64::from(x) - lens.cx) / lens.fx;
                let y = (f64::from(row) + f64::from(y) - lens.cy) / lens.fy;
                (*world_from_camera * Vec3::new(x as f32, y as f32, 1.0)).try_normalize()
            }
            Self::Corners { columns, list } => {
                let at = row as usize * columns + column as usize;
                let corner = |i: usize| list.get(i).copied().flatten();
                let (a, b) = (corner(at)?, corner(at + 1)?);
                let (c, d) = (corner(at + columns)?, corner(at + columns + 1)?);
                a.lerp(b, x).lerp(c.lerp(d, x), y).try_normalize()
            }
        }
    }
}

impl PreparedTrace {
    /// Makes a scene ready; `bounces`: how often light may be reflected diffusely beyond once.
    pub fn new(scene: &TraceScene, bounces: u32) -> Self {
        let real = Bodies::new(&scene.real);
        let emitters = Emitters::new(&real.shining());
        let suns = scene.suns.iter().filter_map(|sun| {
            let irradiance = Vec3::from(sun.irradiance_rgb);
            let shines = irradiance.is_finite() && irradiance.max_element() > 0.0;
            sun.to_light_world.try_normalize().filter(|_| shines).map(|to| (to, irradiance.max(Vec3::ZERO)))
        });
        Self {
            eye: scene.world_from_camera.translation.as_vec3(),
            rays: CameraRays::new(scene),
            suns: suns.collect(),
            only_sky: emitters.is_empty() && !real.has_surroundings(),
            has_apertures: real.has_apertures(),
            real,
            objects: Bodies::new(&scene.objects),
            sky: Sky::new(&scene.environment),
            emitters,
            norm: scene.phong_norm,
            bounces,
        }
    }

    /// One sample of a pixel.
    pub fn sample(&self, column: u32, row: u32, numbers: &Sequence) -> RaySample {
        let Some(direction) = self.rays.through(column, row, numbers.pair(0)) else {
            return RaySample::default();
        };
        let ray = PreparedRay::new(self.eye, direction);
        let real = self.real.nearest(&ray, f32::INFINITY);
        let object = self.objects.nearest(&ray, real.map_or(f32::INFINITY, |met| met.t()));
        let course = Course { numbers, place: 1, bounces: self.bounces, mirrors: 0, from_camera: true };
        let light = self.seen(PictureSide::Both, &ray, real, object, course);
        RaySample { light, covered: object.is_some() }
    }

    /// Light that comes back along a ray which meets these bodies first.
    fn seen(
        &self,
        side: PictureSide,
        ray: &PreparedRay,
        real: Option<MetBody>,
        object: Option<MetBody>,
        course: Course<'_>,
    ) -> RadiancePair {
        let behind = |side: PictureSide| match real {
            Some(met) => self.leaving(side, ray, &self.real.meeting(ray, &met), course),
            None => RadiancePair::of(side, self.sky.look(ray.direction).radiance),
        };
        match object {
            None => behind(side),
            Some(met) => {
                let before = self.leaving(PictureSide::With, ray, &self.objects.meeting(ray, &met), course);
                let without =
                    if side == PictureSide::Both { behind(PictureSide::Without).without } else { Vec3::ZERO };
                RadiancePair { with: before.with, without }
            }
        }
    }

    /// Light that leaves a point against the ray that met it.
    fn leaving(
        &self,
        side: PictureSide,
        ray: &PreparedRay,
        at: &SurfaceMeeting,
        course: Course<'_>,
    ) -> RadiancePair {
        let mut sum = RadiancePair::default();
        match at.emission {
            Emission::None => {}
            Emission::Own(rgb) => sum = RadiancePair::of(side, Vec3::from(rgb)),
            // The camera sees it shaded; what was measured holds all bounces already.
            Emission::Measured(rgb) if !course.from_camera => return RadiancePair::of(side, Vec3::from(rgb)),
            Emission::Surroundings if !course.from_camera => {
                return RadiancePair::of(side, self.sky.look(ray.direction).radiance);
            }
            Emission::Measured(_) | Emission::Surroundings => {}
        }
        let start = at.point + at.offset_m * at.facing;
        if let Some(Material::Mirror { reflectance_rgb }) = at.material {
            if course.mirrors < MOST_MIRRORS {
                let next = PreparedRay::new(start, mirror(ray.direction, at.shading));
                let course = Course { place: course.place + 1, mirrors: course.mirrors + 1, ..course };
                let seen = self.along(side, &next, course);
                sum.add(Vec3::from(reflectance_rgb), seen);
            }
            return sum;
        }
        let Some(reflects) = Reflects::new(at, ray.direction, self.norm) else { return sum };
        for &(to_light, irradiance) in &self.suns {
            let value = reflects.look(to_light).value;
            if value.max_element() > 0.0 {
                let lit = self.sunlit(side, &PreparedRay::new(start, to_light));
                sum.add(value * irradiance, lit);
            }
        }
        let Some((direction, factor, sky)) =
            self.draw(&reflects, start, at, course.bounces > 0, course.numbers.pair(course.place))
        else {
            return sum;
        };
        let next = PreparedRay::new(start, direction);
        let seen = if course.bounces > 0 {
            let bounces = course.bounces - 1;
            let course = Course { place: course.place + 1, bounces, from_camera: false, ..course };
            self.along(side, &next, course)
        } else {
            self.sent(side, &next, sky)
        };
        sum.add(factor, seen);
        sum
    }

    /// A direction from a point, f+ over the density of the whole mixture, and what the sky sends from there.
    #[inline]
    fn draw(
        &self,
        reflects: &Reflects,
        start: Vec3,
        at: &SurfaceMeeting,
        is_lit_by_others: bool,
        [u, v]: [f32; 2],
    ) -> Option<(Vec3, Vec3, Vec3)> {
        let sky_power = self.sky.power();
        let mut near_surface_share = 1.0;
        let (weights, near_power) = if self.emitters.is_empty() {
            (None, 0.0)
        } else {
            let (weights, power, share) = self.emitters.weigh(start, at.facing);
            near_surface_share = share;
            (Some(weights), power)
        };
        let lights = sky_power + near_power;
        let surface_share = match (sky_power > 0.0, near_power > 0.0) {
            (false, false) => 1.0,
            (true, false) => self.sky.surface_share(at.shading),
            (false, true) => near_surface_share,
            (true, true) => near_surface_share.max(0.25),
        };
        // Gloss is best met by its own lobe, and light that was reflected before by the surface's.
        let surface_share =
            if reflects.is_glossy() || is_lit_by_others { surface_share.max(0.5) } else { surface_share };
        // The sky's share of the light drawn: what comes from below is of no use.
        let sky_share = if lights > 0.0 { (1.0 - surface_share) * sky_power / lights } else { 0.0 };
        let near_share = 1.0 - surface_share - sky_share;
        let (direction, seen) = if u < surface_share {
            let direction = reflects.draw([(u / surface_share).min(1.0), v]);
            (direction, self.sky.look(direction))
        } else if u < surface_share + sky_share || near_power <= 0.0 {
            self.sky.draw([((u - surface_share) / sky_share).min(1.0), v])?
        } else {
            let number = ((u - surface_share - sky_share) / near_share).min(1.0);
            let point = self.emitters.draw(weights.as_ref()?, [number, v])?;
            let direction = (point - start).try_normalize()?;
            (direction, self.sky.look(direction))
        };
        let lobe = reflects.look(direction);
        if lobe.value == Vec3::ZERO {
            return None;
        }
        let mut density = surface_share * lobe.density + sky_share * seen.density;
        if let Some(weights) = weights.filter(|_| near_power > 0.0) {
            density += near_share * self.emitters.density(&weights, start, direction);
        }
        (density > 0.0).then(|| (direction, lobe.value / density, seen.radiance))
    }

    /// What is seen along a ray, however light came there.
    fn along(&self, side: PictureSide, ray: &PreparedRay, course: Course<'_>) -> RadiancePair {
        let real = self.real.nearest(ray, f32::INFINITY);
        let object = match side {
            PictureSide::Without => None,
            _ => self.objects.nearest(ray, real.map_or(f32::INFINITY, |met| met.t())),
        };
        self.seen(side, ray, real, object, course)
    }

    /// What is sent along a ray by what shines of itself; everything else is black.
    fn sent(&self, side: PictureSide, ray: &PreparedRay, sky: Vec3) -> RadiancePair {
        if self.only_sky {
            if sky == Vec3::ZERO {
                return RadiancePair::default();
            }
            let mut sent = RadiancePair::default();
            sent.add(sky, self.unhidden(side, ray));
            return sent;
        }
        let met = self.real.nearest(ray, f32::INFINITY);
        let (light, t) = match met {
            None => (sky, f32::INFINITY),
            Some(met) => {
                let light = match self.real.meeting(ray, &met).emission {
                    Emission::None => Vec3::ZERO,
                    Emission::Own(rgb) | Emission::Measured(rgb) => Vec3::from(rgb),
                    Emission::Surroundings => sky,
                };
                (light, met.t())
            }
        };
        if light == Vec3::ZERO {
            return RadiancePair::default();
        }
        let is_hidden = side != PictureSide::Without && self.objects.occluded(ray, t);
        let mut sent = RadiancePair::of(side, light);
        if is_hidden {
            sent.with = Vec3::ZERO;
        }
        sent
    }

    /// Ones where nothing lies on a ray.
    #[inline]
    fn unhidden(&self, side: PictureSide, ray: &PreparedRay) -> RadiancePair {
        if self.real.occluded(ray, f32::INFINITY) {
            return RadiancePair::default();
        }
        self.unhidden_by_objects(side, ray, f32::INFINITY)
    }

    /// Ones where no virtual body lies on a ray up to t_max.
    #[inline]
    fn unhidden_by_objects(&self, side: PictureSide, ray: &PreparedRay, t_max: f32) -> RadiancePair {
        let is_hidden = side != PictureSide::Without && self.objects.occluded(ray, t_max);
        match (is_hidden, side) {
            (false, side) => RadiancePair::of(side, Vec3::ONE),
            (true, PictureSide::Both) => RadiancePair::of(PictureSide::Without, Vec3::ONE),
            (true, _) => RadiancePair::default(),
        }
    }

    /// Ones where a sun is not hidden along a ray.
    #[inline]
    fn sunlit(&self, side: PictureSide, ray: &PreparedRay) -> RadiancePair {
        if !self.has_apertures {
            return self.unhidden(side, ray);
        }
        match self.real.nearest(ray, f32::INFINITY) {
            None => self.unhidden_by_objects(side, ray, f32::INFINITY),
            Some(met) if self.real.meeting(ray, &met).is_aperture => {
                self.unhidden_by_objects(side, ray, met.t())
            }
            Some(_) => RadiancePair::default(),
        }
    }
}

/// Where a path stands.
#[derive(Clone, Copy)]
struct Course<'a> {
    numbers: &'a Sequence,
    /// Which pair of numbers is next.
    place: u32,
    /// How often light may still be reflected after the next time.
    bounces: u32,
    mirrors: u32,
    from_camera: bool,
}

#[cfg(test)]
mod tests;
