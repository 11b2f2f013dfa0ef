//! Every fuzz target on stable Rust: the committed corpus, its truncations and seeded mutations. No function may panic.

use crate::build::{Random, base64, bytes, gzip, join, nifti_header, one, vti, zlib};
use crate::cells;
use crate::hexes;
use crate::meshes::ply;
use isobar_io::fuzz;
use std::path::{Path, PathBuf};

/// A fuzz target: its name, its function.
type Target = (&'static str, fn(&[u8]));

const TARGETS: [Target; 10] = [
    ("nrrd", fuzz::nrrd),
    ("nifti", fuzz::nifti),
    ("vti", fuzz::vti),
    ("vtk", fuzz::vtk),
    ("vtu", fuzz::vtu),
    ("plot3d", fuzz::plot3d),
    ("nurbs", fuzz::nurbs),
    ("mfem", fuzz::mfem),
    ("off", fuzz::off),
    ("ply", fuzz::ply),
];
/// Largest file of the corpus, bytes.
const LARGEST: usize = 4 << 10;

fn corpus(target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target)
}

fn files(target: &str) -> Vec<(String, Vec<u8>)> {
    let mut all: Vec<_> = std::fs::read_dir(corpus(target))
        .unwrap()
        .map(|e| e.unwrap().path())
        .map(|p| (p.display().to_string(), std::fs::read(&p).unwrap()))
        .collect();
    all.sort();
    all
}

#[test]
fn no_reader_panics_on_the_corpus_and_its_mutations() {
    for (target, run) in TARGETS {
        let files = files(target);
        assert!(files.len() >= 3, "the corpus of {target} has {} files", files.len());
        let mut random = Random(2010);
        for (name, bytes) in &files {
            assert!(bytes.len() <= LARGEST, "{name} has {} bytes", bytes.len());
            run(bytes);
            for cut in (0..bytes.len()).step_by(1 + bytes.len() / 60) {
                run(&bytes[..cut]);
            }
            for _ in 0..200 {
                let mut changed = bytes.clone();
                mutate(&mut changed, &mut random);
                run(&changed);
            }
        }
    }
}

/// One to four small injuries.
fn mutate(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.below(4) {
        if bytes.is_empty() {
            return;
        }
        let at = random.below(bytes.len());
        match random.below(6) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = [0, 255, 127, 128, b'9', b'-', b' ', b'\n'][random.below(8)],
            2 => bytes.truncate(at),
            3 => {
                bytes.remove(at);
            }
            4 => {
                let part = bytes[at..bytes.len().min(at + 12)].to_vec();
                let to = random.below(bytes.len());
                bytes.splice(to..to, part);
            }
            _ => bytes.splice(at..at, *b"99999").for_each(drop),
        }
    }
}

/// A legacy VTK file of 2 x 2 x 2 samples with most attributes.
fn vtk_small(binary: bool) -> Vec<u8> {
    let numbers = |kind: &str, n: u32| -> Vec<u8> {
        if binary {
            let values: Vec<u8> = (0..n).flat_map(|v| one(kind, true, v.into())).collect();
            join(&[&values, b"\n"])
        } else {
            (0..n).map(|v| format!("{v} ")).collect::<String>().into_bytes()
        }
    };
    join(&[
        format!(
            "# vtk DataFile Version 5.1\nt\n{}\nDATASET STRUCTURED_POINTS\n",
            if binary { "BINARY" } else { "ASCII" }
        )
        .as_bytes(),
        b"DIMENSIONS 2 2 2\nSPACING 1 1 1\nORIGIN 0 0 0\nCELL_DATA 1\nSCALARS c double\nLOOKUP_TABLE default\n",
        &numbers("double", 1),
        b"\nPOINT_DATA 8\nVECTORS v float\n",
        &numbers("float", 24),
        b"\nMETADATA\nINFORMATION 0\n\nSCALARS s%20t short 1\nLOOKUP_TABLE l\n",
        &numbers("int16", 8),
        b"\nLOOKUP_TABLE l 1\n",
        &numbers("uint8", 4),
        b"\nFIELD f 2\na 2 8 int\n",
        &numbers("int32", 16),
        b"\nb 1 3 vtktypeint64\n",
        &numbers("int64", 3),
    ])
}

