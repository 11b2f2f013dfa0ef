//! Named analytic fields, and the data made from them: `synthetic:NAME[,n=64][,as=grid|algebraic|tets|hexes][,key=value...]`.

use crate::surfaces::SURFACES;
use crate::transcendental::{AnalyticFunction, Formula};
use crate::{AlgebraicFunction, grid_to_hexes, grid_to_tets};
use glam::{DMat3, DVec3};
use isobar_core::{Algebraic, Data, DataError, Function, Grid, Samples, Structure};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::str::FromStr;
use std::sync::Arc;

/// An analytic field and the isovalue of its surface.
#[derive(Debug, Clone)]
pub struct Field {
    /// The function on `[-L, L]^3`; its structure says whether it is a polynomial.
    pub function: Arc<dyn Function>,
    /// The isovalue its surface is known by.
    pub isovalue: f64,
}

/// The fields that are no polynomials, with L, isovalue and the names of their parameters.
const TRANSCENDENTAL: [(&str, f64, f64, &[&str]); 3] = [
    ("marschner-lobb", 1.0, 0.5, &["fm", "alpha"]),
    ("gyroid", 1.0, 0.2, &[]),
    ("chmutov", 1.25, 0.0, &[]),
];

fn unknown<T>(message: String) -> Result<T, DataError> {
    Err(DataError::Unknown(message))
}

/// The field `name` on `[-L, L]^3`.
///
/// `params`: `L` (half the edge of the domain, positive) for every field; `fm` (0 to 1000, default 6) and `alpha` (0 to 1000, default 1/4)
/// for `marschner-lobb`. Formulas, bounds and rounding of coefficients: [`Synthetic::NAMES`] and the readme.
///
/// # Errors
/// [`DataError::Unknown`] for a name or parameter that does not exist (the message lists those that do) and for a value out of range.
pub fn analytic(name: &str, params: &BTreeMap<String, f64>) -> Result<Field, DataError> {
    let surface = SURFACES.iter().find(|s| s.name == name);
    let other = TRANSCENDENTAL.iter().find(|f| f.0 == name);
    let (half, isovalue, known): (f64, f64, &[&str]) = match (surface, other) {
        (Some(s), _) => (s.half, s.isovalue, &[]),
        (None, Some(&(_, half, isovalue, known))) => (half, isovalue, known),
        (None, None) => {
            return unknown(format!(
                "there is no synthetic field \"{name}\"; use one of {}",
                Synthetic::NAMES.join(", ")
            ));
        }
    };
    if let Some(key) = params.keys().find(|k| *k != "L" && !known.contains(&k.as_str())) {
        let list = std::iter::once("L")
            .chain(known.iter().copied())
            .collect::<Vec<_>>()
            .join(", ");
        return unknown(format!("synthetic field {name} has no parameter \"{key}\"; it has {list}"));
    }
    let get = |key: &str, default: f64, ok: fn(f64) -> bool, range: &str| match params.get(key) {
        Some(&v) if !ok(v) => unknown(format!("{key}={v} is out of range for synthetic field {name}; give {range}")),
        v => Ok(v.copied().unwrap_or(default)),
    };
    let half = get("L", half, |v| (1e-6..=1e6).contains(&v), "1e-6 to 1e6")?;
    let function: Arc<dyn Function> = match surface {
        Some(s) => Arc::new(AlgebraicFunction::new(Algebraic {
            name: name.into(),
            terms: s.terms().into(),
            lo: DVec3::splat(-half),
            hi: DVec3::splat(half),
        })?),
        None => {
            let formula = match name {
                "gyroid" => Formula::Gyroid,
                "chmutov" => Formula::Chmutov,
                _ => Formula::MarschnerLobb {
                    fm: get("fm", 6.0, |v| (0.0..=1000.0).contains(&v), "0 to 1000")?,
                    alpha: get("alpha", 0.25, |v| (0.0..=1000.0).contains(&v), "0 to 1000")?,
                },
            };
            Arc::new(AnalyticFunction::new(formula, half))
        }
    };
    Ok(Field { function, isovalue })
}

/// The form data are made in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Grid,
    Algebraic,
    Tets,
    Hexes,
}

/// Names of [`Form`], in order.
const FORMS: [(&str, Form); 4] = [
    ("grid", Form::Grid),
    ("algebraic", Form::Algebraic),
    ("tets", Form::Tets),
    ("hexes", Form::Hexes),
];

/// A parsed `NAME[,n=64][,as=grid|algebraic|tets|hexes][,key=value...]`: a field and the form its data shall have.
///
/// Parsing makes the field and checks everything but memory; [`Synthetic::data`] samples it.
#[derive(Debug, Clone)]
pub struct Synthetic {
    name: String,
    field: Field,
    n: usize,
    form: Form,
}

