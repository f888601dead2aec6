//! Every shader, without a GPU: parses, is valid, has its twin, and agrees with the table of kernels and with
//! Rust's layouts.

use std::{collections::BTreeSet, path::Path};

use halflight::{
    engine::gpu::{
        TABLE,
        context::{STORAGE_BUFFERS_PER_STAGE, WORKGROUP_INVOCATIONS, WORKGROUP_MEMORY_BYTES},
        kernel::{BindingKind, KernelRow},
    },
    plan::Pass,
};
use naga::{AddressSpace, ImageClass, ImageDimension, ScalarKind, ShaderStage, StorageAccess, TypeInner};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn parse(kernel: &KernelRow) -> naga::Module {
    let text = kernel.wgsl();
    naga::front::wgsl::parse_str(&text)
        .unwrap_or_else(|error| panic!("{}:\n{}", kernel.pass.name(), error.emit_to_string(&text)))
}

fn validate(kernel: &KernelRow, module: &naga::Module) -> naga::valid::ModuleInfo {
    let mut validator =
        naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty());
    validator
        .validate(module)
        .unwrap_or_else(|error| panic!("{}:\n{}", kernel.pass.name(), error.emit_to_string(&kernel.wgsl())))
}

#[test]
fn every_shader_parses_and_is_valid() {
    for kernel in TABLE {
        validate(kernel, &parse(kernel));
    }
}

#[test]
fn every_pass_has_a_row_a_twin_and_a_shader() {
    let rows: Vec<_> = TABLE.iter().map(|kernel| kernel.pass).collect();
    assert_eq!(rows, Pass::ALL, "the table has one row for each pass, in the order of the passes");
    for kernel in TABLE {
        let name = kernel.pass.name();
        let shader = format!("shaders/{name}.wgsl");
        let own = kernel.sources.last().expect("a kernel has sources");
        assert_eq!(own.path, shader, "{name}: its own file comes last");
        let twin = format!("src/core/{name}.rs");
        assert!(root().join(&twin).is_file(), "{name}: no twin at {twin}");
        let text = std::fs::read_to_string(root().join(&twin)).expect("readable");
        assert!(text.contains(&shader), "{twin} does not name its shader {shader}");
        assert!(own.text.contains(&twin), "{shader} does not name its twin {twin}");
    }
}

/// The kernel that was added last.
const NEWEST: Pass = Pass::SubtractDisplayed;

/// Paths from the root of all Rust and WGSL files below a folder, with their text; files of unit tests are left out.
fn files_below(folder: &Path, found: &mut Vec<(String, String)>) {
    for entry in std::fs::read_dir(folder).expect("readable").flatten() {
        let path = entry.path();
        let name = path.strip_prefix(root()).expect("inside").to_string_lossy().into_owned();
        if path.is_dir() {
            files_below(&path, found);
        } else if (name.ends_with(".rs") || name.ends_with(".wgsl")) && !name.ends_with("tests.rs") {
            found.push((name, std::fs::read_to_string(&path).expect("readable")));
        }
    }
}

/// Files that name a kernel, by its stem or its variant. A line that only declares its module does not count.
fn places_of(kernel: Pass, files: &[(String, String)]) -> BTreeSet<String> {
    let (stem, variant) = (kernel.name().rsplit('/').next().expect("a name"), format!("{kernel:?}"));
    let is_module = |line: &str| line.trim().trim_start_matches("pub ") == format!("mod {stem};");
    let names_it = |(_, text): &&(String, String)| {
        text.lines().any(|line| !is_module(line) && (line.contains(stem) || line.contains(&variant)))
    };
    files.iter().filter(names_it).map(|(path, _)| path.clone()).collect()
}

