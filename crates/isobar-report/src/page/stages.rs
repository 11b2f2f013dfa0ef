//! Tables 6.1 and 6.3 of Steinberger's thesis beside what `octree/cpu` takes and counts.

use super::html::{Cell, anchor, escape, number, table};
use crate::results::{Comparison, Row, Scene};
use crate::steinberger::Steinberger;
use crate::steinberger::stages::{DEGREES, PRINTED_6_1, PRINTED_6_3, STAGES, STAGES_6_1, SurfaceRow};
use isobar_octree::stages::Laps;

use crate::measure::STAGED as METHOD;

pub(super) fn section(s: &Steinberger, scenes: &[Scene]) -> String {
    let counted = counted(scenes);
    if s.finders.is_empty() && counted.is_empty() {
        return String::new();
    }
    let mut out = String::from("<h3>Tables 6.1 and 6.3: stages of a frame</h3>\n");
    out.push_str(&printed());
    if !counted.is_empty() {
        let head = [
            ("text", "octree/cpu, scene and reconstruction"),
            ("wrap", "CPU ms of a frame"),
            ("wrap", "traverse: nodes per ray"),
            ("", "bricks"),
            ("", "cells"),
            ("wrap", "compositions per ray"),
            ("wrap", "again in f64"),
            ("wrap", "normals per ray"),
        ];
        out.push_str(&table(&head, &counted));
    }
    out.push_str(&clocked(scenes));
    out.push_str(
        "<p><code>octree/cpu</code> has no clock in it, since the rays of a packet are in different stages at once: in its frames work is counted, per ray of the \
         image. Composition and root finding are one column there: a cell whose Bernstein coefficients show no change of sign ends there. The times of the \
         stages are of one thread, of frames drawn tile by tile with a clock between the tile's parts, two of which are taken apart by doing one of their \
         stages again; these frames too were held against the certified roots, and have no wrong pixel. <i>Composition + load</i> holds where rays enter \
         and leave cells, and the signs. Table 6.2 is in the scenes, which are definitions of their own (<i>Scenes of papers</i>).</p>\n",
    );
    out.push_str(&surfaces(&s.surfaces));
    out
}

/// Table 6.3 (a) as printed.
fn printed() -> String {
    let mut head = vec![("text", "as printed, ms".to_owned())];
    for (name, _) in PRINTED_6_3 {
        head.extend(DEGREES.map(|d| ("wrap", format!("{name}, {d}"))));
    }
    let head: Vec<(&str, &str)> = head.iter().map(|(c, t)| (*c, t.as_str())).collect();
    let rows: Vec<_> = (STAGES.iter().enumerate())
        .map(|(i, stage)| {
            let mut cells = vec![Cell::text(stage)];
            cells.extend(PRINTED_6_3.iter().flat_map(|(_, s)| s[i]).map(|x| Cell::new(number(x))));
            ("", cells)
        })
        .collect();
    table(&head, &rows)
}

/// A line for each comparison the method took part in.
fn counted(scenes: &[Scene]) -> Vec<(&'static str, Vec<Cell>)> {
    let mut out = Vec::new();
    for (s, c) in scenes.iter().flat_map(|s| s.comparisons.iter().map(move |c| (s, c))) {
        let row = c.rows.iter().find(|r| r.method == METHOD && r.default && r.reason.is_none());
        out.extend(row.and_then(|r| line(s, c, r)).map(|cells| ("", cells)));
    }
    out
}

fn line(s: &Scene, c: &Comparison, r: &Row) -> Option<Vec<Cell>> {
    let find = |name: &str| r.counters.iter().find(|(n, _)| n == name).map(|(_, v)| *v as f64);
    let rays = r.checked.pixels.max(1) as f64;
    let per = |x: f64| Cell::new(number(x / rays));
    // Degree 1 composes a cubic once; higher degrees compose in f32 and, in doubt, again in f64.
    let composed = find("cubics").or_else(|| find("compositions in f32"))?;
    Some(vec![
        scene_cell(s, c),
        Cell::new(number(r.cpu.median * 1e3)),
        per(find("nodes")?),
        per(find("bricks")?),
        per(find("cells")?),
        per(composed),
        find("compositions in f64").map_or_else(|| Cell::new("–"), per),
        per(r.checked.hits as f64),
    ])
}

