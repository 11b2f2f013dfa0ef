//! Definitions of benchmarks: TOML files under `bench-data/definitions/`, one scene each. The code knows no particular benchmark.
//!
//! The folder is the purpose: `curated/` the public picture, `sweep/` growth with size, `hard/` numerical trouble, `imported/` scenes of
//! papers. The file's name is the definition's. FORMAT: see [`Definition`]; unknown keys are refused.

use crate::hard::matches;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Folders of definitions, in the order of the page.
pub const GROUPS: [&str; 4] = ["curated", "sweep", "hard", "imported"];

/// The variable that names a folder of further data.
pub const DATA_VARIABLE: &str = "ISOBAR_DATA";

/// When a definition is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum Tier {
    /// In every run.
    #[default]
    Plain,
    /// Only with `--full`.
    Full,
}

/// A view: a name of the contract, or a camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub enum ViewSpec {
    /// `bench`, `default`, `+x`, `-x`, `+y`, `-y`, `+z`, `-z`.
    Name(String),
    /// A perspective camera.
    Camera {
        /// World position.
        eye: [f64; 3],
        /// World point in the middle.
        target: [f64; 3],
        /// Upward.
        up: [f64; 3],
        /// Vertical field of view, degrees.
        #[serde(default = "forty")]
        fov: f64,
    },
}

fn forty() -> f64 {
    40.0
}

impl Default for ViewSpec {
    fn default() -> Self {
        Self::Name("default".into())
    }
}

/// What the oracle must find: pixels with a certified first hit. Filled from what `isobar-report counts` prints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// At the definition's own size.
    pub hits: u64,
    /// At twice the width and height, which `--full` measures.
    #[serde(default)]
    pub full: Option<u64>,
}

/// Wrong pixels a method may have at its default setting before the row is marked; those beyond are reported as a failure.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
pub struct Allow {
    /// Missed hits.
    pub missed: u64,
    /// False hits.
    #[serde(rename = "false")]
    pub false_hits: u64,
    /// Hits on a later root.
    pub wrong_root: u64,
    /// Hits of another surface.
    pub wrong_surface: u64,
    /// Why these are known.
    pub reason: String,
}

/// One benchmark.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// File name without `.toml`; not in the file.
    #[serde(skip_deserializing)]
    pub id: String,
    /// Folder; not in the file.
    #[serde(skip_deserializing)]
    pub group: String,
    /// Title for people.
    pub title: String,
    /// DATA of the command line: `synthetic:...`, a path from the repository's root, or one that starts with `$ISOBAR_DATA/`.
    pub data: String,
    /// Field of data with several.
    #[serde(default)]
    pub field: Option<String>,
    /// Isovalues, data units. Several are drawn together, each opaque. None only where there is a medium.
    #[serde(default)]
    pub isovalues: Vec<f64>,
    /// Transfer function of the medium: a file from the repository's root, as `--tf` takes it. Methods are then compared by their colours.
    #[serde(default)]
    pub medium: Option<String>,
    /// The view.
    #[serde(default)]
    pub view: ViewSpec,
    /// Width and height of the image.
    #[serde(default = "small")]
    pub size: [usize; 2],
    /// When it is measured.
    #[serde(default)]
    pub run: Tier,
    /// Reconstructions measured, each a comparison of its own; for data that are no grid a name of what the elements are, drawn as they are.
    #[serde(default = "trilinear")]
    pub reconstructions: Vec<String>,
    /// Methods by id, or its beginning followed by `*`; empty: all that can draw the data. Definitions of every run name theirs, so that a new method
    /// does not make it longer unasked.
    #[serde(default)]
    pub methods: Vec<String>,
    /// Settings measured, by method id or its beginning followed by `*`: each a list of `knob=value` parted by spaces. In place of
    /// those of `sweeps.toml`; a method with neither is swept over its own knob.
    #[serde(default)]
    pub sweep: BTreeMap<String, Vec<String>>,
    /// Certified counts by reconstruction.
    #[serde(default)]
    pub expect: BTreeMap<String, Expect>,
    /// Known wrong pixels by `method reconstruction` or `method`, either also as its beginning followed by `*`.
    #[serde(default)]
    pub allow: BTreeMap<String, Allow>,
    /// What the scene shows and what came out of it.
    pub analysis: String,
}

fn small() -> [usize; 2] {
    [512, 384]
}

fn trilinear() -> Vec<String> {
    vec!["trilinear".into()]
}

