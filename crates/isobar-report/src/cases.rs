//! Hard cases: small inputs with exact answers, as data. `bench-data/definitions/hard/cases/*.toml`, read by the report and by the tests.

use crate::definitions::toml_files;
use anyhow::{Context, Result, bail};
use isobar_core::{Algebraic, DMat3, DVec3, Data, Function, Grid, Ray, Samples};
use isobar_fields::{AlgebraicFunction, Synthetic};
use serde::Deserialize;
use std::path::Path;
use std::sync::Arc;

/// An exact rational number: from a whole number, a fraction such as `"-567/1562500"`, or a decimal (taken as the decimal that is written).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "Written")]
pub struct Number {
    /// Numerator.
    pub n: i128,
    /// Denominator, above 0; no common factor.
    pub d: i128,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Written {
    Int(i64),
    Float(f64),
    Fraction(String),
}

impl Number {
    /// Zero.
    pub const ZERO: Self = Self { n: 0, d: 1 };

    /// n / d in lowest terms; `None` where d is 0.
    #[must_use]
    pub fn new(n: i128, d: i128) -> Option<Self> {
        let (mut a, mut b) = (n.unsigned_abs(), d.unsigned_abs());
        while b != 0 {
            (a, b) = (b, a % b);
        }
        let common = i128::try_from(a).ok()?;
        (d != 0).then(|| Self {
            n: n / common * d.signum(),
            d: d.abs() / common,
        })
    }

    /// The nearest f64 (to an ulp where numerator or denominator exceed 2^53).
    #[must_use]
    pub fn value(self) -> f64 {
        self.n as f64 / self.d as f64
    }

    /// Sum; `None` on overflow.
    #[must_use]
    pub fn plus(self, o: Self) -> Option<Self> {
        let cross = self.n.checked_mul(o.d)?.checked_add(o.n.checked_mul(self.d)?)?;
        Self::new(cross, self.d.checked_mul(o.d)?)
    }

    /// Product; `None` on overflow.
    #[must_use]
    pub fn times(self, o: Self) -> Option<Self> {
        Self::new(self.n.checked_mul(o.n)?, self.d.checked_mul(o.d)?)
    }

    /// A decimal, exactly as written: `-1.25e-18`.
    fn decimal(s: &str) -> Option<Self> {
        let (mantissa, exponent) = match s.split_once(['e', 'E']) {
            Some((m, e)) => (m, e.parse::<i32>().ok()?),
            None => (s, 0),
        };
        let (whole, part) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        let digits = format!("{whole}{part}").parse::<i128>().ok()?;
        let power = exponent - i32::try_from(part.len()).ok()?;
        let ten = 10i128.checked_pow(power.unsigned_abs())?;
        if power < 0 {
            Self::new(digits, ten)
        } else {
            Self::new(digits.checked_mul(ten)?, 1)
        }
    }
}

impl TryFrom<Written> for Number {
    type Error = String;

    fn try_from(w: Written) -> Result<Self, String> {
        let found = match &w {
            Written::Int(i) => Self::new(i128::from(*i), 1),
            // The shortest decimal that reads as this f64 is the one that was written, up to trailing zeros.
            Written::Float(f) => Self::decimal(&format!("{f:?}")),
            Written::Fraction(s) => {
                let (p, q) = s.split_once('/').unwrap_or((s, "1"));
                p.trim()
                    .parse()
                    .ok()
                    .zip(q.trim().parse().ok())
                    .and_then(|(p, q)| Self::new(p, q))
            }
        };
        found.ok_or_else(|| match w {
            Written::Int(i) => format!("{i} is out of range"),
            Written::Float(f) => format!("{f:?} is out of range"),
            Written::Fraction(s) => format!("{s} is neither a number nor a fraction"),
        })
    }
}

/// A root.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseRoot {
    /// Position: of the polynomial's variable, or along the ray in units of its direction.
    pub t: f64,
    /// Multiplicity.
    pub m: u32,
}

