//! Data and views whose numbers differ by many powers of ten: what f64 proves of them is true and says little, so they are for exact arithmetic.

use crate::exact_tests::Drawn;
use isobar_core::{Channels, Claim, DMat3, DVec3, Data, Function, Grid, Knobs, Request, Samples, Stage, Surface, View};
use isobar_fields::{GridSpline, Kind};
use isobar_scenes::trials::hits_are_roots;
use isobar_scenes::{Random, oblique};
use std::sync::Arc;

const PLAIN: [Kind; 3] = [Kind::Trilinear, Kind::Quadratic, Kind::Cubic];

/// A gyroid of 14^3 samples.
fn gyroid(spacing: DVec3, origin: DVec3, change: impl Fn(usize, f64) -> f64) -> Grid {
    let n = 14;
    let samples: Vec<f32> = (0..n * n * n)
        .map(|i| {
            let [x, y, z] = [i % n, i / n % n, i / n / n].map(|i| i as f64 * 0.7);
            change(i, x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos()) as f32
        })
        .collect();
    Grid::new([n; 3], spacing, origin, DMat3::IDENTITY, Samples::F32(samples.into())).unwrap()
}

/// One sample of 1e6 to 1e13 among others of 1: t is right, not only its proof.
#[test]
fn one_great_sample_moves_no_hit() {
    let mut exact = 0;
    for power in 6..14 {
        let data = Arc::new(Data::Grid(gyroid(DVec3::ONE, DVec3::ZERO, |i, s| {
            if i == 0 { 10f64.powi(power) } else { s }
        })));
        let view = View::fit(data.bounds(), 40.0, 24, 18);
        for kind in PLAIN {
            let name = format!("1e{power}");
            let drawn = Drawn::new(&name, kind, &data, &[0.2], &view, Channels::all());
            drawn.is_decided(&name);
            exact += drawn.count("rays exact");
            let mut hits = 0;
            for (t, p) in drawn.frame.t.iter().zip(&drawn.truth.pixels) {
                if p.is_hit() {
                    hits += 1;
                    assert!((t - p.t()).abs() < 2e-5, "{name}, {kind}: {t} instead of {}", p.t());
                }
            }
            assert!(hits > 60, "{name}, {kind}: {hits} hits");
        }
    }
    assert!(exact > 1000, "{exact} rays");
}

/// Every root of a ray, also behind one that is proved.
#[test]
fn one_great_sample_hides_no_root() {
    for power in [7, 9, 11] {
        let data = Arc::new(Data::Grid(gyroid(DVec3::ONE, DVec3::ZERO, |i, s| {
            if i == 0 { 10f64.powi(power) } else { s }
        })));
        let (lo, hi) = data.bounds();
        let mut random = Random(power as u64);
        let rays: Vec<_> = (0..60)
            .map(|_| {
                let (p, direction) = (lo + (hi - lo) * random.vector(), random.direction());
                isobar_core::Ray {
                    origin: p - direction * 30.0,
                    direction,
                }
            })
            .collect();
        let roots = hits_are_roots(&crate::OCTREE_CPU, &data, 0.2, &rays, 40, 2e-5);
        assert!(roots > 60, "{roots}");
    }
}

/// Spacings of 1e6 : 1 on volumes with more than a few samples, and volumes far from the origin of the world: everything is decided.
#[test]
fn long_cells_and_far_volumes_are_decided() {
    let cases = [
        (DVec3::new(1.0, 1e6, 1.0), DVec3::ZERO, 0),
        (DVec3::new(1.0, 1.0, 1e-6), DVec3::ZERO, 0),
        (DVec3::splat(0.5), DVec3::new(448_251.25, 5_411_932.5, 100.0), 0),
        (DVec3::ONE, DVec3::new(1e12, -1e12, 3.0), 1),
    ];
    for (spacing, origin, turned) in cases {
        let grid = gyroid(spacing, origin, |_, s| s);
        let data = Arc::new(Data::Grid(if turned == 1 { oblique(grid) } else { grid }));
        let view = View::fit(data.bounds(), 40.0, 32, 24);
        for kind in [Kind::Trilinear, Kind::Cubic] {
            let name = format!("{spacing}, {origin}");
            let drawn = Drawn::new(&name, kind, &data, &[0.2], &view, Channels::all() - Channels::HITS);
            drawn.is_decided(&name);
            // Near by, whatever the world's origin is, f64 does.
            let alone = drawn.count("rays exact");
            assert!(
                origin.length() < 1e6 || origin.length() > 1e10 || alone == 0,
                "{name}, {kind}: {alone}"
            );
        }
    }
}

