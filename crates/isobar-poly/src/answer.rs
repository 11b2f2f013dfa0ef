//! What a root search is asked and what it answers.

use crate::{MAX_DEGREE, Real};

/// How well and how long to search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance<T> {
    /// Wanted width of a root's bracket in t. A bracket is wider only where rounding (or `error`) hides the sign of p.
    pub width: T,
    /// How far the given Bernstein coefficients may be from the meant ones, absolute, at least 0. Answers then hold for every polynomial
    /// that close. 0: the coefficients are taken as exact.
    pub error: T,
    /// Most subdivisions before the search gives up. See [`Tolerance::SPLITS`].
    pub splits: u32,
}

impl<T: Real> Tolerance<T> {
    /// Default work limit, a fuse and not a knob: no test reaches it. (By Descartes' rule at most n cells of a level keep a sign change, and
    /// rounding ends the subdivision after some 50 levels.)
    pub const SPLITS: u32 = 4096;

    /// Exact coefficients, brackets of `width`.
    #[must_use]
    pub const fn new(width: T) -> Self {
        Self {
            width,
            error: T::ZERO,
            splits: Self::SPLITS,
        }
    }
}

/// What is known about a root.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RootKind {
    /// Proved: p has opposite signs at `lo` and `hi`, so an odd number of roots (with multiplicity) lies between. One simple root,
    /// unless the bracket is wider than the tolerance (a triple root, or three roots that rounding cannot part).
    Crossing,
    /// Proved: p is exactly zero at t = 0 or t = 1, which is `t` and one end of the bracket.
    End,
    /// Not proved: on the bracket p cannot be told from zero, and it has the same sign on both sides (or the bracket reaches an end of [0, 1]).
    /// A double root, two close roots, or a near miss; `|p|` there is at most a few times the error bound.
    Touching,
    /// p cannot be told from zero on all of [0, 1]: the zero polynomial, or one below `Tolerance::error`. The bracket is [0, 1].
    Interval,
}

/// A root of p in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Root<T> {
    /// Lower end of the bracket.
    pub lo: T,
    /// Upper end of the bracket, at least `lo`.
    pub hi: T,
    /// Best estimate, in [lo, hi].
    pub t: T,
    /// What is proved.
    pub kind: RootKind,
}

/// Answer to "where is the first root in [0, 1]?".
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum First<T> {
    /// Proved: p has no root in [0, 1].
    None,
    /// The first root; proved that there is none in [0, lo).
    Root(Root<T>),
    /// The search ended early: none in [0, at), nothing is known from there on. Only for coefficients that are not finite, for an
    /// unsupported number of coefficients (none, or more than [`MAX_DEGREE`] + 1), or at the work limit.
    GaveUp {
        /// Where the search stopped.
        at: T,
    },
}

impl<T: Real> First<T> {
    /// The root, if there is one.
    #[must_use]
    pub fn root(&self) -> Option<&Root<T>> {
        match self {
            Self::Root(r) => Some(r),
            _ => None,
        }
    }
}

/// All roots in [0, 1], ascending, brackets disjoint (they may share an end), stored in place.
#[derive(Clone, Copy, Debug)]
pub struct Roots<T> {
    items: [Root<T>; MAX_DEGREE + 1],
    len: usize,
    gave_up: Option<T>,
}

impl<T: Real> Roots<T> {
    pub(crate) fn new() -> Self {
        let none = Root {
            lo: T::ZERO,
            hi: T::ZERO,
            t: T::ZERO,
            kind: RootKind::Touching,
        };
        Self {
            items: [none; MAX_DEGREE + 1],
            len: 0,
            gave_up: None,
        }
    }

    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.len = 0;
        self.gave_up = None;
    }

    pub(crate) fn give_up(&mut self, at: T) {
        self.gave_up = Some(at);
    }

    /// The roots found, ascending. Outside of their brackets (and before [`Roots::gave_up`]) there is proved to be none.
    #[must_use]
    pub fn as_slice(&self) -> &[Root<T>] {
        &self.items[..self.len]
    }

    /// Where the search ended early, if it did (see [`First::GaveUp`]).
    #[must_use]
    pub fn gave_up(&self) -> Option<T> {
        self.gave_up
    }
}

/// No roots.
impl<T: Real> Default for Roots<T> {
    fn default() -> Self {
        Self::new()
    }
}

/// Takes roots as the search meets them, left to right.
pub(crate) trait Collect<T> {
    /// Stores a root; true if the search may end here.
    fn take(&mut self, root: Root<T>) -> bool;
}

impl<T: Real> Collect<T> for Option<Root<T>> {
    #[inline(always)]
    fn take(&mut self, root: Root<T>) -> bool {
        *self = Some(root);
        true
    }
}

impl<T: Real> Collect<T> for Roots<T> {
    #[inline(always)]
    fn take(&mut self, root: Root<T>) -> bool {
        if self.len == self.items.len() {
            // Cannot happen: brackets are parted by extrema of p. If it did, the answer must not look complete.
            self.gave_up = Some(root.lo);
            return true;
        }
        self.items[self.len] = root;
        self.len += 1;
        false
    }
}
