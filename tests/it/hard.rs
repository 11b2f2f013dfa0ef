//! The hard cases (`bench-data/definitions/hard/cases`), every root finder and every method that starts here.
//!
//! A case that fails is declared in its file as a known failure with the reason. A failure that is not declared fails here, and so does a declared one
//! that begins to pass.

use isobar_report::hard;
use isobar_report::results::{MatrixTable, VerdictKind};
use std::path::Path;
use std::sync::OnceLock;

/// The whole matrix, made once.
fn tables() -> &'static [MatrixTable] {
    static ALL: OnceLock<Vec<MatrixTable>> = OnceLock::new();
    ALL.get_or_init(|| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../bench-data/definitions/hard/cases");
        hard::run(&folder, &isobar::methods()).expect("the cases are readable").tables
    })
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
    assert!(count >= 50, "only {count} cases were run");
}

#[test]
fn every_failure_is_declared_and_every_declared_failure_still_fails() {
    let mut wrong = Vec::new();
    for t in tables() {
        for r in &t.rows {
            for (column, v) in t.columns.iter().zip(&r.cells) {
                if matches!(v.kind, VerdictKind::Wrong | VerdictKind::Unexpected) {
                    wrong.push(format!(
                        "{} {column} {:?}: expected {}, given {}",
                        r.id, v.kind, r.expected, v.given
                    ));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} cells:\n{}", wrong.len(), wrong.join("\n"));
}

/// Methods that prove their answers have no case wrong, and none declared as a known failure.
#[test]
fn proving_methods_are_right_about_every_grid_case() {
    for t in tables() {
        for method in ["octree/cpu", "tetspline/cpu"] {
            let Some(at) = t.columns.iter().position(|c| c == method) else {
                continue;
            };
            for r in &t.rows {
                let v = &r.cells[at];
                assert!(
                    matches!(v.kind, VerdictKind::Right | VerdictKind::Refused),
                    "{method}, {}: expected {}, given {}",
                    r.id,
                    r.expected,
                    v.given
                );
            }
        }
    }
}
