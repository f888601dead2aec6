use super::*;
use crate::model::light::{HardLight, Lights, RadianceSh};
use crate::model::scene::{Material, Mesh, RealSurface, Scene, VirtualObject};
use glam::Affine3A;
use proptest::prelude::*;
use std::f32::consts::PI;

fn table(albedo_rgb: Option<[f32; 3]>, receives_shadow: bool) -> SurfaceGeometry {
    let positions = [[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]];
    let mesh = Mesh {
        positions: positions.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec(),
        normals: vec![Vec3::Z; 4],
        tints_rgb: vec![[1.0; 3]; 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    let mut surfaces = SurfaceGeometry::default();
    surfaces.load(&[RealSurface { name: "table".into(), mesh, receives_shadow, albedo_rgb }]);
    surfaces
}

/// Red, and a mirror: bodies 0 and 1.
fn objects() -> ObjectGeometry {
    let object = |material| VirtualObject {
        name: "o".into(),
        mesh: Mesh {
            positions: vec![Vec3::X, Vec3::Y, Vec3::Z],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        },
        material,
        world_from_object: Affine3A::IDENTITY,
        openness: vec![],
    };
    let red = object(Material::Lambert { albedo_rgb: [0.8, 0.1, 0.0] });
    let mirror = object(Material::Mirror { reflectance_rgb: [0.9; 3] });
    let mut objects = ObjectGeometry::default();
    objects.load(&Scene { objects: vec![red, mirror], ..Scene::default() });
    objects
}

fn picture() -> EnvironmentPicture {
    let mut picture = EnvironmentPicture::default();
    picture.all.reshape(8);
    picture.all.texels_mut().fill([5.0, 6.0, 7.0]);
    picture
}

fn sun_and_sky() -> LightTerms {
    let mut global = RadianceSh::zero(4);
    global.rgb[0] = [(4.0 * PI).sqrt(); 3];
    let mut lights = Lights::soft(global);
    lights.hard.push(HardLight {
        to_light_world: [0.0, 0.0, 1.0],
        irradiance_rgb: [PI, 2.0 * PI, 0.0],
        extent_rad: 0.0,
    });
    LightTerms::of(&lights)
}

fn sphere(at: Vec3, radius_m: f32, body: u32) -> BlockerSphere {
    BlockerSphere { centre_world: at, radius_m, body }
}

#[test]
fn the_nearest_of_surface_sphere_and_sky_is_seen() {
    let (light, picture, objects) = (sun_and_sky(), picture(), objects());
    let mut reflected = Reflected::default();
    reflected.load(&table(Some([0.5, 0.25, 1.0]), true));
    reflected.prepare(
        &[sphere(Vec3::new(0.0, 3.0, 1.0), 0.5, 0), sphere(Vec3::new(0.0, 0.0, 1.0), 0.9, 1)],
        &objects,
    );
    let seen = |along: Vec3, body: u32, lit: f32| {
        reflected.seen(&light, &picture, Vec3::new(0.0, 0.0, 1.0), along.normalize(), body, |_, _, _| lit)
    };
    // Up: the sky's picture. Level: the red ball's side, which the sun from above misses; under the sky's irradiance pi.
    assert_eq!(seen(Vec3::Z, 1, 1.0), [5.0, 6.0, 7.0]);
    let ball = seen(Vec3::Y, 1, 1.0);
    assert!((ball[0] - 0.8).abs() < 1e-5 && (ball[1] - 0.1).abs() < 1e-5 && ball[2] == 0.0, "{ball:?}");
    // The red body does not see itself, and there the mirror's body has no sphere either.
    assert_eq!(seen(Vec3::Y, 0, 1.0), [5.0, 6.0, 7.0]);
    // Down: the table, the sky on it less what the mirror's own sphere (R = .81 straight above) and the far one take.
    let up = 1.0 / 10f32.sqrt();
    let open = (1.0 - 0.81) * (1.0 - up * 0.25 / 10.0);
    for lit in [1.0, 0.25, 0.0] {
        let down = seen(Vec3::NEG_Z, 1, lit);
        let want = [0.5 * (open + lit), 0.25 * (open + 2.0 * lit), open];
        for (a, b) in down.iter().zip(want) {
            assert!((a - b).abs() < 1e-5, "{lit}: {down:?} {want:?}");
        }
    }
}

#[test]
fn an_unknown_surface_is_the_picture_less_its_shadow() {
    let (light, picture, objects) = (sun_and_sky(), picture(), objects());
    let mut reflected = Reflected::default();
    reflected.load(&table(None, true));
    reflected.prepare(&[], &objects);
    let seen = |reflected: &Reflected, lit: f32| {
        reflected.seen(&light, &picture, Vec3::Z, Vec3::new(0.3, 0.0, -0.8).normalize(), 1, |_, _, _| lit)
    };
    let close = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
    assert!(close(seen(&reflected, 1.0), [5.0, 6.0, 7.0]));
    // Red loses the sun's half of its light, green two thirds; blue has no sun.
    assert!(close(seen(&reflected, 0.0), [2.5, 2.0, 7.0]), "{:?}", seen(&reflected, 0.0));
    reflected.load(&table(None, false));
    assert!(close(seen(&reflected, 0.0), [5.0, 6.0, 7.0]));
}

#[test]
fn the_device_gets_the_largest_triangles() {
    let mut mesh = Mesh::default();
    for k in 0..100u32 {
        let size = 1.0 + k as f32;
        mesh.positions.extend([Vec3::ZERO, Vec3::X * size, Vec3::Y * size]);
        mesh.triangles.push([3 * k, 3 * k + 1, 3 * k + 2]);
    }
    let mut surfaces = SurfaceGeometry::default();
    surfaces.load(&[RealSurface { name: "many".into(), mesh, receives_shadow: true, albedo_rgb: None }]);
    let mut reflected = Reflected::default();
    reflected.load(&surfaces);
    assert_eq!(reflected.largest_triangles().len(), MOST_TRIANGLES);
    assert!(reflected.largest_triangles().iter().all(|t| t.edge_u.x >= 37.0));
    reflected.load(&table(None, true));
    assert_eq!(reflected.largest_triangles().len(), 2);
}

proptest! {
    #[test]
    fn never_negative_never_not_a_number(
        origin in prop::array::uniform3(-2.0f32..2.0),
        along in prop::array::uniform3(-1.0f32..1.0),
        centre in prop::array::uniform3(-2.0f32..2.0),
        radius in 1e-3f32..3.0,
        lit in 0.0f32..=1.0,
    ) {
        let mut reflected = Reflected::default();
        reflected.load(&table(None, true));
        reflected.prepare(&[sphere(centre.into(), radius, 0), sphere(origin.into(), radius, 1)], &objects());
        let along = Vec3::from(along).normalize_or(Vec3::X);
        let out = reflected.seen(&sun_and_sky(), &picture(), origin.into(), along, 1, |_, _, _| lit);
        prop_assert!(out.iter().all(|c| c.is_finite() && *c >= 0.0 && *c < 8.0), "{:?}", out);
    }
}
