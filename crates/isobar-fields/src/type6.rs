//! The cubic C1 quasi-interpolating spline on the type-6 tetrahedral partition, as a function.
//!
//! Kalbe, Koch and Goesele 2009, section 3 (the operator is that of Sorokina and Zeilfelder 2007); masks and corrections: maths, section A. Cubes are
//! centred on samples. `type6` takes the samples as data: it reproduces 1, x, y, z, xy, xz, yz, xyz, and `s - f = (h^2/8) Laplacian(f) + O(h^3)`.
//! `type6-prefiltered` takes `f - (sum of the three second differences)/8` instead, which removes that term: value order 3, gradient order 2 (ours, not the
//! paper's; its weights are no longer positive in the samples, but the pieces still lie in the hull of the filtered data).

pub use crate::type6_masks::{DENOMINATOR, INDICES, TYPE6, frame};
pub use crate::type6_patch::{
    DeterminingSet, Number, barycentric, canonical, canonical_gradient, coefficients, coefficients_192, from_canonical, kind_of,
    last_step, reorder, two_steps,
};

use crate::evaluate::{Coefs, locate};
use crate::{Border, Coefficients};
use glam::{DMat3, DVec3};
use isobar_core::{DataError, Domain, Function, Grid, Interval, Samples, Stage, Structure, TetMasks, Tetrahedral};
use rayon::prelude::*;
use std::sync::Arc;

/// Data other than the samples.
#[derive(Clone, Debug)]
enum Own {
    None,
    F32(Arc<Vec<f32>>),
    F64(Arc<Vec<f64>>),
}

/// The spline of a grid. Cloning shares everything.
#[derive(Clone, Debug)]
pub struct Type6Spline {
    grid: Grid,
    own: Own,
    prefiltered: bool,
    domain: Domain,
    /// World displacement to local, where the axes are not the world's.
    to_local: Option<DMat3>,
}

/// Data outside the grid are those of the nearest sample: `c(-1) = c(0)`, also of the filtered data.
const BORDER: Border = Border::Clamp;

/// Runs `$body` with `$c` bound to the typed data.
macro_rules! typed {
    ($self:expr, $c:ident => $body:expr) => {{
        let (dims, border) = ($self.grid.dims, BORDER);
        match $self.coefficients() {
            Coefficients::F32(c) => {
                let $c = Coefs { c, dims, border };
                $body
            }
            Coefficients::F64(c) => {
                let $c = Coefs { c, dims, border };
                $body
            }
            Coefficients::Samples(Samples::U8(c)) => {
                let $c = Coefs { c: &**c, dims, border };
                $body
            }
            Coefficients::Samples(Samples::I16(c)) => {
                let $c = Coefs { c: &**c, dims, border };
                $body
            }
            Coefficients::Samples(Samples::U16(c)) => {
                let $c = Coefs { c: &**c, dims, border };
                $body
            }
            Coefficients::Samples(Samples::F32(c)) => {
                let $c = Coefs { c: &**c, dims, border };
                $body
            }
        }
    }};
}

impl Type6Spline {
    /// The spline of the samples.
    ///
    /// # Errors
    /// [`DataError::TooThin`] where an axis has less than 2 samples, [`DataError::NotFinite`] where a sample is NaN or infinite.
    pub fn new(grid: &Grid) -> Result<Self, DataError> {
        Self::check(grid, "type6")?;
        Ok(Self::with(grid, Own::None, false))
    }

    /// The spline of `f - (sum of the three second differences)/8`, that is `(14 f - sum of the six neighbours)/8` with neighbours outside the grid
    /// clamped. [`Stage::Ideal`] keeps these data in f64 (exact for samples of up to 32 bits whose exponents differ by less than 20), [`Stage::Stored`] rounds them to f32.
    ///
    /// # Errors
    /// As [`Type6Spline::new`]; [`DataError::Unknown`] where filtered data overflow f32.
    pub fn prefiltered(grid: &Grid, stage: Stage) -> Result<Self, DataError> {
        Self::check(grid, "type6-prefiltered")?;
        let data = match &grid.samples {
            Samples::U8(s) => filtered(s, grid.dims),
            Samples::I16(s) => filtered(s, grid.dims),
            Samples::U16(s) => filtered(s, grid.dims),
            Samples::F32(s) => filtered(s, grid.dims),
        };
        let own = match stage {
            Stage::Ideal => Own::F64(Arc::new(data)),
            Stage::Stored => {
                let stored: Vec<f32> = data.par_iter().map(|&v| v as f32).collect();
                if !stored.par_iter().all(|v| v.is_finite()) {
                    return Err(DataError::Unknown(
                        "the f32 data of type6-prefiltered overflow: samples come too near to 3.4e38; scale them down".into(),
                    ));
                }
                Own::F32(Arc::new(stored))
            }
        };
        Ok(Self::with(grid, own, true))
    }

    fn check(grid: &Grid, name: &str) -> Result<(), DataError> {
        if grid.dims.iter().any(|&n| n < 2) {
            return Err(DataError::TooThin {
                reconstruction: name.into(),
                dims: grid.dims,
            });
        }
        if let Samples::F32(s) = &grid.samples
            && !s.par_chunks(1 << 16).all(|c| c.iter().all(|v| v.is_finite()))
        {
            grid.require_finite()?;
        }
        Ok(())
    }

