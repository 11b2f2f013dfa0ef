//! Grids without elements: bricks of 4 x 4 x 4 cells, and of each cell the Bernstein coefficients when a tile needs them (section 4.1, "uniform grid traversal").
//!
//! The geometry of a grid is affine, so all that is kept are the samples (or the spline's own coefficients), least and greatest coefficient of each brick, and for the isovalues sought one
//! bit for each cell of a brick whose coefficients reach it. A tile of pixels finds its bricks in a hierarchy of boxes, projects the marked cells, makes the coefficients of those that some of its
//! pixels may meet, and solves one polynomial for each such pixel (`affine.rs`). Grids of any size the samples of which fit into memory can be drawn.
//!
//! The function is [`GridSpline`]'s, the one of the f64 (or stored) bits of its coefficients: a tensor-product spline on the cells of its lattice. Cells of the quadratic splines are centred on samples; the
//! domain cuts the outer ones in half.

use crate::affine::{Field, LocalRay, Place, rectangle};
use crate::bernstein::{count, halve, range};
use crate::frustum::{EPS, Frustum, PixelBox};
use crate::solve::{Solver, Target, Task};
use crate::tree::Tree;
use glam::DVec3;
use isobar_core::{DataError, Function, Grid, HexElement, Lattice, Stage, Surface, SurfaceKind};
use isobar_cpu::is_visible;
use isobar_fields::{GridSpline, Kind};
use rayon::prelude::*;
use std::sync::Arc;

/// Cells of a brick along an axis: one bit of 64 for each of its cells.
const BRICK: usize = 4;

/// A spline and the ranges of its bricks.
#[derive(Debug, Clone)]
pub(crate) struct Bricks {
    pub(crate) spline: GridSpline,
    place: Place,
    /// Bricks along the axes.
    dims: [usize; 3],
    /// Least and greatest coefficient of each brick's stencils, x fastest.
    ranges: Arc<[(f64, f64)]>,
}

/// Bernstein coefficients of a lattice piece from its stencil, in place, each row of an axis in turn: exact formulas of the uniform B-splines of degree 1, 2, 3.
#[inline(always)]
fn to_bernstein(degree: usize, c: &mut [f64]) {
    let n = degree + 1;
    for axis in 0..3 {
        let stride = n.pow(axis);
        for line in 0..n * n {
            let start = match axis {
                0 => line * n,
                1 => line / n * n * n + line % n,
                _ => line,
            };
            let at = |i: usize| start + i * stride;
            match degree {
                2 => {
                    let (p, q, r) = (c[at(0)], c[at(1)], c[at(2)]);
                    c[at(0)] = 0.5 * (p + q);
                    c[at(2)] = 0.5 * (q + r);
                }
                3 => {
                    let (p, q, r, s) = (c[at(0)], c[at(1)], c[at(2)], c[at(3)]);
                    let (left, right) = ((2.0 * q + r) / 3.0, (q + 2.0 * r) / 3.0);
                    c[at(0)] = 0.5 * ((p + 2.0 * q) / 3.0 + left);
                    c[at(1)] = left;
                    c[at(2)] = right;
                    c[at(3)] = 0.5 * (right + (2.0 * r + s) / 3.0);
                }
                _ => {}
            }
        }
    }
}

/// As [`to_bernstein`], with degrees the compiler knows.
#[inline(always)]
fn bernstein(degree: usize, c: &mut [f64; 64]) {
    match degree {
        1 => to_bernstein(1, &mut c[..8]),
        2 => to_bernstein(2, &mut c[..27]),
        _ => to_bernstein(3, &mut c[..]),
    }
}

