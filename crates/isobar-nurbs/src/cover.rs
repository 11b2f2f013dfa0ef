//! Pixels whose square meets the surface although the ray through their centre does not: the paper's intersections of type 3 (section 3, figure 8).
//!
//! The paper solves Q = (gamma, delta, eta) = 0 for points of the silhouette inside the pixel (equations 18 to 20, section 4.1.2). That is incomplete (maths, section C: the
//! silhouette's nearest point may lie outside the square, and edges of the surface on the domain's boundary are no silhouettes), so here the frustum itself is searched, by the
//! guaranteed test of maths, section C: a piece is dropped where one of `h D +- alpha`, `h D +- beta` (h half a pixel) has no coefficient that is not negative, or gamma has one
//! sign; the pixel is **covered** where all four forms are positive on a piece and gamma has both signs at its corners, for then the surface passes through
//! the piece by continuity; else the piece is halved. Pieces of the smallest size decide nothing: COVERED is claimed only where it is proved.

use crate::bernstein::{count, cut, range};
use crate::frustum::{EPS, Frustum, PixelBox};
use crate::solve::{Constants, Piece, Solver, Task, project};
use isobar_core::HexElement;

/// Halvings of a piece in all, at most: from an element over the whole image to parts of a pixel.
const DEEPEST: u8 = 14;
/// Pieces of one surface of one element in one tile, at most.
const MOST_PIECES: u32 = 1 << 14;
/// Where an axis is cut first: no simple fraction.
const OFF_CENTRE: f64 = 0.473_125_7;

impl Solver {
    /// Marks in `covered` the pixels, of those still false in `settled`, that the surface of a task certainly passes through. `wide` is the frustum with its columns and rows
    /// widened by half a pixel ([`Frustum::widened`]). `errors`: of the element's points and values, where these are themselves rounded.
    #[inline(always)]
    pub(crate) fn cover(
        &mut self,
        wide: &Frustum,
        element: &HexElement,
        task: &Task,
        errors: [f64; 2],
        settled: &mut [bool],
        covered: &mut [bool],
    ) {
        let Some(k) = self.load(wide, element, task) else { return };
        if let Some(whole) = self.stack.last_mut() {
            let roundings = |error: f64, size: f64| error / (EPS * size.max(f64::MIN_POSITIVE));
            whole.geometry += roundings(errors[0], k.scale);
            whole.attribute += roundings(errors[1], k.gamma);
        }
        let mut budget = MOST_PIECES;
        while let Some(piece) = self.stack.pop() {
            if budget == 0 {
                self.stack.clear();
                return;
            }
            budget -= 1;
            if let Some((piece, axis)) = self.cover_step(wide, &k, piece, settled, covered) {
                if piece.depth[axis] == 0 {
                    self.cut_off_centre(&k, piece, axis);
                } else {
                    self.split(&k, piece, axis);
                }
            } else {
                self.drop_piece(&k);
            }
        }
    }

    /// The first cut along an axis: surfaces at simple fractions of the parameters would else lie on the faces of pieces for ever, where gamma has no sign on either side.
    #[inline(always)]
    fn cut_off_centre(&mut self, k: &Constants, mut piece: Piece, axis: usize) {
        self.work.halvings += 1;
        let (n, m) = (count(k.g), count(k.h));
        let (at, av) = (self.points.len(), self.values.len());
        self.points.resize(at + n, [0.0; 4]);
        self.values.resize(av + m, 0.0);
        let (upper, lower) = self.points[at - n..].split_at_mut(n);
        cut(k.g, axis, OFF_CENTRE, upper, lower);
        let (upper, lower) = self.values[av - m..].split_at_mut(m);
        cut(k.h, axis, OFF_CENTRE, upper, lower);
        piece.geometry += 3.0 * k.g[axis] as f64;
        piece.attribute += 3.0 * k.h[axis] as f64;
        piece.depth[axis] += 1;
        self.stack.extend([piece; 2]);
    }

