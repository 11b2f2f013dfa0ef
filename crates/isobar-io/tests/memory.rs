//! Peak memory of reading, in a process of its own: the samples (64 MiB here) and at most a tenth more, whatever the packing.

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use isobar_io::{Options, load};
use std::io::{BufWriter, Write};
use std::path::Path;

const N: usize = 64 << 20;
const PART: usize = 1 << 20;

/// The samples, a part at a time: this process must not hold them twice either.
fn part(i: usize) -> Vec<u8> {
    (0..PART).map(|j| ((j ^ (j >> 7)) + i) as u8).collect()
}

/// A line of /proc/self/status, bytes; none where there is no such file.
fn status(line: &str) -> Option<usize> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let value = status.lines().find_map(|l| l.strip_prefix(line))?;
    value.trim().strip_suffix(" kB")?.parse::<usize>().ok().map(|kb| kb * 1024)
}

fn write_gzip(path: &Path, header: &str) {
    let mut out = BufWriter::new(std::fs::File::create(path).unwrap());
    out.write_all(header.as_bytes()).unwrap();
    let mut packed = GzEncoder::new(out, Compression::new(1));
    (0..N / PART).for_each(|i| packed.write_all(&part(i)).unwrap());
    packed.finish().unwrap().flush().unwrap();
}

fn write_vti(path: &Path, attributes: &str, payload: impl FnOnce(&mut dyn Write)) {
    let mut out = BufWriter::new(std::fs::File::create(path).unwrap());
    write!(
        out,
        "<VTKFile type=\"ImageData\" {attributes}><ImageData WholeExtent=\"0 1023 0 1023 0 63\"><Piece><PointData>\
         <DataArray type=\"UInt8\" Name=\"s\" format=\"binary\">"
    )
    .unwrap();
    payload(&mut out);
    out.write_all(b"</DataArray></PointData></Piece></ImageData></VTKFile>")
        .unwrap();
    out.flush().unwrap();
}

fn base64(out: &mut dyn Write, bytes: &[u8]) {
    use base64::Engine;
    let text = base64::engine::general_purpose::STANDARD.encode(bytes);
    out.write_all(text.as_bytes()).unwrap();
}

#[test]
fn reading_takes_the_samples_and_little_more() {
    let dir = tempfile::tempdir().unwrap();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1024 1024 64\nencoding: gzip\n\n";
    write_gzip(&dir.path().join("v.nrrd"), header);
    // Plain base64: more text than samples. Each part ends in a padded group.
    write_vti(&dir.path().join("plain.vti"), "", |out| {
        base64(out, &(N as u32).to_le_bytes());
        (0..N / PART).for_each(|i| base64(out, &part(i)));
    });
    write_vti(
        &dir.path().join("blocks.vti"),
        "compressor=\"vtkZLibDataCompressor\"",
        |out| {
            let blocks: Vec<Vec<u8>> = (0..N / PART)
                .map(|i| {
                    let mut packed = ZlibEncoder::new(Vec::new(), Compression::new(1));
                    packed.write_all(&part(i)).unwrap();
                    packed.finish().unwrap()
                })
                .collect();
            let mut head: Vec<u8> = [blocks.len() as u32, PART as u32, 0]
                .into_iter()
                .flat_map(u32::to_le_bytes)
                .collect();
            head.extend(blocks.iter().flat_map(|b| (b.len() as u32).to_le_bytes()));
            base64(out, &head);
            blocks.iter().for_each(|b| base64(out, b));
        },
    );
    for name in ["v.nrrd", "plain.vti", "blocks.vti"] {
        // Making the files left free heap in this process: count from here.
        let before = status("VmRSS:");
        let loaded = load(&dir.path().join(name), &Options::default()).unwrap();
        let isobar_core::Data::Grid(grid) = &loaded.data else {
            panic!("not a grid")
        };
        assert_eq!(grid.samples.len(), N);
        assert_eq!(grid.samples.get(N - 1), f64::from(part(N / PART - 1)[PART - 1]), "{name}");
        if let (Some(before), Some(peak)) = (before, status("VmHWM:")) {
            let taken = peak.saturating_sub(before);
            assert!(taken > N / 2, "{name}: the measure is broken, {taken} bytes");
            assert!(
                taken < N * 11 / 10,
                "{name}: {} MiB for {} MiB of samples",
                taken >> 20,
                N >> 20
            );
        }
    }
}
