use super::*;
use crate::{
    kept,
    model::{
        image::Image,
        keep::KeptInput,
        room::{Face, Room, RoomPatches, RoomSurface},
    },
    nearfield::{
        field::{NearField, Preparation},
        irradiance::{VolumeInput, VolumeSettings},
        patches::{Subdivision, subdivide},
        prepare::{RoomSettings, prepare},
        probe::MappedInput,
        sent::{Ends, Sent, SentInput},
    },
};
use glam::{DMat3, Vec3};
use proptest::prelude::*;
use std::{
    path::PathBuf,
    sync::atomic::{AtomicUsize, Ordering},
};

#[test]
fn a_reduced_probe_keeps_its_mean_and_its_faces() {
    let pixels = (0..24 * 12).map(|i| [i as f32, 1.0, 0.0]).collect();
    let picture = RadianceImage::from_pixels(24, 12, pixels).unwrap();
    let size = |layout, rows| {
        let small = reduced(picture.clone(), layout, rows);
        let mean = small.pixels().iter().map(|p| f64::from(p[0])).sum::<f64>() / small.pixels().len() as f64;
        assert!((mean - 143.5).abs() < 1e-3, "{mean}");
        (small.width(), small.height())
    };
    assert_eq!(size(MapLayout::Equirect, None), (24, 12));
    assert_eq!(size(MapLayout::Equirect, Some(100)), (24, 12));
    assert_eq!(size(MapLayout::Equirect, Some(3)), (6, 3));
    // 12 / 5 = 2 texels a side; faces of a cube are 2 rows high and cannot be reduced further.
    assert_eq!(size(MapLayout::Equirect, Some(5)), (12, 6));
    assert_eq!(size(MapLayout::Cube, Some(1)), (12, 6));
}

/// A floor, and a lamp and a panel that look down on it.
fn room() -> Room {
    let quad = |name: &str, half: f32, at: Vec3, reflects: f32, emits: f32| {
        let ring = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let up = ring.map(|[x, y]| at + half * Vec3::new(x, y, 0.0));
        RoomSurface {
            name: name.into(),
            corners_world: up.to_vec(),
            faces: vec![if at.z > 0.0 { Face::Quad([3, 2, 1, 0]) } else { Face::Quad([0, 1, 2, 3]) }],
            reflectance_rgb: [reflects; 3],
            emitted_rgb: [emits, 0.5 * emits, 0.25 * emits],
        }
    };
    Room {
        surfaces: vec![
            quad("floor", 1.0, Vec3::ZERO, 0.5, 0.0),
            quad("lamp", 0.1, Vec3::new(0.3, 0.2, 1.5), 0.0, 9.0),
            quad("panel", 0.4, Vec3::new(-0.5, 0.0, 1.0), 0.3, 0.1),
        ],
    }
}