impl Synthetic {
    /// The fields by name, with L and isovalue:
    ///
    /// | name | field | L | isovalue |
    /// |---|---|---|---|
    /// | `marschner-lobb` | Marschner and Lobb 1994, f_M = `fm` = 6, `alpha` = 1/4; between 0 and 1, slope at most pi/(4(1+alpha)) along z, alpha pi^2 fm/(2(1+alpha)) across | 1 | 0.5 |
    /// | `gyroid` | sin6x cos6y + sin6y cos6z + sin6z cos6x; within 1.5, partial derivatives within 6 sqrt 2 | 1 | 0.2 |
    /// | `sphere` | x^2+y^2+z^2 | 1.25 | 1 |
    /// | `torus` | (x^2+y^2+z^2+15/16)^2 - 4(x^2+y^2) | 1.5 | 0 |
    /// | `teardrop` | x^5/2 + x^4/2 - y^2 - z^2 | 1.25 | 0 |
    /// | `chmutov` | x^16+y^16+z^16 - cos7x - cos7y - cos7z; partial derivatives within 16 L^15 + 7 | 1.25 | 0 |
    /// | `banchoff-chmutov` | T4(x)+T4(y)+T4(z)+1 | 1.25 | 0 |
    /// | `tangle` | x^4-5x^2+y^4-5y^2+z^4-5z^2+11.8 (11.8 rounded to f64) | 3 | 0 |
    /// | `barth-sextic` | 4(phi^2x^2-y^2)(phi^2y^2-z^2)(phi^2z^2-x^2) - (1+2phi)(x^2+y^2+z^2-1)^2, expanded in `Z[phi]`, each coefficient rounded to f64 once | 2 | 0 |
    /// | `steinberger-a` | x+y+z+xyz-1 | 2 | 0 |
    /// | `steinberger-b` | 4x^2+4y^2+4z^2+16xyz-1+x^2y^2z^2 | 2 | 0 |
    /// | `steinberger-c` | x^2+y^2+z^2-x^3y^3z^3-x^2y-1 | 2 | 0 |
    /// | `cayley` | 4(x^2+y^2+z^2)+16xyz-1 | 2 | 0 |
    /// | `clebsch` | 81 sum x^3 - 189 sum x^2y + 54xyz + 126 sum xy - 9 sum x^2 - 9 sum x + 1 | 2 | 0 |
    /// | `steiner` | x^2y^2+y^2z^2+z^2x^2-xyz | 2 | 0 |
    /// | `whitney` | x^2-y^2z | 2 | 0 |
    /// | `kiss` | x^2+y^2-(1-z)z^4 | 2 | 0 |
    /// | `kummer` | (x^2+y^2+z^2-1.3)^2 - 29/17 ((1-z)^2-2x^2)((1+z)^2-2y^2), each coefficient rounded to f64 once | 2 | 0 |
    /// | `mitchell` | 4(x^4+(y^2+z^2)^2)+17x^2(y^2+z^2)-20(x^2+y^2+z^2)+17 | 2.5 | 0 |
    ///
    /// All but `marschner-lobb`, `gyroid` and `chmutov` are polynomials. Where a coefficient is rounded, the surface is that of the rounded
    /// polynomial: its nodes move or open by some 1e-16 relative to the coefficients.
    pub const NAMES: &'static [&'static str] = &[
        "marschner-lobb",
        "gyroid",
        "sphere",
        "torus",
        "teardrop",
        "chmutov",
        "banchoff-chmutov",
        "tangle",
        "barth-sextic",
        "steinberger-a",
        "steinberger-b",
        "steinberger-c",
        "cayley",
        "clebsch",
        "steiner",
        "whitney",
        "kiss",
        "kummer",
        "mitchell",
    ];

    /// Samples along each axis lie in this range for `as=grid`.
    pub const SIZES: std::ops::RangeInclusive<usize> = 2..=1024;
    /// ... for `as=tets`.
    pub const TET_SIZES: std::ops::RangeInclusive<usize> = 2..=256;
    /// ... for `as=hexes`.
    pub const HEX_SIZES: std::ops::RangeInclusive<usize> = 2..=128;

    /// The field's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The field, before any sampling.
    #[must_use]
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// Makes the data, on all threads.
    ///
    /// `grid`: the field in f64 at n^3 points, ends included (sample (i,j,k) at `Grid::domain().world((i,j,k))`, spacing 2L/(n-1), origin
    /// -L), rounded to f32, x fastest. `tets`, `hexes`: that grid through [`grid_to_tets`] and [`grid_to_hexes`]. `algebraic`: the polynomial.
    ///
    /// # Errors
    /// [`DataError::Unknown`] where samples overflow f32.
    pub fn data(&self) -> Result<Data, DataError> {
        if self.form == Form::Algebraic {
            return match self.field.function.structure() {
                Structure::Polynomial(p) => Ok(Data::Algebraic(p.clone())),
                _ => not_polynomial(&self.name),
            };
        }
        let grid = self.grid()?;
        match self.form {
            Form::Tets => grid_to_tets(&grid).map(Data::Tets),
            Form::Hexes => grid_to_hexes(&grid).map(Data::Hexes),
            Form::Grid | Form::Algebraic => Ok(Data::Grid(grid)),
        }
    }

    fn grid(&self) -> Result<Grid, DataError> {
        let n = self.n;
        let half = self.field.function.domain().hi.x;
        let spacing = DVec3::splat(2.0 * half / (n - 1) as f64);
        let origin = DVec3::splat(-half);
        let mut samples = vec![0.0f32; n * n * n];
        samples.par_chunks_mut(n).enumerate().for_each(|(row, out)| {
            // The same sums as Domain::world of an axis-aligned grid makes.
            let at = |i: usize| origin.x + spacing.x * i as f64;
            let (y, z) = (at(row % n), at(row / n));
            for (i, s) in out.iter_mut().enumerate() {
                *s = self.field.function.value(DVec3::new(at(i), y, z)) as f32;
            }
        });
        if !samples.par_chunks(1 << 16).all(|c| c.iter().all(|v| v.is_finite())) {
            return unknown(format!(
                "samples of synthetic field {} overflow f32; give a smaller L",
                self.name
            ));
        }
        Grid::new([n; 3], spacing, origin, DMat3::IDENTITY, Samples::F32(samples.into()))
    }
}

