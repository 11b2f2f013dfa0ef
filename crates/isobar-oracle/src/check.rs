//! A frame held against the truth: CONTRACT `check`, DESIGN section 4.

use crate::{
    Multiplicity, Oracles, Root, Stages, TruePixel, Truth, TruthError,
    truth::{check_clips, check_surfaces},
};
use isobar_core::{Channels, Claim, DVec3, Frame, Function, Ray, Surface, View};
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// A hit farther than this from every root, in voxels, is false.
const FALSE_BEYOND: f64 = 0.5;

/// What a pixel's answer is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Class {
    /// A miss where there is no root.
    RightMiss = 0,
    /// The first root, on the right surface.
    RightHit = 1,
    /// No hit although there is a root.
    Missed = 2,
    /// A hit farther than half a voxel from every root (or NaN).
    FalseHit = 3,
    /// A hit at a later root.
    WrongRoot = 4,
    /// The first root under another surface's index.
    WrongSurface = 5,
    /// Undecidable in f32, and the answer would pass.
    UndecidableAgrees = 6,
    /// Undecidable in f32, and the answer would be counted as one of the four errors.
    UndecidableDiffers = 7,
}

/// Median, 99th percentile and maximum; NaN where there are no values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantiles {
    /// 50th percentile (lower of the middle two).
    pub median: f64,
    /// 99th percentile (nearest rank).
    pub p99: f64,
    /// Greatest.
    pub max: f64,
}

impl Quantiles {
    /// Of the finite values of a list.
    #[must_use]
    pub fn of(values: impl IntoIterator<Item = f32>) -> Self {
        let mut v: Vec<f32> = values.into_iter().filter(|x| x.is_finite()).collect();
        v.sort_by(f32::total_cmp);
        let rank = |q: f64| {
            let i = (q * v.len() as f64).ceil() as usize;
            v.get(i.max(1) - 1).map_or(f64::NAN, |&x| f64::from(x))
        };
        Self {
            median: rank(0.5),
            p99: rank(0.99),
            max: rank(1.0),
        }
    }
}

/// The outcome of a check. `pixels = ` right misses and hits + the four errors + `undecidable`.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels where the frame has a hit.
    pub hits: usize,
    /// Pixels without a hit where there is a root.
    pub missed: usize,
    /// Hits farther than half a voxel from every root of their ray, and NaN.
    pub false_hits: usize,
    /// Hits at a root that is not the first.
    pub wrong_root: usize,
    /// Hits at the first root that name another surface.
    pub wrong_surface: usize,
    /// Pixels with a claim that is proved wrong (undecidable pixels included: a claim is a proof).
    pub refuted: usize,
    /// Pixels that f32-sized errors could change; not counted in the four above.
    pub undecidable: usize,
    /// Undecidable pixels that would have been counted in the four.
    pub undecidable_differs: usize,
    /// Pixels that claim neither EXISTS and FIRST nor EMPTY.
    pub unclaimed: usize,
    /// |t - root| of right hits, as world length over the voxel ([`isobar_core::Domain::voxel`]).
    pub t_error_voxels: Quantiles,
    /// The same over the pixel's footprint at the root; NaN for lists of rays, which have none.
    pub t_error_pixels: Quantiles,
    /// Angle between the frame's normal and grad s at the certified root, degrees, of right hits on isosurfaces; NaN without normals.
    pub normal_error_deg: Quantiles,
    /// How many pixels of the truth each stage decided.
    pub stage: Stages,
    /// Per pixel, row by row.
    pub class: Vec<Class>,
    /// |t - root| in voxels of right hits; NaN elsewhere.
    pub error_voxels: Vec<f32>,
    /// |t - root| in pixel footprints of right hits; NaN elsewhere.
    pub error_pixels: Vec<f32>,
    /// Normal error in degrees of right hits; NaN elsewhere.
    pub error_deg: Vec<f32>,
    /// Claims proved wrong.
    pub refuted_claims: Vec<Claim>,
}

/// One pixel's outcome.
#[derive(Clone, Copy, Debug)]
struct Verdict {
    class: Class,
    hit: bool,
    refuted: Claim,
    unclaimed: bool,
    voxels: f32,
    pixels: f32,
    degrees: f32,
}

