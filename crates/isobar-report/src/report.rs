//! A whole run: definitions one by one, each result kept as soon as it is there, so that an interrupted run goes on where it was.

use crate::definitions::{Definition, Tier};
use crate::measure::{self, Settings};
use crate::results::{MODELS, Report, Scene};
use crate::{benches, convergence, data, definitions, hard, machine, page, record, steinberger, tables};
use anyhow::{Context, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};
use isobar_core::{Method, Stop};
use std::fs::{File, TryLockError};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

/// Fields the convergence plots are made of: no symmetry of theirs raises an order.
const FIELDS: [&str; 2] = ["torus", "tangle"];

/// What a run is asked.
#[derive(Debug, Clone)]
pub struct Options {
    /// The repository's root.
    pub root: PathBuf,
    /// Cargo's target folder.
    pub target: PathBuf,
    /// Larger images, the orbit, further data.
    pub full: bool,
    /// Keep the run under `reports/recorded`.
    pub record: bool,
    /// Names of the definitions measured; empty: all.
    pub only: Vec<String>,
    /// Criterion's folder.
    pub criterion: Option<PathBuf>,
    /// Older estimates belong to another run.
    pub criterion_since: SystemTime,
    /// The command as typed.
    pub command: String,
}

/// A run that is over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Done {
    /// The page.
    pub page: PathBuf,
    /// What is not as the definitions and cases say, a line each; the page says it too.
    pub trouble: Vec<String>,
}

/// Measures everything and puts the page in place.
///
/// # Errors
/// When a definition cannot be read or a file cannot be written. What was measured until then is kept for the next run.
pub fn run(o: &Options) -> Result<Done> {
    let start = Instant::now();
    let folder = o.root.join("bench-data/definitions");
    let all = choose(definitions::read_all(&folder)?, &o.only)?;
    let methods = isobar::methods();
    let reports = o.root.join("reports");
    let _alone = alone(&o.target)?;
    let kept = Kept::open(&o.target.join("isobar-report"), &key(o, &all)?)?;
    let settings = Settings {
        root: o.root.clone(),
        stage: kept.folder.join("stage"),
        truths: measure::truth_folder(&o.target),
        full: o.full,
    };
    let bar = progress(all.len() as u64 + 2);
    let mut r = Report {
        command: o.command.clone(),
        ..Report::default()
    };
    let named = |path: &str| steinberger::DATA == path || all.iter().any(|d| d.data.strip_prefix("bench-data/") == Some(path));
    let say = |what: &str| bar.set_message(what.to_owned());
    data::make(&o.root.join("bench-data"), &named, &say)?;
    for d in &all {
        bar.set_message(d.id.clone());
        r.scenes.push(kept.scene(d, || one(d, o, &methods, &settings))?);
        bar.inc(1);
    }
    bar.set_message("hard cases");
    r.hard = hard::run(&folder.join("hard/cases"), &methods)?;
    bar.inc(1);
    bar.set_message("convergence");
    for f in FIELDS {
        r.convergence.extend(convergence::measure(f)?);
    }
    r.steinberger = steinberger::measure(&o.root.join("bench-data"), &settings.stage, &say)?;
    bar.finish_and_clear();
    r.benches = o
        .criterion
        .as_deref()
        .map(|c| benches::read(c, o.criterion_since))
        .unwrap_or_default();
    r.absent = absent(&r.scenes);
    r.absent.extend(unasked(&all, &methods));
    r.machine = machine::describe(&o.root);
    r.revision = machine::revision(&o.root);
    r.date = machine::now();
    r.minutes = (start.elapsed().as_secs_f64() + kept.seconds_before) / 60.0;
    // From here on the pictures move: a run that is killed now must not be resumed without them.
    kept.over();
    publish(&r, &settings.stage, &reports)?;
    kept.done();
    if o.record {
        let at = record::record(&r, &reports)?;
        println!("recorded under {}", at.display());
    }
    Ok(Done {
        page: reports.join("index.html"),
        trouble: r.trouble(),
    })
}

/// One run at a time in a target folder: two would take each other's pictures away. The system lets go of the lock however the run ends.
///
/// # Errors
/// When another run holds it, or the file cannot be made.
fn alone(target: &Path) -> Result<File> {
    std::fs::create_dir_all(target).with_context(|| format!("{} cannot be made", target.display()))?;
    let path = target.join("isobar-report.lock");
    let file = File::create(&path).with_context(|| format!("{} cannot be made", path.display()))?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => bail!(
            "{}: another report is being made here; wait until it ends, or end it",
            path.display()
        ),
        // A file system without locks: then nobody can tell.
        Ok(()) | Err(TryLockError::Error(_)) => Ok(file),
    }
}

