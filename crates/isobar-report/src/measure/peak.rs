//! Memory of a whole process: each method loads the data, draws one image and reads it out in a process of its own, since the greatest
//! resident size of a process that measures several methods says nothing about one.

use super::{Job, open};
use crate::definitions::Definition;
use crate::results::{Comparison, Peak};
use anyhow::{Context, Result, bail};
use isobar::run::{self, Setup};
use isobar::source::Source;
use isobar_core::{Frame, Request, Stop};
use std::path::Path;
use std::process::{Command, Stdio};

/// Smaller data than this drown in what any process holds.
pub const LEAST: usize = 64 << 20;

/// Measures the default settings of a comparison, where the data are large enough to mean something. What cannot be measured stays out.
pub(super) fn measure(c: &mut Comparison, d: &Definition, source: &Source, full: bool) {
    if source.data.bytes() < LEAST || d.group == "sweep" {
        return;
    }
    for row in c.rows.iter_mut().filter(|r| r.default && r.reason.is_none()) {
        row.peak = child(&d.id, &row.method, &c.reconstruction, full).ok();
    }
}

/// Starts this program again for one method.
fn child(definition: &str, method: &str, reconstruction: &str, full: bool) -> Result<Peak> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["peak", definition, method, reconstruction]);
    if full {
        command.arg("--full");
    }
    let out = command.stdin(Stdio::null()).stderr(Stdio::null()).output()?;
    if !out.status.success() {
        bail!("the process of {method} failed");
    }
    Ok(serde_json::from_slice(&out.stdout)?)
}

/// What such a process does, and the memory it needed.
///
/// # Errors
/// When the definition cannot be opened here, the method refuses or fails, or the system does not tell a process its memory.
pub fn here(d: &Definition, root: &Path, method: &str, reconstruction: &str, full: bool) -> Result<Peak> {
    let name = d.source(root).map_err(anyhow::Error::msg)?;
    let scale = if full && d.doubles() { 2 } else { 1 };
    let (source, surfaces, view) = open(d, &name, d.size.map(|n| n * scale))?;
    let told = || isobar::machine::peak_bytes().context("this system does not tell a process its memory");
    let loaded = told()?;
    // Linux forgets the greatest resident size so far (proc(5), clear_refs); where it does not, drawing is charged with loading.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
    let method = isobar::method(method)?;
    let setup = Setup {
        method,
        data: &source.data,
        surfaces: &surfaces,
        medium: None,
        view: &view,
        request: Request {
            knobs: Job::knobs(method, reconstruction),
            ..Request::default()
        },
    };
    let mut prepared = run::prepare(&setup)?;
    prepared.render(&Stop::default())?;
    let mut frame = Frame::default();
    prepared.renderer().read(&mut frame)?;
    let drawn = told()?;
    Ok(Peak {
        process: drawn.max(loaded),
        loaded,
        drawn,
        data: source.data.bytes() as u64,
        frame: frame.bytes() as u64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn a_process_needs_its_data_and_its_frame_at_least() {
        let mut d: Definition =
            toml::from_str("title='x'\ndata='synthetic:sphere,n=96'\nisovalues=[1]\nanalysis='a'\nsize=[64,48]").unwrap();
        d.id = "x".into();
        let p = here(&d, Path::new("."), "march/cpu", "trilinear", false).unwrap();
        assert_eq!(p.data, 4 * 96 * 96 * 96);
        assert!(p.frame >= 64 * 48 * 37 && p.loaded >= p.data, "{p:?}");
        assert!(
            p.process >= p.loaded.max(p.drawn) && p.drawn >= p.data + p.frame && p.ratio() > 1.0,
            "{p:?}"
        );
    }
}
