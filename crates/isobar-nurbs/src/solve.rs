//! All roots of one element's surface on the rays of a tile: subdivision shared by the pixels, ended by a proof of uniqueness and Newton's method.
//!
//! The system is the paper's P = (alpha, beta, gamma) (equations 13 to 15 as corrected in maths, section C): alpha, beta the ray's two planes, gamma the
//! attribute minus the isovalue. A **piece** is a box of the element's parameters with its Bernstein coefficients and the rectangle of pixels that may
//! see it. What the paper does pixel by pixel (section 4.1: subdivide, test a bounding box, Newton) is done here for all pixels of the rectangle at once:
//!
//! 1. gamma has one sign: no pixel sees a root. The rectangle shrinks to the pixels whose rays may pass the control points.
//! 2. **Oriented test** (the paper's Jacobian OBB, section 4.1.2, in interval form): with m the middle of the piece, Y about the inverse of
//!    the Jacobian J and E >= |Y J - I| over the piece, every root obeys `|u - m + Y P(m)| <= E |u - m|` in each component. Pixels where that leaves the piece have no root.
//! 3. **Uniqueness** (interval Newton operator): where the greatest row sum rho of E is at most 1/2, P is injective on the piece: at most one root per pixel. Newton's method
//!    finds it, and `|u - root| <= |Y P(u)| / (1 - rho)` encloses it: existence is proved where that ball lies in the slightly widened piece.
//! 4. Else the piece is halved along the axis whose derivative varies most in E.
//!
//! Elements that are boxes with a polynomial attribute go to `affine.rs` instead: there the system is one univariate polynomial along each ray.
//!
//! **Roundings.** Every coefficient carries a bound of its error: that of forming it, and one rounding per halving and degree. A coefficient is a mean, with positive factors, of the
//! element's `w (p - eye)`, so it is at most its own weight times the farthest |p - eye|, and so is every rounding on the way to it: the bound is `EPS geometry w_i far`, and for a piece that with its own
//! greatest weight ([`Constants::of_piece`]). The parts that light control points are seen in are small in parameters and their errors with them; halving goes deeper by the binary places between the least and
//! the greatest weight. A test only decides where the bound allows. A box that reaches the smallest size, or a surface that costs too many pieces, is reported for its pixels as undecided: tangential
//! contacts end so.

use crate::affine::{LocalRay, exact_box, is_near, rectangle};
use crate::bernstein::{Lanes, Point, bases, count, halve, jet, range, range_of};
use crate::ends::Ends;
use crate::frustum::{EPS, Frustum, PixelBox};
use crate::model::{Derivatives, survivors};
use glam::DVec3;
use isobar_core::HexElement;

/// Halvings along one axis, at most, where all weights are equal: parameters are then 1e-7 apart.
const DEEPEST: u8 = 23;
/// Binary places between the least and the greatest weight of an element, at most; of others all pixels that may see them are undecided.
const MOST_PLACES: f64 = 200.0;
/// Part of an element up to which a piece of the smallest size is drawn, without a claim.
pub(crate) const DRAWN: f64 = 1.0 / 65536.0;
/// Pieces of one surface of one element in one tile, at most.
const MOST_PIECES: u32 = 1 << 15;
/// How far a piece is widened, in its own size, for the proof of existence.
pub(crate) const WIDER: f64 = 1.0 / (1 << 12) as f64;
/// What the widening multiplies ranges of derivatives by: `(1 + 2 WIDER)^60`, rounded up.
pub(crate) const WIDENED: f64 = 1.03;
/// Row sum up to which a piece counts as injective.
const CONTRACTION: f64 = 0.5;
/// Pixels for which a piece that is not injective is tested one by one.
const FEW: usize = 64;

/// What is sought on an element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Target {
    /// a(u) = c.
    Isovalue(f64),
    /// `u[axis] = value`.
    Parameter(u8, f64),
}

/// One surface of one element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Task {
    pub(crate) element: u32,
    pub(crate) surface: u8,
    pub(crate) target: Target,
    /// Whether the element is a box with a polynomial attribute (`affine.rs`).
    pub(crate) boxed: bool,
}

