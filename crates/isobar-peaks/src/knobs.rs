//! The settings of all methods.

use crate::filter::Filter;
use crate::paper::Mode;
use crate::sampling::Law;
use crate::tables::{MOST_PEAKS, Reach};
use isobar_core::{DataKind, KnobKind, KnobSpec, Knobs, MethodInfo, RenderError, ResolvedKnobs};

const RECONSTRUCTION: KnobSpec = KnobSpec {
    name: "reconstruction",
    doc: "the function drawn; bc21: the filter of Mitchell and Netravali with B = 2, C = 1",
    kind: KnobKind::Choice(Filter::NAMES),
};

const MODE: KnobSpec = KnobSpec {
    name: "mode",
    doc: "peaks and medium, either in each segment, or one of the two; isovalues count as peaks",
    kind: KnobKind::Choice(MODES),
};
const MODES: &[&str] = &["default", "peak_xor_dvr", "peak_only", "dvr_only"];

const MACROCELLS: KnobSpec = KnobSpec {
    name: "macrocells",
    doc: "pass empty space in blocks of 4^3 cells",
    kind: KnobKind::Choice(&["on", "off"]),
};

const PACKETS: KnobSpec = KnobSpec {
    name: "packets",
    doc: "cells of a medium, or samples, of a ray eight at a time in vectors; both give the same bits",
    kind: KnobKind::Choice(&["on", "off"]),
};

pub(crate) static EXACT: MethodInfo = MethodInfo {
    id: "peaks/cpu",
    summary: "transfer functions and isovalues: every peak crossing found exactly, the medium between integrated cell by cell",
    paper: "Knoll, Hijazi, Westerteiger, Schott, Hansen, Hagen, Volume ray casting with peak finding and differential sampling, IEEE Vis 2009",
    data: DataKind::GRID,
    hits: true,
    gpu: false,
    work_unit: "cells composed",
    knobs: &[
        RECONSTRUCTION,
        MODE,
        KnobSpec {
            name: "claims",
            doc: "prove hits and misses (EXISTS, FIRST, EMPTY) where there is no medium to be seen",
            kind: KnobKind::Choice(&["on", "off"]),
        },
        MACROCELLS,
        PACKETS,
        KnobSpec {
            name: "tolerance",
            doc: "of the medium: distance of the field from its chords, as a part of its range, and colour error of a stretch",
            kind: KnobKind::Float {
                default: 1.0 / 1024.0,
                min: 1e-7,
                max: 1.0,
            },
        },
    ],
    sweep: ("tolerance", &["0.1", "0.01", "0.001", "0.0001", "0.00001"]),
};

const SAMPLING: KnobSpec = KnobSpec {
    name: "sampling",
    doc: "how steps grow along a ray; printed: by increments that fall short of the closed form",
    kind: KnobKind::Choice(Law::NAMES),
};

const SK: KnobSpec = KnobSpec {
    name: "sk",
    doc: "steps at the image plane, in pixel footprints there",
    kind: KnobKind::Float {
        default: 4.0,
        min: 1e-15,
        max: 1e6,
    },
};

const STEP: KnobSpec = KnobSpec {
    name: "step",
    doc: "uniform steps (and those of lists of rays), in voxels",
    kind: KnobKind::Float {
        default: 1.0,
        min: 1e-15,
        max: 1e6,
    },
};

const PRECISION: KnobSpec = KnobSpec {
    name: "precision",
    doc: "of positions along a ray; single: summed, as on the paper's GPU",
    kind: KnobKind::Choice(&["double", "single"]),
};

const MULTIPLIER: KnobSpec = KnobSpec {
    name: "multiplier",
    doc: "longer steps in macrocells with a small standard deviation",
    kind: KnobKind::Choice(&["off", "on"]),
};

const INTEGRATION: KnobSpec = KnobSpec {
    name: "integration",
    doc: "of the medium on a segment; lum differs from engel only where it is shaded",
    kind: KnobKind::Choice(SCHEMES),
};

const SHADING: KnobSpec = KnobSpec {
    name: "shading",
    doc: "shade the medium by the gradient",
    kind: KnobKind::Choice(&["off", "on"]),
};

const ITERATIONS: KnobSpec = KnobSpec {
    name: "iterations",
    doc: "steps of the secant method",
    kind: KnobKind::Int {
        default: 3,
        min: 1,
        max: 64,
    },
};

const BINS: KnobSpec = KnobSpec {
    name: "bins",
    doc: "of the peak table, per axis",
    kind: KnobKind::Int {
        default: 128,
        min: 2,
        max: 4096,
    },
};

const TABLE: KnobSpec = KnobSpec {
    name: "table",
    doc: "the peak table: all peaks its bins touch, or those between the middles of its bins",
    kind: KnobKind::Choice(&["covering", "printed"]),
};

const PEAKS: KnobSpec = KnobSpec {
    name: "peaks",
    doc: "most peaks in a segment",
    kind: KnobKind::Int {
        default: 4,
        min: 1,
        max: MOST_PEAKS as i64,
    },
};

