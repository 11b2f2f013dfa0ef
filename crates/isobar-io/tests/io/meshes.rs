//! OFF and PLY.

use crate::build::*;
use isobar_core::DVec3;
use isobar_io::{TriangleMesh, load_mesh_bytes};

const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.5]];

fn expected() -> TriangleMesh {
    TriangleMesh {
        points: SQUARE.map(DVec3::from_array).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3], [3, 2, 1]],
    }
}

#[test]
fn off_in_its_usual_forms() {
    let plain = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n4 0 1 2 3\n3 3 2 1\n";
    assert_eq!(load_mesh_bytes("a.off", plain.as_bytes()).unwrap(), expected());
    let odd = "OFF # comment\r\n\r\n4 2 0\r\n0 0 0\r\n1 0 0\r\n\r\n# another\r\n1 1 0\r\n0 1 5e-1\r\n4 0 1 2 3 255 0 0\r\n3 3 2 1 .5 .5 .5";
    assert_eq!(load_mesh_bytes("a.off", odd.as_bytes()).unwrap(), expected());
    let coloured = "COFF 4 2 0\n0 0 0 1 1 1 1\n1 0 0 1 1 1 1\n1 1 0 1 1 1 1\n0 1 0.5 1 1 1 1\n4 0 1 2 3\n3 3 2 1\n";
    assert_eq!(load_mesh_bytes("a.off", coloured.as_bytes()).unwrap(), expected());
}

/// A PLY file in one of its encodings, with things to skip.
pub(crate) fn ply(format: &str, coordinate: &str, list: (&str, &str)) -> Vec<u8> {
    let header = format!(
        "ply\nformat {format} 1.0\ncomment by hand\nelement vertex 4\nproperty {coordinate} x\nproperty {coordinate} y\n\
         property {coordinate} z\nproperty uchar red\nelement face 2\nproperty list {} {} vertex_indices\nelement edge 1\n\
         property int a\nend_header\n",
        list.0, list.1
    );
    let faces: [&[u32]; 2] = [&[0, 1, 2, 3], &[3, 2, 1]];
    if format == "ascii" {
        let points: String = SQUARE.iter().map(|[x, y, z]| format!("{x} {y} {z} 255\n")).collect();
        let faces: String = faces
            .iter()
            .map(|f| f.iter().fold(f.len().to_string(), |s, i| format!("{s} {i}")) + "\n")
            .collect();
        return format!("{header}{points}{faces}7\n").into_bytes();
    }
    let big = format.contains("big");
    let nrrd_name = |ply: &str| match ply {
        "char" => "int8",
        "uchar" => "uint8",
        "short" => "int16",
        "ushort" => "uint16",
        "int" => "int32",
        "uint" => "uint32",
        other => panic!("{other}"),
    };
    let mut out = header.into_bytes();
    for p in SQUARE {
        for c in p {
            out.extend(one(coordinate, big, c));
        }
        out.push(255);
    }
    for f in faces {
        out.extend(one(nrrd_name(list.0), big, f.len() as f64));
        for &i in f {
            out.extend(one(nrrd_name(list.1), big, f64::from(i)));
        }
    }
    out.extend(one("int32", big, 7.0));
    out
}

#[test]
fn ply_in_every_encoding() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for coordinate in ["float", "double"] {
            for list in [
                ("uchar", "int"),
                ("uchar", "uint"),
                ("int", "ushort"),
                ("ushort", "uchar"),
                ("uint", "short"),
            ] {
                let file = ply(format, coordinate, list);
                assert_eq!(
                    load_mesh_bytes("a.ply", &file).unwrap(),
                    expected(),
                    "{format} {coordinate} {list:?}"
                );
            }
        }
    }
    let old = String::from_utf8(ply("ascii", "float", ("uchar", "int")))
        .unwrap()
        .replace("vertex_indices", "vertex_index");
    assert_eq!(load_mesh_bytes("a.ply", old.as_bytes()).unwrap(), expected());
}

#[test]
fn bad_meshes_are_refused_in_one_line() {
    let off = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n4 0 1 2 3\n3 3 2 1\n";
    let ply = String::from_utf8(ply("ascii", "float", ("uchar", "int"))).unwrap();
    let cases: Vec<(String, &str)> = vec![
        (off.replace("3 3 2 1", "3 3 2 4"), "names point 4"),
        (off.replace("3 3 2 1", "3 3 2"), "is not a face"),
        (off.replace("3 3 2 1", "3 3 2 -1"), "is not a face"),
        (off.replace("3 3 2 1\n", ""), "ends before its last face"),
        (off.replace("1 1 0", "1 nan 0"), "is not a point"),
        (off.replace("1 1 0", "1 1"), "is not a point"),
        (off.replace("4 2 0", "4000000000 2 0"), "can hold at most"),
        (off.replace("4 2 0", "4 99999999999999999999 0"), "not the counts"),
        (off.replace("OFF", "4OFF"), "not supported"),
        (off.replace("OFF", "OFF BINARY"), "not supported"),
        ("OFF\n0 0 0\n".into(), "no triangles"),
        ("OFF".into(), "ends before its counts"),
        (ply.replace("3 3 2 1", "3 3 2 4"), "names point 4"),
        (ply.replace("3 3 2 1", "3 3 2"), "bad PLY file"),
        (
            ply.replace("element vertex 4", "element vertex 99999999999"),
            "can hold at most",
        ),
        (ply.replace("property float z", "property float zz"), "without finite"),
        (ply.replace("vertex_indices", "corners"), "no list vertex_indices"),
        (ply.replace("element face", "element faces"), "no element \"face\""),
        (
            ply.replace("element edge 1\nproperty int a", "element edge 99999999999999"),
            "no properties",
        ),
        (ply.replace("end_header", "ende"), "bad PLY file"),
        (ply.replace("format ascii", "format strange"), "bad PLY file"),
        ("NRRD0004\n".into(), "not a triangle mesh"),
    ];
    for (text, reason) in cases {
        let e = load_mesh_bytes("m", text.as_bytes()).expect_err(reason).to_string();
        assert!(e.contains(reason), "{e}\nshould say {reason:?}");
        assert!(e.starts_with("m: ") && e.contains("; ") && !e.contains('\n'), "{e:?}");
    }
    let e = load_mesh_bytes("m.off.gz", &gzip(off.as_bytes())).unwrap_err().to_string();
    assert!(e.contains("gunzip"), "{e}");
    let e = load_mesh_bytes("m", b"").unwrap_err().to_string();
    assert!(e.contains("empty"), "{e}");
}
