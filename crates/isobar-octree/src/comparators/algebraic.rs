//! One algebraic surface by the thesis's pipeline (section 3.2), every stage clocked: Figure 6.1 and Table 6.1.
//!
//! A row of pixels goes through one stage after the other, so that a stage's clock is read twice per row and no more. The polynomial along a ray comes from one
//! of the thesis's compositions or from the frustum form; everything else is the same code, so two frames differ by the composition alone.

use super::frustum::{Frustum, FrustumForm, weights};
use crate::compose::{Form, Scalar, compose};
use crate::finders::{Answer, Finder};
use glam::DVec3;
use isobar_core::{Algebraic, DataError, RenderError, View, shade};
use isobar_poly::{Real, bernstein, power, scaled};
use std::time::{Duration, Instant};

/// How a ray gets its polynomial.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Composition {
    /// The frustum form, every ray for itself ([`FrustumForm::ray`]).
    Frustum,
    /// The frustum form with what a row of pixels shares worked out once ([`FrustumForm::row`]).
    FrustumRows,
    /// The thesis's [`Form::Pf`].
    Pf,
    /// The thesis's [`Form::Sb1`].
    Sb1,
    /// The recommended [`Form::AxisSegment`].
    Axis,
}

impl Composition {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Frustum, Self::FrustumRows, Self::Pf, Self::Sb1, Self::Axis];

    /// Its name in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Frustum => "frustum form",
            Self::FrustumRows => "frustum form, rows",
            Self::Pf => "PF",
            Self::Sb1 => "SB1",
            Self::Axis => "axis",
        }
    }
}

/// Which part of a ray is searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Extent {
    /// From the near plane to the far one, as the frustum form is made.
    Planes,
    /// The part of it inside the surface's box.
    Box,
}

/// The stages of Table 6.1, as the thesis names them.
pub const STAGES: [&str; 7] = [
    "Setup and Load",
    "to Object Space",
    "BBox Check",
    "Composition",
    "Rootfind",
    "Evaluate",
    "Lighting",
];

/// A polynomial of degree D in each of x, y and z, with the coefficients the compositions take, in numbers T. Local coordinates are -1 to 1 across the box.
#[derive(Debug, Clone)]
pub struct Surface<T, const D: usize> {
    polynomial: Algebraic,
    /// Power form, the axis a last: by (a + 1) % 3, (a + 2) % 3, a.
    power: [Vec<T>; 3],
    /// Scaled Bernstein form over the box.
    scaled: Vec<T>,
}

impl<T: Scalar + Real, const D: usize> Surface<T, D> {
    /// The zeros of `polynomial`. Coefficients about the middle of the box are worked out in f64 and rounded once.
    ///
    /// # Errors
    /// As [`Algebraic::check`], and [`DataError::Algebraic`] where an exponent exceeds D.
    pub fn new(polynomial: &Algebraic) -> Result<Self, DataError> {
        polynomial.check()?;
        if polynomial.terms.iter().any(|(e, _)| e.iter().any(|&p| usize::from(p) > D)) {
            return Err(DataError::Algebraic(format!(
                "{}: an exponent of a coordinate exceeds {D}; use a surface of that degree",
                polynomial.name
            )));
        }
        let n = D + 1;
        let (middle, half) = ((polynomial.lo + polynomial.hi) * 0.5, (polynomial.hi - polynomial.lo) * 0.5);
        let mut local = vec![0.0; n * n * n];
        for (e, k) in polynomial.terms.iter() {
            let [x, y, z] = [0, 1, 2].map(|a| expanded::<D>(middle[a], half[a], e[a]));
            for (i, x) in x.iter().enumerate().take(n) {
                for (j, y) in y.iter().enumerate().take(n) {
                    for (l, z) in z.iter().enumerate().take(n) {
                        local[(i * n + j) * n + l] += k * x * y * z;
                    }
                }
            }
        }
        let turned = |a: usize| {
            let mut e = [0; 3];
            let mut out = vec![<T as Scalar>::ZERO; n * n * n];
            for (at, o) in out.iter_mut().enumerate() {
                (e[(a + 1) % 3], e[(a + 2) % 3], e[a]) = (at / (n * n), at / n % n, at % n);
                *o = T::from_f64(local[(e[0] * n + e[1]) * n + e[2]]);
            }
            out
        };
        let power = [0, 1, 2].map(turned);
        let mut scaled = local;
        for stride in [1, n, n * n] {
            for first in (0..n * n * n).filter(|at| (at / stride).is_multiple_of(n)) {
                let line: [f64; 4] = std::array::from_fn(|i| if i < n { scaled[first + i * stride] } else { 0.0 });
                for (i, x) in to_scaled::<D>(line).into_iter().take(n).enumerate() {
                    scaled[first + i * stride] = x;
                }
            }
        }
        Ok(Self {
            polynomial: polynomial.clone(),
            power,
            scaled: scaled.into_iter().map(T::from_f64).collect(),
        })
    }

