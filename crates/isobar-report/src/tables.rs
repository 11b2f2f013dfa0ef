//! One CSV per method: every number of the page, and the reasons where there is none.

use crate::page::csv_name;
use crate::results::{Apart, Comparison, Matrix, Report, Row, Scene, Stat};
use anyhow::{Context, Result};
use std::path::Path;

/// Columns of the tables. Times are seconds, errors voxels, angles degrees, memory bytes.
const COLUMNS: [&str; 61] = [
    "scene",
    "group",
    "data_sha256",
    "isovalues",
    "medium",
    "view",
    "width",
    "height",
    "reconstruction",
    "method",
    "setting",
    "default",
    "model",
    "error",
    "wall_median",
    "wall_mad",
    "samples",
    "cpu_median",
    "cpu_mad",
    "device_median",
    "pixels",
    "hits",
    "missed",
    "false",
    "wrong_root",
    "wrong_surface",
    "refuted",
    "undecidable",
    "unclaimed",
    "t_median",
    "t_p99",
    "t_max",
    "t_pixels_p99",
    "normal_median",
    "normal_p99",
    "normal_max",
    "memory_coefficients",
    "memory_index",
    "memory_view",
    "memory_device",
    "work",
    "colour_integral_p99",
    "colour_integral_max",
    "colour_integral_visible",
    "colour_integral_psnr",
    "colour_peaks_p99",
    "colour_peaks_max",
    "colour_peaks_visible",
    "colour_peaks_psnr",
    "colour_bias_max",
    "colour_bound",
    "storage_compared",
    "storage_changed",
    "storage_median",
    "storage_p99",
    "storage_max",
    "process_peak",
    "process_loaded",
    "process_drawn",
    "process_ratio",
    "revision",
];

/// Where in [`COLUMNS`] the time model stands.
const MODEL: usize = 12;

/// The first column of [`COLUMNS`] that only a frame verified pixel by pixel has.
const COUNTS: usize = 20;

/// Writes a table per method, and that of the hard cases, into `folder`.
///
/// # Errors
/// When a file cannot be written.
pub fn write(r: &Report, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("{} cannot be made", folder.display()))?;
    let mut methods: Vec<&str> = rows(r).map(|(_, _, row)| row.method.as_str()).collect();
    methods.sort_unstable();
    methods.dedup();
    for m in methods {
        let path = folder.join(csv_name(m));
        let mut w = csv::Writer::from_path(&path).with_context(|| format!("{} cannot be written", path.display()))?;
        w.write_record(COLUMNS)?;
        for (s, c, row) in rows(r).filter(|(_, _, row)| row.method == m) {
            w.write_record(line(s, c, row, &r.revision))?;
        }
        for (s, c) in r.scenes.iter().flat_map(|s| s.comparisons.iter().map(move |c| (s, c))) {
            for model in c.models.iter().filter(|x| x.method == m) {
                let row = Row {
                    method: m.into(),
                    setting: "default".into(),
                    default: true,
                    reason: model.reason.clone(),
                    wall: model.wall,
                    cpu: model.cpu,
                    ..Row::default()
                };
                let mut fields = line(s, c, &row, &r.revision);
                fields[MODEL].clone_from(&model.model);
                // A model's frames are verified on rays, not pixel by pixel: no counts.
                fields[COUNTS..COLUMNS.len() - 1].iter_mut().for_each(String::clear);
                w.write_record(fields)?;
            }
        }
        w.flush()?;
    }
    hard_cases(&r.hard, &folder.join("hard-cases.csv"))
}

fn rows(r: &Report) -> impl Iterator<Item = (&Scene, &Comparison, &Row)> {
    r.scenes.iter().flat_map(|s| {
        s.comparisons
            .iter()
            .flat_map(move |c| c.rows.iter().map(move |row| (s, c, row)))
    })
}

