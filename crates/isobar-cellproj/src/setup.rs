//! Cells of a block as affine functions of its pixels in f32, set up eight at a time in f64: what [`crate::cells`] says of one cell.
//!
//! **Keys** are without a unit and relative to the scene, so that f32 has them as well far away: with D the depth of the farthest corner of the mesh's bounds they are D/z - 1 in
//! perspective, else (D - z)/U with D the middle depth of the bounds and U half their extent in depth. Greater is nearer. A cell's keys count from a *base* of its own, the key of the mean depth of its corners:
//! small cells in large meshes have them as exactly. Pixels count from the block's first one.
//!
//! **Values** are in nodes of the table. At the key k above the base B a ray's value is S + w E, where S, the value at the base, is affine on the screen, E = k/(1 + B + k) and w = (value at the eye) - S in
//! perspective, E = k and w a constant of the cell otherwise. A cell that reaches behind the eye has base 0.
//!
//! **Faces seen edge-on.** Keys above 1e9 in the block are held there, as if the face were turned by less than 1e-7 pixels: none is lost, and f32 keeps its range.

use crate::blocks::{Entry, SIDE};
use crate::camera::Projection;
use crate::cells::Point;
use crate::lanes::LANES;
use glam::DVec3;
use isobar_cpu::packet::{Lanes, WithLanes};

/// Cells gathered together.
pub(crate) const BATCH: usize = 32;
/// The greatest key of a face.
const MOST: f64 = 1e9;

/// What keys and values are measured in.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Units {
    pub(crate) perspective: bool,
    /// D.
    pub(crate) depth: f64,
    /// U; D in perspective.
    pub(crate) unit: f64,
    /// The value of the first node, and nodes per value.
    from: f64,
    per: f64,
}

impl Units {
    /// `axis`: the value of the table's first node, and nodes per value.
    pub(crate) fn new(p: &Projection, bounds: (DVec3, DVec3), (from, per): (f64, f64)) -> Self {
        let corner = |n: usize| {
            let pick = |bit: usize, a: f64, b: f64| if n >> bit & 1 == 0 { a } else { b };
            DVec3::new(
                pick(0, bounds.0.x, bounds.1.x),
                pick(1, bounds.0.y, bounds.1.y),
                pick(2, bounds.0.z, bounds.1.z),
            )
        };
        let (mut near, mut far) = (f64::INFINITY, f64::NEG_INFINITY);
        for depth in (0..8).map(|n| p.depth(corner(n))) {
            (near, far) = (near.min(depth), far.max(depth));
        }
        let (depth, unit) = if p.perspective {
            // Behind the eye nothing is drawn, whatever the unit.
            (far.max(f64::MIN_POSITIVE), far.max(f64::MIN_POSITIVE))
        } else {
            (0.5 * (near + far), (0.5 * (far - near)).max(f64::MIN_POSITIVE))
        };
        Self {
            perspective: p.perspective,
            depth,
            unit,
            from,
            per,
        }
    }

    /// The key of a depth.
    pub(crate) fn key(&self, depth: f64) -> f32 {
        let key = if self.perspective {
            self.depth / depth - 1.0
        } else {
            (self.depth - depth) / self.unit
        };
        key as f32
    }

    /// The key of where rays start.
    pub(crate) fn start(&self) -> f32 {
        if self.perspective { 1e18 } else { self.key(0.0) }
    }

    /// A key behind everything.
    pub(crate) fn behind(&self) -> f32 {
        // Of depths no greater than D, or between D - U and D + U.
        if self.perspective { -0.5 } else { -2.0 }
    }
}

/// A cell ready to be drawn. Lanes 0 to 3 are the keys of its faces, those rays enter by first; lane 4 is S.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(32))]
pub(crate) struct Flat {
    /// Per column, per row, and at the block's first pixel.
    pub(crate) a: [f32; LANES],
    pub(crate) b: [f32; LANES],
    pub(crate) c: [f32; LANES],
    /// The key from which keys count.
    pub(crate) base: f32,
    /// The value at the eye, or w.
    pub(crate) eye: f32,
    /// Least and greatest value.
    pub(crate) least: f32,
    pub(crate) most: f32,
    /// Faces rays enter by.
    pub(crate) entries: u8,
    pub(crate) entry: Entry,
}

/// Corners of cells, gathered: of each eight cells x, y, depth and value of corner 0, and so on.
pub(crate) type Corners = [[[f64; LANES]; 16]; BATCH / LANES];

