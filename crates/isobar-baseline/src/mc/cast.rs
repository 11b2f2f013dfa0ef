//! Rays against the mesh: a compressed wide bounding volume hierarchy (crate `obvhs`: PLOC builder, CWBVH of Ylitie, Karras and Laine,
//! HPG 2017) and the watertight triangle test of Woop, Benthin and Wald (JCGT 2(1), 2013).
//!
//! The hierarchy is f32 and its boxes are widened by more than a ray's rounding, so that it only ever offers too much; the triangle
//! test is f64, with the ray's origin moved to where it enters the grid.

use super::join::Forest;
use super::mesh::{Block, TooLarge, Vertex};
use crate::index_space::IndexRay;
use isobar_core::RenderError;
use isobar_cpu::require_memory;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh, node::CwBvhNode};
use obvhs::ray::{Ray as BvhRay, RayHit};
use std::time::Duration;

/// A hierarchy over some boxes, at least one, with at most `most` of them in a leaf.
fn hierarchy(boxes: &[Aabb], most: u32) -> CwBvh {
    let params = BvhBuildParams {
        max_prims_per_leaf: most,
        ..BvhBuildParams::fast_build()
    };
    build_cwbvh(boxes, params, &mut Duration::default())
}

/// What the boxes of a grid are made with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Space {
    /// Cells of the grid per edge of the lattice: one over the refinement.
    scale: f64,
    /// A ray's f32 coordinates are off by some ulps of the largest coordinate.
    pad: f32,
}

impl Space {
    /// Of a grid of `dims` and a lattice `subdivide` times finer.
    pub(crate) fn new(dims: [usize; 3], subdivide: usize) -> Self {
        let largest = dims.iter().copied().max().unwrap_or(1) as f64;
        Self {
            scale: 1.0 / subdivide as f64,
            pad: (largest * 16.0 * f64::from(f32::EPSILON)) as f32,
        }
    }

    fn boxed(&self, corners: [[f64; 3]; 3]) -> Aabb {
        let end = |f: fn(f64, f64) -> f64| {
            let end = std::array::from_fn::<f32, 3, _>(|a| f(f(corners[0][a], corners[1][a]), corners[2][a]) as f32);
            glam::Vec3A::from_array(end)
        };
        Aabb::new(end(f64::min) - self.pad, end(f64::max) + self.pad)
    }
}

/// The triangles of one block with an area, in the order of the leaves of their hierarchy, and its nodes.
#[derive(Debug)]
pub(crate) struct Tree {
    block: Block,
    nodes: Box<[CwBvhNode]>,
    bounds: Aabb,
}

impl Tree {
    /// `None` where no triangle has an area.
    pub(crate) fn new(mut block: Block, space: Space) -> Option<Self> {
        let mut boxes = Vec::with_capacity(block.triangles.len());
        let position = |v: u16| block.vertices[usize::from(v)].position(block.origin, space.scale);
        block.triangles.retain(|t| {
            let [a, b, c] = t.map(position);
            let keep = a != b && b != c && c != a;
            if keep {
                boxes.push(space.boxed([a, b, c]));
            }
            keep
        });
        let bounds = boxes.iter().copied().reduce(|a, b| a.union(&b))?;
        let bvh = hierarchy(&boxes, 3);
        block.triangles = bvh.primitive_indices.iter().map(|&i| block.triangles[i as usize]).collect();
        Some(Self {
            block,
            // The builder leaves room for many more.
            nodes: bvh.nodes.as_slice().into(),
            bounds,
        })
    }
}

/// Bytes that a list asks for when `more` entries are added: it doubles, and the old list is held until the new one is filled.
pub(super) fn growth<T>(list: &Vec<T>, more: usize) -> usize {
    let needed = list.len() + more;
    if needed <= list.capacity() {
        return 0;
    }
    needed.max(2 * list.capacity()) * size_of::<T>()
}

