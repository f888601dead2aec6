use super::*;
use crate::nearfield::{
    fixture,
    patches::{Subdivision, subdivide},
};

#[test]
fn an_even_room_gathers_its_own_radiance() {
    // All walls shine with L: at every place the form factors of what is seen sum to 1.
    let room = Room { surfaces: vec![fixture::walls(2.0)] };
    let field = fixture::field(&room, 400, &fixture::ALL);
    for (gathered, vertex) in field.gathered_rgb.iter().zip(&field.patches.vertices) {
        // The patch that a place lies on, and those that it sees edge-on, give nothing: exact all the same.
        assert!((gathered[0] / 2.0 - 1.0).abs() < 1e-3, "{gathered:?} at {vertex:?}");
        assert!((gathered[1] / 1.8 - 1.0).abs() < 1e-3);
    }
    assert_eq!(field.kept_rgb, field.gathered_rgb);
    let report = field.report();
    assert!(report.lost_worst == 0.0 && report.unlit_receivers == 0 && report.power_share == 1.0);
}

#[test]
fn what_the_set_leaves_out_is_accounted_for() {
    // A lamp, and walls that shine faintly: half of the power.
    let mut room = fixture::room();
    room.surfaces[0] = fixture::walls(0.18);
    let all = fixture::field(&room, 400, &fixture::ALL);
    let some = fixture::field(&room, 400, &Preparation { power_share: 0.7, ..fixture::ALL });
    let report = some.report();
    assert!(report.sources_left_out > 50 && (report.power_share - 0.7).abs() < 0.02, "{report:?}");
    // Faint walls in the set take the whole lamp first.
    assert!(report.lost_mean > 0.1 && report.lost_worst > report.lost_mean && report.lost_worst <= 1.0);
    let (mut off, mut sum) = (0.0, 0.0);
    for (rough, exact) in some.gathered_rgb.iter().zip(&all.gathered_rgb) {
        off += (rough[0] - exact[0]).abs();
        sum += exact[0];
    }
    // Other places of the rays: 1.0 % where the table hides a part.
    assert!(off / sum < 0.015, "{}", off / sum);
    for (kept, all) in some.kept_rgb.iter().zip(&some.gathered_rgb) {
        assert!(kept[0] <= all[0]);
    }
}

#[test]
fn shafts_neglect_no_more_than_their_budget() {
    let mut room = fixture::room();
    room.surfaces[0] = fixture::walls(0.05);
    for neglected in [0.0, 0.02, 0.3] {
        let field = fixture::field(&room, 300, &Preparation { neglected, ..fixture::ALL });
        let mut kept = vec![[0.0f32; 3]; field.patches.vertices.len()];
        // For each vertex the light of all sources that some leaf shaft links to one of its patches.
        let mut seen = std::collections::HashSet::new();
        let leaf_shafts = (0..field.source_tree.nodes().len() as u32)
            .flat_map(|s| (0..field.octree.nodes().len() as u32).map(move |r| (s, r)))
            .filter(|&(s, r)| field.shafts.has(s, r) && field.shafts.divides_source(s, r).is_none());
        let mut leaves = 0;
        for (source, receiver) in leaf_shafts {
            leaves += 1;
            let node = &field.octree.nodes()[receiver as usize];
            let source = field.source_tree.nodes()[source as usize];
            assert!(node.is_leaf() && source.is_leaf());
            for &item in field.octree.items(node) {
                for &v in field.patches.patches[field.receivers[item as usize] as usize].corners() {
                    if seen.insert((source.begin, v)) {
                        let light = field.sources[source.begin as usize];
                        let t = field.transfers().at(source.begin as usize, v as usize);
                        kept[v as usize].iter_mut().zip(light.radiance_rgb).for_each(|(s, c)| *s += c * t);
                    }
                }
            }
        }
        let mut worst = 0.0f32;
        for (kept, all) in kept.iter().zip(&field.kept_rgb).filter(|(_, all)| all[1] > 0.0) {
            worst = worst.max(1.0 - color::luminance(*kept) / color::luminance(*all));
        }
        // A vertex loses no more than its budget, up to the rounding of sums in f32.
        assert!(worst <= neglected + 1e-4, "{worst} of {neglected}");
        let report = field.report();
        assert!(report.neglected_worst <= neglected + 1e-5);
        assert!(neglected == 0.0 || report.neglected_worst > 0.5 * neglected, "{report:?}");
        assert!(leaves == report.leaf_shafts && leaves > 0 && report.shafts > leaves);
    }
}

