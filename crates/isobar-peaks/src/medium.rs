//! The transfer function made ready: its integrals over the value, so that a stretch along which the field is linear is integrated without a table.
//!
//! With the extinction r(f) and the colour c(f) piecewise linear in the value f, `T(f) = integral of r` is piecewise quadratic and `K(f) = integral of c r`
//! piecewise cubic. A stretch of length h along which f runs linearly from f0 to f1 has the optical depth `h (T(f1) - T(f0)) / (f1 - f0)`, exactly, and the
//! mean colour `(K(f1) - K(f0)) / (T(f1) - T(f0))`. That is the pre-integration of Engel et al. 2001 (their equation of integral functions) without its table: no
//! quantisation of values, so that a feature of any width counts in full.

use crate::interval::Intervals;
use isobar_core::TransferFunction;
use isobar_cpu::packet::Lanes;

/// T and the three K at a value.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sums {
    /// Integral of the extinction per world length over the value.
    pub depth: f64,
    /// Integral of extinction times linear RGB.
    pub colour: [f64; 3],
}

impl Sums {
    #[inline(always)]
    pub(crate) const fn lanes(&self) -> [f64; 4] {
        let [r, g, b] = self.colour;
        [self.depth, r, g, b]
    }
}

/// One linear piece, from its lower end on.
#[derive(Debug, Clone, Copy)]
struct Piece {
    value: f64,
    extinction: [f64; 2],
    colour: [[f64; 2]; 3],
    /// T and the three K as polynomials in the distance from the lower end: `[power][T, K, K, K]`, side by side so that four are evaluated as one.
    powers: [[f64; 4]; 4],
}

impl Piece {
    /// The piece from `value` on, with `before` the integrals up to there.
    fn new(value: f64, extinction: [f64; 2], colour: [[f64; 2]; 3], before: Sums) -> Self {
        let [r, s] = extinction;
        let mut powers = [before.lanes(), [r; 4], [0.5 * s; 4], [0.0; 4]];
        for (i, [c, d]) in colour.into_iter().enumerate() {
            powers[1][i + 1] = c * r;
            powers[2][i + 1] = 0.5 * (c * s + d * r);
            powers[3][i + 1] = d * s / 3.0;
        }
        Self {
            value,
            extinction,
            colour,
            powers,
        }
    }

    #[inline(always)]
    fn sums(&self, value: f64) -> Sums {
        let x = value - self.value;
        let [c0, c1, c2, c3] = &self.powers;
        let mut s = [0.0; 4];
        for i in 0..4 {
            s[i] = c0[i] + x * (c1[i] + x * (c2[i] + x * c3[i]));
        }
        Sums {
            depth: s[0],
            colour: [s[1], s[2], s[3]],
        }
    }
}

/// Buckets of the search for a value's piece.
const BUCKETS: usize = 1024;

/// A transfer function with its integrals.
#[derive(Debug, Clone)]
pub struct Medium {
    /// The first begins nowhere (constant), the last ends nowhere.
    pieces: Vec<Piece>,
    /// Per bucket of [first, last value], the piece its lower end is in.
    buckets: Vec<u32>,
    first: f64,
    per_bucket: f64,
    /// Rises below this part of the values' span lose too many digits in differences of T.
    small: f64,
    /// Width of the narrowest linear piece with extinction.
    narrowest: f64,
    support: Intervals,
}

