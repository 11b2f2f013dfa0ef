//! The thesis's finders in the shape of isobar-poly's list, for tables that run them all on the same polynomials.

use super::{Answer, Finder};
use isobar_poly::{First, NamedSolver, Root, RootKind};

/// What a finder in f32 with ample budget can be asked for: 1e-5 of the cell.
const WIDTH: f64 = 5e-6;

/// What seven subdivisions of LR81 can be asked for.
const WIDTH_7: f64 = 5e-4;

/// The thesis's four in f32 with 24 iterations, and LR81 with the 7 it uses for tri-cubic voxels. A bracket is the point they give and proves
/// nothing. f64 coefficients are scaled by a power of two and rounded.
#[must_use]
pub fn solvers() -> &'static [NamedSolver] {
    const fn solver(name: &'static str, description: &'static str, width: f64, first: fn(&[f64]) -> First<f64>) -> NamedSolver {
        NamedSolver {
            name,
            description,
            width,
            first,
            all: None,
        }
    }
    const {
        &[
            solver("lr81-24", "thesis, Listing A.2, f32, 24 subdivisions", WIDTH, |b| {
                first(&Finder::THESIS[0], b)
            }),
            solver("lr81-7", "thesis, Listing A.2, f32, 7 subdivisions", WIDTH_7, |b| {
                first(&Finder::Lr81 { iterations: 7 }, b)
            }),
            solver("mr07-24", "thesis, knot insertion, f32, 24 knots", WIDTH, |b| {
                first(&Finder::THESIS[1], b)
            }),
            solver("arfbs-24", "thesis, Listing A.3, f32, 24 steps", WIDTH, |b| {
                first(&Finder::THESIS[2], b)
            }),
            solver("sturm-24", "thesis, Listing A.4, f32, 24 halvings", WIDTH, |b| {
                first(&Finder::THESIS[3], b)
            }),
        ]
    }
}

fn first(finder: &Finder, b: &[f64]) -> First<f64> {
    let most = b.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    if !most.is_finite() {
        return First::GaveUp { at: 0.0 };
    }
    // The power of two below the largest coefficient; 1 for the zero polynomial and for subnormal ones.
    let scale = f64::from_bits(most.max(f64::MIN_POSITIVE).to_bits() & (0x7ff << 52));
    let narrow: Vec<f32> = b.iter().map(|x| (x / scale) as f32).collect();
    match finder.first(&narrow) {
        Answer::None => First::None,
        Answer::GaveUp => First::GaveUp { at: 0.0 },
        Answer::Root(t) | Answer::Touching(t) => First::Root(Root {
            lo: t.into(),
            hi: t.into(),
            t: t.into(),
            kind: RootKind::Crossing,
        }),
    }
}
