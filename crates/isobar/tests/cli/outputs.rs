//! Where outputs go: links, devices, one file under two names; and what answers no.

use super::{Place, SPHERE, json, nan_file, text};
use std::path::Path;

fn march() -> String {
    format!("render {SPHERE} --method march/cpu --isovalue 1 --size 20x10")
}

#[cfg(unix)]
#[test]
fn devices_and_pipes_are_refused_and_links_followed() {
    use std::os::unix::fs::symlink;
    let p = Place::new();
    symlink("/dev/null", p.path("null.json")).expect("a link");
    let made = std::process::Command::new("mkfifo")
        .arg(p.path("pipe.json"))
        .status()
        .expect("mkfifo");
    assert!(made.success());
    for (flag, name) in [("--stats", "null.json"), ("--stats", "pipe.json"), ("--stats", "/dev/null")] {
        p.bad(&format!("{} {flag} {name}", march()), &format!("{flag} {name}: is a device"));
    }
    p.bad(&format!("{} --tf pipe.json", march()), "--tf pipe.json: is no ordinary file");
    p.bad(&format!("{} --tf /dev/zero", march()), "--tf /dev/zero: is no ordinary file");
    assert!(p.path("null.json").is_symlink());

    std::fs::create_dir(p.path("far")).expect("a folder");
    symlink("far/a.png", p.path("a.png")).expect("a link");
    symlink("far/s.json", p.path("s.json")).expect("a link");
    p.file("far/s.json", b"before");
    p.good(&format!("{} -o a.png --stats s.json", march()));
    assert!(p.path("a.png").is_symlink() && p.path("s.json").is_symlink());
    assert!(p.path("far/a.png").is_file());
    let stats = json(&p.path("far/s.json"));
    assert_eq!(stats["settings"]["cell_to_point"], false);

    symlink("far/out", p.path("out")).expect("a link");
    p.good(&format!(
        "compare {SPHERE} --isovalue 1 --size 20x10 --repeat 1 --methods mc/cpu -o out"
    ));
    assert!(p.path("out").is_symlink() && p.path("far/out/index.html").is_file());
    symlink("none/out", p.path("lost")).expect("a link");
    p.bad(&format!("compare {SPHERE} --isovalue 1 -o lost"), "-o lost");
}

#[test]
fn a_file_is_named_once() {
    let p = Place::new();
    p.bad(&format!("{} -o a.png -o ./a.png", march()), "./a.png: named twice");
    p.bad(
        &format!("check {SPHERE} --method march/cpu --isovalue 1 --json m.png --map ./m.png"),
        "--map ./m.png",
    );
    let file = nan_file(&p);
    let before = std::fs::read(&file).expect("the file");
    p.bad(
        &format!("render {file} --nan 0 --method march/cpu --isovalue 1 --stats ./nan.nrrd"),
        "the file of DATA",
    );
    assert_eq!(std::fs::read(&file).expect("the file"), before);
    let tf = p.file("t.toml", b"points = [[0, 1, 0, 0, 1]]");
    p.bad(
        &format!("render {SPHERE} --method peaks/cpu --tf {tf} --stats t.toml"),
        "the file of --tf",
    );
}

#[test]
fn a_comparison_of_nothing_answers_no() {
    let p = Place::new();
    for line in [
        // A grid: march draws no tetrahedra.
        "compare synthetic:sphere,n=5,as=tets --isovalue 1 --methods march/cpu --size 20x10 --repeat 1 -o a".to_owned(),
        format!("compare {SPHERE} --isovalue 1 --methods mc/cpu --max-error 1e-12 --size 20x10 --repeat 1 -o b"),
    ] {
        let o = p.run(&line);
        assert_eq!(o.status.code(), Some(1), "{line}\n{}", text(&o.stderr));
    }
    assert!(Path::new(&p.path("a/index.html")).is_file() && p.path("b/index.html").is_file());
}

#[test]
fn unused_flags_and_missing_values_are_told() {
    let p = Place::new();
    let o = p.run(&format!("{} --cell-to-point", march()));
    assert!(
        o.status.success() && text(&o.stderr).contains("--cell-to-point"),
        "{}",
        text(&o.stderr)
    );
    let mesh = p.file(
        "nan.vtk",
        b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\nCELLS 1 5\n4 0 1 2 3\n\
          CELL_TYPES 1\n10\nPOINT_DATA 4\nSCALARS s float 1\nLOOKUP_TABLE default\n0 nan 2 3\n",
    );
    let j: serde_json::Value = serde_json::from_str(&p.good(&format!("info {mesh} --json"))).expect("JSON");
    assert_eq!((&j["nan"], &j["range"]), (&1.into(), &serde_json::json!([0.0, 3.0])));
    p.bad(&format!("render {mesh} --method cellproj/cpu --isovalue 1"), "--nan C");
    p.good(&format!(
        "render {mesh} --nan 1 --method cellproj/cpu --isovalue 1.5 --size 9x9"
    ));
}

#[test]
fn a_dense_medium_is_checked_in_reasonable_time() {
    let p = Place::new();
    let tf = p.file("t.toml", b"points = [[0, 1, 0, 0, 1e25], [10, 0, 1, 0, 0]]");
    let start = std::time::Instant::now();
    p.good(&format!(
        "check synthetic:torus,n=8 --method peaks/cpu --tf {tf} --size 32x24 --json c.json"
    ));
    assert!(start.elapsed().as_secs() < 30, "{:?}", start.elapsed());
    assert!(json(&p.path("c.json"))["colour"]["error_bound"].as_f64().expect("a bound") >= 1.0);
}
