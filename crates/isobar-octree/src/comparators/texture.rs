//! Fast tri-cubic texture sampling after Sigg and Hadwiger (GPU Gems 2, chapter 20), with the weights of a texture unit (thesis, section 6.2 and Figure 6.6).
//!
//! A cubic B-spline's value is eight tri-linear fetches instead of 64 coefficients: along an axis w0 c0 + w1 c1 is (w0 + w1) times a linear interpolation at
//! w1 / (w0 + w1), and likewise for c2 and c3. A texture unit rounds the fraction of a fetch to few bits: NVIDIA's has nine, of which
//! one is before the point, so that 1 is exact and the fraction has eight. Everything else is f32, as in a shader. Gradients are eight fetches per component, with the derivatives of the weights.
//!
//! The surface is found by sampling: the first change of sign between two samples, then halving (Hadwiger et al. 2005). **No guarantee**: pairs of roots within a step are
//! lost, and the isosurface itself is that of the rounded function.

use glam::DVec3;
use isobar_core::{DataError, Domain, Grid, Ray};

/// Bits after the point of NVIDIA's 9-bit interpolation weights (CUDA programming guide, linear filtering: "9-bit fixed point format with 8 bits of fractional
/// value").
pub const FRACTION_BITS: u32 = 8;

/// A volume as a texture: samples at whole index coordinates, clamped at the edges.
#[derive(Debug, Clone)]
pub struct Texture {
    samples: Vec<f32>,
    dims: [usize; 3],
    domain: Domain,
    /// 2^bits; infinite: fractions are not rounded.
    steps: f32,
}

/// How to look for the surface along a ray; lengths in voxels of the finest axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct March {
    /// Step far from the surface, positive.
    pub step: f64,
    /// Step where a sample is within `near` of the isovalue.
    pub fine: f64,
    /// Units of the samples.
    pub near: f64,
    /// Halvings once the sign has changed.
    pub halvings: u32,
}

/// The first change of sign along a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Parameter along the ray.
    pub t: f64,
    /// Unit normal along the gradient in the world; zero where it vanishes.
    pub normal: DVec3,
    /// Values sampled, eight fetches each.
    pub samples: u32,
}

/// Weights of the four coefficients at fraction x of a cell, and their derivatives.
fn weights(x: f32) -> [[f32; 4]; 2] {
    let y = 1.0 - x;
    let (x2, y2) = (x * x, y * y);
    [
        [
            y2 * y / 6.0,
            (4.0 - 3.0 * x2 * (2.0 - x)) / 6.0,
            (4.0 - 3.0 * y2 * (2.0 - y)) / 6.0,
            x2 * x / 6.0,
        ],
        [-0.5 * y2, 0.5 * x * (3.0 * x - 4.0), 0.5 * y * (4.0 - 3.0 * y), 0.5 * x2],
    ]
}

/// The two fetches of an axis: weights g and places.
#[derive(Clone, Copy)]
struct Pair {
    weight: [f32; 2],
    at: [f32; 2],
}

/// From the cell's index and one row of [`weights`].
fn pair(cell: f32, w: [f32; 4]) -> Pair {
    let weight = [w[0] + w[1], w[2] + w[3]];
    // Only the pairs of derivatives can both vanish, and then the fetch has no weight.
    let part = |of: f32, all: f32| if all == 0.0 { 0.0 } else { of / all };
    Pair {
        weight,
        at: [cell - 1.0 + part(w[1], weight[0]), cell + 1.0 + part(w[3], weight[1])],
    }
}

impl Texture {
    /// The cubic B-spline with the samples of `grid` as coefficients. `bits`: bits of a fetch's fraction, at most 20; `None`: fractions as f32 has them.
    ///
    /// # Errors
    /// [`DataError::TooThin`] where an axis has less than 2 samples, [`DataError::Unknown`] for more than 20 bits; [`DataError::NotFinite`].
    pub fn new(grid: &Grid, bits: Option<u32>) -> Result<Self, DataError> {
        if grid.dims.iter().any(|&n| n < 2) {
            return Err(DataError::TooThin {
                reconstruction: "cubic".to_owned(),
                dims: grid.dims,
            });
        }
        if let Some(bits) = bits.filter(|&b| b > 20) {
            return Err(DataError::Unknown(format!(
                "{bits} bits for the fraction of a fetch are more than f32 holds; use at most 20"
            )));
        }
        grid.require_finite()?;
        Ok(Self {
            samples: (0..grid.samples.len()).map(|i| grid.samples.get(i) as f32).collect(),
            dims: grid.dims,
            domain: grid.domain(),
            steps: bits.map_or(f32::INFINITY, |b| (1u32 << b) as f32),
        })
    }

    /// Index and fraction of a fetch along an axis.
    #[inline]
    fn place(&self, x: f32) -> (isize, f32) {
        let whole = x.floor();
        let fraction = x - whole;
        let fraction = if self.steps.is_finite() {
            (fraction * self.steps).round() / self.steps
        } else {
            fraction
        };
        (whole as isize, fraction)
    }