/// A ray and its exact answer.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseRay {
    /// World origin.
    pub origin: [Number; 3],
    /// World direction, any length but 0.
    pub direction: [Number; 3],
    /// All roots, ascending; none: the ray misses.
    #[serde(default)]
    pub roots: Vec<CaseRoot>,
    /// A stretch on which s = c, in place of roots.
    #[serde(default)]
    pub interval: Option<[f64; 2]>,
}

impl CaseRay {
    /// The ray.
    #[must_use]
    pub fn ray(&self) -> Ray {
        let v = |a: &[Number; 3]| DVec3::new(a[0].value(), a[1].value(), a[2].value());
        Ray {
            origin: v(&self.origin),
            direction: v(&self.direction),
        }
    }

    /// Where the first hit is: the first root or the start of the interval.
    #[must_use]
    pub fn first(&self) -> Option<f64> {
        self.interval.map(|i| i[0]).or_else(|| self.roots.first().map(|r| r.t))
    }
}

/// What the case is about.
#[expect(clippy::large_enum_variant, reason = "a hundred cases, read once")]
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Problem {
    /// A univariate polynomial.
    Polynomial {
        /// `power` (ascending) or `bernstein` (over the domain).
        basis: Basis,
        /// Its coefficients.
        coefficients: Vec<Number>,
        /// Taken from every value (subtracted from the constant term, or from every Bernstein coefficient).
        #[serde(default)]
        isovalue: Option<Number>,
        /// Where roots are asked for; [0, 1] where it is not given. Bernstein coefficients refer to [0, 1].
        #[serde(default)]
        domain: Option<[Number; 2]>,
        /// All roots in the closed domain, ascending.
        #[serde(default)]
        roots: Vec<CaseRoot>,
        /// The polynomial is zero everywhere.
        #[serde(default)]
        everywhere: bool,
    },
    /// Samples on a unit lattice.
    Grid {
        /// Samples per axis.
        dims: [usize; 3],
        /// World position of the first sample; 0 where it is not given.
        #[serde(default)]
        origin: Option<[Number; 3]>,
        /// World distance of the samples; 1 where it is not given.
        #[serde(default)]
        spacing: Option<[Number; 3]>,
        /// The samples, x fastest.
        #[serde(default)]
        values: Vec<Number>,
        /// In place of `values`: a polynomial of world coordinates in units of the spacing, `[a, b, c, k]` meaning k x^a y^b z^c.
        #[serde(default)]
        terms: Vec<[f64; 4]>,
        /// The isovalue.
        isovalue: Number,
        /// Reconstructions that the answers are exact for.
        reconstructions: Vec<String>,
        /// Angle between the normals at the first hits of the first two rays, degrees.
        #[serde(default)]
        turn: Option<f64>,
        /// Rays.
        ray: Vec<CaseRay>,
    },
    /// A named field of the command line, or a polynomial.
    Field {
        /// Its name.
        #[serde(default)]
        data: Option<String>,
        /// In place of `data`: `[a, b, c, k]` meaning k x^a y^b z^c.
        #[serde(default)]
        terms: Vec<[f64; 4]>,
        /// Of a polynomial: half the edge of its box about 0.
        #[serde(default)]
        half: Option<f64>,
        /// Samples per axis for methods that draw grids.
        n: usize,
        /// The isovalue.
        isovalue: Number,
        /// Rays, with the exact answers of the field.
        ray: Vec<CaseRay>,
    },
    /// Random rays through a closed surface, from outside, both ways.
    RandomRays {
        /// Name of the field.
        data: String,
        /// Samples per axis for methods that draw grids.
        n: usize,
        /// The isovalue.
        isovalue: Number,
        /// How many rays, each taken both ways.
        rays: usize,
        /// Seed.
        seed: u64,
    },
    /// No scene that a method could draw: where it is tested instead.
    Elsewhere {
        /// Why no method can be asked.
        why: String,
        /// `path of the file: name of the test`.
        tests: Vec<String>,
    },
}

/// Form of a polynomial.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Basis {
    /// Ascending powers of t.
    Power,
    /// Bernstein over [0, 1].
    Bernstein,
}

