//! Trivariate NURBS volumes: `nurbs-volume/1` JSON, G+Smo XML and GeoPDEs text, cut into rational Bezier elements at their knots.
//!
//! Fields: those of the file (JSON: `field`), then the coordinates `x`, `y`, `z` of the geometry, which are all that G+Smo and GeoPDEs files have.

use crate::error::{Cause, quoted};
use crate::field::no_field;
use crate::input::Input;
use crate::{Loaded, Options};
use isobar_core::{Data, HexPatches};
use isobar_fields::NurbsPatch;
use quick_xml::events::Event;
use quick_xml::reader::Reader;
use serde::Deserialize;
use std::io::Read;

/// Larger texts are refused: parsed, they take several times their size.
const MOST_TEXT: u64 = 1 << 30;

/// The whole file as text.
pub(crate) fn text(input: &dyn Input, format: &'static str) -> Result<String, Cause> {
    if input.len() > MOST_TEXT {
        return Err(Cause::Unsupported {
            format,
            what: format!("{} bytes of text", input.len()),
            remedy: "write several smaller files",
        });
    }
    let mut bytes = Vec::new();
    input
        .open(0)?
        .take(MOST_TEXT)
        .read_to_end(&mut bytes)
        .map_err(|e| Cause::system("read", &e))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// A patch without its scalar, and the scalar where the file has one.
pub(crate) struct Volume {
    /// With coefficients still empty.
    pub(crate) patch: NurbsPatch,
    /// One per control point.
    pub(crate) field: Option<Vec<f64>>,
}

/// Elements of the volumes with the field asked for.
pub(crate) fn loaded(volumes: Vec<Volume>, name: &str, format: &'static str, o: &Options) -> Result<Loaded, Cause> {
    if volumes.is_empty() {
        return Err(Cause::malformed(format, "there are no patches"));
    }
    let mut fields: Vec<String> = ["x", "y", "z"].map(String::from).into();
    if volumes.iter().all(|v| v.field.is_some()) {
        fields.insert(0, name.into());
    }
    let field = o.field.clone().unwrap_or_else(|| fields[0].clone());
    if !fields.contains(&field) {
        return Err(no_field(&field, fields.iter().map(String::as_str)));
    }
    let axis = ["x", "y", "z"].iter().position(|a| *a == field);
    let mut elements = Vec::new();
    for v in volumes {
        let values = match (axis, v.field) {
            (Some(a), _) => v.patch.points.iter().map(|p| p[a]).collect(),
            (None, own) => own.unwrap_or_default(),
        };
        elements.extend(NurbsPatch { values, ..v.patch }.elements()?);
    }
    Ok(Loaded {
        data: Data::Hexes(HexPatches::new(elements)?),
        field,
        fields,
        notes: Vec::new(),
        not_finite: 0,
    })
}

#[derive(Deserialize)]
struct JsonVolume {
    format: String,
    patches: Vec<JsonPatch>,
}

#[derive(Deserialize)]
struct JsonPatch {
    degree: [usize; 3],
    n: [usize; 3],
    knots: [Vec<f64>; 3],
    control_points: Vec<[f64; 4]>,
    #[serde(default)]
    field: Option<Vec<f64>>,
}

/// Reads a `nurbs-volume/1` file.
pub(crate) fn read_json(input: &dyn Input, o: &Options) -> Result<Loaded, Cause> {
    const FORMAT: &str = "NURBS volume (JSON)";
    let text = text(input, FORMAT)?;
    let file: JsonVolume = serde_json::from_str(&text).map_err(|e| Cause::malformed(FORMAT, e.to_string()))?;
    if file.format != "nurbs-volume/1" {
        return Err(Cause::malformed(
            FORMAT,
            format!("format {} is not \"nurbs-volume/1\"", quoted(&file.format)),
        ));
    }
    let mut volumes = Vec::new();
    for p in file.patches {
        let counts: [usize; 3] = std::array::from_fn(|a| p.knots[a].len().saturating_sub(p.degree[a].saturating_add(1)));
        if counts != p.n {
            return Err(Cause::malformed(
                FORMAT,
                format!("n is {:?} but the knots of degree {:?} give {counts:?}", p.n, p.degree),
            ));
        }
        volumes.push(Volume {
            patch: NurbsPatch {
                degree: p.degree,
                knots: p.knots,
                points: p.control_points,
                values: Vec::new(),
            },
            field: p.field,
        });
    }
    loaded(volumes, "field", FORMAT, o)
}

/// Numbers between white space.
fn numbers(text: &str, format: &'static str) -> Result<Vec<f64>, Cause> {
    text.split_whitespace()
        .map(|w| {
            w.parse()
                .map_err(|_| Cause::malformed(format, format!("{} is not a number", quoted(w))))
        })
        .collect()
}

/// What one `<Geometry>` of a G+Smo file has said so far.
#[derive(Default)]
struct Geometry {
    /// Degree and knots, in the order of the axes.
    knots: Vec<(usize, Vec<f64>)>,
    weights: Option<Vec<f64>>,
    dimension: usize,
    coefficients: Vec<f64>,
}

/// Reads the volumes of a G+Smo file; other geometries in it are passed over.
pub(crate) fn read_gismo(input: &dyn Input, o: &Options) -> Result<Loaded, Cause> {
    const FORMAT: &str = "G+Smo XML";
    let bad = |what: String| Cause::malformed(FORMAT, what);
    let text = text(input, FORMAT)?;
    let mut reader = Reader::from_str(&text);
    let (mut volumes, mut passed) = (Vec::new(), 0);
    let mut own: Option<Geometry> = None;
    // The element whose text comes next, with its attribute `degree` or `geoDim`.
    let mut inside: Option<(String, usize)> = None;
    loop {
        match reader.read_event().map_err(|e| bad(format!("its XML is broken: {e}")))? {
            Event::Start(tag) => {
                let attribute = |name: &str| -> Result<Option<String>, Cause> {
                    tag.try_get_attribute(name)
                        .map_err(|e| bad(format!("its XML is broken: {e}")))
                        .map(|a| a.map(|a| a.value.as_ref().to_owned()))
                };
                let name = tag.name().as_ref().to_owned();
                match name.as_str() {
                    "Geometry" => {
                        let kind = attribute("type")?.unwrap_or_default();
                        if matches!(kind.as_str(), "TensorNurbs3" | "TensorBSpline3") {
                            own = Some(Geometry::default());
                        } else {
                            passed += 1;
                        }
                    }
                    "KnotVector" | "coefs" | "weights" => {
                        let count = attribute(if name == "coefs" { "geoDim" } else { "degree" })?;
                        let count = count.map_or(Ok(0), |c| c.trim().parse());
                        inside = Some((name, count.map_err(|_| bad("an attribute is not a count".into()))?));
                    }
                    _ => {}
                }
            }
            Event::Text(t) => {
                if let (Some(g), Some((name, count))) = (&mut own, &inside) {
                    let all = numbers(&t, FORMAT)?;
                    match name.as_str() {
                        "KnotVector" => g.knots.push((*count, all)),
                        "weights" => g.weights = Some(all),
                        _ => (g.dimension, g.coefficients) = (*count, all),
                    }
                }
            }
            Event::End(tag) => {
                inside = None;
                if tag.name().as_ref() == "Geometry"
                    && let Some(g) = own.take()
                {
                    volumes.push(g.volume()?);
                }
            }
            Event::Eof => break,
            _ => {}
        }
    }
    if volumes.is_empty() {
        return Err(bad(format!("it has no trivariate patch (of other kinds: {passed})")));
    }
    loaded(volumes, "field", FORMAT, o)
}

impl Geometry {
    fn volume(self) -> Result<Volume, Cause> {
        let bad = |what: String| Cause::malformed("G+Smo XML", what);
        let [(du, u), (dv, v), (dw, w)] =
            <[_; 3]>::try_from(self.knots).map_err(|k| bad(format!("{} knot vectors of a volume", k.len())))?;
        if self.dimension != 3 || !self.coefficients.len().is_multiple_of(3) {
            return Err(bad(format!("{} coefs of geoDim {}", self.coefficients.len(), self.dimension)));
        }
        let points = self.coefficients.as_chunks::<3>().0;
        let weights = self.weights.unwrap_or_else(|| vec![1.0; points.len()]);
        if weights.len() != points.len() {
            return Err(bad(format!("{} weights of {} control points", weights.len(), points.len())));
        }
        Ok(Volume {
            patch: NurbsPatch {
                degree: [du, dv, dw],
                knots: [u, v, w],
                points: points.iter().zip(weights).map(|(p, w)| [p[0], p[1], p[2], w]).collect(),
                values: Vec::new(),
            },
            field: None,
        })
    }
}

/// Reads the patches of a GeoPDEs file (version 2.1); what it says of interfaces and boundaries is passed over.
pub(crate) fn read_geopdes(input: &dyn Input, o: &Options) -> Result<Loaded, Cause> {
    const FORMAT: &str = "GeoPDEs text";
    let bad = |what: String| Cause::malformed(FORMAT, what);
    let text = text(input, FORMAT)?;
    let lines = text.lines().filter(|l| !l.trim_start().starts_with('#'));
    let mut words = lines.flat_map(str::split_whitespace);
    let mut next = |what: &str| words.next().ok_or_else(|| bad(format!("it ends where {what} should be")));
    let count = |w: &str| w.parse::<usize>().map_err(|_| bad(format!("{} is not a count", quoted(w))));
    let (dim, in_space) = (count(next("the dimension")?)?, count(next("the dimension")?)?);
    if (dim, in_space) != (3, 3) {
        return Err(Cause::Unsupported {
            format: FORMAT,
            what: format!("dimension {dim} in {in_space}"),
            remedy: "give a volume",
        });
    }
    let patches = count(next("the number of patches")?)?;
    let mut volumes = Vec::new();
    for p in 0..patches {
        while next("PATCH")? != "PATCH" {}
        next("the number of the patch")?;
        let mut three = || -> Result<[usize; 3], Cause> {
            Ok([count(next("a count")?)?, count(next("a count")?)?, count(next("a count")?)?])
        };
        let (degree, n) = (three()?, three()?);
        // Every number takes a character and a space: sizes beyond that are lies.
        let total = n.iter().try_fold(1usize, |t, &c| t.checked_mul(c));
        let total = total
            .filter(|&t| t > 0 && t <= text.len())
            .ok_or_else(|| bad(format!("patch {p} has {n:?} points")))?;
        let mut row = |count: usize| -> Result<Vec<f64>, Cause> {
            (0..count)
                .map(|_| {
                    let w = next("a number")?;
                    w.parse().map_err(|_| bad(format!("{} is not a number", quoted(w))))
                })
                .collect()
        };
        let mut knots: [Vec<f64>; 3] = Default::default();
        for a in 0..3 {
            let size = n[a]
                .checked_add(degree[a])
                .and_then(|s| s.checked_add(1))
                .filter(|&s| s <= text.len());
            knots[a] = row(size.ok_or_else(|| bad(format!("patch {p} has degree {degree:?}")))?)?;
        }
        let [x, y, z, w] = [row(total)?, row(total)?, row(total)?, row(total)?];
        volumes.push(Volume {
            patch: NurbsPatch {
                degree,
                knots,
                points: (0..total).map(|i| [x[i] / w[i], y[i] / w[i], z[i] / w[i], w[i]]).collect(),
                values: Vec::new(),
            },
            field: None,
        });
    }
    loaded(volumes, "field", FORMAT, o)
}