    /// One tri-linear fetch at index coordinates: three interpolations with rounded fractions.
    #[must_use]
    pub fn fetch(&self, p: [f32; 3]) -> f32 {
        let [(x, fx), (y, fy), (z, fz)] = p.map(|x| self.place(x));
        let clamp = |i: isize, a: usize| i.clamp(0, self.dims[a] as isize - 1) as usize;
        let (x, y, z) = (
            [clamp(x, 0), clamp(x + 1, 0)],
            [clamp(y, 1), clamp(y + 1, 1)],
            [clamp(z, 2), clamp(z + 1, 2)],
        );
        let mix = |a: f32, b: f32, f: f32| (1.0 - f) * a + f * b;
        let row = |j: usize, k: usize| {
            let first = (z[k] * self.dims[1] + y[j]) * self.dims[0];
            mix(self.samples[first + x[0]], self.samples[first + x[1]], fx)
        };
        mix(mix(row(0, 0), row(1, 0), fy), mix(row(0, 1), row(1, 1), fy), fz)
    }

    /// Eight fetches.
    fn eight(&self, [x, y, z]: [Pair; 3]) -> f32 {
        let mut sum = 0.0;
        for k in 0..2 {
            for j in 0..2 {
                for i in 0..2 {
                    let g = x.weight[i] * y.weight[j] * z.weight[k];
                    sum += g * self.fetch([x.at[i], y.at[j], z.at[k]]);
                }
            }
        }
        sum
    }

    /// Per axis the fetches for the value and those for the derivative.
    fn pairs(&self, p: [f32; 3]) -> [[Pair; 2]; 3] {
        p.map(|x| {
            let cell = x.floor();
            weights(x - cell).map(|w| pair(cell, w))
        })
    }

    /// The spline at index coordinates.
    #[must_use]
    pub fn value(&self, p: [f32; 3]) -> f32 {
        let [x, y, z] = self.pairs(p);
        self.eight([x[0], y[0], z[0]])
    }

    /// Its gradient by index coordinates.
    #[must_use]
    pub fn gradient(&self, p: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.pairs(p);
        [
            self.eight([x[1], y[0], z[0]]),
            self.eight([x[0], y[1], z[0]]),
            self.eight([x[0], y[0], z[1]]),
        ]
    }

    /// Index coordinates of a world point.
    fn index(&self, x: DVec3) -> DVec3 {
        self.domain.axes.inverse() * (x - self.domain.origin)
    }

    /// Unit normal in the world at a world point of the domain; zero where the gradient vanishes.
    #[must_use]
    pub fn normal(&self, x: DVec3) -> DVec3 {
        let g = self.gradient(self.index(x).as_vec3().to_array());
        let g = DVec3::from_array(g.map(f64::from));
        (self.domain.axes.inverse().transpose() * g).normalize_or_zero()
    }

    /// The first change of sign of the spline less `isovalue` along the part of the ray inside the domain; `None` where samples show none.
    #[must_use]
    pub fn first(&self, ray: &Ray, isovalue: f64, march: &March) -> Option<Found> {
        let (o, d) = (self.index(ray.origin), self.domain.axes.inverse() * ray.direction);
        let (mut t, mut end) = (0.0f64, f64::INFINITY);
        for a in 0..3 {
            if d[a] == 0.0 {
                if !(self.domain.lo[a]..=self.domain.hi[a]).contains(&o[a]) {
                    return None;
                }
                continue;
            }
            let (p, q) = ((self.domain.lo[a] - o[a]) / d[a], (self.domain.hi[a] - o[a]) / d[a]);
            t = t.max(p.min(q));
            end = end.min(p.max(q));
        }
        let speed = d.abs().max_element();
        let smallest = march.step.min(march.fine) / speed;
        // What is not a number marches nowhere.
        let marches = t <= end && smallest > 0.0 && smallest.is_finite();
        if !marches {
            return None;
        }
        let mut samples = 0;
        let mut sample = |t: f64| {
            samples += 1;
            f64::from(self.value((o + d * t).as_vec3().to_array())) - isovalue
        };
        let mut before = sample(t);
        while t < end {
            let step = if before.abs() < march.near { march.fine } else { march.step } / speed;
            let next = (t + step).min(end);
            let after = sample(next);
            if (before < 0.0) == (after < 0.0) {
                // A step that rounding swallows ends the march.
                if next <= t {
                    return None;
                }
                (t, before) = (next, after);
                continue;
            }
            let (mut lo, mut hi) = (t, next);
            for _ in 0..march.halvings {
                let middle = 0.5 * (lo + hi);
                if (sample(middle) < 0.0) == (before < 0.0) {
                    lo = middle;
                } else {
                    hi = middle;
                }
            }
            let t = 0.5 * (lo + hi);
            return Some(Found {
                t,
                normal: self.normal(ray.at(t)),
                samples,
            });
        }
        None
    }
}

/// Angles between unit vectors, degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Angles {
    /// Pairs compared.
    pub count: usize,
    /// Half of them are at most this.
    pub p50: f64,
    /// 99 of 100 are at most this.
    pub p99: f64,
    /// The greatest.
    pub max: f64,
}

impl Angles {
    /// Of the given pairs; those with a vector that is zero are left out. All zero where there are none.
    #[must_use]
    pub fn between(pairs: impl IntoIterator<Item = (DVec3, DVec3)>) -> Self {
        let mut all: Vec<f64> = (pairs.into_iter())
            .filter(|(a, b)| *a != DVec3::ZERO && *b != DVec3::ZERO)
            .map(|(a, b)| a.cross(b).length().atan2(a.dot(b)).to_degrees())
            .collect();
        all.sort_by(f64::total_cmp);
        let at = |share: f64| {
            all.get(((all.len() as f64 * share).ceil() as usize).max(1) - 1)
                .copied()
                .unwrap_or(0.0)
        };
        Self {
            count: all.len(),
            p50: at(0.5),
            p99: at(0.99),
            max: at(1.0),
        }
    }
}
