//! Tests on an adapter: frames against the oracle and `octree/cpu`, both forms of the code, claims, errors.

mod frames;
mod scenes;
mod twins;

use isobar_core::{Channels, DVec3, Data, Frame, Grid, Knobs, Renderer, Request, Stage, Stop, Surface, View};
use isobar_fields::Kind;
use isobar_gpu::testing::adapter_alone as adapter;
use isobar_oracle::Check;
use isobar_scenes::{Random, against, draw, oblique, open, random_grid, redraw, request, sampled, synthetic};
use std::sync::Arc;

/// A first-hit frame of a reconstruction against the oracle.
pub(super) fn checked(knobs: Knobs, data: &Arc<Data>, surfaces: &[Surface], view: &View) -> Check {
    let mut r = open(&super::OCTREE_GPU, &request(1, knobs));
    let frame = draw(&mut *r, data, surfaces, view);
    against(&frame, &*r, surfaces, view)
}

/// The knob of a reconstruction.
pub(super) fn knobs(kind: Kind) -> Knobs {
    Knobs::default().with("reconstruction", kind)
}
