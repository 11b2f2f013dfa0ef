//! `isobar compare`: every method that can, side by side, in a folder with a page.

use crate::cli::{Answer, CompareArgs};
use crate::compare::{self, Comparison, Scene, Settings};
use crate::output::{self, write_text};
use crate::truth::{Truths, cache_dir};
use crate::{progress, settings, surfaces, view_spec};
use anyhow::{Context, Result, anyhow, ensure};
use isobar_core::{Method, Stop};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// No further round of timing is begun after this long.
const BUDGET: Duration = Duration::from_secs(300);

/// Compares, and writes the folder when all is measured. The answer is no where no method could draw, or none is within `--max-error`.
///
/// # Errors
/// When arguments, data or the folder cannot be used; nothing is left in the folder then.
pub fn run(args: &CompareArgs, command: &[String]) -> Result<Answer> {
    let surfaces = surfaces::parse_isovalues(&args.isovalue)?;
    let knobs = settings::parse_knobs(&args.draw.set)?;
    let methods = methods(args)?;
    if let Some(name) = knobs
        .0
        .keys()
        .find(|n| methods.iter().all(|m| m.info().knobs.iter().all(|k| k.name != n.as_str())))
    {
        anyhow::bail!("--set {name}: none of the methods has this knob; see isobar methods");
    }
    let max_error = args
        .max_error
        .as_deref()
        .map(|s| view_spec::number("--max-error", s))
        .transpose()?;
    ensure!(
        max_error.is_none_or(|e| e > 0.0),
        "--max-error {}: give a length above 0, in voxels",
        args.max_error.as_deref().unwrap_or_default()
    );
    ensure!(args.repeat >= 1, "--repeat 0: nothing would be timed; give 1 or more");
    args.view.validate()?;
    args.view.require_open_cuts()?;
    super::request(&args.draw, knobs.clone(), isobar_core::Channels::RGBA, 1)?;
    let folder = probe(&args.output)?;
    let (source, _) = super::open(&args.data)?;
    source.require_finite()?;
    let view = args.view.view(source.bounds())?;
    let stop = Stop::default();
    let comparison = progress::watch("comparing", &stop, || {
        let scene = Scene {
            source: &source,
            surfaces: &surfaces,
            view: &view,
            knobs: &knobs,
            threads: args.draw.threads,
        };
        let how = Settings {
            max_error,
            repeats: args.repeat,
            budget: BUDGET,
        };
        compare::compare(&methods, &scene, how, &Truths::new(source.hash(), cache_dir()), &stop)
    })?;
    let isovalues: Vec<String> = surfaces
        .iter()
        .filter_map(isobar_core::Surface::value)
        .map(|v| v.to_string())
        .collect();
    let scene = format!(
        "{}, isovalue {}, {} x {} pixels",
        source.name,
        isovalues.join(", "),
        view.width,
        view.height
    );
    write(&folder, &comparison, max_error, &scene, command)?;
    let verdict = compare::verdict(&comparison, max_error).join("\n");
    Ok(Answer {
        text: format!(
            "{}\n{verdict}\nwrote {}\n",
            compare::table_text(&comparison.rows),
            args.output.join("index.html").display()
        ),
        warnings: super::warnings(&source, &surfaces),
        no: nothing(&comparison, max_error),
    })
}

/// Whether the answer is no: nothing was drawn, or nothing lies within the error asked for.
fn nothing(c: &Comparison, max_error: Option<f64>) -> bool {
    c.rows.iter().all(|r| r.result.is_err()) || max_error.is_some() && c.ranking.is_empty()
}

fn methods(args: &CompareArgs) -> Result<Vec<&'static dyn Method>> {
    if args.methods.is_empty() {
        return Ok(crate::methods());
    }
    if let Some((_, twice)) =
        (args.methods.iter().enumerate()).find(|(i, m)| args.methods[..*i].iter().any(|o| o.trim() == m.trim()))
    {
        anyhow::bail!("--methods {}: named twice; name each method once", twice.trim());
    }
    args.methods
        .iter()
        .map(|id| crate::method(id.trim()).map_err(|e| anyhow!("{}", e.to_string().replace("--method ", "--methods "))))
        .collect()
}

/// The folder, links followed, which can be made or takes new files.
fn probe(dir: &Path) -> Result<PathBuf> {
    let name = dir.display();
    ensure!(!dir.is_file(), "-o {name}: is a file; name a folder");
    if dir.is_dir() {
        output::probe_folder("-o", dir, dir)?;
        return Ok(dir.to_owned());
    }
    output::probe("-o", dir)?;
    output::destination("-o", dir)
}

/// Everything is made in a temporary folder beside the one wanted and moved when complete.
fn write(dir: &Path, c: &Comparison, max_error: Option<f64>, scene: &str, command: &[String]) -> Result<()> {
    let what = || format!("-o {}", dir.display());
    let _whole = crate::interrupt::writing()?;
    let parent = match dir.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    // Inside an existing folder (its parent may be closed to us), else beside the new one.
    let place = if dir.is_dir() { dir } else { parent };
    let temporary = tempfile::Builder::new()
        .prefix(".isobar-")
        .tempdir_in(place)
        .with_context(what)?;
    let at = |name: &str| temporary.path().join(name);
    write_text(&at("table.csv"), &compare::table_csv(c)?)?;
    for i in c.shown() {
        let row = &c.rows[i];
        let Ok(m) = &row.result else { continue };
        let stem = row.method.id.replace('/', "-");
        save(&at(&format!("{stem}.png")), &m.pictures.image)?;
        if !m.pictures.errors.is_empty() {
            save(&at(&format!("{stem}-error.png")), &m.pictures.errors)?;
        }
    }
    write_text(&at("index.html"), &compare::page(c, max_error, scene, command)?)?;
    if !dir.is_dir() {
        std::fs::create_dir(dir).with_context(what)?;
    }
    // The page comes last: where it is, its files are.
    let mut names: Vec<_> = std::fs::read_dir(temporary.path())
        .with_context(what)?
        .collect::<std::io::Result<Vec<_>>>()
        .with_context(what)?
        .iter()
        .map(std::fs::DirEntry::file_name)
        .collect();
    names.sort_by_key(|n| n == "index.html");
    for name in names {
        std::fs::rename(temporary.path().join(&name), dir.join(&name)).with_context(what)?;
    }
    Ok(())
}

fn save(path: &Path, bytes: &[u8]) -> Result<()> {
    output::atomically(path, |w| Ok(std::io::Write::write_all(w, bytes)?))
}
