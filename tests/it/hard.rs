//! The hard cases (`bench-data/definitions/hard/cases`), every root finder and every method that starts here.
//!
//! A case that fails is declared in its file as a known failure with the reason. A failure that is not declared fails here, and so does a declared one
//! that begins to pass.

use isobar_report::hard::{self, Bar};
use isobar_report::results::{Elsewhere, Matrix, MatrixTable, VerdictKind};
use std::path::Path;
use std::sync::OnceLock;

/// The whole matrix, made once.
fn matrix() -> &'static Matrix {
    static ALL: OnceLock<Matrix> = OnceLock::new();
    ALL.get_or_init(|| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../bench-data/definitions/hard/cases");
        hard::run(&folder, &isobar::methods()).expect("the cases are readable")
    })
}

fn tables() -> &'static [MatrixTable] {
    &matrix().tables
}

#[test]
fn the_oracle_is_right_about_every_case() {
    let mut count = 0;
    for t in tables() {
        let oracle = t.columns.iter().position(|c| c == "oracle").expect("the oracle has a column");
        for r in &t.rows {
            let v = &r.cells[oracle];
            assert!(
                matches!(v.kind, VerdictKind::Right),
                "{} ({}): expected {}, given {} ({:?})",
                r.id,
                r.title,
                r.expected,
                v.given,
                v.kind
            );
            count += 1;
        }
    }
    assert!(count >= 65, "only {count} cases were run");
}

#[test]
fn every_failure_is_declared_and_every_declared_failure_still_fails() {
    let mut wrong = Vec::new();
    for t in tables() {
        for r in &t.rows {
            for (column, v) in t.columns.iter().zip(&r.cells) {
                if matches!(v.kind, VerdictKind::Wrong | VerdictKind::Unexpected) {
                    wrong.push(format!(
                        "{} {column} {:?}: expected {} {}, given {}",
                        r.id, v.kind, r.expected, v.expected, v.given
                    ));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} cells:\n{}", wrong.len(), wrong.join("\n"));
}

/// Methods that prove their answers have no case wrong; what is declared as known is about hits behind the first, of which nothing is claimed.
#[test]
fn proving_methods_are_right_about_every_grid_case() {
    let mut proving = Vec::new();
    for m in isobar::methods().into_iter().filter(|m| Bar::of(*m).proves) {
        let id = m.info().id;
        let mut right = 0;
        for t in tables() {
            let Some(at) = t.columns.iter().position(|c| c == id) else {
                continue;
            };
            for r in &t.rows {
                let v = &r.cells[at];
                let known = v.kind == VerdictKind::Known && !v.given.contains("refuted");
                assert!(
                    known || matches!(v.kind, VerdictKind::Right | VerdictKind::Refused),
                    "{id}, {}: expected {} {}, given {}",
                    r.id,
                    r.expected,
                    v.expected,
                    v.given
                );
                right += usize::from(v.kind == VerdictKind::Right);
            }
        }
        assert!(right > 0, "{id} was asked nothing");
        proving.push(id);
    }
    assert!(
        proving.contains(&"octree/cpu") && proving.contains(&"tetspline/cpu"),
        "{proving:?}"
    );
}

/// Every case of hardcases B and C is a row, or says where it is tested.
#[test]
fn no_case_of_sections_b_and_c_is_left_out() {
    let said: Vec<&str> = (tables().iter().flat_map(|t| &t.rows).map(|r| r.source.as_str()))
        .chain(matrix().elsewhere.iter().map(|e| e.source.as_str()))
        .collect();
    let wanted = (1..=18).map(|n| format!("B{n}")).chain((1..=19).map(|n| format!("C{n}")));
    for id in wanted.chain(["B11b".to_owned()]) {
        let names = |s: &&str| s.split([' ', ',', ';']).any(|w| w == id);
        assert!(
            said.iter().any(names),
            "hardcases {id} is neither a row nor listed as tested elsewhere"
        );
    }
}

/// A case that is said to be tested elsewhere is: the file has a test of that name.
#[test]
fn tests_elsewhere_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut seen = 0;
    for Elsewhere { id, tests, .. } in &matrix().elsewhere {
        for t in tests {
            let (file, name) = t.split_once(": ").unwrap_or_else(|| panic!("{id}: {t} is not FILE: NAME"));
            let text = std::fs::read_to_string(root.join(file)).unwrap_or_else(|e| panic!("{id}: {file}: {e}"));
            let lines: Vec<&str> = text.lines().map(str::trim).collect();
            let head = format!("fn {name}()");
            let at = lines.iter().position(|l| l.starts_with(&head));
            let at = at.unwrap_or_else(|| panic!("{id}: {file} has no {head}"));
            let marked = lines[..at].iter().rev().take(4).any(|l| *l == "#[test]");
            assert!(marked, "{id}: {file}: {name} is no test");
            seen += 1;
        }
    }
    assert!(seen >= 4, "{seen} tests are listed");
}
