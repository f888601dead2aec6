//! What one frame of a known room is drawn from: the lights that objects may hide, what each sends to every corner of the
//! room's patches, its shadow map, and which of them may throw a shadow on each triangle (Sections 6 to 8 of [Gib03]). The
//! only parts that depend on the frame; the same for every engine.

use super::{
    field::NearField,
    marks::{Marks, SeenReceivers},
    representatives::{Representative, Representatives},
    shaft::Aabb,
    sun_shadows::SunShadows,
    sun_sources::SunMarks,
};
use crate::{
    math::{lens::Lens, pose::Pose},
    sources::expand::{Priority, WantedNodes},
    visibility::{
        point_maps::{PlaceReads, PointLight, PointMapSet, SeenPart},
        proxies::Proxies,
    },
};
use glam::Vec3;
use rayon::prelude::*;

/// Lights of a frame at most: 256 cameras fill the uniform block of 16 KiB that every device has.
pub const MOST_LIGHTS: usize = 256;
/// How many times the lights that were asked for a frame may have at most.
const MORE_LIGHTS: usize = 4;
/// Triangles that one task sorts.
const CHUNK: usize = 64;

/// How the lights of a frame are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearQuality {
    /// Lights, suns among them: 1 to [`MOST_LIGHTS`]. Fewer only where there are no more.
    pub lights: usize,
    /// More come, up to [`MORE_LIGHTS`] times as many, while the choice leaves more than this, radians; infinite: never.
    pub left_rad: f32,
    /// Texels a side of each light's square of maps.
    pub texels: u32,
    /// Places of each light that its shadow is drawn from, a side: 1 draws hard shadows from the source in the middle of
    /// each light, as in [Gib03]; up to 8.
    pub places: u32,
}

/// A frame; keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct NearFrame {
    view: SeenReceivers,
    marks: Marks,
    chosen: Representatives,
    suns: SunMarks,
    rows: Vec<[f32; 3]>,
    /// Which part of each light each vertex sees, in the order of `rows`; empty for hard shadows.
    parts: Vec<SeenPart>,
    casters: Vec<Vec3>,
    boxes: Vec<Aabb>,
    maps: PointMapSet,
    reads: Vec<PlaceReads>,
    /// Radiant intensity of each light along its normal: sum of radiance times area.
    intensities: Vec<[f32; 3]>,
    /// For each triangle where its lights begin and end in `listed`.
    ranges: Vec<[u32; 2]>,
    listed: Vec<u16>,
    chunks: Vec<Vec<u16>>,
    vertices: usize,
    /// Lights that a frame may have.
    most: usize,
}

/// Makes room for `count` items in all, so that no later frame allocates.
fn provide<T>(list: &mut Vec<T>, count: usize) {
    list.reserve_exact(count.saturating_sub(list.len()));
}

impl NearFrame {
    /// Finds the lights that the objects may hide something of, and fits their maps. `positions` are the vertices of all
    /// objects now, world frame, and `proxies` their stand-ins. In a room without suns.
    pub fn update(
        &mut self,
        field: &NearField,
        proxies: &Proxies,
        positions: &[Vec3],
        camera: (&Lens, &Pose),
        quality: &NearQuality,
    ) {
        self.update_under(&SunShadows::default(), field, proxies, positions, camera, quality);
    }

