use super::classes::Classes;
use super::closeup::{BITS, Closeup, near};
use super::degrees::Bricks;
use super::surfaces::{SURFACES, contenders, searched};
use super::*;
use crate::blocks::BlockClass;
use crate::wavelet::Bank;
use crate::wavelet::table::Setting;
use isobar_core::{Grid, Samples};

const N: usize = 24;

/// Two balls side by side, positive inside, and one sample far from both that is positive too.
fn balls() -> Arc<Data> {
    let samples: Vec<f32> = (0..N * N * N)
        .map(|i| {
            let p = [i % N, i / N % N, i / N / N].map(|x| x as f64 - 11.5);
            let d = |x: f64| ((p[0] - x).powi(2) + p[1] * p[1] + p[2] * p[2]).sqrt();
            let speck = if p == [-9.5; 3] { 2.0 } else { f64::NEG_INFINITY };
            (5.0 - d(-5.0).min(d(5.0))).max(speck) as f32
        })
        .collect();
    Arc::new(Data::Grid(Grid::unit([N; 3], Samples::F32(samples.into())).unwrap()))
}

fn grid(data: &Data) -> &Grid {
    match data {
        Data::Grid(g) => g,
        _ => unreachable!("made as a grid"),
    }
}

/// More than one colour.
fn shows(image: &Image) {
    assert_eq!(image.rgb.len(), 3 * image.width * image.height);
    let first = &image.rgb[..3];
    assert!(image.rgb.chunks(3).any(|p| p != first));
}

#[test]
fn classes_sum_to_the_blocks_launched_and_are_seen() {
    let data = balls();
    let view = View::fit(data.bounds(), 40.0, 96, 72);
    let scene = Scene {
        data: &data,
        isovalue: 0.0,
        kind: Kind::Cubic,
        view: &view,
    };
    let c = Classes::draw(&scene).unwrap();
    let named = [BlockClass::MissesBox, BlockClass::NoCandidate].map(|k| c.blocks.count(k));
    assert_eq!(named.iter().sum::<usize>() + c.composed(), c.blocks.launched_blocks());
    assert!(c.composed() > 0 && named[1] > 0, "{named:?}");
    let image = c.image(&view);
    shows(&image);
    // A block with hits is red, one that is not launched white, but for edges.
    let colour = |x: usize, y: usize| &image.rgb[3 * (y * 96 + x)..][..3];
    let hit = (0..view.pixels()).find(|&i| c.frame.t[i].is_finite() && i % 8 == 4 && i / 96 % 8 == 4);
    let hit = hit.expect("the balls are in view");
    let [r, g, b] = colour(hit % 96, hit / 96) else {
        unreachable!("three bytes")
    };
    assert!(r > g && r > b);
}

/// Against every brick's samples one by one.
#[test]
fn bricks_are_active_where_their_samples_lie_on_both_sides() {
    let data = balls();
    let g = grid(&data);
    for side in [1, 2, 4, 5] {
        let bricks = Bricks::new(g, 0.25, side);
        let mut active = 0;
        for (n, &a) in bricks.active.iter().enumerate() {
            let at = [
                n % bricks.count[0],
                n / bricks.count[0] % bricks.count[1],
                n / bricks.count[0] / bricks.count[1],
            ];
            let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
            let span = |a: usize| at[a] * side..=((at[a] + 1) * side).min(N - 1);
            for (z, y, x) in span(2).flat_map(|z| span(1).flat_map(move |y| span(0).map(move |x| (z, y, x)))) {
                let v = g.samples.get((z * N + y) * N + x);
                (lo, hi) = (lo.min(v), hi.max(v));
            }
            assert_eq!(a, lo <= 0.25 && 0.25 <= hi, "brick {at:?} of {side}");
            active += usize::from(a);
        }
        assert_eq!(bricks.active(), active);
        shows(&bricks.image(&View::fit(data.bounds(), 40.0, 64, 48)));
    }
}