/// Why there is no mesh.
#[derive(Debug)]
pub(crate) enum NoMesh {
    /// It cannot be numbered.
    TooLarge,
    /// It cannot be held: [`RenderError::Memory`].
    Memory(RenderError),
}

impl From<TooLarge> for NoMesh {
    fn from(_: TooLarge) -> Self {
        Self::TooLarge
    }
}

impl From<RenderError> for NoMesh {
    fn from(e: RenderError) -> Self {
        Self::Memory(e)
    }
}

/// A scene under construction: blocks are added one by one and let go.
#[derive(Debug)]
pub(crate) struct Builder {
    scene: Scene,
    forest: Forest,
    bounds: Vec<Aabb>,
}

impl Builder {
    pub(crate) fn new(space: Space) -> Self {
        Self {
            scene: Scene {
                vertices: Vec::new(),
                triangles: Vec::new(),
                blocks: Vec::new(),
                hints: Vec::new(),
                bvh: None,
                scale: space.scale,
            },
            forest: Forest::new(),
            bounds: Vec::new(),
        }
    }

    /// Adds a block.
    ///
    /// # Errors
    /// [`NoMesh::TooLarge`] beyond 2^32 - 1 triangles or vertices, [`NoMesh::Memory`] where a list cannot grow.
    pub(crate) fn add(&mut self, tree: &Tree) -> Result<(), NoMesh> {
        let s = &mut self.scene;
        let number = |n: usize| u32::try_from(n).map_err(|_| TooLarge);
        let (block, first) = (&tree.block, number(s.triangles.len())?);
        let grown = growth(&s.vertices, block.vertices.len())
            + growth(&s.triangles, block.triangles.len())
            + self.forest.growth(tree.nodes.len());
        // Small lists are not worth the question.
        if grown > 1 << 20 {
            require_memory(|| format!("a mesh of more than {first} triangles"), grown as u64)?;
        }
        number(s.triangles.len() + block.triangles.len())?;
        s.blocks.push(Place {
            origin: block.origin,
            isovalue: block.isovalue,
            vertices: number(s.vertices.len())?,
            triangles: first,
        });
        s.vertices.extend_from_slice(&block.vertices);
        s.triangles.extend_from_slice(&block.triangles);
        s.hints.resize(s.triangles.len().div_ceil(STRIDE), s.blocks.len() as u32 - 1);
        self.forest.add(&tree.nodes, first);
        self.bounds.push(tree.bounds);
        Ok(())
    }

    /// Joins the hierarchies of the blocks.
    pub(crate) fn finish(self) -> Scene {
        let mut scene = self.scene;
        scene.vertices.shrink_to_fit();
        scene.triangles.shrink_to_fit();
        scene.hints.shrink_to_fit();
        if !self.bounds.is_empty() {
            scene.bvh = Some(self.forest.under(&hierarchy(&self.bounds, 1)));
        }
        scene
    }
}

/// A block's part of the lists of a scene.
#[derive(Debug, Clone, Copy)]
struct Place {
    origin: [u16; 3],
    isovalue: u16,
    /// Its first vertex.
    vertices: u32,
    /// Its first triangle.
    triangles: u32,
}

/// A mesh ready for rays: blocks of triangles under one hierarchy.
///
/// The hierarchy is made block by block and joined: over all triangles at once the builder takes 240 bytes per triangle. One
/// triangle per leaf entry: groups of up to 4 neighbours in one entry took half the time and memory to build, and half as long again to
/// render (a triangle test with its vertices costs about 50 ns).
#[derive(Debug)]
pub(crate) struct Scene {
    vertices: Vec<Vertex>,
    /// In the order of the hierarchy's leaves; corners are numbered in their blocks.
    triangles: Vec<[u16; 3]>,
    blocks: Vec<Place>,
    /// The block of every [`STRIDE`]th triangle.
    hints: Vec<u32>,
    bvh: Option<CwBvh>,
    scale: f64,
}