/// A root.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// Pixel of the frustum, row by row.
    pub(crate) pixel: u16,
    pub(crate) surface: u8,
    /// Whether a root of the element certainly lies within `error` of t.
    pub(crate) certain: bool,
    /// Whether it is a crossing that only rounding keeps from being told from one beyond a face of its cell.
    pub(crate) face: bool,
    pub(crate) t: f64,
    pub(crate) error: f64,
    /// World gradient direction, not of unit length; 0 where the map is singular.
    pub(crate) normal: DVec3,
}

/// Counts of work.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Work {
    pub(crate) tasks: u64,
    pub(crate) pieces: u64,
    pub(crate) halvings: u64,
    pub(crate) newton: u64,
    /// Univariate polynomials along rays.
    pub(crate) polynomials: u64,
    pub(crate) limits: u64,
    pub(crate) hits: u64,
    pub(crate) deepest: u64,
}

/// A box of parameters; its coefficients are at the top of the solver's stacks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece {
    pub(crate) pixels: PixelBox,
    /// Halvings per axis.
    pub(crate) depth: [u8; 3],
    /// Halvings since each axis was halved.
    pub(crate) since: [u8; 3],
    /// Which faces are faces of the element: bit 2 a + side.
    pub(crate) faces: u8,
    /// Roundings, in units of the scale.
    pub(crate) geometry: f64,
    pub(crate) attribute: f64,
}

/// Scratch memory and results of one thread's tile.
#[derive(Debug, Default)]
pub(crate) struct Solver {
    pub(crate) points: Vec<Point>,
    pub(crate) values: Vec<f64>,
    pub(crate) stack: Vec<Piece>,
    /// The tile's rays in the index space of a grid.
    pub(crate) rays: Vec<LocalRay>,
    pub(crate) found: Vec<Found>,
    /// Per pixel: how far along its ray roots are wanted.
    pub(crate) ends: Ends,
    /// Per pixel: whether something was left undecided.
    pub(crate) undecided: Vec<bool>,
    /// Per pixel: pieces that were looked at for it, where asked for.
    pub(crate) seen: Option<Vec<u32>>,
    pub(crate) work: Work,
}

/// What is fixed for a task.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Constants {
    /// Degrees of geometry and gamma.
    pub(crate) g: [usize; 3],
    pub(crate) h: [usize; 3],
    /// Greatest |x| + |y| + |z| of a control point less the eye; of the attribute less the isovalue.
    pub(crate) far: f64,
    level: f64,
    /// Whether weights differ; whether gamma is weighted.
    varied: bool,
    weighted: bool,
    /// Halvings along one axis, at most.
    pub(crate) deepest: u8,
    /// Ends in the camera frame of the box about the control points.
    pub(crate) ends: (DVec3, DVec3),
    /// Greatest magnitude of a homogeneous coordinate before cancellation; of a weight; of gamma.
    pub(crate) scale: f64,
    pub(crate) weight: f64,
    pub(crate) gamma: f64,
    /// The lane of D.
    pub(crate) lane: usize,
    /// The axis whose value the target fixes at an end of [0, 1].
    pub(crate) face_axis: Option<usize>,
}

impl Constants {
    /// With the greatest magnitudes of a piece instead of the element's.
    #[inline(always)]
    pub(crate) fn of_piece(&self, points: &[Point]) -> Self {
        if !self.varied {
            return *self;
        }
        // Weights themselves are rounded.
        let weight = points.iter().fold(0.0f64, |m, p| m.max(p[3])) * 1.001;
        Self {
            scale: weight * self.far,
            weight,
            gamma: if self.weighted { weight * self.level } else { self.gamma },
            ..*self
        }
    }
}

