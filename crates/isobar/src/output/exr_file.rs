//! EXR: R G B A (linear, premultiplied), Z (t, +inf where nothing is hit), N.X N.Y N.Z.

use super::{Staged, stage};
use anyhow::{Result, anyhow};
use exr::meta::attribute::LineOrder;
use exr::prelude::{Compression, Encoding, Image, Layer, LayerAttributes, SpecificChannels, WritableImage};
use isobar_core::{Frame, Hit};
use std::path::Path;

/// Writes colour, t and normal of the first layer as 32-bit floats, losslessly compressed. t is rounded from f64 to f32 (relative
/// error 6e-8): the npz keeps all bits. Channels the frame lacks are 0 (t: +inf).
///
/// # Errors
/// When the file cannot be written; then none is left.
pub fn stage_exr(path: &Path, frame: &Frame) -> Result<Staged> {
    let pixel = |p: exr::math::Vec2<usize>| {
        let i = p.y() * frame.width + p.x();
        let [r, g, b, a] = frame.rgba.get(i).copied().unwrap_or_default();
        let [x, y, z] = frame.normal.get(i).copied().unwrap_or_default();
        let t = frame.t.get(i).copied().unwrap_or(Hit::NONE.t) as f32;
        (r, g, b, a, t, x, y, z)
    };
    let channels = SpecificChannels::build()
        .with_channel::<f32>("R")
        .with_channel::<f32>("G")
        .with_channel::<f32>("B")
        .with_channel::<f32>("A")
        .with_channel::<f32>("Z")
        .with_channel::<f32>("N.X")
        .with_channel::<f32>("N.Y")
        .with_channel::<f32>("N.Z")
        .with_pixel_fn(pixel);
    let encoding = Encoding {
        compression: Compression::ZIP16,
        line_order: LineOrder::Increasing,
        ..Encoding::FAST_LOSSLESS
    };
    let attributes = LayerAttributes {
        software_name: Some(format!("isobar {}", env!("CARGO_PKG_VERSION")).as_str().into()),
        ..LayerAttributes::default()
    };
    let image = Image::from_layer(Layer::new((frame.width, frame.height), attributes, encoding, channels));
    stage(path, |w| {
        image
            .write()
            .to_buffered(w)
            .map_err(|e| anyhow!("EXR: {}", e.to_string().replace('\n', " ")))
    })
}