fn settings() -> RoomSettings {
    RoomSettings { patch_m: Some(0.25), ..RoomSettings::default() }
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("halflight-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

/// Every number of both.
fn assert_same(a: &KnownRoom, b: &KnownRoom) {
    assert_eq!((&a.room, &a.suns, &a.sun_rgb, &a.report), (&b.room, &b.suns, &b.sun_rgb, &b.report));
    assert_eq!((&a.volume, &a.reflectance_measured), (&b.volume, &b.reflectance_measured));
    let (a, b) = (&a.field, &b.field);
    assert_eq!(
        (&a.patches, &a.sources, a.transfers(), a.sums()),
        (&b.patches, &b.sources, b.transfers(), b.sums())
    );
    assert_eq!((&a.gathered_rgb, &a.kept_rgb, a.report()), (&b.gathered_rgb, &b.kept_rgb, b.report()));
    assert!(a.source_tree == b.source_tree && a.octree == b.octree && a.receivers == b.receivers);
}

/// A probe in that room, of nothing but a strong small light above it: a sun through the open side.
fn picture() -> EnvironmentMap {
    let mut radiance = Image::filled(64, 32, [1.0f32, 2.0, 3.0]);
    *radiance.at_mut(21, 4) = [9e4; 3];
    EnvironmentMap { layout: MapLayout::Equirect, radiance }
}

fn probe(map: &EnvironmentMap) -> Probe<'_> {
    let position_world = Vec3::new(0.0, 0.0, 0.5);
    Probe { map, world_from_map: DMat3::IDENTITY, position_world, factor_sun: true }
}

/// A room made ready with what a folder keeps, and how much of it had to be computed.
fn run(room: &Room, light: RoomLight<'_>, folder: &Path) -> (KnownRoom, usize) {
    let (cache, told) = (Cache::new(Some(folder)), AtomicUsize::new(0));
    let ready = prepare_kept(room.clone(), &settings(), light, None, &cache, &|share| {
        told.fetch_max((1000.0 * share) as usize, Ordering::Relaxed);
    });
    assert_eq!(told.into_inner(), 1000);
    (ready.unwrap(), cache.computed())
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let of = |kind: PathBuf| std::fs::read_dir(kind).unwrap().map(|e| e.unwrap().path());
    let kinds = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let mut all: Vec<PathBuf> = kinds.flat_map(of).collect();
    all.sort();
    all
}

#[test]
fn what_is_kept_is_the_same_to_the_last_bit() {
    let (folder, map) = (folder("known-room-again"), picture());
    for (light, count) in [(RoomLight::Given, 2), (RoomLight::Probe(probe(&map)), 3)] {
        let fresh = prepare(room(), &settings(), light, None, &|_| ()).unwrap();
        assert!(fresh.volume.places().1 > 0);
        assert_eq!(fresh.suns.len(), count - 2);
        let (first, computed) = run(&room(), light, &folder);
        assert_eq!(computed, count);
        assert_same(&first, &fresh);
        let (again, computed) = run(&room(), light, &folder);
        assert_eq!(computed, 0);
        assert_same(&again, &fresh);
    }
    assert_eq!(files(&folder).len(), 5);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The three results are each made anew where their file is damaged, and the others are not.
#[test]
fn damage_of_one_file_costs_one_result() {
    let (folder, map) = (folder("known-room-damage"), picture());
    let light = RoomLight::Probe(probe(&map));
    let (wanted, _) = run(&room(), light, &folder);
    for file in files(&folder) {
        let sound = std::fs::read(&file).unwrap();
        for at in [0, 20, 60, sound.len() / 2, sound.len() - 1] {
            let mut bytes = sound.clone();
            bytes[at] ^= 1;
            std::fs::write(&file, &bytes).unwrap();
            let (made, computed) = run(&room(), light, &folder);
            assert_eq!(computed, 1, "{} at {at}", file.display());
            assert_same(&made, &wanted);
            assert_eq!(std::fs::read(&file).unwrap(), sound);
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Hashes of what all three results are computed from.
struct Hashes {
    room: Room,
    subdivision: Subdivision,
    patches: RoomPatches,
    map: EnvironmentMap,
    how: Preparation,
    volume: VolumeSettings,
}

impl Hashes {
    fn new() -> Self {
        let subdivision = Subdivision { patches: 40, ..Subdivision::default() };
        let patches = subdivide(&room(), &subdivision, &|_| None).unwrap();
        let (how, volume) = (Preparation::default(), VolumeSettings::default());
        Self { room: room(), subdivision, patches, map: picture(), how, volume }
    }

    fn of(&self) -> [String; 3] {
        let Self { room, subdivision, patches, how, volume, .. } = self;
        let ends = Ends::of(&Self::new().patches, &Preparation::default()).unwrap();
        let input = SentInput { room, patches, ends: &ends, how };
        let mut field =
            NearField::build(&Self::new().room, Self::new().patches, &Self::new().how, &|_| ()).unwrap();
        field.patches = patches.clone();
        [
            kept::name(&MappedInput { room, subdivision, probe: &probe(&self.map) }),
            kept::name(&input),
            kept::name(&VolumeInput { room, field: &field, how: volume }),
        ]
    }
}

#[test]
fn all_that_goes_in_is_hashed() {
    let plain = Hashes::new().of();
    let mut seen = vec![plain.clone()];
    let mut changed = |expected: [bool; 3], change: &dyn Fn(&mut Hashes)| {
        let mut hashes = Hashes::new();
        change(&mut hashes);
        let found = hashes.of();
        assert_eq!(std::array::from_fn(|k| found[k] != plain[k]), expected, "change {}", seen.len());
        for earlier in &seen {
            assert!((0..3).all(|k| !expected[k] || earlier[k] != found[k]));
        }
        seen.push(found);
    };
    let (all, patches) = ([true; 3], [false, true, true]);
    changed(all, &|h| h.room.surfaces[1].corners_world[2].z += 1e-6);
    changed(all, &|h| h.room.surfaces[1].faces[0] = Face::Triangle([0, 1, 2]));
    changed(patches, &|h| h.patches.vertices[3].gather_world.x += 1e-6);
    changed(patches, &|h| h.patches.patches[3].corners[0] += 1);
    changed(patches, &|h| h.patches.patches[3].radiance_rgb[2] += 1e-6);
    changed(patches, &|h| h.patches.patches[3].reflectance_rgb[2] += 1e-6);
    changed(patches, &|h| h.patches.patches[3].seen ^= true);
    changed(patches, &|h| h.patches.patches[3].area_m2 *= 1.001);
    let sent = [false, true, false];
    changed(sent, &|h| h.how.power_share = 0.5);
    changed(sent, &|h| h.how.rays_side = 2);
    // Of these only the hierarchies depend, which are not kept.
    changed([false; 3], &|h| h.how.neglected = 0.01);
    let mapped = [true, false, false];
    changed(mapped, &|h| h.room.surfaces[0].reflectance_rgb[1] = 0.4);
    changed(mapped, &|h| h.room.surfaces[0].emitted_rgb[1] = 0.4);
    changed(mapped, &|h| h.subdivision.patches = 41);
    changed(mapped, &|h| h.subdivision.refined = 0.2);
    changed(mapped, &|h| h.map.radiance.at_mut(3, 3)[0] = 1.5);
    changed(mapped, &|h| h.map.layout = MapLayout::Angular);
    changed([false, false, true], &|h| h.volume.spacing_m = 0.2);
    changed([false; 3], &|h| h.room.surfaces[0].name = "ground".into());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever a file holds, what is accepted can be used.
    #[test]
    fn what_is_accepted_can_be_used(
        flips in prop::collection::vec((any::<prop::sample::Index>(), 1u8..), 0..4),
        at_the_beginning in any::<bool>(),
    ) {
        let hashes = Hashes::new();
        let Hashes { room, patches, how, .. } = &hashes;
        let ends = Ends::of(patches, how).unwrap();
        let input = SentInput { room, patches, ends: &ends, how };
        let sent = Sent::find(&input, &|_| ());
        prop_assert!(input.accepts(&sent));
        let mut bytes = kept::content(&sent);
        for (at, bits) in flips {
            let end = if at_the_beginning { bytes.len().min(12) } else { bytes.len() };
            bytes[at.index(end)] ^= bits;
        }
        if let Some(sent) = kept::of_content::<Sent>(&bytes).filter(|sent| input.accepts(sent)) {
            let field = NearField::of(patches.clone(), ends.clone(), sent, how, &|_| ());
            let input = VolumeInput { room, field: &field, how: &hashes.volume };
            let volume = crate::nearfield::irradiance::IrradianceVolume::build(room, &field, input.how, &|_| ());
            prop_assert!(input.accepts(&volume));
        }
    }
}
