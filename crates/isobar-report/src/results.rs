//! What a run found, as plain structs: stored between definitions so that a run resumes, and all that the page and the tables are made of.

use serde::{Deserialize, Serialize};

/// A whole run.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Report {
    /// The command that made it, as typed.
    pub command: String,
    /// When it ended, UTC, `YYYY-MM-DD hh:mm`.
    pub date: String,
    /// Revision of the sources, where git says one.
    pub revision: String,
    /// Lines of machine.txt.
    pub machine: Vec<(String, String)>,
    /// Minutes of measuring.
    pub minutes: f64,
    /// The definitions, in the order of the page.
    pub scenes: Vec<Scene>,
    /// Error against sampling for each reconstruction.
    pub convergence: Vec<Convergence>,
    /// The hard cases.
    pub hard: Matrix,
    /// Tables and figures of Steinberger's thesis.
    pub steinberger: crate::steinberger::Steinberger,
    /// Criterion's estimates.
    pub benches: Vec<Bench>,
    /// Methods that could not start, with the reason.
    pub absent: Vec<(String, String)>,
}

impl Report {
    /// Everything that is not as a definition or a case says, a line each. A run with any is a failed one.
    #[must_use]
    pub fn trouble(&self) -> Vec<String> {
        let mut lines = Vec::new();
        for s in &self.scenes {
            for c in &s.comparisons {
                lines.extend(c.failures.iter().map(|f| format!("{}, {}: {f}", s.title, c.reconstruction)));
            }
        }
        lines.extend(self.steinberger.figures.trouble());
        for t in &self.hard.tables {
            for r in &t.rows {
                for (column, v) in t.columns.iter().zip(&r.cells) {
                    if matches!(v.kind, VerdictKind::Wrong | VerdictKind::Unexpected) {
                        lines.push(format!("hard case {}, {column}: {} ({})", r.id, v.kind.word(), v.given));
                    }
                }
            }
        }
        lines
    }
}

/// One definition.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// Name of the definition.
    pub id: String,
    /// Its folder.
    pub group: String,
    /// Its title.
    pub title: String,
    /// What it shows and what came out.
    pub analysis: String,
    /// Data, in words: kind, size, type.
    pub data: String,
    /// SHA-256 of the data.
    pub data_hash: String,
    /// Isovalues.
    pub isovalues: Vec<f64>,
    /// Transfer function of the medium.
    pub medium: Option<String>,
    /// The view, in words.
    pub view: String,
    /// Width and height.
    pub size: [usize; 2],
    /// Why there are no numbers.
    pub skipped: Option<String>,
    /// One comparison per reconstruction.
    pub comparisons: Vec<Comparison>,
    /// Seconds it took.
    pub seconds: f64,
}

/// All methods on one reconstruction of one scene: they draw the same function and have the same truth.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// The reconstruction.
    pub reconstruction: String,
    /// What the oracle certified.
    pub truth: Truth,
    /// Settings measured, method by method.
    pub rows: Vec<Row>,
    /// The time models.
    pub models: Vec<Model>,
    /// Pictures at the default settings.
    pub pictures: Vec<Pictures>,
    /// Seconds of one thread in each stage of a frame of `octree/cpu` (`isobar_octree::stages::Laps`); `None` where it was not asked or its frame has a wrong pixel.
    pub stages: Option<[f64; 6]>,
    /// What was not as the definition says it must be.
    pub failures: Vec<String>,
    /// What a reader of the numbers must know.
    pub remarks: Vec<String>,
}

/// The certified frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Pixels.
    pub pixels: u64,
    /// Pixels with a first hit.
    pub hits: u64,
    /// Pixels the oracle calls undecidable in f32 data.
    pub undecidable: u64,
    /// Decided in f64, in double-double, in exact arithmetic.
    pub stages: [u64; 3],
    /// Hits the definition demands.
    pub expected: Option<u64>,
    /// Seconds to compute or load.
    pub seconds: f64,
}

