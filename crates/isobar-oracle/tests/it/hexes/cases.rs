//! Hardcases D and degenerate rays, with exact answers.

use super::{cuboid, element, expect, net, oracle, position, roots, towards};
use crate::support::{Random, ray};
use isobar_core::{DVec3, HexElement};
use isobar_oracle::{Answer, Decided, Doubt, Multiplicity};
use std::f64::consts::FRAC_1_SQRT_2;

/// The quarter annulus of D1, radii 1 to 2, z from 0 to 1, attribute v.
fn annulus() -> HexElement {
    let arc = [[1.0, 0.0, 1.0], [1.0, 1.0, FRAC_1_SQRT_2], [0.0, 1.0, 1.0]];
    let points = net([2, 1, 1], |[i, j, k]| {
        let r = 1.0 + j as f64;
        [r * arc[i][0], r * arc[i][1], k as f64, arc[i][2]]
    });
    element([2, 1, 1], points, [0, 1, 0], vec![0.0, 1.0])
}

#[test]
fn d1_a_rational_quarter_annulus() {
    let o = oracle(vec![annulus()], 0.5);
    expect(&o, &ray([0.0, 0.9, 0.5], [1.0, 0.0, 0.0]), &[1.2]);
    // x(1, 1/2, 1/2) = (0, 3/2, 1/2): the ray touches the circle at the edge of the patch. Integers find it, nothing tells how it touches.
    let touching = ray([-1.0, 1.5, 0.5], [1.0, 0.0, 0.0]);
    let got = roots(&o, &touching);
    assert!(got.len() == 1 && (got[0].0 - 1.0).abs() < 1e-12, "{got:?}");
    assert_eq!(got[0].1, Multiplicity::Unknown);
    assert_eq!(o.all(&touching).decided, Decided::Exact);
    assert!(o.undecidable(&touching));
    // A little above there is nothing, a little below one root: the other half of the circle is not there.
    assert!(roots(&o, &ray([-1.0, 1.5 + 1e-9, 0.5], [1.0, 0.0, 0.0])).is_empty());
    let below = roots(&o, &ray([-1.0, 1.5 - 1e-9, 0.5], [1.0, 0.0, 0.0]));
    assert!(
        below.len() == 1 && (below[0].0 - 1.0 - (3e-9f64).sqrt()).abs() < 1e-9,
        "{below:?}"
    );
    assert!(!o.undecidable(&ray([0.0, 0.9, 0.5], [1.0, 0.0, 0.0])));
}

#[test]
fn d2_a_bent_element_is_entered_twice() {
    // 0.2 w + u (1 - u): Bernstein coefficients 0, 1/2, 0 in u
    let points = net([2, 1, 1], |[i, j, k]| {
        let bend = if i == 1 { 0.5 } else { 0.0 };
        [i as f64 / 2.0, j as f64, 0.2 * k as f64 + bend, 1.0]
    });
    let o = oracle(vec![element([2, 1, 1], points, [0, 0, 1], vec![0.0, 1.0])], 0.5);
    let want = [0.1127016653792583, 0.8872983346207417];
    expect(&o, &ray([-1.0, 0.5, 0.2], [1.0, 0.0, 0.0]), &want.map(|x| x + 1.0));
}

/// V = (u^2, v, w), A = u.
#[test]
fn d3_a_jacobian_that_vanishes_on_a_face() {
    let points = net([2, 1, 1], |[i, j, k]| [f64::from(u8::from(i == 2)), j as f64, k as f64, 1.0]);
    let all = element([2, 1, 1], points, [1, 0, 0], vec![0.0, 1.0]);
    for a in [0.5, 0.1, 1e-2, 1e-4] {
        let o = oracle(vec![all.clone()], a);
        expect(&o, &ray([-0.5, 0.25, 0.75], [1.0, 0.0, 0.0]), &[a * a + 0.5]);
        let got = roots(&o, &ray([-0.5, 0.25, 0.75], [1.0, 0.125, 0.0625]));
        assert!(got.len() == 1 && (got[0].0 - a * a - 0.5).abs() < 1e-14);
        // From the other side, and from where t = a^2 itself: the bracket keeps relative accuracy.
        let near = o.all(&ray([0.0, 0.25, 0.75], [1.0, 0.0, 0.0])).roots;
        assert!(near.len() == 1 && (near[0].t() - a * a).abs() <= 1e-13 * a * a, "{near:?}");
    }
    // On the face itself, where the Jacobian is 0: u = 0 is on the boundary of the element.
    expect(&oracle(vec![all], 0.0), &ray([-0.5, 0.25, 0.75], [1.0, 0.0, 0.0]), &[0.5]);
}

