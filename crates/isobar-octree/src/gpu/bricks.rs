//! Least and greatest coefficient of bricks of 4^3 cells, built on the device; which bricks an isovalue can meet, as bits, on the host; the cells
//! of these bricks, as bits, on the device again.
//!
//! Steinberger 2010, section 3.3, with two octree levels at once as in `octree/cpu`: a node is a word of 4^3 bricks, a brick a word of 4^3 cells.
//! Bounds of 8- and 16-bit samples are integers, told exactly.

use super::layout::{Node, Params};
use super::programs::Kernels;
use isobar_gpu::levels::Level;
use isobar_gpu::{Gpu, GpuError, Volume, wgpu};
use rayon::prelude::*;

/// Cells of a brick, and bricks of a node, per axis.
const SIDE: u32 = 4;

/// As in `octree_mark.wgsl`: bricks meet an isovalue within this much of their largest |coefficient - bias|.
const SLACK: f32 = 6.1035e-5;

/// The range of every brick.
#[derive(Debug)]
pub(super) struct Bricks {
    /// Bricks per axis.
    dims: [u32; 3],
    ranges: Vec<[f32; 2]>,
    /// Least and greatest coefficient of all.
    pub(super) range: [f32; 2],
}

/// What an isovalue change makes anew.
#[derive(Debug)]
pub(super) struct Active {
    pub(super) nodes: wgpu::Buffer,
    pub(super) cells: wgpu::Buffer,
    /// Active bricks.
    pub(super) count: usize,
}

fn product(n: [u32; 3]) -> u64 {
    n.into_iter().map(u64::from).product()
}

/// Workgroups for `n` of them, in two dimensions where one does not hold them.
pub(super) fn groups(n: u64) -> [u32; 3] {
    /// WebGPU's most workgroups along a dimension.
    const ROW: u64 = 65_535;
    [n.clamp(1, ROW) as u32, n.div_ceil(ROW).max(1) as u32, 1]
}

impl Bricks {
    /// Builds the ranges; `params` describes the grid.
    pub(super) fn new(gpu: &Gpu, kernels: &Kernels, volume: &Volume, params: &Params) -> Result<Self, GpuError> {
        let dims = params.cells.map(|n| n.div_ceil(SIDE));
        let count = product(dims);
        let buffer = gpu.storage_empty("min/max bricks", count * 8)?;
        // The binding limit keeps the count far below 2^32.
        let uniform = gpu.uniform(
            "parameters",
            &Params {
                bricks: count as u32,
                ..*params
            },
        )?;
        let bind = kernels.ranges.bind(
            gpu,
            &[
                (0, wgpu::BindingResource::TextureView(volume.view())),
                (1, uniform.as_entire_binding()),
                (2, buffer.as_entire_binding()),
            ],
        )?;
        gpu.run("min/max bricks", 0, |w| {
            w.compute(&kernels.ranges, &bind, groups(count.div_ceil(64)));
        })?;
        let ranges: Vec<[f32; 2]> = gpu.read(&buffer, count as usize)?;
        let range = ranges
            .iter()
            .fold([f32::INFINITY, f32::NEG_INFINITY], |a, r| [a[0].min(r[0]), a[1].max(r[1])]);
        Ok(Self { dims, ranges, range })
    }

    /// Host bytes.
    pub(super) fn bytes(&self) -> u64 {
        size_of_val(self.ranges.as_slice()) as u64
    }

