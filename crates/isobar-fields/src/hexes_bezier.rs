//! Bernstein and B-spline algebra of one parametric axis, over any field of numbers, and tensors of coefficients to use it on.
//!
//! Everything is generic over [`Number`], so that the same code runs in f64 and, in tests, in exact fractions. Sources: Martin, Cohen, Kirby 2011,
//! sections 2.1 (B-splines), 4.3 (products by Bezier multiplication) and 5.3 (blossoming, equation 27); the blossom and knot insertion as in
//! Boehm 1980 and Ramshaw 1989.

use std::ops::{Add, Div, Mul, Sub};

/// What coefficients are made of: a field.
pub trait Number: Clone + PartialEq + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    /// A whole number.
    fn whole(n: i64) -> Self;
}

impl Number for f64 {
    fn whole(n: i64) -> Self {
        n as Self
    }
}

/// `n` over `k`; 0 where `k > n`. Exact up to n = 61.
#[must_use]
pub const fn binomial(n: usize, k: usize) -> i64 {
    if k > n {
        return 0;
    }
    let mut out = 1;
    let mut i = 0;
    while i < k {
        out = out * (n - i) as i64 / (i as i64 + 1);
        i += 1;
    }
    out
}

/// Bernstein coefficients of the two halves of the domain cut at `t` (de Casteljau); the last of the left is the first of the right.
#[must_use]
pub fn split<T: Number>(c: &[T], t: &T) -> (Vec<T>, Vec<T>) {
    let mut right = c.to_vec();
    let mut left = Vec::with_capacity(c.len());
    for n in (0..c.len()).rev() {
        left.push(right[0].clone());
        for i in 0..n {
            right[i] = right[i].clone() + (right[i + 1].clone() - right[i].clone()) * t.clone();
        }
    }
    (left, right)
}

/// The same polynomial with a degree one higher.
#[must_use]
pub fn elevate<T: Number>(c: &[T]) -> Vec<T> {
    let d = c.len();
    (0..=d)
        .map(|i| {
            let (left, right) = (T::whole(i as i64), T::whole((d - i) as i64));
            match i {
                0 => c[0].clone(),
                _ if i == d => c[d - 1].clone(),
                _ => (left * c[i - 1].clone() + right * c[i].clone()) / T::whole(d as i64),
            }
        })
        .collect()
}

/// Bernstein coefficients of the derivative by the parameter; a single 0 of a constant.
#[must_use]
pub fn derivative<T: Number>(c: &[T]) -> Vec<T> {
    if c.len() == 1 {
        return vec![T::whole(0)];
    }
    let d = T::whole(c.len() as i64 - 1);
    c.windows(2).map(|w| (w[1].clone() - w[0].clone()) * d.clone()).collect()
}

/// Bernstein coefficients, degree `d >= a`, of the monomial `x^a` with `x = lo + (hi - lo) u`: its blossom at lo, ..., hi, ... (equation 27).
///
/// # Panics
/// When `d < a`.
#[must_use]
pub fn monomial<T: Number>(a: usize, d: usize, lo: &T, hi: &T) -> Vec<T> {
    assert!(d >= a, "x^{a} has no Bernstein form of degree {d}");
    let power = |x: &T, n: usize| (0..n).fold(T::whole(1), |p, _| p * x.clone());
    (0..=d)
        .map(|j| {
            let sum = (0..=a).fold(T::whole(0), |s, m| {
                let ways = binomial(j, m) * binomial(d - j, a - m);
                if ways == 0 {
                    s
                } else {
                    s + T::whole(ways) * power(hi, m) * power(lo, a - m)
                }
            });
            sum / T::whole(binomial(d, a))
        })
        .collect()
}

/// The Bernstein coefficients of the polynomial through values at distinct `nodes` of [0, 1]: row j gives coefficient j as weights of the values.
/// `None` where nodes coincide.
#[must_use]
pub fn interpolation<T: Number>(nodes: &[T]) -> Option<Vec<Vec<T>>> {
    let n = nodes.len();
    let d = n.checked_sub(1)?;
    let zero = T::whole(0);
    let power = |x: &T, n: usize| (0..n).fold(T::whole(1), |p, _| p * x.clone());
    // Rows: collocation matrix, then the unit matrix; Gauss-Jordan with the first pivot that is not zero.
    let mut rows: Vec<Vec<T>> = nodes
        .iter()
        .enumerate()
        .map(|(i, x)| {
            let one_less = T::whole(1) - x.clone();
            let basis = (0..n).map(|j| T::whole(binomial(d, j)) * power(x, j) * power(&one_less, d - j));
            basis.chain((0..n).map(|k| T::whole(i64::from(k == i)))).collect()
        })
        .collect();
    for col in 0..n {
        let pivot = (col..n).find(|&r| rows[r][col] != zero)?;
        rows.swap(col, pivot);
        let scale = rows[col][col].clone();
        rows[col].iter_mut().for_each(|v| *v = v.clone() / scale.clone());
        let lead = rows[col].clone();
        for (r, row) in rows.iter_mut().enumerate() {
            if r != col && row[col] != zero {
                let k = row[col].clone();
                row.iter_mut()
                    .zip(&lead)
                    .for_each(|(v, l)| *v = v.clone() - k.clone() * l.clone());
            }
        }
    }
    Some(rows.into_iter().map(|mut r| r.split_off(n)).collect())
}

