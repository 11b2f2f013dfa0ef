//! Table 3.1: operations, times and errors of the compositions.

use super::Random;
use isobar_cpu::Level;
use isobar_octree::compose::{Basis, Counted, Form, Lanes, Packet, WIDTH, axis_packets, axis_segment_packets, compose, count};
use serde::{Deserialize, Serialize};
use std::hint::black_box;
use std::time::Instant;

/// A form of composition at a degree of the cell.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Composition {
    /// The thesis's name, or ours.
    pub form: String,
    /// Degree of the cell in x, y, z.
    pub degree: u32,
    /// Counted.
    pub multiplications: u64,
    /// Counted, subtractions too.
    pub additions: u64,
    /// Least nanoseconds per ray, f32, one ray after another.
    pub nanoseconds: f64,
    /// In packets of sixteen, at the machine's instruction set; where there is such a form.
    pub packet_nanoseconds: Option<f64>,
    /// As in the thesis: random coefficients of the form's own basis, f32 against f64, squared error of a coefficient over the mean square of all.
    pub mse: f64,
    /// The same cell for all forms, converted to the form's basis and rounded: the greatest error of a Bernstein coefficient over the
    /// greatest coefficient, root mean square over rays. Power forms: about a corner of the cell.
    pub cell_error: f64,
    /// The same about the centre of the cell, where the form has a choice of origin.
    pub centred_error: Option<f64>,
}

/// What Table 3.1 prints.
#[derive(Debug, Clone, Copy)]
pub struct Printed31 {
    /// Form.
    pub form: &'static str,
    /// Multiplications, additions as printed; registers.
    pub operations: [u32; 3],
    /// Relative to the slowest.
    pub time: f64,
    /// Relative to the coefficients.
    pub mse: f64,
}

/// Table 3.1 (paper-numbers: Steinberger2010, Tab3.1; degree 3, CUDA compiler's machine code, GeForce GTX 285).
pub const PRINTED_3_1: [Printed31; 5] = [
    printed("naive", [1839, 990, 135], 1.0, 162.3e-12),
    printed("PF", [234, 360, 27], 3.6e-3, 22.6e-12),
    printed("SB0", [741, 483, 72], 26e-3, 5.15e-12),
    printed("SB1", [687, 490, 60], 23e-3, 4.78e-12),
    printed("SB2", [720, 558, 66], 22e-3, 4.78e-12),
];

const fn printed(form: &'static str, operations: [u32; 3], time: f64, mse: f64) -> Printed31 {
    Printed31 {
        form,
        operations,
        time,
        mse,
    }
}

/// Rays for errors.
const RAYS: usize = 2000;

/// All forms, degree 3 first.
pub(super) fn measure() -> Vec<Composition> {
    let mut all = degree::<3>();
    all.extend(degree::<2>());
    all.extend(degree::<1>());
    all
}

fn degree<const D: usize>() -> Vec<Composition> {
    let times = times::<D>();
    Form::ALL
        .iter()
        .zip(times)
        .map(|(form, (nanoseconds, packet_nanoseconds))| {
            let one = Counted(1.0f32);
            let mut out = vec![one; 3 * D + 1];
            let done = count(|| compose::<_, D>(*form, &vec![one; (D + 1).pow(3)], &[[one; 2]; 3], &mut out));
            let centred = form.basis() != Basis::ScaledBernstein;
            Composition {
                form: form.name().into(),
                degree: D as u32,
                multiplications: done.multiplications,
                additions: done.additions,
                nanoseconds,
                packet_nanoseconds,
                mse: own_basis::<D>(*form),
                cell_error: on_a_cell::<D>(*form, 0.0),
                centred_error: centred.then(|| on_a_cell::<D>(*form, 0.5)),
            }
        })
        .collect()
}

/// A stretch of a ray through the unit cube: two points, the axis along which it advances most last.
fn stretch(random: &mut Random) -> [[f64; 2]; 3] {
    let mut s: [[f64; 2]; 3] = std::array::from_fn(|_| [random.unit(), random.unit()]);
    s.sort_by(|a, b| (a[1] - a[0]).abs().total_cmp(&(b[1] - b[0]).abs()));
    s
}

