//! Branch and bound over the parameters of one element.
//!
//! A box is given up where one of the three polynomials, or one of three combinations of them, is certainly not 0 in it, or where `newton` finds that it
//! has no zero; it is done with where `newton` finds exactly one; else it is cut in the middle. The combinations are the rows of the
//! adjugate of the derivatives' middle: the rows of the inverse where that is regular, and close to a tangency or a fold all of them the combination whose
//! derivatives vanish, which keeps the number of boxes about such a point bounded at every depth.
//!
//! What remains doubtful: boxes of the least size, boxes in which a combination is as small as its error, whatever is left when the number of boxes is used up, and zeros
//! that cannot be told to lie inside the element or outside.

use super::{
    Doubt,
    forms::{EDGE, Forms, Number, Slopes},
    newton::{Newton, Settled, adjugate},
};
use crate::tets::ball::Ball;

/// A box of an element's parameters.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) lo: [f64; 3],
    pub(super) size: [f64; 3],
}

impl Place {
    pub(super) const ALL: Self = Self {
        lo: [0.0; 3],
        size: [1.0; 3],
    };

    pub(super) fn hi(&self) -> [f64; 3] {
        // Exact: multiples of 2^-52 in [0, 1].
        std::array::from_fn(|k| self.lo[k] + self.size[k])
    }

    fn halves(&self, axis: usize) -> [Self; 2] {
        let mut a = *self;
        a.size[axis] *= 0.5;
        let mut b = a;
        b.lo[axis] += a.size[axis];
        [a, b]
    }
}

/// What to do and when to stop.
#[derive(Clone, Copy, Debug)]
pub(super) struct Task {
    /// Axes on which a zero lies by the system itself: no need to tell whether inside.
    pub(super) pinned: [bool; 3],
    /// gamma counts as 0 within this, for the watch; 0 for certificates.
    pub(super) band: f64,
    /// Boxes to look at, at most.
    pub(super) boxes: usize,
    /// Least size of a box.
    pub(super) least: f64,
}

/// One zero.
#[derive(Clone, Copy, Debug)]
pub(super) struct Zero<R> {
    /// In the element's parameters.
    pub(super) u: [Ball<R>; 3],
    /// A box of the element's parameters with no other zero.
    alone: ([f64; 3], [f64; 3]),
    /// The test in the small box about it, and the box's size in the element's parameters.
    pub(super) test: (Newton, [Ball<R>; 3]),
    /// Faces (axis, value 0 or 1) it may lie on this side or that of.
    pub(super) faces: [Option<f64>; 3],
}

/// A box that could not be decided.
#[derive(Clone, Copy, Debug)]
pub(super) struct Doubtful {
    pub(super) lo: [f64; 3],
    pub(super) hi: [f64; 3],
    pub(super) why: Doubt,
}

/// All of it.
#[derive(Clone, Debug)]
pub(super) struct Solved<R> {
    /// Zeros certainly in the closed element.
    pub(super) zeros: Vec<Zero<R>>,
    /// Zeros that lie in or beside it.
    pub(super) beside: Vec<Zero<R>>,
    pub(super) doubts: Vec<Doubtful>,
    /// With a band: the balls of zeros, for all values within it, that a face of the element cuts.
    pub(super) cut: Vec<[Ball<R>; 3]>,
    pub(super) boxes: usize,
}

/// A zero, the test that told it and the size of the box it was made in.
type Pinned<R> = ([Ball<R>; 3], (Newton, [Ball<R>; 3]));

/// One search.
struct Search<R> {
    task: Task,
    out: Solved<R>,
    scratch: Vec<R>,
    pool: Vec<Vec<R>>,
}

/// Half the sizes of the small boxes in which zeros are told for certain, and those for all values of a band. About any point that `guess` gives they lie in the
/// enlarged box.
const THIN: f64 = 2.5e-7;
const WIDE: f64 = 1.5e-3;

/// What to do with a box.
enum Next {
    Done,
    Cut(usize),
    Doubt(Doubt),
}

/// All zeros of the system in the closed element.
pub(super) fn solve<R: Number>(forms: Forms<R>, task: Task) -> Solved<R> {
    let mut search = Search {
        task,
        out: Solved {
            zeros: Vec::new(),
            beside: Vec::new(),
            doubts: Vec::new(),
            cut: Vec::new(),
            boxes: 0,
        },
        scratch: Vec::new(),
        pool: Vec::new(),
    };
    let mut stack = vec![(forms, Place::ALL)];
    while let Some((forms, place)) = stack.pop() {
        search.out.boxes += 1;
        let Some(most) = forms.sizes(task.band) else {
            search.pool.push(forms.c);
            continue;
        };
        let next = if search.out.boxes > task.boxes {
            Next::Doubt(Doubt::Limit)
        } else {
            search.look(&forms, &place, &most)
        };
        match next {
            Next::Done => {}
            Next::Doubt(why) => search.out.doubts.push(Doubtful {
                lo: place.lo,
                hi: place.hi(),
                why,
            }),
            Next::Cut(axis) => {
                let places = place.halves(axis);
                stack.extend(forms.halves(axis, &most, &mut search.pool).into_iter().zip(places));
            }
        }
        search.pool.push(forms.c);
    }
    search.out
}

