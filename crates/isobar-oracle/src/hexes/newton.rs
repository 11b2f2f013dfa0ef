//! At most one zero in a box, at least one, and where: interval Newton in Krawczyk's form on the box enlarged by `EDGE` of its size.
//!
//! Everything is in the box's own coordinates, [0, 1]^3; B' is the enlarged box. With an interval matrix J that holds all derivatives of F on B', any matrix Y and
//! any m in B', the mean value theorem (one point per row and pair of points, all in B') gives, for a zero r in B',
//! `r in m - Y F(m) + (I - Y J)(r - m)`. With P not below `|I - Y J|`, s not below the error of `Y F(m)`, and q the greatest row sum of P:
//! * no zero lies in the box where `m - Y F(m) +- (s + P reach)` misses it on an axis, reach the distances from m to the ends of B';
//! * q < 1: F is one to one on B' (`Y F(a) = Y F(b)` gives `|a - b| <= q |a - b|`): at most one zero;
//! * q < 1 and the cube of radius `rho > (max |Y F(m)| + s)/(1 - q)` about m in B': the map `r -> m - Y F(m) + (I - Y J)(r - m)` takes it into its inside: exactly
//!   one zero, in `m - Y F(m) +- (s + P rho)` (Krawczyk 1969).
//!
//! Y is a rounded inverse of the middle of J: it need not be exact for any of this. With Y fixed the steps converge linearly, by q: where a box has at most one
//! zero, plain Newton steps find about where, and the last test is done in a small box there, in which q is tiny.

use super::forms::{EDGE, Forms, Number, Slopes, up};
use crate::{real::U64, tets::ball::Ball};

type Matrix = [[f64; 3]; 3];

/// The rounded inverse of the middle of the derivatives, and P.
#[derive(Clone, Copy, Debug)]
pub(super) struct Newton {
    y: Matrix,
    p: Matrix,
    /// Greatest row sum of P.
    pub(super) q: f64,
}

/// What came out of a box.
#[derive(Clone, Copy, Debug)]
pub(super) enum Settled<R> {
    /// No zero in the box.
    Nothing,
    /// One zero in the enlarged box, in these balls (in the box's own coordinates).
    One([Ball<R>; 3]),
    /// Cannot tell.
    Unclear,
}

/// The adjugate of a matrix and its determinant.
pub(super) fn adjugate(m: &Matrix) -> (Matrix, f64) {
    let cross = |a: usize, b: usize| -> [f64; 3] {
        std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            m[a][j] * m[b][k] - m[a][k] * m[b][j]
        })
    };
    // Columns of the adjugate are the cross products of rows.
    let c = [cross(1, 2), cross(2, 0), cross(0, 1)];
    let adj = std::array::from_fn(|i| [c[0][i], c[1][i], c[2][i]]);
    let det = (0..3).map(|i| m[0][i] * c[0][i]).sum();
    (adj, det)
}

impl Newton {
    /// `None` where the middle has no usable inverse.
    pub(super) fn new(slopes: &Slopes, adj: &Matrix, det: f64) -> Option<Self> {
        let y: Matrix = adj.map(|row| row.map(|a| a / det));
        if !y.iter().flatten().all(|v| v.is_finite()) {
            return None;
        }
        let mut p = [[0.0; 3]; 3];
        for (i, row) in p.iter_mut().enumerate() {
            for (k, out) in row.iter_mut().enumerate() {
                let (mut a, mut size, mut radius) = (if i == k { 1.0 } else { 0.0 }, 1.0, 0.0);
                for (y, (middle, r)) in y[i].iter().zip(slopes.middle.iter().zip(&slopes.radius)) {
                    let x = y * middle[k];
                    a -= x;
                    size += x.abs();
                    radius += y.abs() * r[k];
                }
                *out = up(a.abs() + radius + 16.0 * U64 * size);
            }
        }
        let q = p.iter().map(|r| r.iter().sum::<f64>()).fold(0.0, f64::max);
        q.is_finite().then_some(Self { y, p, q: up(q) })
    }

    /// How much each axis spoils P.
    pub(super) fn spoiled(&self) -> [f64; 3] {
        std::array::from_fn(|k| self.p.iter().map(|row| row[k]).fold(0.0, f64::max))
    }

    /// About where the zero is: plain Newton steps, no guarantee. `None` where they leave the enlarged box.
    pub(super) fn guess<R: Number>(forms: &Forms<R>) -> Option<[f64; 3]> {
        let mut m = [0.5; 3];
        let mut out = 0;
        for _ in 0..20 {
            let (f, j) = forms.jet(&m);
            let (adj, det) = adjugate(&j);
            let mut step = 0.0f64;
            let mut clamped = false;
            for i in 0..3 {
                let d = (0..3).map(|k| adj[i][k] * f[k]).sum::<f64>() / det;
                let x = (m[i] - d).clamp(-0.7 * EDGE, 1.0 + 0.7 * EDGE);
                clamped |= x != m[i] - d;
                step = step.max((x - m[i]).abs());
                m[i] = x;
            }
            out = if clamped { out + 1 } else { 0 };
            if !(step.is_finite() && out < 4) {
                return None;
            }
            if step < 1e-9 {
                return (!clamped).then_some(m);
            }
        }
        None
    }

    /// Whether no zero lies in the box, judged from its centre.
    pub(super) fn empty<R: Number>(&self, forms: &Forms<R>, most: &[f64; 3], band: f64, scratch: &mut Vec<R>) -> bool {
        let m = [0.5; 3];
        let (delta, s) = self.step(forms, &[R::from_f64(0.5); 3], most, band, scratch);
        self.misses(&m, &delta, &s, &[0.5 + 1.01 * EDGE; 3])
    }