/// A form's components of the ray through two points, coordinates about `origin` on all axes.
fn components(form: Form, s: &[[f64; 2]; 3], origin: f64) -> [[f64; 2]; 3] {
    let points = s.map(|[a, b]| [a - origin, b - origin]);
    match form {
        Form::Naive | Form::Pf => points.map(|[a, b]| [a, b - a]),
        Form::Sb0 | Form::Sb1 | Form::Sb2 | Form::Sb3 => points,
        Form::Axis | Form::AxisSegment => {
            let [z0, z1] = points[2];
            let along = |[a, b]: [f64; 2]| {
                let slope = (b - a) / (z1 - z0);
                [a - slope * z0, slope]
            };
            [along(points[0]), along(points[1]), [z0, z1]]
        }
    }
}

/// The composition in f32, and with the same inputs in f64.
fn both<const D: usize>(form: Form, f: &[f64], r: &[[f64; 2]; 3]) -> (Vec<f64>, Vec<f64>) {
    let narrow: Vec<f32> = f.iter().map(|x| *x as f32).collect();
    let narrow_ray = r.map(|c| c.map(|x| x as f32));
    let mut out = vec![0.0f32; 3 * D + 1];
    compose::<f32, D>(form, &narrow, &narrow_ray, &mut out);
    let rounded: Vec<f64> = narrow.iter().map(|x| f64::from(*x)).collect();
    let mut exact = vec![0.0; 3 * D + 1];
    compose::<f64, D>(form, &rounded, &narrow_ray.map(|c| c.map(f64::from)), &mut exact);
    (out.iter().map(|x| f64::from(*x)).collect(), exact)
}

fn own_basis<const D: usize>(form: Form) -> f64 {
    let mut random = Random(31);
    let mut sum = 0.0;
    for _ in 0..RAYS {
        let f: Vec<f64> = (0..(D + 1).pow(3)).map(|_| random.signed()).collect();
        let s = stretch(&mut random);
        let (got, exact) = both::<D>(form, &f, &components(form, &s, 0.0));
        let squares = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
        let errors: Vec<f64> = got.iter().zip(&exact).map(|(a, b)| a - b).collect();
        sum += squares(&errors) / squares(&exact);
    }
    sum / RAYS as f64
}

/// Applies `convert` to every row of the (d + 1)^3 coefficients, axis by axis.
fn each_axis(f: &mut [f64], d: usize, convert: impl Fn(&mut [f64])) {
    let n = d + 1;
    let mut row = vec![0.0; n];
    for stride in [1, n, n * n] {
        for start in (0..n * n * n).filter(|i| i / stride % n == 0) {
            for k in 0..n {
                row[k] = f[start + k * stride];
            }
            convert(&mut row);
            for k in 0..n {
                f[start + k * stride] = row[k];
            }
        }
    }
}

/// A cell's coefficients in a form's basis, about `origin`, from its Bernstein coefficients.
fn in_basis(form: Form, cell: &[f64], d: usize, origin: f64) -> Vec<f64> {
    let mut f = cell.to_vec();
    each_axis(&mut f, d, |row| match form.basis() {
        Basis::ScaledBernstein => isobar_poly::bernstein::to_scaled(row),
        Basis::Power | Basis::PowerToScaledBernstein => {
            isobar_poly::bernstein::to_power(row);
            isobar_poly::power::restrict(row, origin, origin + 1.0);
        }
    });
    f
}

/// A form's result as Bernstein coefficients over the stretch, in f64.
fn as_bernstein(form: Form, a: &[f64], r: &[[f64; 2]; 3]) -> Vec<f64> {
    let mut b = a.to_vec();
    match form {
        Form::Naive | Form::Pf => isobar_poly::power::to_bernstein(&mut b),
        Form::Axis => {
            isobar_poly::power::restrict(&mut b, r[2][0], r[2][1]);
            isobar_poly::power::to_bernstein(&mut b);
        }
        _ => isobar_poly::scaled::to_bernstein(&mut b),
    }
    b
}

/// The Bernstein coefficients of a cell along a stretch, by one form in f64 for all.
fn reference<const D: usize>(cell: &[f64], s: &[[f64; 2]; 3]) -> Vec<f64> {
    let mut out = vec![0.0; 3 * D + 1];
    let f = in_basis(Form::Sb1, cell, D, 0.0);
    compose::<f64, D>(Form::Sb1, &f, s, &mut out);
    isobar_poly::scaled::to_bernstein(&mut out);
    out
}

