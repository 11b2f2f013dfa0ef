//! NRRD: types, encodings, byte orders, geometry, components.

use crate::build::*;
use isobar_core::DVec3;
use isobar_io::{Options, load_bytes};

fn header(kind: &str, more: &str) -> String {
    format!("NRRD0004\n# a comment\ntype: {kind}\ndimension: 3\nsizes: 3 4 5\nkey:=a value\n{more}\n")
}

#[test]
fn every_type_encoding_and_byte_order_gives_the_same_samples() {
    for kind in KINDS {
        for (big, endian) in [(false, "little"), (true, "big")] {
            let data = bytes(kind, big);
            let raw = header(kind, &format!("endian: {endian}\nencoding: raw\n"));
            assert_volume(&load("a.nrrd", &join(&[raw.as_bytes(), &data])).unwrap(), kept(kind));
            let packed = header(kind, &format!("endian: {endian}\nencoding: gzip\n"));
            assert_volume(
                &load("a.nrrd", &join(&[packed.as_bytes(), &gzip(&data)])).unwrap(),
                kept(kind),
            );
        }
        let ascii = header(kind, "encoding: ascii\n");
        assert_volume(
            &load("a.nrrd", &join(&[ascii.as_bytes(), text().as_bytes()])).unwrap(),
            kept(kind),
        );
    }
}

#[test]
fn gzip_of_several_members_is_one_stream() {
    let data = bytes("uint8", false);
    let h = header("uint8", "encoding: gzip\n");
    let file = join(&[h.as_bytes(), &gzip(&data[..20]), &gzip(&data[20..])]);
    assert_volume(&load("a.nrrd", &file).unwrap(), "u8");
}

#[test]
fn skips_and_carriage_returns_are_understood() {
    let data = bytes("int16", false);
    let h = header("short", "endian: little\nencoding: raw\nbyte skip: 3\nline skip: 2\n");
    assert_volume(&load("a", &join(&[h.as_bytes(), b"one\ntwo\nxyz", &data])).unwrap(), "i16");
    let h = header("short", "endian: little\nencoding: raw\nbyte skip: -1\n");
    assert_volume(&load("a", &join(&[h.as_bytes(), b"whatever", &data])).unwrap(), "i16");
    let h = header("short", "endian: little\nencoding: gzip\nbyteskip: 5\n");
    assert_volume(
        &load("a", &join(&[h.as_bytes(), &gzip(&join(&[b"12345", &data]))])).unwrap(),
        "i16",
    );
    let h = header("short", "endian: little\nencoding: raw\n").replace('\n', "\r\n");
    assert_volume(&load("a", &join(&[h.as_bytes(), &data])).unwrap(), "i16");
}

#[test]
fn geometry_is_read_in_all_its_forms() {
    let data = bytes("uint8", false);
    let read = |more: &str| {
        let h = header("uint8", &format!("encoding: raw\n{more}"));
        grid(&load("a", &join(&[h.as_bytes(), &data])).unwrap()).clone()
    };
    let g = read("spacings: 0.957031 2 3\n");
    assert_eq!((g.spacing, g.origin), (DVec3::new(0.957031, 2.0, 3.0), DVec3::ZERO));

    let g = read("space: left-posterior-superior\nspace directions: (0,2,0) (-3, 0, 0) (0,0,0.5)\nspace origin: (1,2,-3)\n");
    assert_eq!(g.spacing, DVec3::new(2.0, 3.0, 0.5));
    assert_eq!((g.direction.x_axis, g.direction.y_axis), (DVec3::Y, DVec3::NEG_X));
    assert_eq!(g.origin, DVec3::new(1.0, 2.0, -3.0));

    let g = read("spacings: 1 2 4\naxis mins: 10 20 nan\ncenterings: node cell cell\n");
    assert_eq!(g.origin, DVec3::new(10.0, 21.0, 0.0));

    let g = read("axis mins: 0 0 0\naxis maxs: 2 4 8\ncenterings: node cell node\n");
    assert_eq!(g.spacing, DVec3::new(1.0, 1.0, 2.0));
    assert_eq!(g.origin, DVec3::new(0.0, 0.5, 0.0));

    let g = read("spacings: 1 -2 1\n");
    assert_eq!((g.spacing, g.direction.y_axis), (DVec3::new(1.0, 2.0, 1.0), DVec3::NEG_Y));
}

