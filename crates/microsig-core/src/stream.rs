//! Counter-based random numbers, identified by an address.
//!
//! Every stream has an address (family, purpose, frame, row) that determines its numbers, independently of
//! threads and order of use. There are two kinds of families:
//!
//! - **public**, from a 64-bit seed: Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2,
//!   3", SC'11). The seed is the key, and the address with a block number is the counter, so that no two
//!   addresses share a block.
//! - **secret**, from a 256-bit key: ChaCha20 (RFC 8439) with the address as nonce. Knowledge of some of the
//!   numbers, such as the noise of an image where there is no particle, reveals nothing about the others.

use chacha20::ChaCha20;
use chacha20::cipher::{KeyIvInit, StreamCipher};
use rand_core::{Infallible, TryRng};

use crate::philox;

/// Purpose of a random stream. The discriminants are part of the address and never change their meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Purpose {
    /// Angles of the ray fans of one particle; row = row of the data file.
    Rays = 1,
    /// Background noise; row = pixel row.
    BackgroundNoise = 2,
    /// Initial particle positions; frame = recording, row = 0.
    Seeding = 3,
    /// Particles that enter through open boundaries; frame = the later frame of the step.
    Inflow = 4,
    /// Angles of the ray fans of the calibration stack; frame = step of the stack.
    CalibrationRays = 5,
    /// Background noise of the calibration stack; frame = step of the stack, row = pixel row.
    CalibrationNoise = 6,
    /// Brownian steps of a tracer; frame = the later frame of the step, row = low 32 bits of its id.
    Brownian = 7,
    /// Initial orientation of a spheroid; row = low 32 bits of its id.
    Orientation = 8,
    /// Brightness of a tracer; row = low 32 bits of its id.
    Intensity = 9,
    /// Fixed-pattern noise of a camera; frame = 0, row = pixel row.
    FixedPattern = 10,
    /// Energy of a light pulse; row = 0.
    PulseEnergy = 16,
    /// Timing jitter of a frame; row = 0.
    Timing = 17,
    /// Brownian steps of a tracer while the shutter is open; row = low 32 bits of its id.
    Exposure = 18,
    /// Diameter of a particle of a recorded track; row = low 32 bits of the track number.
    Diameter = 19,
    /// Quantities that vary between the samples of a training stream; frame = low 32 bits of the sample
    /// number, row = hash of the path of the varied key.
    Variation = 20,
    /// Depth in focus of a tracer; row = low 32 bits of its id.
    FocusScatter = 21,
}

/// A family of random streams.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Streams {
    family: Family,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Family {
    Public(u64),
    Secret([u8; 32]),
}

impl Streams {
    /// The public streams of a seed.
    pub fn new(seed: u64) -> Self {
        Streams { family: Family::Public(seed) }
    }

    /// The streams of a secret 256-bit key, which cannot be found by exhaustive search.
    pub fn secret(key: [u8; 32]) -> Self {
        Streams { family: Family::Secret(key) }
    }

    /// The seed of public streams; `None` if they are secret.
    pub fn seed(&self) -> Option<u64> {
        match self.family {
            Family::Public(seed) => Some(seed),
            Family::Secret(_) => None,
        }
    }

    /// The key of secret streams; `None` if they are public.
    pub fn key(&self) -> Option<[u8; 32]> {
        match self.family {
            Family::Public(_) => None,
            Family::Secret(key) => Some(key),
        }
    }

    /// The stream at an address, positioned at its start.
    pub fn stream(&self, purpose: Purpose, frame: u32, row: u32) -> Stream {
        let source = match self.family {
            Family::Public(seed) => Source::Philox {
                key: [seed as u32, (seed >> 32) as u32],
                counter: [0, row, frame, purpose as u32],
            },
            Family::Secret(key) => {
                let mut nonce = [0; 12];
                for (bytes, word) in nonce.chunks_mut(4).zip([purpose as u32, frame, row]) {
                    bytes.copy_from_slice(&word.to_le_bytes());
                }
                Source::ChaCha(Box::new(ChaCha20::new(&key.into(), &nonce.into())))
            }
        };
        Stream { source, block: [0; 4], used: 4, ahead: Vec::new(), singles: 0 }
    }
}

