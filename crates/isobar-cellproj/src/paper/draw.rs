//! Sections 6 to 10: the passes over the triangles of each cell, back to front, into a frame buffer. A pass looks up a texture and blends; between passes nothing is
//! kept but the frame buffer, the stencil, and what was set last in each pixel, which is the nearest.

use super::scene::{Frame, Projected};
use super::textures::{Isosurfaces, Mark, NO_SURFACE, Volume, fixed};
use super::triangle::fill;
use super::{Mixing, Settings};
use crate::blocks::{AREA, Block};
use crate::mesh::Cells;
use crate::normals::front_weight;
use crate::resolve::Gradient;
use crate::topology::FACES;
use glam::Vec4;
use isobar_core::Surface;
use isobar_cpu::Kernel;

/// One drawing of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pass {
    /// Isosurfaces in one pass, section 7.
    Flat,
    /// The back face's picture of the isosurfaces, section 8.
    Back,
    /// The front face's, over it.
    Front,
    /// The volume.
    Volume,
}

/// What was set last in a pixel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Nearest {
    pub(crate) depth: f64,
    pub(crate) cell: u32,
    pub(crate) surface: u8,
    /// Surfaces set in the pixel, those of double edges included.
    pub(crate) count: u16,
    /// Fragments drawn.
    pub(crate) fragments: u32,
}

/// What blocks share.
pub(crate) struct Scene<'a> {
    pub(crate) mesh: &'a Cells,
    pub(crate) frame: &'a Frame,
    pub(crate) settings: &'a Settings,
    /// Ascending isovalues with their surfaces.
    pub(crate) isovalues: &'a [(f64, u8)],
    pub(crate) surfaces: &'a [Surface],
    pub(crate) isosurfaces: Option<&'a Isosurfaces>,
    pub(crate) volume: Option<&'a Volume>,
    pub(crate) passes: &'a [Pass],
}

/// The passes of a scene, in order.
pub(crate) fn passes(settings: &Settings, surfaces: bool, volume: bool) -> Vec<Pass> {
    let textured = surfaces && !settings.stencil;
    let mut out = match (textured, settings.smooth, volume && settings.mixing == Mixing::Smooth) {
        (false, _, _) => vec![],
        // The smooth mixture needs the weights, whatever the light.
        (true, _, true) => return vec![Pass::Back, Pass::Volume, Pass::Front],
        (true, false, false) => vec![Pass::Flat],
        (true, true, false) => vec![Pass::Back, Pass::Front],
    };
    if volume {
        out.push(Pass::Volume);
    }
    out
}

/// Work of a block.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Work {
    /// Triangles handed to the rasteriser, each pass and block by itself.
    pub(crate) triangles: u64,
    pub(crate) fragments: u64,
}

pub(crate) struct DrawBlock<'a> {
    pub(crate) scene: &'a Scene<'a>,
    pub(crate) block: Block,
}

/// A vertex of a triangle.
#[derive(Debug, Clone, Copy)]
struct Vertex {
    at: [i32; 2],
    /// Front and back.
    value: [f64; 2],
    depth: [f64; 2],
    light: [f32; 2],
    length: f64,
}

#[inline(always)]
fn interpolate(w: [f64; 3], v: [f64; 3]) -> f64 {
    w[0] * v[0] + w[1] * v[1] + w[2] * v[2]
}

impl Kernel for DrawBlock<'_> {
    type Output = (Vec<Vec4>, Vec<Nearest>, Work);

    #[inline(always)]
    fn run(self) -> Self::Output {
        let mut canvas = Canvas::new(self.scene.settings.fixed);
        for cell in self.scene.frame.bins.of(self.block) {
            let p = self.scene.frame.of(cell);
            if self.scene.settings.stencil && p.wanted.surfaces {
                canvas.stencilled(&self, p);
            }
            canvas.textured(&self, p);
        }
        (canvas.colour, canvas.nearest, canvas.work)
    }
}

