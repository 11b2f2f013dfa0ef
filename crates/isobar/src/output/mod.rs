//! Files written whole or not at all: PNG, EXR and npz of a frame, pictures of errors and work.
//!
//! Every file is made under a temporary name in its own folder and renamed when complete; on failure nothing is left. The files of one
//! answer are renamed when all of them are complete.

mod exr_file;
mod npz;
mod picture;
mod place;

pub use exr_file::stage_exr;
pub use npz::stage_npz;
pub use picture::{
    ClassColour, Picture, colour_bar, encode_png, error_picture, frame_picture, heat_colour, heat_picture, log_position,
    stage_picture, work_picture, write_picture,
};
pub use place::{destination, require_distinct, resolved};

use anyhow::{Context, Result, anyhow, bail, ensure};
use isobar_core::{Channels, Frame};
use place::folder;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Formats of an image, by extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Colour, 8-bit sRGB over white.
    Png,
    /// Linear colour, Z (t) and normals, 32-bit floats.
    Exr,
    /// All channels as arrays.
    Npz,
}

impl Format {
    /// The format of a path's extension (any case).
    ///
    /// # Errors
    /// When it is none of png, exr, npz.
    pub fn of(path: &Path) -> Result<Self> {
        match path
            .extension()
            .and_then(|e| e.to_str())
            .map(str::to_ascii_lowercase)
            .as_deref()
        {
            Some("png") => Ok(Self::Png),
            Some("exr") => Ok(Self::Exr),
            Some("npz") => Ok(Self::Npz),
            _ => bail!(
                "-o {}: unknown kind of output; end the name in .png, .exr or .npz",
                path.display()
            ),
        }
    }

    /// Channels it needs. An npz of a method that gives only colour holds what there is.
    #[must_use]
    pub fn channels(self) -> Channels {
        match self {
            Self::Png => Channels::RGBA,
            Self::Exr => Channels::RGBA | Channels::T | Channels::NORMAL,
            Self::Npz => {
                Channels::T
                    | Channels::POINT
                    | Channels::NORMAL
                    | Channels::SURFACE
                    | Channels::T_ERROR
                    | Channels::HITS
                    | Channels::RGBA
                    | Channels::CLAIM
            }
        }
    }

    /// Writes a frame under a temporary name. `layered`: `--layers` was given, so the npz arrays that have layers get a leading axis,
    /// even with one layer.
    ///
    /// # Errors
    /// When a channel is missing or the file cannot be written; then no file is left.
    pub fn stage(self, path: &Path, frame: &Frame, layered: bool) -> Result<Staged> {
        ensure!(
            frame.channels.contains(self.channels()),
            "-o {}: the frame lacks {:?}",
            path.display(),
            self.channels() - frame.channels
        );
        match self {
            Self::Png => stage_picture(path, &frame_picture(frame)),
            Self::Exr => stage_exr(path, frame),
            Self::Npz => stage_npz(path, frame, layered),
        }
    }
}

/// Checks that a file of this name can be written, before any work: its folder takes a new file, and the name is no folder, device or
/// pipe and not write-protected; links are followed. Leaves nothing behind. `flag` is named in the error.
///
/// # Errors
/// When it cannot.
pub fn probe(flag: &str, path: &Path) -> Result<()> {
    let name = path.display();
    let target = destination(flag, path)?;
    if target.exists() {
        OpenOptions::new()
            .append(true)
            .open(&target)
            .map_err(|e| anyhow!("{flag} {name}: cannot be overwritten ({e}); choose another name"))?;
    }
    probe_folder(flag, path, &folder(&target))
}

/// As [`probe`], for files made inside `folder`; `path` is what the user gave.
///
/// # Errors
/// When the folder takes no new file.
pub fn probe_folder(flag: &str, path: &Path, folder: &Path) -> Result<()> {
    let _removed = crate::interrupt::writing()?;
    tempfile::Builder::new()
        .prefix(".isobar-")
        .tempfile_in(folder)
        .map(drop)
        .map_err(|e| {
            anyhow!(
                "{flag} {}: cannot write in folder {} ({}); make the folder or choose another",
                path.display(),
                folder.display(),
                e.kind()
            )
        })
}

