//! What precedes drawing in a frame: corners snapped to the screen, the order of the cells, and their decomposition.

use super::Settings;
use super::fan::{Fan, GUARD, SUB};
use crate::blocks::CellBins;
use crate::camera::Projection;
use crate::cells::{Point, Screen};
use crate::exterior;
use crate::mesh::Cells;
use crate::mixed::Sort;
use crate::order::Order;
use crate::resolve::Gradient;
use crate::topology::Topology;
use glam::{DVec3, Vec3};
use isobar_core::{RenderError, shade};
use rayon::prelude::*;
use std::time::Instant;

/// A corner that cannot be snapped.
const OUTSIDE: [i32; 2] = [i32::MIN; 2];
/// A cell without a fan.
const NONE: u32 = u32::MAX;

/// What is drawn of a cell.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Wanted {
    pub(crate) surfaces: bool,
    pub(crate) volume: bool,
}

/// A projected cell with what its thick vertex carries.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Projected {
    pub(crate) cell: u32,
    pub(crate) class: u8,
    pub(crate) triangles: u8,
    pub(crate) ring: [u8; 4],
    pub(crate) middle: [i32; 2],
    pub(crate) wanted: Wanted,
    /// Front and back: depth, value and light.
    pub(crate) depth: [f64; 2],
    pub(crate) value: [f64; 2],
    pub(crate) light: [f32; 2],
    /// World length of the stay.
    pub(crate) length: f64,
}

/// Microseconds of wall clock of the parts of a frame; Table 1 leaves out the first two.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Parts {
    pub(crate) sorting: u64,
    pub(crate) decomposition: u64,
    pub(crate) drawing: u64,
}

/// Cells of a frame by what became of them.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Classes {
    /// By class; 0: seen edge-on.
    pub(crate) of: [u64; 5],
    /// Cells with a corner too far out or behind the eye plane: not drawn.
    pub(crate) left_out: u64,
}

/// A frame ready to be drawn.
#[derive(Debug)]
pub(crate) struct Frame {
    pub(crate) projection: Projection,
    /// Snapped points.
    pub(crate) at: Vec<[i32; 2]>,
    /// Their depth along the line of sight.
    pub(crate) depth: Vec<f64>,
    /// Their light, for smooth shading.
    pub(crate) light: Vec<f32>,
    pub(crate) cells: Vec<Projected>,
    /// For each cell its place in `cells`.
    slots: Vec<u32>,
    /// Cells per block, back to front.
    pub(crate) bins: CellBins,
    pub(crate) classes: Classes,
    pub(crate) parts: Parts,
    pub(crate) cycles: usize,
}

/// What a frame is made of.
pub(crate) struct Make<'a> {
    pub(crate) mesh: &'a Cells,
    pub(crate) topology: &'a Topology,
    /// Unit normals at the points, for smooth shading.
    pub(crate) normals: Option<&'a [Vec3]>,
    pub(crate) wanted: &'a [Wanted],
    pub(crate) settings: &'a Settings,
}

fn microseconds(start: Instant) -> u64 {
    start.elapsed().as_micros() as u64
}

impl Frame {
    /// To be called on the pool.
    ///
    /// # Errors
    /// [`RenderError::Memory`], as [`CellBins::new`].
    pub(crate) fn new(make: &Make<'_>, projection: Projection) -> Result<Self, RenderError> {
        let mesh = make.mesh;
        let start = Instant::now();
        let screen = Screen::new(mesh, projection, [0.0; 2]);
        let mut order = match make.settings.sort {
            Sort::Centroids => Order::centroids(mesh, &projection),
            Sort::Visibility => {
                let pairs = if make.topology.convex {
                    Vec::new()
                } else {
                    exterior::pairs(mesh, make.topology, &screen)?
                };
                Order::visibility(mesh, make.topology, &projection, &pairs)
            }
        };
        let cycles = order.groups.len();
        order.cells.reverse();
        let sorting = microseconds(start);
        let start = Instant::now();
        let mut out = Self {
            projection,
            at: snapped(&screen),
            depth: screen.points.par_iter().with_min_len(4096).map(|p| p.at[2]).collect(),
            light: make.normals.map_or(Vec::new(), |n| lights(mesh, &projection, n)),
            cells: Vec::new(),
            slots: vec![NONE; mesh.cells.len()],
            bins: CellBins::new(mesh, &screen, &[], |_| false)?,
            classes: Classes::default(),
            parts: Parts::default(),
            cycles,
        };
        out.decompose(make, &order.cells);
        out.bins = CellBins::new(mesh, &screen, &order.cells, |c| out.slots[c as usize] != NONE)?;
        out.parts = Parts {
            sorting,
            decomposition: microseconds(start),
            drawing: 0,
        };
        Ok(out)
    }