    /// Decides a piece, or says how to halve it.
    #[inline(always)]
    fn cover_step(
        &mut self,
        wide: &Frustum,
        k: &Constants,
        mut piece: Piece,
        settled: &mut [bool],
        covered: &mut [bool],
    ) -> Option<(Piece, usize)> {
        let (np, nv) = (self.points.len() - count(k.g), self.values.len() - count(k.h));
        let (points, values) = (&self.points[np..], &self.values[nv..]);
        let k = &k.of_piece(points);
        let noise = EPS * k.gamma * piece.attribute;
        let (lo, hi) = range(values);
        if lo > noise || hi < -noise {
            return None;
        }
        piece.pixels = project(wide, k, &piece, points)?;
        let b = piece.pixels;
        let mut open: Option<PixelBox> = None;
        // Corners of gamma: what continuity needs.
        let n = k.h.map(|d| d + 1);
        let corner = |c: usize| {
            let at = [0, 1, 2].map(|a| if c >> a & 1 == 0 { 0 } else { n[a] - 1 });
            values[(at[2] * n[1] + at[1]) * n[0] + at[0]]
        };
        let crosses = (0..8).any(|c| corner(c) > noise) && (0..8).any(|c| corner(c) < -noise);
        let rough = EPS * piece.geometry * k.scale * (2.0 + wide.reach) + wide.slope_error * k.scale;
        let few = b.pixels() <= 16;
        for y in b.y0..=b.y1 {
            for x in b.x0..=b.x1 {
                let pixel = usize::from(y) * wide.width + usize::from(x);
                if settled[pixel] {
                    continue;
                }
                if few && crosses {
                    let [s, r] = wide.rays[pixel].slope;
                    let inside = points.iter().all(|p| {
                        let d = p[k.lane];
                        let room = wide.half * d - rough;
                        (p[0] - s * d).abs() < room && (p[1] - r * d).abs() < room && p[2] > rough
                    });
                    if inside {
                        (settled[pixel], covered[pixel]) = (true, true);
                        continue;
                    }
                }
                open = Some(PixelBox::with(open, x, y));
            }
        }
        piece.pixels = open?;
        let axis = (0..3).min_by_key(|&a| piece.depth[a])?;
        (piece.depth[axis] < DEEPEST).then_some((piece, axis))
    }
}

#[cfg(test)]
mod tests {
    use crate::NURBS_CPU;
    use crate::tests::request;
    use isobar_core::{Algebraic, Camera, Claim, ClipPlane, DVec3, Data, Frame, Method, Sampling, Stop, Surface, View};
    use std::sync::Arc;

    /// Hardcases D6: a sphere of radius 0.2 pixels about a corner of four pixels.
    #[test]
    fn d6_a_sphere_between_the_centres() {
        let r = 0.2 * 2.0 / 512.0;
        let terms = [([2, 0, 0], 1.0), ([0, 2, 0], 1.0), ([0, 0, 2], 1.0)];
        let sphere = Algebraic::new("sphere", terms, DVec3::splat(-0.05), DVec3::splat(0.05)).unwrap();
        let view = View {
            camera: Camera::Orthographic {
                eye: DVec3::new(0.0, -3.0, 0.0),
                target: DVec3::ZERO,
                up: DVec3::Z,
                height: 2.0,
            },
            width: 512,
            height: 512,
            clips: vec![],
        };
        let mut q = request(1);
        q.sampling = Sampling::PixelFrustum;
        let mut renderer = NURBS_CPU.open(&q).unwrap();
        renderer.set_data(&Arc::new(Data::Algebraic(sphere))).unwrap();
        renderer.set_surfaces(&[Surface::isovalue(r * r, 0)]).unwrap();
        renderer.set_view(&view).unwrap();
        renderer.render(&Stop::default()).unwrap();
        let mut f = Frame::default();
        renderer.read(&mut f).unwrap();
        assert!(f.hits.iter().all(|&h| h == 0) && f.t.iter().all(|t| *t == f64::INFINITY));
        let covered: Vec<_> = (0..512 * 512)
            .filter(|&i| f.claim[i].contains(Claim::COVERED))
            .map(|i| (i % 512, i / 512))
            .collect();
        assert_eq!(covered, [(255, 255), (256, 255), (255, 256), (256, 256)]);
        assert!(f.claim.iter().all(|c| c.contains(Claim::EMPTY)));
        // A plane that cuts the sphere away: of its pixels nothing is claimed.
        let clips = vec![ClipPlane {
            normal: DVec3::Y,
            distance: -1.0,
            cap: false,
        }];
        renderer.set_view(&View { clips, ..view }).unwrap();
        renderer.render(&Stop::default()).unwrap();
        renderer.read(&mut f).unwrap();
        assert!(f.claim.iter().all(|c| !c.contains(Claim::COVERED)));
    }
}
