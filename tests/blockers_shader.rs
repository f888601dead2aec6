//! The shader functions of the blockers, in a kernel of this test's own: the same V as the twin, and one that can be.

#[path = "support/gles.rs"]
mod gles;
mod support;

use bytemuck::Zeroable;
use glam::{Quat, Vec3};
use halflight::{
    model::blocker::{BlockerBox, BlockerSphere, Rung},
    visibility::blockers::{BlockerTables, BlockerTerms, Blockers},
};
use std::path::Path;

const KERNEL: &str = "
@group(0) @binding(0) var<uniform> blockers: BlockerTerms;
@group(0) @binding(1) var<uniform> tables: BlockerTables;
@group(0) @binding(2) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> results: array<f32>;

@compute @workgroup_size(64)
fn each(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&points) {
        return;
    }
    let point = points[id.x].xyz;
    var hidden = blocker_blocked(point, vec3<f32>(0.0, 0.0, 1.0), 2u);
    for (var i = 0u; i < 36u; i += 1u) {
        results[36u * id.x + i] = hidden[i / 4u][i % 4u];
    }
}
";

fn wgsl() -> String {
    let read = |name: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders/shared").join(name);
        std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
    };
    read("sh_basis.wgsl") + &read("sh_product.wgsl") + &read("blockers.wgsl") + KERNEL
}

fn spheres() -> Vec<BlockerSphere> {
    // A pile with overlaps, one behind another, one that receivers stand in, one of the receivers' own body.
    let mut list: Vec<BlockerSphere> = (0..12)
        .map(|i| {
            let turn = i as f32 * 2.4;
            BlockerSphere {
                centre_world: Vec3::new(0.3 * turn.cos(), 0.3 * turn.sin(), 0.15 + 0.1 * i as f32),
                radius_m: 0.1 + 0.02 * (i % 4) as f32,
                body: 0,
            }
        })
        .collect();
    list.push(BlockerSphere { centre_world: Vec3::new(0.8, 0.0, 0.0), radius_m: 0.3, body: 1 });
    list.push(BlockerSphere { centre_world: Vec3::new(-0.5, 0.0, 0.4), radius_m: 0.3, body: 2 });
    list
}

/// Thin and thick ones, one that receivers stand in, a sheet, one of the receivers' own body.
fn boxes() -> Vec<BlockerBox> {
    let of = |at: [f32; 3], half: [f32; 3], tilt: f32, body| {
        let turn = Quat::from_rotation_x(tilt) * Quat::from_rotation_z(1.0 + tilt);
        BlockerBox {
            centre_world: at.into(),
            axes_world: [turn * Vec3::X, turn * Vec3::Y, turn * Vec3::Z],
            half_m: half.into(),
            body,
        }
    };
    vec![
        of([0.0, 0.0, 0.3], [0.2, 0.15, 0.002], 0.2, 0),
        of([0.4, -0.4, 0.25], [0.003, 0.2, 0.1], 1.3, 0),
        of([-0.6, 0.5, 0.05], [0.1, 0.1, 0.1], 0.0, 1),
        of([0.5, 0.6, 0.2], [0.2, 0.1, 0.0], 0.5, 1),
        of([-0.4, -0.5, 0.2], [0.1, 0.1, 0.1], 0.4, 2),
    ]
}

/// Spheres, a rung and an order.
struct Case {
    name: String,
    blockers: Blockers,
    /// The most that a coefficient may be off.
    most: f32,
}

/// Every rung but `directions` at every order.
fn cases() -> Vec<Case> {
    // Of different bodies, so that nothing is left out before the caps are compared.
    let crowd = |spread_m: f32| -> Vec<BlockerSphere> {
        (0..200)
            .map(|i| {
                let (sin, cos) = (i as f32 * 2.4).sin_cos();
                let share = (i as f32 + 0.5) / 200.0;
                let off = Vec3::new(share.sqrt() * cos, share.sqrt() * sin, share);
                BlockerSphere {
                    centre_world: Vec3::new(0.1, 0.05, 0.3) + spread_m * off,
                    radius_m: 0.25,
                    body: 10 + i,
                }
            })
            .collect()
    };
    let lists = [
        ("a pile", spheres()),
        ("a pile and boxes", spheres()),
        ("boxes", Vec::new()),
        ("200 at one place", crowd(0.0)),
        ("200 within 1 mm", crowd(1e-3)),
        ("200 within 0.3 m", crowd(0.3)),
    ];
    let mut cases = Vec::new();
    for order in 2..=6 {
        for rung in Rung::ALL.into_iter().filter(|rung| *rung != Rung::Directions) {
            for (what, list) in &lists {
                let mut blockers = Blockers::new();
                blockers.prepare(list, rung, order, 64);
                if what.contains("boxes") {
                    blockers.add_boxes(&boxes());
                }
                assert!(blockers.fit_shader());
                let name = format!("{what}, {} order {order}", rung.name());
                let most = most_off(what, rung);
                cases.push(Case { name, blockers, most });
            }
        }
    }
    cases
}

