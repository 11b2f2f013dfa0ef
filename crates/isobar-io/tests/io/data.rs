//! The real data sets: every file of `structured/` against MANIFEST.tsv, and the meshes.

use crate::build::{grid, samples};
use isobar_core::{DMat3, DVec3};
use isobar_io::{Options, load, load_mesh};
use std::io::Write;
use std::path::{Path, PathBuf};

/// `ISOBAR_DATA`, else `shared/data` beside the workspace. Where it is absent the skip is said past the test harness's capture.
fn folder(test: &str) -> Option<PathBuf> {
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
            nan: None,
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

#[test]
fn other_kinds_of_data_are_not_read_yet() {
    let Some(folder) = folder("other_kinds_of_data_are_not_read_yet") else {
        return;
    };
    let mut n = 0;
    for part in ["curvilinear", "unstructured", "highorder", "nurbs"] {
        for entry in std::fs::read_dir(folder.join(part)).unwrap() {
            let path = entry.unwrap().path();
            let e = load(&path, &Options::default()).expect_err("no reader yet").to_string();
            assert!(e.contains("is not read yet") && e.lines().count() == 1, "{e}");
            n += 1;
        }
    }
    assert!(n > 20, "only {n} files");
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
