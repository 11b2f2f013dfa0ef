//! The three-dimensional transform and the adaptive reconstruction in exact arithmetic.

use super::dyadic::Dyadic;
use super::noise;
use crate::wavelet::transform::{analyse, synthesise};
use crate::wavelet::{Adaptive, Bank, CHUNK, ChunkSet, Extent, Number, Placement, Pyramid, Selection};
use isobar_core::{Basis1, CUBIC, QUADRATIC, TRILINEAR};
use std::sync::Arc;

fn volume(dims: [usize; 3], seed: u64) -> Vec<Dyadic> {
    let noise = noise(dims.iter().product(), seed);
    noise.into_iter().map(|v| Dyadic::int(v.into())).collect()
}

fn pyramid(dims: [usize; 3], bank: Bank) -> Arc<Pyramid<Dyadic>> {
    Arc::new(Pyramid::of(dims, &volume(dims, 3), bank, Placement::default()))
}

#[test]
fn all_details_give_the_samples_back() {
    for bank in Bank::ALL {
        for dims in [[17, 9, 8], [16, 20, 1], [1, 1, 11], [23, 2, 10]] {
            let mut adaptive = Adaptive::new(pyramid(dims, bank));
            let all = Selection::whole(&adaptive.pyramid().clone(), true);
            let update = adaptive.update(&all, Extent::Whole);
            assert_eq!((update.computed, update.reused), (all.count(), 0));
            assert_eq!(adaptive.coefficients(), volume(dims, 3), "{bank} {dims:?}");
        }
    }
}

#[test]
fn chunks_and_whole_lattices_give_the_same() {
    // One level: the chunked passes against rows of weights, with some chunks' details off.
    for bank in Bank::ALL {
        let dims = [16, 13, 10];
        let p = pyramid(dims, bank);
        assert_eq!(p.levels(), 1);
        let mut selection = Selection::whole(&p, false);
        selection.level_mut(0).set([1, 0, 0], true);
        selection.level_mut(0).set([0, 1, 1], true);
        let mut slots = analyse(bank, &volume(dims, 3), dims);
        for (i, v) in slots.iter_mut().enumerate() {
            let at = [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])];
            if at.iter().any(|v| v % 2 == 1) && !selection.level(0).contains(at.map(|v| v / CHUNK)) {
                *v = Dyadic::default();
            }
        }
        let mut adaptive = Adaptive::new(p.clone());
        adaptive.update(&selection, Extent::Whole);
        assert_eq!(adaptive.coefficients(), synthesise(bank, &slots, dims), "{bank}");
    }
}

/// Value and derivatives up to `degree` along each axis, times `denominator^3`, of the piece `cell` of a lattice at `w` in [0, 1]^3 (halves),
/// with coordinates `scale` finer steps long: `[(a, b, c)]` for all orders below `degree`.
fn jets(basis: &Basis1, stencil: &dyn Fn([usize; 3]) -> Dyadic, w: [Dyadic; 3], level: u32) -> Vec<Dyadic> {
    let width = basis.degree + 1;
    let weight = |w: Dyadic, order: usize, j: usize| {
        let mut sum = Dyadic::default();
        for k in order..width {
            let falling: i32 = (0..order).map(|i| (k - i) as i32).product();
            let power = (order..k).fold(Dyadic::int(1), |p, _| p * w);
            sum = sum + Dyadic::int((basis.matrix[k][j] * falling).into()) * power;
        }
        sum * Dyadic::dyadic(1, level * order as u32)
    };
    let weights: [Vec<Vec<Dyadic>>; 3] = w.map(|w| {
        (0..basis.degree)
            .map(|order| (0..width).map(|j| weight(w, order, j)).collect())
            .collect()
    });
    let values: Vec<Dyadic> = (0..width.pow(3))
        .map(|i| stencil([i % width, i / width % width, i / (width * width)]))
        .collect();
    let mut jets = Vec::new();
    for order in (0..basis.degree.pow(3)).map(|i| [i % basis.degree, i / basis.degree % basis.degree, i / basis.degree.pow(2)]) {
        let mut sum = Dyadic::default();
        for (i, value) in values.iter().enumerate() {
            let j = [i % width, i / width % width, i / (width * width)];
            let product = (0..3).fold(*value, |p, a| p * weights[a][order[a]][j[a]]);
            sum = sum + product;
        }
        jets.push(sum);
    }
    jets
}