/// Median, median absolute deviation and number of samples; seconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Stat {
    /// Median.
    pub median: f64,
    /// Median absolute deviation.
    pub mad: f64,
    /// Samples.
    pub n: usize,
}

impl From<isobar::run::Stat> for Stat {
    fn from(s: isobar::run::Stat) -> Self {
        Self {
            median: s.median,
            mad: s.mad,
            n: s.n,
        }
    }
}

/// Median, 99th percentile and greatest value.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Median.
    pub median: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Greatest.
    pub max: f64,
}

/// A frame against the truth.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Checked {
    /// Pixels compared.
    pub pixels: u64,
    /// Hits of the truth.
    pub hits: u64,
    /// Hits not found.
    pub missed: u64,
    /// Hits where there is none.
    pub false_hits: u64,
    /// Hits on a later root.
    pub wrong_root: u64,
    /// Hits of another surface.
    pub wrong_surface: u64,
    /// Claims refuted.
    pub refuted: u64,
    /// Undecidable pixels.
    pub undecidable: u64,
    /// Pixels without a claim.
    pub unclaimed: u64,
    /// |t - t*| of right hits, voxels.
    pub t_voxels: Spread,
    /// The same in pixel footprints.
    pub t_pixels: Spread,
    /// Angle between the normal and grad s, degrees.
    pub normal_deg: Spread,
}

impl Checked {
    /// Pixels that are wrong whatever their error: missed, false, wrong root, wrong surface.
    #[must_use]
    pub const fn wrong(&self) -> u64 {
        self.missed + self.false_hits + self.wrong_root + self.wrong_surface
    }

    /// Hits that are right: those that errors are about.
    #[must_use]
    pub const fn right(&self) -> u64 {
        self.hits.saturating_sub(self.missed + self.wrong_root + self.wrong_surface)
    }
}

/// One method at one setting.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Method id.
    pub method: String,
    /// `knob=value`.
    pub setting: String,
    /// Whether it is the method's default setting.
    pub default: bool,
    /// Why there is no number: refused, failed, wrong.
    pub reason: Option<String>,
    /// Wall clock of one frame.
    pub wall: Stat,
    /// Processor time of one frame, over all threads.
    pub cpu: Stat,
    /// Device time of one frame, where there is a device.
    pub device: Option<Stat>,
    /// The timed frame against the truth.
    pub checked: Checked,
    /// Its colours against the exact ones, where there is a medium.
    pub colour: Option<Colour>,
    /// What storing the coefficients as the method does moves; `None` where it tells no function.
    pub storage: Option<Storage>,
    /// Bytes: coefficients, index, view, device.
    pub memory: [u64; 4],
    /// Memory of a process that draws this and nothing else; measured where the data are large.
    pub peak: Option<Peak>,
    /// Work of one frame.
    pub work: u64,
    /// Its unit.
    pub work_unit: String,
    /// What the method counted in one frame, by name.
    pub counters: Vec<(String, u64)>,
}

/// Colours of a frame against the exact ones of the oracle, linear and premultiplied, opacity included.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Colour {
    /// Against the emission-absorption integral of the transfer function as given.
    pub integral: Apart,
    /// Against its peaks as surfaces and the integral between, for settings that draw them.
    pub peaks: Option<Apart>,
    /// Of the two exact images: no method's error.
    pub bias: Option<Apart>,
    /// Proved bound of the error of the exact colours, shading apart; `None`: none.
    pub bound: Option<f64>,
    /// Whether the setting draws surfaces: one that draws none cannot miss any.
    pub surfaces: bool,
}

/// How far two images are apart; `None` where a colour is no number.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Apart {
    /// 99th percentile over pixels of the greatest difference of a channel.
    pub p99: Option<f64>,
    /// Greatest.
    pub max: Option<f64>,
    /// Pixels with more than 1/255.
    pub visible: u64,
    /// Decibels; `None` also for equal images.
    pub psnr: Option<f64>,
}

