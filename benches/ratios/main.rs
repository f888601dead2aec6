//! Ratios in one run on one machine: `cargo bench --bench ratios`. A list of modules and nothing else.

mod blockers;
mod frame;
mod growth;
mod merge_bracket;
mod nearfield;
mod opencv;
mod project_sh;

fn main() {
    merge_bracket::run();
    project_sh::run();
    blockers::run();
    growth::run();
    nearfield::run();
    frame::run();
}