/// Puts the corners of a cell into their place.
#[inline(always)]
pub(crate) fn gather(to: &mut Corners, n: usize, points: &[Point], cell: &[u32; 4]) {
    let (group, lane) = (&mut to[n / LANES % (BATCH / LANES)], n % LANES);
    for (i, &corner) in cell.iter().enumerate() {
        let p = &points[corner as usize];
        for k in 0..3 {
            group[4 * i + k][lane] = p.at[k];
        }
        group[4 * i + 3][lane] = p.value;
    }
}

/// Where face k goes, by the set of faces that rays enter by.
const PLACES: [[u8; 4]; 16] = {
    let mut t = [[0; 4]; 16];
    let mut set = 0;
    while set < 16 {
        let (mut entries, mut exits, mut k) = (0, 4, 0);
        while k < 4 {
            if set >> k & 1 == 1 {
                t[set][k] = entries;
                entries += 1;
            } else {
                exits -= 1;
                t[set][k] = exits;
            }
            k += 1;
        }
        set += 1;
    }
    t
};

/// Sets up the cells gathered.
pub(crate) struct SetUp<'a> {
    pub(crate) units: &'a Units,
    /// Centred coordinates of the block's first pixel.
    pub(crate) corner: [f64; 2],
    pub(crate) corners: &'a Corners,
    pub(crate) entries: &'a [Entry],
    pub(crate) out: &'a mut [Flat; BATCH],
}

type V3<S> = [S; 3];

#[inline(always)]
fn minus<S: Lanes>(a: V3<S>, b: V3<S>) -> V3<S> {
    [a[0].sub(b[0]), a[1].sub(b[1]), a[2].sub(b[2])]
}

#[inline(always)]
fn cross<S: Lanes>(a: V3<S>, b: V3<S>) -> V3<S> {
    [
        a[1].mul(b[2]).sub(a[2].mul(b[1])),
        a[2].mul(b[0]).sub(a[0].mul(b[2])),
        a[0].mul(b[1]).sub(a[1].mul(b[0])),
    ]
}

#[inline(always)]
fn dot<S: Lanes>(a: V3<S>, b: V3<S>) -> S {
    a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
}

#[inline(always)]
fn point<S: Lanes>(at: &[[f64; LANES]; 16], i: usize) -> V3<S> {
    [S::load(&at[4 * i]), S::load(&at[4 * i + 1]), S::load(&at[4 * i + 2])]
}

/// Affine functions and constants of eight cells.
struct Eights {
    /// Of the four keys and S: a, b, c.
    affine: [[[f64; LANES]; 3]; 5],
    /// Base, eye, least, most.
    values: [[f64; LANES]; 4],
    /// Lanes in which rays enter by each face.
    enters: [u8; 4],
}

impl WithLanes for SetUp<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self) {
        for (g, entries) in self.entries.chunks(LANES).enumerate() {
            let eights = self.eight::<S>(&self.corners[g]);
            for (l, &entry) in entries.iter().enumerate() {
                let set = (0..4).fold(0, |s, k| s | (usize::from(eights.enters[k] >> l & 1) << k));
                let flat = &mut self.out[g * LANES + l];
                for ([a, b, c], &place) in eights.affine.iter().zip(&PLACES[set]) {
                    let place = usize::from(place) % LANES;
                    (flat.a[place], flat.b[place], flat.c[place]) = (a[l] as f32, b[l] as f32, c[l] as f32);
                }
                let [a, b, c] = &eights.affine[4];
                (flat.a[4], flat.b[4], flat.c[4]) = (a[l] as f32, b[l] as f32, c[l] as f32);
                let [base, eye, least, most] = &eights.values;
                (flat.base, flat.eye) = (base[l] as f32, eye[l] as f32);
                (flat.least, flat.most) = (least[l] as f32, most[l] as f32);
                flat.entries = set.count_ones() as u8;
                flat.entry = entry;
            }
        }
    }
}

