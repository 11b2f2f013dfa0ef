//! Index space, a ray in it, and the bound that all proofs rest on.
//!
//! **Bound on the error of a Bernstein coefficient.** u = 2^-53, per ray. A position o + t d in index space is off per axis by at most E = 24u (|eye - origin of the
//! grid| + |t d|)/spacing + 4u n (four roundings of terms of that size; that of a plane's parameter, seen across the plane, is of the same size; 24 leaves a factor of
//! two). M is the greatest |datum - c| of the volume. The four barycentric coordinates are off by 10 E together, and each of the three arguments of a blossom moves it by as much of M.
//! - A coefficient of a tetrahedron costs 14uM (one difference, sums of at most 9 terms that amount to at most 192M, one division), a step of de Casteljau's rule 7uM, another
//!   isovalue 2uM (M then the greater of its own and that of the first isovalue, which coefficients are relative to), an evaluation of the cubic 14uM.
//! - The value at an end: 30EM + (14 + 3 * 7)uM.
//! - The inner coefficients add a third of the slope times the length: the `b^[2]` there, off by 20EM + 28uM, times the change of the barycentric coordinates along the segment, at most
//!   5 together (its length is at most sqrt(3)/2): 100EM + 140uM, 35uM for the sum itself, and 12EM because the length of the segment is off by 2E.
//! - The slope at the start is that of the tetrahedron before (C1). Its point lies within E of the common face, where the slopes of the two cubics differ by at most 300ME (second
//!   derivatives are at most 6 * 5^2 M): times a third of the length, 87EM.
//!
//! Together below **(256E + 256u) M**. Packets of rays (`packet/`) blossom with both ends instead, so all four coefficients have the bound of a value: 30EM, no division,
//! 10uM for the sums of the masks, 21uM for three steps, and 4uM because positions are counted from centres shifted by 1/2: less than a seventh of it. A stretch within E of a face that was given to the wrong one of two tetrahedra is covered: their
//! cubics join with C1, so they differ there by the square of E.

use isobar_core::{ClipPlane, Ray};
use isobar_cpu::index::{Entry, IndexSpace, Line, Rounding};
pub(crate) use isobar_cpu::packet::three;

/// The bound above.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cubics;

impl Rounding for Cubics {
    const POSITION: f64 = 24.0;
    const INDEX: f64 = 4.0;
    const PART: f64 = 256.0;
    const REST: f64 = 256.0;
    /// For what lies between the ends of the domain and the true ones.
    const STEEPEST: f64 = 32.0;
}

/// Index space of a grid; cubes are centred on its points.
pub(crate) type Space = IndexSpace<Cubics>;

/// The planes `x_a +- x_b`: axes and sign.
pub(crate) const FORMS: [(usize, usize, f64); 6] = [
    (0, 1, 1.0),
    (0, 1, -1.0),
    (0, 2, 1.0),
    (0, 2, -1.0),
    (1, 2, 1.0),
    (1, 2, -1.0),
];

/// A ray in index space.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Walk {
    pub(crate) line: Line<true>,
    /// Parameters of the planes of the six forms, as those of the faces of cubes; never inside the domain where the ray is parallel.
    pub(crate) form_inv: [f64; 6],
    pub(crate) form_shift: [f64; 6],
}

impl Walk {
    /// The way of a ray through the box [0, dims - 1] at t >= 0, where all clipping planes keep it. `margin`: its relative bound.
    #[inline(always)]
    pub(crate) fn enter(ray: &Ray, space: &Space, clips: &[ClipPlane], margin: f64) -> Entry<Self> {
        Line::enter(ray, space, clips, Some(margin)).map(Self::new)
    }

    #[inline(always)]
    fn new(line: Line<true>) -> Self {
        let (o, d) = (line.o, line.d);
        let mut form_inv = [0.0; 6];
        let mut form_shift = [f64::NEG_INFINITY; 6];
        for (n, &(a, b, sign)) in FORMS.iter().enumerate() {
            let (p, q) = (o[a] + sign * o[b], d[a] + sign * d[b]);
            if q != 0.0 {
                form_inv[n] = 1.0 / q;
                form_shift[n] = -p * form_inv[n];
            }
        }
        Self {
            line,
            form_inv,
            form_shift,
        }
    }
}
