//! VTK XML image data (`.vti`): the header; its scan of the tags also serves meshes (`.vtu`, [`crate::vtu`]). The samples are found by position and read by [`crate::vti_data`].
//!
//! Format: VTK file formats, "XML file formats", <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>. The crate
//! `vtkio` 0.7.0-rc2 was tried and is not used: of 300 single flipped bits in a header 27 made it panic, it refuses raw appended data, and
//! it keeps the whole text. Here `quick-xml` reads the tags while the text of arrays is skipped, so the file is never held in memory.
//!
//! One piece; point data are samples at points, cell data a sample at each cell centre. `Direction` is read (row-major, its columns are the
//! axes).

use crate::error::{Cause, quoted};
use crate::field::{Named, choices, choose};
use crate::input::Input;
use crate::sample::{Layout, Scalar};
use crate::volume::{Geometry, loaded};
use crate::{Loaded, Options, vti_data, vtu};
use isobar_core::{DMat3, DVec3};
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;
use std::io::BufRead;
use std::ops::Range;

pub(crate) const FORMAT: &str = "VTK XML file";

/// Where the text or bytes of an array are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Place {
    /// Numbers as text in the file's bytes `range`.
    Ascii(Range<u64>),
    /// Base64 in the file's bytes `range`.
    Inline(Range<u64>),
    /// At this offset of the appended data.
    Appended(u64),
}

/// A `DataArray` of the piece.
#[derive(Debug)]
pub(crate) struct Array {
    pub(crate) named: Named,
    pub(crate) scalar: Option<Scalar>,
    pub(crate) place: Place,
}

/// Which part of a piece an array stands in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Section {
    PointData,
    CellData,
    Points,
    Cells,
}

/// What the file says of all its arrays.
#[derive(Debug)]
pub(crate) struct Storage {
    pub(crate) big_endian: bool,
    /// Bytes of a header word: 4 or 8.
    pub(crate) word: usize,
    pub(crate) zlib: bool,
    /// Start of the appended data (the byte after `_`) and whether they are base64.
    pub(crate) appended: Option<(u64, bool)>,
}

/// Everything but samples.
pub(crate) struct Image {
    pub(crate) storage: Storage,
    /// A mesh, not an image.
    pub(crate) unstructured: bool,
    /// The part of the file's version behind the point: 2 since VTK 9.
    pub(crate) minor: u32,
    /// NumberOfPoints and NumberOfCells of a mesh.
    pub(crate) counts: [u64; 2],
    /// Arrays of Points (false) and Cells (true).
    pub(crate) cells: Vec<(Section, Array)>,
    extent: [i64; 6],
    origin: DVec3,
    spacing: DVec3,
    direction: DMat3,
    pieces: usize,
    pub(crate) arrays: Vec<Array>,
}