impl Bricks {
    /// Of a grid's reconstruction as stored.
    ///
    /// # Errors
    /// As [`GridSpline::new`], and [`DataError::Unknown`] where the grid's axes are nearly dependent.
    pub(crate) fn new(grid: &Grid, kind: Kind) -> Result<Self, DataError> {
        let spline = GridSpline::new(grid, kind, Stage::Stored)?;
        let place = Place::of_domain(spline.domain())
            .ok_or_else(|| DataError::Unknown("the grid's axes are nearly dependent; give it three directions".into()))?;
        let cells = spline.cells();
        let dims = cells.map(|n| n.div_ceil(BRICK));
        let ranges: Vec<(f64, f64)> = (0..dims.iter().product())
            .into_par_iter()
            .map(|b| {
                let first = first_cell(dims, b);
                let last = [0, 1, 2].map(|a| (first[a] + BRICK).min(cells[a]) - 1);
                let r = spline.range(first, last);
                (r.lo, r.hi)
            })
            .collect();
        Ok(Self {
            spline,
            place,
            dims,
            ranges: ranges.into(),
        })
    }

    /// Bytes held beyond the samples.
    pub(crate) fn bytes(&self) -> usize {
        self.spline.own_bytes()
    }

    fn degree(&self) -> usize {
        self.spline.basis().degree
    }

    /// Bernstein coefficients of a cell, into the front of `out`, and how many.
    #[inline(always)]
    fn coefficients(&self, cell: [usize; 3], out: &mut [f64; 64]) -> usize {
        self.spline.stencil(cell, out);
        bernstein(self.degree(), out);
        count([self.degree(); 3])
    }

    /// Where a cell starts in index space.
    #[inline(always)]
    fn start(&self, cell: [usize; 3]) -> [f64; 3] {
        let shift = if self.spline.basis().centred { 0.5 } else { 0.0 };
        cell.map(|i| i as f64 - shift)
    }

    /// The part of a cell that lies in the domain, in its own parameters.
    #[inline(always)]
    fn part(&self, cell: [usize; 3]) -> ([f64; 3], [f64; 3]) {
        if !self.spline.basis().centred {
            return ([0.0; 3], [1.0; 3]);
        }
        let last = self.spline.dims().map(|n| n - 1);
        (
            cell.map(|i| if i == 0 { 0.5 } else { 0.0 }),
            std::array::from_fn(|a| if cell[a] == last[a] { 0.5 } else { 1.0 }),
        )
    }
}

fn first_cell(dims: [usize; 3], brick: usize) -> [usize; 3] {
    [brick % dims[0], brick / dims[0] % dims[1], brick / dims[0] / dims[1]].map(|i| i * BRICK)
}

/// The cells of a brick that reach an isovalue.
#[derive(Debug, Clone, Copy)]
struct Marked {
    first: [u32; 3],
    surface: u8,
    isovalue: f64,
    /// Bit `i + 4 j + 16 k`.
    cells: u64,
}

impl Marked {
    #[inline(always)]
    fn visit(&self, mut take: impl FnMut([usize; 3])) {
        let mut rest = self.cells;
        while rest != 0 {
            let n = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            take([n & 3, n >> 2 & 3, n >> 4]);
        }
    }
}

/// The bricks of a scene's isosurfaces.
#[derive(Debug)]
pub(crate) struct Cells {
    bricks: Bricks,
    marked: Vec<Marked>,
    tree: Tree,
}