/// The times of the stages of one thread, where they were clocked.
fn clocked(scenes: &[Scene]) -> String {
    let all = scenes.iter().flat_map(|s| s.comparisons.iter().map(move |c| (s, c)));
    let rows: Vec<_> = all
        .filter_map(|(s, c)| {
            let stages = c.stages?;
            let whole: f64 = stages.iter().sum();
            let mut cells = vec![scene_cell(s, c)];
            cells.extend(stages.map(|t| Cell::new(format!("{}<small>{:.1} %</small>", number(t * 1e3), 100.0 * t / whole))));
            cells.push(Cell::new(number(whole * 1e3)));
            Some(("", cells))
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    let mut head = vec![("text", "ms of one thread")];
    head.extend(Laps::NAMES.map(|n| ("wrap", n)));
    head.push(("", "all"));
    table(&head, &rows)
}

fn scene_cell(s: &Scene, c: &Comparison) -> Cell {
    let title = format!(
        "<a href=\"#{}\">{}</a><small>{}</small>",
        anchor(&s.id),
        escape(&s.title),
        escape(&c.reconstruction)
    );
    Cell::with("text", title)
}

/// Table 6.1.
fn surfaces(rows: &[SurfaceRow]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let all: Vec<f64> = rows.iter().map(|r| r.stages.iter().sum()).collect();
    let mut head = vec![("text", "percent of a frame".to_owned())];
    head.extend(DEGREES.map(|d| ("wrap", format!("{d}, thesis"))));
    head.extend(rows.iter().map(|r| {
        let degree = DEGREES.get((r.degree as usize).wrapping_sub(1)).unwrap_or(&"");
        let how = if r.thesis {
            "SB1 and LR81, f32"
        } else {
            "axis and robust, f64"
        };
        ("wrap", format!("{degree}, {how}"))
    }));
    let head: Vec<(&str, &str)> = head.iter().map(|(c, t)| (*c, t.as_str())).collect();
    let mut lines: Vec<_> = (STAGES_6_1.iter().zip(PRINTED_6_1).enumerate())
        .map(|(i, (stage, printed))| {
            let mut cells = vec![Cell::text(stage)];
            cells.extend(printed.map(|x| Cell::with("zero", number(x))));
            let share = |(r, all): (&SurfaceRow, &f64)| Cell::new(number(100.0 * r.stages[i] / all));
            cells.extend(rows.iter().zip(&all).map(share));
            ("", cells)
        })
        .collect();
    let mut last = vec![Cell::text("all, ms")];
    last.extend(DEGREES.map(|_| Cell::with("zero", "")));
    last.extend(all.iter().map(|&ms| Cell::new(number(ms))));
    lines.push(("", last));
    format!(
        "<h4>Table 6.1: algebraic surfaces</h4>\n{}<p>The three surfaces of Figure 6.1 in the default view, 1024×768, one thread, the fastest of three frames, by the thesis's \
         pipeline: a row of pixels goes through one stage after the other, with a clock between them. Once with a composition and the root finder of the thesis, 6 (d + 1) \
         iterations; once with the composition and the solver that we recommend. The thesis gives no times. <a \
         href=\"csv/imported/steinberger2010/table-6.1.csv\">table-6.1.csv</a></p>\n",
        table(&head, &lines)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Checked, Stat};

    #[test]
    fn stages_are_counted_per_ray_and_absent_without_counters() {
        assert_eq!(section(&Steinberger::default(), &[]), "");
        let counters = [("nodes", 2000), ("bricks", 1000), ("cells", 500), ("cubics", 250)];
        let row = Row {
            method: METHOD.into(),
            default: true,
            cpu: Stat {
                median: 0.012,
                ..Stat::default()
            },
            checked: Checked {
                pixels: 1000,
                hits: 400,
                ..Checked::default()
            },
            counters: counters.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect(),
            ..Row::default()
        };
        let scene = |row: Row| Scene {
            title: "<Bucky>".into(),
            comparisons: vec![Comparison {
                reconstruction: "trilinear".into(),
                rows: vec![row],
                stages: Some([0.0005, 0.0075, 0.001, 0.0005, 0.0005, 0.0]),
                ..Comparison::default()
            }],
            ..Scene::default()
        };
        let text = section(&Steinberger::default(), &[scene(row.clone())]);
        assert!(
            text.contains("&lt;Bucky&gt;") && text.contains(">12.0<") && text.contains(">0.400<"),
            "{text}"
        );
        assert!(text.contains("224") && text.contains("no clock in it"));
        assert!(text.contains("rootfind") && text.contains("7.50<small>75.0 %"), "{text}");
        let s = Steinberger {
            surfaces: vec![
                SurfaceRow {
                    thesis: true,
                    degree: 3,
                    stages: [1.0, 1.0, 1.0, 1.0, 93.0, 2.0, 1.0],
                    hits: 7,
                };
                3
            ],
            ..Steinberger::default()
        };
        let text = section(&s, &[scene(row.clone())]);
        assert!(
            text.contains("tri-cubic, SB1 and LR81, f32") && text.contains(">93.0<") && text.contains("97.5"),
            "{text}"
        );
        let none = Row { counters: vec![], ..row };
        assert_eq!(section(&Steinberger::default(), &[scene(none)]), "");
    }
}
