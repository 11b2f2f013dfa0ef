//! Where bytes come from: a file, or a slice in memory (tests and fuzzing). Sizes are known before anything is read.

use crate::error::{Cause, quoted};
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Compressed bytes fetched at a time.
const BUFFER: usize = 128 << 10;
/// DEFLATE codes at most 258 bytes in 2 bits (RFC 1951, 3.2.5 and 3.2.7), so no stream grows more than 1032 times; the slack covers
/// streams of a few bytes.
pub(crate) const MOST_INFLATION: u64 = 1032;
/// A stream that claims to grow by more than [`SUSPICIOUS`] to more than this many bytes is inflated once without keeping anything, to
/// count, before memory is taken for it.
const COUNT_FIRST: u64 = 256 << 20;
/// See [`COUNT_FIRST`]. Real volumes compress 2 to 30 times (the most, of a 128^3 hydrogen atom: 29).
const SUSPICIOUS: u64 = 64;

/// Bytes of known length that can be opened at any offset.
pub(crate) trait Input {
    /// Length in bytes.
    fn len(&self) -> u64;
    /// A reader from `offset` (bytes) to the end.
    fn open(&self, offset: u64) -> Result<Box<dyn BufRead + '_>, Cause>;
    /// The file a detached header names, relative to the header's folder.
    fn beside(&self, name: &str) -> Result<Box<dyn Input>, Cause>;
    /// The file's name without folders, as given.
    fn name(&self) -> &str;
}

/// An ordinary file.
pub(crate) struct FileInput {
    path: PathBuf,
    name: String,
    len: u64,
}

impl FileInput {
    /// Checks that the path is an ordinary file that is not empty.
    pub(crate) fn new(path: &Path) -> Result<Self, Cause> {
        let meta = std::fs::metadata(path).map_err(|e| Cause::system("open", &e))?;
        if meta.is_dir() {
            return Err(Cause::Folder);
        }
        if !meta.is_file() {
            return Err(Cause::NotAFile);
        }
        if meta.len() == 0 {
            return Err(Cause::Empty);
        }
        Ok(Self {
            path: path.to_path_buf(),
            name: path
                .file_name()
                .map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
            len: meta.len(),
        })
    }
}

impl Input for FileInput {
    fn len(&self) -> u64 {
        self.len
    }

    fn open(&self, offset: u64) -> Result<Box<dyn BufRead + '_>, Cause> {
        let mut file = File::open(&self.path).map_err(|e| Cause::system("open", &e))?;
        if offset > 0 {
            file.seek(SeekFrom::Start(offset)).map_err(|e| Cause::system("read", &e))?;
        }
        Ok(Box::new(BufReader::with_capacity(BUFFER, file)))
    }

    fn beside(&self, name: &str) -> Result<Box<dyn Input>, Cause> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        FileInput::new(&folder.join(name))
            .map(|f| Box::new(f) as Box<dyn Input>)
            .map_err(|cause| Cause::Detached {
                name: quoted(name),
                cause: Box::new(cause),
            })
    }

    fn name(&self) -> &str {
        &self.name
    }
}

/// Bytes in memory under a name.
pub(crate) struct BytesInput<'a> {
    name: &'a str,
    bytes: &'a [u8],
}

impl<'a> BytesInput<'a> {
    /// Refuses an empty slice, as a file would be.
    pub(crate) fn new(name: &'a str, bytes: &'a [u8]) -> Result<Self, Cause> {
        if bytes.is_empty() {
            return Err(Cause::Empty);
        }
        Ok(Self { name, bytes })
    }
}

impl Input for BytesInput<'_> {
    fn len(&self) -> u64 {
        self.bytes.len() as u64
    }

    fn open(&self, offset: u64) -> Result<Box<dyn BufRead + '_>, Cause> {
        let from = usize::try_from(offset).unwrap_or(usize::MAX).min(self.bytes.len());
        Ok(Box::new(Cursor::new(&self.bytes[from..])))
    }

    fn beside(&self, name: &str) -> Result<Box<dyn Input>, Cause> {
        Err(Cause::Detached {
            name: quoted(name),
            cause: Box::new(Cause::NotFound),
        })
    }

    fn name(&self) -> &str {
        self.name
    }
}

/// How a stream is packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packing {
    /// As it is.
    None,
    /// One or more gzip members.
    Gzip,
}

/// The unpacked bytes from `offset`.
pub(crate) fn unpack(input: &dyn Input, offset: u64, packing: Packing) -> Result<Box<dyn Read + '_>, Cause> {
    let reader = input.open(offset)?;
    Ok(match packing {
        Packing::None => Box::new(reader),
        Packing::Gzip => Box::new(MultiGzDecoder::new(reader)),
    })
}