#[test]
fn a_new_kernel_touches_the_places_that_the_map_names() {
    let map = std::fs::read_to_string(root().join("src/README.md")).expect("readable");
    let row = map.lines().find(|line| line.starts_with("| a kernel |")).expect("a row for kernels");
    let (room, name) = NEWEST.name().split_once('/').expect("a room and a name");
    let named: BTreeSet<_> = row
        .split('`')
        .filter(|word| word.starts_with("src/") || word.starts_with("shaders/"))
        .map(|word| word.replace("ROOM", room).replace("NAME", name))
        .collect();
    let mut files = Vec::new();
    files_below(&root().join("src"), &mut files);
    files_below(&root().join("shaders"), &mut files);
    assert_eq!(places_of(NEWEST, &files), named, "files that name {NEWEST:?}, and those of the map");
    assert!(named.len() <= 6, "{named:?}");
    // The count sees a place more.
    files.push(("src/engine/more.rs".into(), "match pass { Pass::SubtractDisplayed => {} }".into()));
    assert_eq!(places_of(NEWEST, &files).len(), named.len() + 1);
    files.push(("src/engine/less.rs".into(), "    pub mod subtract_displayed;".into()));
    assert_eq!(places_of(NEWEST, &files).len(), named.len() + 1, "a module's declaration is no place");
}

#[test]
fn every_file_in_shaders_is_in_the_table() {
    let built_in: BTreeSet<_> =
        TABLE.iter().flat_map(|kernel| kernel.sources).map(|source| source.path.to_owned()).collect();
    let mut on_disk = BTreeSet::new();
    for folder in std::fs::read_dir(root().join("shaders")).expect("readable").flatten() {
        if !folder.path().is_dir() {
            continue;
        }
        for file in std::fs::read_dir(folder.path()).expect("readable").flatten() {
            let path = file.path();
            let relative = path.strip_prefix(root()).expect("inside").to_string_lossy().into_owned();
            assert!(relative.ends_with(".wgsl"), "{relative}: only shaders live here");
            on_disk.insert(relative);
        }
    }
    assert_eq!(built_in, on_disk);
}

#[test]
fn shared_files_hold_functions_only() {
    for source in TABLE.iter().flat_map(|kernel| kernel.sources) {
        if source.path.starts_with("shaders/shared/") {
            assert!(!source.text.contains("@group"), "{}: bindings belong to kernels", source.path);
            assert!(
                !source.text.contains("@workgroup_size"),
                "{}: entry points belong to kernels",
                source.path
            );
        }
    }
}

#[test]
fn entry_points_are_those_of_the_table() {
    for kernel in TABLE {
        let module = parse(kernel);
        let entries: BTreeSet<_> = module.entry_points.iter().map(|entry| entry.name.as_str()).collect();
        assert_eq!(entries, kernel.entries.iter().copied().collect(), "{}", kernel.pass.name());
        let draws = module.entry_points.iter().any(|entry| entry.stage != ShaderStage::Compute);
        assert_eq!(draws, kernel.pass.draws_triangles(), "{}", kernel.pass.name());
    }
}

#[test]
fn bindings_are_those_of_the_table() {
    for kernel in TABLE {
        let name = kernel.pass.name();
        let module = parse(kernel);
        let mut found: Vec<_> = module
            .global_variables
            .iter()
            .filter_map(|(_, variable)| Some((variable.binding?, variable)))
            .map(|(binding, variable)| {
                assert_eq!(binding.group, 0, "{name}: one bind group");
                (binding.binding, variable.name.clone().unwrap_or_default(), kind(&module, variable))
            })
            .collect();
        found.sort_by_key(|row| row.0);
        let expected: Vec<_> = kernel
            .bindings
            .iter()
            .enumerate()
            .map(|(number, binding)| {
                let kind = match binding.kind {
                    BindingKind::UniformAtOffset => BindingKind::Uniform,
                    other => other,
                };
                (number as u32, binding.name.to_owned(), kind)
            })
            .collect();
        assert_eq!(found, expected, "{name}");
    }
}