impl SetUp<'_> {
    #[inline(always)]
    fn eight<S: Lanes>(&self, at: &[[f64; LANES]; 16]) -> Eights {
        let (u, perspective) = (self.units, self.units.perspective);
        let (h0, from, per) = (point::<S>(at, 0), S::splat(u.from), S::splat(u.per));
        let mut s = [from; 4];
        for (i, s) in s.iter_mut().enumerate() {
            *s = S::load(&at[4 * i + 3]).sub(from).mul(per);
        }
        let (a, b, d) = (minus(point(at, 1), h0), minus(point(at, 2), h0), minus(point(at, 3), h0));
        let (n1, n2, n3) = (cross(b, d), cross(d, a), cross(a, b));
        let zero = S::splat(0.0);
        let mut n0 = [zero; 3];
        for (i, n) in n0.iter_mut().enumerate() {
            *n = zero.sub(n1[i].add(n2[i]).add(n3[i]));
        }
        let volume = dot(a, n1);
        let (l1, l2, l3) = (zero.sub(dot(n1, h0)), zero.sub(dot(n2, h0)), zero.sub(dot(n3, h0)));
        let inward = [volume.sub(l1).sub(l2).sub(l3), l1, l2, l3];
        let normals = [n0, n1, n2, n3];
        let (ox, oy) = (S::splat(self.corner[0]), S::splat(self.corner[1]));
        let scale = S::splat(if perspective { u.depth } else { 1.0 / u.unit });
        let zero_depth = S::splat(u.depth);
        let z = [
            point::<S>(at, 0)[2],
            point::<S>(at, 1)[2],
            point::<S>(at, 2)[2],
            point::<S>(at, 3)[2],
        ];
        let middle = z[0].add(z[1]).add(z[2].add(z[3])).mul(S::splat(0.25));
        let (middle, offset, base) = if perspective {
            // Not nearer than keys of MOST, nor behind the eye.
            let ahead = z[0].min(z[1]).min(z[2].min(z[3])).above(S::splat(u.depth / MOST));
            let middle = middle.where_or(ahead, zero_depth);
            let near = zero_depth.div(middle);
            (middle, zero.sub(near), near.sub(S::splat(1.0)))
        } else {
            (middle, middle.mul(scale), zero_depth.sub(middle).mul(scale))
        };
        let least = S::splat(if perspective { u.depth / MOST } else { 1.0 / (u.unit * MOST) });
        let side = S::splat(SIDE as f64);
        let mut out = Eights {
            affine: [[[0.0; LANES]; 3]; 5],
            values: [[0.0; LANES]; 4],
            enters: [0; 4],
        };
        for k in 0..4 {
            let n = normals[k];
            let (fixed, rest) = if perspective {
                (zero.sub(inward[k]), n[2])
            } else {
                (n[2], inward[k])
            };
            let first = rest.add(n[0].mul(ox)).add(n[1].mul(oy));
            let enters = fixed.above(zero);
            let size = n[0].abs().add(n[1].abs()).mul(side).add(first.abs());
            let one = scale.div(fixed.abs().max(size.mul(least)));
            let one = one.where_or(enters, zero.sub(one));
            n[0].mul(one).store(&mut out.affine[k][0]);
            n[1].mul(one).store(&mut out.affine[k][1]);
            first.mul(one).add(offset).store(&mut out.affine[k][2]);
            out.enters[k] = enters;
        }
        let one = S::splat(1.0).div(volume);
        let rises = [s[1].sub(s[0]).mul(one), s[2].sub(s[0]).mul(one), s[3].sub(s[0]).mul(one)];
        let mut g = [zero; 3];
        for (i, g) in g.iter_mut().enumerate() {
            *g = n1[i].mul(rises[0]).add(n2[i].mul(rises[1])).add(n3[i].mul(rises[2]));
        }
        let [sa, sb, sc] = &mut out.affine[4];
        // From corner 0 to the first pixel's ray at the base.
        let (along, rise) = if perspective {
            (middle, s[0].sub(dot(g, h0)))
        } else {
            (S::splat(1.0), zero.sub(g[2].mul(S::splat(u.unit))))
        };
        let to = [ox.mul(along).sub(h0[0]), oy.mul(along).sub(h0[1]), middle.sub(h0[2])];
        g[0].mul(along).store(sa);
        g[1].mul(along).store(sb);
        s[0].add(dot(g, to)).store(sc);
        base.store(&mut out.values[0]);
        rise.store(&mut out.values[1]);
        s[0].min(s[1]).min(s[2].min(s[3])).store(&mut out.values[2]);
        s[0].max(s[1]).max(s[2].max(s[3])).store(&mut out.values[3]);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cells::{CellOnScreen, Screen};
    use crate::mesh::Cells;
    use isobar_core::{Camera, TetMesh, View};
    use isobar_cpu::Level;

    /// Keys and values are those of [`CellOnScreen`], which has them in f64 and other units; near, and a million mesh sizes away.
    #[test]
    fn cells_are_those_of_f64() {
        let mut seed = 7u64;
        let mut next = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as f64 / (1u64 << 31) as f64 * 2.0 - 1.0
        };
        for away in [0.0, 1e6] {
            for perspective in [false, true] {
                let points: Vec<DVec3> = (0..4 * 24).map(|_| DVec3::new(next(), next(), next())).collect();
                let values: Vec<f32> = (0..4 * 24).map(|_| next() as f32 * 3.0).collect();
                let tets: Vec<[u32; 4]> = (0..24).map(|i| [4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3]).collect();
                let cells = Cells::new(&TetMesh::new(points.into(), tets.into(), values.into()).unwrap()).unwrap();
                let (eye, target, up) = (DVec3::new(0.3, -0.4, 4.0 + away), DVec3::ZERO, DVec3::Y);
                let camera = if perspective {
                    let fov = 2.0 * (2.0 / (4.0 + away)).atan().to_degrees();
                    Camera::Perspective { eye, target, up, fov }
                } else {
                    Camera::Orthographic {
                        eye,
                        target,
                        up,
                        height: 4.0,
                    }
                };
                let (width, height) = (64, 48);
                let view = View {
                    camera,
                    width,
                    height,
                    clips: vec![],
                };
                let screen = Screen::new(&cells, Projection::new(&view).unwrap(), [0.0; 2]);
                let (from, per) = (-3.0, 255.0 / 6.0);
                let units = Units::new(&screen.projection, cells.bounds, (from, per));
                let first = screen.projection.first_pixel();
                let corner = [first[0] + 32.0, first[1]];
                let mut corners = [[[0.0; LANES]; 16]; BATCH / LANES];
                let entries: Vec<Entry> = (0..24)
                    .map(|cell| Entry {
                        cell,
                        x: [0, 31],
                        y: [0, 31],
                    })
                    .collect();
                for (n, e) in entries.iter().enumerate() {
                    gather(&mut corners, n, &screen.points, &cells.cells[e.cell as usize]);
                }
                let mut out = [Flat::default(); BATCH];
                isobar_cpu::packet::run(
                    Level::detect(),
                    SetUp {
                        units: &units,
                        corner,
                        corners: &corners,
                        entries: &entries,
                        out: &mut out,
                    },
                );
                let mut stays = 0;
                for flat in &out[..24] {
                    let cell = flat.entry.cell;
                    let c = CellOnScreen::new(
                        perspective,
                        &cells.cells[cell as usize].map(|i| screen.points[i as usize].at),
                        &cells.values(cell),
                    );
                    assert_eq!(usize::from(flat.entries), c.entries);
                    for (x, y) in (0..48).flat_map(|y| (0..32).map(move |x| (x, y))) {
                        let (px, py) = (corner[0] + f64::from(x), corner[1] + f64::from(y));
                        let Some(stay) = c.stay(perspective, px, py) else { continue };
                        let at = |k: usize| flat.a[k] * x as f32 + flat.b[k] * y as f32 + flat.c[k];
                        let entry = (0..c.entries).map(at).fold(units.start() - flat.base, f32::min);
                        let exit = (c.entries..4).map(at).fold(units.behind() - flat.base, f32::max);
                        for (key, depth) in [(entry, stay.from), (exit, stay.to)] {
                            // A steep face's key is off by the rounding of where the pixel lies.
                            let steep = (0..4).map(|k| flat.a[k].abs() + flat.b[k].abs()).fold(0.0, f32::max);
                            let error = (flat.base + key - units.key(depth)).abs();
                            let scale = if perspective { 1.0 / (4.0 + away as f32) } else { 1.0 };
                            assert!(
                                error <= 1e-5 * (scale + steep),
                                "{away} {perspective} {cell}: {key} {depth} {error}"
                            );
                            let e = if perspective { key / (1.0 + flat.base + key) } else { key };
                            let w = if perspective { flat.eye - at(4) } else { flat.eye };
                            let value = (at(4) + e * w).clamp(flat.least, flat.most);
                            let g = c.start[0] * px
                                + c.start[1] * py
                                + c.start[2]
                                + depth * (c.rise[0] * px + c.rise[1] * py + c.rise[2]);
                            let want = ((g - from) * per) as f32;
                            let slope = (flat.eye - at(4)).abs();
                            assert!(
                                (value - want).abs() <= 1e-3 + 1e-5 * (scale + steep) * slope,
                                "{value} {want}"
                            );
                        }
                        stays += 1;
                    }
                }
                assert!(stays > 500, "{stays}");
            }
        }
    }
}
