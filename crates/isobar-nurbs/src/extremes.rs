//! Numbers far from 1: grids far from the origin.

use crate::proofs::{checked, rays};
use isobar_core::{DMat3, DVec3, Data, Grid, Knobs, Samples, Surface};
use std::sync::Arc;

const SKEW: [DVec3; 3] = [
    DVec3::new(0.3, 0.01, 0.0),
    DVec3::new(0.1, 0.3, 0.0),
    DVec3::new(0.0, 0.05, 0.7),
];

/// Samples of an ellipsoid's quadric about the middle of 8^3; at 9.3 it is inside but for its ends along z.
fn quadric(axes: [DVec3; 3], origin: DVec3) -> Arc<Data> {
    let samples: Vec<f32> = (0..512)
        .map(|n| {
            let [x, y, z] = [n % 8, n / 8 % 8, n / 64].map(|i| i as f32 - 3.5);
            x * x + 0.7 * y * y + 0.4 * z * z + 0.1 * x * y
        })
        .collect();
    let grid = Grid::new(
        [8; 3],
        DVec3::from_array(axes.map(DVec3::length)),
        origin,
        DMat3::from_cols(axes[0].normalize(), axes[1].normalize(), axes[2].normalize()),
        Samples::F32(samples.into()),
    );
    Arc::new(Data::Grid(grid.unwrap()))
}

/// Grids whose corners are rounded to a part of a cell, to cells, or away: what is far from the origin is drawn roughly or left open, and nothing is claimed that is not so.
#[test]
fn grids_far_from_the_origin_refute_nothing() {
    let mut hits = 0;
    for (axes, signs) in [
        (SKEW, DVec3::new(1.0, -1.0, 1.0)),
        (DVec3::AXES, DVec3::new(1.0, 1.0, -1.0)),
        (DVec3::AXES.map(|a| a * 0.3), DVec3::new(1.0, -1.0, 1.0)),
    ] {
        for far in (10..=17)
            .flat_map(|e| [1.0, 4.0].map(|m| m * 10f64.powi(e)))
            .filter(|f| *f <= 1e17)
        {
            let data = quadric(axes, signs * far);
            for seed in [5, 7] {
                let (c, _) = checked(&data, &[Surface::isovalue(9.3, 0)], &rays(&data, 400, seed), Knobs::default());
                assert_eq!(c.refuted, 0, "{far:e} {axes:?}: {c:?}");
                hits += c.hits;
            }
        }
    }
    assert!(hits > 4000, "{hits}");
}
