//! Tables 3.1, 3.2, 6.1, 6.2 and 6.4 and the figures of Steinberger's thesis, measured and drawn again: compositions along a ray, root finders with their budgets, stages of
//! algebraic surfaces, levels of detail, and [`figures`].
//!
//! Operations are counted by running the compositions on numbers that count. Errors of f32 are against the same composition in f64 (its own error
//! is 2^-29 of what is measured; that the forms are exact is tested on integers). Answers of root finders are judged by certified roots of the
//! same f32 polynomials. The thesis's numbers stand beside ours with their hardware; they are never scaled.

use crate::cases::{self, Problem};
use anyhow::{Context, Result};
use isobar_octree::finders::{Answer, Finder};
use isobar_oracle::univariate;
use isobar_poly::{First, RootKind};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Instant;

mod compositions;
pub mod figures;
pub mod gains;
pub mod levels;
pub mod stages;

pub use compositions::{Composition, PRINTED_3_1, Printed31};

/// The tables.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Steinberger {
    /// Table 3.1, for degrees 3, 2, 1 of the cell.
    pub compositions: Vec<Composition>,
    /// Table 3.2.
    pub finders: Vec<FinderRow>,
    /// Titles of the families of polynomials, in the order of [`FinderRow::judged`].
    pub families: Vec<String>,
    /// Cases of [`FinderRow::hard`].
    pub hard_cases: u64,
    /// Table 6.4; none where its data are not there.
    #[serde(default)]
    pub levels: Vec<levels::LevelRow>,
    /// What levels of detail gain.
    #[serde(default)]
    pub gains: Vec<gains::GainRow>,
    /// Table 6.1.
    #[serde(default)]
    pub surfaces: Vec<stages::SurfaceRow>,
    /// The figures, and Table 6.2.
    #[serde(default)]
    pub figures: figures::Figures,
    /// Seconds the tables took, the figures apart.
    pub seconds: f64,
}

/// A root finder with a budget.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FinderRow {
    /// Its name.
    pub name: String,
    /// Iterations, knots or halvings; none for the robust one.
    pub budget: Option<u32>,
    /// Least nanoseconds per polynomial: random, degree 9, f32, one after another.
    pub nanoseconds: f64,
    /// Per family.
    pub judged: Vec<Judged>,
    /// Hardcases A with no answer or a wrong one.
    pub hard: u64,
    /// Hardcases A of which it says that it cannot tell.
    pub hard_undecided: u64,
}

/// Answers about the first root, against certified ones.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// Polynomials.
    pub asked: u64,
    /// Those with a root.
    pub with_root: u64,
    /// There is a root, and none was found.
    pub missed: u64,
    /// There is none, and one was found.
    pub invented: u64,
    /// The answer is nearest to a later root.
    pub later: u64,
    /// Nearest to the first root, but more than [`FAR`] away.
    pub far: u64,
    /// Budget ended without an answer.
    pub gave_up: u64,
    /// Cannot tell from zero (the robust one alone); neither right nor wrong.
    pub undecided: u64,
    /// Mean of the squared distance to the first root, wherever both are there; the interval is 1.
    pub mse: f64,
    /// Of the distances to the first root where that is the nearest: median, 99th percentile.
    pub median: f64,
    /// See `median`.
    pub p99: f64,
    /// Greatest distance to the first root, wherever both are there.
    pub max: f64,
}

impl Judged {
    /// No answer or a wrong one.
    #[must_use]
    pub fn wrong(&self) -> u64 {
        self.missed + self.invented + self.later + self.far + self.gave_up
    }
}

/// An answer farther than this from the first root is wrong, in parts of the interval: a hundredth of a voxel.
pub const FAR: f64 = 0.01;

/// Closer roots than this are one root for f32.
const SAME: f64 = 1e-5;

/// Polynomials per family.
const COUNT: usize = 4000;