#[test]
fn components_become_fields() {
    // Sample i is (i, 2 i, -2 i): magnitude 3 i.
    let data: Vec<u8> = (0..N)
        .flat_map(|i| [1.0, 2.0, -2.0].map(|k| one("int16", true, k * value(i))))
        .flatten()
        .collect();
    let h = "NRRD0005\ntype: short\ndimension: 4\nsizes: 3 3 4 5\nspace dimension: 3\nkinds: 3-vector domain domain domain\n\
             space directions: none (1,0,0) (0,1,0) (0,0,1)\nendian: big\nencoding: gzip\ncontent: flow\n\n";
    let file = join(&[h.as_bytes(), &gzip(&data)]);
    let l = load("a.nrrd", &file).unwrap();
    assert_eq!(
        (l.field.as_str(), l.fields.join(" ")),
        ("flow", "flow flow-x flow-y flow-z".into())
    );
    for i in 0..N {
        assert!((samples(&l)[i] - 3.0 * value(i)).abs() < 1e-4);
    }
    let z = load_field(&file, "flow-z").unwrap();
    assert_eq!(grid(&z).samples.type_name(), "i16");
    assert_eq!(samples(&z)[7], -14.0);
    // Spacings of such a file have a number for every axis.
    let h = "NRRD0005\ntype: uchar\ndimension: 4\nsizes: 2 3 4 5\nkinds: list domain domain domain\nspacings: nan 1 2 3\nencoding: raw\n\n";
    let two: Vec<u8> = (0..N).flat_map(|i| [value(i) as u8, 7]).collect();
    let l = load("a.nrrd", &join(&[h.as_bytes(), &two])).unwrap();
    assert_eq!(grid(&l).spacing, DVec3::new(1.0, 2.0, 3.0));
    assert_volume(&l, "u8");
}

#[test]
fn values_that_change_are_noted() {
    let h = header("int", "endian: little\nencoding: raw\n");
    let mut data = bytes("int32", false);
    put(&mut data, 8, &16_777_217i32.to_le_bytes());
    let l = load("a", &join(&[h.as_bytes(), &data])).unwrap();
    assert_eq!(l.notes, ["1 of 60 int32 samples changed by rounding to float32"]);

    let h = header("uint64", "endian: little\nencoding: raw\n");
    let mut data = bytes("uint64", false);
    // 2^53 + 1 is lost in f64 already, 2^53 - 1 on the way to f32; both count once.
    put(&mut data, 8, &((1u64 << 53) + 1).to_le_bytes());
    put(&mut data, 16, &((1u64 << 53) - 1).to_le_bytes());
    let l = load("a", &join(&[h.as_bytes(), &data])).unwrap();
    assert_eq!(l.notes, ["2 of 60 uint64 samples changed by rounding to float32"]);

    let h = header("double", "endian: little\nencoding: raw\n");
    let mut data = bytes("double", false);
    put(&mut data, 8, &0.1f64.to_le_bytes());
    put(&mut data, 16, &1e300f64.to_le_bytes());
    put(&mut data, 24, &f64::NAN.to_le_bytes());
    let file = join(&[h.as_bytes(), &data]);
    let l = load("a", &file).unwrap();
    assert_eq!(l.notes, ["2 of 60 float64 samples changed by rounding to float32"]);
    assert_eq!(grid(&l).samples.range().1, 2, "NaN and the infinite one are kept");
    let o = Options {
        nan: Some(-5.0),
        ..Options::default()
    };
    let l = load_bytes("a", &file, &o).unwrap();
    assert_eq!(samples(&l)[2..4], [-5.0, -5.0]);
    assert!(
        l.notes.iter().any(|n| n == "2 NaN or infinite samples were read as -5"),
        "{:?}",
        l.notes
    );
}

#[test]
fn surplus_samples_are_noted() {
    let h = header("uint8", "encoding: raw\n");
    let l = load("a", &join(&[h.as_bytes(), &bytes("uint8", false), b"more"])).unwrap();
    assert_eq!(l.notes.len(), 1);
    assert_eq!(samples(&l)[59], 59.0);
}
