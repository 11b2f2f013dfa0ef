//! NRRD (teem), NRRD0001 to NRRD0005: header attached or detached, encodings raw, gzip and text.
//!
//! Format: G. Kindlmann, "Definition of NRRD File Format", <https://teem.sourceforge.net/nrrd/format.html>. The crate `nrrd` of that name
//! writes only; no well-kept reader was found, so this one is our own. World coordinates are the file's own `space`; none is converted to
//! another. Three axes are read as the grid; a fourth axis of components (kinds `vector`, `3-vector`, `list`, ...) must be the fastest and
//! gives several fields; further axes must have one sample.

use crate::error::{Cause, quoted};
use crate::field::{Named, choices, choose};
use crate::input::{Input, Packing, finish, line, sized};
use crate::sample::{Layout, Scalar, check_text, read_binary, read_text};
use crate::volume::{Geometry, loaded, only_field};
use crate::{Loaded, Options};
use isobar_core::{DMat3, DVec3};
use std::collections::BTreeMap;

const FORMAT: &str = "NRRD header";
/// A header is a page of text; more than this is not one.
const MOST_HEADER: u64 = 1 << 20;

/// The fields of the header that matter here.
struct Header {
    fields: BTreeMap<String, String>,
    /// Where attached samples start, bytes.
    end: u64,
}

/// The encodings.
#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Raw,
    Gzip,
    Text,
}

/// Reads an NRRD file.
pub(crate) fn read(input: &dyn Input, o: &Options) -> Result<Loaded, Cause> {
    let header = Header::read(input)?;
    let scalar = header.scalar()?;
    let axes = header.axes()?;
    let geometry = header.geometry(&axes)?;
    let n = geometry.check()?;
    let encoding = header.encoding()?;
    let big_endian = header.big_endian(scalar, encoding)?;

    let named = [Named {
        name: header.get("content").unwrap_or("value").to_owned(),
        components: axes.components,
        on_cells: false,
    }];
    let all = choices(&named);
    let (field, pick) = if axes.components == 1 {
        (only_field(&all[0].name, o)?, all[0].pick)
    } else {
        let c = choose(&all, &named, o.field.as_deref())?;
        (c.name.clone(), c.pick)
    };
    let layout = Layout {
        scalar,
        big_endian,
        components: axes.components,
        pick,
        count: n,
        scale: None,
    };

    let mut notes = Vec::new();
    let samples = match header.data_file()? {
        None => read_samples(input, &header, header.end, encoding, &layout, &mut notes)?,
        Some(name) => {
            let data = input.beside(name)?;
            read_samples(&*data, &header, 0, encoding, &layout, &mut notes).map_err(|cause| Cause::Detached {
                name: quoted(name),
                cause: Box::new(cause),
            })?
        }
    };
    loaded(geometry, samples, field, all.into_iter().map(|c| c.name).collect(), notes, o)
}

/// Line skip, byte skip, size check, samples.
fn read_samples(
    input: &dyn Input,
    header: &Header,
    start: u64,
    encoding: Encoding,
    layout: &Layout,
    notes: &mut Vec<String>,
) -> Result<isobar_core::Samples, Cause> {
    let mut at = start;
    let lines = header.skip("line skip", "lineskip")?;
    if lines > 0 {
        let mut reader = input.open(at)?;
        for _ in 0..lines {
            // Each line takes a byte, so a hostile count ends with the file.
            let mut read = 0;
            let n = skip_line(&mut *reader, &mut read)?;
            at += read;
            if !n {
                return Err(Cause::malformed(FORMAT, format!("line skip {lines} goes beyond the file")));
            }
        }
    }
    let bytes = layout.bytes().ok_or(Cause::Dims([layout.count as u64, 1, 1]))?;
    let skip = header.skip("byte skip", "byteskip")?;
    if encoding == Encoding::Text {
        let at = at.saturating_add(u64::try_from(skip).unwrap_or(0));
        check_text(layout, input.len().saturating_sub(at))?;
        return read_text(&mut *input.open(at)?, layout, notes);
    }
    let mut extra_is_meant = false;
    let (packing, skip) = match (encoding, u64::try_from(skip)) {
        (Encoding::Gzip, Ok(skip)) => (Packing::Gzip, skip),
        (Encoding::Gzip, Err(_)) => return Err(Cause::malformed(FORMAT, "byte skip -1 is for raw encoding only")),
        (_, Ok(skip)) => (Packing::None, skip),
        (_, Err(_)) => {
            // -1: the samples are the end of the file.
            extra_is_meant = true;
            let there = input.len().saturating_sub(at);
            (Packing::None, there.saturating_sub(bytes))
        }
    };
    let mut reader = sized(input, at, packing, skip, bytes)?;
    let samples = read_binary(&mut *reader, layout, notes)?;
    if finish(&mut *reader)? && !extra_is_meant {
        notes.push("the file has more samples than its header declares; they were ignored".into());
    }
    Ok(samples)
}

