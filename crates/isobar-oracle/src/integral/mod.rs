//! The colour a ray sees: a medium by its emission-absorption integral, surfaces with opacity in it, and a bound of the error.
//!
//! **Equation.** Along the ray let s be the value at distance l, rho(s) the extinction per world length (the transfer function's density over its unit) and c(s) its colour (linear, not
//! premultiplied). The volume-density model of Williams and Max, equation (1) of Röttger et al. 2000, gives the premultiplied colour and the opacity of a stretch as
//!
//! `C = integral of rho(s(l)) c(s(l)) exp(-D(l)) dl`, `A = 1 - exp(-D)`, `D(l) = integral of rho from the start of the stretch to l`.
//!
//! With [`Model::DensityEmitter`] (Wilhelms and Van Gelder) `c(s)/unit` takes the place of `rho c`: the density then hides but does not shine. Surfaces and stretches are composed front to back with
//! *over*: a surface adds its opacity times its shaded colour and lets 1 - opacity through. Outside the domain, and in gaps of a mesh, there is nothing; without medium only surfaces are composed.
//!
//! **Surfaces.** Each distinct root of s = c is one crossing (a stretch s = c counts once, at its entry; a tangent counts once), as certified by [`Oracle`]. Its colour is core's
//! `shade` of the surface's colour with the unit gradient of the function at the middle of the root's bracket: that f32 colour is taken as given and is no part of the bound (where the
//! gradient jumps, on faces between pieces, it is that of one side). Roots of one bracket are composed in the order of the surfaces.
//!
//! **References** ([`Reference`]). I is the integral of the transfer function as given. P composes at each crossing of a peak ([`TransferFunction::peaks`]) the peak's colour with its unscaled
//! opacity, and the integral of I between: the medium of the peak itself is counted in both, as in Knoll et al. 2009, section 4.2, default mode. The difference of the two is the bias of that method, not an error of a renderer.
//!
//! **What is proved.** Apart from shading, `|rgba - exact| <= error` in every channel, for splines, polynomials and meshes; the exact ray and coefficients are meant, as everywhere in this crate. The error is gathered
//! leg by leg ([`beam`]); it is near the target of 1e-10 unless a medium is so steep or so dense that f64 cannot hold it. There is no estimate in it. Fields without polynomial pieces are refused, and
//! a ray that only integers could follow through a polynomial in world coordinates has no colour: an infinite error.

pub(crate) mod beam;
mod compare;
mod frame;
pub(crate) mod legs;
mod rule;
#[cfg(test)]
mod tests;
mod transfer;

use crate::{Oracle, Oracles, TruthError, truth::check_clips};
use beam::{Beam, Event};
pub use compare::Difference;
pub use frame::Colours;
use isobar_core::{ClipPlane, Function, Ray, Structure, Surface, TransferFunction, shade};
use rule::Rules;
use std::sync::Arc;
use transfer::Bands;

/// What emits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Model {
    /// The extinction times the colour (Williams and Max): the contract's meaning of `--tf`.
    #[default]
    VolumeDensity,
    /// The colour alone, per unit of the transfer function (Wilhelms and Van Gelder).
    DensityEmitter,
}

/// What an image is held against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reference {
    /// I: surfaces, and the integral of the transfer function between them.
    #[default]
    Integral,
    /// P: as I, and the transfer function's peaks as surfaces with unscaled opacity.
    Peaks,
    /// Surfaces and peaks alone: Knoll's `peak_only`.
    PeaksAlone,
}

/// The colour of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Colour {
    /// Linear premultiplied colour and opacity.
    pub rgba: [f64; 4],
    /// Proved: no channel is wrong by more. See the module for what is taken as given.
    pub error: f64,
    /// Parts of the medium that were integrated.
    pub leaves: u32,
}

/// Exact colours of rays through one scene. Immutable and shared freely between threads.
#[derive(Clone, Debug)]
pub struct Integral {
    /// For walking; its isovalue has no meaning.
    oracle: Oracle,
    surfaces: Vec<Surface>,
    oracles: Oracles,
    bands: Option<Bands>,
    rules: Rules,
    target: f64,
}

