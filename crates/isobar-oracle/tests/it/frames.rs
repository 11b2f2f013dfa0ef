//! Truth of whole views, and frames held against it.

use crate::support::{Spline, field};
use isobar_core::{
    Channels, Claim, DVec3, Frame, Function, Hit, Interval, NO_SURFACE, Pixel, Ray, Stop, Surface, TRILINEAR, View,
};
use isobar_oracle::{Check, Class, Decided, Multiplicity, Truth, TruthError, check};
use std::sync::Arc;

fn plane() -> Arc<dyn Function> {
    // s = x + 2y - z in index space: exact for the trilinear reconstruction
    Arc::new(Spline::new([9; 3], &TRILINEAR, |i, j, k| i + 2.0 * j - k))
}

fn view(w: usize, h: usize) -> View {
    View::perspective(DVec3::new(-9.0, -7.0, 11.0), DVec3::splat(4.0), DVec3::Z, 35.0, w, h)
}

fn truth(f: &Arc<dyn Function>, surfaces: &[Surface], v: &View) -> Truth {
    Truth::compute(f, surfaces, v, &Stop::default()).unwrap()
}

/// The frame that says what the truth says.
fn perfect(f: &Arc<dyn Function>, truth: &Truth, v: &View) -> Frame {
    let channels = Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::T_ERROR | Channels::CLAIM;
    let mut frame = Frame::new(v.width, v.height, 1, channels);
    for (i, p) in truth.pixels.iter().enumerate() {
        let mut claim = Claim::EMPTY;
        if p.is_hit() {
            let at = v.ray(i % v.width, i / v.width).at(p.t());
            let n = f.gradient(at).normalize_or_zero().as_vec3().to_array();
            frame.set_hit(
                0,
                i,
                &Hit {
                    t: p.t(),
                    point: at,
                    normal: n,
                    surface: p.surface,
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
}

#[test]
fn the_truth_of_a_linear_field_is_the_plane() {
    let (f, v) = (plane(), view(64, 48));
    let t = truth(&f, &[Surface::isovalue(9.3, 0)], &v);
    let n = DVec3::new(1.0, 2.0, -1.0);
    let (mut hits, mut misses) = (0, 0);
    for (i, p) in t.pixels.iter().enumerate() {
        let r = v.ray(i % 64, i / 64);
        let at = (9.3 - n.dot(r.origin)) / n.dot(r.direction);
        let inside = |e: f64| {
            let x = r.at(at);
            at > 0.0 && x.min_element() >= -e && x.max_element() <= 8.0 + e
        };
        if inside(-1e-9) {
            assert!(p.is_hit() && (p.t() - at).abs() < 1e-13 * at && p.decided == Decided::F64);
            assert!((f64::from(p.slope) - n.dot(r.direction)).abs() < 1e-5);
            hits += 1;
        } else if !inside(1e-9) {
            assert!(!p.is_hit());
            misses += 1;
        }
    }
    assert!(hits > 300 && misses > 300);
    assert_eq!((t.hits(), t.stages().f64), (hits, 64 * 48));
}

#[test]
fn the_first_of_several_surfaces_counts_and_invisible_ones_do_not() {
    let (f, v) = (plane(), view(32, 24));
    let near = Surface::isovalue(0.5, 0);
    let far = Surface::isovalue(12.0, 1);
    let only_far = truth(&f, &[far], &v);
    let both = truth(&f, &[near, far], &v);
    let hidden = truth(&f, &[Surface { opacity: 0.0, ..near }, far], &v);
    let mut surfaces = [0; 2];
    for ((b, h), o) in both.pixels.iter().zip(&hidden.pixels).zip(&only_far.pixels) {
        assert_eq!((h.lo, h.hi), (o.lo, o.hi));
        assert!(!h.is_hit() || h.surface == 1);
        if b.is_hit() {
            surfaces[usize::from(b.surface)] += 1;
            assert!(b.lo <= o.lo);
        } else {
            assert_eq!(b.surface, NO_SURFACE);
        }
    }
    assert!(surfaces[0] > 50 && surfaces[1] > 50, "{surfaces:?}");
}

#[test]
fn what_cannot_be_certified_is_refused_and_stop_stops() {
    let (f, v) = (plane(), view(8, 6));
    let s = [Surface::isovalue(1.0, 0)];
    let mut clipped = v.clone();
    clipped.clips.push(isobar_core::ClipPlane {
        normal: DVec3::X,
        distance: 0.0,
        cap: true,
    });
    assert!(matches!(
        Truth::compute(&f, &s, &clipped, &Stop::default()),
        Err(TruthError::Unsupported(_))
    ));
    let boundary = Surface {
        kind: isobar_core::SurfaceKind::Boundary,
        ..s[0]
    };
    assert!(matches!(
        Truth::compute(&f, &[boundary], &v, &Stop::default()),
        Err(TruthError::Unsupported(_))
    ));
    let stop = Stop::default();
    stop.raise();
    assert_eq!(Truth::compute(&f, &s, &v, &stop), Err(TruthError::Stopped));
    let stop = Stop::default();
    Truth::compute(&f, &s, &v, &stop).unwrap();
    assert_eq!(stop.progress(), (6, 6));
    let frame = Frame::new(4, 4, 1, Channels::T);
    let t = truth(&f, &s, &v);
    assert!(matches!(check(&frame, &t, &f, &s, &v), Err(TruthError::Size { .. })));
    let frame = Frame::new(8, 6, 1, Channels::CLAIM);
    assert_eq!(check(&frame, &t, &f, &s, &v), Err(TruthError::Channel("t")));
}

fn sphere() -> (Arc<dyn Function>, [Surface; 2], View) {
    let f = field("sphere").function().clone();
    let v = View::perspective(DVec3::new(3.0, 0.5, 0.25), DVec3::ZERO, DVec3::Z, 40.0, 32, 24);
    (f, [Surface::isovalue(1.0, 0), Surface::isovalue(0.5, 1)], v)
}

#[test]
fn a_perfect_frame_is_clean() {
    let (f, s, v) = sphere();
    let t = truth(&f, &s, &v);
    let c = check(&perfect(&f, &t, &v), &t, &f, &s, &v).unwrap();
    assert!(
        c.is_clean() && c.unclaimed == 0 && c.hits == t.hits() && c.hits > 100,
        "{c:?}"
    );
    assert_eq!(c.pixels, 32 * 24);
    assert_eq!(c.t_error_voxels.max, 0.0);
    assert!(c.normal_error_deg.max < 1e-4);
    let two = Check::join([c.clone(), c.clone()]);
    assert_eq!(
        (two.pixels, two.hits, two.class.len()),
        (2 * c.pixels, 2 * c.hits, 2 * c.class.len())
    );
    assert_eq!(two.normal_error_deg, c.normal_error_deg);
}

/// One wrong pixel of each sort in an otherwise perfect frame.
#[test]
fn each_sort_of_error_is_counted() {
    let (f, s, v) = sphere();
    let t = truth(&f, &s, &v);
    let good = perfect(&f, &t, &v);
    let at = t
        .pixels
        .iter()
        .position(|p| p.is_hit() && !p.undecidable && p.surface == 0)
        .unwrap()
        + 3;
    let background = t.pixels.iter().position(|p| !p.is_hit() && !p.undecidable).unwrap();
    assert!(t.pixels[at].is_hit() && !t.pixels[at].undecidable);
    let exit = {
        let oracles = isobar_oracle::Oracles::new(&f, &s, &v.clips).unwrap();
        let (roots, _) = oracles.roots(&v.ray(at % 32, at / 32), f64::INFINITY);
        roots.last().unwrap().1.t()
    };
    let run = |change: &dyn Fn(&mut Frame)| {
        let mut frame = good.clone();
        change(&mut frame);
        check(&frame, &t, &f, &s, &v).unwrap()
    };
    let t0 = t.pixels[at].t();
    let sum = |c: &Check| [c.missed, c.false_hits, c.wrong_root, c.wrong_surface, c.refuted];
    // missed, with a false claim EMPTY
    let c = run(&|f| {
        f.t[at] = f64::INFINITY;
        f.claim[at] = Claim::EMPTY;
    });
    assert_eq!(
        (sum(&c), c.class[at], c.refuted_claims[at]),
        ([1, 0, 0, 0, 1], Class::Missed, Claim::EMPTY)
    );
    // invented
    let c = run(&|f| {
        f.t[background] = 3.0;
        f.claim[background] = Claim::EXISTS | Claim::FIRST;
        f.t_error[background] = 1e-3;
    });
    assert_eq!((sum(&c), c.class[background]), ([0, 1, 0, 0, 1], Class::FalseHit));
    assert_eq!(c.refuted_claims[background], Claim::EXISTS);
    // NaN
    let c = run(&|f| {
        f.t[at] = f64::NAN;
        f.claim[at] = Claim::empty();
    });
    assert_eq!((sum(&c), c.unclaimed), ([0, 1, 0, 0, 0], 1));
    // the far side
    let c = run(&|f| f.t[at] = exit);
    assert_eq!((sum(&c), c.class[at]), ([0, 0, 1, 0, 1], Class::WrongRoot));
    assert_eq!(c.refuted_claims[at], Claim::FIRST);
    // another name
    let c = run(&|f| f.surface[at] = 1);
    assert_eq!((sum(&c), c.class[at]), ([0, 0, 0, 1, 1], Class::WrongSurface));
    assert_eq!(c.refuted_claims[at], Claim::EXISTS);
    // an error within half a voxel is an error length, and a tight claim is refuted
    let voxel = f.domain().voxel();
    let c = run(&|f| f.t[at] = t0 + 0.01 * voxel);
    assert_eq!((sum(&c), c.class[at]), ([0, 0, 0, 0, 1], Class::RightHit));
    assert!((c.t_error_voxels.max - 0.01).abs() < 1e-8 && c.t_error_voxels.median == 0.0);
    let pixel = v.footprint(t0);
    assert!((c.t_error_pixels.max - 0.01 * voxel / pixel).abs() < 1e-5 * c.t_error_pixels.max);
    let c = run(&|f| {
        f.t[at] = t0 + 0.01 * voxel;
        f.t_error[at] = 0.02 * voxel;
    });
    assert_eq!(sum(&c), [0; 5]);
    // false claims about the kind of root
    let c = run(&|f| f.claim[at] |= Claim::TANGENT | Claim::INTERVAL);
    assert_eq!(c.refuted_claims[at], Claim::TANGENT | Claim::INTERVAL);
    // a normal the wrong way round
    let c = run(&|f| f.normal[at] = f.normal[at].map(|x| -x));
    assert!((c.normal_error_deg.max - 180.0).abs() < 1e-3);
}

/// Tangents, stretches and kinks: undecidable pixels have their own column, claims about them are still checked.
#[test]
fn undecidable_pixels_are_set_apart() {
    let f = field("sphere").function().clone();
    let s = [Surface::isovalue(1.0, 0)];
    let x = DVec3::X;
    let ray = |y: f64| Ray {
        origin: DVec3::new(-2.0, y, 0.0),
        direction: x,
    };
    let v = View::rays(vec![ray(1.0), ray(1.0 - 1e-9), ray(1.0 + 1e-9), ray(0.5), ray(1.2)]);
    let t = truth(&f, &s, &v);
    let flags: Vec<bool> = t.pixels.iter().map(|p| p.undecidable).collect();
    assert_eq!(flags, [true, true, true, false, false]);
    assert_eq!(t.pixels[0].multiplicity, Some(Multiplicity::Even(2)));
    let mut frame = Frame::new(5, 1, 1, Channels::T | Channels::CLAIM | Channels::T_ERROR);
    // nothing hit anywhere, and a proof of it claimed for the first
    frame.claim[0] = Claim::EMPTY;
    let c = check(&frame, &t, &f, &s, &v).unwrap();
    assert_eq!(
        (c.missed, c.undecidable, c.undecidable_differs, c.refuted, c.unclaimed),
        (1, 3, 2, 1, 4)
    );
    // a right claim of a tangent
    frame.t[0] = 2.0;
    frame.t_error[0] = 0.0;
    frame.claim[0] = Claim::EXISTS | Claim::FIRST | Claim::TANGENT;
    let c = check(&frame, &t, &f, &s, &v).unwrap();
    assert_eq!((c.undecidable_differs, c.refuted, c.unclaimed), (1, 0, 4));
    assert!(c.t_error_pixels.max.is_nan());
}

/// A silhouette sweep: near-tangent rays are flagged, the others are not, whichever side they fall on.
#[test]
fn undecidable_follows_the_limit() {
    let o = Spline::new([9; 3], &TRILINEAR, |i, j, _| (i - 4.0).abs() + j * 1e-3).oracle(1.0);
    // kink at i = 4 with s = y / 1000; s - c = 0 there at y = 1000: shift the isovalue instead
    for (c, want) in [
        (1e-3, true),
        (1e-3 + 1e-8, true),
        (1e-3 - 1e-8, true),
        (1e-3 + 1e-5, false),
        (1e-3 - 1e-5, false),
    ] {
        let r = Ray {
            origin: DVec3::new(-1.0, 1.0, 4.5),
            direction: DVec3::X,
        };
        assert_eq!(o.with_isovalue(c).undecidable(&r), want, "{c}");
    }
    let _: Interval = o.function().enclosure(DVec3::ZERO, DVec3::ONE);
}

#[test]
fn the_cache_reads_what_it_wrote() {
    let (f, s, v) = sphere();
    let t = truth(&f, &s, &v);
    let bytes = t.to_bytes();
    assert_eq!(Truth::from_bytes(&bytes), Ok(t));
    assert!(matches!(Truth::from_bytes(&bytes[1..]), Err(TruthError::Corrupt(_))));
}