const PREINTEGRATION: KnobSpec = KnobSpec {
    name: "preintegration",
    doc: "bins of the pre-integration table, per axis",
    kind: KnobKind::Int {
        default: 256,
        min: 2,
        max: 4096,
    },
};

const SCHEMES: &[&str] = &["post", "engel", "lum", "analytic"];

pub(crate) static PAPER: MethodInfo = MethodInfo {
    id: "peaks/cpu-paper",
    summary: "as printed: sampled rays, peaks by the rule of signs and three secant steps; post-classification and pre-integration",
    paper: EXACT.paper,
    data: DataKind::GRID,
    hits: true,
    gpu: false,
    work_unit: "evaluations of the field",
    knobs: &[
        RECONSTRUCTION,
        MODE,
        MACROCELLS,
        PACKETS,
        SAMPLING,
        SK,
        STEP,
        PRECISION,
        MULTIPLIER,
        INTEGRATION,
        SHADING,
        ITERATIONS,
        BINS,
        TABLE,
        PEAKS,
        PREINTEGRATION,
    ],
    sweep: ("sk", &["32", "16", "8", "4", "2", "1", "0.5", "0.25"]),
};

/// `peaks/gpu`.
#[cfg(feature = "gpu")]
pub(crate) static GPU: MethodInfo = MethodInfo {
    id: "peaks/gpu",
    summary: "as printed, in f32 on the GPU: sampled rays, peaks by the rule of signs and three secant steps; comparators",
    paper: EXACT.paper,
    data: DataKind::GRID,
    hits: true,
    gpu: true,
    work_unit: PAPER.work_unit,
    knobs: &[
        RECONSTRUCTION,
        MODE,
        MACROCELLS,
        SAMPLING,
        SK,
        STEP,
        MULTIPLIER,
        KnobSpec {
            kind: KnobKind::Choice(SCHEMES.split_at(3).0),
            ..INTEGRATION
        },
        SHADING,
        ITERATIONS,
        BINS,
        TABLE,
        PEAKS,
        PREINTEGRATION,
    ],
    sweep: PAPER.sweep,
};

/// Which method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Variant {
    Exact,
    Paper,
    #[cfg(feature = "gpu")]
    Gpu,
}

impl Variant {
    pub(crate) const fn info(self) -> &'static MethodInfo {
        match self {
            Self::Exact => &EXACT,
            Self::Paper => &PAPER,
            #[cfg(feature = "gpu")]
            Self::Gpu => &GPU,
        }
    }
}

/// Which pre-integration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scheme {
    Post,
    Table,
    Smooth,
    Analytic,
}

/// What the sampled ray adds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sampled {
    pub(crate) law: Law,
    pub(crate) s_k: f64,
    pub(crate) step: f64,
    pub(crate) single: bool,
    pub(crate) multiplier: bool,
    pub(crate) scheme: Scheme,
    pub(crate) shaded: bool,
    pub(crate) iterations: u32,
    pub(crate) bins: usize,
    pub(crate) reach: Reach,
    pub(crate) peaks: usize,
    pub(crate) segments: usize,
}

/// Settings, resolved.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Settings {
    pub(crate) filter: Filter,
    pub(crate) mode: Mode,
    pub(crate) claims: bool,
    pub(crate) macrocells: bool,
    pub(crate) packets: bool,
    pub(crate) tolerance: f64,
    pub(crate) sampled: Option<Sampled>,
}

impl Settings {
    pub(crate) fn new(variant: Variant, knobs: &Knobs) -> Result<Self, RenderError> {
        let k = ResolvedKnobs::new(variant.info().knobs, knobs)?;
        let place = |name: &str, words: &[&str]| words.iter().position(|w| *w == k.word(name)).unwrap_or(0);
        let modes = [Mode::Both, Mode::Either, Mode::Peaks, Mode::Medium];
        let schemes = [Scheme::Post, Scheme::Table, Scheme::Smooth, Scheme::Analytic];
        let count = |name: &str| k.int(name) as usize;
        Ok(Self {
            filter: k.word("reconstruction").parse()?,
            mode: modes[place("mode", MODES)],
            claims: variant == Variant::Exact && k.word("claims") == "on",
            macrocells: k.word("macrocells") == "on",
            packets: variant.info().knobs.iter().any(|k| k.name == PACKETS.name) && k.word(PACKETS.name) == "on",
            tolerance: if variant == Variant::Exact {
                k.float("tolerance")
            } else {
                0.0
            },
            sampled: (variant != Variant::Exact).then(|| Sampled {
                law: Law::named(k.word("sampling")).unwrap_or(Law::Differential),
                s_k: k.float("sk"),
                step: k.float("step"),
                single: variant == Variant::Paper && k.word("precision") == "single",
                multiplier: k.word("multiplier") == "on",
                scheme: schemes[place("integration", SCHEMES)],
                shaded: k.word("shading") == "on",
                iterations: k.int("iterations") as u32,
                bins: count("bins"),
                reach: if k.word("table") == "printed" {
                    Reach::Printed
                } else {
                    Reach::Covering
                },
                peaks: count("peaks"),
                segments: count("preintegration"),
            }),
        })
    }
}