impl Medium {
    /// Prepares a transfer function that [`TransferFunction::new`] accepts. Time linear in its points.
    ///
    /// # Panics
    /// When it has no points.
    #[must_use]
    pub fn new(tf: &TransferFunction) -> Self {
        let p = &tf.points;
        let (first, last) = (p[0], p[p.len() - 1]);
        let constant = |(value, colour, density): (f64, [f32; 3], f32), before| {
            let colour = colour.map(|c| [f64::from(c), 0.0]);
            Piece::new(value, [f64::from(density) / tf.unit, 0.0], colour, before)
        };
        let mut pieces = vec![constant(first, Sums::default())];
        let mut support = Vec::new();
        if first.2 > 0.0 {
            support.push((f64::NEG_INFINITY, first.0));
        }
        for w in p.windows(2) {
            let (a, b) = (w[0], w[1]);
            let width = b.0 - a.0;
            let line = |x: f64, y: f64| [x, (y - x) / width];
            let before = pieces[pieces.len() - 1].sums(a.0);
            pieces.push(Piece::new(
                a.0,
                line(f64::from(a.2) / tf.unit, f64::from(b.2) / tf.unit),
                std::array::from_fn(|i| line(a.1[i].into(), b.1[i].into())),
                before,
            ));
            if a.2 > 0.0 || b.2 > 0.0 {
                support.push((a.0, b.0));
            }
        }
        let before = pieces[pieces.len() - 1].sums(last.0);
        pieces.push(constant(last, before));
        if last.2 > 0.0 {
            support.push((last.0, f64::INFINITY));
        }
        let width = last.0 - first.0;
        let per_bucket = if width > 0.0 { BUCKETS as f64 / width } else { 0.0 };
        let mut at = 1;
        let buckets = (0..BUCKETS)
            .map(|i| {
                let value = first.0 + i as f64 * width / BUCKETS as f64;
                // One piece early, since the bucket of a value is rounded.
                while at + 2 < pieces.len() && pieces[at + 1].value <= value {
                    at += 1;
                }
                at.saturating_sub(1) as u32
            })
            .collect();
        let mut out = Self {
            pieces,
            buckets,
            first: first.0,
            per_bucket,
            small: 1e-9 * width,
            narrowest: 0.0,
            support: Intervals::new(support, 0.0),
        };
        out.narrowest = out.finest(f64::NEG_INFINITY, f64::INFINITY);
        // A point far outside the data makes the transfer function wide: no stretch that a piece with extinction cuts is flat for that.
        out.small = out.small.min(1e-3 * out.narrowest);
        out
    }

    /// Values with extinction, as closed intervals.
    #[must_use]
    pub(crate) fn support(&self) -> &Intervals {
        &self.support
    }

    #[inline(always)]
    fn piece(&self, value: f64) -> &Piece {
        // `as` sends what is below to 0 and NaN too.
        let bucket = (((value - self.first) * self.per_bucket) as usize).min(BUCKETS - 1);
        let mut i = self.buckets[bucket] as usize;
        while i + 1 < self.pieces.len() && self.pieces[i + 1].value <= value {
            i += 1;
        }
        &self.pieces[i]
    }

    /// T and K at a value.
    #[must_use]
    #[inline(always)]
    pub fn sums(&self, value: f64) -> Sums {
        self.piece(value).sums(value)
    }

    /// Extinction per world length and linear RGB at a value.
    #[must_use]
    #[inline(always)]
    pub fn at(&self, value: f64) -> (f64, [f64; 3]) {
        let p = self.piece(value);
        let x = if std::ptr::eq(p, &raw const self.pieces[0]) {
            0.0
        } else {
            value - p.value
        };
        let line = |[a, b]: [f64; 2]| a + x * b;
        (line(p.extinction), [line(p.colour[0]), line(p.colour[1]), line(p.colour[2])])
    }

    /// Whether values are so near one another that differences of T lose their digits: there the middle stands for all. Values far from 0 are not flat over a feature of the transfer function for
    /// that: they count by their distance, down to where they lose their own digits.
    #[inline(always)]
    fn is_flat(&self, a: f64, b: f64) -> bool {
        let size = a.abs() + b.abs();
        (b - a).abs() <= (1e-7 * size).min(1e-3 * self.narrowest).max(1e-13 * size) + self.small
    }

    /// The greatest |b - a| that is flat, of eight pairs.
    #[inline(always)]
    pub(crate) fn flat<S: Lanes>(&self, a: S, b: S) -> S {
        let size = a.abs().add(b.abs());
        let rounding = S::splat(1e-13).mul(size);
        let most = S::splat(1e-7).mul(size).min(S::splat(1e-3 * self.narrowest));
        most.max(rounding).add(S::splat(self.small))
    }

    /// Optical depth of a stretch of the given world length along which the field runs linearly from value `a` to `b`, with `sums` of both; and its
    /// mean colour. The depth is exact but for rounding; the colour leaves out attenuation inside the stretch (none where the colour is constant).
    #[must_use]
    #[inline(always)]
    pub fn stretch(&self, a: f64, b: f64, sums: [&Sums; 2], length: f64) -> (f64, [f64; 3]) {
        let depth = sums[1].depth - sums[0].depth;
        let rise = b - a;
        if self.is_flat(a, b) {
            let (r, c) = self.at(0.5 * (a + b));
            return (r * length, c);
        }
        if depth == 0.0 {
            return (0.0, [0.0; 3]);
        }
        let k = 1.0 / depth;
        let c = |i: usize| ((sums[1].colour[i] - sums[0].colour[i]) * k).clamp(0.0, 1.0);
        ((depth / rise * length).max(0.0), [c(0), c(1), c(2)])
    }
}