fn on_a_cell<const D: usize>(form: Form, origin: f64) -> f64 {
    let mut random = Random(7);
    let mut sum = 0.0;
    for _ in 0..RAYS {
        let cell: Vec<f64> = (0..(D + 1).pow(3)).map(|_| random.signed()).collect();
        let s = stretch(&mut random);
        let exact = reference::<D>(&cell, &s);
        let r = components(form, &s, origin);
        let (got, _) = both::<D>(form, &in_basis(form, &cell, D, origin), &r);
        let got = as_bernstein(form, &got, &r);
        let most = exact.iter().fold(f64::MIN_POSITIVE, |m, x| m.max(x.abs()));
        let error = got.iter().zip(&exact).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
        sum += (error / most) * (error / most);
    }
    (sum / RAYS as f64).sqrt()
}

/// Bernstein coefficients of degree 9, 6 or 3 along a ray through a voxel of a smooth field with noise, and an isovalue in its range: what root
/// finders meet in volumes.
pub(super) fn random_ray(random: &mut Random, degree: usize) -> Vec<f64> {
    fn of<const D: usize>(random: &mut Random) -> Vec<f64> {
        let slope: [f64; 3] = std::array::from_fn(|_| random.signed());
        let n = D + 1;
        let mut cell: Vec<f64> = (0..n * n * n)
            .map(|i| {
                let at = [i / (n * n), i / n % n, i % n].map(|x| x as f64 / D as f64 - 0.5);
                (0..3).map(|a| slope[a] * at[a]).sum::<f64>() + 0.4 * random.signed()
            })
            .collect();
        // The isovalue: between the values at two corners of the cell.
        let (a, b) = (cell[0], cell[n * n * n - 1]);
        let isovalue = a + (b - a) * random.unit();
        cell.iter_mut().for_each(|x| *x -= isovalue);
        let s = stretch(random);
        reference::<D>(&cell, &s)
    }
    match degree {
        9 => of::<3>(random),
        6 => of::<2>(random),
        _ => of::<1>(random),
    }
}

/// Least nanoseconds per ray of all forms, interleaved: one by one, and in packets.
fn times<const D: usize>() -> Vec<(f64, Option<f64>)> {
    const PACKETS: usize = 8;
    const ROUNDS: usize = 60;
    let (n, m, rays) = ((D + 1).pow(3), 3 * D + 1, PACKETS * WIDTH);
    let mut random = Random(99);
    let cells: Vec<Lanes<WIDTH>> = (0..PACKETS * n)
        .map(|_| Lanes(std::array::from_fn(|_| random.signed() as f32)))
        .collect();
    let mut pair = || std::array::from_fn(|_| Lanes(std::array::from_fn(|_| random.unit() as f32)));
    let packets: Vec<Packet<'_>> = (cells.chunks(n))
        .map(|cells| Packet {
            cells,
            rays: [pair(), pair()],
            stretch: pair(),
        })
        .collect();
    let single: Vec<(Vec<f32>, [[f32; 2]; 3])> = (0..rays)
        .map(|i| {
            let (p, lane) = (&packets[i / WIDTH], i % WIDTH);
            let f = p.cells.iter().map(|c| c.0[lane]).collect();
            (f, [p.rays[0], p.rays[1], p.stretch].map(|r| r.map(|c| c.0[lane])))
        })
        .collect();
    let level = Level::detect();
    let (mut out, mut wide) = (vec![0.0f32; rays * m], vec![Lanes::splat(0.0); PACKETS * m]);
    let mut least = vec![(f64::INFINITY, None); Form::ALL.len()];
    for _ in 0..ROUNDS {
        for (form, least) in Form::ALL.iter().zip(&mut least) {
            let start = Instant::now();
            for ((f, r), out) in black_box(&single).iter().zip(out.chunks_exact_mut(m)) {
                compose::<f32, D>(*form, f, r, out);
            }
            black_box(&mut out);
            least.0 = least.0.min(start.elapsed().as_secs_f64() * 1e9 / rays as f64);
            let in_packets = match form {
                Form::Axis => axis_packets::<D>,
                Form::AxisSegment => axis_segment_packets::<D>,
                _ => continue,
            };
            let start = Instant::now();
            in_packets(level, black_box(&packets), black_box(&mut wide));
            let each = start.elapsed().as_secs_f64() * 1e9 / rays as f64;
            least.1 = Some(least.1.map_or(each, |l: f64| l.min(each)));
        }
    }
    least
}