/// Reads a VTI or VTU file.
pub(crate) fn read(input: &dyn Input, o: &Options) -> Result<Loaded, Cause> {
    let image = Scan::new(input)?.run()?;
    match image.pieces {
        0 => return Err(malformed("there is no Piece")),
        1 => {}
        n => {
            return Err(Cause::Unsupported {
                format: "VTK XML",
                what: format!("{n} pieces"),
                remedy: "write the data as one piece",
            });
        }
    }
    if image.unstructured {
        return vtu::read(input, &image, o);
    }
    let named: Vec<Named> = image.arrays.iter().map(|a| a.named.clone()).collect();
    let all = choices(&named);
    let choice = choose(&all, &named, o.field.as_deref())?.clone();
    let array = &image.arrays[choice.array];
    let geometry = image.geometry(array.named.on_cells)?;
    let layout = Layout {
        scalar: array.scalar.ok_or_else(|| Cause::Unsupported {
            format: "VTI",
            what: format!("array {} of a type that is not a number", quoted(&array.named.name)),
            remedy: "choose another with --field",
        })?,
        big_endian: image.storage.big_endian,
        components: array.named.components,
        pick: choice.pick,
        count: geometry.check()?,
        scale: None,
    };
    let mut notes = Vec::new();
    let samples = vti_data::read(input, &image.storage, &array.place, &layout, &mut notes)?;
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

impl Image {
    fn geometry(&self, on_cells: bool) -> Result<Geometry, Cause> {
        let e = self.extent;
        let mut dims = [0u64; 3];
        for (axis, d) in dims.iter_mut().enumerate() {
            let points = e[2 * axis + 1]
                .checked_sub(e[2 * axis])
                .and_then(|n| n.checked_add(1))
                .and_then(|n| u64::try_from(n).ok())
                .filter(|&n| n > 0)
                .ok_or_else(|| malformed(format!("extent {e:?} is empty or reversed")))?;
            // A flat image has one layer of cells.
            *d = if on_cells { (points - 1).max(1) } else { points };
        }
        let steps = DMat3::from_cols(
            self.direction.x_axis * self.spacing.x,
            self.direction.y_axis * self.spacing.y,
            self.direction.z_axis * self.spacing.z,
        );
        let half = if on_cells { DVec3::splat(0.5) } else { DVec3::ZERO };
        let first = DVec3::new(e[0] as f64, e[2] as f64, e[4] as f64) + half;
        Ok(Geometry::from_steps(dims, steps, self.origin).shifted(first))
    }
}

/// One pass over the tags.
struct Scan<'a> {
    reader: Reader<Box<dyn BufRead + 'a>>,
    image: Image,
    /// Inside this part of the piece.
    section: Option<Section>,
    seen_file: bool,
    seen_image: bool,
}

impl<'a> Scan<'a> {
    fn new(input: &'a dyn Input) -> Result<Self, Cause> {
        Ok(Self {
            reader: Reader::from_reader(input.open(0)?),
            image: Image {
                storage: Storage {
                    big_endian: false,
                    word: 4,
                    zlib: false,
                    appended: None,
                },
                unstructured: false,
                minor: 0,
                counts: [0; 2],
                cells: Vec::new(),
                extent: [0, -1, 0, -1, 0, -1],
                origin: DVec3::ZERO,
                spacing: DVec3::ONE,
                direction: DMat3::IDENTITY,
                pieces: 0,
                arrays: Vec::new(),
            },
            section: None,
            seen_file: false,
            seen_image: false,
        })
    }

    fn run(mut self) -> Result<Image, Cause> {
        let mut buffer = Vec::new();
        loop {
            buffer.clear();
            let event = self
                .reader
                .read_event_into(&mut buffer)
                .map_err(|e| malformed(format!("its XML is broken: {e}")))?;
            match event {
                Event::Start(tag) => {
                    let tag = tag.into_owned();
                    if tag.name().as_ref() == "AppendedData" {
                        self.appended(&tag)?;
                        break;
                    }
                    self.open(&tag, false)?;
                }
                Event::Empty(tag) => {
                    let tag = tag.into_owned();
                    self.open(&tag, true)?;
                }
                Event::End(tag) => {
                    if matches!(tag.name().as_ref(), "PointData" | "CellData" | "Points" | "Cells") {
                        self.section = None;
                    }
                }
                Event::Eof => break,
                _ => {}
            }
        }
        if !self.seen_file || !self.seen_image {
            return Err(malformed(
                "there is no ImageData or UnstructuredGrid in a VTKFile (is the file cut short?)",
            ));
        }
        Ok(self.image)
    }

