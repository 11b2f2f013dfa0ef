use super::*;
use crate::results::{
    Apart, Checked, Colour, Comparison, Elsewhere, Matrix, MatrixRow, MatrixTable, Pictures, Row, Scene, Spread, Stat, Truth,
    Verdict, VerdictKind,
};

fn row(method: &str, setting: &str, seconds: f64, missed: u64) -> Row {
    Row {
        method: method.into(),
        setting: setting.into(),
        wall: Stat {
            median: seconds,
            mad: 0.001,
            n: 5,
        },
        checked: Checked {
            pixels: 1000,
            hits: 400,
            missed,
            t_voxels: Spread {
                median: 1e-7,
                p99: 1e-4,
                max: 1e-3,
            },
            ..Checked::default()
        },
        ..Row::default()
    }
}

fn report() -> Report {
    let mut refused = row("c/gpu", "step=1", 0.0, 0);
    refused.reason = Some("no adapter <here>".into());
    let comparison = Comparison {
        reconstruction: "trilinear".into(),
        truth: Truth {
            pixels: 1000,
            hits: 400,
            expected: Some(401),
            ..Truth::default()
        },
        rows: vec![
            row("a/cpu", "step=2", 0.010, 9),
            row("a/cpu", "step=1", 0.020, 0),
            row("b/cpu", "", 0.015, 0),
            refused,
        ],
        pictures: vec![Pictures {
            method: "a/cpu".into(),
            image: "files/x.png".into(),
            error: "files/e.png".into(),
            ..Pictures::default()
        }],
        failures: vec!["the oracle found 400 hits, the definition demands 401".into()],
        ..Comparison::default()
    };
    let scene = |id: &str, comparisons, skipped: Option<&str>| Scene {
        id: id.into(),
        group: "curated".into(),
        title: format!("Scene {id}"),
        analysis: "It shows <something>.".into(),
        size: [40, 25],
        skipped: skipped.map(String::from),
        comparisons,
        ..Scene::default()
    };
    Report {
        command: "cargo xtask report --only <x>".into(),
        scenes: vec![
            scene("one", vec![comparison], None),
            scene("two", vec![], Some("ISOBAR_DATA is not set")),
        ],
        hard: Matrix {
            tables: vec![MatrixTable {
                title: "Polynomials".into(),
                columns: vec!["clip".into()],
                rows: vec![MatrixRow {
                    id: "A2".into(),
                    cells: vec![Verdict {
                        kind: VerdictKind::Known,
                        given: "none".into(),
                        expected: "certified at 0.5".into(),
                    }],
                    ..MatrixRow::default()
                }],
                ..MatrixTable::default()
            }],
            elsewhere: vec![Elsewhere {
                id: "B16".into(),
                tests: vec!["crates/a.rs: banks".into()],
                ..Elsewhere::default()
            }],
        },
        ..Report::default()
    }
}

#[test]
fn the_page_says_who_wins_and_what_failed() {
    let p = page(&report()).unwrap();
    // at no wrong pixel the slower setting of a loses to b
    assert!(
        p.contains("No wrong pixel, all within 0.1 voxel: of 1 comparisons, <b>b/cpu</b> is fastest in 1."),
        "{p}"
    );
    assert!(
        p.contains("A picture: at most 1000 wrong pixels per million, 99 % within 0.1 voxel: of 1 comparisons, <b>b/cpu</b>")
    );
    assert!(p.contains("the oracle found 400 hits"));
    assert!(p.contains("no adapter &lt;here&gt;"));
    assert!(p.contains("ISOBAR_DATA is not set"));
    assert!(p.contains("known failure"));
    assert!(p.contains("certified: certified at 0.5") && p.contains("<code>crates/a.rs: banks</code>"));
}

/// A method without a rival is not the fastest of anything.
#[test]
fn one_method_alone_wins_nothing() {
    let mut r = report();
    r.scenes[0].comparisons[0].rows.retain(|row| row.method == "b/cpu");
    let p = page(&r).unwrap();
    assert!(!p.contains("is fastest in"));
    assert!(p.contains("1 more have a single method"));
    assert!(p.contains(", one method only</small>"));
}

/// Media are compared by colour, and not ranked among those compared by distance.
#[test]
fn media_have_a_table_of_colours() {
    let mut r = report();
    let apart = |p99| Apart {
        p99: Some(p99),
        max: Some(0.5),
        visible: 7,
        psnr: Some(40.0),
    };
    let colour = |peaks: Option<Apart>| Colour {
        integral: apart(0.125),
        peaks,
        bound: Some(1e-11),
        surfaces: peaks.is_some(),
        ..Colour::default()
    };
    let mut drawn = row("a/cpu", "mode=default", 0.010, 0);
    drawn.colour = Some(colour(Some(apart(0.0625))));
    let mut alone = row("b/cpu", "mode=dvr_only", 0.010, 0);
    (alone.colour, alone.checked.hits) = (Some(colour(None)), 0);
    r.scenes[0].medium = Some("bench-data/tf/m.toml".into());
    r.scenes[0].comparisons[0].rows = vec![drawn, alone];
    let p = page(&r).unwrap();
    assert!(
        p.contains("No scene was measured") && p.contains("medium <code>bench-data/tf/m.toml</code>"),
        "{p}"
    );
    assert!(
        p.contains("0.0625<small>max 0.500, visible 7, 40.0 dB") && p.contains("0.125<small>"),
        "{p}"
    );
    // Two references, two charts.
    assert!(p.contains("error of colour against peaks") && p.contains("error of colour against the integral"));
    r.scenes[0].comparisons[0].rows[0].colour = Some(Colour::default());
    assert!(page(&r).unwrap().contains("no numbers"));
}

#[test]
fn the_page_needs_no_network_and_escapes_what_it_is_given() {
    let p = page(&report()).unwrap();
    for remote in ["http://", "https://", "<script", "@import", "url("] {
        // the name space of SVG is not fetched
        let rest = p.replace("http://www.w3.org/2000/svg", "");
        assert!(!rest.contains(remote), "{remote}");
    }
    assert!(p.contains("It shows &lt;something&gt;."));
    assert!(p.contains("--only &lt;x&gt;"));
    assert_eq!(p.matches("<table>").count(), p.matches("</table>").count());
    assert_eq!(p.matches("<figure>").count(), p.matches("</figure>").count());
}