/// Budgets: voxels of degree 1, 2, 3 (3, 5, 7), algebraic surfaces (9, 11), Fig. 6.1 (6 (d + 1) = 24).
pub const BUDGETS: [u32; 6] = [3, 5, 7, 9, 11, 24];

/// What Table 3.2 prints (paper-numbers: Steinberger2010, Tab3.2; degree 9, GeForce GTX 285; the budgets are not given): name, registers, time and maximal
/// error relative to the worst, mean squared error relative to the interval.
pub const PRINTED_3_2: [(&str, &str, f64, f64, f64); 4] = [
    ("LR81", "42", 0.076, 0.003, 0.66),
    ("MR07", "30 + 9d + 2i", 1.0, 0.034, 0.85),
    ("aRFBS", "43", 0.062, 0.016, 0.99),
    ("Sturm", "73", 0.077, 0.003, 1.0),
];

/// splitmix64, for inputs that are the same in every run.
#[derive(Debug)]
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// Uniform in [0, 1), 24 bits: exact in f32.
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f64 / f64::from(1 << 24)
    }

    /// Uniform in [-1, 1), exact in f32.
    pub(crate) fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }
}

/// The distance field of Table 6.4 and of most figures, from `bench-data`.
pub const DATA: &str = "cache/dragon_128.nrrd";

/// Measures the tables and draws the figures. `data` is the folder `bench-data`; pictures go to `stage`, the folder the page is put together in; `say` is told
/// what is in hand.
///
/// # Errors
/// When a case or a volume cannot be read, a frame not be drawn or checked, or a picture not be written.
pub fn measure(data: &Path, stage: &Path, say: &dyn Fn(&str)) -> Result<Steinberger> {
    say("tables of the thesis");
    let mut out = kernels(&data.join("definitions/hard/cases"))?;
    let start = Instant::now();
    out.surfaces = stages::measure()?;
    let field = levels::Field::load(&data.join(DATA))?;
    let rows = field.as_ref().map_or(Ok(Vec::new()), levels::Field::rows)?;
    out.levels = levels::table(&rows);
    out.gains = gains::measure()?;
    out.seconds += start.elapsed().as_secs_f64();
    let start = Instant::now();
    let figure = |number: &str| say(&format!("figures of the thesis: {number}"));
    let (album, drawn) = (figures::Album { stage }, &mut out.figures);
    figure("3.2");
    figures::volumes::blocks(data, album, drawn)?;
    if let Some(field) = &field {
        figure("4.5 to 4.6, 6.7 and 6.8");
        figures::detail::dragon(field, &rows, album, drawn)?;
    }
    // Their coefficients need not be in memory beside what follows.
    drop((rows, field));
    figure("6.1");
    figures::surfaces::measure(&figures::surfaces::SIZES, album, drawn)?;
    for (i, v) in figures::volumes::VOLUMES.iter().enumerate() {
        let number = format!("6.{}", i + 2);
        figure(&number);
        figures::volumes::degrees(data, &number, v, [1024, 768], album, drawn)?;
    }
    figure("6.6");
    figures::volumes::closeup(data, [512, 384], album, drawn)?;
    figure("6.9");
    figures::detail::parts(data, album, drawn)?;
    drawn.seconds = start.elapsed().as_secs_f64();
    Ok(out)
}

/// Tables 3.1 and 3.2.
fn kernels(cases: &Path) -> Result<Steinberger> {
    let start = Instant::now();
    let mut out = Steinberger {
        compositions: compositions::measure(),
        ..Steinberger::default()
    };
    let finders: Vec<Finder> = BUDGETS
        .iter()
        .flat_map(|n| Finder::with_budget(*n))
        .chain([Finder::Robust { width: 1e-6 }])
        .collect();
    let times = times(&finders);
    let families = families();
    out.families = families.iter().map(|f| f.title.clone()).collect();
    let hard = hard_cases(cases)?;
    out.hard_cases = hard.len() as u64;
    for (finder, nanoseconds) in finders.iter().zip(times) {
        let mut row = FinderRow {
            name: finder.name().into(),
            budget: finder.budget(),
            nanoseconds,
            judged: families.par_iter().map(|f| judge(finder, f)).collect(),
            ..FinderRow::default()
        };
        for case in &hard {
            match case.verdict(finder) {
                Some(true) => {}
                Some(false) => row.hard += 1,
                None => row.hard_undecided += 1,
            }
        }
        out.finders.push(row);
    }
    out.finders.sort_by_key(|r| {
        let known = PRINTED_3_2.iter().position(|p| p.0 == r.name);
        (known.unwrap_or(PRINTED_3_2.len()), r.budget)
    });
    out.seconds = start.elapsed().as_secs_f64();
    Ok(out)
}

