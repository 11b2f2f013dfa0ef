//! Isosurfaces of a view: patches made, sorted into tiles, drawn, and hits worked out for the pixels.

use crate::bvh::Bvh;
use crate::camera::Projection;
use crate::faces::Look;
use crate::mesh::{ActiveCell, Cells};
use crate::patch::{Maker, Patch};
use crate::raster::{Bins, CHUNK, Keys, Patches, TileBuffer};
use crate::resolve::{Resolver, Root};
use isobar_core::{Channels, Claim, Hit, Pixel, Ray, RayGenerator, Request, View};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Blend, Kernel, Level, PixelSink, TILE, Tile, TileOut, is_visible};
use rayon::prelude::*;

/// Active cells whose patches are made together: at most 16 times as many patches.
const BATCH: usize = CHUNK / 16;

/// A surface scene ready to be drawn: everything that depends on data, isovalues and view.
#[derive(Debug)]
pub(crate) enum Prepared {
    /// An image plane.
    Image(Box<Image>),
    /// A list of rays.
    Rays(Bvh),
}

/// Patches of a view.
#[derive(Debug)]
pub(crate) struct Image {
    projection: Projection,
    keys: Keys,
    patches: Patches,
    bins: Bins,
}

/// Work of a frame or a tile.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Work {
    /// Pixels covered by patches, with certainty.
    pub(crate) fragments: u64,
    /// Pixels that went to the resolver.
    pub(crate) resolved: u64,
}

/// Makes the patches of a batch of active cells.
struct Make<'a> {
    maker: Maker<'a>,
    cells: &'a Cells,
    active: &'a [ActiveCell],
    isovalues: &'a [f64],
}

impl Kernel for Make<'_> {
    type Output = Vec<Patch>;

    #[inline(always)]
    fn run(self) -> Vec<Patch> {
        let mut out = Vec::with_capacity(self.active.len() + self.active.len() / 4);
        for a in self.active {
            let (p, s) = (self.cells.corners(a.cell), self.cells.values(a.cell));
            for i in a.from..a.to {
                self.maker
                    .patches(a.cell, &p, &s, (i, self.isovalues[usize::from(i)]), &mut out);
            }
        }
        out
    }
}

/// Greatest |depth| of a corner of the bounds: not 0.
pub(crate) fn key_unit(p: &Projection, (lo, hi): (glam::DVec3, glam::DVec3)) -> f64 {
    (0..8)
        .map(|n| {
            let pick = |bit: usize, a: f64, b: f64| if n >> bit & 1 == 0 { a } else { b };
            let corner = glam::DVec3::new(pick(0, lo.x, hi.x), pick(1, lo.y, hi.y), pick(2, lo.z, hi.z));
            p.depth(corner).abs()
        })
        .fold(f64::MIN_POSITIVE, f64::max)
}

impl Prepared {
    /// Makes the patches of `active` cells; to be called on the pool.
    pub(crate) fn new(cells: &Cells, active: &[ActiveCell], isovalues: &[f64], view: &View, level: Level) -> Self {
        let Some(projection) = Projection::new(view) else {
            return Self::Rays(Bvh::new(cells, active));
        };
        let key_unit = key_unit(&projection, cells.bounds);
        let maker = Maker {
            projection: &projection,
            key_unit,
        };
        // A cell has at most four patches per isovalue; a batch of cells with many isovalues is cut so that its patches can be counted in 16 bits.
        let most = active.iter().map(|a| usize::from(a.to - a.from)).max().unwrap_or(1);
        let chunks: Vec<Vec<Patch>> = active
            .par_chunks((BATCH / most).max(1))
            .map(|active| {
                level.run(Make {
                    maker,
                    cells,
                    active,
                    isovalues,
                })
            })
            .collect();
        let mut patches = Patches { chunks };
        patches.pack();
        let bins = Bins::new(&patches, view.width, view.height, projection.first_pixel());
        Self::Image(Box::new(Image {
            keys: Keys::new(projection.perspective, key_unit),
            projection,
            patches,
            bins,
        }))
    }

    /// Patches and entries of tiles.
    pub(crate) fn counts(&self) -> (usize, usize) {
        match self {
            Self::Image(i) => (i.patches.len(), i.bins.len()),
            Self::Rays(_) => (0, 0),
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Image(i) => i.patches.bytes() + i.bins.bytes(),
            Self::Rays(b) => b.bytes(),
        }
    }
}

