//! Coefficients with which a B-spline passes through its samples.
//!
//! Per axis the system is `(c[i-1] + m c[i] + c[i+1]) / q = s[i]` with m, q = 6, 8 (quadratic) or 4, 6 (cubic) and the
//! mirror rows `(m c[0] + 2 c[1]) / q = s[0]` at both ends (maths: corrections, section B; the border rule is [`crate::Border::Mirror`]).
//! It is diagonally dominant, so elimination without pivoting (Thomas) solves it stably in O(n); the three axes one after the other.
//! All arithmetic is f64. The result for f32 storage is the f64 result rounded once: the z recurrence runs forward over the
//! whole grid keeping one slice per block, then backward block by block with the forward values of the block made again, so that about
//! `2 sqrt(nz)` slices of f64 are the only scratch.

use rayon::prelude::*;

/// The elimination of one axis: `d[i] = (q s[i] - a[i] d[i-1]) w[i]`, then `c[i] = d[i] - e[i] c[i+1]`.
struct Axis {
    /// Sub-diagonal times `w`.
    aw: Vec<f64>,
    w: Vec<f64>,
    e: Vec<f64>,
}

impl Axis {
    /// The axis of `n >= 2` coefficients with centre weight `m`.
    fn new(n: usize, m: f64) -> Self {
        let (mut aw, mut w, mut e) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        for i in 0..n {
            let (below, above) = match i {
                0 => (0.0, 2.0),
                _ if i == n - 1 => (2.0, 0.0),
                _ => (1.0, 1.0),
            };
            w[i] = 1.0 / (m - if i == 0 { 0.0 } else { below * e[i - 1] });
            aw[i] = below * w[i];
            e[i] = above * w[i];
        }
        Self { aw, w, e }
    }
}

/// Everything about one grid.
pub(crate) struct Prefilter<'a, S> {
    samples: &'a [S],
    dims: [usize; 3],
    /// q^3, exact in f64.
    scale: f64,
    axes: [Axis; 3],
}

/// Rows solved at a time, so that the recurrences of neighbours overlap in the pipeline.
const ROWS: usize = 4;
/// Elements of one slice a task takes in the z recurrence.
const CHUNK: usize = 1 << 13;

impl<'a, S: Copy + Into<f64> + Sync> Prefilter<'a, S> {
    /// For samples of `dims` (each at least 2), of degree 2 or 3.
    pub(crate) fn new(samples: &'a [S], dims: [usize; 3], degree: usize) -> Self {
        let (m, q): (f64, f64) = if degree == 2 { (6.0, 8.0) } else { (4.0, 6.0) };
        Self {
            samples,
            dims,
            scale: q * q * q,
            axes: dims.map(|n| Axis::new(n, m)),
        }
    }

    /// The coefficients in f64.
    pub(crate) fn ideal(&self) -> Vec<f64> {
        let mut all = vec![0.0; self.samples.len()];
        self.planes(0, &mut all);
        self.forward(0, &mut all, None);
        self.backward(0, &mut all, None);
        all
    }

    /// The coefficients of [`Prefilter::ideal`], each rounded to f32, with about `2 sqrt(nz)` slices of scratch.
    pub(crate) fn stored(&self) -> Vec<f32> {
        let [nx, ny, nz] = self.dims;
        let slice = nx * ny;
        let block = (1..).find(|b| b * b >= nz).unwrap_or(1).max(rayon::current_num_threads());
        let mut scratch = vec![0.0; block.min(nz) * slice];
        let starts: Vec<usize> = (0..nz).step_by(block).collect();
        // Forward: keep the last slice of every block but the last.
        let mut kept: Vec<Vec<f64>> = Vec::with_capacity(starts.len());
        for &k in &starts[..starts.len() - 1] {
            self.planes(k, &mut scratch);
            self.forward(k, &mut scratch, kept.last().map(Vec::as_slice));
            kept.push(scratch[(block - 1) * slice..].to_vec());
        }
        // Backward, with the forward values of each block made again.
        let mut out = vec![0.0f32; self.samples.len()];
        let mut above: Option<Vec<f64>> = None;
        for (b, &k) in starts.iter().enumerate().rev() {
            let part = &mut scratch[..block.min(nz - k) * slice];
            self.planes(k, part);
            self.forward(k, part, b.checked_sub(1).map(|b| kept[b].as_slice()));
            self.backward(k, part, above.as_deref());
            out[k * slice..][..part.len()]
                .par_chunks_mut(CHUNK)
                .zip(part.par_chunks(CHUNK))
                .for_each(|(to, from)| to.iter_mut().zip(from).for_each(|(t, &f)| *t = f as f32));
            above = Some(part[..slice].to_vec());
            kept.truncate(b);
        }
        out
    }

