//! Reading a gzip volume of 256^3 samples beside `gzip -dc` of the same file, which only decompresses. What is asked is at most twice its time.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DMat3, DVec3};
use isobar_core::{Grid, Samples};
use isobar_io::{Options, load, write_nrrd};
use std::hint::black_box;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

const N: usize = 256;

/// A smooth signal with noise in the last bits, u8: compresses about as well as a scan.
fn volume() -> Grid {
    let mut state = 1u32;
    let samples: Vec<u8> = (0..N * N * N)
        .map(|i| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let p = [i % N, i / N % N, i / N / N].map(|k| (k as f64 * 0.05).sin());
            (120.0 + 35.0 * (p[0] + p[1] + p[2])) as u8 + (state >> 30) as u8
        })
        .collect();
    Grid::new([N; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY, Samples::U8(samples.into())).expect("a good grid")
}

/// The gzip stream of an attached NRRD file: what follows the empty line after the header.
fn payload(file: &Path) -> Vec<u8> {
    let bytes = std::fs::read(file).expect("just written");
    let at = bytes.windows(2).position(|w| w == b"\n\n").expect("a header") + 2;
    bytes[at..].to_vec()
}

fn read(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("volume.nrrd");
    write_nrrd(&file, &volume()).expect("written");
    let stream = folder.path().join("volume.gz");
    std::fs::write(&stream, payload(&file)).expect("written");
    let mut group = c.benchmark_group("read-256");
    group.throughput(Throughput::Elements((N * N * N) as u64));
    group.bench_function("isobar", |b| {
        b.iter(|| load(black_box(&file), &Options::default()).expect("it reads"));
    });
    let gzip = || {
        let mut c = Command::new("gzip");
        c.arg("-dc").arg(&stream).stdout(Stdio::null()).stderr(Stdio::null());
        c.status().is_ok_and(|s| s.success())
    };
    // Not every machine has the program.
    if gzip() {
        group.bench_function("gzip-dc", |b| b.iter(gzip));
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(3));
    targets = read
}
criterion_main!(benches);
