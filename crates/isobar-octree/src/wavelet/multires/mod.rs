//! Rendering over levels of detail (S15 to S18; section 4.5 and Figures 6.7 to 6.9): every part of the volume with pieces of its own level.
//!
//! A brick of 4^3 pieces of a level is a chunk of the next finer one, so the selection parts the domain into bricks of different sizes
//! ([`Selection::bricks`]). Each level becomes a lattice of its own: the box about its bricks, cut out of the adaptive reconstruction with the
//! coefficients of neighbours that stencils need, in which all other bricks are switched off. The casters of this crate draw these lattices one after
//! the other, finest first, and the nearest hit of a pixel counts. A tile of 16 x 16 pixels is given to a level only where a brick with a surface
//! is seen in it, and not where all its rays have hit something nearer than all of these.
//!
//! **Borders.** Levels agree along shared faces, as one spline (`adaptive.rs`), up to the rounding of f32 coefficients: two roots or none within some 1e-7 voxel of such a
//! face are one in exact arithmetic. Beyond the faces of the domain the finest level goes on by the contract's clamped indices, the others by the mirror of
//! the transform, whose function they are. In degrees 1 and 2 that is the same; in degree 3 levels differ in the last voxel, by at most a sixth of the difference of its two last
//! coefficients, and join there with a jump. On an axis whose size coarse lattices do not end with ([`super`]) so do the last pieces of two coarse levels.
//!
//! **Cost.** A ray pays for every cell it crosses that the surface may meet, whatever the size of the cell; so a coarser level is no cheaper where the cells of
//! the finest are larger than a pixel already, and a second level in the picture is a second pass. The README has the times.
//!
//! **Guarantee.** None is claimed: the casters' proofs hold for each level's spline, and levels are rounded apart.

mod part;

use super::{Adaptive, Extent, Pyramid, Selection, Update};
use crate::cpu::INFO;
use isobar_core::{Channels, DataError, Frame, RenderError, RenderTime, Request, Stop, Surface, Unsupported, View};
use isobar_cpu::scene::{Isovalues, check_open_cuts};
use isobar_cpu::{Level, Pool, Tile, render_tiles};
use part::{Part, kind_of};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
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
    other: Frame,
    tiles: usize,
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
            other: Frame::default(),
            tiles: 0,
        })
    }

    /// The reconstruction behind it.
    #[must_use]
    pub const fn adaptive(&self) -> &Adaptive {
        &self.adaptive
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
        self.prepare();
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
        let (update, parts) = pool.install(|| {
            let update = adaptive.update(selection, Extent::Drawn);
            let bricks = selection.bricks(adaptive.pyramid());
            let parts: Result<Vec<Part>, DataError> = bricks
                .into_iter()
                .enumerate()
                .filter_map(|(l, set)| Part::new(adaptive, l, set).transpose())
                .collect();
            (update, parts)
        });
        self.parts = parts?;
        self.prepare();
        Ok(update)
    }

    fn prepare(&mut self) {
        let Some(surfaces) = &self.surfaces else { return };
        let parts = &mut self.parts;
        self.pool
            .install(|| parts.iter_mut().for_each(|p| p.prepare(surfaces.values())));
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
        let tiles = AtomicUsize::new(0);
        let mut drawn = false;
        for part in &self.parts {
            let Some(prepared) = part.prepared.as_ref().filter(|p| !p.chunks.is_empty()) else {
                continue;
            };
            let mut view = view.clone();
            view.clips.extend_from_slice(&part.ends);
            let nearest = part.nearest(prepared, &view);
            let before = drawn.then_some(&self.frame);
            render_tiles(&self.pool, &view, &self.request, stop, &mut self.other, |tile, out| {
                let seen = nearest.as_ref().map_or(0.0, |n| n.of(tile));
                if seen < f64::INFINITY && !before.is_some_and(|f| hidden(f, tile, seen)) {
                    tiles.fetch_add(1, Ordering::Relaxed);
                    part.draw(prepared, self.simd, (&view, surfaces), tile, out);
                }
            })?;
            if drawn {
                join(&self.pool, &mut self.frame, &self.other);
            } else {
                std::mem::swap(&mut self.frame, &mut self.other);
                drawn = true;
            }
        }
        if !drawn {
            self.frame.reset(view.width, view.height, 1, self.request.channels);
        }
        self.tiles = tiles.into_inner();
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

    /// Bytes of the levels' lattices and their indices, beside [`Adaptive::bytes`].
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.parts.iter().map(Part::bytes).sum()
    }

    /// By level that is drawn: the level, its bricks, and those pairs of bricks per axis that a surface may meet.
    pub fn levels(&self) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        let met = |p: &Part| p.prepared.as_ref().map_or(0, |p| p.chunks.len());
        self.parts.iter().map(move |p| (p.level, p.bricks.count(), met(p)))
    }
}

/// Whether all rays of the tile have hit something nearer than `t`.
fn hidden(frame: &Frame, tile: Tile, t: f64) -> bool {
    tile.pixels().all(|(x, y)| frame.t[y * frame.width + x] < t)
}

/// As [`Frame::compose`], in parallel: takes over the nearer hits of `other`.
fn join(pool: &Pool, frame: &mut Frame, other: &Frame) {
    const PART: usize = 1 << 14;
    fn take<T: Copy + Send + Sync>(nearer: &[bool], to: &mut [T], from: &[T]) {
        if to.is_empty() {
            return;
        }
        let each = |((near, to), from): ((&[bool], &mut [T]), &[T])| {
            for ((&near, to), from) in near.iter().zip(to).zip(from) {
                if near {
                    *to = *from;
                }
            }
        };
        nearer
            .par_chunks(PART)
            .zip(to.par_chunks_mut(PART))
            .zip(from.par_chunks(PART))
            .for_each(each);
    }
    pool.install(|| {
        let nearer: Vec<bool> = (frame.t.par_iter().zip(&other.t)).map(|(a, b)| b < a).collect();
        if !nearer.contains(&true) {
            return;
        }
        take(&nearer, &mut frame.t, &other.t);
        take(&nearer, &mut frame.point, &other.point);
        take(&nearer, &mut frame.normal, &other.normal);
        take(&nearer, &mut frame.surface, &other.surface);
        take(&nearer, &mut frame.rgba, &other.rgba);
        take(&nearer, &mut frame.work, &other.work);
    });
}