/// V = (u, u v, w), A = v.
#[test]
fn d4_a_collapsed_face() {
    let points = net([1; 3], |[i, j, k]| [i as f64, (i * j) as f64, k as f64, 1.0]);
    let o = oracle(vec![element([1; 3], points, [0, 1, 0], vec![0.0, 1.0])], 0.5);
    for n in 1..=9 {
        let e = 10f64.powi(-n);
        expect(&o, &ray([e, -1.0, 0.5], [0.0, 1.0, 0.0]), &[1.0 + 0.5 * e]);
        let near = o.all(&ray([e, 0.0, 0.5], [0.0, 1.0, 0.0])).roots;
        assert!(near.len() == 1 && (near[0].t() - 0.5 * e).abs() <= 1e-13 * e, "{near:?}");
    }
    // Along the collapsed edge every v is at the same point.
    expect(&o, &ray([0.0, -1.0, 0.5], [0.0, 1.0, 0.0]), &[1.0]);
}

/// V = (4 u^2 - 3 u, v, w), A = u: folded at u = 3/8.
#[test]
fn d5_a_folded_element() {
    let points = net([2, 1, 1], |[i, j, k]| [[0.0, -1.5, 1.0][i], j as f64, k as f64, 1.0]);
    let folded = element([2, 1, 1], points, [1, 0, 0], vec![0.0, 1.0]);
    let r = ray([-2.0, 0.5, 0.25], [1.0, 0.0, 0.0]);
    expect(&oracle(vec![folded.clone()], 0.25), &r, &[1.5]);
    // On the fold itself: x(3/8) = -9/16.
    expect(&oracle(vec![folded.clone()], 0.375), &r, &[2.0 - 0.5625]);
    // With A = (2 u - 1)^2 = 1 at both ends: x = 0 and 1; and 1/4 at u = 1/4 and 3/4: x = -1/2 and 0.
    let mut both = folded;
    (both.value_degree, both.values) = ([2, 0, 0], vec![1.0, -1.0, 1.0].into());
    expect(&oracle(vec![both.clone()], 0.25), &r, &[1.5, 2.0]);
    expect(&oracle(vec![both.clone()], 1.0), &r, &[2.0, 3.0]);
    // With A = 0 the two sheets touch at u = 1/2; the derivative vanishes there. Integers find u = 1/2.
    let o = oracle(vec![both], 0.0);
    assert_eq!(roots(&o, &r), [(1.5, Multiplicity::Unknown)]);
}

/// Two sheets of a fold at one t: one root.
#[test]
fn sheets_that_meet_on_the_ray_are_one_root() {
    // x = 4 (u - 1/2)^2, A = (u - 1/2)^2: x = 4 A, so that both u with A = 1/16 have x = 1/4.
    let points = net([2, 1, 1], |[i, j, k]| [[1.0, -1.0, 1.0][i], j as f64, k as f64, 1.0]);
    let fold = element([2, 1, 1], points, [2, 0, 0], vec![0.25, -0.25, 0.25]);
    let o = oracle(vec![fold], 0.0625);
    let got = o.all(&ray([-1.0, 0.5, 0.5], [1.0, 0.0, 0.0]));
    assert!(got.roots.len() == 1 && got.unresolved.is_empty(), "{got:?}");
    assert!(got.roots[0].lo <= 1.25 && got.roots[0].hi >= 1.25);
}

/// A face with corners in no plane, shared by two elements; the attribute is x on both, exactly x(u) by its coefficients.
#[test]
fn d8_a_face_that_is_not_flat() {
    let bend = [[0.0, 0.2], [-0.15, 0.1]];
    let two: Vec<HexElement> = (0..2)
        .map(|n| {
            let x = |[i, j, k]: [usize; 3]| match i + n {
                0 => -1.0,
                1 => bend[j][k],
                _ => 1.0,
            };
            let points = net([1; 3], |i| [x(i), i[1] as f64, i[2] as f64, 1.0]);
            let values = points.iter().map(|p| p[0]).collect();
            element([1; 3], points, [1; 3], values)
        })
        .collect();
    let mut random = Random(5);
    for _ in 0..300 {
        let u = DVec3::new(1.0, random.unit(), random.unit());
        let at = position(&two[0], u);
        // The surface x = c is the plane, through a point of the face up to rounding.
        let o = oracle(two.clone(), at.x);
        let d = random.vector(-1.0, 1.0) + DVec3::new(1.5, 0.0, 0.0);
        let r = isobar_core::Ray {
            origin: at - d,
            direction: d,
        };
        let all = o.all(&r);
        assert!(all.unresolved.is_empty() && all.roots.len() == 1, "{all:?}");
        assert!((all.roots[0].t() - 1.0).abs() < 1e-12 && all.roots[0].multiplicity == Multiplicity::Simple);
    }
}

