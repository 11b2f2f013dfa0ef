//! One level of the transform on a whole lattice: rows of weights per axis, out of place. The decomposition uses it; the chunked reconstruction is
//! tested against its synthesis.

use super::banks::{Bank, Number, Synthesis};
use super::blocks::CHUNK;
use rayon::prelude::*;

/// For every output of a line, the inputs and their weights.
type Rows<T> = Vec<Vec<(usize, T)>>;

fn merged<T: Number>(terms: impl Iterator<Item = (usize, T)>) -> Vec<(usize, T)> {
    let mut row: Vec<(usize, T)> = Vec::new();
    for (i, w) in terms {
        match row.iter_mut().find(|(j, _)| *j == i) {
            Some((_, sum)) => *sum = *sum + w,
            None => row.push((i, w)),
        }
    }
    row
}

/// Samples to slots: slot 2k from the low pass, slot 2k+1 from the high pass.
pub(super) fn analysis_rows<T: Number>(bank: Bank, n: usize) -> Rows<T> {
    let (f, mirror) = (bank.filters(), bank.mirror());
    (0..n)
        .map(|slot| {
            let filter = if slot % 2 == 0 { &f.a0 } else { &f.a1 };
            let centre = (slot - slot % 2) as isize;
            merged(filter.weights::<T>().map(|(o, w)| (mirror.sample(centre + o as isize, n), w)))
        })
        .collect()
}

/// How far samples may move up and down: of the samples that the details of each chunk alone make, the sums of those above and of those below 0.
pub(super) fn movements(bank: Bank, slots: &[f32], dims: [usize; 3]) -> [Vec<f32>; 2] {
    let mut out = [vec![0.0; slots.len()], vec![0.0; slots.len()]];
    move_by(bank, slots, dims, 2, &mut out);
    out
}

fn move_by(bank: Bank, slots: &[f32], dims: [usize; 3], axis: usize, out: &mut [Vec<f32>; 2]) {
    let (n, stride) = (dims[axis], dims[..axis].iter().product::<usize>());
    let rows = synthesis_rows::<f32>(bank, n);
    // Chunks so far apart reach no common sample: details reach 5 samples in psi4,4, which makes 18 of a chunk, and at most 4 in the others.
    let apart = if bank == Bank::Psi44 { 3 } else { 2 };
    for colour in 0..apart.min(n.div_ceil(CHUNK)) {
        let mut part = slots.to_vec();
        part.par_chunks_mut(stride).enumerate().for_each(|(i, v)| {
            if i % n / CHUNK % apart != colour {
                v.fill(0.0);
            }
        });
        if n > 1 {
            part = along(&rows, &part, dims, axis);
        }
        if axis > 0 {
            move_by(bank, &part, dims, axis - 1, out);
        } else {
            let [up, down] = out;
            for ((v, up), down) in part.iter().zip(up).zip(down) {
                *up += v.max(0.0);
                *down += v.min(0.0);
            }
        }
    }
}

/// Slots to samples.
pub(super) fn synthesis_rows<T: Number>(bank: Bank, n: usize) -> Rows<T> {
    let (taps, mirror) = (Synthesis::<T>::new(bank), bank.mirror());
    let minus = T::dyadic(-1, 0);
    (0..n)
        .map(|i| {
            merged(taps.taps[i % 2].iter().filter_map(|&(o, w)| {
                let (slot, negative) = mirror.slot(i as isize + o, n)?;
                Some((slot, if negative { minus * w } else { w }))
            }))
        })
        .collect()
}

fn dot<T: Number>(row: &[(usize, T)], line: &[T]) -> T {
    row.iter().fold(T::default(), |sum, &(i, w)| sum + w * line[i])
}

/// Applies the rows along one axis of values stored x fastest.
fn along<T: Number>(rows: &Rows<T>, values: &[T], dims: [usize; 3], axis: usize) -> Vec<T> {
    let [nx, ny, _] = dims;
    let mut out = vec![T::default(); values.len()];
    let add = |to: &mut [T], w: T, from: &[T]| to.iter_mut().zip(from).for_each(|(o, &v)| *o = *o + w * v);
    match axis {
        0 => out.par_chunks_mut(nx).zip(values.par_chunks(nx)).for_each(|(to, line)| {
            for (o, row) in to.iter_mut().zip(rows) {
                *o = dot(row, line);
            }
        }),
        1 => out
            .par_chunks_mut(nx * ny)
            .zip(values.par_chunks(nx * ny))
            .for_each(|(to, plane)| {
                for (o, row) in to.chunks_mut(nx).zip(rows) {
                    row.iter().for_each(|&(i, w)| add(o, w, &plane[i * nx..][..nx]));
                }
            }),
        _ => out.par_chunks_mut(nx * ny).zip(rows).for_each(|(to, row)| {
            row.iter().for_each(|&(i, w)| add(to, w, &values[i * nx * ny..][..nx * ny]));
        }),
    }
    out
}

/// One step of the non-standard decomposition: samples to slots along x, y and z.
pub(super) fn analyse<T: Number>(bank: Bank, values: &[T], dims: [usize; 3]) -> Vec<T> {
    let mut slots = values.to_vec();
    for (axis, &n) in dims.iter().enumerate() {
        if n > 1 {
            slots = along(&analysis_rows(bank, n), &slots, dims, axis);
        }
    }
    slots
}

/// Its inverse: slots to samples along z, y and x.
pub(super) fn synthesise<T: Number>(bank: Bank, slots: &[T], dims: [usize; 3]) -> Vec<T> {
    let mut values = slots.to_vec();
    for axis in [2, 1, 0] {
        if dims[axis] > 1 {
            values = along(&synthesis_rows(bank, dims[axis]), &values, dims, axis);
        }
    }
    values
}

/// The slots that hold the low pass along all axes, and their dimensions.
pub(super) fn low<T: Number>(slots: &[T], dims: [usize; 3]) -> (Vec<T>, [usize; 3]) {
    let coarse = dims.map(|n| n.div_ceil(2));
    let mut out = Vec::with_capacity(coarse.iter().product());
    for z in 0..coarse[2] {
        for y in 0..coarse[1] {
            let row = &slots[(2 * z * dims[1] + 2 * y) * dims[0]..][..dims[0]];
            out.extend(row.iter().step_by(2));
        }
    }
    (out, coarse)
}
