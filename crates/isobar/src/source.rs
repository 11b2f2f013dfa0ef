//! DATA of the command line: a file, or `synthetic:NAME[,key=value...]`.

use crate::histogram::Histogram;
use anyhow::{Context, Result, anyhow, ensure};
use glam::DVec3;
use isobar_core::{Data, Samples};
use isobar_fields::{Field, Synthetic};
use isobar_io::Options;
use sha2::{Digest, Sha256};
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// What begins the name of synthetic data.
pub const SYNTHETIC: &str = "synthetic:";

/// Opened data.
#[derive(Debug)]
pub struct Source {
    /// As given: a path or `synthetic:...`.
    pub name: String,
    /// The data, one scalar field.
    pub data: Arc<Data>,
    /// The analytic field behind synthetic data, with its usual isovalue.
    pub truth: Option<Field>,
    /// Name of the field read.
    pub field: String,
    /// Fields the file has.
    pub fields: Vec<String>,
    /// Warnings worth a line each.
    pub notes: Vec<String>,
    /// Values of a mesh or of elements that are NaN or infinite, as counted in the file.
    not_finite: usize,
    hash: OnceLock<String>,
}

/// Opens DATA. NaN or infinite samples are kept unless `options.nan` replaces them: see [`Source::require_finite`].
///
/// # Errors
/// When the file cannot be used, or the synthetic name or a key is not known; one line that names it.
pub fn open(spec: &str, options: &Options) -> Result<Source> {
    let source = |data: Data, truth, field, fields, notes| Source {
        name: spec.to_owned(),
        data: Arc::new(data),
        truth,
        field,
        fields,
        notes,
        not_finite: 0,
        hash: OnceLock::new(),
    };
    if let Some(text) = spec.strip_prefix(SYNTHETIC) {
        // The contract writes the parameter as its paper does.
        let synthetic: Synthetic = text
            .replace(",f_M=", ",fm=")
            .parse()
            .with_context(|| format!("DATA {spec}"))?;
        ensure!(
            options.field.is_none(),
            "--field {}: synthetic data have one field; leave the flag out",
            options.field.as_deref().unwrap_or_default()
        );
        let data = synthetic.data().with_context(|| format!("DATA {spec}"))?;
        let field = synthetic.field().clone();
        let name = field.function.name();
        let sized = text.split(',').any(|part| part.trim().starts_with("n="));
        let notes = match &data {
            Data::Algebraic(_) if sized => vec![format!("n= changes nothing of {spec}: as=algebraic is the polynomial itself")],
            _ => Vec::new(),
        };
        return Ok(source(data, Some(field), name.clone(), vec![name], notes));
    }
    let (path, options) = file(spec, options)?;
    let loaded = isobar_io::load(Path::new(path), &options).map_err(|e| anyhow!("{e}"))?;
    Ok(Source {
        not_finite: loaded.not_finite,
        ..source(loaded.data, None, loaded.field, loaded.fields, loaded.notes)
    })
}

/// The file that DATA names; `None` for synthetic data.
#[must_use]
pub fn path(spec: &str) -> Option<&Path> {
    let named = || file(spec, &Options::default()).map_or(spec, |(path, _)| path);
    (!spec.starts_with(SYNTHETIC)).then(|| Path::new(named()))
}

/// The path of `FILE[,as=hexes]` and how it is read. A file of that very name is taken as it is.
fn file<'a>(spec: &'a str, options: &Options) -> Result<(&'a str, Options)> {
    let mut options = options.clone();
    let asked = spec.rsplit_once(",as=").filter(|_| !Path::new(spec).exists());
    let Some((path, form)) = asked else {
        return Ok((spec, options));
    };
    ensure!(
        form == "hexes",
        "DATA {spec}: as={form} is not known of files; write as=hexes for elements, or leave it out"
    );
    options.as_hexes = true;
    Ok((path, options))
}

