//! How a scene is to be drawn: channels, layers, sampling, threads and knobs.

use crate::{Channels, RenderError};
use std::collections::BTreeMap;

/// What a renderer is opened for.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Channels of the frames to come.
    pub channels: Channels,
    /// Hits kept per pixel, front to back, at least 1.
    pub layers: usize,
    /// What a pixel means.
    pub sampling: Sampling,
    /// Worker threads; 0: as many as the machine offers.
    pub threads: usize,
    /// Settings of the method.
    pub knobs: Knobs,
}

impl Default for Request {
    /// First hits with t, normal, surface and colour.
    fn default() -> Self {
        Self {
            channels: Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA,
            layers: 1,
            sampling: Sampling::PixelCentre,
            threads: 0,
            knobs: Knobs::default(),
        }
    }
}

/// What a pixel means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sampling {
    /// The ray through its centre.
    #[default]
    PixelCentre,
    /// The frustum of its square: surfaces that miss the centre are reported as COVERED.
    PixelFrustum,
}

/// A setting.
#[derive(Debug, Clone, PartialEq)]
pub enum KnobValue {
    /// A whole number.
    Int(i64),
    /// A real number.
    Float(f64),
    /// One of a list of words.
    Word(String),
}

impl std::fmt::Display for KnobValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Int(v) => write!(f, "{v}"),
            Self::Float(v) => write!(f, "{v}"),
            Self::Word(v) => f.write_str(v),
        }
    }
}

/// Settings by name; those left out have the method's defaults.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Knobs(pub BTreeMap<String, KnobValue>);

impl Knobs {
    /// Adds `name=value`, the value read as an integer, else a number, else a word.
    pub fn set(&mut self, name: &str, value: &str) {
        let v = value
            .parse()
            .map(KnobValue::Int)
            .or_else(|_| value.parse().map(KnobValue::Float))
            .unwrap_or_else(|_| KnobValue::Word(value.to_owned()));
        self.0.insert(name.to_owned(), v);
    }

    /// As [`Knobs::set`], for building in one expression.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl ToString) -> Self {
        self.set(name, &value.to_string());
        self
    }
}

/// Range and default of a setting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum KnobKind {
    /// A whole number in `[min, max]`.
    Int {
        /// Default.
        default: i64,
        /// Least.
        min: i64,
        /// Greatest.
        max: i64,
    },
    /// A real number in `[min, max]`.
    Float {
        /// Default.
        default: f64,
        /// Least.
        min: f64,
        /// Greatest.
        max: f64,
    },
    /// One of the words; the first is the default.
    Choice(&'static [&'static str]),
}

/// A setting a method has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnobSpec {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it does, with its unit.
    pub doc: &'static str,
    /// Range and default.
    pub kind: KnobKind,
}