impl<R: Number> Search<R> {
    fn look(&mut self, forms: &Forms<R>, place: &Place, most: &[f64; 3]) -> Next {
        let band = self.task.band;
        let slopes = forms.slopes(most);
        let (adj, det) = adjugate(&slopes.middle);
        let newton = Newton::new(&slopes, &adj, det);
        if let Some(newton) = &newton {
            if newton.q < 4.0 && newton.empty(forms, most, band, &mut self.scratch) {
                return Next::Done;
            }
            // At most one zero, for each value in the band.
            if newton.q < 0.95
                && let Some(m) = Newton::guess(forms)
                && let Some((zero, test)) = self.pinned_down(forms, most, &m, THIN, 0.0)
            {
                if band == 0.0 {
                    self.found(place, &zero, test);
                    return Next::Done;
                }
                let tube = match newton.settle(forms, most, band, &mut self.scratch) {
                    Settled::One(coarse) => {
                        let fine = self.pinned_down(forms, most, &m, WIDE, band);
                        Some(fine.map_or(coarse, |f| f.0))
                    }
                    _ => None,
                };
                if let Some(tube) = tube {
                    self.banded(place, &tube);
                    self.found(place, &zero, test);
                    return Next::Done;
                }
            }
        }
        let mut noise = false;
        let mut flattest = ([0.0; 3], 0.0);
        for row in &adj {
            let size = row.iter().fold(0.0f64, |a, x| a.max(x.abs()));
            if !(size > 0.0 && size.is_finite()) {
                continue;
            }
            let y = row.map(|x| x / size);
            if size > flattest.1 {
                flattest = (y, size);
            }
            let (greatest, error, apart) = forms.combined(&y, most, band);
            if apart {
                return Next::Done;
            }
            noise |= greatest <= 3.0 * error;
        }
        let error: [f64; 3] = std::array::from_fn(|j| forms.e[j] + if j == 2 { band } else { 0.0 });
        noise |= (0..3).any(|j| most[j] <= 3.0 * error[j]);
        let wanted = |k: &usize| place.size[*k] > self.task.least && forms.degree[*k] > 0;
        let axis = if noise {
            // Cuts that the errors do not hide.
            let clear = |k: &usize| (0..3).any(|j| slopes.middle[j][*k].abs() > 8.0 * error[j]);
            match (0..3).find(|k| wanted(k) && clear(k)) {
                Some(k) => return Next::Cut(k),
                None => return Next::Doubt(kind(&slopes)),
            }
        } else {
            match &newton {
                Some(n) if n.q < 4.0 => largest(n.spoiled(), place),
                _ if singular(&slopes, det) => largest(steepness(&slopes, &flattest.0), place),
                _ => largest(variation(&slopes, most), place),
            }
        };
        match std::iter::once(axis).chain(0..3).find(wanted) {
            Some(k) => Next::Cut(k),
            None => Next::Doubt(kind(&slopes)),
        }
    }

    /// The zero in a small box about m, for all values in the band, in balls of the forms' box, with the test and the small box's size. It exists and is the
    /// only one in the small box.
    fn pinned_down(&mut self, forms: &Forms<R>, most: &[f64; 3], m: &[f64; 3], half: f64, band: f64) -> Option<Pinned<R>> {
        let (small, lower, size) = forms.about(m, half, most);
        let most = small.sizes(band)?;
        let slopes = small.slopes(&most);
        let (adj, det) = adjugate(&slopes.middle);
        let newton = Newton::new(&slopes, &adj, det)?;
        match newton.settle(&small, &most, band, &mut self.scratch) {
            Settled::One(ball) => {
                let zero = std::array::from_fn(|k| lower[k].plus(size[k].times(ball[k])));
                Some((zero, (newton, size)))
            }
            _ => None,
        }
    }

    /// One zero for each value in the band.
    fn banded(&mut self, place: &Place, ball: &[Ball<R>; 3]) {
        let u = global(place, ball);
        if let Sides::On(faces) = sides(&u, &self.task.pinned)
            && faces.iter().any(Option::is_some)
        {
            self.out.cut.push(u);
        }
    }