/// What all pixels share.
struct Checker<'a> {
    frame: &'a Frame,
    function: &'a Arc<dyn Function>,
    view: &'a View,
    surfaces: &'a [Surface],
    oracles: OnceLock<Oracles>,
    voxel: f64,
}

/// Compares every pixel of `frame` with `truth`, which must be that of the same function, surfaces and view. Later roots are worked out
/// where a pixel needs them. Runs on the current rayon pool.
///
/// A hit belongs to the root of its ray nearest to it (a stretch s = c counts with all its length). Undecidable pixels have a column of
/// their own; claims are checked there too. EXISTS is refuted where no root of the claimed surface meets `[t - e, t + e]`, FIRST where a
/// root certainly lies before `t - e`, EMPTY where there is a root, TANGENT and INTERVAL where no root of that kind meets `[t - e, t + e]`. An
/// e that is NaN counts as 0, and a claim about an unresolved part of a ray is not refuted.
///
/// # Errors
/// [`TruthError::Size`] and [`TruthError::Channel`] where the frame does not fit, and those of [`Oracles::new`].
pub fn check(
    frame: &Frame,
    truth: &Truth,
    function: &Arc<dyn Function>,
    surfaces: &[Surface],
    view: &View,
) -> Result<Check, TruthError> {
    let sizes = ((frame.width, frame.height), (truth.width, truth.height));
    if sizes.0 != sizes.1 || sizes.0 != (view.width, view.height) {
        return Err(TruthError::Size {
            frame: sizes.0,
            truth: sizes.1,
        });
    }
    if !frame.channels.contains(Channels::T) {
        return Err(TruthError::Channel("t"));
    }
    check_clips(&view.clips)?;
    // Refuse bad surfaces here; the min/max blocks are built when a pixel needs them.
    check_surfaces(function.as_ref(), surfaces)?;
    let checker = Checker {
        frame,
        function,
        view,
        surfaces,
        oracles: OnceLock::new(),
        voxel: function.domain().voxel(),
    };
    let generator = view.generator();
    let verdicts: Vec<Verdict> = truth
        .pixels
        .par_iter()
        .enumerate()
        .with_min_len(256)
        .map(|(i, p)| checker.pixel(i, &generator.ray(i % view.width, i / view.width), p))
        .collect();
    Ok(Check::gather(&verdicts, truth.stages()))
}

