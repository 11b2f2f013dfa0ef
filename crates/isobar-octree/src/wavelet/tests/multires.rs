//! Rendering over levels against the same spline drawn at full resolution.

use super::rays::Random;
use crate::wavelet::{Adaptive, Bank, Criteria, Extent, Multiresolution, Pyramid, Selection};
use glam::{DMat3, DVec3};
use isobar_core::{
    Channels, ClipPlane, Data, DataError, Frame, Function, Grid, Knobs, Method, Ray, RenderError, Request, Samples, Stage, Stop,
    Surface, View,
};
use isobar_fields::{GridSpline, Kind};
use std::sync::Arc;

const CHANNELS: Channels = Channels::T
    .union(Channels::NORMAL)
    .union(Channels::SURFACE)
    .union(Channels::RGBA);
const BANKS: [(Bank, Kind); 3] = [
    (Bank::Psi22, Kind::Trilinear),
    (Bank::Psi31, Kind::Quadratic),
    (Bank::Psi42, Kind::Cubic),
];

/// A wavy function with some noise.
fn wavy(dims: [usize; 3], spacing: DVec3) -> Grid {
    let mut random = Random(0x1234_5678_9abc_def1);
    let [nx, ny, _] = dims;
    let samples: Vec<f32> = (0..dims.iter().product())
        .map(|i| {
            let p = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64) * 0.4;
            (p.x.sin() * p.y.cos() + p.y.sin() * p.z.cos() + p.z.sin() * p.x.cos() + 0.2 * random.next()) as f32
        })
        .collect();
    let origin = DVec3::new(-1.0, 2.0, 0.5);
    Grid::new(dims, spacing, origin, DMat3::IDENTITY, Samples::F32(samples.into())).unwrap()
}

/// Level 0 at low x, level 1 in the middle, coarser behind.
fn stepped(pyramid: &Pyramid) -> Selection {
    Selection::by(pyramid, |n| {
        n.chunk[0] < 1 || (n.level > 0 && n.lo.x < 20.0 && n.level < 2) || n.level > 2
    })
}

fn full(grid: &Grid, kind: Kind, view: &View, value: f64) -> Frame {
    let request = Request {
        channels: CHANNELS,
        knobs: Knobs::default().with("reconstruction", kind.name()),
        ..Request::default()
    };
    let mut r = crate::OCTREE_CPU.open(&request).unwrap();
    r.set_data(&Arc::new(Data::Grid(grid.clone()))).unwrap();
    r.set_surfaces(&[Surface::isovalue(value, 0)]).unwrap();
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut frame = Frame::default();
    r.read(&mut frame).unwrap();
    frame
}

/// Both pictures of a selection.
fn pictures(
    grid: &Grid,
    (bank, kind): (Bank, Kind),
    select: impl Fn(&Pyramid) -> Selection,
    view: &View,
) -> (Frame, Frame, Multiresolution) {
    let pyramid = Arc::new(Pyramid::new(grid, bank).unwrap());
    let selection = select(&pyramid);
    let mut levels = Multiresolution::new(pyramid.clone(), CHANNELS, 2).unwrap();
    levels.set_surfaces(&[Surface::isovalue(0.3, 0)]).unwrap();
    levels.select(&selection).unwrap();
    levels.render(view, &Stop::default()).unwrap();
    let mut adaptive = Adaptive::new(pyramid);
    adaptive.update(&selection, Extent::Whole);
    let one = full(&adaptive.grid().unwrap(), kind, view, 0.3);
    (levels.frame().clone(), one, levels)
}

/// Pixels both hit at the same place, those that differ, and those that differ and lie within `zone` voxels of a face of the domain.
fn compare(grid: &Grid, view: &View, a: &Frame, b: &Frame, zone: f64) -> (usize, usize, usize) {
    let domain = grid.domain();
    let (mut same, mut differ, mut at_face) = (0, 0, 0);
    for (i, (&t, &u)) in a.t.iter().zip(&b.t).enumerate() {
        if t.is_infinite() && u.is_infinite() {
            continue;
        }
        let ray = view.ray(i % view.width, i / view.width);
        let near = [t, u].into_iter().filter(|t| t.is_finite()).any(|t| {
            let p = domain.local(ray.at(t));
            (p - domain.lo).min(domain.hi - p).min_element() < zone
        });
        if (t - u).abs() < 1e-4 {
            same += 1;
            let turned = (0..3).map(|c| (a.normal[i][c] - b.normal[i][c]).abs()).fold(0.0, f32::max);
            assert!(near || turned < 1e-2, "{turned} at pixel {i}");
            continue;
        }
        if near { at_face += 1 } else { differ += 1 }
    }
    (same, differ, at_face)
}