/// The seeds: one or more files per target that are read without error, made by the builders of these tests.
fn seeds() -> Vec<(&'static str, &'static str, Vec<u8>)> {
    let nrrd =
        |more: &str| format!("NRRD0004\n# c\ntype: short\ndimension: 3\nsizes: 3 4 5\nendian: big\n{more}\n\n").into_bytes();
    let data = bytes("int16", true);
    let vector: Vec<u8> = (0..60)
        .flat_map(|i| [1.0, 2.0, 3.0].map(|k| one("uint8", false, k * f64::from(i))))
        .flatten()
        .collect();
    let nifti = join(&[&nifti_header(2, 8), &bytes("uint8", false)]);
    let float = bytes("float", false);
    let blocks: Vec<Vec<u8>> = float.chunks(100).map(zlib).collect();
    let head: Vec<u8> = [3, 100, 40]
        .into_iter()
        .chain(blocks.iter().map(|b| b.len() as u32))
        .flat_map(u32::to_le_bytes)
        .collect();
    let inline = format!("{}{}", base64(&head), base64(&blocks.concat()));
    let zlib_attribute = "byte_order=\"LittleEndian\" compressor=\"vtkZLibDataCompressor\"";
    let array = |more: &str, body: &str| {
        format!("<PointData Scalars=\"s\"><DataArray type=\"Float32\" Name=\"s\" {more}>{body}</DataArray></PointData>")
    };
    let appended = array("format=\"appended\" offset=\"0\"", "");
    let raw = join(&[
        b"<AppendedData encoding=\"raw\">_",
        &240u64.to_le_bytes(),
        &float,
        b"</AppendedData>",
    ]);
    // A grid without flags: its size is 72 bytes less.
    let with = cells::plot3d();
    let size = u32::from_be_bytes([with[0], with[1], with[2], with[3]]) as usize - 72;
    let plain = join(&[&(size as u32).to_be_bytes(), &with[4..4 + size], &with[4 + size + 72..]]);
    let off = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 .5\n4 0 1 2 3\n3 3 2 1\n";
    let mut all = vec![
        ("nrrd", "raw", join(&[&nrrd("spacings: 1 2 3\nencoding: raw"), &data])),
        ("nrrd", "gzip", join(&[&nrrd("space directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (1,2,3)\nencoding: gzip"), &gzip(&data)])),
        ("nrrd", "text", join(&[&nrrd("axis mins: 0 0 0\naxis maxs: 1 1 1\ncenters: cell node cell\nencoding: text"), crate::build::text().as_bytes()])),
        ("nrrd", "skips", join(&[&nrrd("line skip: 1\nbyte skip: -1\nencoding: raw"), b"x\ny", &data])),
        (
            "nrrd",
            "vector",
            join(&[
                b"NRRD0005\ntype: uchar\ndimension: 4\nsizes: 3 3 4 5\nkinds: vector domain domain domain\nencoding: gz\n\n",
                &gzip(&vector),
            ]),
        ),
        ("nifti", "plain", nifti.clone()),
        ("nifti", "gzip", gzip(&nifti)),
        ("nifti", "float", join(&[&nifti_header(64, 64), &bytes("double", false)])),
        ("vti", "ascii", vti("", &array("", &crate::build::text()), b"")),
        ("vti", "inline", vti(zlib_attribute, &array("format=\"binary\"", &inline), b"")),
        (
            "vti",
            "base64",
            vti(zlib_attribute, &appended, format!("<AppendedData encoding=\"base64\">_{inline}</AppendedData>").as_bytes()),
        ),
        ("vti", "raw", vti("header_type=\"UInt64\"", &appended, &raw)),
        ("vtk", "ascii", vtk_small(false)),
        ("vtk", "binary", vtk_small(true)),
        (
            "vtk",
            "small",
            join(&[
                b"# vtk DataFile Version 1.0\nt\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 4 5\nASPECT_RATIO 1 1 1\nPOINT_DATA 60\nSCALARS s unsigned_char\nLOOKUP_TABLE default\n",
                &bytes("uint8", false),
            ]),
        ),
        ("off", "plain", off.into()),
        ("off", "comments", off.replace("\n4 2 0", " # c\n\n4 2 0").into()),
        ("off", "coloured", b"COFF 3 1 0\n0 0 0 1 1 1 1\n1 0 0 1 1 1 1\n1 1 0 1 1 1 1\n3 0 1 2 255 0 0\n".to_vec()),
        ("ply", "ascii", ply("ascii", "float", ("uchar", "int"))),
        ("ply", "little", ply("binary_little_endian", "float", ("uchar", "int"))),
        ("ply", "big", ply("binary_big_endian", "double", ("int", "ushort"))),
        ("plot3d", "flags", cells::plot3d()),
        ("plot3d", "plain", plain),
        ("plot3d", "short", cells::plot3d()[..300].to_vec()),
        ("vtk", "cells", cells::vtk(true, 3)),
        ("vtk", "cells-text", cells::vtk(false, 2)),
        ("vtk", "cells-offsets", cells::vtk(true, 5)),
        ("vtk", "cells-offsets-text", cells::vtk(false, 5)),
    ];
    // The first byte says which text follows.
    let texts = hexes::small().into_iter().zip(["{", "<", "#"]);
    all.extend(texts.map(|((name, text), kind)| ("nurbs", name, format!("{kind}{text}").into_bytes())));
    let [plain, patch] = hexes::mfem();
    let mesh = plain.split('\u{c}').next().unwrap_or_default().to_owned();
    for (name, text) in [("function", plain), ("patch", patch), ("mesh", mesh)] {
        all.push(("mfem", name, text.into_bytes()));
    }
    let names = ["ascii", "inline", "zlib", "base64", "raw"];
    all.extend(
        names
            .into_iter()
            .zip(cells::WAYS)
            .map(|(name, way)| ("vtu", name, cells::vtu(way))),
    );
    all
}

