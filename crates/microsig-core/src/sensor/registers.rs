//! Lookup of 16 words at a time in a table of 256 words held in AVX-512 registers.
//!
//! Gathers from memory take as long as single loads; a permutation of two registers looks up 16 words among
//! 32 at once.

use std::arch::x86_64::__m512i;
use std::array::from_fn;

use pulp::cast;
use pulp::x86::V4;

/// Number of entries of a table.
pub(super) const ENTRIES: usize = 256;

/// 32-bit words per register.
const LANES: usize = 16;

/// Samples of [`super::RoundedNormal`].
pub(super) struct Samples<'a> {
    pub(super) simd: V4,
    pub(super) lowest: i32,
    /// Number of leading bits of a random word, at most 8, that select a column.
    pub(super) bits: u32,
    pub(super) columns: &'a [u32; ENTRIES],
    pub(super) random: &'a [[u32; LANES]],
    pub(super) values: &'a mut [[i32; LANES]],
}

impl pulp::NullaryFnOnce for Samples<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let f = self.simd.avx512f;
        let all = |word: u32| -> __m512i { cast([word; LANES]) };
        let (registers, _) = self.columns.as_chunks::<LANES>();
        let table: [__m512i; ENTRIES / LANES] = from_fn(|k| cast(registers[k]));
        let (bits, others, lowest) = (all(self.bits), all(32 - self.bits), all(self.lowest as u32));
        for (values, random) in self.values.iter_mut().zip(self.random) {
            let random: __m512i = cast(*random);
            let number = f._mm512_srlv_epi32(random, others);
            let bit = |bit: u32| f._mm512_test_epi32_mask(number, all(1 << bit));
            // The five lowest bits of a column number select a word from a pair of registers; each further
            // bit halves the number of pairs.
            let find =
                |pair: usize| f._mm512_permutex2var_epi32(table[2 * pair], number, table[2 * pair + 1]);
            let of32: [__m512i; 4] = from_fn(find);
            let of64: [__m512i; 2] =
                from_fn(|k| f._mm512_mask_blend_epi32(bit(5), of32[2 * k], of32[2 * k + 1]));
            let mut column = f._mm512_mask_blend_epi32(bit(6), of64[0], of64[1]);
            if self.bits > 7 {
                let of32: [__m512i; 4] = from_fn(|k| find(4 + k));
                let of64: [__m512i; 2] =
                    from_fn(|k| f._mm512_mask_blend_epi32(bit(5), of32[2 * k], of32[2 * k + 1]));
                let others = f._mm512_mask_blend_epi32(bit(6), of64[0], of64[1]);
                column = f._mm512_mask_blend_epi32(bit(7), column, others);
            }
            let share = |word| f._mm512_sllv_epi32(word, bits);
            let stays = f._mm512_cmplt_epu32_mask(share(random), share(column));
            let decided = f._mm512_mask_blend_epi32(stays, column, random);
            *values = cast(f._mm512_add_epi32(f._mm512_srlv_epi32(decided, others), lowest));
        }
    }
}