/// Triangles per entry of `Scene::hints`.
const STRIDE: usize = 64;

/// A hit of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TriangleHit {
    /// In the ray's unit.
    pub(crate) t: f64,
    /// Its position in the scene.
    pub(crate) triangle: u32,
    /// Number of its isovalue.
    pub(crate) isovalue: usize,
}

/// The part of a ray on which hits count.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Part {
    /// First and last t that clipping planes keep, 0 or more.
    pub(crate) kept: (f64, f64),
    /// The stretch inside the grid; hits just outside, by rounding, count.
    pub(crate) inside: (f64, f64),
}

impl Part {
    #[inline(always)]
    fn keeps(&self, t: f64) -> bool {
        self.kept.0 <= t && t <= self.kept.1
    }
}

/// Hits of one surface nearer than this, in voxels, are one: a ray through an edge meets both triangles.
const SAME: f64 = 1e-9;

impl Scene {
    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.vertices.capacity() * size_of::<Vertex>()
            + self.triangles.capacity() * 6
            + self.blocks.capacity() * size_of::<Place>()
            + self.hints.capacity() * 4
            + self.bvh.as_ref().map_or(0, |b| b.nodes.capacity() * size_of::<CwBvhNode>())
    }

    /// Triangles with an area.
    pub(crate) fn len(&self) -> usize {
        self.triangles.len()
    }

    /// The block of a triangle.
    #[inline(always)]
    fn place(&self, triangle: usize) -> &Place {
        let mut n = self.hints[triangle / STRIDE] as usize;
        while self.blocks.get(n + 1).is_some_and(|b| b.triangles as usize <= triangle) {
            n += 1;
        }
        &self.blocks[n]
    }

    #[inline(always)]
    fn corners(&self, triangle: usize) -> [[f64; 3]; 3] {
        let place = self.place(triangle);
        self.triangles[triangle]
            .map(|v| self.vertices[place.vertices as usize + usize::from(v)].position(place.origin, self.scale))
    }

    /// Index-space normal of a triangle, along the gradient (to where s is greater), any length.
    pub(crate) fn normal(&self, triangle: u32) -> [f64; 3] {
        let [a, b, c] = self.corners(triangle as usize).map(isobar_core::DVec3::from_array);
        (c - a).cross(b - a).to_array()
    }

    /// The first hit on a part of the ray; counts triangle tests in `tests`.
    pub(crate) fn first(&self, ray: &IndexRay, part: Part, tests: &mut u32) -> Option<TriangleHit> {
        let bvh = self.bvh.as_ref()?;
        let (t0, t1) = part.inside;
        let local = Local::new(ray, t0, t1);
        let mut best: Option<(f64, u32)> = None;
        bvh.ray_traverse(local.ray, &mut RayHit::none(), |_, i| {
            *tests += 1;
            let Some(t) = local.woop.hit(self.corners(i)).filter(|t| part.keeps(t0 + t)) else {
                return f32::INFINITY;
            };
            let here = (t, i as u32);
            if best.is_none_or(|b| here < b) {
                best = Some(here);
            }
            // widened, so that a hit as near as this one is still looked at
            local.to_bvh(t)
        });
        best.map(|(t, triangle)| self.told(t0 + t, triangle))
    }

    /// All hits on a part of the ray in the order of t, each root once, into `out`.
    pub(crate) fn all(&self, ray: &IndexRay, part: Part, tests: &mut u32, out: &mut Vec<TriangleHit>) {
        out.clear();
        let (t0, t1) = part.inside;
        let Some(bvh) = &self.bvh else {
            return;
        };
        let local = Local::new(ray, t0, t1);
        bvh.ray_traverse_anyhit(local.ray, |_, i| {
            *tests += 1;
            if let Some(t) = local.woop.hit(self.corners(i)).filter(|t| part.keeps(t0 + t)) {
                out.push(self.told(t0 + t, i as u32));
            }
        });
        let same = SAME / ray.speed();
        out.sort_by(|a, b| {
            a.isovalue
                .cmp(&b.isovalue)
                .then(a.t.total_cmp(&b.t))
                .then(a.triangle.cmp(&b.triangle))
        });
        out.dedup_by(|b, a| a.isovalue == b.isovalue && b.t - a.t <= same);
        out.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.isovalue.cmp(&b.isovalue)));
    }

    fn told(&self, t: f64, triangle: u32) -> TriangleHit {
        TriangleHit {
            t,
            triangle,
            isovalue: usize::from(self.place(triangle as usize).isovalue),
        }
    }
}

