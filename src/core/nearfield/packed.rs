//! Transfers in 16 bits each: numbers within [0, 1], and all sources' rows of them in blocks of vertices.

use crate::{math::widest::widest, model::keep::as_bytes};
use serde::{Deserialize, Serialize};

/// Vertices of a block.
pub const BLOCK: usize = 32;
/// Exponents from 2^-30 on have a code of their own.
const EXPONENT: u32 = 96;
const SCALE: f32 = f32::from_bits((127 + EXPONENT) << 23);

/// A number within [0, 1] in 16 bits: 5 of exponent and 11 of mantissa, rounded to nearest: wrong by at most 2^-12 of
/// itself (1 in 4096). Below 2^-30, and where it is not a number, 0; above 1.999, the largest there is.
pub fn pack(number: f32) -> u16 {
    let bits = number.to_bits();
    if !(number >= f32::from_bits((EXPONENT + 1) << 23)) {
        return 0;
    }
    ((bits - (EXPONENT << 23) + (1 << 11)) >> 12).min(u32::from(u16::MAX)) as u16
}

/// The number again, exactly as it was rounded.
#[inline(always)]
pub fn unpack(code: u16) -> f32 {
    f32::from_bits(u32::from(code) << 12) * SCALE
}

/// T = F V of every source at every vertex: for each source the blocks of consecutive vertices at any of which it is
/// not zero.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Transfers {
    /// Words of the bits of one source.
    words: usize,
    /// For each source a bit for each block.
    bits: Vec<u64>,
    /// For each source its first block in `values`.
    first: Vec<u32>,
    #[serde(with = "as_bytes")]
    values: Vec<[u16; BLOCK]>,
}

/// One source's blocks, before they are put together.
pub struct PackedRow {
    bits: Vec<u64>,
    values: Vec<[u16; BLOCK]>,
}

impl PackedRow {
    /// From the value at every vertex.
    pub fn from_dense(dense: &[f32]) -> Self {
        let mut bits = vec![0u64; words(dense.len())];
        let mut values = Vec::new();
        for (block, numbers) in dense.chunks(BLOCK).enumerate() {
            let mut codes = [0u16; BLOCK];
            codes.iter_mut().zip(numbers).for_each(|(code, number)| *code = pack(*number));
            if codes != [0; BLOCK] {
                bits[block / 64] |= 1 << (block % 64);
                values.push(codes);
            }
        }
        Self { bits, values }
    }
}

fn words(vertices: usize) -> usize {
    vertices.div_ceil(BLOCK).div_ceil(64)
}

/// Room for sums over vertices in whole blocks, plane by plane (colours, or what else is summed), and which blocks are asked
/// for.
#[derive(Clone, Debug)]
pub struct BlockSums<const P: usize = 3> {
    wanted: Vec<u64>,
    planes: [Vec<f32>; P],
}

impl<const P: usize> Default for BlockSums<P> {
    fn default() -> Self {
        Self { wanted: Vec::new(), planes: [const { Vec::new() }; P] }
    }
}

impl<const P: usize> BlockSums<P> {
    /// Asks for the blocks of these vertices, of so many.
    pub fn want(&mut self, vertices: &[u32], count: usize) {
        self.wanted.clear();
        self.wanted.resize(words(count), 0);
        for &vertex in vertices {
            let block = vertex as usize / BLOCK;
            self.wanted[block / 64] |= 1 << (block % 64);
        }
        for plane in &mut self.planes {
            plane.clear();
            plane.resize(count.div_ceil(BLOCK) * BLOCK, 0.0);
        }
    }

    /// Writes the sums to a list with an entry for every vertex, and begins anew.
    pub fn take(&mut self, out: &mut [[f32; P]]) {
        for (k, plane) in self.planes.iter_mut().enumerate() {
            for (out, sum) in out.iter_mut().zip(&*plane) {
                out[k] = *sum;
            }
            plane.fill(0.0);
        }
    }
}

impl Transfers {
    /// Of rows with an equal number of vertices each.
    pub fn of(rows: &[PackedRow]) -> Self {
        let blocks = rows.iter().map(|r| r.values.len()).sum();
        let mut out = Self { words: rows.first().map_or(0, |r| r.bits.len()), ..Self::default() };
        out.values.reserve_exact(blocks);
        for row in rows {
            out.first.push(out.values.len() as u32);
            out.bits.extend_from_slice(&row.bits);
            out.values.extend_from_slice(&row.values);
        }
        out
    }