    /// A zero that lies in `ball` narrowed by values from `forms` in a better arithmetic: one step from the ball's centre. The tests were made in a small box of
    /// `size` (a ball for each axis, in the ball's units), which holds the ball. All errors are carried over; what is left are the step's and the
    /// rounding of the parameters to f64.
    pub(super) fn sharpened<R: Number>(
        &self,
        forms: &Forms<R>,
        ball: &[Ball<f64>; 3],
        size: &[Ball<f64>; 3],
    ) -> Option<[Ball<f64>; 3]> {
        let most = forms.sizes(0.0)?;
        let m = ball.map(|b| R::from_f64(b.x));
        let (delta, s) = self.step(forms, &m, &most, 0.0, &mut Vec::new());
        let reach: [f64; 3] = std::array::from_fn(|k| up(ball[k].e / (size[k].x - size[k].e)));
        // The zero is a 12800th of the small box inside its enlargement (`accept`): so is m, then.
        if !reach.iter().all(|&r| (0.0..5e-5).contains(&r)) {
            return None;
        }
        let out = std::array::from_fn(|i| {
            let radius = up(s[i] + (0..3).map(|k| self.p[i][k] * reach[k]).sum::<f64>());
            let step = Ball { x: delta[i], e: radius };
            Ball::exact(ball[i].x).minus(step.times(size[i]))
        });
        out.iter().all(|b| b.e.is_finite()).then_some(out)
    }

    /// `Y F(m)`, and a bound on its error.
    fn step<R: Number>(
        &self,
        forms: &Forms<R>,
        m: &[R; 3],
        most: &[f64; 3],
        band: f64,
        scratch: &mut Vec<R>,
    ) -> ([f64; 3], [f64; 3]) {
        let (f, mut fe) = forms.value(m, most, scratch);
        fe[2] += band;
        let (mut delta, mut s) = ([0.0; 3], [0.0; 3]);
        for i in 0..3 {
            for j in 0..3 {
                let (y, x) = (self.y[i][j], f[j].f64());
                delta[i] += y * x;
                s[i] += y.abs() * (fe[j] + 8.0 * U64 * x.abs());
            }
            s[i] = up(s[i]);
        }
        (delta, s)
    }

    /// Looks for the zero of `F + [-band, band] e_gamma`, for every member of which it holds.
    pub(super) fn settle<R: Number>(&self, forms: &Forms<R>, most: &[f64; 3], band: f64, scratch: &mut Vec<R>) -> Settled<R> {
        const ROUNDS: usize = 12;
        let mut m = [R::from_f64(0.5); 3];
        let mut last = f64::INFINITY;
        for round in 0..ROUNDS {
            let (delta, s) = self.step(forms, &m, most, band, scratch);
            let at = m.map(Number::dd).map(|x| x.hi);
            let reach = at.map(|x| (x + EDGE).max(1.0 + EDGE - x) + 1e-15);
            if self.misses(&at, &delta, &s, &reach) {
                return Settled::Nothing;
            }
            if self.q >= 0.99 {
                return Settled::Unclear;
            }
            let step = delta.iter().fold(0.0f64, |a, d| a.max(d.abs()));
            let noise = s.iter().fold(0.0f64, |a, &d| a.max(d));
            if step <= noise || round > 0 && step > 0.25 * last || round + 1 == ROUNDS {
                return self.accept(&m, &at, &delta, &s);
            }
            last = step;
            for (x, d) in m.iter_mut().zip(delta) {
                *x = x.shifted(-d);
                let v = x.f64();
                if v < -0.5 * EDGE {
                    *x = R::from_f64(-0.5 * EDGE);
                } else if v > 1.0 + 0.5 * EDGE {
                    *x = R::from_f64(1.0 + 0.5 * EDGE);
                }
            }
        }
        Settled::Unclear
    }

    /// Whether no zero of the enlarged box lies in the box.
    fn misses(&self, m: &[f64; 3], delta: &[f64; 3], s: &[f64; 3], reach: &[f64; 3]) -> bool {
        (0..3).any(|i| {
            let radius: f64 = s[i] + (0..3).map(|k| self.p[i][k] * reach[k]).sum::<f64>();
            let c = m[i] - delta[i];
            let radius = up(radius) + 4.0 * f64::EPSILON * (1.0 + c.abs() + delta[i].abs());
            c + radius < 0.0 || c - radius > 1.0
        })
    }

    fn accept<R: Number>(&self, m: &[R; 3], at: &[f64; 3], delta: &[f64; 3], s: &[f64; 3]) -> Settled<R> {
        let worst = (0..3).map(|i| delta[i].abs() + s[i]).fold(0.0, f64::max);
        let rho = up(worst / (1.0 - self.q) * 1.01);
        // The bounds of B' leave room for the rounding of `at`.
        let inside = at.iter().all(|&x| x - rho >= -0.99 * EDGE && x + rho <= 1.0 + 0.99 * EDGE);
        if !inside || rho.is_nan() {
            return Settled::Unclear;
        }
        let around = |rho: &[f64; 3]| -> [f64; 3] {
            std::array::from_fn(|i| up(s[i] + (0..3).map(|k| self.p[i][k] * rho[k]).sum::<f64>()))
        };
        // How far the zero is from m, then once more with that.
        let first = around(&[rho; 3]);
        let radius = around(&std::array::from_fn(|k| up(delta[k].abs() + first[k]).min(rho)));
        Settled::One(std::array::from_fn(|i| Ball {
            x: m[i].shifted(-delta[i]),
            e: up(radius[i] + 4.0 * R::UNIT * (1.0 + delta[i].abs())),
        }))
    }
}
