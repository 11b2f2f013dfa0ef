//! The section of one definition.

use super::html::{Cell, anchor, bytes, count, escape, figure, image, ms, number, paragraphs, table};
use super::swatch;
use crate::plots::{self, Against};
use crate::results::{Apart, Comparison, MODELS, Pictures, Row, Scene, Stat};
use anyhow::Result;
use std::fmt::Write;

pub(super) fn scene(s: &Scene, methods: &[String]) -> Result<String> {
    let mut out = String::new();
    let values: Vec<String> = s.isovalues.iter().map(f64::to_string).collect();
    let mut shown = Vec::new();
    if !values.is_empty() {
        shown.push(format!("isovalue {}", values.join(", ")));
    }
    if let Some(m) = &s.medium {
        shown.push(format!("medium <code>{}</code>", escape(m)));
    }
    let _ = writeln!(out, "<h3 id=\"{}\">{}</h3>", anchor(&s.id), escape(&s.title));
    let _ = writeln!(
        out,
        "<p class=\"meta\">{} · {} · view {} · {} × {} pixels · definition <code>{}/{}.toml</code></p>",
        escape(&s.data),
        shown.join(" · "),
        escape(&s.view),
        s.size[0],
        s.size[1],
        escape(&s.group),
        escape(&s.id)
    );
    out.push_str(&paragraphs(&s.analysis));
    for c in &s.comparisons {
        out.push_str(&comparison(s, c, methods)?);
    }
    Ok(out)
}

fn comparison(s: &Scene, c: &Comparison, methods: &[String]) -> Result<String> {
    let mut out = String::new();
    let t = &c.truth;
    let _ = writeln!(out, "<h4>Reconstruction: {}</h4>", escape(&c.reconstruction));
    let expected = match t.expected {
        Some(e) if e == t.hits => ", as the definition demands".to_owned(),
        Some(e) => format!(", <span class=\"bad\">not the {} the definition demands</span>", count(e)),
        None => String::new(),
    };
    let _ = writeln!(
        out,
        "<p class=\"meta\">Truth: {} of {} pixels hit{expected}; {} undecidable; decided in f64 {}, double-double {}, exact {}.</p>",
        count(t.hits),
        count(t.pixels),
        count(t.undecidable),
        count(t.stages[0]),
        count(t.stages[1]),
        count(t.stages[2])
    );
    for r in &c.remarks {
        let _ = writeln!(out, "<p class=\"note\">{}.</p>", escape(r));
    }
    if !c.pictures.is_empty() {
        for p in &c.pictures {
            out.push_str(&pictures(s, p, methods));
        }
        if c.pictures.iter().any(|p| !p.error.is_empty()) {
            out.push_str(LEGEND);
        }
    }
    let names: Vec<String> = (methods.iter().enumerate())
        .filter(|(_, m)| c.rows.iter().any(|r| r.method == **m && r.reason.is_none()))
        .map(|(i, m)| format!("{}{}", swatch(i), escape(m)))
        .collect();
    for against in [Against::Roots, Against::Peaks, Against::Integral] {
        let Some(chart) = plots::time_against_error(&c.rows, methods, against)? else {
            continue;
        };
        let hollow = match against {
            Against::Roots => " Hollow: the frame has missed, false or wrong hits, which the error of right hits does not show.",
            Against::Peaks => " Hollow: the frame has missed, false or wrong hits.",
            Against::Integral => "",
        };
        let names = names.join(" &nbsp; ");
        let caption = format!("{names}. Each point is one setting of the knob that is swept; lower left is better.{hollow}");
        out.push_str(&figure(&chart, &caption));
    }
    out.push_str(&colours(c, methods));
    out.push_str(&rows(c, methods));
    out.push_str(&storage(c));
    out.push_str(&models(c, methods));
    out.push_str(&peaks(c, methods));
    Ok(out)
}

/// What the colours of the error maps mean: those of `isobar::checking::picture`.
const LEGEND: &str = "<p class=\"legend\">Error map: distance of right hits from the certified root, 10<sup>-6</sup> voxel or less <span \
                      class=\"bar heat\"></span> 1 voxel, logarithmic; <span class=\"swatch\" style=\"background:#f0f\"></span>missed <span \
                      class=\"swatch\" style=\"background:#f00\"></span>false <span class=\"swatch\" \
                      style=\"background:#ff8c00\"></span>wrong root <span class=\"swatch\" style=\"background:#00dcff\"></span>wrong surface \
                      <span class=\"swatch\" style=\"background:#000\"></span>refuted claim <span class=\"swatch\" \
                      style=\"background:#969696\"></span>undecidable; white: no root, no hit.</p>\n";

