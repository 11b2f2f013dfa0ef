//! The seam: a method says what it is, a renderer does it.

use crate::{Data, Frame, Function, KnobSpec, Knobs, RenderError, Request, Scene, Surface, TransferFunction, Unsupported, View};
use bitflags::bitflags;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

bitflags! {
    /// Kinds of data a method draws.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub struct DataKind: u8 {
        /// [`crate::Grid`]
        const GRID = 1;
        /// [`crate::TetMesh`]
        const TETS = 2;
        /// [`crate::HexPatches`]
        const HEXES = 4;
        /// [`crate::Algebraic`]
        const ALGEBRAIC = 8;
    }
}

impl DataKind {
    /// The kind of some data.
    #[must_use]
    pub const fn of(data: &Data) -> Self {
        match data {
            Data::Grid(_) => Self::GRID,
            Data::Tets(_) => Self::TETS,
            Data::Hexes(_) => Self::HEXES,
            Data::Algebraic(_) => Self::ALGEBRAIC,
        }
    }

    /// The kinds in words: `grid, tets`.
    #[must_use]
    pub fn words(self) -> String {
        let names = [
            (Self::GRID, "grid"),
            (Self::TETS, "tets"),
            (Self::HEXES, "hexes"),
            (Self::ALGEBRAIC, "algebraic"),
        ];
        let words: Vec<_> = names.iter().filter(|(k, _)| self.contains(*k)).map(|(_, n)| *n).collect();
        words.join(", ")
    }
}

/// What a method is.
#[derive(Debug)]
pub struct MethodInfo {
    /// `method/backend[-variant]`.
    pub id: &'static str,
    /// One line: what it does.
    pub summary: &'static str,
    /// Authors, title, venue and year; empty for the rulers.
    pub paper: &'static str,
    /// Data it draws.
    pub data: DataKind,
    /// Whether t, and not only colour, comes back: then frames are checked against the oracle.
    pub hits: bool,
    /// Whether it needs a GPU adapter.
    pub gpu: bool,
    /// What [`crate::Channels::WORK`] counts, such as `samples`.
    pub work_unit: &'static str,
    /// Settings.
    pub knobs: &'static [KnobSpec],
    /// The knob whose sweep trades time against error, with the values to sweep, as on the command line; empty: none.
    pub sweep: (&'static str, &'static [&'static str]),
}

/// A way to draw: stateless, listed once in the program.
pub trait Method: Send + Sync {
    /// What it is.
    fn info(&self) -> &'static MethodInfo;

    /// Whether it can draw this scene as asked; cheap, builds nothing.
    ///
    /// # Errors
    /// [`Unsupported`] says what it cannot do.
    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported>;

    /// Starts a renderer: compiles pipelines, starts threads. Timed on its own.
    ///
    /// # Errors
    /// [`RenderError::Knob`], [`RenderError::Device`], [`RenderError::Unsupported`].
    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError>;
}

/// Which function a reconstruction is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The mathematical reconstruction of the samples (coefficients in f64).
    Ideal,
    /// The one drawn, with coefficients as stored (f32, dropped details).
    Stored,
}

/// Draws one scene at a time. Setters come in any order, each at its own cost; nothing is built that the scene cannot show.
pub trait Renderer: Send {
    /// The data; shared, re-laid out only if it pays.
    ///
    /// # Errors
    /// [`RenderError::Data`], [`RenderError::Memory`], [`RenderError::Unsupported`]. The renderer keeps its former data.
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError>;

    /// The surfaces.
    ///
    /// # Errors
    /// As [`Renderer::set_data`].
    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError>;

    /// The medium between the surfaces.
    ///
    /// # Errors
    /// As [`Renderer::set_data`].
    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError>;

    /// Camera, size and clipping planes.
    ///
    /// # Errors
    /// [`RenderError::View`], or as [`Renderer::set_data`].
    fn set_view(&mut self, view: &View) -> Result<(), RenderError>;

    /// Other settings; a sweep rebuilds nothing it need not.
    ///
    /// # Errors
    /// [`RenderError::Knob`].
    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError>;

    /// Draws; blocks. `stop` is looked at per tile and carries progress.
    ///
    /// # Errors
    /// [`RenderError::NotReady`] before data, surfaces or view were set; [`RenderError::Stopped`]; [`RenderError::Device`].
    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError>;

    /// Copies the last frame out: not part of rendering.
    ///
    /// # Errors
    /// [`RenderError::NotReady`] before the first `render`; [`RenderError::Device`].
    fn read(&mut self, out: &mut Frame) -> Result<(), RenderError>;

    /// The function it really draws; `None` before `set_data`, or where there is none to tell.
    fn reconstruction(&self, stage: Stage) -> Option<Arc<dyn Function>>;

    /// Bytes beyond the shared source and the frame.
    fn memory(&self) -> Memory;

    /// Work done by the last `render`.
    fn counters(&self) -> Counters;
}

/// Time of one `render`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RenderTime {
    /// Wall clock.
    pub wall: Duration,
    /// Device time by timestamps, where there is a device.
    pub device: Option<Duration>,
}

/// Bytes a renderer holds beyond the shared source data and the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Memory {
    /// Coefficients and other copies of the data.
    pub coefficients: u64,
    /// Search structures: min/max blocks, hierarchies, meshes.
    pub index: u64,
    /// What depends on the view.
    pub view: u64,
    /// Device memory.
    pub device: u64,
}

impl Memory {
    /// All together.
    #[must_use]
    pub const fn total(&self) -> u64 {
        self.coefficients + self.index + self.view + self.device
    }
}

/// Named counts of work, such as `("samples", 123)`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Counters(pub Vec<(&'static str, u64)>);

/// Raised from outside to end a `render` early; carries progress the other way.
#[derive(Debug, Default)]
pub struct Stop {
    raised: AtomicBool,
    done: AtomicU64,
    total: AtomicU64,
}

impl Stop {
    /// Asks the renderer to end.
    pub fn raise(&self) {
        self.raised.store(true, Ordering::Relaxed);
    }

    /// Whether it should end.
    #[must_use]
    pub fn is_raised(&self) -> bool {
        self.raised.load(Ordering::Relaxed)
    }

    /// Says how many steps (tiles, passes) there are, and forgets those done.
    pub fn begin(&self, total: u64) {
        self.done.store(0, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
    }

    /// One step is done.
    pub fn step(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    /// Steps done and steps in all.
    #[must_use]
    pub fn progress(&self) -> (u64, u64) {
        (self.done.load(Ordering::Relaxed), self.total.load(Ordering::Relaxed))
    }
}