fn line(s: &Scene, c: &Comparison, r: &Row, revision: &str) -> Vec<String> {
    let isovalues: Vec<String> = s.isovalues.iter().map(f64::to_string).collect();
    let mut out: Vec<String> = vec![
        s.id.clone(),
        s.group.clone(),
        s.data_hash.clone(),
        isovalues.join(" "),
        s.medium.clone().unwrap_or_default(),
        s.view.clone(),
        s.size[0].to_string(),
        s.size[1].to_string(),
        c.reconstruction.clone(),
        r.method.clone(),
        r.setting.clone(),
        r.default.to_string(),
        "steady".into(),
        r.reason.clone().unwrap_or_default(),
    ];
    if r.reason.is_some() {
        out.resize(COLUMNS.len() - 1, String::new());
        out.push(revision.to_owned());
        return out;
    }
    let number = |x: f64| format!("{x:e}");
    let device = r.device.map_or_else(String::new, |d: Stat| number(d.median));
    let k = &r.checked;
    out.extend([
        number(r.wall.median),
        number(r.wall.mad),
        r.wall.n.to_string(),
        number(r.cpu.median),
        number(r.cpu.mad),
        device,
    ]);
    let counts = [
        k.pixels,
        k.hits,
        k.missed,
        k.false_hits,
        k.wrong_root,
        k.wrong_surface,
        k.refuted,
        k.undecidable,
        k.unclaimed,
    ];
    out.extend(counts.map(|n| n.to_string()));
    // Without right hits there are no errors of them.
    let error = |x: f64| if k.right() > 0 { number(x) } else { String::new() };
    out.extend([k.t_voxels.median, k.t_voxels.p99, k.t_voxels.max, k.t_pixels.p99].map(error));
    out.extend([k.normal_deg.median, k.normal_deg.p99, k.normal_deg.max].map(error));
    out.extend(r.memory.map(|n| n.to_string()));
    out.push(r.work.to_string());
    out.extend(colours(r));
    out.extend(storage(r));
    out.extend(r.peak.map_or_else(
        || vec![String::new(); 4],
        |p| {
            [p.process, p.loaded, p.drawn]
                .map(|n| n.to_string())
                .into_iter()
                .chain([number(p.ratio())])
                .collect::<Vec<_>>()
        },
    ));
    out.push(revision.to_owned());
    out
}

/// Colours against the exact ones; nothing without a medium.
fn colours(r: &Row) -> [String; 10] {
    let Some(c) = &r.colour else {
        return Default::default();
    };
    let number = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:e}"));
    let apart = |a: Option<Apart>| {
        let visible = a.map_or_else(String::new, |a| a.visible.to_string());
        let field = |f: fn(Apart) -> Option<f64>| number(a.and_then(f));
        [field(|a| a.p99), field(|a| a.max), visible, field(|a| a.psnr)]
    };
    let [a, b, d, e] = apart(Some(c.integral));
    let [f, g, h, i] = apart(c.peaks);
    [a, b, d, e, f, g, h, i, number(c.bias.and_then(|a| a.max)), number(c.bound)]
}

/// The storage error; 0 pixels compared where the stored function is the ideal one, nothing where the method tells none.
fn storage(r: &Row) -> [String; 5] {
    let Some(s) = &r.storage else {
        return Default::default();
    };
    let [median, p99, max] = [s.voxels.median, s.voxels.p99, s.voxels.max].map(|x| format!("{x:e}"));
    [s.compared.to_string(), s.changed.to_string(), median, p99, max]
}

