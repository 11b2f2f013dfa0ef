//! Differential sampling: where along a ray the field is sampled (Knoll et al. 2009, section 5).
//!
//! Sample n lies at distance T(n) from the eye, n a whole number, whatever macrocells are skipped. Lengths are in units of the volume's largest world extent: the
//! paper puts its image plane at distance 1 from the eye and leaves the unit open, though its law is not free of scale. In these units a volume of 256^3 seen from the
//! default view gets steps of about 1.5 voxels for s_k = 4, the paper's default.
//!
//! With the ray differential of a pinhole camera (Igehy 1999; the paper's equation 10), d = w + x u + y v not normalised and u the step to the next pixel,
//! `dD/dx = ((d.d) u - (d.u) d) / (d.d)^(3/2)`, and k = s_k |u|, the pixel's footprint at the image plane times s_k:
//!
//! ```text
//! a = k |dD/dx|,  b = k,  T(x) = a x^2/2 + b x,  x(T) = 2 T / (b + sqrt(b^2 + 2 a T))
//! ```
//!
//! **What the print says twice and differently.** Section 5.3 starts with the step b and adds a to it each time; after n steps that is at
//! `b n + a n (n-1)/2`, not at T(n): short by a n/2 ([`Law::Printed`]; hardcases E12). Steps that begin with b + a/2 are the differences of T ([`Law::Differential`]).
//! With the multiplier M, a step of T is `M (a x + b) + a M^2/2`, and M increments of the printed kind are `M (a x + b) + a M (M-1)/2`; the
//! printed `M (M+1)/2` is neither ([`Steps::printed_multiple`]). The printed inverse, (-b + sqrt(b^2 + 2 a T))/a, subtracts two numbers that agree in most digits where a is small
//! and divides 0 by 0 for parallel rays; the one above does neither.
//!
//! **What the law does.** The step of T at distance t is sqrt(b^2 + 2 a t): it grows like the square root of the distance, while the pixel's footprint grows like the
//! distance. [`Law::Geometric`] has steps of s_k times the footprint: `T(n) = L0 ((1 + q)^n - 1)`, q = s_k |dD/dx|, with L0 = 1/32 of the extent, at which
//! distance the step is twice that at the eye. A smaller L0 is nearer to the footprint and spends most samples on the first voxels, where the field hardly changes: 1/1000 takes 1.5 to 2 times as many
//! at equal error.
//!
//! **How much the law can gain.** From t0 to t1 it takes `x(t1) - x(t0) = (s1 - s0)/a` samples, s = sqrt(b^2 + 2 a t) being the step at either end. Uniform steps of length s0, which are nowhere
//! longer than the law's, take `(t1 - t0)/s0 = (s1^2 - s0^2)/(2 a s0)`. So by any measure in which an image gets no worse when steps get shorter, uniform sampling needs at most
//!
//! ```text
//! gain = (1 + s1/s0)/2, from the eye to distance L: (1 + sqrt(1 + 2 L/s_k))/2
//! ```
//!
//! times the law's samples ([`Steps::greatest_gain`]), or s1/s0 where only the far end of the ray is sampled. On the view axis a/b^2 is 1/s_k whatever the image, and the unit of length does
//! not matter: s_k in another unit that gives the same first step gives the same gain. In numbers of samples: uniform sampling must take N = L/b of them along the ray, and `gain = (1 + sqrt(1 + 2 N w))/2`
//! with w = |u| the width of a pixel at distance 1. A gain g so takes N >= 2 g (g - 1)/w: 1.5 takes N >= 1.5/w, 1650 samples a ray in an image of 800 rows and 40 degrees, and 3 takes 13,000.
//! Geometric steps have no such bound: q (t + L0) grows without end.
//!
//! **Single precision.** Steps summed in f32, as the paper's shader does, stop growing the position at all where a step is below half a unit in the last place of it; the
//! closed form in f64, here, has no sum and no such limit ([`summed_f32`] shows what the sum does).

use glam::DVec3;
use isobar_core::{Camera, RenderError, View};

