//! GPU against CPU, coefficient by coefficient.

use super::{GpuAdaptive, TWIN};
use crate::wavelet::{Adaptive, Bank, CHUNK, ChunkSet, Extent, Placement, Pyramid, Selection};
use isobar_gpu::test_adapter;
use std::sync::Arc;

fn noise(n: usize, seed: u64) -> Vec<f32> {
    let mut state = seed | 1;
    (0..n)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 40) as f32 / (1 << 24) as f32 - 0.5
        })
        .collect()
}

fn pyramid(dims: [usize; 3], bank: Bank) -> Arc<Pyramid> {
    let values = noise(dims.iter().product(), 7);
    Arc::new(Pyramid::of(dims, &values, bank, Placement::default()))
}

/// Some chunks of every level.
fn some(p: &Pyramid, seed: u64, share: f32) -> Selection {
    let mut selection = Selection::whole(p, false);
    for l in 0..p.levels() {
        let set: ChunkSet = selection.level(l).clone();
        let n: usize = set.chunks().iter().product();
        for (i, v) in noise(n, seed + 10 * l as u64).into_iter().enumerate() {
            selection.level_mut(l).set(set.chunk(i), v < share - 0.5);
        }
    }
    selection
}

/// Coefficients of all levels that are there, how many differ by more than [`TWIN`] of 0.5, the greatest magnitude of all samples, and the greatest difference
/// in such parts.
fn twins(cpu: &Adaptive, gpu: &GpuAdaptive) -> (usize, usize, f32) {
    let p = cpu.pyramid();
    let (mut all, mut beyond, mut worst) = (0, 0, 0.0f32);
    for l in 0..p.levels() {
        let (chunks, values) = gpu.level(l).unwrap();
        let dims = p.level_dims(l);
        for chunk in chunks.iter() {
            let first = chunks.index(chunk) * CHUNK * CHUNK * CHUNK;
            for i in 0..CHUNK * CHUNK * CHUNK {
                let inside = [i % CHUNK, i / CHUNK % CHUNK, i / (CHUNK * CHUNK)];
                let xyz = [0, 1, 2].map(|a| chunk[a] * CHUNK + inside[a]);
                if (0..3).any(|a| xyz[a] >= dims[a]) {
                    continue;
                }
                let want = cpu.coefficient(l, xyz).expect("both compute the same chunks");
                let error = (values[first + i] - want).abs() / 0.5;
                all += 1;
                beyond += usize::from(error > TWIN);
                worst = worst.max(error);
            }
        }
    }
    (all, beyond, worst)
}

#[test]
fn coefficients_are_those_of_the_cpu() {
    let Some(gpu) = test_adapter("coefficients_are_those_of_the_cpu") else {
        return;
    };
    for bank in Bank::ALL {
        for dims in [[40, 33, 24], [1, 19, 64], [2, 9, 10], [5, 5, 5]] {
            let p = pyramid(dims, bank);
            let mut device = GpuAdaptive::new(&gpu, p.clone()).unwrap();
            let mut host = Adaptive::new(p.clone());
            let mut compared = 0;
            // Frame after frame, so that what is kept is looked at too; then all of it.
            let selections = [
                some(&p, 1, 0.2),
                some(&p, 3, 0.3),
                some(&p, 3, 0.3),
                Selection::whole(&p, true),
            ];
            for (i, selection) in selections.iter().enumerate() {
                let extent = if i == 3 { Extent::Whole } else { Extent::Drawn };
                let (update, _) = device.update(selection, extent).unwrap();
                assert_eq!(update, host.update(selection, extent), "{bank} {dims:?}");
                let (all, beyond, worst) = twins(&host, &device);
                assert_eq!(
                    beyond, 0,
                    "{bank} {dims:?}: {beyond} of {all} coefficients, greatest difference {worst}"
                );
                compared += all;
            }
            assert_eq!(device.update(&selections[3], Extent::Whole).unwrap().0.computed, 0);
            assert!(compared > 0 || p.levels() == 0, "{bank} {dims:?}");
        }
    }
}

/// All details: the samples, within the same constant of the CPU's own rounding.
#[test]
fn samples_come_back() {
    let Some(gpu) = test_adapter("samples_come_back") else {
        return;
    };
    let dims = [33, 40, 17];
    let values = noise(dims.iter().product(), 7);
    for bank in Bank::ALL {
        let p = pyramid(dims, bank);
        let mut device = GpuAdaptive::new(&gpu, p.clone()).unwrap();
        assert!(device.bytes() > 4 * values.len() as u64);
        device.update(&Selection::whole(&p, true), Extent::Whole).unwrap();
        let (chunks, blocks) = device.level(0).unwrap();
        let mut worst = 0.0f32;
        for (i, v) in values.iter().enumerate() {
            let xyz = [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])];
            let r = xyz.map(|v| v % CHUNK);
            let at = chunks.index(xyz.map(|v| v / CHUNK)) * CHUNK.pow(3) + (r[2] * CHUNK + r[1]) * CHUNK + r[0];
            worst = worst.max((blocks[at] - v).abs());
        }
        assert!(worst < 4.0 * TWIN, "{bank}: {worst}");
    }
}