impl Solver {
    /// Ready for the pixels of a frustum.
    pub(crate) fn begin(&mut self, pixels: usize, heat: bool, stops: &[bool]) {
        self.found.clear();
        self.ends.begin(stops, pixels);
        self.undecided.clear();
        self.undecided.resize(pixels, false);
        self.seen = heat.then(|| vec![0; pixels]);
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.points.capacity() * 32
            + self.values.capacity() * 8
            + self.stack.capacity() * size_of::<Piece>()
            + self.rays.capacity() * size_of::<LocalRay>()
            + self.found.capacity() * size_of::<Found>()
    }

    /// Finds all roots of a task.
    #[inline(always)]
    pub(crate) fn solve(&mut self, f: &Frustum, element: &HexElement, task: &Task) {
        if let Target::Isovalue(c) = task.target
            && task.boxed
            && let Some(corners) = exact_box(element)
            && is_near(corners, f.eye)
        {
            return self.solve_box(f, element, corners, task.surface, c);
        }
        let Some(k) = self.load(f, element, task) else { return };
        self.work.tasks += 1;
        let mut budget = MOST_PIECES;
        while let Some(piece) = self.stack.pop() {
            self.work.deepest = self.work.deepest.max(self.stack.len() as u64 + 1);
            if budget == 0 {
                self.leave(f, piece.pixels);
                self.drop_piece(&k);
                continue;
            }
            budget -= 1;
            self.work.pieces += 1;
            self.step(f, task, &k, piece);
        }
    }

    /// The element's coefficients in the camera frame onto the stacks, and the whole element as the first piece.
    #[inline(always)]
    pub(crate) fn load(&mut self, f: &Frustum, e: &HexElement, task: &Task) -> Option<Constants> {
        self.points.clear();
        self.values.clear();
        self.stack.clear();
        let g = e.degree.map(usize::from);
        let (least, most) = range_of_weights(e);
        let (mut far, mut ends) = (0.0f64, (DVec3::INFINITY, DVec3::NEG_INFINITY));
        for p in &e.points {
            let d = DVec3::new(p[0], p[1], p[2]) - f.eye;
            // The greatest is 1: no sum overflows, whatever the weights.
            let w = p[3] / most;
            let c = DVec3::new(f.right.dot(d), f.up.dot(d), f.forward.dot(d));
            self.points.push([w * c.x, w * c.y, w * c.z, w]);
            far = far.max(d.x.abs() + d.y.abs() + d.z.abs());
            ends = (ends.0.min(c), ends.1.max(c));
        }
        // The element lies in the box about its control points, whatever their weights. Room: a difference and three products with their sum, and where rays are parallel, how far these stray from
        // the frame's axis on their way.
        let (middle, half) = (0.5 * (ends.0 + ends.1), 0.5 * (ends.1 - ends.0));
        let pixels = if far.is_finite() {
            rectangle(f, middle.to_array(), half.to_array(), 32.0 * EPS * far, f.all())?
        } else {
            f.all()
        };
        let places = (most / least).log2();
        let mut h = e.value_degree.map(usize::from);
        let mut face_axis = None;
        match task.target {
            Target::Isovalue(c) if e.rational_value => {
                h = g;
                self.values
                    .extend(e.values.iter().zip(&e.points).map(|(a, p)| p[3] / most * (a - c)));
            }
            Target::Isovalue(c) => self.values.extend(e.values.iter().map(|a| a - c)),
            Target::Parameter(axis, v) => {
                h = [0; 3];
                h[usize::from(axis)] = 1;
                self.values.extend([-v, 1.0 - v]);
                face_axis = (v == 0.0 || v == 1.0).then_some(usize::from(axis));
            }
        }
        let gamma = self.values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let weighted = e.rational_value && matches!(task.target, Target::Isovalue(_));
        let level = match task.target {
            Target::Isovalue(c) if weighted => e.values.iter().fold(0.0f64, |m, a| m.max((a - c).abs())),
            _ => gamma,
        };
        if !(far.is_finite() && gamma.is_finite() && level.is_finite() && places <= MOST_PLACES) {
            self.leave(f, pixels);
            return None;
        }
        self.stack.push(Piece {
            pixels,
            depth: [0; 3],
            since: [0; 3],
            faces: 0b11_1111,
            // A difference, three products with their sum, the weight over the greatest and the product with it.
            geometry: 9.0,
            attribute: 4.0,
        });
        Some(Constants {
            g,
            h,
            far,
            level,
            varied: least < most,
            weighted,
            deepest: DEEPEST + places.ceil() as u8,
            ends,
            scale: far,
            weight: 1.0,
            gamma: if weighted { level } else { gamma },
            lane: if f.parallel { 3 } else { 2 },
            face_axis,
        })
    }

