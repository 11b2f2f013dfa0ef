//! Tables 3.1, 3.2 and 6.4 of Steinberger's thesis beside ours, and what levels of detail gain.

use super::html::{Cell, count, escape, number, table};
use crate::steinberger::gains::{FIELD, GainRow};
use crate::steinberger::levels::{LevelRow, PRINTED_6_4};
use crate::steinberger::{Composition, FAR, FinderRow, PRINTED_3_1, PRINTED_3_2, Steinberger};
use std::fmt::Write;

/// Families shown in full, by their place; the others are in the CSV.
const SHOWN: [usize; 4] = [0, 3, 6, 5];

pub(super) fn section(s: &Steinberger) -> String {
    if s.finders.is_empty() {
        return String::new();
    }
    let mut out = format!(
        "<h2 id=\"steinberger2010\">Steinberger 2010: compositions and root finders</h2>\n<p>The two inner loops of M. Steinberger's thesis, measured \
         again in {:.1} s: the polynomial along a ray (Table 3.1), and its first root (Table 3.2). The thesis's numbers are copied; its times are of a \
         GeForce GTX 285, relative to the slowest, and are not scaled to this machine. All of ours is f32, on one core. Tables: <a \
         href=\"csv/imported/steinberger2010/table-3.1.csv\">table-3.1.csv</a>, <a \
         href=\"csv/imported/steinberger2010/table-3.2.csv\">table-3.2.csv</a>.</p>\n",
        s.seconds
    );
    out.push_str("<h3>Table 3.1: compositions, tri-cubic</h3>\n");
    out.push_str(&compositions(&s.compositions));
    out.push_str(&lower_degrees(&s.compositions));
    out.push_str("<h3>Table 3.2: root finders, degree 9</h3>\n");
    out.push_str(&finders(s));
    out.push_str(&wrong(s));
    out.push_str(&levels(&s.levels));
    out.push_str(&gains(&s.gains));
    out
}

/// Table 6.4.
fn levels(rows: &[LevelRow]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let lines: Vec<_> = (rows.iter().zip(PRINTED_6_4))
        .map(|(r, p)| {
            let theirs = |x: String| Cell::with("zero", x);
            let cells = vec![
                Cell::text(p.figure),
                Cell::new(number(r.epsilon)),
                Cell::new(count(r.chunks)),
                theirs(p.chunks.0.to_string()),
                Cell::new(number(r.share)),
                Cell::new(number(r.reconstruction)),
                theirs(number(p.times[0])),
                Cell::new(number(r.select)),
                Cell::new(number(r.frame)),
                theirs(number(p.times[1])),
                Cell::new(number(r.full / r.frame)),
                Cell::new(number(r.mse)),
                theirs(number(p.mse)),
                Cell::new(number(r.depth)),
                Cell::new(count(r.one_sided)),
                Cell::new(count(r.parts)),
            ];
            ("", cells)
        })
        .collect();
    let head = [
        ("text", "Fig. 6.7"),
        ("", "ε"),
        ("", "chunks"),
        ("", "thesis"),
        ("", "%"),
        ("wrap", "reconstruction, ms"),
        ("", "thesis"),
        ("wrap", "select, ms"),
        ("wrap", "frame, ms"),
        ("", "thesis"),
        ("wrap", "full / frame"),
        ("wrap", "MSE × 10³"),
        ("", "thesis"),
        ("wrap", "depth, voxels"),
        ("wrap", "pixels hit in one only"),
        ("", "parts"),
    ];
    format!(
        "<h3>Table 6.4: levels of detail, tri-cubic</h3>\n{}<p>Another dragon's distance field of 128³ in the default view, 1024×768, ψ4,2, CPU time of one thread; \
         the thesis's is of a GeForce GTX 285. ε is the threshold that leaves the thesis's share of chunks. <i>Reconstruction</i>: to select chunks and compute \
         them from the coarsest level; <i>select</i>: the same from the row before, with the lattices that are drawn; <i>frame</i>: every part with pieces of its \
         own level; <i>full</i>: the volume at full resolution, interleaved with it. MSE is of linear colour in [0, 1] over pixels hit in either picture; the \
         thesis does not say of which. <i>Parts</i>: connected parts of the samples above the isovalue. <a \
         href=\"csv/imported/steinberger2010/table-6.4.csv\">table-6.4.csv</a></p>\n",
        table(&head, &lines)
    )
}

