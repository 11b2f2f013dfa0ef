//! The certified hits of definitions, for the tables `expect` in their files: numbers that nobody types from memory.

use crate::definitions::{self, Definition};
use crate::measure;
use anyhow::{Context, Result, bail};
use isobar::truth::Truths;
use isobar_core::{Data, Function, Stage, Stop};
use isobar_fields::{HexField, Reconstruction, TetLinear};
use std::path::Path;
use std::sync::Arc;

/// What the oracle says of one reconstruction at one image size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Count {
    /// Pixels with a certified first hit.
    pub hits: usize,
    /// Pixels that f32 data cannot decide.
    pub undecidable: usize,
    /// Pixels the oracle itself could not decide: must be 0.
    pub unresolved: usize,
}

/// The certified count of a reconstruction; truths are kept in `folder`.
///
/// # Errors
/// When the data cannot be opened, are of another kind than grid, tetrahedra or hexahedra, or the oracle does not answer.
pub fn count(d: &Definition, root: &Path, folder: &Path, reconstruction: &str, size: [usize; 2]) -> Result<Count> {
    let name = d.source(root).map_err(anyhow::Error::msg)?;
    let (source, surfaces, view) = measure::open(d, &name, size)?;
    let function: Arc<dyn Function> = match &*source.data {
        Data::Grid(grid) => reconstruction.parse::<Reconstruction>()?.of(grid, Stage::Stored)?,
        Data::Tets(mesh) => Arc::new(TetLinear::new(mesh)?),
        Data::Hexes(patches) => Arc::new(HexField::new(patches)?),
        other => bail!("{} is {}, which the definitions do not count yet", d.data, other.kind()),
    };
    let truths = Truths::new(source.hash(), Some(folder.to_path_buf()));
    let truth = truths
        .get(&function, &surfaces, &view, &Stop::default())
        .context("the certified truth")?;
    Ok(Count {
        hits: truth.hits(),
        undecidable: truth.undecidable(),
        unresolved: truth.pixels.iter().filter(|p| p.unresolved).count(),
    })
}

/// Prints the counts of all definitions whose data are here, as they stand in `expect`, and those that differ from it.
///
/// # Errors
/// When the definitions cannot be read.
pub fn print(root: &Path, folder: &Path, only: &[String]) -> Result<()> {
    for d in definitions::read_all(&root.join("bench-data/definitions"))? {
        if !only.is_empty() && !only.contains(&d.id) {
            continue;
        }
        // Of a medium there are no hits to demand: which surfaces it has is for the method to say.
        for r in d.reconstructions.iter().filter(|_| d.medium.is_none()) {
            let doubled = d.doubles().then(|| d.size.map(|n| 2 * n));
            for (key, size) in [("hits", Some(d.size)), ("full", doubled)] {
                let Some(size) = size else { continue };
                let line = match count(&d, root, folder, r, size) {
                    Err(e) => format!("# {e:#}"),
                    Ok(c) if c.unresolved > 0 => format!("# {} pixels are not decided", c.unresolved),
                    Ok(c) => {
                        let said = match d.expected(r, size) {
                            Some(e) if e == c.hits as u64 => "as the definition says".to_owned(),
                            Some(e) => format!("the definition says {e}"),
                            None => "the definition says nothing".to_owned(),
                        };
                        format!("{key} = {} # {said}; {} undecidable", c.hits, c.undecidable)
                    }
                };
                println!("{}.{r}: {line}", d.id);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_is_counted_at_both_sizes() {
        let dir = tempfile::tempdir().unwrap();
        let text = "title='x'\ndata='synthetic:sphere,n=24'\nisovalues=[1]\nview='bench'\nanalysis='a'";
        let d: Definition = toml::from_str(text).unwrap();
        let at = |size| count(&d, Path::new("."), dir.path(), "trilinear", size).unwrap();
        let (small, large) = (at([48, 36]), at([96, 72]));
        assert_eq!((small.unresolved, large.unresolved), (0, 0));
        assert!(
            small.hits > 200 && large.hits.abs_diff(4 * small.hits) < small.hits / 4,
            "{small:?} {large:?}"
        );
    }
}