    pub(crate) fn drop_piece(&mut self, k: &Constants) {
        self.points.truncate(self.points.len() - count(k.g));
        self.values.truncate(self.values.len() - count(k.h));
    }

    /// Gives up on the pixels of a piece.
    pub(crate) fn leave(&mut self, f: &Frustum, b: PixelBox) {
        self.work.limits += 1;
        for y in usize::from(b.y0)..=usize::from(b.y1) {
            for x in usize::from(b.x0)..=usize::from(b.x1) {
                self.undecided[y * f.width + x] = true;
            }
        }
    }

    /// One piece: decided, or halved.
    #[inline(always)]
    fn step(&mut self, f: &Frustum, task: &Task, k: &Constants, mut piece: Piece) {
        let (np, nv) = (self.points.len() - count(k.g), self.values.len() - count(k.h));
        let (points, values) = (&self.points[np..], &self.values[nv..]);
        let k = &k.of_piece(points);
        let noise = EPS * k.gamma * piece.attribute;
        let (lo, hi) = range(values);
        if lo > noise || hi < -noise {
            return self.drop_piece(k);
        }
        let Some(b) = project(f, k, &piece, points) else {
            return self.drop_piece(k);
        };
        let near = if self.ends.is_on() { nearest(k, &piece, points) } else { 0.0 };
        let Some(b) = self.ends.open(f, b, near) else {
            return self.drop_piece(k);
        };
        piece.pixels = b;
        if let Some(seen) = &mut self.seen {
            for y in usize::from(b.y0)..=usize::from(b.y1) {
                for x in usize::from(b.x0)..=usize::from(b.x1) {
                    seen[y * f.width + x] += 1;
                }
            }
        }
        let derivatives = Derivatives::new(k, points, values);
        let model = derivatives.model(f, k, &piece, points, values);
        if let Some(m) = &model {
            if m.rho <= CONTRACTION {
                // Pixels whose root lies too near the piece's outside are left: they see it again in smaller pieces.
                match self.finish(f, task, k, &piece, m) {
                    Some(b) => piece.pixels = b,
                    None => return self.drop_piece(k),
                }
            } else if b.pixels() <= FEW {
                match survivors(f, k, m, b) {
                    Some(b) => piece.pixels = b,
                    None => return self.drop_piece(k),
                }
            }
        }
        let Some(axis) = derivatives.axis(f, k, &piece, model.as_ref()) else {
            self.give_up(f, task, k, &piece);
            return self.drop_piece(k);
        };
        self.split(k, piece, axis);
    }

    /// Replaces the piece at the top by its halves, the lower one on top.
    #[inline(always)]
    pub(crate) fn split(&mut self, k: &Constants, mut piece: Piece, axis: usize) {
        self.work.halvings += 1;
        let (n, m) = (count(k.g), count(k.h));
        let (at, av) = (self.points.len(), self.values.len());
        self.points.resize(at + n, [0.0; 4]);
        self.values.resize(av + m, 0.0);
        let (upper, lower) = self.points[at - n..].split_at_mut(n);
        halve(k.g, axis, upper, lower);
        let (upper, lower) = self.values[av - m..].split_at_mut(m);
        halve(k.h, axis, upper, lower);
        piece.geometry += k.g[axis] as f64;
        piece.attribute += k.h[axis] as f64;
        piece.depth[axis] += 1;
        for (a, s) in piece.since.iter_mut().enumerate() {
            *s = if a == axis { 0 } else { s.saturating_add(1) };
        }
        let mut upper = piece;
        upper.faces &= !(1 << (2 * axis));
        piece.faces &= !(2 << (2 * axis));
        self.stack.extend([upper, piece]);
        // The nearer half on top where what is behind a root is not wanted.
        if self.ends.is_on() {
            let depth = |p: &[Point]| p.iter().map(|p| p[2]).sum::<f64>();
            let (upper, lower) = self.points[at - n..].split_at_mut(n);
            if depth(upper) < depth(lower) {
                upper.swap_with_slice(lower);
                let (upper, lower) = self.values[av - m..].split_at_mut(m);
                upper.swap_with_slice(lower);
                let top = self.stack.len();
                self.stack.swap(top - 1, top - 2);
            }
        }
    }

