//! The real data sets: every file of `structured/` against MANIFEST.tsv, and the meshes.

use crate::build::{grid, samples};
use isobar_core::{DMat3, DVec3, Data};
use isobar_io::{Options, load, load_mesh};
use std::io::Write;
use std::path::{Path, PathBuf};

/// `ISOBAR_DATA`, else `shared/data` beside the workspace. Where it is absent the skip is said past the test harness's capture.
pub(crate) fn folder(test: &str) -> Option<PathBuf> {
    let path = std::env::var_os("ISOBAR_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    if path.join("MANIFEST.tsv").is_file() {
        return Some(path);
    }
    let mut out = std::io::stdout();
    writeln!(
        out,
        "\nSKIPPED: isobar-io {test}: no MANIFEST.tsv in {} (set ISOBAR_DATA)",
        path.display()
    )
    .unwrap();
    None
}

/// One row of the manifest.
struct Row {
    file: String,
    dims: [usize; 3],
    kind: String,
    spacing: DVec3,
}

fn rows(folder: &Path) -> Vec<Row> {
    let text = std::fs::read_to_string(folder.join("MANIFEST.tsv")).unwrap();
    let three = |s: &str, sep: char| -> Vec<f64> { s.split(sep).map(|w| w.parse().unwrap()).collect() };
    text.lines()
        .skip(1)
        .map(|l| l.split('\t').collect::<Vec<_>>())
        .filter(|c| c[0].starts_with("structured/") && !c[0].ends_with(".raw.gz"))
        .map(|c| Row {
            file: c[0].into(),
            dims: three(c[2], 'x')
                .iter()
                .map(|&d| d as usize)
                .collect::<Vec<_>>()
                .try_into()
                .unwrap(),
            kind: c[3].into(),
            spacing: DVec3::from_slice(&three(c[4], ',')),
        })
        .collect()
}

#[test]
fn every_structured_file_agrees_with_the_manifest() {
    let Some(folder) = folder("every_structured_file_agrees_with_the_manifest") else {
        return;
    };
    let rows = rows(&folder);
    assert!(rows.len() >= 19, "only {} volumes in the manifest", rows.len());
    for row in rows {
        let loaded = load(&folder.join(&row.file), &Options::default()).unwrap_or_else(|e| panic!("{e}"));
        let g = grid(&loaded);
        assert_eq!(g.dims, row.dims, "{}", row.file);
        assert_eq!(g.samples.type_name(), row.kind, "{}", row.file);
        assert!(
            (g.spacing - row.spacing).abs().max_element() <= 1e-6,
            "{}: {}",
            row.file,
            g.spacing
        );
        assert!(g.require_finite().is_ok(), "{}", row.file);
        assert!(loaded.notes.is_empty(), "{}: {:?}", row.file, loaded.notes);
        let (lo, hi) = g.samples.range().0.unwrap();
        assert!(lo < hi, "{}", row.file);
    }
}

#[test]
fn known_headers_are_understood() {
    let Some(folder) = folder("known_headers_are_understood") else {
        return;
    };
    let read = |file: &str, field: Option<&str>| {
        let o = Options {
            field: field.map(str::to_owned),
            ..Options::default()
        };
        load(&folder.join(file), &o).unwrap_or_else(|e| panic!("{e}"))
    };
    let g = read("structured/ch2_colin27_t1.nii.gz", None);
    assert_eq!(grid(&g).origin, DVec3::new(-90.0, -125.0, -71.0));
    assert_eq!(grid(&g).direction, DMat3::IDENTITY);
    let g = read("structured/bonsai_256.nrrd", None);
    assert_eq!(grid(&g).origin, DVec3::splat(-128.0));
    let g = read("structured/carotid.vtk", None);
    assert_eq!(grid(&g).origin, DVec3::new(100.0, 80.0, 1.0));
    assert_eq!(g.fields, ["scalars", "vectors", "vectors-x", "vectors-y", "vectors-z"]);
    let parts = ["vectors-x", "vectors-y", "vectors-z"].map(|f| samples(&read("structured/carotid.vtk", Some(f))));
    let length = samples(&read("structured/carotid.vtk", Some("vectors")));
    for i in (0..length.len()).step_by(997) {
        let v = parts.each_ref().map(|p| p[i]);
        assert!((DVec3::from_array(v).length() - length[i]).abs() <= 1e-6 * length[i]);
    }
    // Hounsfield units: bytes in the right order give air and bone.
    let g = read("structured/cranium_ct_256x256x108.nhdr", None);
    let (lo, hi) = grid(&g).samples.range().0.unwrap();
    assert!(
        (-3100.0..=-900.0).contains(&lo) && (1000.0..=4100.0).contains(&hi),
        "{lo} {hi}"
    );
}

