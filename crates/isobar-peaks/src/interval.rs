//! Sets of values.

/// Closed intervals, ascending and disjoint.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Intervals(Vec<(f64, f64)>);

impl Intervals {
    /// The union of `of`, each grown by `margin` on both sides.
    pub(crate) fn new(of: impl IntoIterator<Item = (f64, f64)>, margin: f64) -> Self {
        let mut all: Vec<_> = of.into_iter().map(|(lo, hi)| (lo - margin, hi + margin)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut out: Vec<(f64, f64)> = Vec::new();
        for (lo, hi) in all {
            match out.last_mut() {
                Some(last) if lo <= last.1 => last.1 = last.1.max(hi),
                _ => out.push((lo, hi)),
            }
        }
        Self(out)
    }

    /// Whether a value of the set lies in [lo, hi].
    #[inline(always)]
    pub(crate) fn meets(&self, lo: f64, hi: f64) -> bool {
        if self.0.len() <= 4 {
            return self.0.iter().any(|&(a, b)| a <= hi && b >= lo);
        }
        let first = self.0.partition_point(|i| i.1 < lo);
        self.0.get(first).is_some_and(|i| i.0 <= hi)
    }

    /// The intervals.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.0.iter().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unions_are_joined_and_searched() {
        let i = Intervals::new([(3.0, 4.0), (0.0, 1.0), (0.5, 2.0)], 0.0);
        assert_eq!(i.iter().collect::<Vec<_>>(), [(0.0, 2.0), (3.0, 4.0)]);
        assert!(i.meets(2.0, 2.5) && i.meets(-1.0, 9.0) && !i.meets(2.1, 2.9) && !i.meets(5.0, 6.0));
        let many = Intervals::new((0..20).map(|k| (f64::from(k), f64::from(k) + 0.25)), 0.125);
        for k in 0..19 {
            let x = f64::from(k);
            assert!(many.meets(x + 0.3, x + 0.3) && !many.meets(x + 0.4, x + 0.8) && many.meets(x + 0.5, x + 0.9));
        }
        assert!(!Intervals::default().meets(f64::NEG_INFINITY, f64::INFINITY));
    }
}