/// Methods that no definition of this run names.
fn unasked(all: &[Definition], methods: &[&'static dyn Method]) -> Vec<(String, String)> {
    let ids = methods.iter().map(|m| m.info().id);
    ids.filter(|id| all.iter().all(|d| !d.wants(id)))
        .map(|id| {
            (
                id.to_owned(),
                "no definition of this run names it; the hard cases ask it".to_owned(),
            )
        })
        .collect()
}

/// The definitions named, or all.
fn choose(all: Vec<Definition>, only: &[String]) -> Result<Vec<Definition>> {
    if let Some(name) = only.iter().find(|n| all.iter().all(|d| d.id != **n)) {
        let names: Vec<&str> = all.iter().map(|d| d.id.as_str()).collect();
        bail!("--only {name}: there is no such definition; there are {}", names.join(", "));
    }
    Ok(all.into_iter().filter(|d| only.is_empty() || only.contains(&d.id)).collect())
}

/// Measures a definition, or says why this run leaves it out.
fn one(d: &Definition, o: &Options, methods: &[&'static dyn Method], settings: &Settings) -> Result<Scene> {
    let left_out = d.run == Tier::Full && !o.full && o.only.is_empty();
    if left_out && d.source(&o.root).is_ok() {
        return Ok(Scene {
            id: d.id.clone(),
            group: d.group.clone(),
            title: d.title.clone(),
            skipped: Some("measured with --full only".into()),
            ..Scene::default()
        });
    }
    let quiet = !std::io::stderr().is_terminal();
    let scene = measure::scene(d, methods, settings, &Stop::default()).with_context(|| format!("definition {}", d.id))?;
    if quiet {
        let said = scene.skipped.clone().unwrap_or_else(|| format!("{:.1} s", scene.seconds));
        eprintln!("{:<24} {said}", d.id);
    }
    Ok(scene)
}

/// Methods that drew nothing in any scene, with the first reason.
fn absent(scenes: &[Scene]) -> Vec<(String, String)> {
    let rows = || scenes.iter().flat_map(|s| &s.comparisons).flat_map(|c| &c.rows);
    let mut out: Vec<(String, String)> = Vec::new();
    for r in rows() {
        let never = rows().filter(|x| x.method == r.method).all(|x| x.reason.is_some());
        if let (true, Some(reason)) = (never && out.iter().all(|(m, _)| *m != r.method), &r.reason) {
            out.push((r.method.clone(), reason.clone()));
        }
    }
    out
}

fn progress(steps: u64) -> ProgressBar {
    // Hidden by indicatif itself where standard error is not a terminal.
    let bar = ProgressBar::new(steps);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} ({elapsed})") {
        bar.set_style(style);
    }
    bar
}

/// Writes the files of the page into the stage and moves them into `reports`, the page last: at every moment there is a whole page or none.
fn publish(r: &Report, stage: &Path, reports: &Path) -> Result<()> {
    let text = page::page(r)?;
    let csv = stage.join("csv");
    if csv.exists() {
        std::fs::remove_dir_all(&csv)?;
    }
    tables::write(r, &csv)?;
    steinberger::write(&r.steinberger, &csv.join("imported/steinberger2010"))?;
    let machine: String = r.machine.iter().map(|(k, v)| format!("{k}: {v}\n")).collect();
    let lines = format!(
        "date: {} UTC\ncommand: {}\nrevision: {}\n{machine}",
        r.date, r.command, r.revision
    );
    isobar::output::write_text(&stage.join("machine.txt"), &lines)?;
    isobar::output::write_text(&stage.join("index.html"), &text)?;
    std::fs::create_dir_all(stage.join("files"))?;
    std::fs::create_dir_all(reports).with_context(|| format!("{} cannot be made", reports.display()))?;
    // The old page goes first: it would show the new pictures.
    let _ = std::fs::remove_file(reports.join("index.html"));
    for name in ["files", "csv", "machine.txt", "index.html"] {
        let (from, to) = (stage.join(name), reports.join(name));
        if to.is_dir() {
            std::fs::remove_dir_all(&to)?;
        }
        move_to(&from, &to)?;
    }
    Ok(())
}

