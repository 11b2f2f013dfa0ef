//! What became of each block of pixels (thesis, section 3.2 and Figure 3.2; S13).
//!
//! The thesis starts a thread for every pixel of the rectangle that the volume's box projects to, in blocks of 8 x 8, and counts the blocks whose rays all miss the
//! box, those that meet no candidate voxel, and those that work on a polynomial. Here these are counted from a frame of `octree/cpu`, whose channel WORK
//! holds the active cells on each ray: packets launch tiles in the same rectangle. Blocks are those of the image's own grid (the thesis's begin at the rectangle's corner).

use crate::walk::{Entry, Space, Walk};
use isobar_core::{Channels, Domain, Frame, RenderError, View};
use isobar_cpu::packet::Projection;

/// The furthest that any ray of a block got.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum BlockClass {
    /// Outside the rectangle: no ray is made.
    NotLaunched,
    /// All rays miss the volume's box, or what clipping planes leave of it.
    MissesBox,
    /// A ray enters the box; none meets a cell that can hold the surface.
    NoCandidate,
    /// A ray has a polynomial composed; none has a hit.
    Composed,
    /// A ray hits the surface.
    Hit,
}

impl BlockClass {
    /// All of them, least work first.
    pub const ALL: [Self; 5] = [
        Self::NotLaunched,
        Self::MissesBox,
        Self::NoCandidate,
        Self::Composed,
        Self::Hit,
    ];

    /// What it is called in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NotLaunched => "not launched",
            Self::MissesBox => "finished at the box",
            Self::NoCandidate => "no candidate cell",
            Self::Composed => "polynomials without a root",
            Self::Hit => "hit",
        }
    }
}

/// The blocks of an image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Blocks {
    /// Pixels along the side of a block; less at the right and lower edge of the image.
    pub side: usize,
    /// Blocks per row.
    pub columns: usize,
    /// Rows of blocks.
    pub rows: usize,
    /// First and last pixel in x and in y of the rectangle that the box projects to, inside the image; `None` where no pixel is in it.
    pub launched: Option<[[usize; 2]; 2]>,
    /// Row by row.
    pub classes: Vec<BlockClass>,
}

impl Blocks {
    /// The blocks of `frame`, drawn by `octree/cpu` of a grid with that domain as `view` shows it.
    ///
    /// # Errors
    /// [`RenderError::View`]: as [`View::validate`], a list of rays, a side of 0, a frame of another size or without the channels T and WORK.
    pub fn new(frame: &Frame, view: &View, domain: &Domain, side: usize) -> Result<Self, RenderError> {
        let bad = |what: &str| Err(RenderError::View(what.to_owned()));
        view.validate()?;
        if side == 0 {
            return bad("blocks of pixels need a side of at least 1");
        }
        if (frame.width, frame.height) != (view.width, view.height) {
            return bad("the frame is not of the view's size; render it with that view");
        }
        if !frame.channels.contains(Channels::T | Channels::WORK) {
            return bad("blocks are classed by the channels T and WORK; ask for both when rendering");
        }
        let space = Space::new(*domain);
        let Some(projection) = Projection::new(view, &space.domain) else {
            return bad("a list of rays has no blocks of pixels; give a camera");
        };
        let launched = rectangle(&projection, &space, view);
        let (columns, rows) = (view.width.div_ceil(side), view.height.div_ceil(side));
        let rays = view.generator();
        let mut classes = vec![BlockClass::NotLaunched; columns * rows];
        let Some([xs, ys]) = launched else {
            return Ok(Self {
                side,
                columns,
                rows,
                launched,
                classes,
            });
        };
        for y in ys[0]..=ys[1] {
            for x in xs[0]..=xs[1] {
                let at = y * view.width + x;
                let class = if frame.t[at * frame.layers.max(1)].is_finite() {
                    BlockClass::Hit
                } else if frame.work[at] > 0 {
                    BlockClass::Composed
                } else {
                    match Walk::enter(&rays.ray(x, y), &space, &view.clips, None) {
                        Entry::Through(_) => BlockClass::NoCandidate,
                        Entry::Misses { .. } => BlockClass::MissesBox,
                    }
                };
                let block = &mut classes[y / side * columns + x / side];
                *block = class.max(*block);
            }
        }
        Ok(Self {
            side,
            columns,
            rows,
            launched,
            classes,
        })
    }

    /// The class of the block that holds pixel (x, y).
    ///
    /// # Panics
    /// Outside the image.
    #[must_use]
    pub fn at(&self, x: usize, y: usize) -> BlockClass {
        assert!(x / self.side < self.columns && y / self.side < self.rows, "inside the image");
        self.classes[y / self.side * self.columns + x / self.side]
    }

    /// Blocks of a class.
    #[must_use]
    pub fn count(&self, class: BlockClass) -> usize {
        self.classes.iter().filter(|&&c| c == class).count()
    }

