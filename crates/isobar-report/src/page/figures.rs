//! The figures of Steinberger's thesis, drawn again, with the thesis's numbers.

use super::html::{Cell, count, escape, figure, image, number, table};
use super::swatch;
use crate::plots;
use crate::steinberger::figures::detail::{CompressionRow, LevelPictures, Shot, TOPOLOGY, TopologyRow};
use crate::steinberger::figures::surfaces::SurfaceTime;
use crate::steinberger::figures::volumes::{BlocksRow, CloseupRow, DegreesRow};
use crate::steinberger::figures::{Figures, Verified};
use crate::steinberger::levels::LevelRow;
use anyhow::Result;
use isobar_octree::figures::closeup::WHITE;
use isobar_octree::figures::printed::{FIGURE_3_2, TABLE_6_2, TABLE_6_4};
use isobar_octree::figures::surfaces::SURFACES;
use std::fmt::Write;

/// Folder of the tables.
const CSV: &str = "csv/imported/steinberger2010";

pub(super) fn section(f: &Figures, levels: &[LevelRow]) -> Result<String> {
    if f.seconds == 0.0 {
        return Ok(String::new());
    }
    let mut out = format!(
        "<h2 id=\"steinberger2010-figures\">Steinberger 2010: figures</h2>\n<p>The figures of the thesis, drawn again in {:.1} s. The repository ships none of the thesis's data sets: \
         where it shows Bucky, a foot, a vertebra or its own dragon, other volumes of about the same size stand in, and views are ours, since it gives none. So pictures \
         and counts stand beside each other and are no ratio. Its times are of a GeForce GTX 285 and a Core i7 at 1024×768 and are not scaled; ours are of this machine's processor. \
         {}</p>\n",
        f.seconds,
        verdict(f.verdicts().map(|v| v.1))
    );
    out.push_str(&f.blocks.as_ref().map_or_else(String::new, blocks));
    out.push_str(&compressions(&f.compressions));
    out.push_str(&chosen(&f.levels, levels));
    out.push_str(&surfaces(f)?);
    out.push_str(&degrees(&f.degrees));
    out.push_str(&f.closeup.as_ref().map_or_else(String::new, closeup));
    out.push_str(&transition(&f.transition));
    out.push_str(&topology(&f.topology));
    Ok(out)
}

/// What the check of some frames says.
fn verdict(all: impl Iterator<Item = Verified>) -> String {
    let (mut frames, mut sum) = (0u64, Verified::default());
    for v in all {
        frames += 1;
        sum.pixels += v.pixels;
        sum.wrong += v.wrong;
        sum.undecidable += v.undecidable;
    }
    let wrong = match sum.wrong {
        0 => "none is wrong".to_owned(),
        n => format!("<b class=\"bad\">{} are wrong</b>", count(n)),
    };
    let undecidable = match sum.undecidable {
        0 => String::new(),
        n => format!(", {} are undecidable in f32 data", count(n)),
    };
    format!(
        "All {} pixels of the {frames} frames of <code>octree/cpu</code> below were held against certified roots in this run: {wrong}{undecidable}.",
        count(sum.pixels)
    )
}

/// A link to a table.
fn csv(name: &str) -> String {
    format!("<a href=\"{CSV}/{name}\">{name}</a>")
}

/// A gallery of pictures: file, what it shows as text, caption as markup.
fn gallery(size: [usize; 2], pictures: impl Iterator<Item = (String, String, String)>) -> String {
    let mut out = String::from("<div class=\"pictures\">\n");
    for (file, alt, caption) in pictures {
        out.push_str(&figure(&image(&file, &alt, size), &caption));
    }
    out.push_str("</div>\n");
    out
}

fn percent(part: u64, of: u64) -> String {
    format!("{:.1} %", 100.0 * part as f64 / of.max(1) as f64)
}

