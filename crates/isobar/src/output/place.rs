//! Where an output really goes: symbolic links followed, what is no ordinary file left alone.

use anyhow::{Result, anyhow, bail, ensure};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};

/// Links followed before they are taken for a circle, as many as Linux follows.
const MOST_LINKS: usize = 40;

/// The folder a path lies in.
pub(super) fn folder(path: &Path) -> PathBuf {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// The place a path names, by its one full name: links followed, also the last one where nothing is there yet.
///
/// # Errors
/// Where the folder is not there or cannot be read, or links go round in a circle.
pub fn resolved(path: &Path) -> std::io::Result<PathBuf> {
    let mut at = path.to_owned();
    for _ in 0..MOST_LINKS {
        match std::fs::symlink_metadata(&at) {
            Ok(m) if m.is_symlink() => at = folder(&at).join(std::fs::read_link(&at)?),
            Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
            // What is there has a full name; `.` and `..` at the end have no name of their own.
            Ok(_) if at.file_name().is_none() => return at.canonicalize(),
            _ => {
                let name = at.file_name().ok_or_else(|| Error::from(ErrorKind::InvalidInput))?;
                return Ok(folder(&at).canonicalize()?.join(name));
            }
        }
    }
    Err(Error::other("its symbolic links go round in a circle"))
}

/// Where a file given to `flag` is to be made: the target of a link takes the place of the link.
///
/// # Errors
/// Where something other than an ordinary file is there (it is not opened), the name stands for standard output, or the place cannot be told.
pub fn destination(flag: &str, path: &Path) -> Result<PathBuf> {
    let name = path.display();
    ensure!(
        path != Path::new("-"),
        "{flag} -: only check --json writes to standard output; give a file name, or ./- for a file called -"
    );
    ensure!(path.file_name().is_some(), "{flag} {name}: not a file name; give one");
    match std::fs::metadata(path) {
        Ok(m) if m.is_dir() => bail!("{flag} {name}: is a folder; give a file name"),
        Ok(m) if !m.is_file() => bail!("{flag} {name}: is a device, pipe or socket; give the name of an ordinary file"),
        Ok(_) => {}
        Err(e) if e.kind() == ErrorKind::NotFound => {}
        Err(e) => bail!("{flag} {name}: cannot be looked up ({e}); choose another name"),
    }
    resolved(path).map_err(|e| match e.kind() {
        ErrorKind::NotFound => anyhow!(
            "{flag} {name}: cannot write in folder {} ({}); make the folder or choose another",
            folder(path).display(),
            e.kind()
        ),
        _ => anyhow!("{flag} {name}: cannot be looked up ({e}); choose another name"),
    })
}

/// Refuses outputs that are one file, by whatever names, and outputs that are an input. Each comes with the flag it was given to.
///
/// # Errors
/// Where there are such; the text names both flags.
pub fn require_distinct(outputs: &[(&str, &Path)], inputs: &[(&str, &Path)]) -> Result<()> {
    // A place that cannot be told is refused where it is used.
    let place = |p: &Path| resolved(p).ok();
    for (i, (flag, path)) in outputs.iter().enumerate() {
        let Some(here) = place(path) else { continue };
        let mut others = inputs.iter().chain(&outputs[..i]);
        if let Some((other, _)) = others.find(|(_, p)| place(p).as_ref() == Some(&here)) {
            let same = if other == flag { "another" } else { "the file of" };
            bail!(
                "{flag} {}: named twice, {same} {other} is the same file; give each its own name",
                path.display()
            );
        }
    }
    Ok(())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn places_have_one_name() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::create_dir(at("sub")).unwrap();
        symlink("sub", at("link")).unwrap();
        symlink("link/there", at("dangling")).unwrap();
        symlink("round", at("circle")).unwrap();
        symlink("circle", at("round")).unwrap();
        let want = at("sub").canonicalize().unwrap().join("there");
        for spelling in ["sub/there", "./sub/../sub/there", "link/there", "dangling"] {
            assert_eq!(resolved(&at(spelling)).unwrap(), want, "{spelling}");
        }
        assert!(resolved(&at("circle")).is_err() && resolved(&at("none/there")).is_err());
        let (a, b, c) = (at("sub/there"), at("dangling"), at("other"));
        assert!(require_distinct(&[("-o", &a), ("--stats", &c)], &[]).is_ok());
        let e = require_distinct(&[("-o", &a), ("--stats", &b)], &[]).unwrap_err().to_string();
        assert!(e.contains("--stats") && e.contains("-o") && e.contains("dangling"), "{e}");
        assert!(require_distinct(&[("-o", &a)], &[("DATA", &b)]).is_err());
    }

    #[test]
    fn only_ordinary_files_are_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        symlink("/dev/null", at("null")).unwrap();
        let socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        for (path, said) in [
            (at("null"), "device"),
            (at("socket"), "device"),
            (PathBuf::from("/dev/null"), "device"),
            (PathBuf::from("-"), "standard output"),
            (dir.path().to_owned(), "folder"),
            (at(&"n".repeat(300)), "choose another"),
        ] {
            let e = destination("--stats", &path).unwrap_err().to_string();
            assert!(e.starts_with("--stats") && e.contains(said), "{e}");
        }
        drop(socket);
        // The link stays, its target is replaced.
        std::fs::write(at("target"), "before").unwrap();
        symlink("target", at("link")).unwrap();
        super::super::write_text(&at("link"), "after").unwrap();
        assert!(at("link").is_symlink());
        assert_eq!(std::fs::read_to_string(at("target")).unwrap(), "after");
        assert!(super::super::write_text(&at("null"), "x").is_err() && at("null").is_symlink());
    }
}