/// The cell of the issue: its control net rises to 1.5, the attribute 3 u (1 - u) only to 3/4.
#[test]
fn a_bezier_cell_is_lower_than_its_net() {
    let cell = cuboid(DVec3::ZERO, DVec3::ONE, [2, 0, 0], vec![0.0, 1.5, 0.0]);
    let along = ray([-1.0, 0.3125, 0.625], [1.0, 0.0, 0.0]);
    let mut random = Random(9);
    for _ in 0..300 {
        let r = super::through(&mut random, DVec3::ZERO, DVec3::ONE);
        assert!(matches!(
            oracle(vec![cell.clone()], 0.9).first(&r),
            Answer::Miss { decided: Decided::F64 }
        ));
    }
    assert!(roots(&oracle(vec![cell.clone()], 0.75 + 1e-9), &along).is_empty());
    assert_eq!(
        roots(&oracle(vec![cell.clone()], 0.75), &along),
        [(1.5, Multiplicity::Unknown)]
    );
    let w = (0.25 - 0.5f64 / 3.0).sqrt();
    expect(&oracle(vec![cell], 0.5), &along, &[1.5 - w, 1.5 + w]);
}

/// Eight cubes about a point, attribute x + 2 y + 4 z: rays through the corner, along edges, in faces.
#[test]
fn corners_edges_and_faces() {
    let f = |p: DVec3| p.x + 2.0 * p.y + 4.0 * p.z;
    let cubes: Vec<HexElement> = (0..8)
        .map(|n| {
            let lo = DVec3::new(f64::from(n & 1) - 1.0, f64::from(n >> 1 & 1) - 1.0, f64::from(n >> 2) - 1.0);
            let values = net([1; 3], |i| [f(lo + DVec3::from_array(i.map(|v| v as f64))), 0.0, 0.0, 0.0]);
            cuboid(lo, lo + 1.0, [1; 3], values.iter().map(|v| v[0]).collect())
        })
        .collect();
    let o = oracle(cubes.clone(), 0.0);
    // Through the corner, in all directions: one root each.
    for d in [
        [1.0, 1.0, 1.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 1.0, 0.0],
        [0.5, -0.25, 1.0],
        [-1.0, -0.3, -0.7],
    ] {
        expect(&o, &ray(d.map(|x| -2.0 * x), d), &[2.0]);
    }
    // Along an edge of four cubes and in faces of two, at another value; and leaving the cubes by an edge.
    let o = oracle(cubes.clone(), 0.25);
    expect(&o, &ray([-2.0, 0.0, 0.0], [1.0, 0.0, 0.0]), &[2.25]);
    expect(&o, &ray([0.0, -2.0, 0.1], [0.0, 1.0, 0.0]), &[2.0 + 0.5 * (0.25 - 0.4)]);
    expect(&o, &ray([-2.0, -0.3, 0.0], [1.0, 0.0, 0.0]), &[2.85]);
    expect(&o, &ray([-2.0, 0.0, -0.1], [1.0, 0.3, 0.0]), &[2.65 / 1.6]);
    expect(&o, &towards([-1.0, 1.0, -2.0], [-1.0, 1.0, 1.0]), &[(2.0 - 0.1875) / 3.0]);
    // The value at an outer corner: touched there, in one point.
    let o = oracle(cubes, 7.0);
    expect(&o, &towards([3.0, 3.0, 3.0], [1.0, 1.0, 1.0]), &[1.0]);
    expect(&o, &towards([3.0, -1.0, 1.0], [1.0, 1.0, 1.0]), &[1.0]);
}

/// The surface is the side of the element: a Dirichlet value on the boundary.
#[test]
fn a_surface_that_is_a_face() {
    let o = oracle(vec![annulus()], 0.0);
    // r = 1, from inside and outside
    expect(&o, &ray([0.0, 0.0, 0.5], [0.6, 0.8, 0.0]), &[1.0]);
    let mut random = Random(31);
    for _ in 0..50 {
        let angle = random.within(0.05, 1.5);
        let r = towards([3.0, 3.0, random.unit()], [angle.cos(), angle.sin(), random.within(0.1, 0.9)]);
        let all = o.all(&r);
        let certain = all.unresolved.is_empty() && all.roots.len() == 1 && all.roots[0].multiplicity == Multiplicity::Simple;
        assert!(certain && (all.roots[0].t() - 1.0).abs() < 1e-13, "{all:?}");
    }
}

/// A ray in the surface: a stretch that stays open, with its reason; others see it as usual.
#[test]
fn rays_in_the_surface_stay_open() {
    let flat = cuboid(DVec3::ZERO, DVec3::ONE, [0, 0, 1], vec![-1.0, 1.0]);
    let o = oracle(vec![flat], 0.0);
    let inside = ray([-1.0, 0.25, 0.5], [1.0, 0.5, 0.0]);
    let doubts = o.doubts(&inside);
    assert!(o.all(&inside).roots.is_empty() || o.all(&inside).roots[0].multiplicity == Multiplicity::Unknown);
    let (lo, hi) = (doubts[0].0, doubts[doubts.len() - 1].1);
    assert!((lo - 1.0).abs() < 1e-6 && (hi - 1.5).abs() < 1e-6, "{doubts:?}");
    assert!(o.undecidable(&inside));
    expect(&o, &ray([-1.0, 0.25, 0.5 - 0.25], [1.0, 0.0, 0.1875]), &[4.0 / 3.0]);
    assert!(
        doubts.iter().all(|d| matches!(d.2, Doubt::Tangent | Doubt::Limit)),
        "{doubts:?}"
    );
}