    /// The polynomial given.
    #[must_use]
    pub fn polynomial(&self) -> &Algebraic {
        &self.polynomial
    }

    /// The polynomial along the segment from local `a` to local `b`, M = 3 D + 1 Bernstein coefficients on [0, 1]; `None` where the two are the same
    /// point, and for the two ways that do not compose.
    #[must_use]
    #[inline]
    pub fn composed<const M: usize>(&self, how: Composition, a: [T; 3], b: [T; 3]) -> Option<[T; M]> {
        const { assert!(M == 3 * D + 1) };
        let zero = <T as Scalar>::ZERO;
        let d: [T; 3] = std::array::from_fn(|i| b[i] - a[i]);
        let major = (1..3).fold(0, |m, i| if Real::abs(d[i]) > Real::abs(d[m]) { i } else { m });
        if d[major] == zero {
            return None;
        }
        let mut out = [zero; M];
        match how {
            Composition::Pf => {
                // The order of the coefficients with z last.
                compose::<T, D>(Form::Pf, &self.power[2], &std::array::from_fn(|i| [a[i], d[i]]), &mut out);
                power::to_bernstein(&mut out);
            }
            Composition::Sb1 => {
                let q = |x: T| (x + <T as Scalar>::ONE) * T::HALF;
                compose::<T, D>(
                    Form::Sb1,
                    &self.scaled,
                    &std::array::from_fn(|i| [q(a[i]), q(b[i])]),
                    &mut out,
                );
                scaled::to_bernstein(&mut out);
            }
            Composition::Axis => {
                let line = |i: usize| {
                    let slope = d[i] / d[major];
                    [a[i] - slope * a[major], slope]
                };
                let r = [line((major + 1) % 3), line((major + 2) % 3), [a[major], b[major]]];
                compose::<T, D>(Form::AxisSegment, &self.power[major], &r, &mut out);
                scaled::to_bernstein(&mut out);
            }
            Composition::Frustum | Composition::FrustumRows => return None,
        }
        Some(out)
    }

    /// Gradient at a local point, in local coordinates, by Horner's rule.
    #[inline]
    fn gradient(&self, [x, y, z]: [T; 3]) -> [T; 3] {
        let (n, zero) = (D + 1, <T as Scalar>::ZERO);
        let f = &self.power[2];
        // Value, and derivatives by x, y and z.
        let mut by_x = [zero; 4];
        for i in (0..n).rev() {
            let mut by_y = [zero; 3];
            for j in (0..n).rev() {
                let (mut value, mut slope) = (zero, zero);
                for &c in f[(i * n + j) * n..][..n].iter().rev() {
                    slope = value + z * slope;
                    value = c + z * value;
                }
                by_y = [value + y * by_y[0], by_y[0] + y * by_y[1], slope + y * by_y[2]];
            }
            by_x = [
                by_y[0] + x * by_x[0],
                by_x[0] + x * by_x[1],
                by_y[1] + x * by_x[2],
                by_y[2] + x * by_x[3],
            ];
        }
        [by_x[1], by_x[2], by_x[3]]
    }
}

/// Powers of s in (middle + half s)^e.
fn expanded<const D: usize>(middle: f64, half: f64, e: u8) -> [f64; 4] {
    const { assert!(D >= 1 && D <= 3) };
    let mut p = [1.0, 0.0, 0.0, 0.0];
    for _ in 0..e {
        for i in (0..4).rev() {
            p[i] = middle * p[i] + if i > 0 { half * p[i - 1] } else { 0.0 };
        }
    }
    // The entries beyond D are zero, since e is at most D.
    p
}

/// From powers of s = 2q - 1 to weights q^k (1 - q)^(D - k): s^i = (q - r)^i (q + r)^(D - i) with r = 1 - q.
fn to_scaled<const D: usize>(a: [f64; 4]) -> [f64; 4] {
    let mut out = [0.0; 4];
    for (i, a) in a.into_iter().enumerate().take(D + 1) {
        let mut w = [1.0, 0.0, 0.0, 0.0];
        for factor in 0..D {
            let r = if factor < i { -1.0 } else { 1.0 };
            for k in (0..4).rev() {
                w[k] = r * w[k] + if k > 0 { w[k - 1] } else { 0.0 };
            }
        }
        for (o, w) in out.iter_mut().zip(w) {
            *o += a * w;
        }
    }
    out
}

