//! The six filter banks (S14), and how slots beyond the ends of a line are mirrored.

use std::fmt;
use std::ops::{Add, Mul};

/// What the transform computes in: f32 for drawing, f64 and exact dyadic numbers in tests. Every filter tap is a dyadic fraction.
pub trait Number: Copy + Default + Send + Sync + PartialEq + fmt::Debug + Add<Output = Self> + Mul<Output = Self> {
    /// `numerator / 2^log2`, exactly.
    fn dyadic(numerator: i32, log2: u32) -> Self;

    /// The nearest f64, for ranges and magnitudes.
    fn to_f64(self) -> f64;
}

impl Number for f32 {
    #[inline(always)]
    fn dyadic(numerator: i32, log2: u32) -> Self {
        numerator as Self / (1u64 << log2) as Self
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

impl Number for f64 {
    #[inline(always)]
    fn dyadic(numerator: i32, log2: u32) -> Self {
        Self::from(numerator) / (1u64 << log2) as Self
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
}

/// One filter: tap j, `taps[j] / 2^log2`, belongs to offset `first + j`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Filter {
    /// Offset of the first tap.
    pub first: i32,
    /// Numerators.
    pub taps: &'static [i32],
    /// Logarithm of the common denominator.
    pub log2: u32,
}

impl Filter {
    /// The numerator at an offset; 0 outside the filter.
    #[must_use]
    pub fn at(&self, offset: i32) -> i32 {
        usize::try_from(offset - self.first)
            .ok()
            .and_then(|j| self.taps.get(j))
            .copied()
            .unwrap_or(0)
    }

    /// `(offset, weight)` of the taps.
    pub fn weights<T: Number>(&self) -> impl Iterator<Item = (i32, T)> + '_ {
        (self.first..).zip(self.taps).map(|(o, &t)| (o, T::dyadic(t, self.log2)))
    }
}

/// The four filters of a bank. Analysis `c[k] = sum a0[m] s[2k+m]`, `d[k] = sum a1[m] s[2k+m]` (correlations); synthesis
/// `s[n] = sum g0[n-2k] c[k] + g1[n-2k] d[k]`. The sum of g0 is 2 (the two-scale mask of the B-spline), that of a0 is 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Filters {
    /// Analysis, low pass.
    pub a0: Filter,
    /// Analysis, high pass.
    pub a1: Filter,
    /// Synthesis, low pass.
    pub g0: Filter,
    /// Synthesis, high pass.
    pub g1: Filter,
}

/// A biorthogonal spline wavelet: the scaling function is the B-spline of the bank's degree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Bank {
    /// Linear, 2 vanishing moments.
    Psi22,
    /// Linear, 4 vanishing moments.
    Psi24,
    /// Quadratic, 1 vanishing moment.
    Psi31,
    /// Quadratic, 3 vanishing moments.
    Psi33,
    /// Cubic, 2 vanishing moments.
    Psi42,
    /// Cubic, 4 vanishing moments.
    Psi44,
}

const fn filter(first: i32, log2: u32, taps: &'static [i32]) -> Filter {
    Filter { first, taps, log2 }
}

const LINEAR: (Filter, Filter) = (filter(0, 2, &[-1, 2, -1]), filter(-1, 1, &[1, 2, 1]));
const QUADRATIC: (Filter, Filter) = (filter(-1, 3, &[-1, 3, -3, 1]), filter(-1, 2, &[1, 3, 3, 1]));
const CUBIC: (Filter, Filter) = (filter(-1, 4, &[1, -4, 6, -4, 1]), filter(-2, 3, &[1, 4, 6, 4, 1]));

const fn bank((a1, g0): (Filter, Filter), a0: Filter, g1: Filter) -> Filters {
    Filters { a0, a1, g0, g1 }
}

