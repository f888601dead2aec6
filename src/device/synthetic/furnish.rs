//! What stands in the room. World frame: the table's top is z = 0, the tag lies at the origin; metres.

use super::{
    options::SyntheticSubject,
    paint::{BOARD_SIDE_M, Paint},
    room::{Lamp, RoomWindow, Solid},
    shapes::SyntheticShape,
};
use crate::model::rig::MirrorBall;
use glam::{DVec2, DVec3};

/// Solids and lights before anything is lit.
pub struct RoomPlan {
    /// The walls first.
    pub solids: Vec<Solid>,
    /// First members of the groups that stand together, then the number of solids.
    pub groups: Vec<usize>,
    /// Index of the table's top.
    pub table: usize,
    /// A small strong light.
    pub lamp: Lamp,
    /// A wide light.
    pub window: RoomWindow,
    /// Where it stands on the table, and how large it is.
    pub ball: MirrorBall,
}

const FLOOR: f64 = -0.74;
const CEILING: f64 = 1.86;
const ROOM: ([f64; 2], [f64; 2]) = ([-2.3, 1.7], [-1.4, 1.6]);

/// Where the board with the tag stands (the middle of its foot) and how it is turned about z, degrees, in the view of the room.
pub const BOARD: ([f64; 3], f64) = ([0.36, 0.22, 0.0], 26.0);

/// The whole room.
pub fn furnish(view: SyntheticSubject) -> RoomPlan {
    let lamp_centre = DVec3::new(-1.30, 0.64, 1.58);
    let lamp = Lamp {
        centre: lamp_centre,
        radius: 0.21,
        // Aimed beyond the table's middle, so that the nearer part of the table is hardly brighter.
        axis: (DVec3::new(0.8, -0.25, 0.0) - lamp_centre).normalize(),
        radiance: DVec3::new(1.10, 1.0, 0.84) * 6700.0,
    };
    let window =
        RoomWindow { low: DVec3::new(ROOM.0[0], -0.45, 0.16), size: DVec2::new(1.4, 1.25), radiance: 90.0 };
    let ball = MirrorBall {
        surface_radius_m: None,
        centre_world: DVec3::new(-0.20, 0.04, 0.06),
        radius_m: 0.06,
        reflectance_rgb: [0.90, 0.89, 0.87],
    };
    let mut solids = walls();
    let mut groups = vec![solids.len()];
    window_frame(&mut solids, &window);
    groups.push(solids.len());
    furniture(&mut solids, &mut groups);
    let table = solids.len();
    groups.push(table);
    table_with_legs(&mut solids, view);
    let first_on_table = solids.len();
    groups.push(first_on_table);
    on_the_table(&mut solids, view);
    if view == SyntheticSubject::Room {
        solids.push(Solid::new(
            SyntheticShape::standing(BOARD.0, [BOARD_SIDE_M, 0.02, BOARD_SIDE_M], BOARD.1),
            &[Paint::Plain(DVec3::splat(0.6)), Paint::Plain(DVec3::splat(0.6)), Paint::TagBoard],
        ));
    }
    solids.push(Solid {
        mirror: true,
        ..Solid::new(
            SyntheticShape::Sphere { centre: ball.centre_world, radius: ball.radius_m },
            &[Paint::Plain(DVec3::ZERO)],
        )
    });
    for solid in &mut solids[first_on_table..] {
        solid.on_table = true;
    }
    groups.push(solids.len());
    solids.push(Solid {
        shines: true,
        ..Solid::new(
            SyntheticShape::Sphere { centre: lamp.centre, radius: lamp.radius },
            &[Paint::Plain(DVec3::ZERO)],
        )
    });
    // Its stand.
    let metal = Paint::Plain(DVec3::splat(0.12));
    let foot = lamp.centre.truncate().extend(FLOOR);
    for (radius, height) in [(0.16, 0.03), (0.012, lamp.centre.z - lamp.radius - FLOOR + 0.005)] {
        solids.push(Solid::new(
            SyntheticShape::Cylinder { base: foot, radius, height, hollow: None },
            &[metal],
        ));
    }
    groups.push(solids.len());
    RoomPlan { solids, groups, table, lamp, window, ball }
}

fn walls() -> Vec<Solid> {
    let plaster = Paint::Wall(DVec3::new(0.52, 0.50, 0.45));
    let accent = Paint::Wall(DVec3::new(0.36, 0.43, 0.42));
    let parquet = Paint::Boards(0.11, 0.9, DVec3::new(0.40, 0.27, 0.155), DVec3::new(0.27, 0.165, 0.09));
    vec![Solid::new(
        SyntheticShape::Room {
            min: DVec3::new(ROOM.0[0], ROOM.1[0], FLOOR),
            max: DVec3::new(ROOM.0[1], ROOM.1[1], CEILING),
        },
        &[plaster, plaster, plaster, accent, parquet, Paint::Mottled(DVec3::splat(0.66), 0.04)],
    )]
}