fn pictures(s: &Scene, p: &Pictures, methods: &[String]) -> String {
    let colour = swatch(methods.iter().position(|m| *m == p.method).unwrap_or(0));
    let name = format!("{colour}<b>{}</b> {}", escape(&p.method), escape(&p.setting));
    let mut out = String::from("<div class=\"pictures\">");
    out.push_str(&figure(
        &image(&p.image, &format!("{} drawn by {}", s.title, p.method), s.size),
        &format!("{name}: the picture"),
    ));
    if !p.error.is_empty() {
        let map = image(&p.error, &format!("error map of {}", p.method), s.size);
        out.push_str(&figure(&map, "Error of every pixel"));
    }
    if !p.work.is_empty() {
        let caption = format!(
            "Work per pixel: 0 <span class=\"bar heat\"></span> {} {}",
            number(p.work_most),
            escape(&p.work_unit)
        );
        out.push_str(&figure(&image(&p.work, &format!("work of {}", p.method), s.size), &caption));
    }
    out.push_str("</div>\n");
    out
}

fn rows(c: &Comparison, methods: &[String]) -> String {
    let head = [
        ("text", "method"),
        ("text", "setting"),
        ("", "frame<small>ms, ± MAD</small>"),
        ("", "CPU<small>ms</small>"),
        ("", "missed"),
        ("", "false"),
        ("", "wrong<small>root</small>"),
        ("", "wrong<small>surface</small>"),
        ("", "refuted"),
        ("", "undecid-<small>able</small>"),
        ("", "un-<small>proved</small>"),
        ("", "error, voxels<small>median</small>"),
        ("", "<small>99 %</small>"),
        ("", "<small>max</small>"),
        ("", "normal, °<small>99 %</small>"),
        ("", "memory"),
        ("", "work<small>per pixel</small>"),
    ];
    let body: Vec<_> = c
        .rows
        .iter()
        .map(|r| (if r.default { "default" } else { "" }, row(r, methods)))
        .collect();
    table(&head, &body)
        + "<p class=\"note\">Tinted: the default setting. Unproved: pixels without a claim that the oracle can refute. \
           Memory: what the renderer holds beyond the data and the frame.</p>\n"
}

fn row(r: &Row, methods: &[String]) -> Vec<Cell> {
    let i = methods.iter().position(|m| *m == r.method).unwrap_or(0);
    let mut cells = vec![
        Cell::with("text", format!("{}{}", swatch(i), escape(&r.method))),
        Cell::with("text wrap", escape(&r.setting)),
    ];
    if let Some(reason) = &r.reason {
        cells.push(Cell::with("reason", escape(reason)));
        return cells;
    }
    let k = &r.checked;
    let surfaces = r.colour.is_none_or(|c| c.surfaces);
    let device = r
        .device
        .map_or_else(String::new, |d| format!("<small>device {}</small>", ms(d.median)));
    cells.push(Cell::new(format!("{}{device}", spread(&r.wall))));
    cells.push(Cell::new(ms(r.cpu.median)));
    for n in [k.missed, k.false_hits, k.wrong_root, k.wrong_surface, k.refuted] {
        cells.push(if surfaces {
            Cell::count(n, true)
        } else {
            // A setting that draws no surfaces cannot miss any.
            Cell::with("zero", "–")
        });
    }
    cells.push(Cell::count(k.undecidable, false));
    cells.push(if k.unclaimed == k.pixels {
        Cell::with("zero", "all")
    } else {
        Cell::count(k.unclaimed, false)
    });
    for x in [k.t_voxels.median, k.t_voxels.p99, k.t_voxels.max, k.normal_deg.p99] {
        cells.push(if k.right() > 0 {
            Cell::new(number(x))
        } else {
            Cell::with("zero", "–")
        });
    }
    cells.push(Cell::new(bytes(r.memory.iter().sum())));
    let work = if r.work_unit.is_empty() {
        String::new()
    } else {
        format!(
            "{}<small>{}</small>",
            number(r.work as f64 / k.pixels.max(1) as f64),
            escape(&r.work_unit)
        )
    };
    cells.push(Cell::new(work));
    cells
}