impl Cells {
    /// The cells that reach each visible isovalue; other surfaces are left out. Of several surfaces with the same isovalue the first is drawn.
    pub(crate) fn new(bricks: &Bricks, surfaces: &[Surface]) -> Self {
        let mut marked: Vec<Marked> = Vec::new();
        for (n, s) in surfaces.iter().enumerate() {
            let again = surfaces[..n].iter().any(|o| is_visible(o) && o.kind == s.kind);
            if let SurfaceKind::Isovalue(c) = s.kind
                && is_visible(s)
                && !again
            {
                marked.par_extend(
                    (0..bricks.ranges.len())
                        .into_par_iter()
                        .filter_map(|b| mark(bricks, b, n as u8, c)),
                );
            }
        }
        let domain = bricks.spline.domain();
        let boxes: Vec<(DVec3, DVec3)> = marked
            .par_iter()
            .map(|m| {
                let lo = bricks.start(m.first.map(|i| i as usize));
                (0..8).fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), n| {
                    let corner = [0, 1, 2].map(|i| lo[i] + if n >> i & 1 == 0 { 0.0 } else { BRICK as f64 });
                    let x = domain.world(DVec3::from_array(corner));
                    (a.min(x), b.max(x))
                })
            })
            .collect();
        Self {
            bricks: bricks.clone(),
            marked,
            tree: Tree::new(boxes, 16.0 * EPS * reach(domain)),
        }
    }

    /// Bytes held beyond the coefficients.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.bricks.ranges[..]) + size_of_val(&self.marked[..]) + self.tree.bytes()
    }

    /// All roots of all marked cells on the rays of a frustum.
    #[inline(always)]
    pub(crate) fn solve(&self, f: &Frustum, solver: &mut Solver, stack: &mut Vec<u32>) {
        let bricks = &self.bricks;
        let degree = bricks.degree();
        let camera = Seen::new(bricks, f);
        let mut rays = std::mem::take(&mut solver.rays);
        rays.clear();
        let mut bernstein = [0.0; 64];
        for (near, i) in self.tree.list(f, stack, solver.ends.is_on()) {
            if solver.ends.all_behind(f, near) {
                break;
            }
            let brick = &self.marked[i as usize];
            let Some(within) = camera.brick(f, bricks.start(brick.first.map(|i| i as usize))) else {
                continue;
            };
            if rays.is_empty() {
                let d = bricks.spline.domain();
                let centre = ((d.lo + d.hi) * 0.5).to_array();
                rays.extend(f.rays.iter().map(|r| LocalRay::new(&bricks.place, &r.ray, centre)));
            }
            brick.visit(|at| {
                let cell: [usize; 3] = std::array::from_fn(|a| brick.first[a] as usize + at[a]);
                let start = bricks.start(cell);
                let Some(pixels) = camera.cell(f, start, within) else { return };
                let Some(pixels) = solver.ends.open(f, pixels, camera.near(start)) else {
                    return;
                };
                let n = bricks.coefficients(cell, &mut bernstein);
                let values = &mut bernstein[..n];
                let ends = range(values);
                values.iter_mut().for_each(|v| *v -= brick.isovalue);
                solver.work.tasks += 1;
                // The stencil may be greater than the Bernstein coefficients made of it: its rounding is that of the brick.
                let greatest = self.bricks.greatest(cell);
                let field = Field::new(
                    &bricks.place,
                    [degree; 3],
                    values,
                    brick.surface,
                    greatest + brick.isovalue.abs(),
                    ends,
                    bricks.part(cell),
                );
                for y in usize::from(pixels.y0)..=usize::from(pixels.y1) {
                    for x in usize::from(pixels.x0)..=usize::from(pixels.x1) {
                        let pixel = y * f.width + x;
                        solver.along_ray(&field, &rays[pixel].from(start), pixel);
                    }
                }
            });
        }
        solver.rays = rays;
    }

    /// The part inside the domain of every marked cell that the frustum may meet, as an element of its own, with bounds of the errors of its points and values.
    pub(crate) fn elements(&self, f: &Frustum, stack: &mut Vec<u32>, mut take: impl FnMut(&HexElement, &Task, [f64; 2])) {
        let (bricks, domain) = (&self.bricks, self.bricks.spline.domain());
        // A corner: three products and their sum with the origin, in each of three coordinates.
        let placed = 16.0 * EPS * reach(domain);
        let camera = Seen::new(bricks, f);
        let mut bernstein = [0.0; 64];
        self.tree.visit(f, stack, |i| {
            let brick = &self.marked[i];
            brick.visit(|at| {
                let cell: [usize; 3] = std::array::from_fn(|a| brick.first[a] as usize + at[a]);
                let start = bricks.start(cell);
                if camera.cell(f, start, f.all()).is_none() {
                    return;
                }
                let n = bricks.coefficients(cell, &mut bernstein);
                let (lo, hi) = bricks.part(cell);
                let degree = [bricks.degree(); 3];
                for a in 0..3 {
                    // Halved where the domain cuts the cell; `other` is what lies outside.
                    let mut other = [0.0; 64];
                    if lo[a] > 0.0 {
                        halve(degree, a, &mut bernstein[..n], &mut other[..n]);
                    } else if hi[a] < 1.0 {
                        halve(degree, a, &mut bernstein[..n], &mut other[..n]);
                        bernstein = other;
                    }
                }
                let corner = |n: usize| {
                    let u = [0, 1, 2].map(|a| start[a] + if n >> a & 1 == 0 { lo[a] } else { hi[a] });
                    let x = domain.world(DVec3::from_array(u));
                    [x.x, x.y, x.z, 1.0]
                };
                let element = HexElement {
                    degree: [1; 3],
                    points: (0..8).map(corner).collect(),
                    value_degree: [bricks.degree() as u8; 3],
                    values: bernstein[..n].into(),
                    rational_value: false,
                };
                let task = Task {
                    element: 0,
                    surface: brick.surface,
                    target: Target::Isovalue(brick.isovalue),
                    boxed: false,
                };
                // As in `roundings`: 12 for the conversion, the degree for each of three halvings, all taken twice.
                let size = bricks.greatest(cell) + brick.isovalue.abs();
                take(&element, &task, [placed, EPS * (24 + 6 * bricks.degree()) as f64 * size]);
            });
        });
    }
}