fn window_frame(solids: &mut Vec<Solid>, w: &RoomWindow) {
    let white = Paint::Plain(DVec3::splat(0.74));
    let (x, y0, z0) = (w.low.x, w.low.y, w.low.z);
    let (y1, z1) = (y0 + w.size.x, z0 + w.size.y);
    let mut bar = |min: [f64; 2], max: [f64; 2], depth: f64| {
        solids.push(Solid::new(
            SyntheticShape::block([x, min[0], min[1]], [x + depth, max[0], max[1]]),
            &[white],
        ));
    };
    bar([y0 - 0.06, z0 - 0.06], [y1 + 0.06, z0], 0.16);
    bar([y0 - 0.06, z1], [y1 + 0.06, z1 + 0.06], 0.05);
    bar([y0 - 0.06, z0], [y0, z1], 0.05);
    bar([y1, z0], [y1 + 0.06, z1], 0.05);
    let middle = (y0 + y1) / 2.0;
    bar([middle - 0.025, z0], [middle + 0.025, z1], 0.04);
    bar([y0, z0 + 0.82], [y1, z0 + 0.86], 0.04);
    for (a, b) in [(y0 - 0.30, y0 - 0.02), (y1 + 0.02, y1 + 0.30)] {
        solids.push(Solid::new(
            SyntheticShape::block([x + 0.06, a, FLOOR + 0.06], [x + 0.12, b, z1 + 0.12]),
            &[Paint::Curtain],
        ));
    }
}

fn furniture(solids: &mut Vec<Solid>, groups: &mut Vec<usize>) {
    let dark = Paint::Plain(DVec3::new(0.16, 0.085, 0.045));
    let sage = Paint::Mottled(DVec3::new(0.20, 0.27, 0.26), 0.06);
    let oak = Paint::Mottled(DVec3::new(0.38, 0.25, 0.14), 0.12);
    // Cabinet with things on it, chair behind the table, then what lies along the walls and the floor.
    solids.push(Solid::new(SyntheticShape::block([-1.15, 1.20, FLOOR + 0.08], [0.35, 1.6, -0.02]), &[sage]));
    solids.push(Solid::new(SyntheticShape::block([-1.10, 1.24, FLOOR], [0.30, 1.58, FLOOR + 0.08]), &[dark]));
    for x in [-0.76, -0.38, 0.0] {
        solids.push(Solid::new(
            SyntheticShape::block([x - 0.006, 1.195, -0.70], [x + 0.006, 1.2, -0.05]),
            &[dark],
        ));
    }
    solids.push(Solid::new(
        SyntheticShape::Cylinder {
            base: DVec3::new(-0.9, 1.38, -0.02),
            radius: 0.08,
            height: 0.26,
            hollow: Some((0.07, 0.05)),
        },
        &[Paint::Glaze(DVec3::new(0.55, 0.22, 0.08), DVec3::new(0.65, 0.58, 0.45))],
    ));
    groups.push(solids.len());
    let seat = Paint::Mottled(DVec3::new(0.33, 0.10, 0.07), 0.2);
    solids.push(Solid::new(SyntheticShape::block([0.30, 0.62, -0.32], [0.72, 1.02, -0.27]), &[seat]));
    solids.push(Solid::new(SyntheticShape::block([0.30, 0.98, -0.02], [0.72, 1.02, 0.22]), &[seat]));
    for (x, y, top) in [(0.30, 0.62, -0.32), (0.68, 0.62, -0.32), (0.30, 0.98, 0.22), (0.68, 0.98, 0.22)] {
        solids.push(Solid::new(SyntheticShape::block([x, y, FLOOR], [x + 0.04, y + 0.04, top]), &[dark]));
    }
    let carpet = Solid::new(
        SyntheticShape::block([-1.3, -0.9, FLOOR], [1.1, 1.05, FLOOR + 0.008]),
        &[oak, oak, oak, oak, oak, Paint::Carpet],
    );
    let shelf = Solid::new(
        SyntheticShape::block([1.42, -0.95, FLOOR], [1.7, 0.75, 1.24]),
        &[Paint::Books(61), dark, dark, dark, dark, oak],
    );
    for piece in [carpet, shelf] {
        groups.push(solids.len());
        solids.push(piece);
    }
    groups.push(solids.len());
    let white = Paint::Plain(DVec3::splat(0.62));
    solids.push(Solid::new(SyntheticShape::block([-1.6, -1.4, FLOOR], [-0.75, -1.36, 1.30]), &[white]));
    let picture = |motif| {
        let p = Paint::Picture(motif);
        [dark, dark, p, p, dark, dark]
    };
    groups.push(solids.len());
    solids.push(Solid::new(SyntheticShape::block([-0.75, 1.575, 0.42], [0.05, 1.6, 1.02]), &picture(3)));
    solids.push(Solid::new(SyntheticShape::block([0.45, 1.575, 0.50], [0.90, 1.6, 1.10]), &picture(8)));
    groups.push(solids.len());
    solids.push(Solid::new(SyntheticShape::block([0.10, -1.4, 0.40], [1.10, -1.375, 1.05]), &picture(14)));
}

