//! Base64 text in a stream: white space is skipped, a padded group ends a run and another may follow, anything else ends the stream.
//!
//! VTK encodes the header and the payload of an array as two runs, other writers as one; with runs joined both read the same.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::io::{self, BufRead, Read};

/// Text decoded at a time, characters; a multiple of 4.
const BATCH: usize = 64 << 10;

/// Decodes base64 on the fly.
pub(crate) struct Base64Reader<R> {
    text: R,
    /// Characters of the run, not decoded yet.
    pending: Vec<u8>,
    decoded: Vec<u8>,
    /// Bytes of `decoded` already given.
    given: usize,
    ended: bool,
}

impl<R: BufRead> Base64Reader<R> {
    pub(crate) fn new(text: R) -> Self {
        Self {
            text,
            pending: Vec::new(),
            decoded: Vec::new(),
            given: 0,
            ended: false,
        }
    }

    /// Gathers up to a batch of characters.
    fn gather(&mut self) -> io::Result<()> {
        while !self.ended && self.pending.len() < BATCH {
            let buffer = self.text.fill_buf()?;
            if buffer.is_empty() {
                self.ended = true;
                break;
            }
            let room = (BATCH - self.pending.len()).min(buffer.len());
            let mut used = room;
            for (i, &c) in buffer[..room].iter().enumerate() {
                if c.is_ascii_alphanumeric() || matches!(c, b'+' | b'/' | b'=') {
                    self.pending.push(c);
                } else if !c.is_ascii_whitespace() {
                    self.ended = true;
                    used = i;
                    break;
                }
            }
            self.text.consume(used);
        }
        Ok(())
    }

    /// Decodes what is pending, up to the end of its first padded group or the last whole group.
    fn decode(&mut self) -> io::Result<()> {
        let whole = self.pending.len() / 4 * 4;
        let padded = self.pending[..whole].iter().position(|&c| c == b'=');
        let end = padded.map_or(whole, |p| p / 4 * 4 + 4);
        let bad = |e: &dyn std::fmt::Display| io::Error::new(io::ErrorKind::InvalidData, format!("base64: {e}"));
        if end == 0 && !self.pending.is_empty() {
            return Err(bad(&"the last group is cut short"));
        }
        self.decoded.clear();
        self.given = 0;
        STANDARD
            .decode_vec(&self.pending[..end], &mut self.decoded)
            .map_err(|e| bad(&e))?;
        self.pending.drain(..end);
        Ok(())
    }
}

impl<R: BufRead> Read for Base64Reader<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        while self.given == self.decoded.len() {
            self.gather()?;
            if self.pending.is_empty() {
                return Ok(0);
            }
            self.decode()?;
        }
        let n = out.len().min(self.decoded.len() - self.given);
        out[..n].copy_from_slice(&self.decoded[self.given..self.given + n]);
        self.given += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(text: &str) -> io::Result<Vec<u8>> {
        let mut out = Vec::new();
        Base64Reader::new(text.as_bytes()).read_to_end(&mut out)?;
        Ok(out)
    }

    #[test]
    fn runs_are_joined_and_white_space_skipped() {
        assert_eq!(decode(" aGVs\n bG8= d29y bGQ=<").unwrap(), b"helloworld");
        assert_eq!(decode("aGVsbG8hd29ybGQ=").unwrap(), b"hello!world");
        assert_eq!(decode("").unwrap(), b"");
        assert!(decode("aGV").is_err());
        assert!(decode("aG=V").is_err());
        let long = STANDARD.encode(vec![7u8; 300_000]);
        assert_eq!(decode(&long).unwrap(), vec![7u8; 300_000]);
    }
}
