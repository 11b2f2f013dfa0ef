//! What needs a real file: paths, detached headers, writing.

use crate::build::*;
use isobar_core::{DMat3, DVec3, Grid, Samples};
use isobar_io::{Options, load, load_mesh, write_nrrd};
use std::path::Path;

fn refused(path: &Path, reason: &str) {
    let text = load(path, &Options::default()).expect_err(reason).to_string();
    assert!(text.contains(reason) && text.contains("; "), "{text}\nshould say {reason:?}");
    assert!(text.starts_with(&*path.to_string_lossy()), "{text}");
    assert_eq!(text.lines().count(), 1, "{text}");
}

#[test]
fn paths_that_are_not_files() {
    let dir = tempfile::tempdir().unwrap();
    refused(dir.path(), "this is a folder; name a file in it");
    refused(&dir.path().join("missing.nrrd"), "no such file");
    let empty = dir.path().join("empty.nrrd");
    std::fs::write(&empty, b"").unwrap();
    refused(&empty, "the file is empty");
    assert!(load_mesh(&empty).unwrap_err().to_string().contains("empty"));
    #[cfg(unix)]
    refused(Path::new("/dev/zero"), "not an ordinary file");
}

#[test]
fn detached_headers_find_their_data_beside_them() {
    let dir = tempfile::tempdir().unwrap();
    let sub = dir.path().join("sub");
    std::fs::create_dir(&sub).unwrap();
    let header = |file: &str, encoding: &str| {
        format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 3 4 5\nencoding: {encoding}\ndata file: {file}")
    };
    let data = bytes("uint8", false);
    std::fs::write(sub.join("v.raw"), &data).unwrap();
    std::fs::write(dir.path().join("v.raw.gz"), gzip(&data)).unwrap();
    let nhdr = sub.join("v.nhdr");
    let read = || load(&nhdr, &Options::default());
    std::fs::write(&nhdr, header("v.raw", "raw")).unwrap();
    assert_volume(&read().unwrap(), "u8");
    std::fs::write(&nhdr, header("./../v.raw.gz", "gzip")).unwrap();
    assert_volume(&read().unwrap(), "u8");
    std::fs::write(&nhdr, header("none.raw", "raw")).unwrap();
    refused(&nhdr, "its data file \"none.raw\": there is no such file; check the path");
    std::fs::write(&nhdr, header("..", "raw")).unwrap();
    refused(&nhdr, "its data file \"..\": this is a folder");
    std::fs::write(sub.join("short.raw"), &data[..59]).unwrap();
    std::fs::write(&nhdr, header("short.raw", "raw")).unwrap();
    refused(
        &nhdr,
        "its data file \"short.raw\": the header declares 60 bytes of samples but the file can hold at most 59",
    );
    std::fs::write(&nhdr, header("v.raw", "gzip")).unwrap();
    refused(&nhdr, "its data file \"v.raw\": the compressed samples are damaged");
}

fn round_trip(grid: &Grid) -> Grid {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("out.nrrd");
    write_nrrd(&path, grid).unwrap();
    let names: Vec<_> = std::fs::read_dir(dir.path())
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert_eq!(names, ["out.nrrd"], "nothing else is left");
    let loaded = load(&path, &Options::default()).unwrap();
    assert!(loaded.notes.is_empty());
    crate::build::grid(&loaded).clone()
}

#[test]
fn what_is_written_is_read_back() {
    let turned = DMat3::from_cols(DVec3::NEG_Y, DVec3::X, DVec3::Z);
    let f: Vec<f32> = (0..N).map(|i| (i as f32).sin() * 1e-3).collect();
    for samples in [
        Samples::U8((0..60).collect()),
        Samples::I16((-30..30).map(|v| v * 1000).collect()),
        Samples::U16((0..60).map(|v| v * 1000).collect()),
        Samples::F32(f.into()),
    ] {
        let g = Grid::new(
            DIMS,
            DVec3::new(0.1, 3.94305, 1.0 / 3.0),
            DVec3::new(-0.7, 1e-9, 1e9),
            turned,
            samples,
        )
        .unwrap();
        assert_eq!(round_trip(&g), g);
    }
    let skew = DMat3::from_cols(
        DVec3::new(0.6, 0.8, 0.0),
        DVec3::new(-0.8, 0.6, 0.0),
        DVec3::new(0.1, 0.2, 1.0).normalize(),
    );
    let g = Grid::new(
        DIMS,
        DVec3::new(0.1, 0.2, 0.3),
        DVec3::ONE,
        skew,
        Samples::U8((0..60).collect()),
    )
    .unwrap();
    let back = round_trip(&g);
    assert!((back.spacing - g.spacing).abs().max_element() < 1e-15);
    assert!((0..3).all(|a| (back.direction.col(a) - g.direction.col(a)).length() < 1e-15));
}

#[test]
fn writing_over_a_file_replaces_it_and_failing_leaves_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("v.nrrd");
    std::fs::write(&path, "old").unwrap();
    let g = Grid::unit([2, 2, 2], Samples::U8((0..8).collect())).unwrap();
    write_nrrd(&path, &g).unwrap();
    assert_eq!(
        crate::build::grid(&load(&path, &Options::default()).unwrap()).samples,
        g.samples
    );
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o400, 0o400);
        assert_ne!(mode & 0o077, 0, "not the private permissions of a temporary file: {mode:o}");
    }
    let e = write_nrrd(&dir.path().join("no/such/v.nrrd"), &g).unwrap_err().to_string();
    assert!(e.contains("cannot write it") && e.lines().count() == 1, "{e}");
    let e = write_nrrd(dir.path(), &g).unwrap_err().to_string();
    assert!(e.contains("folder"), "{e}");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no temporary file is left");
}