/// Colours against the exact ones, where there is a medium.
fn colours(c: &Comparison, methods: &[String]) -> String {
    let peaks = c.rows.iter().any(|r| r.colour.is_some_and(|k| k.peaks.is_some()));
    let body: Vec<_> = (c.rows.iter())
        .filter_map(|r| {
            let k = r.colour?;
            let i = methods.iter().position(|m| *m == r.method).unwrap_or(0);
            let mut cells = vec![
                Cell::with("text", format!("{}{}", swatch(i), escape(&r.method))),
                Cell::with("text wrap", escape(&r.setting)),
                Cell::new(ms(r.wall.median)),
            ];
            cells.push(apart(&k.integral));
            if peaks {
                cells.extend([k.peaks, k.bias].map(|d| d.map_or_else(|| Cell::new(""), |d| apart(&d))));
            }
            Some((if r.default { "default" } else { "" }, cells))
        })
        .collect();
    if body.is_empty() {
        return String::new();
    }
    let mut head = vec![
        ("text", "method"),
        ("text", "setting"),
        ("", "frame<small>ms</small>"),
        ("wrap", "against the integral"),
    ];
    if peaks {
        head.push(("wrap", "against peaks and the integral between"));
        head.push(("wrap", "bias<small>of drawing peaks: of the two exact images</small>"));
    }
    let bounds: Option<Vec<f64>> = c.rows.iter().filter_map(|r| r.colour).map(|k| k.bound).collect();
    let proved = bounds.map_or_else(
        || "not proved everywhere: where f64 cannot hold the integral there is no bound".to_owned(),
        |b| format!("proved to {}, shading apart", number(b.into_iter().fold(0.0, f64::max))),
    );
    table(&head, &body)
        + &format!(
            "<p class=\"note\">Differences of linear premultiplied colour and opacity: 99th percentile over pixels of the greatest difference of a channel; \
             below it the greatest, pixels off by more than 1/255, and peak signal-to-noise ratio. The exact colours are {proved}.</p>\n"
        )
}

fn apart(d: &Apart) -> Cell {
    let (Some(p99), Some(max)) = (d.p99, d.max) else {
        return Cell::with("reason", "colours that are no numbers");
    };
    let psnr = d.psnr.map_or_else(|| "equal".to_owned(), |p| format!("{p:.1} dB"));
    Cell::new(format!(
        "{}<small>max {}, visible {}, {psnr}</small>",
        number(p99),
        number(max),
        count(d.visible)
    ))
}

/// Median and median absolute deviation, milliseconds; of one time there is no deviation.
fn spread(s: &Stat) -> String {
    if s.n > 1 {
        format!("{} ± {}", ms(s.median), ms(s.mad))
    } else {
        format!("{} (once)", ms(s.median))
    }
}

/// How far storing the coefficients moves the surface: a line for each answer, with the methods that give it.
fn storage(c: &Comparison) -> String {
    let mut answers: Vec<(String, Vec<&str>)> = Vec::new();
    for r in c
        .rows
        .iter()
        .filter(|r| r.default && r.reason.is_none() && r.colour.is_none())
    {
        let told = match &r.storage {
            None => "not told".to_owned(),
            Some(s) if s.same => "none, the function drawn is that of coefficients in f64".to_owned(),
            Some(s) => {
                let [median, p99, max] = [s.voxels.median, s.voxels.p99, s.voxels.max].map(number);
                let changed = if s.changed > 0 {
                    format!("; {} pixels hit another root or none", count(s.changed))
                } else {
                    String::new()
                };
                format!("median {median}, 99 % {p99}, greatest {max} voxel{changed}")
            }
        };
        match answers.iter_mut().find(|(t, _)| *t == told) {
            Some((_, names)) => names.push(&r.method),
            None => answers.push((told, vec![&r.method])),
        }
    }
    let Some(lines) = answers
        .into_iter()
        .map(|(told, names)| format!("{}: {told}", names.join(", ")))
        .reduce(|a, b| a + ". " + &b)
    else {
        return String::new();
    };
    format!(
        "<p class=\"note\">Storage error, how far the certified root of the function drawn lies from that of the same with coefficients in f64. {}.</p>\n",
        escape(&lines)
    )
}

