//! npz: every channel as an array of the contract's name, type and shape.

use super::{Staged, stage};
use anyhow::{Context, Result};
use isobar_core::Frame;
use npyz::WriterBuilder;
use std::io::{BufWriter, Seek, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Writes the channels a frame holds, C order, little endian: `t` f64 (H,W), `point` f64 (H,W,3), `normal` f32 (H,W,3), `surface` u8
/// (H,W), `t_error` f64 (H,W), `hits` u16 (H,W), `rgba` f32 (H,W,4), `claim` u8 (H,W), and `work` u32 (H,W) where it was asked for. With
/// `layered` the first five have a leading axis of `frame.layers`.
///
/// # Errors
/// When the file cannot be written; then none is left.
pub fn stage_npz(path: &Path, frame: &Frame, layered: bool) -> Result<Staged> {
    stage(path, |w| {
        let mut archive = Archive(ZipWriter::new(w));
        let image = [frame.height as u64, frame.width as u64];
        let plain = |tail: &[u64]| [&image, tail].concat();
        let layers = |tail: &[u64]| {
            if layered {
                [&[frame.layers as u64], &image[..], tail].concat()
            } else {
                plain(tail)
            }
        };
        let first = frame.width * frame.height * if layered { frame.layers } else { 1 };
        let cut = |n: usize| n.min(first);
        archive.add("t", &layers(&[]), frame.t[..cut(frame.t.len())].iter().copied())?;
        archive.add(
            "point",
            &layers(&[3]),
            frame.point[..cut(frame.point.len())].iter().flat_map(|p| p.to_array()),
        )?;
        archive.add(
            "normal",
            &layers(&[3]),
            frame.normal[..cut(frame.normal.len())].iter().flatten().copied(),
        )?;
        archive.add(
            "surface",
            &layers(&[]),
            frame.surface[..cut(frame.surface.len())].iter().copied(),
        )?;
        archive.add(
            "t_error",
            &layers(&[]),
            frame.t_error[..cut(frame.t_error.len())].iter().copied(),
        )?;
        archive.add("hits", &plain(&[]), frame.hits.iter().copied())?;
        archive.add("rgba", &plain(&[4]), frame.rgba.iter().flatten().copied())?;
        archive.add("claim", &plain(&[]), frame.claim.iter().map(|c| c.bits()))?;
        archive.add("work", &plain(&[]), frame.work.iter().copied())?;
        archive.0.finish().context("npz")?;
        Ok(())
    })
}

struct Archive<W: Write + Seek>(ZipWriter<W>);

impl<W: Write + Seek> Archive<W> {
    /// Adds an array; one without values belongs to a channel the frame does not hold and is left out.
    fn add<T: npyz::AutoSerialize>(&mut self, name: &str, shape: &[u64], values: impl Iterator<Item = T>) -> Result<()> {
        let mut values = values.peekable();
        if values.peek().is_none() {
            return Ok(());
        }
        let bytes = shape.iter().product::<u64>() * size_of::<T>() as u64;
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .compression_level(Some(1))
            .large_file(bytes > u64::from(u32::MAX) / 2);
        self.0
            .start_file(npyz::npz::file_name_from_array_name(name), options)
            .context("npz")?;
        let mut buffered = BufWriter::with_capacity(1 << 18, &mut self.0);
        let mut array = npyz::WriteOptions::new()
            .default_dtype()
            .shape(shape)
            .writer(&mut buffered)
            .begin_nd()?;
        array.extend(values)?;
        array.finish()?;
        buffered.flush()?;
        Ok(())
    }
}
