//! The samples of a VTI array: text, inline base64, appended base64, appended raw; as they are or in zlib blocks.
//!
//! A binary array starts with header words (UInt32 or UInt64): without compression one, its bytes; with it the number of blocks, the bytes of
//! a whole block, those of the last where it is partial (else 0), and the packed bytes of each. All are checked against the layout and the
//! file before samples are allocated.

use crate::base64_stream::Base64Reader;
use crate::error::Cause;
use crate::input::{Input, MOST_INFLATION, ZlibBlock, fill, finish};
use crate::sample::{Layout, check_text, numbers_binary, numbers_text, read_binary, read_text};
use crate::vti::{Place, Storage, malformed};
use flate2::bufread::ZlibDecoder;
use isobar_core::Samples;
use std::io::{self, BufRead, Cursor, Read};

/// Reads the samples of the array at `place`.
pub(crate) fn read(
    input: &dyn Input,
    storage: &Storage,
    place: &Place,
    layout: &Layout,
    notes: &mut Vec<String>,
) -> Result<Samples, Cause> {
    match source(input, storage, place, layout)? {
        Source::Text(mut text) => read_text(&mut *text, layout, notes),
        Source::Plain(mut reader) => read_binary(&mut *reader, layout, notes),
        Source::Packed(mut blocks) => {
            let samples = read_binary(&mut *blocks, layout, notes)?;
            finish(&mut *blocks)?;
            Ok(samples)
        }
    }
}

/// Reads all numbers of the array at `place` as f64.
pub(crate) fn numbers(input: &dyn Input, storage: &Storage, place: &Place, layout: &Layout) -> Result<Vec<f64>, Cause> {
    match source(input, storage, place, layout)? {
        Source::Text(mut text) => numbers_text(&mut *text, layout),
        Source::Plain(mut reader) => numbers_binary(&mut *reader, layout),
        Source::Packed(mut blocks) => {
            let all = numbers_binary(&mut *blocks, layout)?;
            finish(&mut *blocks)?;
            Ok(all)
        }
    }
}

/// The bytes or the text of an array, found able to hold it.
enum Source<'a> {
    Text(Box<dyn BufRead + 'a>),
    Plain(Box<dyn Read + 'a>),
    Packed(Box<Blocks<'a>>),
}

fn source<'a>(input: &'a dyn Input, storage: &Storage, place: &Place, layout: &Layout) -> Result<Source<'a>, Cause> {
    let (reader, there): (Box<dyn Read + 'a>, u64) = match place {
        Place::Ascii(range) => {
            let length = range.end - range.start;
            check_text(layout, length)?;
            return Ok(Source::Text(Box::new(input.open(range.start)?.take(length))));
        }
        Place::Inline(range) => {
            let length = range.end - range.start;
            (
                Box::new(Base64Reader::new(input.open(range.start)?.take(length))),
                length / 4 * 3,
            )
        }
        Place::Appended(offset) => {
            let (start, base64) = storage
                .appended
                .ok_or_else(|| malformed("an array is in appended data, but there are none"))?;
            let at = start
                .checked_add(*offset)
                .filter(|&at| at < input.len())
                .ok_or_else(|| malformed(format!("offset {offset} is beyond the end of the file")))?;
            let length = input.len() - at;
            let reader: Box<dyn BufRead + 'a> = input.open(at)?;
            if base64 {
                (Box::new(Base64Reader::new(reader)), length / 4 * 3)
            } else {
                (Box::new(reader), length)
            }
        }
    };
    binary(reader, there, storage, layout)
}

