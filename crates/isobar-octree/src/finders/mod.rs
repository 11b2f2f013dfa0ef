//! The thesis's root finders (section 3.2.4, Listings A.2 to A.4), and beside them the one this workspace uses.
//!
//! Each works on [0, 1], finds the first root only, and takes its budget of iterations as an argument. The four of the thesis, [`lr81`], [`mr07`],
//! [`arfbs`], [`sturm`], are as printed with the listings' slips corrected, each named where it is; they prove nothing, and at a small
//! budget they find roots that are not there and lose ones that are. [`Finder::Robust`] is `isobar_poly::first_root`, which proves its answers. `f32` as in the
//! thesis, or `f64`.
//!
//! ```
//! use isobar_octree::finders::{Answer, Finder};
//! let b = [1.0f32, 1.0, -4.0, 5.0]; // hardcases A15, root 0.343553830433
//! for finder in Finder::THESIS {
//!     let Answer::Root(t) = finder.first(&b) else { panic!("{} finds none", finder.label()) };
//!     assert!((t - 0.343_553_83).abs() < 1e-5, "{} {t}", finder.label());
//! }
//! ```

mod arfbs;
mod lr81;
mod mr07;
mod named;
mod polygon;
mod sturm;
#[cfg(test)]
mod tests;

pub use arfbs::arfbs;
pub use lr81::lr81;
pub use mr07::mr07;
pub use named::solvers;
pub use sturm::sturm;

use isobar_poly::{First, Real, RootKind, Roots, Tolerance, all_roots, bernstein, first_root};

/// A root finder with its budget.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Finder {
    /// Subdivision at the control polygon's crossing ([`lr81`]).
    Lr81 {
        /// Subdivisions.
        iterations: u32,
    },
    /// Knot insertion at the control polygon's crossing ([`mr07`]).
    Mr07 {
        /// Knots inserted.
        knots: u32,
    },
    /// Isolation, then regula falsi and halving in turn ([`arfbs`]).
    Arfbs {
        /// Most splits of the isolation; the listing has no limit.
        splits: u32,
        /// Steps after it.
        iterations: u32,
    },
    /// Halving by Sturm's chain ([`sturm`]).
    Sturm {
        /// Halvings.
        halvings: u32,
    },
    /// isobar-poly's solver: brackets proved, no budget.
    Robust {
        /// Width of bracket aimed at.
        width: f64,
    },
}

/// What a finder says about the first root on [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answer<T> {
    /// There is none.
    None,
    /// Here.
    Root(T),
    /// p cannot be told from zero here: a root or a near miss. Only the robust finder says so; the others answer one way or the other.
    Touching(T),
    /// The budget ended before either was found, or the number of coefficients is not 2 to 10.
    GaveUp,
}

impl<T> From<Option<T>> for Answer<T> {
    fn from(found: Option<T>) -> Self {
        found.map_or(Self::None, Self::Root)
    }
}

/// Splits of aRFBS: the thesis saw 1 to 3; more than f32 can part.
pub const SPLITS: u32 = 32;

impl Finder {
    /// The thesis's four with ample budgets: 6 (d + 1) = 24 subdivisions, and as many for the others.
    pub const THESIS: [Self; 4] = Self::with_budget(24);

    /// The thesis's four, each with the same budget.
    #[must_use]
    pub const fn with_budget(n: u32) -> [Self; 4] {
        [
            Self::Lr81 { iterations: n },
            Self::Mr07 { knots: n },
            Self::Arfbs {
                splits: SPLITS,
                iterations: n,
            },
            Self::Sturm { halvings: n },
        ]
    }

    /// The thesis's name for it.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Lr81 { .. } => "LR81",
            Self::Mr07 { .. } => "MR07",
            Self::Arfbs { .. } => "aRFBS",
            Self::Sturm { .. } => "Sturm",
            Self::Robust { .. } => "isobar-poly",
        }
    }

    /// Name and budget.
    #[must_use]
    pub fn label(&self) -> String {
        match self.budget() {
            Some(n) => format!("{} {n}", self.name()),
            None => self.name().to_owned(),
        }
    }

    /// Iterations, knots or halvings; the robust solver has none.
    #[must_use]
    pub const fn budget(&self) -> Option<u32> {
        match *self {
            Self::Lr81 { iterations } | Self::Arfbs { iterations, .. } => Some(iterations),
            Self::Mr07 { knots } => Some(knots),
            Self::Sturm { halvings } => Some(halvings),
            Self::Robust { .. } => None,
        }
    }

    /// The first root on [0, 1] of the polynomial with Bernstein coefficients `b`, 2 to 10 of them. Sturm's chain needs the power form: it is
    /// calculated in f64 and rounded once ([`sturm`] takes power coefficients where they are there already, as in the thesis).
    #[must_use]
    pub fn first<T: Real>(&self, b: &[T]) -> Answer<T> {
        macro_rules! sized {
            ($($m:literal)*) => {
                match b.len() {
                    $($m => match b.try_into() {
                        Ok(b) => self.first_of::<T, $m>(b),
                        Err(_) => Answer::GaveUp,
                    },)*
                    _ => Answer::GaveUp,
                }
            };
        }
        sized!(2 3 4 5 6 7 8 9 10)
    }

    /// [`Finder::first`] for a number of coefficients that the compiler knows.
    #[inline]
    #[must_use]
    pub fn first_of<T: Real, const M: usize>(&self, b: &[T; M]) -> Answer<T> {
        match *self {
            Self::Lr81 { iterations } => lr81(b, iterations).into(),
            Self::Mr07 { knots } => mr07(b, knots).into(),
            Self::Arfbs { splits, iterations } => arfbs(b, splits, iterations),
            Self::Sturm { halvings } => sturm(&power_form(b), halvings).into(),
            Self::Robust { width } => match first_root(&b[..], &Tolerance::new(T::from_f64(width))) {
                First::None => Answer::None,
                First::Root(r) if matches!(r.kind, RootKind::Touching | RootKind::Interval) => Answer::Touching(r.t),
                First::Root(r) => Answer::Root(r.t),
                First::GaveUp { .. } => Answer::GaveUp,
            },
        }
    }

    /// All roots, where the finder has them: only the robust one. The thesis needs no more than the first.
    #[must_use]
    pub fn all<T: Real>(&self, b: &[T]) -> Option<Roots<T>> {
        match self {
            Self::Robust { width } => Some(all_roots(b, &Tolerance::new(T::from_f64(*width)))),
            _ => None,
        }
    }
}

/// Power coefficients, calculated in f64.
#[must_use]
pub fn power_form<T: Real, const M: usize>(b: &[T; M]) -> [T; M] {
    let mut wide = b.map(T::to_f64);
    bernstein::to_power(&mut wide);
    wide.map(T::from_f64)
}
