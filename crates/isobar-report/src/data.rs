//! The shipped data: listed, verified by sha256; and the generated data: seeded, made once, kept under `bench-data/cache`.

use crate::sdf::SignedDistance;
use anyhow::{Context, Result, bail};
use flate2::read::GzDecoder;
use isobar_core::{DMat3, DVec3, Data, Grid, Samples};
use rayon::prelude::*;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::io::Read;
use std::path::Path;

/// `bench-data/MANIFEST.toml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Shipped files.
    pub file: Vec<Shipped>,
    /// Files that [`generate`] makes.
    pub generated: Vec<Generated>,
}

/// A shipped file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shipped {
    /// Path from `bench-data`.
    pub path: String,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
    /// Package, version and path inside it.
    pub source: String,
    /// SPDX identifier.
    pub licence: String,
    /// File with the licence's text, from `bench-data`.
    pub licence_file: String,
    /// How it was made from the package's file.
    pub derivation: String,
    /// SHA-256 of the decompressed content, where the file was compressed again.
    #[serde(default)]
    pub payload_sha256: Option<String>,
    /// What it shows.
    pub description: String,
    /// Isovalues of interest, data units.
    #[serde(default)]
    pub isovalues: Vec<f64>,
}

/// A generated file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Generated {
    /// Signed distance of a triangle mesh on n^3 points, its longest side 90 % of the box, negative inside.
    SignedDistance {
        /// Path from `bench-data`.
        path: String,
        /// The mesh, from `bench-data`.
        mesh: String,
        /// Samples per axis.
        n: usize,
        /// What it shows.
        description: String,
        /// Isovalues of interest.
        isovalues: Vec<f64>,
    },
    /// A field of the contract.
    Synthetic {
        /// Path from `bench-data`.
        path: String,
        /// The text after `synthetic:`.
        spec: String,
        /// What it shows.
        description: String,
        /// Isovalues of interest.
        isovalues: Vec<f64>,
    },
    /// White noise, filtered once by (1, 2, 1)/4 along each axis.
    EntropicNoise {
        /// Path from `bench-data`.
        path: String,
        /// Samples per axis.
        n: usize,
        /// Seed.
        seed: u64,
        /// What it shows.
        description: String,
        /// Isovalues of interest.
        isovalues: Vec<f64>,
    },
}

impl Generated {
    /// Path from `bench-data`.
    #[must_use]
    pub fn path(&self) -> &str {
        match self {
            Self::SignedDistance { path, .. } | Self::Synthetic { path, .. } | Self::EntropicNoise { path, .. } => path,
        }
    }

    /// What it shows.
    #[must_use]
    pub fn description(&self) -> &str {
        match self {
            Self::SignedDistance { description, .. }
            | Self::Synthetic { description, .. }
            | Self::EntropicNoise { description, .. } => description,
        }
    }
}

/// Reads the manifest of a `bench-data` folder.
///
/// # Errors
/// One line that names the file and what is wrong in it.
pub fn manifest(folder: &Path) -> Result<Manifest> {
    let path = folder.join("MANIFEST.toml");
    let text = std::fs::read_to_string(&path).with_context(|| format!("{} cannot be read", path.display()))?;
    toml::from_str(&text).with_context(|| format!("{} is not a manifest", path.display()))
}

/// SHA-256, hexadecimal.
#[must_use]
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}

/// Checks a shipped file and its licence; the error is what is wrong.
///
/// # Errors
/// When the file is absent, its digest or that of its content is another, or the licence text is missing.
pub fn verify(folder: &Path, f: &Shipped) -> Result<()> {
    let path = folder.join(&f.path);
    let bytes =
        std::fs::read(&path).with_context(|| format!("{} cannot be read; restore it from the repository", path.display()))?;
    let found = sha256(&bytes);
    if found != f.sha256 {
        bail!(
            "{}: its sha256 is {found}, not {}; restore it from the repository",
            path.display(),
            f.sha256
        );
    }
    if let Some(payload) = &f.payload_sha256 {
        let mut content = Vec::new();
        GzDecoder::new(&bytes[..])
            .read_to_end(&mut content)
            .with_context(|| format!("{} is not gzip", path.display()))?;
        let found = sha256(&content);
        if found != *payload {
            bail!("{}: the sha256 of its content is {found}, not {payload}", path.display());
        }
    }
    let licence = folder.join(&f.licence_file);
    if !licence.is_file() {
        bail!("{}: its licence text {} is missing", path.display(), licence.display());
    }
    Ok(())
}

/// Lists and verifies what is shipped; generates what is missing where `make` is set. Prints a line per file; `false` where one is wrong.
///
/// # Errors
/// When the manifest cannot be read or a file cannot be generated.
pub fn list(folder: &Path, make: bool) -> Result<bool> {
    let m = manifest(folder)?;
    let mut ok = true;
    for f in &m.file {
        match verify(folder, f) {
            Ok(()) => println!("ok         {:<24} {:<12} {}", f.path, f.licence, f.description),
            Err(e) => {
                ok = false;
                println!("WRONG      {:<24} {e:#}", f.path);
            }
        }
    }
    for g in &m.generated {
        let path = folder.join(g.path());
        let state = if path.is_file() {
            "cached"
        } else if make {
            println!("generating {:<24} {}", g.path(), g.description());
            generate(folder, g)?;
            "generated"
        } else {
            "absent"
        };
        println!("{state:<10} {:<24} {}", g.path(), g.description());
    }
    Ok(ok)
}

