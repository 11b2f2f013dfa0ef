//! WGSL of the spline's coefficients, written by running isobar_fields' own rules on symbols.
//!
//! `coefficients_192` and [`DeterminingSet`] are generic over numbers. Run on [`Symbol`]s they leave a tape of sums and products, equal ones stored once, which is printed as
//! straight-line WGSL: Kalbe et al. 2009, section 4.1, "the BB-coefficients for Q have to be calculated only once and are then assigned to the corresponding
//! domain points on the tetrahedra", and section 4.3, the 20 coefficients of one tetrahedron from 23 texels, or from the stored determining set.

use isobar_fields::type6::{DeterminingSet, Number, coefficients_192, frame};
use std::cell::RefCell;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::ops::{Add, Mul, Sub};

/// Coefficients of a determining set: 8 vertices, 24 on edges, 24 on faces.
pub(super) const SET: usize = 56;

/// The kind whose canonical frame is the cube's own.
const OWN: usize = 5;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Op {
    Input(usize),
    Constant(i32),
    Add(Symbol, Symbol),
    Sub(Symbol, Symbol),
    Mul(Symbol, Symbol),
    Half(Symbol),
}

/// What is written down so far; equal operations once.
#[derive(Debug, Default)]
struct Tape {
    ops: Vec<Op>,
    seen: HashMap<Op, Symbol>,
}

thread_local! {
    static TAPE: RefCell<Tape> = RefCell::default();
}

/// A number of the tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
struct Symbol(usize);

fn note(op: Op) -> Symbol {
    TAPE.with_borrow_mut(|t| {
        let next = Symbol(t.ops.len());
        let at = *t.seen.entry(op).or_insert(next);
        if at == next {
            t.ops.push(op);
        }
        at
    })
}

impl Add for Symbol {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        // Addition commutes bit by bit, so both orders are one.
        note(Op::Add(self.min(o), self.max(o)))
    }
}

impl Sub for Symbol {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        note(Op::Sub(self, o))
    }
}

impl Mul for Symbol {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        note(Op::Mul(self.min(o), self.max(o)))
    }
}

impl Number for Symbol {
    fn small(k: i32) -> Self {
        note(Op::Constant(k))
    }
    fn half(self) -> Self {
        note(Op::Half(self))
    }
}

/// The lines that compute `wanted`, input n named `input(n)`; and the inputs they need.
fn lines(wanted: &[Symbol], input: impl Fn(usize) -> String) -> (String, Vec<usize>, impl Fn(Symbol) -> String) {
    let ops = TAPE.with_borrow(|t| t.ops.clone());
    let mut needed = vec![false; ops.len()];
    for s in wanted {
        needed[s.0] = true;
    }
    for at in (0..ops.len()).rev().filter(|&at| needed[at]).collect::<Vec<_>>() {
        mark(&ops, at, &mut needed);
    }
    let name = {
        let ops = ops.clone();
        let inputs: Vec<String> = (0..SET).map(input).collect();
        move |s: Symbol| match ops[s.0] {
            Op::Input(n) => inputs[n].clone(),
            Op::Constant(k) => format!("{k}.0"),
            _ => format!("e{}", s.0),
        }
    };
    let mut text = String::new();
    let mut inputs = Vec::new();
    for (at, op) in ops.iter().enumerate().filter(|(at, _)| needed[*at]) {
        let right = match *op {
            Op::Input(n) => {
                inputs.push(n);
                continue;
            }
            Op::Constant(_) => continue,
            Op::Add(a, b) => format!("{} + {}", name(a), name(b)),
            Op::Sub(a, b) => format!("{} - {}", name(a), name(b)),
            Op::Mul(a, b) => format!("{} * {}", name(a), name(b)),
            Op::Half(a) => format!("0.5 * {}", name(a)),
        };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "    let e{at} = {right};");
    }
    (text, inputs, name)
}

/// Marks what operation `at` needs, and what that needs.
fn mark(ops: &[Op], at: usize, needed: &mut [bool]) {
    let of: &[Symbol] = match &ops[at] {
        Op::Input(_) | Op::Constant(_) => &[],
        Op::Add(a, b) | Op::Sub(a, b) | Op::Mul(a, b) => &[*a, *b],
        Op::Half(a) => &[*a],
    };
    for s in of {
        if !needed[s.0] {
            needed[s.0] = true;
            mark(ops, s.0, needed);
        }
    }
}

fn restart() {
    TAPE.with_borrow_mut(|t| *t = Tape::default());
}

fn inputs<const N: usize>() -> [Symbol; N] {
    std::array::from_fn(|n| note(Op::Input(n)))
}

