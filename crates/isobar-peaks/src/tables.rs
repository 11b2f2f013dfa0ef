//! The tables over pairs of values at the ends of a ray segment.
//!
//! [`PeakTable`]: which peaks may lie on the segment, in the order met (Knoll et al. 2009, section 4.1). [`SegmentTable`]: the comparator, optical depth and colour of the
//! segment (Engel et al. 2001), with the weights of Lum et al. 2004. [`Lookup`]: the one-dimensional transfer function of section 6, 8192 entries.

use crate::medium::{Medium, Sums};
use isobar_cpu::packet::{LANES, Lanes};

/// Peaks a segment can hold.
pub const MOST_PEAKS: usize = 4;

/// No peak: the flag outside of all peaks.
pub const NO_PEAK: u8 = u8::MAX;

/// Bins of equal width over a range of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bins {
    lo: f64,
    per_value: f64,
    width: f64,
    count: usize,
}

impl Bins {
    /// `count` bins over [lo, hi]; all values fall into the first where the range is empty.
    #[must_use]
    pub fn new((lo, hi): (f64, f64), count: usize) -> Self {
        let range = hi - lo;
        Self {
            lo,
            per_value: if range > 0.0 { count as f64 / range } else { 0.0 },
            width: range / count as f64,
            count,
        }
    }

    /// The bin of a value, clamped.
    #[must_use]
    #[inline(always)]
    pub fn of(&self, value: f64) -> usize {
        // `as` sends what is below, and NaN, to 0.
        (((value - self.lo) * self.per_value) as usize).min(self.count - 1)
    }

    /// [`Bins::of`] eight values.
    #[inline(always)]
    pub(crate) fn of_eight<S: Lanes>(&self, values: S) -> [u32; LANES] {
        let mut x = [0.0; LANES];
        values.sub(S::splat(self.lo)).mul(S::splat(self.per_value)).store(&mut x);
        let last = self.count as i32 - 1;
        let mut out = [0; LANES];
        for (out, x) in out.iter_mut().zip(x) {
            *out = (x as i32).clamp(0, last) as u32;
        }
        out
    }

    /// The value in the middle of a bin.
    #[must_use]
    pub fn middle(&self, bin: usize) -> f64 {
        self.lo + (bin as f64 + 0.5) * self.width
    }

    /// Bins per unit of the value.
    #[cfg(feature = "gpu")]
    pub(crate) const fn per_value(&self) -> f64 {
        self.per_value
    }

    /// Number of bins.
    #[must_use]
    pub const fn count(&self) -> usize {
        self.count
    }
}

/// Which entries of a [`PeakTable`] name a peak.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// The letter of section 4.1: a bin stands for the value in its middle, and a segment from i up to j has the peaks v with i < v <= j (downward j < v <= i). A
    /// peak between two values of one bin, or of neighbouring bins, can be passed.
    Printed,
    /// All peaks of the bins touched: none is passed for want of a bin, and the rule of signs drops those that are not there.
    Covering,
}

/// For each pair of bins at entry and exit of a segment, up to four peaks in the order met, [`NO_PEAK`] from the end of the list on.
#[derive(Debug, Clone, PartialEq)]
pub struct PeakTable {
    bins: Bins,
    entries: Vec<[u8; MOST_PEAKS]>,
    crowded: usize,
    dropped: usize,
}

impl PeakTable {
    /// For ascending peak values, at most 255 of them, of which at most `most` (up to four) are kept per segment. Time bins^2.
    #[must_use]
    pub fn new(values: &[f64], bins: Bins, reach: Reach, most: usize) -> Self {
        let n = bins.count();
        let most = most.min(MOST_PEAKS);
        let half = 0.5 * bins.width;
        let mut entries = vec![[NO_PEAK; MOST_PEAKS]; n * n];
        let mut dropped = 0;
        for i in 0..n {
            for j in 0..n {
                let (low, high) = (bins.middle(i.min(j)), bins.middle(i.max(j)));
                let first_to_last = match reach {
                    Reach::Printed => values.partition_point(|v| *v <= low)..values.partition_point(|v| *v <= high),
                    Reach::Covering => {
                        // The outermost bins hold whatever lies beyond them; bins are rounded, on the GPU to single precision, so edges reach over.
                        let slack = 1e-3 * bins.width;
                        let from = if i.min(j) == 0 {
                            0
                        } else {
                            values.partition_point(|v| *v < low - half - slack)
                        };
                        let to = if i.max(j) + 1 == n {
                            values.len()
                        } else {
                            values.partition_point(|v| *v <= high + half + slack)
                        };
                        from..to
                    }
                };
                let entry = &mut entries[i * n + j];
                let len = first_to_last.len();
                dropped += usize::from(len > most);
                for (k, slot) in entry.iter_mut().enumerate().take(len.min(most)) {
                    *slot = if i <= j {
                        first_to_last.start + k
                    } else {
                        first_to_last.end - 1 - k
                    } as u8;
                }
            }
        }
        let crowded = values.windows(2).filter(|w| bins.of(w[0]) == bins.of(w[1])).count();
        Self {
            bins,
            entries,
            crowded,
            dropped,
        }
    }

