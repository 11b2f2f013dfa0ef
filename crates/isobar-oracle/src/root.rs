//! What the oracle answers.

/// Which stage of the arithmetic decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Decided {
    /// f64 with rigorous error bounds (for analytic fields: outward-rounded intervals).
    F64,
    /// Double-double with rigorous error bounds.
    DoubleDouble,
    /// Integers without limit.
    Exact,
}

/// How s - c vanishes at a root, seen along the ray.
///
/// On a face between two pieces the parity says whether s - c changes sign there; the number is the least one of that parity not below the
/// orders of vanishing on both sides (a crossing with a kink is `Simple`, a kink that touches is `Even(2)`). At the ends of the stay in
/// the domain only the side inside counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Multiplicity {
    /// A crossing with non-zero slope.
    Simple,
    /// s - c touches zero without changing sign: the multiplicity, at least 2.
    Even(u32),
    /// A crossing with zero slope: the multiplicity, at least 3.
    Odd(u32),
    /// s = c on a stretch of the ray.
    Interval,
    /// At least one root is certain, how s - c vanishes is not: tangents and folds of mapped elements, and roots of several elements that cannot be told
    /// apart and disagree. Only for [`isobar_core::Structure::Elements`].
    Unknown,
}

impl Multiplicity {
    /// From the order of vanishing.
    pub(crate) fn of(order: u32) -> Self {
        match order {
            0 | 1 => Self::Simple,
            n if n.is_multiple_of(2) => Self::Even(n),
            n => Self::Odd(n),
        }
    }
}

/// One root of s = c on a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Root {
    /// Certified: the root is not below this t. Units of the ray's direction.
    pub lo: f64,
    /// Certified: the root is not above this t. `hi - lo` is at most `max(4 ulp of t, 1e-13 |t|)` for splines and polynomials; for analytic
    /// fields it is what their enclosures allow, 1e-12 |t| for the contract's fields where the surface is not grazed; for mapped elements what
    /// double-double allows where f64 cannot keep to it, and up to 1e-10 |t| where the multiplicity is [`Multiplicity::Unknown`].
    pub hi: f64,
    /// How s - c vanishes.
    pub multiplicity: Multiplicity,
    /// s = c from the root to here (rounded upward to an f64); then `multiplicity` is [`Multiplicity::Interval`].
    pub interval_end: Option<f64>,
    /// ds/dt at the root, f64 without guarantee; 0 where the multiplicity is not `Simple`.
    pub slope: f64,
    /// Which stage decided.
    pub decided: Decided,
}

impl Root {
    /// The middle of the bracket.
    #[must_use]
    pub fn t(&self) -> f64 {
        self.lo + 0.5 * (self.hi - self.lo)
    }

    /// `1 / |ds/dt|`: how far the root moves per unit of error in s; infinite at tangents and stretches.
    #[must_use]
    pub fn conditioning(&self) -> f64 {
        1.0 / self.slope.abs()
    }

    /// Distance of t from the root, 0 inside its bracket or on its stretch.
    #[must_use]
    pub fn distance(&self, t: f64) -> f64 {
        let end = self.interval_end.unwrap_or(self.hi);
        (self.lo - t).max(t - end).max(0.0)
    }
}

/// The first hit of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// The first root, certified: it exists and none lies before it.
    Hit(Root),
    /// No root, certified.
    Miss {
        /// Which stage decided.
        decided: Decided,
    },
    /// Enclosures could not decide whether a root lies in `[lo, hi]`; none lies before. Only for analytic fields and mapped elements (and for rays
    /// that are not finite, with infinite ends).
    Unresolved {
        /// Start of the doubtful part.
        lo: f64,
        /// Its end.
        hi: f64,
    },
}

impl Answer {
    /// The hit, where there is one.
    #[must_use]
    pub fn hit(&self) -> Option<&Root> {
        match self {
            Self::Hit(r) => Some(r),
            _ => None,
        }
    }
}

/// All roots of a ray.
#[derive(Clone, Debug, PartialEq)]
pub struct AllRoots {
    /// The distinct roots, front to back.
    pub roots: Vec<Root>,
    /// Parts of the ray that could not be decided, front to back; empty for splines and polynomials.
    pub unresolved: Vec<(f64, f64)>,
    /// The last stage that was needed.
    pub decided: Decided,
}
