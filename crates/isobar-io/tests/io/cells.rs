//! Meshes of cells in every encoding: VTU, legacy VTK, PLOT3D; and files of them that lie.

use crate::build::{base64, join, load, one, zlib};
use isobar_core::{Data, TetMesh};
use isobar_io::{Options, load_bytes};
use std::fmt::Write;

/// Two cubes side by side and a wedge on top of the second, with a value, a vector and a value of the cells.
const POINTS: [[f64; 3]; 14] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 0.0, 1.0],
    [1.0, 1.0, 1.0],
    [0.0, 1.0, 1.0],
    [2.0, 0.0, 0.0],
    [2.0, 1.0, 0.0],
    [2.0, 0.0, 1.0],
    [2.0, 1.0, 1.0],
    [1.5, 2.0, 0.0],
    [1.5, 2.0, 1.0],
];
const CORNERS: [&[u32]; 3] = [&[0, 1, 2, 3, 4, 5, 6, 7], &[1, 8, 9, 2, 5, 10, 11, 6], &[2, 9, 12, 6, 11, 13]];
const TYPES: [u8; 3] = [12, 12, 13];

/// How the arrays of a VTU file are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Way {
    Ascii,
    Inline,
    InlineZlib,
    AppendedBase64Zlib,
    AppendedRaw,
}

pub(crate) const WAYS: [Way; 5] = [
    Way::Ascii,
    Way::Inline,
    Way::InlineZlib,
    Way::AppendedBase64Zlib,
    Way::AppendedRaw,
];

/// An array: tag around it, name, type, the builders' name of the type, components, numbers.
type Numbers = (&'static str, &'static str, &'static str, &'static str, usize, Vec<f64>);

fn arrays() -> Vec<Numbers> {
    let ends = CORNERS.iter().scan(0, |at, c| {
        *at += c.len();
        Some(*at as f64)
    });
    vec![
        ("PointData", "v", "Float32", "float", 3, (0..42).map(f64::from).collect()),
        (
            "PointData",
            "s",
            "Float64",
            "double",
            1,
            (0..14).map(|i| f64::from(i) * 0.5).collect(),
        ),
        ("CellData", "e", "Int16", "int16", 1, vec![3.0, -6.0, 12.0]),
        ("Points", "Points", "Float64", "double", 3, POINTS.concat()),
        (
            "Cells",
            "connectivity",
            "Int64",
            "int64",
            1,
            CORNERS.concat().iter().map(|&i| f64::from(i)).collect(),
        ),
        ("Cells", "offsets", "Int32", "int32", 1, ends.collect()),
        (
            "Cells",
            "types",
            "UInt8",
            "uint8",
            1,
            TYPES.iter().map(|&t| f64::from(t)).collect(),
        ),
    ]
}

/// The mesh as VTU.
pub(crate) fn vtu(way: Way) -> Vec<u8> {
    let zipped = matches!(way, Way::InlineZlib | Way::AppendedBase64Zlib);
    let word = |n: usize| -> Vec<u8> {
        if way == Way::AppendedRaw {
            (n as u64).to_le_bytes().into()
        } else {
            (n as u32).to_le_bytes().into()
        }
    };
    let (mut body, mut appended) = (String::new(), Vec::new());
    for (tag, name, kind, builder, components, numbers) in arrays() {
        let bytes: Vec<u8> = numbers.iter().flat_map(|&v| one(builder, false, v)).collect();
        let packed = if zipped {
            let blocks: Vec<Vec<u8>> = bytes.chunks(40).map(zlib).collect();
            let partial = bytes.len() % 40;
            let head = [blocks.len(), 40, partial].into_iter().chain(blocks.iter().map(Vec::len));
            let head: Vec<u8> = head.flat_map(word).collect();
            (head, blocks.concat())
        } else {
            (word(bytes.len()), bytes)
        };
        let text = base64(&packed.0) + &base64(&packed.1);
        let (how, text) = match way {
            Way::Ascii => ("ascii".into(), numbers.iter().map(|v| format!("{v} ")).collect()),
            Way::Inline | Way::InlineZlib => ("binary".into(), text),
            Way::AppendedBase64Zlib | Way::AppendedRaw => {
                let at = appended.len();
                if way == Way::AppendedRaw {
                    appended.extend(packed.0);
                    appended.extend(packed.1);
                } else {
                    appended.extend(text.bytes());
                }
                (format!("appended\" offset=\"{at}"), String::new())
            }
        };
        writeln!(
            body,
            "<{tag}><DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"{how}\">{text}</DataArray></{tag}>"
        )
        .unwrap();
    }
    let attributes = match way {
        Way::AppendedRaw => " header_type=\"UInt64\"",
        _ if zipped => " compressor=\"vtkZLibDataCompressor\"",
        _ => "",
    };
    let encoding = if way == Way::AppendedRaw { "raw" } else { "base64" };
    let head = format!(
        "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\"{attributes}><UnstructuredGrid>\
         <Piece NumberOfPoints=\"14\" NumberOfCells=\"3\">{body}</Piece></UnstructuredGrid>"
    );
    if appended.is_empty() {
        return join(&[head.as_bytes(), b"</VTKFile>"]);
    }
    let open = format!("<AppendedData encoding=\"{encoding}\">_");
    join(&[head.as_bytes(), open.as_bytes(), &appended, b"</AppendedData></VTKFile>"])
}