    /// The peaks that may lie on a segment from value `a` to value `b`.
    #[must_use]
    #[inline(always)]
    pub fn peaks(&self, a: f64, b: f64) -> [u8; MOST_PEAKS] {
        self.entries[self.bins.of(a) * self.bins.count() + self.bins.of(b)]
    }

    /// The same from the bins of both values.
    #[inline(always)]
    pub(crate) fn between(&self, a: u32, b: u32) -> [u8; MOST_PEAKS] {
        self.entries[a as usize * self.bins.count() + b as usize]
    }

    /// The bins of both axes.
    #[inline(always)]
    pub(crate) const fn bins(&self) -> &Bins {
        &self.bins
    }

    /// All entries, row by row of the entry's bin, the first peak in the lowest byte.
    #[cfg(feature = "gpu")]
    pub(crate) fn words(&self) -> Vec<u32> {
        self.entries.iter().map(|e| u32::from_le_bytes(*e)).collect()
    }

    /// Pairs of neighbouring peaks that share a bin.
    #[must_use]
    pub const fn crowded(&self) -> usize {
        self.crowded
    }

    /// Entries with more peaks than are kept: those farthest along the segment are dropped.
    #[must_use]
    pub const fn dropped(&self) -> usize {
        self.dropped
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(self.entries.as_slice())
    }
}

/// Mean extinction and colour of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Extinction per world length.
    pub extinction: f32,
    /// Linear RGB, weighted by extinction and by nearness to the entry: the part to be shaded there.
    pub front: [f32; 3],
    /// The rest, to be shaded at the exit. Without shading, front + back is the colour of Engel et al.
    pub back: [f32; 3],
}

/// The pre-integration table: mean extinction and colour for each pair of bins, read with bilinear interpolation. Self-attenuation inside a segment is left
/// out, so that one table serves steps of any length (the integral functions of Engel et al. 2001).
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentTable {
    bins: Bins,
    entries: Vec<Segment>,
}

impl SegmentTable {
    /// Time bins^2. The first moments, for the weights of Lum et al., come from the integral of K by Simpson's rule on each bin.
    #[must_use]
    pub fn new(medium: &Medium, bins: Bins) -> Self {
        let n = bins.count();
        let sums: Vec<Sums> = (0..n).map(|i| medium.sums(bins.middle(i))).collect();
        // First moments: integral of (value) times extinction times colour, by parts: v K(v) - integral of K. The integral of K by Simpson's rule on each bin.
        let mut integral = vec![[0.0f64; 3]; n];
        for i in 1..n {
            let (a, b) = (bins.middle(i - 1), bins.middle(i));
            let m = medium.sums(0.5 * (a + b));
            let area = |c: usize| (b - a) * (sums[i - 1].colour[c] + 4.0 * m.colour[c] + sums[i].colour[c]) / 6.0;
            integral[i] = std::array::from_fn(|c| integral[i - 1][c] + area(c));
        }
        let mut entries = Vec::with_capacity(n * n);
        for i in 0..n {
            for j in 0..n {
                entries.push(if i == j {
                    let (e, c) = medium.at(bins.middle(i));
                    let half = c.map(|x| (0.5 * x) as f32);
                    Segment {
                        extinction: e as f32,
                        front: half,
                        back: half,
                    }
                } else {
                    let (a, b) = (bins.middle(i), bins.middle(j));
                    let depth = sums[j].depth - sums[i].depth;
                    let whole = |c: usize| sums[j].colour[c] - sums[i].colour[c];
                    // integral over the segment of (v - a)/(b - a) d K = K(b) - (1/(b - a)) integral of K from a to b
                    let back = |c: usize| sums[j].colour[c] - (integral[j][c] - integral[i][c]) / (b - a);
                    let mean = |x: f64| if depth == 0.0 { 0.0 } else { (x / depth) as f32 };
                    Segment {
                        extinction: (depth / (b - a)) as f32,
                        front: std::array::from_fn(|c| mean(whole(c) - back(c))),
                        back: std::array::from_fn(|c| mean(back(c))),
                    }
                });
            }
        }
        Self { bins, entries }
    }