impl Bricks {
    /// Greatest magnitude of a coefficient of the brick of a cell.
    #[inline(always)]
    fn greatest(&self, cell: [usize; 3]) -> f64 {
        let [i, j, k] = cell.map(|c| c / BRICK);
        let (lo, hi) = self.ranges[(k * self.dims[1] + j) * self.dims[0] + i];
        lo.abs().max(hi.abs())
    }
}

/// The marked cells of a brick, if any.
fn mark(bricks: &Bricks, b: usize, surface: u8, c: f64) -> Option<Marked> {
    let (lo, hi) = bricks.ranges[b];
    if c < lo || c > hi {
        return None;
    }
    let (first, all) = (first_cell(bricks.dims, b), bricks.spline.cells());
    let mut marks = 0;
    let mut bernstein = [0.0; 64];
    // Room for the rounding of the coefficients.
    let room = 32.0 * EPS * (lo.abs().max(hi.abs()));
    for n in 0..64 {
        let cell: [usize; 3] = std::array::from_fn(|a| first[a] + (n >> (2 * a) & 3));
        if (0..3).any(|a| cell[a] >= all[a]) {
            continue;
        }
        let count = bricks.coefficients(cell, &mut bernstein);
        let (lo, hi) = range(&bernstein[..count]);
        if lo - room <= c && c <= hi + room {
            marks |= 1 << n;
        }
    }
    (marks != 0).then(|| Marked {
        first: first.map(|i| i as u32),
        surface,
        isovalue: c,
        cells: marks,
    })
}

/// At least the sum of the magnitudes that a world position of the domain is made of.
fn reach(d: &isobar_core::Domain) -> f64 {
    let steps = (0..3).map(|a| (d.hi[a] + 2.0) * d.axes.col(a).abs().element_sum());
    d.origin.abs().element_sum() + steps.sum::<f64>()
}

/// Index space in the camera frame of a frustum.
struct Seen {
    origin: [f64; 3],
    /// Of each camera axis, the displacement of one step along the three index axes.
    steps: [[f64; 3]; 3],
    /// Half the extent of a cell.
    half: [f64; 3],
    noise: f64,
}

