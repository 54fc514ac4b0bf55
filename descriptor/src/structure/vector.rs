//! Numbers in the lanes of a vector, with the operators of a single one.

use std::ops::{Add, Div, Mul, Neg, Sub};

use pulp::Simd;

/// A float in each lane, as many as `S` computes at once.
#[derive(Clone, Copy)]
pub(super) struct Floats<S: Simd> {
    simd: S,
    pub(super) lanes: S::f32s,
}

impl<S: Simd> Floats<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, lanes: S::f32s) -> Self {
        Self { simd, lanes }
    }

    /// The same in all lanes.
    #[inline(always)]
    pub(super) fn all(simd: S, value: f32) -> Self {
        Self { simd, lanes: simd.splat_f32s(value) }
    }

    /// Those of a slice from place `vector` · lanes on.
    ///
    /// # Panics
    /// If the slice has fewer: a programming error.
    #[inline(always)]
    pub(super) fn of(simd: S, values: &[f32], vector: usize) -> Self {
        Self { simd, lanes: S::as_simd_f32s(values).0[vector] }
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        Self { lanes: self.simd.sqrt_f32s(self.lanes), ..self }
    }

    /// By bits, as what pulp has may stay a call.
    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        let sizes = self.simd.and_u32s(self.bits(), self.simd.splat_u32s(!SIGN));
        Self { lanes: self.simd.transmute_f32s_u32s(sizes), ..self }
    }

    #[inline(always)]
    pub(super) fn bits(self) -> S::u32s {
        self.simd.transmute_u32s_f32s(self.lanes)
    }

    #[inline(always)]
    pub(super) fn equals(self, value: f32) -> S::m32s {
        self.simd.equal_f32s(self.lanes, self.simd.splat_f32s(value))
    }

    #[inline(always)]
    pub(super) fn is_below(self, value: f32) -> S::m32s {
        self.simd.less_than_f32s(self.lanes, self.simd.splat_f32s(value))
    }

    #[inline(always)]
    pub(super) fn is_above(self, value: f32) -> S::m32s {
        self.simd.greater_than_f32s(self.lanes, self.simd.splat_f32s(value))
    }

    #[inline(always)]
    pub(super) fn is_at_most(self, value: f32) -> S::m32s {
        self.simd.less_than_or_equal_f32s(self.lanes, self.simd.splat_f32s(value))
    }

    #[inline(always)]
    pub(super) fn is_at_least(self, value: f32) -> S::m32s {
        self.simd.greater_than_or_equal_f32s(self.lanes, self.simd.splat_f32s(value))
    }

    /// How many of these edges each number has reached.
    #[inline(always)]
    pub(super) fn edges_reached(self, edges: &[f32]) -> S::u32s {
        let mut reached = self.simd.splat_u32s(0);
        for &edge in edges {
            reached = increment(self.simd, reached, self.is_at_least(edge));
        }
        reached
    }

    /// `value` in the lanes of the mask.
    #[inline(always)]
    pub(super) fn with(self, mask: S::m32s, value: f32) -> Self {
        Self { lanes: self.simd.select_f32s(mask, self.simd.splat_f32s(value), self.lanes), ..self }
    }
}

/// The bit of a float that is its sign.
const SIGN: u32 = 1 << 31;

/// One more in the lanes of the mask.
#[inline(always)]
pub(super) fn increment<S: Simd>(simd: S, numbers: S::u32s, mask: S::m32s) -> S::u32s {
    simd.add_u32s(numbers, simd.select_u32s(mask, simd.splat_u32s(1), simd.splat_u32s(0)))
}

macro_rules! operator {
    ($operator:ident, $name:ident, $of_lanes:ident) => {
        impl<S: Simd> $operator for Floats<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self { lanes: self.simd.$of_lanes(self.lanes, other.lanes), ..self }
            }
        }
    };
}
operator!(Add, add, add_f32s);
operator!(Sub, sub, sub_f32s);
operator!(Mul, mul, mul_f32s);
operator!(Div, div, div_f32s);

impl<S: Simd> Neg for Floats<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        let turned = self.simd.xor_u32s(self.bits(), self.simd.splat_u32s(SIGN));
        Self { lanes: self.simd.transmute_f32s_u32s(turned), ..self }
    }
}

/// The sum of the products of three numbers each.
#[inline(always)]
pub(super) fn dot<S: Simd>(a: [Floats<S>; 3], b: [Floats<S>; 3]) -> Floats<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