/// Memory of a process of its own, where it was measured.
fn peaks(c: &Comparison, methods: &[String]) -> String {
    let body: Vec<_> = (c.rows.iter())
        .filter_map(|r| {
            let p = r.peak?;
            let i = methods.iter().position(|m| *m == r.method).unwrap_or(0);
            let name = Cell::with("text", format!("{}{}", swatch(i), escape(&r.method)));
            let mut cells = vec![name];
            cells.extend([p.process, p.loaded, p.drawn, p.data, p.frame].map(|n| Cell::new(bytes(n))));
            cells.push(Cell::new(number(p.ratio())));
            Some(("", cells))
        })
        .collect();
    if body.is_empty() {
        return String::new();
    }
    let head = [
        ("text", "process memory"),
        ("wrap", "greatest resident size"),
        ("wrap", "until the data were there"),
        ("wrap", "from then on"),
        ("", "data"),
        ("", "frame"),
        ("wrap", "from then on, over data and frame"),
    ];
    format!(
        "<p class=\"note\">A process of its own for each method: it makes or reads the data, draws one image at the default setting and copies it out. \
         Data of 64 MiB and more only; smaller ones drown in what any process holds.</p>\n{}",
        table(&head, &body)
    )
}

/// The time models: one row per method, one column per model.
fn models(c: &Comparison, methods: &[String]) -> String {
    if c.models.is_empty() {
        return String::new();
    }
    let titles: Vec<String> = MODELS
        .iter()
        .map(|(m, about)| format!("{m}<small>{}</small>", escape(about)))
        .collect();
    let mut head = vec![("text", "ms, wall clock")];
    head.extend(titles.iter().map(|t| ("wrap", t.as_str())));
    let mut names: Vec<&str> = c.models.iter().map(|m| m.method.as_str()).collect();
    names.dedup();
    let body: Vec<_> = (names.iter())
        .map(|name| {
            let i = methods.iter().position(|m| m == name).unwrap_or(0);
            let mut cells = vec![Cell::with("text", format!("{}{}", swatch(i), escape(name)))];
            for (model, _) in MODELS {
                let found = c.models.iter().find(|m| m.method == *name && m.model == model);
                cells.push(match found {
                    Some(m) if m.reason.is_some() => Cell::with("reason", escape(m.reason.as_deref().unwrap_or_default())),
                    Some(m) => Cell::new(format!(
                        "{}<small>CPU {}</small><small>{}</small>",
                        spread(&m.wall),
                        ms(m.cpu.median),
                        escape(&m.verified)
                    )),
                    None => Cell::new(""),
                });
            }
            ("", cells)
        })
        .collect();
    format!(
        "<p class=\"note\">Time models at the default setting; they are different questions and are never ranked together.</p>\n{}",
        table(&head, &body)
    )
}

/// Time against resolution over the definitions of a sweep, at default settings and the first reconstruction.
pub(super) fn growth(scenes: &[&Scene], methods: &[String]) -> Result<String> {
    let series: Vec<(usize, Vec<(f64, f64)>)> = (methods.iter().enumerate())
        .map(|(i, m)| {
            let mut points: Vec<(f64, f64)> = (scenes.iter())
                .filter_map(|s| {
                    let n = s.data.split(['×', ' ']).next()?.parse::<f64>().ok()?;
                    let row = s
                        .comparisons
                        .first()?
                        .rows
                        .iter()
                        .find(|r| r.method == *m && r.default && r.reason.is_none())?;
                    Some((n, row.wall.median * 1e3))
                })
                .collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            (i, points)
        })
        .filter(|(_, p)| !p.is_empty())
        .collect();
    let Some(chart) = plots::growth(&series)? else {
        return Ok(String::new());
    };
    let names: Vec<String> = series
        .iter()
        .map(|(i, _)| format!("{}{}", swatch(*i), escape(&methods[*i])))
        .collect();
    Ok(figure(
        &chart,
        &format!("{}. Time of one frame at the default setting.", names.join(" &nbsp; ")),
    ))
}
