//! Cells on the screen as four faces: where a ray enters and leaves, and the values there. Sections 2 and 3 of the paper without its
//! triangles: entry, exit and their values are exact per fragment, in perspective as well, where none of them is linear on the screen.
//!
//! With barycentric functions lambda_k(t) = a_k + t b_k on a ray, the cell is where all are at least 0. Perspective: a_k is a constant of the cell (its
//! sign: which side of the face the eye is on) and b_k affine on the screen, so the inverse depth of each face, -b_k/a_k, is too. Orthographic: b_k is the constant and a_k affine, so
//! minus the depth, a_k/b_k, is. Either way the ray enters at the least key of the faces it may enter by and leaves at the greatest of the others: four affine functions per pixel
//! classify, clip and measure at once, for every projection class including all degenerate ones.

use crate::camera::Projection;
use crate::lanes::prefetch;
use crate::mesh::Cells;
use glam::DVec3;
use rayon::prelude::*;

/// A point on the screen of a view: pixels right, pixels down (times depth in perspective), depth; and its value, so that cells find all of a corner in one place.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub(crate) struct Point {
    pub(crate) at: [f64; 3],
    pub(crate) value: f64,
}

/// The points of a mesh on the screen of a view.
#[derive(Debug)]
pub(crate) struct Screen {
    pub(crate) projection: Projection,
    pub(crate) points: Vec<Point>,
    /// Pixel coordinates; NaN near and behind the eye plane.
    pixels: Vec<[f32; 2]>,
}

/// Where in a pixel the medium is looked at: so many pixels right of its centre, and below. Where a face is seen edge-on and a pixel's ray lies in its plane, as they do on lattices seen along an axis, rounding would
/// put the ray into both cells, or neither. Beside the centre it is in one. No ratio of small numbers, so that no usual face runs along it.
type Beside = [f64; 2];

/// Far above the rounding of f64 in an image, and below all that its colours show.
pub(crate) const BESIDE: Beside = [1e-9, 6.180_34e-10];
/// The same for f32 in a block.
pub(crate) const BESIDE_F32: Beside = [6e-5, 3.708_2e-5];

impl Screen {
    /// The points moved so that rays through centres of pixels are those that were `beside` them.
    pub(crate) fn new(mesh: &Cells, projection: Projection, [right, down]: Beside) -> Self {
        let place = |p: DVec3| {
            let [x, y, z] = projection.rows.map(|r| r.dot(p - projection.eye));
            let per = if projection.perspective { z } else { 1.0 };
            [x - right * per, y - down * per, z]
        };
        let points: Vec<Point> = mesh
            .mesh
            .points
            .par_iter()
            .zip(&mesh.mesh.values[..])
            .with_min_len(4096)
            .map(|(&p, &value)| Point {
                at: place(p),
                value: f64::from(value),
            })
            .collect();
        let first = projection.first_pixel();
        let pixels = points
            .par_iter()
            .with_min_len(4096)
            .map(|&Point { at: [x, y, z], .. }| {
                let near = Projection::NEAR * (z.abs() + mesh_scale(x, y, &projection));
                let one = match projection.perspective {
                    false => 1.0,
                    true if z > near => 1.0 / z,
                    true => f64::NAN,
                };
                [(x * one - first[0]) as f32, (y * one - first[1]) as f32]
            })
            .collect();
        Self {
            projection,
            points,
            pixels,
        }
    }

    /// Asks for what [`Self::bounds`] needs of a cell.
    #[inline(always)]
    pub(crate) fn prefetch(&self, cell: &[u32; 4]) {
        for &i in cell {
            prefetch(&self.pixels, i);
        }
    }

    /// First and last column and row of the pixels a cell may cover; `None` without any.
    #[inline(always)]
    pub(crate) fn bounds(&self, cell: &[u32; 4]) -> Option<[i32; 4]> {
        let p = cell.map(|i| self.pixels[i as usize]);
        let (w, h) = (self.projection.width as f32 - 1.0, self.projection.height as f32 - 1.0);
        let sum = p[0][0] + p[1][0] + p[2][0] + p[3][0];
        if sum.is_nan() {
            // Across the eye plane: anywhere, unless all is behind it.
            let ahead = cell.iter().any(|&i| self.points[i as usize].at[2] > 0.0);
            return ahead.then_some([0, w as i32, 0, h as i32]);
        }
        let range = |k: usize, most: f32| {
            let lo = p[0][k].min(p[1][k]).min(p[2][k].min(p[3][k]));
            let hi = p[0][k].max(p[1][k]).max(p[2][k].max(p[3][k]));
            // f32 pixel coordinates: half a unit of their last place and some more.
            let slack = 0.01 + 2e-7 * (lo.abs() + hi.abs());
            ((lo - slack).ceil().max(0.0), (hi + slack).floor().min(most))
        };
        let ((x0, x1), (y0, y1)) = (range(0, w), range(1, h));
        (x0 <= x1 && y0 <= y1).then_some([x0 as i32, x1 as i32, y0 as i32, y1 as i32])
    }

