//! Why a file could not be read or written: one cause each, printed as `FILE: reason; remedy` on one line.

use isobar_core::DataError;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A file that could not be read or written. Displayed as one line, `FILE: reason; remedy`, whatever the file holds.
#[derive(Debug, Error)]
#[error("{}: {cause}", one_line(&path.to_string_lossy(), 400))]
pub struct IoError {
    /// The file named by the caller.
    pub path: PathBuf,
    /// What is wrong with it.
    pub cause: Cause,
}

impl IoError {
    pub(crate) fn new(path: &Path, cause: Cause) -> Self {
        Self {
            path: path.to_path_buf(),
            cause,
        }
    }
}

/// What is wrong with a file. Displayed as `reason; remedy`.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Cause {
    /// There is no such file.
    #[error("there is no such file; check the path")]
    NotFound,
    /// The path names a folder.
    #[error("this is a folder; name a file in it")]
    Folder,
    /// The path names a device, pipe or socket, whose size is not known before it is read.
    #[error("this is not an ordinary file; copy the data into one")]
    NotAFile,
    /// The file has no bytes.
    #[error("the file is empty; fetch or write it again")]
    Empty,
    /// The operating system refused.
    #[error("cannot {doing} it ({error}); check the path, its permissions and the disk")]
    System {
        /// `open`, `read` or `write`.
        doing: &'static str,
        /// The system's words.
        error: String,
    },
    /// No known format.
    #[error(
        "unknown format; isobar reads NRRD, NIfTI-1, VTI, VTU, legacy VTK, PLOT3D, MFEM, NURBS (nurbs-volume JSON, G+Smo, GeoPDEs) and NAME_WxHxD_TYPE.raw volumes, OFF and PLY meshes"
    )]
    Unknown,
    /// A triangle mesh where a field is needed.
    #[error("this is a triangle mesh ({0}), not a scalar field; give it with --mesh")]
    IsMesh(&'static str),
    /// Something else where a triangle mesh is needed.
    #[error("not a triangle mesh; give an OFF or PLY file")]
    NotMesh,
    /// Data of a kind that has no reader.
    #[error(
        "{0} is not read yet; give a grid (NRRD, NIfTI-1, VTI, legacy VTK structured points, raw) or cells (VTU, legacy VTK unstructured grid, PLOT3D)"
    )]
    NotYet(String),
    /// A header or text that breaks the rules of its format.
    #[error("bad {format}: {reason}; correct the file or write it again")]
    Malformed {
        /// The format.
        format: &'static str,
        /// What is wrong.
        reason: String,
    },
    /// A legal file that uses something this reader does not do.
    #[error("{format} with {what} is not supported; {remedy}")]
    Unsupported {
        /// The format.
        format: &'static str,
        /// What it uses.
        what: String,
        /// What to do instead.
        remedy: &'static str,
    },
    /// The declared size cannot be in the file; found before anything was allocated.
    #[error(
        "the header declares {declared} bytes of samples but the file can hold at most {possible}; it is cut short or its header is wrong: fetch or write it again"
    )]
    TooShort {
        /// Bytes of samples by the header.
        declared: u64,
        /// Bytes there can be.
        possible: u64,
    },
    /// The samples end early.
    #[error(
        "the samples end after {found} of {declared} bytes; the file is cut short or its header is wrong: fetch or write it again"
    )]
    Truncated {
        /// Bytes of samples by the header.
        declared: u64,
        /// Bytes found.
        found: u64,
    },
    /// The size disagrees with what the name or header says, and more data than declared is not harmless.
    #[error("{declared} bytes are declared but there are {found}; correct the dimensions or the type")]
    Size {
        /// Bytes declared.
        declared: u64,
        /// Bytes there.
        found: u64,
    },
    /// Compressed data that do not decompress, or fail their checksum.
    #[error("the compressed samples are damaged ({0}); fetch or write the file again")]
    Corrupt(String),
    /// Dimensions that are zero or overflow.
    #[error("dimensions {0:?} are empty or too large for this machine; correct the header")]
    Dims([u64; 3]),
    /// The allocator refused.
    #[error("{0} bytes of samples do not fit into memory; use a smaller or cropped volume")]
    Memory(u64),
    /// A field that is not in the file.
    #[error("there is no field {asked}; --field may be one of: {have}")]
    NoField {
        /// The name asked for.
        asked: String,
        /// The names there are.
        have: String,
    },
    /// A file without any array of samples.
    #[error("the file has no field; write at least one array of point or cell data")]
    NoFields,
    /// A replacement of NaN that is itself not finite.
    #[error("NaN cannot be replaced by {0}; give a finite number to --nan")]
    Replacement(f64),
    /// Geometry or counts that core refuses.
    #[error("{0}; correct the header")]
    Data(#[from] DataError),
    /// A grid that cannot become elements: too thin, or more cells than elements there may be.
    #[error("{0}; crop it, or leave as=hexes out")]
    AsHexes(DataError),
    /// Trouble in the file that holds the samples of a detached header.
    #[error("its data file {name}: {cause}")]
    Detached {
        /// The name in the header.
        name: String,
        /// What is wrong with it.
        cause: Box<Cause>,
    },
}

impl Cause {
    pub(crate) fn malformed(format: &'static str, reason: impl Into<String>) -> Self {
        Self::Malformed {
            format,
            reason: one_line(&reason.into(), 200),
        }
    }

    /// An error of opening or reading, by its kind.
    pub(crate) fn system(doing: &'static str, e: &io::Error) -> Self {
        match e.kind() {
            io::ErrorKind::NotFound if doing == "open" => Self::NotFound,
            io::ErrorKind::IsADirectory => Self::Folder,
            io::ErrorKind::UnexpectedEof => Self::Corrupt("the stream ends early".into()),
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput if doing == "read" => {
                Self::Corrupt(one_line(&e.to_string(), 120))
            }
            _ => Self::System {
                doing,
                error: one_line(&e.to_string(), 120),
            },
        }
    }
}

/// The text with control characters as spaces, cut after `most` characters: what goes into a message stays on one line.
pub(crate) fn one_line(text: &str, most: usize) -> String {
    let mut line: String = text
        .chars()
        .take(most)
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect();
    if text.chars().nth(most).is_some() {
        line.push_str("...");
    }
    line
}

/// A word of a file, quoted for a message.
pub(crate) fn quoted(word: &str) -> String {
    format!("\"{}\"", one_line(word.trim(), 60))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_stay_on_one_line() {
        let e = IoError::new(
            Path::new("a\nb.nrrd"),
            Cause::malformed("NRRD header", "line \"x\ny\u{7}\" is\tstrange"),
        );
        let text = e.to_string();
        assert!(!text.chars().any(char::is_control), "{text:?}");
        assert_eq!(
            text,
            "a b.nrrd: bad NRRD header: line \"x y \" is strange; correct the file or write it again"
        );
        assert_eq!(one_line(&"x".repeat(9), 4), "xxxx...");
    }
}