/// Every file of `nurbs/` and `highorder/` is a collection of elements, but for the grid functions, which are found beside their meshes.
#[test]
fn every_file_of_elements_is_read() {
    let Some(folder) = folder("every_file_of_elements_is_read") else {
        return;
    };
    let mut n = 0;
    for part in ["highorder", "nurbs"] {
        for entry in std::fs::read_dir(folder.join(part)).unwrap() {
            let path = entry.unwrap().path();
            let read = load(&path, &Options::default());
            if path.extension().is_some_and(|e| e == "gf") {
                let e = read.unwrap_err().to_string();
                assert!(e.contains("name its mesh") && e.lines().count() == 1, "{e}");
            } else {
                let l = read.unwrap_or_else(|e| panic!("{e}"));
                assert!(
                    matches!(l.data, Data::Hexes(_)) && l.fields.contains(&l.field),
                    "{}",
                    path.display()
                );
            }
            n += 1;
        }
    }
    assert!(n >= 18, "only {n} files");
}

#[test]
fn the_meshes_have_their_counts() {
    let Some(folder) = folder("the_meshes_have_their_counts") else {
        return;
    };
    for (file, points, triangles) in [
        ("mesh/ChineseDragon-10kv.off", 10_000, 19_994),
        ("mesh/stanford_bunny.ply", 35_947, 69_451),
    ] {
        let m = load_mesh(&folder.join(file)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((m.points.len(), m.triangles.len()), (points, triangles), "{file}");
        let e = load(&folder.join(file), &Options::default()).unwrap_err().to_string();
        assert!(e.contains("--mesh"), "{e}");
    }
}

#[test]
fn shipped_volumes_are_read() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bench-data");
    let mut n = 0;
    let mut stack = vec![folder.clone()];
    while let Some(dir) = stack.pop() {
        for entry in std::fs::read_dir(&dir).into_iter().flatten().flatten() {
            let path = entry.path();
            let name = path.to_string_lossy().into_owned();
            if path.is_dir() {
                stack.push(path);
            } else if [".nii.gz", ".nii", ".nrrd", ".nhdr", ".vti", ".vtk"]
                .iter()
                .any(|e| name.ends_with(e))
            {
                let loaded = load(&path, &Options::default()).unwrap_or_else(|e| panic!("{e}"));
                assert!(grid(&loaded).require_finite().is_ok() && loaded.notes.is_empty(), "{name}");
                n += 1;
            }
        }
    }
    if n == 0 {
        writeln!(
            std::io::stdout(),
            "\nSKIPPED: isobar-io shipped_volumes_are_read: no volume in bench-data"
        )
        .unwrap();
    }
}

/// A mesh: file, points, tetrahedra, default field, its range.
type Mesh = (&'static str, usize, usize, &'static str, (f64, f64));

