//! VTI and legacy VTK: every encoding, both places, vectors, fields.

use crate::build::*;
use isobar_core::DVec3;

const VTI_TYPES: [&str; 10] = [
    "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Float32", "Float64",
];
const VTK_TYPES: [&str; 10] = [
    "char",
    "unsigned_char",
    "short",
    "unsigned_short",
    "int",
    "unsigned_int",
    "long",
    "vtktypeuint64",
    "float",
    "double",
];

fn word(size: usize, big: bool, v: usize) -> Vec<u8> {
    one(if size == 4 { "uint32" } else { "uint64" }, big, v as f64)
}

/// Header words and payload of a binary array: in zlib blocks of `block` bytes, or as it is.
fn pack(data: &[u8], block: Option<usize>, size: usize, big: bool) -> (Vec<u8>, Vec<u8>) {
    let Some(block) = block else {
        return (word(size, big, data.len()), data.to_vec());
    };
    let blocks: Vec<Vec<u8>> = data.chunks(block).map(zlib).collect();
    let mut head = word(size, big, blocks.len());
    head.extend(word(size, big, block));
    head.extend(word(size, big, data.len() % block));
    for b in &blocks {
        head.extend(word(size, big, b.len()));
    }
    (head, blocks.concat())
}

#[test]
fn vti_every_type_and_encoding_gives_the_same_samples() {
    for (t, kind) in VTI_TYPES.iter().zip(KINDS) {
        let points = |inner: &str| format!("<PointData Scalars=\"s\">{inner}</PointData>");
        let ascii = points(&format!(
            "<DataArray type=\"{t}\" Name=\"s\" format=\"ascii\">\n{}\n</DataArray>",
            text()
        ));
        assert_volume(&load("a.vti", &vti("", &ascii, b"")).unwrap(), kept(kind));
        for (big, order) in [(false, "LittleEndian"), (true, "BigEndian")] {
            for size in [4, 8] {
                for block in [None, Some(64), Some(bytes(kind, big).len()), Some(7)] {
                    let (head, body) = pack(&bytes(kind, big), block, size, big);
                    let attributes = format!(
                        "byte_order=\"{order}\" header_type=\"UInt{}\" {}",
                        size * 8,
                        if block.is_some() {
                            "compressor=\"vtkZLibDataCompressor\""
                        } else {
                            ""
                        }
                    );
                    let two = format!("{}{}", base64(&head), base64(&body));
                    let one_run = base64(&join(&[&head, &body]));
                    for code in [&two, &one_run] {
                        let inline = points(&format!(
                            "<DataArray type=\"{t}\" Name=\"s\" format=\"binary\" RangeMin=\"0\">\n    {code}\n</DataArray>"
                        ));
                        assert_volume(&load("a.vti", &vti(&attributes, &inline, b"")).unwrap(), kept(kind));
                        let appended = points(&format!(
                            "<DataArray type=\"{t}\" Name=\"s\" format=\"appended\" offset=\"4\"/>"
                        ));
                        let after = format!("<AppendedData encoding=\"base64\">\n  _QUJD{code}\n</AppendedData>");
                        assert_volume(
                            &load("a.vti", &vti(&attributes, &appended, after.as_bytes())).unwrap(),
                            kept(kind),
                        );
                    }
                    let raw = points(&format!(
                        "<DataArray type=\"{t}\" Name=\"s\" format=\"appended\" offset=\"5\"><InformationKey name=\"k\">1</InformationKey></DataArray>"
                    ));
                    let after = join(&[b"<AppendedData encoding=\"raw\">_12<&5", &head, &body, b"</AppendedData>"]);
                    assert_volume(&load("a.vti", &vti(&attributes, &raw, &after)).unwrap(), kept(kind));
                }
            }
        }
    }
}

