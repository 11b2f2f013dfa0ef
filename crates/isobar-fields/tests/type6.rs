//! The type-6 spline in exact arithmetic: masks, smoothness, reproduced polynomials (hardcases B11b, B14, B15; maths: corrections, section A).

use isobar_core::{DMat3, DVec3, Function, Grid, Samples, Tetrahedral};
use isobar_fields::Type6Spline;
use isobar_fields::type6::{
    DeterminingSet, TYPE6, barycentric, canonical, canonical_gradient, coefficients, coefficients_192, from_canonical, kind_of,
    last_step, reorder, two_steps,
};
use std::collections::BTreeMap;

/// A seeded generator.
struct Random(u64);
impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 20
    }
    fn integer(&mut self) -> i64 {
        (self.bits() % 2_000_001) as i64 - 1_000_000
    }
    fn unit(&mut self) -> f64 {
        (self.bits() % (1 << 40)) as f64 / (1u64 << 40) as f64
    }
}

fn data(random: &mut Random) -> [i64; 27] {
    std::array::from_fn(|_| random.integer())
}

#[test]
fn masks_are_averages_of_23_data() {
    for kind in 0..24 {
        let w = &TYPE6.weights[kind];
        for row in w {
            assert_eq!(row.iter().map(|&v| i32::from(v)).sum::<i32>(), TYPE6.denominator);
        }
        let used = (0..27).filter(|&n| w.iter().any(|row| row[n] > 0)).count();
        assert_eq!(used, 23, "kind {kind}");
    }
}

/// Directly from 23 data, by the masks, and through the determining set: the same integers.
#[test]
fn three_ways_to_the_coefficients_agree() {
    let mut random = Random(1);
    for _ in 0..50 {
        let d = data(&mut random);
        let set = DeterminingSet::new(&d);
        for kind in 0..24 {
            let direct = coefficients_192(&reorder(kind, &d));
            let masks: [i64; 20] = std::array::from_fn(|i| (0..27).map(|n| i64::from(TYPE6.weights[kind][i][n]) * d[n]).sum());
            assert_eq!(direct, masks, "kind {kind}");
            assert_eq!(set.coefficients(kind), masks, "kind {kind}");
        }
    }
}

type Point = [i64; 3];

/// A tetrahedron of the block: absolute vertices in half steps, the centre, coefficients times 192.
struct Tet {
    kind: usize,
    centre: Point,
    vertices: [Point; 4],
    b: BTreeMap<[u8; 4], i64>,
}

fn block(random: &mut Random) -> Vec<Tet> {
    let samples: Vec<i64> = (0..125).map(|_| random.integer()).collect();
    let mut all = Vec::new();
    for cube in 0..27i64 {
        let c = [cube % 3 + 1, cube / 3 % 3 + 1, cube / 9 + 1];
        let d: [i64; 27] = std::array::from_fn(|n| {
            let o = [n as i64 % 3 - 1, n as i64 / 3 % 3 - 1, n as i64 / 9 - 1];
            samples[((c[2] + o[2]) * 25 + (c[1] + o[1]) * 5 + c[0] + o[0]) as usize]
        });
        for kind in 0..24 {
            let b = coefficients_192(&reorder(kind, &d));
            let centre = c.map(|v| 2 * v);
            all.push(Tet {
                kind,
                centre,
                vertices: TYPE6.vertices[kind].map(|v| std::array::from_fn(|a| centre[a] + i64::from(v[a]))),
                b: TYPE6.indices.iter().copied().zip(b).collect(),
            });
        }
    }
    all
}

/// Twice the barycentric coordinates of a point.
fn twice_phi(t: &Tet, p: Point) -> [i64; 4] {
    TYPE6.barycentric[t.kind]
        .map(|row| 2 * i64::from(row[0]) + (0..3).map(|a| i64::from(row[1 + a]) * (p[a] - t.centre[a])).sum::<i64>())
}

