//! Figures 6.2 to 6.5: a volume in degrees 1, 2 and 3, and the bricks that have to be looked into.

use super::Image;
use isobar_core::{DVec3, Domain, Grid, View, shade, to_srgb8};
use isobar_fields::Kind;
use rayon::prelude::*;

/// The reconstructions of the figures.
pub const KINDS: [Kind; 3] = [Kind::Trilinear, Kind::Quadratic, Kind::Cubic];

/// Which bricks have samples on both sides of the isovalue, as the caster of degree 1 has it.
#[derive(Debug, Clone)]
pub struct Bricks {
    domain: Domain,
    /// Cells along a brick.
    pub side: usize,
    /// Bricks per axis.
    pub count: [usize; 3],
    /// Whether a surface may meet it; x fastest.
    pub active: Vec<bool>,
}

impl Bricks {
    /// The bricks of `side`^3 cells, at least 1; on the current rayon pool.
    #[must_use]
    pub fn new(grid: &Grid, isovalue: f64, side: usize) -> Self {
        let side = side.max(1);
        let count = grid.dims.map(|n| n.saturating_sub(1).div_ceil(side).max(1));
        let layers: Vec<Vec<bool>> = (0..count[2])
            .into_par_iter()
            .map(|k| layer(grid, isovalue, side, count, k))
            .collect();
        Self {
            domain: grid.domain(),
            side,
            count,
            active: layers.concat(),
        }
    }

    /// How many are active.
    #[must_use]
    pub fn active(&self) -> usize {
        self.active.iter().filter(|a| **a).count()
    }

    /// The nearest active brick of every pixel, its edges darker where bricks are wide enough to show them; white where there is none.
    #[must_use]
    pub fn image(&self, view: &View) -> Image {
        Image::new(view, |i| to_srgb8(self.colour(view, i % view.width, i / view.width)))
    }

    /// The first active brick along the ray of a pixel.
    fn colour(&self, view: &View, x: usize, y: usize) -> [f32; 4] {
        let ray = view.ray(x, y);
        let (o, d) = (self.domain.local(ray.origin), self.domain.local_vector(ray.direction));
        let Some((mut t, end)) = self.domain.clip(&ray) else {
            return [0.0; 4];
        };
        let side = self.side as f64;
        // The face by which the ray enters the volume.
        let entry = |a: usize| {
            let q = (o + d * t)[a];
            (q - self.domain.lo[a]).abs().min((q - self.domain.hi[a]).abs())
        };
        let mut axis = (1..3).fold(0, |m, a| if entry(a) < entry(m) { a } else { m });
        while t <= end {
            // A little beyond the face that was passed.
            let p = (o + d * (t + 1e-9 * (1.0 + t.abs()))) / side;
            let at = [0, 1, 2].map(|a| (p[a].floor().max(0.0) as usize).min(self.count[a] - 1));
            if self.active[(at[2] * self.count[1] + at[1]) * self.count[0] + at[0]] {
                let q = (o + d * t) / side;
                let near = |a: usize| (q[a] - at[a] as f64 - 0.5).abs() > 0.44;
                let wide = view.footprint(t) < 0.12 * side * self.domain.voxel();
                let edge = wide && (0..3).filter(|&a| a != axis).any(near);
                let normal = self.domain.world_gradient(DVec3::AXES[axis]).normalize_or_zero();
                let [r, g, b] = shade([0.9, 0.75, 0.35], normal.as_vec3().to_array(), ray.direction);
                let [r, g, b] = [r, g, b].map(|c| if edge { 0.4 * c } else { c });
                return [r, g, b, 1.0];
            }
            let exit = |a: usize| {
                let plane = if d[a] > 0.0 { at[a] + 1 } else { at[a] };
                if d[a] == 0.0 {
                    f64::INFINITY
                } else {
                    (plane as f64 * side - o[a]) / d[a]
                }
            };
            let exits = [exit(0), exit(1), exit(2)];
            axis = (0..3).fold(0, |m, a| if exits[a] < exits[m] { a } else { m });
            t = exits[axis].max(t + 1e-12 * (1.0 + t.abs()));
        }
        [0.0; 4]
    }
}

/// The bricks of one layer, from all samples at their corners and between.
fn layer(grid: &Grid, isovalue: f64, side: usize, count: [usize; 3], k: usize) -> Vec<bool> {
    let [nx, ny, nz] = grid.dims;
    let mut range = vec![(f64::INFINITY, f64::NEG_INFINITY); count[0] * count[1]];
    // A sample belongs to the bricks on both sides of it.
    let of = |i: usize, n: usize| i.saturating_sub(1) / side..=(i / side).min(n - 1);
    for z in k * side..=((k + 1) * side).min(nz - 1) {
        for y in 0..ny {
            let first = (z * ny + y) * nx;
            for i in 0..count[0] {
                let samples = i * side..=((i + 1) * side).min(nx - 1);
                let (lo, hi) = samples.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| {
                    let v = grid.samples.get(first + x);
                    (lo.min(v), hi.max(v))
                });
                for j in of(y, count[1]) {
                    let r = &mut range[j * count[0] + i];
                    *r = (r.0.min(lo), r.1.max(hi));
                }
            }
        }
    }
    range.into_iter().map(|(lo, hi)| lo <= isovalue && isovalue <= hi).collect()
}
