//! Files of Bezier, NURBS and Lagrange elements.

use crate::build::Random;
use crate::data::folder;
use isobar_core::{DVec3, Data, HexPatches};
use isobar_fields::{HexField, evaluate_hex};
use isobar_io::{Options, load, load_bytes};
use std::path::Path;

fn hexes(file: &Path, o: &Options) -> (HexPatches, Vec<String>) {
    let l = load(file, o).unwrap_or_else(|e| panic!("{e}"));
    assert!(l.notes.is_empty(), "{:?}", l.notes);
    match l.data {
        Data::Hexes(h) => (h, l.fields),
        other => panic!("{} is a {}", file.display(), other.kind()),
    }
}

/// Volume by Gauss quadrature, signed.
fn volume(h: &HexPatches) -> f64 {
    // Four points, exact to degree 7 per axis.
    let (a, b) = (0.861_136_311_594_052_6, 0.339_981_043_584_856_3);
    let (wa, wb) = (0.347_854_845_137_453_9, 0.652_145_154_862_546_1);
    let rule = [(-a, wa), (-b, wb), (b, wb), (a, wa)].map(|(x, w)| (0.5 + 0.5 * x, 0.5 * w));
    let mut sum = 0.0;
    for e in h.elements.iter() {
        for (u, wu) in rule {
            for (v, wv) in rule {
                for (w, ww) in rule {
                    let p = evaluate_hex(e, DVec3::new(u, v, w));
                    sum += wu * wv * ww * p.jacobian.determinant();
                }
            }
        }
    }
    sum
}

/// Elements per file, degree of geometry and attribute, default range of coefficients about the field's, volume where the file tells it.
#[test]
fn files_of_elements_agree_with_the_manifest() {
    let Some(data) = folder("files_of_elements_agree_with_the_manifest") else {
        return;
    };
    for (file, count, degree, value_degree, fields, range, size) in [
        ("nurbs/horseshoe_iga.json", 6 * 4 * 18, 3, 3, 4, 1.0, 437.061_566_994_217_2),
        ("nurbs/gshaped_iga.json", 14 * 4 * 3, 3, 3, 4, 1.0, -0.297_720_499_999_999_1),
        ("nurbs/pipe_nurbs_iga.json", 8, 3, 3, 4, 1.0, 403.817_331_843_413_6),
        (
            "nurbs/twisted_pipe_mp_iga.json",
            3 * 8 * 8 * 8,
            3,
            3,
            4,
            1.0,
            2.075_661_153_627_030_5,
        ),
        ("nurbs/horseshoe.xml", 2 * 6, 2, 2, 3, 4.0, 437.0),
        ("nurbs/GshapedVolume.xml", 7, 2, 2, 3, 1.5, -0.2977),
        ("nurbs/geo_twisted_pipe_mp.txt", 3 * 8, 2, 2, 3, 4.0, 2.0757),
        ("highorder/laghos_q2.vtu", 512, 2, 2, 2, 4.4, 0.0),
        ("highorder/toroid_hex_p4.vtu", 48, 4, 4, 2, 1.0, 0.0),
        ("highorder/pipe_nurbs_p2.vtu", 64, 3, 3, 2, 1.0, 403.8),
        ("highorder/hex_3x3x3_o4.vtk", 27, 4, 4, 2, 14.3, 27.0),
    ] {
        let (h, names) = hexes(&data.join(file), &Options::default());
        assert_eq!(h.elements.len(), count, "{file}");
        assert_eq!(
            (h.elements[0].degree, h.elements[0].value_degree),
            ([degree; 3], [value_degree; 3]),
            "{file}"
        );
        assert_eq!(names.len(), fields, "{file}: {names:?}");
        let most = h.elements.iter().map(|e| e.value_range().1).fold(f64::MIN, f64::max);
        assert!(most > 0.5 * range && most < 1.5 * range, "{file}: {most}");
        let found = volume(&h);
        if size != 0.0 {
            let near = if file.ends_with("iga.json") { 2e-5 } else { 2e-3 };
            assert!((found - size).abs() < near * size.abs(), "{file}: {found}");
        } else {
            assert!(found > 0.0, "{file}: {found}");
        }
    }
}

