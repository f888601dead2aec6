//! Ratios in one run on one machine: `cargo bench --bench ratios`. A list of modules and nothing else.

mod blockers;
mod frame;
mod growth;
mod merge_bracket;
mod opencv;
mod project_sh;

/// All of them, or the one that is named: `cargo bench --bench ratios -- blockers`.
fn main() {
    let parts: [(&str, fn()); 5] = [
        ("merge_bracket", merge_bracket::run),
        ("project_sh", project_sh::run),
        ("blockers", blockers::run),
        ("growth", growth::run),
        ("frame", frame::run),
    ];
    let named = std::env::args().nth(1).filter(|name| parts.iter().any(|(part, _)| part == name));
    for (_, run) in parts.iter().filter(|(part, _)| named.as_deref().is_none_or(|name| name == *part)) {
        run();
    }
}
