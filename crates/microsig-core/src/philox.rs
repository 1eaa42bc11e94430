//! Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC'11).

/// Increments of the key from round to round.
const WEYL: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];

const MULTIPLIERS: [u32; 2] = [0xD251_1F53, 0xCD9E_8D57];

/// The key of every round.
#[inline(always)]
fn keys(key: [u32; 2]) -> [[u32; 2]; 10] {
    std::array::from_fn(|round| {
        let step = |half: usize| key[half].wrapping_add(WEYL[half].wrapping_mul(round as u32));
        [step(0), step(1)]
    })
}

#[inline(always)]
pub(crate) fn block(mut counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
    for key in keys(key) {
        let product0 = u64::from(MULTIPLIERS[0]) * u64::from(counter[0]);
        let product1 = u64::from(MULTIPLIERS[1]) * u64::from(counter[2]);
        counter = [
            (product1 >> 32) as u32 ^ counter[1] ^ key[0],
            product1 as u32,
            (product0 >> 32) as u32 ^ counter[3] ^ key[1],
            product0 as u32,
        ];
    }
    counter
}

pub(crate) fn fill(counter: [u32; 4], key: [u32; 2], blocks: &mut [[u32; 4]]) {
    let arch = pulp::Arch::new();
    #[cfg(target_arch = "x86_64")]
    if let pulp::Arch::V4(simd) = arch {
        let (groups, rest) = blocks.as_chunks_mut();
        simd.vectorize(avx512::Groups { simd, counter, key, groups });
        let [first, row, frame, purpose] = counter;
        let next = first.wrapping_add(groups.as_flattened().len() as u32);
        return arch.dispatch(Blocks { counter: [next, row, frame, purpose], key, blocks: rest });
    }
    arch.dispatch(Blocks { counter, key, blocks });
}

/// Blocks in a loop that the compiler vectorizes.
struct Blocks<'a> {
    counter: [u32; 4],
    key: [u32; 2],
    blocks: &'a mut [[u32; 4]],
}

impl pulp::WithSimd for Blocks<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let [first, row, frame, purpose] = self.counter;
        for (i, place) in self.blocks.iter_mut().enumerate() {
            *place = block([first.wrapping_add(i as u32), row, frame, purpose], self.key);
        }
    }
}

/// Blocks whose 32-bit words are held in 64-bit lanes whose upper half is ignored, so that a product needs no
/// extraction of its lower word.
#[cfg(target_arch = "x86_64")]
mod avx512 {
    use std::arch::x86_64::__m512i;
    use std::array::from_fn;

    use pulp::cast;
    use pulp::x86::V4;

    /// Blocks of a vector.
    const LANES: usize = 8;
    /// Number of vectors processed concurrently, to hide the latency of a round.
    const VECTORS: usize = 4;

    pub(super) struct Groups<'a> {
        pub(super) simd: V4,
        pub(super) counter: [u32; 4],
        pub(super) key: [u32; 2],
        pub(super) groups: &'a mut [[[u32; 4]; LANES * VECTORS]],
    }

    impl pulp::NullaryFnOnce for Groups<'_> {
        type Output = ();

        #[inline(always)]
        fn call(self) {
            let f = self.simd.avx512f;
            let all = |word: u32| -> __m512i { cast([u64::from(word); LANES]) };
            let multipliers = super::MULTIPLIERS.map(all);
            let keys = super::keys(self.key).map(|key| key.map(all));
            let [first, row, frame, purpose] = self.counter;
            let halves: [__m512i; 2] =
                [cast([0u64, 8, 1, 9, 2, 10, 3, 11]), cast([4u64, 12, 5, 13, 6, 14, 7, 15])];
            for (k, group) in self.groups.iter_mut().enumerate() {
                let next = first.wrapping_add((k * LANES * VECTORS) as u32);
                let mut words: [[__m512i; 4]; VECTORS] = from_fn(|v| {
                    let numbers: [u64; LANES] =
                        from_fn(|i| u64::from(next.wrapping_add((v * LANES + i) as u32)));
                    [cast(numbers), all(row), all(frame), all(purpose)]
                });
                for key in keys {
                    words = words.map(|[a, b, c, d]| {
                        let [low, high] =
                            [f._mm512_mul_epu32(a, multipliers[0]), f._mm512_mul_epu32(c, multipliers[1])];
                        let upper = |product| f._mm512_srli_epi64::<32>(product);
                        let mixed = |a, b, c| f._mm512_ternarylogic_epi64::<0x96>(a, b, c);
                        [mixed(upper(high), b, key[0]), high, mixed(upper(low), d, key[1]), low]
                    });
                }
                let vectors: [[__m512i; 2]; VECTORS] = words.map(|[a, b, c, d]| {
                    let pair = |low, high| {
                        f._mm512_mask_blend_epi32(0xAAAA, low, f._mm512_shuffle_epi32::<0xA0>(high))
                    };
                    let (front, back) = (pair(a, b), pair(c, d));
                    halves.map(|half| f._mm512_permutex2var_epi64(front, half, back))
                });
                *group = cast(vectors);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The known answers published with the Random123 library.
    #[test]
    fn philox_gives_the_published_blocks() {
        assert_eq!(block([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(block([!0; 4], [!0; 2]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
        assert_eq!(
            block([0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344], [0xa409_3822, 0x299f_31d0]),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }

    #[test]
    fn many_blocks_are_those_made_one_by_one() {
        for n in [0, 1, 7, 16, 17, 33, 100] {
            // The block number wraps around.
            let counter = [u32::MAX - 20, 7, 8, 9];
            let mut blocks = vec![[0; 4]; n];
            fill(counter, [3, 4], &mut blocks);
            for (i, made) in blocks.iter().enumerate() {
                let number = counter[0].wrapping_add(i as u32);
                assert_eq!(*made, block([number, 7, 8, 9], [3, 4]), "{i} of {n}");
            }
        }
    }
}