/// Skips to the next line; false at the end of the stream.
fn skip_line(reader: &mut dyn std::io::BufRead, read: &mut u64) -> Result<bool, Cause> {
    loop {
        let buffer = reader.fill_buf().map_err(|e| Cause::system("read", &e))?;
        if buffer.is_empty() {
            return Ok(false);
        }
        let end = buffer.iter().position(|&b| b == b'\n');
        let n = end.map_or(buffer.len(), |e| e + 1);
        reader.consume(n);
        *read += n as u64;
        if end.is_some() {
            return Ok(true);
        }
    }
}

/// Which axes are space, and what is left.
struct Axes {
    sizes: Vec<u64>,
    /// Index of the first space axis, 0 or 1.
    first: usize,
    /// Values per sample.
    components: usize,
}

impl Header {
    fn read(input: &dyn Input) -> Result<Self, Cause> {
        let mut reader = input.open(0)?;
        let mut end = 0;
        let magic = line(&mut *reader, 4096, &mut end, FORMAT)?.unwrap_or_default();
        if !matches!(
            magic.trim_end(),
            "NRRD0001" | "NRRD0002" | "NRRD0003" | "NRRD0004" | "NRRD0005"
        ) {
            return Err(Cause::malformed(
                FORMAT,
                format!("magic {} is not NRRD0001 to NRRD0005", quoted(&magic)),
            ));
        }
        let mut fields = BTreeMap::new();
        // A header without a blank line after it is one whose samples are elsewhere.
        while let Some(text) = line(&mut *reader, 64 << 10, &mut end, FORMAT)? {
            if text.is_empty() {
                break;
            }
            if end > MOST_HEADER {
                return Err(Cause::malformed(
                    FORMAT,
                    format!("no blank line in its first {MOST_HEADER} bytes"),
                ));
            }
            if text.starts_with('#') {
                continue;
            }
            // "key:=value" is free text, "field: value" is the header.
            let field = text.find(": ").or_else(|| text.ends_with(':').then(|| text.len() - 1));
            let key = text.find(":=");
            let Some(colon) = field.filter(|&f| key.is_none_or(|k| f < k)) else {
                if key.is_some() {
                    continue;
                }
                return Err(Cause::malformed(
                    FORMAT,
                    format!("line {} is not \"field: value\"", quoted(&text)),
                ));
            };
            let name = text[..colon].trim().to_ascii_lowercase();
            let value = text.get(colon + 1..).unwrap_or_default().trim().to_owned();
            if fields.insert(name.clone(), value).is_some() {
                return Err(Cause::malformed(FORMAT, format!("field {} stands twice", quoted(&name))));
            }
        }
        Ok(Self { fields, end })
    }

    fn get(&self, name: &str) -> Option<&str> {
        self.fields.get(name).map(String::as_str)
    }

    fn need(&self, name: &str) -> Result<&str, Cause> {
        self.get(name)
            .ok_or_else(|| Cause::malformed(FORMAT, format!("field {name:?} is missing")))
    }

    fn scalar(&self) -> Result<Scalar, Cause> {
        let text = self.need("type")?;
        let words: Vec<String> = text.split_whitespace().map(str::to_ascii_lowercase).collect();
        Ok(match words.join(" ").as_str() {
            "signed char" | "int8" | "int8_t" => Scalar::I8,
            "uchar" | "unsigned char" | "uint8" | "uint8_t" => Scalar::U8,
            "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Scalar::I16,
            "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Scalar::U16,
            "int" | "signed int" | "int32" | "int32_t" => Scalar::I32,
            "uint" | "unsigned int" | "uint32" | "uint32_t" => Scalar::U32,
            "longlong" | "long long" | "long long int" | "signed long long" | "signed long long int" | "int64" | "int64_t" => {
                Scalar::I64
            }
            "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Scalar::U64,
            "float" => Scalar::F32,
            "double" => Scalar::F64,
            _ => {
                return Err(Cause::malformed(
                    FORMAT,
                    format!("type {} is not a number type", quoted(text)),
                ));
            }
        })
    }

