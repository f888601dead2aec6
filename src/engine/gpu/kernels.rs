//! THE TABLE: one row a kernel. `tests/shaders.rs` checks every row without a GPU.

use super::{
    kernel::{Binding, BindingKind, Kernel, Source},
    params,
};
use crate::plan::Pass;

macro_rules! source {
    ($path:literal) => {
        Source {
            path: concat!("shaders/", $path, ".wgsl"),
            text: include_str!(concat!("../../../shaders/", $path, ".wgsl")),
        }
    };
}

/// `hdr/merge_bracket`: one invocation for four pixels (three words of packed bytes).
pub const MERGE_BRACKET: Kernel = Kernel {
    pass: Pass::MergeBracket,
    sources: &[source!("hdr/merge_bracket")],
    entries: &["merge"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("pictures", BindingKind::Read),
        Binding::new("tables", BindingKind::Read),
        Binding::new("radiance", BindingKind::Write),
        Binding::new("flags", BindingKind::Write),
    ],
    structs: &[params::MergeParams::LAYOUT],
};

/// `light/project_sh`: partial sums of 256 samples each, then one workgroup for each coefficient.
pub const PROJECT_SH: Kernel = Kernel {
    pass: Pass::ProjectSh,
    sources: &[source!("shared/sh_basis"), source!("light/project_sh")],
    entries: &["partial_sums", "total"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("directions", BindingKind::Read),
        Binding::new("radiance", BindingKind::Read),
        Binding::new("partials", BindingKind::Write),
        Binding::new("coefficients", BindingKind::Write),
    ],
    structs: &[params::ProjectParams::LAYOUT],
};

/// Every kernel, in the order of `Pass::ALL`.
pub const TABLE: [&Kernel; 2] = [&MERGE_BRACKET, &PROJECT_SH];
