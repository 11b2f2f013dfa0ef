//! The oracle of one function and one isovalue.

use crate::{
    AllRoots, Answer, Decided, Root, analytic,
    clip::Kept,
    exact::ExactRay,
    extremum::LIMIT,
    hexes::{self, Doubt, Target, Wanted},
    integral::{beam::Beam, legs},
    lattice,
    map::{LocalMap, Mapped},
    polynomial,
    skip::Skip,
    tets, type6,
};
use isobar_core::{ClipPlane, Domain, Function, Ray, Structure, SurfaceKind};
use std::sync::Arc;

/// Certified roots of s = c along rays. Immutable and shared freely between threads.
#[derive(Clone, Debug)]
pub struct Oracle {
    function: Arc<dyn Function>,
    isovalue: f64,
    /// What is looked for in mapped elements.
    wanted: Wanted,
    shared: Arc<Shared>,
    least: Decided,
    clips: Arc<[ClipPlane]>,
}

/// What does not depend on the isovalue.
#[derive(Debug)]
pub(crate) struct Shared {
    /// `None`: the domain's numbers are outside the range of stages 1 and 2.
    pub(crate) local: Option<LocalMap>,
    /// `None` unless the function is a lattice or tetrahedral.
    pub(crate) skip: Option<Skip>,
    /// `None` unless the function is that of a mesh.
    pub(crate) tets: Option<tets::Index>,
    /// `None` unless the function is that of mapped elements.
    pub(crate) hexes: Option<hexes::Index>,
    /// Whether cells are centred on samples.
    pub(crate) centred: bool,
}

/// What a search is after.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Goal<'a> {
    /// Roots beyond this t are not asked for.
    pub(crate) until: f64,
    /// Only the first root.
    pub(crate) first_only: bool,
    /// Whether near-extrema are to be noted.
    pub(crate) watch: bool,
    /// Earliest stage to use: for tests.
    pub(crate) least: Decided,
    /// What clipping planes keep of the ray.
    pub(crate) kept: Option<&'a Kept>,
}

impl Goal<'_> {
    /// The kept part of a stay.
    pub(crate) fn keep(&self, mapped: Mapped) -> Mapped {
        match self.kept {
            Some(k) => k.narrow(mapped),
            None => mapped,
        }
    }

    /// [`ExactRay::new`] with the kept part of its stay.
    pub(crate) fn exact_ray(&self, ray: &Ray, domain: &Domain, centred: bool) -> Option<ExactRay> {
        let mut exact = ExactRay::new(ray, domain, centred)?;
        if let Some(k) = self.kept {
            k.narrow_exactly(&mut exact);
        }
        Some(exact)
    }
}

/// What a search found.
#[derive(Clone, Debug)]
pub(crate) struct Search {
    pub(crate) roots: Vec<Root>,
    pub(crate) unresolved: Vec<(f64, f64)>,
    /// Why, for each, where that is known: mapped elements.
    pub(crate) doubts: Vec<Doubt>,
    pub(crate) decided: Decided,
    /// t of the first near-extremum not after the first root.
    pub(crate) near: Option<f64>,
}

impl Search {
    pub(crate) fn new(least: Decided) -> Self {
        Self {
            roots: Vec::new(),
            unresolved: Vec::new(),
            doubts: Vec::new(),
            decided: least,
            near: None,
        }
    }

    /// The first event as an answer.
    pub(crate) fn answer(&self) -> Answer {
        match (self.roots.first(), self.unresolved.first()) {
            (Some(r), u) if u.is_none_or(|u| r.hi <= u.0) => Answer::Hit(*r),
            (_, Some(&(lo, hi))) => Answer::Unresolved { lo, hi },
            _ => Answer::Miss { decided: self.decided },
        }
    }

    /// Whether the ray is undecidable up to `t`: see [`Oracle::undecidable`].
    pub(crate) fn undecidable_until(&self, t: f64) -> bool {
        use crate::Multiplicity::{Even, Interval, Unknown};
        self.near.is_some_and(|n| n <= t)
            || self.unresolved.first().is_some_and(|u| u.0 <= t)
            || self
                .roots
                .first()
                .is_some_and(|r| r.lo <= t && matches!(r.multiplicity, Even(_) | Interval | Unknown))
    }
}