impl Integral {
    /// For a scene: surfaces in their order, then with [`Reference::Peaks`] the peaks, ascending.
    ///
    /// # Errors
    /// As [`Oracles::new`]; [`TruthError::Medium`] for an unusable transfer function; [`TruthError::Unsupported`] for a medium in a field without polynomial pieces.
    pub fn new(
        function: &Arc<dyn Function>,
        surfaces: &[Surface],
        medium: Option<&TransferFunction>,
        reference: Reference,
        model: Model,
        clips: &[ClipPlane],
    ) -> Result<Self, TruthError> {
        check_clips(clips)?;
        if surfaces.iter().any(|s| s.value().is_none()) {
            return Err(TruthError::Unsupported("the colours of surfaces that are no isosurfaces"));
        }
        let medium = medium
            .map(|m| TransferFunction::new(m.points.clone(), m.unit))
            .transpose()
            .map_err(TruthError::Medium)?;
        let mut surfaces = surfaces.to_vec();
        if let (Reference::Peaks | Reference::PeaksAlone, Some(m)) = (reference, &medium) {
            surfaces.extend(m.peaks().iter().map(isobar_core::Peak::surface));
        }
        let medium = medium.filter(|_| reference != Reference::PeaksAlone);
        let degree = match function.structure() {
            Structure::Lattice(l) => 3 * l.basis().degree,
            Structure::Tetrahedral(_) => 3,
            Structure::Mesh(_) => 1,
            Structure::Polynomial(p)
                if p.degree() <= crate::compose::MOST && p.terms.iter().all(|(e, _)| e.iter().all(|&e| e <= 15)) =>
            {
                p.degree().max(1)
            }
            _ if medium.is_none() => 1,
            _ => {
                return Err(TruthError::Unsupported(
                    "a medium in a field without polynomial pieces along a ray",
                ));
            }
        };
        let oracles = Oracles::new(function, &surfaces, clips)?;
        let oracle = match oracles.iter().next() {
            Some((_, o)) => o.clone(),
            None => Oracle::new(function.clone(), 0.0).with_clips(clips),
        };
        Ok(Self {
            oracle,
            surfaces,
            oracles,
            bands: medium.map(|m| Bands::new(&m, model)),
            rules: Rules::new(degree),
            target: 1e-10,
        })
    }

    /// The surfaces that are composed, peaks last.
    #[must_use]
    pub fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }

    /// The colour of one ray.
    #[must_use]
    pub fn colour(&self, ray: &Ray) -> Colour {
        let unknown = Colour {
            rgba: [0.0; 4],
            error: f64::INFINITY,
            leaves: 0,
        };
        let Some(events) = self.events(ray) else { return unknown };
        let speed = ray.direction.length();
        let mut beam = Beam::new(self.bands.as_ref(), &self.rules, speed, self.target, &events);
        if self.bands.is_some() && !self.oracle.integrate(ray, &mut beam) {
            return unknown;
        }
        let (rgba, error) = beam.finish();
        Colour {
            rgba,
            error,
            leaves: beam.leaves,
        }
    }

    /// The surfaces on the ray front to back, up to the first opaque one; `None` where that could not be decided.
    fn events(&self, ray: &Ray) -> Option<Vec<Event>> {
        let mut until = f64::INFINITY;
        for (i, o) in self.oracles.iter() {
            if self.surfaces[usize::from(i)].opacity >= 1.0 {
                let s = o.search(ray, until, true, false);
                until = s.answer().hit().map_or(until, |r| until.min(r.hi));
            }
        }
        let (roots, unresolved) = self.oracles.roots(ray, until);
        let function = self.oracle.function();
        (!unresolved).then(|| {
            let event = |(i, r): &(u8, crate::Root)| {
                let surface = &self.surfaces[usize::from(*i)];
                let normal = function.gradient(ray.at(r.t())).normalize_or_zero();
                let colour = shade(surface.colour, normal.as_vec3().to_array(), ray.direction);
                Event {
                    t: r.t(),
                    width: r.hi - r.lo,
                    colour: colour.map(f64::from),
                    opacity: f64::from(surface.opacity),
                }
            };
            let mut events: Vec<Event> = roots.iter().map(event).collect();
            if let Some(last) = events.iter().position(|e| e.opacity >= 1.0) {
                events.truncate(last + 1);
            }
            events
        })
    }
}