    /// A piece of the smallest size: its pixels are undecided, and those whose rays pass the box about its control points get an uncertain hit there, if the box is small.
    #[inline(always)]
    fn give_up(&mut self, f: &Frustum, task: &Task, k: &Constants, piece: &Piece) {
        self.leave(f, piece.pixels);
        let (np, nv) = (self.points.len() - count(k.g), self.values.len() - count(k.h));
        let (points, values) = (&self.points[np..], &self.values[nv..]);
        let at = bases(k.g, [0.5; 3]);
        let [p, pu, pv, pw] = jet(k.g, points, &at);
        let [_, au, av, aw] = jet(k.h, values, &bases(k.h, [0.5; 3]));
        let depth = p[2] / p[3];
        let (lo, hi) = range_of(points, |p: Point| [p[0] / p[3], p[1] / p[3], p[2] / p[3], p[3]]);
        let (whole, room) = (k.ends.1 - k.ends.0, EPS * piece.geometry * k.far);
        if (0..3).any(|i| hi[i] - lo[i] > DRAWN * whole.max_element() + 2.0 * room) {
            return;
        }
        // An extent of its own on every side: the box is a millionth of the element.
        let beside = |i: usize, x: f64| x < lo[i] - (hi[i] - lo[i]) - room || x > hi[i] + (hi[i] - lo[i]) + room;
        let b = piece.pixels;
        for y in usize::from(b.y0)..=usize::from(b.y1) {
            for x in usize::from(b.x0)..=usize::from(b.x1) {
                let pixel = y * f.width + x;
                let ray = &f.rays[pixel];
                let away = if f.parallel { 1.0 } else { depth };
                if beside(0, ray.slope[0] * away) || beside(1, ray.slope[1] * away) {
                    continue;
                }
                let extent = [pu, pv, pw].iter().map(|q| (q[2] - depth * q[3]).abs() / p[3]).sum::<f64>();
                self.found.push(Found {
                    pixel: pixel as u16,
                    surface: task.surface,
                    certain: false,
                    face: false,
                    t: (depth - ray.start) / ray.rate,
                    error: (extent + 1e-14 * depth.abs()) / ray.rate.abs(),
                    normal: normal(f, p, [pu, pv, pw], [au, av, aw]),
                });
            }
        }
    }
}

/// `J^-T grad_u gamma` in the world (maths C, equation 16), up to a positive factor.
#[inline(always)]
pub(crate) fn normal(f: &Frustum, p: Point, d: [Point; 3], g: [f64; 3]) -> DVec3 {
    let [a, b, c] = d.map(|q| {
        DVec3::new(
            q[0] - p[0] / p[3] * q[3],
            q[1] - p[1] / p[3] * q[3],
            q[2] - p[2] / p[3] * q[3],
        )
    });
    let (bc, ca, ab) = (b.cross(c), c.cross(a), a.cross(b));
    let n = bc * g[0] + ca * g[1] + ab * g[2];
    let n = n * a.dot(bc).signum();
    let world = f.right * n.x + f.up * n.y + f.forward * n.z;
    world.normalize_or(DVec3::ZERO)
}

/// Least and greatest weight.
#[inline(always)]
fn range_of_weights(e: &HexElement) -> (f64, f64) {
    e.points
        .iter()
        .fold((f64::INFINITY, 0.0f64), |(a, b), p| (a.least(p[3]), b.most(p[3])))
}