impl Checker<'_> {
    fn oracles(&self) -> Option<&Oracles> {
        if self.oracles.get().is_none() {
            let made = Oracles::new(self.function, self.surfaces, &self.view.clips).ok()?;
            // Another thread may have been faster; theirs is as good.
            let _ = self.oracles.set(made);
        }
        self.oracles.get()
    }

    /// All roots up to t, of all surfaces.
    fn roots(&self, ray: &Ray, until: f64) -> (Vec<(u8, Root)>, bool) {
        self.oracles().map_or((Vec::new(), true), |o| o.roots(ray, until))
    }

    fn pixel(&self, i: usize, ray: &Ray, p: &TruePixel) -> Verdict {
        let t = self.frame.t[i];
        let surface = self.frame.surface.get(i).copied();
        let hit = t != f64::INFINITY;
        let length = ray.direction.length();
        let voxels = |dt: f64| dt * length / self.voxel;
        let mut v = Verdict {
            class: Class::RightMiss,
            hit,
            refuted: Claim::empty(),
            unclaimed: true,
            voxels: f32::NAN,
            pixels: f32::NAN,
            degrees: f32::NAN,
        };
        v.class = match (hit, p.is_hit()) {
            (false, false) => Class::RightMiss,
            (false, true) => Class::Missed,
            (true, _) => self.judge_hit(t, surface, ray, p, &voxels),
        };
        if v.class == Class::RightHit && p.is_hit() {
            let root = p.t();
            let error = (t - root).abs();
            let end = if p.multiplicity == Some(Multiplicity::Interval) {
                f64::INFINITY
            } else {
                p.hi
            };
            let inside = (p.lo..=end).contains(&t);
            let error = if inside { 0.0 } else { error };
            v.voxels = voxels(error) as f32;
            let footprint = self.view.footprint(root);
            if footprint > 0.0 {
                v.pixels = (error * length / footprint) as f32;
            }
            // Of other surfaces s is not constant on them: its gradient is no normal.
            if self.surfaces.get(usize::from(p.surface)).is_some_and(|s| s.value().is_some()) {
                v.degrees = self.normal_error(i, ray.at(root));
            }
        }
        if let Some(&claim) = self.frame.claim.get(i) {
            v.unclaimed = !(claim.contains(Claim::EXISTS | Claim::FIRST) || claim.contains(Claim::EMPTY));
            v.refuted = self.refuted(claim, t, i, ray, p);
        }
        if p.undecidable {
            v.class = match v.class {
                Class::RightMiss | Class::RightHit => Class::UndecidableAgrees,
                _ => Class::UndecidableDiffers,
            };
        }
        v
    }

    fn judge_hit(&self, t: f64, surface: Option<u8>, ray: &Ray, p: &TruePixel, voxels: &dyn Fn(f64) -> f64) -> Class {
        if t.is_nan() || !p.is_hit() && !p.unresolved {
            return Class::FalseHit;
        }
        if p.unresolved {
            // Nothing certain to hold it against; such pixels are undecidable.
            return if p.lo <= t && t <= p.hi {
                Class::RightHit
            } else {
                Class::FalseHit
            };
        }
        let mut first = (p.lo - t).max(t - p.hi).max(0.0);
        if t > p.hi {
            // A later root may be nearer; it cannot lie beyond t + (t - first).
            let (roots, _) = self.roots(ray, t + first);
            let mut at_first = true;
            let mut best = f64::INFINITY;
            for (_, r) in &roots {
                let d = r.distance(t);
                // Roots of two surfaces with the same isovalue are one root.
                let same = r.lo <= p.hi;
                if d < best || d <= best && same {
                    (best, at_first) = (d, same);
                }
            }
            if !at_first {
                return if voxels(best) > FALSE_BEYOND {
                    Class::FalseHit
                } else {
                    Class::WrongRoot
                };
            }
            first = best.min(first);
        }
        if voxels(first) > FALSE_BEYOND {
            return Class::FalseHit;
        }
        let kind = |i: u8| self.surfaces.get(usize::from(i)).map(|s| s.kind);
        match surface {
            Some(s) if s != p.surface && kind(s) != kind(p.surface) => Class::WrongSurface,
            _ => Class::RightHit,
        }
    }

    fn normal_error(&self, i: usize, at: DVec3) -> f32 {
        let Some(n) = self.frame.normal.get(i) else {
            return f32::NAN;
        };
        let n = DVec3::new(f64::from(n[0]), f64::from(n[1]), f64::from(n[2]));
        let g = self.function.gradient(at);
        if g.length() == 0.0 || !g.is_finite() {
            return f32::NAN;
        }
        // atan2 keeps small angles; a zero or NaN normal is as wrong as can be.
        let angle = n.cross(g).length().atan2(n.dot(g)).to_degrees();
        if n == DVec3::ZERO || angle.is_nan() {
            180.0
        } else {
            angle as f32
        }
    }

    /// The claims of a pixel that are certainly wrong.
    fn refuted(&self, claim: Claim, t: f64, i: usize, ray: &Ray, p: &TruePixel) -> Claim {
        let mut wrong = Claim::empty();
        if claim.contains(Claim::EMPTY) && p.is_hit() {
            wrong |= Claim::EMPTY;
        }
        let about_root = Claim::EXISTS | Claim::TANGENT | Claim::INTERVAL;
        if !claim.intersects(about_root | Claim::FIRST) {
            return wrong;
        }
        let e = self.frame.t_error.get(i).copied().unwrap_or(f64::INFINITY);
        let e = if e.is_nan() { 0.0 } else { e.abs() };
        // A miss, or NaN, that claims a root.
        if !t.is_finite() {
            if claim.contains(Claim::FIRST) && p.is_hit() && t == f64::INFINITY {
                wrong |= Claim::FIRST;
            }
            return wrong | (claim & about_root);
        }
        // Rounded outward: a claim is refuted only where the exact interval misses every bracket.
        let (lo, hi) = ((t - e).next_down(), (t + e).next_up());
        if claim.contains(Claim::FIRST) && p.is_hit() && p.hi < lo {
            wrong |= Claim::FIRST;
        }
        let asked = claim & about_root;
        if asked.is_empty() {
            return wrong;
        }
        let named = self.frame.surface.get(i).copied();
        let kind = |s: u8| self.surfaces.get(usize::from(s)).map(|s| s.kind);
        let of_surface = |s: u8| named.is_none_or(|n| n == s || kind(n) == kind(s));
        // The first root settles most claims; the others are looked for only where it does not.
        if asked == Claim::EXISTS && p.is_hit() && p.lo <= hi && lo <= p.hi && of_surface(p.surface) {
            return wrong;
        }
        if !p.is_hit() && !p.unresolved {
            return wrong | asked;
        }
        let (roots, unresolved) = self.roots(ray, hi);
        if unresolved {
            return wrong;
        }
        let meets = |want: &dyn Fn(&Root) -> bool| {
            roots
                .iter()
                .any(|(s, r)| of_surface(*s) && r.lo <= hi && lo <= r.interval_end.unwrap_or(r.hi) && want(r))
        };
        for (flag, want) in [
            (Claim::EXISTS, &(|_: &Root| true) as &dyn Fn(&Root) -> bool),
            (Claim::TANGENT, &|r: &Root| {
                matches!(
                    r.multiplicity,
                    Multiplicity::Even(_) | Multiplicity::Interval | Multiplicity::Unknown
                )
            }),
            (Claim::INTERVAL, &|r: &Root| r.multiplicity == Multiplicity::Interval),
        ] {
            if claim.contains(flag) && !meets(want) {
                wrong |= flag;
            }
        }
        wrong
    }
}