    fn with(grid: &Grid, own: Own, prefiltered: bool) -> Self {
        let domain = grid.domain();
        Self {
            grid: grid.clone(),
            own,
            prefiltered,
            domain,
            to_local: (!domain.is_axis_aligned()).then(|| domain.axes.inverse()),
        }
    }

    /// The grid reconstructed; its samples are shared.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The data as used: the shared samples, or the filtered ones.
    #[must_use]
    pub fn coefficients(&self) -> Coefficients<'_> {
        match &self.own {
            Own::None => Coefficients::Samples(&self.grid.samples),
            Own::F32(c) => Coefficients::F32(c),
            Own::F64(c) => Coefficients::F64(c),
        }
    }

    /// Bytes of data beyond the shared samples.
    #[must_use]
    pub fn own_bytes(&self) -> usize {
        match &self.own {
            Own::None => 0,
            Own::F32(c) => size_of_val(c.as_slice()),
            Own::F64(c) => size_of_val(c.as_slice()),
        }
    }

    /// The b^[2] at the point of the domain nearest to x, with the kind and the barycentric coordinates there.
    fn at(&self, x: DVec3) -> ([f64; 4], usize, [f64; 4]) {
        let u = (self.local_vector(x - self.domain.origin))
            .max(self.domain.lo)
            .min(self.domain.hi);
        let at = [0, 1, 2].map(|a| locate(u[a], self.grid.dims[a], true));
        let p = at.map(|(_, w)| w - 0.5);
        let mut data = [0.0; 27];
        self.data(at.map(|(i, _)| i), &mut data);
        let kind = kind_of(p);
        let phi = barycentric(canonical(kind, p));
        (two_steps(&coefficients(&reorder(kind, &data)), phi), kind, phi)
    }

    fn local_vector(&self, v: DVec3) -> DVec3 {
        match self.to_local {
            None => {
                let a = self.domain.axes;
                v / DVec3::new(a.x_axis.x, a.y_axis.y, a.z_axis.z)
            }
            Some(m) => m * v,
        }
    }
}

fn filtered<S: Copy + Into<f64> + Sync>(s: &[S], [nx, ny, nz]: [usize; 3]) -> Vec<f64> {
    let mut out = vec![0.0; s.len()];
    out.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
        let (j, k) = (row % ny, row / ny);
        let at = |i: usize, j: usize, k: usize| -> f64 { s[(k * ny + j) * nx + i].into() };
        let beside = |i: usize, n: usize| (i.saturating_sub(1), (i + 1).min(n - 1));
        let ((j0, j1), (k0, k1)) = (beside(j, ny), beside(k, nz));
        for (i, o) in out.iter_mut().enumerate() {
            let (i0, i1) = beside(i, nx);
            let neighbours = (at(i0, j, k) + at(i1, j, k)) + (at(i, j0, k) + at(i, j1, k)) + (at(i, j, k0) + at(i, j, k1));
            *o = (14.0 * at(i, j, k) - neighbours) * 0.125;
        }
    });
    out
}

impl Function for Type6Spline {
    fn name(&self) -> String {
        if self.prefiltered { "type6-prefiltered" } else { "type6" }.into()
    }

    fn domain(&self) -> &Domain {
        &self.domain
    }

    fn value(&self, x: DVec3) -> f64 {
        let (l, _, phi) = self.at(x);
        last_step(l, phi)
    }

    fn gradient(&self, x: DVec3) -> DVec3 {
        let (l, kind, _) = self.at(x);
        let g = DVec3::from_array(from_canonical(kind, canonical_gradient(l)));
        match self.to_local {
            None => {
                let a = self.domain.axes;
                g / DVec3::new(a.x_axis.x, a.y_axis.y, a.z_axis.z)
            }
            Some(m) => m.transpose() * g,
        }
    }

    fn enclosure(&self, lo: DVec3, hi: DVec3) -> Interval {
        let (lo, hi) = (
            lo.max(self.domain.lo).min(self.domain.hi),
            hi.min(self.domain.hi).max(self.domain.lo),
        );
        crate::type6_enclose::enclosure(self, lo, hi)
    }

    fn structure(&self) -> Structure<'_> {
        Structure::Tetrahedral(self)
    }
}

impl Tetrahedral for Type6Spline {
    fn dims(&self) -> [usize; 3] {
        self.grid.dims
    }

    fn masks(&self) -> &'static TetMasks {
        &TYPE6
    }

    fn data(&self, cube: [usize; 3], out: &mut [f64; 27]) {
        typed!(self, c => c.rows::<3>(cube, |j, k, row| out[(k * 3 + j) * 3..][..3].copy_from_slice(&row)));
    }

    fn range(&self, lo: [usize; 3], hi: [usize; 3]) -> Interval {
        let dims = self.grid.dims;
        let from = std::array::from_fn(|a| lo[a].saturating_sub(1).min(dims[a] - 1));
        let to = std::array::from_fn(|a| (hi[a] + 1).clamp(from[a], dims[a] - 1));
        let (a, b) = typed!(self, c => c.range(from, to));
        Interval::new(a, b)
    }
}