/// A failure that is known and explained. When the case starts to pass, the declaration is an error.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Known {
    /// Columns: ids of methods or names of root finders, or the beginning of one followed by `*`.
    pub method: Vec<String>,
    /// Why.
    pub reason: String,
}

/// One case.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Case {
    /// Id, such as `A5`.
    pub id: String,
    /// Title.
    pub title: String,
    /// What goes wrong.
    pub trap: String,
    /// Where it comes from.
    pub source: String,
    /// Distance at which a root is right, in units of t.
    pub tolerance: f64,
    /// The input and the exact answer.
    #[serde(flatten)]
    pub problem: Problem,
    /// Known failures.
    #[serde(default)]
    pub known: Vec<Known>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    case: Vec<Case>,
}

/// All cases of a folder, file by file.
///
/// # Errors
/// When a file cannot be read or holds something else; one line that names it.
pub fn read_all(folder: &Path) -> Result<Vec<Case>> {
    let mut all: Vec<Case> = Vec::new();
    for path in toml_files(folder)? {
        let text = std::fs::read_to_string(&path).with_context(|| format!("{} cannot be read", path.display()))?;
        let file: File = toml::from_str(&text).with_context(|| format!("{} holds no cases", path.display()))?;
        for c in file.case {
            if all.iter().any(|o| o.id == c.id) {
                bail!("{}: there are two cases {}", path.display(), c.id);
            }
            all.push(c);
        }
    }
    Ok(all)
}

/// Exact Bernstein coefficients, over the domain, of a polynomial less its isovalue.
///
/// # Errors
/// When the numbers are too long for 127 bits, or Bernstein coefficients are given with a domain other than [0, 1].
pub fn bernstein(basis: Basis, coefficients: &[Number], isovalue: Option<Number>, domain: [Number; 2]) -> Result<Vec<Number>> {
    let minus = |x: Number| Number { n: -x.n, d: x.d };
    let shift = minus(isovalue.unwrap_or(Number::ZERO));
    let work = || -> Option<Vec<Number>> {
        if basis == Basis::Bernstein {
            return coefficients.iter().map(|c| c.plus(shift)).collect();
        }
        let width = domain[1].plus(minus(domain[0]))?;
        let n = coefficients.len().checked_sub(1)?;
        // p(lo + width u): Horner's scheme on polynomials in u.
        let mut power = vec![Number::ZERO; n + 1];
        for c in coefficients.iter().rev() {
            for i in (0..=n).rev() {
                let low = power[i].times(domain[0])?;
                power[i] = if i > 0 { low.plus(power[i - 1].times(width)?)? } else { low };
            }
            power[0] = power[0].plus(*c)?;
        }
        power[0] = power[0].plus(shift)?;
        let binomial = |n: usize, k: usize| (0..k).fold(1i128, |b, i| b * (n - i) as i128 / (i + 1) as i128);
        (0..=n)
            .map(|j| {
                (0..=j).try_fold(Number::ZERO, |s, i| {
                    s.plus(power[i].times(Number::new(binomial(j, i), binomial(n, i))?)?)
                })
            })
            .collect()
    };
    let unit = domain == [Number::ZERO, Number { n: 1, d: 1 }];
    if basis == Basis::Bernstein && !unit {
        bail!("Bernstein coefficients refer to [0, 1]: leave the domain out");
    }
    work().context("the coefficients are too long")
}

