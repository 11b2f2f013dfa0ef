//! Classification, scan and compaction against their CPU twins, number by number.

use super::*;
use crate::classify::Rule;
use crate::gpu::lists::{Limits, Lists};
use crate::gpu::renderer::TetsplineRenderer;
use crate::gpu::twin::Twin;
use isobar_core::Tetrahedral as _;
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

/// Samples of a field as bytes between `lo` and `hi`.
fn bytes(spec: &str, [lo, hi]: [f32; 2]) -> Grid {
    let data = synthetic(spec);
    let Data::Grid(grid) = &*data else { unreachable!("a grid") };
    let Samples::F32(s) = &grid.samples else { unreachable!("f32") };
    let samples: Vec<u8> = s
        .iter()
        .map(|v| (255.0 * (v - lo) / (hi - lo)).clamp(0.0, 255.0) as u8)
        .collect();
    Grid {
        samples: Samples::U8(samples.into()),
        ..grid.clone()
    }
}

/// The lists that threads make in f64 ([`crate::lists::Lists`]) are those of the kernels, number by number and in order, for every rule: of bytes, whose coefficients are exact
/// in both. Isovalues between samples, equal to samples and coefficients (1.328125 is 255/192), at both ends of the data and beyond them; plateaus.
#[test]
fn lists_of_bytes_are_those_of_the_cpu() {
    let Some((gpu, _guard)) = adapter("lists_of_bytes_are_those_of_the_cpu") else {
        return;
    };
    let mut random = Random(9);
    let steps: Vec<u8> = (0..19 * 23 * 11).map(|_| (random.single() * 4.0) as u8).collect();
    let flat = Grid::unit([70, 5, 4], Samples::U8(vec![7; 1400].into())).unwrap();
    let cases = [
        (random_grid([23, 18, 17], 0), vec![190.5, 128.0, 0.0, 255.0, -1.0, 300.0]),
        (
            Grid::unit([19, 23, 11], Samples::U8(steps.into())).unwrap(),
            vec![1.0, 1.5, 3.0, 1.328_125, 2.25],
        ),
        (flat, vec![7.0, 6.5, 7.5]),
        (bytes("gyroid,n=36", [-1.6, 1.6]), vec![143.0, 127.5, 20.25]),
        (bytes("marschner-lobb,n=33", [0.0, 1.0]), vec![127.0, 99.75]),
    ];
    let limits = Limits {
        chunk: 3000,
        ..Limits::new(&gpu)
    };
    let mut none = 0;
    for (n, (grid, isovalues)) in cases.iter().enumerate() {
        let data = Arc::new(Data::Grid(grid.clone()));
        let mut cpu = crate::lists::Lists::new(&Type6Spline::new(grid).unwrap(), n % 2 == 0).unwrap();
        for word in ["coefficients", "data", "paper"] {
            let mut r =
                TetsplineRenderer::new(gpu.clone(), &request(1, Knobs::default().with("classify", word)), limits).unwrap();
            r.set_data(&data).unwrap();
            for &c in isovalues {
                let name = format!("data {n} at {c}, {word}");
                r.set_surfaces(&[Surface::isovalue(c, 0)]).unwrap();
                let (lists, ..) = r.lists().unwrap();
                let (cubes, tets) = read(&gpu, lists, false);
                cpu.rebuild(c, rule(word));
                assert!(cubes == cpu.cubes(), "{name}");
                for (kind, list) in tets.iter().enumerate() {
                    assert!(list == cpu.tetrahedra(kind), "{name}, kind {kind}");
                }
                assert_eq!(lists.counts(), [cpu.cubes().len() as u64, cpu.count() as u64], "{name}");
                none += usize::from(word == "data" && cubes.is_empty());
            }
        }
    }
    assert_eq!(none, 4, "isovalues beyond all data have empty lists, the others do not");
}

/// Of data that f32 rounds the kernels' lists hold those of the CPU; what they hold beyond them has a coefficient as near to the isovalue as rounding may hide.
#[test]
fn lists_of_other_data_hold_those_of_the_cpu() {
    let Some((gpu, _guard)) = adapter("lists_of_other_data_hold_those_of_the_cpu") else {
        return;
    };
    let floats = |spec: &str| match &*synthetic(spec) {
        Data::Grid(g) => g.clone(),
        _ => unreachable!("a grid"),
    };
    let cases = [
        (floats("gyroid,n=36"), vec![0.2, 0.0, -1.1]),
        (floats("marschner-lobb,n=30"), vec![0.5, 0.73]),
        (random_grid([17, 12, 15], 1), vec![300.25, -20_000.0]),
        (random_grid([12, 19, 9], 2), vec![32_000.0]),
    ];
    for (n, (grid, isovalues)) in cases.iter().enumerate() {
        let spline = Type6Spline::new(grid).unwrap();
        let mut cpu = crate::lists::Lists::new(&spline, true).unwrap();
        let mut r = TetsplineRenderer::new(gpu.clone(), &request(1, Knobs::default()), Limits::new(&gpu)).unwrap();
        r.set_data(&Arc::new(Data::Grid(grid.clone()))).unwrap();
        for &c in isovalues {
            r.set_surfaces(&[Surface::isovalue(c, 0)]).unwrap();
            let (lists, ..) = r.lists().unwrap();
            let (_, tets) = read(&gpu, lists, false);
            cpu.rebuild(c, Rule::Coefficients);
            let mut more = 0;
            for (kind, list) in tets.iter().enumerate() {
                let (have, want) = (list, cpu.tetrahedra(kind));
                assert!(
                    want.iter().all(|t| have.binary_search(t).is_ok()),
                    "data {n} at {c}, kind {kind}"
                );
                for cube in have.iter().filter(|t| want.binary_search(t).is_err()) {
                    let mut d = [0.0; 27];
                    let (i, dims) = (*cube as usize, grid.dims);
                    spline.data([i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]], &mut d);
                    let d = d.map(|v| v - c);
                    // Of the greatest |datum - isovalue|: the slack of `tet_cube.wgsl`, and as much for the rounding of f32.
                    let margin = 2.0 * 3.814_697_3e-6 * d.iter().fold(0.0f64, |m, v| m.max(v.abs()));
                    assert!(
                        crate::classify::active_kinds(&d, margin) >> kind & 1 == 1,
                        "data {n} at {c}, kind {kind}"
                    );
                    more += 1;
                }
            }
            println!("data {n} at {c}: {} tetrahedra, {more} more than in f64", lists.counts()[1]);
            assert!(
                more * 1000 <= cpu.count() && cpu.count() > 1000,
                "data {n} at {c}: {more} of {}",
                cpu.count()
            );
        }
    }
}