/// Isovalues next to each other: s comes to the nearer one first.
#[test]
fn isovalues_next_to_each_other_are_in_order() {
    let data = Arc::new(Data::Grid(gyroid(DVec3::ONE, DVec3::ZERO, |_, s| s)));
    let view = View::fit(data.bounds(), 40.0, 24, 18);
    for kind in [Kind::Trilinear, Kind::Cubic] {
        let Data::Grid(grid) = &*data else { panic!("a grid") };
        let f = GridSpline::new(grid, kind, Stage::Stored).unwrap();
        for apart in [0.2f64.next_up(), 0.2 + 1e-15, 0.2 + 1e-13] {
            for values in [[0.2, apart], [apart, 0.2]] {
                for channels in [Channels::all() - Channels::HITS, Channels::all()] {
                    let name = format!("{values:?}");
                    let drawn = Drawn::new(&name, kind, &data, &values, &view, channels);
                    drawn.is_decided(&name);
                    // The oracle's brackets say nothing about the order, but s before the hit does.
                    let mut told = 0;
                    for (i, &t) in drawn.frame.t[..view.pixels()].iter().enumerate() {
                        if !t.is_finite() {
                            continue;
                        }
                        let before = f.value(view.ray(i % 24, i / 24).at(t - 1e-4)) - 0.2;
                        if before.abs() > 1e-6 {
                            let nearest = if before < 0.0 { 0.2 } else { apart };
                            assert_eq!(
                                values[usize::from(drawn.frame.surface[i])],
                                nearest,
                                "{name}, {kind}, pixel {i}"
                            );
                            told += 1;
                        }
                    }
                    assert!(told > 60, "{name}: {told}");
                }
            }
        }
    }
}

/// The isovalue that much of the data is: cells of which a corner, an edge or a face is at it.
#[test]
fn the_least_value_of_the_data_is_decided_in_a_frame() {
    let data = Arc::new(Data::Grid(gyroid(DVec3::ONE, DVec3::ZERO, |_, s| {
        (s * 20.0).round().max(0.0)
    })));
    // As many rays a tile as exact work is allowed for in builds for tests.
    let view = View::fit(data.bounds(), 40.0, 32, 24);
    let mut exact = 0;
    for kind in PLAIN {
        let drawn = Drawn::new("least", kind, &data, &[0.0], &view, Channels::all() - Channels::HITS);
        drawn.is_decided("least");
        exact += drawn.count("rays exact");
    }
    assert!(exact > 200, "{exact}");
}

/// What a frame spends no exact work on is counted.
#[test]
fn open_pixels_are_counted() {
    let data = Arc::new(Data::Grid(gyroid(
        DVec3::ONE,
        DVec3::ZERO,
        |i, s| if i == 0 { 1e30 } else { s },
    )));
    let view = View::fit(data.bounds(), 40.0, 256, 192);
    let request = Request {
        channels: Channels::T | Channels::CLAIM,
        knobs: Knobs::default().with("reconstruction", "cubic"),
        ..Request::default()
    };
    let mut r = isobar_scenes::open(&crate::OCTREE_CPU, &request);
    let frame = isobar_scenes::draw(&mut *r, &data, &[Surface::isovalue(0.2, 0)], &view);
    let decided = |c: &&Claim| c.contains(Claim::EXISTS | Claim::FIRST) || c.contains(Claim::EMPTY);
    let open = frame.claim.len() - frame.claim.iter().filter(decided).count();
    let count = |name: &str| r.counters().0.iter().find(|c| c.0 == name).unwrap().1;
    assert_eq!(count("rays undecided"), open as u64);
    assert!(open > 1000 && count("rays exact") > 1000, "{open}");
}