impl Medium {
    /// [`Medium::stretch`] with its opacity: optical depth, then the colour it adds (premultiplied), then its opacity. Two divisions, and an exponential only where it is thick.
    #[inline(always)]
    pub(crate) fn layer(&self, a: f64, b: f64, sums: [&Sums; 2], length: f64) -> (f64, [f64; 3], f64) {
        if self.is_flat(a, b) {
            let (r, c) = self.at(0.5 * (a + b));
            let depth = r * length;
            let o = opacity(depth);
            return (depth, c.map(|x| x * o), o);
        }
        let per = length / (b - a);
        let (from, to) = (sums[0].lanes(), sums[1].lanes());
        let depth = per * (to[0] - from[0]);
        // opacity / depth times per: what turns differences of the sums into colour and opacity.
        let k = per / thinned(depth);
        let d = |i: usize| (to[i] - from[i]) * k;
        (depth, [d(1), d(2), d(3)], d(0))
    }

    /// Width of the narrowest linear piece with extinction; +inf where there is none.
    #[inline(always)]
    pub(crate) const fn narrowest(&self) -> f64 {
        self.narrowest
    }

    /// The same of those that meet [lo, hi].
    #[inline(never)]
    pub(crate) fn finest(&self, lo: f64, hi: f64) -> f64 {
        let inner = &self.pieces[1..];
        let from = inner.partition_point(|p| p.value <= lo).saturating_sub(1);
        let meets = inner[from..].windows(2).take_while(|w| w[0].value <= hi);
        let visible = meets.filter(|w| w[0].extinction != [0.0; 2]);
        visible.map(|w| w[1].value - w[0].value).fold(f64::INFINITY, f64::min)
    }

    /// The value between `from` and `to`, which lie on one linear piece, up to which T changes by `change`, seen from `from`; `to` where it changes by less before that.
    pub(crate) fn after(&self, from: f64, to: f64, change: f64) -> f64 {
        let p = self.piece(0.5 * (from + to));
        let side = if to >= from { 1.0 } else { -1.0 };
        // The integral of r + s x from 0 to x is D.
        let (r, s) = (self.at_piece(p, from), side * p.extinction[1]);
        let d = change.abs();
        let x = 2.0 * d / (r + (r * r + 2.0 * s * d).max(0.0).sqrt());
        // What is not a number is not below.
        if x < (to - from).abs() { from + side * x } else { to }
    }

    /// Extinction of a piece at a value on it.
    fn at_piece(&self, p: &Piece, value: f64) -> f64 {
        let x = if std::ptr::eq(p, &raw const self.pieces[0]) {
            0.0
        } else {
            value - p.value
        };
        (p.extinction[0] + x * p.extinction[1]).max(0.0)
    }

    /// Cuts the run of values from `a` to `b` at the transfer function's points, in the order met.
    pub(crate) fn pieces_between(&self, a: f64, b: f64, mut each: impl FnMut(f64, f64)) {
        let rising = a <= b;
        let (low, high) = if rising { (a, b) } else { (b, a) };
        let inner = &self.pieces[1..];
        let from = inner.partition_point(|p| p.value <= low);
        let to = inner.partition_point(|p| p.value < high);
        let mut at = a;
        for i in 0..to.saturating_sub(from) {
            let next = inner[if rising { from + i } else { to - 1 - i }].value;
            each(at, next);
            at = next;
        }
        each(at, b);
    }
}

/// depth / (1 - exp(-depth)): by the series of `d/2 coth d/2`, whose next term is below 3e-11 of the result, where that is enough.
#[inline(always)]
fn thinned(depth: f64) -> f64 {
    if depth.abs() < 0.5 {
        let s = depth * depth;
        1.0 + 0.5 * depth + s * (1.0 / 12.0 - s * (1.0 / 720.0 - s * (1.0 / 30_240.0 - s * (1.0 / 1_209_600.0))))
    } else {
        depth / -(-depth).exp_m1()
    }
}

