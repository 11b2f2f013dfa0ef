//! How far frames of the GPU are from those of the CPU, pixel by pixel.

use isobar_core::Frame;

/// Pixels of both casters are alike where t differs by at most this, in voxels.
pub const T: f64 = 5e-5;
/// And every component of the unit normals by at most this.
pub const NORMAL: f32 = 1e-4;

/// What [`Agreement::of`] counts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Agreement {
    /// Pixels compared.
    pub pixels: usize,
    /// Those that one of the frames hits.
    pub hit: usize,
    /// Those with another number of hits, of layers or of counted ones, or with another surface in a layer.
    pub other: usize,
    /// Of the rest, those with a layer that is farther off than [`T`] or turned by more than [`NORMAL`].
    pub beyond: usize,
    /// The greatest distance in t of all layers but those of `other`, voxels.
    pub t: f64,
    /// The greatest difference of a component of normals, of all layers but those of `other`.
    pub normal: f32,
}

impl Agreement {
    /// Compares two frames of one size and number of layers that hold t, and of the channels hits, surface and normal those that both hold; `voxel` is the
    /// length of a voxel in the world.
    #[must_use]
    pub fn of(a: &Frame, b: &Frame, pixels: usize, voxel: f64) -> Self {
        let layers = a.t.len().min(b.t.len()) / pixels.max(1);
        let mut out = Self {
            pixels,
            ..Self::default()
        };
        for i in 0..pixels {
            let at = || (0..layers).map(|l| l * pixels + i);
            out.hit += usize::from(a.t[i].is_finite() || b.t[i].is_finite());
            let other = at().any(|k| a.t[k].is_finite() != b.t[k].is_finite() || a.surface.get(k) != b.surface.get(k));
            if other || a.hits.get(i) != b.hits.get(i) {
                out.other += 1;
                continue;
            }
            let (mut t, mut normal) = (0.0f64, 0.0f32);
            for k in at().filter(|k| a.t[*k].is_finite()) {
                t = t.max((a.t[k] - b.t[k]).abs() / voxel);
                if let (Some(n), Some(m)) = (a.normal.get(k), b.normal.get(k)) {
                    normal = n.iter().zip(m).map(|(x, y)| (x - y).abs()).fold(normal, f32::max);
                }
            }
            out.beyond += usize::from(t > T || normal > NORMAL);
            (out.t, out.normal) = (out.t.max(t), out.normal.max(normal));
        }
        out
    }

    /// Pixels that are not alike.
    #[must_use]
    pub const fn unlike(&self) -> usize {
        self.other + self.beyond
    }
}
