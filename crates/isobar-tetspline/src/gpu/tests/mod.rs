//! Tests on an adapter: kernels against their twins, frames against the oracle and `tetspline/cpu`, variants, claims, errors.

mod culling;
mod frames;
mod lists;
mod paint;
mod scenes;

use isobar_core::{Channels, DVec3, Data, Frame, Grid, Knobs, Method, Renderer, Request, Samples, Stop, Surface, View};
use isobar_gpu::Gpu;
use isobar_gpu::testing::adapter_alone as adapter;
use isobar_oracle::Check;
use isobar_scenes::{Random, draw, oblique, open, random_grid, redraw, request, synthetic};
use std::sync::Arc;

/// A request of the first hits only.
pub(super) fn first_hits(knobs: Knobs) -> Request {
    Request {
        channels: Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::CLAIM,
        ..request(1, knobs)
    }
}

/// A first-hit frame against the oracle, with the renderer that drew it.
pub(super) fn checked(knobs: Knobs, data: &Arc<Data>, surfaces: &[Surface], view: &View) -> (Check, Box<dyn Renderer>) {
    let mut r = open(&super::TETSPLINE_GPU, &first_hits(knobs));
    let frame = draw(&mut *r, data, surfaces, view);
    (isobar_scenes::against(&frame, &*r, surfaces, view), r)
}

/// Missed, false, on the wrong root, on the wrong surface.
pub(super) fn wrong(c: &Check) -> [usize; 4] {
    [c.missed, c.false_hits, c.wrong_root, c.wrong_surface]
}