    /// As [`NearFrame::update`] in a room with suns: [`NearFrame::lights`] and the suns that have a map
    /// ([`NearFrame::sun_maps`]) are `quality.lights` together (more where the error asks for it), shared by what each map gains
    /// ([`Representatives::choose`]). With a single light for both, it goes to those that send more.
    pub fn update_under(
        &mut self,
        suns: &SunShadows,
        field: &NearField,
        proxies: &Proxies,
        positions: &[Vec3],
        (lens, world_from_camera): (&Lens, &Pose),
        quality: &NearQuality,
    ) {
        proxies.gather(positions, &mut self.casters);
        self.boxes.clear();
        let around = |r: &std::ops::Range<usize>| Aabb::around(self.casters[r.clone()].iter().copied());
        self.boxes.extend(proxies.objects().iter().map(around));
        self.view.look(field, lens, world_from_camera);
        self.marks.mark(field, &self.boxes, Some(&self.view));
        let count = quality.lights.clamp(1, MOST_LIGHTS);
        let more = if quality.left_rad.is_finite() { MORE_LIGHTS } else { 1 };
        let most = (count * more).min(MOST_LIGHTS);
        let wanted = WantedNodes { least: count, most, left_rad: quality.left_rad };
        self.provide(most, field.patches.vertices.len());
        let by = Priority::ErrorRemoved;
        self.suns.mark(field, suns, &self.marks, &self.boxes, Some(&self.view));
        self.chosen.choose(field, &self.marks, &self.boxes, self.suns.marked(suns), wanted, by);
        self.suns.share(suns, self.chosen.far());
        self.chosen.light_rows(field, &self.marks, &mut self.rows);
        self.vertices = field.patches.vertices.len();
        let hard = quality.places <= 1;
        self.parts.clear();
        if !hard {
            self.chosen.light_parts(field, &self.marks, &mut self.parts);
        }
        let place = |light: &Representative| if hard { light.centre_world } else { light.middle_world };
        self.intensities.clear();
        let (marks, chosen) = (&self.marks, self.chosen.near());
        self.intensities.extend(chosen.iter().map(|light| intensity(field, marks, light)));
        let lights = self.chosen.near().iter().map(|light| PointLight {
            place_world: place(light),
            half_axes_world: light.half_axes_world,
            front: light.normal_world,
        });
        self.maps.fit(lights, quality.places, &self.casters, quality.texels);
        self.maps.provide(most);
        self.reads.clear();
        let cameras = self.maps.cameras();
        self.reads
            .extend(cameras.iter().map(|camera| camera.as_ref().map_or(PlaceReads::NONE, PlaceReads::new)));
    }

    /// Makes room for the most lights that may come: which frame has the most depends on the objects' way.
    fn provide(&mut self, lights: usize, vertices: usize) {
        self.most = lights;
        provide(&mut self.rows, lights * vertices);
        provide(&mut self.parts, lights * vertices);
        provide(&mut self.intensities, lights);
    }

    /// Draws the maps, on the CPU.
    pub fn draw(&mut self, proxies: &Proxies) {
        self.maps.draw(&self.casters, proxies.triangles());
    }

    /// Lists for each triangle of the room (`triangles`, corners as numbers of the field's vertices) the lights that may lose
    /// something on it. `is_drawn`: the maps were drawn here, and what they hold is looked at too.
    pub fn list(&mut self, field: &NearField, triangles: &[[u32; 3]], is_drawn: bool) {
        let lights = self.chosen.near().len();
        self.ranges.resize(triangles.len(), [0; 2]);
        self.chunks.resize_with(triangles.len().div_ceil(CHUNK), Vec::new);
        provide(&mut self.listed, triangles.len() * self.most);
        let most = CHUNK * self.most;
        let Self { marks, rows, maps, ranges, chunks, vertices, .. } = self;
        let (marks, rows, maps, vertices) = (&*marks, &*rows, &*maps, *vertices);
        let parts = ranges.par_chunks_mut(CHUNK).zip(triangles.par_chunks(CHUNK)).zip(chunks.par_iter_mut());
        parts.for_each(|((ranges, triangles), chunk)| {
            chunk.clear();
            provide(chunk, most);
            for (range, triangle) in ranges.iter_mut().zip(triangles) {
                let begin = chunk.len() as u32;
                if triangle.iter().any(|&v| marks.has_vertex(v as usize)) {
                    let position = |v: u32| {
                        field.patches.vertices.get(v as usize).map_or(Vec3::NAN, |v| v.position_world)
                    };
                    let corners = triangle.map(position);
                    let row = |k: usize, v: u32| rows.get(k * vertices + v as usize).copied();
                    chunk.extend((0..lights).filter_map(|k| {
                        let shines = triangle.iter().any(|&v| row(k, v).is_some_and(|rgb| rgb != [0.0; 3]));
                        (shines && maps.may_shadow(k, &corners, is_drawn)).then_some(k as u16)
                    }));
                }
                *range = [begin, chunk.len() as u32];
            }
        });
        self.listed.clear();
        for (ranges, chunk) in self.ranges.chunks_mut(CHUNK).zip(&self.chunks) {
            let base = self.listed.len() as u32;
            self.listed.extend_from_slice(chunk);
            ranges.iter_mut().flatten().for_each(|end| *end += base);
        }
    }

