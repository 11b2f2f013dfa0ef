//! Roots on trivariate rational Bezier elements ([`isobar_core::Structure::Elements`]): isosurfaces, parameter surfaces, the boundary.
//!
//! **What a root is.** A t >= 0 for which some element has u in the closed cube [0, 1]^3 with `x(u) = o + t d` and `a(u) = c`, all numbers being the real ones that
//! the f64 of data and ray name, products of weights and points included. Elements may be folded, turned inside out or degenerate; where several u
//! (of one element or several) have the same t it is one root. Cracks between elements are there if the data have them.
//!
//! **How.** A tree of boxes finds the elements ([`index`]); each gives a system of three polynomials in u ([`forms`]), whose zeros in the cube are isolated and certified by
//! branch and bound ([`solve`]) with interval Newton steps ([`newton`]); t follows from the balls of u ([`place`]). f64 with bounds first; an element with doubts
//! or with a bracket wider than the oracle promises is done again in double-double; what double-double cannot place (zeros exactly on faces, tangents at
//! simple fractions) is given to integers ([`exact`]). A root that f64 has certified but placed too widely is narrowed by one step whose values are taken in
//! double-double: the stage that decided it stays f64.
//!
//! **What is certified.** Each root's bracket holds a zero (Krawczyk's test or integers), and no t outside all brackets and unresolved stretches is a root.
//! Brackets that still overlap in double-double, as those of elements that share the face the ray goes through do, are joined: then certainly at least one
//! root lies in the bracket, and those in it, if several, are closer than two brackets. [`Multiplicity::Simple`]: the zeros found are
//! regular, and s - c changes sign the same way at all of them. [`Multiplicity::Unknown`]: a root is certain (integers found one, or several were joined that
//! disagree), its multiplicity is not.
//!
//! **What stays unresolved**, with the reason in [`Doubt`]: tangents and folds that are not at simple fractions, stretches of the ray inside the surface,
//! zeros on a curved face to 1e-28, and rays so close to all these that double-double cannot tell (the parameters of two zeros nearer than some 1e-14).
//!
//! **Units.** Errors are counted in the voxel of the function's [`isobar_core::Domain`]: for isobar-fields' `HexField` the geometric mean, over the elements, of the
//! diagonal of the control points' box over sqrt 3.
//!
//! **The watch** ([`crate::Oracle::undecidable`]) asks the same question for all values within the limit of c at once: where each element still has exactly one zero
//! for all of them, inside, or handed from one element to the next with the same sign of the slope, nothing f32-sized can change the answer.

mod exact;
mod forms;
mod index;
mod newton;
mod place;
mod run;
mod solve;

pub(crate) use index::Index;
pub(crate) use run::search;

use isobar_core::Ray;

/// Why a stretch of a ray could not be decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Doubt {
    /// The ray grazes the surface, or all but does.
    Tangent,
    /// The element is folded or degenerate there: its parameters do not follow the ray.
    Fold,
    /// The root lies on a face of its element, at the start of the ray or on a clipping plane, or all but does.
    Face,
    /// The number of boxes was used up: the ray runs inside the surface, or nearly so.
    Limit,
}

/// What is looked for in an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Target {
    /// a(u) = c.
    Isovalue(f64),
    /// `u_axis = value`.
    Parameter { axis: usize, value: f64 },
}

/// What is looked for in all of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Wanted {
    /// The same in each.
    Each(Target),
    /// The faces that only one element has.
    Boundary,
}

/// A ray with the axis of its greatest component.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    origin: [f64; 3],
    direction: [f64; 3],
    along: usize,
    others: [usize; 2],
}

impl Line {
    fn new(ray: &Ray) -> Self {
        let along = ray.direction.abs().max_position();
        Self {
            origin: ray.origin.to_array(),
            direction: ray.direction.to_array(),
            along,
            others: [(along + 1) % 3, (along + 2) % 3],
        }
    }

    /// Whether the bounds of `forms` hold for it.
    fn moderate(&self) -> bool {
        let largest = self.direction[self.along].abs();
        self.origin.iter().chain(&self.direction).all(|&x| moderate(x)) && largest >= 7.6e-37
    }
}

/// At most 2^120.
fn moderate(x: f64) -> bool {
    x.abs() <= 1.3e36
}