#[test]
fn all_details_are_drawn_as_the_volume_itself() {
    for bank in BANKS {
        let grid = wavy([40, 33, 24], DVec3::ONE);
        let view = View::fit(grid.domain().world_bounds(), 40.0, 160, 120);
        let (levels, one, drawn) = pictures(&grid, bank, |p| Selection::whole(p, true), &view);
        assert_eq!(drawn.levels().map(|l| l.0).collect::<Vec<_>>(), [0]);
        let (same, differ, at_face) = compare(&grid, &view, &levels, &one, 0.0);
        assert!(same > 3000 && differ + at_face == 0, "{}: {same} {differ} {at_face}", bank.0);
    }
}

#[test]
fn levels_are_drawn_as_the_one_spline_they_are() {
    let cut = ClipPlane {
        normal: DVec3::new(0.2, 0.1, 1.0),
        distance: 14.0,
        cap: false,
    };
    for bank in BANKS {
        // Sizes of which all coarse lattices end with the domain, sizes that chunks do not divide, and cells that are no cubes.
        let odd = if bank.0.degree() == 2 { [48, 32, 24] } else { [49, 33, 25] };
        for (dims, spacing) in [(odd, DVec3::ONE), ([43, 31, 22], DVec3::new(1.0, 2.0, 0.5))] {
            let grid = wavy(dims, spacing);
            let mut view = View::fit(grid.domain().world_bounds(), 40.0, 160, 120);
            for clips in [vec![], vec![cut]] {
                view.clips = clips;
                let (levels, one, drawn) = pictures(&grid, bank, stepped, &view);
                let bricks: Vec<_> = drawn.levels().collect();
                assert!(bricks.len() >= 2 && bricks.iter().all(|l| l.1 > 0), "{bricks:?}");
                // At faces the finest level goes on by clamped indices, the others by the mirror: in degree 3 the last voxel differs, a fifth of what is seen
                // of so small a volume (735 pixels beside 3683 in 49 x 33 x 25), and with sizes that coarse lattices do not end with some more.
                let (same, differ, at_face) = compare(&grid, &view, &levels, &one, 4.0);
                assert!(same > 1000, "{}: {same}", bank.0);
                assert!(
                    differ == 0 && at_face * 3 < same,
                    "{} {dims:?}: {same} {differ} {at_face}",
                    bank.0
                );
            }
        }
    }
}

#[test]
fn no_ray_slips_through_a_border_of_levels() {
    for (bank, kind) in BANKS {
        let dims = if bank.degree() == 2 { [48, 32, 32] } else { [49, 33, 33] };
        let grid = wavy(dims, DVec3::ONE);
        let pyramid = Arc::new(Pyramid::new(&grid, bank).unwrap());
        let selection = stepped(&pyramid);
        let mut levels = Multiresolution::new(pyramid.clone(), Channels::T, 0).unwrap();
        levels.set_surfaces(&[Surface::isovalue(0.3, 0)]).unwrap();
        levels.select(&selection).unwrap();
        let mut adaptive = Adaptive::new(pyramid);
        adaptive.update(&selection, Extent::Whole);
        let coefficients = adaptive.grid().unwrap();
        let function = GridSpline::new(&coefficients, kind, Stage::Stored).unwrap();
        let border = selection.drawn(0).iter().map(|c| c[0] + 1).max().unwrap() as f64 * 8.0;
        let mut random = Random(99);
        let domain = grid.domain();
        let rays: Vec<Ray> = (0..60_000)
            .map(|_| Ray {
                origin: domain.world(DVec3::new(border - 3.0, 6.0, 6.0) + random.vector() * DVec3::new(6.0, 18.0, 18.0)),
                direction: (random.vector() - 0.5).normalize(),
            })
            .collect();
        let view = View::rays(rays.clone());
        levels.render(&view, &Stop::default()).unwrap();
        let mut changes = 0;
        for (ray, &t) in rays.iter().zip(&levels.frame().t) {
            let at = |t: f64| function.value(ray.at(t)) - 0.3;
            let first = at(0.0);
            if first.abs() < 1e-4 {
                continue;
            }
            let Some(end) = (1..=12)
                .map(|i| f64::from(i) * 0.25)
                .find(|&t| at(t) * first.signum() < -1e-4)
            else {
                continue;
            };
            changes += 1;
            assert!(t <= end, "{kind}: a sign changes before {end} on {ray:?}, the hit is at {t}");
            assert!(at(t).abs() < 1e-4, "{kind}: {} at the hit {t} of {ray:?}", at(t));
        }
        assert!(changes > 10_000, "{changes}");
    }
}

