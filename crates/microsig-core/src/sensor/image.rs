//! Images: whole counts as a camera delivers them, or counts before they are rounded.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ops::Range;

/// A gray image.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Bit depth: 8 to 16, or [`Image::FLOAT_BITS`] for unrounded counts.
    pub bits: u8,
    /// Counts of `width * height` pixels, row by row from the top.
    pub counts: Counts,
}

impl Image {
    /// Bits of an unrounded count.
    pub const FLOAT_BITS: u8 = 32;
}

/// The counts of an image.
#[derive(Debug, Clone, PartialEq)]
pub enum Counts {
    /// Rounded and clamped to the sensor's range.
    Whole(Vec<u16>),
    /// Neither rounded nor clamped.
    Unrounded(Vec<f32>),
}

impl Counts {
    /// Number of pixels.
    pub fn len(&self) -> usize {
        match self {
            Counts::Whole(counts) => counts.len(),
            Counts::Unrounded(counts) => counts.len(),
        }
    }

    /// Whether there are no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Appends the counts of another image, which has the same format; others are converted.
    pub fn extend(&mut self, other: &Counts) {
        match (self, other) {
            (Counts::Unrounded(all), Counts::Unrounded(more)) => all.extend_from_slice(more),
            (Counts::Unrounded(all), Counts::Whole(more)) => all.extend(more.iter().copied().map(f32::from)),
            (Counts::Whole(all), more) => all.extend_from_slice(&more.whole()),
        }
    }

    /// The counts of some of the pixels.
    ///
    /// # Panics
    /// If the range ends beyond the last pixel.
    pub fn slice(&self, pixels: Range<usize>) -> Counts {
        match self {
            Counts::Whole(counts) => Counts::Whole(counts[pixels].to_vec()),
            Counts::Unrounded(counts) => Counts::Unrounded(counts[pixels].to_vec()),
        }
    }

    /// Whole counts; unrounded ones are rounded and clamped to 16 bit.
    pub fn whole(&self) -> Cow<'_, [u16]> {
        match self {
            Counts::Whole(counts) => Cow::Borrowed(counts),
            Counts::Unrounded(counts) => {
                counts.iter().map(|&count| u16::of(f64::from(count), f64::from(u16::MAX))).collect()
            }
        }
    }

    /// The counts as they are.
    pub fn values(&self) -> impl Iterator<Item = f64> + Clone + '_ {
        let (whole, unrounded): (&[u16], &[f32]) = match self {
            Counts::Whole(counts) => (counts, &[]),
            Counts::Unrounded(counts) => (&[], counts),
        };
        whole.iter().map(|&count| f64::from(count)).chain(unrounded.iter().map(|&count| f64::from(count)))
    }
}

/// What the pixels of an image file hold.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ImageFormat {
    /// Whole counts of 16 bit, or of 8 bit for a sensor of 8 bit, clamped to the sensor's range.
    #[default]
    Integer,
    /// 32-bit floating-point numbers: counts before they are rounded and clamped to the range of the sensor,
    /// which keeps light below half a count. Noise is included, if there is any.
    Float32,
}

/// The number that a pixel holds.
pub(super) trait Pixel: Copy + Default + Send + Sync {
    /// The count of a level, which is finite; at most `largest` if counts are whole.
    fn of(level: f64, largest: f64) -> Self;
}

/// 2^52: adding it to a number in [0, 2^52) puts the nearest integer (ties to even) into the low bits.
const ROUND: f64 = 4_503_599_627_370_496.0;

impl Pixel for u16 {
    #[inline(always)]
    fn of(level: f64, largest: f64) -> u16 {
        (level.clamp(0.0, largest) + ROUND).to_bits() as u16
    }
}

impl Pixel for f32 {
    #[inline(always)]
    fn of(level: f64, _: f64) -> f32 {
        level as f32
    }
}
