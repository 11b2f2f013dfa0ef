//! Rendering over levels against the same spline drawn at full resolution.

use super::rays::Random;
use crate::wavelet::{Adaptive, Bank, Criteria, Extent, Multiresolution, Pyramid, Selection};
use glam::{DMat3, DVec3};
use isobar_core::{
    Channels, ClipPlane, Data, DataError, Frame, Grid, Knobs, Method, RenderError, Request, Samples, Stop, Surface, View,
};
use isobar_fields::Kind;
use std::sync::Arc;

const CHANNELS: Channels = Channels::T
    .union(Channels::NORMAL)
    .union(Channels::SURFACE)
    .union(Channels::RGBA);
pub(super) const BANKS: [(Bank, Kind); 3] = [
    (Bank::Psi22, Kind::Trilinear),
    (Bank::Psi31, Kind::Quadratic),
    (Bank::Psi42, Kind::Cubic),
];

/// A wavy function of `frequency` radians per sample, with some noise.
pub(super) fn waves(dims: [usize; 3], spacing: DVec3, frequency: f64) -> Grid {
    let mut random = Random(0x1234_5678_9abc_def1);
    let [nx, ny, _] = dims;
    let samples: Vec<f32> = (0..dims.iter().product())
        .map(|i| {
            let p = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64) * frequency;
            (p.x.sin() * p.y.cos() + p.y.sin() * p.z.cos() + p.z.sin() * p.x.cos() + 0.2 * random.next()) as f32
        })
        .collect();
    let origin = DVec3::new(-1.0, 2.0, 0.5);
    Grid::new(dims, spacing, origin, DMat3::IDENTITY, Samples::F32(samples.into())).unwrap()
}

