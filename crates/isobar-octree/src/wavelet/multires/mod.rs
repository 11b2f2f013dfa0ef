//! Rendering over levels of detail (S15 to S18; section 4.5 and Figures 6.7 to 6.9): every part of the volume with pieces of its own level.
//!
//! A brick of 4^3 pieces of a level is a chunk of the next finer one, so the selection parts the domain into bricks of different sizes
//! ([`Selection::bricks`]). Each level becomes a lattice of its own: the box about its bricks, cut out of the adaptive reconstruction with the
//! coefficients of neighbours that stencils need, in which all other bricks are switched off. The casters of this crate draw a tile of 16 x 16 pixels level by level, the level
//! whose bricks may be nearest first, and the nearest hit of a pixel counts. A tile is given to a level only where a brick with a surface is seen in it, and not
//! where all its rays have hit something nearer than all of these; a ray ends where it has hit a level before.
//!
//! **Borders.** Levels agree along shared faces, as one spline (`adaptive.rs`), up to the rounding of f32 coefficients, which moves roots by some 1e-7 voxel. So that none is lost between
//! the two sides of a face, the finer level draws a layer of its bricks on the coarser side too, where both are one function. Beyond the faces of the domain the finest level goes on by the contract's clamped indices, the others by the mirror of
//! the transform, whose function they are. In degrees 1 and 2 that is the same; in degree 3 levels differ in the last voxel, by at most a sixth of the difference of its two last
//! coefficients, and join there with a jump. On an axis whose size coarse lattices do not end with ([`super`]) so do the last pieces of two coarse levels.
//!
//! **Cost.** A ray pays for every cell it crosses that the surface may meet, whatever the size of the cell, and eight rays share a vector: so a coarser level is cheaper where the
//! cells of the finest are smaller than some two pixels, and no cheaper where they are larger. Making rays, working out roots and shading cost what they do at any
//! level. The README has the times.
//!
//! **Guarantee.** None is claimed: the casters' proofs hold for each level's spline, and levels are rounded apart.

mod part;

use super::{Adaptive, Extent, Pyramid, Selection, Update};
use crate::cpu::INFO;
use isobar_core::{Channels, DataError, Frame, RenderError, RenderTime, Request, Stop, Surface, Unsupported, View};
use isobar_cpu::scene::{Isovalues, check_open_cuts};
use isobar_cpu::{Level, Pool, Tile, TileOut, render_tiles};
use part::{Nearest, Part, Prepared, kind_of};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

/// A volume drawn at levels of detail: first hits of opaque isovalues.
#[derive(Debug)]
pub struct Multiresolution {
    adaptive: Adaptive<f32>,
    pool: Pool,
    simd: Level,
    request: Request,
    surfaces: Option<Isovalues>,
    /// By level, finest first; those without a brick are left out.
    parts: Vec<Part>,
    frame: Frame,
    tiles: usize,
    cells: u64,
}

impl Multiresolution {
    /// Nothing is drawn before [`Multiresolution::select`]. `channels`: T, POINT, NORMAL, SURFACE, RGBA and WORK; T is always there. `threads` as in
    /// [`Request`].
    ///
    /// # Errors
    /// [`Unsupported::Feature`] for other channels; [`DataError::TooThin`] where an axis has one sample; as [`Pool::new`].
    pub fn new(pyramid: Arc<Pyramid>, channels: Channels, threads: usize) -> Result<Self, RenderError> {
        let can = Channels::T | Channels::POINT | Channels::NORMAL | Channels::SURFACE | Channels::RGBA | Channels::WORK;
        if !can.contains(channels) {
            return Err(Unsupported::Feature {
                method: INFO.id,
                what: "hit counts, errors and claims over levels of detail; ask for t, point, normal, surface, rgba or work"
                    .into(),
            }
            .into());
        }
        if pyramid.dims().iter().any(|&n| n < 2) {
            return Err(DataError::TooThin {
                reconstruction: kind_of(pyramid.bank()).name().into(),
                dims: pyramid.dims(),
            }
            .into());
        }
        Ok(Self {
            adaptive: Adaptive::new(pyramid),
            pool: Pool::new(threads)?,
            simd: Level::detect(),
            request: Request {
                channels: channels | Channels::T,
                threads,
                ..Request::default()
            },
            surfaces: None,
            parts: Vec::new(),
            frame: Frame::default(),
            tiles: 0,
            cells: 0,
        })
    }

    /// The reconstruction behind it.
    #[must_use]
    pub const fn adaptive(&self) -> &Adaptive {
        &self.adaptive
    }

    /// Forgets what was reconstructed, so that the next selection makes all it needs.
    pub fn forget(&mut self) {
        self.adaptive.forget();
        self.parts.clear();
    }