/// How steps follow one another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Law {
    /// T(n) in closed form: its steps begin with b + a/2.
    Differential,
    /// As printed: T(n) where a macrocell is entered, then increments b + a n.
    Printed,
    /// Steps proportional to the pixel's footprint.
    Geometric,
    /// Equal steps: the comparator.
    Uniform,
}

impl Law {
    /// Names on the command line, the default first.
    pub const NAMES: &'static [&'static str] = &["differential", "printed", "geometric", "uniform"];

    /// The law of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let all = [Self::Differential, Self::Printed, Self::Geometric, Self::Uniform];
        Self::NAMES.iter().position(|n| *n == name).map(|i| all[i])
    }
}

/// The distance at which geometric steps are twice those at the eye, in extents.
const NEAR: f64 = 1.0 / 32.0;

/// Most samples along one ray; more are refused.
pub const MOST_SAMPLES: f64 = 16_777_216.0;

/// The samples of one ray: distances are in the ray's own t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    law: Law,
    /// T(n) = a n^2/2 + b n (all but geometric).
    a: f64,
    b: f64,
    /// ln(1 + q) and L (geometric).
    growth: f64,
    near: f64,
    /// 1 + q (geometric).
    factor: f64,
}

impl Steps {
    /// T(x) = a x^2/2 + b x, b > 0, a >= 0, by closed form or by the printed increments.
    #[must_use]
    pub const fn quadratic(law: Law, a: f64, b: f64) -> Self {
        Self {
            law,
            a,
            b,
            growth: 0.0,
            near: 0.0,
            factor: 1.0,
        }
    }

    /// Equal steps.
    #[must_use]
    pub const fn uniform(step: f64) -> Self {
        Self::quadratic(Law::Uniform, 0.0, step)
    }

    /// T(n) = near ((1 + q)^n - 1).
    #[must_use]
    pub fn geometric(q: f64, near: f64) -> Self {
        Self {
            law: Law::Geometric,
            a: 0.0,
            b: q * near,
            growth: q.ln_1p(),
            near,
            factor: 1.0 + q,
        }
    }

    /// T(n), the distance of sample n.
    #[must_use]
    #[inline(always)]
    pub fn t(&self, n: f64) -> f64 {
        if self.growth > 0.0 {
            self.near * (self.growth * n).exp_m1()
        } else {
            n * (0.5 * self.a * n + self.b)
        }
    }

    /// T(n + m) from `t` = T(n), m a whole number above 0. For geometric steps by a product, which is off by some units in the last place a step; the others are
    /// as cheap in closed form.
    #[must_use]
    #[inline(always)]
    pub fn after(&self, t: f64, n: f64, m: f64) -> f64 {
        if self.growth > 0.0 {
            let factor = if m == 1.0 { self.factor } else { self.factor.powi(m as i32) };
            (t + self.near) * factor - self.near
        } else {
            self.t(n + m)
        }
    }

    /// The real number whose T is `t`, t >= 0.
    #[must_use]
    #[inline(always)]
    pub fn x(&self, t: f64) -> f64 {
        if self.growth > 0.0 {
            (t / self.near).ln_1p() / self.growth
        } else {
            2.0 * t / (self.b + (self.b * self.b + 2.0 * self.a * t).sqrt())
        }
    }

    /// The last sample at or before `t`, and its distance: T(n) <= t < T(n + 1), whatever the rounding of [`Steps::x`].
    #[must_use]
    #[inline(always)]
    pub fn before(&self, t: f64) -> (f64, f64) {
        let mut n = self.x(t).floor().max(0.0);
        let mut at = self.t(n);
        if n > 0.0 && at > t {
            n -= 1.0;
            at = self.t(n);
        }
        let next = self.t(n + 1.0);
        if next <= t {
            (n, at) = (n + 1.0, next);
        }
        (n, at)
    }

    /// Samples that uniform steps no longer than any of these take from t0 to t1, over those that these take: the most that these can gain there. 0 <= t0 < t1.
    #[must_use]
    pub fn greatest_gain(&self, t0: f64, t1: f64) -> f64 {
        let least = if self.growth > 0.0 {
            self.growth * (t0 + self.near)
        } else {
            (self.b * self.b + 2.0 * self.a * t0).sqrt()
        };
        (t1 - t0) / (least * (self.x(t1) - self.x(t0)))
    }

