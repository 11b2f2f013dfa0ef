//! The matrix of hard cases.

use super::html::escape;
use crate::results::{Matrix, MatrixTable, VerdictKind};
use std::fmt::Write;

pub(super) fn matrix(m: &Matrix) -> String {
    let mut out = String::from(
        "<h2 id=\"cases\">Hard cases</h2>\n<p>Small inputs with exact answers, each known to break some method: double roots, roots glued to \
         a face, offsets that swallow the signal, cells whose corners all have one sign. Each cell says what the column made of the \
         case, with the value it gave. <i>Refused</i> is an honest answer; a <i>known failure</i> is declared in the case file with its \
         reason, and turns red when it starts to pass.</p>\n",
    );
    for t in &m.tables {
        out.push_str(&table(t));
    }
    out
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
    for c in &t.columns {
        let _ = write!(out, "<th style=\"text-align:center\">{}</th>", escape(c));
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
            let _ = write!(
                out,
                "<td class=\"v {}\"><b>{}</b><small>{}</small></td>",
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
