//! The certified first hits of a whole view.

use crate::{Answer, Decided, Multiplicity, Oracle, Root, oracle::Search};
use isobar_core::{ClipPlane, Function, NO_SURFACE, Ray, Stop, Structure, Surface, View};
use rayon::prelude::*;
use std::sync::Arc;
use thiserror::Error;

/// Why no truth could be worked out or read.
#[derive(Debug, Error, Clone, PartialEq)]
#[non_exhaustive]
pub enum TruthError {
    /// The stop was raised.
    #[error("stopped")]
    Stopped,
    /// The view has no pixels, no direction or numbers that are not finite.
    #[error(transparent)]
    View(#[from] isobar_core::RenderError),
    /// Something the oracle does not certify.
    #[error("the oracle does not certify {0}")]
    Unsupported(&'static str),
    /// A transfer function that cannot be used.
    #[error(transparent)]
    Medium(isobar_core::DataError),
    /// More surfaces than a frame can name.
    #[error("{0} surfaces are more than the 255 a frame can name")]
    TooManySurfaces(usize),
    /// The frame or the truth is of another size.
    #[error("the frame has {frame:?} pixels and the truth {truth:?}")]
    Size {
        /// Width and height of the frame.
        frame: (usize, usize),
        /// Width and height of the truth.
        truth: (usize, usize),
    },
    /// The frame lacks a channel that a check needs.
    #[error("the frame has no channel {0}; request it")]
    Channel(&'static str),
    /// Bytes that are no truth, or a damaged one.
    #[error("the cached truth is unusable ({0}); delete it to have it worked out again")]
    Corrupt(&'static str),
}

/// What is true of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruePixel {
    /// The first root over all surfaces with opacity above 0; +inf without one. See [`Root::lo`].
    pub lo: f64,
    /// See [`Root::hi`].
    pub hi: f64,
    /// Index of its surface in the order given, [`NO_SURFACE`] without a root.
    pub surface: u8,
    /// How s - c vanishes there; `None` without a root.
    pub multiplicity: Option<Multiplicity>,
    /// ds/dt there, rounded to f32; 0 at tangents and without a root.
    pub slope: f32,
    /// See [`Oracle::undecidable`]; over all surfaces up to the first root, and also where the brackets of two isovalues meet there.
    pub undecidable: bool,
    /// Whether enclosures could not tell if there is an earlier (or any) root: then lo and hi enclose the doubtful part.
    pub unresolved: bool,
    /// The last stage needed.
    pub decided: Decided,
}

impl TruePixel {
    /// No root.
    pub(crate) const MISS: Self = Self {
        lo: f64::INFINITY,
        hi: f64::INFINITY,
        surface: NO_SURFACE,
        multiplicity: None,
        slope: 0.0,
        undecidable: false,
        unresolved: false,
        decided: Decided::F64,
    };

    /// Whether there is a certified root.
    #[must_use]
    pub fn is_hit(&self) -> bool {
        self.multiplicity.is_some()
    }

    /// The middle of the bracket; +inf for a miss.
    #[must_use]
    pub fn t(&self) -> f64 {
        if self.lo == self.hi {
            self.lo
        } else {
            self.lo + 0.5 * (self.hi - self.lo)
        }
    }

    /// `1 / |ds/dt|`.
    #[must_use]
    pub fn conditioning(&self) -> f64 {
        1.0 / f64::from(self.slope.abs())
    }
}

/// Certified first hits of all pixels of a view, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels.
    pub pixels: Vec<TruePixel>,
}

/// How many pixels each stage decided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stages {
    /// f64 with bounds.
    pub f64: usize,
    /// Double-double.
    pub dd: usize,
    /// Integers.
    pub exact: usize,
}

/// The oracles of the surfaces that can be seen, with their indices.
#[derive(Clone, Debug)]
pub struct Oracles {
    all: Vec<(u8, Oracle)>,
}

impl Oracles {
    /// One oracle per surface with opacity above 0, in what the clipping planes keep: a surface of opacity 0 never hides what is behind
    /// it, so it is no hit. The min/max blocks are built once.
    ///
    /// # Errors
    /// [`TruthError::Unsupported`] for capped planes and for surfaces that [`Oracle::with_surface`] does not know, [`TruthError::TooManySurfaces`].
    pub fn new(function: &Arc<dyn Function>, surfaces: &[Surface], clips: &[ClipPlane]) -> Result<Self, TruthError> {
        check_clips(clips)?;
        check_surfaces(function.as_ref(), surfaces)?;
        let mut all: Vec<(u8, Oracle)> = Vec::new();
        for (s, i) in surfaces.iter().zip(0..) {
            if s.opacity > 0.0 {
                let oracle = match all.first() {
                    Some((_, o)) => o.with_surface(s.kind),
                    None => Oracle::new(function.clone(), 0.0).with_clips(clips).with_surface(s.kind),
                };
                all.push((i, oracle.ok_or(NOT_KNOWN)?));
            }
        }
        Ok(Self { all })
    }

    /// Surface indices and their oracles.
    pub fn iter(&self) -> impl Iterator<Item = (u8, &Oracle)> {
        self.all.iter().map(|(i, o)| (*i, o))
    }