fn blocks(b: &BlocksRow) -> String {
    let all: usize = FIGURE_3_2.iter().map(|p| p.1).sum();
    let ours = [b.classes[0], b.classes[1], b.classes[2] + b.classes[3]];
    let names = [
        "all rays miss the box (blue)",
        "no candidate cell (green)",
        "polynomials worked on (red)",
    ];
    let mut rows: Vec<_> = (names.iter().zip(ours).zip(FIGURE_3_2))
        .map(|((name, n), (_, printed))| {
            let theirs = |x: String| Cell::with("zero", x);
            let cells = vec![
                Cell::text(name),
                Cell::new(count(n)),
                Cell::new(percent(n, b.launched)),
                theirs(printed.to_string()),
                theirs(percent(printed as u64, all as u64)),
            ];
            ("", cells)
        })
        .collect();
    let launched = [
        Cell::text("launched"),
        Cell::new(count(b.launched)),
        Cell::new(format!("of {}", count(b.blocks))),
        Cell::with("zero", all.to_string()),
        Cell::new(""),
    ];
    rows.push(("", launched.into()));
    let head = [
        ("text", "blocks of 8×8 pixels"),
        ("", "ours"),
        ("", ""),
        ("", "thesis"),
        ("", ""),
    ];
    format!(
        "<h3>Figure 3.2: where blocks of pixels end</h3>\n<div class=\"pair\">{}<div>{}<p>Tri-cubic, 512×512; the thesis shows Bucky, 32³. Only the rectangle that the box projects to is \
         launched; white blocks never start. {} of the red blocks hit the surface (dark red); the other {} compose polynomials that have no root. Candidates are cells whose Bernstein \
         coefficients have both signs. {}</p></div></div>\n",
        figure(
            &image(&b.shown.file, "blocks of pixels by what became of them", [512, 512]),
            &format!("{}, by <code>octree/cpu</code>.", escape(&b.title))
        ),
        table(&head, &rows),
        count(b.classes[3]),
        count(b.classes[2]),
        csv("figure-3.2.csv")
    )
}

fn compressions(all: &[CompressionRow]) -> String {
    if all.is_empty() {
        return String::new();
    }
    let mut out = String::from("<h3>Figure 4.5: the greatest wavelet coefficients only</h3>\n");
    let shown = all.iter().filter(|c| c.weighted);
    out.push_str(&gallery(
        [512, 384],
        shown.map(|c| {
            let kept = format!("{} % of the coefficients", number(c.share));
            let caption = format!("{kept} ({}); MSE × 10³ {}", count(c.kept), number(c.mse));
            (c.shown.file.clone(), format!("dragon from {kept}"), caption)
        }),
    ));
    let rows: Vec<_> = (all.iter())
        .map(|c| {
            let by = if c.weighted {
                "magnitude × norm of its function"
            } else {
                "magnitude"
            };
            let mut cells = vec![Cell::text(by), Cell::new(count(c.kept))];
            cells.extend([c.share, c.rms, c.max, c.mse, c.depth].map(|x| Cell::new(number(x))));
            cells.push(Cell::new(count(c.one_sided)));
            ("", cells)
        })
        .collect();
    let head = [
        ("text", "greatest by"),
        ("", "kept"),
        ("", "%"),
        ("wrap", "coefficients: rms error, voxels"),
        ("", "greatest"),
        ("wrap", "picture: MSE × 10³"),
        ("wrap", "depth rms, voxels"),
        ("wrap", "pixels hit in one only"),
    ];
    out.push_str(&table(&head, &rows));
    let _ = writeln!(
        out,
        "<p>A dragon's distance field, 128³, ψ4,2, tri-cubic, 512×384; the pictures are those of the second half of the table. The thesis shows its dragon from a small part of the coefficients \
         and prints no numbers. By magnitude alone, details of fine levels count as much as those of coarse ones, which reach further; times the norm of the basis function the error of \
         the field is smaller at the same count. {}</p>",
        csv("figure-4.5.csv")
    );
    out
}