/// 1 - exp(-depth), without loss for thin stretches.
#[must_use]
#[inline(always)]
pub fn opacity(depth: f64) -> f64 {
    if depth < 1e-3 {
        // The next term is below 1e-14 of the depth.
        depth * (1.0 - depth * (0.5 - depth * (1.0 / 6.0 - depth * (1.0 / 24.0))))
    } else {
        1.0 - (-depth).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tf(points: &[(f64, [f32; 3], f32)], unit: f64) -> TransferFunction {
        TransferFunction::new(points.to_vec(), unit).unwrap()
    }

    /// T and K against sums of many small steps of core's evaluation.
    #[test]
    fn integrals_are_those_of_the_function() {
        let f = tf(
            &[
                (1.0, [0.2, 0.0, 1.0], 0.5),
                (2.0, [1.0, 0.5, 0.0], 2.0),
                (2.01, [0.0, 0.5, 0.5], 9.0),
                (2.02, [0.0, 0.0, 0.5], 0.0),
                (5.0, [0.3, 0.0, 0.0], 1.0),
            ],
            0.25,
        );
        let m = Medium::new(&f);
        let (mut depth, mut colour) = (0.0, [0.0; 3]);
        let n = 60_000;
        let (lo, hi) = (0.0, 6.0);
        let h = (hi - lo) / f64::from(n);
        let start = m.sums(lo);
        for i in 0..n {
            let v = lo + (f64::from(i) + 0.5) * h;
            let (c, density) = f.at(v);
            let (e, rgb) = m.at(v);
            assert!((e - density / 0.25).abs() < 1e-9 && (rgb[0] - c[0]).abs() < 1e-9, "at {v}");
            depth += e * h;
            for k in 0..3 {
                colour[k] += e * rgb[k] * h;
            }
            let s = m.sums(v + 0.5 * h);
            assert!((s.depth - start.depth - depth).abs() < 1e-4, "depth at {v}");
            assert!((s.colour[0] - start.colour[0] - colour[0]).abs() < 1e-4, "colour at {v}");
        }
    }

    #[test]
    fn a_stretch_has_its_exact_depth() {
        // hardcases E5: constant and linear extinction
        let m = Medium::new(&tf(&[(0.0, [1.0; 3], 2.0), (1.0, [1.0; 3], 2.0)], 1.0));
        let (d, c) = m.stretch(0.2, 0.9, [&m.sums(0.2), &m.sums(0.9)], 3.0);
        assert!((d - 6.0).abs() < 1e-12 && c == [1.0; 3]);
        let m = Medium::new(&tf(&[(0.0, [1.0; 3], 0.0), (1.0, [1.0; 3], 1.0)], 1.0));
        let (d, _) = m.stretch(0.9, 0.3, [&m.sums(0.9), &m.sums(0.3)], 2.0);
        assert!((d - 1.2).abs() < 1e-12);
        let (d, _) = m.stretch(0.4, 0.4, [&m.sums(0.4), &m.sums(0.4)], 2.0);
        assert!((d - 0.8).abs() < 1e-12);
        assert!((opacity(1e-5) - 9.999_950_000_166_665e-6).abs() < 1e-18);
        assert!((opacity(2.0) - (1.0 - (-2.0f64).exp())).abs() < 1e-15);
        for depth in [1e-9, 1e-3, 0.1, 0.4999, 0.5001, 3.0, 40.0] {
            assert!((depth / thinned(depth) / -(-depth).exp_m1() - 1.0).abs() < 1e-10, "{depth}");
        }
        assert_eq!(thinned(0.0), 1.0);
    }

    /// Both forms of a stretch are one, thick and thin, steep and flat.
    #[test]
    fn a_layer_is_a_stretch_with_its_opacity() {
        let m = Medium::new(&tf(
            &[(0.0, [0.9, 0.1, 0.3], 0.0), (1.0, [0.2, 0.5, 1.0], 3.0), (1.5, [1.0; 3], 0.5)],
            1.0,
        ));
        for (a, b) in [
            (0.1, 0.9),
            (1.4, 0.2),
            (0.5, 0.5),
            (0.5, 0.5 + 1e-12),
            (-1.0, 3.0),
            (2.0, 4.0),
        ] {
            for length in [1e-6, 0.03, 1.0, 20.0] {
                let sums = [&m.sums(a), &m.sums(b)];
                let ((d, c), (depth, colour, o)) = (m.stretch(a, b, sums, length), m.layer(a, b, sums, length));
                assert!((d - depth).abs() <= 1e-12 * d && (o - opacity(d)).abs() < 1e-9 * o + 1e-18);
                for (x, y) in c.iter().zip(colour) {
                    assert!((x * o - y).abs() < 1e-9, "{a} {b} {length}: {x} {y}");
                }
            }
        }
    }

    #[test]
    fn runs_of_values_are_cut_at_the_points() {
        let c = [0.0; 3];
        let m = Medium::new(&tf(&[(0.0, c, 0.0), (1.0, c, 1.0), (2.0, c, 0.0), (3.0, c, 0.0)], 1.0));
        let cut = |a: f64, b: f64| {
            let mut out = vec![a];
            m.pieces_between(a, b, |x, y| {
                assert_eq!(x, out[out.len() - 1]);
                out.push(y);
            });
            out
        };
        assert_eq!(cut(0.5, 2.5), [0.5, 1.0, 2.0, 2.5]);
        assert_eq!(cut(2.5, 0.5), [2.5, 2.0, 1.0, 0.5]);
        assert_eq!(cut(1.0, 2.0), [1.0, 2.0]);
        assert_eq!(cut(1.2, 1.4), [1.2, 1.4]);
        assert_eq!(cut(-5.0, 9.0), [-5.0, 0.0, 1.0, 2.0, 3.0, 9.0]);
        let m = Medium::new(&tf(&[(0.0, c, 1.0), (1.0, c, 1.0), (1.25, c, 0.0), (1.3, c, 0.0)], 1.0));
        assert_eq!(
            [m.finest(0.2, 0.4), m.finest(0.2, 1.1), m.finest(1.1, 9.0)],
            [1.0, 0.25, 0.25]
        );
        assert_eq!(m.finest(1.26, 9.0), f64::INFINITY);
        assert_eq!(m.narrowest(), 0.25);
    }

    /// Values far from 0 do not blur a narrow feature: a triangle of half width 0.2 among values from 8e6 on has the depth it has at 0.
    #[test]
    fn narrow_peaks_stay_far_from_zero() {
        let c = [1.0; 3];
        let at = |o: f64| Medium::new(&tf(&[(o + 4.8, c, 0.0), (o + 5.0, c, 1.0), (o + 5.2, c, 0.0)], 1.0));
        let depth = |m: &Medium, a: f64, b: f64| m.stretch(a, b, [&m.sums(a), &m.sums(b)], 1.0).0;
        let (near, far) = (at(0.0), at(8e6));
        for (a, b) in [(4.0, 6.0), (5.0, 6.0), (4.9, 5.1), (5.15, 4.0)] {
            let (x, y) = (depth(&near, a, b), depth(&far, 8e6 + a, 8e6 + b));
            // The values themselves are off by 2^-31.
            assert!(x > 0.0 && (x - y).abs() < 1e-6 * x, "{a} to {b}: {x} and {y}");
        }
    }

    /// A point far outside of the data does not blur what lies inside.
    #[test]
    fn wide_transfer_functions_keep_their_narrow_peaks() {
        let c = [1.0; 3];
        let peak = [(37.995, c, 0.0), (38.25, c, 1.0), (38.505, c, 0.0)];
        let alone = Medium::new(&tf(&peak, 1.0));
        let wide = Medium::new(&tf(&[peak[0], peak[1], peak[2], (1e9, c, 0.0)], 1.0));
        for (a, b) in [(37.9, 38.3), (38.0, 38.6), (38.2, 38.3)] {
            assert_eq!(wide.is_flat(a, b), alone.is_flat(a, b), "{a} to {b}");
            assert!(!wide.is_flat(a, b));
        }
    }

    #[test]
    fn a_single_point_is_constant() {
        let m = Medium::new(&tf(&[(3.0, [0.5; 3], 0.7)], 2.0));
        assert_eq!(m.at(-10.0), (0.35_f32.into(), [0.5; 3]));
        assert!((m.sums(5.0).depth - m.sums(1.0).depth - 1.4).abs() < 1e-6);
        assert!(m.support().meets(-1e9, -1e8));
    }

    #[test]
    fn support_is_where_there_is_extinction() {
        let m = Medium::new(&tf(
            &[
                (0.0, [0.0; 3], 0.0),
                (1.0, [0.0; 3], 1.0),
                (2.0, [0.0; 3], 0.0),
                (3.0, [0.0; 3], 0.0),
            ],
            1.0,
        ));
        assert!(m.support().meets(0.5, 0.6) && m.support().meets(1.5, 9.0));
        assert!(!m.support().meets(2.5, 9.0) && !m.support().meets(-3.0, -0.1));
    }
}
