//! The legs of a ray through the tetrahedra of a mesh.
//!
//! Each cell whose box the ray meets and whose values absorb or emit is looked at on its own, in f64 about a point of the ray near the cell ([`Near`]), which knows the stay to some ulps of the
//! cell, then in double-double, then in integers.
//!
//! **Each t counts once.** Stays are sorted by their entry; of a stay that begins before the one before has ended only the rest counts. So a ray inside a face, or along an edge, has the medium of one of the cells there
//! (they agree on it), and where cells overlap (a folded mesh) the one entered first counts up to its end. Stays that meet within their errors are joined; their
//! common end is only known to its error, by which the value at it is wrong by at most `|ds/dt|` times that error, and never by more than the cell's values
//! differ. At an end without a neighbour the length itself is wrong: it is the leg's slop.

use super::{
    Part,
    ball::{Ball, Near, Seen, Stay, see, surely_beside},
    exact::ExactCell,
    tree::moderate,
};
use crate::{
    integral::{
        beam::{Beam, Leg},
        legs::{Doubtful, from_base},
    },
    oracle::{Goal, Shared},
    real::{Dd, Real, U64, two_sum},
};
use isobar_core::{DVec3, Function, Ray, TetMesh};

/// A stay in one cell, in s.
#[derive(Clone, Copy, Debug)]
struct Inside {
    s: [f64; 2],
    value: [f64; 2],
    /// Bounds of the errors of both.
    s_error: f64,
    value_error: f64,
    /// Greatest less least value of the cell.
    spread: f64,
}

/// Finds and adds all legs.
pub(crate) fn legs(
    mesh: &TetMesh,
    function: &dyn Function,
    shared: &Shared,
    ray: &Ray,
    goal: Goal<'_>,
    beam: &mut Beam<'_>,
) -> Result<(), Doubtful> {
    let Some(index) = &shared.tets else { return Err(Doubtful) };
    let Some(part) = Part::new(function, ray, &goal) else {
        return Ok(());
    };
    let until = part.to_f64.1.min(beam.last());
    let mut cells = Vec::new();
    index.gather_where(ray, |lo, hi| beam.dark(lo, hi), part.from_f64.0, until, &mut cells);
    let (base, stays) = stays(mesh, index.moderate, function, ray, &part, &cells);
    beam.begin(base);
    // What clipping planes keep; the ends are known to an ulp.
    let kept = (
        from_base(&part.from, base),
        part.to.as_ref().map_or(f64::INFINITY, |t| from_base(t, base)),
    );
    let mut end = f64::NEG_INFINITY;
    let mut end_error = 0.0;
    for (i, x) in stays.iter().enumerate() {
        let joined = (x.s[0] - end).abs() <= x.s_error + end_error;
        let start = if joined || x.s[0] < end { end } else { x.s[0] };
        let next = stays[i + 1..].iter().take_while(|y| y.s[0] <= x.s[1] + x.s_error + y.s_error);
        let followed = next.into_iter().any(|y| y.s[1] > x.s[1]);
        let (a, b) = (start.max(kept.0), x.s[1].min(kept.1));
        let length = x.s[1] - x.s[0];
        if a < b && length > 0.0 {
            let rate = (x.value[1] - x.value[0]) / length;
            let at = |s: f64| {
                let w = ((s - x.s[0]) / length).clamp(0.0, 1.0);
                (1.0 - w) * x.value[0] + w * x.value[1]
            };
            // Both ends are moved by at most their errors, and the start onto the end before.
            let moved = rate.abs() * (2.0 * x.s_error + end_error);
            let open = [!joined && start == x.s[0], !followed];
            let slop = open.iter().filter(|&&o| o).count() as f64 * x.s_error;
            let cut = if a > start || b < x.s[1] {
                4.0 * f64::EPSILON * (base + a.abs().max(b.abs()))
            } else {
                0.0
            };
            let leg = Leg {
                s: (a, b),
                b: &[at(a), at(b)],
                e: x.value_error + moved.min(x.spread) + 4.0 * U64 * x.spread,
                slop: slop + cut,
            };
            if beam.leg(&leg).is_break() {
                return Ok(());
            }
        } else if a < b {
            beam.smear(2.0 * x.s_error, x.value[0] - x.spread, x.value[0] + x.spread);
        }
        if x.s[1] > end {
            (end, end_error) = (x.s[1], x.s_error);
        }
    }
    Ok(())
}