/// Figures 4.6 and 6.7.
fn chosen(all: &[LevelPictures], rows: &[LevelRow]) -> String {
    if all.is_empty() {
        return String::new();
    }
    let mut out = String::from("<h3>Figures 4.6 and 6.7: levels of detail chosen by view</h3>\n");
    let captioned = || {
        all.iter().map(|l| {
            let row = rows.iter().find(|r| r.figure == l.figure);
            let printed = TABLE_6_4.iter().find(|p| p.figure == l.figure);
            let mut text = match l.figure.as_str() {
                "full" => "<b>full</b>".to_owned(),
                letter => format!("<b>({letter})</b>"),
            };
            if let (Some(r), Some(p)) = (row, printed) {
                let _ = write!(
                    text,
                    " {} chunks [{}]; frame {} ms [{}]; MSE × 10³ {} [{}]",
                    count(r.chunks),
                    p.chunks.0,
                    number(r.frame),
                    number(p.times[1]),
                    number(r.mse),
                    number(p.mse)
                );
            }
            (l, text)
        })
    };
    out.push_str("<h4>Figure 6.7, shaded</h4>\n");
    out.push_str(&gallery(
        [1024, 768],
        captioned().map(|(l, text)| (l.shaded.file.clone(), format!("dragon, Figure 6.7 {}", l.figure), text)),
    ));
    out.push_str("<h4>Figure 4.6, by level</h4>\n");
    out.push_str(&gallery(
        [1024, 768],
        captioned().map(|(l, _)| {
            let chunks: Vec<String> = l.chunks_by_level.iter().map(|&n| count(n)).collect();
            let name = if l.figure == "full" {
                "full".to_owned()
            } else {
                format!("({})", l.figure)
            };
            let caption = format!("<b>{name}</b> finest chunks, level 0 first: {}", chunks.join(", "));
            (l.by_level.clone(), format!("levels of detail, {}", l.figure), caption)
        }),
    ));
    let differ: u64 = all.iter().map(|l| l.differ).sum();
    let _ = writeln!(
        out,
        "<p>In brackets Table 6.4 as the thesis prints it; our times are CPU time of one thread. Levels by colour: {}; black where the level changes. The pictures show the coefficients \
         that are left at full resolution; the frames over levels, which were timed, differ from them by more than 10⁻³ voxel in {} pixels. {}, {}</p>",
        legend(all.iter().map(|l| l.chunks_by_level.len()).max().unwrap_or(0)),
        count(differ),
        csv("figure-6.7.csv"),
        csv("table-6.4.csv")
    );
    out
}

/// Colours of levels, as `wavelet::table::level_picture` has them.
fn legend(levels: usize) -> String {
    let names: Vec<String> = (0..levels)
        .map(|l| {
            let colours = isobar_core::Surface::COLOURS;
            let [r, g, b] = colours[l % colours.len()];
            let [r, g, b] = isobar_core::to_srgb8([r, g, b, 1.0]);
            let what = if l == 0 { " (finest)" } else { "" };
            format!("<span class=\"swatch\" style=\"background:#{r:02x}{g:02x}{b:02x}\"></span>{l}{what}")
        })
        .collect();
    names.join(" &nbsp; ")
}

