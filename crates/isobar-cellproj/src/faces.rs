//! The two faces of an isosurface: section 9 gives the one towards greater values a colour of its own, which in the paper are the texels with s_f > s_b.

use crate::mesh::Cells;
use crate::normals::Shading;
use crate::resolve::Root;
use isobar_core::{KnobKind, KnobSpec, Ray, ResolvedKnobs, Surface};
use isobar_cpu::scene::Isovalues;

/// The knob, the same in all methods of this crate.
pub(crate) const INSIDE: KnobSpec = KnobSpec {
    name: "inside",
    doc: "colour of isosurfaces' faces towards greater values, 65536 red + 256 green + blue; -1: that of the other face, -2: of the surface given next",
    kind: KnobKind::Int {
        default: -1,
        min: -2,
        max: 0xff_ffff,
    },
};

/// What colour faces towards greater values have.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) enum Inside {
    /// That of the other face.
    #[default]
    Same,
    /// That of the surface given after it; the last one's is the first one's. Surfaces that cannot be seen (opacity 0) count: so each surface has two colours of its own.
    Next,
    /// One for all surfaces.
    Colour([f32; 3]),
}

impl Inside {
    /// Of the knobs of a method that has [`INSIDE`].
    pub(crate) fn new(knobs: &ResolvedKnobs) -> Self {
        match u32::try_from(knobs.int(INSIDE.name)) {
            Ok(rgb) => Self::Colour([16, 8, 0].map(|bit| (rgb >> bit & 255) as f32 / 255.0)),
            Err(_) if knobs.int(INSIDE.name) == -2 => Self::Next,
            Err(_) => Self::Same,
        }
    }

    /// The colour of surface `i`, of its face towards greater values or of the other one.
    pub(crate) fn colour(self, surfaces: &[Surface], i: u8, greater: bool) -> [f32; 3] {
        let i = usize::from(i);
        match self {
            Self::Colour(colour) if greater => colour,
            Self::Next if greater => surfaces[(i + 1) % surfaces.len()].colour,
            _ => surfaces[i].colour,
        }
    }
}

/// How hits get their colour.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Look<'a> {
    pub(crate) shading: Shading<'a>,
    pub(crate) inside: Inside,
}

impl Look<'_> {
    /// Whether the normals given and the surfaces' own colours are all there is to it.
    pub(crate) fn is_plain(&self) -> bool {
        matches!(self.shading, Shading::Flat) && self.inside == Inside::Same
    }

    /// The surface of a hit in the colour of the face seen, and the normal that shades it. A ray along which values fall sees the face towards greater ones; where the cell has no gradient it is the other.
    pub(crate) fn of(&self, surfaces: &Isovalues, mesh: &Cells, ray: &Ray, root: &Root) -> (Surface, [f32; 3]) {
        let i = surfaces.surface(usize::from(root.isovalue));
        let greater = root.gradient.dot(ray.direction) < 0.0;
        let surface = Surface {
            colour: self.inside.colour(surfaces.all(), i, greater),
            ..surfaces.all()[usize::from(i)]
        };
        (surface, self.shading.normal(mesh, ray, root))
    }
}