/// A frame and where its time went.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// Making the frustum form and the columns' weights; zero for compositions.
    pub preprocessing: Duration,
    /// By [`STAGES`].
    pub stages: [Duration; 7],
    /// World point of the first root of each pixel, row by row; infinite where none was found.
    pub points: Vec<DVec3>,
    /// Linear colour, white where nothing is hit.
    pub colours: Vec<[f32; 3]>,
    /// Rays that had a polynomial.
    pub composed: usize,
}

impl Drawn {
    /// Preprocessing and all stages.
    #[must_use]
    pub fn total(&self) -> Duration {
        self.preprocessing + self.stages.iter().sum::<Duration>()
    }
}

/// A ray on its way through the stages.
#[derive(Clone, Copy)]
struct Way<T> {
    x: usize,
    uv: [T; 2],
    /// Local points at the near and the far plane, then at the ends of what is searched.
    ends: [[T; 3]; 2],
    /// That part, of [0, 1] between the planes.
    span: [T; 2],
}

/// Draws `surface` as the view shows it between planes that touch its box's sphere, with M = 3 D + 1.
///
/// **No guarantee**: roots are those `finder` gives, in numbers T.
///
/// # Errors
/// [`RenderError::View`] as [`View::validate`], for lists of rays, and where the eye lies inside the sphere round the box.
pub fn draw<T: Scalar + Real, const D: usize, const M: usize>(
    surface: &Surface<T, D>,
    view: &View,
    how: Composition,
    finder: &Finder,
    extent: Extent,
) -> Result<Drawn, RenderError> {
    view.validate()?;
    let polynomial = &surface.polynomial;
    let (lo, hi) = (polynomial.lo, polynomial.hi);
    let frustum = Frustum::around(view, lo, hi).ok_or_else(|| {
        RenderError::View(
            "the frustum form needs a camera outside the sphere round the polynomial's box; move --eye away".to_owned(),
        )
    })?;
    let mut job = Job::<T, D, M> {
        surface,
        how,
        finder,
        extent,
        planes: local_planes(&frustum, (lo + hi) * 0.5, (hi - lo) * 0.5),
        form: None,
        columns: Vec::new(),
        ways: Vec::with_capacity(view.width),
        polynomials: Vec::with_capacity(view.width),
        drawn: Drawn {
            preprocessing: Duration::ZERO,
            stages: [Duration::ZERO; 7],
            points: vec![DVec3::INFINITY; view.pixels()],
            colours: vec![[1.0; 3]; view.pixels()],
            composed: 0,
        },
    };
    if matches!(how, Composition::Frustum | Composition::FrustumRows) {
        let clock = Instant::now();
        job.form = Some(FrustumForm::<f64, M>::new(|p| polynomial.value(p), &frustum).rounded());
        job.columns = (0..view.width)
            .map(|x| weights(T::from_f64((x as f64 + 0.5) / view.width as f64)))
            .collect();
        job.drawn.preprocessing = clock.elapsed();
    }
    for y in 0..view.height {
        job.row(view, y);
    }
    Ok(job.drawn)
}

/// Corner and edges of the near and the far plane in local coordinates.
fn local_planes<T: Real>(frustum: &Frustum, middle: DVec3, half: DVec3) -> [[[T; 3]; 3]; 2] {
    let point = |u: f64, v: f64| frustum.ends(u, v).map(|p| (p - middle) / half);
    let (corner, u, v) = (point(0.0, 0.0), point(1.0, 0.0), point(0.0, 1.0));
    [0, 1].map(|e| [corner[e], u[e] - corner[e], v[e] - corner[e]].map(|p| p.to_array().map(T::from_f64)))
}

struct Job<'a, T, const D: usize, const M: usize> {
    surface: &'a Surface<T, D>,
    how: Composition,
    finder: &'a Finder,
    extent: Extent,
    planes: [[[T; 3]; 3]; 2],
    form: Option<FrustumForm<T, M>>,
    columns: Vec<[T; M]>,
    ways: Vec<Way<T>>,
    polynomials: Vec<[T; M]>,
    drawn: Drawn,
}