/// The stays in the cells, sorted by their entry, and the t they are counted from.
fn stays(mesh: &TetMesh, moderately: bool, function: &dyn Function, ray: &Ray, part: &Part, cells: &[u32]) -> (f64, Vec<Inside>) {
    let numbers = ray.origin.to_array().into_iter().chain(ray.direction.to_array());
    let floating = moderately && numbers.into_iter().all(moderate);
    let (lo, hi) = function.domain().world_bounds();
    let near = (0.5 * (lo + hi) - ray.origin).dot(ray.direction) / ray.direction.length_squared();
    let base = if near.is_finite() && near > 0.0 { near } else { 0.0 };
    let seen = Seer {
        mesh,
        ray,
        part,
        base,
        fine: 1e-14 * (hi - lo).length() / ray.direction.length(),
    };
    let mut stays: Vec<Inside> = cells.iter().filter_map(|&c| seen.cell(c, floating)).collect();
    stays.sort_by(|a, b| a.s[0].total_cmp(&b.s[0]).then(a.s[1].total_cmp(&b.s[1])));
    (base, stays)
}

struct Seer<'a> {
    mesh: &'a TetMesh,
    ray: &'a Ray,
    part: &'a Part,
    base: f64,
    /// An error of s that is good enough.
    fine: f64,
}

impl Seer<'_> {
    fn cell(&self, cell: u32, floating: bool) -> Option<Inside> {
        let c = self.mesh.cells[cell as usize];
        let corners = c.map(|i| self.mesh.points[i as usize]);
        let values = c.map(|i| f64::from(self.mesh.values[i as usize]));
        let (lo, hi) = values.iter().fold((values[0], values[0]), |(a, b), &v| (a.min(v), b.max(v)));
        let spread = hi - lo;
        if floating {
            if surely_beside(self.ray, &corners) {
                return None;
            }
            if let Ok(found) = self.about(&corners, &values) {
                return found.map(|x| Inside { spread, ..x });
            }
            match see::<Dd>(self.ray, &corners, &values, 0.0) {
                Seen::Beside => return None,
                Seen::Through(stay) => {
                    // The numbers themselves round to f64.
                    let s = stay.t.map(|t| t.minus(Ball::exact(self.base)));
                    let error = s[0].e.max(s[1].e) + U64 * s[0].x.hi.abs().max(s[1].x.hi.abs());
                    return Some(Inside {
                        s: s.map(|s| s.x.hi),
                        value: stay.f.map(|f| f.x.hi),
                        s_error: error * (1.0 + 1e-15),
                        value_error: stay.f[0].e.max(stay.f[1].e) + U64 * lo.abs().max(hi.abs()),
                        spread,
                    });
                }
                Seen::Unclear => {}
            }
        }
        self.exactly(cell, &corners, &values, spread)
    }

    /// In f64 about a point near the cell.
    fn about(&self, corners: &[DVec3; 4], values: &[f64; 4]) -> Result<Option<Inside>, Doubtful> {
        let near = Near::new(self.ray, corners).ok_or(Doubtful)?;
        match near.see(self.ray.direction, corners, values, 0.0) {
            Seen::Beside => Ok(None),
            Seen::Unclear => Err(Doubtful),
            Seen::Through(Stay { t: [a, b], f, .. }) => {
                let shift = two_sum(near.t, -self.base);
                let s = [a, b].map(|x| shift.plus(x.x).hi);
                // One rounding to f64 besides the ball.
                let error = a.e.max(b.e) + U64 * s[0].abs().max(s[1].abs()) * 1.001;
                // In flat or grazed cells the ball is wide: double-double knows more.
                if error > self.fine {
                    return Err(Doubtful);
                }
                Ok(Some(Inside {
                    s,
                    value: f.map(|f| f.x.f64()),
                    s_error: error,
                    value_error: f[0].e.max(f[1].e),
                    spread: 0.0,
                }))
            }
        }
    }

    fn exactly(&self, cell: u32, corners: &[DVec3; 4], values: &[f64; 4], spread: f64) -> Option<Inside> {
        let c = values[0];
        let most = values.iter().fold(0.0f64, |m, v| m.max((v - c).abs()));
        let x = ExactCell::new(self.ray, cell, corners, values, c, (&self.part.from, self.part.to.as_ref()))?;
        if x.is_point() {
            return None;
        }
        let s = [from_base(&x.t0, self.base), from_base(&x.t1, self.base)];
        let size = s[0].abs().max(s[1].abs());
        Some(Inside {
            s,
            value: [c + most * x.share(&x.t0), c + most * x.share(&x.t1)],
            s_error: 2.0 * U64 * size + f64::MIN_POSITIVE,
            value_error: 8.0 * U64 * (most + c.abs()),
            spread,
        })
    }
}