/// The derivatives at a point (in half fine steps) of the piece on one side, from a level's computed coefficients.
fn at(adaptive: &Adaptive<Dyadic>, level: usize, point: [usize; 3], below: [bool; 3]) -> Vec<Dyadic> {
    let degree = adaptive.pyramid().bank().degree();
    let basis = [&TRILINEAR, &QUADRATIC, &CUBIC][degree - 1];
    let step = 2 << level;
    let mut cell = [0; 3];
    let mut w = [Dyadic::default(); 3];
    for a in 0..3 {
        // Quadratic pieces start half a fine step before 0 on every level.
        let u = point[a] + usize::from(basis.centred);
        cell[a] = u / step;
        let mut rest = u % step;
        if rest == 0 && below[a] {
            cell[a] -= 1;
            rest = step;
        }
        w[a] = Dyadic::dyadic(rest as i32, level as u32 + 1);
    }
    let first = if degree == 1 { 0 } else { 1 };
    let stencil = |j: [usize; 3]| {
        let xyz = [0, 1, 2].map(|a| cell[a] + j[a] - first);
        adaptive
            .coefficient(level, xyz)
            .unwrap_or_else(|| panic!("level {level} lacks {xyz:?} of the piece {cell:?}"))
    };
    jets(basis, &stencil, w, level as u32)
}

/// A pyramid of whole-numbered coefficients: decompositions of many levels would outgrow 128 bits.
fn of_details(dims: [usize; 3], bank: Bank) -> Arc<Pyramid<Dyadic>> {
    let zeros = vec![Dyadic::default(); dims.iter().product()];
    let mut p = Pyramid::of(dims, &zeros, bank, Placement::default());
    for (l, level) in p.levels.iter_mut().enumerate() {
        let noise = noise(level.details.data.len(), l as u64 + 5);
        for (i, v) in level.details.data.iter_mut().enumerate() {
            let low = [i, i / CHUNK, i / CHUNK.pow(2)].iter().all(|v| v % 2 == 0);
            *v = if low {
                Dyadic::default()
            } else {
                Dyadic::int(noise[i].into())
            };
        }
    }
    p.coarsest.data.fill(Dyadic::int(9));
    Arc::new(p)
}

/// Every face, edge and corner at which a drawn chunk of levels 0 and 1 meets a chunk that is not drawn, along all axes and on both sides: derivatives from the one side with
/// the drawn level's coefficients, and from the other with those of the next coarser one.
#[test]
fn no_jump_of_value_or_derivative_between_levels() {
    for bank in Bank::ALL {
        let degree = bank.degree();
        // Coarse lattices end with the domain.
        let p = of_details([if degree == 2 { 72 } else { 73 }; 3], bank);
        let mut selection = Selection::whole(&p, false);
        selection.level_mut(0).set([5, 5, 5], true);
        selection.level_mut(0).set([2, 5, 4], true);
        selection.level_mut(1).set([2, 2, 2], true);
        let mut adaptive = Adaptive::new(p.clone());
        adaptive.update(&selection, Extent::Drawn);
        for level in 0..2 {
            let drawn = selection.drawn(level);
            // Borders by the number of axes along which the chunks part: faces, edges, corners.
            let mut borders = [0; 3];
            let (mut sides, mut differ) = ([[0; 2]; 3], 0);
            for chunk in drawn.iter() {
                for way in (0..27).map(|i| [i % 3, i / 3 % 3, i / 9].map(|d| d - 1)) {
                    let other = [0, 1, 2].map(|a| chunk[a].wrapping_add_signed(way[a]));
                    if (0..3).any(|a| other[a] >= drawn.chunks()[a]) || drawn.contains(other) {
                        continue;
                    }
                    // In half steps; quadratic pieces start half a step earlier.
                    let shift = usize::from(degree == 2);
                    let point = [0, 1, 2].map(|a| match way[a] {
                        0 => 2 * ((chunk[a] * CHUNK + 3) << level) + 1,
                        1 => 2 * (((chunk[a] + 1) * CHUNK) << level) - shift,
                        _ => 2 * ((chunk[a] * CHUNK) << level) - shift,
                    });
                    let fine = at(&adaptive, level, point, way.map(|d| d == 1));
                    let coarse = at(&adaptive, level + 1, point, way.map(|d| d == -1));
                    assert_eq!(fine, coarse, "{bank} level {level} chunk {chunk:?} way {way:?}");
                    assert_eq!(fine.len(), degree.pow(3));
                    let parted: Vec<usize> = (0..3).filter(|a| way[*a] != 0).collect();
                    borders[parted.len() - 1] += 1;
                    if let [a] = parted[..] {
                        sides[a][usize::from(way[a] > 0)] += 1;
                    }
                }
                // Not everything is flat: inside drawn chunks the levels differ.
                let inside = chunk.map(|c| 2 * ((c * CHUNK + 3) << level) + 1);
                differ += usize::from(at(&adaptive, level, inside, [false; 3]) != at(&adaptive, level + 1, inside, [false; 3]));
            }
            assert!(borders.iter().all(|b| *b >= 8), "{bank} level {level}: {borders:?}");
            assert!(
                sides.as_flattened().iter().all(|s| *s >= 9),
                "{bank} level {level}: {sides:?}"
            );
            assert!(differ > 0, "{bank} level {level}");
        }
    }
}

