//! Clipping planes: first roots in the kept part, with exact answers.

use crate::support::{Random, Spline, algebraic, field, ray};
use isobar_core::{
    CUBIC, Channels, Claim, ClipPlane, DMat3, DVec3, Frame, Function, Hit, Pixel, QUADRATIC, Stop, Surface, TRILINEAR, View,
};
use isobar_oracle::{Answer, Class, Decided, Multiplicity, Oracle, Truth, check};
use std::sync::Arc;

fn plane(normal: [f64; 3], distance: f64) -> ClipPlane {
    ClipPlane {
        normal: normal.into(),
        distance,
        cap: false,
    }
}

/// The unit sphere as a polynomial.
fn sphere() -> Oracle {
    algebraic(&[([2, 0, 0], 1.0), ([0, 2, 0], 1.0), ([0, 0, 2], 1.0), ([0; 3], -1.0)], 2.0)
}

#[test]
fn a_plane_takes_the_near_half_of_a_sphere_away() {
    let r = ray([-3.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
    let first = |clips: &[ClipPlane]| sphere().with_clips(clips).first(&r);
    let at = |a: &Answer, t: f64| a.hit().is_some_and(|h| h.lo <= t && t <= h.hi && h.hi - h.lo < 1e-13 * t);
    assert!(at(&first(&[]), 2.0));
    // x >= 0: the inside of the far half
    let half = plane([-2.0, 0.0, 0.0], 0.0);
    assert!(at(&first(&[half]), 4.0));
    let hit = *first(&[half]).hit().unwrap();
    assert!(hit.multiplicity == Multiplicity::Simple && hit.slope > 0.0);
    assert!(!sphere().with_clips(&[half]).undecidable(&r));
    // 0 <= x <= 1/2: nothing, and decidable
    let slab = [half, plane([1.0, 0.0, 0.0], 0.5)];
    assert!(matches!(first(&slab), Answer::Miss { .. }) && !sphere().with_clips(&slab).undecidable(&r));
    // x >= 1/2 and x <= -1/2 keep nothing, planes beside the ray all or nothing
    assert!(matches!(
        first(&[plane([-1.0, 0.0, 0.0], -0.5), plane([1.0, 0.0, 0.0], -0.5)]),
        Answer::Miss { .. }
    ));
    assert!(at(&first(&[plane([0.0, 1.0, 0.0], 0.25)]), 2.0));
    assert!(matches!(first(&[plane([0.0, 1.0, 0.0], -0.25)]), Answer::Miss { .. }));
}

/// A plane through the hit: the point is kept from both sides, and one f64 farther it is not; the pixel is undecidable each time.
#[test]
fn a_plane_through_the_hit_keeps_it_exactly() {
    let r = ray([-3.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
    let spline = || Spline::new([9; 3], &TRILINEAR, |i, _, _| i - 4.0).placed(DVec3::splat(-4.0), DMat3::IDENTITY);
    // the sphere's first root is at x = -1, the plane's at x = 0
    let cases: [(Oracle, f64); 2] = [(sphere(), -1.0), (spline().oracle(0.0), 0.0)];
    for (o, x) in cases {
        let t = x + 3.0;
        for stage in [Decided::F64, Decided::DoubleDouble, Decided::Exact] {
            let o = o.with_stage(stage);
            let at = |clip: ClipPlane| {
                let o = o.with_clips(&[clip]);
                let hit = o.first(&r).hit().map(|h| (h.lo + h.hi) / 2.0);
                (hit.map(|h| (h - t).abs() < 1e-13), o.undecidable(&r))
            };
            let through = (Some(true), true);
            assert_eq!(at(plane([1.0, 0.0, 0.0], x)), through);
            assert_eq!(at(plane([-1.0, 0.0, 0.0], -x)), through);
            assert_eq!(at(plane([3.0, 0.0, 0.0], 3.0 * x)), through);
            // just before the root: x <= x0 - tiny; just behind it: x >= x0 + tiny
            let tiny = 1e-12;
            assert_eq!(at(plane([1.0, 0.0, 0.0], x - tiny)), (None, true));
            let (hit, undecidable) = at(plane([-1.0, 0.0, 0.0], -x - tiny));
            assert!(undecidable && hit != Some(true), "{hit:?}");
            // far enough away it is an ordinary pixel
            assert_eq!(at(plane([1.0, 0.0, 0.0], x - 0.01)), (None, false));
            assert_eq!(at(plane([1.0, 0.0, 0.0], x + 0.01)), (Some(true), false));
        }
    }
}

/// A stretch s = c is cut to what is kept.
#[test]
fn stretches_are_cut() {
    let f = |i: f64, _: f64, _: f64| if (2.0..=5.0).contains(&i) { 1.0 } else { 0.0 };
    let o = Spline::new([8; 3], &TRILINEAR, f).oracle(1.0);
    let r = ray([-1.0, 3.3, 3.4], [1.0, 0.0, 0.0]);
    let stretch = |clips: &[ClipPlane]| {
        let all = o.with_clips(clips).all(&r);
        all.roots.iter().map(|h| (h.lo, h.interval_end)).collect::<Vec<_>>()
    };
    assert_eq!(stretch(&[]), [(3.0, Some(6.0))]);
    assert_eq!(stretch(&[plane([-1.0, 0.0, 0.0], -2.5)]), [(3.5, Some(6.0))]);
    let both = [plane([-1.0, 0.0, 0.0], -2.5), plane([1.0, 0.0, 0.0], 4.75)];
    assert_eq!(stretch(&both), [(3.5, Some(5.75))]);
}

/// Random planes over random splines, polynomials and fields: the first root is the first of all roots in the kept part.
#[test]
fn the_first_kept_root_is_the_first_of_all_that_are_kept() {
    let mut random = Random(77);
    let bases = [&TRILINEAR, &QUADRATIC, &CUBIC];
    let (mut hits, mut later, mut misses, mut undecidable) = (0, 0, 0, 0);
    for n in 0..600 {
        let o = if n % 12 == 0 {
            field("gyroid")
        } else if n % 12 == 1 {
            field("barth-sextic")
        } else {
            let values: Vec<f64> = (0..216).map(|_| random.within(-1.0, 1.0)).collect();
            let at = |i: f64, j: f64, k: f64| values[(k * 36.0 + j * 6.0 + i) as usize];
            Spline::new([6; 3], bases[n % 3], at)
                .placed(DVec3::splat(-2.5), DMat3::IDENTITY)
                .oracle(0.1)
        };
        let mut clips = Vec::new();
        for _ in 0..1 + random.below(3) {
            clips.push(plane(random.vector(-1.0, 1.0).to_array(), random.within(-0.5, 1.0)));
        }
        let clipped = o.with_clips(&clips);
        for _ in 0..4 {
            let from = random.vector(-4.0, 4.0);
            let r = ray(from.to_array(), (random.vector(-0.8, 0.8) - from).to_array());
            let kept = |t: f64| {
                clips
                    .iter()
                    .map(|c| c.normal.dot(r.at(t)) - c.distance)
                    .fold(f64::NEG_INFINITY, f64::max)
            };
            let all = o.all(&r);
            if clipped.undecidable(&r) || !all.unresolved.is_empty() || all.roots.iter().any(|h| kept(h.t()).abs() < 1e-9) {
                undecidable += 1;
                continue;
            }
            let want = all.roots.iter().find(|h| kept(h.t()) < 0.0);
            let got = clipped.first(&r);
            match (want, got.hit()) {
                (None, None) => misses += 1,
                (Some(w), Some(g)) => {
                    assert!(
                        g.lo <= w.hi && w.lo <= g.hi && g.multiplicity == w.multiplicity,
                        "{g:?} for {w:?}"
                    );
                    hits += 1;
                    later += usize::from(w.lo > all.roots[0].hi);
                }
                other => panic!("{other:?} with {clips:?} on {r:?}"),
            }
            let exact = clipped.with_stage(Decided::Exact).first(&r);
            assert_eq!(exact.hit().is_some(), got.hit().is_some());
            if let (Some(e), Some(g)) = (exact.hit(), got.hit()) {
                assert!(e.lo <= g.hi && g.lo <= e.hi);
            }
            assert_eq!(
                clipped.all(&r).roots.len(),
                all.roots.iter().filter(|h| kept(h.t()) < 0.0).count()
            );
        }
    }
    assert!(
        hits > 500 && later > 200 && misses > 300 && undecidable < 100,
        "{hits} {later} {misses} {undecidable}"
    );
}

/// A frame of the unclipped surface held against a clipped truth: pixels at the part cut away are at a wrong root or missed, and
/// their claims are refuted.
#[test]
fn a_frame_that_ignores_the_planes_is_found_out() {
    let f: Arc<dyn Function> = field("sphere").function().clone();
    let s = [Surface::isovalue(1.0, 0)];
    let open = View::perspective(DVec3::new(4.0, 0.3, 0.2), DVec3::ZERO, DVec3::Z, 35.0, 40, 30);
    let mut cut = open.clone();
    cut.clips = vec![plane([1.0, 0.0, 0.0], 0.25), plane([0.0, 0.0, 1.0], 0.5)];
    let truth = |v: &View| Truth::compute(&f, &s, v, &Stop::default()).unwrap();
    let (whole, clipped) = (truth(&open), truth(&cut));
    let mut behind = 0;
    for (i, p) in clipped.pixels.iter().enumerate().filter(|(_, p)| p.is_hit()) {
        let x = cut.ray(i % 40, i / 40).at(p.t());
        assert!((x.length() - 1.0).abs() < 1e-9 && x.x < 0.25 + 1e-9 && x.z < 0.5 + 1e-9);
        behind += usize::from(x.x < 0.0);
    }
    assert!(behind > 100 && clipped.undecidable() < 10, "{behind}");
    let frame_of = |t: &Truth| {
        let mut frame = Frame::new(40, 30, 1, Channels::T | Channels::T_ERROR | Channels::CLAIM);
        for (i, p) in t.pixels.iter().enumerate() {
            let mut claim = Claim::EMPTY;
            if p.is_hit() {
                frame.set_hit(
                    0,
                    i,
                    &Hit {
                        t: p.t(),
                        point: DVec3::ZERO,
                        normal: [0.0; 3],
                        surface: 0,
                        t_error: 1e-9,
                    },
                );
                claim = Claim::EXISTS | Claim::FIRST;
            }
            frame.set_pixel(
                i,
                &Pixel {
                    claim,
                    ..Pixel::default()
                },
            );
        }
        frame
    };
    let right = check(&frame_of(&clipped), &clipped, &f, &s, &cut).unwrap();
    assert!(right.is_clean(), "{right:?}");
    let wrong = check(&frame_of(&whole), &clipped, &f, &s, &cut).unwrap();
    assert!(wrong.false_hits > 100 && wrong.refuted >= wrong.false_hits && !wrong.class.contains(&Class::Missed));
}