fn table_with_legs(solids: &mut Vec<Solid>, view: SyntheticSubject) {
    let edge = Paint::Mottled(DVec3::new(0.34, 0.22, 0.12), 0.15);
    let top = match view {
        SyntheticSubject::Desk => Paint::TableTop,
        SyntheticSubject::Room => Paint::BareTable,
    };
    solids.push(Solid::new(
        SyntheticShape::block([-0.62, -0.40, -0.032], [0.62, 0.46, 0.0]),
        &[edge, edge, edge, edge, edge, top],
    ));
    for (x, y) in [(-0.58, -0.36), (0.52, -0.36), (-0.58, 0.36), (0.52, 0.36)] {
        solids.push(Solid::new(SyntheticShape::block([x, y, FLOOR], [x + 0.06, y + 0.06, -0.032]), &[edge]));
    }
}

fn on_the_table(solids: &mut Vec<Solid>, view: SyntheticSubject) {
    let mug = DVec3::new(-0.03, 0.27, 0.0);
    let glaze = Paint::Glaze(DVec3::new(0.05, 0.20, 0.24), DVec3::new(0.62, 0.58, 0.50));
    let inside = Paint::Plain(DVec3::new(0.66, 0.64, 0.58));
    solids.push(Solid::new(
        SyntheticShape::Cylinder { base: mug, radius: 0.041, height: 0.095, hollow: Some((0.0375, 0.074)) },
        &[glaze, inside, inside, Paint::Plain(DVec3::new(0.045, 0.022, 0.012))],
    ));
    let outward = DVec3::new(0.80, -0.60, 0.0);
    solids.push(Solid::new(
        SyntheticShape::Handle {
            centre: mug + outward * 0.042 + DVec3::Z * 0.047,
            outward,
            radii: DVec2::new(0.026, 0.0058),
            mug: mug.truncate().extend(0.040),
        },
        &[Paint::Plain(DVec3::new(0.05, 0.20, 0.24))],
    ));
    let book = |foot: [f64; 3], size: [f64; 3], turn: f64, rgb: DVec3, accent: DVec3| {
        let (plain, pages) = (Paint::Plain(rgb), Paint::Pages);
        let faces = [plain, pages, pages, pages, plain, Paint::Cover(rgb, accent)];
        Solid::new(SyntheticShape::standing(foot, size, turn), &faces)
    };
    let cream = DVec3::new(0.62, 0.56, 0.42);
    let red = DVec3::new(0.34, 0.045, 0.04);
    let green = DVec3::new(0.05, 0.17, 0.09);
    // The board stands where the books lie otherwise.
    let has_books = view == SyntheticSubject::Desk;
    if has_books {
        solids.push(book([0.38, 0.31, 0.0], [0.17, 0.24, 0.028], 24.0, red, cream));
        solids.push(book([0.385, 0.305, 0.028], [0.13, 0.19, 0.018], 5.0, green, cream));
    }
    solids.push(Solid::new(
        SyntheticShape::Sphere { centre: DVec3::new(0.15, 0.33, 0.037), radius: 0.037 },
        &[Paint::Apple],
    ));
    let maple = Paint::Mottled(DVec3::new(0.56, 0.40, 0.22), 0.10);
    solids.push(Solid::new(SyntheticShape::standing([-0.26, 0.25, 0.0], [0.05, 0.05, 0.05], 33.0), &[maple]));
    let toy = Paint::Mottled(DVec3::new(0.48, 0.33, 0.05), 0.06);
    solids
        .push(Solid::new(SyntheticShape::standing([-0.335, 0.225, 0.0], [0.04, 0.04, 0.04], -12.0), &[toy]));
    let pencil = Paint::Plain(DVec3::new(0.55, 0.33, 0.03));
    if has_books {
        solids.push(Solid::new(
            SyntheticShape::standing([0.37, 0.12, 0.0], [0.17, 0.007, 0.007], -14.0),
            &[pencil],
        ));
    }
}