fn vti_two() -> Vec<u8> {
    let vectors: String = (0..N).map(|i| format!("{} 0 {} ", 3 * i, 4 * i)).collect();
    let cells: String = (0..24).map(|i| format!("{i} ")).collect();
    vti(
        "",
        &format!(
            "<PointData><DataArray type=\"Float32\" Name=\"v\" NumberOfComponents=\"3\">{vectors}</DataArray>\
             <DataArray type=\"UInt8\" Name=\"s &amp; t\">{}</DataArray></PointData>\
             <CellData><DataArray type=\"Int16\" Name=\"c\">{cells}</DataArray>\
             <DataArray type=\"String\" Name=\"words\" format=\"ascii\">65 66</DataArray></CellData>",
            text()
        ),
        b"",
    )
}

#[test]
fn vti_has_vectors_and_cell_data() {
    let file = vti_two();
    let l = load("a.vti", &file).unwrap();
    assert_eq!(
        (l.field.as_str(), l.fields.join(", ")),
        ("s & t", "v, v-x, v-y, v-z, s & t, c, words".into())
    );
    assert_volume(&l, "u8");
    let g = grid(&l);
    assert_eq!((g.origin, g.spacing), (DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.5, 1.0, 2.0)));
    assert_eq!(samples(&load_field(&file, "v").unwrap())[7], 35.0);
    assert_eq!(samples(&load_field(&file, "v-z").unwrap())[7], 28.0);
    let c = load_field(&file, "c").unwrap();
    assert_eq!(grid(&c).dims, [2, 3, 4]);
    assert_eq!(grid(&c).origin, DVec3::new(1.25, 2.5, 4.0), "a sample at each cell centre");
    assert_eq!(samples(&c)[23], 23.0);
    assert!(load_field(&file, "words").unwrap_err().to_string().contains("not a number"));
}

#[test]
fn vti_extents_and_directions_place_the_grid() {
    let file = String::from_utf8(vti_two())
        .unwrap()
        .replace("<Piece Extent=\"0 2 0 3 0 4\">", "<Piece Extent=\"2 4 -1 2 0 4\">")
        .replace("Spacing=", "Direction=\"0 -1 0 1 0 0 0 0 1\" Spacing=");
    let g = load("a.vti", file.as_bytes()).unwrap();
    let g = grid(&g);
    assert_eq!(g.direction.x_axis, DVec3::Y, "columns of the row-major matrix are the axes");
    assert_eq!(g.direction.y_axis, DVec3::NEG_X);
    // Origin + 2 * 0.5 along x axis (world y), - 1 * 1 along y axis (world -x).
    assert_eq!(g.origin, DVec3::new(2.0, 3.0, 3.0));
}

fn vtk(encoding: &str, body: &[u8]) -> Vec<u8> {
    join(&[
        format!(
            "# vtk DataFile Version 3.0\na title\n{encoding}\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 4 5\nSPACING 1 2 0.5\nORIGIN 1 2 3\n"
        )
        .as_bytes(),
        body,
    ])
}

#[test]
fn legacy_vtk_every_type_in_both_encodings() {
    for (t, kind) in VTK_TYPES.iter().zip(KINDS) {
        let head = format!("POINT_DATA 60\nSCALARS s {t}\nLOOKUP_TABLE default\n");
        let binary = vtk("BINARY", &join(&[head.as_bytes(), &bytes(kind, true), b"\n"]));
        let l = load("a.vtk", &binary).unwrap();
        assert_volume(&l, kept(kind));
        assert_eq!(grid(&l).spacing, DVec3::new(1.0, 2.0, 0.5));
        let ascii = vtk("ASCII", &join(&[head.as_bytes(), text().as_bytes()]));
        assert_volume(&load("a.vtk", &ascii).unwrap(), kept(kind));
        let old = String::from_utf8(ascii)
            .unwrap()
            .replace("SPACING", "ASPECT_RATIO")
            .replace("LOOKUP_TABLE default\n", "")
            .replace("Version 3.0", "Version 1.0")
            .replace("\nASCII", "\n\nASCII");
        let l = load("a.vtk", old.as_bytes()).unwrap();
        assert_volume(&l, kept(kind));
        assert_eq!(grid(&l).spacing, DVec3::new(1.0, 2.0, 0.5));
    }
}

