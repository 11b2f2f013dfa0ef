//! The storage error: the certified roots of the function drawn against those of the function with coefficients in f64.

use super::spread;
use crate::results::Storage;
use isobar_core::View;
use isobar_oracle::{Quantiles, Truth};

/// Roots farther apart than this, in voxels, are not one root that moved.
const ANOTHER: f64 = 0.5;

/// Compares two certified frames of one view. Pixels that the oracle calls undecidable in either are left out.
pub(super) fn compare(stored: &Truth, ideal: &Truth, view: &View, voxel: f64) -> Storage {
    let mut out = Storage::default();
    let mut moved = Vec::new();
    let generator = view.generator();
    for (i, (a, b)) in stored.pixels.iter().zip(&ideal.pixels).enumerate() {
        if a.undecidable || b.undecidable || !(a.is_hit() || b.is_hit()) {
            continue;
        }
        let ray = generator.ray(i % view.width, i / view.width);
        let voxels = (a.t() - b.t()).abs() * ray.direction.length() / voxel;
        if a.is_hit() && b.is_hit() && a.surface == b.surface && voxels <= ANOTHER {
            moved.push(voxels as f32);
        } else {
            out.changed += 1;
        }
    }
    out.compared = moved.len() as u64;
    out.voxels = spread(&Quantiles::of(moved));
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Function, Stage, Stop, Surface};
    use isobar_fields::{Reconstruction, Synthetic};
    use std::sync::Arc;

    /// f32 coefficients of an interpolating spline move the surface by some 1e-7 voxel, and a spline that is its samples not at all.
    #[test]
    fn rounded_coefficients_move_the_surface_a_little() {
        let data = "torus,n=24".parse::<Synthetic>().unwrap().data().unwrap();
        let isobar_core::Data::Grid(grid) = &data else {
            panic!("samples of a field are a grid");
        };
        let view = View::fit(data.bounds(), 40.0, 48, 36);
        let surfaces = [Surface::isovalue(0.0, 0)];
        let of = |name: &str, stage: Stage| {
            let f: Arc<dyn Function> = name.parse::<Reconstruction>().unwrap().of(grid, stage).unwrap();
            (
                Truth::compute(&f, &surfaces, &view, &Stop::default()).unwrap(),
                f.domain().voxel(),
            )
        };
        let storage = |name: &str| {
            let ((stored, voxel), (ideal, _)) = (of(name, Stage::Stored), of(name, Stage::Ideal));
            compare(&stored, &ideal, &view, voxel)
        };
        let cubic = storage("cubic-interpolating");
        assert!(cubic.compared > 100 && cubic.changed == 0, "{cubic:?}");
        assert!(cubic.voxels.median > 0.0 && cubic.voxels.max < 1e-3, "{cubic:?}");
        assert_eq!(storage("trilinear").voxels.max, 0.0);
    }
}
