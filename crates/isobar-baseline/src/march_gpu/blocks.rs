//! Two levels of min/max blocks, built on the device from the texture.

use super::data;
use super::layout::Params;
use super::programs;
use isobar_gpu::{Gpu, GpuError, Kernel, Texel, Volume, wgpu};

/// Side of a fine block, cells, where the index fits into one binding. march/cpu tried 4, 8 and 16; 4 keeps the shell of samples around
/// a surface thinnest, and the upper level crosses the empty rest.
const FINE: usize = 4;
/// A coarse block is this many times as long.
const UP: usize = 4;

/// `[min, max]` per block, fine then coarse, x fastest.
#[derive(Debug)]
pub(super) struct Blocks {
    pub(super) ranges: wgpu::Buffer,
    /// Least and greatest coefficient of all.
    pub(super) range: [f32; 2],
}

/// The kernels that build blocks from one texel type.
#[derive(Debug, Clone)]
pub(super) struct Builder {
    fine: Kernel,
    coarse: Kernel,
}

/// Blocks per axis of side `side` on a grid of `dims` samples.
fn counts(dims: [usize; 3], side: usize) -> [u32; 3] {
    // dims fit u32: they are sides of a texture
    dims.map(|n| (n - 1).div_ceil(side) as u32)
}

fn product(n: [u32; 3]) -> u64 {
    n.into_iter().map(u64::from).product()
}

/// Fills in what the kernels know of blocks: of side 4 and 16 cells, or as many times longer as `limit` bytes ask for.
pub(super) fn describe(params: &mut Params, dims: [usize; 3], degree: usize, limit: u64) {
    let mut side = FINE;
    let bytes = |side| 8 * (product(counts(dims, side)) + product(counts(dims, side * UP)));
    while bytes(side) > limit {
        side *= 2;
    }
    params.fine = counts(dims, side);
    params.fine_side = side as u32;
    params.coarse = counts(dims, side * UP);
    params.coarse_side = (side * UP) as u32;
    params.pad = data::pad(degree) as u32;
}

/// Workgroups of 64 for `n` invocations, in two dimensions where one does not hold them.
pub(super) fn groups(n: u64) -> [u32; 3] {
    /// WebGPU's most workgroups along a dimension.
    const ROW: u64 = 65_535;
    let all = n.div_ceil(64);
    [all.min(ROW) as u32, all.div_ceil(ROW) as u32, 1]
}

impl Builder {
    pub(super) fn new(gpu: &Gpu, texel: Texel) -> Result<Self, GpuError> {
        Ok(Self {
            fine: programs::blocks(gpu, texel, "fine")?,
            coarse: programs::blocks(gpu, texel, "coarse")?,
        })
    }

    /// Builds both levels; `params` describes the grid and its blocks.
    pub(super) fn build(&self, gpu: &Gpu, volume: &Volume, params: &Params) -> Result<Blocks, GpuError> {
        let (fine, coarse) = (product(params.fine), product(params.coarse));
        let ranges = gpu.storage_empty("min/max blocks", (fine + coarse) * 8)?;
        let uniform = gpu.uniform("parameters", params)?;
        let common = [(1, uniform.as_entire_binding()), (2, ranges.as_entire_binding())];
        let texture = (0, wgpu::BindingResource::TextureView(volume.view()));
        let fine_bind = self.fine.bind(gpu, &[&[texture][..], &common].concat())?;
        let coarse_bind = self.coarse.bind(gpu, &common)?;
        gpu.run("min/max blocks", 0, |w| {
            w.compute(&self.fine, &fine_bind, groups(fine));
            w.compute(&self.coarse, &coarse_bind, groups(coarse));
        })?;
        let range = gpu.read_with(&ranges, fine * 8..(fine + coarse) * 8, |bytes| {
            let all: Vec<[f32; 2]> = bytemuck::pod_collect_to_vec(bytes);
            all.iter()
                .fold([f32::INFINITY, f32::NEG_INFINITY], |a, r| [a[0].min(r[0]), a[1].max(r[1])])
        })?;
        Ok(Blocks { ranges, range })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn blocks_grow_until_they_fit() {
        let mut p = Params::zeroed();
        describe(&mut p, [256, 17, 2], 3, 1 << 27);
        assert_eq!(
            (p.fine, p.fine_side, p.coarse, p.coarse_side, p.pad),
            ([64, 4, 1], 4, [16, 1, 1], 16, 1)
        );
        describe(&mut p, [2048, 2048, 2048], 1, 1 << 27);
        assert_eq!((p.fine, p.coarse_side, p.pad), ([128; 3], 64, 0));
        describe(&mut p, [9, 9, 9], 1, 16);
        assert_eq!((p.fine, p.coarse), ([1; 3], [1; 3]));
    }

    #[test]
    fn groups_cover_everything() {
        for n in [0, 1, 64, 65, 64 * 65_535, 64 * 65_535 + 1, 1 << 30] {
            let [x, y, _] = groups(n);
            assert!(u64::from(x) * u64::from(y) * 64 >= n && x <= 65_535 && y <= 65_535, "{n}");
        }
    }
}