/// A ray as the hierarchy and the triangle test see it: from its entry into the grid on, t counted from there.
struct Local {
    ray: BvhRay,
    woop: Woop,
    /// Voxels per unit of t, and where the hierarchy's own t is 0: a voxel before the entry.
    speed: f64,
}

/// The hierarchy's ray starts this many voxels before the entry.
const BEFORE: f64 = 1.0;

impl Local {
    fn new(ray: &IndexRay, t0: f64, t1: f64) -> Self {
        let speed = ray.speed();
        let entry = ray.at(t0).get();
        let direction = ray.d.map(|d| d / speed);
        let start: [f64; 3] = std::array::from_fn(|a| entry[a] - BEFORE * direction[a]);
        let length = ((t1 - t0) * speed + 2.0 * BEFORE) as f32 * 1.0001;
        // Adding zero turns -0 into +0: the hierarchy takes the octant from `< 0` but the reciprocal's sign from the sign bit, and where the
        // two disagree it finds nothing.
        let vector = |v: [f64; 3]| glam::Vec3A::from_array(v.map(|x| x as f32 + 0.0));
        Self {
            ray: BvhRay::new(vector(start), vector(direction), 0.0, length),
            woop: Woop::new(entry, ray.d),
            speed,
        }
    }

    /// The t of the hierarchy's ray for a t from the entry on, rounded up.
    fn to_bvh(&self, t: f64) -> f32 {
        let t = (t * self.speed + BEFORE) as f32;
        t + t.abs() * 16.0 * f32::EPSILON + 1e-4
    }
}

/// The shear that takes the ray to the z axis (Woop et al., section 3), in f64.
struct Woop {
    axes: [usize; 3],
    shear: [f64; 3],
    origin: [f64; 3],
}

impl Woop {
    fn new(origin: [f64; 3], d: [f64; 3]) -> Self {
        let z = (0..3).fold(0, |z, a| if d[a].abs() > d[z].abs() { a } else { z });
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        Self {
            axes,
            shear: [d[axes[0]] / d[z], d[axes[1]] / d[z], 1.0 / d[z]],
            origin,
        }
    }

    /// t of the plane of the triangle where the ray passes through it, edges included. Both triangles of an edge compute the same edge
    /// function with the other sign, so that no ray passes between them.
    fn hit(&self, corners: [[f64; 3]; 3]) -> Option<f64> {
        let [kx, ky, kz] = self.axes;
        let [a, b, c] = corners.map(|p| {
            let z = p[kz] - self.origin[kz];
            let x = p[kx] - self.origin[kx] - self.shear[0] * z;
            let y = p[ky] - self.origin[ky] - self.shear[1] * z;
            [x, y, z * self.shear[2]]
        });
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        (det != 0.0).then(|| (u * a[2] + v * b[2] + w * c[2]) / det)
    }
}

#[cfg(test)]
mod tests {
    use super::super::mesh::{Lattice, blocks};
    use super::*;
    use crate::testing::Seed;

    fn inside(t0: f64, t1: f64) -> Part {
        Part {
            kept: (0.0, f64::INFINITY),
            inside: (t0, t1),
        }
    }