/// Takes the roots of a pixel.
pub(crate) trait Emit {
    /// All roots in front, ascending; those left out lie certainly behind the first, which is all that is asked for then. `covered`: patches.
    fn pixel(&mut self, ray: &Ray, x: usize, y: usize, roots: &[Root], covered: u32);

    /// A pixel that certainly has none.
    fn nothing(&mut self, x: usize, y: usize, covered: u32);
}

/// Pixels of an image to be drawn.
pub(crate) struct DrawTile<'a, E> {
    pub(crate) prepared: &'a Prepared,
    pub(crate) resolver: Resolver<'a>,
    pub(crate) view: &'a View,
    pub(crate) nearest_only: bool,
    pub(crate) tile: Tile,
    pub(crate) emit: E,
}

/// Writes pixels into the frame.
pub(crate) struct Write<'a, 'b> {
    pub(crate) cells: &'a Cells,
    pub(crate) surfaces: &'a Isovalues,
    pub(crate) claims: bool,
    pub(crate) look: Look<'a>,
    pub(crate) out: &'a mut TileOut<'b>,
}

impl Write<'_, '_> {
    fn hit(&self, ray: &Ray, root: &Root, error: f64) -> Hit {
        Hit {
            t: root.t,
            point: ray.at(root.t),
            normal: root.normal(),
            surface: self.surfaces.surface(usize::from(root.isovalue)),
            t_error: if self.claims { error } else { f64::INFINITY },
        }
    }

    fn claim(&self, roots: &[Root]) -> Claim {
        match roots.first() {
            _ if !self.claims => Claim::empty(),
            None => Claim::EMPTY,
            Some(r) if r.end.is_some() => Claim::EXISTS | Claim::FIRST | Claim::INTERVAL,
            Some(_) => Claim::EXISTS | Claim::FIRST,
        }
    }

    /// A pixel whose colour is known: surfaces and medium together.
    pub(crate) fn coloured(
        &mut self,
        rays: &RayGenerator<'_>,
        (x, y): (usize, usize),
        roots: &[Root],
        covered: u32,
        rgba: [f32; 4],
    ) {
        if roots.is_empty() {
            let pixel = Pixel {
                claim: self.claim(roots),
                rgba,
                work: covered,
                ..Pixel::default()
            };
            return self.out.set_pixel(x, y, &pixel);
        }
        self.hits_coloured(&rays.ray(x, y), (x, y), roots, covered, rgba);
    }

    /// The same with hits, on their ray.
    fn hits_coloured(&mut self, ray: &Ray, (x, y): (usize, usize), roots: &[Root], covered: u32, rgba: [f32; 4]) {
        for (layer, root) in roots.iter().enumerate().take(self.out.layers()) {
            let error = if layer == 0 { widest(roots) } else { root.error };
            let hit = self.hit(ray, root, error);
            self.out.set_hit(layer, x, y, &hit);
        }
        let pixel = Pixel {
            hits: roots.len().min(usize::from(u16::MAX)) as u16,
            claim: self.claim(roots),
            rgba,
            work: covered,
        };
        self.out.set_pixel(x, y, &pixel);
    }

    /// Hits with other colours, or shaded with other normals, than they are given with.
    fn colour(&self, ray: &Ray, roots: &[Root]) -> [f32; 4] {
        let mut blend = Blend::default();
        for root in roots {
            if blend.is_opaque() {
                break;
            }
            let (surface, normal) = self.look.of(self.surfaces, self.cells, ray, root);
            blend.add(&surface, normal, ray.direction);
        }
        blend.rgba()
    }
}

/// The error of the first of some roots within which none of the others can lie before it.
fn widest(roots: &[Root]) -> f64 {
    let first = &roots[0];
    roots.iter().fold(first.error, |e, r| e.max(first.t - (r.t - r.error)))
}

impl Emit for Write<'_, '_> {
    #[inline(always)]
    fn pixel(&mut self, ray: &Ray, x: usize, y: usize, roots: &[Root], covered: u32) {
        if roots.is_empty() {
            return self.nothing(x, y, covered);
        }
        if !self.look.is_plain() {
            let rgba = if self.out.holds(Channels::RGBA) {
                self.colour(ray, roots)
            } else {
                [0.0; 4]
            };
            return self.hits_coloured(ray, (x, y), roots, covered, rgba);
        }
        let claim = self.claim(roots);
        let hits = |i: usize| self.hit(ray, &roots[i], if i == 0 { widest(roots) } else { roots[i].error });
        let first = hits(0);
        let more: Vec<Hit> = (1..roots.len()).map(hits).collect();
        let mut sink = PixelSink::new(self.out, x, y, ray, self.surfaces.all());
        if sink.push(&first) {
            for hit in &more {
                if !sink.push(hit) {
                    break;
                }
            }
        }
        sink.finish(claim, covered);
    }