/// The grid of a grid case, samples as f32 (they are whole numbers below 2^24, so exact).
///
/// # Errors
/// When the problem is no grid, the counts disagree or a sample is not exact.
pub fn grid(problem: &Problem) -> Result<Grid> {
    let Problem::Grid {
        dims,
        origin,
        spacing,
        values,
        terms,
        ..
    } = problem
    else {
        bail!("is no grid");
    };
    let vector = |v: &[Number; 3]| DVec3::new(v[0].value(), v[1].value(), v[2].value());
    let one = Number { n: 1, d: 1 };
    let (dims, spacing, origin) = (*dims, spacing.unwrap_or([one; 3]), origin.unwrap_or([Number::ZERO; 3]));
    let all: Vec<f64> = if terms.is_empty() {
        values.iter().map(|v| v.value()).collect()
    } else {
        let units = |a: usize| origin[a].times(Number::new(spacing[a].d, spacing[a].n)?);
        let mut first = [0.0; 3];
        for (a, f) in first.iter_mut().enumerate() {
            *f = units(a).context("the spacing is 0 or too long a fraction")?.value();
        }
        let at = |i: usize, a: usize| first[a] + i as f64;
        let value = |i: usize, j: usize, k: usize| -> f64 {
            (terms.iter())
                .map(|[a, b, c, f]| f * at(i, 0).powf(*a) * at(j, 1).powf(*b) * at(k, 2).powf(*c))
                .sum()
        };
        let [nx, ny, nz] = dims;
        (0..nx * ny * nz).map(|n| value(n % nx, n / nx % ny, n / nx / ny)).collect()
    };
    if let Some(v) = all.iter().find(|v| f64::from(**v as f32) != **v) {
        bail!("sample {v} is not exact in f32");
    }
    let samples: Vec<f32> = all.iter().map(|v| *v as f32).collect();
    Ok(Grid::new(
        dims,
        vector(&spacing),
        vector(&origin),
        DMat3::IDENTITY,
        Samples::F32(samples.into()),
    )?)
}

/// The field of a field case: its function, and its samples on n^3 points of its box, ends included.
#[derive(Debug)]
pub struct FieldData {
    /// The exact function.
    pub function: Arc<dyn Function>,
    /// Of a named field.
    name: Option<String>,
}

impl FieldData {
    /// A named field, or a polynomial on [-half, half]^3.
    ///
    /// # Errors
    /// When there is no such field, or neither or both are given.
    pub fn new(name: Option<&str>, terms: &[[f64; 4]], half: Option<f64>) -> Result<Self> {
        match (name, half) {
            (Some(name), None) if terms.is_empty() => Ok(Self {
                function: name.parse::<Synthetic>()?.field().function.clone(),
                name: Some(name.to_owned()),
            }),
            (None, Some(half)) if !terms.is_empty() => {
                let power = |x: f64| (x.fract() == 0.0 && (0.0..256.0).contains(&x)).then_some(x as u8);
                let term = |[a, b, c, k]: &[f64; 4]| Some(([power(*a)?, power(*b)?, power(*c)?], *k));
                let polynomial = Algebraic {
                    name: "polynomial".into(),
                    terms: terms
                        .iter()
                        .map(term)
                        .collect::<Option<_>>()
                        .context("exponents are whole numbers")?,
                    lo: DVec3::splat(-half),
                    hi: DVec3::splat(half),
                };
                Ok(Self {
                    function: Arc::new(AlgebraicFunction::new(polynomial)?),
                    name: None,
                })
            }
            _ => bail!("give either data, or terms and half"),
        }
    }

