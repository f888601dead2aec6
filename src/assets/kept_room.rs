//! What rays find in a known room (`nearfield::sent` and its irradiance volume), kept in a folder from run to run under a hash
//! of all that goes in.

use super::kept::{self, Bytes, Key, Reader};
use crate::{
    model::room::{Room, RoomPatches},
    nearfield::{
        error::RoomError,
        field::Preparation,
        irradiance::{self, IrradianceVolume, VolumeSettings},
        packed::{BLOCK, Transfers},
        prepare::{CameraPicture, KnownRoom, LitRoom, RoomSettings},
        sent::{self, Ends, Sent},
        sums::NodeSums,
    },
};
use std::path::Path;

/// Folders in the cache: transfers, and volumes.
const KINDS: [&str; 2] = ["transfers", "volume"];
/// Share of the progress that transfers take.
const SENT_SHARE: f32 = 0.5;

/// Makes a room ready with what an earlier run left in the folder `cache` for the same room, patches and settings, bit for bit
/// as if it were found now; and whether nothing had to be found. A file there that is damaged is warned of, not used and
/// written anew; where nothing can be written, that is logged and nothing else. `progress` as for `nearfield::prepare`.
///
/// # Errors
/// As `Ends::of` and `LitRoom::ready`.
pub fn ready(
    lit: LitRoom,
    how: &RoomSettings,
    camera: Option<&CameraPicture<'_>>,
    cache: Option<&Path>,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<(KnownRoom, bool), RoomError> {
    let ends = Ends::of(&lit.patches, &how.preparation)?;
    let rest = |share: f32| progress(SENT_SHARE + (1.0 - SENT_SHARE) * share);
    let find = |ends: &Ends| {
        let by = |share: f32| progress(SENT_SHARE * share);
        Sent::find(&lit.room, &lit.patches, ends, &how.preparation, &by)
    };
    let Some(folder) = cache else {
        let sent = find(&ends);
        return Ok((lit.ready((ends, sent), None, how, camera, &rest)?, false));
    };
    let key = key(&lit.room, &lit.patches, &how.preparation);
    let [sent_file, volume_file] = KINDS.map(|kind| kept::cache_file(folder, kind, &key));
    let kept = kept::read(&sent_file, &key, |content| decode(content, &lit.patches, &ends));
    let volume = kept::read(&volume_file, &key, |content| decode_volume(content, &lit.patches));
    let whole = [kept.is_some(), volume.is_some()];
    let sent = kept.unwrap_or_else(|| {
        let found = find(&ends);
        keep(&sent_file, &key, &encode(&found));
        found
    });
    progress(SENT_SHARE);
    let known = lit.ready((ends, sent), volume, how, camera, &rest)?;
    if !whole[1] {
        let mut numbers = Bytes::default();
        numbers.floats(&known.volume.numbers());
        keep(&volume_file, &key, &numbers.0);
    }
    Ok((known, whole == [true; 2]))
}

fn keep(file: &Path, key: &Key, content: &[u8]) {
    if let Err(error) = kept::write(file, key, content) {
        tracing::warn!("what was found of the room is not kept: {error}");
    }
}

fn decode_volume(content: &[u8], patches: &RoomPatches) -> Option<IrradianceVolume> {
    let mut from = Reader(content);
    let numbers = from.many(content.len() / 4, f32::from_le_bytes)?;
    if from.0.is_empty() {
        IrradianceVolume::from_numbers(patches, &VolumeSettings::default(), &numbers)
    } else {
        None
    }
}

/// Everything that rays meet, everything that they are cast between, and how many. All else that both results depend on
/// follows from the patches and the settings, or has a version.
fn key(room: &Room, patches: &RoomPatches, how: &Preparation) -> Key {
    let mut out = Bytes::default();
    out.numbers(&[sent::VERSION, irradiance::VERSION]);
    out.number(room.surfaces.len() as u32);
    for surface in &room.surfaces {
        out.number(surface.corners_world.len() as u32);
        surface.corners_world.iter().for_each(|p| out.floats(&p.to_array()));
        out.number(surface.faces.len() as u32);
        for corners in surface.faces.iter().map(|face| face.corners()) {
            out.number(corners.len() as u32);
            out.numbers(corners);
        }
    }
    out.number(patches.vertices.len() as u32);
    for v in &patches.vertices {
        [v.position_world, v.gather_world, v.normal_world].iter().for_each(|p| out.floats(&p.to_array()));
    }
    out.number(patches.patches.len() as u32);
    for p in &patches.patches {
        out.numbers(&p.corners);
        out.floats(&p.centre_world.to_array());
        out.floats(&p.normal_world.to_array());
        out.floats(&[p.area_m2]);
        out.floats(&p.radiance_rgb);
        out.floats(&p.reflectance_rgb);
        out.number(u32::from(p.seen));
    }
    out.floats(&[how.power_share]);
    out.number(how.rays_side);
    kept::key(&out.0)
}

fn encode(sent: &Sent) -> Vec<u8> {
    let (bits, first, values) = sent.transfers.parts();
    let mut out = Bytes::default();
    out.number(first.len() as u32);
    out.number(bits.len() as u32);
    out.number(values.len() as u32);
    out.longs(bits);
    out.numbers(first);
    out.shorts(values.as_flattened());
    let (areas_m2, means) = sent.sums.parts();
    out.number(areas_m2.len() as u32);
    out.floats(areas_m2);
    out.shorts(means);
    out.number(sent.rest_rgb.len() as u32);
    out.floats(sent.rest_rgb.as_flattened());
    out.0
}

/// `None` where the bytes are not of a room with these sources and vertices.
fn decode(bytes: &[u8], patches: &RoomPatches, ends: &Ends) -> Option<Sent> {
    let mut from = Reader(bytes);
    let (sources, words, blocks) =
        (from.number()? as usize, from.number()? as usize, from.number()? as usize);
    let bits = from.many(words, u64::from_le_bytes)?;
    let first = from.many(sources, u32::from_le_bytes)?;
    let values = from.many(blocks, |block: [u8; 2 * BLOCK]| {
        std::array::from_fn(|k| u16::from_le_bytes([block[2 * k], block[2 * k + 1]]))
    })?;
    let vertices = patches.vertices.len();
    let transfers = Transfers::from_parts(vertices, bits, first, values)?;
    let nodes = from.number()? as usize;
    let areas_m2 = from.many(nodes, f32::from_le_bytes)?;
    let means = from.many(nodes.checked_mul(sources)?, u16::from_le_bytes)?;
    let rest = from.number()? as usize;
    let rest_rgb = from.many(rest, |rgb: [u8; 12]| {
        std::array::from_fn(|c| f32::from_le_bytes(std::array::from_fn(|k| rgb[4 * c + k])))
    })?;
    let sums = NodeSums::from_parts(sources, areas_m2, means)?;
    let fits = sources == ends.sources.len()
        && nodes == ends.octree.nodes().len()
        && rest == vertices
        && from.0.is_empty();
    fits.then_some(Sent { transfers, sums, rest_rgb })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        model::room::{Face, RoomSurface},
        nearfield::prepare::{RoomLight, prepare},
    };
    use glam::Vec3;
    use proptest::prelude::*;
    use std::{
        path::PathBuf,
        sync::atomic::{AtomicUsize, Ordering},
    };

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

    fn run(room: &Room, how: &RoomSettings, folder: &Path) -> (KnownRoom, bool) {
        let lit = LitRoom::new(room.clone(), how, RoomLight::Given, &|_| ()).unwrap();
        let told = AtomicUsize::new(0);
        let ready = ready(lit, how, None, Some(folder), &|share| {
            told.fetch_max((1000.0 * share) as usize, Ordering::Relaxed);
        });
        assert_eq!(told.into_inner(), 1000);
        ready.unwrap()
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

    fn files(folder: &Path) -> Vec<PathBuf> {
        let of = |kind: &&str| std::fs::read_dir(folder.join(kind)).unwrap().map(|e| e.unwrap().path());
        KINDS.iter().flat_map(of).collect()
    }

    #[test]
    fn what_is_kept_is_the_same_to_the_last_bit() {
        let folder = folder("kept-room");
        let fresh = prepare(room(), &settings(), RoomLight::Given, None, &|_| ()).unwrap();
        assert!(fresh.field.report().sources_left_out > 0 && fresh.volume.places().1 > 0);
        let (first, kept) = run(&room(), &settings(), &folder);
        assert!(!kept && files(&folder).len() == 2);
        assert_same(&first, &fresh);
        let (again, kept) = run(&room(), &settings(), &folder);
        assert!(kept);
        assert_same(&again, &fresh);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn all_that_goes_in_is_in_the_key() {
        let lit = |room: Room| LitRoom::new(room, &settings(), RoomLight::Given, &|_| ()).unwrap();
        let of = |lit: &LitRoom, how: &Preparation| key(&lit.room, &lit.patches, how);
        let how = Preparation::default();
        let mut keys = vec![of(&lit(room()), &how)];
        for power_share in [0.5, 0.9] {
            keys.push(of(&lit(room()), &Preparation { power_share, ..how }));
        }
        keys.push(of(&lit(room()), &Preparation { rays_side: 2, ..how }));
        let mut changed = |change: &dyn Fn(&mut LitRoom)| {
            let mut lit = lit(room());
            change(&mut lit);
            keys.push(of(&lit, &how));
        };
        changed(&|lit| lit.room.surfaces[1].corners_world[2].z += 1e-6);
        changed(&|lit| lit.room.surfaces[1].faces[0] = Face::Triangle([0, 1, 2]));
        changed(&|lit| lit.patches.vertices[3].gather_world.x += 1e-6);
        changed(&|lit| lit.patches.patches[3].corners[0] += 1);
        changed(&|lit| lit.patches.patches[3].radiance_rgb[2] += 1e-6);
        changed(&|lit| lit.patches.patches[3].reflectance_rgb[2] += 1e-6);
        changed(&|lit| lit.patches.patches[3].seen ^= true);
        changed(&|lit| lit.patches.patches[3].area_m2 *= 1.001);
        let count = keys.len();
        keys.sort_unstable();
        keys.dedup();
        assert_eq!(keys.len(), count);
        // Names change nothing.
        let mut renamed = room();
        renamed.surfaces[0].name = "ground".into();
        assert!(keys.contains(&of(&lit(renamed), &how)));
    }

    #[test]
    fn a_file_of_another_room_is_not_taken() {
        let folder = folder("kept-foreign");
        let mut darker = room();
        darker.surfaces[1].emitted_rgb = [1.0; 3];
        let (wanted, _) = run(&room(), &settings(), &folder);
        let own = files(&folder);
        run(&darker, &settings(), &folder);
        for file in files(&folder).into_iter().filter(|file| !own.contains(file)) {
            let kind = file.parent().unwrap();
            let target = own.iter().find(|own| own.starts_with(kind)).unwrap();
            std::fs::copy(&file, target).unwrap();
        }
        let (made, kept) = run(&room(), &settings(), &folder);
        assert!(!kept);
        assert_same(&made, &wanted);
        assert!(run(&room(), &settings(), &folder).1, "mended");
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_no_error() {
        let folder = folder("kept-nowhere");
        std::fs::write(&folder, "a file").unwrap();
        let (_, kept) = run(&room(), &settings(), &folder);
        assert!(!kept && !run(&room(), &settings(), &folder).1);
        std::fs::remove_file(&folder).unwrap();
    }

    /// Cut, lengthened and altered.
    fn damage()
    -> impl Strategy<Value = (usize, Option<prop::sample::Index>, Vec<(prop::sample::Index, u8)>, usize)>
    {
        let flips = prop::collection::vec((any::<prop::sample::Index>(), 1u8..), 0..4);
        (0usize..2, any::<Option<prop::sample::Index>>(), flips, 0usize..3)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn damage_is_noticed_and_mended((which, cut, flips, longer) in damage()) {
            let folder = folder("kept-damage");
            let (wanted, _) = run(&room(), &settings(), &folder);
            let file = files(&folder).remove(which);
            let sound = std::fs::read(&file).unwrap();
            let mut bytes = sound.clone();
            bytes.truncate(cut.map_or(sound.len(), |cut| cut.index(sound.len())));
            for (at, bits) in flips.iter().filter(|_| !bytes.is_empty()).collect::<Vec<_>>() {
                let at = at.index(bytes.len());
                bytes[at] ^= bits;
            }
            bytes.extend(vec![0; longer]);
            std::fs::write(&file, &bytes).unwrap();
            let (made, kept) = run(&room(), &settings(), &folder);
            prop_assert_eq!(kept, bytes == sound);
            assert_same(&made, &wanted);
            prop_assert_eq!(std::fs::read(&file).unwrap(), sound);
            std::fs::remove_dir_all(&folder).unwrap();
        }

        /// Even where a checksum were right.
        #[test]
        fn any_content_is_judged((which, cut, flips, longer) in damage()) {
            let lit = LitRoom::new(room(), &settings(), RoomLight::Given, &|_| ()).unwrap();
            let ends = Ends::of(&lit.patches, &Preparation::default()).unwrap();
            let sent = Sent::find(&lit.room, &lit.patches, &ends, &Preparation::default(), &|_| ());
            let sound = encode(&sent);
            prop_assert!(decode(&sound, &lit.patches, &ends) == Some(sent));
            let mut bytes = sound;
            let length = bytes.len();
            bytes.truncate(cut.map_or(length, |cut| cut.index(length)));
            for (at, bits) in flips {
                // The counts at its beginning above all.
                let end = if which == 0 { bytes.len() } else { bytes.len().min(12) };
                if end > 0 {
                    bytes[at.index(end)] ^= bits;
                }
            }
            bytes.extend(vec![0; longer]);
            let _ = decode_volume(&bytes, &lit.patches);
            if let Some(sent) = decode(&bytes, &lit.patches, &ends) {
                let known = lit.ready((ends, sent), None, &settings(), None, &|_| ());
                prop_assert!(known.is_ok());
            }
        }
    }
}
