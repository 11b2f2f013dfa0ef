//! Classification, scan and compaction against their CPU twins, number by number.

use super::*;
use crate::classify::Rule;
use crate::gpu::lists::{Limits, Lists};
use crate::gpu::renderer::TetsplineRenderer;
use crate::gpu::twin::Twin;
use isobar_fields::Type6Spline;

fn rule(word: &str) -> Rule {
    match word {
        "data" => Rule::Data,
        "paper" => Rule::DeterminingSet,
        _ => Rule::Coefficients,
    }
}

/// Q_active, the 24 lists and the draw arguments of all parts, as the device holds them; entries that are places are made indices.
fn read(gpu: &Gpu, lists: &Lists, stored: bool) -> (Vec<u32>, Vec<Vec<u32>>) {
    let (mut cubes, mut tets) = (Vec::new(), vec![Vec::new(); 24]);
    for p in &lists.parts {
        let own: Vec<u32> = gpu.read(&p.cubes, p.counts[0] as usize).unwrap();
        let all: Vec<u32> = gpu.read(&p.tetrahedra, p.counts[1] as usize).unwrap();
        let bases: Vec<u32> = gpu.read(&p.bases, 25).unwrap();
        let draws: Vec<[u32; 4]> = gpu.read(&p.draws, 24).unwrap();
        assert_eq!(bases[24], p.counts[1]);
        for k in 0..24 {
            let (from, to) = (bases[k] as usize, bases[k + 1] as usize);
            assert_eq!(draws[k], [6, (to - from) as u32, 6 * k as u32, 0], "draw {k}");
            let entries = all[from..to].iter().map(|&e| if stored { own[e as usize] } else { e });
            tets[k].extend(entries);
        }
        cubes.extend(own);
    }
    (cubes, tets)
}

fn twin_of(r: &mut TetsplineRenderer, grid: &Grid, word: &str) -> Twin {
    let (_, levels, bias) = r.lists().unwrap();
    Twin::new(Type6Spline::new(grid).unwrap(), levels, bias, rule(word))
}

/// Every list of every rule is that of the twin: integers, so that no device may round otherwise; several isovalues; chunks and parts of odd sizes.
#[test]
fn lists_are_those_of_the_twin() {
    let Some((gpu, _guard)) = adapter("lists_are_those_of_the_twin") else {
        return;
    };
    let grid = random_grid([23, 18, 17], 0);
    let data = Arc::new(Data::Grid(grid.clone()));
    let total = 23 * 18 * 17;
    let cases = [
        (
            "coefficients",
            false,
            vec![190.5],
            Limits {
                chunk: 1 << 20,
                list: 1 << 27,
            },
            1,
        ),
        (
            "data",
            false,
            vec![255.0, 3.25],
            Limits {
                chunk: 1000,
                list: 1 << 27,
            },
            1,
        ),
        (
            "paper",
            false,
            vec![185.5],
            Limits {
                chunk: 513,
                list: 1 << 27,
            },
            1,
        ),
        (
            "coefficients",
            true,
            vec![190.5],
            Limits {
                chunk: 2048,
                list: 1 << 27,
            },
            1,
        ),
        // Lists of 4096 numbers, 73 determining sets: parts are halved.
        (
            "coefficients",
            false,
            vec![190.5],
            Limits {
                chunk: 1024,
                list: 16_384,
            },
            2,
        ),
        (
            "data",
            true,
            vec![190.5],
            Limits {
                chunk: 1024,
                list: 65_536,
            },
            9,
        ),
    ];
    for (word, stored, isovalues, limits, least_parts) in cases {
        let knobs = Knobs::default()
            .with("classify", word)
            .with("coefficients", if stored { "determining-set" } else { "on-the-fly" });
        let mut r = TetsplineRenderer::new(gpu.clone(), &request(1, knobs), limits).unwrap();
        let surfaces: Vec<Surface> = isovalues.iter().map(|c| Surface::isovalue(*c, 0)).collect();
        r.set_data(&data).unwrap();
        r.set_surfaces(&surfaces).unwrap();
        let twin = twin_of(&mut r, &grid, word);
        let (lists, ..) = r.lists().unwrap();
        let name = format!("{word} {stored} {isovalues:?}");
        assert!(lists.parts.len() >= least_parts, "{name}: {} parts", lists.parts.len());
        assert_eq!(lists.parts.len() > 1, least_parts > 1, "{name}");
        let (want_cubes, want_tets) = twin.lists(0..total);
        let (cubes, mut tets) = read(&gpu, lists, stored);
        assert!(!cubes.is_empty() && cubes.len() < total as usize, "{name}: {}", cubes.len());
        assert_eq!(cubes, want_cubes, "{name}");
        tets.iter_mut().for_each(|t| t.sort_unstable());
        assert_eq!(tets, want_tets, "{name}");
        assert_eq!(
            lists.counts(),
            [cubes.len() as u64, tets.iter().map(Vec::len).sum::<usize>() as u64]
        );
        if stored {
            let p = &lists.parts[0];
            let own: Vec<u32> = gpu.read(&p.cubes, p.counts[0] as usize).unwrap();
            let sets: Vec<f32> = gpu.read(p.sets.as_ref().unwrap(), 56 * own.len()).unwrap();
            let want: Vec<f32> = own.iter().flat_map(|&c| twin.set(c)).collect();
            assert_eq!(sets, want, "{name}");
        }
    }
}

/// Smooth floats: the lists of this device are those of the twin too, the conservative ones hold every cube that is active in f64, and a change of the
/// isovalue makes no new buffers where they suffice.
#[test]
fn lists_of_floats_are_conservative_and_remade_in_place() {
    let Some((gpu, _guard)) = adapter("lists_of_floats_are_conservative_and_remade_in_place") else {
        return;
    };
    let data = synthetic("gyroid,n=36");
    let Data::Grid(grid) = &*data else { unreachable!("a grid") };
    let limits = Limits::new(&gpu);
    let mut r = TetsplineRenderer::new(gpu.clone(), &request(1, Knobs::default()), limits).unwrap();
    r.set_data(&data).unwrap();
    let mut held = Vec::new();
    for c in [0.2, 0.9, -1.3, 0.0] {
        r.set_surfaces(&[Surface::isovalue(c, 0)]).unwrap();
        let twin = twin_of(&mut r, grid, "coefficients");
        let (lists, ..) = r.lists().unwrap();
        let (cubes, _) = read(&gpu, lists, false);
        let (want, _) = twin.lists(0..36 * 36 * 36);
        let apart = cubes.iter().filter(|c| want.binary_search(c).is_err()).count() + want.len().abs_diff(cubes.len());
        assert_eq!(apart, 0, "{c}: {} cubes", cubes.len());
        let exact = crate::classify::count(&Type6Spline::new(grid).unwrap(), c);
        assert!(
            cubes.len() >= exact.by_coefficients && cubes.len() <= exact.by_coefficients + 20,
            "{c}: {exact:?}"
        );
        held.push(lists.bytes());
    }
    assert_eq!(held[0], held[3]);
    let none = [Surface::isovalue(99.0, 0)];
    r.set_surfaces(&none).unwrap();
    assert_eq!(r.lists().unwrap().0.counts(), [0, 0]);
}
