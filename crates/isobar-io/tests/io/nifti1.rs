//! NIfTI-1: types, byte order, scaling, affines, several volumes.

use crate::build::*;
use isobar_core::{DVec3, Samples};

const CODES: [(i16, &str); 10] = [
    (256, "int8"),
    (2, "uint8"),
    (4, "int16"),
    (512, "uint16"),
    (8, "int32"),
    (768, "uint32"),
    (1024, "int64"),
    (1280, "uint64"),
    (16, "float"),
    (64, "double"),
];

fn bits(kind: &str) -> i16 {
    one(kind, false, 0.0).len() as i16 * 8
}

#[test]
fn every_type_is_read_packed_or_not() {
    for (code, kind) in CODES {
        let file = join(&[&nifti_header(code, bits(kind)), &bytes(kind, false)]);
        assert_volume(&load("a.nii", &file).unwrap(), kept(kind));
        assert_volume(&load("a.nii.gz", &gzip(&file)).unwrap(), kept(kind));
        // The content is enough.
        assert_volume(&load("strange name", &gzip(&file)).unwrap(), kept(kind));
    }
}

#[test]
fn big_endian_headers_and_samples_are_read() {
    let mut h = vec![0u8; 352];
    put(&mut h, 0, &348i32.to_be_bytes());
    for (i, d) in [3i16, 3, 4, 5, 1, 1, 1, 1].iter().enumerate() {
        put(&mut h, 40 + 2 * i, &d.to_be_bytes());
    }
    put(&mut h, 70, &4i16.to_be_bytes());
    put(&mut h, 72, &16i16.to_be_bytes());
    for i in 0..8 {
        put(&mut h, 76 + 4 * i, &2f32.to_be_bytes());
    }
    put(&mut h, 108, &352f32.to_be_bytes());
    put(&mut h, 344, b"n+1\0");
    let l = load("a.nii", &join(&[&h, &bytes("int16", true)])).unwrap();
    assert_volume(&l, "i16");
    assert_eq!(grid(&l).spacing, DVec3::splat(2.0));
}

#[test]
fn scaling_is_applied_only_where_it_is_one() {
    let data = bytes("uint8", false);
    let with = |slope: f32, inter: f32| {
        let mut h = nifti_header(2, 8);
        put(&mut h, 112, &slope.to_le_bytes());
        put(&mut h, 116, &inter.to_le_bytes());
        load("a.nii", &join(&[&h, &data])).unwrap()
    };
    for none in [
        with(0.0, 5.0),
        with(f32::NAN, 5.0),
        with(1.0, 0.0),
        with(f32::INFINITY, 0.0),
        with(1.0, f32::NAN),
    ] {
        assert_volume(&none, "u8");
    }
    let l = with(0.5, -3.0);
    assert!(matches!(grid(&l).samples, Samples::F32(_)));
    assert_eq!(samples(&l)[9], 1.5);
    assert_eq!(samples(&with(1.0, 10.0))[9], 19.0);
}

#[test]
fn sform_goes_before_qform_before_spacing() {
    let data = bytes("uint8", false);
    let mut h = nifti_header(2, 8);
    for (i, s) in [2.0f32, 3.0, 4.0].iter().enumerate() {
        put(&mut h, 80 + 4 * i, &s.to_le_bytes());
    }
    let read = |h: &[u8]| grid(&load("a.nii", &join(&[h, &data])).unwrap()).clone();
    let g = read(&h);
    assert_eq!((g.spacing, g.origin), (DVec3::new(2.0, 3.0, 4.0), DVec3::ZERO));

    // qform: half a turn about z, qfac -1, shift 10 20 30.
    put(&mut h, 76, &(-1f32).to_le_bytes());
    put(&mut h, 252, &1i16.to_le_bytes());
    put(&mut h, 264, &1f32.to_le_bytes());
    for (i, s) in [10f32, 20.0, 30.0].iter().enumerate() {
        put(&mut h, 268 + 4 * i, &s.to_le_bytes());
    }
    let g = read(&h);
    assert_eq!(
        (g.spacing, g.origin),
        (DVec3::new(2.0, 3.0, 4.0), DVec3::new(10.0, 20.0, 30.0))
    );
    assert_eq!(
        (g.direction.x_axis, g.direction.y_axis, g.direction.z_axis),
        (DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z)
    );

    // sform: x flipped, y and z swapped.
    put(&mut h, 254, &2i16.to_le_bytes());
    let rows = [[-1f32, 0.0, 0.0, 90.0], [0.0, 0.0, 1.5, -126.0], [0.0, 0.5, 0.0, -72.0]];
    for (i, v) in rows.iter().flatten().enumerate() {
        put(&mut h, 280 + 4 * i, &v.to_le_bytes());
    }
    let g = read(&h);
    assert_eq!(
        (g.spacing, g.origin),
        (DVec3::new(1.0, 0.5, 1.5), DVec3::new(90.0, -126.0, -72.0))
    );
    assert_eq!(
        (g.direction.x_axis, g.direction.y_axis, g.direction.z_axis),
        (DVec3::NEG_X, DVec3::Z, DVec3::Y)
    );
    // A code below 0 is none.
    put(&mut h, 254, &(-1i16).to_le_bytes());
    assert_eq!(read(&h).origin, DVec3::new(10.0, 20.0, 30.0));
}

#[test]
fn volumes_are_fields() {
    let mut h = nifti_header(2, 8);
    put(&mut h, 40, &4i16.to_le_bytes());
    put(&mut h, 48, &2i16.to_le_bytes());
    let second: Vec<u8> = bytes("uint8", false).iter().map(|v| v + 100).collect();
    let file = join(&[&h, &bytes("uint8", false), &second]);
    for file in [file.clone(), gzip(&file)] {
        let l = load("a.nii", &file).unwrap();
        assert_eq!(
            (l.field.as_str(), l.fields.join(" ")),
            ("volume-0", "volume-0 volume-1".into())
        );
        assert_volume(&l, "u8");
        assert_eq!(samples(&load_field(&file, "volume-1").unwrap())[59], 159.0);
        assert!(
            load_field(&file, "volume-2")
                .unwrap_err()
                .to_string()
                .contains("volume-0, volume-1")
        );
    }
}

#[test]
fn small_oddities_are_forgiven_with_a_note_or_without() {
    let data = bytes("uint8", false);
    let mut h = nifti_header(2, 0);
    let l = load("a.nii", &join(&[&h, &data])).unwrap();
    assert!(l.notes[0].contains("bitpix"), "{:?}", l.notes);
    put(&mut h, 72, &8i16.to_le_bytes());
    put(&mut h, 108, &0f32.to_le_bytes());
    assert_volume(&load("a.nii", &join(&[&h, &data])).unwrap(), "u8");
    let l = load("a.nii", &join(&[&h, &data, b"tail"])).unwrap();
    assert_eq!(l.notes.len(), 1);
}