    fn encoding(&self) -> Result<Encoding, Cause> {
        let text = self.need("encoding")?;
        match text.to_ascii_lowercase().as_str() {
            "raw" => Ok(Encoding::Raw),
            "gz" | "gzip" => Ok(Encoding::Gzip),
            "txt" | "text" | "ascii" => Ok(Encoding::Text),
            _ => Err(Cause::Unsupported {
                format: "NRRD",
                what: format!("encoding {}", quoted(text)),
                remedy: "write it with encoding raw, gzip or text",
            }),
        }
    }

    fn big_endian(&self, scalar: Scalar, encoding: Encoding) -> Result<bool, Cause> {
        match self.get("endian").map(str::to_ascii_lowercase).as_deref() {
            Some("little") => Ok(false),
            Some("big") => Ok(true),
            Some(other) => Err(Cause::malformed(
                FORMAT,
                format!("endian {} is not little or big", quoted(other)),
            )),
            None if scalar.bytes() == 1 || encoding == Encoding::Text => Ok(false),
            None => Err(Cause::malformed(FORMAT, "field \"endian\" is missing, little or big")),
        }
    }

    /// A skip; -1 only for bytes.
    fn skip(&self, name: &str, other: &str) -> Result<i64, Cause> {
        let Some(text) = self.get(name).or(self.get(other)) else {
            return Ok(0);
        };
        let least = if name == "byte skip" { -1 } else { 0 };
        text.parse::<i64>()
            .ok()
            .filter(|&n| n >= least)
            .ok_or_else(|| Cause::malformed(FORMAT, format!("{name} {} is not a count", quoted(text))))
    }

    fn data_file(&self) -> Result<Option<&str>, Cause> {
        let Some(name) = self.get("data file").or(self.get("datafile")) else {
            return Ok(None);
        };
        if name == "LIST" || name.starts_with("LIST ") || name.contains('%') {
            return Err(Cause::Unsupported {
                format: "NRRD",
                what: format!("samples in several files ({})", quoted(name)),
                remedy: "join the slices into one data file",
            });
        }
        if name.is_empty() {
            return Err(Cause::malformed(FORMAT, "field \"data file\" names nothing"));
        }
        Ok(Some(name))
    }

    fn axes(&self) -> Result<Axes, Cause> {
        let dimension = self.need("dimension")?;
        let n: usize = dimension
            .parse()
            .ok()
            .filter(|n| (1..=16).contains(n))
            .ok_or_else(|| Cause::malformed(FORMAT, format!("dimension {} is not 1 to 16", quoted(dimension))))?;
        let text = self.need("sizes")?;
        let sizes: Vec<u64> = text.split_whitespace().filter_map(|w| w.parse().ok()).collect();
        if sizes.len() != n || text.split_whitespace().count() != n || sizes.contains(&0) {
            return Err(Cause::malformed(
                FORMAT,
                format!("sizes {} are not {n} positive counts", quoted(text)),
            ));
        }
        let first = usize::from(n > 3 && self.is_component_axis(0));
        if n < 3 || sizes.iter().skip(first + 3).any(|&s| s != 1) {
            return Err(Cause::Unsupported {
                format: "NRRD",
                what: format!("{n} axes of sizes {}", quoted(text)),
                remedy: "write three space axes, or a component axis (kind vector or list) before three",
            });
        }
        let components = if first == 1 { sizes[0] } else { 1 };
        let components = usize::try_from(components)
            .ok()
            .filter(|&c| c <= 64)
            .ok_or_else(|| Cause::malformed(FORMAT, format!("{components} components per sample, at most 64 are read")))?;
        Ok(Axes {
            sizes,
            first,
            components,
        })
    }

    /// By `kinds`, else by `space directions`.
    fn is_component_axis(&self, axis: usize) -> bool {
        if let Some(kind) = self.get("kinds").and_then(|k| k.split_whitespace().nth(axis)) {
            return !matches!(
                kind.to_ascii_lowercase().as_str(),
                "domain" | "space" | "time" | "???" | "none"
            );
        }
        self.get("space directions")
            .and_then(|d| vectors(d).ok())
            .is_some_and(|v| v.get(axis).is_some_and(Option::is_none))
    }

