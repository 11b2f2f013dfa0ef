//! Lists against the counts and rules of `classify`, cube by cube.

use super::*;
use crate::classify::{active_kinds, count};
use isobar_core::{Data, Grid};
use isobar_fields::Synthetic;
use isobar_fields::type6::DeterminingSet;

fn random_bytes(dims: [usize; 3], seed: u64) -> Grid {
    let mut s = seed;
    let samples: Vec<u8> = (0..dims.iter().product())
        .map(|_| {
            s = s
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (s >> 56) as u8
        })
        .collect();
    Grid::unit(dims, Samples::U8(samples.into())).unwrap()
}

/// Every list of one isovalue by the scalar rules.
fn by_rule(spline: &Type6Spline, isovalue: f64, rule: Rule) -> (Vec<u32>, Vec<Vec<u32>>) {
    let dims = spline.dims();
    let (mut cubes, mut tets) = (Vec::new(), vec![Vec::new(); KINDS]);
    for cube in 0..dims.iter().product::<usize>() as u32 {
        let mut d = [0.0; 27];
        spline.data(coordinates(cube, dims), &mut d);
        let d = d.map(|v| v - isovalue);
        if is_active(rule, &d, 0.0) {
            cubes.push(cube);
            let kinds = active_kinds(&d, 0.0);
            (0..KINDS).filter(|k| kinds >> k & 1 == 1).for_each(|k| tets[k].push(cube));
        }
    }
    (cubes, tets)
}

fn assert_lists(lists: &Lists, isovalue: f64, rule: Rule, name: &str) {
    let (cubes, tets) = by_rule(&lists.spline, isovalue, rule);
    assert_eq!(lists.cubes(), cubes, "{name}");
    for (k, want) in tets.iter().enumerate() {
        assert_eq!(lists.tetrahedra(k), want, "{name}, kind {k}");
    }
    assert_eq!(lists.count(), tets.iter().map(Vec::len).sum::<usize>());
}

/// Odd sizes, rows longer than a word and shorter than a block, isovalues between data, on data, and outside; the same lists with a hierarchy, at every level of
/// instructions, and when the memory of another isovalue is used again.
#[test]
fn lists_are_those_of_the_rules() {
    for dims in [[2, 2, 2], [3, 5, 9], [67, 9, 6], [16, 4, 8], [130, 3, 5]] {
        let spline = Type6Spline::new(&random_bytes(dims, 7)).unwrap();
        let (mut plain, mut blocks) = (Lists::new(&spline, false).unwrap(), Lists::new(&spline, true).unwrap());
        assert!(blocks.hierarchy_bytes() > 0 && plain.hierarchy_bytes() == 0);
        for level in Level::ALL {
            (plain.level, blocks.level) = (level, level);
            for (isovalue, rule) in [
                (200.5, Rule::Coefficients),
                (3.0, Rule::Data),
                (90.0, Rule::DeterminingSet),
                (255.0, Rule::Coefficients),
                (-1.0, Rule::Coefficients),
            ] {
                for lists in [&mut plain, &mut blocks] {
                    lists.rebuild(isovalue, rule);
                    assert_lists(lists, isovalue, rule, &format!("{dims:?} at {isovalue}, {rule:?}, {level}"));
                }
            }
        }
    }
}

/// Floats, where coefficients round: the lists have the numbers of `classify::count`, and one thread gives what many do.
#[test]
fn lists_have_the_counts_of_the_classification() {
    let Data::Grid(grid) = "gyroid,n=50".parse::<Synthetic>().unwrap().data().unwrap() else {
        panic!("a grid")
    };
    for spline in [
        Type6Spline::new(&grid).unwrap(),
        Type6Spline::prefiltered(&grid, isobar_core::Stage::Stored).unwrap(),
    ] {
        let mut lists = Lists::new(&spline, true).unwrap();
        for isovalue in [0.2, 0.0, -1.1] {
            let want = count(&spline, isovalue);
            lists.rebuild(isovalue, Rule::Data);
            assert_eq!(lists.cubes().len(), want.by_data);
            lists.rebuild(isovalue, Rule::DeterminingSet);
            assert_eq!(lists.cubes().len(), want.by_determining_set);
            let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            one.install(|| lists.rebuild(isovalue, Rule::Coefficients));
            assert_eq!((lists.cubes().len(), lists.count()), (want.by_coefficients, want.tetrahedra));
            assert!(want.tetrahedra > 1000 && lists.bytes() > 4 * (want.by_coefficients + want.tetrahedra));
        }
    }
}

/// From a stored determining set the averaging rules give back the coefficients.
#[test]
fn stored_sets_give_the_coefficients() {
    let spline = Type6Spline::new(&random_bytes([9, 8, 7], 3)).unwrap();
    let mut lists = Lists::new(&spline, false).unwrap();
    lists.rebuild(120.5, Rule::Coefficients);
    let sets = lists.determining_sets(120.5);
    assert_eq!(sets.len(), lists.cubes().len());
    assert!(!sets.is_empty());
    for (stored, &cube) in sets.iter().zip(lists.cubes()) {
        let mut d = [0.0; 27];
        spline.data(coordinates(cube, spline.dims()), &mut d);
        let want = DeterminingSet::new(&d.map(|v| v - 120.5));
        let all = want
            .vertices
            .iter()
            .chain(want.edges.iter().flatten().flatten())
            .chain(&want.faces);
        // Halves of integers below 2^16: exact in f32.
        assert!(stored.iter().zip(all).all(|(s, w)| f64::from(*s) == *w));
    }
}

/// A plateau at the isovalue is active everywhere.
#[test]
fn plateaus_are_active() {
    let grid = Grid::unit([70, 5, 4], Samples::U16(vec![7; 70 * 5 * 4].into())).unwrap();
    let mut lists = Lists::new(&Type6Spline::new(&grid).unwrap(), true).unwrap();
    lists.rebuild(7.0, Rule::Coefficients);
    assert_eq!((lists.cubes().len(), lists.count()), (1400, 24 * 1400));
    lists.rebuild(7.5, Rule::Coefficients);
    assert_eq!((lists.cubes().len(), lists.count()), (0, 0));
}