fn wavy(dims: [usize; 3], spacing: DVec3) -> Grid {
    waves(dims, spacing, 0.4)
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

/// How far from the faces of the domain, per axis and end, levels may differ from the one spline that is drawn at full resolution: as far as stencils reach beyond the faces where
/// rules differ there. In voxels, 0: nowhere.
///
/// Degree 3: in the last voxel the finest level's stencil takes the clamped index, that of others the mirrored one; in degrees 1 and 2 both are the same. At the high end of an axis
/// level k goes on by the mirror of level k - 1, which lies elsewhere than that of level k itself where k - 1 has an even number of samples (an odd one in degree 2); so pieces of level k whose
/// stencils go beyond its end are not those that level k + 1 and coarser ones draw there.
fn reach(drawn: &Multiresolution, degree: usize) -> [[f64; 2]; 3] {
    let pyramid = drawn.adaptive().pyramid();
    let coarsest = drawn.levels().map(|l| l.0).max().unwrap();
    let own = if degree == 3 && coarsest > 0 { 1.0 } else { 0.0 };
    [0, 1, 2].map(|a| {
        let n = |l: usize| pyramid.level_dims(l)[a] as f64;
        let beyond = (1..coarsest)
            .filter(|&k| pyramid.level_dims(k - 1)[a] % 2 == usize::from(degree == 2))
            .map(|k| {
                let step = (1 << k) as f64;
                // Where the first such piece begins.
                let first = match degree {
                    1 => step * (n(k) - 1.0),
                    2 => step * (n(k) - 1.0) - 0.5,
                    _ => step * (n(k) - 2.0),
                };
                n(0) - 1.0 - first
            });
        [own, beyond.fold(own, f64::max)]
    })
}

/// Pixels both hit at the same place, and those that differ; each of these has to be hit within `reach` of a face of the domain in one of the frames. Normals are compared
/// everywhere else.
fn compare(grid: &Grid, view: &View, a: &Frame, b: &Frame, reach: [[f64; 2]; 3]) -> (usize, usize) {
    let domain = grid.domain();
    let (mut same, mut differ) = (0, 0);
    for (i, (&t, &u)) in a.t.iter().zip(&b.t).enumerate() {
        if t.is_infinite() && u.is_infinite() {
            continue;
        }
        let ray = view.ray(i % view.width, i / view.width);
        let at_face = [t, u].into_iter().filter(|t| t.is_finite()).any(|t| {
            let p = domain.local(ray.at(t));
            let ends = [p - domain.lo, domain.hi - p];
            (0..3).any(|a| (0..2).any(|end| reach[a][end] > 0.0 && ends[end][a] < reach[a][end] + 1e-6))
        });
        if (t - u).abs() < 1e-4 {
            same += 1;
            let turned = (0..3).map(|c| (a.normal[i][c] - b.normal[i][c]).abs()).fold(0.0, f32::max);
            assert!(at_face || turned < 1e-3, "{turned} at pixel {i}");
            continue;
        }
        assert!(
            at_face,
            "pixel {i}: {t} and {u}, {} away from faces",
            domain.local(ray.at(t.min(u)))
        );
        differ += 1;
    }
    (same, differ)
}

#[test]
fn all_details_are_drawn_as_the_volume_itself() {
    for bank in BANKS {
        let grid = wavy([40, 33, 24], DVec3::ONE);
        let view = View::fit(grid.domain().world_bounds(), 40.0, 160, 120);
        let (levels, one, drawn) = pictures(&grid, bank, |p| Selection::whole(p, true), &view);
        assert_eq!(drawn.levels().map(|l| l.0).collect::<Vec<_>>(), [0]);
        let (same, differ) = compare(&grid, &view, &levels, &one, [[0.0; 2]; 3]);
        assert!(same > 3000 && differ == 0, "{}: {same} {differ}", bank.0);
    }
}

/// Less than a chunk, one sample more than chunks, axes of two samples: at full resolution the volume itself, bit by bit but for rounding; over levels the one spline, but near the faces that [`reach`] tells.
#[test]
fn sizes_that_chunks_do_not_divide() {
    for bank in BANKS {
        // Pixels that agree over levels, in all.
        let mut agree = 0;
        for dims in [
            [2, 2, 2],
            [3, 9, 2],
            [9, 8, 17],
            [16, 25, 7],
            [2, 40, 3],
            [27, 41, 30],
            [38, 23, 51],
        ] {
            let grid = wavy(dims, DVec3::ONE);
            let view = View::fit(grid.domain().world_bounds(), 40.0, 80, 60);
            let (levels, one, _) = pictures(&grid, bank, |p| Selection::whole(p, true), &view);
            let (_, differ) = compare(&grid, &view, &levels, &one, [[0.0; 2]; 3]);
            assert_eq!(differ, 0, "{} {dims:?}", bank.0);
            for coarser in [0, 1] {
                let select = |p: &Pyramid| Selection::by(p, |n| n.level > coarser || n.chunk[1] == 0);
                let (levels, one, drawn) = pictures(&grid, bank, select, &view);
                let reach = reach(&drawn, bank.0.degree());
                let (same, _) = compare(&grid, &view, &levels, &one, reach);
                // On short axes every point is near a face; on long ones most are not, and have to agree.
                let long = (0..3).all(|a| reach[a][0] + reach[a][1] < 0.3 * dims[a] as f64);
                if long && dims.iter().all(|n| *n > 20) {
                    assert!(drawn.levels().count() > 1, "{} {dims:?} {coarser}", bank.0);
                    assert!(same > 200, "{} {dims:?} {coarser}: {same}", bank.0);
                    agree += same;
                }
            }
        }
        assert!(agree > 1000, "{}: {agree}", bank.0);
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
        let stretched = DVec3::new(1.0, 2.0, 0.5);
        for (dims, spacing) in [(odd, DVec3::ONE), ([43, 31, 22], stretched), ([75, 46, 22], DVec3::ONE)] {
            let grid = wavy(dims, spacing);
            let mut view = View::fit(grid.domain().world_bounds(), 40.0, 160, 120);
            for clips in [vec![], vec![cut]] {
                view.clips = clips;
                let (levels, one, drawn) = pictures(&grid, bank, stepped, &view);
                let bricks: Vec<_> = drawn.levels().collect();
                assert!(bricks.len() >= 2 && bricks.iter().all(|l| l.1 > 0), "{bricks:?}");
                let reach = reach(&drawn, bank.0.degree());
                let (same, differ) = compare(&grid, &view, &levels, &one, reach);
                assert!(same > 800, "{} {dims:?}: {same} {differ} {reach:?}", bank.0);
                // Where coarse lattices end with the domain, degrees 1 and 2 agree in every pixel.
                assert!(dims != odd || bank.0.degree() == 3 || differ == 0, "{}: {differ}", bank.0);
            }
        }
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
        assert!(levels.cells() > 0);
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

/// hardcases B17: cells a million times as wide as high are hit by the rays that hit the cubes they are the image of, and at the same place.
#[test]
fn flat_cells_are_drawn() {
    let flat = DVec3::new(1.0, 1.0, 1e-6);
    let view = View::perspective(
        DVec3::new(15.0, 20.0, 40.0),
        DVec3::new(15.0, 18.0, 0.5),
        DVec3::Y,
        60.0,
        64,
        48,
    );
    let rays: Vec<_> = (0..view.pixels()).map(|i| view.ray(i % 64, i / 64)).collect();
    let pressed = rays.iter().map(|r| isobar_core::Ray {
        origin: r.origin * flat,
        direction: (r.direction * flat).normalize(),
    });
    let pressed: Vec<_> = pressed.collect();
    let wide = wavy([33, 33, 17], DVec3::ONE);
    for bank in BANKS {
        let of = |spacing: DVec3, rays: &[isobar_core::Ray]| {
            let grid = Grid::new(wide.dims, spacing, DVec3::ZERO, DMat3::IDENTITY, wide.samples.clone()).unwrap();
            pictures(&grid, bank, stepped, &View::rays(rays.to_vec())).0
        };
        let (cubes, levels) = (of(DVec3::ONE, &rays), of(flat, &pressed));
        let (mut hits, mut worst) = (0, 0.0f64);
        for (i, ray) in rays.iter().enumerate() {
            // Along the ray of the cubes.
            let t = levels.t[i] / (ray.direction * flat).length();
            assert_eq!(t.is_finite(), cubes.t[i].is_finite(), "{} ray {i}", bank.0);
            if t.is_finite() {
                hits += 1;
                worst = worst.max((t - cubes.t[i]).abs());
            }
        }
        println!("{}: {hits} hits, {worst:e}", bank.0);
        // Seen: 1.1e-4, of a ray that grazes the surface in degree 2.
        assert!(hits > 300 && worst < 2e-4, "{}: {hits} hits, {worst:e} apart", bank.0);
    }
}

/// A noisy step: selecting by isovalue changes no pixel, although coarse levels alone, without the wavelets of neighbours, have the surface elsewhere.
#[test]
fn selection_by_isovalue_changes_no_pixel() {
    let dims = [50usize, 37, 41];
    let mut random = Random(0x0123_4567);
    let samples: Vec<f32> = (0..dims.iter().product())
        .map(|i: usize| {
            let p = DVec3::new(
                (i % dims[0]) as f64,
                (i / dims[0] % dims[1]) as f64,
                (i / (dims[0] * dims[1])) as f64,
            );
            let inside = if p.distance(DVec3::splat(20.0)) < 12.0 { 1.0 } else { 0.0 };
            (inside + 0.05 * random.next()) as f32
        })
        .collect();
    let noisy = Grid::unit(dims, Samples::F32(samples.into())).unwrap();
    for grid in [noisy, wavy([50, 37, 41], DVec3::ONE)] {
        let view = View::fit(grid.domain().world_bounds(), 40.0, 160, 120);
        for bank in Bank::ALL {
            let pyramid = Arc::new(Pyramid::new(&grid, bank).unwrap());
            let criteria = Criteria {
                isovalues: Some(vec![0.5]),
                ..Criteria::default()
            };
            let frame = |selection: &Selection| {
                let mut levels = Multiresolution::new(pyramid.clone(), CHANNELS, 2).unwrap();
                levels.set_surfaces(&[Surface::isovalue(0.5, 0)]).unwrap();
                levels.select(selection).unwrap();
                levels.render(&view, &Stop::default()).unwrap();
                levels.frame().clone()
            };
            let (some, all) = (Selection::new(&pyramid, &criteria), Selection::whole(&pyramid, true));
            let (a, b) = (frame(&some), frame(&all));
            let far = |(x, y): (&f64, &f64)| x.is_finite() != y.is_finite() || (x.is_finite() && (x - y).abs() >= 1e-4);
            let changed = a.t.iter().zip(&b.t).filter(|p| far(*p)).count();
            println!("{bank}: {} of {} chunks, {changed} pixels", some.count(), all.count());
            assert_eq!(changed, 0, "{bank}: {} of {} chunks", some.count(), all.count());
            assert!(b.t.iter().filter(|t| t.is_finite()).count() > 1000);
        }
    }
}

/// What a frame draws does not depend on what was selected before: lattices that are kept are those that would be made.
#[test]
fn frames_are_those_of_fresh_selections() {
    let grid = wavy([60, 33, 24], DVec3::ONE);
    let pyramid = Arc::new(Pyramid::new(&grid, Bank::Psi42).unwrap());
    let view = View::fit(grid.domain().world_bounds(), 40.0, 80, 60);
    let fresh = || {
        let mut levels = Multiresolution::new(pyramid.clone(), CHANNELS, 2).unwrap();
        levels.set_surfaces(&[Surface::isovalue(0.3, 0)]).unwrap();
        levels
    };
    let mut kept = fresh();
    for near in [1, 2, 2, 1, 3, 0] {
        let selection = Selection::by(&pyramid, |n| n.level > 1 || n.chunk[0] < near << (1 - n.level));
        kept.select(&selection).unwrap();
        kept.render(&view, &Stop::default()).unwrap();
        let mut other = fresh();
        other.select(&selection).unwrap();
        other.render(&view, &Stop::default()).unwrap();
        assert_eq!(kept.frame(), other.frame(), "{near}");
        assert!(kept.levels().eq(other.levels()));
    }
}

/// Pieces of coarser levels are seen no wider than was asked for.
#[test]
fn levels_are_chosen_by_the_width_of_their_pieces() {
    let grid = wavy([97, 65, 65], DVec3::splat(0.5));
    let pyramid = Pyramid::new(&grid, Bank::Psi42).unwrap();
    let view = View::perspective(
        DVec3::new(-20.0, 18.0, 17.0),
        DVec3::new(20.0, 16.0, 16.0),
        DVec3::Z,
        40.0,
        640,
        480,
    );
    let mut last = usize::MAX;
    for pixels in [1.0, 4.0, 9.0, 30.0] {
        let selection = Selection::new(&pyramid, &Criteria::pixels(&view, pixels).unwrap());
        let eye = DVec3::new(-20.0, 18.0, 17.0);
        let domain = grid.domain();
        for (l, bricks) in selection.bricks(&pyramid).iter().enumerate().skip(1) {
            let size = (4 << l) as f64;
            for brick in bricks.iter() {
                let lo = DVec3::from_array(brick.map(|b| b as f64 * size));
                let nearest = domain.local(eye).clamp(lo, (lo + size).min(domain.hi));
                let width = 0.5 * (1 << l) as f64 / view.footprint(eye.distance(domain.world(nearest)));
                // Nodes that the domain cuts are smaller than their level's.
                let whole = (0..3).all(|a| lo[a] + size <= domain.hi[a]);
                assert!(!whole || width <= pixels * (1.0 + 1e-9), "{width} of {pixels} at level {l}");
            }
        }
        assert!(
            selection.count() <= last && (pixels < 9.0 || selection.count() < last),
            "{pixels}"
        );
        last = selection.count();
    }
    assert!(Criteria::pixels(&View::rays(vec![view.ray(0, 0)]), 2.0).is_none());
}