/// At most the depth of all points of a piece: errors of a coefficient are relative to its own weight.
#[inline(always)]
fn nearest(k: &Constants, piece: &Piece, points: &[Point]) -> f64 {
    let near = points.iter().fold(f64::INFINITY, |m, p| m.least(p[2] / p[3]));
    near - 3.0 * EPS * (piece.geometry + 4.0) * (k.far + near.abs())
}

/// Ends of the slopes or offsets of control points, each divided by its own D, widened by its own error (relative to its weight); `None` where a D may not be positive.
#[inline(always)]
fn quotients(k: &Constants, piece: &Piece, points: &[Point]) -> Option<[(f64, f64); 2]> {
    let mut out = [(f64::INFINITY, f64::NEG_INFINITY); 2];
    for p in points {
        let d = p[k.lane];
        let error = EPS * piece.geometry * k.far * p[3];
        let heavy = if k.lane == 3 { EPS * piece.geometry * p[3] } else { error };
        if d <= 4.0 * heavy {
            return None;
        }
        for (x, (lo, hi)) in p.iter().zip(&mut out) {
            let q = x / d;
            let by = (error + q.abs() * heavy) / d * 1.5 + 4.0 * EPS * (q.abs() + k.far * p[3] / d);
            (*lo, *hi) = (lo.min(q - by), hi.max(q + by));
        }
    }
    Some(out)
}

/// The pixels whose rays may pass the control points of a piece; `None`: none do.
///
/// Slopes are taken from those of the rectangle's middle, s0 and r0: of `x - s0 D` the least over the greatest or least depth is hardly less than the least quotient of a control point,
/// and no point is divided by. Where depths or weights differ by more than a factor of 8 that is too wide, and every point is divided.
#[inline(always)]
pub(crate) fn project(f: &Frustum, k: &Constants, piece: &Piece, points: &[Point]) -> Option<PixelBox> {
    let [(s, ds), (r, dr)] = f.slopes(piece.pixels);
    let lane = k.lane;
    let (lo, hi) = range_of(points, |p: Point| [p[0] - s * p[lane], p[1] - r * p[lane], p[2], p[3]]);
    let noise = EPS * piece.geometry * k.scale;
    let (near, far) = (lo[lane], hi[lane]);
    if !f.parallel && far < -noise {
        return None;
    }
    // Errors of a depth, and of `x - s D`: of both coefficients, of the product and of the difference.
    let (heavy, depth) = if f.parallel {
        (EPS * piece.geometry * k.weight, k.weight)
    } else {
        (noise, k.scale)
    };
    if far > 8.0 * near
        && let Some([x, y]) = quotients(k, piece, points)
    {
        return f.narrow(piece.pixels, x, y);
    }
    if near > 4.0 * heavy {
        let steep = s.abs().max(r.abs());
        let rough = noise + steep * heavy + 4.0 * EPS * (k.scale + steep * depth);
        let slopes = |(a, b): (f64, f64), middle: f64| {
            let lo = a / if a < 0.0 { near } else { far };
            let hi = b / if b < 0.0 { far } else { near };
            let most = lo.abs().max(hi.abs());
            // Rounding of the quotient, and of its sum with the middle.
            let by = (rough + most * heavy) / near * 1.5 + 4.0 * EPS * (most + middle.abs());
            (middle + lo - by, middle + hi + by)
        };
        return f.narrow(piece.pixels, slopes((lo[0], hi[0]), s), slopes((lo[1], hi[1]), r));
    }
    // Points before and behind the eye: no quotients. A linear form that is negative on all control points is negative on the piece, and
    // not negative on the rays.
    let most = noise + heavy * (f.reach + 1.0);
    let outside = [(0, s - ds, 1.0), (0, s + ds, -1.0), (1, r - dr, 1.0), (1, r + dr, -1.0)]
        .iter()
        .any(|&(lane, slope, sign)| points.iter().all(|p| sign * (p[lane] - slope * p[k.lane]) < -2.0 * most));
    (!outside).then_some(piece.pixels)
}
