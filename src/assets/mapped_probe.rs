//! Probes mapped onto rooms, kept in a folder from run to run under a hash of all that goes in.

use super::kept::{self, Bytes, Key, Reader};
use crate::{
    model::room::{Face, Patch, PatchVertex, Room, RoomPatches, RoomSun},
    nearfield::{
        error::RoomError,
        patches::Subdivision,
        probe::{self, Mapped, Probe, ProbeReport, map_probe},
    },
};
use std::path::Path;

/// Its folder in the cache.
const KIND: &str = "room";

/// `map_probe`, or what an earlier run left in the folder `cache` for the same room, subdivision and probe, bit for bit. A
/// file there that is damaged is not used and written anew; where nothing can be written, that is logged and nothing else.
///
/// # Errors
/// As `map_probe`.
pub fn of_room(
    room: &Room,
    how: &Subdivision,
    probe: &Probe<'_>,
    cache: Option<&Path>,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<Mapped, RoomError> {
    let Some(folder) = cache else { return map_probe(room, how, probe, progress) };
    let key = key(room, how, probe);
    let file = kept::cache_file(folder, KIND, &key);
    if let Some(known) = kept::read(&file, &key, decode) {
        progress(1.0);
        return Ok(known);
    }
    let mapped = map_probe(room, how, probe, progress)?;
    if let Err(error) = kept::write(&file, &key, &encode(&mapped)) {
        tracing::warn!("the mapped probe is not kept: {error}");
    }
    Ok(mapped)
}

/// SHA-256 of the algorithm's version and all input.
fn key(room: &Room, how: &Subdivision, probe: &Probe<'_>) -> Key {
    let mut out = Bytes::default();
    out.number(probe::VERSION);
    out.number(room.surfaces.len() as u32);
    for surface in &room.surfaces {
        out.number(surface.corners_world.len() as u32);
        surface.corners_world.iter().for_each(|p| out.floats(&p.to_array()));
        out.number(surface.faces.len() as u32);
        for face in &surface.faces {
            out.number(match face {
                Face::Triangle(_) => 3,
                Face::Quad(_) => 4,
            });
            face.corners().iter().for_each(|i| out.number(*i));
        }
        out.floats(&surface.reflectance_rgb);
        out.floats(&surface.emitted_rgb);
    }
    out.number(how.patches as u32);
    out.floats(&[how.refined, how.edges]);
    out.0.extend(format!("{:?}", probe.map.layout).into_bytes());
    out.number(probe.map.radiance.width() as u32);
    out.number(probe.map.radiance.height() as u32);
    probe.map.radiance.pixels().iter().for_each(|p| out.floats(p));
    probe.world_from_map.to_cols_array().iter().for_each(|c| out.0.extend(c.to_le_bytes()));
    out.floats(&probe.position_world.to_array());
    out.number(u32::from(probe.factor_sun));
    kept::key(&out.0)
}

fn encode(mapped: &Mapped) -> Vec<u8> {
    let mut out = Bytes::default();
    let RoomPatches { vertices, patches, dropped_faces } = &mapped.patches;
    out.number(vertices.len() as u32);
    for v in vertices {
        [v.position_world, v.gather_world, v.normal_world].iter().for_each(|p| out.floats(&p.to_array()));
    }
    out.number(patches.len() as u32);
    for p in patches {
        p.corners.iter().for_each(|i| out.number(*i));
        out.floats(&p.centre_world.to_array());
        out.floats(&p.normal_world.to_array());
        out.floats(&[p.area_m2]);
        out.floats(&p.radiance_rgb);
        out.floats(&p.reflectance_rgb);
        out.number(u32::from(p.seen));
        out.number(p.surface);
    }
    out.number(*dropped_faces as u32);
    out.number(mapped.suns.len() as u32);
    for sun in &mapped.suns {
        out.floats(&sun.to_light_world);
        out.floats(&sun.irradiance_rgb);
        out.floats(&[sun.extent_rad]);
        out.number(sun.apertures.len() as u32);
        sun.apertures.iter().for_each(|i| out.number(*i));
    }
    let r = &mapped.report;
    [&r.flux_rgb, &r.sun_flux_rgb, &r.patch_flux_rgb].iter().for_each(|rgb| out.doubles(*rgb));
    out.floats(&[r.fronts, r.backs, r.nothing]);
    [r.seen_patches, r.filled_patches].iter().for_each(|n| out.number(*n as u32));
    out.number(r.damaged_texels);
    out.0
}

fn decode(bytes: &[u8]) -> Option<Mapped> {
    let mut from = Reader(bytes);
    let vertices = from.list(36, |r| {
        let (position_world, gather_world) = (r.place()?, r.place()?);
        Some(PatchVertex { position_world, gather_world, normal_world: r.place()? })
    })?;
    let patches = from.list(76, |r| {
        Some(Patch {
            corners: [r.number()?, r.number()?, r.number()?, r.number()?],
            centre_world: r.place()?,
            normal_world: r.place()?,
            area_m2: r.float()?,
            radiance_rgb: r.floats()?,
            reflectance_rgb: r.floats()?,
            seen: r.number()? != 0,
            surface: r.number()?,
        })
    })?;
    let dropped_faces = from.number()? as usize;
    let suns = from.list(32, |r| {
        Some(RoomSun {
            to_light_world: r.floats()?,
            irradiance_rgb: r.floats()?,
            extent_rad: r.float()?,
            apertures: r.list(4, Reader::number)?,
        })
    })?;
    let report = ProbeReport {
        flux_rgb: from.doubles()?,
        sun_flux_rgb: from.doubles()?,
        patch_flux_rgb: from.doubles()?,
        fronts: from.float()?,
        backs: from.float()?,
        nothing: from.float()?,
        seen_patches: from.number()? as usize,
        filled_patches: from.number()? as usize,
        damaged_texels: from.number()?,
    };
    let is_whole =
        from.0.is_empty() && patches.iter().all(|p| p.corners.iter().all(|&i| (i as usize) < vertices.len()));
    is_whole.then_some(Mapped { patches: RoomPatches { vertices, patches, dropped_faces }, suns, report })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{
        image::Image,
        light::{EnvironmentMap, MapLayout},
        room::RoomSurface,
    };
    use glam::{DMat3, Vec3};
    use proptest::prelude::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// A floor of one square metre, seen from half a metre above.
    fn room() -> Room {
        let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let floor = RoomSurface {
            name: "floor".into(),
            corners_world: corners.to_vec(),
            faces: vec![Face::Quad([0, 1, 2, 3])],
            reflectance_rgb: [0.5; 3],
            emitted_rgb: [0.0; 3],
        };
        Room { surfaces: vec![floor] }
    }

    #[test]
    fn what_is_kept_is_read_again_and_damage_is_mended() {
        let folder = std::env::temp_dir().join(format!("halflight-room-{}", std::process::id()));
        let (room, how) = (room(), Subdivision { patches: 20, ..Subdivision::default() });
        // Nothing but a strong small light above, which is a sun through the open side.
        let mut picture = Image::filled(64, 32, [1.0f32, 2.0, 3.0]);
        *picture.at_mut(5, 4) = [9e4; 3];
        let map = EnvironmentMap { layout: MapLayout::Equirect, radiance: picture };
        let maps = AtomicUsize::new(0);
        let run = |position_world: Vec3, room: &Room| {
            maps.store(0, Ordering::Relaxed);
            let count = |share: f32| {
                maps.fetch_add(usize::from(share < 1.0), Ordering::Relaxed);
            };
            let probe =
                Probe { map: &map, world_from_map: DMat3::IDENTITY, position_world, factor_sun: true };
            let mapped = of_room(room, &how, &probe, Some(&folder), &count).unwrap();
            (mapped, maps.load(Ordering::Relaxed) > 0)
        };
        let at = Vec3::new(0.0, 0.0, 0.5);
        let (first, fresh) = run(at, &room);
        assert!(fresh && first.suns.len() == 1, "{:?}", first.suns);
        assert!(first.patches.patches.len() > 4, "{}", first.patches.patches.len());
        assert_eq!(run(at, &room), (first.clone(), false));
        // Something else: another place, another reflectance.
        assert!(run(at.with_z(0.4), &room).1);
        let mut darker = room.clone();
        darker.surfaces[0].reflectance_rgb = [0.4; 3];
        assert!(run(at, &darker).1);
        let files: Vec<_> =
            std::fs::read_dir(folder.join("room")).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(files.len(), 3);
        for damage in [0usize, 40, 300] {
            for file in &files {
                let mut bytes = std::fs::read(file).unwrap();
                bytes[damage] ^= 1;
                std::fs::write(file, &bytes).unwrap();
            }
            assert_eq!(run(at, &room), (first.clone(), true), "damage at {damage}");
        }
        let (none, zeros) = ([0; kept::HASH], kept::cache_file(&folder, KIND, &[0; kept::HASH]));
        std::fs::write(&zeros, [0; 10]).unwrap();
        assert!(kept::read(&zeros, &none, decode).is_none());
        std::fs::remove_dir_all(&folder).unwrap();
    }

    proptest! {
        #[test]
        fn any_bytes_are_judged(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            let _ = decode(&bytes);
        }
    }
}