    #[inline(always)]
    fn nothing(&mut self, x: usize, y: usize, covered: u32) {
        let pixel = Pixel {
            claim: self.claim(&[]),
            work: covered,
            ..Pixel::default()
        };
        self.out.set_pixel(x, y, &pixel);
    }
}

/// Keeps the roots of the pixels of a square region, row by row.
#[derive(Debug)]
pub(crate) struct Gathered {
    x: usize,
    y: usize,
    side: usize,
    /// Of each pixel: where its roots begin, how many, and patches.
    pixels: Vec<[u32; 3]>,
    roots: Vec<Root>,
}

impl Gathered {
    pub(crate) fn new(x: usize, y: usize, side: usize) -> Self {
        Self {
            x,
            y,
            side,
            pixels: vec![[0; 3]; side * side],
            roots: Vec::new(),
        }
    }

    /// Roots and patches of pixel (x, y) of the image.
    pub(crate) fn pixel(&self, x: usize, y: usize) -> (&[Root], u32) {
        let [from, n, covered] = self.pixels[(y - self.y) * self.side + x - self.x];
        (&self.roots[from as usize..(from + n) as usize], covered)
    }
}

impl Emit for &mut Gathered {
    fn pixel(&mut self, _: &Ray, x: usize, y: usize, roots: &[Root], covered: u32) {
        self.pixels[(y - self.y) * self.side + x - self.x] = [self.roots.len() as u32, roots.len() as u32, covered];
        self.roots.extend_from_slice(roots);
    }

    fn nothing(&mut self, x: usize, y: usize, covered: u32) {
        self.pixels[(y - self.y) * self.side + x - self.x] = [0, 0, covered];
    }
}

/// Whether only the nearest hit of a pixel can be seen.
pub(crate) fn nearest_only(surfaces: &Isovalues, request: &Request) -> bool {
    let opaque = surfaces.all().iter().filter(|s| is_visible(s)).all(|s| s.opacity >= 1.0);
    request.layers <= 1 && !request.channels.contains(Channels::HITS) && (opaque || !request.channels.contains(Channels::RGBA))
}

impl<E: Emit> Kernel for DrawTile<'_, E> {
    type Output = Work;

    #[inline(always)]
    fn run(mut self) -> Work {
        let rays = self.view.generator();
        match self.prepared {
            Prepared::Rays(tree) => self.rays(tree, &rays),
            Prepared::Image(image) => {
                // With clipping planes the nearest hit need not be one that counts.
                let nearest = self.nearest_only && self.resolver.clips.is_empty();
                let mut work = Work::default();
                // Flat images have tiles of other shapes.
                let (tile, side) = (self.tile, TILE);
                for y in tile.y / side..=(tile.y + tile.height - 1) / side {
                    for x in tile.x / side..=(tile.x + tile.width - 1) / side {
                        let square = Tile {
                            x: x * side,
                            y: y * side,
                            width: side,
                            height: side,
                        };
                        if nearest {
                            self.nearest(image, &rays, square, &mut work);
                        } else {
                            self.all(image, &rays, square, &mut work);
                        }
                    }
                }
                work
            }
        }
    }
}

/// The pixels of a tile that lie in a square.
fn pixels(tile: Tile, square: Tile) -> impl Iterator<Item = (usize, usize)> {
    let x = tile.x.max(square.x)..(tile.x + tile.width).min(square.x + square.width);
    let y = tile.y.max(square.y)..(tile.y + tile.height).min(square.y + square.height);
    y.flat_map(move |y| x.clone().map(move |x| (x, y)))
}

