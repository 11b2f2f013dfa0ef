//! Files that lie, break off or are something else: each gives one clear line, before memory is taken for what it claims.

use crate::build::*;
use crate::vtk::vtk_all;
use isobar_io::{Options, load_bytes};

/// Reads a bad file and checks that the error is one line of the form FILE: reason; remedy with the reason wanted.
fn refused(name: &str, bytes: &[u8], reason: &str) {
    let e = load(name, bytes)
        .err()
        .unwrap_or_else(|| panic!("{name} was read; it should say {reason:?}"));
    let text = e.to_string();
    assert!(text.contains(reason), "{text}\nshould say {reason:?}");
    assert!(
        text.starts_with(&format!("{name}: ")) && text.contains("; ") && !text.chars().any(char::is_control),
        "{text:?}"
    );
    assert!(text.len() < 400, "{text:?}");
}

fn nrrd(change: impl Fn(String) -> String) -> Vec<u8> {
    let header = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 3 4 5\nspacings: 1 1 1\nendian: little\nencoding: raw\n\n";
    join(&[change(header.into()).as_bytes(), &bytes("uint16", false)])
}

#[test]
fn nrrd_headers_that_lie() {
    let cases = [
        ("sizes: 3 4 5", "sizes: 3 4 6", "can hold at most 120"),
        ("sizes: 3 4 5", "sizes: 30000 40000 50000", "can hold at most 120"),
        ("sizes: 3 4 5", "sizes: 4294967296 4294967296 4294967296", "too large"),
        ("sizes: 3 4 5", "sizes: 18446744073709551615 2 2", "too large"),
        ("sizes: 3 4 5", "sizes: 99999999999999999999 2 2", "not 3 positive counts"),
        ("sizes: 3 4 5", "sizes: 3 0 5", "not 3 positive counts"),
        ("sizes: 3 4 5", "sizes: 3 -4 5", "not 3 positive counts"),
        ("sizes: 3 4 5", "sizes: 12 5", "not 3 positive counts"),
        ("sizes: 3 4 5\n", "", "\"sizes\" is missing"),
        (
            "dimension: 3\nsizes: 3 4 5\nspacings: 1 1 1",
            "dimension: 2\nsizes: 12 5",
            "2 axes",
        ),
        (
            "dimension: 3\nsizes: 3 4 5\nspacings: 1 1 1",
            "dimension: 4\nsizes: 3 4 5 2",
            "4 axes",
        ),
        ("dimension: 3", "dimension: 400", "not 1 to 16"),
        ("spacings: 1 1 1", "spacings: nan 1 1", "spacing is unusable"),
        ("spacings: 1 1 1", "spacings: 0 1 1", "spacing is unusable"),
        ("spacings: 1 1 1", "spacings: 1e308 1 1", "extent is unusable"),
        ("spacings: 1 1 1", "spacings: inf 1 1", "spacing is unusable"),
        ("spacings: 1 1 1", "spacings: 1 1", "are not 3 numbers"),
        (
            "spacings: 1 1 1",
            "space directions: (1,0,0) (1,0,0) (0,0,1)",
            "direction is unusable",
        ),
        (
            "spacings: 1 1 1",
            "space directions: (1,0,0) (0,1) (0,0,1)",
            "not a list of vectors",
        ),
        (
            "spacings: 1 1 1",
            "space directions: (1,0,0) (0,1,0)",
            "for each of three axes",
        ),
        (
            "spacings: 1 1 1",
            "space directions: (1,0,0) none (0,0,1)",
            "for each of three axes",
        ),
        ("spacings: 1 1 1", "space origin: (nan,0,0)", "origin is unusable"),
        ("spacings: 1 1 1", "space origin: 1 2 3", "not a list of vectors"),
        ("type: uint16", "type: block", "not a number type"),
        ("type: uint16", "type: double", "can hold at most"),
        ("endian: little\n", "", "\"endian\" is missing"),
        ("endian: little", "endian: middle", "not little or big"),
        ("encoding: raw", "encoding: bzip2", "not supported"),
        ("encoding: raw", "encoding: gzip", "damaged"),
        ("encoding: raw", "encoding: ascii", "is not a uint16"),
        ("encoding: raw", "encoding: raw\nbyte skip: 5", "can hold at most"),
        (
            "encoding: raw",
            "encoding: raw\nbyte skip: 9223372036854775807",
            "can hold at most",
        ),
        ("encoding: raw", "encoding: raw\nbyte skip: -2", "is not a count"),
        ("encoding: raw", "encoding: raw\nline skip: 1000000000000", "beyond the file"),
        ("encoding: raw", "encoding: raw\ndata file: nowhere.raw", "no such file"),
        ("encoding: raw", "encoding: raw\ndata file: LIST", "several files"),
        ("encoding: raw", "encoding: raw\ndata file: s%03d.raw 1 9 1", "several files"),
        ("encoding: raw", "encoding: raw\ntype: uint16", "stands twice"),
        ("encoding: raw", "encoding raw", "is not \"field: value\""),
        ("NRRD0004", "NRRD0009", "is not NRRD0001"),
    ];
    for (from, to, reason) in cases {
        let file = nrrd(|h| {
            assert!(h.contains(from));
            h.replace(from, to)
        });
        refused("a.nrrd", &file, reason);
    }
    refused("a.nrrd", b"NRRD0004\n", "\"type\" is missing");
    let mut long = b"NRRD0004\n# ".to_vec();
    long.resize(1 << 20, b'x');
    refused("a.nrrd", &long, "longer than");
    refused(
        "a.nrrd",
        &b"NRRD0004\n"
            .iter()
            .chain(b"# no end\n".repeat(200_000).iter())
            .copied()
            .collect::<Vec<_>>(),
        "no blank line",
    );
}

