//! The page: one HTML file that opens without a network, beside its pictures and tables.

mod figures;
mod html;
mod matrix;
mod scene;
mod stages;
mod steinberger;
mod summary;

use crate::plots;
use crate::results::{Bench, Convergence, Report};
use anyhow::Result;
pub(crate) use html::bytes;
use html::{Cell, anchor, escape, figure, number, table};
use std::fmt::Write;

const STYLE: &str = include_str!("page.css");

/// Titles of the groups of definitions.
const GROUPS: [(&str, &str, &str); 4] = [
    (
        "curated",
        "Scenes",
        "The public picture: scans, simulations and fields that are known in the literature.",
    ),
    (
        "sweep",
        "Growth with size",
        "One field at several resolutions, the same image.",
    ),
    (
        "hard",
        "Hard scenes",
        "Isovalues equal to data values: the surface passes exactly through lattice points, along edges and faces, and has plateaus where neighbours \
         share the value.",
    ),
    (
        "imported",
        "Scenes of papers",
        "Scenes of the papers the methods come from, with their published numbers beside ours.",
    ),
];

/// The whole page.
///
/// # Errors
/// When a chart cannot be drawn.
pub fn page(r: &Report) -> Result<String> {
    let methods = methods(r);
    let mut out = String::new();
    let _ = write!(
        out,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width, \
         initial-scale=1\">\n<title>isobar report</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n"
    );
    out.push_str(&header(r, &methods));
    out.push_str("<main>\n");
    out.push_str(&summary::summary(r, &methods));
    for (group, title, about) in GROUPS {
        let scenes: Vec<_> = r.scenes.iter().filter(|s| s.group == group).collect();
        if scenes.is_empty() {
            continue;
        }
        let _ = writeln!(out, "<h2 id=\"{group}\">{title}</h2>\n<p>{}</p>", escape(about));
        if group == "sweep" {
            out.push_str(&scene::growth(&scenes, &methods)?);
        }
        for s in scenes.iter().filter(|s| s.skipped.is_none()) {
            out.push_str(&scene::scene(s, &methods)?);
        }
        out.push_str(&skipped(&scenes));
    }
    out.push_str(&steinberger::section(&r.steinberger));
    out.push_str(&stages::section(&r.steinberger, &r.scenes));
    out.push_str(&figures::section(&r.steinberger.figures, &r.steinberger.levels)?);
    out.push_str(&matrix::matrix(&r.hard));
    out.push_str(&convergence(&r.convergence)?);
    out.push_str(&benches(&r.benches));
    out.push_str(&method_of_measuring(r));
    out.push_str("</main>\n</body>\n</html>\n");
    Ok(out)
}

/// Ids of all methods with a row, in order of first appearance: the order of colours.
fn methods(r: &Report) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for row in r.scenes.iter().flat_map(|s| &s.comparisons).flat_map(|c| &c.rows) {
        if !all.contains(&row.method) {
            all.push(row.method.clone());
        }
    }
    all
}

fn header(r: &Report, methods: &[String]) -> String {
    let measured = r.scenes.iter().filter(|s| s.skipped.is_none()).count();
    let pixels: u64 = (r.scenes.iter().flat_map(|s| &s.comparisons))
        .map(|c| c.truth.pixels * c.rows.iter().filter(|r| r.reason.is_none()).count() as u64)
        .sum();
    let cpu = r
        .machine
        .iter()
        .find(|(k, _)| k == "processor")
        .map_or("", |(_, v)| v.as_str());
    format!(
        "<header class=\"top\">\n<h1>isobar report</h1>\n<p class=\"lead\">How fast each isosurface renderer is, how wrong it is, and where it \
         breaks: {measured} scenes, {} methods. All {} pixels of the timed pictures were compared with certified roots in this same \
         run.</p>\n<p class=\"meta\">{} UTC · {} · revision {} · made by <code>{}</code> in {:.1} minutes</p>\n</header>\n<nav \
         class=\"top\"><a href=\"#summary\">In short</a><a href=\"#curated\">Scenes</a><a href=\"#sweep\">Growth</a><a href=\"#hard\">Hard \
         scenes</a><a href=\"#cases\">Hard cases</a><a href=\"#convergence\">Convergence</a><a href=\"#kernels\">Kernels</a><a \
         href=\"#steinberger2010\">Steinberger 2010</a><a href=\"#steinberger2010-figures\">its figures</a><a \
         href=\"#how\">How it was measured</a></nav>\n",
        methods.len(),
        html::count(pixels),
        escape(&r.date),
        escape(cpu),
        escape(&r.revision),
        escape(&r.command),
        r.minutes,
    )
}