/// The matrix of hard cases as one table, a line per cell; cases that are no rows have no column.
fn hard_cases(m: &Matrix, path: &Path) -> Result<()> {
    let mut w = csv::Writer::from_path(path).with_context(|| format!("{} cannot be written", path.display()))?;
    w.write_record([
        "table",
        "case",
        "title",
        "source",
        "column",
        "bar",
        "verdict",
        "expected",
        "certified",
        "given",
    ])?;
    for t in &m.tables {
        for r in &t.rows {
            for (i, (column, v)) in t.columns.iter().zip(&r.cells).enumerate() {
                let bar = t.bars.get(i).map_or("", String::as_str);
                w.write_record([
                    t.title.as_str(),
                    &r.id,
                    &r.title,
                    &r.source,
                    column,
                    bar,
                    v.kind.word(),
                    &r.expected,
                    &v.expected,
                    &v.given,
                ])?;
            }
        }
    }
    for e in &m.elsewhere {
        let tests = e.tests.join("; ");
        w.write_record(["elsewhere", &e.id, &e.title, &e.source, "", "", "tested", &e.why, "", &tests])?;
    }
    w.flush()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Colour, MatrixRow, MatrixTable, Peak, Storage, Verdict};

    #[test]
    fn every_row_has_every_column_and_reasons_are_kept() {
        let row = |reason: Option<&str>| Row {
            method: "a/cpu".into(),
            reason: reason.map(String::from),
            ..Row::default()
        };
        let r = Report {
            scenes: vec![Scene {
                comparisons: vec![Comparison {
                    rows: vec![row(None), row(Some("no adapter"))],
                    ..Comparison::default()
                }],
                ..Scene::default()
            }],
            ..Report::default()
        };
        let dir = tempfile::tempdir().unwrap();
        write(&r, dir.path()).unwrap();
        let mut reader = csv::Reader::from_path(dir.path().join("a-cpu.csv")).unwrap();
        let lines: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        assert_eq!(lines.len(), 2);
        assert_eq!((COLUMNS[MODEL], COLUMNS[COUNTS]), ("model", "pixels"));
        assert_eq!(&lines[1][MODEL + 1], "no adapter");
        assert!(lines.iter().all(|l| l.len() == COLUMNS.len()));
    }

    #[test]
    fn storage_error_memory_and_hard_cases_are_written() {
        let row = Row {
            method: "a/cpu".into(),
            colour: Some(Colour {
                peaks: Some(Apart {
                    p99: Some(0.25),
                    visible: 9,
                    ..Apart::default()
                }),
                bound: Some(0.5),
                ..Colour::default()
            }),
            storage: Some(Storage {
                compared: 7,
                changed: 1,
                ..Storage::default()
            }),
            peak: Some(Peak {
                process: 300,
                loaded: 150,
                drawn: 300,
                data: 100,
                frame: 100,
            }),
            ..Row::default()
        };
        let table = MatrixTable {
            columns: vec!["oracle".into(), "a/cpu".into()],
            bars: vec!["the case's tolerance".into(), "within 0.01 cell".into()],
            rows: vec![MatrixRow {
                id: "B2".into(),
                expected: "1.3, 1.6".into(),
                cells: ["1.3, 1.6", "no hit"]
                    .map(|g| Verdict {
                        given: g.into(),
                        ..Verdict::default()
                    })
                    .into(),
                ..MatrixRow::default()
            }],
            ..MatrixTable::default()
        };
        let r = Report {
            scenes: vec![Scene {
                comparisons: vec![Comparison {
                    rows: vec![row],
                    ..Comparison::default()
                }],
                ..Scene::default()
            }],
            hard: Matrix {
                tables: vec![table],
                ..Matrix::default()
            },
            ..Report::default()
        };
        let dir = tempfile::tempdir().unwrap();
        write(&r, dir.path()).unwrap();
        let read = |name: &str| -> Vec<csv::StringRecord> {
            let mut reader = csv::Reader::from_path(dir.path().join(name)).unwrap();
            reader.records().map(Result::unwrap).collect()
        };
        let at = |name: &str| COLUMNS.iter().position(|c| *c == name).unwrap();
        let line = &read("a-cpu.csv")[0];
        assert_eq!(
            (&line[at("colour_peaks_p99")], &line[at("colour_peaks_visible")]),
            ("2.5e-1", "9")
        );
        assert_eq!(
            (
                &line[at("colour_bound")],
                &line[at("colour_integral_max")],
                &line[at("t_max")]
            ),
            ("5e-1", "", "")
        );
        assert_eq!((&line[at("storage_compared")], &line[at("storage_changed")]), ("7", "1"));
        assert_eq!((&line[at("process_peak")], &line[at("process_ratio")]), ("300", "1.5e0"));
        let cells = read("hard-cases.csv");
        assert_eq!(cells.len(), 2);
        assert_eq!(
            (&cells[1][4], &cells[1][5], &cells[1][9]),
            ("a/cpu", "within 0.01 cell", "no hit")
        );
    }
}
