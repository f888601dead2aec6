//! Profiles through the shadows of near light, beside ray tracing: F3 of the reference.

use crate::{
    assets::{pictures::load_gray8, shapes::transformed},
    case::{self, Case},
    error::LabError,
    math::{bvh::Bvh, color},
    model::image::RadianceImage,
    nearfield::{
        field::{NearField, Preparation},
        marks::{Marks, SeenReceivers, bounds_world},
        patches::{Subdivision, subdivide},
        representatives::{Representative, Representatives},
        shaft::Aabb,
        subtract::seen_part,
    },
    open_exr::load_raw,
    page::svg::{Anchor, Svg},
    sources::expand::{Priority, WantedNodes},
    visibility::point_maps::SeenPart,
};
use glam::{DVec2, Vec3};
use std::{fmt::Write, path::Path};

/// Lights that stand for the room's.
pub const COUNTS: [usize; 2] = [10, 50];
/// Places a side on each light, and in each pixel.
const PLACES: u32 = 3;
/// Shares of the shadow that lie above the lines.
const LINES: [f64; 3] = [0.25, 0.5, 0.75];
/// Pixels before and after the shadow.
const MARGIN: usize = 6;

/// One line of pixels through a shadow.
pub struct ShadowProfile {
    /// Name of the reference it belongs to.
    pub case: String,
    /// Which object.
    pub object: String,
    /// The picture's row.
    pub row: usize,
    /// The first column.
    pub column: usize,
    /// What the object takes away, luminance of radiance: of the reference, and of ours for each of [`COUNTS`]; `None`
    /// where the object or a lamp is seen.
    pub points: Vec<Option<[f64; 1 + COUNTS.len()]>>,
}

impl ShadowProfile {
    /// RMS of each of ours less the reference, over the reference's largest.
    pub fn off(&self) -> [f64; COUNTS.len()] {
        let points = || self.points.iter().flatten();
        let largest = points().map(|p| p[0]).fold(f64::MIN_POSITIVE, f64::max);
        let number = points().count().max(1) as f64;
        std::array::from_fn(|k| {
            let sum: f64 = points().map(|p| (p[k + 1] - p[0]).powi(2)).sum();
            (sum / number).sqrt() / largest
        })
    }
}

/// All profiles of one case: three rows through the shadow of each object.
///
/// # Errors
/// The case or one of its pictures cannot be read; its room cannot be prepared.
pub fn of_case(folder: &Path) -> Result<Vec<ShadowProfile>, LabError> {
    let on = |what: &str| format!("{}: {what}", folder.display());
    let case = case::load(folder)?;
    let room = case.room();
    let divided = subdivide(&room, &Subdivision::default(), &|_| None)
        .map_err(|e| LabError::on(on("dividing the room"), e))?;
    let how = Preparation { power_share: 1.0, ..Preparation::default() };
    let field = NearField::build(&room, divided, &how, &|_| ())
        .map_err(|e| LabError::on(on("preparing the room"), e))?;
    let bare = picture(&case, "noobj")?;
    let surfaces = PatchSurfaces::new(&field);
    let mut out = Vec::new();
    for image in case.images.iter().filter_map(|i| i.name.strip_prefix("obj_")) {
        let difference = picture(&case, &format!("diff_{image}"))?;
        let mut free = vec![true; difference.pixels().len()];
        for mask in [format!("mask_{image}"), "mask_emitters".to_owned()] {
            let file = &case.image(&mask)?.file;
            let mask = load_gray8(file)?;
            free.iter_mut().zip(mask.pixels()).for_each(|(free, mask)| *free &= *mask == 0);
        }
        let shadow = ProfiledObject::new(&case, &field, image)?;
        for (row, columns) in lines(&difference, &free) {
            let point = |column: usize| {
                let i = row * case.lens.width as usize + column;
                let truth = f64::from(color::luminance(difference.pixels()[i]));
                let ours = || shadow.taken(&case, &field, &surfaces, [column, row], bare.pixels()[i]);
                free[i].then(|| {
                    let [few, many] = ours();
                    [truth, few, many]
                })
            };
            let (id, object, column) = (case.id.clone(), image.to_owned(), columns.start);
            out.push(ShadowProfile { case: id, object, row, column, points: columns.map(point).collect() });
        }
    }
    Ok(out)
}