impl Oracle {
    /// An oracle for the surface `function = isovalue`. For a lattice it builds min/max blocks of 8^3 and 64^3 cells, in parallel: time
    /// linear in the samples, memory 1/30 byte per sample.
    #[must_use]
    pub fn new(function: Arc<dyn Function>, isovalue: f64) -> Self {
        let structure = function.structure();
        let centred = match structure {
            Structure::Lattice(l) => l.basis().centred,
            Structure::Tetrahedral(_) => true,
            _ => false,
        };
        let skip = match structure {
            Structure::Lattice(l) => Some(Skip::new(l)),
            Structure::Tetrahedral(t) => Some(Skip::of(t.dims(), |lo, hi| t.range(lo, hi))),
            _ => None,
        };
        let tets = match structure {
            Structure::Mesh(m) => Some(tets::Index::new(m)),
            _ => None,
        };
        let hexes = match structure {
            Structure::Elements(h) => Some(hexes::Index::new(h)),
            _ => None,
        };
        let shared = Shared {
            tets,
            hexes,
            local: LocalMap::new(function.domain(), centred),
            skip,
            centred,
        };
        Self {
            function,
            isovalue,
            wanted: Wanted::Each(Target::Isovalue(isovalue)),
            shared: Arc::new(shared),
            least: Decided::F64,
            clips: Arc::default(),
        }
    }

    /// The same with clipping planes: only `t` at which all of them keep the ray's point count, a point exactly on a plane included. Decided
    /// exactly on the bits of the planes. Caps are not drawn: a plane is taken as an open cut whether it asks for one or not. Planes must
    /// be finite with normals that are not zero.
    #[must_use]
    pub fn with_clips(&self, clips: &[ClipPlane]) -> Self {
        Self {
            clips: clips.into(),
            ..self.clone()
        }
    }

    /// The same function with another isovalue; shares the min/max blocks.
    #[must_use]
    pub fn with_isovalue(&self, isovalue: f64) -> Self {
        Self {
            isovalue,
            wanted: Wanted::Each(Target::Isovalue(isovalue)),
            ..self.clone()
        }
    }

    /// The same function with another surface: an isosurface, or for mapped elements a parameter surface (then [`Oracle::isovalue`] is 0 and slopes are those of
    /// the parameter) or the boundary, which are the faces that only one element has, bit by bit. `None` for other surfaces of other functions, for an axis above 2
    /// and a parameter outside [0, 1].
    #[must_use]
    pub fn with_surface(&self, kind: SurfaceKind) -> Option<Self> {
        let mapped = self.shared.hexes.is_some();
        let wanted = match kind {
            SurfaceKind::Isovalue(c) => return Some(self.with_isovalue(c)),
            SurfaceKind::Parameter { axis, value } if mapped && axis < 3 && (0.0..=1.0).contains(&value) => {
                let axis = usize::from(axis);
                Wanted::Each(Target::Parameter { axis, value })
            }
            SurfaceKind::Boundary if mapped => Wanted::Boundary,
            _ => return None,
        };
        Some(Self {
            isovalue: 0.0,
            wanted,
            ..self.clone()
        })
    }

    /// Skips the stages before `least`: to test the stages against each other.
    #[doc(hidden)]
    #[must_use]
    pub fn with_stage(&self, least: Decided) -> Self {
        Self { least, ..self.clone() }
    }

    /// The function.
    #[must_use]
    pub fn function(&self) -> &Arc<dyn Function> {
        &self.function
    }

    /// The isovalue.
    #[must_use]
    pub fn isovalue(&self) -> f64 {
        self.isovalue
    }

    /// The first root with t >= 0 in the closed domain.
    #[must_use]
    pub fn first(&self, ray: &Ray) -> Answer {
        self.search(ray, f64::INFINITY, true, false).answer()
    }

    /// All distinct roots with t >= 0 in the closed domain, front to back.
    #[must_use]
    pub fn all(&self, ray: &Ray) -> AllRoots {
        self.until(ray, f64::INFINITY)
    }

    /// All distinct roots with `lo <= t` (see [`Root::lo`]), front to back; what lies beyond is neither looked for nor reported.
    #[must_use]
    pub fn until(&self, ray: &Ray, t: f64) -> AllRoots {
        let mut s = self.search(ray, t, false, false);
        s.roots.retain(|r| r.lo <= t);
        s.unresolved.retain(|u| u.0 <= t);
        AllRoots {
            roots: s.roots,
            unresolved: s.unresolved,
            decided: s.decided,
        }
    }

    /// Why stretches of the ray stay unresolved, front to back: mapped elements only, empty for all others.
    #[must_use]
    pub fn doubts(&self, ray: &Ray) -> Vec<(f64, f64, Doubt)> {
        let s = self.search(ray, f64::INFINITY, false, false);
        s.unresolved.iter().zip(s.doubts).map(|(u, why)| (u.0, u.1, why)).collect()
    }