    /// The lights, in the order of their maps and rows.
    pub fn lights(&self) -> &[Representative] {
        self.chosen.near()
    }

    /// For each sun of the room the sun whose map of the objects it is hidden by; `None`: objects hide nothing of it.
    pub fn sun_maps(&self) -> &[Option<u32>] {
        self.suns.maps()
    }

    /// Whether a sun has a map of the objects of its own.
    pub fn has_sun_map(&self, sun: usize) -> bool {
        self.suns.maps().iter().flatten().any(|&map| map as usize == sun)
    }

    /// What the choice of lights leaves undone, radians ([`Representatives::left_rad`]).
    pub fn left_rad(&self) -> f32 {
        self.chosen.left_rad()
    }

    /// What each light sends to each vertex (`Representatives::light_rows`).
    pub fn rows(&self) -> &[[f32; 3]] {
        &self.rows
    }

    /// What light `k` sends to a vertex.
    pub fn sent(&self, k: usize, vertex: u32) -> [f32; 3] {
        self.rows.get(k * self.vertices + vertex as usize).copied().unwrap_or([0.0; 3])
    }

    /// Which part of light `k` a vertex sees.
    pub fn part(&self, k: usize, vertex: u32) -> SeenPart {
        self.parts.get(k * self.vertices + vertex as usize).copied().unwrap_or(SeenPart::WHOLE)
    }

    /// Shadow maps of all lights, in the order of [`NearFrame::lights`].
    pub fn maps(&self) -> &PointMapSet {
        &self.maps
    }

    /// The shadow maps, to take depths drawn elsewhere.
    pub fn maps_mut(&mut self) -> &mut PointMapSet {
        &mut self.maps
    }

    /// What each light sends straight ahead: radiance times area of its marked sources, linear RGB.
    pub fn intensities(&self) -> &[[f32; 3]] {
        &self.intensities
    }

    /// The views of each light, made ready to be read.
    pub fn reads(&self) -> &[PlaceReads] {
        &self.reads
    }

    /// Stand-ins of the objects, world frame, metres.
    pub fn casters(&self) -> &[Vec3] {
        &self.casters
    }

    /// Boxes around the objects' stand-ins, world frame.
    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// The lights that may lose something on triangle `t` of the last [`NearFrame::list`].
    pub fn listed(&self, t: usize) -> &[u16] {
        let Some([begin, end]) = self.ranges.get(t) else { return &[] };
        self.listed.get(*begin as usize..*end as usize).unwrap_or(&[])
    }

    /// All lists, and where each triangle's begins and ends.
    pub fn lists(&self) -> (&[[u32; 2]], &[u16]) {
        (&self.ranges, &self.listed)
    }

    /// What may be hidden in this frame.
    pub fn marks(&self) -> &Marks {
        &self.marks
    }
}

fn intensity(field: &NearField, marks: &Marks, light: &Representative) -> [f32; 3] {
    let node = field.source_tree.nodes()[light.node as usize];
    let mut sum = [0.0f32; 3];
    for index in (node.begin as usize..node.end as usize).filter(|&s| marks.has_source(s)) {
        let source = &field.sources[index];
        let area_m2 = field.patches.patches[source.patch as usize].area_m2;
        sum.iter_mut().zip(source.radiance_rgb).for_each(|(sum, l)| *sum += l * area_m2);
    }
    sum
}

#[cfg(test)]
mod tests;
