//! The part of an isosurface inside a cell, as edge functions on the screen: Roettger, Kraus, Ertl 2000, sections 5 to 7, with the texture replaced by
//! what it stands for.
//!
//! In a cell s is linear, so s = c is a triangle or a quadrilateral whose corners lie on the edges of the cell between a corner v with s >= c
//! and a corner a with s < c. In homogeneous pixel coordinates such a corner is `Q = |w_v| H_a + |w_a| H_v`, w = s - c, **without a division**, and the line
//! through two of them is `Q1 x Q2`: it is where a face of the cell cuts s = c, seen from the eye. All edge functions of one sign means that the
//! ray meets s = c inside the closed cell; this holds for cells that cross the eye plane, and excludes what lies behind it, with no clipping
//! (Olano and Greer's homogeneous rasterisation). The key of the hit is affine on the screen.
//!
//! Each edge function is divided by its proved bound ([`crate::camera`]): at least 1 is certainly inside, below -1 certainly outside, and what is
//! between is for integers. So neighbours neither lose nor share a ray.

use crate::camera::{Corner, Projection, UNIT};
use crate::resolve::Gradient;
use isobar_core::DVec3;

/// What a patch needs besides the common test.
pub(crate) mod kind {
    /// Nothing is certain: every pixel it may cover is decided in integers.
    pub(crate) const UNSURE: u8 = 1;
    /// A face of a cell with all values equal to the isovalue; its number in bits 4 and 5.
    pub(crate) const CONSTANT: u8 = 2;
}

/// One patch on the screen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patch {
    /// Edge functions `a x + b y + c` of centred pixel coordinates, in units of their bounds.
    pub(crate) edges: [[f64; 3]; 4],
    /// The key.
    pub(crate) key: [f64; 3],
    pub(crate) cell: u32,
    /// Index of the isovalue.
    pub(crate) isovalue: u8,
    pub(crate) kind: u8,
    /// Pixels that may be covered: first and last column and row.
    pub(crate) x: [u16; 2],
    pub(crate) y: [u16; 2],
}

impl Patch {
    #[inline(always)]
    pub(crate) fn is_unsure(&self) -> bool {
        self.kind & kind::UNSURE != 0
    }

    /// The face of a constant cell.
    #[inline(always)]
    pub(crate) fn face(&self) -> Option<usize> {
        (self.kind & kind::CONSTANT != 0).then_some(usize::from(self.kind >> 4))
    }

    /// Whether the ray at centred pixel coordinates certainly meets it, and whether it may.
    #[inline(always)]
    pub(crate) fn covers(&self, x: f64, y: f64) -> (bool, bool) {
        let e = self.edges.map(|[a, b, c]| a * x + (b * y + c));
        let least = e.iter().fold(f64::INFINITY, |m, &v| m.min(v));
        let most = e.iter().fold(f64::NEG_INFINITY, |m, &v| m.max(v));
        if self.is_unsure() {
            // Negated, so that NaN is not excluded.
            return (false, !(least < -1.0 && most > 1.0));
        }
        (least >= 1.0, least >= -1.0)
    }
}

/// Makes patches of one view.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Maker<'a> {
    pub(crate) projection: &'a Projection,
    /// Orthographic: the greatest depth of the mesh, which keys are precise to a share of.
    pub(crate) key_unit: f64,
}

type Q = [f64; 4];

/// `|w_v| H_a + |w_a| H_v` with the weight `|w_v| + |w_a|`.
#[inline(always)]
fn between(v: &Corner, a: &Corner, wv: f64, wa: f64) -> (Q, f64) {
    let (f, g) = (wv.abs(), wa.abs());
    (std::array::from_fn(|i| f * a.h[i] + g * v.h[i]), f + g)
}

#[inline(always)]
fn cross(a: &Q, b: &Q) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
fn dot(a: &[f64; 3], b: &Q) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// What all patches of a cell share.
struct Cell {
    number: u32,
    isovalue: u8,
    kind: u8,
    /// At least |P| of every corner.
    size: f64,
    /// The key of s = c; `None` where it may be off by more than a tenth of [`KEY_TOLERANCE`].
    key: Option<[f64; 3]>,
}