    pub(crate) fn bytes(&self) -> usize {
        self.points.len() * (size_of::<Point>() + 8)
    }
}

/// A length comparable with the depth.
fn mesh_scale(x: f64, y: f64, p: &Projection) -> f64 {
    x.abs() / p.rows[0].length() + y.abs() / p.rows[1].length()
}

/// A cell on the screen. Affine functions are `[a, b, c]`: a x + b y + c of centred pixel coordinates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CellOnScreen {
    /// Keys of the faces rays enter by, then of those they leave by.
    pub(crate) keys: [[f64; 3]; 4],
    /// The corners opposite those faces.
    pub(crate) faces: [u8; 4],
    /// How many of them rays enter by.
    pub(crate) entries: usize,
    /// The value at depth t is start + t rise.
    pub(crate) start: [f64; 3],
    pub(crate) rise: [f64; 3],
}

type V3 = [f64; 3];

#[inline(always)]
fn minus(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn cross(a: V3, b: V3) -> V3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl CellOnScreen {
    /// A cell of positive volume by its points on the screen and their values.
    #[inline(always)]
    pub(crate) fn new(perspective: bool, h: &[V3; 4], s: &[f64; 4]) -> Self {
        let (a, b, d) = (minus(h[1], h[0]), minus(h[2], h[0]), minus(h[3], h[0]));
        let (n1, n2, n3) = (cross(b, d), cross(d, a), cross(a, b));
        let n0: V3 = std::array::from_fn(|i| -(n1[i] + n2[i] + n3[i]));
        let volume = dot(a, n1);
        let (l1, l2, l3) = (-dot(n1, h[0]), -dot(n2, h[0]), -dot(n3, h[0]));
        // Value at the eye (or on the plane of rays' starts at the image's centre), of the inward function of each face.
        let at = [volume - l1 - l2 - l3, l1, l2, l3];
        let normals = [n0, n1, n2, n3];
        let mut out = Self {
            keys: [[0.0; 3]; 4],
            faces: [0; 4],
            entries: 0,
            start: [0.0; 3],
            rise: [0.0; 3],
        };
        let mut exits = 4;
        for k in 0..4 {
            let n = normals[k];
            // A face seen exactly edge-on only limits: as an exit at once outside and never inside. Rays in its plane, which it would not limit, are none: see [`BESIDE`].
            let (fixed, enters, key): (f64, bool, V3) = if perspective {
                (at[k], at[k] < 0.0, [-n[0], -n[1], -n[2]])
            } else {
                (n[2], n[2] > 0.0, [n[0], n[1], at[k]])
            };
            let fixed = if fixed == 0.0 {
                let tiny = 1e-30 * volume.abs();
                if perspective { tiny } else { -tiny }
            } else {
                fixed
            };
            let one = 1.0 / fixed;
            let key = key.map(|v| v * one);
            let place = if enters {
                out.entries += 1;
                out.entries - 1
            } else {
                exits -= 1;
                exits
            };
            out.keys[place] = key;
            out.faces[place] = k as u8;
        }
        let one = 1.0 / volume;
        let (s1, s2, s3) = ((s[1] - s[0]) * one, (s[2] - s[0]) * one, (s[3] - s[0]) * one);
        let g: V3 = std::array::from_fn(|i| n1[i] * s1 + n2[i] * s2 + n3[i] * s3);
        let constant = s[0] - dot(g, h[0]);
        if perspective {
            (out.start, out.rise) = ([0.0, 0.0, constant], g);
        } else {
            (out.start, out.rise) = ([g[0], g[1], constant], [0.0, 0.0, g[2]]);
        }
        out
    }

    /// Where rows of the image may meet the cell; `reach` is at least |x| and |y| of centred pixel coordinates.
    #[inline(always)]
    pub(crate) fn spans(&self, reach: [f64; 2]) -> Spans {
        let mut out = Spans {
            lo: [[0.0; 4], [f64::NEG_INFINITY; 4]],
            hi: [[0.0; 4], [f64::INFINITY; 4]],
        };
        let size = |k: &V3| k[0].abs() * reach[0] + k[1].abs() * reach[1] + k[2].abs();
        let mut n = 0;
        for e in &self.keys[..self.entries] {
            for x in &self.keys[self.entries..] {
                // Inside, the key of each entry is above that of each exit.
                let d = minus(*e, *x);
                let one = 1.0 / d[0];
                let (slope, constant) = (-d[1] * one, -d[2] * one);
                // Well above the rounding of both keys.
                let margin = 1e-3 + 1e-14 * (size(e) + size(x)) * one.abs();
                if margin < 1e300 && slope.abs() < 1e300 && constant.abs() < 1e300 {
                    let (side, sign) = if d[0] > 0.0 { (&mut out.lo, -1.0) } else { (&mut out.hi, 1.0) };
                    side[0][n & 3] = slope;
                    side[1][n & 3] = constant + sign * margin;
                }
                n += 1;
            }
        }
        out
    }

    /// Depth of entry and exit at centred pixel coordinates with the corners opposite the faces; `None` where the ray passes by. The entry has no
    /// face where the ray starts inside.
    pub(crate) fn stay(&self, perspective: bool, x: f64, y: f64) -> Option<Stay> {
        let key = |k: usize| self.keys[k][0] * x + (self.keys[k][1] * y + self.keys[k][2]);
        let mut entry = (if perspective { f64::INFINITY } else { 0.0 }, None);
        let mut exit = (f64::NEG_INFINITY, 0);
        for k in 0..4 {
            let v = key(k);
            if k < self.entries {
                if v < entry.0 {
                    entry = (v, Some(self.faces[k]));
                }
            } else if v > exit.0 {
                exit = (v, self.faces[k]);
            }
        }
        let depth = |key: f64| if perspective { 1.0 / key } else { -key };
        (exit.0 < entry.0 && (!perspective || entry.0 > 0.0)).then(|| Stay {
            from: depth(entry.0),
            to: depth(exit.0),
            entry: entry.1,
            exit: exit.1,
        })
    }
}

/// The columns between which a row may meet a cell: greatest and least of affine functions of the row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spans {
    /// Slopes and constants.
    lo: [[f64; 4]; 2],
    hi: [[f64; 4]; 2],
}