/// C0 and C1 (the paper's equation 2) across all interior faces of 3x3x3 cubes of random integers.
#[test]
fn pieces_join_with_continuous_gradients() {
    let tets = block(&mut Random(7));
    for t in &tets {
        for (v, p) in t.vertices.iter().enumerate() {
            let want: [i64; 4] = std::array::from_fn(|n| 2 * i64::from(n == v));
            assert_eq!(twice_phi(t, *p), want);
        }
    }
    let mut faces: BTreeMap<[Point; 3], Vec<(usize, usize)>> = BTreeMap::new();
    for (n, t) in tets.iter().enumerate() {
        for opposite in 0..4 {
            let mut face: Vec<Point> = (0..4).filter(|&v| v != opposite).map(|v| t.vertices[v]).collect();
            face.sort_unstable();
            faces.entry([face[0], face[1], face[2]]).or_default().push((n, opposite));
        }
    }
    let mut interior = 0;
    for pair in faces.values().filter(|f| f.len() == 2) {
        interior += 1;
        let ((n, opposite), (m, other)) = (pair[0], pair[1]);
        let (t, u) = (&tets[n], &tets[m]);
        // Vertex of u for each vertex of t on the face.
        let partner: Vec<usize> = (0..4)
            .map(|v| (0..4).find(|&w| u.vertices[w] == t.vertices[v]).unwrap_or(other))
            .collect();
        let phi = twice_phi(t, u.vertices[other]);
        for (index, &value) in &t.b {
            if index[opposite] == 0 {
                let mut same = [0; 4];
                (0..4).filter(|&v| v != opposite).for_each(|v| same[partner[v]] = index[v]);
                assert_eq!(u.b[&same], value, "C0");
            }
            if index[opposite] == 1 {
                // The same two steps on the face, and the third to the opposite vertex of u.
                let mut alpha = *index;
                alpha[opposite] = 0;
                let extended: i64 = (0..4)
                    .map(|v| {
                        let mut i = alpha;
                        i[v] += 1;
                        phi[v] * t.b[&i]
                    })
                    .sum();
                let mut across = [0; 4];
                (0..4).filter(|&v| v != opposite).for_each(|v| across[partner[v]] = alpha[v]);
                across[other] = 1;
                assert_eq!(2 * u.b[&across], extended, "C1");
            }
        }
    }
    assert_eq!(interior, 1188);
}

/// `27 * 192 * s` at the domain points against a cubic form: `216 p(n/6)` with the plus of the constant defect in quarters.
#[test]
fn polynomials_come_back() {
    // name, p homogeneous of degree 3 in (x, y, z, w), defect times four
    type Form = fn([i64; 4]) -> i64;
    let cases: [(&str, Form, i64); 11] = [
        ("1", |[_, _, _, w]| w * w * w, 0),
        ("x", |[x, _, _, w]| x * w * w, 0),
        ("y", |[_, y, _, w]| y * w * w, 0),
        ("z", |[_, _, z, w]| z * w * w, 0),
        ("xy", |[x, y, _, w]| x * y * w, 0),
        ("xz", |[x, _, z, w]| x * z * w, 0),
        ("yz", |[_, y, z, w]| y * z * w, 0),
        ("xyz", |[x, y, z, _]| x * y * z, 0),
        ("x^2", |[x, _, _, w]| x * x * w, 1),
        ("y^2", |[_, y, _, w]| y * y * w, 1),
        ("z^2", |[_, _, z, w]| z * z * w, 1),
    ];
    let centre = [3i64, -7, 11];
    for (name, p, defect) in cases {
        let d: [i64; 27] = std::array::from_fn(|n| {
            let n = n as i64;
            p([centre[0] + n % 3 - 1, centre[1] + n / 3 % 3 - 1, centre[2] + n / 9 - 1, 1])
        });
        for kind in 0..24 {
            let b = coefficients_192(&reorder(kind, &d));
            for at in TYPE6.indices {
                // s = sum b 6/(i! j! k! l!) (at/3)^(ijkl)
                let fact = |n: u8| i64::from([1, 1, 2, 6][usize::from(n)]);
                let s: i64 = TYPE6
                    .indices
                    .iter()
                    .zip(b)
                    .map(|(i, b)| {
                        let multinomial = 6 / i.iter().map(|&n| fact(n)).product::<i64>();
                        b * multinomial * (0..4).map(|v| i64::from(at[v]).pow(i[v].into())).product::<i64>()
                    })
                    .sum();
                // sum at_v v_v / 3 in half steps: sixths of a step
                let x = |a: usize| {
                    6 * centre[a]
                        + (0..4)
                            .map(|v| i64::from(at[v]) * i64::from(TYPE6.vertices[kind][v][a]))
                            .sum::<i64>()
                };
                let want = p([x(0), x(1), x(2), 6]) + 54 * defect;
                assert_eq!(s * 216, want * 27 * 192, "{name}, kind {kind}");
            }
        }
    }
}