    /// Fills slices `k0..` with the scaled samples, solved along x and y.
    fn planes(&self, k0: usize, out: &mut [f64]) {
        let [nx, ny, _] = self.dims;
        out.par_chunks_mut(nx * ny).enumerate().for_each(|(k, plane)| {
            let from = &self.samples[(k0 + k) * nx * ny..][..nx * ny];
            for (to, &s) in plane.iter_mut().zip(from) {
                *to = self.scale * s.into();
            }
            for rows in plane.chunks_mut(ROWS * nx) {
                solve_rows(&self.axes[0], nx, rows);
            }
            let y = &self.axes[1];
            for j in 0..ny {
                let (before, now) = plane[..(j + 1) * nx].split_at_mut(j * nx);
                let before = (j > 0).then(|| &before[(j - 1) * nx..]);
                step_forward(y.aw[j], y.w[j], now, before);
            }
            for j in (0..ny - 1).rev() {
                let (now, after) = plane[j * nx..(j + 2) * nx].split_at_mut(nx);
                step_back(y.e[j], now, after);
            }
        });
    }

    /// The forward recurrence along z over slices `k0..`; `before` is slice `k0 - 1` after it.
    fn forward(&self, k0: usize, part: &mut [f64], before: Option<&[f64]>) {
        let slice = self.dims[0] * self.dims[1];
        let z = &self.axes[2];
        for k in 0..part.len() / slice {
            let (done, now) = part[..(k + 1) * slice].split_at_mut(k * slice);
            let before = if k > 0 { Some(&done[(k - 1) * slice..]) } else { before };
            let (aw, w) = (z.aw[k0 + k], z.w[k0 + k]);
            match before {
                Some(b) => now
                    .par_chunks_mut(CHUNK)
                    .zip(b.par_chunks(CHUNK))
                    .for_each(|(n, b)| step_forward(aw, w, n, Some(b))),
                None => now.par_chunks_mut(CHUNK).for_each(|n| step_forward(aw, w, n, None)),
            }
        }
    }

    /// Back substitution along z over slices `k0..`; `above` is the coefficient slice after the last.
    fn backward(&self, k0: usize, part: &mut [f64], above: Option<&[f64]>) {
        let slice = self.dims[0] * self.dims[1];
        let count = part.len() / slice;
        for k in (0..count).rev() {
            let (now, after) = part[k * slice..].split_at_mut(slice);
            let after = if k + 1 < count { Some(&after[..slice]) } else { above };
            if let Some(after) = after {
                let e = self.axes[2].e[k0 + k];
                now.par_chunks_mut(CHUNK)
                    .zip(after.par_chunks(CHUNK))
                    .for_each(|(n, a)| step_back(e, n, a));
            }
        }
    }
}

fn step_forward(aw: f64, w: f64, now: &mut [f64], before: Option<&[f64]>) {
    match before {
        Some(b) => now.iter_mut().zip(b).for_each(|(n, b)| *n = *n * w - b * aw),
        None => now.iter_mut().for_each(|n| *n *= w),
    }
}

fn step_back(e: f64, now: &mut [f64], after: &[f64]) {
    now.iter_mut().zip(after).for_each(|(n, a)| *n -= e * a);
}

/// Solves up to [`ROWS`] rows of length `n` along themselves.
fn solve_rows(x: &Axis, n: usize, rows: &mut [f64]) {
    if rows.len() == ROWS * n {
        let (a, rest) = rows.split_at_mut(n);
        let (b, rest) = rest.split_at_mut(n);
        let (c, d) = rest.split_at_mut(n);
        let mut last = [0.0; ROWS];
        for i in 0..n {
            let (aw, w) = (x.aw[i], x.w[i]);
            let now = [a[i], b[i], c[i], d[i]];
            last = std::array::from_fn(|r| now[r] * w - last[r] * aw);
            [a[i], b[i], c[i], d[i]] = last;
        }
        last = [0.0; ROWS];
        for i in (0..n).rev() {
            let e = x.e[i];
            let now = [a[i], b[i], c[i], d[i]];
            last = std::array::from_fn(|r| now[r] - e * last[r]);
            [a[i], b[i], c[i], d[i]] = last;
        }
    } else {
        for row in rows.chunks_mut(n) {
            let mut last = 0.0;
            for ((v, w), aw) in row.iter_mut().zip(&x.w).zip(&x.aw) {
                last = *v * w - last * aw;
                *v = last;
            }
            last = 0.0;
            for (v, e) in row.iter_mut().zip(&x.e).rev() {
                last = *v - e * last;
                *v = last;
            }
        }
    }
}
