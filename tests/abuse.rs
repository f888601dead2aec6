//! A mutational fuzzer of our own: damaged inputs of every format that comes from outside, by seed. No panic, no more than 512 MiB
//! and 2 s of processor time for any input below a megabyte. `HALFLIGHT_ABUSE=N` tries N inputs (20,000 otherwise), and
//! `HALFLIGHT_ABUSE_SEED=S` begins elsewhere; `make fuzz` goes on for long.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "abuse/corpus.rs"]
mod corpus;
#[path = "abuse/mutate.rs"]
mod mutate;
#[path = "support/bytes/sys.rs"]
mod sys;

use corpus::Format;
use halflight::math::dice::Dice;
use std::panic::{AssertUnwindSafe, catch_unwind};

const MOST_BYTES: isize = 512 << 20;
/// Hundredths of a second, as the system counts processor time.
const MOST_TICKS: u64 = 200;

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().map_or(default, |text| text.parse().unwrap())
}

/// Processor time of this program so far, in hundredths of a second.
fn ticks() -> u64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    // User and system time are the 14th and 15th field; the second, a name in parentheses, may hold spaces.
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    fields[11].parse::<u64>().unwrap() + fields[12].parse::<u64>().unwrap()
}

/// What came of one input.
struct Tried {
    is_refused: bool,
    /// What it does that it must not.
    fault: Option<String>,
}

fn try_one(format: &Format, input: &[u8]) -> Tried {
    sys::forget_peak();
    let (before, began) = (sys::live_bytes(), ticks());
    let read = catch_unwind(AssertUnwindSafe(|| (format.read)(input)));
    let (bytes, took) = (sys::peak_bytes() - before, ticks() - began);
    let fault = match &read {
        Err(_) => Some("it panics".into()),
        Ok(Err(said)) if said.is_empty() => Some("it is refused without a word".into()),
        Ok(_) if bytes > MOST_BYTES => Some(format!("it takes {} MiB", bytes >> 20)),
        Ok(_) if took > MOST_TICKS => Some(format!("it takes {took} hundredths of a second")),
        Ok(_) => None,
    };
    Tried { is_refused: matches!(read, Ok(Err(_))), fault }
}

#[test]
fn sound_inputs_are_read() {
    for format in corpus::formats() {
        for (k, sound) in format.sound.iter().enumerate() {
            let read = (format.read)(sound);
            // The case's file stands for its grammar only.
            assert!(read.is_ok() || format.name == "case", "{} {k}: {read:?}", format.name);
        }
    }
}

#[test]
fn damaged_inputs_are_refused_or_read_and_nothing_else() {
    let formats = corpus::formats();
    let all: Vec<&[u8]> = formats.iter().flat_map(|f| f.sound.iter().map(Vec::as_slice)).collect();
    let (tries, first) = (setting("HALFLIGHT_ABUSE", 20_000), setting("HALFLIGHT_ABUSE_SEED", 0));
    let (mut refused, mut faults) = (0, Vec::new());
    for seed in first..first + tries {
        let mut dice = Dice::new(seed);
        let mut choose = |count: usize| (dice.bits() % count as u64) as usize;
        let format = &formats[choose(formats.len())];
        let (sound, other) = (&format.sound[choose(format.sound.len())], all[choose(all.len())]);
        let input = mutate::mutated(sound, other, format.is_text, &mut dice);
        let tried = try_one(format, &input);
        refused += u64::from(tried.is_refused);
        if let Some(fault) = tried.fault {
            faults.push(format!("{} by seed {seed}: {fault}", format.name));
        }
    }
    println!("{tries} inputs, {refused} refused, {} faults", faults.len());
    // Damage is seen, and does not hide all else.
    assert!(refused > tries / 4 && refused < tries, "{refused} of {tries} are refused");
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
}
