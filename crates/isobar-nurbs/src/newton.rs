//! The roots of the pixels of an injective piece: Newton's method, eight pixels at a time, and enclosures of where it ends.

use crate::bernstein::{Point, bases, count, jet, value_roundings};
use crate::frustum::{EPS, Frustum, PixelBox};
use crate::matrix::{inverse, product};
use crate::model::Model;
use crate::solve::{Constants, DRAWN, Found, Piece, Solver, Task, WIDER, normal};
use crate::wide::{Jets, WIDE};

/// Newton steps, at most.
const STEPS: usize = 16;
/// Up to so many pixels are evaluated one by one.
const FEW: usize = 2;

impl Solver {
    /// The pixels of an injective piece; a rectangle about those that could not be decided.
    #[inline(always)]
    pub(crate) fn finish(&mut self, f: &Frustum, task: &Task, k: &Constants, piece: &Piece, m: &Model) -> Option<PixelBox> {
        let mut left = None;
        let b = piece.pixels;
        let mut guesses = [Guess::default(); WIDE];
        let mut n = 0;
        for y in b.y0..=b.y1 {
            for x in b.x0..=b.x1 {
                let pixel = usize::from(y) * f.width + usize::from(x);
                let d = m.step(f, k, pixel);
                if m.excludes(d) {
                    continue;
                }
                guesses[n] = Guess {
                    x,
                    y,
                    u: std::array::from_fn(|i| (0.5 - d[i]).clamp(-WIDER, 1.0 + WIDER)),
                    before: f64::INFINITY,
                };
                n += 1;
                if n == WIDE {
                    left = self.newton(f, task, k, piece, m, &mut guesses, left);
                    n = 0;
                }
            }
        }
        if n > 0 {
            left = self.newton(f, task, k, piece, m, &mut guesses[..n], left);
        }
        left
    }

    /// The roots of some pixels in an injective piece, from first guesses of their parameters; `left` becomes the rectangle about it and the pixels that could not be decided.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one step of one loop, split for length")]
    fn newton(
        &mut self,
        f: &Frustum,
        task: &Task,
        k: &Constants,
        piece: &Piece,
        m: &Model,
        guesses: &mut [Guess],
        mut left: Option<PixelBox>,
    ) -> Option<PixelBox> {
        let (np, nv) = (self.points.len() - count(k.g), self.values.len() - count(k.h));
        let mut n = guesses.len();
        let mut together = Jets::new();
        for _ in 0..STEPS {
            let (points, values) = (&self.points[np..], &self.values[nv..]);
            let wide = n > FEW && together.fill(k.g, points, k.h, values, |i| guesses[if i < n { i } else { 0 }].u);
            self.work.newton += n as u64;
            let mut kept = 0;
            for i in 0..n {
                let guess = guesses[i];
                let at = if wide {
                    together.get(i)
                } else {
                    (jet(k.g, points, &bases(k.g, guess.u)), jet(k.h, values, &bases(k.h, guess.u)))
                };
                let pixel = usize::from(guess.y) * f.width + usize::from(guess.x);
                match judge(f, task, k, piece, m, pixel, &guess, &at) {
                    Outcome::Next(u, miss) => {
                        guesses[kept] = Guess {
                            u,
                            before: miss,
                            ..guess
                        };
                        kept += 1;
                    }
                    Outcome::Root(found) => {
                        self.ends.note(&found);
                        self.found.push(found);
                    }
                    Outcome::None => {}
                    Outcome::Lost => left = Some(PixelBox::with(left, guess.x, guess.y)),
                }
            }
            n = kept;
            if n == 0 {
                return left;
            }
        }
        for g in &guesses[..n] {
            left = Some(PixelBox::with(left, g.x, g.y));
        }
        left
    }
}

/// Where a pixel's root may be.
#[derive(Debug, Clone, Copy, Default)]
struct Guess {
    x: u16,
    y: u16,
    u: [f64; 3],
    /// |Y P| one step before.
    before: f64,
}

enum Outcome {
    Root(Found),
    None,
    Lost,
    /// The next guess, and |Y P| at this one.
    Next([f64; 3], f64),
}

/// Values and partial derivatives of the points and of gamma.
type Jet = ([Point; 4], [f64; 4]);