/// Polynomials of one kind and degree, with their certified roots.
struct Family {
    title: String,
    polynomials: Vec<(Vec<f32>, Vec<f64>)>,
}

/// Degree 9, 6, 3 of each kind.
fn families() -> Vec<Family> {
    type Make = fn(&mut Random, usize) -> Vec<f64>;
    let kinds: [(&str, Make); 3] = [
        ("random", |r, degree| (0..=degree).map(|_| r.signed()).collect()),
        ("rays through voxels", compositions::random_ray),
        ("grazing", grazing),
    ];
    let all: Vec<_> = kinds.iter().flat_map(|k| [9, 6, 3].map(|d| (k, d))).collect();
    all.into_par_iter()
        .map(|((title, make), degree)| {
            let mut random = Random(degree as u64);
            let polynomials = (0..COUNT)
                .map(|_| {
                    let b = scaled_to_one(&make(&mut random, degree));
                    let wide: Vec<f64> = b.iter().map(|x| f64::from(*x)).collect();
                    let roots = univariate::bernstein_roots(&wide, 0.0, 1.0).map(|all| all.roots);
                    let roots = roots.unwrap_or_default().iter().map(isobar_oracle::Root::t).collect();
                    (b, roots)
                })
                .collect();
            Family {
                title: format!("{title}, degree {degree}"),
                polynomials,
            }
        })
        .collect()
}

/// Two roots, or a near miss, `10^-1` to `10^-4` apart, times a polynomial without roots.
fn grazing(random: &mut Random, degree: usize) -> Vec<f64> {
    let at = 0.05 + 0.9 * random.unit();
    let apart = 10f64.powf(-1.0 - 3.0 * random.unit());
    let square = if random.unit() < 0.5 { apart * apart } else { -apart * apart };
    let quadratic = [at * at - square, -2.0 * at, 1.0];
    let mut other: Vec<f64> = (0..=degree - 2).map(|_| 0.2 + 0.8 * random.unit()).collect();
    isobar_poly::bernstein::to_power(&mut other);
    let mut product = vec![0.0; degree + 1];
    isobar_poly::scaled::multiply(&quadratic, &other, &mut product);
    isobar_poly::power::to_bernstein(&mut product);
    product
}

/// Scaled by a power of two to a largest coefficient in [1, 2), and rounded.
fn scaled_to_one(b: &[f64]) -> Vec<f32> {
    let most = b.iter().fold(f64::MIN_POSITIVE, |m, x| m.max(x.abs()));
    let scale = f64::from_bits(most.to_bits() & (0x7ff << 52));
    b.iter().map(|x| (x / scale) as f32).collect()
}

