use super::*;
use crate::steinberger::figures::Shown;
use crate::steinberger::figures::volumes::{Degree, SampledRow};

fn shown(file: &str, wrong: u64) -> Shown {
    Shown {
        file: file.into(),
        verified: Verified {
            pixels: 1000,
            hits: 400,
            wrong,
            undecidable: 0,
        },
    }
}

fn all() -> Figures {
    Figures {
        blocks: Some(BlocksRow {
            title: "<a skull>".into(),
            blocks: 4096,
            launched: 2000,
            classes: [500, 700, 200, 600],
            shown: shown("files/b.png", 0),
        }),
        compressions: vec![CompressionRow {
            weighted: true,
            kept: 42,
            shown: shown("files/c.png", 0),
            ..CompressionRow::default()
        }],
        levels: vec![LevelPictures {
            figure: "c".into(),
            shaded: shown("files/l.png", 0),
            by_level: "files/k.png".into(),
            differ: 3,
            chunks_by_level: vec![5, 6, 7],
        }],
        transition: vec![Shot {
            name: "close-up".into(),
            shaded: shown("files/t.png", 0),
            by_level: "files/u.png".into(),
        }],
        topology: vec![TopologyRow {
            details: "all".into(),
            above: [18, 1, 900],
            shown: shown("files/p.png", 0),
            ..TopologyRow::default()
        }],
        surfaces: [64, 128]
            .into_iter()
            .flat_map(|size| {
                ["frustum form", "SB1"].map(|how| SurfaceTime {
                    letter: 'a',
                    size,
                    how: how.into(),
                    preprocessing: if how == "SB1" { 0.0 } else { 0.01 },
                    frame: 2.5,
                    checked: 4096,
                    wrong: u64::from(how == "SB1"),
                    ..SurfaceTime::default()
                })
            })
            .collect(),
        surface_pictures: vec![('a', "files/a.png".into())],
        degrees: vec![DegreesRow {
            figure: "6.3".into(),
            title: "a dragon".into(),
            degrees: vec![
                Degree {
                    kind: "trilinear".into(),
                    frame: 20.0,
                    shown: shown("files/d.png", 0),
                };
                3
            ],
            bricks: [[1, 8], [1, 1]],
            bricks_file: "files/e.png".into(),
        }],
        closeup: Some(CloseupRow {
            title: "a head".into(),
            voxels: 4.0,
            sampled: vec![SampledRow {
                bits: Some(8),
                ..SampledRow::default()
            }],
            exact: shown("files/x.png", 0),
            sampled_file: "files/y.png".into(),
            angle_file: "files/z.png".into(),
            ..CloseupRow::default()
        }),
        seconds: 1.0,
    }
}

#[test]
fn every_figure_has_its_pictures_and_the_numbers_of_the_thesis() {
    let rows = [LevelRow {
        figure: "c".into(),
        chunks: 1873,
        ..LevelRow::default()
    }];
    let text = section(&all(), &rows).unwrap();
    for name in "abcdeklptuxyz".chars() {
        assert!(text.contains(&format!("<img src=\"files/{name}.png\"")), "{name}");
    }
    for said in [
        "Figure 3.2",
        "752",
        "28.9 %",
        "&lt;a skull&gt;",
        "Figure 4.5",
        "Figures 4.6 and 6.7",
        "[1877]",
        "[161]",
        "Figure 6.1",
        "Figures 6.2 to 6.5",
        "9.80",
        "50.0",
        "Figure 6.6",
        "Figure 6.8",
        "Figure 6.9",
        "none is wrong",
        "<span class=\"bad\">1</span> of 4",
    ] {
        assert!(text.contains(said), "{said}: {text}");
    }
    assert!(text.contains("<svg class=\"chart\""));
    for tag in ["table", "figure", "div", "p", "h3", "h4"] {
        let open = text.matches(&format!("<{tag}>")).count() + text.matches(&format!("<{tag} ")).count();
        assert_eq!(open, text.matches(&format!("</{tag}>")).count(), "{tag}");
    }
}

#[test]
fn what_was_not_drawn_is_not_mentioned_and_wrong_pixels_are() {
    assert_eq!(section(&Figures::default(), &[]).unwrap(), "");
    let some = Figures {
        topology: all().topology,
        seconds: 1.0,
        ..Figures::default()
    };
    let text = section(&some, &[]).unwrap();
    assert!(text.contains("Figure 6.9") && !text.contains("Figure 6.8") && !text.contains("Figure 3.2"));
    let mut bad = all();
    bad.transition[0].shaded = shown("files/t.png", 7);
    assert!(section(&bad, &[]).unwrap().contains("<b class=\"bad\">7 are wrong</b>"));
    assert_eq!(bad.trouble(), ["Steinberger 2010, Figure 6.8: 7 of 1000 pixels are wrong"]);
    assert!(all().trouble().is_empty());
}