/// The mesh as legacy VTK; version 5 has offsets.
pub(crate) fn vtk(binary: bool, version: u32) -> Vec<u8> {
    let write = |kind: &str, v: &[f64]| -> Vec<u8> {
        if binary {
            let mut all: Vec<u8> = v.iter().flat_map(|&v| one(kind, true, v)).collect();
            all.push(b'\n');
            all
        } else {
            (v.iter().map(|v| format!("{v} ")).collect::<String>() + "\n").into_bytes()
        }
    };
    let find = |name: &str| arrays().into_iter().find(|a| a.1 == name).unwrap().5;
    let corners = find("connectivity");
    let cells = if version >= 5 {
        let offsets: Vec<f64> = std::iter::once(0.0).chain(find("offsets")).collect();
        join(&[
            format!("CELLS 4 {}\nOFFSETS vtktypeint64\n", corners.len()).as_bytes(),
            &write("int64", &offsets),
            b"CONNECTIVITY vtktypeint64\n",
            &write("int64", &corners),
        ])
    } else {
        let counted: Vec<f64> = CORNERS
            .iter()
            .flat_map(|c| std::iter::once(c.len() as u32).chain(c.iter().copied()))
            .map(f64::from)
            .collect();
        join(&[format!("CELLS 3 {}\n", counted.len()).as_bytes(), &write("int32", &counted)])
    };
    let encoding = if binary { "BINARY" } else { "ASCII" };
    join(&[
        format!("# vtk DataFile Version {version}.0\nt\n{encoding}\nDATASET UNSTRUCTURED_GRID\nPOINTS 14 double\n").as_bytes(),
        &write("double", &POINTS.concat()),
        &cells,
        b"CELL_TYPES 3\n",
        &write("int32", &TYPES.map(f64::from)),
        b"CELL_DATA 3\nSCALARS e short 1\nLOOKUP_TABLE default\n",
        &write("int16", &find("e")),
        b"POINT_DATA 14\nVECTORS v float\n",
        &write("float", &find("v")),
        b"FIELD f 1\ns 1 14 double\n",
        &write("double", &find("s")),
    ])
}

/// A PLOT3D grid of 3 x 3 x 2 points with flags, and its solution, behind the grid's size.
pub(crate) fn plot3d() -> Vec<u8> {
    let int = |v: u32| v.to_be_bytes();
    let counts: Vec<u8> = [3, 3, 2].into_iter().flat_map(int).collect();
    let axis = |a: usize| (0..18usize).flat_map(move |i| ([i % 3, i / 3 % 3, i / 9][a] as f32).to_be_bytes());
    let mut grid = counts.clone();
    (0..3).for_each(|a| grid.extend(axis(a)));
    grid.extend((0..18).flat_map(|i| int(u32::from(i != 8))));
    let mut all: Vec<u8> = int(grid.len() as u32).into();
    all.extend(&grid);
    all.extend(&counts);
    all.extend((0..4 + 90).flat_map(|i| (i as f32).to_be_bytes()));
    all
}

fn mesh(bytes: &[u8]) -> TetMesh {
    match load("a", bytes).unwrap_or_else(|e| panic!("{e}")).data {
        Data::Tets(m) => m,
        other => panic!("{}", other.kind()),
    }
}

#[test]
fn every_encoding_gives_the_same_mesh() {
    let first = mesh(&vtu(Way::Ascii));
    assert_eq!((first.points.len(), first.cells.len()), (14, 6 + 6 + 3));
    assert_eq!(first.points[13].to_array(), POINTS[13]);
    assert_eq!(first.values[13], 6.5, "the first scalar of the points");
    let volume = |t: &[u32; 4]| {
        let p = t.map(|i| first.points[i as usize]);
        (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) / 6.0
    };
    assert!((first.cells.iter().map(volume).sum::<f64>() - 2.5).abs() < 1e-12);
    for way in WAYS {
        assert_eq!(mesh(&vtu(way)), first, "{way:?}");
    }
    for version in [2, 3, 4, 5] {
        for binary in [false, true] {
            assert_eq!(mesh(&vtk(binary, version)), first, "{version} {binary}");
        }
    }
}