/// What levels of detail gain.
fn gains(rows: &[GainRow]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let lines: Vec<_> = (rows.iter())
        .map(|r| {
            let cells = vec![
                Cell::text(&r.size),
                Cell::new(number(r.voxel)),
                Cell::new(number(r.pixels)),
                Cell::text(&r.levels),
                Cell::new(number(r.anew)),
                Cell::new(number(r.moved)),
                Cell::new(number(r.frame)),
                Cell::new(number(r.full)),
                Cell::new(number(r.full / r.frame)),
                Cell::new(number(r.full / (r.moved + r.frame))),
                Cell::new(number(r.mse)),
                Cell::new(number(r.median)),
                Cell::new(number(r.p99)),
                Cell::new(format!("{} of {}", count(r.one_sided), count(r.hits))),
            ];
            ("", cells)
        })
        .collect();
    let head = [
        ("text", "image"),
        ("wrap", "a voxel, pixels"),
        ("wrap", "pieces at most, pixels"),
        ("text", "levels"),
        ("wrap", "anew, ms"),
        ("wrap", "moved, ms"),
        ("wrap", "frame, ms"),
        ("wrap", "full, ms"),
        ("wrap", "full / frame"),
        ("wrap", "full / (moved + frame)"),
        ("wrap", "MSE × 10³"),
        ("wrap", "depth, median, voxels"),
        ("", "99 %"),
        ("wrap", "pixels hit in one only"),
    ];
    format!(
        "<h3>What levels of detail gain</h3>\n{}<p>{} at {}, tri-cubic, ψ4,2, bench view, CPU time of one thread, the least of five, frames of both kinds in turn; \
         the thesis has no such table. Every part is drawn at the coarsest level whose pieces are seen at most so many pixels wide; chunks without a surface are \
         collapsed. <i>Anew</i>: to select, reconstruct and lay out the lattices from nothing; <i>moved</i>: the same from one frame to the next, the eye a degree \
         further round; <i>full</i>: the frame of the volume at full resolution. Errors are against that frame. Levels pay where voxels are smaller than pixels. \
         <a href=\"csv/imported/steinberger2010/gains.csv\">gains.csv</a></p>\n",
        table(&head, &lines),
        FIELD.0,
        FIELD.1
    )
}

fn compositions(all: &[Composition]) -> String {
    let cubic: Vec<&Composition> = all.iter().filter(|c| c.degree == 3).collect();
    let slowest = cubic.iter().map(|c| c.nanoseconds).fold(0.0, f64::max);
    let rows: Vec<_> = (cubic.iter())
        .map(|c| {
            let printed = PRINTED_3_1.iter().find(|p| p.form == c.form);
            let theirs =
                |f: &dyn Fn(&crate::steinberger::Printed31) -> String| Cell::with("zero", printed.map_or_else(String::new, f));
            let optional = |x: Option<f64>| Cell::new(x.map_or_else(String::new, number));
            (
                "",
                vec![
                    Cell::text(&c.form),
                    Cell::new(count(c.multiplications)),
                    theirs(&|p| p.operations[0].to_string()),
                    Cell::new(count(c.additions)),
                    theirs(&|p| p.operations[1].to_string()),
                    theirs(&|p| p.operations[2].to_string()),
                    Cell::new(number(c.nanoseconds)),
                    optional(c.packet_nanoseconds),
                    Cell::new(number(c.nanoseconds / slowest)),
                    theirs(&|p| number(p.time)),
                    Cell::new(number(c.mse * 1e12)),
                    theirs(&|p| number(p.mse * 1e12)),
                    Cell::new(number(c.cell_error * 1e6)),
                    optional(c.centred_error.map(|e| e * 1e6)),
                ],
            )
        })
        .collect();
    let mut out = table(
        &[
            ("text", "form"),
            ("", "mul"),
            ("", "thesis"),
            ("", "add"),
            ("", "thesis"),
            ("wrap", "registers, thesis"),
            ("wrap", "ns per ray"),
            ("wrap", "ns in packets"),
            ("wrap", "relative"),
            ("", "thesis"),
            ("wrap", "MSE × 10¹²"),
            ("", "thesis"),
            ("wrap", "error on a cell × 10⁶"),
            ("wrap", "about its centre × 10⁶"),
        ],
        &rows,
    );
    out.push_str(
        "<p>Operations are counted by running each form on numbers that count. Two columns of the thesis do not hold what they say: PF's counts are \
         exchanged (360 multiplications, 234 additions), and SB2's are those of three precomputed sums (here SB3), not two. The multiplications of the naive \
         form depend on which products a compiler shares. MSE as in the thesis: random coefficients of the form's own basis, relative to \
         the coefficients. <i>Error on a cell</i>: the same random cell for all, converted and rounded to the form's basis, greatest error of \
         a Bernstein coefficient over the stretch relative to the greatest one, root mean square; power forms about a corner of the cell, \
         then about its centre. <i>axis</i> is the form we recommend: t is the coordinate along which the ray advances most, so the innermost sum costs \
         nothing; <i>on a stretch</i> adds the step to the scaled Bernstein form between entry and exit, which the SB forms \
         give and root finders want.</p>\n",
    );
    out
}

