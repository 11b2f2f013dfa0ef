//! Composition: the polynomial f(r(t)) of a tri-linear, tri-quadratic or tri-cubic f along a ray r (thesis, section 3.2.3).
//!
//! Degree D in each of x, y, z gives degree 3 D in t. `f` holds (D + 1)^3 coefficients, that of `x^i y^j z^k` (or of the scaled
//! Bernstein basis) at `(i (D + 1) + j) (D + 1) + k`; a ray's component along an axis is a pair, in power form
//! `[p, v]` for `p + t v`, in scaled Bernstein form `[u0, u1]` for `u0 (1 - t) + u1 t`. All forms are generic over [`Scalar`]: f32, f64, [`Lanes`] of rays, or
//! [`Counted`] numbers, which is how their operations are counted. Rounding is all that parts them; none claims a bound.
//!
//! ```
//! use isobar_octree::compose::{Counted, Form, compose, count};
//! // f = x y z along x = y = z = t: t^3
//! let mut f = [0.0; 8];
//! f[7] = 1.0;
//! let mut out = [0.0; 4];
//! compose::<f64, 1>(Form::Pf, &f, &[[0.0, 1.0]; 3], &mut out);
//! assert_eq!(out, [0.0, 0.0, 0.0, 1.0]);
//! let one = Counted(1.0f32);
//! let done = count(|| compose::<_, 3>(Form::Pf, &[one; 64], &[[one; 2]; 3], &mut [one; 10]));
//! assert_eq!((done.multiplications, done.additions), (360, 234));
//! ```

mod bernstein;
mod cell;
mod packets;
mod power;
mod scalar;
#[cfg(test)]
mod tests;

pub use bernstein::sb;
pub use cell::{powers_of_samples, scale_of_samples};
pub use packets::{Packet, WIDTH, axis_packets, axis_segment_packets};
pub use power::{axis, axis_segment, naive, pf, restrict, to_scaled};
pub use scalar::{Counted, Lanes, Operations, Scalar, count};

/// A way to compose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Form {
    /// Everything multiplied out ([`naive`]).
    Naive,
    /// Horner's scheme in power form ([`pf`]).
    Pf,
    /// Scaled Bernstein form, recursion in all three sums ([`sb`]).
    Sb0,
    /// The innermost sum's products calculated before.
    Sb1,
    /// The two innermost sums' products calculated before.
    Sb2,
    /// All three. The thesis does not name it, but Table 3.1 prints its operations for SB2.
    Sb3,
    /// Power form along the ray's axis ([`axis`]): the recommended one.
    Axis,
    /// The same, and on to the scaled Bernstein form of a stretch ([`axis_segment`]).
    AxisSegment,
}

/// Which coefficients a form takes and gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Basis {
    /// Powers in, powers out.
    Power,
    /// Scaled Bernstein in, scaled Bernstein out.
    ScaledBernstein,
    /// Powers in, scaled Bernstein out.
    PowerToScaledBernstein,
}

impl Form {
    /// All of them, the thesis's in its order.
    pub const ALL: [Self; 8] = [
        Self::Naive,
        Self::Pf,
        Self::Sb0,
        Self::Sb1,
        Self::Sb2,
        Self::Sb3,
        Self::Axis,
        Self::AxisSegment,
    ];

    /// Its name, the thesis's where it has one.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Naive => "naive",
            Self::Pf => "PF",
            Self::Sb0 => "SB0",
            Self::Sb1 => "SB1",
            Self::Sb2 => "SB2",
            Self::Sb3 => "SB3",
            Self::Axis => "axis",
            Self::AxisSegment => "axis, on a stretch",
        }
    }

    /// The coefficients it takes and gives.
    #[must_use]
    pub const fn basis(self) -> Basis {
        match self {
            Self::Naive | Self::Pf | Self::Axis => Basis::Power,
            Self::AxisSegment => Basis::PowerToScaledBernstein,
            Self::Sb0 | Self::Sb1 | Self::Sb2 | Self::Sb3 => Basis::ScaledBernstein,
        }
    }
}

/// f(r(t)) by a form, into `out`, lowest first.
///
/// `r`: the components of the ray, in the form's own basis. For [`Form::Axis`] t is the coordinate z, and `r[2]` is not read;
/// for [`Form::AxisSegment`] `r[2]` is the stretch `[t0, t1]` of z, which becomes [0, 1].
///
/// # Panics
/// If `f` does not hold (D + 1)^3 coefficients or `out` does not hold 3 D + 1. D other than 1, 2, 3 does not compile.
#[inline(always)]
pub fn compose<T: Scalar, const D: usize>(form: Form, f: &[T], r: &[[T; 2]; 3], out: &mut [T]) {
    match form {
        Form::Naive => naive::<T, D>(f, r, out),
        Form::Pf => pf::<T, D>(f, r, out),
        Form::Sb0 => sb::<T, D, 0>(f, r, out),
        Form::Sb1 => sb::<T, D, 1>(f, r, out),
        Form::Sb2 => sb::<T, D, 2>(f, r, out),
        Form::Sb3 => sb::<T, D, 3>(f, r, out),
        Form::Axis => axis::<T, D>(f, &[r[0], r[1]], out),
        Form::AxisSegment => axis_segment::<T, D>(f, &[r[0], r[1]], r[2], out),
    }
}

/// Where the coefficient ijk is.
#[inline(always)]
const fn at<const D: usize>(i: usize, j: usize, k: usize) -> usize {
    (i * (D + 1) + j) * (D + 1) + k
}

#[inline(always)]
fn check<const D: usize>(f: usize, out: usize) {
    const { assert!(D >= 1 && D <= 3, "degrees 1, 2 and 3") };
    assert!(f == (D + 1).pow(3), "(D + 1)^3 coefficients");
    assert!(out == 3 * D + 1, "room for 3 D + 1 coefficients");
}
