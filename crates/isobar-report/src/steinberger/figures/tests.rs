use super::*;
use crate::steinberger::levels::Field;
use isobar_core::{DVec3, Samples};
use isobar_fields::Synthetic;

fn data() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bench-data")
}

/// Width, height and colours of a picture.
fn colours(stage: &Path, file: &str) -> (u32, u32, usize) {
    let picture = image::open(stage.join(file)).expect("written").to_rgb8();
    let all: std::collections::BTreeSet<[u8; 3]> = picture.pixels().map(|p| p.0).collect();
    (picture.width(), picture.height(), all.len())
}

fn lines(folder: &Path, name: &str) -> usize {
    std::fs::read_to_string(folder.join(name)).map_or(0, |t| t.lines().count())
}

/// The classes of the blocks launched are all of them; the frame is right; a table and a picture are there.
#[test]
fn blocks_are_classed_checked_and_written() {
    let dir = tempfile::tempdir().unwrap();
    let album = Album { stage: dir.path() };
    let mut out = Figures::default();
    volumes::blocks(&data(), album, &mut out).unwrap();
    let b = out.blocks.as_ref().expect("the skull is in the repository");
    assert_eq!(b.classes.iter().sum::<u64>(), b.launched);
    assert!(b.launched < b.blocks && b.classes.iter().all(|&n| n > 0), "{b:?}");
    let v = b.shown.verified;
    assert!(v.wrong == 0 && v.pixels == 512 * 512 && v.hits > 10_000, "{v:?}");
    assert_eq!(colours(dir.path(), &b.shown.file).0, 512);
    assert!(colours(dir.path(), &b.shown.file).2 > 100);
    write(&out, dir.path()).unwrap();
    assert_eq!(lines(dir.path(), "figure-3.2.csv"), 2);
}

/// Without their files there are no figures, and nothing fails.
#[test]
fn absent_data_give_no_figure() {
    let dir = tempfile::tempdir().unwrap();
    let (album, empty) = (Album { stage: dir.path() }, dir.path().join("no data"));
    let mut out = Figures::default();
    volumes::blocks(&empty, album, &mut out).unwrap();
    volumes::closeup(&empty, [32, 24], album, &mut out).unwrap();
    detail::parts(&empty, album, &mut out).unwrap();
    for v in volumes::VOLUMES.iter().filter(|v| !v.file.starts_with("synthetic:")) {
        volumes::degrees(&empty, "6.2", v, [32, 24], album, &mut out).unwrap();
    }
    assert_eq!(out, Figures::default());
    assert!(load(&empty.join("x.nrrd")).unwrap().is_none());
}

#[test]
fn three_degrees_and_a_close_up_are_checked_and_written() {
    let dir = tempfile::tempdir().unwrap();
    let album = Album { stage: dir.path() };
    let mut out = Figures::default();
    volumes::degrees(&data(), "6.2", &volumes::VOLUMES[0], [64, 48], album, &mut out).unwrap();
    let d = &out.degrees[0];
    assert!(d.degrees.len() == 3 && d.degrees.iter().all(|k| k.frame > 0.0 && k.shown.verified.wrong == 0));
    assert!(
        d.bricks[0][0] < d.bricks[0][1] && d.bricks[0][1] == 16 * 16 * 6,
        "{:?}",
        d.bricks
    );
    for file in d.degrees.iter().map(|k| &k.shown.file).chain([&d.bricks_file]) {
        assert!(colours(dir.path(), file).2 > 10, "{file}");
    }
    volumes::closeup(&data(), [64, 48], album, &mut out).unwrap();
    let c = out.closeup.as_ref().expect("the heart is in the repository");
    assert!(
        c.exact.verified.wrong == 0 && c.octree[2] < 1e-4 && c.sampled.len() == 3,
        "{c:?}"
    );
    assert!(c.sampled[0].at_exact_hits[0] < c.sampled[2].at_exact_hits[0]);
    write(&out, dir.path()).unwrap();
    assert_eq!(lines(dir.path(), "figures-6.2-to-6.5.csv"), 4);
    assert_eq!(lines(dir.path(), "figure-6.6.csv"), 5);
}

