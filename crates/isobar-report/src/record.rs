//! A run worth keeping: tables, machine.txt, the page and small pictures, under `reports/recorded/<date>-<machine>/`.

use crate::machine;
use crate::results::Report;
use anyhow::{Context, Result, bail};
use image::imageops::FilterType;
use std::path::{Path, PathBuf};

/// Bytes of a recorded run at most. The scenes' pictures and tables take 2.8 million, the thesis's figures some 0.4 million at the smallest width.
const LIMIT: u64 = 4_000_000;

/// Widths of pictures tried, from the largest, until the run fits in [`LIMIT`].
const WIDTHS: [u32; 3] = [256, 160, 96];

/// Copies the finished report; returns its folder. A run of the same day and machine is replaced.
///
/// # Errors
/// When files cannot be read or written, or even the smallest pictures are too large.
pub fn record(r: &Report, reports: &Path) -> Result<PathBuf> {
    let date = r.date.split(' ').next().unwrap_or_default();
    let folder = reports
        .join("recorded")
        .join(format!("{date}-{}", machine::short_name(&r.machine)));
    let new = reports.join("recorded/.new");
    for width in WIDTHS {
        if new.exists() {
            std::fs::remove_dir_all(&new)?;
        }
        std::fs::create_dir_all(&new).with_context(|| format!("{} cannot be made", new.display()))?;
        for name in ["index.html", "machine.txt"] {
            std::fs::copy(reports.join(name), new.join(name)).with_context(|| format!("{name} cannot be copied"))?;
        }
        copy(&reports.join("csv"), &new.join("csv"), None)?;
        copy(&reports.join("files"), &new.join("files"), Some(width))?;
        if size(&new)? < LIMIT {
            if folder.exists() {
                std::fs::remove_dir_all(&folder)?;
            }
            std::fs::rename(&new, &folder)?;
            return Ok(folder);
        }
    }
    std::fs::remove_dir_all(&new)?;
    bail!(
        "{}: the run is larger than {LIMIT} bytes even with pictures {} wide",
        folder.display(),
        WIDTHS[WIDTHS.len() - 1]
    )
}

/// Copies a folder; pictures are made at most `width` pixels wide.
fn copy(from: &Path, to: &Path, width: Option<u32>) -> Result<()> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from).with_context(|| format!("{} cannot be read", from.display()))? {
        let path = entry?.path();
        let target = to.join(path.file_name().unwrap_or_default());
        if path.is_dir() {
            copy(&path, &target, width)?;
        } else if let Some(w) = width.filter(|_| path.extension().is_some_and(|e| e == "png")) {
            let picture = image::open(&path).with_context(|| format!("{} is no picture", path.display()))?;
            let picture = if picture.width() > w {
                picture.resize(w, w, FilterType::Triangle)
            } else {
                picture
            };
            picture.to_rgb8().save(&target)?;
        } else {
            std::fs::copy(&path, &target)?;
        }
    }
    Ok(())
}

fn size(folder: &Path) -> Result<u64> {
    let mut total = 0;
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        total += if path.is_dir() {
            size(&path)?
        } else {
            std::fs::metadata(&path)?.len()
        };
    }
    Ok(total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::RgbImage;

    #[test]
    fn pictures_shrink_until_the_run_fits() {
        let dir = tempfile::tempdir().unwrap();
        let reports = dir.path();
        for (name, text) in [("index.html", "<html>"), ("machine.txt", "x")] {
            std::fs::write(reports.join(name), text).unwrap();
        }
        std::fs::create_dir_all(reports.join("csv")).unwrap();
        std::fs::write(reports.join("csv/a.csv"), "a,b").unwrap();
        std::fs::create_dir_all(reports.join("files/one")).unwrap();
        // noise does not compress
        let mut state = 1u32;
        let noise = RgbImage::from_fn(512, 384, |_, _| {
            image::Rgb(std::array::from_fn(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 24) as u8
            }))
        });
        for i in 0..100 {
            noise.save(reports.join(format!("files/one/{i}.png"))).unwrap();
        }
        let r = Report {
            date: "2026-01-02 03:04".into(),
            machine: vec![("processor".into(), "CPU 1".into())],
            ..Report::default()
        };
        let folder = record(&r, reports).unwrap();
        assert!(folder.ends_with("recorded/2026-01-02-cpu-1"));
        assert!(size(&folder).unwrap() < LIMIT);
        let small = image::open(folder.join("files/one/3.png")).unwrap();
        // How well noise compresses depends on the deflate crate that is built in: at 256 wide it fits with none of them.
        assert!(
            WIDTHS[1..].contains(&small.width()) && small.height() * 4 == small.width() * 3,
            "{}",
            small.width()
        );
        assert!(folder.join("csv/a.csv").is_file());
        // again: replaced, not doubled
        assert_eq!(record(&r, reports).unwrap(), folder);
    }
}
