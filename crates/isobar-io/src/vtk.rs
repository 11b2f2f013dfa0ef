//! Legacy VTK (`.vtk`), STRUCTURED_POINTS and (through [`crate::vtk_cells`]) UNSTRUCTURED_GRID, versions 1.0 to 5.1, ASCII and BINARY (big-endian).
//!
//! Format: VTK file formats, "Simple legacy formats", <https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html>. The
//! crate `vtkio` 0.7.0-rc2 was tried and is not used: it refuses a blank line after the title (ironProt.vtk) and keeps the whole file. Here the
//! file is scanned once for its arrays, whose samples are skipped, then the one asked for is read from its position.
//!
//! Read: SCALARS (with its LOOKUP_TABLE line), VECTORS, NORMALS, TENSORS, TEXTURE_COORDINATES, COLOR_SCALARS, FIELD, METADATA and lookup
//! tables skipped. `ASPECT_RATIO` is the old name of SPACING. `bit` and `string` arrays cannot be chosen; `long` has 8 bytes.

use crate::error::{Cause, quoted};
use crate::field::{Named, choices, choose};
use crate::input::{Input, fill, line};
use crate::sample::{Layout, Scalar, check_text, next_word, read_binary, read_text};
use crate::volume::{Geometry, loaded};
use crate::{Loaded, Options, vtk_cells};
use isobar_core::DVec3;
use std::io::BufRead;

const FORMAT: &str = "legacy VTK file";

/// An array and where its samples start.
pub(crate) struct Array {
    pub(crate) named: Named,
    pub(crate) kind: Kind,
    pub(crate) tuples: u64,
    pub(crate) at: u64,
}

/// The type of an array.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    Number(Scalar),
    /// Packed, 8 to a byte.
    Bit,
}

/// What a scan has found so far.
pub(crate) struct Scan<'a> {
    pub(crate) input: &'a dyn Input,
    reader: Box<dyn BufRead + 'a>,
    /// Position of the reader, bytes.
    at: u64,
    /// Of the file's first line.
    pub(crate) version: (u32, u32),
    pub(crate) binary: bool,
    /// Geometry of an UNSTRUCTURED_GRID: POINTS, CELLS (or OFFSETS and CONNECTIVITY), CELL_TYPES by these names.
    pub(crate) cells: Option<Vec<Array>>,
    dims: Option<[u64; 3]>,
    spacing: DVec3,
    origin: DVec3,
    /// Of the current section: on cells, tuples.
    section: Option<(bool, u64)>,
    pub(crate) arrays: Vec<Array>,
}

/// Reads a legacy VTK file.
pub(crate) fn read(input: &dyn Input, o: &Options) -> Result<Loaded, Cause> {
    let mut scan = Scan::new(input)?;
    let dims = scan.run()?;
    if scan.cells.is_some() {
        return vtk_cells::read(&scan, o);
    }
    let named: Vec<Named> = scan.arrays.iter().map(|a| a.named.clone()).collect();
    let all = choices(&named);
    let choice = choose(&all, &named, o.field.as_deref())?.clone();
    let array = &scan.arrays[choice.array];
    let on_cells = array.named.on_cells;
    let own = if on_cells {
        dims.map(|d| d.saturating_sub(1).max(1))
    } else {
        dims
    };
    let half = if on_cells { DVec3::splat(0.5) } else { DVec3::ZERO };
    let geometry = Geometry::aligned(own, scan.spacing, scan.origin).shifted(half);
    let count = geometry.check()?;
    if array.tuples != count as u64 {
        return Err(malformed(format!(
            "array {} has {} tuples, {own:?} samples need {count}",
            quoted(&array.named.name),
            array.tuples
        )));
    }
    let Kind::Number(scalar) = array.kind else {
        return Err(Cause::Unsupported {
            format: "legacy VTK",
            what: format!("array {} of type bit", quoted(&array.named.name)),
            remedy: "choose another with --field",
        });
    };
    let layout = Layout {
        scalar,
        big_endian: true,
        components: array.named.components,
        pick: choice.pick,
        count,
        scale: None,
    };
    let mut notes = Vec::new();
    let mut reader = input.open(array.at)?;
    let samples = if scan.binary {
        read_binary(&mut *reader, &layout, &mut notes)?
    } else {
        read_text(&mut *reader, &layout, &mut notes)?
    };
    loaded(
        geometry,
        samples,
        choice.name,
        all.into_iter().map(|c| c.name).collect(),
        notes,
        o,
    )
}

pub(crate) fn malformed(reason: impl Into<String>) -> Cause {
    Cause::malformed(FORMAT, reason)
}