fn judge(finder: &Finder, family: &Family) -> Judged {
    let mut out = Judged {
        asked: family.polynomials.len() as u64,
        ..Judged::default()
    };
    let (mut distances, mut squares, mut both) = (Vec::new(), 0.0, 0u64);
    for (b, roots) in &family.polynomials {
        out.with_root += u64::from(!roots.is_empty());
        let t = match (finder.first(b), roots.first()) {
            (Answer::GaveUp, _) => {
                out.gave_up += 1;
                continue;
            }
            (Answer::Touching(_), _) => {
                out.undecided += 1;
                continue;
            }
            (Answer::None, None) => continue,
            (Answer::None, Some(_)) => {
                out.missed += 1;
                continue;
            }
            (Answer::Root(_), None) => {
                out.invented += 1;
                continue;
            }
            (Answer::Root(t), Some(_)) => f64::from(t),
        };
        let error = (t - roots[0]).abs();
        (both, squares, out.max) = (both + 1, squares + error * error, out.max.max(error));
        match which(t, roots) {
            Which::Later => out.later += 1,
            Which::Far => {
                out.far += 1;
                distances.push(error);
            }
            Which::First => distances.push(error),
        }
    }
    distances.sort_by(f64::total_cmp);
    let at = |q: f64| distances.get(((distances.len() as f64 - 1.0) * q).round() as usize).copied();
    out.mse = squares / both.max(1) as f64;
    (out.median, out.p99) = (at(0.5).unwrap_or(0.0), at(0.99).unwrap_or(0.0));
    out
}

#[derive(PartialEq)]
enum Which {
    First,
    Far,
    Later,
}

/// Where an answer belongs. Roots that f32 cannot part count as one.
fn which(t: f64, roots: &[f64]) -> Which {
    let error = (t - roots[0]).abs();
    if roots[1..].iter().any(|r| r - roots[0] > SAME && (t - r).abs() < error) {
        Which::Later
    } else if error <= FAR {
        Which::First
    } else {
        Which::Far
    }
}

/// A polynomial of hardcases A.
struct Hard {
    /// Bernstein coefficients over its domain, largest in [1, 2).
    exact: Vec<f64>,
    narrow: Vec<f32>,
    /// Exact roots, as parts of the domain.
    roots: Vec<f64>,
    everywhere: bool,
}

fn hard_cases(folder: &Path) -> Result<Vec<Hard>> {
    let mut all = Vec::new();
    for c in cases::read_all(folder)? {
        let Problem::Polynomial {
            basis,
            coefficients,
            isovalue,
            domain,
            roots,
            everywhere,
        } = &c.problem
        else {
            continue;
        };
        let domain = domain.unwrap_or([cases::Number::ZERO, cases::Number { n: 1, d: 1 }]);
        let exact = cases::bernstein(*basis, coefficients, *isovalue, domain).with_context(|| format!("case {}", c.id))?;
        let exact: Vec<f64> = exact.iter().map(|x| x.value()).collect();
        let (lo, hi) = (domain[0].value(), domain[1].value());
        all.push(Hard {
            narrow: scaled_to_one(&exact),
            exact,
            roots: roots.iter().map(|r| (r.t - lo) / (hi - lo)).collect(),
            everywhere: *everywhere,
        });
    }
    Ok(all)
}

impl Hard {
    /// Right, wrong, or said that it cannot tell. The robust solver takes the rounding to f32 into account, as in the matrix of hard cases.
    fn verdict(&self, finder: &Finder) -> Option<bool> {
        let robust = || isobar_poly::solvers().iter().find(|s| s.name == "bernstein-f32");
        let answer = match (finder, robust()) {
            (Finder::Robust { .. }, Some(s)) => match (s.first)(&self.exact) {
                First::None => Answer::None,
                First::GaveUp { .. } => Answer::GaveUp,
                First::Root(r) if matches!(r.kind, RootKind::Touching | RootKind::Interval) => Answer::Touching(r.t as f32),
                First::Root(r) => Answer::Root(r.t as f32),
            },
            _ => finder.first(&self.narrow),
        };
        match answer {
            Answer::Touching(_) => None,
            Answer::GaveUp => Some(false),
            Answer::None => Some(self.roots.is_empty() && !self.everywhere),
            // A polynomial that is zero is hit where it begins.
            Answer::Root(t) if self.everywhere => Some(f64::from(t) <= FAR),
            Answer::Root(t) => Some(!self.roots.is_empty() && which(t.into(), &self.roots) == Which::First),
        }
    }
}