fn picture(case: &Case, name: &str) -> Result<RadianceImage, LabError> {
    Ok(load_raw(&case.image(name)?.file)?)
}

/// Rows that leave these shares of the shadow above them, and the columns in which they cross it.
fn lines(difference: &RadianceImage, free: &[bool]) -> Vec<(usize, std::ops::Range<usize>)> {
    let width = difference.width();
    let light: Vec<f64> = (difference.pixels().iter().zip(free))
        .map(|(rgb, free)| if *free { f64::from(color::luminance(*rgb)).max(0.0) } else { 0.0 })
        .collect();
    let rows: Vec<f64> = light.chunks(width).map(|row| row.iter().sum()).collect();
    let total: f64 = rows.iter().sum();
    let mut found = Vec::new();
    for share in LINES {
        let mut sum = 0.0;
        let row = rows.iter().position(|r| {
            sum += r;
            sum >= share * total && *r > 0.0
        });
        let Some(row) = row else { continue };
        let values = &light[row * width..(row + 1) * width];
        let largest = values.iter().copied().fold(0.0, f64::max);
        let in_shadow = |v: &f64| *v > 0.02 * largest;
        let (Some(first), Some(last)) =
            (values.iter().position(in_shadow), values.iter().rposition(in_shadow))
        else {
            continue;
        };
        found.push((row, first.saturating_sub(MARGIN)..(last + 1 + MARGIN).min(width)));
    }
    found
}

/// The room's patches as rays meet them.
struct PatchSurfaces {
    bvh: Bvh,
    triangles: Vec<[u32; 3]>,
    patches: Vec<u32>,
}

impl PatchSurfaces {
    fn new(field: &NearField) -> Self {
        let positions: Vec<Vec3> = field.patches.vertices.iter().map(|v| v.position_world).collect();
        let (mut triangles, mut patches) = (Vec::new(), Vec::new());
        for (i, patch) in field.patches.patches.iter().enumerate() {
            for triangle in patch.triangles() {
                triangles.push(triangle);
                patches.push(i as u32);
            }
        }
        Self { bvh: Bvh::build(&positions, &triangles), triangles, patches }
    }
}

/// Some lights, what each sends to every vertex, and which part of it each vertex sees.
type ChosenLights = (Vec<Representative>, Vec<[f32; 3]>, Vec<SeenPart>);

/// An object, and the lights that it may hide.
struct ProfiledObject {
    bvh: Bvh,
    lights: [ChosenLights; COUNTS.len()],
}