impl Definition {
    /// Reads one file.
    ///
    /// # Errors
    /// One line that names the file and what is wrong in it.
    pub fn read(path: &Path, group: &str) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| format!("{} cannot be read", path.display()))?;
        let mut d: Self = toml::from_str(&text).with_context(|| format!("{} is not a definition", path.display()))?;
        d.id = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        group.clone_into(&mut d.group);
        d.check().with_context(|| format!("{} is not a definition", path.display()))?;
        Ok(d)
    }

    fn check(&self) -> Result<()> {
        if self.isovalues.is_empty() && self.medium.is_none() || self.isovalues.iter().any(|v| !v.is_finite()) {
            bail!("isovalues must be one or more finite numbers, where there is no medium");
        }
        if self.size.contains(&0) {
            bail!("size must be two numbers above 0");
        }
        if self.reconstructions.is_empty() {
            bail!("reconstructions must name at least one");
        }
        if self.analysis.trim().is_empty() {
            bail!("analysis must say what the scene shows");
        }
        if self.expect.values().any(|e| e.full.is_some()) && !self.doubles() {
            bail!("expect.full is never checked: scenes of sweep/ and imported/ keep their size");
        }
        if let Some((m, _)) = self.sweep.iter().find(|(_, s)| s.is_empty()) {
            bail!("the sweep of {m} has no settings");
        }
        Ok(())
    }

    /// Whether `--full` doubles the width and height: scenes of papers and of growth have the sizes they are compared at.
    #[must_use]
    pub fn doubles(&self) -> bool {
        !matches!(self.group.as_str(), "sweep" | "imported")
    }

    /// Whether a method is to be measured.
    #[must_use]
    pub fn wants(&self, method: &str) -> bool {
        self.methods.is_empty() || self.methods.iter().any(|w| matches(w, method))
    }

    /// The hits demanded of a reconstruction at an image size.
    #[must_use]
    pub fn expected(&self, reconstruction: &str, size: [usize; 2]) -> Option<u64> {
        let e = self.expect.get(reconstruction)?;
        if size == self.size {
            Some(e.hits)
        } else {
            e.full.filter(|_| size == self.size.map(|n| 2 * n))
        }
    }

    /// The data as `isobar` takes it, with `$ISOBAR_DATA` and the root filled in; `Err` is the reason it cannot be measured here.
    ///
    /// # Errors
    /// The line shown in the page in place of numbers.
    pub fn source(&self, root: &Path) -> Result<String, String> {
        if self.data.starts_with("synthetic:") {
            return Ok(self.data.clone());
        }
        let path = match self.data.strip_prefix("$ISOBAR_DATA/") {
            Some(rest) => match std::env::var_os(DATA_VARIABLE) {
                Some(folder) if !folder.is_empty() => PathBuf::from(folder).join(rest),
                _ => return Err(format!("{DATA_VARIABLE} is not set: it names a folder with {rest}")),
            },
            None => root.join(&self.data),
        };
        if path.is_file() {
            Ok(path.display().to_string())
        } else if self.data.starts_with("bench-data/cache/") {
            Err(format!("{} is not generated yet: cargo xtask data", self.data))
        } else {
            Err(format!("{} is not there", self.data))
        }
    }

    /// The settings of a method, where the definition or `sweeps.toml` says any.
    #[must_use]
    pub fn settings(&self, method: &str) -> Option<&Vec<String>> {
        self.sweep
            .get(method)
            .or_else(|| self.sweep.iter().rev().find(|(k, _)| matches(k, method)).map(|(_, s)| s))
    }

    /// The wrong pixels allowed to a method under a reconstruction.
    #[must_use]
    pub fn allowed(&self, method: &str, reconstruction: &str) -> Allow {
        let both = format!("{method} {reconstruction}");
        let exact = self.allow.get(&both).or_else(|| self.allow.get(method));
        // Keys are sorted: the longest beginning that fits comes last.
        let like = || self.allow.iter().rev().find(|(k, _)| matches(k, &both)).map(|(_, a)| a);
        exact.or_else(like).cloned().unwrap_or_default()
    }
}

/// All definitions below `folder`, group by group, by file name.
///
/// # Errors
/// When a folder or a file cannot be read, or two definitions have one name.
pub fn read_all(folder: &Path) -> Result<Vec<Definition>> {
    let mut all: Vec<Definition> = Vec::new();
    let sweeps = folder.join("sweeps.toml");
    let common: BTreeMap<String, Vec<String>> = if sweeps.is_file() {
        let text = std::fs::read_to_string(&sweeps).with_context(|| format!("{} cannot be read", sweeps.display()))?;
        toml::from_str(&text).with_context(|| format!("{} holds no settings", sweeps.display()))?
    } else {
        BTreeMap::new()
    };
    for group in GROUPS {
        for path in toml_files(&folder.join(group))? {
            let mut d = Definition::read(&path, group)?;
            for (method, settings) in &common {
                d.sweep.entry(method.clone()).or_insert_with(|| settings.clone());
            }
            if let Some(other) = all.iter().find(|o| o.id == d.id) {
                bail!(
                    "{}: {}/{} has the same name; rename one",
                    path.display(),
                    other.group,
                    other.id
                );
            }
            all.push(d);
        }
    }
    // Within a group, what every run measures comes first.
    all.sort_by_key(|d| (GROUPS.iter().position(|g| *g == d.group), d.run == Tier::Full));
    Ok(all)
}

