//! Where only the first hit is wanted: how far along its ray a pixel is still searched.
//!
//! A root that certainly exists, on a surface that nothing is seen through, ends its pixel at the far end of its enclosure. Roots behind that change neither the frame nor what is claimed of the first one, so pieces,
//! cells and elements that lie behind the ends of all their pixels are dropped; what is nearest is looked at first, to have the ends early.

use crate::frustum::{EPS, Frustum, PixelBox, PixelRay};
use crate::solve::Found;

/// Per pixel the t behind which nothing is wanted.
#[derive(Debug, Default)]
pub(crate) struct Ends {
    /// Per surface whether its hits end a pixel.
    stops: Vec<bool>,
    /// Empty where all hits are wanted.
    t: Vec<f64>,
}

impl Ends {
    /// For the pixels of a frustum; no surface stops where all hits are wanted.
    pub(crate) fn begin(&mut self, stops: &[bool], pixels: usize) {
        self.stops.clear();
        self.t.clear();
        if stops.contains(&true) {
            self.stops.extend_from_slice(stops);
            self.t.resize(pixels, f64::INFINITY);
        }
    }

    /// Whether anything may end early.
    #[inline(always)]
    pub(crate) fn is_on(&self) -> bool {
        !self.t.is_empty()
    }

    /// A root was found.
    #[inline(always)]
    pub(crate) fn note(&mut self, found: &Found) {
        if self.is_on() && found.certain && self.stops[usize::from(found.surface)] && found.t - found.error >= 0.0 {
            let end = &mut self.t[usize::from(found.pixel)];
            *end = end.min(found.t + found.error);
        }
    }

    /// Whether t is behind a pixel's end.
    #[inline(always)]
    pub(crate) fn is_past(&self, pixel: usize, t: f64) -> bool {
        self.is_on() && t > self.t[pixel] * (1.0 + 8.0 * EPS)
    }

    /// Whether all points of a ray at this depth or more are behind its end.
    #[inline(always)]
    fn is_behind(&self, ray: &PixelRay, pixel: usize, depth: f64) -> bool {
        let (a, b) = (self.t[pixel] * ray.rate, ray.start);
        a + b + 8.0 * EPS * (a.abs() + b.abs()) < depth
    }

    /// The pixels of `b` to which something at this depth or more is of interest, as a rectangle.
    #[inline(always)]
    pub(crate) fn open(&self, f: &Frustum, b: PixelBox, depth: f64) -> Option<PixelBox> {
        if !self.is_on() {
            return Some(b);
        }
        let mut out = None;
        for y in b.y0..=b.y1 {
            for x in b.x0..=b.x1 {
                let pixel = usize::from(y) * f.width + usize::from(x);
                if !self.is_behind(&f.rays[pixel], pixel, depth) {
                    out = Some(PixelBox::with(out, x, y));
                }
            }
        }
        out
    }

    /// Whether nothing at this depth or more is of interest to any pixel.
    #[inline(always)]
    pub(crate) fn all_behind(&self, f: &Frustum, depth: f64) -> bool {
        self.is_on() && f.rays.iter().enumerate().all(|(i, r)| self.is_behind(r, i, depth))
    }
}

#[cfg(test)]
mod tests {
    use crate::tests::{hexes, request};
    use crate::{NURBS_CPU, proofs};
    use isobar_core::{Channels, Claim, Counters, DMat3, Data, Frame, HexElement, Knobs, Method, Request, Stop, Surface, View};
    use std::sync::Arc;

    fn draw(data: &Arc<Data>, surfaces: &[Surface], view: &View, all: bool) -> (Frame, Counters) {
        let mut r = NURBS_CPU
            .open(&Request {
                channels: if all {
                    Channels::all()
                } else {
                    Channels::all() - Channels::HITS
                },
                knobs: Knobs::default().with("reconstruction", "cubic"),
                ..request(if all { 4 } else { 1 })
            })
            .unwrap();
        r.set_data(data).unwrap();
        r.set_surfaces(surfaces).unwrap();
        r.set_view(view).unwrap();
        r.render(&Stop::default()).unwrap();
        let mut f = Frame::default();
        r.read(&mut f).unwrap();
        (f, r.counters())
    }

    fn count(c: &Counters, name: &str) -> u64 {
        c.0.iter().find(|c| c.0 == name).unwrap().1
    }

    /// What is drawn and claimed of the first hit is what a frame of all hits has, with less work.
    fn same_first_hits(name: &str, data: &Arc<Data>, surfaces: &[Surface], work: &str) -> f64 {
        let (lo, hi) = data.bounds();
        let inside = View::perspective(lo + (hi - lo) * 0.45, hi, isobar_core::DVec3::Z, 80.0, 40, 30);
        let mut cost = [0; 2];
        for view in [View::fit((lo, hi), 40.0, 40, 30), inside] {
            let (all, a) = draw(data, surfaces, &view, true);
            let (first, b) = draw(data, surfaces, &view, false);
            cost = [cost[0] + count(&a, work), cost[1] + count(&b, work)];
            let mut hits = 0;
            for i in 0..first.t.len() {
                if all.claim[i].contains(Claim::LIMIT) {
                    continue;
                }
                assert_eq!(first.claim[i], all.claim[i], "{name} pixel {i}");
                assert_eq!(first.surface[i], all.surface[i], "{name} pixel {i}");
                let same = first.t[i] == all.t[i] || (first.t[i] - all.t[i]).abs() <= first.t_error[i] + all.t_error[i];
                assert!(same, "{name} pixel {i}: {} {}", first.t[i], all.t[i]);
                hits += usize::from(first.t[i].is_finite());
            }
            assert!(hits > 60, "{name}: {hits} hits");
        }
        cost[1] as f64 / cost[0] as f64
    }

    #[test]
    fn first_hits_are_those_of_all_hits() {
        let opaque = [Surface::isovalue(127.3, 0), Surface::isovalue(160.0, 1)];
        let grid = proofs::noise([12, 11, 13], DMat3::IDENTITY);
        let elements = isobar_fields::spline_to_hexes(&grid, isobar_fields::Kind::Cubic, isobar_core::Stage::Stored).unwrap();
        // A bent copy: no element is a box.
        let bent: Vec<HexElement> = elements
            .elements
            .iter()
            .map(|e| {
                let bend = |p: &[f64; 4]| [p[0] + 0.01 * p[1] * p[1], p[1], p[2] + 0.02 * p[0] * p[2], p[3]];
                HexElement {
                    points: e.points.iter().map(bend).collect(),
                    ..e.clone()
                }
            })
            .collect();
        let grid = Arc::new(Data::Grid(grid));
        // Observed: a third to a half of the work.
        for (name, data, work) in [
            ("cells", &grid, "polynomials"),
            ("boxes", &Arc::new(Data::Hexes(elements)), "polynomials"),
            ("bent", &hexes(bent), "pieces"),
        ] {
            let part = same_first_hits(name, data, &opaque, work);
            assert!(part < 0.6, "{name}: {part}");
            // What is behind a surface that lets light through is wanted.
            let lucid = opaque.map(|s| Surface { opacity: 0.5, ..s });
            assert_eq!(same_first_hits(name, data, &lucid, work), 1.0, "{name}");
        }
    }
}
