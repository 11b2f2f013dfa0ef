//! The comparison as a table (text, CSV) and as one page that needs no network.

use super::{Comparison, Measured, Row};
use crate::settings::{escape, seconds, short};
use anyhow::Result;
use base64::Engine;
use std::fmt::Write;

const HEAD: [&str; 15] = [
    "method",
    "setting",
    "reconstruction",
    "render",
    "cpu",
    "prepare",
    "missed",
    "false",
    "wrong root",
    "wrong surface",
    "refuted",
    "undecidable",
    "t error p99",
    "t error max",
    "memory",
];

fn cells(row: &Row) -> Result<[String; 15], &str> {
    let m = row.result.as_ref().map_err(String::as_str)?;
    let count = |f: fn(&crate::checking::Check) -> String| m.check.as_ref().map_or_else(|| "-".to_owned(), f);
    Ok([
        row.method.id.to_owned(),
        row.setting.clone(),
        m.reconstruction.clone(),
        seconds(m.render.median),
        seconds(m.cpu.median),
        seconds(m.prepare),
        count(|c| c.missed.to_string()),
        count(|c| c.false_hits.to_string()),
        count(|c| c.wrong_root.to_string()),
        count(|c| c.wrong_surface.to_string()),
        count(|c| c.refuted.to_string()),
        count(|c| c.undecidable.to_string()),
        count(|c| format!("{:.2e}", c.t_error_voxels.p99)),
        count(|c| format!("{:.2e}", c.t_error_voxels.max)),
        megabytes(m.memory.total()),
    ])
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 * 1e-6)
}

/// The table for a terminal; rows without numbers have their reason.
#[must_use]
pub fn table_text(rows: &[Row]) -> String {
    let body: Vec<Result<[String; 15], String>> = rows
        .iter()
        .map(|r| cells(r).map_err(|e| format!("{}  {}  {e}", r.method.id, r.setting)))
        .collect();
    let width = |i: usize| {
        let column = body.iter().filter_map(|r| r.as_ref().ok()).map(|r| r[i].chars().count());
        column.max().unwrap_or(0).max(HEAD[i].chars().count())
    };
    let widths: Vec<usize> = (0..HEAD.len()).map(width).collect();
    let line = |cells: &[String]| {
        let padded: Vec<String> = cells
            .iter()
            .zip(&widths)
            .enumerate()
            .map(|(i, (c, &w))| if i < 3 { format!("{c:<w$}") } else { format!("{c:>w$}") })
            .collect();
        format!("{}\n", padded.join("  ").trim_end())
    };
    let mut out = line(&HEAD.map(str::to_owned));
    for row in &body {
        match row {
            Ok(c) => out.push_str(&line(c)),
            Err(e) => {
                out.push_str(e);
                out.push('\n');
            }
        }
    }
    out
}

/// What the ranking says, in sentences.
#[must_use]
pub fn verdict(c: &Comparison, max_error: Option<f64>) -> Vec<String> {
    let Some(e) = max_error else {
        return vec![
            "No maximum error was given (--max-error E), so nothing is ranked: times at different errors do not compare.".into(),
        ];
    };
    let name = |r: &Row| {
        if r.setting == "default" {
            r.method.id.to_owned()
        } else {
            format!("{} with {}", r.method.id, r.setting)
        }
    };
    let time = |m: &Measured| format!("{} +- {} per image", seconds(m.render.median), seconds(m.render.mad));
    let mut out: Vec<String> = c
        .ranking
        .iter()
        .enumerate()
        .filter_map(|(n, &i)| {
            let m = c.rows[i].result.as_ref().ok()?;
            Some(format!(
                "{}. {}: {} ({} processor time), {} prepared in {}",
                n + 1,
                name(&c.rows[i]),
                time(m),
                seconds(m.cpu.median),
                megabytes(m.memory.total()),
                seconds(m.prepare)
            ))
        })
        .collect();
    let head = if out.is_empty() {
        let closest = c.closest().and_then(|r| Some((r, r.result.as_ref().ok()?.check.as_ref()?)));
        let nearest = closest.map_or_else(String::new, |(r, k)| {
            format!(
                " Closest is {}: {} wrong pixels, error up to {} voxels.",
                name(r),
                crate::checking::wrong(k),
                short(k.t_error_voxels.max)
            )
        });
        format!(
            "No method stays within {} voxels with no wrong pixel here.{nearest}",
            short(e)
        )
    } else {
        format!("Within {} voxels and no wrong pixel, fastest first:", short(e))
    };
    out.insert(0, head);
    out
}