/// `fn bezier(...) -> Patch` from its arguments and the names of inputs.
fn patch(arguments: &str, b: &[Symbol; 20], input: impl Fn(usize) -> String, load: impl Fn(usize) -> String) -> String {
    let (body, used, name) = lines(b, input);
    let mut out = format!("fn bezier({arguments}) -> Patch {{\n");
    for n in used {
        let _ = writeln!(out, "    let d{n} = {};", load(n));
    }
    out.push_str(&body);
    let fours: Vec<String> = b
        .chunks_exact(4)
        .map(|c| {
            let c: Vec<String> = c.iter().map(|s| name(*s)).collect();
            format!("vec4({}) * PART", c.join(", "))
        })
        .collect();
    let _ = writeln!(out, "    return Patch({});\n}}", fours.join(", "));
    out
}

/// K13 (a): `fn bezier(q, x, y, z)`: the 20 coefficients, minus the bias, of the tetrahedron of cube q with canonical axes x, y, z, from 23 texels.
pub(super) fn on_the_fly() -> String {
    restart();
    let b = coefficients_192(&inputs::<27>());
    let step = |o: usize, axis: &str| match o {
        0 => format!(" - {axis}"),
        2 => format!(" + {axis}"),
        _ => String::new(),
    };
    patch(
        "q: vec3<i32>, x: vec3<i32>, y: vec3<i32>, z: vec3<i32>",
        &b,
        |n| format!("d{n}"),
        |n| format!("datum(q{}{}{})", step(n % 3, "x"), step(n / 3 % 3, "y"), step(n / 9, "z")),
    )
}

/// The inputs of a determining set: vertices, edges, faces, in that order.
fn set_of(n: &[Symbol; SET]) -> DeterminingSet<Symbol> {
    DeterminingSet {
        vertices: std::array::from_fn(|v| n[v]),
        edges: std::array::from_fn(|a| std::array::from_fn(|e| std::array::from_fn(|s| n[8 + 8 * a + 2 * e + s]))),
        faces: std::array::from_fn(|f| n[32 + f]),
    }
}

/// A determining set as the list that [`table`] speaks of.
fn list_of<T: Copy>(s: &DeterminingSet<T>) -> [T; SET] {
    std::array::from_fn(|n| match n {
        0..8 => s.vertices[n],
        8..32 => s.edges[(n - 8) / 8][(n - 8) / 2 % 4][n % 2],
        _ => s.faces[n - 32],
    })
}

/// K13 (b): `fn bezier(slot, kind)` from the determining set stored for the cube.
pub(super) fn from_set() -> String {
    restart();
    let b = set_of(&inputs::<SET>()).coefficients(OWN);
    let load = |n: usize| format!("sets[slot * {SET}u + set_table[kind * {SET}u + {n}u]]");
    patch("slot: u32, kind: u32", &b, |n| format!("d{n}"), load)
}

/// Where the determining set of a cube holds what a kind sees at each place of its canonical frame.
pub(super) fn table() -> Vec<u32> {
    (0..24).flat_map(|kind| (0..SET).map(move |n| place(kind, n))).collect()
}

/// The place in the cube's own frame of place `n` in the frame of a kind.
fn place(kind: usize, n: usize) -> u32 {
    let ([a, b, c], [sa, sb]) = frame(kind);
    // Canonical axis i is the cube's axis `axes[i]`, with that sign.
    let (axes, signs) = ([a, b, c], [i32::from(sa), i32::from(sb), 1]);
    let bit = |s: i32| usize::from(s > 0);
    let own = |s: [i32; 3]| {
        let mut out = [0; 3];
        for i in 0..3 {
            out[axes[i]] = signs[i] * s[i];
        }
        out
    };
    let sign = |bits: usize, i: usize| if bits >> i & 1 == 1 { 1 } else { -1 };
    let at = match n {
        0..8 => {
            let s = own(std::array::from_fn(|i| sign(n, i)));
            (0..3).map(|i| bit(s[i]) << i).sum()
        }
        8..32 => {
            let (axis, edge, end) = ((n - 8) / 8, (n - 8) / 2 % 4, n % 2);
            let mut s = [0; 3];
            s[axis] = sign(end, 0);
            s[(axis + 1) % 3] = sign(edge, 0);
            s[(axis + 2) % 3] = sign(edge, 1);
            let (s, axis) = (own(s), axes[axis]);
            8 + 8 * axis + 2 * (bit(s[(axis + 1) % 3]) + 2 * bit(s[(axis + 2) % 3])) + bit(s[axis])
        }
        _ => {
            let ([fa, fb, _], [fsa, fsb]) = frame(n - 32);
            let (x, y) = (axes[fa], axes[fb]);
            let (sx, sy) = (signs[fa] * i32::from(fsa), signs[fb] * i32::from(fsb));
            32 + 8 * x + 4 * bit(sx) + 2 * ((y + 2 - x) % 3) + bit(sy)
        }
    };
    at as u32
}