    /// Whether its parts fit together, for so many sources and vertices: what was read from a file may be anything.
    pub fn is_sound(&self, sources: usize, vertices: usize) -> bool {
        let (words, blocks) = (if sources == 0 { 0 } else { words(vertices) }, vertices.div_ceil(BLOCK));
        if self.words != words
            || self.first.len() != sources
            || Some(self.bits.len()) != sources.checked_mul(words)
        {
            return false;
        }
        let mut begin = 0u32;
        for (row, first) in self.bits.chunks(words.max(1)).zip(&self.first) {
            let beyond =
                row.last().is_some_and(|last| !blocks.is_multiple_of(64) && last >> (blocks % 64) != 0);
            let held: u32 = row.iter().map(|word| word.count_ones()).sum();
            match begin.checked_add(held) {
                Some(next) if *first == begin && !beyond => begin = next,
                _ => return false,
            }
        }
        begin as usize == self.values.len()
    }

    /// First vertex and values of each block of a source, in order; the last block's may reach past the last vertex.
    pub fn blocks(&self, source: usize) -> impl Iterator<Item = (usize, &[u16; BLOCK])> {
        let bits = &self.bits[source * self.words..(source + 1) * self.words];
        let held = bits.iter().enumerate().flat_map(|(word, &bits)| {
            let mut left = bits;
            std::iter::from_fn(move || {
                let bit = left.trailing_zeros() as usize;
                left &= left.wrapping_sub(1);
                (bit < 64).then_some((word * 64 + bit) * BLOCK)
            })
        });
        held.zip(&self.values[self.first[source] as usize..])
    }

    /// One block of a source, where it has it.
    pub fn block(&self, source: usize, block: usize) -> Option<&[u16; BLOCK]> {
        let bits = self.bits.get(source * self.words..(source + 1) * self.words)?;
        let word = *bits.get(block / 64)?;
        if word >> (block % 64) & 1 == 0 {
            return None;
        }
        let before: u32 = bits[..block / 64].iter().map(|w| w.count_ones()).sum();
        let within = (word & ((1 << (block % 64)) - 1)).count_ones();
        self.values.get((self.first[source] + before + within) as usize)
    }

    /// The value of a source at a vertex.
    pub fn at(&self, source: usize, vertex: usize) -> f32 {
        self.block(source, vertex / BLOCK).map_or(0.0, |codes| unpack(codes[vertex % BLOCK]))
    }

    /// A source's row, with an entry for every vertex.
    pub fn dense(&self, source: usize, out: &mut [f32]) {
        out.fill(0.0);
        for (first, codes) in self.blocks(source) {
            for (slot, code) in out[first..].iter_mut().zip(codes) {
                *slot = unpack(*code);
            }
        }
    }