impl Source {
    /// World bounds `(min, max)`.
    #[must_use]
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.data.bounds()
    }

    /// Checks that all values are finite: what drawing needs.
    ///
    /// # Errors
    /// When some are not; the text names the data and `--nan`.
    pub fn require_finite(&self) -> Result<()> {
        if let Data::Grid(g) = &*self.data {
            g.require_finite().with_context(|| format!("DATA {}", self.name))?;
        }
        ensure!(
            self.not_finite == 0,
            "DATA {}: {} values are NaN or infinite; read them as a number with --nan C",
            self.name,
            self.not_finite
        );
        Ok(())
    }

    /// SHA-256 of kind, geometry and samples, hexadecimal; worked out once, when first asked for.
    #[must_use]
    pub fn hash(&self) -> &str {
        self.hash.get_or_init(|| hash(&self.data))
    }

    /// Number type of the samples, such as `u8`.
    #[must_use]
    pub fn type_name(&self) -> &'static str {
        match &*self.data {
            Data::Grid(g) => g.samples.type_name(),
            Data::Tets(_) => "f32",
            _ => "f64",
        }
    }

    /// Samples per axis of a grid.
    #[must_use]
    pub fn dims(&self) -> Option<[usize; 3]> {
        match &*self.data {
            Data::Grid(g) => Some(g.dims),
            _ => None,
        }
    }

    /// Cells: of the lattice, of the mesh; 0 for a polynomial.
    #[must_use]
    pub fn cells(&self) -> usize {
        match &*self.data {
            Data::Grid(g) => g.dims.iter().map(|n| n - 1).product(),
            Data::Tets(m) => m.cells.len(),
            Data::Hexes(h) => h.elements.len(),
            _ => 0,
        }
    }

    /// Range, count of NaN or infinite values, and histogram.
    #[must_use]
    pub fn summary(&self) -> Summary {
        match &*self.data {
            Data::Grid(g) => summary(
                |f| (0..g.samples.len()).for_each(|i| f(g.samples.get(i))),
                !matches!(g.samples, Samples::F32(_)),
            ),
            Data::Tets(m) => summary(|f| m.values.iter().for_each(|&v| f(f64::from(v))), false),
            Data::Hexes(h) => Summary {
                nan: self.not_finite,
                ..summary(|f| h.elements.iter().flat_map(|e| e.values.iter()).for_each(|&v| f(v)), false)
            },
            Data::Algebraic(a) => {
                let n = 33usize;
                let at = |i: usize| i as f64 / (n - 1) as f64;
                let corner = |i: usize| a.lo + (a.hi - a.lo) * DVec3::new(at(i % n), at(i / n % n), at(i / (n * n)));
                summary(|f| (0..n * n * n).for_each(|i| f(a.value(corner(i)))), false)
            }
            _ => summary(|_| (), false),
        }
    }
}

/// What the values are like.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Values looked at. Those of hexes are control coefficients; a polynomial is sampled at 33^3 points.
    pub count: usize,
    /// NaN or infinite ones; of hexes those of the file, each of which may be in many coefficients.
    pub nan: usize,
    /// Least and greatest finite value.
    pub range: Option<(f64, f64)>,
    /// Histogram of the finite values.
    pub histogram: Option<Histogram>,
}

fn summary(visit: impl Fn(&mut dyn FnMut(f64)), integer: bool) -> Summary {
    let (mut count, mut nan, mut range) = (0, 0, None::<(f64, f64)>);
    visit(&mut |v| {
        count += 1;
        if v.is_finite() {
            range = Some(range.map_or((v, v), |(lo, hi)| (lo.min(v), hi.max(v))));
        } else {
            nan += 1;
        }
    });
    let histogram = range.map(|r| {
        let mut h = Histogram::new(std::iter::empty(), r, integer);
        visit(&mut |v| h.add(v));
        h
    });
    Summary {
        count,
        nan,
        range,
        histogram,
    }
}

/// Isovalues worth a try: the usual one of synthetic data first, then those of [`Histogram::suggest`], each once.
#[must_use]
pub fn suggested_isovalues(source: &Source, summary: &Summary) -> Vec<f64> {
    let mut out: Vec<f64> = source.truth.iter().map(|f| f.isovalue).collect();
    for v in summary.histogram.iter().flat_map(Histogram::suggest) {
        if !out.contains(&v) {
            out.push(v);
        }
    }
    out
}