/// Steinberger 2010, Figures 4.2 to 4.4, with the misprints put right (maths: corrections, section B: five taps, one scale, one sign; the taps here
/// are those of the verified table there).
static FILTERS: [Filters; 6] = [
    bank(LINEAR, filter(-2, 3, &[-1, 2, 6, 2, -1]), filter(-1, 2, &[-1, -2, 6, -2, -1])),
    bank(
        LINEAR,
        filter(-4, 7, &[3, -6, -16, 38, 90, 38, -16, -6, 3]),
        filter(-3, 6, &[3, 6, -16, -38, 90, -38, -16, 6, 3]),
    ),
    bank(QUADRATIC, filter(-1, 2, &[-1, 3, 3, -1]), filter(-1, 1, &[1, 3, -3, -1])),
    bank(
        QUADRATIC,
        filter(-3, 6, &[3, -9, -7, 45, 45, -7, -9, 3]),
        filter(-3, 5, &[-3, -9, 7, 45, -45, -7, 9, 3]),
    ),
    bank(
        CUBIC,
        filter(-3, 5, &[3, -12, 5, 40, 5, -12, 3]),
        filter(-2, 4, &[-3, -12, -5, 40, -5, -12, -3]),
    ),
    bank(
        CUBIC,
        filter(-5, 8, &[-5, 20, -1, -96, 70, 280, 70, -96, -1, 20, -5]),
        filter(-4, 7, &[5, 20, 1, -96, -70, 280, -70, -96, 1, 20, 5]),
    ),
];

impl Bank {
    /// All banks, in the order of the thesis.
    pub const ALL: [Self; 6] = [Self::Psi22, Self::Psi24, Self::Psi31, Self::Psi33, Self::Psi42, Self::Psi44];

    /// The bank of the fewest vanishing moments of a degree, which the thesis recommends (section 4.1).
    #[must_use]
    pub const fn of_degree(degree: usize) -> Option<Self> {
        match degree {
            1 => Some(Self::Psi22),
            2 => Some(Self::Psi31),
            3 => Some(Self::Psi42),
            _ => None,
        }
    }

    /// `psi2,2` and so on.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Psi22 => "psi2,2",
            Self::Psi24 => "psi2,4",
            Self::Psi31 => "psi3,1",
            Self::Psi33 => "psi3,3",
            Self::Psi42 => "psi4,2",
            Self::Psi44 => "psi4,4",
        }
    }

    /// Degree of the spline: 1, 2 or 3.
    #[must_use]
    pub const fn degree(self) -> usize {
        match self {
            Self::Psi22 | Self::Psi24 => 1,
            Self::Psi31 | Self::Psi33 => 2,
            Self::Psi42 | Self::Psi44 => 3,
        }
    }

    /// Vanishing moments `(synthesis wavelet, analysis wavelet)`.
    #[must_use]
    pub const fn moments(self) -> (usize, usize) {
        match self {
            Self::Psi22 => (2, 2),
            Self::Psi24 => (4, 2),
            Self::Psi31 => (1, 3),
            Self::Psi33 => (3, 3),
            Self::Psi42 => (2, 4),
            Self::Psi44 => (4, 4),
        }
    }

    /// The filters.
    #[must_use]
    pub fn filters(self) -> &'static Filters {
        &FILTERS[self as usize]
    }

    /// How lines of this bank go on beyond their ends.
    #[must_use]
    pub const fn mirror(self) -> Mirror {
        if self.degree() == 2 { Mirror::Half } else { Mirror::Whole }
    }

    /// Polynomial pieces of the scaling function and of the wavelet, in fine steps, as in Table 4.1.
    #[must_use]
    pub fn pieces(self) -> (usize, usize) {
        let f = self.filters();
        // A wavelet of n fine B-splines with degree + 1 pieces each covers n + degree pieces.
        (self.degree() + 1, f.g1.taps.len() + self.degree())
    }

    /// The frequency responses `|G0(w)|`, `|G1(w)|` of the synthesis filters at `w` in [0, pi] radians per sample (Figures 4.2 to 4.4).
    #[must_use]
    pub fn response(self, w: f64) -> (f64, f64) {
        let f = self.filters();
        let of = |f: &Filter| {
            let (re, im) = f.weights::<f64>().fold((0.0, 0.0), |(re, im), (o, t)| {
                (re + t * (w * f64::from(o)).cos(), im - t * (w * f64::from(o)).sin())
            });
            f64::hypot(re, im)
        };
        (of(&f.g0), of(&f.g1))
    }
}

