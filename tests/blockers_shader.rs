//! The shader functions of the blockers, in a kernel of this test's own: the same V as the twin.

mod support;

use bytemuck::Zeroable;
use glam::Vec3;
use halflight::{
    model::blocker::{BlockerSphere, Rung},
    visibility::blockers::{BlockerTerms, Blockers},
};
use std::path::Path;

const KERNEL: &str = "
@group(0) @binding(0) var<uniform> blockers: BlockerTerms;
@group(0) @binding(1) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> results: array<f32>;

@compute @workgroup_size(64)
fn each(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&points) {
        return;
    }
    let point = points[id.x].xyz;
    var hidden = blocker_blocked(point, vec3<f32>(0.0, 0.0, 1.0), 2u);
    for (var i = 0u; i < 16u; i += 1u) {
        results[16u * id.x + i] = hidden[i];
    }
}
";

fn wgsl() -> String {
    let read = |name: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders/shared").join(name);
        std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
    };
    read("sh_basis.wgsl") + &read("blockers.wgsl") + KERNEL
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

/// Runs the kernel on any adapter; `None` where there is none.
fn on_gpu(all: &[BlockerTerms], points: &[Vec3]) -> Option<Vec<Vec<f32>>> {
    use wgpu::util::DeviceExt;
    let instance = wgpu::Instance::default();
    let adapter =
        pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).ok()?;
    println!("on {}", adapter.get_info().name);
    let (device, queue) =
        pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).ok()?;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(wgsl().into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("each"),
        compilation_options: Default::default(),
        cache: None,
    });
    let buffer = |contents: &[u8], usage| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    };
    let places: Vec<[f32; 4]> = points.iter().map(|p| p.extend(0.0).to_array()).collect();
    let places = buffer(bytemuck::cast_slice(&places), wgpu::BufferUsages::STORAGE);
    let size = 16 * points.len() as u64 * 4;
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let out =
        device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
    let mut results = Vec::new();
    for terms in all {
        let read = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage,
            mapped_at_creation: false,
        });
        let uniform = buffer(bytemuck::bytes_of(terms), wgpu::BufferUsages::UNIFORM);
        let entry = |binding, buffer: &wgpu::Buffer| (binding, buffer.clone());
        let buffers = [entry(0, &uniform), entry(1, &places), entry(2, &out)];
        let entries: Vec<_> = buffers
            .iter()
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding: *binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
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

#[test]
fn the_shader_gives_what_the_twin_gives() {
    let points: Vec<Vec3> = (0..400)
        .map(|i| Vec3::new((i % 20) as f32 * 0.1 - 0.95, (i / 20) as f32 * 0.1 - 0.95, 0.0))
        .collect();
    let mut cases = Vec::new();
    for rung in Rung::ALL.into_iter().filter(|rung| *rung != Rung::Directions) {
        for order in 2..=4 {
            let mut blockers = Blockers::new();
            blockers.prepare(&spheres(), rung, order, 64);
            assert!(blockers.fit_shader());
            let mut terms = BlockerTerms::zeroed();
            blockers.shader_terms(&mut terms);
            cases.push((rung, order, blockers, terms));
        }
    }
    let all: Vec<BlockerTerms> = cases.iter().map(|case| case.3).collect();
    let Some(results) = on_gpu(&all, &points) else {
        return support::skip_gpu("the_shader_gives_what_the_twin_gives", "no adapter");
    };
    let whole = (4.0 * std::f32::consts::PI).sqrt();
    for ((rung, order, blockers, _), results) in cases.iter().zip(results) {
        let (mut worst, mut most_hidden) = (0.0f32, 0.0f32);
        for (point, hidden) in points.iter().zip(results.chunks(16)) {
            let mut v = [0.0; 36];
            blockers.visibility(*point, Vec3::Z, Some(2), &mut v);
            most_hidden = most_hidden.max(whole - v[0]);
            worst = worst.max((whole - v[0] - hidden[0]).abs());
            worst = v[1..]
                .iter()
                .zip(&hidden[1..])
                .fold(worst, |worst, (v, hidden)| worst.max((v + hidden).abs()));
        }
        println!("{} order {order}: within {worst:.1e}, up to {most_hidden:.1} hidden", rung.name());
        assert!(most_hidden > 1.0, "{} order {order}: {most_hidden}", rung.name());
        // Measured: 7e-6 for `squared`, whose squarings double what the last digits differ by; `dc` none.
        assert!(worst < 2e-5, "{} order {order}: {worst:e}", rung.name());
    }
}