fn hash(data: &Data) -> String {
    let mut h = Sha256::new();
    h.update(data.kind());
    let numbers = |h: &mut Sha256, v: &[f64]| v.iter().for_each(|x| h.update(x.to_bits().to_le_bytes()));
    let counts = |h: &mut Sha256, v: &[usize]| v.iter().for_each(|&x| h.update((x as u64).to_le_bytes()));
    match data {
        Data::Grid(g) => {
            counts(&mut h, &g.dims);
            let d = g.domain();
            numbers(&mut h, &d.origin.to_array());
            numbers(&mut h, &d.axes.to_cols_array());
            h.update(g.samples.type_name());
            h.update(bytes_of(&g.samples));
        }
        Data::Tets(m) => {
            counts(&mut h, &[m.points.len(), m.cells.len()]);
            m.points.iter().for_each(|p| numbers(&mut h, &p.to_array()));
            h.update(bytemuck::cast_slice(&m.cells));
            h.update(bytemuck::cast_slice(&m.values));
        }
        Data::Hexes(p) => {
            for e in p.elements.iter() {
                h.update(e.degree);
                h.update(e.value_degree);
                h.update([u8::from(e.rational_value)]);
                e.points.iter().for_each(|p| numbers(&mut h, p));
                numbers(&mut h, &e.values);
            }
        }
        Data::Algebraic(a) => {
            numbers(&mut h, &[a.lo.to_array(), a.hi.to_array()].concat());
            for (e, k) in a.terms.iter() {
                h.update(e);
                numbers(&mut h, &[*k]);
            }
        }
        other => h.update(format!("{other:?}")),
    }
    hexadecimal(&h.finalize())
}

fn bytes_of(samples: &Samples) -> &[u8] {
    match samples {
        Samples::U8(s) => s,
        Samples::I16(s) => bytemuck::cast_slice(s),
        Samples::U16(s) => bytemuck::cast_slice(s),
        Samples::F32(s) => bytemuck::cast_slice(s),
    }
}

/// Bytes as lower-case hexadecimal digits.
#[must_use]
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(spec: &str) -> Result<Source> {
        super::open(spec, &Options::default())
    }

    #[test]
    fn synthetic_data_know_their_field() {
        let s = open("synthetic:sphere,n=16").unwrap();
        assert_eq!((s.data.kind(), s.dims(), s.cells()), ("grid", Some([16; 3]), 3375));
        assert_eq!(suggested_isovalues(&s, &s.summary())[0], 1.0);
        assert!(s.require_finite().is_ok());
    }

    #[test]
    fn files_are_read_as_elements_where_asked() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.vtk");
        std::fs::write(
            &path,
            "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 2 2\nORIGIN 0 0 0\nSPACING 1 1 1\n\
             POINT_DATA 12\nSCALARS s float 1\nLOOKUP_TABLE default\n0 1 2 3 4 5 6 7 8 9 10 11\n",
        )
        .unwrap();
        let name = path.display();
        assert_eq!(open(&format!("{name}")).unwrap().data.kind(), "grid");
        let s = open(&format!("{name},as=hexes")).unwrap();
        assert_eq!((s.data.kind(), s.cells(), s.summary().range), ("hexes", 2, Some((0.0, 11.0))));
        let e = open(&format!("{name},as=tets")).unwrap_err().to_string();
        assert!(e.contains("as=tets") && e.contains("as=hexes"), "{e}");
    }

    #[test]
    fn keys_are_the_contracts_and_unused_ones_are_told() {
        let a = open("synthetic:marschner-lobb,n=8,f_M=3").unwrap();
        assert_eq!(a.hash(), open("synthetic:marschner-lobb,n=8,fm=3").unwrap().hash());
        assert_ne!(a.hash(), open("synthetic:marschner-lobb,n=8").unwrap().hash());
        assert!(open("synthetic:sphere,as=algebraic,n=8").unwrap().notes[0].contains("n="));
        assert!(open("synthetic:sphere,as=algebraic").unwrap().notes.is_empty());
        assert_eq!(
            (path("synthetic:sphere"), path("a.vtk,as=hexes")),
            (None, Some(Path::new("a.vtk")))
        );
    }

    #[test]
    fn the_hash_tells_data_apart() {
        let a = open("synthetic:sphere,n=8").unwrap();
        let b = open("synthetic:sphere,n=9").unwrap();
        assert_eq!(a.hash(), open("synthetic:sphere,n=8").unwrap().hash());
        assert_ne!(a.hash(), b.hash());
        assert_eq!(a.hash().len(), 64);
    }

    #[test]
    fn unknown_data_are_one_line() {
        for spec in [
            "synthetic:",
            "synthetic:nothing",
            "synthetic:sphere,n=0",
            "synthetic:sphere,n=abc",
            "no/such/file.nrrd",
        ] {
            let e = format!("{:#}", open(spec).unwrap_err());
            assert!(
                !e.contains('\n') && e.contains(spec.trim_start_matches(SYNTHETIC)),
                "{spec}: {e}"
            );
        }
    }
}