    /// Adds the wanted blocks of some sources, each times its factor in every plane.
    pub fn add_to<const P: usize>(
        &self,
        sources: impl Iterator<Item = (usize, [f32; P])>,
        sums: &mut BlockSums<P>,
    ) {
        let BlockSums { wanted, planes } = sums;
        widest(|| {
            for (source, factors) in sources {
                let mut at = self.first[source] as usize;
                for (word, &held) in
                    self.bits[source * self.words..(source + 1) * self.words].iter().enumerate()
                {
                    let wanted = wanted.get(word).copied().unwrap_or(0);
                    let mut left = held;
                    while left != 0 {
                        let bit = left.trailing_zeros() as usize;
                        left &= left - 1;
                        let codes = &self.values[at];
                        at += 1;
                        if wanted >> bit & 1 == 0 {
                            continue;
                        }
                        let begin = (word * 64 + bit) * BLOCK;
                        for (plane, c) in planes.iter_mut().zip(factors) {
                            let Some(sums) = plane.get_mut(begin..begin + BLOCK) else { continue };
                            for (sum, code) in sums.iter_mut().zip(codes) {
                                *sum += c * unpack(*code);
                            }
                        }
                    }
                }
            }
        });
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.bits) + size_of_val(&*self.first) + size_of_val(&*self.values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_come_back() {
        assert_eq!([0.0, 0.5, 1.0, 0.75].map(|n| unpack(pack(n))), [0.0, 0.5, 1.0, 0.75]);
        assert_eq!([f32::NAN, -1.0, 1e-12, -0.0].map(pack), [0; 4]);
        assert!([1.9999, 2.0, f32::INFINITY].iter().all(|n| unpack(pack(*n)) > 1.99));
    }

    proptest! {
        #[test]
        fn wrong_by_at_most_one_in_4096(exponent in -23.0f32..0.0) {
            let number = exponent.exp2();
            prop_assert!((unpack(pack(number)) / number - 1.0).abs() <= 1.0 / 4096.0);
        }

        #[test]
        fn rows_give_back_what_they_were_made_of(
            rows in (1usize..3000).prop_flat_map(|n| prop::collection::vec(
                prop::collection::vec((0usize..n, 0.01f32..1.0), 0..60).prop_map(move |set| {
                    let mut dense = vec![0.0f32; n];
                    set.into_iter().for_each(|(i, value)| dense[i] = value);
                    dense
                }), 1..4)),
        ) {
            let count = rows[0].len();
            let packed: Vec<PackedRow> = rows.iter().map(|r| PackedRow::from_dense(r)).collect();
            let all = Transfers::of(&packed);
            let mut sums = BlockSums::default();
            let every: Vec<u32> = (0..count as u32).collect();
            let (mut dense, mut out) = (vec![1.0; count], vec![[9.0; 3]; count]);
            prop_assert!(all.is_sound(rows.len(), count));
            prop_assert!(!all.is_sound(rows.len(), count + 64 * BLOCK) && !all.is_sound(rows.len() + 1, count));
            for (source, row) in rows.iter().enumerate() {
                all.dense(source, &mut dense);
                for (i, value) in row.iter().enumerate() {
                    prop_assert_eq!(all.at(source, i), unpack(pack(*value)));
                    prop_assert_eq!(dense[i], all.at(source, i));
                }
            }
            prop_assert_eq!(all.at(0, count + 3), 0.0);
            sums.want(&every, count);
            all.add_to((0..rows.len()).map(|s| (s, [1.0, 2.0, 0.0])), &mut sums);
            sums.take(&mut out);
            for (i, got) in out.iter().enumerate() {
                let want: f32 = (0..rows.len()).map(|s| all.at(s, i)).sum();
                prop_assert!((got[0] - want).abs() <= 1e-6 && got[1] == 2.0 * got[0] && got[2] == 0.0);
            }
            // Blocks that nobody asked for stay empty, and nothing is left from before.
            sums.want(&every[..1], count);
            all.add_to((0..rows.len()).map(|s| (s, [1.0; 3])), &mut sums);
            sums.take(&mut out);
            prop_assert!(out.iter().skip(BLOCK).all(|c| *c == [0.0; 3]));
        }
    }

    #[test]
    fn parts_that_do_not_fit_are_refused() {
        let all = Transfers::of(&[PackedRow::from_dense(&[0.5; 70]), PackedRow::from_dense(&[0.0; 70])]);
        assert_eq!((&all.bits[..], &all.first[..], all.values.len()), (&[0b111, 0][..], &[0, 3][..], 3));
        let is_sound = |change: &dyn Fn(&mut Transfers)| {
            let mut changed = all.clone();
            change(&mut changed);
            changed.is_sound(2, 70)
        };
        assert!(is_sound(&|_| ()));
        assert!(!is_sound(&|t| t.values.truncate(2)) && !is_sound(&|t| t.first[1] = 2));
        assert!(!is_sound(&|t| t.bits.truncate(1)) && !is_sound(&|t| t.bits[0] = 0b1110));
        assert!(!is_sound(&|t| t.words = 0) && Transfers::default().is_sound(0, 70));
    }

    #[test]
    fn blocks_of_zeros_are_not_stored() {
        let mut dense = vec![0.0; 10_000];
        dense[10..20].fill(0.5);
        dense[5000] = 0.25;
        let all = Transfers::of(&[PackedRow::from_dense(&dense)]);
        assert_eq!(all.blocks(0).map(|(first, _)| first).collect::<Vec<_>>(), [0, 4992]);
        assert_eq!(all.bytes(), 2 * 2 * BLOCK + 4 + 8 * 5);
        assert_eq!(Transfers::of(&[]).bytes(), 0);
    }
}