/// Figure 6.1.
fn surfaces(f: &Figures) -> Result<String> {
    if f.surfaces.is_empty() {
        return Ok(String::new());
    }
    let mut out = String::from("<h3>Figure 6.1: the frustum form beside compositions</h3>\n");
    let ways: Vec<&str> = f.surfaces.iter().fold(Vec::new(), |mut all, s| {
        if !all.contains(&s.how.as_str()) {
            all.push(&s.how);
        }
        all
    });
    out.push_str("<div class=\"pictures\">\n");
    for (letter, degree, formula) in SURFACES {
        if let Some((_, file)) = f.surface_pictures.iter().find(|p| p.0 == letter) {
            let alt = format!("surface {letter}");
            let caption = format!("<b>({letter})</b> {formula}, degree {degree} in each variable");
            out.push_str(&figure(&image(file, &alt, [512, 512]), &caption));
        }
    }
    out.push_str("</div>\n<div class=\"pictures\">\n");
    for (letter, _, _) in SURFACES {
        let of = |s: &&SurfaceTime| s.letter == letter;
        let mut series: Vec<Vec<(f64, f64)>> = (ways.iter())
            .map(|w| {
                let one = f.surfaces.iter().filter(of).filter(|s| s.how == *w);
                one.map(|s| (s.size as f64, s.frame)).collect()
            })
            .collect();
        let form = f
            .surfaces
            .iter()
            .filter(of)
            .filter(|s| s.preprocessing > 0.0 && s.how == ways[0]);
        series.push(form.map(|s| (s.size as f64, s.preprocessing)).collect());
        if let Some(chart) = plots::sizes(&series)? {
            out.push_str(&figure(&chart, &format!("({letter}): ms of a frame")));
        }
    }
    out.push_str("</div>\n");
    let names: Vec<String> = (ways.iter().copied().chain(["making the frustum form"]).enumerate())
        .map(|(i, w)| format!("{}{}", swatch(i), escape(w)))
        .collect();
    let _ = writeln!(out, "<p class=\"legend\">{}</p>", names.join(" &nbsp; "));
    out.push_str(&surface_table(&f.surfaces, &ways));
    let _ = writeln!(
        out,
        "<p>One thread, wall clock, f32, the thesis's 6 (d + 1) iterations of LR81 for all, from the near plane to the far one; the fastest of up to five frames, ways in turn. <i>Frustum form</i>: Reimers and Seland, every ray for \
         itself, as a fragment shader has to; <i>rows</i>: what a row of pixels shares worked out once; PF and SB1: the thesis's compositions; <i>axis</i>: the one we recommend. The \
         frustum form is made anew for each view; compositions need nothing of the kind. The thesis prints bars without numbers and says that its composition is faster than the frustum form, most \
         at low degrees and small images, where making the form weighs (Core i7, GeForce GTX 285). Here the root finder takes most of a frame either way. <i>Wrong</i>: of at most 256×256 pixels of an image \
         held against certified roots between the planes, those hit or not hit wrongly or more than a pixel's width off: what f32 and a fixed number of iterations cost. {}</p>",
        csv("figure-6.1.csv")
    );
    Ok(out)
}

fn surface_table(all: &[SurfaceTime], ways: &[&str]) -> String {
    let mut head = vec![
        ("text", "surface, image".to_owned()),
        ("wrap", "making the form, ms".to_owned()),
    ];
    head.extend(ways.iter().map(|w| {
        (
            "wrap",
            format!("{}<small>frame, ms; composition, ns a ray; wrong</small>", escape(w)),
        )
    }));
    let head: Vec<(&str, &str)> = head.iter().map(|(c, t)| (*c, t.as_str())).collect();
    let mut rows: Vec<(&str, Vec<Cell>)> = Vec::new();
    for group in all.chunk_by(|a, b| a.letter == b.letter && a.size == b.size) {
        let first = &group[0];
        let form = group
            .iter()
            .map(|s| s.preprocessing)
            .fold(f64::INFINITY, |m, x| if x > 0.0 { m.min(x) } else { m });
        let mut cells = vec![
            Cell::text(&format!("({}) {}²", first.letter, first.size)),
            Cell::new(number(form)),
        ];
        for way in ways {
            cells.push(group.iter().find(|s| s.how == *way).map_or_else(
                || Cell::new(""),
                |s| {
                    let ns = s.composition * 1e6 / (s.size * s.size).max(1) as f64;
                    let wrong = if s.wrong > 0 {
                        format!("<span class=\"bad\">{}</span> of {}", count(s.wrong), count(s.checked))
                    } else {
                        format!("0 of {}", count(s.checked))
                    };
                    Cell::new(format!(
                        "{}<small>{} ns</small><small>{wrong}</small>",
                        number(s.frame),
                        number(ns)
                    ))
                },
            ));
        }
        rows.push(("", cells));
    }
    table(&head, &rows)
}