impl<'a> Scan<'a> {
    fn new(input: &'a dyn Input) -> Result<Self, Cause> {
        Ok(Self {
            input,
            reader: input.open(0)?,
            at: 0,
            version: (0, 0),
            binary: false,
            cells: None,
            dims: None,
            spacing: DVec3::ONE,
            origin: DVec3::ZERO,
            section: None,
            arrays: Vec::new(),
        })
    }

    /// Scans the file; the dimensions.
    fn run(&mut self) -> Result<[u64; 3], Cause> {
        let cut = || malformed("it ends in its first four lines");
        let magic = self.line()?.ok_or_else(cut)?;
        if !magic.to_ascii_lowercase().starts_with("# vtk datafile version") {
            return Err(malformed(format!("its first line is {}", quoted(&magic))));
        }
        let version = magic.split_whitespace().last().and_then(|v| v.split_once('.'));
        self.version = version.map_or((0, 0), |(a, b)| (a.parse().unwrap_or(0), b.parse().unwrap_or(0)));
        self.line()?.ok_or_else(cut)?;
        // Some writers leave a blank line after the title.
        let mut encoding = String::new();
        while encoding.trim().is_empty() {
            encoding = self.line()?.ok_or_else(cut)?;
        }
        self.binary = match encoding.trim().to_ascii_uppercase().as_str() {
            "ASCII" => false,
            "BINARY" => true,
            _ => {
                return Err(malformed(format!(
                    "{} stands where ASCII or BINARY should",
                    quoted(&encoding)
                )));
            }
        };
        let dataset = self.words()?.ok_or_else(cut)?;
        match dataset.iter().map(String::as_str).collect::<Vec<_>>()[..] {
            ["DATASET", "STRUCTURED_POINTS"] => {}
            ["DATASET", "UNSTRUCTURED_GRID"] => (self.cells, self.dims) = (Some(Vec::new()), Some([0; 3])),
            ["DATASET", other, ..] => return Err(Cause::NotYet(format!("legacy VTK data {}", quoted(other)))),
            _ => {
                return Err(malformed(format!(
                    "{} stands where DATASET should",
                    quoted(&dataset.join(" "))
                )));
            }
        }
        while let Some(words) = self.words()? {
            self.keyword(&words)?;
        }
        self.dims.ok_or_else(|| malformed("there are no DIMENSIONS"))
    }