/// The frame buffer of a block.
struct Canvas {
    /// Premultiplied colour and opacity.
    colour: Vec<Vec4>,
    nearest: Vec<Nearest>,
    /// Section 6: the stencil, with values and depths of the front and back face under it.
    stencil: Vec<bool>,
    faces: Vec<[[f64; 2]; 2]>,
    fixed: bool,
    work: Work,
}

impl Canvas {
    fn new(fixed: bool) -> Self {
        let nothing = Nearest {
            depth: f64::INFINITY,
            cell: 0,
            surface: NO_SURFACE,
            count: 0,
            fragments: 0,
        };
        Self {
            colour: vec![Vec4::ZERO; AREA],
            nearest: vec![nothing; AREA],
            stencil: vec![false; AREA],
            faces: vec![[[0.0; 2]; 2]; AREA],
            fixed,
            work: Work::default(),
        }
    }

    /// Source over destination, premultiplied; in 8 bits where the frame buffer has them.
    #[inline(always)]
    fn blend(&mut self, pixel: usize, texel: Vec4, light: f32) {
        let mut source = (texel * light).with_w(texel.w);
        if self.fixed {
            source = fixed(source);
        }
        let sum = source + self.colour[pixel] * (1.0 - source.w);
        self.colour[pixel] = if self.fixed { fixed(sum) } else { sum };
        self.nearest[pixel].fragments += 1;
        self.work.fragments += 1;
    }

    #[inline(always)]
    fn mark(&mut self, pixel: usize, cell: u32, mark: Mark, depth: [f64; 2]) {
        let weight = f64::from(mark.weight);
        let n = &mut self.nearest[pixel];
        n.depth = weight * depth[0] + (1.0 - weight) * depth[1];
        n.cell = cell;
        n.surface = mark.surface;
        n.count = n.count.saturating_add(u16::from(mark.count));
    }

    /// The triangles of a cell, pass by pass.
    #[inline(always)]
    fn textured(&mut self, job: &DrawBlock<'_>, p: &Projected) {
        let frame = job.scene.frame;
        let corners = job.scene.mesh.cells[p.cell as usize];
        let values = job.scene.mesh.values(p.cell);
        let corner = |k: u8| {
            let i = corners[usize::from(k)] as usize;
            Vertex {
                at: frame.at[i],
                value: [values[usize::from(k)]; 2],
                depth: [frame.depth[i]; 2],
                light: frame.light.get(i).map_or(p.light, |l| [*l; 2]),
                length: 0.0,
            }
        };
        let middle = Vertex {
            at: p.middle,
            value: p.value,
            depth: p.depth,
            light: p.light,
            length: p.length,
        };
        for i in (0..4).filter(|i| p.triangles >> i & 1 != 0) {
            let triangle = [middle, corner(p.ring[i]), corner(p.ring[(i + 1) % 4])];
            for &pass in job.scene.passes {
                let wanted = if pass == Pass::Volume {
                    p.wanted.volume
                } else {
                    p.wanted.surfaces
                };
                if wanted {
                    self.work.triangles += 1;
                    match pass {
                        Pass::Volume => self.volume(job, &triangle),
                        _ => self.surfaces(job, p.cell, &triangle, pass),
                    }
                }
            }
        }
    }

    /// An isosurface pass of a triangle.
    #[inline(always)]
    fn surfaces(&mut self, job: &DrawBlock<'_>, cell: u32, v: &[Vertex; 3], pass: Pass) {
        let Some(texture) = job.scene.isosurfaces else { return };
        let side = usize::from(pass != Pass::Front);
        fill(job.block, v.map(|v| v.at), |pixel, w| {
            let at = |k: usize| interpolate(w, v.map(|v| v.value[k]));
            let (front, back) = (at(0), at(1));
            let (texel, mark) = match pass {
                Pass::Flat => texture.flat(front, back),
                Pass::Back => texture.back(front, back),
                _ => {
                    let texel = texture.front(front, back);
                    if texel.w > 0.0 {
                        let light = interpolate(w, v.map(|v| f64::from(v.light[0])));
                        self.blend(pixel, texel, light as f32);
                    }
                    return;
                }
            };
            // The alpha test of a texture of zeros and ones.
            if mark.surface == NO_SURFACE {
                return;
            }
            let light = interpolate(w, v.map(|v| f64::from(v.light[side])));
            self.blend(pixel, texel, light as f32);
            let depth = [0, 1].map(|k| interpolate(w, v.map(|v| v.depth[k])));
            self.mark(pixel, cell, mark, depth);
        });
    }