/// A file that is complete, but still under a temporary name in its folder: [`publish`] gives it its own. Dropped before, nothing is left of it.
#[derive(Debug)]
#[must_use = "the file is removed unless it is published"]
pub struct Staged {
    path: PathBuf,
    temporary: NamedTempFile,
}

/// Writes a file under a temporary name in its folder; that of its target, where the path is a link.
///
/// # Errors
/// Where the path is no place for a file ([`destination`]); what `fill` or the file system says, with the path; nothing is left then.
pub fn stage(path: &Path, fill: impl FnOnce(&mut BufWriter<&File>) -> Result<()>) -> Result<Staged> {
    let what = || {
        format!(
            "{}: could not be written; free some space or choose another place",
            path.display()
        )
    };
    let _whole = crate::interrupt::writing()?;
    let path = destination("output", path)?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".isobar-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The usual rights of a new file; the process's mask is taken off.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let temporary = builder.tempfile_in(folder(&path)).with_context(what)?;
    let mut writer = BufWriter::with_capacity(1 << 20, temporary.as_file());
    fill(&mut writer).with_context(what)?;
    writer.flush().with_context(what)?;
    drop(writer);
    Ok(Staged { path, temporary })
}

/// Gives complete files their names, in order; former files of these names are replaced.
///
/// # Errors
/// When a name cannot be given, with the path; the files after it are not published.
pub fn publish(files: impl IntoIterator<Item = Staged>) -> Result<()> {
    let _whole = crate::interrupt::writing()?;
    for f in files {
        f.temporary
            .persist(&f.path)
            .map_err(|e| anyhow!(e.error))
            .with_context(|| format!("{}: could not be written; choose another name", f.path.display()))?;
    }
    Ok(())
}

/// Writes a file under a temporary name in its folder and renames it when `fill` succeeded; else nothing is left and a former file of
/// this name is unchanged.
///
/// # Errors
/// What `fill` or the file system says, with the path.
pub fn atomically(path: &Path, fill: impl FnOnce(&mut BufWriter<&File>) -> Result<()>) -> Result<()> {
    let _whole = crate::interrupt::writing()?;
    publish([stage(path, fill)?])
}

/// Writes a text file by [`atomically`].
///
/// # Errors
/// When it cannot be written.
pub fn write_text(path: &Path, text: &str) -> Result<()> {
    publish([stage_text(path, text)?])
}

/// Writes a text file by [`stage`].
///
/// # Errors
/// When it cannot be written.
pub fn stage_text(path: &Path, text: &str) -> Result<Staged> {
    stage(path, |w| Ok(w.write_all(text.as_bytes())?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_former_file_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        write_text(&path, "before").unwrap();
        let failed = atomically(&path, |w| {
            w.write_all(b"half")?;
            bail!("no more")
        });
        assert!(format!("{:#}", failed.unwrap_err()).contains("no more"));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "before");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn files_of_one_answer_appear_together_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let first = stage_text(&at("a.txt"), "a").unwrap();
        assert!(!at("a.txt").exists());
        let second = stage(&at("b.txt"), |_| bail!("no more"));
        assert!(second.is_err());
        drop(first);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        publish([stage_text(&at("a.txt"), "a").unwrap(), stage_text(&at("b.txt"), "b").unwrap()]).unwrap();
        assert_eq!(std::fs::read_to_string(at("b.txt")).unwrap(), "b");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2);
    }

    #[test]
    fn unwritable_places_are_found_before_any_work() {
        let dir = tempfile::tempdir().unwrap();
        assert!(probe("-o", &dir.path().join("new.png")).is_ok());
        assert!(probe("-o", dir.path()).is_err());
        assert!(probe("-o", &dir.path().join("no/such/a.png")).is_err());
        assert!(probe("-o", Path::new("/")).is_err());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[cfg(unix)]
    #[test]
    fn files_have_the_usual_rights() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let (ours, theirs) = (dir.path().join("a"), dir.path().join("b"));
        write_text(&ours, "x").unwrap();
        std::fs::write(&theirs, "x").unwrap();
        let mode = |p: &Path| p.metadata().unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&theirs));
    }
}