/// All ways find the same surface but for a few pixels, f32 being what parts them, and what is found lies between the planes.
#[test]
fn contenders_find_the_same_surfaces() {
    for (letter, degree, _) in SURFACES {
        let (polynomial, view) = searched(letter, 32).unwrap();
        assert!(
            polynomial
                .terms
                .iter()
                .all(|(e, _)| e.iter().all(|&p| usize::from(p) <= degree))
        );
        let all = contenders(letter, 32, 1).unwrap();
        assert_eq!(all.len(), 5);
        let first = &all[0].drawn;
        for c in &all {
            assert!(c.drawn.composed == view.pixels() && c.drawn.total() > Duration::ZERO);
            let far = (c.drawn.points.iter().zip(&first.points))
                .filter(|(a, b)| a.is_finite() != b.is_finite() || (a.is_finite() && (**a - **b).length() > view.footprint(8.0)));
            assert!(far.count() <= 10, "{letter} {:?}", c.how);
            for p in c.drawn.points.iter().filter(|p| p.is_finite()) {
                for clip in &view.clips {
                    assert!(p.dot(clip.normal) <= clip.distance + 1e-3);
                }
            }
        }
        assert!(first.points.iter().any(|p| p.is_finite()) && first.points.iter().any(|p| !p.is_finite()));
    }
}

#[test]
fn fewer_bits_turn_normals_further() {
    let data = balls();
    let overview = View::fit(data.bounds(), 40.0, 64, 48);
    let view = near(&data, 0.0, &overview, 3.0, [64, 48]).unwrap();
    let c = Closeup::draw(&data, 0.0, view).unwrap();
    assert!(c.hits() > 1000 && c.angles.max < 1e-4, "{} {:?}", c.hits(), c.angles);
    let p50: Vec<f64> = BITS
        .iter()
        .map(|&bits| {
            let s = c.sample(bits).unwrap();
            shows(&c.sampled_image(&s));
            assert!(s.at_own_hits.count + 20 > c.hits());
            if bits.is_some() {
                shows(&c.angle_image(&s));
            }
            s.at_exact_hits.p50
        })
        .collect();
    shows(&c.image());
    assert!(p50[0] < p50[1] && p50[1] < p50[2], "{p50:?}");
}

#[test]
fn without_details_a_speck_vanishes() {
    let data = balls();
    let view = View::fit(data.bounds(), 40.0, 48, 36);
    let setting = Setting {
        grid: grid(&data),
        bank: Bank::Psi42,
        isovalue: 0.5,
        view: &view,
        method: &crate::OCTREE_CPU,
        threads: 1,
        clock: || Duration::ZERO,
    };
    let stages = super::topology::stages(&setting, &[0.2]).unwrap();
    let [all, .., coarse, magnitude] = stages.as_slice() else {
        panic!("a stage per level and one by magnitude");
    };
    assert_eq!((all.details.as_str(), all.above.all, all.below.all), ("all", 3, 1));
    assert!(all.above.large == 2 && all.above.largest > 300, "{:?}", all.above);
    assert!(coarse.chunks == 0 && coarse.above.all < 3, "{:?}", coarse.above);
    assert!(magnitude.chunks < all.chunks);
    shows(&Image::linear(&view, &all.picture.frame.rgba));
}

#[test]
fn the_levels_of_a_view_are_seen_from_behind_and_near_a_border() {
    let data = "gyroid,n=33".parse::<isobar_fields::Synthetic>().unwrap().data().unwrap();
    let view = View::fit(data.bounds(), 40.0, 64, 48);
    let setting = Setting {
        grid: grid(&data),
        bank: Bank::Psi42,
        isovalue: 0.2,
        view: &view,
        method: &crate::OCTREE_CPU,
        threads: 1,
        clock: || Duration::ZERO,
    };
    let eye = levels::eye(&view).unwrap();
    let pyramid = crate::wavelet::Pyramid::new(setting.grid, setting.bank).unwrap();
    let epsilons = [0.8, 0.6, 0.4].map(|share| crate::wavelet::table::epsilon_for(&pyramid, eye, share));
    let mut borders = 0;
    for (row, picture) in setting.rows(eye, &epsilons, false).unwrap() {
        let shots = levels::transition(&setting, &row, &picture).unwrap();
        borders += usize::from(shots.len() == 2);
        for s in &shots {
            shows(&s.shaded);
            assert_eq!(s.picture.grid, picture.grid);
        }
        if shots.len() == 2 {
            assert_ne!(shots[0].shaded, shots[0].by_level);
        }
    }
    assert!(borders > 0, "a border of levels is in view");
}