/// The seeds in the corpus are those of the builders. `ISOBAR_BLESS=1` writes them.
#[test]
fn the_seeds_are_committed() {
    for (target, name, bytes) in seeds() {
        let path = corpus(target).join(name);
        if std::env::var_os("ISOBAR_BLESS").is_some() {
            std::fs::create_dir_all(corpus(target)).unwrap();
            std::fs::write(&path, &bytes).unwrap();
        }
        // Compressed bytes may differ between versions of the compressor: what is compared is what they are read as.
        let committed = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}; run with ISOBAR_BLESS=1", path.display()));
        if matches!(target, "plot3d" | "nurbs" | "mfem") {
            assert_eq!(committed, bytes, "{target}/{name}");
        } else if target == "vtu" || name.starts_with("cells") {
            let read = |b: &[u8]| match crate::build::load(name, b).unwrap_or_else(|e| panic!("{target}/{e}")).data {
                isobar_core::Data::Tets(m) => m,
                other => panic!("{target}/{name} is a {}", other.kind()),
            };
            assert_eq!(read(&committed), read(&bytes), "{target}/{name}");
        } else if matches!(target, "off" | "ply") {
            assert_eq!(
                isobar_io::load_mesh_bytes(name, &committed).unwrap(),
                isobar_io::load_mesh_bytes(name, &bytes).unwrap()
            );
        } else {
            let read = |b: &[u8]| crate::build::samples(&crate::build::load(name, b).unwrap_or_else(|e| panic!("{target}/{e}")));
            assert_eq!(read(&committed), read(&bytes), "{target}/{name}");
        }
    }
}
