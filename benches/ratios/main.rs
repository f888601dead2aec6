//! Ratios in one run on one machine: `cargo bench --bench ratios`, or `-- NAME` for one module of the list.

mod blockers;
mod conversions;
mod delivery;
mod effects;
mod frame;
mod growth;
mod merge_bracket;
mod naive;
mod nearfield;
mod opencv;
mod project_sh;
mod room;
mod tags;
mod timing;
mod trace;

fn main() {
    let all: [(&str, fn()); 13] = [
        ("conversions", conversions::run),
        ("merge_bracket", merge_bracket::run),
        ("project_sh", project_sh::run),
        ("blockers", blockers::run),
        ("growth", growth::run),
        ("naive", naive::run),
        ("nearfield", nearfield::run),
        ("room", room::run),
        ("effects", effects::run),
        ("trace", trace::run),
        ("frame", frame::run),
        ("delivery", delivery::run),
        ("tags", tags::run),
    ];
    // Cargo itself adds `--bench`.
    let only = std::env::args().skip(1).find(|argument| !argument.starts_with('-'));
    for (_, run) in all.iter().filter(|(name, _)| only.as_ref().is_none_or(|only| only == name)) {
        run();
    }
}
