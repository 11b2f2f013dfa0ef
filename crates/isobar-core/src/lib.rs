//! What is asked and what is answered, and nothing else.
//!
//! A [`Scene`] is data, surfaces (isovalues), at most one transfer function and a [`View`]. A [`Method`] says what it
//! can do and opens a [`Renderer`]; the renderer takes the scene in pieces, each at its own cost, and answers with a
//! [`Frame`]. The function it really draws is a [`Function`], so that an oracle can say how wrong the frame is.
//!
//! **Architecture invariants.** No file, thread pool, GPU, serialisation or printing here. Nothing here finds a root:
//! a method and the oracle share types, never algorithms.

mod data;
mod domain;
mod error;
mod frame;
mod function;
mod hexes;
mod interval;
mod method;
mod request;
mod scene;
mod shade;
mod view;

pub use data::{Algebraic, Data, Grid, Samples, TetMesh};
pub use domain::Domain;
pub use error::{DataError, RenderError, Unsupported};
pub use frame::{Channels, Claim, Frame, Hit, NO_SURFACE, Pixel};
pub use function::{Analytic, Basis1, CUBIC, Function, Lattice, QUADRATIC, Structure, TRILINEAR, TetMasks, Tetrahedral};
pub use hexes::{HexElement, HexPatches};
pub use interval::Interval;
pub use method::{Counters, DataKind, Memory, Method, MethodInfo, RenderTime, Renderer, Stage, Stop};
pub use request::{KnobKind, KnobSpec, KnobValue, Knobs, Request, ResolvedKnobs, Sampling};
pub use scene::{Peak, Scene, Surface, SurfaceKind, TransferFunction};
pub use shade::{over, shade, to_srgb8};
pub use view::{Camera, ClipPlane, Lens, Ray, RayGenerator, View};

pub use glam::{DMat3, DVec3, Vec3};