    /// The segment from value `a` to value `b`: extinction per world length, colour to be shaded at its entry, colour to be shaded at its exit.
    #[must_use]
    #[inline(always)]
    pub fn segment(&self, a: f64, b: f64) -> (f64, [f64; 3], [f64; 3]) {
        let n = self.bins.count;
        let place = |v: f64| {
            let x = ((v - self.bins.lo) * self.bins.per_value - 0.5).clamp(0.0, (n - 1) as f64);
            let i = (x as usize).min(n.saturating_sub(2));
            (i, x - i as f64)
        };
        let ((i, x), (j, y)) = (place(a), place(b));
        let next = usize::from(n > 1);
        let e = [
            (&self.entries[i * n + j], (1.0 - x) * (1.0 - y)),
            (&self.entries[i * n + j + next], (1.0 - x) * y),
            (&self.entries[(i + next) * n + j], x * (1.0 - y)),
            (&self.entries[(i + next) * n + j + next], x * y),
        ];
        let (mut extinction, mut front, mut back) = (0.0, [0.0; 3], [0.0; 3]);
        for (s, w) in e {
            // Colours are interpolated premultiplied, or an empty entry would darken its neighbours.
            let k = w * f64::from(s.extinction);
            extinction += k;
            for c in 0..3 {
                front[c] += k * f64::from(s.front[c]);
                back[c] += k * f64::from(s.back[c]);
            }
        }
        if extinction > 0.0 {
            let k = 1.0 / extinction;
            front = front.map(|c| c * k);
            back = back.map(|c| c * k);
        }
        (extinction, front, back)
    }

    /// The bins of both axes.
    #[cfg(feature = "gpu")]
    pub(crate) const fn bins(&self) -> &Bins {
        &self.bins
    }

    /// All entries, row by row of the entry's bin, each as (extinction, front) and (back, 0).
    #[cfg(feature = "gpu")]
    pub(crate) fn rows(&self) -> Vec<[f32; 4]> {
        let rows = self.entries.iter().flat_map(|s| {
            let ([a, b, c], [x, y, z]) = (s.front, s.back);
            [[s.extinction, a, b, c], [x, y, z, 0.0]]
        });
        rows.collect()
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(self.entries.as_slice())
    }
}

/// Entries of the one-dimensional transfer function.
pub const LOOKUP: usize = 8192;

/// The transfer function as a texture of [`LOOKUP`] entries, linear between.
#[derive(Debug, Clone, PartialEq)]
pub struct Lookup {
    lo: f64,
    per_value: f64,
    /// Extinction per world length times RGB, and alone.
    entries: Vec<[f32; 4]>,
}

impl Lookup {
    /// Samples the transfer function at equal distances over [lo, hi].
    #[must_use]
    pub fn new(medium: &Medium, (lo, hi): (f64, f64)) -> Self {
        let last = (LOOKUP - 1) as f64;
        let per_value = if hi > lo { last / (hi - lo) } else { 0.0 };
        let entries = (0..LOOKUP)
            .map(|i| {
                let (e, [r, g, b]) = medium.at(lo + i as f64 / last * (hi - lo));
                [e * r, e * g, e * b, e].map(|x| x as f32)
            })
            .collect();
        Self { lo, per_value, entries }
    }

    /// Extinction per world length and linear RGB at a value.
    #[must_use]
    #[inline(always)]
    pub fn at(&self, value: f64) -> (f64, [f64; 3]) {
        Self::parted(self.row_at(value))
    }

    /// What [`Lookup::parted`] takes.
    #[inline(always)]
    pub(crate) fn row_at(&self, value: f64) -> [f64; 4] {
        let x = ((value - self.lo) * self.per_value).clamp(0.0, (LOOKUP - 1) as f64);
        let i = (x as usize).min(LOOKUP - 2);
        self.row(i, x - i as f64)
    }

    /// Extinction and colour of a row.
    #[inline(always)]
    pub(crate) fn parted([r, g, b, e]: [f64; 4]) -> (f64, [f64; 3]) {
        let k = if e > 0.0 { 1.0 / e } else { 0.0 };
        (e, [r * k, g * k, b * k])
    }

    /// Between entry i and the next: extinction per world length times RGB, and alone.
    #[inline(always)]
    fn row(&self, i: usize, w: f64) -> [f64; 4] {
        let (p, q) = (&self.entries[i], &self.entries[i + 1]);
        let mut out = [0.0; 4];
        for c in 0..4 {
            out[c] = f64::from(p[c]) + w * (f64::from(q[c]) - f64::from(p[c]));
        }
        out
    }