/// |t*(s stored) - t*(s ideal)|: the certified first roots of the function drawn, and of the one with coefficients in f64.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Storage {
    /// The two are one function.
    pub same: bool,
    /// Pixels compared: hit in both, decidable in both, the two roots within half a voxel.
    pub compared: u64,
    /// Decidable pixels where a hit became a miss, a miss a hit, or the root another one.
    pub changed: u64,
    /// Of the pixels compared, voxels.
    pub voxels: Spread,
}

/// Resident memory of a process of its own, bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Peak {
    /// The greatest, from start to end.
    pub process: u64,
    /// The greatest until the data were there and no method was started.
    pub loaded: u64,
    /// The greatest from then on: what the method needs, whatever making or reading the data took.
    pub drawn: u64,
    /// The data.
    pub data: u64,
    /// The frame.
    pub frame: u64,
}

impl Peak {
    /// The greatest of drawing over data and frame.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.drawn as f64 / (self.data + self.frame).max(1) as f64
    }
}

/// The time models.
pub const MODELS: [(&str, &str); 7] = [
    ("open", "start the renderer: threads, pipelines"),
    ("data", "take the data and draw the first image"),
    ("isovalue", "another isovalue, and draw"),
    ("view", "another camera on an orbit, and draw"),
    ("steady", "draw the same image again"),
    ("all-hits", "draw all intersections, not only the first"),
    ("read", "copy the finished image out"),
];

/// One time model of one method at its default setting.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// Method id.
    pub method: String,
    /// One of [`MODELS`].
    pub model: String,
    /// Wall clock.
    pub wall: Stat,
    /// Processor time over all threads.
    pub cpu: Stat,
    /// Why there is no number.
    pub reason: Option<String>,
    /// How the timed output was verified.
    pub verified: String,
}

/// Files of pictures, relative to the page.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Pictures {
    /// Method id.
    pub method: String,
    /// Its setting.
    pub setting: String,
    /// The shaded image.
    pub image: String,
    /// Error map; empty where a medium alone is drawn.
    pub error: String,
    /// Work heat map; empty where the method counts none.
    pub work: String,
    /// Work at the dark end of the map.
    pub work_most: f64,
    /// Its unit.
    pub work_unit: String,
}

/// Error of one reconstruction of one field against the number of samples.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Convergence {
    /// The field.
    pub field: String,
    /// The reconstruction.
    pub reconstruction: String,
    /// Samples per axis.
    pub n: Vec<usize>,
    /// Root mean square distance of the two surfaces at seeded points, in units of the box.
    pub position: Vec<f64>,
    /// Root mean square angle of the two normals, degrees.
    pub normal: Vec<f64>,
    /// Fitted order of the position's error.
    pub slope: f64,
    /// Fitted order of the normal's error.
    pub normal_slope: f64,
    /// Orders of the theory.
    pub theory: [f64; 2],
}

/// Hard cases against methods.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Matrix {
    /// Tables: the root finders on polynomials, the methods on grids and surfaces.
    pub tables: Vec<MatrixTable>,
    /// Cases that no method can be asked.
    pub elsewhere: Vec<Elsewhere>,
}

/// A case that is no row, and where it is tested.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Elsewhere {
    /// Id.
    pub id: String,
    /// Title.
    pub title: String,
    /// What goes wrong.
    pub trap: String,
    /// Where it comes from.
    pub source: String,
    /// Why no method can be asked.
    pub why: String,
    /// `path of the file: name of the test`.
    pub tests: Vec<String>,
}

/// A table of the matrix.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MatrixTable {
    /// Title.
    pub title: String,
    /// Columns.
    pub columns: Vec<String>,
    /// What a right answer of each column must keep; empty where the case alone says it.
    pub bars: Vec<String>,
    /// Rows.
    pub rows: Vec<MatrixRow>,
}

/// One hard case.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MatrixRow {
    /// Id.
    pub id: String,
    /// Title.
    pub title: String,
    /// What goes wrong.
    pub trap: String,
    /// Where it comes from.
    pub source: String,
    /// What is right.
    pub expected: String,
    /// One verdict per column.
    pub cells: Vec<Verdict>,
}