#[test]
fn chunks_without_details_are_exact_subdivision() {
    // Away from active chunks the finest coefficients are those of the coarse level subdivided by the two-scale mask alone.
    for bank in Bank::ALL {
        let dims = [40, 17, 16];
        let p = pyramid(dims, bank);
        let mut selection = Selection::whole(&p, false);
        selection.level_mut(0).set([0, 0, 0], true);
        let mut adaptive = Adaptive::new(p.clone());
        adaptive.update(&selection, Extent::Whole);
        let g0 = bank.filters().g0;
        let subdivided = |x: [usize; 3]| {
            let mut sum = Dyadic::default();
            let reach: Vec<i32> = (-2..=2).collect();
            for &kz in &reach {
                for &ky in &reach {
                    for &kx in &reach {
                        let k = [0, 1, 2].map(|a| (x[a] / 2) as i32 + [kx, ky, kz][a]);
                        let tap = |a: usize| g0.at(x[a] as i32 - 2 * k[a]);
                        let w = tap(0) * tap(1) * tap(2);
                        if w != 0 {
                            let c = adaptive.coefficient(1, k.map(|v| v as usize)).unwrap();
                            sum = sum + Dyadic::dyadic(w, 3 * g0.log2) * c;
                        }
                    }
                }
            }
            sum
        };
        for x in [[18, 8, 8], [25, 9, 6], [31, 7, 10], [22, 5, 7]] {
            assert!(!selection.drawn(0).contains(x.map(|v| v / CHUNK)));
            assert_eq!(adaptive.coefficient(0, x).unwrap(), subdivided(x), "{bank} {x:?}");
        }
        // And where a wavelet reaches they are not.
        assert_ne!(adaptive.coefficient(0, [4, 5, 6]).unwrap(), subdivided([4, 5, 6]), "{bank}");
    }
}

#[test]
fn reuse_changes_nothing() {
    // A walk through selections: what is kept and made anew equals what is made from nothing, and little is made.
    let p = pyramid([40, 33, 24], Bank::Psi42);
    let mut kept = Adaptive::new(p.clone());
    let mut saved = 0;
    for step in 0..6u64 {
        let mut selection = Selection::whole(&p, false);
        for l in 0..p.levels() {
            let set: ChunkSet = selection.level(l).clone();
            for (i, v) in noise(set.chunks().iter().product(), step / 2 + 10 * l as u64)
                .into_iter()
                .enumerate()
            {
                selection.level_mut(l).set(set.chunk(i), v > 100);
            }
        }
        selection.level_mut(0).set([step as usize % 5, 2, 1], true);
        let update = kept.update(&selection, if step == 3 { Extent::Whole } else { Extent::Drawn });
        saved += update.reused;
        let mut fresh = Adaptive::new(p.clone());
        let whole = fresh.update(&selection, Extent::Whole);
        assert_eq!(whole.reused, 0);
        for l in 0..p.levels() {
            let [nx, ny, nz] = p.level_dims(l);
            for i in (0..nx * ny * nz).step_by(7) {
                let xyz = [i % nx, i / nx % ny, i / (nx * ny)];
                if let Some(v) = kept.coefficient(l, xyz) {
                    assert_eq!(Some(v), fresh.coefficient(l, xyz), "step {step} level {l} {xyz:?}");
                }
            }
        }
        assert_eq!(kept.update(&selection, Extent::Drawn).computed, 0);
    }
    assert!(saved > 50, "{saved}");
}