    /// The bit words of the nodes and the active bricks in the order of their cells.
    fn active(&self, levels: &[Level], bias: [f32; 2]) -> (Vec<Node>, Vec<u32>) {
        let nodes = self.dims.map(|n| n.div_ceil(SIDE));
        let meets = |r: &[f32; 2]| {
            let [lo, hi] = r.map(|v| (v - bias[0]) - bias[1]);
            let slack = SLACK * lo.abs().max(hi.abs());
            levels.iter().any(|l| lo - slack <= l.value && l.value <= hi + slack)
        };
        let of_node = |at: u32| {
            let n = [at % nodes[0], at / nodes[0] % nodes[1], at / (nodes[0] * nodes[1])];
            let mut word = 0u64;
            let mut bricks = Vec::new();
            for bit in 0..64 {
                let b = [bit & 3, bit >> 2 & 3, bit >> 4];
                let b: [u32; 3] = std::array::from_fn(|a| n[a] * SIDE + b[a]);
                if (0..3).all(|a| b[a] < self.dims[a]) {
                    let i = (b[2] * self.dims[1] + b[1]) * self.dims[0] + b[0];
                    if meets(&self.ranges[i as usize]) {
                        word |= 1 << bit;
                        bricks.push(i);
                    }
                }
            }
            (word, bricks)
        };
        let all: Vec<(u64, Vec<u32>)> = (0..product(nodes) as u32).into_par_iter().map(of_node).collect();
        let mut first = 0;
        let words = all
            .iter()
            .map(|(word, bricks)| {
                let node = Node {
                    lo: *word as u32,
                    hi: (*word >> 32) as u32,
                    first,
                    unused: 0,
                };
                first += bricks.len() as u32;
                node
            })
            .collect();
        (words, all.into_iter().flat_map(|(_, b)| b).collect())
    }

    /// Finds the active bricks, and on the device their active cells.
    pub(super) fn mark(
        &self,
        gpu: &Gpu,
        kernels: &Kernels,
        volume: &Volume,
        params: &Params,
        levels: &[Level],
        level_buffer: &wgpu::Buffer,
    ) -> Result<Active, GpuError> {
        let (words, bricks) = self.active(levels, [params.bias_hi, params.bias_lo]);
        let active = Active {
            nodes: gpu.storage("octree nodes", &words)?,
            cells: gpu.storage_empty("active cells", bricks.len() as u64 * 8)?,
            count: bricks.len(),
        };
        if bricks.is_empty() {
            return Ok(active);
        }
        let list = gpu.storage("active bricks", &bricks)?;
        let uniform = gpu.uniform(
            "parameters",
            &Params {
                bricks: bricks.len() as u32,
                ..*params
            },
        )?;
        let bind = kernels.mark.bind(
            gpu,
            &[
                (0, wgpu::BindingResource::TextureView(volume.view())),
                (1, uniform.as_entire_binding()),
                (2, list.as_entire_binding()),
                (3, level_buffer.as_entire_binding()),
                (4, active.cells.as_entire_binding()),
            ],
        )?;
        gpu.run("active cells", 0, |w| {
            w.compute(&kernels.mark, &bind, groups(bricks.len() as u64));
        })?;
        Ok(active)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_cover_everything() {
        for n in [0, 1, 65_535, 65_536, 1 << 30] {
            let [x, y, _] = groups(n);
            assert!(u64::from(x) * u64::from(y) >= n && x <= 65_535 && y <= 65_535, "{n}");
        }
    }

    #[test]
    fn bricks_are_listed_in_the_order_of_their_bits() {
        let dims = [5, 4, 9];
        let ranges = (0..180).map(|i| if i % 3 == 0 { [0.0, 2.0] } else { [2.0, 3.0] }).collect();
        let b = Bricks {
            dims,
            ranges,
            range: [0.0, 3.0],
        };
        let level = Level {
            value: 1.0,
            opacity: 1.0,
            surface: 0,
            unused: 0,
            colour: [1.0; 3],
            unused_1: 0.0,
        };
        let (words, list) = b.active(&[level], [0.0; 2]);
        assert_eq!((words.len(), list.len()), (2 * 3, 60));
        for (n, node) in words.iter().enumerate() {
            let word = u64::from(node.hi) << 32 | u64::from(node.lo);
            let n = [n as u32 % 2, 0, n as u32 / 2];
            for (slot, bit) in (node.first as usize..).zip((0..64u32).filter(|b| word >> b & 1 == 1)) {
                let at = [n[0] * 4 + (bit & 3), bit >> 2 & 3, n[2] * 4 + (bit >> 4)];
                assert_eq!(list[slot], (at[2] * dims[1] + at[1]) * dims[0] + at[0]);
            }
        }
    }
}
