//! Halving by Sturm's chain in power form (thesis, section 3.2.4 and Listing A.4).

use isobar_poly::Real;

/// The chain: p, p', then the negated remainders, each scaled by its largest coefficient. Row i has `degree[i]` + 1 coefficients.
struct Chain<T, const M: usize> {
    rows: [[T; M]; M],
    degree: [usize; M],
    len: usize,
}

/// Degree by the last coefficient that is not zero; `None` for all zero.
#[inline(always)]
fn degree<T: Real>(a: &[T]) -> Option<usize> {
    a.iter().rposition(|x| *x != T::ZERO)
}

impl<T: Real, const M: usize> Chain<T, M> {
    #[inline(always)]
    fn new(a: &[T; M]) -> Option<Self> {
        let mut chain = Self {
            rows: [[T::ZERO; M]; M],
            degree: [0; M],
            len: 1,
        };
        chain.rows[0] = *a;
        chain.degree[0] = degree(a)?;
        let n = chain.degree[0];
        if n == 0 {
            return Some(chain);
        }
        for (i, c) in a.iter().enumerate().take(n + 1).skip(1) {
            chain.rows[1][i - 1] = *c * T::from_f64(i as f64);
        }
        (chain.degree[1], chain.len) = (n - 1, 2);
        while chain.len < M && chain.degree[chain.len - 1] > 0 {
            let Some((row, n)) = chain.remainder() else { break };
            (chain.rows[chain.len], chain.degree[chain.len]) = (row, n);
            chain.len += 1;
        }
        Some(chain)
    }

    /// The negated remainder of the last two rows; `None` where it vanishes: the last row is the greatest common divisor.
    #[inline(always)]
    fn remainder(&self) -> Option<([T; M], usize)> {
        let (i, j) = (self.len - 2, self.len - 1);
        let (mut r, n) = (self.rows[i], self.degree[j]);
        let divisor = &self.rows[j];
        for k in (n..=self.degree[i]).rev() {
            let q = r[k] / divisor[n];
            for l in 0..n {
                r[k - n + l] -= q * divisor[l];
            }
            r[k] = T::ZERO;
        }
        let most = r.iter().fold(T::ZERO, |m, x| m.larger(x.abs()));
        let degree = degree(&r)?;
        for x in &mut r {
            *x = -(*x / most);
        }
        Some((r, degree))
    }

    /// Changes of sign along the chain at x, zeros skipped.
    #[inline(always)]
    fn changes(&self, x: T) -> u32 {
        let (mut changes, mut last) = (0, T::ZERO);
        for (row, n) in self.rows[..self.len].iter().zip(&self.degree) {
            let value = row[..=*n].iter().rev().fold(T::ZERO, |v, c| v * x + *c);
            if value != T::ZERO {
                changes += u32::from((value < T::ZERO) != (last < T::ZERO) && last != T::ZERO);
                last = value;
            }
        }
        changes
    }
}

/// First root on (0, 1] of the polynomial with power coefficients `a`, lowest first: Sturm's theorem counts the roots, `halvings` halvings close in on
/// the first. **No guarantee**: in exact arithmetic the count is right, also at multiple roots, but the signs of a chain of rounded
/// remainders are not, least of all near a root of the chain; the error of the answer is at most 2^-(halvings + 1) otherwise.
///
/// Corrected against the listing (maths, section B; the inventory's errata): a zero in the chain is skipped when signs are compared (the product of neighbours
/// loses the change in +, 0, -); `rootpos` is set, to the middle of the last interval. Filled in: `calcStrumSeries`, which is not given. Its rows need not
/// lose one degree each: the chain ends where a remainder is exactly zero, and rows are scaled by a positive number.
#[must_use]
pub fn sturm<T: Real, const M: usize>(a: &[T; M], halvings: u32) -> Option<T> {
    let chain = Chain::new(a)?;
    let (mut lo, mut hi) = (T::ZERO, T::ONE);
    let mut at_lo = chain.changes(lo);
    if at_lo == chain.changes(hi) {
        return None;
    }
    for _ in 0..halvings {
        let middle = T::HALF * (lo + hi);
        let changes = chain.changes(middle);
        if changes == at_lo {
            (lo, at_lo) = (middle, changes);
        } else {
            hi = middle;
        }
    }
    Some(T::HALF * (lo + hi))
}