    /// The volume pass of a triangle.
    #[inline(always)]
    fn volume(&mut self, job: &DrawBlock<'_>, v: &[Vertex; 3]) {
        let Some(volume) = job.scene.volume else { return };
        let carried = v.map(|v| volume.vertex(v.value[0], v.value[1], v.length));
        fill(job.block, v.map(|v| v.at), |pixel, w| {
            let here = std::array::from_fn(|k| interpolate(w, carried.map(|c| c[k])));
            self.blend(pixel, volume.fragment(here), 1.0);
        });
    }

    /// Section 6: for each isovalue, farthest first, the parts of all faces with smaller values invert the stencil; the back faces are drawn where it is set.
    #[cold]
    fn stencilled(&mut self, job: &DrawBlock<'_>, p: &Projected) {
        let scene = job.scene;
        let (mesh, frame) = (scene.mesh, scene.frame);
        let corners = mesh.cells[p.cell as usize];
        let values = mesh.values(p.cell);
        let at = corners.map(|c| frame.at[c as usize]);
        // Faces are counterclockwise from outside; the screen's y goes down and depth away.
        let turn = |f: [usize; 3]| {
            let [a, b, c] = f.map(|i| at[i].map(i64::from));
            (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        };
        let points = mesh.corners(p.cell);
        let gradient = Gradient::new(&points, &values);
        // Rays meet the planes s = c in the order of their distance from where they start. All rays of an eye start at its value, and go on from there to greater values or to smaller ones;
        // parallel rays come from infinitely far below or above.
        let start = if frame.projection.perspective {
            values[0] + gradient.scaled.dot(frame.projection.eye - points[0]) / gradient.volume
        } else if gradient.scaled.dot(frame.projection.rows[2]) >= 0.0 {
            f64::NEG_INFINITY
        } else {
            f64::INFINITY
        };
        let mut left = 0..scene.isovalues.len();
        while !left.is_empty() {
            // Farthest first.
            let (lowest, highest) = (scene.isovalues[left.start].0, scene.isovalues[left.end - 1].0);
            let i = if highest > start && (lowest >= start || highest - start >= start - lowest) {
                left.end -= 1;
                left.end
            } else {
                left.start += 1;
                left.start - 1
            };
            let (c, surface) = scene.isovalues[i];
            if values.iter().all(|v| *v < c) || values.iter().all(|v| *v >= c) {
                continue;
            }
            for face in FACES {
                let side = usize::from(turn(face) > 0);
                self.work.triangles += 1;
                fill(job.block, face.map(|i| at[i]), |pixel, w| {
                    let value = interpolate(w, face.map(|i| values[i]));
                    self.stencil[pixel] ^= value < c;
                    let depth = interpolate(w, face.map(|i| frame.depth[corners[i] as usize]));
                    self.faces[pixel][side] = [value, depth];
                });
            }
            let scene_surface = &scene.surfaces[usize::from(surface)];
            let opacity = scene_surface.opacity.clamp(0.0, 1.0);
            let faces = [false, true].map(|greater| scene.settings.inside.colour(scene.surfaces, surface, greater));
            let texels = faces.map(|[r, g, b]| Vec4::new(r, g, b, 1.0) * opacity);
            for face in FACES.into_iter().filter(|f| turn(*f) > 0) {
                self.work.triangles += 1;
                fill(job.block, face.map(|i| at[i]), |pixel, _| {
                    if std::mem::take(&mut self.stencil[pixel]) {
                        let [front, back] = self.faces[pixel];
                        let mark = Mark {
                            surface,
                            count: 1,
                            weight: front_weight(front[0], back[0], c) as f32,
                        };
                        self.blend(pixel, texels[usize::from(front[0] > back[0])], p.light[1]);
                        self.mark(pixel, p.cell, mark, [front[1], back[1]]);
                    }
                });
            }
        }
    }
}