fn kind(module: &naga::Module, variable: &naga::GlobalVariable) -> BindingKind {
    match (variable.space, &module.types[variable.ty].inner) {
        (AddressSpace::Uniform, _) => BindingKind::Uniform,
        (AddressSpace::Storage { access }, _) if access.contains(StorageAccess::STORE) => BindingKind::Write,
        (AddressSpace::Storage { .. }, _) => BindingKind::Read,
        (_, TypeInner::Image { dim: ImageDimension::D2, arrayed: false, class }) => match class {
            ImageClass::Sampled { kind: ScalarKind::Float, multi: false } => BindingKind::Floats,
            ImageClass::Sampled { kind: ScalarKind::Uint, multi: false } => BindingKind::Uints,
            other => panic!("{:?}: no binding kind for {other:?}", variable.name),
        },
        (_, TypeInner::Image { dim: ImageDimension::D2, arrayed: true, class }) => match class {
            ImageClass::Sampled { kind: ScalarKind::Uint, multi: false } => BindingKind::UintLayers,
            other => panic!("{:?}: no binding kind for {other:?}", variable.name),
        },
        other => panic!("{:?}: no binding kind for {other:?}", variable.name),
    }
}

#[test]
fn small_gpus_can_bind_what_a_stage_uses() {
    for kernel in TABLE {
        let name = kernel.pass.name();
        let module = parse(kernel);
        let info = validate(kernel, &module);
        for (number, entry) in module.entry_points.iter().enumerate() {
            let used = info.get_entry_point(number);
            let mut storage = 0;
            let mut workgroup_bytes = 0;
            for (handle, variable) in module.global_variables.iter() {
                if used[handle].is_empty() {
                    continue;
                }
                match variable.space {
                    AddressSpace::Storage { .. } => storage += 1,
                    AddressSpace::WorkGroup => {
                        workgroup_bytes += module.types[variable.ty].inner.size(module.to_ctx());
                    }
                    _ => {}
                }
            }
            let most = if entry.stage == ShaderStage::Vertex { 0 } else { STORAGE_BUFFERS_PER_STAGE };
            assert!(storage <= most, "{name}, {}: {storage} storage buffers, {most} allowed", entry.name);
            assert!(
                workgroup_bytes <= WORKGROUP_MEMORY_BYTES,
                "{name}, {}: {workgroup_bytes} bytes of workgroup memory",
                entry.name
            );
            let invocations: u32 = entry.workgroup_size.iter().product();
            assert!(
                invocations <= WORKGROUP_INVOCATIONS,
                "{name}, {}: {invocations} invocations",
                entry.name
            );
        }
        // The whole group is bound for every entry point, so it counts as a whole too.
        let all = kernel.bindings.iter().filter(|b| matches!(b.kind, BindingKind::Read | BindingKind::Write));
        assert!(all.count() <= STORAGE_BUFFERS_PER_STAGE as usize, "{name}");
    }
}

#[test]
fn struct_layouts_are_those_of_rust() {
    for kernel in TABLE {
        let module = parse(kernel);
        for layout in kernel.structs {
            let place = format!("{}, struct {}", kernel.pass.name(), layout.name);
            let (_, found) = module
                .types
                .iter()
                .find(|(_, ty)| ty.name.as_deref() == Some(layout.name))
                .unwrap_or_else(|| panic!("{place}: not in the shader"));
            let TypeInner::Struct { members, span } = &found.inner else {
                panic!("{place}: not a struct");
            };
            let wgsl: Vec<_> = members
                .iter()
                .map(|member| {
                    (
                        member.name.clone().unwrap_or_default(),
                        member.offset as usize,
                        module.types[member.ty].inner.size(module.to_ctx()) as usize,
                    )
                })
                .collect();
            let rust: Vec<_> = layout.members.iter().map(|m| (m.name.to_owned(), m.offset, m.size)).collect();
            assert_eq!(wgsl, rust, "{place}: name, offset and size of each member");
            assert_eq!(*span as usize, layout.size, "{place}: size");
        }
        // Every uniform is a struct with a layout here.
        for (_, variable) in module.global_variables.iter() {
            if variable.space == AddressSpace::Uniform {
                let name = module.types[variable.ty].name.clone().unwrap_or_default();
                assert!(
                    kernel.structs.iter().any(|layout| layout.name == name),
                    "{}: uniform struct {name:?} has no layout in the table",
                    kernel.pass.name()
                );
            }
        }
    }
}
