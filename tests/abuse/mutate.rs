//! Makes damaged inputs of sound ones, by seed.

use halflight::math::dice::Dice;

/// Numbers that parsers fall over, as text.
const NUMBERS: [&str; 22] = [
    "0",
    "-0.0",
    "-1",
    "1",
    "255",
    "65536",
    "2147483648",
    "4294967295",
    "4294967296",
    "18446744073709551615",
    "-9223372036854775808",
    "1e38",
    "1e39",
    "1e300",
    "1e308",
    "1e309",
    "-1e308",
    "5e-324",
    "nan",
    "inf",
    "99999999999999999999999999",
    "0.1",
];
/// Pieces of text that mean something to one format or another.
const PIECES: [&str; 14] = [
    "[[",
    "]]",
    "{",
    "}",
    "\"",
    "'",
    "\n",
    "&a *a",
    "<<: *a",
    ",,",
    "\0",
    "\u{feff}",
    "../../../etc/passwd",
    "#",
];
/// Four bytes that lengths and offsets are set to.
const WORDS: [u32; 8] = [0, 1, 0xff, 0xffff, 0x7fff_ffff, 0x8000_0000, 0xffff_fffe, 0xffff_ffff];
/// The most bytes in an input: a little under a megabyte.
const MOST: usize = 1_000_000;

fn below(dice: &mut Dice, count: usize) -> usize {
    (dice.bits() % count.max(1) as u64) as usize
}

/// One to four changes to a sound input; `other` is spliced in now and then.
pub fn mutated(sound: &[u8], other: &[u8], is_text: bool, dice: &mut Dice) -> Vec<u8> {
    let mut bytes = sound.to_vec();
    for _ in 0..1 + below(dice, 4) {
        let kinds = if is_text { 9 } else { 7 };
        match below(dice, kinds) {
            0 => flip(&mut bytes, dice),
            1 => bytes.truncate(below(dice, sound.len() + 1)),
            2 => word(&mut bytes, dice),
            3 => repeat(&mut bytes, dice),
            4 => cut_out(&mut bytes, dice),
            5 => splice(&mut bytes, other, dice),
            6 => noise(&mut bytes, dice),
            7 => number(&mut bytes, dice),
            _ => piece(&mut bytes, dice),
        }
    }
    bytes.truncate(MOST);
    bytes
}

fn flip(bytes: &mut [u8], dice: &mut Dice) {
    let at = below(dice, bytes.len());
    if let Some(byte) = bytes.get_mut(at) {
        *byte ^= 1 << below(dice, 8);
    }
}

/// Most headers are short: half of the changes go there.
fn place(length: usize, dice: &mut Dice) -> usize {
    let within = if dice.unit() < 0.5 { length.min(256) } else { length };
    below(dice, within)
}

fn word(bytes: &mut [u8], dice: &mut Dice) {
    let at = place(bytes.len(), dice);
    let word = WORDS[below(dice, WORDS.len())];
    let word = if dice.unit() < 0.5 { word.to_le_bytes() } else { word.to_be_bytes() };
    for (byte, new) in bytes.iter_mut().skip(at).zip(word) {
        *byte = new;
    }
}

fn range(length: usize, most: usize, dice: &mut Dice) -> std::ops::Range<usize> {
    let from = place(length, dice);
    from..(from + below(dice, most)).min(length)
}

fn repeat(bytes: &mut Vec<u8>, dice: &mut Dice) {
    let part = bytes[range(bytes.len(), 64, dice)].to_vec();
    let at = below(dice, bytes.len() + 1);
    for _ in 0..1 + below(dice, 40) {
        bytes.splice(at..at, part.iter().copied());
    }
}

fn cut_out(bytes: &mut Vec<u8>, dice: &mut Dice) {
    let part = range(bytes.len(), 200, dice);
    bytes.drain(part);
}

fn splice(bytes: &mut Vec<u8>, other: &[u8], dice: &mut Dice) {
    let part = &other[range(other.len(), 500, dice)];
    let at = below(dice, bytes.len() + 1);
    bytes.splice(at..at, part.iter().copied());
}

fn noise(bytes: &mut [u8], dice: &mut Dice) {
    let part = range(bytes.len(), 16, dice);
    for byte in &mut bytes[part] {
        *byte = dice.bits() as u8;
    }
}

/// Puts another number in the place of one.
fn number(bytes: &mut Vec<u8>, dice: &mut Dice) {
    let is_part = |byte: u8| byte.is_ascii_digit() || byte == b'.';
    let starts: Vec<usize> =
        (0..bytes.len()).filter(|&k| is_part(bytes[k]) && (k == 0 || !is_part(bytes[k - 1]))).collect();
    if starts.is_empty() {
        return;
    }
    let from = starts[below(dice, starts.len())];
    let length = bytes[from..].iter().take_while(|byte| is_part(**byte)).count();
    bytes.splice(from..from + length, NUMBERS[below(dice, NUMBERS.len())].bytes());
}

fn piece(bytes: &mut Vec<u8>, dice: &mut Dice) {
    let at = below(dice, bytes.len() + 1);
    let piece = PIECES[below(dice, PIECES.len())];
    for _ in 0..1 + below(dice, 3) * below(dice, 200) {
        bytes.splice(at..at, piece.bytes());
    }
}
