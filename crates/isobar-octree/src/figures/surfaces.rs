//! Figure 6.1: the frustum form of Reimers and Seland beside compositions, on the thesis's three algebraic surfaces at several sizes of the image.
//!
//! Both ways use the thesis's 6 (d + 1) iterations of LR81 in f32 and search from the near plane to the far one. The thesis gives bars without numbers.

use crate::comparators::algebraic::{Composition, Drawn, Extent, Surface, draw};
use crate::comparators::frustum::Frustum;
use crate::finders::Finder;
use isobar_core::{Algebraic, ClipPlane, DVec3, Data, DataError, RenderError, View};
use isobar_fields::Synthetic;

/// Letter, degree per axis, and formula of the three surfaces.
pub const SURFACES: [(char, usize, &str); 3] = [
    ('a', 1, "x + y + z + xyz = 1"),
    ('b', 2, "4x² + 4y² + 4z² + 16xyz + x²y²z² = 1"),
    ('c', 3, "x² + y² + z² − x³y³z³ − x²y = 1"),
];

/// The polynomial of a letter.
///
/// # Errors
/// [`DataError::Unknown`] for other letters.
pub fn polynomial(letter: char) -> Result<Algebraic, DataError> {
    match format!("steinberger-{letter},as=algebraic").parse::<Synthetic>()?.data()? {
        Data::Algebraic(a) => Ok(a),
        other => Err(DataError::Unknown(format!("steinberger-{letter} is {}", other.kind()))),
    }
}

/// The square view of the figure; the thesis does not give its own.
#[must_use]
pub fn view(size: usize) -> View {
    View::perspective(DVec3::new(6.0, 4.0, 5.0), DVec3::ZERO, DVec3::Z, 40.0, size, size)
}

/// One way of getting the polynomials at one size of the image.
#[derive(Debug, Clone)]
pub struct Contender {
    /// The way.
    pub how: Composition,
    /// Its fastest frame, one thread.
    pub drawn: Drawn,
}

/// All ways, drawn in turn so many times, the fastest frame of each.
///
/// # Errors
/// [`RenderError`] where the letter has no surface, or the image no pixels.
pub fn contenders(letter: char, size: usize, repeats: usize) -> Result<Vec<Contender>, RenderError> {
    match letter {
        'a' => all::<1, 4>(letter, size, repeats),
        'b' => all::<2, 7>(letter, size, repeats),
        _ => all::<3, 10>(letter, size, repeats),
    }
}

fn all<const D: usize, const M: usize>(letter: char, size: usize, repeats: usize) -> Result<Vec<Contender>, RenderError> {
    let surface = Surface::<f32, D>::new(&polynomial(letter)?)?;
    let finder = Finder::Lr81 {
        iterations: 6 * (D as u32 + 1),
    };
    let view = view(size);
    let mut out: Vec<Contender> = Vec::new();
    for _ in 0..repeats.max(1) {
        for how in Composition::ALL {
            let drawn = draw::<f32, D, M>(&surface, &view, how, &finder, Extent::Planes)?;
            match out.iter_mut().find(|c| c.how == how) {
                Some(c) if c.drawn.total() <= drawn.total() => {}
                Some(c) => c.drawn = drawn,
                None => out.push(Contender { how, drawn }),
            }
        }
    }
    Ok(out)
}

/// The polynomial on a box that holds all that is searched, and the view with planes that leave just that: whose first roots the frames should show.
///
/// # Errors
/// Those of [`polynomial`]; [`RenderError::View`] where the frustum has no near plane.
pub fn searched(letter: char, size: usize) -> Result<(Algebraic, View), RenderError> {
    let mut polynomial = polynomial(letter)?;
    let mut view = view(size);
    let no_frustum = || RenderError::View("the eye is inside the sphere round the box".to_owned());
    let frustum = Frustum::around(&view, polynomial.lo, polynomial.hi).ok_or_else(no_frustum)?;
    let lens = view.lens().ok_or_else(no_frustum)?;
    let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(u, v)| frustum.ends(u, v));
    let [near, far] = [0, 1].map(|e| corners[0][e].dot(lens.forward));
    view.clips = vec![
        ClipPlane {
            normal: -lens.forward,
            distance: -near,
            cap: false,
        },
        ClipPlane {
            normal: lens.forward,
            distance: far,
            cap: false,
        },
    ];
    for p in corners.into_iter().flatten() {
        polynomial.lo = polynomial.lo.min(p - 1.0);
        polynomial.hi = polynomial.hi.max(p + 1.0);
    }
    Ok((polynomial, view))
}