/// Figures 6.2 to 6.5.
fn degrees(all: &[DegreesRow]) -> String {
    if all.is_empty() {
        return String::new();
    }
    let mut out = String::from("<h3>Figures 6.2 to 6.5 and Table 6.2: three degrees, and the bricks that are looked into</h3>\n");
    for d in all {
        let printed = TABLE_6_2.iter().find(|p| p.1 == d.figure);
        let instead = printed.map_or("", |p| p.0);
        let _ = writeln!(
            out,
            "<h4>Figure {}: {}; in the thesis {instead}</h4>",
            escape(&d.figure),
            escape(&d.title)
        );
        let kinds = d.degrees.iter().enumerate().map(|(i, k)| {
            let theirs = printed.map_or_else(String::new, |p| format!(" [{}]", number(p.2[i])));
            let caption = format!("{}: {} frames per second{theirs}", escape(&k.kind), number(1e3 / k.frame));
            (k.shown.file.clone(), format!("{}, {}", d.title, k.kind), caption)
        });
        let [[two, of_two], [four, of_four]] = d.bricks;
        let bricks = format!(
            "active bricks of 2³ cells: {} of {}, {}; of 4³: {} of {}, {}",
            count(two),
            count(of_two),
            percent(two, of_two),
            count(four),
            count(of_four),
            percent(four, of_four)
        );
        let bricks = (d.bricks_file.clone(), format!("active bricks of {}", d.title), bricks);
        out.push_str(&gallery([1024, 768], kinds.chain([bricks])));
    }
    let rows: Vec<_> = (all.iter())
        .map(|d| {
            let printed = TABLE_6_2.iter().find(|p| p.1 == d.figure);
            let mut cells = vec![Cell::text(&d.title)];
            for (i, k) in d.degrees.iter().enumerate() {
                cells.push(Cell::new(number(k.frame)));
                cells.push(Cell::new(number(1e3 / k.frame)));
                cells.push(Cell::with("zero", printed.map_or_else(String::new, |p| number(p.2[i]))));
            }
            cells.push(Cell::with("zero", printed.map_or_else(String::new, |p| number(p.2[3]))));
            cells.insert(1, Cell::with("zero", printed.map_or("", |p| p.0)));
            ("", cells)
        })
        .collect();
    let head = [
        ("text", "volume"),
        ("", "thesis's"),
        ("wrap", "tri-linear: ms"),
        ("wrap", "frames per second"),
        ("", "thesis"),
        ("wrap", "tri-quadratic: ms"),
        ("wrap", "frames per second"),
        ("", "thesis"),
        ("wrap", "tri-cubic: ms"),
        ("wrap", "frames per second"),
        ("", "thesis"),
        ("wrap", "texture sampling, thesis"),
    ];
    out.push_str("<h4>Table 6.2: frames per second</h4>\n");
    out.push_str(&table(&head, &rows));
    let _ = writeln!(
        out,
        "<p>1024×768, default view, wall clock on all threads, the fastest of three frames, with normals, colours and proofs of every pixel. In brackets and grey the thesis's, of its own volumes and views on a \
         GeForce GTX 285. Its row of texture sampling has no counterpart: an emulated texture unit says nothing about the speed of a real one. A brick of 2³ cells, the thesis's size, is drawn where its samples lie on both sides of the \
         isovalue; <code>octree/cpu</code> has bricks of 4³. {}</p>",
        csv("figures-6.2-to-6.5.csv")
    );
    out
}

fn closeup(c: &CloseupRow) -> String {
    let three = |v: [f64; 3]| v.map(|x| Cell::new(number(x)));
    let mut first = vec![Cell::text("octree/cpu")];
    first.extend(three(c.octree));
    first.extend(three(c.octree));
    let mut rows = vec![("", first)];
    for s in &c.sampled {
        let name = s.bits.map_or_else(
            || "eight fetches, fractions of f32".to_owned(),
            |b| format!("eight fetches, {b} bits of fraction"),
        );
        let mut cells = vec![Cell::text(&name)];
        cells.extend(three(s.at_exact_hits));
        cells.extend(three(s.at_own_hits));
        cells.push(Cell::new(count(s.one_sided)));
        cells.extend(three(s.off));
        rows.push(("", cells));
    }
    let head = [
        ("text", "normals, degrees off"),
        ("wrap", "at the exact hits: median"),
        ("", "99 %"),
        ("", "greatest"),
        ("wrap", "at its own hits: median"),
        ("", "99 %"),
        ("", "greatest"),
        ("wrap", "pixels hit by one only"),
        ("wrap", "hits apart, voxels: median"),
        ("", "99 %"),
        ("", "greatest"),
    ];
    let pictures = [
        (&c.exact.file, "octree/cpu", "<code>octree/cpu</code>, tri-cubic".to_owned()),
        (
            &c.sampled_file,
            "texture sampling",
            "fast tri-cubic texture sampling, weights of a texture unit (8 bits of fraction)".to_owned(),
        ),
        (
            &c.angle_file,
            "angle between the normals",
            format!("angle between the normals of the two: black 0°, white {WHITE}° and more; blue: hit by one only"),
        ),
    ];
    format!(
        "<h3>Figure 6.6: a close-up by texture sampling</h3>\n{}{}<p>{}, seen from {} voxel away, 512×384; {} pixels hit. The thesis shows an artery in its vertebra by a GeForce GTX 285, whose texture unit \
         interpolates with 9 bits, 8 of them after the point, and prints no numbers: its picture (d) is the difference of the normals. Here that unit is emulated, everything else in f32; the surface is found by steps of half a \
         voxel, an eighth near it, and 12 halvings, which pass over pairs of roots. Normals are held against the exact gradient of the cubic B-spline. {}</p>\n",
        gallery(
            [512, 384],
            pictures
                .into_iter()
                .map(|(file, alt, caption)| (file.clone(), alt.to_owned(), caption))
        ),
        table(&head, &rows),
        escape(&c.title),
        number(c.voxels),
        count(c.exact.verified.hits),
        csv("figure-6.6.csv")
    )
}