/// The node numbering is right where a known function comes out: the distance to the centre of a straight grid, and coordinates as fields.
#[test]
fn known_functions_come_out() {
    let Some(data) = folder("known_functions_come_out") else {
        return;
    };
    let (h, _) = hexes(&data.join("highorder/hex_3x3x3_o4.vtk"), &Options::default());
    let f = HexField::new(&h).unwrap();
    let (mut worst, mut random) = (0.0f64, Random(72));
    for _ in 0..300 {
        let mut next = || 3.0 * random.below(10_000) as f64 / 10_000.0;
        let x = DVec3::new(next(), next(), next());
        let want = (x - 1.5).length();
        // Interpolated at order 4: near the kink at the centre and near its own cell's ends worst.
        worst = worst.max((isobar_core::Function::value(&f, x) - want).abs() / if want < 1.0 { 10.0 } else { 1.0 });
    }
    assert!(worst < 5e-3, "{worst}");
    for (file, axis) in [
        ("nurbs/horseshoe.xml", "y"),
        ("nurbs/twisted_pipe_mp_iga.json", "z"),
        ("nurbs/geo_twisted_pipe_mp.txt", "x"),
    ] {
        let o = Options {
            field: Some(axis.into()),
            ..Options::default()
        };
        let (h, _) = hexes(&data.join(file), &o);
        let a = usize::from(axis.as_bytes()[0] - b'x');
        for e in h.elements.iter() {
            let p = evaluate_hex(e, DVec3::new(0.3, 0.8, 0.45));
            assert!((p.value - p.position[a]).abs() < 1e-13, "{file}");
        }
    }
    let bad = load(
        &data.join("nurbs/horseshoe.xml"),
        &Options {
            field: Some("t".into()),
            ..Options::default()
        },
    );
    assert!(bad.unwrap_err().to_string().contains("--field may be one of: x, y, z"));
}