/// What a method made of a case.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// The kind.
    pub kind: VerdictKind,
    /// The value given, or the reason.
    pub given: String,
    /// The certified value for the function that the column draws; empty where it is that of the row.
    pub expected: String,
}

/// Kinds of verdicts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VerdictKind {
    /// The expected answer.
    Right,
    /// Another answer.
    Wrong,
    /// The method does not do this.
    #[default]
    Refused,
    /// Another answer, declared in the case file with its reason.
    Known,
    /// The expected answer although a failure is declared: the declaration must go.
    Unexpected,
}

impl VerdictKind {
    /// In words.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Wrong => "wrong",
            Self::Refused => "refused",
            Self::Known => "known failure",
            Self::Unexpected => "right, but declared a failure",
        }
    }
}

/// One criterion estimate.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Bench {
    /// Group and function, as criterion names them.
    pub name: String,
    /// Median, nanoseconds per iteration.
    pub median: f64,
    /// 95 % interval of the median.
    pub interval: [f64; 2],
    /// Elements per iteration, where the bench states them.
    pub elements: Option<u64>,
}

/// The fastest row of a comparison that keeps an error target.
#[must_use]
pub fn fastest<'a>(rows: &'a [Row], target: &Target) -> Option<&'a Row> {
    rows.iter()
        .filter(|r| r.reason.is_none() && target.met(&r.checked))
        .min_by(|a, b| a.wall.median.total_cmp(&b.wall.median))
}

/// An error target: what a row must keep to be ranked by time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// In words.
    pub title: &'static str,
    /// Wrong pixels per million at most.
    pub wrong_per_million: f64,
    /// Greatest error, or 99th percentile where wrong pixels are allowed, voxels.
    pub voxels: f64,
}

/// The targets of the summary, from loose to strict.
pub const TARGETS: [Target; 4] = [
    Target {
        title: "a picture: at most 1000 wrong pixels per million, 99 % within 0.1 voxel",
        wrong_per_million: 1000.0,
        voxels: 0.1,
    },
    Target {
        title: "a good picture: at most 10 wrong pixels per million, 99 % within 0.01 voxel",
        wrong_per_million: 10.0,
        voxels: 0.01,
    },
    Target {
        title: "no wrong pixel, all within 0.1 voxel",
        wrong_per_million: 0.0,
        voxels: 0.1,
    },
    Target {
        title: "no wrong pixel, all within 0.000 001 voxel",
        wrong_per_million: 0.0,
        voxels: 1e-6,
    },
];

impl Target {
    /// Whether a checked frame keeps the target.
    #[must_use]
    pub fn met(&self, c: &Checked) -> bool {
        let rate = 1e6 * c.wrong() as f64 / c.pixels.max(1) as f64;
        let error = if self.wrong_per_million > 0.0 {
            c.t_voxels.p99
        } else {
            c.t_voxels.max
        };
        rate <= self.wrong_per_million && error <= self.voxels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(wall: f64, missed: u64, p99: f64, max: f64) -> Row {
        Row {
            wall: Stat {
                median: wall,
                mad: 0.0,
                n: 3,
            },
            checked: Checked {
                pixels: 100_000,
                missed,
                t_voxels: Spread { median: 0.0, p99, max },
                ..Checked::default()
            },
            ..Row::default()
        }
    }

    #[test]
    fn the_fastest_row_keeps_the_target() {
        let mut rows = [
            row(1.0, 5, 0.001, 0.2),
            row(2.0, 1, 0.001, 0.2),
            row(3.0, 0, 0.001, 0.005),
            row(0.1, 0, 0.0, 0.0),
        ];
        rows[3].reason = Some("failed".into());
        let best = TARGETS.map(|t| fastest(&rows, &t).map(|r| r.wall.median));
        assert_eq!(best, [Some(1.0), Some(2.0), Some(3.0), None]);
    }
}