    fn decompose(&mut self, make: &Make<'_>, order: &[u32]) {
        let project = |&cell: &u32| {
            let wanted = make.wanted[cell as usize];
            (wanted.surfaces || wanted.volume).then(|| self.project(make, cell, wanted))
        };
        let all: Vec<Result<Projected, u8>> = order.par_iter().with_min_len(1024).filter_map(project).collect();
        for p in all {
            match p {
                Ok(p) => {
                    self.classes.of[usize::from(p.class)] += 1;
                    self.slots[p.cell as usize] = self.cells.len() as u32;
                    self.cells.push(p);
                }
                Err(0) => self.classes.of[0] += 1,
                Err(_) => self.classes.left_out += 1,
            }
        }
    }

    /// A cell, or 0 where it is seen edge-on, 1 where it cannot be projected.
    fn project(&self, make: &Make<'_>, cell: u32, wanted: Wanted) -> Result<Projected, u8> {
        let corners = make.mesh.cells[cell as usize];
        let at = corners.map(|c| self.at[c as usize]);
        if at.contains(&OUTSIDE) {
            return Err(1);
        }
        let fan = Fan::new(&at).ok_or(0u8)?;
        let depths = corners.map(|c| self.depth[c as usize]);
        let values = make.mesh.values(cell);
        let of = |v: &[f64; 4], w: &[f64; 4]| v[0] * w[0] + v[1] * w[1] + v[2] * w[2] + v[3] * w[3];
        let mut ends = fan.ends;
        if of(&depths, &ends[0]) > of(&depths, &ends[1]) {
            ends.swap(0, 1);
        }
        let depth = ends.map(|w| of(&depths, &w));
        let light = if self.light.is_empty() {
            [flat_light(make.mesh, &self.projection, cell); 2]
        } else {
            let lights = corners.map(|c| f64::from(self.light[c as usize]));
            ends.map(|w| of(&lights, &w) as f32)
        };
        Ok(Projected {
            cell,
            class: fan.class,
            triangles: fan.triangles,
            ring: fan.ring,
            middle: fan.middle,
            wanted,
            depth,
            value: ends.map(|w| of(&values, &w)),
            light,
            length: (depth[1] - depth[0]) * self.stretch(fan.middle),
        })
    }

    /// World length per depth on the ray through a snapped position.
    fn stretch(&self, at: [i32; 2]) -> f64 {
        let p = &self.projection;
        if !p.perspective {
            return 1.0;
        }
        let first = p.first_pixel();
        let [x, y]: [f64; 2] = std::array::from_fn(|k| f64::from(at[k]) / SUB + first[k]);
        (p.rows[2] + p.steps[0] * x + p.steps[1] * y).length()
    }

    /// The projected cell of a cell in the bins.
    pub(crate) fn of(&self, cell: u32) -> &Projected {
        &self.cells[self.slots[cell as usize] as usize]
    }

    pub(crate) fn bytes(&self) -> usize {
        self.at.len() * 16
            + self.light.len() * 4
            + self.cells.len() * size_of::<Projected>()
            + self.slots.len() * 4
            + self.bins.bytes()
    }
}

/// Points on the lattice of 1/256 pixel from the centre of pixel (0, 0).
fn snapped(screen: &Screen) -> Vec<[i32; 2]> {
    let p = &screen.projection;
    let first = p.first_pixel();
    screen
        .points
        .par_iter()
        .with_min_len(4096)
        .map(|&Point { at: [x, y, z], .. }| {
            let one = if p.perspective { 1.0 / z } else { 1.0 };
            let (x, y) = (x * one - first[0], y * one - first[1]);
            if z >= 0.0 && x.abs() < GUARD && y.abs() < GUARD {
                [x, y].map(|v| (v * SUB).round() as i32)
            } else {
                OUTSIDE
            }
        })
        .collect()
}

/// The direction rays come from at a place.
fn direction(p: &Projection, at: DVec3) -> DVec3 {
    if p.perspective { at - p.eye } else { p.rows[2] }
}

/// The one shading of a white surface at each point.
fn lights(mesh: &Cells, p: &Projection, normals: &[Vec3]) -> Vec<f32> {
    let of = |(at, n): (&DVec3, &Vec3)| shade([1.0; 3], n.to_array(), direction(p, *at))[0];
    mesh.mesh.points.par_iter().zip(normals).with_min_len(4096).map(of).collect()
}

/// The same of a cell: its gradient, seen at its centroid.
fn flat_light(mesh: &Cells, p: &Projection, cell: u32) -> f32 {
    let corners = mesh.corners(cell);
    let normal = Gradient::new(&corners, &mesh.values(cell)).scaled.normalize_or_zero();
    let middle = corners.iter().sum::<DVec3>() * 0.25;
    shade([1.0; 3], normal.as_vec3().to_array(), direction(p, middle))[0]
}