impl std::fmt::Debug for Streams {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // A secret key must not appear in messages.
        match self.family {
            Family::Public(seed) => write!(f, "Streams::new({seed})"),
            Family::Secret(_) => f.write_str("Streams::secret(..)"),
        }
    }
}

/// A sequence of random numbers: 2^34 words of 32 bits.
#[derive(Debug)]
pub struct Stream {
    source: Source,
    block: [u32; 4],
    used: usize,
    /// Blocks drawn ahead, in reverse order; of long streams only.
    ahead: Vec<[u32; 4]>,
    /// Blocks drawn one by one so far.
    singles: u32,
}

/// Streams that need more blocks than this draw [`AHEAD`] at a time.
const SINGLES: u32 = 16;
const AHEAD: usize = 64;

/// Where the next four words of a stream come from.
#[derive(Debug)]
enum Source {
    Philox { key: [u32; 2], counter: [u32; 4] },
    // Boxed, so that public streams, one per particle, stay small.
    ChaCha(Box<ChaCha20>),
}

impl Source {
    /// The next blocks of four words.
    fn fill(&mut self, blocks: &mut [[u32; 4]]) {
        match self {
            Source::Philox { key, counter } => {
                let n = blocks.len() as u32;
                match blocks {
                    [block] => *block = philox::block(*counter, *key),
                    blocks => philox::fill(*counter, *key, blocks),
                }
                counter[0] = counter[0].wrapping_add(n);
            }
            Source::ChaCha(cipher) => {
                // Four blocks of the cipher at a time.
                for blocks in blocks.chunks_mut(16) {
                    let mut bytes = [0u8; 256];
                    cipher.apply_keystream(&mut bytes[..16 * blocks.len()]);
                    let (words, _) = bytes.as_chunks::<4>();
                    for (word, bytes) in blocks.as_flattened_mut().iter_mut().zip(words) {
                        *word = u32::from_le_bytes(*bytes);
                    }
                }
            }
        }
    }
}

impl Stream {
    /// The next 32 random bits.
    pub fn next_u32(&mut self) -> u32 {
        if self.used == 4 {
            self.block = self.next_block();
            self.used = 0;
        }
        self.used += 1;
        self.block[self.used - 1]
    }

    #[inline(never)]
    fn next_block(&mut self) -> [u32; 4] {
        if let Some(block) = self.ahead.pop() {
            return block;
        }
        if self.singles < SINGLES {
            self.singles += 1;
            let mut block = [[0; 4]];
            self.source.fill(&mut block);
            return block[0];
        }
        self.ahead.resize(AHEAD, [0; 4]);
        self.source.fill(&mut self.ahead);
        self.ahead.reverse();
        self.ahead.pop().unwrap_or_default()
    }

    /// Fills a slice with the numbers that repeated calls of [`Stream::next_u32`] would give, many blocks at
    /// a time.
    pub fn fill(&mut self, words: &mut [u32]) {
        let (rest, words) = words.split_at_mut(words.len().min(4 - self.used));
        let (blocks, last) = words.as_chunks_mut::<4>();
        rest.fill_with(|| self.next_u32());
        let (known, blocks) = blocks.split_at_mut(blocks.len().min(self.ahead.len()));
        known.fill_with(|| self.ahead.pop().unwrap_or_default());
        self.source.fill(blocks);
        last.fill_with(|| self.next_u32());
    }

    /// The next 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        u64::from(self.next_u32()) | u64::from(self.next_u32()) << 32
    }

    /// A uniform random number in [0, 1), a multiple of 2^-53.
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }
}