fn noise(dims: [usize; 3], seed: u64) -> Grid {
    let mut random = Random(seed);
    let samples: Vec<f32> = (0..dims.iter().product()).map(|_| random.unit() as f32).collect();
    let spacing = DVec3::new(1.0, 0.5, 2.0);
    let turn = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(1.0);
    Grid::new(dims, spacing, DVec3::new(0.5, 2.0, -1.0), turn, Samples::F32(samples.into())).unwrap()
}

/// The f64 function at random points against the masks; the gradient against differences; values outside are those of the nearest point.
#[test]
fn the_function_is_the_spline() {
    let grid = noise([5, 4, 6], 3);
    let s = Type6Spline::new(&grid).unwrap();
    let domain = *s.domain();
    let mut random = Random(5);
    for _ in 0..3000 {
        let u = domain.hi * DVec3::new(random.unit(), random.unit(), random.unit());
        let cube = u.to_array().map(|v| (v + 0.5).floor() as usize);
        let p: [f64; 3] = std::array::from_fn(|a| u[a] - cube[a] as f64);
        let mut d = [0.0; 27];
        s.data(cube, &mut d);
        let kind = kind_of(p);
        let phi: [f64; 4] =
            TYPE6.barycentric[kind].map(|row| f64::from(row[0]) + (0..3).map(|a| f64::from(row[1 + a]) * p[a]).sum::<f64>());
        assert!(phi.iter().all(|&v| v >= -1e-12), "{p:?} {kind} {phi:?}");
        let value: f64 = (0..20)
            .map(|i| {
                let index = TYPE6.indices[i];
                let b: f64 = (0..27).map(|n| f64::from(TYPE6.weights[kind][i][n]) * d[n]).sum::<f64>() / 192.0;
                let fact = |n: u8| [1.0, 1.0, 2.0, 6.0][usize::from(n)];
                let multinomial = 6.0 / index.iter().map(|&n| fact(n)).product::<f64>();
                b * multinomial * (0..4).map(|v| phi[v].powi(index[v].into())).product::<f64>()
            })
            .sum();
        let x = domain.world(u);
        assert!((s.value(x) - value).abs() < 1e-14, "{} {value}", s.value(x));
        let g = s.gradient(x);
        for a in 0..3 {
            let e = [DVec3::X, DVec3::Y, DVec3::Z][a] * 1e-5;
            if (0..3).all(|a| u[a] > 0.01 && u[a] < domain.hi[a] - 0.01) {
                let slope = (s.value(x + e) - s.value(x - e)) / 2e-5;
                assert!((g[a] - slope).abs() < 1e-4, "{g} {slope} {a}");
            }
        }
    }
    let outside = domain.world(DVec3::new(-3.0, 1.3, 9.0));
    let nearest = domain.world(DVec3::new(0.0, 1.3, 5.0));
    assert!((s.value(outside) - s.value(nearest)).abs() < 1e-14);
}