/// One rational patch in the three texts.
pub(crate) fn small() -> [(&'static str, String); 3] {
    let points: Vec<[f64; 4]> = (0..12)
        .map(|n| {
            [
                f64::from(n % 3),
                f64::from(n / 3 % 2),
                f64::from(n / 6),
                if n % 3 == 1 { 0.5 } else { 1.0 },
            ]
        })
        .collect();
    let list = |f: &dyn Fn(&[f64; 4]) -> String, by: &str| points.iter().map(f).collect::<Vec<_>>().join(by);
    let row = |c: usize| list(&|p| if c < 3 { (p[c] * p[3]).to_string() } else { p[3].to_string() }, " ");
    let json = format!(
        "{{\"format\": \"nurbs-volume/1\", \"patches\": [{{\"degree\": [2, 1, 1], \"n\": [3, 2, 2], \"knots\": [[0,0,0,1,1,1],[0,0,1,1],[0,0,1,1]], \"control_points\": [{}], \"field\": [0,1,2,3,4,5,6,7,8,9,10,11]}}]}}",
        list(&|p| format!("{p:?}"), ", ")
    );
    let xml = format!(
        "<?xml version=\"1.0\"?><xml><Geometry type=\"TensorNurbs3\" id=\"1\"><Basis><KnotVector degree=\"2\">0 0 0 1 1 1</KnotVector><KnotVector degree=\"1\">0 0 1 1</KnotVector><KnotVector degree=\"1\">0 0 1 1</KnotVector><weights>{}</weights></Basis><coefs geoDim=\"3\">{}</coefs></Geometry></xml>",
        row(3),
        list(&|p| format!("{} {} {}", p[0], p[1], p[2]), " ")
    );
    let geopdes = format!(
        "# nurbs mesh v.2.1\n3 3 1 0 1\nPATCH 1\n2 1 1\n3 2 2\n0 0 0 1 1 1\n0 0 1 1\n0 0 1 1\n{}\n{}\n{}\n{}\n",
        row(0),
        row(1),
        row(2),
        row(3)
    );
    [("json", json), ("xml", xml), ("txt", geopdes)]
}

#[test]
fn the_three_texts_say_the_same() {
    let o = Options {
        field: Some("x".into()),
        ..Options::default()
    };
    let read = small().map(
        |(name, text)| match load_bytes(name, text.as_bytes(), &o).unwrap_or_else(|e| panic!("{e}")).data {
            Data::Hexes(h) => h,
            other => panic!("{name} is a {}", other.kind()),
        },
    );
    assert_eq!(read[0], read[1]);
    assert_eq!(read[0], read[2]);
    assert!(read[0].elements[0].rational_value && read[0].elements[0].points[1] == [1.0, 0.0, 0.0, 0.5]);
}

#[test]
fn bad_volumes_are_one_line() {
    let [(_, json), (_, xml), (_, geopdes)] = small();
    for (name, text, from, to, reason) in [
        ("json", &json, "[0,0,0,1,1,1]", "[0,0,0,2,1,1]", "knots along u fall"),
        ("json", &json, "0.5", "0.0", "weight is not positive"),
        ("json", &json, "0.5", "-0.5", "weight is not positive"),
        ("json", &json, "[2, 1, 1]", "[21, 1, 1]", "degree"),
        ("json", &json, "[2, 1, 1]", "[0, 1, 1]", "degree"),
        ("json", &json, "\"n\": [3,", "\"n\": [4,", "n is [4, 2, 2]"),
        ("json", &json, ",10,11]", ",10]", "11 coefficients"),
        ("json", &json, "volume/1", "volume/2", "not \"nurbs-volume/1\""),
        ("json", &json, "\"degree\"", "\"degre\"", "missing field"),
        ("xml", &xml, "0 0 0 1 1 1", "0 0 0 1 1", "no span"),
        ("xml", &xml, "geoDim=\"3\"", "geoDim=\"2\"", "geoDim 2"),
        (
            "xml",
            &xml,
            "TensorNurbs3",
            "TensorNurbs2",
            "no trivariate patch (of other kinds: 1)",
        ),
        ("xml", &xml, "degree=\"2\"", "degree=\"-2\"", "not a count"),
        ("txt", &geopdes, "3 3 1 0 1", "2 3 1 0 1", "dimension 2"),
        ("txt", &geopdes, "3 2 2", "3 2 99999999", "points"),
        ("txt", &geopdes, "3 3 1", "3 3 2", "ends where"),
        ("txt", &geopdes, "0.5", "x", "\"x\" is not a number"),
    ] {
        let changed = text.replacen(from, to, 1);
        assert_ne!(*text, changed, "{from}");
        let e = load_bytes(name, changed.as_bytes(), &Options::default())
            .expect_err(reason)
            .to_string();
        assert!(
            e.contains(reason) && e.lines().count() == 1 && e.contains("; "),
            "{e}\nshould say {reason:?}"
        );
    }
}

/// The MFEM files against the Lagrange cells written from them (numbers of 8 digits, element by element in the same order).
#[test]
fn mfem_files_agree_with_their_lagrange_cells() {
    let Some(data) = folder("mfem_files_agree_with_their_lagrange_cells") else {
        return;
    };
    for (stem, count, degree, value_degree, near) in [
        ("laghos_q2", 512, 2, 1, 1e-6),
        ("toroid_hex_p4", 48, 3, 4, 1e-6),
        // The cells interpolate the rational geometry: 5.3e-3 was observed on a pipe of length 16.
        ("pipe_nurbs_p2", 64, 2, 2, 8e-3),
    ] {
        let (m, fields) = hexes(&data.join(format!("highorder/{stem}.mesh")), &Options::default());
        let (v, _) = hexes(&data.join(format!("highorder/{stem}.vtu")), &Options::default());
        assert_eq!(
            (m.elements.len(), v.elements.len(), fields.len()),
            (count, count, 4),
            "{stem}"
        );
        assert_eq!(
            (m.elements[0].degree, m.elements[0].value_degree),
            ([degree; 3], [value_degree; 3]),
            "{stem}"
        );
        // A NURBS mesh may list its spans in another order: the nearest middle tells which is which.
        let middle = |h: &HexPatches| {
            h.elements
                .iter()
                .map(|e| evaluate_hex(e, DVec3::splat(0.5)))
                .collect::<Vec<_>>()
        };
        let (a, b) = (middle(&m), middle(&v));
        for p in &a {
            let q = b
                .iter()
                .min_by(|x, y| {
                    (x.position - p.position)
                        .length()
                        .total_cmp(&(y.position - p.position).length())
                })
                .unwrap();
            assert!(
                (p.position - q.position).length() < near && (p.value - q.value).abs() < near,
                "{stem}: {p:?} {q:?}"
            );
        }
        if stem != "pipe_nurbs_p2" {
            for (a, b) in m.elements.iter().zip(v.elements.iter()) {
                for u in [
                    DVec3::ZERO,
                    DVec3::new(1.0, 0.3, 0.0),
                    DVec3::new(0.2, 0.9, 0.6),
                    DVec3::new(0.0, 1.0, 1.0),
                ] {
                    let (p, q) = (evaluate_hex(a, u), evaluate_hex(b, u));
                    assert!(
                        (p.position - q.position).length() < near && (p.value - q.value).abs() < near,
                        "{stem} {u}: {p:?} {q:?}"
                    );
                }
            }
        }
        assert!(volume(&m) > 0.0);
    }
    for (file, count) in [("nurbs/pipe-nurbs.mesh", 8), ("highorder/toroid-hex.mesh", 6)] {
        let (h, fields) = hexes(&data.join(file), &Options::default());
        assert_eq!((h.elements.len(), fields.len()), (count, 3), "{file}");
        let p = evaluate_hex(&h.elements[0], DVec3::new(0.2, 0.7, 0.4));
        assert!((p.value - p.position.x).abs() < 1e-12);
    }
    let e = load(&data.join("highorder/laghos_q2.gf"), &Options::default())
        .unwrap_err()
        .to_string();
    assert!(e.contains("name its mesh"), "{e}");
}

/// A mesh of two straight hexahedra with a quadratic grid function, and a rational NURBS patch.
pub(crate) fn mfem() -> [String; 2] {
    let plain = "MFEM mesh v1.0\n\ndimension\n3\nelements\n2\n1 5 0 1 2 3 4 5 6 7\n1 5 9 8 0 1 11 10 4 5\nboundary\n1\n1 3 0 1 2 3\nvertices\n12\n3\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n0 -1 0\n1 -1 0\n0 -1 1\n1 -1 1\n";
    // 12 vertices, 20 edges, 11 faces, 2 insides
    let field = "FiniteElementSpace\nFiniteElementCollection: H1_3D_P2\nVDim: 1\nOrdering: 0\n\n".to_owned()
        + &(0..45).map(|i| format!("{i}\n")).collect::<String>();
    let patch = "MFEM NURBS mesh v1.0\ndimension\n3\nelements\n1\n1 5 0 1 2 3 4 5 6 7\nboundary\n0\nedges\n12\n0 0 1\n1 1 2\n0 3 2\n1 0 3\n0 4 5\n1 5 6\n0 7 6\n1 4 7\n1 0 4\n1 1 5\n1 2 6\n1 3 7\nvertices\n8\nknotvectors\n2\n2 3 0 0 0 1 1 1\n1 2 0 0 1 1\nweights\n1 1 1 1 1 1 1 1 .7 .7 .7 .7\nFiniteElementSpace\nFiniteElementCollection: NURBS2\nVDim: 3\nOrdering: 1\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n.5 0 0\n.5 1 0\n.5 0 1\n.5 1 1\n";
    [format!("{plain}\u{c}{field}"), patch.to_owned()]
}

#[test]
fn mfem_numbers_are_shared_between_elements() {
    let dir = tempfile::tempdir().unwrap();
    let [plain, patch] = mfem();
    let (mesh, field) = plain.split_once('\u{c}').unwrap();
    std::fs::write(dir.path().join("a.mesh"), mesh).unwrap();
    std::fs::write(dir.path().join("a.gf"), field).unwrap();
    let (h, _) = hexes(&dir.path().join("a.mesh"), &Options::default());
    // The shared face y = 0: v = 0 of the first, v = 1 of the second element, which runs against x.
    for (u, w) in [(0.0, 0.0), (0.25, 0.5), (0.5, 0.5), (1.0, 0.3)] {
        let a = evaluate_hex(&h.elements[0], DVec3::new(u, 0.0, w));
        let b = evaluate_hex(&h.elements[1], DVec3::new(1.0 - u, 1.0, w));
        assert!(
            (a.position - b.position).length() < 1e-15 && (a.value - b.value).abs() < 1e-12,
            "{a:?} {b:?}"
        );
    }
    std::fs::write(dir.path().join("b.mesh"), patch).unwrap();
    let (h, fields) = hexes(&dir.path().join("b.mesh"), &Options::default());
    assert_eq!((h.elements[0].degree, fields.len()), ([2, 1, 1], 3));
    assert_eq!(h.elements[0].points[4], [0.5, 1.0, 0.0, 0.7]);
    assert_eq!(volume(&h).signum(), 1.0);
}

/// One to four small injuries per text, and all truncations: no reader panics, errors are one line.
#[test]
fn injured_texts_are_refused_or_read() {
    let mut random = Random(2012);
    let [plain, patch] = mfem();
    let texts = small()
        .map(|(kind, text)| {
            (
                false,
                [
                    match kind {
                        "json" => "{",
                        "xml" => "<",
                        _ => "#",
                    },
                    &text,
                ]
                .concat(),
            )
        })
        .into_iter()
        .chain([(true, plain), (true, patch)]);
    for (is_mfem, text) in texts {
        let run = |b: &[u8]| {
            if is_mfem {
                isobar_io::fuzz::mfem(b)
            } else {
                isobar_io::fuzz::nurbs(b)
            }
        };
        let first = usize::from(!is_mfem);
        let bytes = text.into_bytes();
        run(&bytes);
        for cut in (first..bytes.len()).step_by(7) {
            run(&bytes[..cut]);
        }
        for _ in 0..1500 {
            let mut b = bytes.clone();
            for _ in 0..=random.below(4) {
                let at = first + random.below(b.len() - first);
                match random.below(5) {
                    0 => b[at] = b"0123456789-. e\n"[random.below(15)],
                    1 => b[at] ^= 1 << random.below(7),
                    2 => drop(b.splice(at..at, *b"99999")),
                    3 => {
                        b.remove(at);
                    }
                    _ => {
                        let part = b[at..b.len().min(at + 9)].to_vec();
                        b.splice(at..at, part);
                    }
                }
            }
            run(&b);
        }
    }
}

/// Linear hexahedra (12), voxels (11, corners in another order) and the cells of a grid as elements: the same trilinear function.
#[test]
fn linear_hexahedra_are_read_as_elements_where_asked() {
    let o = Options {
        as_hexes: true,
        ..Options::default()
    };
    let corner = |n: usize| [n & 1, n >> 1 & 1, n >> 2].map(|i| i as f64);
    let file = |kind: u8, order: [usize; 8]| {
        let points: String = (0..8).map(|n| corner(n).map(|x| format!("{x} ")).concat()).collect();
        let cell: String = order.iter().map(|n| format!(" {n}")).collect();
        format!(
            "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 float\n{points}\nCELLS 1 9\n8{cell}\nCELL_TYPES 1\n{kind}\n\
             POINT_DATA 8\nSCALARS s float 1\nLOOKUP_TABLE default\n0 1 2 3 4 5 6 8\n"
        )
    };
    let grid = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nORIGIN 0 0 0\nSPACING 1 1 1\n\
                POINT_DATA 8\nSCALARS s float 1\nLOOKUP_TABLE default\n0 1 2 3 4 5 6 8\n";
    for text in [
        file(12, [0, 1, 3, 2, 4, 5, 7, 6]),
        file(11, [0, 1, 2, 3, 4, 5, 6, 7]),
        grid.to_owned(),
    ] {
        let l = load_bytes("a.vtk", text.as_bytes(), &o).unwrap_or_else(|e| panic!("{e}"));
        let Data::Hexes(h) = l.data else {
            panic!("a {}", l.data.kind())
        };
        assert_eq!(
            (h.elements.len(), h.elements[0].degree, h.elements[0].value_degree),
            (1, [1; 3], [1; 3])
        );
        let p = evaluate_hex(&h.elements[0], DVec3::new(0.25, 0.5, 0.75));
        // x + 2 y + 4 z + x y z
        assert!((p.position - DVec3::new(0.25, 0.5, 0.75)).length() < 1e-15 && (p.value - 4.343_75).abs() < 1e-14);
    }
    // Without being asked, voxels are refused and hexahedra split.
    let plain = |kind, order| load_bytes("a.vtk", file(kind, order).as_bytes(), &Options::default());
    assert_eq!(plain(12, [0, 1, 3, 2, 4, 5, 7, 6]).unwrap().data.kind(), "tets");
    let e = plain(11, [0, 1, 2, 3, 4, 5, 6, 7]).unwrap_err().to_string();
    assert!(e.contains("pixel or voxel") && e.contains("as=hexes"), "{e}");
    let tetra = load_bytes("a.vtk", file(10, [0; 8]).as_bytes(), &o).unwrap_err().to_string();
    assert!(tetra.contains("cell 0 of type 10") && tetra.lines().count() == 1, "{tetra}");
}

/// NaN of the file are counted there, whatever becomes of them in coefficients and tetrahedra; replaced, they are ordinary numbers.
#[test]
fn values_that_are_not_finite_are_counted_in_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let [plain, _] = mfem();
    let (mesh, field) = plain.split_once('\u{c}').unwrap();
    let mesh_file = dir.path().join("a.mesh");
    std::fs::write(&mesh_file, mesh).unwrap();
    std::fs::write(dir.path().join("a.gf"), field.replace("\n44\n", "\nnan\n")).unwrap();
    let grid = dir.path().join("g.vtk");
    let text = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 2 2\nORIGIN 0 0 0\nSPACING 1 1 1\n\
                POINT_DATA 12\nSCALARS s float 1\nLOOKUP_TABLE default\n0 nan 2 3 4 5 6 7 8 9 10 11\n";
    std::fs::write(&grid, text).unwrap();
    let tets = dir.path().join("t.vtk");
    let text = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\nCELLS 1 5\n4 0 1 2 3\n\
                CELL_TYPES 1\n10\nPOINT_DATA 4\nSCALARS s float 1\nLOOKUP_TABLE default\n0 nan 2 3\n";
    std::fs::write(&tets, text).unwrap();
    for (file, as_hexes) in [(mesh_file, false), (grid, true), (tets, false)] {
        let o = Options {
            as_hexes,
            ..Options::default()
        };
        let l = load(&file, &o).unwrap();
        let bad = |data: &Data| match data {
            Data::Hexes(h) => h
                .elements
                .iter()
                .flat_map(|e| e.values.iter())
                .filter(|v| !v.is_finite())
                .count(),
            Data::Tets(m) => m.values.iter().filter(|v| !v.is_finite()).count(),
            other => panic!("{}", other.kind()),
        };
        assert!(l.not_finite == 1 && bad(&l.data) >= 1, "{}: {}", file.display(), l.not_finite);
        let replaced = load(&file, &Options { nan: Some(1.0), ..o }).unwrap();
        assert_eq!((replaced.not_finite, bad(&replaced.data)), (0, 0), "{}", file.display());
        assert!(replaced.notes[0].starts_with("1 NaN or infinite"), "{:?}", replaced.notes);
    }
    let large = dir.path().join("large.vtk");
    let text = format!(
        "# vtk DataFile Version 3.0\nx\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 164 164 164\nORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA {}\n\
         SCALARS s unsigned_char 1\nLOOKUP_TABLE default\n",
        164 * 164 * 164
    );
    std::fs::write(&large, [text.as_bytes(), &vec![1; 164 * 164 * 164]].concat()).unwrap();
    let o = Options {
        as_hexes: true,
        ..Options::default()
    };
    let e = load(&large, &o).unwrap_err().to_string();
    assert!(
        e.contains("more than 4194304") && e.ends_with("crop it, or leave as=hexes out"),
        "{e}"
    );
}