impl<E: Emit> DrawTile<'_, E> {
    /// Nearest hits by keys; the resolver where something is unclear.
    #[inline(always)]
    fn nearest(&mut self, image: &Image, rays: &RayGenerator<'_>, square: Tile, work: &mut Work) {
        let ids = image.bins.tile(square);
        let first = image.projection.first_pixel();
        let corner = [first[0] + square.x as f64, first[1] + square.y as f64];
        if ids.is_empty() {
            for (x, y) in pixels(self.tile, square) {
                self.emit.nothing(x, y, 0);
            }
            return;
        }
        let mut buffer = TileBuffer::new(&image.keys);
        for &id in ids {
            buffer.draw(image.patches.get(id), id, square, corner, &image.keys);
        }
        let mut scratch = Vec::new();
        for (x, y) in pixels(self.tile, square) {
            let i = (y - square.y) * TILE + x - square.x;
            work.fragments += u64::from(buffer.covered(i));
            let nearest = buffer.nearest(i);
            if nearest.is_none() && !buffer.is_unclear(i) {
                self.emit.nothing(x, y, buffer.covered(i));
                continue;
            }
            let ray = rays.ray(x, y);
            let certain = nearest.filter(|_| !buffer.is_unclear(i));
            let found = certain.and_then(|id| self.resolver.sure(&ray, image.patches.get(id)));
            if let Some(root) = found {
                self.emit.pixel(&ray, x, y, &[root], buffer.covered(i));
            } else {
                work.resolved += 1;
                let (px, py) = (first[0] + x as f64, first[1] + y as f64);
                let candidates = ids.iter().filter_map(|&id| {
                    let patch = image.patches.get(id);
                    let (certain, may) = patch.covers(px, py);
                    may.then_some((*patch, certain))
                });
                self.resolver.roots(&ray, candidates, &mut scratch);
                self.emit.pixel(&ray, x, y, &scratch, buffer.covered(i));
            }
        }
    }

    /// All hits of each pixel.
    #[inline(always)]
    fn all(&mut self, image: &Image, rays: &RayGenerator<'_>, square: Tile, work: &mut Work) {
        let first = image.projection.first_pixel();
        // (pixel, place in the list, certain), sorted by pixel: each pixel's patches in the order made.
        let mut found: Vec<(u16, bool, u32)> = Vec::new();
        for &id in image.bins.tile(square) {
            let patch = image.patches.get(id);
            let clip = |[a, b]: [u16; 2], from: usize| usize::from(a).max(from)..(usize::from(b) + 1).min(from + TILE);
            for y in clip(patch.y, square.y) {
                for x in clip(patch.x, square.x) {
                    let (certain, may) = patch.covers(first[0] + x as f64, first[1] + y as f64);
                    if may {
                        found.push((((y - square.y) * TILE + x - square.x) as u16, certain, id));
                    }
                }
            }
        }
        found.sort_by_key(|f| f.0);
        let mut scratch = Vec::new();
        for (x, y) in pixels(self.tile, square) {
            let i = ((y - square.y) * TILE + x - square.x) as u16;
            let from = found.partition_point(|f| f.0 < i);
            let here = &found[from..from + found[from..].partition_point(|f| f.0 == i)];
            if here.is_empty() {
                self.emit.nothing(x, y, 0);
                continue;
            }
            let ray = rays.ray(x, y);
            work.fragments += here.len() as u64;
            work.resolved += 1;
            let candidates = here.iter().map(|f| (*image.patches.get(f.2), f.1));
            self.resolver.roots(&ray, candidates, &mut scratch);
            self.emit.pixel(&ray, x, y, &scratch, here.len() as u32);
        }
    }

    /// A list of rays: each is an image of one pixel.
    fn rays(&mut self, tree: &Bvh, rays: &RayGenerator<'_>) -> Work {
        let (mut work, mut scratch, mut patches) = (Work::default(), Vec::new(), Vec::new());
        for (x, y) in self.tile.pixels() {
            let ray = rays.ray(x, y);
            let projection = Projection::of_ray(&ray);
            let maker = Maker {
                projection: &projection,
                key_unit: 1.0,
            };
            patches.clear();
            tree.visit(&ray, |a| {
                let (p, s) = (self.resolver.cells.corners(a.cell), self.resolver.cells.values(a.cell));
                for i in a.from..a.to {
                    let c = self.resolver.isovalues[usize::from(i)];
                    maker.patches(a.cell, &p, &s, (i, c), &mut patches);
                }
            });
            work.fragments += patches.len() as u64;
            work.resolved += 1;
            let candidates = patches.iter().filter_map(|p| {
                let (certain, may) = p.covers(0.0, 0.0);
                may.then_some((*p, certain))
            });
            self.resolver.roots(&ray, candidates, &mut scratch);
            self.emit.pixel(&ray, x, y, &scratch, patches.len() as u32);
        }
        work
    }
}
