//! The crate's root finders by name, for tables that compare root finders on the same polynomials.

use crate::{
    First, LANES, MAX_DEGREE, Real, Root, Roots, Tolerance, all_roots, first_root, first_roots, packet, roots_of_packets,
};

/// First root from f64 Bernstein coefficients.
pub type FindFirst = fn(&[f64]) -> First<f64>;

/// All roots from f64 Bernstein coefficients.
pub type FindAll = fn(&[f64]) -> Roots<f64>;

/// A root finder on [0, 1] that takes f64 Bernstein coefficients (1 to [`MAX_DEGREE`] + 1 of them).
#[derive(Clone, Copy, Debug)]
pub struct NamedSolver {
    /// Short name: `bernstein-f64`.
    pub name: &'static str,
    /// One line for a table's legend.
    pub description: &'static str,
    /// Width of bracket it aims at.
    pub width: f64,
    /// First root.
    pub first: FindFirst,
    /// All roots, where it can.
    pub all: Option<FindAll>,
}

/// Bracket width of the f64 solver in the list.
const WIDTH_F64: f64 = 1e-12;
/// Bracket width of the f32 solvers in the list.
const WIDTH_F32: f32 = 1e-6;

/// All root finders of this crate. The f32 ones round the coefficients and count that rounding as `Tolerance::error`: what they
/// prove is true of the f64 polynomial.
#[must_use]
pub fn solvers() -> &'static [NamedSolver] {
    &[
        NamedSolver {
            name: "bernstein-f64",
            description: "Descartes subdivision, bracketed Newton, f64, to 1e-12",
            width: WIDTH_F64,
            first: |b| first_root(b, &Tolerance::new(WIDTH_F64)),
            all: Some(|b| all_roots(b, &Tolerance::new(WIDTH_F64))),
        },
        NamedSolver {
            name: "bernstein-f32",
            description: "Descartes subdivision, bracketed Newton, f32, to 1e-6",
            width: WIDTH_F32 as f64,
            first: |b| {
                rounded(b).map_or(First::GaveUp { at: 0.0 }, |(c, m, error)| {
                    widen_first(first_root(&c[..m], &tolerance_f32(error)))
                })
            },
            all: Some(|b| {
                let mut out = Roots::new();
                match rounded(b) {
                    Some((c, m, error)) => widen_all(&all_roots(&c[..m], &tolerance_f32(error)), &mut out),
                    None => out.give_up(0.0),
                }
                out
            }),
        },
        NamedSolver {
            name: "bernstein-f32x16",
            description: "the f32 solver in packets of 16 (degrees 1 to 9; above, one by one), to 1e-6",
            width: WIDTH_F32 as f64,
            first: |b| {
                rounded(b).map_or(First::GaveUp { at: 0.0 }, |(c, m, error)| {
                    widen_first(first_in_packet(&c[..m], &tolerance_f32(error)))
                })
            },
            all: Some(|b| {
                let mut out = Roots::new();
                match rounded(b) {
                    Some((c, m, error)) => widen_all(&all_in_packet(&c[..m], &tolerance_f32(error)), &mut out),
                    None => out.give_up(0.0),
                }
                out
            }),
        },
    ]
}

fn tolerance_f32(error: f32) -> Tolerance<f32> {
    Tolerance {
        error,
        ..Tolerance::new(WIDTH_F32)
    }
}

/// f32 coefficients of a positive multiple of the polynomial, their number, and a bound of their rounding error. `None` for an
/// unsupported number of them, or infinite ones.
fn rounded(b: &[f64]) -> Option<([f32; MAX_DEGREE + 1], usize, f32)> {
    if b.is_empty() || b.len() > MAX_DEGREE + 1 {
        return None;
    }
    let mut c = [0.0; MAX_DEGREE + 1];
    let most = b.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    if !most.is_finite() {
        return None;
    }
    // Powers of two that bring the largest coefficient near 1, so that f32's range is enough. Subnormal numbers first become normal.
    let boost = if most < f64::MIN_POSITIVE { f64::SCALE } else { 1.0 };
    let scale = match (most * boost).to_bits() & (0x7ff << 52) {
        0 => 1.0,
        power => f64::from_bits(power),
    };
    let mut error = 0.0;
    for (y, &x) in c.iter_mut().zip(b) {
        let z = x * boost / scale;
        *y = z as f32;
        // Exact difference, but z itself may have underflowed: its error is below f32's smallest number.
        error = f64::max(
            error,
            (f64::from(*y) - z).abs() + if z == 0.0 && x != 0.0 { 1e-300 } else { 0.0 },
        );
    }
    let bound = error as f32;
    Some((c, b.len(), if error > 0.0 { bound.above() } else { 0.0 }))
}

/// Runs `$run` for the number of coefficients, or `$alone` above degree 9.
macro_rules! by_degree {
    ($c:expr, $tolerance:expr, $run:ident, $alone:expr) => {
        match $c.len() {
            2 => $run::<2>($c, $tolerance),
            3 => $run::<3>($c, $tolerance),
            4 => $run::<4>($c, $tolerance),
            5 => $run::<5>($c, $tolerance),
            6 => $run::<6>($c, $tolerance),
            7 => $run::<7>($c, $tolerance),
            8 => $run::<8>($c, $tolerance),
            9 => $run::<9>($c, $tolerance),
            10 => $run::<10>($c, $tolerance),
            _ => $alone,
        }
    };
}

/// Sixteen copies in a packet.
fn copies<const M: usize>(c: &[f32]) -> [[f32; LANES]; M] {
    let one: [f32; M] = std::array::from_fn(|i| c[i]);
    packet(&[one; LANES])
}

/// The first root by a packet of copies; the answer is that of a middle lane.
fn first_in_packet(c: &[f32], tolerance: &Tolerance<f32>) -> First<f32> {
    fn run<const M: usize>(c: &[f32], tolerance: &Tolerance<f32>) -> First<f32> {
        let mut out = [[First::None; LANES]];
        first_roots(&[copies::<M>(c)], tolerance, &mut out);
        out[0][LANES / 2]
    }
    by_degree!(c, tolerance, run, first_root(c, tolerance))
}

/// As [`first_in_packet`], all roots.
fn all_in_packet(c: &[f32], tolerance: &Tolerance<f32>) -> Roots<f32> {
    fn run<const M: usize>(c: &[f32], tolerance: &Tolerance<f32>) -> Roots<f32> {
        let mut out = [[Roots::default(); LANES]];
        roots_of_packets(&[copies::<M>(c)], tolerance, &mut out);
        out[0][LANES / 2]
    }
    by_degree!(c, tolerance, run, all_roots(c, tolerance))
}

fn widen(r: &Root<f32>) -> Root<f64> {
    Root {
        lo: r.lo.into(),
        hi: r.hi.into(),
        t: r.t.into(),
        kind: r.kind,
    }
}

fn widen_first(a: First<f32>) -> First<f64> {
    match a {
        First::None => First::None,
        First::Root(r) => First::Root(widen(&r)),
        First::GaveUp { at } => First::GaveUp { at: at.into() },
    }
}

fn widen_all(a: &Roots<f32>, out: &mut Roots<f64>) {
    for r in a.as_slice() {
        crate::answer::Collect::take(out, widen(r));
    }
    if let Some(at) = a.gave_up() {
        out.give_up(at.into());
    }
}