#[test]
fn surfaces_are_timed_and_judged() {
    let dir = tempfile::tempdir().unwrap();
    let mut out = Figures::default();
    surfaces::measure(&[(48, 1)], Album { stage: dir.path() }, &mut out).unwrap();
    assert_eq!((out.surfaces.len(), out.surface_pictures.len()), (15, 3));
    for s in &out.surfaces {
        assert!(s.frame > s.rootfind && s.rootfind > 0.0 && s.composition > 0.0, "{s:?}");
        assert_eq!(s.preprocessing > 0.0, s.how.starts_with("frustum"), "{s:?}");
        // f32 and 12 to 24 iterations: a few pixels at silhouettes.
        assert!(s.checked > 2000 && s.wrong * 100 <= s.checked && s.hits > 100, "{s:?}");
    }
    for (_, file) in &out.surface_pictures {
        assert!(colours(dir.path(), file).2 > 10, "{file}");
    }
    write(&out, dir.path()).unwrap();
    assert_eq!(lines(dir.path(), "figure-6.1.csv"), 16);
}

/// A small field in the dragon's place.
#[test]
fn levels_of_detail_are_checked_and_written() {
    let Data::Grid(grid) = "gyroid,n=33".parse::<Synthetic>().unwrap().data().unwrap() else {
        panic!("a grid");
    };
    let view = View::fit(grid.domain().world_bounds(), 40.0, 96, 72);
    let field = Field { grid, view };
    let rows = field.rows().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let album = Album { stage: dir.path() };
    let mut out = Figures::default();
    detail::dragon(&field, &rows, album, &mut out).unwrap();
    assert_eq!((out.levels.len(), out.compressions.len()), (6, 8));
    assert!(out.trouble().iter().all(|t| t.contains("6.8")), "{:?}", out.trouble());
    assert!(!out.transition.is_empty());
    let pictures = (out.levels.iter().flat_map(|l| [&l.shaded.file, &l.by_level]))
        .chain(out.compressions.iter().map(|c| &c.shown.file))
        .chain(out.transition.iter().flat_map(|t| [&t.shaded.file, &t.by_level]));
    for file in pictures {
        assert!(colours(dir.path(), file).2 > 10, "{file}");
    }
    detail::parts(&data(), album, &mut out).unwrap();
    assert!(out.topology.len() >= 4 && out.topology[0].above[0] > 0, "{:?}", out.topology);
    assert!(out.topology.iter().all(|t| t.shown.verified.wrong == 0));
    write(&out, dir.path()).unwrap();
    assert_eq!(lines(dir.path(), "figure-4.5.csv"), 9);
    assert_eq!(lines(dir.path(), "figure-6.7.csv"), 7);
    assert_eq!(lines(dir.path(), "figure-6.8.csv"), 1 + out.transition.len());
    assert_eq!(lines(dir.path(), "figure-6.9.csv"), 1 + out.topology.len());
}

/// A frame of another isovalue is found out.
#[test]
fn a_wrong_frame_is_told() {
    let at = |i: usize| [i % 12, i / 12 % 12, i / 144].map(|x| x as f64 - 5.5);
    let samples: Vec<f32> = (0..12 * 12 * 12).map(|i| DVec3::from_array(at(i)).length() as f32).collect();
    let grid = Grid::unit([12; 3], Samples::F32(samples.into())).unwrap();
    let view = View::fit(grid.domain().world_bounds(), 40.0, 48, 36);
    let volume = std::sync::Arc::new(Data::Grid(grid.clone()));
    let scene = isobar_octree::figures::Scene {
        data: &volume,
        isovalue: 3.0,
        kind: Kind::Cubic,
        view: &view,
    };
    let (frame, _) = scene.draw(isobar_core::Channels::T, 1, 0).unwrap();
    let right = verify(&frame, &grid, Kind::Cubic, 3.0, &view).unwrap();
    assert!(right.wrong == 0 && right.hits > 60, "{right:?}");
    assert!(verify(&frame, &grid, Kind::Cubic, 4.5, &view).unwrap().wrong > 100);
}