    /// The printed increment at sample n: b + a n. The corrected one, T(n+1) - T(n), is b + a/2 + a n.
    #[must_use]
    #[inline(always)]
    pub fn printed_increment(&self, n: f64) -> f64 {
        self.b + self.a * n
    }

    /// M printed increments from sample n: `M (a n + b) + a M (M-1)/2`.
    #[must_use]
    #[inline(always)]
    pub fn increments(&self, n: f64, m: f64) -> f64 {
        m * self.printed_increment(n) + 0.5 * self.a * m * (m - 1.0)
    }

    /// What section 6.2 prints for the step of multiplier M, `M a n + a M (M+1)/2 + b`: neither M increments nor a step of T, unless a = 0 and M = 1.
    #[must_use]
    pub fn printed_multiple(&self, n: f64, m: f64) -> f64 {
        m * self.a * n + 0.5 * self.a * m * (m + 1.0) + self.b
    }

    /// The samples counted from sample n: those numbers `[first, step, growth]` with which T(n + k) is `first + k (step + growth k/2)`, or for geometric steps
    /// `first + step (exp(growth k) - 1)`.
    #[cfg(feature = "gpu")]
    pub(crate) fn counted_from(&self, n: f64) -> [f64; 3] {
        let first = self.t(n);
        if self.growth > 0.0 {
            [first, first + self.near, self.growth]
        } else {
            [first, self.b + self.a * n, self.a]
        }
    }

    /// Which law.
    #[must_use]
    pub const fn law(&self) -> Law {
        self.law
    }
}

/// The sum of n printed increments in single precision, from 0: the paper's shader.
#[must_use]
pub fn summed_f32(a: f32, b: f32, n: usize) -> f32 {
    let (mut t, mut step) = (0.0f32, b);
    for _ in 0..n {
        t += step;
        step += a;
    }
    t
}

/// Makes the [`Steps`] of each pixel.
#[derive(Debug, Clone)]
pub struct Sampler {
    law: Law,
    s_k: f64,
    /// World length of the unit.
    extent: f64,
    /// World step to the next pixel on the image plane at distance 1; its length for parallel rays.
    u: DVec3,
    forward: DVec3,
    /// World length of a uniform step.
    uniform: f64,
    parallel: bool,
}

impl Sampler {
    /// For a view of a volume of the given world extent; `uniform` is the world length of the steps of [`Law::Uniform`] and of lists of rays, which
    /// have no pixels and therefore no differentials. Parallel rays have a constant footprint, and T is linear.
    #[must_use]
    pub fn new(law: Law, s_k: f64, extent: f64, uniform: f64, view: &View) -> Self {
        let mut out = Self {
            law,
            s_k,
            extent,
            u: DVec3::X,
            forward: DVec3::Z,
            uniform,
            parallel: true,
        };
        match &view.camera {
            Camera::Rays(_) => out.law = Law::Uniform,
            Camera::Orthographic { height, .. } => out.u = DVec3::X * (height / view.height as f64),
            Camera::Perspective { eye, target, up, fov } => {
                out.parallel = false;
                out.forward = (*target - *eye).normalize();
                let right = out.forward.cross(*up).normalize();
                out.u = right * (2.0 * (fov.to_radians() * 0.5).tan() / view.height as f64);
            }
        }
        out
    }

    /// The samples of a ray with this world direction (any length).
    #[must_use]
    #[inline(always)]
    pub fn steps(&self, direction: DVec3) -> Steps {
        let length = direction.length();
        // From extents to the ray's t.
        let unit = self.extent / length;
        if self.law == Law::Uniform {
            return Steps::uniform(self.uniform / length);
        }
        if self.parallel {
            return Steps {
                law: self.law,
                ..Steps::uniform(self.s_k * self.u.x / length)
            };
        }
        // The direction not normalised, with the image plane at distance 1.
        let d = direction / direction.dot(self.forward);
        let dd = d.length_squared();
        let differential = ((dd * self.u - d.dot(self.u) * d) / (dd * dd.sqrt())).length();
        match self.law {
            Law::Geometric => Steps::geometric(self.s_k * differential, NEAR * unit),
            law => {
                let k = self.s_k * self.u.length();
                Steps::quadratic(law, k * differential * unit, k * unit)
            }
        }
    }