/// The table as CSV: numbers in seconds, voxels, degrees and bytes; `err` has the reason where there are none.
///
/// # Errors
/// Never for rows that are made here.
pub fn table_csv(c: &Comparison) -> Result<String> {
    let mut w = csv::Writer::from_writer(vec![]);
    w.write_record([
        "method",
        "setting",
        "knobs",
        "err",
        "reconstruction",
        "rank",
        "render_median_s",
        "render_mad_s",
        "n",
        "cpu_render_median_s",
        "device_render_median_s",
        "first_render_s",
        "prepare_s",
        "pixels",
        "hits",
        "missed",
        "false",
        "wrong_root",
        "wrong_surface",
        "refuted",
        "undecidable",
        "unclaimed",
        "t_error_voxels_median",
        "t_error_voxels_p99",
        "t_error_voxels_max",
        "normal_error_deg_median",
        "normal_error_deg_p99",
        "normal_error_deg_max",
        "memory_bytes",
    ])?;
    for (i, r) in c.rows.iter().enumerate() {
        let mut record = vec![r.method.id.to_owned(), r.setting.clone(), r.knobs.clone()];
        match &r.result {
            Err(e) => {
                record.push(e.clone());
                record.resize(29, String::new());
            }
            Ok(m) => {
                let rank = c
                    .ranking
                    .iter()
                    .position(|&k| k == i)
                    .map_or(String::new(), |n| (n + 1).to_string());
                record.extend([String::new(), m.reconstruction.clone(), rank]);
                let device = if m.device.n > 0 {
                    m.device.median.to_string()
                } else {
                    String::new()
                };
                record.extend([m.render.median, m.render.mad].map(|v| v.to_string()));
                record.extend([m.render.n.to_string(), m.cpu.median.to_string(), device]);
                record.extend([m.first_render, m.prepare].map(|v| v.to_string()));
                match &m.check {
                    Some(k) => {
                        record.extend(
                            [
                                k.pixels,
                                k.hits,
                                k.missed,
                                k.false_hits,
                                k.wrong_root,
                                k.wrong_surface,
                                k.refuted,
                                k.undecidable,
                                k.unclaimed,
                            ]
                            .map(|v| v.to_string()),
                        );
                        for s in [&k.t_error_voxels, &k.normal_error_deg] {
                            record.extend([s.median, s.p99, s.max].map(|v| v.to_string()));
                        }
                    }
                    None => record.extend(std::iter::repeat_n(String::new(), 15)),
                }
                record.push(m.memory.total().to_string());
            }
        }
        w.write_record(&record)?;
    }
    Ok(String::from_utf8(
        w.into_inner().map_err(|e| anyhow::anyhow!("table.csv: {e}"))?,
    )?)
}

const STYLE: &str = "body{font:15px/1.45 sans-serif;margin:2em auto;max-width:1400px;padding:0 1em;color:#222}table{border-collapse:collapse;\
font-size:13px}th,td{padding:.25em .6em;border-bottom:1px solid #ddd;text-align:right}td{white-space:nowrap}th:nth-child(-n+3),\
td:nth-child(-n+3){text-align:left}.scroll{overflow-x:auto}figure{display:inline-block;margin:0 1em 1em 0;vertical-align:top}\
figure img{max-width:500px;border:1px solid #ccc;image-rendering:pixelated}figcaption{font-size:13px;color:#555}.best{background:#eef6ee}\
code{background:#f3f3f3;padding:.1em .3em;overflow-wrap:anywhere}";