impl TryRng for Stream {
    type Error = Infallible;

    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok(self.next_u32())
    }

    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        Ok(self.next_u64())
    }

    fn try_fill_bytes(&mut self, dst: &mut [u8]) -> Result<(), Infallible> {
        for chunk in dst.chunks_mut(4) {
            chunk.copy_from_slice(&self.next_u32().to_le_bytes()[..chunk.len()]);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filling_gives_the_same_numbers_as_asking_one_by_one() {
        for streams in [Streams::new(7), Streams::secret([7; 32])] {
            for (before, n) in
                [(0, 0), (0, 3), (1, 2), (3, 100), (4, 64), (5, 333), (0, 500), (66, 9), (101, 600)]
            {
                let stream = || streams.stream(Purpose::Rays, 1, 2);
                let (mut filled, mut asked) = (stream(), stream());
                let mut words = vec![0; n];
                (0..before).for_each(|_| assert_eq!(filled.next_u32(), asked.next_u32()));
                filled.fill(&mut words);
                assert!(words.iter().all(|&word| word == asked.next_u32()), "{before} before {n}");
                assert_eq!(filled.next_u64(), asked.next_u64(), "after {before} and {n}");
            }
        }
    }

    #[test]
    fn an_address_is_a_stream_of_its_own() {
        let streams = Streams::new(7);
        let first = |purpose, frame, row| streams.stream(purpose, frame, row).next_u64();
        let of_seed = |seed: u64, frame: u32| Streams::new(seed).stream(Purpose::Rays, frame, 0).next_u64();
        let numbers = [
            first(Purpose::Rays, 0, 0),
            first(Purpose::Rays, 0, 1),
            first(Purpose::Rays, 1, 0),
            first(Purpose::Rays, 256, 0),
            first(Purpose::Rays, 65_536, 0),
            first(Purpose::BackgroundNoise, 0, 0),
            first(Purpose::CalibrationNoise, 0, 0),
            of_seed(8, 0),
            of_seed(7 + (1 << 32), 0),
            // Parts of an address are not added.
            of_seed(6, 1),
            of_seed(0, 7),
        ];
        for (i, a) in numbers.iter().enumerate() {
            assert!(numbers[i + 1..].iter().all(|b| a != b));
        }
        assert_eq!(numbers[0], first(Purpose::Rays, 0, 0));
    }

    /// Keystream of the all-zero key and nonce (draft-nir-cfrg-chacha20-poly1305-06, appendix A.1, test
    /// vectors 1 and 2), and the address as RFC 8439 lays out a nonce.
    #[test]
    fn secret_streams_are_the_published_keystream() {
        let zero = ChaCha20::new(&[0; 32].into(), &[0; 12].into());
        let mut stream = Stream {
            source: Source::ChaCha(Box::new(zero)),
            block: [0; 4],
            used: 4,
            ahead: Vec::new(),
            singles: 0,
        };
        assert_eq!([stream.next_u32(), stream.next_u32()], [0xade0_b876, 0x903d_f1a0]);
        let second_block = (2..17).map(|_| stream.next_u32()).last();
        assert_eq!(second_block, Some(0xbee7_079f));

        let mut key = [0; 32];
        key[31] = 1;
        let first = |key, row| Streams::secret(key).stream(Purpose::Rays, 0, row).next_u64();
        assert_ne!(first(key, 0), first([0; 32], 0));
        assert_ne!(first(key, 0), first(key, 1));
        assert_eq!(first(key, 1), first(key, 1));
        assert_eq!(Streams::secret(key).seed(), None);
        assert!(!format!("{:?}", Streams::secret(key)).contains('1'), "a key is never shown");
    }

    #[test]
    fn uniform_fills_the_unit_interval() {
        let mut stream = Streams::new(1).stream(Purpose::Seeding, 0, 0);
        let numbers: Vec<f64> = (0..10_000).map(|_| stream.uniform()).collect();
        let mean = numbers.iter().sum::<f64>() / 10_000.0;
        // Standard error of the mean of a uniform number: 1 / sqrt(12 n) = 0.0029.
        assert!((mean - 0.5).abs() < 4.0 * 0.0029);
        assert!(numbers.iter().all(|u| (0.0..1.0).contains(u)));
    }
}
