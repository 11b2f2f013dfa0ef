//! `isobar info`: what a data file holds.

use crate::cli::{Answer, InfoArgs};
use crate::settings::{finite, pretty, short};
use crate::source::{Source, Summary, suggested_isovalues};
use anyhow::Result;
use isobar_core::{DVec3, Data};
use isobar_nurbs::Orientations;
use serde_json::{Value, json};
use std::fmt::Write;

/// Describes the data.
///
/// # Errors
/// When they cannot be read.
pub fn run(args: &InfoArgs) -> Result<Answer> {
    let (source, _) = super::open(&args.data)?;
    let summary = source.summary();
    let text = if args.json {
        pretty(&to_json(&source, &summary))
    } else {
        to_text(&source, &summary)
    };
    Ok(Answer {
        text,
        warnings: source.notes,
        no: false,
    })
}

/// Everything `info` tells, as JSON.
#[must_use]
pub fn to_json(source: &Source, summary: &Summary) -> Value {
    let (lo, hi) = source.bounds();
    let mut out = json!({
        "data": source.name,
        "kind": source.data.kind(),
        "cells": source.cells(),
        "type": source.type_name(),
        "bounds": {"min": lo.to_array(), "max": hi.to_array()},
        "field": source.field,
        "fields": source.fields,
        "values": summary.count,
        "nan": summary.nan,
        "range": summary.range.map(|(a, b)| [finite(a), finite(b)]),
        "histogram": summary.histogram,
        "suggested_isovalues": suggested_isovalues(source, summary),
        "bytes": source.data.bytes(),
        "sha256": source.hash(),
        "notes": source.notes,
    });
    match &*source.data {
        Data::Grid(g) => {
            out["dims"] = json!(g.dims);
            out["spacing"] = json!(g.spacing.to_array());
            out["origin"] = json!(g.origin.to_array());
            out["direction"] = json!(g.direction.to_cols_array_2d());
        }
        Data::Tets(m) => out["points"] = json!(m.points.len()),
        Data::Hexes(h) => {
            let n = Orientations::of(h);
            out["orientation"] = json!({"right": n.right, "left": n.left, "vanishing": n.vanishing, "folded": n.folded});
        }
        Data::Algebraic(a) => out["degree"] = json!(a.degree()),
        _ => {}
    }
    out
}

fn triple(v: DVec3) -> String {
    v.to_array().map(short).join(" ")
}

fn to_text(source: &Source, summary: &Summary) -> String {
    let mut out = String::new();
    let mut row = |name: &str, value: &str| {
        // Writing to a String cannot fail.
        let _ = writeln!(out, "{name:<12} {value}");
    };
    row("data", &source.name);
    row("kind", source.data.kind());
    match &*source.data {
        Data::Grid(g) => {
            let [x, y, z] = g.dims;
            row("dims", &format!("{x} x {y} x {z} samples, {} cells", source.cells()));
            row("type", source.type_name());
            row("spacing", &triple(g.spacing));
            row("origin", &triple(g.origin));
            for (name, axis) in ["direction x", "direction y", "direction z"].iter().zip([
                g.direction.x_axis,
                g.direction.y_axis,
                g.direction.z_axis,
            ]) {
                row(name, &triple(axis));
            }
        }
        Data::Tets(m) => {
            row("cells", &format!("{} tetrahedra, {} points", m.cells.len(), m.points.len()));
            row("type", source.type_name());
        }
        Data::Hexes(h) => {
            row("cells", &format!("{} elements", h.elements.len()));
            let n = Orientations::of(h);
            let counts = [
                (n.right, "right-handed"),
                (n.left, "left-handed"),
                (n.vanishing, "with a vanishing Jacobian determinant"),
                (n.folded, "folded"),
            ];
            let some = counts.iter().filter(|(n, _)| *n > 0);
            let words: Vec<String> = some.map(|(n, what)| format!("{n} {what}")).collect();
            row("orientation", &words.join(", "));
        }
        Data::Algebraic(a) => row("polynomial", &format!("{} terms, degree {}", a.terms.len(), a.degree())),
        _ => {}
    }
    let (lo, hi) = source.bounds();
    row("bounds", &format!("{} to {}", triple(lo), triple(hi)));
    row("memory", &format!("{} bytes", source.data.bytes()));
    row("field", &source.field);
    if source.fields.len() > 1 {
        row("fields", &source.fields.join(", "));
    }
    let range = summary
        .range
        .map_or("no finite value".to_owned(), |(a, b)| format!("{} to {}", short(a), short(b)));
    row("range", &range);
    row("NaN or inf", &format!("{} of {}", summary.nan, summary.count));
    let isovalues: Vec<_> = suggested_isovalues(source, summary).into_iter().map(short).collect();
    row(
        "isovalues",
        &if isovalues.is_empty() {
            "none to suggest".to_owned()
        } else {
            format!("try {}", isovalues.join(", "))
        },
    );
    if let Some(h) = &summary.histogram {
        row("histogram", "(lengths logarithmic)");
        out.push_str(&h.bars());
    }
    out
}