    /// Blocks that were launched.
    #[must_use]
    pub fn launched_blocks(&self) -> usize {
        self.classes.len() - self.count(BlockClass::NotLaunched)
    }

    /// Share of a class in the blocks launched, in [0, 1]; 0 where none were.
    #[must_use]
    pub fn share(&self, class: BlockClass) -> f64 {
        self.count(class) as f64 / self.launched_blocks().max(1) as f64
    }
}

/// The pixels whose rays may meet the volume, as packets have them (`isobar_cpu::packet::Place::misses`).
fn rectangle(projection: &Projection, space: &Space, view: &View) -> Option<[[usize; 2]; 2]> {
    let whole = [[0.0, (view.width - 1) as f64], [0.0, (view.height - 1) as f64]];
    // Where the box is not wholly in front of the eye, all pixels.
    let bounds = projection.bounds(space.domain.hi.to_array()).unwrap_or(whole);
    let clamped = [0, 1].map(|a| [bounds[a][0].ceil().max(0.0), bounds[a][1].floor().min(whole[a][1])]);
    clamped
        .iter()
        .all(|[lo, hi]| lo <= hi)
        .then(|| clamped.map(|b| b.map(|x| x as usize)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::OCTREE_CPU;
    use glam::DVec3;
    use isobar_core::{Camera, ClipPlane, Data, Function, Grid, Knobs, Method, Ray, Request, Samples, Stage, Stop, Surface};
    use isobar_fields::{GridSpline, Kind};
    use std::sync::Arc;

    const N: usize = 24;

    /// Distance from the middle: a ball of radius 5 in a box of half edge 11.5.
    fn ball() -> Grid {
        let at = |i: usize| [i % N, i / N % N, i / N / N].map(|x| x as f64 - 11.5);
        let samples: Vec<f32> = (0..N * N * N)
            .map(|i| at(i).iter().map(|x| x * x).sum::<f64>().sqrt() as f32)
            .collect();
        Grid::unit([N; 3], Samples::F32(samples.into())).unwrap()
    }

    fn drawn(grid: &Grid, view: &View, kind: &str) -> Frame {
        let request = Request {
            channels: Channels::T | Channels::WORK,
            knobs: Knobs::default().with("reconstruction", kind),
            ..Request::default()
        };
        let mut r = OCTREE_CPU.open(&request).unwrap();
        r.set_data(&Arc::new(Data::Grid(grid.clone()))).unwrap();
        r.set_surfaces(&[Surface::isovalue(5.0, 0)]).unwrap();
        r.set_view(view).unwrap();
        r.render(&Stop::default()).unwrap();
        let mut frame = Frame::default();
        r.read(&mut frame).unwrap();
        frame
    }

    /// What a ray meets by the thesis's definitions, with none of the caster's code: the box by slabs, candidates by stepping finely through cells whose
    /// corner samples straddle the isovalue, a hit by the sign of the spline at the same steps.
    fn truth(grid: &Grid, spline: &GridSpline, ray: &Ray) -> BlockClass {
        let (mut t0, mut t1) = (0.0f64, f64::INFINITY);
        for a in 0..3 {
            let (p, q) = (
                -ray.origin[a] / ray.direction[a],
                ((N - 1) as f64 - ray.origin[a]) / ray.direction[a],
            );
            t0 = t0.max(p.min(q));
            t1 = t1.min(p.max(q));
        }
        if t0 > t1 {
            return BlockClass::MissesBox;
        }
        let mut class = BlockClass::NoCandidate;
        let steps = ((t1 - t0) / 0.01) as usize;
        for n in 0..=steps {
            let p = ray.at(t0 + (t1 - t0) * n as f64 / steps.max(1) as f64);
            let c = [0, 1, 2].map(|a| (p[a].max(0.0) as usize).min(N - 2));
            let corners = (0..8).map(|k| {
                let i = (c[2] + (k >> 2)) * N * N + (c[1] + (k >> 1 & 1)) * N + c[0] + (k & 1);
                grid.samples.get(i)
            });
            let (lo, hi) = corners.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            if lo <= 5.0 && hi >= 5.0 {
                class = BlockClass::Composed;
            }
            if spline.value(p) < 5.0 {
                return BlockClass::Hit;
            }
        }
        class
    }

    #[test]
    fn every_class_is_what_an_independent_walk_finds() {
        let grid = ball();
        let spline = GridSpline::new(&grid, Kind::Trilinear, Stage::Stored).unwrap();
        let view = View::perspective(DVec3::new(60.0, 45.0, 38.0), DVec3::splat(11.0), DVec3::Z, 50.0, 75, 52);
        let frame = drawn(&grid, &view, "trilinear");
        for side in [1, 8] {
            let blocks = Blocks::new(&frame, &view, &grid.domain(), side).unwrap();
            let [xs, ys] = blocks.launched.unwrap();
            let mut differ = 0;
            for (by, bx) in (0..blocks.rows).flat_map(|y| (0..blocks.columns).map(move |x| (y, x))) {
                let mut want = BlockClass::NotLaunched;
                for y in (by * side..view.height.min((by + 1) * side)).filter(|y| (ys[0]..=ys[1]).contains(y)) {
                    for x in (bx * side..view.width.min((bx + 1) * side)).filter(|x| (xs[0]..=xs[1]).contains(x)) {
                        want = want.max(truth(&grid, &spline, &view.ray(x, y)));
                    }
                }
                let got = blocks.at(bx * side, by * side);
                if got != want {
                    // A ray may cut an active cell's corner between two of the walk's steps, and graze the surface there.
                    assert!(
                        got > want && want >= BlockClass::NoCandidate,
                        "block ({bx}, {by}): {got:?}, not {want:?}"
                    );
                    differ += 1;
                }
            }
            assert!(
                differ <= blocks.classes.len() / 100,
                "{differ} blocks of {}",
                blocks.classes.len()
            );
            for class in BlockClass::ALL {
                assert!(side > 1 || blocks.count(class) > 0, "no pixel is {}", class.name());
            }
            let sum: f64 = BlockClass::ALL[1..].iter().map(|&c| blocks.share(c)).sum();
            assert!((sum - 1.0).abs() < 1e-12);
        }
    }

    /// The rectangle holds every pixel that meets the box and is no larger than the corners' projection.
    #[test]
    fn the_launched_rectangle_is_that_of_the_projected_corners() {
        let grid = ball();
        for kind in ["trilinear", "cubic"] {
            let view = View::perspective(DVec3::new(60.0, 45.0, 38.0), DVec3::splat(11.0), DVec3::Z, 50.0, 75, 52);
            let blocks = Blocks::new(&drawn(&grid, &view, kind), &view, &grid.domain(), 8).unwrap();
            let [xs, ys] = blocks.launched.unwrap();
            let met = |x: usize, y: usize| {
                let ray = view.ray(x, y);
                let (mut t0, mut t1) = (0.0f64, f64::INFINITY);
                for a in 0..3 {
                    let (p, q) = (-ray.origin[a] / ray.direction[a], (23.0 - ray.origin[a]) / ray.direction[a]);
                    (t0, t1) = (t0.max(p.min(q)), t1.min(p.max(q)));
                }
                t0 <= t1
            };
            let mut seen = [[usize::MAX, 0]; 2];
            for (x, y) in (0..52).flat_map(|y| (0..75).map(move |x| (x, y))).filter(|&(x, y)| met(x, y)) {
                for (s, p) in seen.iter_mut().zip([x, y]) {
                    *s = [s[0].min(p), s[1].max(p)];
                }
            }
            for (rectangle, seen) in [xs, ys].into_iter().zip(seen) {
                assert!(
                    rectangle[0] <= seen[0] && rectangle[1] >= seen[1],
                    "{rectangle:?} holds {seen:?}"
                );
                assert!(
                    rectangle[0] + 1 >= seen[0] && rectangle[1] <= seen[1] + 1,
                    "{rectangle:?}, {seen:?}"
                );
            }
        }
    }

    #[test]
    fn views_without_blocks_are_refused_and_those_beside_the_volume_launch_none() {
        let grid = ball();
        let mut view = View::perspective(
            DVec3::new(60.0, 45.0, 38.0),
            DVec3::new(60.0, 45.0, 90.0),
            DVec3::X,
            40.0,
            20,
            20,
        );
        let frame = drawn(&grid, &view, "trilinear");
        let blocks = Blocks::new(&frame, &view, &grid.domain(), 8).unwrap();
        assert!(blocks.launched.is_none() || blocks.count(BlockClass::Hit) == 0);
        for side in [0, 8] {
            let other = View::perspective(DVec3::splat(50.0), DVec3::ZERO, DVec3::Z, 40.0, 21, 20);
            assert!(Blocks::new(&frame, &other, &grid.domain(), side).is_err());
        }
        let bare = Frame::new(20, 20, 1, Channels::T);
        assert!(Blocks::new(&bare, &view, &grid.domain(), 8).is_err());
        let rays = View {
            camera: Camera::Rays(vec![view.ray(0, 0); 400].into()),
            ..view.clone()
        };
        assert!(Blocks::new(&frame, &rays, &grid.domain(), 8).is_err());
        // A plane that cuts everything away: all blocks end at the box.
        view = View::perspective(DVec3::new(60.0, 45.0, 38.0), DVec3::splat(11.0), DVec3::Z, 50.0, 20, 20);
        view.clips.push(ClipPlane {
            normal: DVec3::X,
            distance: -5.0,
            cap: false,
        });
        let blocks = Blocks::new(&drawn(&grid, &view, "cubic"), &view, &grid.domain(), 8).unwrap();
        assert_eq!(blocks.count(BlockClass::MissesBox), blocks.launched_blocks());
    }
}
