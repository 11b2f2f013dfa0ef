//! Histogram of the samples and the isovalues it suggests.

use serde::Serialize;

/// Counts in even bins.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Histogram {
    /// Lower end of the first bin. For integer samples the ends of all bins end in .5.
    pub lo: f64,
    /// Width of a bin; a whole number for integer samples.
    pub width: f64,
    /// Finite samples per bin.
    pub counts: Vec<u64>,
}

/// Most bins.
const BINS: usize = 256;

impl Histogram {
    /// Of the finite ones of `values`, which all lie in `range` `(min, max)`. Integer data get bins of a whole width whose ends end
    /// in .5, at most 256; other data 256 bins from min to max. All values equal: one bin.
    #[must_use]
    pub fn new(values: impl Iterator<Item = f64>, range: (f64, f64), integer: bool) -> Self {
        let (min, max) = range;
        let (lo, width, n) = if integer {
            let width = ((max - min + 1.0) / BINS as f64).ceil().max(1.0);
            (min - 0.5, width, ((max - min + 1.0) / width).ceil() as usize)
        } else if max > min {
            (min, (max - min) / BINS as f64, BINS)
        } else {
            (min, 1.0, 1)
        };
        let mut out = Self {
            lo,
            width,
            counts: vec![0; n.clamp(1, BINS)],
        };
        values.for_each(|v| out.add(v));
        out
    }

    /// Counts a value; NaN and infinite ones are left out, others outside the range go to the nearer end.
    pub fn add(&mut self, value: f64) {
        if value.is_finite() {
            let bin = ((value - self.lo) / self.width) as usize;
            let last = self.counts.len() - 1;
            self.counts[bin.min(last)] += 1;
        }
    }

    /// Upper end of a bin.
    #[must_use]
    pub fn upper(&self, bin: usize) -> f64 {
        self.lo + (bin + 1) as f64 * self.width
    }

    /// Suggested isovalues, ascending: the borders that Otsu's criterion (greatest variance between classes) puts between two classes
    /// of samples, and the two between three classes. Borders are ends of bins, so they end in .5 for integer data and never hit a
    /// sample there. Fewer where borders coincide; none where all samples are equal.
    #[must_use]
    pub fn suggest(&self) -> Vec<f64> {
        let mut borders: Vec<usize> = self.otsu().into_iter().collect();
        borders.extend(self.otsu_three().into_iter().flatten());
        borders.sort_unstable();
        borders.dedup();
        borders.into_iter().map(|b| self.upper(b)).collect()
    }

    /// Prefix sums of count and of count * bin.
    fn sums(&self) -> (Vec<f64>, Vec<f64>) {
        let (mut n, mut m) = (0.0, 0.0);
        self.counts
            .iter()
            .enumerate()
            .map(|(i, &c)| {
                n += c as f64;
                m += c as f64 * i as f64;
                (n, m)
            })
            .unzip()
    }

    /// The bin after which two classes part. In a gap every border is equally good: the middle of the gap is taken.
    fn otsu(&self) -> Option<usize> {
        let (n, m) = self.sums();
        let last = self.counts.len() - 1;
        let (total, sum) = (n[last], m[last]);
        let score = |b: usize| class(n[b], m[b]) + class(total - n[b], sum - m[b]);
        let best = (0..last)
            .filter(|&b| n[b] > 0.0 && n[b] < total)
            .max_by(|&a, &b| score(a).total_cmp(&score(b)))?;
        let gap_start = (0..=best).rev().find(|&b| self.counts[b] > 0)?;
        let gap_end = (best + 1..=last).find(|&b| self.counts[b] > 0)?;
        Some((gap_start + gap_end - 1) / 2)
    }

    /// The two bins after which three classes part.
    fn otsu_three(&self) -> Option<[usize; 2]> {
        let (n, m) = self.sums();
        let last = self.counts.len() - 1;
        let (total, sum) = (n[last], m[last]);
        let mut best: Option<([usize; 2], f64)> = None;
        for a in 0..last {
            for b in a + 1..last {
                let (middle, upper) = (n[b] - n[a], total - n[b]);
                if n[a] == 0.0 || middle == 0.0 || upper == 0.0 {
                    continue;
                }
                let score = class(n[a], m[a]) + class(middle, m[b] - m[a]) + class(upper, sum - m[b]);
                if best.is_none_or(|(_, s)| score > s) {
                    best = Some(([a, b], score));
                }
            }
        }
        best.map(|(b, _)| b)
    }

    /// Bars for people, about 16 rows, each `lower..upper count bar`; lengths on a logarithmic scale, because one value often has most
    /// of the samples.
    #[must_use]
    pub fn bars(&self) -> String {
        let group = self.counts.len().div_ceil(16);
        let rows: Vec<(usize, u64)> = self.counts.chunks(group).map(|c| c.iter().sum()).enumerate().collect();
        let top = rows.iter().map(|r| r.1).max().unwrap_or(0).max(1);
        let end = |bin: usize| crate::settings::short(self.lo + bin.min(self.counts.len()) as f64 * self.width);
        rows.iter()
            .map(|&(i, count)| {
                let length = (40.0 * ((1 + count) as f64).ln() / ((1 + top) as f64).ln()).round() as usize;
                format!(
                    "  {:>12} .. {:<12} {count:>12} {}\n",
                    end(i * group),
                    end((i + 1) * group),
                    "#".repeat(length)
                )
            })
            .collect()
    }
}

/// Weight of a class in Otsu's criterion: n * mean^2.
fn class(n: f64, sum: f64) -> f64 {
    if n > 0.0 { sum * sum / n } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integer_borders_end_in_a_half() {
        let values = [3.0; 50].into_iter().chain([9.0; 30]).chain([200.0; 20]);
        let h = Histogram::new(values, (3.0, 200.0), true);
        assert_eq!((h.lo, h.width, h.counts.len()), (2.5, 1.0, 198));
        assert_eq!(h.counts.iter().sum::<u64>(), 100);
        let s = h.suggest();
        assert!(!s.is_empty() && s.iter().all(|v| (v - 0.5).fract() == 0.0), "{s:?}");
        assert!(
            s.iter().any(|v| (9.5..200.0).contains(v)) && s.iter().any(|v| (3.0..9.0).contains(v)),
            "{s:?}"
        );
    }

    #[test]
    fn wide_integers_share_bins() {
        let h = Histogram::new([0.0, 65_535.0].into_iter(), (0.0, 65_535.0), true);
        assert_eq!((h.width, h.counts.len()), (256.0, 256));
        assert_eq!((h.counts[0], h.counts[255]), (1, 1));
        assert_eq!(h.suggest()[0].fract(), 0.5);
    }

    #[test]
    fn reals_and_constants_do_not_fail() {
        let h = Histogram::new([0.25, f64::NAN, 0.75].into_iter(), (0.25, 0.75), false);
        assert_eq!(h.counts.iter().sum::<u64>(), 2);
        let s = h.suggest();
        assert!(
            s.iter().all(|v| (0.25..=0.75).contains(v)) && s.iter().any(|v| (v - 0.5).abs() < 0.01),
            "{s:?}"
        );
        let h = Histogram::new([5.0, 5.0].into_iter(), (5.0, 5.0), true);
        assert_eq!((h.counts.as_slice(), h.suggest()), ([2].as_slice(), vec![]));
        assert_eq!(
            Histogram::new([1.5].into_iter(), (1.5, 1.5), false).suggest(),
            Vec::<f64>::new()
        );
        assert!(h.bars().contains('#'));
    }
}
