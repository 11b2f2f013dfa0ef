//! Small files of every format, made by hand: the volume of all of them is 3 x 4 x 5 with sample i equal to [`value`]\(i\).

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use isobar_core::{Data, Grid, Samples};
use isobar_io::{IoError, Loaded, Options, load_bytes};
use std::io::Write;

/// Samples per axis of the test volume.
pub(crate) const DIMS: [usize; 3] = [3, 4, 5];
/// Samples of the test volume.
pub(crate) const N: usize = 60;

/// Sample i, exact in every type.
pub(crate) fn value(i: usize) -> f64 {
    (i % 100) as f64
}

/// The samples as bytes of a type, by the name NRRD has for it.
pub(crate) fn bytes(kind: &str, big: bool) -> Vec<u8> {
    (0..N).flat_map(|i| one(kind, big, value(i))).collect()
}

/// One value as bytes.
pub(crate) fn one(kind: &str, big: bool, v: f64) -> Vec<u8> {
    let mut b = match kind {
        "int8" => (v as i8).to_le_bytes().to_vec(),
        "uint8" => (v as u8).to_le_bytes().to_vec(),
        "int16" => (v as i16).to_le_bytes().to_vec(),
        "uint16" => (v as u16).to_le_bytes().to_vec(),
        "int32" => (v as i32).to_le_bytes().to_vec(),
        "uint32" => (v as u32).to_le_bytes().to_vec(),
        "int64" => (v as i64).to_le_bytes().to_vec(),
        "uint64" => (v as u64).to_le_bytes().to_vec(),
        "float" => (v as f32).to_le_bytes().to_vec(),
        "double" => v.to_le_bytes().to_vec(),
        other => panic!("no type {other}"),
    };
    if big {
        b.reverse();
    }
    b
}

/// The type a volume of this type is kept in.
pub(crate) fn kept(kind: &str) -> &'static str {
    match kind {
        "uint8" => "u8",
        "int16" => "i16",
        "uint16" => "u16",
        _ => "f32",
    }
}

pub(crate) const KINDS: [&str; 10] = [
    "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float", "double",
];

pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut e = GzEncoder::new(Vec::new(), Compression::new(6));
    e.write_all(bytes).unwrap();
    e.finish().unwrap()
}

pub(crate) fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut e = ZlibEncoder::new(Vec::new(), Compression::new(6));
    e.write_all(bytes).unwrap();
    e.finish().unwrap()
}

pub(crate) fn base64(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}

/// A file: text and bytes one after another.
pub(crate) fn join(parts: &[&[u8]]) -> Vec<u8> {
    parts.concat()
}

/// A NIfTI-1 header of the test volume with its four flag bytes; little-endian, spacing 1, no sform, no qform, no scaling.
pub(crate) fn nifti_header(datatype: i16, bits: i16) -> Vec<u8> {
    let mut h = vec![0u8; 352];
    put(&mut h, 0, &348i32.to_le_bytes());
    for (i, d) in [3i16, 3, 4, 5, 1, 1, 1, 1].iter().enumerate() {
        put(&mut h, 40 + 2 * i, &d.to_le_bytes());
    }
    put(&mut h, 70, &datatype.to_le_bytes());
    put(&mut h, 72, &bits.to_le_bytes());
    for i in 0..8 {
        put(&mut h, 76 + 4 * i, &1f32.to_le_bytes());
    }
    put(&mut h, 108, &352f32.to_le_bytes());
    put(&mut h, 344, b"n+1\0");
    h
}

/// Overwrites bytes.
pub(crate) fn put(bytes: &mut [u8], at: usize, what: &[u8]) {
    bytes[at..at + what.len()].copy_from_slice(what);
}

/// A VTI file around an array element and what follows the image.
pub(crate) fn vti(attributes: &str, arrays: &str, after: &[u8]) -> Vec<u8> {
    join(&[
        format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"0.1\" {attributes}>\n\
             <ImageData WholeExtent=\"0 2 0 3 0 4\" Origin=\"1 2 3\" Spacing=\"0.5 1 2\">\n\
             <FieldData><DataArray type=\"String\" Name=\"note\" format=\"ascii\"> 65 0 </DataArray></FieldData>\n\
             <Piece Extent=\"0 2 0 3 0 4\">{arrays}</Piece></ImageData>\n"
        )
        .as_bytes(),
        after,
        b"</VTKFile>\n",
    ])
}

/// The text of the samples.
pub(crate) fn text() -> String {
    (0..N).map(|i| format!("{} ", value(i))).collect()
}

pub(crate) fn grid(loaded: &Loaded) -> &Grid {
    match &loaded.data {
        Data::Grid(g) => g,
        other => panic!("a grid was expected, not {}", other.kind()),
    }
}

/// Reads with default options.
pub(crate) fn load(name: &str, bytes: &[u8]) -> Result<Loaded, IoError> {
    load_bytes(name, bytes, &Options::default())
}

/// Reads one field.
pub(crate) fn load_field(bytes: &[u8], field: &str) -> Result<Loaded, IoError> {
    let o = Options {
        field: Some(field.into()),
        ..Options::default()
    };
    load_bytes("test", bytes, &o)
}

/// Checks that this is the test volume.
pub(crate) fn assert_volume(loaded: &Loaded, kept: &str) {
    let g = grid(loaded);
    assert_eq!(g.dims, DIMS);
    assert_eq!(g.samples.type_name(), kept);
    for i in 0..N {
        assert_eq!(g.samples.get(i), value(i), "sample {i}");
    }
    assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
}

/// All samples.
pub(crate) fn samples(loaded: &Loaded) -> Vec<f64> {
    let s: &Samples = &grid(loaded).samples;
    (0..s.len()).map(|i| s.get(i)).collect()
}

/// Deterministic numbers for mutations (SplitMix64).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Below n.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}