fn folded(function: &str, names: &[String]) -> String {
    names
        .iter()
        .skip(1)
        .fold(names[0].clone(), |a, n| format!("{function}({a}, {n})"))
}

fn data_arguments() -> String {
    let names: Vec<String> = (0..27).map(|n| format!("d{n}: f32")).collect();
    names.join(", ")
}

/// `fn kinds(data, slack) -> u32`: the kinds whose 20 coefficients meet an isovalue, bit by bit; all coefficients of the cube once.
pub(super) fn kinds() -> String {
    restart();
    let set = DeterminingSet::new(&inputs::<27>());
    let all: Vec<[Symbol; 20]> = (0..24).map(|k| set.coefficients(k)).collect();
    let (body, _, name) = lines(all.as_flattened(), |n| format!("d{n}"));
    let mut out = format!("fn kinds({}, slack: f32) -> u32 {{\n{body}", data_arguments());
    for (k, b) in all.iter().enumerate() {
        let names: Vec<String> = b.iter().map(|s| name(*s)).collect();
        let _ = writeln!(out, "    let lo{k} = {};", folded("min", &names));
        let _ = writeln!(out, "    let hi{k} = {};", folded("max", &names));
    }
    out.push_str(
        "    var mask = 0u;\n    for (var j = 0u; j < params.levels; j++) {\n        let v = levels[j].value * 192.0;\n",
    );
    for k in 0..24 {
        let _ = writeln!(
            out,
            "        mask |= select(0u, {}u, lo{k} - slack <= v && v <= hi{k} + slack);",
            1u32 << k
        );
    }
    out.push_str("    }\n    return mask;\n}\n");
    out
}

/// `fn determining_set_meets(data) -> bool`: the paper's classification of cubes.
pub(super) fn set_meets() -> String {
    restart();
    let set = list_of(&DeterminingSet::new(&inputs::<27>()));
    let (body, _, name) = lines(&set, |n| format!("d{n}"));
    let names: Vec<String> = set.iter().map(|s| name(*s)).collect();
    format!(
        "fn determining_set_meets({}) -> bool {{\n{body}    let lo = {};\n    let hi = {};\n    return meets(lo, hi, 192.0, 0.0);\n}}\n",
        data_arguments(),
        folded("min", &names),
        folded("max", &names)
    )
}

/// `fn store_set(slot, data)`: the determining set of a cube, stored.
pub(super) fn store_set() -> String {
    restart();
    let set = list_of(&DeterminingSet::new(&inputs::<27>()));
    let (body, _, name) = lines(&set, |n| format!("d{n}"));
    let mut out = format!("fn store_set(slot: u32, {}) {{\n{body}", data_arguments());
    for (n, s) in set.iter().enumerate() {
        let _ = writeln!(out, "    sets[slot * {SET}u + {n}u] = {};", name(*s));
    }
    out.push_str("}\n");
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_fields::type6::{canonical, reorder};

    /// What a kind reads of the stored set through the table gives its coefficients, for every kind.
    #[test]
    fn the_table_turns_determining_sets() {
        let p = [1.0, 2.0, 3.0];
        assert!((0..24).all(|k| (canonical(k, p) == p) == (k == OWN)));
        let data: [i64; 27] = std::array::from_fn(|n| 4 * ((n as i64 * 7919 + 13) % 101));
        let set = DeterminingSet::new(&data);
        let list = list_of(&set);
        let table = table();
        for kind in 0..24 {
            let seen: [i64; SET] = std::array::from_fn(|n| list[table[kind * SET + n] as usize]);
            let turned = list_of(&DeterminingSet::new(&reorder(kind, &data)));
            assert_eq!(seen, turned, "kind {kind}");
            assert_eq!(set.coefficients(kind), coefficients_192(&reorder(kind, &data)));
        }
    }

    /// The texts: 23 texels (K13), a patch without loops, and nothing computed twice.
    #[test]
    fn twenty_three_texels_and_no_loops() {
        let text = on_the_fly();
        assert_eq!(text.matches("datum(").count(), 23);
        assert!(!text.contains("for"));
        let texts = [on_the_fly(), from_set(), set_meets(), store_set()];
        for t in texts {
            let mut sums: Vec<&str> = t
                .lines()
                .filter_map(|l| l.split(" = ").nth(1))
                .filter(|r| r.contains(" + e"))
                .collect();
            let n = sums.len();
            sums.sort_unstable();
            sums.dedup();
            assert_eq!(sums.len(), n);
        }
    }
}