    /// Geometry of an UNSTRUCTURED_GRID; false for other keywords.
    fn geometry(&mut self, words: &[String]) -> Result<bool, Cause> {
        let at = |i: usize| words.get(i).map_or("", String::as_str);
        let int = Kind::Number(Scalar::I32);
        match words[0].as_str() {
            "POINTS" => self.place("POINTS", kind(at(2))?, 3, count(at(1))?)?,
            "CELL_TYPES" => self.place("CELL_TYPES", int, 1, count(at(1))?)?,
            "CELLS" if self.stands(b"OFFSETS")? => {
                for (name, n) in [("OFFSETS", count(at(1))?), ("CONNECTIVITY", count(at(2))?)] {
                    let words = self.words()?.unwrap_or_default();
                    let [found, kind_name] = &words[..] else {
                        return Err(malformed(format!(
                            "{} stands where {name} TYPE should",
                            quoted(&words.join(" "))
                        )));
                    };
                    if !found.eq_ignore_ascii_case(name) {
                        return Err(malformed(format!("{} stands where {name} should", quoted(found))));
                    }
                    self.place(name, kind(kind_name)?, 1, n)?;
                }
            }
            "CELLS" => {
                self.place("CELLS", int, 1, count(at(2))?)?;
                if let Some(cells) = self.cells.as_mut().and_then(|c| c.last_mut()) {
                    // The number of cells; the values are as many as were skipped.
                    cells.named.components = usize::try_from(count(at(1))?).unwrap_or(usize::MAX);
                }
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn place(&mut self, name: &str, kind: Kind, components: u64, tuples: u64) -> Result<(), Cause> {
        let at = self.at;
        self.skip(kind, tuples, components)?;
        if let Some(cells) = &mut self.cells {
            cells.push(Array {
                named: Named {
                    name: name.into(),
                    components: usize::try_from(components).unwrap_or(usize::MAX),
                    on_cells: false,
                },
                kind,
                tuples,
                at,
            });
        }
        Ok(())
    }

    fn keyword(&mut self, words: &[String]) -> Result<(), Cause> {
        if self.cells.is_some() && self.geometry(words)? {
            return Ok(());
        }
        let at = |i: usize| words.get(i).map_or("", String::as_str);
        match words[0].as_str() {
            "DIMENSIONS" => self.dims = Some([count(at(1))?, count(at(2))?, count(at(3))?]),
            "SPACING" | "ASPECT_RATIO" => self.spacing = DVec3::new(number(at(1))?, number(at(2))?, number(at(3))?),
            "ORIGIN" => self.origin = DVec3::new(number(at(1))?, number(at(2))?, number(at(3))?),
            "POINT_DATA" => self.section = Some((false, count(at(1))?)),
            "CELL_DATA" => self.section = Some((true, count(at(1))?)),
            "SCALARS" => {
                let components = if words.len() > 3 { count(at(3))? } else { 1 };
                let kind = kind(at(2))?;
                self.lookup_line()?;
                self.array(at(1), kind, components)?;
            }
            "COLOR_SCALARS" => {
                // Bytes in binary, floats from 0 to 1 in text.
                let kind = Kind::Number(if self.binary { Scalar::U8 } else { Scalar::F32 });
                self.array(at(1), kind, count(at(2))?)?;
            }
            "LOOKUP_TABLE" => {
                let kind = Kind::Number(if self.binary { Scalar::U8 } else { Scalar::F32 });
                self.skip(kind, count(at(2))?, 4)?;
            }
            "VECTORS" | "NORMALS" => self.array(at(1), kind(at(2))?, 3)?,
            "TENSORS" => self.array(at(1), kind(at(2))?, 9)?,
            "TENSORS6" => self.array(at(1), kind(at(2))?, 6)?,
            "GLOBAL_IDS" | "PEDIGREE_IDS" => self.array(at(1), kind(at(2))?, 1)?,
            "TEXTURE_COORDINATES" => self.array(at(1), kind(at(3))?, count(at(2))?)?,
            "FIELD" => self.field(count(at(2))?)?,
            "METADATA" => self.metadata()?,
            other => return Err(malformed(format!("keyword {} is unknown", quoted(other)))),
        }
        Ok(())
    }

    /// A FIELD of several arrays, each with its own tuples; those that do not fit the section are skipped.
    fn field(&mut self, arrays: u64) -> Result<(), Cause> {
        let mut left = arrays;
        while left > 0 {
            let words = self
                .words()?
                .ok_or_else(|| malformed(format!("a FIELD ends {left} arrays early")))?;
            if words[0] == "METADATA" {
                self.metadata()?;
                continue;
            }
            let [name, components, tuples, kind_name] = &words[..] else {
                return Err(malformed(format!(
                    "{} is not NAME COMPONENTS TUPLES TYPE",
                    quoted(&words.join(" "))
                )));
            };
            let (components, tuples, kind) = (count(components)?, count(tuples)?, kind(kind_name)?);
            let at = self.at;
            self.skip(kind, tuples, components)?;
            if let Some((on_cells, n)) = self.section
                && n == tuples
            {
                self.push(name, kind, components, tuples, on_cells, at);
            }
            left -= 1;
        }
        Ok(())
    }

    fn array(&mut self, name: &str, kind: Kind, components: u64) -> Result<(), Cause> {
        let (on_cells, tuples) = self
            .section
            .ok_or_else(|| malformed(format!("array {} stands before POINT_DATA or CELL_DATA", quoted(name))))?;
        let at = self.at;
        self.skip(kind, tuples, components)?;
        self.push(name, kind, components, tuples, on_cells, at);
        Ok(())
    }

    fn push(&mut self, name: &str, kind: Kind, components: u64, tuples: u64, on_cells: bool, at: u64) {
        self.arrays.push(Array {
            named: Named {
                name: decoded(name),
                components: usize::try_from(components).unwrap_or(usize::MAX),
                on_cells,
            },
            kind,
            tuples,
            at,
        });
    }

    /// Skips samples, after checking that they can be there.
    fn skip(&mut self, kind: Kind, tuples: u64, components: u64) -> Result<(), Cause> {
        let values = tuples
            .checked_mul(components)
            .filter(|_| components > 0)
            .and_then(|v| usize::try_from(v).ok())
            .ok_or(Cause::Dims([tuples, components, 1]))?;
        let there = self.input.len().saturating_sub(self.at);
        let one = |scalar| Layout {
            scalar,
            big_endian: true,
            components: 1,
            pick: crate::sample::Pick::Component(0),
            count: values,
            scale: None,
        };
        if !self.binary {
            check_text(&one(Scalar::U8), there)?;
            return self.skip_words(values);
        }
        let bytes = match kind {
            Kind::Bit => (values as u64).div_ceil(8),
            Kind::Number(s) => one(s).bytes().ok_or(Cause::Dims([tuples, components, 1]))?,
        };
        if bytes > there {
            return Err(Cause::TooShort {
                declared: bytes,
                possible: there,
            });
        }
        self.at += bytes;
        self.reader = self.input.open(self.at)?;
        Ok(())
    }

    fn skip_words(&mut self, n: usize) -> Result<(), Cause> {
        let mut counted = Counted {
            reader: &mut *self.reader,
            read: 0,
        };
        let mut word = Vec::new();
        for i in 0..n {
            if !next_word(&mut counted, &mut word)? {
                return Err(malformed(format!("an array ends after {i} of {n} numbers")));
            }
        }
        self.at += counted.read;
        Ok(())
    }

    /// The `LOOKUP_TABLE name` line after SCALARS, which old writers leave out. What stands there instead may be binary samples.
    fn lookup_line(&mut self) -> Result<(), Cause> {
        if self.stands(b"LOOKUP_TABLE")? {
            self.words()?;
        }
        Ok(())
    }

    /// Whether this word comes next.
    fn stands(&self, word: &[u8]) -> Result<bool, Cause> {
        let mut next = [0u8; 64];
        let n = fill(&mut *self.input.open(self.at)?, &mut next)?;
        let next = next[..n].trim_ascii_start();
        Ok(next.get(..word.len()).is_some_and(|w| w.eq_ignore_ascii_case(word)))
    }

    /// METADATA goes on to the next blank line.
    fn metadata(&mut self) -> Result<(), Cause> {
        while let Some(text) = self.line()? {
            if text.trim().is_empty() {
                break;
            }
        }
        Ok(())
    }

    fn line(&mut self) -> Result<Option<String>, Cause> {
        line(&mut *self.reader, 64 << 10, &mut self.at, FORMAT)
    }

    /// The words of the next line that has any, the first in capitals where it is a keyword.
    fn words(&mut self) -> Result<Option<Vec<String>>, Cause> {
        while let Some(text) = self.line()? {
            let mut words: Vec<String> = text.split_whitespace().map(str::to_owned).collect();
            if let Some(first) = words.first_mut() {
                if matches!(first.to_ascii_uppercase().as_str(), "DATASET" | "LOOKUP_TABLE" | "METADATA") || self.dims.is_none() {
                    *first = first.to_ascii_uppercase();
                }
                return Ok(Some(words));
            }
        }
        Ok(None)
    }
}

/// Counts what is consumed.
struct Counted<'a> {
    reader: &'a mut dyn BufRead,
    read: u64,
}

impl std::io::Read for Counted<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let n = self.reader.read(out)?;
        self.read += n as u64;
        Ok(n)
    }
}