fn transition(all: &[Shot]) -> String {
    if all.is_empty() {
        return String::new();
    }
    let pictures = all.iter().flat_map(|s| {
        let shaded = (
            s.shaded.file.clone(),
            format!("{}, shaded", s.name),
            format!("{}, shaded", escape(&s.name)),
        );
        let by_level = (
            s.by_level.clone(),
            format!("{}, by level", s.name),
            format!("{}, by level", escape(&s.name)),
        );
        [shaded, by_level]
    });
    let wrong: u64 = all.iter().map(|s| s.shaded.verified.wrong).sum();
    format!(
        "<h3>Figure 6.8: the transition from one level to another</h3>\n{}<p>The levels of Figure 6.7 (b), chosen for its view, seen from the other side, and the border of two levels from 20 voxels before it; \
         drawn over levels of detail, every part with pieces of its own level. Against the certified roots of the coefficients at full resolution {} of {} pixels are wrong: no crack and no jump at the border, where the thesis, \
         too, shows none. Colours of levels as above. {}</p>\n",
        gallery([1024, 768], pictures),
        count(wrong),
        count(all.iter().map(|s| s.shaded.verified.pixels).sum()),
        csv("figure-6.8.csv")
    )
}

fn topology(all: &[TopologyRow]) -> String {
    if all.is_empty() {
        return String::new();
    }
    let pictures = all.iter().map(|t| {
        let caption = format!("details: {}", escape(&t.details));
        (t.shown.file.clone(), format!("skull, details: {}", t.details), caption)
    });
    let rows: Vec<_> = (all.iter())
        .map(|t| {
            let mut cells = vec![Cell::text(&t.details), Cell::new(count(t.chunks))];
            cells.extend(t.above.iter().chain(&t.below).map(|&n| Cell::new(count(n))));
            ("", cells)
        })
        .collect();
    let head = [
        ("text", "details"),
        ("wrap", "chunks with details"),
        ("wrap", "parts above the isovalue"),
        ("wrap", "of 64 samples and more"),
        ("wrap", "samples of the largest"),
        ("wrap", "parts below it"),
        ("wrap", "of 64 samples and more"),
        ("wrap", "samples of the largest"),
    ];
    format!(
        "<h3>Figure 6.9: aggressive settings change the topology</h3>\n{}{}<p>The skull, 64³, at {}, ψ4,2, tri-cubic, in place of the thesis's Bucky, for which it prints no numbers: connected parts of the samples at or above \
         the isovalue and of those below it, neighbours along axes. Fewer levels close small holes, join parts that are close, and tear thin shells; magnitude keeps large parts longer at as few chunks. {}</p>\n",
        gallery([384, 384], pictures),
        table(&head, &rows),
        TOPOLOGY.1,
        csv("figure-6.9.csv")
    )
}

#[cfg(test)]
mod tests;