impl fmt::Display for Bank {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// The symmetric extension of a line (maths, section B): filters of odd length mirror about the end sample, those of even length about the point half a
/// step beyond it.
///
/// A line of n samples is transformed into n *slots* in place: slot 2k holds c\[k\], slot 2k+1 holds d\[k\]; there are `ceil(n/2)` c and `floor(n/2)` d.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mirror {
    /// About the end sample.
    Whole,
    /// About the point half a step beyond it; details change their sign.
    Half,
}

impl Mirror {
    /// The sample in `0..n` that stands for sample i.
    #[must_use]
    pub fn sample(self, i: isize, n: usize) -> usize {
        let n = n as isize;
        let m = match self {
            Self::Whole if n == 1 => 0,
            Self::Whole => {
                let m = i.rem_euclid(2 * (n - 1));
                if m >= n { 2 * (n - 1) - m } else { m }
            }
            Self::Half => {
                let m = i.rem_euclid(2 * n);
                if m >= n { 2 * n - 1 - m } else { m }
            }
        };
        m as usize
    }

    /// The slot in `0..n` that stands for slot i and whether its value is negated; `None` where the value is zero: a detail mirrored on itself with
    /// a change of sign, or of a line of one sample.
    #[must_use]
    #[inline]
    pub fn slot(self, i: isize, n: usize) -> Option<(usize, bool)> {
        if i >= 0 && (i as usize) < n {
            return Some((i as usize, false));
        }
        match self {
            Self::Whole if n == 1 => (i.rem_euclid(2) == 0).then_some((0, false)),
            // The period 2(n-1) is even: low slots stay low.
            Self::Whole => Some((self.sample(i, n), false)),
            Self::Half => {
                // c[-1-k] = c[k], c[n-1-k] = c[k]; d the same with a sign: a shift by n is two reflections.
                let (k, odd) = (i.div_euclid(2).rem_euclid(n as isize) as usize, i.rem_euclid(2) as usize);
                let count = (n + 1 - odd) / 2;
                if k < count {
                    Some((2 * k + odd, false))
                } else if odd == 1 && 2 * k + 1 == n {
                    None
                } else {
                    Some((2 * (n - 1 - k) + odd, odd == 1))
                }
            }
        }
    }
}

/// The synthesis of one sample: `s[n] = sum weight * slot[n + offset]`, for even and odd n.
#[derive(Debug, Clone)]
pub(super) struct Synthesis<T> {
    /// `[parity of n]`, `(offset, weight)` with |offset| <= [`REACH`].
    pub(super) taps: [Vec<(isize, T)>; 2],
}

/// How many slots beyond a sample its synthesis reads at most (psi4,4).
pub(super) const REACH: usize = 5;

impl<T: Number> Synthesis<T> {
    pub(super) fn new(bank: Bank) -> Self {
        let f = bank.filters();
        let taps = |parity: isize| {
            (-(REACH as isize)..=REACH as isize)
                .filter_map(|o| {
                    // Slot n + o is 2k or 2k + 1; the filter's offset is n - 2k.
                    let low = (parity + o).rem_euclid(2) == 0;
                    let (f, at) = if low { (&f.g0, -o) } else { (&f.g1, 1 - o) };
                    let tap = f.at(at as i32);
                    (tap != 0).then(|| (o, T::dyadic(tap, f.log2)))
                })
                .collect()
        };
        Self {
            taps: [taps(0), taps(1)],
        }
    }
}
