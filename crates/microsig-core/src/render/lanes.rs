//! SIMD vectors of the width of the processor, with arithmetic operators.
//!
//! Every operation is correctly rounded and none is fused, so that the bits of a lane do not depend on the
//! vector width.

use std::ops::{Add, BitOr, Div, Mul, Sub};

use pulp::Simd;
use pulp::bytemuck::cast;

/// Number of f32 lanes of the widest vectors of any instruction set.
pub(super) const MAX_LANES: usize = 16;

/// Number of lanes of the narrowest vectors. These use scalar comparisons: pulp's compile to slow code
/// without mask registers, and max(x, NaN) differs between instruction sets.
const NARROW: usize = 4;

/// A vector of f32.
#[derive(Debug, Clone, Copy)]
pub(super) struct Floats<S: Simd>(S, S::f32s);

/// A vector of u32.
#[derive(Debug, Clone, Copy)]
pub(super) struct Words<S: Simd>(S, S::u32s);

impl<S: Simd> Floats<S> {
    #[inline(always)]
    pub(super) fn splat(simd: S, value: f32) -> Self {
        Floats(simd, simd.splat_f32s(value))
    }

    /// Loads a full vector starting at `values[first]`.
    #[inline(always)]
    pub(super) fn load(simd: S, values: &[f32], first: usize) -> Self {
        Floats(simd, S::as_simd_f32s(&values[first..first + S::F32_LANES]).0[0])
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        Floats(self.0, self.0.sqrt_f32s(self.1))
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        Floats(self.0, self.0.abs_f32s(self.1))
    }

    /// Clamps to two limits; NaN becomes the lower limit.
    #[inline(always)]
    pub(super) fn clamp(self, low: Self, high: Self) -> Self {
        let simd = self.0;
        if S::F32_LANES == NARROW {
            let [x, low, high]: [[f32; NARROW]; 3] = [self.1, low.1, high.1].map(cast);
            let larger: [f32; NARROW] = std::array::from_fn(|i| if x[i] > low[i] { x[i] } else { low[i] });
            let within: [f32; NARROW] =
                std::array::from_fn(|i| if larger[i] < high[i] { larger[i] } else { high[i] });
            return Floats(simd, cast(within));
        }
        Floats(simd, simd.min_f32s(simd.max_f32s(self.1, low.1), high.1))
    }

    #[inline(always)]
    pub(super) fn to_bits(self) -> Words<S> {
        Words(self.0, self.0.transmute_u32s_f32s(self.1))
    }
}

impl<S: Simd> Words<S> {
    #[inline(always)]
    pub(super) fn splat(simd: S, value: u32) -> Self {
        Words(simd, simd.splat_u32s(value))
    }

    #[inline(always)]
    pub(super) fn store(self, values: &mut [u32], first: usize) {
        S::as_mut_simd_u32s(&mut values[first..first + S::U32_LANES]).0[0] = self.1;
    }

    /// `instead` where the topmost bit of `sign` is set.
    #[inline(always)]
    pub(super) fn replace_where_negative(self, sign: Self, instead: Self) -> Self {
        let simd = self.0;
        if S::U32_LANES == NARROW {
            let [x, sign, instead]: [[u32; NARROW]; 3] = [self.1, sign.1, instead.1].map(cast);
            let replaced: [u32; NARROW] =
                std::array::from_fn(|i| if (sign[i] as i32) < 0 { instead[i] } else { x[i] });
            return Words(simd, cast(replaced));
        }
        let negative = simd.less_than_i32s(simd.transmute_i32s_u32s(sign.1), simd.splat_i32s(0));
        Words(simd, simd.select_u32s(negative, instead.1, self.1))
    }
}

macro_rules! operator {
    ($vector:ident: $trait:ident, $name:ident, $operation:ident) => {
        impl<S: Simd> $trait for $vector<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                $vector(self.0, self.0.$operation(self.1, other.1))
            }
        }
    };
}

operator!(Floats: Add, add, add_f32s);
operator!(Floats: Sub, sub, sub_f32s);
operator!(Floats: Mul, mul, mul_f32s);
operator!(Floats: Div, div, div_f32s);
// These operators wrap around.
operator!(Words: Add, add, add_u32s);
operator!(Words: Sub, sub, sub_u32s);
operator!(Words: Mul, mul, mul_u32s);
operator!(Words: BitOr, bitor, or_u32s);
