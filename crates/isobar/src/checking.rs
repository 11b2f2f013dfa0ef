//! Counts of a check as text, JSON and picture.

use crate::output::{self, ClassColour, Picture};
use crate::settings::{finite, short};
use isobar_core::{Channels, Frame, Knobs, Method, ResolvedKnobs, Surface, TransferFunction};
pub use isobar_oracle::{Check, Class, Difference, Quantiles};
use isobar_oracle::{Colours, Reference, TruthError};
use serde_json::{Value, json};

/// Channels a frame needs for everything a check can say.
pub const CHANNELS: Channels = Channels::T
    .union(Channels::NORMAL)
    .union(Channels::SURFACE)
    .union(Channels::T_ERROR)
    .union(Channels::CLAIM);

/// Ends of the scale of an error map, voxels.
pub const SCALE: (f64, f64) = (1e-6, 1.0);

/// What the colours of an error map mean that are not on its scale.
pub const LEGEND: &str =
    "magenta missed, red false, orange wrong root, cyan wrong surface, black refuted claim, grey undecidable, white no root";

/// Pixels that are wrong: missed, false, wrong root, wrong surface.
#[must_use]
pub fn wrong(c: &Check) -> usize {
    c.missed + c.false_hits + c.wrong_root + c.wrong_surface
}

/// The error map: t error of right hits on a logarithmic scale, other colours as [`LEGEND`] says.
///
/// # Panics
/// When the check has not `width * height` pixels.
#[must_use]
pub fn picture(c: &Check, width: usize, height: usize) -> Picture {
    let colour = |class: Class, refuted: bool| -> Option<ClassColour> {
        match class {
            _ if refuted => Some([0, 0, 0]),
            Class::Missed => Some([255, 0, 255]),
            Class::FalseHit => Some([255, 0, 0]),
            Class::WrongRoot => Some([255, 140, 0]),
            Class::WrongSurface => Some([0, 220, 255]),
            Class::UndecidableAgrees | Class::UndecidableDiffers => Some([150, 150, 150]),
            Class::RightHit | Class::RightMiss => None,
        }
    };
    let classes: Vec<_> = c
        .class
        .iter()
        .zip(&c.refuted_claims)
        .map(|(&class, claims)| colour(class, !claims.is_empty()))
        .collect();
    let errors: Vec<f64> = c.error_voxels.iter().map(|&e| f64::from(e)).collect();
    output::error_picture(width, height, &errors, &classes, SCALE.0, SCALE.1)
}

/// The check without its per-pixel lists: what a table needs.
#[must_use]
pub fn summary(mut c: Check) -> Check {
    c.class = vec![];
    c.error_voxels = vec![];
    c.error_pixels = vec![];
    c.error_deg = vec![];
    c.refuted_claims = vec![];
    c
}

/// Median, 99th percentile and maximum as JSON; null where there are no values.
#[must_use]
pub fn quantiles_json(q: &Quantiles) -> Value {
    json!({"median": finite(q.median), "p99": finite(q.p99), "max": finite(q.max)})
}

/// The counts with the contract's keys.
#[must_use]
pub fn to_json(c: &Check) -> Value {
    json!({
        "pixels": c.pixels,
        "hits": c.hits,
        "missed": c.missed,
        "false": c.false_hits,
        "wrong_root": c.wrong_root,
        "wrong_surface": c.wrong_surface,
        "refuted": c.refuted,
        "undecidable": c.undecidable,
        "undecidable_differs": c.undecidable_differs,
        "unclaimed": c.unclaimed,
        "t_error_voxels": quantiles_json(&c.t_error_voxels),
        "t_error_pixels": quantiles_json(&c.t_error_pixels),
        "normal_error_deg": quantiles_json(&c.normal_error_deg),
        "stage": {"f64": c.stage.f64, "dd": c.stage.dd, "exact": c.stage.exact},
    })
}