#[test]
fn two_thousand_shining_patches_keep_within_their_memory() {
    let mut room = fixture::room();
    room.surfaces[0] = fixture::walls(0.05);
    room.surfaces[1].emitted_rgb = [0.02; 3];
    let how = Preparation { power_share: 1.0, ..Preparation::default() };
    let report = *fixture::field(&room, 2000, &how).report();
    assert!(report.patches == 2000 && report.sources == 2000, "{report:?}");
    let (sources, vertices) = (report.sources, report.vertices);
    // Nearly every patch sends something to half of the vertices: two bytes each, and two for each node of the octree.
    assert!(report.transfer_bytes > sources * vertices / 2 && report.transfer_bytes < 3 * sources * vertices);
    // 16 MiB are allowed. A bit for every pair of nodes, and not a shaft of eight bytes each.
    assert!(report.bytes < 11 << 20, "{report:?}");
    assert!(report.shaft_bytes < report.leaf_shafts, "{report:?}");
    assert!(report.bytes > report.transfer_bytes + report.shaft_bytes);
}

#[test]
fn the_same_for_any_number_of_threads() {
    let mut room = fixture::room();
    room.surfaces[0] = fixture::walls(0.05);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fixture::field(&room, 250, &Preparation::default()))
    };
    let (one, three) = (build(1), build(3));
    assert_eq!(one.transfers(), three.transfers());
    assert_eq!(one.gathered_rgb, three.gathered_rgb);
    assert_eq!(one.shafts, three.shafts);
    assert_eq!(one.patches, three.patches);
}

#[test]
fn rooms_that_cannot_be_used_say_why() {
    let how = Preparation::default();
    let build = |room: &Room, how: &Preparation| {
        let divided = subdivide(room, &Subdivision { patches: 60, ..Subdivision::default() }, &|_| None)?;
        NearField::build(room, divided, how, &|_| ()).map(|field| *field.report())
    };
    let dark = Room { surfaces: vec![fixture::walls(0.0)] };
    assert!(matches!(build(&dark, &how), Err(RoomError::NoLight { patches: 6.. })));
    let mut black = fixture::room();
    black.surfaces.iter_mut().for_each(|s| s.reflectance_rgb = [0.0; 3]);
    assert!(matches!(build(&black, &how), Err(RoomError::NoReceivers { .. })));
    for bad in [
        Preparation { power_share: 0.0, ..how },
        Preparation { power_share: f32::NAN, ..how },
        Preparation { rays_side: 0, ..how },
        Preparation { neglected: 0.6, ..how },
    ] {
        assert!(matches!(build(&fixture::room(), &bad), Err(RoomError::Setting { .. })), "{bad:?}");
    }
    // Inside out: it is accepted, and the report says that no receiver of the walls is lit.
    let mut turned = fixture::room();
    for face in &mut turned.surfaces[0].faces {
        if let crate::model::room::Face::Quad(corners) = face {
            corners.reverse();
        }
    }
    let report = build(&turned, &how).unwrap();
    let right = build(&fixture::room(), &how).unwrap();
    // What is left lit is the table's upper side.
    assert!(report.unlit_receivers > 2 * right.unlit_receivers, "{report:?} {right:?}");
    // Without a floor and a wall: open edges are no error.
    let mut open = fixture::room();
    open.surfaces[0].faces.truncate(4);
    assert!(build(&open, &how).unwrap().sources > 0);
}

#[test]
fn progress_reaches_the_end() {
    let room = fixture::room();
    let divided =
        subdivide(&room, &Subdivision { patches: 80, ..Subdivision::default() }, &|_| None).unwrap();
    let told = std::sync::Mutex::new(Vec::new());
    NearField::build(&room, divided, &fixture::ALL, &|share| told.lock().unwrap().push(share)).unwrap();
    let told = told.into_inner().unwrap();
    assert!(told.len() > 10 && told.last() == Some(&1.0) && told.iter().all(|s| (0.0..=1.0).contains(s)));
}