#[test]
fn fields_of_points_and_cells() {
    for file in [vtu(Way::InlineZlib), vtk(true, 5)] {
        let read = |field: &str, cell_to_point| {
            let o = Options {
                field: Some(field.into()),
                cell_to_point,
                ..Options::default()
            };
            load_bytes("a", &file, &o)
        };
        let l = read("v-y", false).unwrap();
        assert_eq!(l.fields, ["v", "v-x", "v-y", "v-z", "s", "e"]);
        let Data::Tets(m) = l.data else { panic!() };
        assert_eq!(m.values[3], 10.0);
        let e = read("e", false).unwrap_err().to_string();
        assert!(e.contains("give --cell-to-point to average"), "{e}");
        let Data::Tets(m) = read("e", true).unwrap().data else {
            panic!()
        };
        // of the first cube only, of the cubes, of the second cube and the wedge, of all three
        assert_eq!([m.values[0], m.values[1], m.values[9], m.values[2]], [3.0, -1.5, 3.0, 3.0]);
        assert!(read("w", true).unwrap_err().to_string().contains("v, v-x, v-y, v-z, s, e"));
    }
}

#[test]
fn meshes_that_lie_are_one_line() {
    let good = String::from_utf8(vtu(Way::Ascii)).unwrap();
    let legacy = String::from_utf8(vtk(false, 5)).unwrap();
    let old = String::from_utf8(vtk(false, 3)).unwrap();
    let cases = [
        (
            &good,
            "NumberOfCells=\"3\"",
            "NumberOfCells=\"300000000000\"",
            "can hold at most",
        ),
        (
            &good,
            "NumberOfPoints=\"14\"",
            "NumberOfPoints=\"18446744073709551615\"",
            "too large",
        ),
        (
            &good,
            "NumberOfPoints=\"14\"",
            "NumberOfPoints=\"13\"",
            "names point 13 of 13",
        ),
        (&good, "NumberOfCells=\"3\"", "NumberOfCells=\"0\"", "no cells"),
        (&good, "8 16 22", "8 16 2000000000", "can hold at most"),
        (&good, "8 16 22", "8 7 22", "stands after"),
        (&good, "12 12 13", "12 11 13", "cell 1 of type 11 (pixel or voxel)"),
        (&good, "12 12 13", "12 12 12", "has 6 corners instead of 8"),
        (&good, "0 1 2 3 4 5 6 7 1 8", "0 1 2 3 4 5 6 7 -1 8", "names point -1"),
        (&good, "Name=\"types\"", "Name=\"kinds\"", "array types is missing"),
        (&good, "1.5 2 1 ", "1.5 nan 1 ", "point 13 is"),
        (&good, "</Piece>", "</Piece><Piece/>", "2 pieces"),
        (&legacy, "POINTS 14", "POINTS 140000000000", "can hold at most"),
        (&legacy, "CELLS 4 22", "CELLS 4 2200000000000", "can hold at most"),
        (
            &legacy,
            "OFFSETS vtktypeint64\n0 8",
            "OFFSETS vtktypeint64\n1 8",
            "do not go from 0",
        ),
        (&legacy, "CONNECTIVITY", "CONECTIVITY", "stands where CONNECTIVITY should"),
        (
            &legacy,
            "CELL_TYPES 3\n12 12 13",
            "CELL_TYPES 2\n12 12",
            "3 cells but 2 CELL_TYPES",
        ),
        (&legacy, "CELL_TYPES 3\n12 12 13", "CELL_TYPES 3\n12 12 71", "(Lagrange)"),
        (&old, "CELLS 3 25", "CELLS 4 25", "declares 4 cells but holds 3"),
        (&old, "CELLS 3 25\n8", "CELLS 3 25\n80", "has 80 corners"),
        (&old, "POINT_DATA 14", "POINT_DATA 13", "names point"),
    ];
    for (file, from, to, reason) in cases {
        assert!(file.contains(from), "{from}");
        let text = match load("a", file.replace(from, to).as_bytes()) {
            Ok(_) => panic!("{to} was read"),
            Err(e) => e.to_string(),
        };
        let fits = text.contains(reason) || reason == "names point" && text.lines().count() == 1;
        assert!(
            fits && !text.chars().any(char::is_control) && text.contains("; "),
            "{text}\nshould say {reason}"
        );
    }
}