impl Seen {
    fn new(bricks: &Bricks, f: &Frustum) -> Self {
        let d = bricks.spline.domain();
        let axes = [f.right, f.up, f.forward];
        let steps = axes.map(|a| [a.dot(d.axes.x_axis), a.dot(d.axes.y_axis), a.dot(d.axes.z_axis)]);
        let reach = reach(d) + f.eye.abs().element_sum();
        Self {
            origin: axes.map(|a| a.dot(d.origin - f.eye)),
            steps,
            half: steps.map(|s| 0.5 * (s[0].abs() + s[1].abs() + s[2].abs())),
            noise: 32.0 * EPS * reach,
        }
    }

    #[inline(always)]
    fn place(&self, u: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| {
            let s = &self.steps[i];
            self.origin[i] + (s[0] * u[0] + s[1] * u[1] + s[2] * u[2])
        })
    }

    /// Pixels that may see the cell that starts at `u`.
    #[inline(always)]
    fn cell(&self, f: &Frustum, u: [f64; 3], within: PixelBox) -> Option<PixelBox> {
        rectangle(f, self.place(u.map(|x| x + 0.5)), self.half, self.noise, within)
    }

    /// At most the depth of all points of the cell that starts at `u`.
    #[inline(always)]
    fn near(&self, u: [f64; 3]) -> f64 {
        self.place(u.map(|x| x + 0.5))[2] - self.half[2] - 2.0 * self.noise
    }

    /// Pixels that may see the brick that starts at `u`.
    #[inline(always)]
    fn brick(&self, f: &Frustum, u: [f64; 3]) -> Option<PixelBox> {
        let b = BRICK as f64;
        rectangle(
            f,
            self.place(u.map(|x| x + 0.5 * b)),
            self.half.map(|h| h * b),
            self.noise,
            f.all(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bernstein::{bases, value};
    use isobar_core::Samples;

    /// The coefficients of every cell give the reconstruction's values, on all kinds.
    #[test]
    fn coefficients_are_those_of_the_spline() {
        let samples = (0..5 * 6 * 7).map(|i| (i * 7919 % 251) as u8).collect();
        let grid = Grid::unit([5, 6, 7], Samples::U8(samples)).unwrap();
        for kind in Kind::ALL {
            let b = Bricks::new(&grid, kind).unwrap();
            let mut c = [0.0; 64];
            for n in 0..b.spline.cells().iter().product() {
                let all = b.spline.cells();
                let cell = [n % all[0], n / all[0] % all[1], n / all[0] / all[1]];
                let count = b.coefficients(cell, &mut c);
                let (start, (lo, hi)) = (b.start(cell), b.part(cell));
                for s in 0..8 {
                    let u = [0, 1, 2].map(|a| lo[a] + (hi[a] - lo[a]) * [0.125, 0.875][s >> a & 1]);
                    let x = b
                        .spline
                        .domain()
                        .world(DVec3::new(start[0] + u[0], start[1] + u[1], start[2] + u[2]));
                    let d = [b.degree(); 3];
                    let found = value(d, &c[..count], &bases(d, u));
                    let want = b.spline.value(x);
                    assert!((found - want).abs() < 1e-11, "{kind} {cell:?} {u:?}: {found} {want}");
                }
            }
        }
    }

    #[test]
    fn only_cells_that_reach_the_isovalue_are_marked() {
        // A plane x = 2.5 of values 0 and 9.
        let samples = (0..9 * 9 * 9).map(|i| if i % 9 < 3 { 0 } else { 9 }).collect();
        let grid = Grid::unit([9, 9, 9], Samples::U8(samples)).unwrap();
        let b = Bricks::new(&grid, Kind::Trilinear).unwrap();
        let cells = Cells::new(
            &b,
            &[
                Surface::isovalue(4.5, 0),
                Surface::isovalue(4.5, 1),
                Surface::isovalue(99.0, 2),
            ],
        );
        let marked: u32 = cells.marked.iter().map(|m| m.cells.count_ones()).sum();
        assert_eq!((marked, cells.marked.len()), (8 * 8, 4));
        assert!(cells.marked.iter().all(|m| m.surface == 0));
        assert!(cells.bytes() > 0 && b.bytes() == 0);
    }
}