/// The `.toml` files of a folder, by name; none where the folder does not exist.
///
/// # Errors
/// When the folder cannot be read.
pub fn toml_files(folder: &Path) -> Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(folder).with_context(|| format!("{} cannot be read", folder.display()))?;
    let mut files: Vec<_> = entries
        .flatten()
        .map(|e| e.path())
        .filter(|p| p.extension().is_some_and(|e| e == "toml"))
        .collect();
    files.sort();
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Definition> {
        let d: Definition = toml::from_str(text)?;
        d.check()?;
        Ok(d)
    }

    #[test]
    fn a_definition_has_defaults_and_refuses_what_it_does_not_know() {
        let d = parse(
            "title='x'\ndata='synthetic:gyroid,n=9'\nisovalues=[0.2]\nanalysis='a'\n[allow.'march/cpu']\nmissed=3\nfalse=1",
        )
        .unwrap();
        assert_eq!(
            (d.size, d.run, &d.reconstructions[..]),
            ([512, 384], Tier::Plain, &["trilinear".to_owned()][..])
        );
        assert_eq!(
            (d.allowed("march/cpu", "cubic").missed, d.allowed("mc/cpu", "cubic").missed),
            (3, 0)
        );
        let d = parse(
            "title='x'\ndata='y'\nisovalues=[1]\nanalysis='a'\nmethods=['march/*','mc/cpu']\n[expect.trilinear]\nhits=3\nfull=12",
        )
        .unwrap();
        assert_eq!(["march/gpu", "mc/cpu", "octree/cpu"].map(|m| d.wants(m)), [true, true, false]);
        let expected = |r, size| d.expected(r, size);
        assert_eq!(expected("trilinear", [512, 384]), Some(3));
        assert_eq!(expected("trilinear", [1024, 768]), Some(12));
        assert_eq!(
            (expected("trilinear", [100, 100]), expected("cubic", [512, 384])),
            (None, None)
        );
        assert!(parse("title='x'\ndata='y'\nisovalues=[]\nanalysis='a'").is_err());
        assert!(parse("title='x'\ndata='y'\nmedium='m.toml'\nanalysis='a'").is_ok());
        assert!(parse("title='x'\ndata='y'\nisovalues=[1]\nanalysis='a'\nisovalue=1").is_err());
        let d = parse("title='x'\ndata='y'\nisovalues=[1]\nanalysis='a'\nview={eye=[1,2,3],target=[0,0,0],up=[0,0,1]}").unwrap();
        assert!(matches!(d.view, ViewSpec::Camera { fov: 40.0, .. }));
    }

    #[test]
    fn absent_data_is_a_reason() {
        let mut d = parse("title='x'\ndata='bench-data/none.nrrd'\nisovalues=[1]\nanalysis='a'").unwrap();
        assert!(d.source(Path::new("/nowhere")).unwrap_err().contains("not there"));
        d.data = "bench-data/cache/x.nrrd".into();
        assert!(d.source(Path::new("/nowhere")).unwrap_err().contains("cargo xtask data"));
    }

    #[test]
    fn the_shipped_definitions_read() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bench-data/definitions");
        let all = read_all(&folder).unwrap();
        assert!(all.iter().filter(|d| d.group == "curated").count() >= 10);
        for d in &all {
            assert!(d.run == Tier::Full || !d.methods.is_empty(), "{} names no methods", d.id);
            assert!(d.methods.iter().all(|m| m.contains('/')), "{}", d.id);
            for r in &d.reconstructions {
                let e = d.expect.get(r);
                assert!(
                    d.medium.is_some() || e.is_some_and(|e| e.hits > 0),
                    "{} has no expected hits of {r}",
                    d.id
                );
                assert!(
                    !d.doubles() || e.is_none() || e.is_some_and(|e| e.full.is_some()),
                    "{} has none at twice the size, {r}",
                    d.id
                );
            }
        }
        // Isovalues of whole-number data end in .5 in the public picture: an isovalue equal to data values makes plateaus.
        for d in all
            .iter()
            .filter(|d| d.group == "curated" && d.data.starts_with("$ISOBAR_DATA"))
        {
            for v in &d.isovalues {
                assert_eq!(v.rem_euclid(1.0), 0.5, "{}", d.id);
            }
        }
    }
}