fn lower_degrees(all: &[Composition]) -> String {
    let find = |form: &str, degree| all.iter().find(|c| c.form == form && c.degree == degree);
    let names: Vec<&str> = all.iter().filter(|c| c.degree == 3).map(|c| c.form.as_str()).collect();
    let rows: Vec<_> = (names.iter())
        .map(|form| {
            let mut cells = vec![Cell::text(form)];
            for c in [2, 1].map(|d| find(form, d)) {
                let Some(c) = c else { continue };
                let packets = c.packet_nanoseconds.map_or_else(String::new, number);
                let error = c.centred_error.unwrap_or(c.cell_error);
                cells.extend([count(c.multiplications), count(c.additions), number(c.nanoseconds), packets].map(Cell::new));
                cells.push(Cell::new(number(error * 1e6)));
            }
            ("", cells)
        })
        .collect();
    let head: [(&'static str, &str); 11] = [
        ("text", "form"),
        ("wrap", "tri-quadratic: mul"),
        ("", "add"),
        ("wrap", "ns per ray"),
        ("wrap", "ns in packets"),
        ("wrap", "error on a cell × 10⁶"),
        ("wrap", "tri-linear: mul"),
        ("", "add"),
        ("wrap", "ns per ray"),
        ("wrap", "ns in packets"),
        ("wrap", "error on a cell × 10⁶"),
    ];
    format!("<h4>Lower degrees</h4>\n{}", table(&head, &rows))
}

fn label(r: &FinderRow) -> String {
    r.budget.map_or_else(|| r.name.clone(), |n| format!("{}, {n}", r.name))
}

fn finders(s: &Steinberger) -> String {
    let slowest = s.finders.iter().map(|r| r.nanoseconds).fold(0.0, f64::max);
    let greatest = s.finders.iter().map(|r| r.judged[0].max).fold(f64::MIN_POSITIVE, f64::max);
    let mut out = String::from("<p>As printed, budgets not given:</p>\n");
    let printed: Vec<_> = (PRINTED_3_2.iter())
        .map(|(name, registers, time, mse, max)| {
            let cells = [(*registers).to_owned(), number(*time), number(*mse), number(*max)];
            let mut row = vec![Cell::text(name)];
            row.extend(cells.map(Cell::new));
            ("", row)
        })
        .collect();
    out.push_str(&table(
        &[
            ("text", "finder"),
            ("", "registers"),
            ("wrap", "time, relative"),
            ("wrap", "MSE, interval 1"),
            ("wrap", "greatest error, relative"),
        ],
        &printed,
    ));
    out.push_str("<p>Ours, on random polynomials of degree 9, with their budgets:</p>\n");
    let rows: Vec<_> = (s.finders.iter())
        .map(|r| {
            let j = &r.judged[0];
            let cells = [
                number(r.nanoseconds),
                number(r.nanoseconds / slowest),
                number(j.mse),
                number(j.max),
                number(j.max / greatest),
                number(j.median),
                number(j.p99),
            ];
            let mut row = vec![Cell::text(&label(r))];
            row.extend(cells.map(Cell::new));
            ("", row)
        })
        .collect();
    out.push_str(&table(
        &[
            ("text", "finder, budget"),
            ("wrap", "ns per polynomial"),
            ("wrap", "relative"),
            ("wrap", "MSE, interval 1"),
            ("wrap", "greatest error"),
            ("wrap", "relative"),
            ("wrap", "right root: median error"),
            ("", "99 %"),
        ],
        &rows,
    ));
    out
}

fn wrong(s: &Steinberger) -> String {
    let shown: Vec<usize> = SHOWN.into_iter().filter(|i| *i < s.families.len()).collect();
    let names: Vec<String> = shown.iter().map(|i| escape(&s.families[*i])).collect();
    let mut head = vec![("text", "finder, budget")];
    head.extend(names.iter().map(|n| ("wrap", n.as_str())));
    head.extend([
        ("wrap", "random: missed"),
        ("", "invented"),
        ("wrap", "later root"),
        ("", "far off"),
        ("wrap", "gave up"),
    ]);
    let hard = format!("hard cases A, of {}", s.hard_cases);
    head.push(("wrap", &hard));
    let rows: Vec<_> = (s.finders.iter())
        .map(|r| {
            let mut cells = vec![Cell::text(&label(r))];
            for i in &shown {
                let j = &r.judged[*i];
                let class = if j.wrong() > 0 { "bad" } else { "" };
                let mut text = format!("{} %", number(100.0 * j.wrong() as f64 / j.asked.max(1) as f64));
                if j.undecided > 0 {
                    let _ = write!(text, " <small>({} undecided)</small>", j.undecided);
                }
                cells.push(Cell::with(class, text));
            }
            let j = &r.judged[0];
            cells.extend([j.missed, j.invented, j.later, j.far, j.gave_up].map(|n| Cell::count(n, true)));
            let class = if r.hard > 0 { "bad" } else { "" };
            let mut text = r.hard.to_string();
            if r.hard_undecided > 0 {
                let _ = write!(text, " <small>({} undecided)</small>", r.hard_undecided);
            }
            cells.push(Cell::with(class, text));
            ("", cells)
        })
        .collect();
    let asked = s.finders.first().map_or(0, |r| r.judged[0].asked);
    format!(
        "<h4>Wrong answers</h4>\n{}<p>Share of wrong answers among {} polynomials of each kind: a root missed, one invented, a later one, the first by more \
         than {FAR} of the interval, or none within the limit. Judged by certified roots of the same f32 polynomials. <i>Random</i>: uniform Bernstein coefficients; \
         <i>rays through voxels</i>: compositions through cells of a smooth field with noise; <i>grazing</i>: two roots, or a near miss, 10<sup>-1</sup> to \
         10<sup>-4</sup> apart. Undecided is what the robust solver says where f32 cannot tell a root from a near miss; the others never say \
         so. All families are in the table's CSV.</p>\n",
        table(&head, &rows),
        count(asked)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::steinberger::Judged;

    #[test]
    fn the_section_has_both_tables_and_is_absent_without_them() {
        assert_eq!(section(&Steinberger::default()), "");
        let row = FinderRow {
            name: "LR81".into(),
            budget: Some(7),
            judged: vec![
                Judged {
                    asked: 100,
                    missed: 5,
                    ..Judged::default()
                };
                9
            ],
            ..FinderRow::default()
        };
        let s = Steinberger {
            compositions: vec![Composition {
                form: "PF".into(),
                degree: 3,
                multiplications: 360,
                ..Composition::default()
            }],
            finders: vec![row],
            families: vec!["<x>".into(); 9],
            levels: vec![LevelRow::default(); 6],
            gains: vec![
                GainRow {
                    frame: 20.0,
                    full: 50.0,
                    ..GainRow::default()
                };
                2
            ],
            ..Steinberger::default()
        };
        let text = section(&s);
        assert!(text.contains("Table 6.4") && text.contains("4681"), "{text}");
        assert!(text.contains("levels of detail gain") && text.contains("2.50"), "{text}");
        assert!(
            text.contains("LR81, 7") && text.contains("5.00 %") && text.contains("360") && text.contains("&lt;x&gt;"),
            "{text}"
        );
        assert_eq!(text.matches("<table>").count(), text.matches("</table>").count());
    }
}