/// [`interpolation`] at the nodes i/d, exactly, over a common denominator: `c_j = sum_i rows[j][i] v_i / denominator`.
/// `None` above degree 6, whose fractions outgrow i128.
#[must_use]
pub fn equidistant(d: usize) -> Option<(Vec<Vec<i64>>, i64)> {
    if d > 6 {
        return None;
    }
    let nodes: Vec<Fraction> = (0..=d as i64).map(|i| Fraction::new(i.into(), d.max(1) as i128)).collect();
    let rows = interpolation(&nodes)?;
    let common = rows.iter().flatten().fold(1i128, |l, f| l / gcd(l, f.1) * f.1);
    let whole = |f: &Fraction| i64::try_from(f.0 * (common / f.1)).ok();
    let rows: Option<Vec<Vec<i64>>> = rows.iter().map(|r| r.iter().map(whole).collect()).collect();
    Some((rows?, i64::try_from(common).ok()?))
}

/// A fraction in lowest terms with a positive denominator; small ones only.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Fraction(i128, i128);

const fn gcd(a: i128, b: i128) -> i128 {
    let (mut a, mut b) = (a.abs(), b.abs());
    while b != 0 {
        (a, b) = (b, a % b);
    }
    if a == 0 { 1 } else { a }
}

impl Fraction {
    fn new(n: i128, d: i128) -> Self {
        let g = gcd(n, d) * d.signum();
        Self(n / g, d / g)
    }
}

impl Add for Fraction {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self::new(self.0 * o.1 + o.0 * self.1, self.1 * o.1)
    }
}

impl Sub for Fraction {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self::new(self.0 * o.1 - o.0 * self.1, self.1 * o.1)
    }
}

impl Mul for Fraction {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self::new(self.0 * o.0, self.1 * o.1)
    }
}

impl Div for Fraction {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        Self::new(self.0 * o.1, self.1 * o.0)
    }
}

impl Number for Fraction {
    fn whole(n: i64) -> Self {
        Self(n.into(), 1)
    }
}

/// The non-empty spans of a knot vector, by the index of the knot they start at.
pub fn spans<T: Number + PartialOrd>(degree: usize, knots: &[T]) -> impl Iterator<Item = usize> {
    (degree..knots.len().saturating_sub(degree + 1)).filter(|&k| knots[k] < knots[k + 1])
}

/// The blossom of a B-spline on span `k` (knots `[k]` and `[k + 1]` differ) at `degree` arguments: de Boor's recursion with one argument per step.
#[must_use]
pub fn blossom<T: Number>(degree: usize, knots: &[T], control: &[T], k: usize, at: &[T]) -> T {
    let mut d: Vec<T> = control[k - degree..=k].to_vec();
    for (r, x) in (1..=degree).zip(at) {
        for j in (r..=degree).rev() {
            let i = k - degree + j;
            let (lo, hi) = (&knots[i], &knots[i + degree + 1 - r]);
            let alpha = (x.clone() - lo.clone()) / (hi.clone() - lo.clone());
            // At the end of a span what is there already: a difference loses numbers far smaller than their neighbours, as weights may be.
            if x != hi {
                d[j] = d[j - 1].clone() + (d[j].clone() - d[j - 1].clone()) * alpha;
            }
        }
    }
    d[degree].clone()
}

/// The Bernstein coefficients of a B-spline on all its non-empty spans, `degree + 1` each (Bezier extraction). Where the spline is continuous (a knot
/// no more than `degree` fold) neighbours get the very same number at the joint.
#[must_use]
pub fn extract<T: Number + PartialOrd>(degree: usize, knots: &[T], control: &[T]) -> Vec<T> {
    let mut out: Vec<T> = Vec::new();
    let mut last = None;
    for k in spans(degree, knots) {
        let (lo, hi) = (knots[k].clone(), knots[k + 1].clone());
        for j in 0..=degree {
            let joined = j == 0 && degree > 0 && last.is_some_and(|l| k - l <= degree);
            let value = match out.last() {
                Some(v) if joined => v.clone(),
                _ => {
                    let at: Vec<T> = (0..degree)
                        .map(|n| if n < degree - j { lo.clone() } else { hi.clone() })
                        .collect();
                    blossom(degree, knots, control, k, &at)
                }
            };
            out.push(value);
        }
        last = Some(k);
    }
    out
}