/// Definitions without numbers, with the reason.
fn skipped(scenes: &[&crate::results::Scene]) -> String {
    let rows: Vec<_> = (scenes.iter())
        .filter_map(|s| {
            s.skipped
                .as_ref()
                .map(|why| ("", vec![Cell::text(&s.title), Cell::with("reason", escape(why))]))
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "<h3>Not measured in this run</h3>\n{}",
        table(&[("text", "scene"), ("text", "reason")], &rows)
    )
}

fn convergence(all: &[Convergence]) -> Result<String> {
    if all.is_empty() {
        return Ok(String::new());
    }
    let mut out = String::from(
        "<h2 id=\"convergence\">Convergence</h2>\n<p>The error of the reconstruction alone, without any renderer: how far the isosurface of the \
         reconstruction lies from that of the field it was sampled from, and how far its normals turn, at seeded points of the exact surface at \
         least 16 cells from the faces. Dashed: the slope that theory promises, through the last point. More samples do not help a renderer that \
         loses roots; a better renderer does not help a reconstruction that is wrong.</p>\n",
    );
    let mut fields: Vec<&str> = all.iter().map(|c| c.field.as_str()).collect();
    fields.dedup();
    for field in fields {
        let series: Vec<&Convergence> = all.iter().filter(|c| c.field == field).collect();
        out.push_str("<div class=\"pair\">");
        for normal in [false, true] {
            if let Some(chart) = plots::convergence(&series, normal)? {
                let what = if normal {
                    "Angle between the normals"
                } else {
                    "Distance between the surfaces"
                };
                out.push_str(&figure(
                    &chart,
                    &format!("{what}, root mean square; field {}.", escape(field)),
                ));
            }
        }
        out.push_str("</div>\n");
        let rows: Vec<_> = (series.iter().enumerate())
            .map(|(i, c)| {
                let swatch = swatch(i);
                let order = |x: f64, theory: f64| {
                    let class = if crate::convergence::is_met(&c.reconstruction, x, theory) {
                        ""
                    } else {
                        "bad"
                    };
                    [Cell::with(class, format!("{x:.2}")), Cell::new(format!("{theory}"))]
                };
                let [a, b] = order(c.slope, c.theory[0]);
                let [d, e] = order(c.normal_slope, c.theory[1]);
                let last = |v: &[f64]| Cell::new(v.last().map_or_else(String::new, |x| number(*x)));
                let name = Cell::with("text", format!("{swatch}{}", escape(&c.reconstruction)));
                ("", vec![name, last(&c.position), a, b, last(&c.normal), d, e])
            })
            .collect();
        let n = series[0].n.last().copied().unwrap_or(0);
        let (position, normal) = (
            format!("position error at n = {n}, box units"),
            format!("normal error at n = {n}, degrees"),
        );
        out.push_str(&table(
            &[
                ("text", "reconstruction"),
                ("wrap", &position),
                ("", "order found"),
                ("", "theory"),
                ("wrap", &normal),
                ("", "order found"),
                ("", "theory"),
            ],
            &rows,
        ));
    }
    Ok(out)
}

fn swatch(i: usize) -> String {
    let colour = plots::hex(plots::COLOURS[i % plots::COLOURS.len()]);
    format!("<span class=\"swatch\" style=\"background:{colour}\"></span>")
}

fn benches(all: &[Bench]) -> String {
    let mut out = String::from("<h2 id=\"kernels\">Kernels</h2>\n");
    if all.is_empty() {
        out.push_str("<p class=\"note\">The criterion pass was left out, or it left no estimates.</p>\n");
        return out;
    }
    out.push_str(
        "<p>Criterion's estimates of the inner loops, run before the frames: the median of an iteration and its 95 % interval. Where a bench \
         states how many elements (roots, cells, points) an iteration holds, the last column is the time of one.</p>\n",
    );
    let rows: Vec<_> = (all.iter())
        .map(|b| {
            let each = b.elements.filter(|&n| n > 0).map(|n| number(b.median / n as f64));
            let interval = format!("{} – {}", number(b.interval[0]), number(b.interval[1]));
            (
                "",
                vec![
                    Cell::text(&b.name),
                    Cell::new(number(b.median)),
                    Cell::new(interval),
                    Cell::new(each.unwrap_or_default()),
                ],
            )
        })
        .collect();
    out.push_str(&table(
        &[
            ("text", "bench"),
            ("", "median, ns"),
            ("", "95 % interval, ns"),
            ("", "one element, ns"),
        ],
        &rows,
    ));
    out
}

fn method_of_measuring(r: &Report) -> String {
    let mut out = String::from(
        "<h2 id=\"how\">How it was measured</h2>\n<p><b>Truth.</b> For every pixel an oracle that shares no root-finding code with any method \
         isolates the roots of the function each method says it draws: outward-rounded f64 first, double-double next, exact integers last. \
         Frames are compared pixel by pixel, and every repeated timed frame must equal the checked one bit for bit; of the other time models 64 rays of an image are checked, as their cells say.</p>\n<p><b>Errors.</b> A hit \
         belongs to the nearest certified root of its ray. <i>Missed</i>: there is a root and no hit. <i>False</i>: a hit farther than half \
         a voxel from every root. <i>Wrong root</i>: a hit on a root that is not the first. <i>Undecidable</i>: the oracle finds an \
         extremum so close to the isovalue that the last bit of the f32 data decides; these pixels are counted apart. Errors of right hits are in \
         voxels, as median, 99 % and maximum; a wrong pixel never disappears in an average.</p>\n<p><b>Times.</b> Wall clock, median \
         and median absolute deviation; methods of one table ran interleaved, round by round. A method that refuses or fails has a row with its \
         reason.</p>\n",
    );
    if !r.absent.is_empty() {
        let rows: Vec<_> = (r.absent.iter())
            .map(|(m, why)| ("", vec![Cell::text(m), Cell::with("reason", escape(why))]))
            .collect();
        out.push_str("<h4>Methods without a number in this run</h4>\n");
        out.push_str(&table(&[("text", "method"), ("text", "reason")], &rows));
    }
    let rows: Vec<_> = r
        .machine
        .iter()
        .map(|(k, v)| ("", vec![Cell::text(k), Cell::text(v)]))
        .collect();
    out.push_str("<h4>The machine</h4>\n");
    out.push_str(&table(&[("text", ""), ("text", "")], &rows));
    out.push_str("<p>Tables: ");
    for m in methods(r) {
        let file = format!("csv/{}.csv", anchor(&m));
        let _ = write!(out, "<a href=\"{file}\">{file}</a>, ");
    }
    out.push_str("<a href=\"machine.txt\">machine.txt</a>.</p>\n");
    let _ = writeln!(
        out,
        "<footer>Made by <code>{}</code>. Every number on this page was measured by that one run.</footer>",
        escape(&r.command)
    );
    out
}

/// Name of a method's table.
#[must_use]
pub fn csv_name(method: &str) -> String {
    format!("{}.csv", anchor(method))
}

#[cfg(test)]
mod tests;