/// The counts as lines.
#[must_use]
pub fn to_text(c: &Check) -> String {
    let rows = [
        ("pixels", c.pixels, ""),
        ("hits", c.hits, ""),
        ("missed", c.missed, "no hit where there is a root"),
        ("false", c.false_hits, "hit farther than half a voxel from every root"),
        ("wrong root", c.wrong_root, "hit at a later root"),
        ("wrong surface", c.wrong_surface, "first root, other surface"),
        ("refuted", c.refuted, "claims proved wrong"),
        (
            "undecidable",
            c.undecidable,
            "f32-sized errors could change the answer; counted apart",
        ),
        ("unclaimed", c.unclaimed, "neither a first root nor a miss is claimed"),
    ];
    let mut out: String = rows
        .iter()
        .map(|(name, count, note)| format!("{}\n", format!("{name:<14} {count:>10}  {note}").trim_end()))
        .collect();
    let quantiles = |q: &Quantiles| {
        if q.max.is_nan() {
            "no values".to_owned()
        } else {
            format!("median {}  p99 {}  max {}", short(q.median), short(q.p99), short(q.max))
        }
    };
    for (name, q) in [
        ("t error, voxels", &c.t_error_voxels),
        ("t error, pixels", &c.t_error_pixels),
        ("normal, degrees", &c.normal_error_deg),
    ] {
        out.push_str(&format!("{name:<16} {}\n", quantiles(q)));
    }
    out.push_str(&format!(
        "decided by       f64 {}  double-double {}  exact {}\n",
        c.stage.f64, c.stage.dd, c.stage.exact
    ));
    out
}

/// The surfaces that hits are held against: those given, then for peaks/* the maxima of the transfer function's density, ascending; none at all in its mode
/// `dvr_only`, which draws the medium alone.
#[must_use]
pub fn judged(method: &dyn Method, knobs: &Knobs, surfaces: &[Surface], medium: Option<&TransferFunction>) -> Vec<Surface> {
    let given = || surfaces.iter().copied();
    match mode(method, knobs).as_deref() {
        None => given().collect(),
        Some("dvr_only") => Vec::new(),
        Some(_) => {
            let peaks = medium.map(TransferFunction::peaks).unwrap_or_default();
            given().chain(peaks.iter().map(|p| p.surface())).collect()
        }
    }
}

/// The exact image of a method that draws the maxima of a transfer function as surfaces; `None` where it draws the transfer function as given: then there is
/// only the integral.
#[must_use]
pub fn peaks_reference(method: &dyn Method, knobs: &Knobs) -> Option<Reference> {
    match mode(method, knobs)?.as_str() {
        "dvr_only" => None,
        "peak_only" => Some(Reference::PeaksAlone),
        _ => Some(Reference::Peaks),
    }
}

/// The knob `mode` of the family peaks/*, which says what of a transfer function is drawn as surfaces; other methods draw none of it so.
fn mode(method: &dyn Method, knobs: &Knobs) -> Option<String> {
    let info = method.info();
    let all = ResolvedKnobs::new(info.knobs, knobs)
        .ok()
        .filter(|_| info.id.starts_with("peaks/"))?;
    Some(all.word("mode").to_owned())
}

/// Colours of a frame against the exact ones: the emission-absorption integral of the transfer function as given, and for methods that draw
/// its peaks as surfaces the integral with these between.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourCheck {
    /// Against the integral.
    pub integral: Difference,
    /// Against peaks and the integral between.
    pub peaks: Option<Difference>,
    /// Of the two exact images: the bias of drawing peaks, no method's error.
    pub bias: Option<Difference>,
    /// Proved bound of the error of the exact colours, shading apart.
    pub bound: f64,
}