    /// The samples on n^3 points.
    ///
    /// # Errors
    /// When the grid cannot be made.
    pub fn grid(&self, n: usize) -> Result<Grid> {
        if let Some(name) = &self.name {
            let Data::Grid(g) = format!("{name},n={n}").parse::<Synthetic>()?.data()? else {
                bail!("the samples of a field are no grid");
            };
            return Ok(g);
        }
        let half = self.function.domain().hi.x;
        let at = |i: usize| -half + 2.0 * half * i as f64 / (n - 1) as f64;
        let value = |i: usize| self.function.value(DVec3::new(at(i % n), at(i / n % n), at(i / n / n))) as f32;
        let samples: Vec<f32> = (0..n * n * n).map(value).collect();
        Ok(Grid::new(
            [n; 3],
            DVec3::splat(2.0 * half / (n - 1) as f64),
            DVec3::splat(-half),
            DMat3::IDENTITY,
            Samples::F32(samples.into()),
        )?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_cases_read_and_their_grids_are_exact() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bench-data/definitions/hard/cases");
        let all = read_all(&folder).unwrap();
        let mut kinds = [0; 5];
        for c in &all {
            let kind = match &c.problem {
                Problem::Polynomial { coefficients, .. } => {
                    assert!(!coefficients.is_empty());
                    0
                }
                Problem::Grid { ray, turn, .. } => {
                    grid(&c.problem).unwrap_or_else(|e| panic!("{}: {e}", c.id));
                    assert!(ray.len() > usize::from(turn.is_some()), "{}", c.id);
                    1
                }
                Problem::Field {
                    data, terms, half, ray, ..
                } => {
                    FieldData::new(data.as_deref(), terms, *half).unwrap_or_else(|e| panic!("{}: {e}", c.id));
                    assert!(!ray.is_empty());
                    2
                }
                Problem::RandomRays { rays, .. } => {
                    assert!(*rays >= 10_000, "{}", c.id);
                    3
                }
                Problem::Elsewhere { why, tests } => {
                    assert!(!why.is_empty() && !tests.is_empty(), "{}", c.id);
                    4
                }
            };
            kinds[kind] += 1;
        }
        assert!(
            kinds[0] >= 17 && kinds[1] >= 19 && kinds[2] >= 20 && kinds[3] >= 2 && kinds[4] >= 2,
            "{kinds:?}"
        );
    }

    /// The exact answers of the polynomials, against the polynomials themselves: a sign change or a zero within the tolerance of each root.
    #[test]
    fn the_exact_answers_are_roots() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bench-data/definitions/hard/cases");
        for c in read_all(&folder).unwrap() {
            let Problem::Polynomial {
                basis: Basis::Power,
                coefficients,
                roots,
                ..
            } = &c.problem
            else {
                continue;
            };
            let p = |t: f64| coefficients.iter().rev().fold(0.0, |s, k| s * t + k.value());
            for r in roots {
                // Near a root of multiplicity m the value is of the order of the m-th power of the distance.
                let scale = coefficients
                    .iter()
                    .enumerate()
                    .map(|(i, k)| (k.value() * r.t.powi(i as i32)).abs())
                    .sum::<f64>();
                let h = 1e-6 * r.t.abs().max(1e-3);
                let noise = 1e-14 * scale;
                let changes = p(r.t - h).signum() != p(r.t + h).signum();
                assert!(
                    changes || p(r.t).abs() <= noise || r.m.is_multiple_of(2) && p(r.t).abs() <= 1e-12 * scale,
                    "{} at {}",
                    c.id,
                    r.t
                );
            }
        }
    }

    #[test]
    fn numbers_are_exact() {
        type Map = std::collections::BTreeMap<String, Vec<Number>>;
        let v = toml::from_str::<Map>("a = [1, 0.5, \"-2/6\", 1e-18, -1.25]").unwrap()["a"].clone();
        let want = [(1, 1), (1, 2), (-1, 3), (1, 10i128.pow(18)), (-5, 4)];
        assert_eq!(v.iter().map(|x| (x.n, x.d)).collect::<Vec<_>>(), want);
        assert!(toml::from_str::<Map>("a = [\"1/0\"]").is_err());
        assert!(toml::from_str::<Map>("a = [nan]").is_err());
        let third = Number::new(1, 3).unwrap();
        assert_eq!(
            third.plus(third).and_then(|x| x.times(Number::new(3, 2).unwrap())),
            Number::new(1, 1)
        );
    }

    #[test]
    fn bernstein_coefficients_are_exact() {
        let whole = |v: &[i128]| v.iter().map(|n| Number::new(*n, 1).unwrap()).collect::<Vec<_>>();
        // (t - 2)(t - 4) = 8 - 6t + t^2 on [2, 4]: values 0 and 0 at the ends, minimum -1 in the middle
        let b = bernstein(
            Basis::Power,
            &whole(&[8, -6, 1]),
            None,
            [Number::new(2, 1).unwrap(), Number::new(4, 1).unwrap()],
        )
        .unwrap();
        assert_eq!(b, whole(&[0, -2, 0]));
        let b = bernstein(
            Basis::Bernstein,
            &whole(&[1, 2]),
            Number::new(1, 1),
            [Number::ZERO, Number::new(1, 1).unwrap()],
        )
        .unwrap();
        assert_eq!(b, whole(&[0, 1]));
    }
}