    /// The surfaces; no part of the volume is read again.
    ///
    /// # Errors
    /// [`Unsupported::Feature`] as [`Isovalues::new`], and where one is semi-transparent.
    pub fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        if surfaces.iter().any(|s| s.opacity > 0.0 && s.opacity < 1.0) {
            return Err(Unsupported::Feature {
                method: INFO.id,
                what: "semi-transparent surfaces over levels of detail; give them opacity 1".into(),
            }
            .into());
        }
        self.surfaces = Some(Isovalues::new(&INFO, surfaces)?);
        self.prepare(true);
        Ok(())
    }

    /// Makes a selection the present one: reconstructs what it needs beyond what is there ([`Adaptive::update`]), and lays out the lattices of the levels.
    ///
    /// # Errors
    /// [`DataError`] where reconstructed values are not finite.
    ///
    /// # Panics
    /// When the selection was made for a pyramid of other dimensions.
    pub fn select(&mut self, selection: &Selection) -> Result<Update, RenderError> {
        let (pool, adaptive) = (&self.pool, &mut self.adaptive);
        let mut before = std::mem::take(&mut self.parts);
        let (update, parts) = pool.install(|| {
            let update = adaptive.update(selection, Extent::Drawn);
            let bricks = selection.overlapping(adaptive.pyramid());
            let parts: Result<Vec<Part>, DataError> = bricks
                .into_iter()
                .enumerate()
                .filter_map(|(l, set)| {
                    let same = before.iter().position(|p| p.level == l && p.bricks == set);
                    match same.filter(|_| !adaptive.changed(l)) {
                        Some(at) => Some(Ok(before.swap_remove(at))),
                        None => Part::new(adaptive, l, set).transpose(),
                    }
                })
                .collect();
            (update, parts)
        });
        self.parts = parts?;
        self.prepare(false);
        Ok(update)
    }

    /// Finds the bricks of the levels that the surfaces may meet: of those that are new, or of all.
    fn prepare(&mut self, all: bool) {
        let Some(surfaces) = &self.surfaces else { return };
        let parts = self.parts.iter_mut().filter(|p| all || p.prepared.is_none());
        self.pool.install(|| parts.for_each(|p| p.prepare(surfaces.values())));
    }

    /// Draws the frame, which [`Multiresolution::frame`] shows.
    ///
    /// # Errors
    /// [`RenderError::NotReady`] without surfaces; closed cuts are refused; as [`View::validate`]; [`RenderError::Stopped`].
    pub fn render(&mut self, view: &View, stop: &Stop) -> Result<RenderTime, RenderError> {
        let surfaces = self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        view.validate()?;
        check_open_cuts(&INFO, view)?;
        let start = Instant::now();
        let scenes: Vec<Scene<'_>> = (self.parts.iter())
            .filter_map(|part| Scene::new(part, view, surfaces))
            .collect();
        let (tiles, cells) = (AtomicUsize::new(0), AtomicU64::new(0));
        render_tiles(&self.pool, view, &self.request, stop, &mut self.frame, |tile, out| {
            let (mut given, mut looked) = (0, 0);
            let mut seen: Vec<(f64, &Scene<'_>)> = (scenes.iter())
                .map(|s| (s.nearest.as_ref().map_or(0.0, |n| n.of(tile)), s))
                .filter(|s| s.0 < f64::INFINITY)
                .collect();
            // Of equals the finer one first, as it was.
            seen.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (near, scene) in seen {
                if given > 0 {
                    if hidden(out, tile, near) {
                        // What is left is no nearer.
                        break;
                    }
                    out.keep_nearest();
                }
                given += 1;
                looked += scene.draw(self.simd, surfaces, tile, out);
            }
            tiles.fetch_add(given, Ordering::Relaxed);
            cells.fetch_add(looked, Ordering::Relaxed);
        })?;
        (self.tiles, self.cells) = (tiles.into_inner(), cells.into_inner());
        Ok(RenderTime {
            wall: start.elapsed(),
            device: None,
        })
    }

    /// The last frame drawn.
    #[must_use]
    pub const fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Tiles given to levels for the last frame: more than the tiles of the image where several levels are seen in one.
    #[must_use]
    pub const fn tiles(&self) -> usize {
        self.tiles
    }

    /// Active cells that rays of the last frame looked into, once a ray.
    #[must_use]
    pub const fn cells(&self) -> u64 {
        self.cells
    }

    /// Bytes of the levels' lattices and their indices, beside [`Adaptive::bytes`].
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.parts.iter().map(Part::bytes).sum()
    }

    /// By level that is drawn: the level, its bricks with those that overlap coarser levels, and those of them that a surface may meet.
    pub fn levels(&self) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        let met = |p: &Part| p.prepared.as_ref().map_or(0, |p| p.bricks);
        self.parts.iter().map(move |p| (p.level, p.bricks.count(), met(p)))
    }
}

/// A level as it is seen.
struct Scene<'a> {
    part: &'a Part,
    prepared: &'a Prepared,
    /// With the planes that end the level's lattice.
    view: View,
    /// `None`: any tile may see it.
    nearest: Option<Nearest>,
}

impl<'a> Scene<'a> {
    /// `None` where no surface can be in the level.
    fn new(part: &'a Part, view: &View, surfaces: &Isovalues) -> Option<Self> {
        let prepared = part
            .prepared
            .as_ref()
            .filter(|p| p.bricks > 0 && !surfaces.values().is_empty())?;
        let mut view = view.clone();
        view.clips.extend_from_slice(&part.ends);
        Some(Self {
            nearest: part.nearest(prepared, &view),
            part,
            prepared,
            view,
        })
    }

    fn draw(&self, simd: Level, surfaces: &Isovalues, tile: Tile, out: &mut TileOut<'_>) -> u64 {
        self.part.draw(self.prepared, simd, (&self.view, surfaces), tile, out)
    }
}

/// Whether all rays of the tile have hit something nearer than `t`.
fn hidden(out: &TileOut<'_>, tile: Tile, t: f64) -> bool {
    tile.pixels().all(|(x, y)| out.t(x, y) < t)
}