/// Least nanoseconds per polynomial, interleaved.
fn times(finders: &[Finder]) -> Vec<f64> {
    const POLYNOMIALS: usize = 500;
    const ROUNDS: usize = 15;
    let mut random = Random(32);
    let polynomials: Vec<[f32; 10]> = (0..POLYNOMIALS)
        .map(|_| std::array::from_fn(|_| random.signed() as f32))
        .collect();
    let powers: Vec<[f32; 10]> = polynomials.iter().map(isobar_octree::finders::power_form).collect();
    let mut least = vec![f64::INFINITY; finders.len()];
    for _ in 0..ROUNDS {
        for (finder, least) in finders.iter().zip(&mut least) {
            let start = Instant::now();
            match finder {
                // In the thesis the composition gives the power form.
                Finder::Sturm { halvings } => {
                    for p in &powers {
                        std::hint::black_box(isobar_octree::finders::sturm(std::hint::black_box(p), *halvings));
                    }
                }
                _ => {
                    for p in &polynomials {
                        std::hint::black_box(finder.first_of(std::hint::black_box(p)));
                    }
                }
            }
            *least = least.min(start.elapsed().as_secs_f64() * 1e9 / POLYNOMIALS as f64);
        }
    }
    least
}

/// Writes the tables as CSV into `folder`.
///
/// # Errors
/// When a file cannot be written.
pub fn write(s: &Steinberger, folder: &Path) -> Result<()> {
    if s.finders.is_empty() {
        return Ok(());
    }
    std::fs::create_dir_all(folder).with_context(|| format!("{} cannot be made", folder.display()))?;
    let open = |name: &str| {
        let path = folder.join(name);
        csv::Writer::from_path(&path).with_context(|| format!("{} cannot be written", path.display()))
    };
    let mut w = open("table-3.1.csv")?;
    for c in &s.compositions {
        w.serialize(c)?;
    }
    w.flush()?;
    let mut w = open("table-3.2.csv")?;
    w.write_record([
        "finder",
        "budget",
        "nanoseconds",
        "family",
        "asked",
        "with_root",
        "wrong",
        "missed",
        "invented",
        "later",
        "far",
        "gave_up",
        "undecided",
        "mse",
        "median",
        "p99",
        "max",
        "hard_wrong",
        "hard_undecided",
        "hard_cases",
    ])?;
    for r in &s.finders {
        for (family, j) in s.families.iter().zip(&r.judged) {
            let budget = r.budget.map_or_else(String::new, |n| n.to_string());
            let mut line = vec![r.name.clone(), budget, format!("{:.1}", r.nanoseconds), family.clone()];
            let counts = [
                j.asked,
                j.with_root,
                j.wrong(),
                j.missed,
                j.invented,
                j.later,
                j.far,
                j.gave_up,
                j.undecided,
            ];
            line.extend(counts.map(|n| n.to_string()));
            line.extend([j.mse, j.median, j.p99, j.max].map(|x| format!("{x:e}")));
            line.extend([r.hard, r.hard_undecided, s.hard_cases].map(|n| n.to_string()));
            w.write_record(line)?;
        }
    }
    w.flush()?;
    if !s.gains.is_empty() {
        let mut w = open("gains.csv")?;
        for r in &s.gains {
            w.serialize(r)?;
        }
        w.flush()?;
    }
    if !s.surfaces.is_empty() {
        let mut w = open("table-6.1.csv")?;
        let mut head = vec!["thesis", "degree", "hits"];
        head.extend(stages::STAGES_6_1);
        w.write_record(head)?;
        for r in &s.surfaces {
            let mut line = vec![r.thesis.to_string(), r.degree.to_string(), r.hits.to_string()];
            line.extend(r.stages.map(|ms| format!("{ms:.4}")));
            w.write_record(line)?;
        }
        w.flush()?;
    }
    if !s.levels.is_empty() {
        let mut w = open("table-6.4.csv")?;
        for r in &s.levels {
            w.serialize(r)?;
        }
        w.flush()?;
    }
    figures::write(&s.figures, folder)
}

#[cfg(test)]
mod tests;