/// All the attributes a file can have, in the encoding given.
pub(crate) fn vtk_all(binary: bool) -> Vec<u8> {
    let numbers = |kind: &str, values: &[f64]| -> Vec<u8> {
        if binary {
            join(&[&values.iter().flat_map(|&v| one(kind, true, v)).collect::<Vec<_>>(), b"\n"])
        } else {
            (values.iter().map(|v| format!("{v}\n")).collect::<String>() + "\n").into_bytes()
        }
    };
    let ramp = |n: usize, k: f64| (0..n).map(|i| k * i as f64).collect::<Vec<_>>();
    let three: Vec<f64> = (0..N)
        .flat_map(|i| [2.0 * i as f64, 3.0 * i as f64, 6.0 * i as f64])
        .collect();
    let table = if binary { vec![255.0; 8] } else { vec![1.0; 8] };
    let body = join(&[
        b"CELL_DATA 24\nSCALARS cell%20name short 1\nLOOKUP_TABLE default\n",
        &numbers("int16", &ramp(24, 1.0)),
        b"METADATA\nINFORMATION 1\nNAME x LOCATION y\nDATA 3\n\n",
        b"POINT_DATA 60\nVECTORS flow float\n",
        &numbers("float", &three),
        b"SCALARS s unsigned_char 1\nLOOKUP_TABLE mine\n",
        &numbers("uint8", &ramp(N, 1.0)),
        b"LOOKUP_TABLE mine 2\n",
        &numbers(if binary { "uint8" } else { "float" }, &table),
        b"SCALARS pair double 2\nLOOKUP_TABLE default\n",
        &numbers("double", &ramp(2 * N, 0.5)),
        b"TEXTURE_COORDINATES tc 2 float\n",
        &numbers("float", &ramp(2 * N, 1.0)),
        b"TENSORS tensor float\n",
        &numbers("float", &ramp(9 * N, 1.0)),
        b"FIELD FieldData 3\nfromfield 1 60 int\n",
        &numbers("int32", &ramp(N, 3.0)),
        b"METADATA\nCOMPONENT_NAMES\na\n\n",
        b"other 1 7 float\n",
        &numbers("float", &ramp(7, 1.0)),
        b"normal 3 60 float\n",
        &numbers("float", &three),
    ]);
    vtk(if binary { "BINARY" } else { "ASCII" }, &body)
}

#[test]
fn legacy_vtk_attributes_are_found() {
    for binary in [false, true] {
        let file = vtk_all(binary);
        let l = load("a.vtk", &file).unwrap();
        assert_eq!(l.field, "s");
        assert_volume(&l, "u8");
        let names = l.fields.join(" ");
        assert!(
            names.starts_with("flow flow-x flow-y flow-z s pair-0 pair-1 tc-0 tc-1 tensor-0"),
            "{names}"
        );
        assert!(
            names.ends_with("fromfield normal normal-x normal-y normal-z cell name"),
            "{names}"
        );
        let at = |field: &str, i: usize| samples(&load_field(&file, field).unwrap())[i];
        assert_eq!(at("flow", 5), 35.0);
        assert_eq!(at("flow-y", 5), 15.0);
        assert_eq!(at("pair-1", 5), 5.5);
        assert_eq!(at("fromfield", 59), 177.0);
        assert_eq!(at("normal-z", 59), 354.0);
        let cells = load_field(&file, "cell name").unwrap();
        assert_eq!(grid(&cells).dims, [2, 3, 4]);
        assert_eq!(grid(&cells).origin, DVec3::new(1.5, 3.0, 3.25));
        assert_eq!(samples(&cells)[23], 23.0);
    }
}