impl ProfiledObject {
    fn new(case: &Case, field: &NearField, which: &str) -> Result<Self, LabError> {
        let image = format!("obj_{which}");
        let scene = case.scene(Some(&image))?;
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for object in &scene.objects {
            let mesh = transformed(&object.mesh, &object.world_from_object);
            let base = positions.len() as u32;
            positions.extend_from_slice(&mesh.positions);
            triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| i + base)));
        }
        let objects: Vec<Aabb> = bounds_world(positions.iter().copied()).into_iter().collect();
        let (mut view, mut marks) = (SeenReceivers::default(), Marks::default());
        view.look(field, &case.lens, &case.world_from_camera);
        marks.mark(field, &objects, Some(&view));
        let lights = COUNTS.map(|count| {
            let (mut chosen, mut rows) = (Representatives::default(), Vec::new());
            chosen.choose(field, &marks, &objects, None, WantedNodes::exactly(count), Priority::ErrorRemoved);
            chosen.light_rows(field, &marks, &mut rows);
            let mut parts = Vec::new();
            chosen.light_parts(field, &marks, &mut parts);
            (chosen.near().to_vec(), rows, parts)
        });
        Ok(Self { bvh: Bvh::build(&positions, &triangles), lights })
    }

    /// Luminance taken away at a pixel, in the ratio form: the share of the room's own light times what is seen without
    /// the object.
    fn taken(
        &self,
        case: &Case,
        field: &NearField,
        surfaces: &PatchSurfaces,
        pixel: [usize; 2],
        bare: [f32; 3],
    ) -> [f64; COUNTS.len()] {
        let vertices = field.patches.vertices.len();
        let (mut taken, mut all) = ([[0.0f32; 3]; COUNTS.len()], [0.0f32; 3]);
        for place in 0..PLACES * PLACES {
            let within = |whole: usize, part: u32| whole as f64 + (f64::from(part) + 0.5) / f64::from(PLACES);
            let at = DVec2::new(within(pixel[0], place % PLACES), within(pixel[1], place / PLACES));
            let Some(ray) = case.lens.unproject(at) else { continue };
            let ray = case.world_from_camera.rotate(ray).as_vec3();
            let eye = case.world_from_camera.translation.as_vec3();
            let Some(hit) = surfaces.bvh.intersect(eye, ray, 1e-4, f32::INFINITY) else { continue };
            let patch = &field.patches.patches[surfaces.patches[hit.triangle as usize] as usize];
            let corners = surfaces.triangles[hit.triangle as usize];
            let mixed = |rows: &[[f32; 3]]| -> [f32; 3] {
                std::array::from_fn(|c| {
                    let sum: f32 =
                        corners.iter().zip(hit.barycentric).map(|(&v, w)| w * rows[v as usize][c]).sum();
                    sum * patch.reflectance_rgb[c]
                })
            };
            let (point, normal) = (eye + ray * hit.t, patch.normal_world);
            all.iter_mut().zip(mixed(&field.gathered_rgb)).for_each(|(sum, c)| *sum += c);
            for (taken, (lights, rows, parts)) in taken.iter_mut().zip(&self.lights) {
                for ((light, row), parts) in
                    lights.iter().zip(rows.chunks(vertices)).zip(parts.chunks(vertices))
                {
                    let sent = corners.map(|v| row[v as usize]);
                    let own = corners.map(|v| parts[v as usize].middle_half());
                    let part = seen_part(&own, &sent, hit.barycentric);
                    let hidden = self.hidden(point, normal, light, part);
                    if hidden > 0.0 {
                        taken.iter_mut().zip(mixed(row)).for_each(|(sum, c)| *sum += hidden * c);
                    }
                }
            }
        }
        taken.map(|taken| {
            let share = |c: usize| if all[c] > 0.0 { (taken[c] / all[c]).min(1.0) } else { 0.0 };
            f64::from(color::luminance(std::array::from_fn(|c| share(c) * bare[c])))
        })
    }

    /// Share of a light that the object hides, by places on the part of its parallelogram that the point sees.
    fn hidden(
        &self,
        point: Vec3,
        normal: Vec3,
        light: &Representative,
        (middle, half): ([f32; 2], [f32; 2]),
    ) -> f32 {
        let from = point + normal * 2e-4;
        let [long, short] = light.half_axes_world;
        let mut hidden = 0;
        for k in 0..PLACES * PLACES {
            let step = |i: u32| (2.0 * i as f32 + 1.0) / PLACES as f32 - 1.0;
            let steps = [step(k % PLACES), step(k / PLACES)];
            let [a, b] = [0, 1].map(|i: usize| middle[i] + half[i] * steps[i]);
            let to = light.middle_world + long * a + short * b - from;
            hidden += u32::from(self.bvh.occluded(from, to, 0.0, 1.0));
        }
        hidden as f32 / (PLACES * PLACES) as f32
    }
}

