//! The matrix of hard cases.

use super::html::{Cell, escape};
use crate::results::{Elsewhere, Matrix, MatrixTable, VerdictKind};
use std::fmt::Write;

pub(super) fn matrix(m: &Matrix) -> String {
    let mut out = String::from(
        "<h2 id=\"cases\">Hard cases</h2>\n<p>Small inputs with exact answers, each known to break some method: double roots, roots glued to \
         a face, offsets that swallow the signal, cells whose corners all have one sign. Each cell says what the column made of the \
         case, with the value it gave. <i>Refused</i> is an honest answer; a <i>known failure</i> is declared in the case file with its \
         reason, and turns red when it starts to pass. Under each method stands what its hits must keep: a method that proves its answers must be within \
         the case's own tolerance, without a refuted claim; a ruler within what its setting allows. Where the certified answer for the function that a column \
         draws is not that of the row, it stands under the value given. Table: <a href=\"csv/hard-cases.csv\">hard-cases.csv</a>.</p>\n",
    );
    for t in &m.tables {
        out.push_str(&table(t));
    }
    out.push_str(&elsewhere(&m.elsewhere));
    out
}

/// Cases that are no rows.
fn elsewhere(all: &[Elsewhere]) -> String {
    if all.is_empty() {
        return String::new();
    }
    let rows: Vec<_> = (all.iter())
        .map(|e| {
            let tests: Vec<String> = e.tests.iter().map(|t| format!("<code>{}</code>", escape(t))).collect();
            let case = format!(
                "<b>{}</b> {}<small>{} ({})</small>",
                escape(&e.id),
                escape(&e.title),
                escape(&e.trap),
                escape(&e.source)
            );
            let cells = vec![
                Cell::with("text wrap", case),
                Cell::with("text wrap", escape(&e.why)),
                Cell::with("text wrap", tests.join("<br>")),
            ];
            ("", cells)
        })
        .collect();
    format!(
        "<h3>Cases that are no row</h3>\n{}",
        super::html::table(&[("text", "case"), ("text", "why"), ("text", "tested in")], &rows)
    )
}

fn class(k: VerdictKind) -> &'static str {
    match k {
        VerdictKind::Right => "v-right",
        VerdictKind::Wrong => "v-wrong",
        VerdictKind::Refused => "v-refused",
        VerdictKind::Known => "v-known",
        VerdictKind::Unexpected => "v-unexpected",
    }
}

fn table(t: &MatrixTable) -> String {
    let mut out = String::new();
    let total = |k| t.rows.iter().flat_map(|r| &r.cells).filter(|c| c.kind == k).count();
    let _ = writeln!(
        out,
        "<h3>{}</h3>\n<p class=\"meta\">{} cases: {} right, {} wrong, {} refused, {} known failures.</p>",
        escape(&t.title),
        t.rows.len(),
        total(VerdictKind::Right),
        total(VerdictKind::Wrong) + total(VerdictKind::Unexpected),
        total(VerdictKind::Refused),
        total(VerdictKind::Known)
    );
    out.push_str("<div class=\"scroll\"><table><thead><tr><th class=\"text\">case</th><th class=\"text\">expected</th>");
    for (i, c) in t.columns.iter().enumerate() {
        let bar = t
            .bars
            .get(i)
            .map_or_else(String::new, |b| format!("<small>{}</small>", escape(b)));
        let _ = write!(out, "<th class=\"wrap\" style=\"text-align:center\">{}{bar}</th>", escape(c));
    }
    out.push_str("</tr></thead><tbody>\n");
    for r in &t.rows {
        let _ = write!(
            out,
            "<tr><td class=\"text wrap\"><b>{}</b> {}<small>{} ({})</small></td><td class=\"text wrap\">{}</td>",
            escape(&r.id),
            escape(&r.title),
            escape(&r.trap),
            escape(&r.source),
            escape(&r.expected)
        );
        for c in &r.cells {
            let certified = if c.expected.is_empty() || c.expected == c.given {
                String::new()
            } else {
                format!("<small>certified: {}</small>", escape(&c.expected))
            };
            let _ = write!(
                out,
                "<td class=\"v {}\"><b>{}</b><small>{}</small>{certified}</td>",
                class(c.kind),
                c.kind.word(),
                escape(&c.given)
            );
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</tbody></table></div>\n");
    out
}