/// hardcases B15: on faces, edges and vertices every adjacent tetrahedron gives the same value and gradient.
#[test]
fn neighbours_agree_on_their_faces() {
    let mut random = Random(11);
    let d: [f64; 27] = std::array::from_fn(|_| random.unit());
    for n in 0..4000 {
        let mut p: [f64; 3] = std::array::from_fn(|_| random.unit() - 0.5);
        // On one of the six planes, or at a vertex of the partition.
        let (a, b) = (n % 3, (n + 1 + n / 3 % 2) % 3);
        p[b] = if n % 2 == 0 { p[a] } else { -p[a] };
        if n % 50 == 0 {
            p = [0.5, -0.5, 0.5];
        }
        let mut seen: Vec<(f64, [f64; 3])> = Vec::new();
        for kind in 0..24 {
            let phi = barycentric(canonical(kind, p));
            if phi.iter().all(|&v| v >= 0.0) {
                let l = two_steps(&coefficients(&reorder(kind, &d)), phi);
                seen.push((last_step(l, phi), from_canonical(kind, canonical_gradient(l))));
            }
        }
        assert!(seen.len() >= 2, "{p:?}");
        for w in seen.windows(2) {
            assert!((w[0].0 - w[1].0).abs() <= 4.0 * f64::EPSILON);
            assert!((0..3).all(|a| (w[0].1[a] - w[1].1[a]).abs() < 1e-13));
        }
    }
}

/// hardcases B11b and B14 through the function, from inside to the border.
#[test]
fn moments_of_sampled_polynomials() {
    let n = 21;
    let sampled = |f: &dyn Fn(DVec3) -> f64| {
        let samples: Vec<f32> = (0..n * n * n)
            .map(|i| f(DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) - 10.0) as f32)
            .collect();
        Type6Spline::new(&Grid::unit([n; 3], Samples::F32(samples.into())).unwrap()).unwrap()
    };
    let squares = sampled(&|p| p.length_squared());
    let linear = sampled(&|p| 3.0 * p.x - 2.0 * p.y + 0.5 * p.z + 7.0);
    let mut random = Random(2);
    for _ in 0..500 {
        let p = DVec3::new(random.unit(), random.unit(), random.unit()) * 18.0 - 9.0;
        assert!((squares.value(p + 10.0) - (p.length_squared() + 0.75)).abs() < 1e-12);
        assert!((linear.value(p + 10.0) - (3.0 * p.x - 2.0 * p.y + 0.5 * p.z + 7.0)).abs() < 1e-13);
        assert!((linear.gradient(p + 10.0) - DVec3::new(3.0, -2.0, 0.5)).length() < 1e-12);
    }
}

/// Enclosures hold what they enclose, and their excess falls with the square of the box.
#[test]
fn enclosures_hold_the_values() {
    let grid = noise([6, 7, 5], 21);
    for s in [
        Type6Spline::new(&grid).unwrap(),
        Type6Spline::prefiltered(&grid, isobar_core::Stage::Stored).unwrap(),
    ] {
        let mut random = Random(8);
        let hi = s.domain().hi;
        for size in [4.0, 1.0, 0.2, 0.01, 0.0] {
            for _ in 0..40 {
                let a = hi * DVec3::new(random.unit(), random.unit(), random.unit());
                let b = (a + DVec3::splat(size)).min(hi);
                let e = s.enclosure(a, b);
                let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
                for _ in 0..60 {
                    let u = a + (b - a) * DVec3::new(random.unit(), random.unit(), random.unit());
                    let v = s.value(s.domain().world(u));
                    // The world's rounding moves the point by some ulps.
                    assert!(e.lo - 1e-13 <= v && v <= e.hi + 1e-13, "{e:?} {v}");
                    (least, greatest) = (least.min(v), greatest.max(v));
                }
                if size <= 0.2 {
                    assert!(
                        e.width() <= (greatest - least) + 30.0 * size * size + 4.0 * size + 1e-13,
                        "{size} {e:?}"
                    );
                }
                if size <= 0.01 {
                    assert!(e.width() < 0.2, "{e:?}");
                }
            }
        }
    }
}