/// `there`: the bytes the reader can give at most.
fn binary<'a>(mut reader: Box<dyn Read + 'a>, there: u64, storage: &Storage, layout: &Layout) -> Result<Source<'a>, Cause> {
    let declared = layout.bytes().ok_or(Cause::Dims([layout.count as u64, 1, 1]))?;
    let first = word(&mut *reader, storage)?;
    if !storage.zlib {
        if first != declared {
            return Err(Cause::Size { declared, found: first });
        }
        if declared > there {
            return Err(Cause::TooShort {
                declared,
                possible: there,
            });
        }
        return Ok(Source::Plain(reader));
    }
    let whole = word(&mut *reader, storage)?;
    let partial = word(&mut *reader, storage)?;
    // Each block has a header word in the file.
    if first > there / storage.word as u64 {
        return Err(malformed(format!("{first} compressed blocks cannot be in {there} bytes")));
    }
    let found = match (first, partial) {
        (0, _) => Some(0),
        (n, 0) => n.checked_mul(whole),
        (n, last) => (n - 1).checked_mul(whole).and_then(|b| b.checked_add(last)),
    };
    let found = found.ok_or_else(|| malformed("the sizes of its compressed blocks overflow"))?;
    if found != declared {
        return Err(Cause::Size { declared, found });
    }
    let mut sizes = Vec::with_capacity(usize::try_from(first).unwrap_or(0));
    let mut packed = 0u64;
    for _ in 0..first {
        let size = word(&mut *reader, storage)?;
        packed = packed.saturating_add(size);
        sizes.push(size);
    }
    if packed > there {
        return Err(Cause::TooShort {
            declared: packed,
            possible: there,
        });
    }
    let possible = packed.saturating_mul(MOST_INFLATION);
    if declared > possible {
        return Err(Cause::TooShort { declared, possible });
    }
    let last = if partial == 0 { whole } else { partial };
    Ok(Source::Packed(Box::new(Blocks {
        reader,
        sizes: sizes.into_iter(),
        whole,
        last,
        block: None,
        left: 0,
    })))
}

/// A header word.
fn word(reader: &mut dyn Read, storage: &Storage) -> Result<u64, Cause> {
    let mut bytes = [0u8; 8];
    let n = storage.word;
    if fill(reader, &mut bytes[..n])? < n {
        return Err(malformed("the header of an array is cut short"));
    }
    if storage.big_endian {
        bytes[..n].reverse();
    }
    Ok(u64::from_le_bytes(bytes))
}

/// The blocks one after another. Each must unpack to exactly its size.
struct Blocks<'a> {
    reader: Box<dyn Read + 'a>,
    sizes: std::vec::IntoIter<u64>,
    whole: u64,
    last: u64,
    block: Option<ZlibBlock>,
    /// Unpacked bytes the block still owes.
    left: u64,
}

impl Blocks<'_> {
    /// Checks that the block is used up, takes the next; false after the last.
    fn next(&mut self) -> io::Result<bool> {
        let bad = |text: &str| io::Error::new(io::ErrorKind::InvalidData, text);
        if let Some(block) = &mut self.block {
            // Also verifies its checksum.
            if block.read(&mut [0u8])? > 0 {
                return Err(bad("a compressed block is longer than declared"));
            }
        }
        let Some(size) = self.sizes.next() else { return Ok(false) };
        // The sum of all sizes has been found to be within the file.
        let mut bytes = std::mem::take(&mut self.block).map_or_else(Vec::new, |b| b.into_inner().into_inner());
        bytes.clear();
        let found = self.reader.by_ref().take(size).read_to_end(&mut bytes)?;
        if (found as u64) < size {
            return Err(bad("a compressed block is cut short"));
        }
        self.left = if self.sizes.len() == 0 { self.last } else { self.whole };
        self.block = Some(ZlibDecoder::new(Cursor::new(bytes)));
        Ok(true)
    }
}

impl Read for Blocks<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if out.is_empty() {
            return Ok(0);
        }
        while self.left == 0 {
            if !self.next()? {
                return Ok(0);
            }
        }
        let most = usize::try_from(self.left).unwrap_or(usize::MAX).min(out.len());
        let Some(block) = &mut self.block else { return Ok(0) };
        let n = block.read(&mut out[..most])?;
        if n == 0 {
            return Err(io::Error::new(
                io::ErrorKind::InvalidData,
                "a compressed block is shorter than declared",
            ));
        }
        self.left -= n as u64;
        Ok(n)
    }
}