impl Maker<'_> {
    /// The patches of s = c in a cell with corners and values; c lies between the least and the greatest.
    #[inline(always)]
    pub(crate) fn patches(&self, cell: u32, points: &[DVec3; 4], values: &[f64; 4], isovalue: (u8, f64), out: &mut Vec<Patch>) {
        let h = points.map(|p| self.projection.corner(p));
        let w = values.map(|v| v - isovalue.1);
        let size = h[0].size.max(h[1].size).max(h[2].size.max(h[3].size));
        let cell = Cell {
            number: cell,
            isovalue: isovalue.0,
            kind: 0,
            size,
            key: self.key(&Gradient::new(points, values), points[0], isovalue.1 - values[0], size),
        };
        let above: usize = (0..4).map(|i| usize::from(w[i] >= 0.0) << i).sum();
        match above.count_ones() {
            2 => {
                let [a, b, c, d] = PAIRS[above];
                self.quad(&cell, [&h[a], &h[b], &h[c], &h[d]], [w[a], w[b], w[c], w[d]], out);
            }
            1 | 3 => {
                let v = if above.count_ones() == 1 { above } else { 15 - above }.trailing_zeros() as usize;
                let q: [(Q, f64); 3] = OTHERS[v].map(|a| between(&h[v], &h[a], w[v], w[a]));
                if w[v] == 0.0 {
                    return self.point(&cell, &q[0].0, q[0].1, out);
                }
                self.polygon(&cell, &q, out);
            }
            // All at least c, at least one equal: the cell only touches the surface from above.
            _ => self.touching(&cell, points, &h, &w, out),
        }
    }

    /// a and b at least c, the others below.
    #[inline(always)]
    fn quad(&self, cell: &Cell, [a, b, c, d]: [&Corner; 4], [wa, wb, wc, wd]: [f64; 4], out: &mut Vec<Patch>) {
        let q = [
            between(a, c, wa, wc),
            between(a, d, wa, wd),
            between(b, d, wb, wd),
            between(b, c, wb, wc),
        ];
        match (wa == 0.0, wb == 0.0) {
            (false, false) => self.polygon(cell, &q, out),
            (true, false) => self.polygon(cell, &[q[0], q[2], q[3]], out),
            (false, true) => self.polygon(cell, &[q[0], q[1], q[2]], out),
            (true, true) => self.segment(cell, &q[0], &q[2], out),
        }
    }

    /// A cell whose least value is c.
    #[cold]
    #[inline(never)]
    fn touching(&self, cell: &Cell, points: &[DVec3; 4], h: &[Corner; 4], w: &[f64; 4], out: &mut Vec<Patch>) {
        let zeros: Vec<(Q, f64)> = (0..4).filter(|&i| w[i] == 0.0).map(|i| (h[i].h, 1.0)).collect();
        match zeros[..] {
            [(q, w)] => self.point(cell, &q, w, out),
            [a, b] => self.segment(cell, &a, &b, out),
            [a, b, c] => self.polygon(cell, &[a, b, c], out),
            [..] => self.constant(cell, points, h, out),
        }
    }

    /// A cell on which s = c everywhere: the faces through which rays enter it. Where the eye (or the plane rays start on) may lie in the cell,
    /// all faces, for integers to decide.
    fn constant(&self, cell: &Cell, points: &[DVec3; 4], h: &[Corner; 4], out: &mut Vec<Patch>) {
        // Cells have positive volume: these are the faces opposite corners 0 to 3, counterclockwise from outside.
        const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];
        let bound = self.projection.volume_bound(cell.size);
        let dets = FACES.map(|[a, b, c]| dot(&cross(&h[a].h, &h[b].h), &h[c].h));
        let starts_inside = if self.projection.perspective {
            // The eye is inside where it sees no face from outside.
            dets.iter().all(|d| *d > -bound)
        } else {
            let depth = |c: &Corner| -c.h[3];
            let slack = UNIT_OF_DEPTH * cell.size;
            h.iter().any(|c| depth(c) <= slack) && h.iter().any(|c| depth(c) >= -slack)
        };
        for (k, [a, b, c]) in FACES.into_iter().enumerate() {
            // Seen from outside, a face has the sign that the whole screen's handedness gives: x right, y down, depth away.
            let front = dets[k] < 0.0;
            let doubtful = dets[k].abs() <= bound;
            if starts_inside || front || doubtful {
                let kind = kind::CONSTANT | (k as u8) << 4 | if starts_inside || doubtful { kind::UNSURE } else { 0 };
                let face = [a, b, c].map(|i| points[i]);
                let key = self.key(&Gradient::of_face(&face), face[0], 0.0, cell.size);
                let cell = Cell { kind, key, ..*cell };
                self.polygon(&cell, &[a, b, c].map(|i| (h[i].h, 1.0)), out);
            }
        }
    }

    /// The key of the plane G . (x - corner) = rise V, if it is precise enough everywhere on a cell of this size.
    ///
    /// Perspective: the inverse depth is (G . D)/N, D the direction with depth 1 and N = rise V + G . (corner - eye). Orthographic: the depth is
    /// (N - G . (start - eye))/(G . forward).
    #[inline(always)]
    fn key(&self, g: &Gradient, corner: DVec3, rise: f64, m: f64) -> Option<[f64; 3]> {
        let p = self.projection;
        let from = corner - p.eye;
        let [x, y, forward] = [p.steps[0], p.steps[1], p.rows[2]].map(|v| g.scaled.dot(v));
        let n = rise * g.volume + g.scaled.dot(from);
        let n_off = UNIT * (rise.abs() * g.edges + g.bound * (m + p.reach[1]));
        let small = 0.05 * KEY_TOLERANCE;
        if p.perspective {
            let one = 1.0 / n;
            let precise = n_off <= small * n.abs() && UNIT * g.bound * 2.0 * p.stretch * m <= small * n.abs();
            (precise && n.abs() > 1e-280).then_some([x * one, y * one, forward * one])
        } else {
            let one = 1.0 / forward;
            let off = n_off + UNIT * g.bound * (self.key_unit + m);
            let precise = off <= small * self.key_unit * forward.abs();
            (precise && forward.abs() > 1e-280).then_some([x * one, y * one, -n * one])
        }
    }

    /// Three or four corners in a plane, in order around it.
    #[inline(always)]
    fn polygon<const N: usize>(&self, cell: &Cell, q: &[(Q, f64); N], out: &mut Vec<Patch>) {
        let Some(([x0, x1], [y0, y1])) = self.pixels(cell, q) else {
            return;
        };
        let m = cell.size;
        let unit = self.projection.edge_bound(m);
        let mut edges = [[0.0; 3]; 4];
        let mut bounds = [0.0; 4];
        for i in 0..N {
            let j = (i + 1) % N;
            edges[i] = cross(&q[i].0, &q[j].0);
            bounds[i] = unit * q[i].1 * q[j].1;
        }
        // Of the triangles (0, 1, 2) and (0, 2, 3) the larger tells the orientation.
        let mut det = dot(&edges[1], &q[0].0);
        let mut weights = q[0].1 * q[1].1 * q[2].1;
        if N == 4 {
            let other = dot(&edges[2], &q[0].0);
            if other.abs() > det.abs() {
                det = other;
                weights = q[0].1 * q[2].1 * q[N - 1].1;
            }
        } else {
            edges[3] = edges[2];
            bounds[3] = bounds[2];
        }
        let oriented = det.abs() > self.projection.volume_bound(m) * weights;
        let least_bound = bounds[0].min(bounds[1]).min(bounds[2].min(bounds[3]));
        let mut finite = least_bound > 1e-280;
        for (e, b) in edges.iter_mut().zip(&bounds) {
            let f = det.signum() / b;
            *e = e.map(|v| v * f);
            finite &= e[0].is_finite() && e[1].is_finite() && e[2].is_finite();
        }
        let mut kind = cell.kind;
        if !(oriented && finite && cell.key.is_some()) {
            kind |= kind::UNSURE;
            if !finite {
                edges = [[0.0; 3]; 4];
            }
        }
        out.push(Patch {
            edges,
            key: cell.key.unwrap_or([0.0; 3]),
            cell: cell.number,
            isovalue: cell.isovalue,
            kind,
            x: [x0, x1],
            y: [y0, y1],
        });
    }

    /// An edge of the cell, where s = c only on it.
    #[cold]
    #[inline(never)]
    fn segment(&self, cell: &Cell, a: &(Q, f64), b: &(Q, f64), out: &mut Vec<Patch>) {
        let Some((x, y)) = self.pixels(cell, &[*a, *b]) else { return };
        let f = 1.0 / (self.projection.edge_bound(cell.size) * a.1 * b.1);
        let e = cross(&a.0, &b.0).map(|v| v * f);
        let e = if e.iter().all(|v| v.is_finite()) { e } else { [0.0; 3] };
        self.unsure(cell, [e, e.map(|v| -v), e, e], (x, y), out);
    }

    /// A corner of the cell, where s = c only in it.
    #[cold]
    #[inline(never)]
    fn point(&self, cell: &Cell, q: &Q, w: f64, out: &mut Vec<Patch>) {
        let Some(pixels) = self.pixels(cell, &[(*q, w)]) else { return };
        self.unsure(cell, [[0.0; 3]; 4], pixels, out);
    }

    fn unsure(&self, cell: &Cell, edges: [[f64; 3]; 4], (x, y): ([u16; 2], [u16; 2]), out: &mut Vec<Patch>) {
        out.push(Patch {
            edges,
            key: [0.0; 3],
            cell: cell.number,
            isovalue: cell.isovalue,
            kind: cell.kind | kind::UNSURE,
            x,
            y,
        });
    }

    /// Columns and rows of the pixels whose centres may be covered; `None` where there are none, or all is behind the eye.
    #[inline(always)]
    fn pixels<const N: usize>(&self, cell: &Cell, q: &[(Q, f64); N]) -> Option<([u16; 2], [u16; 2])> {
        let p = self.projection;
        let [x0, y0] = p.first_pixel();
        let (mut lo, mut hi) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let (mut near, mut behind) = (false, true);
        for (q, w) in q {
            let limit = Projection::NEAR * w * cell.size;
            if p.perspective {
                near |= q[2] <= limit || q[2].is_nan();
                behind &= q[2] < -limit;
            }
            let one = 1.0 / q[2];
            let (x, y) = (q[0] * one - x0, q[1] * one - y0);
            lo = [lo[0].min(x), lo[1].min(y)];
            hi = [hi[0].max(x), hi[1].max(y)];
        }
        let (w, h) = (p.width as f64 - 1.0, p.height as f64 - 1.0);
        if near {
            return (!behind || !p.perspective).then_some(([0, w as u16], [0, h as u16]));
        }
        let slack = p.pixel_slack(cell.size);
        let (a, b) = (
            [(lo[0] - slack).ceil(), (lo[1] - slack).ceil()],
            [(hi[0] + slack).floor(), (hi[1] + slack).floor()],
        );
        let (a, b) = ([a[0].max(0.0), a[1].max(0.0)], [b[0].min(w), b[1].min(h)]);
        if a[0] > b[0] || a[1] > b[1] {
            return None;
        }
        Some(([a[0] as u16, b[0] as u16], [a[1] as u16, b[1] as u16]))
    }
}

/// Two keys closer than this share of the greater (perspective) or of the key unit (orthographic) are told apart by the hits themselves.
pub(crate) const KEY_TOLERANCE: f64 = 1e-7;

/// Depths of corners are known to this share of their size.
const UNIT_OF_DEPTH: f64 = 1e-12;

/// The corners with s >= c first, by the set of them, where it has two.
const PAIRS: [[usize; 4]; 16] = {
    let none = [0, 1, 2, 3];
    let mut t = [none; 16];
    t[0b0011] = [0, 1, 2, 3];
    t[0b0101] = [0, 2, 1, 3];
    t[0b1001] = [0, 3, 1, 2];
    t[0b0110] = [1, 2, 0, 3];
    t[0b1010] = [1, 3, 0, 2];
    t[0b1100] = [2, 3, 0, 1];
    t
};

/// The corners other than one.
const OTHERS: [[usize; 3]; 4] = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]];