    /// Numbers of the three space axes from a per-axis field; NaN where the field is absent or does not say.
    fn per_axis(&self, axes: &Axes, names: [&str; 2]) -> Result<Option<DVec3>, Cause> {
        let Some(text) = self.get(names[0]).or(self.get(names[1])) else {
            return Ok(None);
        };
        let words: Vec<&str> = text.split_whitespace().collect();
        let bad = || {
            Cause::malformed(
                FORMAT,
                format!("{} {} are not {} numbers", names[0], quoted(text), axes.sizes.len()),
            )
        };
        if words.len() != axes.sizes.len() {
            return Err(bad());
        }
        let mut out = DVec3::ZERO;
        for (axis, word) in words[axes.first..axes.first + 3].iter().enumerate() {
            out[axis] = word.parse().map_err(|_| bad())?;
        }
        Ok(Some(out))
    }

    fn geometry(&self, axes: &Axes) -> Result<Geometry, Cause> {
        let dims = [0, 1, 2].map(|a| axes.sizes[axes.first + a]);
        if let Some(text) = self.get("space directions") {
            return self.space_geometry(axes, dims, text);
        }
        let cell = ["centers", "centerings"].iter().find_map(|n| self.get(n)).map(|c| {
            c.split_whitespace()
                .map(|w| w.eq_ignore_ascii_case("cell"))
                .collect::<Vec<_>>()
        });
        let is_cell = |axis: usize| cell.as_ref().and_then(|c| c.get(axes.first + axis)).copied().unwrap_or(false);
        let min = self.per_axis(axes, ["axis mins", "axismins"])?;
        let max = self.per_axis(axes, ["axis maxs", "axismaxs"])?;
        let mut spacing = DVec3::ONE;
        if let Some(s) = self.per_axis(axes, ["spacings", "spacing"])? {
            spacing = s;
        } else if let (Some(min), Some(max)) = (min, max) {
            for axis in 0..3 {
                let steps = dims[axis] as f64 - f64::from(u8::from(!is_cell(axis)));
                if steps > 0.0 {
                    spacing[axis] = (max[axis] - min[axis]) / steps;
                }
            }
        }
        let mut origin = match self.get("space origin") {
            Some(text) => one_vector(text)?,
            None => DVec3::ZERO,
        };
        if let Some(min) = min {
            for axis in 0..3 {
                // A NaN says that this axis has no minimum.
                if !min[axis].is_nan() {
                    let half = if is_cell(axis) { 0.5 * spacing[axis] } else { 0.0 };
                    origin[axis] = min[axis] + half;
                }
            }
        }
        Ok(Geometry::aligned(dims, spacing, origin))
    }

    fn space_geometry(&self, axes: &Axes, dims: [u64; 3], text: &str) -> Result<Geometry, Cause> {
        let all = vectors(text)?;
        let space: Vec<DVec3> = all.iter().skip(axes.first).take(3).copied().flatten().collect();
        if all.len() != axes.sizes.len() || space.len() != 3 {
            return Err(Cause::malformed(
                FORMAT,
                format!(
                    "space directions {} are not a vector of three numbers for each of three axes",
                    quoted(text)
                ),
            ));
        }
        let origin = self.get("space origin").map_or(Ok(DVec3::ZERO), one_vector)?;
        Ok(Geometry::from_steps(
            dims,
            DMat3::from_cols(space[0], space[1], space[2]),
            origin,
        ))
    }
}

fn one_vector(text: &str) -> Result<DVec3, Cause> {
    match vectors(text)?.as_slice() {
        [Some(v)] => Ok(*v),
        _ => Err(Cause::malformed(
            FORMAT,
            format!("space origin {} is not one vector (x,y,z)", quoted(text)),
        )),
    }
}

/// `(x,y,z) none (x,y,z)`, with any white space.
fn vectors(text: &str) -> Result<Vec<Option<DVec3>>, Cause> {
    let bad = || Cause::malformed(FORMAT, format!("{} is not a list of vectors (x,y,z)", quoted(text)));
    let mut rest = text.trim();
    let mut all = Vec::new();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            all.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inside, after) = rest.strip_prefix('(').and_then(|r| r.split_once(')')).ok_or_else(bad)?;
        let numbers: Vec<f64> = inside
            .split(',')
            .map(|w| w.trim().parse().map_err(|_| bad()))
            .collect::<Result<_, _>>()?;
        let [x, y, z] = numbers[..] else { return Err(bad()) };
        all.push(Some(DVec3::new(x, y, z)));
        rest = after.trim_start();
    }
    Ok(all)
}
