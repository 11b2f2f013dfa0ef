//! What can go wrong, one variant per cause, each with what a caller needs to say a remedy.

use thiserror::Error;

/// Data that cannot be used, or cannot be made.
#[derive(Debug, Error, Clone, PartialEq)]
#[non_exhaustive]
pub enum DataError {
    /// Sample count and dimensions disagree.
    #[error("{dims:?} samples were declared but {found} are there")]
    Count {
        /// Declared samples per axis.
        dims: [usize; 3],
        /// Samples found.
        found: usize,
    },
    /// An axis has no samples, or the product of the dimensions overflows.
    #[error("dimensions {0:?} are empty or too large for this machine")]
    Dims([usize; 3]),
    /// Spacing, origin or direction is zero, singular, infinite or NaN.
    #[error("the grid's {what} is unusable ({value})")]
    Geometry {
        /// `spacing`, `origin` or `direction`.
        what: &'static str,
        /// What it was.
        value: String,
    },
    /// NaN or infinite samples.
    #[error("{count} of {total} samples are NaN or infinite; read them as a number with --nan C")]
    NotFinite {
        /// Bad samples.
        count: usize,
        /// All samples.
        total: usize,
    },
    /// An axis is too thin for the reconstruction asked.
    #[error("{reconstruction} needs at least 2 samples along every axis, the grid has {dims:?}")]
    TooThin {
        /// Name of the reconstruction.
        reconstruction: String,
        /// Samples per axis.
        dims: [usize; 3],
    },
    /// A mesh with connectivity outside its points, no cells, or points that are not finite.
    #[error("unusable mesh: {0}")]
    Mesh(String),
    /// Elements with a degree out of range, counts that disagree, or a weight that is not positive.
    #[error("unusable elements: {0}")]
    Elements(String),
    /// A polynomial with an exponent that is too large, a term twice, numbers that are not finite, or an empty box.
    #[error("unusable polynomial: {0}")]
    Algebraic(String),
    /// A transfer function that is empty, unsorted, or has numbers that are not finite or outside their range.
    #[error("unusable transfer function: {0}")]
    Transfer(String),
    /// A reconstruction, field or parameter that does not exist.
    #[error("{0}")]
    Unknown(String),
}

/// Why a method will not draw this scene: an answer, not a failure.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Unsupported {
    /// The data are of a kind the method cannot draw.
    #[error("{method} draws {can}, not {given}")]
    DataKind {
        /// Method id.
        method: &'static str,
        /// Kinds it draws.
        can: String,
        /// Kind given.
        given: &'static str,
    },
    /// The scene or request has something the method cannot do: transfer function, clipping planes, parametric surfaces, channels.
    #[error("{method} cannot do {what}")]
    Feature {
        /// Method id.
        method: &'static str,
        /// What it cannot do.
        what: String,
    },
    /// It cannot start on this machine.
    #[error("{method} cannot start here: {reason}")]
    Machine {
        /// Method id.
        method: &'static str,
        /// Why.
        reason: String,
    },
}

/// Why a renderer failed.
#[derive(Debug, Error, Clone, PartialEq)]
#[non_exhaustive]
pub enum RenderError {
    /// `render` or `read` was called before the call named.
    #[error("{0} must be called first")]
    NotReady(&'static str),
    /// The scene is outside what the method does.
    #[error(transparent)]
    Unsupported(#[from] Unsupported),
    /// A knob does not exist or its value is outside the range.
    #[error("knob {name}: {reason}")]
    Knob {
        /// Its name.
        name: String,
        /// What is wrong, with the range or the choices.
        reason: String,
    },
    /// The data cannot be used.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The view has no pixels, no direction, or numbers that are not finite.
    #[error("unusable view: {0}")]
    View(String),
    /// Not enough memory, on the host or the device.
    #[error("{what} needs {bytes} bytes, more than {limit} available")]
    Memory {
        /// What needed it.
        what: String,
        /// Bytes asked.
        bytes: u64,
        /// Bytes there.
        limit: u64,
    },
    /// The GPU or its driver gave up; the renderer may be opened again.
    #[error("device: {0}")]
    Device(String),
    /// [`crate::Stop`] was raised.
    #[error("stopped")]
    Stopped,
}