/// The same B-spline with the knot `t` once more (Boehm): new knots and control coefficients. `None` where `t` lies outside the spline's domain.
#[must_use]
pub fn insert_knot<T: Number + PartialOrd>(degree: usize, knots: &[T], control: &[T], t: &T) -> Option<(Vec<T>, Vec<T>)> {
    let k = spans(degree, knots).find(|&k| knots[k] <= *t && *t < knots[k + 1])?;
    let mut more = knots.to_vec();
    more.insert(k + 1, t.clone());
    let mut out = control[..=k - degree].to_vec();
    for i in k + 1 - degree..=k {
        let alpha = (t.clone() - knots[i].clone()) / (knots[i + degree].clone() - knots[i].clone());
        out.push(control[i - 1].clone() + (control[i].clone() - control[i - 1].clone()) * alpha);
    }
    out.extend_from_slice(&control[k..]);
    Some((more, out))
}

/// Coefficients of three axes, the first fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor<T> {
    /// Coefficients per axis: degree + 1 for one Bezier element.
    pub counts: [usize; 3],
    /// `counts` of them.
    pub values: Vec<T>,
}

impl<T: Number> Tensor<T> {
    /// Applies a map of one-dimensional coefficients to every line along `axis`.
    ///
    /// # Panics
    /// When the map gives lines of different lengths.
    #[must_use]
    pub fn along(&self, axis: usize, map: impl Fn(&[T]) -> Vec<T>) -> Self {
        let stride: usize = self.counts[..axis].iter().product();
        let n = self.counts[axis];
        let outer = self.values.len() / (stride * n).max(1);
        let mut counts = self.counts;
        let mut values = Vec::new();
        for o in 0..outer {
            let lines: Vec<Vec<T>> = (0..stride)
                .map(|s| {
                    let line: Vec<T> = (0..n).map(|i| self.values[(o * n + i) * stride + s].clone()).collect();
                    map(&line)
                })
                .collect();
            counts[axis] = lines.first().map_or(0, Vec::len);
            for i in 0..counts[axis] {
                values.extend(lines.iter().map(|l| l[i].clone()));
            }
        }
        Self { counts, values }
    }

    /// The product of two polynomials in Bernstein form: degrees add up. In scaled coefficients (each times its binomials) it is a convolution.
    #[must_use]
    pub fn product(&self, other: &Self) -> Self {
        let (ca, cb) = (self.counts, other.counts);
        let counts: [usize; 3] = std::array::from_fn(|a| ca[a] + cb[a] - 1);
        let (left, right) = (self.scaled(), other.scaled());
        let mut values = vec![T::whole(0); counts.iter().product()];
        for (row, a) in left.chunks_exact(ca[0]).enumerate() {
            let (j, k) = (row % ca[1], row / ca[1]);
            for (row, b) in right.chunks_exact(cb[0]).enumerate() {
                let at = ((k + row / cb[1]) * counts[1] + j + row % cb[1]) * counts[0];
                for (i, a) in a.iter().enumerate() {
                    for (out, b) in values[at + i..at + i + cb[0]].iter_mut().zip(b) {
                        *out = out.clone() + a.clone() * b.clone();
                    }
                }
            }
        }
        let weights = Self::binomials(counts);
        for (n, v) in values.iter_mut().enumerate() {
            *v = v.clone() / Self::weight(&weights, counts, n);
        }
        Self { counts, values }
    }

    /// Every coefficient times its binomials.
    fn scaled(&self) -> Vec<T> {
        let weights = Self::binomials(self.counts);
        let each = self.values.iter().enumerate();
        each.map(|(n, v)| v.clone() * Self::weight(&weights, self.counts, n))
            .collect()
    }

    fn binomials(counts: [usize; 3]) -> [Vec<T>; 3] {
        counts.map(|n| (0..n).map(|i| T::whole(binomial(n - 1, i))).collect())
    }

    fn weight(weights: &[Vec<T>; 3], c: [usize; 3], n: usize) -> T {
        let [x, y, z] = [
            &weights[0][n % c[0]],
            &weights[1][n / c[0] % c[1]],
            &weights[2][n / c[0] / c[1]],
        ];
        x.clone() * y.clone() * z.clone()
    }
}

#[cfg(test)]
#[path = "hexes_bezier_tests.rs"]
mod tests;