    fn scene(n: usize, f: impl Fn([f64; 3]) -> f64, c: &[f64]) -> Scene {
        let data: Vec<f32> = (0..n * n * n)
            .map(|i| f([i % n, i / n % n, i / n / n].map(|x| x as f64)) as f32)
            .collect();
        let space = Space::new([n; 3], 1);
        let mut builder = Builder::new(space);
        for (i, c) in (0..).zip(c) {
            let lattice = Lattice::new(&data, [n; 3], 1);
            let add = |t: Option<Tree>| t.map_or(Ok(()), |t| builder.add(&t));
            blocks(&lattice, *c, i, |b| Tree::new(b, space), add).unwrap();
        }
        builder.finish()
    }

    /// The hierarchy offers every triangle a ray meets: the same hits as testing all of them.
    #[test]
    fn the_hierarchy_loses_no_hit() {
        let mut seed = Seed(5);
        let s = scene(
            12,
            |p| (p[0] * 0.9).sin() + (p[1] * 0.8).cos() + (p[2] * 0.7).sin(),
            &[0.1, 0.7],
        );
        let mut found = 0;
        let mut out = Vec::new();
        for n in 0..3000 {
            let o = seed.point(-3.0, 14.0).to_array();
            // also along lattice lines, which meet edges and vertices
            let d = match n % 5 {
                0 => [0.0, 0.0, 1.0],
                1 => [1.0, -1.0, 0.0],
                2 => [-0.0, -1.0, -0.0],
                _ => seed.point(-1.0, 1.0).to_array(),
            };
            let o = if n % 10 < 3 { o.map(f64::round) } else { o };
            let ray = IndexRay::new(o, d);
            let Some((t0, t1)) = ray.clip([11.0; 3]) else { continue };
            s.all(&ray, inside(t0, t1), &mut 0, &mut out);
            let local = Local::new(&ray, t0, t1);
            let brute: Vec<f64> = (0..s.len())
                .filter_map(|i| local.woop.hit(s.corners(i)))
                .map(|t| t0 + t)
                .filter(|t| *t >= 0.0)
                .collect();
            for t in &brute {
                assert!(out.iter().any(|h| (h.t - t).abs() <= 1e-8), "{t} is lost: {out:?}");
            }
            let first = s.first(&ray, inside(t0, t1), &mut 0);
            assert_eq!(first.map(|h| h.t), brute.iter().copied().min_by(f64::total_cmp));
            assert_eq!(first.map(|h| h.t), out.first().map(|h| h.t));
            found += brute.len();
        }
        assert!(found > 2000, "{found} hits compared");
    }

    /// Rays from inside a closed surface never escape, not even through edges and vertices.
    #[test]
    fn a_closed_mesh_is_watertight() {
        let s = scene(17, |p| -(p.map(|x| (x - 8.0) * (x - 8.0)).iter().sum::<f64>()), &[-30.0]);
        let mut seed = Seed(9);
        let (mut out, mut n) = (Vec::new(), 0);
        let vertices = (0..s.len()).flat_map(|i| s.corners(i));
        for target in vertices {
            let o = (seed.point(-1.0, 1.0) + 8.0).to_array();
            let ray = IndexRay::new(o, std::array::from_fn(|a| target[a] - o[a]));
            let (t0, t1) = ray.clip([16.0; 3]).unwrap();
            s.all(&ray, inside(t0, t1), &mut 0, &mut out);
            assert_eq!(out.len(), 1, "towards {target:?}: {out:?}");
            assert!((out[0].t - 1.0).abs() < 1e-6);
            n += 1;
        }
        assert!(n > 500);
    }

    #[test]
    fn nothing_is_hit_where_there_is_nothing() {
        let s = scene(4, |p| p[0], &[9.0]);
        let ray = IndexRay::new([-1.0, 1.0, 1.0], [1.0, 0.1, 0.0]);
        assert_eq!((s.first(&ray, inside(1.0, 4.0), &mut 0), s.len(), s.bytes()), (None, 0, 0));
    }
}