/// Renames, or copies and removes where source and target lie on different file systems.
fn move_to(from: &Path, to: &Path) -> Result<()> {
    if std::fs::rename(from, to).is_ok() {
        return Ok(());
    }
    if from.is_dir() {
        std::fs::create_dir_all(to)?;
        for e in std::fs::read_dir(from)? {
            let e = e?.path();
            move_to(&e, &to.join(e.file_name().unwrap_or_default()))?;
        }
        std::fs::remove_dir_all(from)?;
        return Ok(());
    }
    let part = to.with_extension("part");
    std::fs::copy(from, &part).with_context(|| format!("{} cannot be written", part.display()))?;
    std::fs::rename(&part, to)?;
    std::fs::remove_file(from)?;
    Ok(())
}

/// What results of a run depend on: the program, the options, the definitions.
fn key(o: &Options, all: &[Definition]) -> Result<String> {
    let program = std::env::current_exe()
        .and_then(std::fs::read)
        .context("the program cannot read itself")?;
    let text = serde_json::to_string(all)?;
    let data = std::env::var(definitions::DATA_VARIABLE).unwrap_or_default();
    // Transfer functions are files that may be edited between two runs; one that cannot be read is a reason in the page.
    let media: Vec<String> = (all.iter().filter_map(|d| d.medium.as_ref()))
        .map(|m| std::fs::read_to_string(o.root.join(m)).unwrap_or_default())
        .collect();
    let all = format!(
        "{} {} {text} {media:?} {data} {MODELS:?} {}",
        data::sha256(&program),
        o.full,
        std::env::var("VK_DRIVER_FILES").unwrap_or_default()
    );
    Ok(data::sha256(all.as_bytes()))
}

/// Results kept between definitions; of one run only, known by its key.
struct Kept {
    folder: PathBuf,
    /// Seconds spent on the results found.
    seconds_before: f64,
}