    /// Checks that no ray takes more than [`MOST_SAMPLES`] through the world bounds: rays of the image's corners and middle, or all of a list.
    ///
    /// # Errors
    /// [`RenderError::Knob`] with the count.
    pub fn check(&self, view: &View, bounds: (DVec3, DVec3)) -> Result<(), RenderError> {
        let rays = view.generator();
        let count = |x: usize, y: usize| {
            let ray = rays.ray(x, y);
            let far = (ray.origin - bounds.0).abs().max((ray.origin - bounds.1).abs()).length();
            self.steps(ray.direction).x(far / ray.direction.length())
        };
        let (w, h) = (view.width, view.height);
        let n = match view.camera {
            Camera::Rays(_) => (0..w * h).map(|i| count(i % w, i / w)).fold(0.0, f64::max),
            _ => [(0, 0), (w / 2, h / 2), (w - 1, h - 1)]
                .into_iter()
                .map(|(x, y)| count(x, y))
                .fold(0.0, f64::max),
        };
        if n <= MOST_SAMPLES {
            return Ok(());
        }
        let name = if self.law == Law::Uniform { "step" } else { "sk" };
        Err(RenderError::Knob {
            name: name.into(),
            reason: format!(
                "the steps are so short that a ray would take {n:.3e} samples, more than {MOST_SAMPLES}; give a larger {name}"
            ),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// hardcases E12.
    #[test]
    fn printed_increments_fall_short_of_the_closed_form() {
        let s = Steps::quadratic(Law::Printed, 0.01, 1.0);
        let mut t = 0.0;
        for n in 0..400 {
            t += s.printed_increment(f64::from(n));
        }
        assert!((t - 1198.0).abs() < 1e-9 && (s.t(400.0) - 1200.0).abs() < 1e-9);
        // begun with b + a/2 they meet it
        let mut t = 0.0;
        for n in 0..400 {
            t += s.printed_increment(f64::from(n)) + 0.005;
        }
        assert!((t - 1200.0).abs() < 1e-9);
    }

    #[test]
    fn multiples_of_a_step() {
        let s = Steps::quadratic(Law::Differential, 0.03, 0.7);
        for m in [1.0, 3.0, 5.0, 7.0] {
            let n = 12.0;
            let closed = s.t(n + m) - s.t(n);
            assert!((closed - (m * (0.03 * n + 0.7) + 0.03 * m * m / 2.0)).abs() < 1e-12);
            let sum: f64 = (0..m as usize).map(|i| s.printed_increment(n + i as f64)).sum();
            assert!((s.increments(n, m) - sum).abs() < 1e-12);
            let printed = s.printed_multiple(n, m);
            assert!((printed - sum).abs() > 1e-3 && (printed - closed).abs() > 1e-3, "M = {m}");
        }
    }

    #[test]
    fn inverses_find_their_sample() {
        let laws = [
            Steps::quadratic(Law::Differential, 3.6e-6, 3.8e-3),
            Steps::quadratic(Law::Differential, 0.0, 0.25),
            Steps::quadratic(Law::Differential, 1e-18, 1e-3),
            Steps::geometric(3.8e-3, 1e-3),
            Steps::uniform(0.1),
        ];
        for s in laws {
            for n in [0.0, 1.0, 2.0, 17.0, 1000.0, 4321.0] {
                let t = s.t(n);
                assert!((s.x(t) - n).abs() < 1e-6 * (1.0 + n), "{s:?} {n}: {}", s.x(t));
                assert_eq!(s.before(t), (n, t), "{s:?}");
                for m in [1.0, 3.0] {
                    let (next, want) = (s.after(t, n, m), s.t(n + m));
                    assert!((next - want).abs() <= 1e-12 * want, "{s:?} {n}: {next} {want}");
                }
                assert_eq!(s.before(0.5 * (t + s.t(n + 1.0))), (n, t), "{s:?}");
            }
        }
    }

    #[test]
    fn steps_follow_their_law() {
        let view = View::bench(1024, 768);
        let d = view.ray(700, 300).direction;
        let make = |law| Sampler::new(law, 4.0, 2.0, 0.01, &view).steps(d);
        let step = |s: Steps, t: f64| {
            let (n, t) = s.before(t);
            s.t(n + 1.0) - t
        };
        // the footprint of the pixel, to the cosine between the ray and the line of sight, from 1/32 of the extent behind the eye
        let q = make(Law::Geometric);
        for t in [0.0, 0.05, 0.5, 1.0, 4.0] {
            let ratio = step(q, t) / (4.0 * view.footprint(t + 2.0 * NEAR));
            assert!(ratio > 0.8 && ratio < 1.1, "{ratio} at {t}");
        }
        // the printed law grows like the square root
        let p = make(Law::Differential);
        let ratio = step(p, 4000.0) / step(p, 1000.0);
        assert!((ratio - 2.0).abs() < 0.01, "{ratio}");
        assert!((step(make(Law::Uniform), 3.0) - 0.01).abs() < 1e-15);
    }

    #[test]
    fn gains_are_bounded() {
        for (s_k, l) in [(4.0, 1.0), (4.0, 3.0), (1.0, 1.5), (0.5, 1.0)] {
            for w in [9e-4, 1e-2] {
                // on the view axis |dD/dx| is w
                let s = Steps::quadratic(Law::Differential, s_k * w * w, s_k * w);
                let want = 0.5 * (1.0 + (1.0 + 2.0 * l / s_k).sqrt());
                assert!((s.greatest_gain(0.0, l) - want).abs() < 1e-9, "{s_k} {l}");
                let n = l / (s_k * w);
                assert!((want - 0.5 * (1.0 + (1.0 + 2.0 * n * w).sqrt())).abs() < 1e-12);
                // counted: samples in [l/2, l], and uniform ones of the step where they begin
                let (first, from) = s.before(0.5 * l);
                let step = s.t(first + 1.0) - from;
                let counted = (l - from) / step / (s.before(l).0 - first);
                let bound = s.greatest_gain(from, l);
                assert!((counted / bound - 1.0).abs() < 0.08 && bound < want, "{counted} {bound}");
            }
        }
        let uniform = Steps::uniform(0.01);
        assert!((uniform.greatest_gain(0.3, 2.0) - 1.0).abs() < 1e-12);
        let geometric = Steps::geometric(4e-3, 1e-3).greatest_gain(0.0, 1.0);
        assert!((geometric - 1000.0 / 1001f64.ln()).abs() < 1e-6, "{geometric}");
    }

    /// Steps of 1e-7 extents: sums in f32 stand still, the closed form does not.
    #[test]
    fn single_precision_stands_still_and_the_closed_form_does_not() {
        let (a, b) = (1e-13, 1e-7);
        let n = 40_000_000u32;
        let s = Steps::quadratic(Law::Differential, a, b);
        let exact = s.t(f64::from(n));
        // 40 million additions take a tenth of a second; what they give is far off
        let sum = f64::from(summed_f32(a as f32, b as f32, n as usize));
        assert!((sum - exact).abs() > 0.1 * exact, "{sum} {exact}");
        // neighbouring samples stay apart, by the right amount
        let step = s.t(f64::from(n) + 1.0) - exact;
        assert!((step / (b + a * (f64::from(n) + 0.5)) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn too_many_samples_are_refused_with_their_count() {
        let view = View::bench(64, 48);
        let bounds = (DVec3::splat(-1.0), DVec3::splat(1.0));
        let ok = Sampler::new(Law::Differential, 4.0, 2.0, 0.01, &view);
        assert!(ok.check(&view, bounds).is_ok());
        let e = Sampler::new(Law::Differential, 1e-12, 2.0, 0.01, &view)
            .check(&view, bounds)
            .unwrap_err()
            .to_string();
        assert!(
            e.starts_with("knob sk") && e.contains("e8 samples") && !e.contains('\n'),
            "{e}"
        );
        let e = Sampler::new(Law::Uniform, 4.0, 2.0, 1e-9, &view)
            .check(&view, bounds)
            .unwrap_err();
        assert!(e.to_string().contains("knob step"), "{e}");
    }
}