    fn open(&mut self, tag: &BytesStart<'_>, empty: bool) -> Result<(), Cause> {
        match tag.name().as_ref() {
            "VTKFile" => self.file(tag)?,
            "ImageData" => self.image_data(tag)?,
            "UnstructuredGrid" => self.seen_image = true,
            "Piece" => {
                self.image.pieces += 1;
                for (name, n) in ["NumberOfPoints", "NumberOfCells"].iter().zip(&mut self.image.counts) {
                    if let Some(text) = attribute(tag, name)? {
                        [*n] = numbers(&text, name)?;
                    }
                }
                if let Some(text) = attribute(tag, "Extent")? {
                    self.image.extent = numbers(&text, "Extent")?;
                }
            }
            "PointData" if !empty => self.section = Some(Section::PointData),
            "CellData" if !empty => self.section = Some(Section::CellData),
            "Points" if !empty => self.section = Some(Section::Points),
            "Cells" if !empty => self.section = Some(Section::Cells),
            "DataArray" => {
                // Text is skipped also where the array is not of the piece (FieldData).
                let place = self.place(tag, empty)?;
                if let (Some(section), Some(place)) = (self.section, place) {
                    let array = array(tag, section == Section::CellData, place)?;
                    match section {
                        Section::PointData | Section::CellData => self.image.arrays.push(array),
                        Section::Points | Section::Cells => self.image.cells.push((section, array)),
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn file(&mut self, tag: &BytesStart<'_>) -> Result<(), Cause> {
        let kind = attribute(tag, "type")?.unwrap_or_default();
        self.image.unstructured = kind == "UnstructuredGrid";
        if kind != "ImageData" && !self.image.unstructured {
            return Err(Cause::NotYet(format!("VTK XML data of type {}", quoted(&kind))));
        }
        self.seen_file = true;
        let version = attribute(tag, "version")?.unwrap_or_default();
        self.image.minor = version.split_once('.').and_then(|(_, m)| m.trim().parse().ok()).unwrap_or(0);
        let s = &mut self.image.storage;
        s.big_endian = match attribute(tag, "byte_order")?.as_deref() {
            None | Some("LittleEndian") => false,
            Some("BigEndian") => true,
            Some(other) => return Err(malformed(format!("byte_order {} is unknown", quoted(other)))),
        };
        s.word = match attribute(tag, "header_type")?.as_deref() {
            None | Some("UInt32") => 4,
            Some("UInt64") => 8,
            Some(other) => return Err(malformed(format!("header_type {} is not UInt32 or UInt64", quoted(other)))),
        };
        s.zlib = match attribute(tag, "compressor")?.as_deref() {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                return Err(Cause::Unsupported {
                    format: "VTK XML",
                    what: format!("compressor {}", quoted(other)),
                    remedy: "write it with vtkZLibDataCompressor or without compression",
                });
            }
        };
        Ok(())
    }

    fn image_data(&mut self, tag: &BytesStart<'_>) -> Result<(), Cause> {
        self.seen_image = true;
        let vector = |name: &str, default: DVec3| -> Result<DVec3, Cause> {
            attribute(tag, name)?.map_or(Ok(default), |t| Ok(DVec3::from_array(numbers(&t, name)?)))
        };
        self.image.origin = vector("Origin", DVec3::ZERO)?;
        self.image.spacing = vector("Spacing", DVec3::ONE)?;
        if let Some(text) = attribute(tag, "Direction")? {
            let rows: [f64; 9] = numbers(&text, "Direction")?;
            self.image.direction = DMat3::from_cols_array(&rows).transpose();
        }
        if let Some(text) = attribute(tag, "WholeExtent")? {
            self.image.extent = numbers(&text, "WholeExtent")?;
        }
        Ok(())
    }

    /// Where the samples of an array are; skips its text. `None` for an array that says nothing usable.
    fn place(&mut self, tag: &BytesStart<'_>, empty: bool) -> Result<Option<Place>, Cause> {
        let format = attribute(tag, "format")?.unwrap_or_else(|| "ascii".into());
        if format == "appended" {
            let text = attribute(tag, "offset")?.unwrap_or_default();
            return text
                .trim()
                .parse()
                .map(|offset| Some(Place::Appended(offset)))
                .map_err(|_| malformed(format!("offset {} is not a count", quoted(&text))));
        }
        if empty {
            return Ok(None);
        }
        let start = self.reader.buffer_position();
        let mut stream = self.reader.stream();
        loop {
            let buffer = stream.fill_buf().map_err(|e| Cause::system("read", &e))?;
            if buffer.is_empty() {
                return Err(malformed("an array is not closed; the file is cut short"));
            }
            let end = buffer.iter().position(|&b| b == b'<');
            let n = end.unwrap_or(buffer.len());
            stream.consume(n);
            if end.is_some() {
                break;
            }
        }
        let range = start..stream.offset();
        match format.as_str() {
            "ascii" => Ok(Some(Place::Ascii(range))),
            "binary" => Ok(Some(Place::Inline(range))),
            other => Err(malformed(format!("array format {} is unknown", quoted(other)))),
        }
    }

    /// The `_` that starts the appended data. What follows need not be XML.
    fn appended(&mut self, tag: &BytesStart<'_>) -> Result<(), Cause> {
        let base64 = match attribute(tag, "encoding")?.as_deref() {
            None | Some("base64") => true,
            Some("raw") => false,
            Some(other) => return Err(malformed(format!("appended encoding {} is unknown", quoted(other)))),
        };
        let mut stream = self.reader.stream();
        loop {
            let buffer = stream.fill_buf().map_err(|e| Cause::system("read", &e))?;
            match buffer.first() {
                Some(b'_') => {
                    stream.consume(1);
                    self.image.storage.appended = Some((stream.offset(), base64));
                    return Ok(());
                }
                Some(b) if b.is_ascii_whitespace() => stream.consume(1),
                _ => return Err(malformed("the appended data do not start with \"_\"")),
            }
        }
    }
}

fn array(tag: &BytesStart<'_>, on_cells: bool, place: Place) -> Result<Array, Cause> {
    let components = match attribute(tag, "NumberOfComponents")? {
        None => 1,
        Some(text) => text
            .trim()
            .parse()
            .ok()
            .filter(|&n: &usize| n > 0)
            .ok_or_else(|| malformed(format!("NumberOfComponents {} is not a count", quoted(&text))))?,
    };
    let scalar = match attribute(tag, "type")?.as_deref() {
        Some("Int8") => Some(Scalar::I8),
        Some("UInt8") => Some(Scalar::U8),
        Some("Int16") => Some(Scalar::I16),
        Some("UInt16") => Some(Scalar::U16),
        Some("Int32") => Some(Scalar::I32),
        Some("UInt32") => Some(Scalar::U32),
        Some("Int64") => Some(Scalar::I64),
        Some("UInt64") => Some(Scalar::U64),
        Some("Float32") => Some(Scalar::F32),
        Some("Float64") => Some(Scalar::F64),
        _ => None,
    };
    Ok(Array {
        named: Named {
            name: attribute(tag, "Name")?.unwrap_or_default(),
            components,
            on_cells,
        },
        scalar,
        place,
    })
}

fn attribute(tag: &BytesStart<'_>, name: &str) -> Result<Option<String>, Cause> {
    let broken = |e: &dyn std::fmt::Display| malformed(format!("its XML is broken: {e}"));
    match tag.try_get_attribute(name).map_err(|e| broken(&e))? {
        None => Ok(None),
        Some(a) => a
            .normalized_value(XmlVersion::Implicit1_0)
            .map(|v| Some(v.into_owned()))
            .map_err(|e| broken(&e)),
    }
}

fn numbers<T: std::str::FromStr + Copy, const N: usize>(text: &str, what: &str) -> Result<[T; N], Cause> {
    let all: Vec<T> = text.split_whitespace().map_while(|w| w.parse().ok()).collect();
    if text.split_whitespace().count() != N {
        return Err(malformed(format!("{what} {} is not {N} numbers", quoted(text))));
    }
    all.try_into()
        .map_err(|_| malformed(format!("{what} {} is not {N} numbers", quoted(text))))
}