    /// All roots of all surfaces up to `until`, front to back, and whether a part before could not be decided.
    #[must_use]
    pub fn roots(&self, ray: &Ray, until: f64) -> (Vec<(u8, Root)>, bool) {
        let mut unresolved = false;
        let mut roots = Vec::new();
        for (i, o) in &self.all {
            let all = o.until(ray, until);
            unresolved |= !all.unresolved.is_empty();
            roots.extend(all.roots.into_iter().map(|r| (*i, r)));
        }
        roots.sort_by(|a, b| a.1.lo.total_cmp(&b.1.lo).then(a.1.hi.total_cmp(&b.1.hi)));
        (roots, unresolved)
    }

    /// The truth of one ray.
    #[must_use]
    pub fn pixel(&self, ray: &Ray) -> TruePixel {
        let mut best = TruePixel::MISS;
        let mut searches: Vec<Search> = Vec::with_capacity(self.all.len());
        let mut firsts: Vec<(f64, f64, f64)> = Vec::new();
        let mut until = f64::INFINITY;
        for (i, o) in &self.all {
            let s = o.search(ray, until, true, true);
            best.decided = best.decided.max(s.decided);
            let answer = s.answer();
            if let Answer::Hit(r) = &answer {
                firsts.push((o.isovalue(), r.lo, r.hi));
            }
            match answer {
                Answer::Hit(r) if r.lo < best.lo => {
                    best = TruePixel {
                        lo: r.lo,
                        hi: r.hi,
                        surface: *i,
                        multiplicity: Some(r.multiplicity),
                        slope: r.slope as f32,
                        unresolved: false,
                        ..best
                    };
                    until = r.hi;
                }
                Answer::Unresolved { lo, hi } if lo < best.lo => {
                    best = TruePixel {
                        lo,
                        hi,
                        surface: NO_SURFACE,
                        multiplicity: None,
                        slope: 0.0,
                        unresolved: true,
                        ..best
                    };
                    until = hi;
                }
                _ => {}
            }
            searches.push(s);
        }
        // Brackets of two isovalues that meet may be in either order.
        let meets = |&(_, lo, hi): &(f64, f64, f64)| lo <= best.hi && hi >= best.lo;
        let mut near = firsts.iter().filter(|f| meets(f)).map(|f| f.0);
        let first = near.next();
        best.undecidable =
            best.unresolved || near.any(|c| Some(c) != first) || searches.iter().any(|s| s.undecidable_until(best.hi));
        best
    }
}

const NOT_KNOWN: TruthError =
    TruthError::Unsupported("surfaces that are no isosurfaces, but parameter surfaces and the boundary of mapped elements");

/// Refuses surfaces that no oracle knows, and too many.
pub(crate) fn check_surfaces(function: &dyn Function, surfaces: &[Surface]) -> Result<(), TruthError> {
    if surfaces.len() > usize::from(NO_SURFACE) {
        return Err(TruthError::TooManySurfaces(surfaces.len()));
    }
    let mapped = matches!(function.structure(), Structure::Elements(_));
    if surfaces.iter().any(|s| s.value().is_none() && !mapped) {
        return Err(NOT_KNOWN);
    }
    Ok(())
}

/// Refuses capped planes: a cut through the solid is no root.
pub(crate) fn check_clips(clips: &[ClipPlane]) -> Result<(), TruthError> {
    if clips.iter().any(|c| c.cap) {
        return Err(TruthError::Unsupported("closed cuts; leave out --cap"));
    }
    Ok(())
}

impl Truth {
    /// The first root of every pixel over all surfaces with opacity above 0, in what the view's clipping planes keep. Rows in parallel on the current rayon pool; `stop`
    /// counts rows.
    ///
    /// # Errors
    /// [`TruthError::Stopped`]; [`TruthError::View`]; those of [`Oracles::new`].
    pub fn compute(function: &Arc<dyn Function>, surfaces: &[Surface], view: &View, stop: &Stop) -> Result<Self, TruthError> {
        view.validate()?;
        let oracles = Oracles::new(function, surfaces, &view.clips)?;
        let generator = view.generator();
        let (w, h) = (view.width, view.height);
        // A list of rays is one row: cut it, so that threads share it.
        let run = w.clamp(1, 1024);
        stop.begin((w * h).div_ceil(run) as u64);
        let mut pixels = vec![TruePixel::MISS; w * h];
        pixels.par_chunks_mut(run).enumerate().for_each(|(n, chunk)| {
            for (k, p) in chunk.iter_mut().enumerate() {
                if stop.is_raised() {
                    return;
                }
                let i = n * run + k;
                *p = oracles.pixel(&generator.ray(i % w, i / w));
            }
            stop.step();
        });
        if stop.is_raised() {
            return Err(TruthError::Stopped);
        }
        Ok(Self {
            width: w,
            height: h,
            pixels,
        })
    }

    /// How many pixels each stage decided.
    #[must_use]
    pub fn stages(&self) -> Stages {
        let mut s = Stages::default();
        for p in &self.pixels {
            match p.decided {
                Decided::F64 => s.f64 += 1,
                Decided::DoubleDouble => s.dd += 1,
                Decided::Exact => s.exact += 1,
            }
        }
        s
    }

    /// Pixels with a certified root.
    #[must_use]
    pub fn hits(&self) -> usize {
        self.pixels.iter().filter(|p| p.is_hit()).count()
    }

    /// Pixels that are undecidable in f32 (unresolved ones among them).
    #[must_use]
    pub fn undecidable(&self) -> usize {
        self.pixels.iter().filter(|p| p.undecidable).count()
    }
}