impl Spans {
    /// First and last column, of `from..=to`, of the row at centred coordinate y; columns are counted from centred coordinate `first`. The last is below the first where there is none.
    #[inline(always)]
    pub(crate) fn columns(&self, y: f64, first: f64, from: usize, to: usize) -> (usize, usize) {
        let at = |[slopes, constants]: &[[f64; 4]; 2]| -> [f64; 4] { std::array::from_fn(|k| slopes[k] * y + constants[k]) };
        let (lo, hi) = (at(&self.lo), at(&self.hi));
        let more = |a: f64, b: f64| if a > b { a } else { b };
        let less = |a: f64, b: f64| if a < b { a } else { b };
        let (lo, hi) = (
            more(more(lo[0], lo[1]), more(lo[2], lo[3])),
            less(less(hi[0], hi[1]), less(hi[2], hi[3])),
        );
        // Casts saturate; what is beyond the image is clipped.
        let (lo, hi) = ((lo - first).ceil() as i32, (hi - first).floor() as i32);
        (lo.max(from as i32) as usize, hi.clamp(-1, to as i32) as usize)
    }
}

/// A ray's stay in a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stay {
    pub(crate) from: f64,
    pub(crate) to: f64,
    pub(crate) entry: Option<u8>,
    pub(crate) exit: u8,
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Camera, TetMesh, View};

    fn screen(points: &[DVec3], camera: Camera) -> (Cells, Screen) {
        let mesh = TetMesh::new(points.into(), vec![[0, 1, 2, 3]].into(), vec![0.0, 0.0, 0.0, 1.0].into()).unwrap();
        let cells = Cells::new(&mesh).unwrap();
        let view = View {
            camera,
            width: 9,
            height: 9,
            clips: vec![],
        };
        let s = Screen::new(&cells, Projection::new(&view).unwrap(), [0.0; 2]);
        (cells, s)
    }

    /// hardcases E8: thickness 1/2 at (1/4, 1/4), values 1/2 and 0.
    #[test]
    fn the_unit_cell() {
        let camera = Camera::Orthographic {
            eye: DVec3::new(0.25, 0.25, 3.0),
            target: DVec3::new(0.25, 0.25, 0.0),
            up: DVec3::Y,
            height: 2.0,
        };
        let (cells, s) = screen(&[DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z], camera);
        let h = cells.cells[0].map(|i| s.points[i as usize].at);
        let c = CellOnScreen::new(false, &h, &cells.values(0));
        let stay = c.stay(false, 0.0, 0.0).unwrap();
        assert!((stay.to - stay.from - 0.5).abs() < 1e-15 && (stay.from - 2.5).abs() < 1e-15);
        assert!((c.start[2] + stay.from * c.rise[2] - 0.5).abs() < 1e-15 && (c.start[2] + stay.to * c.rise[2]).abs() < 1e-15);
        assert_eq!((c.entries, stay.entry, stay.exit), (1, Some(0), 3));
    }

    /// hardcases E8: all projection classes, also seen along edges and faces: the stay is that of clipping by the four planes one by one.
    #[test]
    fn all_classes_and_degenerate_views() {
        let tets = [
            [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
            [
                DVec3::new(-1.0, -1.0, 0.0),
                DVec3::new(1.0, -1.0, 0.0),
                DVec3::new(0.0, 1.0, 0.0),
                DVec3::new(0.0, 0.0, 1.0),
            ],
            [
                DVec3::new(-1.0, 0.0, 0.0),
                DVec3::new(1.0, 0.0, 0.0),
                DVec3::new(0.0, -1.0, 1.0),
                DVec3::new(0.0, 1.0, 1.0),
            ],
        ];
        let eyes = [
            DVec3::Z,
            -DVec3::Z,
            DVec3::X,
            DVec3::Y,
            DVec3::new(1.0, 1.0, 0.0),
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(0.3, 0.2, 0.9),
        ];
        let mut classes = [0; 5];
        for points in tets {
            for eye in eyes {
                for perspective in [false, true] {
                    let target = points.iter().sum::<DVec3>() * 0.25;
                    let (eye, up) = (target + eye * 4.0, DVec3::new(0.1, 0.2, 0.3));
                    let camera = if perspective {
                        Camera::Perspective {
                            eye,
                            target,
                            up,
                            fov: 30.0,
                        }
                    } else {
                        Camera::Orthographic {
                            eye,
                            target,
                            up,
                            height: 2.5,
                        }
                    };
                    let (cells, s) = screen(&points, camera.clone());
                    let h = cells.cells[0].map(|i| s.points[i as usize].at);
                    let c = CellOnScreen::new(perspective, &h, &cells.values(0));
                    classes[c.entries] += 1;
                    let view = View {
                        camera,
                        width: 9,
                        height: 9,
                        clips: vec![],
                    };
                    for (x, y) in (0..9).flat_map(|y| (0..9).map(move |x| (x, y))) {
                        let ray = view.ray(x, y);
                        let p = cells.corners(0);
                        let (mut from, mut to, mut misses) = (0.0f64, f64::INFINITY, false);
                        for f in crate::topology::FACES {
                            let n = (p[f[1]] - p[f[0]]).cross(p[f[2]] - p[f[0]]);
                            let (a, b) = (n.dot(p[f[0]] - ray.origin), n.dot(ray.direction));
                            if b.abs() < 1e-12 {
                                misses |= a < 0.0;
                            } else if b < 0.0 {
                                from = from.max(a / b);
                            } else {
                                to = to.min(a / b);
                            }
                        }
                        let (px, py) = (x as f64 - 4.0, y as f64 - 4.0);
                        let along = ray.direction.dot(s.projection.rows[2]);
                        let want = if misses { 0.0 } else { (to - from).max(0.0) };
                        let found = c.stay(perspective, px, py).map_or(0.0, |v| (v.to - v.from) / along);
                        assert!(
                            (want - found).abs() < 1e-9,
                            "{points:?} {eye} {perspective} ({x}, {y}): {found} not {want}"
                        );
                        if want > 1e-6 {
                            let (from, to) = c.spans([4.5; 2]).columns(py, -4.0, 0, 8);
                            assert!(
                                (from..=to).contains(&x),
                                "{points:?} {eye} {perspective} ({x}, {y}): {from} to {to}"
                            );
                            let b = s.bounds(&cells.cells[0]).unwrap();
                            assert!((b[0]..=b[1]).contains(&(x as i32)) && (b[2]..=b[3]).contains(&(y as i32)));
                        }
                    }
                }
            }
        }
        assert!(classes[1] > 3 && classes[2] > 3 && classes[3] > 3, "{classes:?}");
    }
}