    /// Whether f32-sized errors in the coefficients could change the first hit: s - c has an extremum (or an end of the stay in the
    /// domain) before or at the first root with `|s - c| <= 8 * 2^-24 * M`, M the greatest `|coefficient - c|` of the piece; or the
    /// first root is a tangent or a stretch; or the answer is unresolved. Where clipping planes end the stay, the same holds at that end; and a ray
    /// that runs so nearly along a plane that f64 arithmetic misplaces the crossing by more than the limit's share of a voxel is undecidable.
    ///
    /// Pieces: cells of a lattice; for a polynomial the parts its stay is cut into (Bernstein coefficients along the ray); for an
    /// analytic field intervals of at most 1/64 of the stay (M is the magnitude of the enclosure); mapped elements, whose roots are followed for all values within
    /// the limit at once.
    #[must_use]
    pub fn undecidable(&self, ray: &Ray) -> bool {
        self.search(ray, f64::INFINITY, true, true).undecidable_until(f64::INFINITY)
    }

    /// Whether all numbers of the ray, the domain and the clipping planes can be worked with.
    fn usable(&self, ray: &Ray) -> bool {
        let planes = self.clips.iter().all(|p| p.normal.is_finite() && p.distance.is_finite());
        planes && ExactRay::usable(ray, self.function.domain())
    }

    /// What clipping planes keep.
    fn kept(&self, ray: &Ray) -> Option<Kept> {
        (!self.clips.is_empty()).then(|| {
            let fine = LIMIT * self.function.domain().voxel() / ray.direction.length();
            Kept::new(ray, &self.clips, fine)
        })
    }

    /// Gathers the colour of the medium along a ray. `false`: it cannot be followed.
    pub(crate) fn integrate(&self, ray: &Ray, beam: &mut Beam<'_>) -> bool {
        if !self.usable(ray) {
            return false;
        }
        let kept = self.kept(ray);
        if kept.as_ref().is_some_and(Kept::is_nothing) {
            return true;
        }
        let goal = Goal {
            until: f64::INFINITY,
            first_only: false,
            watch: false,
            least: self.least,
            kept: kept.as_ref(),
        };
        let (function, shared) = (&*self.function, &*self.shared);
        let floating = self.least != Decided::Exact;
        let exact = || goal.exact_ray(ray, function.domain(), shared.centred);
        match function.structure() {
            Structure::Lattice(l) => {
                if !(floating && legs::lattice(l, shared, ray, goal, beam).is_ok())
                    && let Some(e) = exact()
                {
                    legs::lattice_exactly(l, &e, beam);
                }
                true
            }
            Structure::Tetrahedral(t) => {
                if !(floating && type6::legs::legs(t, function, shared, ray, goal, beam).is_ok())
                    && let Some(e) = exact()
                {
                    type6::legs::legs_exactly(t, &e, beam);
                }
                true
            }
            Structure::Mesh(m) => tets::legs::legs(m, function, shared, ray, goal, beam).is_ok(),
            Structure::Polynomial(p) => legs::polynomial(p, shared, ray, goal, beam).is_ok(),
            _ => false,
        }
    }

    /// The whole search; near-extrema are noted with `watch` only.
    pub(crate) fn search(&self, ray: &Ray, until: f64, first_only: bool, watch: bool) -> Search {
        if !(self.isovalue.is_finite() && self.usable(ray)) {
            let mut s = Search::new(Decided::Exact);
            s.unresolved.push((f64::NEG_INFINITY, f64::INFINITY));
            return s;
        }
        let kept = self.kept(ray);
        let goal = Goal {
            until,
            first_only,
            watch,
            least: self.least,
            kept: kept.as_ref(),
        };
        let mut s = if kept.as_ref().is_some_and(Kept::is_nothing) {
            Search::new(Decided::F64)
        } else {
            self.search_for(ray, goal)
        };
        if watch && kept.is_some_and(|k| k.grazes) {
            s.near = Some(f64::NEG_INFINITY);
        }
        s
    }

    fn search_for(&self, ray: &Ray, goal: Goal<'_>) -> Search {
        match self.function.structure() {
            Structure::Lattice(l) => lattice::search(l, &*self.function, &self.shared, self.isovalue, ray, goal),
            Structure::Tetrahedral(t) => type6::search(t, &*self.function, &self.shared, self.isovalue, ray, goal),
            Structure::Mesh(m) => tets::search(m, &*self.function, &self.shared, self.isovalue, ray, goal),
            Structure::Elements(h) => hexes::search(h, &*self.function, &self.shared, self.wanted, ray, goal),
            Structure::Polynomial(p) => polynomial::search(p, &*self.function, &self.shared, self.isovalue, ray, goal),
            Structure::Analytic(a) => analytic::search(a, &self.shared, self.isovalue, ray, goal),
            // A form this oracle does not know: it decides nothing.
            _ => {
                let mut s = Search::new(Decided::Exact);
                s.unresolved.push((f64::NEG_INFINITY, f64::INFINITY));
                s
            }
        }
    }
}