impl ColourCheck {
    /// Holds a frame against the exact colours: the integral, and what [`peaks_reference`] says, with whether that is peaks alone (which has no bias to tell).
    ///
    /// # Errors
    /// Where the frame has no colour, or the sizes differ.
    pub fn of(frame: &Frame, integral: &Colours, peaks: Option<(Reference, &Colours)>) -> Result<Self, TruthError> {
        let (reference, peaks) = peaks.unzip();
        let bounds = peaks.into_iter().chain([integral]).map(Colours::greatest_error);
        Ok(Self {
            bound: bounds.fold(0.0, f64::max),
            integral: integral.difference(frame)?,
            peaks: peaks.map(|p| p.difference(frame)).transpose()?,
            bias: (peaks.filter(|_| reference == Some(Reference::Peaks)))
                .map(|p| p.bias(integral))
                .transpose()?,
        })
    }

    fn rows(&self) -> impl Iterator<Item = (&'static str, &Difference)> {
        let rows = [
            ("integral", Some(&self.integral)),
            ("peaks", self.peaks.as_ref()),
            ("bias", self.bias.as_ref()),
        ];
        rows.into_iter().filter_map(|(name, d)| Some((name, d?)))
    }

    /// The differences by name, and the bound of the exact colours; a ratio of equal images (infinite) is null.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let mut out = json!({"error_bound": finite(self.bound)});
        for (name, d) in self.rows() {
            out[name] = json!({
                "max": finite(d.max), "p99": finite(d.p99), "mean": finite(d.mean), "visible": d.visible,
                "psnr_db": finite(d.psnr), "ssim": finite(d.ssim),
            });
        }
        out
    }

    /// The differences as lines.
    #[must_use]
    pub fn to_text(&self) -> String {
        let line = |(name, d): (&str, &Difference)| {
            format!(
                "{:<16} max {}  p99 {}  visible {}  PSNR {} dB  SSIM {}\n",
                format!("colour, {name}"),
                short(d.max),
                short(d.p99),
                d.visible,
                short(d.psnr),
                short(d.ssim)
            )
        };
        let rows: String = self.rows().map(line).collect();
        format!("{rows}exact colours are off by at most {}\n", short(self.bound))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::Claim;

    fn check(class: &[Class], errors: &[f32]) -> Check {
        let mut c = Check::join([]);
        c.pixels = class.len();
        c.class = class.to_vec();
        c.error_voxels = errors.to_vec();
        c.refuted_claims = vec![Claim::empty(); class.len()];
        Check::join([Check {
            error_pixels: vec![f32::NAN; class.len()],
            error_deg: vec![f32::NAN; class.len()],
            ..c
        }])
    }

    #[test]
    fn the_json_has_the_contracts_keys_and_no_nan() {
        let c = check(
            &[Class::Missed, Class::RightHit, Class::WrongRoot],
            &[f32::NAN, 0.25, f32::NAN],
        );
        let j = to_json(&c);
        for key in [
            "pixels",
            "hits",
            "missed",
            "false",
            "wrong_root",
            "wrong_surface",
            "refuted",
            "undecidable",
            "unclaimed",
        ] {
            assert!(j[key].is_u64(), "{key}");
        }
        assert_eq!(j["t_error_voxels"], json!({"median": 0.25, "p99": 0.25, "max": 0.25}));
        assert_eq!(j["normal_error_deg"]["max"], Value::Null);
        assert_eq!((wrong(&c), &j["missed"]), (2, &json!(1)));
        assert!(to_text(&c).contains("wrong root"));
    }

    #[test]
    fn wrong_pixels_stand_out_of_the_map() {
        let c = check(
            &[Class::Missed, Class::RightHit, Class::RightMiss, Class::RightHit],
            &[f32::NAN, 1e-9, f32::NAN, 2.0],
        );
        let p = picture(&c, 4, 1);
        let at = |x| p.get_pixel(x, 0).0;
        assert_eq!((at(0), at(2)), ([255, 0, 255], [255; 3]));
        assert_eq!((at(1), at(3)), (output::heat_colour(0.0), output::heat_colour(1.0)));
        assert!(summary(c).class.is_empty());
    }
}