/// Every file of `unstructured/` and `curvilinear/` against MANIFEST.tsv: hexahedra give 6 tetrahedra, wedges 3, cells of a PLOT3D grid 5.
#[test]
fn every_mesh_of_cells_agrees_with_the_manifest() {
    let Some(folder) = folder("every_mesh_of_cells_agrees_with_the_manifest") else {
        return;
    };
    let read = |file: &str, o: &Options| {
        let l = load(&folder.join(file), o).unwrap_or_else(|e| panic!("{e}"));
        let Data::Tets(m) = l.data.clone() else {
            panic!("{file} is a {}", l.data.kind())
        };
        let (lo, hi) = m.values.iter().fold((f32::MAX, f32::MIN), |(a, b), &v| (a.min(v), b.max(v)));
        for t in m.cells.iter() {
            let p = t.map(|i| m.points[i as usize]);
            assert!((p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) >= 0.0);
        }
        (l, m, (f64::from(lo), f64::from(hi)))
    };
    let expected: [Mesh; 7] = [
        ("unstructured/fire_ug.vtu", 12_323, 10_462 * 6, "t", (298.0, 692.0)),
        ("unstructured/can.vtu", 6_724, 4_800 * 6, "GlobalNodeId", (1.0, 6724.0)),
        ("unstructured/notch_stress.vtk", 12_717, 2_188 * 6 + 4 * 3, "", (0.0, 0.0)),
        ("unstructured/utah_torso_voltage.vtu", 8_278, 51_419, "", (-5059.0, 1780.0)),
        ("curvilinear/bluntfinxyz.bin", 40_960, 187_395, "density", (0.1926, 4.9775)),
        (
            "curvilinear/combxyz.bin",
            57 * 33 * 25,
            43_008 * 5,
            "density",
            (0.1978, 0.7104),
        ),
        ("curvilinear/postxyz.bin", 38 * 76 * 38, 102_675 * 5, "density", (1.0, 1.0)),
    ];
    for (file, points, tets, field, range) in expected {
        let (l, m, found) = read(file, &Options::default());
        assert_eq!((m.points.len(), m.cells.len()), (points, tets), "{file}");
        if !field.is_empty() {
            assert_eq!(l.field, field, "{file}");
        }
        let near = |a: f64, b: f64| (a - b).abs() <= 0.003 * b.abs().max(0.02);
        if range.1 > 0.0 {
            assert!(near(found.0, range.0) && near(found.1, range.1), "{file}: {found:?}");
        }
    }
    // The manifest lists these files and no others.
    let text = std::fs::read_to_string(folder.join("MANIFEST.tsv")).unwrap();
    let listed = |l: &&str| (l.starts_with("unstructured/") || l.starts_with("curvilinear/")) && !l.contains("q.bin\t");
    assert_eq!(text.lines().filter(listed).count(), expected.len());
    let (l, ..) = read("unstructured/notch_stress.vtk", &Options::default());
    assert!(
        l.notes.iter().any(|n| n.starts_with("2192 of 2192 cells have more corners")),
        "{:?}",
        l.notes
    );
    let (l, ..) = read("curvilinear/bluntfinxyz.bin", &Options::default());
    assert!(
        l.notes
            .iter()
            .any(|n| n.starts_with("77 of 187395 tetrahedra have no volume")),
        "{:?}",
        l.notes
    );
    assert_eq!(
        l.fields,
        ["density", "momentum", "momentum-x", "momentum-y", "momentum-z", "energy"]
    );
    let with = |field: &str, cell_to_point| Options {
        field: Some(field.into()),
        cell_to_point,
        ..Options::default()
    };
    let (.., energy) = read("curvilinear/postxyz.bin", &with("energy", false));
    assert!((energy.0 + 0.54).abs() < 0.01 && (energy.1 - 4.40).abs() < 0.01, "{energy:?}");
    let parts = ["momentum-x", "momentum-y", "momentum-z"].map(|f| read("curvilinear/postxyz.bin", &with(f, false)).1);
    let (_, length, _) = read("curvilinear/postxyz.bin", &with("momentum", false));
    for i in (0..length.values.len()).step_by(997) {
        let v = DVec3::from_array(parts.each_ref().map(|p| f64::from(p.values[i]))).length();
        assert!((v - f64::from(length.values[i])).abs() < 1e-6 * v.max(1e-3));
    }
    // Fields of cells need the flag.
    let can = folder.join("unstructured/can.vtu");
    let e = load(&can, &with("EQPS", false)).unwrap_err().to_string();
    assert!(e.contains("field \"EQPS\" on cells") && e.contains("--cell-to-point"), "{e}");
    let (l, _, range) = read("unstructured/can.vtu", &with("EQPS", true));
    assert!(
        range.0 >= 0.0 && range.1 > range.0 && l.notes.iter().any(|n| n.contains("averaged")),
        "{range:?}"
    );
}