    /// The rows, as [`Lookup::parted`] takes them, of the first `n` of eight values.
    #[inline(always)]
    pub(crate) fn rows_of_eight<S: Lanes>(&self, values: S, n: usize) -> [[f64; 4]; LANES] {
        let x = values.sub(S::splat(self.lo)).mul(S::splat(self.per_value));
        let x = x.max(S::splat(0.0)).min(S::splat((LOOKUP - 1) as f64));
        let mut at = [0.0; LANES];
        x.store(&mut at);
        let (mut first, mut whole) = ([0i32; LANES], [0.0; LANES]);
        for l in 0..LANES {
            first[l] = (at[l] as i32).min(LOOKUP as i32 - 2);
            whole[l] = f64::from(first[l]);
        }
        x.sub(S::load(&whole)).store(&mut at);
        let mut out = [[0.0; 4]; LANES];
        for l in 0..n {
            out[l] = self.row(first[l] as usize, at[l]);
        }
        out
    }

    /// Entries per unit of the value.
    #[cfg(feature = "gpu")]
    pub(crate) const fn per_value(&self) -> f64 {
        self.per_value
    }

    /// All entries: extinction per world length times RGB, and alone.
    #[cfg(feature = "gpu")]
    pub(crate) fn entries(&self) -> &[[f32; 4]] {
        &self.entries
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(self.entries.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::TransferFunction;

    fn table(values: &[f64], reach: Reach) -> PeakTable {
        PeakTable::new(values, Bins::new((0.0, 1.0), 128), reach, 4)
    }

    #[test]
    fn peaks_come_in_the_order_met() {
        for reach in [Reach::Printed, Reach::Covering] {
            let t = table(&[0.1, 0.3, 0.5, 0.7, 0.9], reach);
            assert_eq!(t.peaks(0.05, 0.4), [0, 1, NO_PEAK, NO_PEAK]);
            assert_eq!(t.peaks(0.4, 0.05), [1, 0, NO_PEAK, NO_PEAK]);
            assert_eq!(t.peaks(0.15, 0.2), [NO_PEAK; 4]);
            // hardcases E10: the fifth is dropped, the farthest one
            assert_eq!(t.peaks(0.0, 1.0), [0, 1, 2, 3]);
            assert_eq!(t.peaks(1.0, 0.0), [4, 3, 2, 1]);
            assert!(t.dropped() > 0 && t.crowded() == 0);
        }
    }

    #[test]
    fn the_printed_table_passes_peaks_within_a_bin() {
        // both values in the bin of the peak, one on each side of it
        let v = 64.5 / 128.0;
        assert_eq!(table(&[v], Reach::Printed).peaks(v - 1e-3, v + 1e-3), [NO_PEAK; 4]);
        assert_eq!(table(&[v], Reach::Covering).peaks(v - 1e-3, v + 1e-3)[0], 0);
        assert_eq!(table(&[v, v + 1e-4], Reach::Printed).crowded(), 1);
    }

    fn medium() -> Medium {
        let points = vec![
            (0.0, [1.0, 0.0, 0.0], 0.0),
            (0.4, [1.0, 0.5, 0.0], 2.0),
            (0.6, [0.0, 0.5, 1.0], 0.5),
            (1.0, [0.0, 0.0, 1.0], 4.0),
        ];
        Medium::new(&TransferFunction::new(points, 0.5).unwrap())
    }

    /// Front and back weights against sums of many steps.
    #[test]
    fn segments_are_integrals() {
        let m = medium();
        let bins = Bins::new((0.0, 1.0), 64);
        let t = SegmentTable::new(&m, bins);
        for (i, j) in [(3, 50), (50, 3), (20, 21), (10, 10), (0, 63)] {
            let (a, b) = (bins.middle(i), bins.middle(j));
            let (mut depth, mut front, mut back) = (0.0, 0.0, 0.0);
            let n = 20_000;
            for k in 0..n {
                let s = (f64::from(k) + 0.5) / f64::from(n);
                let (e, c) = m.at(a + s * (b - a));
                depth += e / f64::from(n);
                front += (1.0 - s) * e * c[0] / f64::from(n);
                back += s * e * c[0] / f64::from(n);
            }
            let (e, f, g) = t.segment(a, b);
            assert!((e - depth).abs() < 1e-5 * depth, "{i} {j}: {e} {depth}");
            assert!(
                (f[0] - front / depth).abs() < 1e-4 && (g[0] - back / depth).abs() < 1e-4,
                "{i} {j}"
            );
        }
    }

    #[test]
    fn the_lookup_is_the_function_where_it_is_smooth() {
        let m = medium();
        let l = Lookup::new(&m, (0.0, 1.0));
        for i in 0..=100 {
            let v = f64::from(i) / 100.0;
            let ((e, c), (f, d)) = (l.at(v), m.at(v));
            assert!((e - f).abs() < 2e-3 && (e * c[1] - f * d[1]).abs() < 2e-3, "{v}");
        }
        assert_eq!(l.at(-1.0), l.at(0.0));
    }
}