impl Check {
    fn gather(verdicts: &[Verdict], stage: Stages) -> Self {
        let mut c = Self {
            pixels: verdicts.len(),
            hits: verdicts.iter().filter(|v| v.hit).count(),
            missed: 0,
            false_hits: 0,
            wrong_root: 0,
            wrong_surface: 0,
            refuted: 0,
            undecidable: 0,
            undecidable_differs: 0,
            unclaimed: verdicts.iter().filter(|v| v.unclaimed).count(),
            t_error_voxels: Quantiles::of([]),
            t_error_pixels: Quantiles::of([]),
            normal_error_deg: Quantiles::of([]),
            stage,
            class: verdicts.iter().map(|v| v.class).collect(),
            error_voxels: verdicts.iter().map(|v| v.voxels).collect(),
            error_pixels: verdicts.iter().map(|v| v.pixels).collect(),
            error_deg: verdicts.iter().map(|v| v.degrees).collect(),
            refuted_claims: verdicts.iter().map(|v| v.refuted).collect(),
        };
        c.count();
        c
    }

    /// Several frames as one: counts add, quantiles are of all pixels together, and the per-pixel lists follow one another.
    #[must_use]
    pub fn join(checks: impl IntoIterator<Item = Self>) -> Self {
        let mut all = Self::gather(&[], Stages::default());
        for c in checks {
            all.pixels += c.pixels;
            all.hits += c.hits;
            all.unclaimed += c.unclaimed;
            all.stage.f64 += c.stage.f64;
            all.stage.dd += c.stage.dd;
            all.stage.exact += c.stage.exact;
            all.class.extend(c.class);
            all.error_voxels.extend(c.error_voxels);
            all.error_pixels.extend(c.error_pixels);
            all.error_deg.extend(c.error_deg);
            all.refuted_claims.extend(c.refuted_claims);
        }
        all.count();
        all
    }

    /// Counts and quantiles from the per-pixel lists. Errors of undecidable pixels do not count.
    fn count(&mut self) {
        let of = |class: Class| self.class.iter().filter(|&&c| c == class).count();
        self.missed = of(Class::Missed);
        self.false_hits = of(Class::FalseHit);
        self.wrong_root = of(Class::WrongRoot);
        self.wrong_surface = of(Class::WrongSurface);
        self.undecidable_differs = of(Class::UndecidableDiffers);
        self.undecidable = self.undecidable_differs + of(Class::UndecidableAgrees);
        self.refuted = self.refuted_claims.iter().filter(|c| !c.is_empty()).count();
        let right = |values: &[f32]| {
            let pairs = values.iter().zip(&self.class);
            Quantiles::of(pairs.filter(|(_, c)| **c == Class::RightHit).map(|(v, _)| *v))
        };
        self.t_error_voxels = right(&self.error_voxels);
        self.t_error_pixels = right(&self.error_pixels);
        self.normal_error_deg = right(&self.error_deg);
    }

    /// Whether every decidable pixel is right and no claim is refuted.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        self.missed + self.false_hits + self.wrong_root + self.wrong_surface + self.refuted == 0
    }
}