impl<T: Scalar + Real, const D: usize, const M: usize> Job<'_, T, D, M> {
    /// One row of pixels through all stages.
    fn row(&mut self, view: &View, y: usize) {
        let mut clock = Instant::now();
        let mut lap = |drawn: &mut Drawn, stage: usize| {
            let now = Instant::now();
            drawn.stages[stage] += now - clock;
            clock = now;
        };
        let v = T::from_f64((y as f64 + 0.5) / view.height as f64);
        let zero = <T as Scalar>::ZERO;
        self.ways.clear();
        self.ways.extend((0..view.width).map(|x| Way {
            x,
            uv: [T::from_f64((x as f64 + 0.5) / view.width as f64), v],
            ends: [[zero; 3]; 2],
            span: [zero, <T as Scalar>::ONE],
        }));
        lap(&mut self.drawn, 0);
        for w in &mut self.ways {
            let [u, v] = w.uv;
            w.ends = self
                .planes
                .map(|[c, du, dv]| std::array::from_fn(|a| c[a] + u * du[a] + v * dv[a]));
        }
        lap(&mut self.drawn, 1);
        if self.extent == Extent::Box {
            self.ways.retain_mut(clip);
        }
        lap(&mut self.drawn, 2);
        self.compose(v);
        lap(&mut self.drawn, 3);
        let roots: Vec<Answer<T>> = self.polynomials.iter().map(|p| self.finder.first_of(p)).collect();
        lap(&mut self.drawn, 4);
        let found: Vec<(usize, [T; 3], [T; 3])> = (self.ways.iter().zip(roots))
            .filter_map(|(w, root)| {
                let (Answer::Root(x) | Answer::Touching(x)) = root else {
                    return None;
                };
                let [a, b] = w.ends;
                let p = std::array::from_fn(|i| a[i] + x * (b[i] - a[i]));
                Some((w.x, p, self.surface.gradient(p)))
            })
            .collect();
        lap(&mut self.drawn, 5);
        let (lo, hi) = (self.surface.polynomial.lo, self.surface.polynomial.hi);
        let (middle, half) = ((lo + hi) * 0.5, (hi - lo) * 0.5);
        let rays = view.generator();
        for (x, p, g) in found {
            let world = |v: [T; 3]| DVec3::from_array(v.map(T::to_f64));
            let normal = (world(g) / half).normalize_or_zero().as_vec3().to_array();
            let at = y * view.width + x;
            self.drawn.points[at] = middle + world(p) * half;
            self.drawn.colours[at] = shade([0.8; 3], normal, rays.ray(x, y).direction);
        }
        lap(&mut self.drawn, 6);
    }

    /// The polynomials of the rays that are left, and only these rays.
    fn compose(&mut self, v: T) {
        self.polynomials.clear();
        if let Some(form) = &self.form {
            let v = weights(v);
            let shared = (self.how == Composition::FrustumRows).then(|| form.row(&v));
            for w in &self.ways {
                let u = &self.columns[w.x];
                let mut p = shared.as_ref().map_or_else(|| form.ray(u, &v), |row| row.ray(u));
                scaled::to_bernstein(&mut p);
                if self.extent == Extent::Box {
                    bernstein::restrict(&mut p, w.span[0], w.span[1]);
                }
                self.polynomials.push(p);
            }
        } else {
            let (surface, how, polynomials) = (self.surface, self.how, &mut self.polynomials);
            self.ways.retain(|w| {
                let p = surface.composed(how, w.ends[0], w.ends[1]);
                polynomials.extend(p);
                p.is_some()
            });
        }
        self.drawn.composed += self.polynomials.len();
    }
}

/// Cuts a ray to the box, local -1 to 1; whether anything is left.
fn clip<T: Scalar + Real>(w: &mut Way<T>) -> bool {
    let one = <T as Scalar>::ONE;
    let [a, b] = w.ends;
    let [mut t0, mut t1] = w.span;
    for i in 0..3 {
        let d = b[i] - a[i];
        if d == <T as Scalar>::ZERO {
            if Real::abs(a[i]) > one {
                return false;
            }
            continue;
        }
        let (p, q) = ((-one - a[i]) / d, (one - a[i]) / d);
        t0 = t0.larger(p.smaller(q));
        t1 = t1.smaller(p.larger(q));
    }
    w.span = [t0, t1];
    w.ends = w.span.map(|t| std::array::from_fn(|i| a[i] + t * (b[i] - a[i])));
    t0 < t1
}
