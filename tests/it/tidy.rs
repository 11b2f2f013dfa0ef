//! Rules of the repository that no compiler checks.

use sha2::{Digest, Sha256};
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .canonicalize()
        .expect("the workspace is there")
}

fn files(dir: &Path, out: &mut Vec<PathBuf>) {
    for e in fs::read_dir(dir).expect("readable").flatten() {
        let p = e.path();
        let name = e.file_name();
        let name = name.to_string_lossy();
        if p.is_dir() {
            if !["target", ".git", "cache", "reports", "artifacts", "corpus"].contains(&name.as_ref()) {
                files(&p, out);
            }
        } else {
            out.push(p);
        }
    }
}

fn sources(extensions: &[&str]) -> Vec<PathBuf> {
    let mut all = Vec::new();
    files(&root(), &mut all);
    // Of the reports only those kept in the repository.
    let recorded = root().join("reports/recorded");
    if recorded.is_dir() {
        files(&recorded, &mut all);
    }
    all.retain(|p| p.extension().is_some_and(|e| extensions.iter().any(|x| e == *x)));
    assert!(!all.is_empty());
    all
}

#[test]
fn no_file_names_a_path_of_one_machine() {
    let words = ["/home", "/root", "/wo_rk", "/Us_ers"].map(|w| format!("{}/", w.replace('_', "")));
    for p in sources(&["rs", "wgsl", "toml", "md", "yml", "sh", "css", "html", "csv", "txt"]) {
        if p.ends_with("tidy.rs") {
            continue;
        }
        let text = fs::read_to_string(&p).expect("text");
        for w in &words {
            assert!(!text.contains(w.as_str()), "{} names {w}", p.display());
        }
    }
}

#[test]
fn no_test_is_ignored_or_passes_without_running() {
    for p in sources(&["rs"]) {
        if p.ends_with("tidy.rs") {
            continue;
        }
        let text = fs::read_to_string(&p).expect("text");
        for w in ["#[ignore", "todo!(", "unimplemented!("] {
            assert!(!text.contains(w), "{} has {w}", p.display());
        }
    }
}

#[test]
fn every_crate_has_a_readme_and_files_stay_readable() {
    for e in fs::read_dir(root().join("crates")).expect("crates").flatten() {
        let name = e.file_name();
        if e.path().join("Cargo.toml").exists() && name != "isobar-core" {
            assert!(e.path().join("README.md").exists(), "{name:?} has no README.md");
        }
    }
    for p in sources(&["rs", "wgsl"]) {
        let lines = fs::read_to_string(&p).expect("text").lines().count();
        assert!(lines <= 800, "{} has {lines} lines", p.display());
    }
}

#[test]
fn the_oracle_and_the_methods_do_not_see_each_other() {
    let text = |krate: &str| {
        let toml = fs::read_to_string(root().join("crates").join(krate).join("Cargo.toml")).expect("manifest");
        let parsed: toml::Table = toml.parse().expect("toml");
        parsed
            .get("dependencies")
            .and_then(|d| d.as_table())
            .map(|t| t.keys().cloned().collect::<Vec<_>>())
            .unwrap_or_default()
    };
    for forbidden in ["isobar-poly", "isobar-cpu", "isobar-gpu", "isobar-baseline", "isobar-fields"] {
        assert!(
            !text("isobar-oracle").contains(&forbidden.to_owned()),
            "the oracle depends on {forbidden}"
        );
    }
    // Only the program, the report and the crates above the methods see the oracle; methods see no other method.
    let above = ["isobar", "isobar-report", "isobar-oracle", "isobar-scenes"];
    let methods = [
        "isobar-baseline",
        "isobar-cellproj",
        "isobar-nurbs",
        "isobar-octree",
        "isobar-peaks",
        "isobar-tetspline",
    ];
    let mut seen = 0;
    for e in fs::read_dir(root().join("crates")).expect("crates").flatten() {
        let name = e.file_name().to_string_lossy().into_owned();
        // It sees the oracle, so what tests share is for tests alone.
        assert!(
            !text(&name).contains(&"isobar-scenes".to_owned()),
            "{name} needs isobar-scenes outside of its tests"
        );
        if above.contains(&name.as_str()) {
            continue;
        }
        let needs = text(&name);
        for other in ["isobar-oracle"].iter().chain(methods.iter().filter(|m| **m != name)) {
            assert!(!needs.contains(&(*other).to_owned()), "{name} depends on {other}");
        }
        seen += 1;
    }
    assert!(seen >= 8, "{seen} crates");
    for forbidden in ["rayon", "wgpu", "serde", "isobar-fields"] {
        assert!(
            !text("isobar-core").contains(&forbidden.to_owned()),
            "core depends on {forbidden}"
        );
    }
}

#[test]
fn shipped_data_are_what_the_manifest_says() {
    let dir = root().join("bench-data");
    let manifest: toml::Table = fs::read_to_string(dir.join("MANIFEST.toml"))
        .expect("manifest")
        .parse()
        .expect("toml");
    let rows = manifest["file"].as_array().expect("[[file]] rows");
    assert!(rows.len() >= 3);
    let mut total = 0;
    for row in rows {
        let name = row["path"].as_str().expect("path");
        let bytes = fs::read(dir.join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        total += bytes.len();
        let digest: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(digest, row["sha256"].as_str().expect("sha256"), "{name}");
        let licence = row["licence_file"].as_str().expect("licence_file");
        assert!(dir.join(licence).is_file(), "{name}: {licence} is missing");
        assert!(!row["licence"].as_str().expect("licence").is_empty() && !row["source"].as_str().expect("source").is_empty());
    }
    let named = |p: &str| rows.iter().any(|r| r["path"].as_str() == Some(p));
    for e in fs::read_dir(&dir)
        .expect("bench-data")
        .flatten()
        .filter(|e| e.path().is_file())
    {
        let name = e.file_name().to_string_lossy().into_owned();
        assert!(name == "MANIFEST.toml" || named(&name), "{name} has no row in MANIFEST.toml");
    }
    assert!(total < 25 << 20, "{total} bytes are shipped");
}