/// Settings with defaults filled in and ranges checked.
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvedKnobs(BTreeMap<&'static str, KnobValue>);

impl ResolvedKnobs {
    /// Checks `knobs` against what the method has. `claims=on|off` is common to all methods: one that never claims anything takes it and has
    /// nothing to change.
    ///
    /// # Errors
    /// [`RenderError::Knob`] for a name the method does not have, or a value outside its range.
    pub fn new(specs: &'static [KnobSpec], knobs: &Knobs) -> Result<Self, RenderError> {
        let bad = |name: &str, reason: String| RenderError::Knob {
            name: name.to_owned(),
            reason,
        };
        let common = |n: &str| n == "claims" && ["on", "off"].contains(&knobs.0[n].to_string().as_str());
        let unknown = |n: &&String| specs.iter().all(|s| s.name != n.as_str()) && !common(n);
        if let Some(name) = knobs.0.keys().find(unknown) {
            let names: Vec<_> = specs.iter().map(|s| s.name).collect();
            return Err(bad(
                name,
                format!("this method has no such knob; it has {}", names.join(", ")),
            ));
        }
        let mut out = BTreeMap::new();
        for s in specs {
            let given = knobs.0.get(s.name);
            let value = match (s.kind, given) {
                (KnobKind::Int { default, .. }, None) => KnobValue::Int(default),
                (KnobKind::Float { default, .. }, None) => KnobValue::Float(default),
                (KnobKind::Choice(words), None) => KnobValue::Word(words[0].to_owned()),
                (KnobKind::Int { min, max, .. }, Some(KnobValue::Int(v))) if (min..=max).contains(v) => KnobValue::Int(*v),
                (KnobKind::Float { min, max, .. }, Some(KnobValue::Float(v))) if (min..=max).contains(v) => KnobValue::Float(*v),
                (KnobKind::Float { min, max, .. }, Some(KnobValue::Int(v))) if (min..=max).contains(&(*v as f64)) => {
                    KnobValue::Float(*v as f64)
                }
                (KnobKind::Choice(words), Some(v)) if words.contains(&v.to_string().as_str()) => KnobValue::Word(v.to_string()),
                (KnobKind::Int { min, max, .. }, Some(v)) => {
                    return Err(bad(s.name, format!("{v} is not a whole number from {min} to {max}")));
                }
                (KnobKind::Float { min, max, .. }, Some(v)) => {
                    return Err(bad(s.name, format!("{v} is not a number from {min} to {max}")));
                }
                (KnobKind::Choice(words), Some(v)) => return Err(bad(s.name, format!("{v} is none of {}", words.join(", ")))),
            };
            out.insert(s.name, value);
        }
        Ok(Self(out))
    }

    /// A whole number; `name` is one of the method's own specs.
    ///
    /// # Panics
    /// When the method has no whole-number knob of this name: a mistake in the method.
    #[must_use]
    pub fn int(&self, name: &str) -> i64 {
        match self.0.get(name) {
            Some(KnobValue::Int(v)) => *v,
            other => panic!("{name} is not a whole-number knob of this method: {other:?}"),
        }
    }

    /// A real number.
    ///
    /// # Panics
    /// When the method has no such knob.
    #[must_use]
    pub fn float(&self, name: &str) -> f64 {
        match self.0.get(name) {
            Some(KnobValue::Float(v)) => *v,
            other => panic!("{name} is not a number knob of this method: {other:?}"),
        }
    }

    /// A word.
    ///
    /// # Panics
    /// When the method has no such knob.
    #[must_use]
    pub fn word(&self, name: &str) -> &str {
        match self.0.get(name) {
            Some(KnobValue::Word(v)) => v,
            other => panic!("{name} is not a word knob of this method: {other:?}"),
        }
    }

    /// All settings, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, &KnobValue)> {
        self.0.iter().map(|(k, v)| (*k, v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    static SPECS: &[KnobSpec] = &[
        KnobSpec {
            name: "n",
            doc: "",
            kind: KnobKind::Int {
                default: 3,
                min: 0,
                max: 9,
            },
        },
        KnobSpec {
            name: "step",
            doc: "",
            kind: KnobKind::Float {
                default: 0.5,
                min: 0.1,
                max: 2.0,
            },
        },
        KnobSpec {
            name: "claims",
            doc: "",
            kind: KnobKind::Choice(&["off", "on"]),
        },
    ];

    #[test]
    fn knobs_are_filled_in_and_checked() {
        let r = ResolvedKnobs::new(SPECS, &Knobs::default().with("step", 1)).unwrap();
        assert_eq!((r.int("n"), r.float("step"), r.word("claims")), (3, 1.0, "off"));
        for (k, v) in [
            ("n", "10"),
            ("n", "1.5"),
            ("step", "nan"),
            ("step", "0"),
            ("claims", "maybe"),
            ("other", "1"),
        ] {
            assert!(ResolvedKnobs::new(SPECS, &Knobs::default().with(k, v)).is_err(), "{k}={v}");
        }
    }
}