fn picture(png: &[u8], alt: &str) -> String {
    let data = base64::engine::general_purpose::STANDARD.encode(png);
    format!("<img alt=\"{}\" src=\"data:image/png;base64,{data}\">", escape(alt))
}

/// The whole page: verdict, table, curve, pictures and error maps; self-contained.
///
/// # Errors
/// When a picture cannot be encoded.
pub fn page(c: &Comparison, max_error: Option<f64>, scene: &str, command: &[String]) -> Result<String> {
    // Writing to a String cannot fail.
    let mut out = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>isobar compare</title><style>{STYLE}</style></head><body>\n\
         <h1>Isosurface methods side by side</h1>\n<p>{}</p>\n<p>Made by <code>{}</code>, isobar {}.</p>\n",
        escape(scene),
        escape(&command.join(" ")),
        env!("CARGO_PKG_VERSION")
    );
    for line in verdict(c, max_error) {
        let _ = writeln!(out, "<p><strong>{}</strong></p>", escape(&line));
    }
    let _ = writeln!(
        out,
        "<div class=\"scroll\"><table><tr>{}</tr>",
        HEAD.map(|h| format!("<th>{h}</th>")).join("")
    );
    for (i, r) in c.rows.iter().enumerate() {
        let class = if c.ranking.first() == Some(&i) {
            " class=\"best\""
        } else {
            ""
        };
        let _ = match cells(r) {
            Ok(cells) => writeln!(
                out,
                "<tr{class}>{}</tr>",
                cells.map(|v| format!("<td>{}</td>", escape(&v))).join("")
            ),
            Err(e) => writeln!(
                out,
                "<tr><td>{}</td><td>{}</td><td colspan=\"13\">{}</td></tr>",
                escape(r.method.id),
                escape(&r.setting),
                escape(e)
            ),
        };
    }
    out.push_str(
        "</table></div>\n<p>Times are medians of interleaved renderings, wall clock; cpu is processor time summed over threads; prepare is opening the \
         renderer and giving it data, surfaces, view and settings. Errors of t are in voxels, against the certified first root of the function each method \
         really draws. Undecidable pixels are the oracle's own verdict and count as neither right nor wrong.</p>\n",
    );
    let curve = super::curve(&c.rows);
    if !curve.is_empty() {
        let _ = writeln!(
            out,
            "<h2>Time against error</h2>\n{curve}\n<p>Hollow: some pixels are wrong.</p>"
        );
    }
    let scale = picture(&crate::output::encode_png(&super::error_scale())?, "colour scale");
    let _ = writeln!(
        out,
        "<h2>Pictures and error maps</h2>\n<p>{scale} error of t: 1e-6 voxels and less (left) to 1 voxel (right), logarithmic; {}</p>",
        escape(crate::checking::LEGEND)
    );
    for i in c.shown() {
        let row = &c.rows[i];
        let title = format!("{} ({})", row.method.id, row.setting);
        match &row.result {
            Err(e) => {
                let _ = writeln!(out, "<h3>{}</h3><p>{}</p>", escape(&title), escape(e));
            }
            Ok(m) => {
                let _ = writeln!(out, "<h3>{}</h3>\n<p><code>{}</code></p>", escape(&title), escape(&row.knobs));
                let _ = writeln!(
                    out,
                    "<figure>{}<figcaption>image</figcaption></figure>",
                    picture(&m.pictures.image, "image")
                );
                if !m.pictures.errors.is_empty() {
                    let _ = writeln!(
                        out,
                        "<figure>{}<figcaption>error map</figcaption></figure>",
                        picture(&m.pictures.errors, "error map")
                    );
                }
            }
        }
    }
    out.push_str("</body></html>\n");
    Ok(out)
}