#[test]
fn views_draw_what_is_far_at_coarser_levels_with_fewer_bricks() {
    let grid = wavy([97, 65, 65], DVec3::ONE);
    let pyramid = Arc::new(Pyramid::new(&grid, Bank::Psi42).unwrap());
    let eye = DVec3::new(-30.0, 30.0, 40.0);
    let view = View::perspective(eye, DVec3::new(48.0, 32.0, 32.0), DVec3::Z, 40.0, 160, 120);
    let mut levels = Multiresolution::new(pyramid.clone(), CHANNELS, 0).unwrap();
    levels.set_surfaces(&[Surface::isovalue(0.3, 0)]).unwrap();
    let mut last = usize::MAX;
    for epsilon in [1e-3, 0.2, 0.4, 1.0] {
        let criteria = Criteria {
            view: Some((eye, epsilon)),
            isovalues: Some(vec![0.3]),
            ..Criteria::default()
        };
        levels.select(&Selection::new(&pyramid, &criteria)).unwrap();
        levels.render(&view, &Stop::default()).unwrap();
        let met: usize = levels.levels().map(|l| l.2).sum();
        assert!(met <= last && met > 0, "{met} at {epsilon}, {last} before");
        last = met;
        let hits = levels.frame().t.iter().filter(|t| t.is_finite()).count();
        assert!(hits > 3000 && levels.tiles() > 0, "{hits}");
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_in_words() {
    let thin = Arc::new(Pyramid::new(&wavy([20, 1, 20], DVec3::ONE), Bank::Psi42).unwrap());
    let e = Multiresolution::new(thin, CHANNELS, 1).unwrap_err();
    assert!(matches!(e, RenderError::Data(DataError::TooThin { .. })), "{e}");
    let small = Arc::new(Pyramid::new(&wavy([2, 3, 2], DVec3::ONE), Bank::Psi42).unwrap());
    assert!(Multiresolution::new(small.clone(), CHANNELS | Channels::HITS, 1).is_err());
    let mut levels = Multiresolution::new(small.clone(), CHANNELS, 1).unwrap();
    let view = View::fit((DVec3::new(-1.0, 2.0, 0.5), DVec3::new(0.0, 4.0, 1.5)), 40.0, 32, 24);
    assert_eq!(
        levels.render(&view, &Stop::default()).unwrap_err(),
        RenderError::NotReady("set_surfaces")
    );
    let glass = Surface {
        opacity: 0.5,
        ..Surface::isovalue(0.0, 0)
    };
    assert!(levels.set_surfaces(&[glass]).is_err());
    // A volume of less than a chunk has its coarsest level alone.
    let grid = wavy([2, 3, 2], DVec3::ONE);
    let mean = (0..12).map(|i| grid.samples.get(i)).sum::<f64>() / 12.0;
    levels.set_surfaces(&[Surface::isovalue(mean, 0)]).unwrap();
    levels.select(&Selection::whole(&small, false)).unwrap();
    levels.render(&view, &Stop::default()).unwrap();
    let one = full(&grid, Kind::Cubic, &view, mean);
    assert_eq!(levels.frame().t, one.t);
    assert!(one.t.iter().any(|t| t.is_finite()));
    let stop = Stop::default();
    stop.raise();
    assert_eq!(levels.render(&view, &stop).unwrap_err(), RenderError::Stopped);
}

#[test]
fn flat_cells_are_drawn() {
    // A million to one.
    let grid = wavy([33, 33, 17], DVec3::new(1.0, 1.0, 1e-6));
    let view = View::perspective(
        DVec3::new(15.0, 20.0, 1e-3),
        DVec3::new(15.0, 18.0, 0.5),
        DVec3::Y,
        60.0,
        64,
        48,
    );
    let (levels, one, _) = pictures(&grid, (Bank::Psi42, Kind::Cubic), stepped, &view);
    let hits = |f: &Frame| f.t.iter().filter(|t| t.is_finite()).count();
    let (a, b) = (hits(&levels), hits(&one));
    assert!(b > 300 && a.abs_diff(b) * 20 < b, "{a} {b}");
}
