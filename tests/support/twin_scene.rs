//! The scene that every kernel draws on the device and on its twin.

use glam::{Affine3A, Vec3};
use halflight::{
    assets::shapes,
    light::prefilter::Prefilter,
    model::{
        animation::Figure,
        environment::EnvironmentPicture,
        light::RadianceSamples,
        scene::{Material, Mesh, RealSurface, Scene, VirtualObject},
    },
};

fn sphere(name: &str, bands: u32, centre: Vec3, radius: f64, material: Material) -> VirtualObject {
    let mut mesh = shapes::uv_sphere(radius, 2 * bands, bands);
    mesh.tints_rgb = mesh.normals.iter().map(|n| [0.5 + 0.5 * n.x, 1.0, 0.7 + 0.3 * n.z]).collect();
    let openness = mesh.normals.iter().map(|n| 0.75 + 0.25 * n.z).collect();
    let world_from_object = Affine3A::from_translation(centre);
    VirtualObject { name: name.into(), mesh, material, world_from_object, openness }
}

fn box_mesh(low: Vec3, high: Vec3) -> Mesh {
    let half = (0.5 * (high - low)).as_dvec3();
    shapes::transformed(&shapes::cuboid(half), &Affine3A::from_translation(0.5 * (low + high)))
}

/// Matt, glossy and mirror spheres and a box on the ground; a real box in front hides some of them and receives
/// shadows, a real board only hides.
pub fn scene() -> Scene {
    let matt = Material::Lambert { albedo_rgb: [0.8, 0.5, 0.3] };
    let glossy = Material::Phong { albedo_rgb: [0.2, 0.3, 0.6], specular_rgb: [0.3; 3], exponent: 40.0 };
    let satin = Material::Phong { albedo_rgb: [0.1; 3], specular_rgb: [0.5, 0.6, 0.4], exponent: 6.0 };
    let mirror = Material::Mirror { reflectance_rgb: [0.9; 3] };
    let cube = VirtualObject {
        name: "cube".into(),
        mesh: box_mesh(Vec3::new(-0.25, 0.1, 0.0), Vec3::new(-0.1, 0.25, 0.15)),
        material: matt,
        world_from_object: Affine3A::IDENTITY,
        openness: Vec::new(),
    };
    let surface = |name: &str, mesh, receives_shadow| RealSurface {
        name: name.into(),
        mesh,
        receives_shadow,
        albedo_rgb: None,
    };
    let mut scene = Scene {
        objects: vec![
            sphere("matt", 24, Vec3::new(0.0, 0.0, 0.1), 0.1, matt),
            cube,
            sphere("glossy", 20, Vec3::new(0.15, -0.12, 0.05), 0.05, glossy),
            sphere("mirror", 20, Vec3::new(-0.15, -0.1, 0.06), 0.06, mirror),
            sphere("satin", 20, Vec3::new(-0.06, -0.17, 0.04), 0.04, satin),
            sphere("free", 16, Vec3::new(0.17, 0.06, 0.04), 0.04, satin),
        ],
        surfaces: vec![
            surface("ground", shapes::plane_z0(50.0), true),
            surface("box", box_mesh(Vec3::new(0.02, -0.25, 0.0), Vec3::new(0.1, -0.18, 0.07)), true),
            surface("board", box_mesh(Vec3::new(-0.3, -0.2, 0.0), Vec3::new(-0.2, -0.19, 0.1)), false),
        ],
        // Spheres that stand for them where they block soft light; two bodies overlap on purpose.
        figures: vec![
            body(
                "matt",
                0,
                Vec3::new(0.0, 0.0, 0.1),
                &[(Vec3::ZERO, 0.1), (Vec3::new(0.02, 0.0, 0.01), 0.09)],
            ),
            body("cube", 1, Vec3::ZERO, &[(Vec3::new(-0.17, 0.17, 0.07), 0.09)]),
            body("glossy", 2, Vec3::new(0.15, -0.12, 0.05), &[(Vec3::ZERO, 0.05)]),
            body("mirror", 3, Vec3::new(-0.15, -0.1, 0.06), &[(Vec3::ZERO, 0.06)]),
            body("satin", 4, Vec3::new(-0.06, -0.17, 0.04), &[(Vec3::ZERO, 0.04)]),
            body("free", 5, Vec3::new(0.17, 0.06, 0.04), &[(Vec3::ZERO, 0.04)]),
        ],
        ..Scene::default()
    };
    // The cube, the satin and one glossy ball answer by precomputed transfer, the others by their openness and the spheres of
    // all others.
    let mut transfer = halflight::assets::transfer::of_scene(&scene, 4, 32, None, &|_| ());
    for object in [0, 3, 5] {
        transfer.objects[object] = None;
    }
    scene.transfer = Some(std::sync::Arc::new(transfer));
    scene
}

fn body(name: &str, object: usize, at: Vec3, spheres: &[(Vec3, f32)]) -> Figure {
    Figure::still(name.into(), object, Affine3A::from_translation(at), spheres.iter().copied())
}

/// A sky that is brighter on one side, with a lamp; its levels as for gloss without hard lights.
pub fn environment() -> EnvironmentPicture {
    let mut samples = RadianceSamples::default();
    for k in 0..20_000 {
        let z = 1.0 - 2.0 * (k as f32 + 0.5) / 20_000.0;
        let (s, c) = (2.399_963_2 * k as f32).sin_cos();
        let d = Vec3::new((1.0 - z * z).sqrt() * c, (1.0 - z * z).sqrt() * s, z);
        let lamp = if d.dot(Vec3::new(0.48, 0.6, 0.64)) > 0.98 { 4.0 } else { 0.0 };
        samples.directions.push([d.x, d.y, d.z, 4.0 * std::f32::consts::PI / 20_000.0]);
        samples.radiance.push([1.0 + 0.5 * d.x + lamp, 1.0 + lamp, 1.0 - 0.4 * d.y, 0.0]);
    }
    let (mut picture, mut work) = (EnvironmentPicture::default(), Prefilter::default());
    work.see(&samples, 1.0, &mut picture);
    work.levels(Some(&samples), &mut picture);
    picture
}