impl Kept {
    /// The results of an interrupted run with the same key, or none.
    fn open(folder: &Path, key: &str) -> Result<Self> {
        let mark = folder.join("key");
        let same = std::fs::read_to_string(&mark).is_ok_and(|k| k == key);
        if !same {
            if folder.exists() {
                std::fs::remove_dir_all(folder).with_context(|| format!("{} cannot be removed", folder.display()))?;
            }
            std::fs::create_dir_all(folder).with_context(|| format!("{} cannot be made", folder.display()))?;
            isobar::output::write_text(&mark, key)?;
        }
        let files = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path());
        let scenes: Vec<Scene> = files.filter_map(|f| read(&f)).collect();
        if !scenes.is_empty() {
            eprintln!("going on after {} definitions of the run that was interrupted", scenes.len());
        }
        Ok(Self {
            folder: folder.to_path_buf(),
            seconds_before: scenes.iter().map(|s| s.seconds).sum(),
        })
    }

    /// The kept result of a definition, or a new one, kept.
    fn scene(&self, d: &Definition, measure: impl FnOnce() -> Result<Scene>) -> Result<Scene> {
        let path = self.folder.join(format!("{}.json", d.id));
        if let Some(s) = read(&path) {
            return Ok(s);
        }
        let s = measure()?;
        isobar::output::write_text(&path, &serde_json::to_string(&s)?)?;
        Ok(s)
    }

    /// All is measured: the next run measures anew.
    fn over(&self) {
        let _ = std::fs::remove_file(self.folder.join("key"));
    }

    /// All is in place.
    fn done(&self) {
        self.over();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

fn read(path: &Path) -> Option<Scene> {
    if path.extension().is_none_or(|e| e != "json") {
        return None;
    }
    serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Comparison, Row};

    #[test]
    fn two_reports_in_one_folder_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let first = alone(folder.path()).unwrap();
        let second = alone(folder.path()).unwrap_err().to_string();
        assert!(second.contains("another report"), "{second}");
        drop(first);
        alone(folder.path()).unwrap();
    }

    #[test]
    fn an_interrupted_run_goes_on_and_a_finished_one_starts_anew() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("kept");
        let mut d: Definition = toml::from_str("title='x'\ndata='y'\nisovalues=[1]\nanalysis='a'").unwrap();
        d.id = "one".into();
        let scene = |title: &str| Scene {
            title: title.into(),
            seconds: 2.0,
            ..Scene::default()
        };
        let kept = Kept::open(&folder, "key").unwrap();
        assert_eq!(kept.scene(&d, || Ok(scene("first"))).unwrap().title, "first");
        // interrupted here: the same key finds the result, another one does not
        let again = Kept::open(&folder, "key").unwrap();
        assert_eq!(again.seconds_before, 2.0);
        assert_eq!(again.scene(&d, || bail!("measured twice")).unwrap().title, "first");
        let other = Kept::open(&folder, "other").unwrap();
        assert_eq!(other.scene(&d, || Ok(scene("second"))).unwrap().title, "second");
        other.over();
        let fresh = Kept::open(&folder, "other").unwrap();
        assert_eq!(fresh.scene(&d, || Ok(scene("third"))).unwrap().title, "third");
    }

    #[test]
    fn methods_that_never_draw_are_named_once() {
        let row = |m: &str, reason: Option<&str>| Row {
            method: m.into(),
            reason: reason.map(String::from),
            ..Row::default()
        };
        let s = Scene {
            comparisons: vec![Comparison {
                rows: vec![
                    row("a", None),
                    row("b", Some("no adapter")),
                    row("a", Some("x")),
                    row("b", Some("no adapter")),
                ],
                ..Comparison::default()
            }],
            ..Scene::default()
        };
        assert_eq!(absent(&[s]), [("b".to_owned(), "no adapter".to_owned())]);
    }

    #[test]
    fn trouble_is_what_a_definition_or_a_case_did_not_say() {
        use crate::results::{Matrix, MatrixRow, MatrixTable, Verdict, VerdictKind};
        let cell = |kind| Verdict {
            kind,
            given: "0.5".into(),
            ..Verdict::default()
        };
        let mut r = Report {
            scenes: vec![Scene {
                title: "Gyroid".into(),
                comparisons: vec![Comparison {
                    reconstruction: "trilinear".into(),
                    ..Comparison::default()
                }],
                ..Scene::default()
            }],
            hard: Matrix {
                tables: vec![MatrixTable {
                    columns: ["a", "b", "c"].map(String::from).into(),
                    rows: vec![MatrixRow {
                        id: "B2".into(),
                        cells: [VerdictKind::Right, VerdictKind::Known, VerdictKind::Refused]
                            .map(cell)
                            .into(),
                        ..MatrixRow::default()
                    }],
                    ..MatrixTable::default()
                }],
                ..Matrix::default()
            },
            ..Report::default()
        };
        assert!(r.trouble().is_empty());
        r.scenes[0].comparisons[0]
            .failures
            .push("the oracle finds 3 hits, the definition demands 4".into());
        r.hard.tables[0].rows[0].cells[1].kind = VerdictKind::Wrong;
        r.hard.tables[0].rows[0].cells[2].kind = VerdictKind::Unexpected;
        assert_eq!(
            r.trouble(),
            [
                "Gyroid, trilinear: the oracle finds 3 hits, the definition demands 4",
                "hard case B2, b: wrong (0.5)",
                "hard case B2, c: right, but declared a failure (0.5)"
            ]
        );
    }

    #[test]
    fn methods_that_no_definition_names_are_said() {
        let mut d: Definition = toml::from_str("title='x'\ndata='y'\nisovalues=[1]\nanalysis='a'\nmethods=['march/*']").unwrap();
        let methods = [isobar::method("march/cpu").unwrap(), isobar::method("mc/cpu").unwrap()];
        let names = |d: &Definition| {
            unasked(std::slice::from_ref(d), &methods)
                .into_iter()
                .map(|m| m.0)
                .collect::<Vec<_>>()
        };
        assert_eq!(names(&d), ["mc/cpu"]);
        d.methods.clear();
        assert!(names(&d).is_empty());
    }

    #[test]
    fn a_page_is_put_in_place_whole() {
        let dir = tempfile::tempdir().unwrap();
        let (stage, reports) = (dir.path().join("stage"), dir.path().join("reports"));
        std::fs::create_dir_all(stage.join("files/x")).unwrap();
        std::fs::write(stage.join("files/x/a.png"), b"a").unwrap();
        std::fs::create_dir_all(reports.join("files/old")).unwrap();
        std::fs::write(reports.join("index.html"), "old").unwrap();
        publish(&Report::default(), &stage, &reports).unwrap();
        assert!(
            std::fs::read_to_string(reports.join("index.html"))
                .unwrap()
                .contains("isobar report")
        );
        assert!(reports.join("files/x/a.png").is_file() && !reports.join("files/old").exists());
        assert!(reports.join("machine.txt").is_file());
    }
}
