//! The mesh on the device and the view as the shaders have it.

use crate::camera::Projection;
use crate::mesh::Cells;
use bytemuck::{Pod, Zeroable};
use isobar_core::{DVec3, RenderError, View};
use isobar_gpu::{Gpu, wgpu};
use rayon::prelude::*;

/// Clipping planes there is room for.
pub(super) const PLANES: usize = 8;

/// `Point` of `view.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Point {
    at: [f32; 3],
    value: f32,
    rest: [f32; 3],
    unused: f32,
}

/// `View` of `view.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Uniform {
    right: [f32; 3],
    width: f32,
    down: [f32; 3],
    height: f32,
    forward: [f32; 3],
    pixel: f32,
    eye: [f32; 3],
    parallel: u32,
    eye_rest: [f32; 3],
    depth_scale: f32,
    planes: u32,
    peel: u32,
    columns: u32,
    unused: u32,
    plane: [[f32; 4]; PLANES],
}

impl Uniform {
    /// With only what lies behind the layer before.
    pub(super) fn peeled(self, peel: bool) -> Self {
        Self {
            peel: u32::from(peel),
            ..self
        }
    }

    /// With `columns` squares side by side.
    pub(super) fn in_columns(self, columns: usize) -> Self {
        Self {
            columns: columns as u32,
            ..self
        }
    }
}

/// A number as the sum of two f32.
fn two(v: DVec3) -> [[f32; 3]; 2] {
    let hi = v.as_vec3();
    [hi.to_array(), (v - hi.as_dvec3()).as_vec3().to_array()]
}

/// Points, values and cells.
#[derive(Debug)]
pub(super) struct Mesh {
    pub(super) points: wgpu::Buffer,
    pub(super) cells: wgpu::Buffer,
    /// Points are counted from the middle of the mesh in units that make its half diagonal at most 1.
    middle: DVec3,
    /// World length of a unit, a power of two.
    pub(super) unit: f64,
    /// Of the half diagonal, in the world.
    radius: f64,
}

impl Mesh {
    /// Uploads.
    ///
    /// # Errors
    /// [`RenderError::Unsupported`] for values that span too much, [`RenderError::Memory`] for meshes that exceed a binding.
    pub(super) fn new(gpu: &Gpu, cells: &Cells) -> Result<Self, RenderError> {
        let (lo, hi) = cells.range();
        if !(hi - lo).is_finite() || hi - lo > 1e37 {
            return Err(super::feature("values that span more than 1e37; scale them down or use cellproj/cpu").into());
        }
        // Bounds are finite, and cells have volume.
        let (lo, hi) = cells.bounds;
        let radius = 0.5 * (hi - lo).length();
        let middle = lo + (hi - lo) * 0.5;
        let unit = radius.log2().ceil().exp2();
        if !(unit.is_normal() && (1.0 / unit).is_normal()) {
            return Err(super::feature("meshes of an extent near the limits of f64; scale it or use cellproj/cpu").into());
        }
        let values = &cells.mesh.values;
        let points: Vec<Point> = cells
            .mesh
            .points
            .par_iter()
            .zip(values.par_iter())
            .map(|(&p, &value)| {
                let [at, rest] = two((p - middle) / unit);
                Point {
                    at,
                    value,
                    rest,
                    unused: 0.0,
                }
            })
            .collect();
        Ok(Self {
            points: gpu.storage("the points of the mesh", &points)?,
            cells: gpu.storage("the cells of the mesh", &cells.cells)?,
            middle,
            unit,
            radius,
        })
    }

    pub(super) fn bytes(&self) -> u64 {
        self.points.size() + self.cells.size()
    }
}

/// A view of a mesh.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scene {
    pub(super) uniform: Uniform,
    pub(super) projection: Projection,
    /// World length of a unit of depth, and the depth of parallel rays' starts.
    unit: f64,
    start: f64,
}

impl Scene {
    /// `None` for lists of rays.
    pub(super) fn new(view: &View, mesh: &Mesh) -> Option<Self> {
        let projection = Projection::new(view)?;
        let p = &projection;
        let to_middle = p.depth(mesh.middle);
        // Parallel rays start near the mesh: what they pass before costs precision.
        let start = if p.perspective {
            0.0
        } else {
            (to_middle - mesh.radius * 1.01).max(0.0)
        };
        let eye = p.eye + p.rows[2] * start;
        let [eye_hi, eye_rest] = two((eye - mesh.middle) / mesh.unit);
        let direction = |v: DVec3| v.normalize().as_vec3().to_array();
        // The rows have the length of pixels per unit.
        let per = p.rows[0].length();
        let far = (to_middle - start + mesh.radius) / mesh.unit;
        let mut plane = [[0.0; 4]; PLANES];
        for (to, clip) in plane.iter_mut().zip(&view.clips) {
            let length = clip.normal.length();
            let n = clip.normal / length;
            let local = [p.rows[0].normalize(), p.rows[1].normalize(), p.rows[2]].map(|r| r.dot(n) as f32);
            let distance = (clip.distance / length - n.dot(eye)) / mesh.unit;
            *to = [local[0], local[1], local[2], distance as f32];
        }
        let uniform = Uniform {
            right: direction(p.rows[0]),
            width: view.width as f32,
            down: direction(p.rows[1]),
            height: view.height as f32,
            forward: p.rows[2].as_vec3().to_array(),
            pixel: (1.0 / (per * if p.perspective { 1.0 } else { mesh.unit })) as f32,
            eye: eye_hi,
            parallel: u32::from(!p.perspective),
            eye_rest,
            depth_scale: (-far.max(1e-30).log2().ceil() - 1.0).exp2() as f32,
            planes: view.clips.len() as u32,
            peel: 0,
            columns: 0,
            unused: 0,
            plane,
        };
        Some(Self {
            uniform,
            projection,
            unit: mesh.unit,
            start,
        })
    }

    /// The depth in the world of a depth of the shaders.
    pub(super) fn depth(&self, z: f32) -> f64 {
        self.start + f64::from(z) * self.unit
    }

    /// The other way.
    pub(super) fn local(&self, depth: f64) -> f32 {
        ((depth - self.start) / self.unit) as f32
    }
}