    /// One zero, in these balls of the box's coordinates.
    fn found(&mut self, place: &Place, ball: &[Ball<R>; 3], (newton, size): (Newton, [Ball<R>; 3])) {
        // Beside this box it is another's, or nobody's.
        if matches!(sides(ball, &[false; 3]), Sides::Outside) {
            return;
        }
        let u = global(place, ball);
        let faces = match sides(&u, &self.task.pinned) {
            Sides::Outside => return,
            Sides::On(faces) => faces,
        };
        let bounds = u.map(Ball::bounds);
        let known = |z: &Zero<R>| (0..3).all(|k| z.alone.0[k] <= bounds[k].0 && bounds[k].1 <= z.alone.1[k]);
        if self.out.zeros.iter().chain(&self.out.beside).any(known) {
            return;
        }
        // The small box lies in the enlarged one, which has at most one zero. Half the enlargement: its rounding stays below the other half.
        let margin = |k: usize| 0.5 * EDGE * place.size[k];
        let zero = Zero {
            u,
            alone: (
                std::array::from_fn(|k| place.lo[k] - margin(k)),
                std::array::from_fn(|k| place.hi()[k] + margin(k)),
            ),
            test: (newton, std::array::from_fn(|k| size[k].times(Ball::exact(place.size[k])))),
            faces,
        };
        if faces.iter().any(Option::is_some) {
            self.out.beside.push(zero);
        } else {
            self.out.zeros.push(zero);
        }
    }
}

/// Balls of a box's coordinates as balls of the element's parameters.
fn global<R: Number>(place: &Place, ball: &[Ball<R>; 3]) -> [Ball<R>; 3] {
    std::array::from_fn(|k| Ball::exact(place.lo[k]).plus(Ball::exact(place.size[k]).times(ball[k])))
}

/// Where balls lie with respect to [0, 1]^3.
enum Sides {
    Outside,
    /// Inside but for the planes named per axis.
    On([Option<f64>; 3]),
}

fn sides<R: Number>(u: &[Ball<R>; 3], pinned: &[bool; 3]) -> Sides {
    let mut faces = [None; 3];
    for k in 0..3 {
        if pinned[k] {
            continue;
        }
        let ends = [(u[k].sign(), 0.0), (Ball::exact(1.0).minus(u[k]).sign(), 1.0)];
        for (sign, face) in ends {
            match sign {
                Some(1) => {}
                Some(_) => return Sides::Outside,
                None => faces[k] = Some(face),
            }
        }
    }
    Sides::On(faces)
}

/// The axis to cut: the largest side of those that matter half as much as the most important. (What a term in `u v` does to the derivatives shows as much
/// with u as with v, whichever is the larger.)
fn largest(matter: [f64; 3], place: &Place) -> usize {
    let most = matter.iter().fold(0.0f64, |a, &m| a.max(m));
    (0..3)
        .filter(|&k| matter[k] >= 0.5 * most)
        .max_by(|&a, &b| place.size[a].total_cmp(&place.size[b]))
        .unwrap_or(0)
}

/// How much the polynomials vary along each axis, in units of their sizes.
fn variation(slopes: &Slopes, most: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| {
        (0..3)
            .filter(|&j| most[j] > 0.0)
            .map(|j| (slopes.middle[j][k].abs() + slopes.radius[j][k]) / most[j])
            .fold(0.0, f64::max)
    })
}

/// Whether the derivatives' middle is nearly singular for the lengths of its rows.
fn singular(slopes: &Slopes, det: f64) -> bool {
    let lengths: f64 = slopes
        .middle
        .iter()
        .map(|r| r.iter().map(|x| x * x).sum::<f64>().sqrt())
        .product();
    det.abs() <= 0.02 * lengths
}

/// How much a combination of the polynomials may vary along each axis.
fn steepness(slopes: &Slopes, y: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| {
        let middle: f64 = (0..3).map(|j| y[j] * slopes.middle[j][k]).sum();
        middle.abs() + (0..3).map(|j| y[j].abs() * slopes.radius[j][k]).sum::<f64>()
    })
}

/// A fold where the line's own two derivatives depend on each other, else a tangency.
fn kind(slopes: &Slopes) -> Doubt {
    let [a, b, _] = slopes.middle;
    let (x, y) = (isobar_core::DVec3::from(a), isobar_core::DVec3::from(b));
    if x.cross(y).length() <= 1e-6 * x.length() * y.length() {
        Doubt::Fold
    } else {
        Doubt::Tangent
    }
}

/// Boxes that touch each other, together.
pub(super) fn clusters(boxes: &[Doubtful]) -> Vec<Vec<Doubtful>> {
    let touch = |a: &Doubtful, b: &Doubtful| (0..3).all(|k| a.lo[k] <= b.hi[k] && b.lo[k] <= a.hi[k]);
    let mut out: Vec<Vec<Doubtful>> = Vec::new();
    for b in boxes {
        let (with, mut without): (Vec<_>, Vec<_>) = out.into_iter().partition(|c| c.iter().any(|o| touch(o, b)));
        let mut one: Vec<Doubtful> = with.into_iter().flatten().collect();
        one.push(*b);
        without.push(one);
        out = without;
    }
    out
}

/// Bounds of the parameters of some boxes.
pub(super) fn hull(cluster: &[Doubtful]) -> [(f64, f64); 3] {
    std::array::from_fn(|k| {
        cluster.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), b| {
            (lo.min(b.lo[k]), hi.max(b.hi[k]))
        })
    })
}
