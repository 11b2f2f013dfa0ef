//! Grid reconstructions: trilinear, quadratic and cubic B-spline, plain and interpolating.
//!
//! Uniform tensor-product B-splines over the samples of a [`Grid`] (index space, [`isobar_core::Lattice`]). The plain kinds use the samples
//! as coefficients; the interpolating ones solve for coefficients first (`prefilter.rs`). Corrections to the
//! printed matrices and the moments: maths, section B.

use crate::enclose::piece;
use crate::evaluate::Coefs;
use crate::prefilter::Prefilter;
use crate::{Border, Kind};
use glam::{DMat3, DVec3};
use isobar_core::{Basis1, DataError, Domain, Function, Grid, Interval, Lattice, Samples, Stage, Structure};
use rayon::prelude::*;
use std::sync::Arc;

/// The coefficients a spline uses, x fastest, as many as the grid has samples.
#[derive(Clone, Copy, Debug)]
pub enum Coefficients<'a> {
    /// The grid's own samples, shared.
    Samples(&'a Samples),
    /// Prefiltered, rounded to f32.
    F32(&'a [f32]),
    /// Prefiltered, f64.
    F64(&'a [f64]),
}

/// Coefficients other than the samples.
#[derive(Clone, Debug)]
enum Own {
    None,
    F32(Arc<Vec<f32>>),
    F64(Arc<Vec<f64>>),
}

/// A tensor-product spline reconstruction of a grid. Cloning shares everything.
#[derive(Clone, Debug)]
pub struct GridSpline {
    kind: Kind,
    grid: Grid,
    own: Own,
    domain: Domain,
    /// World displacement to local, where the axes are not the world's; the exact diagonal otherwise.
    to_local: ToLocal,
}

#[derive(Clone, Copy, Debug)]
enum ToLocal {
    Divide(DVec3),
    Multiply(DMat3),
}

/// Runs `$body` with `$c` bound to the typed coefficients.
macro_rules! coefs {
    ($self:expr, $c:ident => $body:expr) => {{
        let (dims, border) = ($self.grid.dims, $self.kind.border());
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

impl GridSpline {
    /// The reconstruction of `grid`. `stage` matters to the interpolating kinds only: [`Stage::Ideal`] keeps their coefficients in f64,
    /// [`Stage::Stored`] rounds these to f32. The prefilter takes O(n) time on all threads and, for f32, about `2 sqrt(nz)`
    /// slices of f64 scratch; the plain kinds take no memory.
    ///
    /// # Errors
    /// [`DataError::TooThin`] where an axis has less than 2 samples, [`DataError::NotFinite`] where a sample is NaN or infinite,
    /// [`DataError::Unknown`] where coefficients overflow f32.
    pub fn new(grid: &Grid, kind: Kind, stage: Stage) -> Result<Self, DataError> {
        if grid.dims.iter().any(|&n| n < 2) {
            return Err(DataError::TooThin {
                reconstruction: kind.name().into(),
                dims: grid.dims,
            });
        }
        if let Samples::F32(s) = &grid.samples
            && !s.par_chunks(1 << 16).all(|c| c.iter().all(|v| v.is_finite()))
        {
            grid.require_finite()?;
        }
        let own = if kind.interpolates() {
            match &grid.samples {
                Samples::U8(s) => prefiltered(s, grid.dims, kind, stage),
                Samples::I16(s) => prefiltered(s, grid.dims, kind, stage),
                Samples::U16(s) => prefiltered(s, grid.dims, kind, stage),
                Samples::F32(s) => prefiltered(s, grid.dims, kind, stage),
            }
        } else {
            Own::None
        };
        if let (Samples::F32(_), Own::F32(c)) = (&grid.samples, &own)
            && !c.par_chunks(1 << 16).all(|c| c.iter().all(|v| v.is_finite()))
        {
            return Err(DataError::Unknown(format!(
                "the f32 coefficients of {kind} overflow: samples come too near to 3.4e38; scale them down"
            )));
        }
        let domain = grid.domain();
        let to_local = if domain.is_axis_aligned() {
            ToLocal::Divide(DVec3::new(domain.axes.x_axis.x, domain.axes.y_axis.y, domain.axes.z_axis.z))
        } else {
            ToLocal::Multiply(domain.axes.inverse())
        };
        Ok(Self {
            kind,
            grid: grid.clone(),
            own,
            domain,
            to_local,
        })
    }

    /// Which reconstruction.
    #[must_use]
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The grid reconstructed; its samples are shared.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The coefficients as used: the shared samples, own f32 (interpolating, Stored) or own f64 (interpolating, Ideal).
    #[must_use]
    #[inline]
    pub fn coefficients(&self) -> Coefficients<'_> {
        match &self.own {
            Own::None => Coefficients::Samples(&self.grid.samples),
            Own::F32(c) => Coefficients::F32(c),
            Own::F64(c) => Coefficients::F64(c),
        }
    }

    /// Bytes of coefficients beyond the shared samples.
    #[must_use]
    pub fn own_bytes(&self) -> usize {
        match &self.own {
            Own::None => 0,
            Own::F32(c) => size_of_val(c.as_slice()),
            Own::F64(c) => size_of_val(c.as_slice()),
        }
    }

    /// Where coefficients beyond the grid come from.
    #[must_use]
    pub fn border(&self) -> Border {
        self.kind.border()
    }

    /// Local coordinates of the point of the domain nearest to a world point (per local coordinate).
    #[inline]
    fn clamped(&self, x: DVec3) -> DVec3 {
        let d = x - self.domain.origin;
        let u = match self.to_local {
            ToLocal::Divide(s) => d / s,
            ToLocal::Multiply(m) => m * d,
        };
        u.max(self.domain.lo).min(self.domain.hi)
    }
}

fn prefiltered<S: Copy + Into<f64> + Sync>(s: &[S], dims: [usize; 3], kind: Kind, stage: Stage) -> Own {
    let p = Prefilter::new(s, dims, kind.basis().degree);
    match stage {
        Stage::Ideal => Own::F64(Arc::new(p.ideal())),
        Stage::Stored => Own::F32(Arc::new(p.stored())),
    }
}

/// Boxes that touch at most this many cells are enclosed piece by piece, larger ones by the coefficients' range.
const PIECES: usize = 27;

impl Function for GridSpline {
    fn name(&self) -> String {
        self.kind.name().into()
    }

    fn domain(&self) -> &Domain {
        &self.domain
    }

    fn value(&self, x: DVec3) -> f64 {
        let u = self.clamped(x);
        coefs!(self, c => c.value(self.kind.basis().degree, u))
    }

    fn gradient(&self, x: DVec3) -> DVec3 {
        let u = self.clamped(x);
        let g = coefs!(self, c => c.gradient(self.kind.basis().degree, u));
        match self.to_local {
            ToLocal::Divide(s) => g / s,
            ToLocal::Multiply(m) => m.transpose() * g,
        }
    }

    fn enclosure(&self, lo: DVec3, hi: DVec3) -> Interval {
        let basis = self.kind.basis();
        let (lo, hi) = (
            lo.max(self.domain.lo).min(self.domain.hi),
            hi.min(self.domain.hi).max(self.domain.lo),
        );
        let shift = if basis.centred { 0.5 } else { 0.0 };
        let cells = self.cells();
        let mut first = [0; 3];
        let mut last = [0; 3];
        for a in 0..3 {
            first[a] = ((lo[a] + shift).floor() as usize).min(cells[a] - 1);
            last[a] = (((hi[a] + shift).ceil() as usize).max(1) - 1).clamp(first[a], cells[a] - 1);
            // The sums may round onto an integer; the differences are exact there and say so.
            if first[a] > 0 && lo[a] - (first[a] as f64) < -shift {
                first[a] -= 1;
            }
            if last[a] + 1 < cells[a] && hi[a] - last[a] as f64 > 1.0 - shift {
                last[a] += 1;
            }
        }
        let count: usize = (0..3).map(|a| last[a] - first[a] + 1).product();
        if count > PIECES {
            return self.range(first, last);
        }
        let mut stencil = [0.0; 64];
        let mut all: Option<Interval> = None;
        for k in first[2]..=last[2] {
            for j in first[1]..=last[1] {
                for i in first[0]..=last[0] {
                    let cell = [i, j, k];
                    self.stencil(cell, &mut stencil);
                    let part = |u: DVec3| std::array::from_fn(|a| (u[a] - cell[a] as f64 + shift).clamp(0.0, 1.0));
                    let e = piece(basis.degree, &stencil, part(lo), part(hi));
                    all = Some(all.map_or(e, |x| x.union(e)));
                }
            }
        }
        all.unwrap_or(Interval::ALL)
    }

    fn structure(&self) -> Structure<'_> {
        Structure::Lattice(self)
    }
}

impl Lattice for GridSpline {
    fn dims(&self) -> [usize; 3] {
        self.grid.dims
    }

    fn basis(&self) -> &'static Basis1 {
        self.kind.basis()
    }

    fn stencil(&self, cell: [usize; 3], out: &mut [f64; 64]) {
        coefs!(self, c => match self.kind.basis().degree {
            1 => c.rows::<2>(cell, |j, k, row| out[(k * 2 + j) * 2..][..2].copy_from_slice(&row)),
            2 => c.rows::<3>(cell, |j, k, row| out[(k * 3 + j) * 3..][..3].copy_from_slice(&row)),
            _ => c.rows::<4>(cell, |j, k, row| out[(k * 4 + j) * 4..][..4].copy_from_slice(&row)),
        });
    }

    fn range(&self, lo: [usize; 3], hi: [usize; 3]) -> Interval {
        let degree = self.kind.basis().degree;
        let before = degree / 2;
        let after = degree - before;
        let dims = self.grid.dims;
        // What the border rule takes from elsewhere lies inside the cut block, with either rule.
        let from = std::array::from_fn(|a| lo[a].saturating_sub(before).min(dims[a] - 1));
        let to = std::array::from_fn(|a| (hi[a] + after).clamp(from[a], dims[a] - 1));
        let (a, b) = coefs!(self, c => c.range(from, to));
        Interval::new(a, b)
    }
}