/// Makes those of the generated files that are wanted and not there: `wanted` is asked for the path from `bench-data`. Tells `say` what takes long.
///
/// # Errors
/// As [`generate`].
pub fn make(folder: &Path, wanted: &dyn Fn(&str) -> bool, say: &dyn Fn(&str)) -> Result<()> {
    for g in &manifest(folder)?.generated {
        if wanted(g.path()) && !folder.join(g.path()).is_file() {
            say(g.path());
            generate(folder, g)?;
        }
    }
    Ok(())
}

/// Makes one generated file; written to a temporary name first.
///
/// # Errors
/// When the mesh cannot be read or the file cannot be written.
pub fn generate(folder: &Path, g: &Generated) -> Result<()> {
    let grid = match g {
        Generated::SignedDistance { mesh, n, .. } => distances(&folder.join(mesh), *n)?,
        Generated::Synthetic { spec, .. } => {
            let synthetic: isobar_fields::Synthetic = spec.parse()?;
            match synthetic.data()? {
                Data::Grid(grid) => grid,
                other => bail!("{spec} is {}, not a grid", other.kind()),
            }
        }
        Generated::EntropicNoise { n, seed, .. } => entropic(*n, *seed)?,
    };
    let path = folder.join(g.path());
    if let Some(parent) = path.parent() {
        std::fs::create_dir_all(parent).with_context(|| format!("{} cannot be made", parent.display()))?;
    }
    isobar_io::write_nrrd(&path, &grid)?;
    Ok(())
}

/// Signed distance on a cube of n^3 points around the mesh.
fn distances(mesh: &Path, n: usize) -> Result<Grid> {
    let mesh = isobar_io::load_mesh(mesh)?;
    let d = SignedDistance::new(mesh.points, mesh.triangles)?;
    let (lo, hi) = d.bounds();
    let side = (hi - lo).max_element() / 0.9;
    let spacing = side / (n as f64 - 1.0);
    let origin = (lo + hi) * 0.5 - DVec3::splat(side * 0.5);
    let samples = d.sample(n, origin, spacing);
    Ok(Grid::new(
        [n; 3],
        DVec3::splat(spacing),
        origin,
        DMat3::IDENTITY,
        Samples::F32(samples.into()),
    )?)
}

/// Seeded white noise filtered once by (1, 2, 1)/4 along each axis (the index clamped at the ends), on [-1, 1]^3.
///
/// "Entropic" data are those whose filtered field is not adequately sampled by a ray with a fixed step (Knoll et al. 2009, section 6.2):
/// here every cell has detail near the sampling limit. The white noise is uniform in [0, 1), a SplitMix64 hash of seed and index, so it
/// does not depend on the order of evaluation.
///
/// # Errors
/// When n is too small for a grid.
pub fn entropic(n: usize, seed: u64) -> Result<Grid> {
    let mut field: Vec<f32> = (0..n * n * n).into_par_iter().map(|i| uniform(seed, i as u64)).collect();
    for axis in 0..3 {
        let stride = n.pow(axis);
        let old = field.clone();
        field.par_iter_mut().enumerate().for_each(|(i, v)| {
            let at = i / stride % n;
            let before = if at == 0 { i } else { i - stride };
            let after = if at + 1 == n { i } else { i + stride };
            *v = 0.25 * old[before] + 0.5 * old[i] + 0.25 * old[after];
        });
    }
    let spacing = DVec3::splat(2.0 / (n as f64 - 1.0));
    Ok(Grid::new(
        [n; 3],
        spacing,
        DVec3::NEG_ONE,
        DMat3::IDENTITY,
        Samples::F32(field.into()),
    )?)
}

/// SplitMix64's output function, as a number in [0, 1).
fn uniform(seed: u64, index: u64) -> f32 {
    let mut z = seed
        .wrapping_mul(0x9E37_79B9_7F4A_7C15)
        .wrapping_add((index + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^= z >> 31;
    (z >> 40) as f32 / (1u64 << 24) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder() -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bench-data")
    }

    #[test]
    fn the_shipped_data_are_what_the_manifest_says() {
        let m = manifest(&folder()).unwrap();
        let mut bytes = 0;
        for f in &m.file {
            verify(&folder(), f).unwrap();
            bytes += std::fs::metadata(folder().join(&f.path)).unwrap().len();
        }
        assert!(bytes < 25_000_000, "{bytes}");
        assert!(m.file.len() >= 5 && m.generated.len() == 4);
    }

    #[test]
    fn a_changed_file_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let m = manifest(&folder()).unwrap();
        let f = &m.file[0];
        std::fs::write(dir.path().join(&f.path), b"other").unwrap();
        let e = verify(dir.path(), f).unwrap_err().to_string();
        assert!(e.contains("sha256") && e.contains(&f.path), "{e}");
    }

    #[test]
    fn noise_is_seeded_filtered_and_mapped_to_the_unit_cube() {
        let (a, b) = (entropic(16, 1).unwrap(), entropic(16, 1).unwrap());
        assert_eq!(a, b);
        assert_ne!(a.samples, entropic(16, 2).unwrap().samples);
        let (lo, hi) = a.samples.range().0.unwrap();
        assert!(lo > 0.1 && hi < 0.9 && lo < 0.4 && hi > 0.6, "{lo} {hi}");
        assert_eq!(a.domain().world_bounds().0, DVec3::NEG_ONE);
    }
}