#[test]
fn packed_data_that_lie() {
    let header = |sizes: &str| format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: {sizes}\nencoding: gzip\n\n");
    let packed = gzip(&bytes("uint8", false));
    // More than 1032 times the file: refused by arithmetic.
    refused(
        "a.nrrd",
        &join(&[header("1000 1000 1000").as_bytes(), &packed]),
        "can hold at most",
    );
    // Within 1032 times, but not there: read to its end.
    refused(
        "a.nrrd",
        &join(&[header("3 4 6").as_bytes(), &packed]),
        "after 60 of 72 bytes",
    );
    refused(
        "a.nrrd",
        &join(&[header("3 4 5").as_bytes(), &packed[..packed.len() - 20]]),
        "bytes",
    );
    let mut wrong_sum = packed.clone();
    let at = wrong_sum.len() - 6;
    wrong_sum[at] ^= 1;
    refused("a.nrrd", &join(&[header("3 4 5").as_bytes(), &wrong_sum]), "damaged");
    refused("a.nrrd", &join(&[header("3 4 5").as_bytes(), b"not gzip at all"]), "damaged");
    // A claim of 300 MB on 1 MiB, padded with empty gzip members so that it could be true: counted before memory is taken for it.
    let zeros = gzip(&vec![0u8; 1 << 20]);
    let padding = gzip(&[]).repeat(20_000);
    let bomb = join(&[header("1000 1000 300").as_bytes(), &zeros, &padding]);
    refused("a.nrrd", &bomb, "after 1048576 of 300000000 bytes");
    if let Ok(status) = std::fs::read_to_string("/proc/self/status") {
        let peak = status
            .lines()
            .find_map(|l| l.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
        let peak: u64 = peak.unwrap().parse().unwrap();
        assert!(peak < 250_000, "the process took {peak} kB");
    }
}

#[test]
fn nifti_headers_that_lie() {
    let cases: [(usize, &[u8], &str); 17] = [
        (40, &0i16.to_le_bytes(), "1 to 7 axes"),
        (42, &0i16.to_le_bytes(), "1 to 32767"),
        (42, &(-3i16).to_le_bytes(), "1 to 32767"),
        (42, &i16::MAX.to_le_bytes(), "can hold at most"),
        (
            40,
            &[7, 0, 255, 127, 255, 127, 255, 127, 255, 127, 255, 127, 255, 127, 255, 127],
            "volumes",
        ),
        (
            40,
            &[6, 0, 255, 127, 255, 127, 255, 127, 9, 0, 9, 0, 9, 0, 9, 0],
            "can hold at most",
        ),
        (70, &128i16.to_le_bytes(), "datatype 128"),
        (70, &1536i16.to_le_bytes(), "datatype 1536"),
        (80, &f32::NAN.to_le_bytes(), "spacing is unusable"),
        (84, &0f32.to_le_bytes(), "spacing is unusable"),
        (88, &f32::INFINITY.to_le_bytes(), "spacing is unusable"),
        (108, &f32::NAN.to_le_bytes(), "vox_offset"),
        (108, &(-352f32).to_le_bytes(), "vox_offset"),
        (108, &12f32.to_le_bytes(), "vox_offset"),
        (108, &352.5f32.to_le_bytes(), "vox_offset"),
        (108, &1e9f32.to_le_bytes(), "can hold at most"),
        // sform of zeros.
        (254, &1i16.to_le_bytes(), "spacing is unusable"),
    ];
    for (at, what, reason) in cases {
        let mut h = nifti_header(2, 8);
        put(&mut h, at, what);
        let file = join(&[&h, &bytes("uint8", false)]);
        refused("a.nii", &file, reason);
        if reason != "can hold at most" {
            refused("a.nii.gz", &gzip(&file), reason);
        }
    }
    let whole = join(&[&nifti_header(2, 8), &bytes("uint8", false)]);
    refused("a.nii", &whole[..400], "can hold at most 400");
    refused("a.nii", &whole[..100], "348 bytes cannot be read");
    refused("a.nii.gz", &gzip(&whole[..400]), "after 48 of 60 bytes");
    let packed = gzip(&whole);
    refused("a.nii.gz", &packed[..packed.len() / 2], "");
    refused("a.nii.gz", &packed[..12], "348 bytes cannot be read");
    let mut pair = whole.clone();
    put(&mut pair, 344, b"ni1\0");
    refused("a.hdr", &pair, "two files");
    let mut two = vec![0; 540];
    put(&mut two, 0, &540i32.to_le_bytes());
    put(&mut two, 4, b"n+2\0");
    refused("a.nii", &two, "NIfTI-2 is not read yet");
    let mut q = whole;
    put(&mut q, 252, &1i16.to_le_bytes());
    put(&mut q, 256, &f32::NAN.to_le_bytes());
    refused("a.nii", &q, "quaternion");
}

#[test]
fn vti_files_that_lie() {
    let ascii = |attributes: &str, data: &str| {
        vti(
            "",
            &format!("<PointData><DataArray {attributes}>{data}</DataArray></PointData>"),
            b"",
        )
    };
    let good = "type=\"UInt8\" Name=\"s\"";
    let edit = |from: &str, to: &str| {
        let text = String::from_utf8(ascii(good, &text())).unwrap();
        assert!(text.contains(from));
        text.replace(from, to).into_bytes()
    };
    refused("a.vti", &ascii(good, "1 2 3"), "can hold at most");
    refused(
        "a.vti",
        &ascii(good, &text().replace("59 ", "            ")),
        "after 59 of 60 numbers",
    );
    refused("a.vti", &ascii(good, &text().replace("59 ", "256 ")), "is not a uint8");
    refused("a.vti", &ascii(good, &text().replace("59 ", "x ")), "is not a uint8");
    refused(
        "a.vti",
        &edit("Extent=\"0 2 0 3 0 4\">", "Extent=\"0 2 0 3 0 999999\">"),
        "can hold at most",
    );
    refused(
        "a.vti",
        &edit("Extent=\"0 2 0 3 0 4\">", "Extent=\"0 9223372036854775807 0 3 0 4\">"),
        "bad VTK XML file",
    );
    refused(
        "a.vti",
        &edit("Extent=\"0 2 0 3 0 4\">", "Extent=\"0 2 3 0 0 4\">"),
        "empty or reversed",
    );
    refused(
        "a.vti",
        &edit("Extent=\"0 2 0 3 0 4\">", "Extent=\"0 2 0 3\">"),
        "is not 6 numbers",
    );
    refused(
        "a.vti",
        &edit("Spacing=\"0.5 1 2\"", "Spacing=\"nan 1 2\""),
        "spacing is unusable",
    );
    refused(
        "a.vti",
        &edit("Spacing=\"0.5 1 2\"", "Spacing=\"0 1 2\""),
        "spacing is unusable",
    );
    refused(
        "a.vti",
        &edit("Spacing=", "Direction=\"1 0 0 1 0 0 0 0 1\" Spacing="),
        "unusable",
    );
    refused("a.vti", &edit("\"ImageData\"", "\"UnstructuredGrid\""), "there are no cells");
    refused("a.vti", &edit("</Piece>", "</Piece><Piece/>"), "2 pieces");
    refused("a.vti", &edit("</PointData>", "</PintData>"), "XML is broken");
    refused("a.vti", &edit("UInt8\" Name=\"s\"", "Bit\" Name=\"s\""), "not a number");
    refused(
        "a.vti",
        &edit(good, "type=\"UInt8\" Name=\"s\" NumberOfComponents=\"0\""),
        "NumberOfComponents",
    );
    refused(
        "a.vti",
        &edit(good, "type=\"UInt8\" NumberOfComponents=\"99999999999\""),
        "no field",
    );
    refused(
        "a.vti",
        &edit(good, "type=\"UInt8\" format=\"appended\" offset=\"0\""),
        "there are none",
    );
    refused("a.vti", &edit(good, "type=\"UInt8\" format=\"strange\""), "is unknown");
    refused(
        "a.vti",
        &vti("compressor=\"vtkLZ4DataCompressor\"", "", b""),
        "vtkLZ4DataCompressor",
    );
    refused("a.vti", &vti("", "<PointData></PointData>", b""), "no field");
    refused("a.vti", &vti("header_type=\"Int7\"", "", b""), "header_type");
    let whole = ascii(good, &text());
    for cut in [30, 120, 200, 300, whole.len() / 2] {
        refused("a.vti", &whole[..cut], "");
    }
}

#[test]
fn vti_blocks_that_lie() {
    let data = bytes("uint8", false);
    let block = zlib(&data);
    let file = |words: &[u32], body: &[u8]| {
        let head: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        let code = format!("{}{}", base64(&head), base64(body));
        vti(
            "compressor=\"vtkZLibDataCompressor\"",
            &format!("<PointData><DataArray type=\"UInt8\" Name=\"s\" format=\"binary\">{code}</DataArray></PointData>"),
            b"",
        )
    };
    let size = block.len() as u32;
    assert_volume(&load("a.vti", &file(&[1, 60, 0, size], &block)).unwrap(), "u8");
    assert_volume(&load("a.vti", &file(&[1, 60, 60, size], &block)).unwrap(), "u8");
    refused(
        "a.vti",
        &file(&[1, 61, 0, size], &block),
        "60 bytes are declared but there are 61",
    );
    refused("a.vti", &file(&[0, 60, 0, size], &block), "but there are 0");
    refused("a.vti", &file(&[u32::MAX, 60, 0, size], &block), "cannot be in");
    refused("a.vti", &file(&[1, 60, 0, size + 100], &block), "can hold at most");
    refused("a.vti", &file(&[1, 60, 0, size - 9], &block), "of 60 bytes");
    refused("a.vti", &file(&[1, 60, 0, size], &zlib(&data[..59])), "damaged");
    let longer = zlib(&[data.clone(), vec![1]].concat());
    refused(
        "a.vti",
        &file(&[1, 60, 0, longer.len() as u32], &longer),
        "longer than declared",
    );
    let mut broken = block;
    broken[8] ^= 0x55;
    refused("a.vti", &file(&[1, 60, 0, size], &broken), "damaged");
    refused("a.vti", &file(&[1, 60, 0], b""), "cut short");
    let not_base64 = vti(
        "",
        "<PointData><DataArray type=\"UInt8\" format=\"binary\">A===</DataArray></PointData>",
        b"",
    );
    refused("a.vti", &not_base64, "damaged");
    let plain = |n: u32| {
        let code = base64(&join(&[&n.to_le_bytes(), &data]));
        let array = format!("<PointData><DataArray type=\"UInt8\" format=\"binary\">{code}</DataArray></PointData>");
        load("a.vti", &vti("", &array, b"")).map(|_| ()).map_err(|e| e.to_string())
    };
    assert_eq!(plain(60), Ok(()));
    assert!(plain(61).unwrap_err().contains("there are 61"));
    let far = vti(
        "",
        "<PointData><DataArray type=\"UInt8\" format=\"appended\" offset=\"18446744073709551615\"/></PointData>",
        b"<AppendedData encoding=\"raw\">_x</AppendedData>",
    );
    refused("a.vti", &far, "beyond the end");
}

#[test]
fn legacy_vtk_files_that_lie() {
    let good = String::from_utf8(vtk_all(false)).unwrap();
    let cases = [
        ("DIMENSIONS 3 4 5", "DIMENSIONS 3 4 6", "has 60 tuples"),
        ("DIMENSIONS 3 4 5", "DIMENSIONS 3 4 0", "dimensions [3, 4, 0]"),
        ("DIMENSIONS 3 4 5", "DIMENSIONS 4294967296 4294967296 4294967296", "too large"),
        ("DIMENSIONS 3 4 5", "DIMENSIONS 3 4 x", "where a count should"),
        ("DIMENSIONS 3 4 5\n", "", "no DIMENSIONS"),
        ("SPACING 1 2 0.5", "SPACING 1 nan 0.5", "spacing is unusable"),
        ("ORIGIN 1 2 3", "ORIGIN 1 2", "where a number should"),
        ("POINT_DATA 60", "POINT_DATA 6000000000", "can hold at most"),
        ("POINT_DATA 60", "POINT_DATA 18446744073709551615", "too large"),
        ("POINT_DATA 60\n", "", "keyword \"48\" is unknown"),
        ("SCALARS s unsigned_char", "SCALARS s string", "type \"string\" is unknown"),
        ("pair double 2", "pair double 0", "too large"),
        ("FIELD FieldData 3", "FIELD FieldData 4", "1 arrays early"),
        ("VECTORS flow float", "VEKTORS flow float", "\"VEKTORS\" is unknown"),
        (
            "STRUCTURED_POINTS",
            "RECTILINEAR_GRID",
            "\"RECTILINEAR_GRID\" is not read yet",
        ),
        ("ASCII", "UTF-8", "where ASCII or BINARY should"),
    ];
    for (from, to, reason) in cases {
        assert!(good.contains(from), "{from}");
        refused("a.vtk", good.replace(from, to).as_bytes(), reason);
    }
    let binary = vtk_all(true);
    refused("a.vtk", &binary[..binary.len() - 100], "can hold at most");
    refused("a.vtk", &binary[..33], "first four lines");
    refused(
        "a.vtk",
        b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\n",
        "no field",
    );
    refused(
        "a.vtk",
        b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nSCALARS a float\n1\n",
        "before POINT_DATA",
    );
}

#[test]
fn raw_volumes_must_have_the_size_of_their_name() {
    let data = bytes("uint16", false);
    assert_volume(&load("v_3x4x5_uint16.raw", &data).unwrap(), "u16");
    assert_volume(&load("v_3x4x5_uint16.raw.gz", &gzip(&data)).unwrap(), "u16");
    refused("v_3x4x6_uint16.raw", &data, "144 bytes are declared but there are 120");
    refused("v_3x4x4_uint16.raw", &data, "96 bytes are declared but there are 120");
    refused("v_3x4x4_uint16.raw.gz", &gzip(&data), "more than the 96 bytes");
    refused("v_3x4x6_uint16.raw.gz", &gzip(&data), "after 120 of 144 bytes");
    refused("v_0x4x6_uint16.raw", &data, "dimensions");
    refused("v_9999999999x9999999999x9999999999_uint16.raw", &data, "too large");
    refused("v_3x4x5.raw", &data, "unknown format");
}

#[test]
fn files_of_other_kinds_and_beginnings_of_files_say_so() {
    let cases: [(&str, &[u8], &str); 10] = [
        ("a.mesh", b"MFEM mesh v1.0\n\ndimension\n3\n", "it ends early"),
        (
            "a.gf",
            b"FiniteElementSpace\nFiniteElementCollection: H1\n",
            "a grid function named alone is not supported; name its mesh",
        ),
        ("a.json", b"{\"format\":\"nurbs-volume/1\"}", "missing field"),
        (
            "a.xml",
            b"<?xml version=\"1.0\"?>\n<xml>\n<Geometry type=\"TensorNurbs3\">",
            "G+Smo",
        ),
        ("a.txt", b"# nurbs mesh v.2.1\n#\n", "it ends where the dimension should be"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "triangle mesh (OFF)"),
        ("a.ply", b"ply\nformat ascii 1.0\n", "triangle mesh (PLY)"),
        ("a.txt", b"hello", "unknown format"),
        ("a.xml", b"<svg/>", "unknown format"),
        ("a.bin", &[0, 0, 0, 1, 0, 0, 0, 1], "unknown format"),
    ];
    for (name, bytes, reason) in cases {
        refused(name, bytes, reason);
    }
    let mut plot3d: Vec<u8> = [2i32, 2, 2].iter().flat_map(|n| n.to_be_bytes()).collect();
    plot3d.extend(vec![0; 96]);
    refused("a.bin", &plot3d, "a grid whose name tells no solution");
    refused("axyz.bin", &plot3d, "its data file \"aq.bin\": there is no such file");
    refused("a.nrrd.gz", &gzip(b"NRRD0004\ntype: uchar\n"), "unpack it with gunzip");
    refused("a", b"", "empty");
}

#[test]
fn fields_and_replacements_are_checked() {
    let file = nrrd(|h| h);
    let e = load_field(&file, "density").unwrap_err().to_string();
    assert!(e.contains("no field \"density\"; --field may be one of: value"), "{e}");
    assert_volume(&load_field(&file, "value").unwrap(), "u16");
    for nan in [f64::NAN, f64::INFINITY, 1e300] {
        let o = Options {
            nan: Some(nan),
            ..Options::default()
        };
        assert!(
            load_bytes("a", &file, &o)
                .unwrap_err()
                .to_string()
                .contains("finite number to --nan")
        );
    }
}
