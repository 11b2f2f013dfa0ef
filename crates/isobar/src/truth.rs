//! Certified frames, computed once and kept: a file per data, function, isovalues and view.

use crate::output;
use crate::source::hexadecimal;
use anyhow::Result;
use isobar_core::{DVec3, Function, Stop, Surface, View};
use isobar_oracle::Truth;
use sha2::{Digest, Sha256};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Where certified frames are kept: `$ISOBAR_CACHE`; where that is not set, `target/isobar-truth` of the Cargo workspace around the
/// current folder; outside of one, `isobar/truth` in the user's cache folder (`$XDG_CACHE_HOME`, else `$HOME/.cache`). `None` (nothing
/// is kept) where `$ISOBAR_CACHE` is empty or no folder is known. Files there may be deleted at any time.
#[must_use]
pub fn cache_dir() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).map(PathBuf::from);
    if let Some(dir) = set("ISOBAR_CACHE") {
        return (!dir.as_os_str().is_empty()).then_some(dir);
    }
    let here = std::env::current_dir().ok();
    let workspace = here.as_deref().and_then(|h| {
        h.ancestors()
            .find(|a| a.join("Cargo.lock").is_file() && a.join("target").is_dir())
    });
    if let Some(w) = workspace {
        return Some(w.join("target/isobar-truth"));
    }
    let user = set("XDG_CACHE_HOME").or_else(|| Some(set("HOME")?.join(".cache")))?;
    user.is_absolute().then(|| user.join("isobar/truth"))
}

/// The certified first hits of all surfaces for every pixel: read from `dir` where they are, else computed and kept there. A file that
/// cannot be read or written is no error: then they are computed, or not kept.
///
/// # Errors
/// When the oracle cannot answer for this function, or `stop` was raised.
pub fn cached(
    f: &Arc<dyn Function>,
    surfaces: &[Surface],
    view: &View,
    data_hash: &str,
    dir: Option<&Path>,
    stop: &Stop,
) -> Result<Truth> {
    let path = dir.map(|d| d.join(format!("{}.truth", key(f.as_ref(), surfaces, view, data_hash))));
    if let Some(t) = path
        .as_deref()
        .and_then(|p| std::fs::read(p).ok())
        .and_then(|b| Truth::from_bytes(&b).ok())
    {
        return Ok(t);
    }
    let truth = Truth::compute(f, surfaces, view, stop)?;
    if let (Some(dir), Some(path)) = (dir, path) {
        // Not being able to keep it costs time later, nothing else.
        let _ = std::fs::create_dir_all(dir)
            .map_err(anyhow::Error::from)
            .and_then(|()| output::atomically(&path, |w| Ok(w.write_all(&truth.to_bytes())?)));
    }
    Ok(truth)
}

/// Name of a certified frame: a hash of everything it depends on. Two functions of one name on the same data (such as a reconstruction
/// with and without dropped details) are told apart by their domains and their values at scattered points.
#[must_use]
pub fn key(f: &dyn Function, surfaces: &[Surface], view: &View, data_hash: &str) -> String {
    let mut h = Sha256::new();
    let vector = |h: &mut Sha256, v: DVec3| v.to_array().into_iter().for_each(|x| h.update(x.to_bits().to_le_bytes()));
    h.update(data_hash);
    let d = f.domain();
    [d.origin, d.axes.x_axis, d.axes.y_axis, d.axes.z_axis, d.lo, d.hi]
        .into_iter()
        .for_each(|v| vector(&mut h, v));
    let mut random = Random::new(0);
    for _ in 0..4096 {
        let u = DVec3::new(random.unit(), random.unit(), random.unit());
        h.update(f.value(d.world(d.lo + (d.hi - d.lo) * u)).to_bits().to_le_bytes());
    }
    isobar_oracle::cache_key(&hexadecimal(&h.finalize()), &f.name(), surfaces, view)
}

/// [`cached`] for one data set, keeping the last answer in memory: settings of one method ask for the same.
#[derive(Debug)]
pub struct Truths {
    data_hash: String,
    dir: Option<PathBuf>,
    last: Mutex<Option<(String, Arc<Truth>)>>,
}

impl Truths {
    /// For data of this hash; frames are kept in `dir`.
    #[must_use]
    pub fn new(data_hash: &str, dir: Option<PathBuf>) -> Self {
        Self {
            data_hash: data_hash.to_owned(),
            dir,
            last: Mutex::new(None),
        }
    }

    /// The certified frame.
    ///
    /// # Errors
    /// As [`cached`].
    pub fn get(&self, f: &Arc<dyn Function>, surfaces: &[Surface], view: &View, stop: &Stop) -> Result<Arc<Truth>> {
        let key = key(f.as_ref(), surfaces, view, &self.data_hash);
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, t)) = last.as_ref().filter(|(k, _)| *k == key) {
            return Ok(t.clone());
        }
        let truth = Arc::new(cached(f, surfaces, view, &self.data_hash, self.dir.as_deref(), stop)?);
        *last = Some((key, truth.clone()));
        Ok(truth)
    }
}

/// Seeded random numbers (SplitMix64): the same on every machine.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// From a seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Even in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Even on the unit sphere.
    pub fn direction(&mut self) -> DVec3 {
        let z = 2.0 * self.unit() - 1.0;
        let a = std::f64::consts::TAU * self.unit();
        let r = (1.0 - z * z).max(0.0).sqrt();
        DVec3::new(r * a.cos(), r * a.sin(), z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_io::Options;

    #[test]
    fn truth_is_kept_by_everything_it_depends_on() {
        let source = crate::source::open("synthetic:sphere,n=12", &Options::default()).unwrap();
        let field = source.truth.clone().unwrap();
        let view = View::fit(source.bounds(), 40.0, 12, 9);
        let surfaces = [Surface::isovalue(1.0, 0)];
        let k = |surfaces: &[Surface], view: &View, hash: &str| key(field.function.as_ref(), surfaces, view, hash);
        let base = k(&surfaces, &view, "a");
        assert_eq!(base, k(&surfaces, &view, "a"));
        assert_ne!(base, k(&surfaces, &view, "b"));
        assert_ne!(base, k(&[Surface::isovalue(0.5, 0)], &view, "a"));
        assert_ne!(base, k(&surfaces, &View::fit(source.bounds(), 41.0, 12, 9), "a"));

        let dir = tempfile::tempdir().unwrap();
        let get = || cached(&field.function, &surfaces, &view, "a", Some(dir.path()), &Stop::default()).unwrap();
        let first = get();
        let files: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(files.len(), 1);
        assert_eq!(get(), first);
        // A damaged file is worked out again, and mended.
        std::fs::write(&files[0], b"damaged").unwrap();
        assert_eq!(get(), first);
        assert_eq!(std::fs::read(&files[0]).unwrap(), first.to_bytes());
    }

    #[test]
    fn random_numbers_are_even_and_repeatable() {
        let mut r = Random::new(7);
        let values: Vec<f64> = (0..4000).map(|_| r.unit()).collect();
        assert!((values.iter().sum::<f64>() / 4000.0 - 0.5).abs() < 0.02);
        assert_eq!(Random::new(7).unit(), values[0]);
        let mean = (0..4000).map(|_| r.direction()).sum::<DVec3>() / 4000.0;
        assert!(mean.length() < 0.05 && (r.direction().length() - 1.0).abs() < 1e-12);
    }
}
