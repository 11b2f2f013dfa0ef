//! The first screen: which method wins where, at equal error.

use super::html::{Cell, anchor, escape, figure, image, ms, table};
use super::swatch;
use crate::results::{Comparison, Report, Row, Scene, TARGETS, fastest};
use std::fmt::Write;

/// Scenes and comparisons that have numbers.
fn comparisons(r: &Report) -> impl Iterator<Item = (&Scene, &Comparison)> {
    r.scenes
        .iter()
        // Media are compared by colour: their sections say so.
        .filter(|s| s.group != "hard" && s.medium.is_none())
        .flat_map(|s| s.comparisons.iter().map(move |c| (s, c)))
}

/// Whether more than one method drew it.
fn has_rivals(c: &Comparison) -> bool {
    let mut drawn = c.rows.iter().filter(|r| r.reason.is_none()).map(|r| &r.method);
    let first = drawn.next();
    drawn.any(|m| Some(m) != first)
}

pub(super) fn summary(r: &Report, methods: &[String]) -> String {
    let mut out = String::from("<h2 id=\"summary\">In short</h2>\n");
    if comparisons(r).next().is_none() {
        out.push_str("<p>No scene was measured; the reasons stand below.</p>\n");
        return out;
    }
    out.push_str("<p>Methods are compared at equal error, never at equal settings: for each target, the fastest setting of the knob sweep that keeps it. Times are wall clock, of one frame.</p>\n<ul>\n");
    let total = comparisons(r).filter(|(_, c)| has_rivals(c)).count();
    for t in TARGETS.iter().filter(|_| total > 0) {
        let winners: Vec<&Row> = comparisons(r)
            .filter(|(_, c)| has_rivals(c))
            .filter_map(|(_, c)| fastest(&c.rows, t))
            .collect();
        let mut parts: Vec<String> = (methods.iter())
            .filter_map(|m| {
                let n = winners.iter().filter(|w| w.method == *m).count();
                (n > 0).then(|| format!("<b>{}</b> is fastest in {n}", escape(m)))
            })
            .collect();
        let nobody = total - winners.len();
        if nobody > 0 {
            parts.push(format!("no method gets there in {nobody}"));
        }
        let _ = writeln!(
            out,
            "<li>{}: of {total} comparisons, {}.</li>",
            capital(t.title),
            parts.join(", ")
        );
    }
    let single = comparisons(r).count() - total;
    if single > 0 {
        let _ = writeln!(
            out,
            "<li>{single} more have a single method: nothing to be faster than, so they are not counted here.</li>"
        );
    }
    out.push_str("</ul>\n");
    out.push_str(&winners(r, methods));
    out.push_str(&gallery(r));
    out.push_str(&trouble(r));
    out
}

fn capital(s: &str) -> String {
    let mut c = s.chars();
    c.next()
        .map_or_else(String::new, |f| f.to_uppercase().collect::<String>() + c.as_str())
}

/// The table of winners.
fn winners(r: &Report, methods: &[String]) -> String {
    let mut head = vec![("text", "scene, reconstruction".to_owned())];
    head.extend(TARGETS.iter().map(|t| ("text wrap", capital(t.title))));
    head.push(("text wrap", "Fewest wrong pixels of all settings".to_owned()));
    let colour = |m: &str| swatch(methods.iter().position(|x| x == m).unwrap_or(0));
    let name = |row: &Row| {
        format!(
            "{}{}<small>{}, {} ms</small>",
            colour(&row.method),
            escape(&row.method),
            escape(&row.setting),
            ms(row.wall.median)
        )
    };
    let rows: Vec<_> = comparisons(r)
        .map(|(s, c)| {
            let title = format!(
                "<a href=\"#{}\">{}</a><small>{}{}</small>",
                anchor(&s.id),
                escape(&s.title),
                escape(&c.reconstruction),
                if has_rivals(c) { "" } else { ", one method only" },
            );
            let mut cells = vec![Cell::with("text", title)];
            for t in &TARGETS {
                cells.push(match fastest(&c.rows, t) {
                    Some(row) => Cell::with("text", name(row)),
                    None => Cell::with("text zero", "none"),
                });
            }
            let fewest = (c.rows.iter().filter(|r| r.reason.is_none())).min_by(|a, b| {
                let wall = a.wall.median.total_cmp(&b.wall.median);
                a.checked.wrong().cmp(&b.checked.wrong()).then(wall)
            });
            cells.push(fewest.map_or_else(
                || Cell::with("text zero", "none"),
                |row| {
                    let n = super::html::count(row.checked.wrong());
                    Cell::with(
                        "text",
                        format!(
                            "{n} of {}<small>{}, {}</small>",
                            super::html::count(row.checked.pixels),
                            escape(&row.method),
                            escape(&row.setting)
                        ),
                    )
                },
            ));
            ("", cells)
        })
        .collect();
    let head: Vec<(&str, &str)> = head.iter().map(|(c, t)| (*c, t.as_str())).collect();
    table(&head, &rows)
}

/// A picture of every scene.
fn gallery(r: &Report) -> String {
    let mut out = String::from("<div class=\"gallery\">\n");
    for s in r.scenes.iter().filter(|s| s.group == "curated") {
        let Some(p) = s.comparisons.first().and_then(|c| c.pictures.first()) else {
            continue;
        };
        let caption = format!("<a href=\"#{}\">{}</a>, {}", anchor(&s.id), escape(&s.title), escape(&s.data));
        out.push_str(&figure(&image(&p.image, &s.title, s.size), &caption));
    }
    out.push_str("</div>\n");
    out
}

/// What was not as its definition says, and wrong verdicts.
fn trouble(r: &Report) -> String {
    let lines = r.trouble();
    if lines.is_empty() {
        return "<p>Every count is as its definition says, and no case is wrong that is not declared.</p>\n".into();
    }
    let list = lines.iter().fold(String::new(), |mut out, l| {
        let _ = writeln!(out, "<li>{}</li>", escape(l));
        out
    });
    format!("<div class=\"failures\"><p><b>Not as the definitions and cases say:</b></p><ul>\n{list}</ul></div>\n")
}