fn not_polynomial<T>(name: &str) -> Result<T, DataError> {
    unknown(format!(
        "synthetic field {name} is no polynomial, so as=algebraic cannot be; use as=grid, tets or hexes"
    ))
}

impl FromStr for Synthetic {
    type Err = DataError;

    /// # Errors
    /// [`DataError::Unknown`], saying which part cannot be and what can.
    fn from_str(s: &str) -> Result<Self, DataError> {
        let mut parts = s.split(',').map(str::trim);
        let name = parts.next().unwrap_or_default();
        let (mut n, mut form) = (None, None);
        let mut params = BTreeMap::new();
        for part in parts {
            let Some((key, value)) = part.split_once('=') else {
                return unknown(format!(
                    "\"{part}\" in synthetic:{s} is not key=value; write synthetic:NAME,n=64,as=grid,key=value"
                ));
            };
            let twice = match key {
                "n" => {
                    let bad = || {
                        DataError::Unknown(format!(
                            "n={value} in synthetic:{s} is not a number of samples; give 2 to 1024"
                        ))
                    };
                    n.replace(value.parse::<usize>().map_err(|_| bad())?).is_some()
                }
                "as" => {
                    let found = FORMS.iter().find(|f| f.0 == value).map(|f| f.1);
                    let bad = || {
                        DataError::Unknown(format!(
                            "as={value} in synthetic:{s} is unknown; use grid, algebraic, tets or hexes"
                        ))
                    };
                    form.replace(found.ok_or_else(bad)?).is_some()
                }
                _ => {
                    let v = value.parse::<f64>().ok().filter(|v| v.is_finite());
                    let bad = || DataError::Unknown(format!("{key}={value} in synthetic:{s} is not a finite number"));
                    params.insert(key.to_string(), v.ok_or_else(bad)?).is_some()
                }
            };
            if twice {
                return unknown(format!("{key} is given twice in synthetic:{s}"));
            }
        }
        let field = analytic(name, &params)?;
        let form = form.unwrap_or(Form::Grid);
        let n = n.unwrap_or(64);
        let (sizes, what) = match form {
            Form::Grid | Form::Algebraic => (Self::SIZES, "grid"),
            Form::Tets => (Self::TET_SIZES, "tets"),
            Form::Hexes => (Self::HEX_SIZES, "hexes"),
        };
        if !sizes.contains(&n) {
            return unknown(format!(
                "n={n} in synthetic:{s} is out of range; as={what} takes {} to {}",
                sizes.start(),
                sizes.end()
            ));
        }
        if form == Form::Algebraic && !matches!(field.function.structure(), Structure::Polynomial(_)) {
            return not_polynomial(name);
        }
        Ok(Self {
            name: name.into(),
            field,
            n,
            form,
        })
    }
}