/// All points as a table.
pub fn table(profiles: &[ShadowProfile]) -> String {
    let mut csv = String::from("case,object,row,column,reference");
    for n in COUNTS {
        let _ = write!(csv, ",lights_{n}");
    }
    csv.push('\n');
    for p in profiles {
        for (i, point) in p.points.iter().enumerate() {
            let _ = write!(csv, "{},{},{},{}", p.case, p.object, p.row, p.column + i);
            match point {
                Some(values) => {
                    for value in values {
                        let _ = write!(csv, ",{value:.6}");
                    }
                }
                None => csv.push_str(&",".repeat(1 + COUNTS.len())),
            }
            csv.push('\n');
        }
    }
    csv
}

/// One small plot for each profile, three in a row.
pub fn plot(profiles: &[ShadowProfile]) -> String {
    const SIZE: [f64; 2] = [320.0, 190.0];
    const COLOURS: [&str; 3] = ["#000000", "#ff7f0e", "#1f77b4"];
    let rows = profiles.len().div_ceil(LINES.len());
    let mut svg = Svg::new([SIZE[0] * LINES.len() as f64, SIZE[1] * rows as f64 + 30.0], 11);
    let names = ["ray tracing".to_owned(), format!("{} lights", COUNTS[0]), format!("{} lights", COUNTS[1])];
    for (k, (name, colour)) in names.iter().zip(COLOURS).enumerate() {
        svg.key([16.0 + 130.0 * k as f64, 16.0], colour, "", name);
    }
    for (index, p) in profiles.iter().enumerate() {
        let left = SIZE[0] * (index % LINES.len()) as f64 + 16.0;
        let bottom = 30.0 + SIZE[1] * (index / LINES.len() + 1) as f64 - 14.0;
        let (wide, high) = (SIZE[0] - 32.0, SIZE[1] - 44.0);
        let largest = p.points.iter().flatten().flatten().copied().fold(f64::MIN_POSITIVE, f64::max);
        let title = format!("{} {}, row {}; largest {largest:.3}", p.case, p.object, p.row);
        svg.text([left, bottom - high - 6.0], Anchor::Start, &title);
        svg.line([left, bottom], [left + wide, bottom], "stroke=\"#bbb\"");
        for (k, colour) in COLOURS.iter().enumerate() {
            let place = |i: usize, point: &[f64; 3]| {
                let x = left + wide * (i as f64 + 0.5) / p.points.len() as f64;
                [x, bottom - high * (point[k] / largest).max(0.0)]
            };
            let points = p.points.iter().enumerate().map(|(i, point)| point.as_ref().map(|p| place(i, p)));
            svg.curve(points, colour, 1.5);
        }
    }
    svg.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_crosses_the_shadow_where_it_is() {
        let mut pixels = vec![[0.0f32; 3]; 40 * 20];
        for row in 8..12 {
            pixels[row * 40 + 15..row * 40 + 25].fill([1.0; 3]);
        }
        let mut free = vec![true; pixels.len()];
        let picture = RadianceImage::from_pixels(40, 20, pixels).unwrap();
        assert_eq!(lines(&picture, &free), [(8, 9..31), (9, 9..31), (10, 9..31)]);
        free.fill(false);
        assert!(lines(&picture, &free).is_empty());
    }

    #[test]
    fn plots_break_where_nothing_is_known() {
        let points = vec![Some([1.0, 0.5, 1.0]), None, Some([0.0, 0.5, 0.0])];
        let profile =
            ShadowProfile { case: "c".to_owned(), object: "o".to_owned(), row: 3, column: 7, points };
        assert_eq!(profile.off(), [0.5, 0.0]);
        let svg = plot(std::slice::from_ref(&profile));
        assert_eq!(svg.matches("stroke-width=\"1.5\"").count(), 3);
        assert!(svg.contains("M") && !svg.contains("NaN") && svg.ends_with("</svg>\n"));
        let csv = table(&[profile]);
        assert_eq!(csv.lines().nth(1), Some("c,o,3,7,1.000000,0.500000,1.000000"));
        assert_eq!(csv.lines().nth(2), Some("c,o,3,8,,,"));
    }
}