/// Measured for the pile 1.2e-5 (`squared`, whose squarings double what the last digits differ by); for the crowds 8e-6
/// for `dc` and `linear`, 4e-5 for `chain`, 3e-4 for `hybrid` and `squared`, which square nine times. Within 1 mm the last
/// digit decides which of 64 caps lie in another, and each one counts: there V is only to be a possible one.
fn most_off(what: &str, rung: Rung) -> f32 {
    match (what, rung) {
        ("200 within 1 mm", _) => f32::INFINITY,
        ("boxes" | "a pile and boxes", _) => 5e-5,
        ("a pile", _) | (_, Rung::Dc | Rung::Linear) => 2e-5,
        (_, Rung::Chain) => 1e-4,
        _ => 6e-4,
    }
}

/// Runs the kernel on an adapter of a backend; `None` where there is none.
fn on_gpu(backends: wgpu::Backends, all: &[Case], points: &[Vec3]) -> Option<Vec<Vec<f32>>> {
    use wgpu::util::DeviceExt;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapter =
        pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).ok()?;
    let info = adapter.get_info();
    println!("on {} ({} {})", info.name, info.driver, info.driver_info);
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        required_limits: wgpu::Limits::downlevel_defaults().or_worse_values_from(&adapter.limits()),
        ..Default::default()
    }))
    .ok()?;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(wgsl().into()),
    });
    let pipelines = [2, 3, 4, 5, 6].map(|order| {
        device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: Some("each"),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &[("SH_ORDER", f64::from(order))],
                ..Default::default()
            },
            cache: None,
        })
    });
    let buffer = |contents: &[u8], usage| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    };
    let places: Vec<[f32; 4]> = points.iter().map(|p| p.extend(0.0).to_array()).collect();
    let places = buffer(bytemuck::cast_slice(&places), wgpu::BufferUsages::STORAGE);
    let size = 36 * points.len() as u64 * 4;
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let out =
        device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
    let mut results = Vec::new();
    for Case { blockers, .. } in all {
        let read = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage,
            mapped_at_creation: false,
        });
        let (mut terms, mut tables) = (BlockerTerms::zeroed(), BlockerTables::zeroed());
        blockers.shader_terms(&mut terms);
        blockers.shader_tables(&mut tables);
        let buffers = [
            buffer(bytemuck::bytes_of(&terms), wgpu::BufferUsages::UNIFORM),
            buffer(bytemuck::bytes_of(&tables), wgpu::BufferUsages::UNIFORM),
            places.clone(),
            out.clone(),
        ];
        let entries: Vec<_> = buffers
            .iter()
            .zip(0..)
            .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let pipeline = &pipelines[blockers.order() - 2];
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(points.len().div_ceil(64) as u32, 1, 1);
        }
        encoder.copy_buffer_to_buffer(&out, 0, &read, 0, size);
        queue.submit([encoder.finish()]);
        read.slice(..).map_async(wgpu::MapMode::Read, |_| {});
        device.poll(wgpu::PollType::wait_indefinitely()).ok()?;
        let view = read.slice(..).get_mapped_range().ok()?;
        results.push(bytemuck::cast_slice::<u8, f32>(&view).to_vec());
    }
    Some(results)
}

/// The shader's V is the twin's, and within what 0 <= V <= 1 allows.
fn same_as_the_twin(test: &str, backends: wgpu::Backends) {
    let points: Vec<Vec3> = (0..400)
        .map(|i| Vec3::new((i % 20) as f32 * 0.1 - 0.95, (i / 20) as f32 * 0.1 - 0.95, 0.0))
        .collect();
    let cases = cases();
    let Some(results) = on_gpu(backends, &cases, &points) else {
        return support::skip_gpu(test, "no adapter");
    };
    let whole = (4.0 * std::f32::consts::PI).sqrt();
    for (Case { name, blockers, most }, results) in cases.iter().zip(results) {
        let (mut worst, mut most_hidden) = (0.0f32, 0.0f32);
        for (point, hidden) in points.iter().zip(results.chunks(36)) {
            let mut v = [0.0; 36];
            blockers.visibility(*point, Vec3::Z, Some(2), &mut v);
            most_hidden = most_hidden.max(whole - v[0]);
            worst = worst.max((whole - v[0] - hidden[0]).abs());
            worst = v[1..]
                .iter()
                .zip(&hidden[1..])
                .fold(worst, |worst, (v, hidden)| worst.max((v + hidden).abs()));
            let mean = whole - hidden[0];
            assert!((0.0..=whole * 1.000_001).contains(&mean), "{name}: {mean}");
            let rest: f32 = hidden[1..].iter().map(|v| v * v).sum();
            assert!(rest <= mean * hidden[0] * 1.00001 + 2e-6, "{name}: {rest}, {mean}");
        }
        println!("{name}: within {worst:.1e}, up to {most_hidden:.1} hidden");
        assert!(most_hidden > 0.5, "{name}: {most_hidden}");
        assert!(worst < *most, "{name}: {worst:e}");
    }
}

#[test]
fn the_shader_gives_what_the_twin_gives_on_vulkan() {
    same_as_the_twin("the shader's V on Vulkan", wgpu::Backends::VULKAN);
}

#[test]
fn the_shader_gives_what_the_twin_gives_on_gl() {
    same_as_the_twin("the shader's V on GL", wgpu::Backends::GL);
}

#[test]
fn gles_3_1_does_the_same() {
    gles::assert_gles_3_1(&gles::child("the_shader_gives_what_the_twin_gives_on_gl", "3.1"));
}