impl BufRead for Counted<'_> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        self.reader.fill_buf()
    }

    fn consume(&mut self, n: usize) {
        self.reader.consume(n);
        self.read += n as u64;
    }
}

fn kind(name: &str) -> Result<Kind, Cause> {
    Ok(Kind::Number(match name.to_ascii_lowercase().as_str() {
        "bit" => return Ok(Kind::Bit),
        "char" | "signed_char" | "vtktypeint8" => Scalar::I8,
        "unsigned_char" | "vtktypeuint8" => Scalar::U8,
        "short" | "vtktypeint16" => Scalar::I16,
        "unsigned_short" | "vtktypeuint16" => Scalar::U16,
        "int" | "vtktypeint32" => Scalar::I32,
        "unsigned_int" | "vtktypeuint32" => Scalar::U32,
        "long" | "vtktypeint64" | "vtkidtype" => Scalar::I64,
        "unsigned_long" | "vtktypeuint64" => Scalar::U64,
        "float" => Scalar::F32,
        "double" => Scalar::F64,
        _ => return Err(malformed(format!("type {} is unknown", quoted(name)))),
    }))
}

fn count(word: &str) -> Result<u64, Cause> {
    word.parse()
        .map_err(|_| malformed(format!("{} stands where a count should", quoted(word))))
}

fn number(word: &str) -> Result<f64, Cause> {
    word.parse()
        .map_err(|_| malformed(format!("{} stands where a number should", quoted(word))))
}

/// Names have %-codes for white space and quotes.
fn decoded(name: &str) -> String {
    let mut out = Vec::with_capacity(name.len());
    let bytes = name.as_bytes();
    let mut i = 0;
    while i < bytes.len() {
        let code = (bytes[i] == b'%')
            .then(|| name.get(i + 1..i + 3))
            .flatten()
            .and_then(|h| u8::from_str_radix(h, 16).ok());
        out.push(code.unwrap_or(bytes[i]));
        i += if code.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&out).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_decoded() {
        assert_eq!(decoded("a%20b"), "a b");
        assert_eq!(decoded("50%"), "50%");
        assert_eq!(decoded("%zz%41"), "%zzA");
    }
}