/// A reader of the unpacked bytes from `offset`, after `skip` of them, that has been found able to hold `need` more: by the file's length
/// where it is not packed, by the greatest growth of DEFLATE where it is, and by counting where even that looks suspicious.
pub(crate) fn sized<'a>(
    input: &'a dyn Input,
    offset: u64,
    packing: Packing,
    skip: u64,
    need: u64,
) -> Result<Box<dyn Read + 'a>, Cause> {
    let there = input.len().saturating_sub(offset);
    let total = need.saturating_add(skip);
    check_possible(total, there, packing)?;
    let suspicious = packing == Packing::Gzip && total > COUNT_FIRST && total / SUSPICIOUS > there;
    if suspicious {
        let mut reader = unpack(input, offset, packing)?.take(total);
        let found = io::copy(&mut reader, &mut io::sink()).map_err(|e| Cause::system("read", &e))?;
        if found < total {
            return Err(Cause::Truncated { declared: total, found });
        }
    }
    let mut reader = unpack(input, offset, packing)?;
    if skip > 0 {
        let found = io::copy(&mut reader.by_ref().take(skip), &mut io::sink()).map_err(|e| Cause::system("read", &e))?;
        if found < skip {
            return Err(Cause::Truncated { declared: total, found });
        }
    }
    Ok(reader)
}

/// Whether `there` bytes can unpack to `need`.
pub(crate) fn check_possible(need: u64, there: u64, packing: Packing) -> Result<(), Cause> {
    let possible = match packing {
        Packing::None => there,
        Packing::Gzip => there.saturating_mul(MOST_INFLATION),
    };
    if need > possible {
        return Err(Cause::TooShort {
            declared: need,
            possible,
        });
    }
    Ok(())
}

/// Fills `out` as far as the reader goes; the number of bytes written.
pub(crate) fn fill(reader: &mut dyn Read, out: &mut [u8]) -> Result<usize, Cause> {
    let mut at = 0;
    while at < out.len() {
        match reader.read(&mut out[at..]) {
            Ok(0) => break,
            Ok(n) => at += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            // A packed stream that stops in the middle: say how far it came.
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => break,
            Err(e) => return Err(Cause::system("read", &e)),
        }
    }
    Ok(at)
}

/// Reads to the end of a stream of which everything wanted has been read, so that its checksum is verified; whether there was more data.
pub(crate) fn finish(reader: &mut dyn Read) -> Result<bool, Cause> {
    let mut one = [0u8];
    loop {
        match reader.read(&mut one) {
            Ok(n) => return Ok(n > 0),
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(Cause::system("read", &e)),
        }
    }
}

/// The first bytes of the file, unpacked if it is a gzip file; fewer where it is shorter or damaged.
pub(crate) fn head(input: &dyn Input, most: usize) -> Result<(Vec<u8>, Packing), Cause> {
    let mut start = [0u8; 2];
    let n = fill(&mut *input.open(0)?, &mut start)?;
    let packing = if n == 2 && start == [0x1f, 0x8b] {
        Packing::Gzip
    } else {
        Packing::None
    };
    let mut head = vec![0; most];
    let found = match packing {
        Packing::None => fill(&mut *input.open(0)?, &mut head)?,
        // Damage is reported by the reader of the format, if the name tells which; here it only hides the magic.
        Packing::Gzip => fill(&mut *unpack(input, 0, packing)?, &mut head).unwrap_or(0),
    };
    head.truncate(found);
    Ok((head, packing))
}

/// One line without its end, at most `most` bytes; `None` at the end of the stream. Bytes that are not UTF-8 become U+FFFD.
pub(crate) fn line(reader: &mut dyn BufRead, most: usize, read: &mut u64, format: &'static str) -> Result<Option<String>, Cause> {
    let mut bytes = Vec::new();
    let n = reader
        .take(most as u64 + 1)
        .read_until(b'\n', &mut bytes)
        .map_err(|e| Cause::system("read", &e))?;
    *read += n as u64;
    if n == 0 {
        return Ok(None);
    }
    if bytes.len() > most {
        return Err(Cause::malformed(
            format,
            format!(
                "a line is longer than {most} bytes: {}",
                quoted(&String::from_utf8_lossy(&bytes))
            ),
        ));
    }
    while bytes.last().is_some_and(|b| matches!(b, b'\n' | b'\r')) {
        bytes.pop();
    }
    Ok(Some(String::from_utf8_lossy(&bytes).into_owned()))
}

/// A zlib stream of a block held in memory.
pub(crate) type ZlibBlock = ZlibDecoder<Cursor<Vec<u8>>>;