/// One step of Newton's method for one pixel: the end, or where to look next.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "one step of one loop, split for length")]
fn judge(f: &Frustum, task: &Task, k: &Constants, piece: &Piece, m: &Model, pixel: usize, guess: &Guess, at: &Jet) -> Outcome {
    let ray = &f.rays[pixel];
    let ([s, r], lane, u) = (ray.slope, k.lane, guess.u);
    let ([p, pu, pv, pw], [a, au, av, aw]) = *at;
    let floor = m.noise.iter().fold(0.0f64, |a, &b| a.max(b)) / (1.0 - m.rho);
    let residual = [p[0] - s * p[lane], p[1] - r * p[lane], a];
    let step = product(&m.y, residual);
    let miss = step.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    let error = (miss / (1.0 - m.rho) + floor) * (1.0 + 1e-12) + 8.0 * EPS;
    if !error.is_finite() {
        return Outcome::Lost;
    }
    // A root u + v of the piece has |v| <= error and |v + Y P(u)| <= E |v|.
    let outside = (0..3).any(|i| {
        let (x, by) = (u[i] - step[i], m.rows[i] * error + m.noise[i] + 8.0 * EPS);
        x + by < 0.0 || x - by > 1.0 || u[i] + error < 0.0 || u[i] - error > 1.0
    });
    if outside {
        return Outcome::None;
    }
    let j = [
        [pu[0] - s * pu[lane], pv[0] - s * pv[lane], pw[0] - s * pw[lane]],
        [pu[1] - r * pu[lane], pv[1] - r * pv[lane], pw[1] - r * pw[lane]],
        [au, av, aw],
    ];
    let own = inverse(&j)
        .map(|y| product(&y, residual))
        .filter(|d| d.iter().all(|x| x.is_finite()));
    let by = own.unwrap_or(step);
    // Neither at the floor of the roundings, nor no longer falling near it.
    if miss > floor && (miss > 1e-10 || miss < 0.5 * guess.before) {
        let next = std::array::from_fn(|i| (u[i] - by[i]).clamp(-WIDER, 1.0 + WIDER));
        return if next == u { Outcome::Lost } else { Outcome::Next(next, miss) };
    }
    let inside = u.iter().all(|&x| x - error >= -WIDER && x + error <= 1.0 + WIDER);
    if !inside {
        return Outcome::Lost;
    }
    let mut certain = true;
    for (axis, &x) in u.iter().enumerate() {
        let face = |side: u8| piece.faces & (1 << (2 * axis + usize::from(side))) != 0 && k.face_axis != Some(axis);
        // At a face of the element the root may lie beyond it.
        let beyond = x - error < 0.0 && face(0) || x + error > 1.0 && face(1);
        certain &= !beyond;
    }
    // One more step to first order: where the equations are nearly dependent the floor is far above what is reached.
    let last: Point = std::array::from_fn(|l| p[l] - (by[0] * pu[l] + by[1] * pv[l] + by[2] * pw[l]));
    let depth = last[2] / last[3];
    // Three steps: to the root and back, and what the first order leaves out.
    let e: [f64; 3] = std::array::from_fn(|i| step[i].abs() + 3.0 * by[i].abs() + m.noise[i] + m.rows[i] * error);
    let along = |d: &[f64; 3]| (d[0] * e[0] + d[1] * e[1] + d[2] * e[2]) * 1.01;
    let heavy = along(&m.dw);
    let reach = along(&m.dz) + depth.abs() * heavy;
    let rounding = EPS * (piece.geometry + value_roundings(k.g));
    let noise = rounding * (k.scale + depth.abs() * k.weight);
    // With z, w at the root and z', w' here: z / w - z' / w' = (z - z' - (z' / w') (w - w')) / w.
    let weight = last[3] - heavy - rounding * k.weight;
    if weight <= 0.0 {
        return Outcome::Lost;
    }
    if !certain {
        // The element ends at the box about its control points; near light ones what is beyond its faces may be far away.
        let away = if f.parallel { 1.0 } else { depth };
        let here = [s * away, r * away, depth];
        let beyond = (0..3).fold(0.0f64, |m, i| m.max(k.ends.0[i] - here[i]).max(here[i] - k.ends.1[i]));
        let room = (reach + noise) / weight * f.obliquity.max(1.0) + f.slope_error * (1.0 + depth.abs()) + 64.0 * EPS * k.far;
        if beyond > room {
            return Outcome::None;
        }
        if beyond > DRAWN * (k.ends.1 - k.ends.0).max_element() {
            return Outcome::Lost;
        }
    }
    let rounded = EPS * 16.0 * (depth.abs() + ray.start.abs());
    Outcome::Root(Found {
        pixel: pixel as u16,
        surface: task.surface,
        certain,
        face: false,
        t: (depth - ray.start) / ray.rate,
        error: ((reach + noise) / weight + rounded) / ray.rate.abs() * f.obliquity.max(1.0),
        normal: normal(f, p, [pu, pv, pw], [au, av, aw]),
    })
}
