//! What the method is and its knobs.

use crate::faces::{INSIDE, Inside};
use crate::medium::Model;
use crate::mixed::Sort;
use isobar_core::{DataKind, KnobKind, KnobSpec, Knobs, MethodInfo, RenderError, Request, ResolvedKnobs, Surface, Unsupported};

pub(super) static INFO: MethodInfo = MethodInfo {
    id: "cellproj/cpu-paper",
    summary: "projected tetrahedra as printed: triangles, textures and blending, orthographic; no claims",
    paper: "Roettger, Kraus, Ertl, Hardware-accelerated volume and isosurface rendering based on cell-projection, IEEE Visualization 2000",
    data: DataKind::TETS,
    hits: true,
    gpu: false,
    work_unit: "fragments blended",
    knobs: &[
        KnobSpec {
            name: "isosurface",
            doc: "isosurfaces by texture (sections 7 and 8), or by the stencil of section 6, which is flat",
            kind: KnobKind::Choice(&["texture", "stencil"]),
        },
        KnobSpec {
            name: "shading",
            doc: "one pass with the light of the cell, or two with that of the points (section 8)",
            kind: KnobKind::Choice(&["smooth", "flat"]),
        },
        KnobSpec {
            name: "texture",
            doc: "texels along each side of the 2D textures",
            kind: KnobKind::Int {
                default: 256,
                min: 2,
                max: 4096,
            },
        },
        KnobSpec {
            name: "thickening",
            doc: "texels beside an isovalue that are set as well, against gaps",
            kind: KnobKind::Float {
                default: 0.0,
                min: 0.0,
                max: 16.0,
            },
        },
        INSIDE,
        KnobSpec {
            name: "volume",
            doc: "3D texture (section 3), 2D texture (section 4), linear opacity, or Stein's texture of the opacity (section 2)",
            kind: KnobKind::Choice(&["table2d", "table3d", "linear", "stein"]),
        },
        KnobSpec {
            name: "table",
            doc: "texels along each side of the 3D texture",
            kind: KnobKind::Int {
                default: 64,
                min: 2,
                max: 256,
            },
        },
        KnobSpec {
            name: "model",
            doc: "what the medium of the 2D and 3D textures emits: extinction times colour, or colour alone",
            kind: KnobKind::Choice(&["williams-max", "wilhelms-van-gelder"]),
        },
        KnobSpec {
            name: "mixing",
            doc: "the volume between back and front face, or over the surfaces with the integration stopped at isovalues (section 10)",
            kind: KnobKind::Choice(&["smooth", "stopped"]),
        },
        KnobSpec {
            name: "framebuffer",
            doc: "colours and texels in floating point, or rounded to 8 bits at each step as on the paper's machine",
            kind: KnobKind::Choice(&["float", "8bit"]),
        },
        KnobSpec {
            name: "sort",
            doc: "order of the cells: by visibility, or by the distance of their centroids, which may be wrong",
            kind: KnobKind::Choice(&["visibility", "centroids"]),
        },
    ],
    sweep: ("texture", &["32", "64", "128", "256", "512", "1024"]),
};

/// How volumes are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum VolumeKind {
    Table2,
    Table3,
    Linear,
    Stein,
}

/// Section 10's two ways.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mixing {
    Smooth,
    Stopped,
}

/// The knobs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Settings {
    pub(super) stencil: bool,
    pub(super) smooth: bool,
    pub(super) texture: usize,
    pub(super) thickening: f64,
    /// The colour of faces towards greater values, if they have one of their own.
    pub(super) inside: Inside,
    pub(super) volume: VolumeKind,
    pub(super) table: usize,
    pub(super) model: Model,
    pub(super) mixing: Mixing,
    pub(super) fixed: bool,
    pub(super) sort: Sort,
}

impl Settings {
    pub(super) fn new(knobs: &Knobs) -> Result<Self, RenderError> {
        let k = ResolvedKnobs::new(INFO.knobs, knobs)?;
        let stencil = k.word("isosurface") == "stencil";
        Ok(Self {
            stencil,
            smooth: k.word("shading") == "smooth" && !stencil,
            texture: k.int("texture") as usize,
            thickening: k.float("thickening"),
            inside: Inside::new(&k),
            volume: match k.word("volume") {
                "table2d" => VolumeKind::Table2,
                "table3d" => VolumeKind::Table3,
                "linear" => VolumeKind::Linear,
                _ => VolumeKind::Stein,
            },
            table: k.int("table") as usize,
            model: if k.word("model") == "williams-max" {
                Model::WilliamsMax
            } else {
                Model::WilhelmsVanGelder
            },
            mixing: if k.word("mixing") == "smooth" {
                Mixing::Smooth
            } else {
                Mixing::Stopped
            },
            fixed: k.word("framebuffer") == "8bit",
            sort: if k.word("sort") == "visibility" {
                Sort::Visibility
            } else {
                Sort::Centroids
            },
        })
    }

    /// What cannot be mixed.
    pub(super) fn check(&self, surfaces: &[Surface], medium: bool) -> Result<(), Unsupported> {
        if surfaces.is_empty() || !medium {
            return Ok(());
        }
        let tables = matches!(self.volume, VolumeKind::Table2 | VolumeKind::Table3);
        if self.stencil && self.mixing == Mixing::Smooth {
            return Err(feature("the stencil with weights; give --set mixing=stopped"));
        }
        if self.mixing == Mixing::Stopped && !tables {
            return Err(feature(
                "integration stopped at isovalues without a table; give --set volume=table2d",
            ));
        }
        if self.mixing == Mixing::Stopped && surfaces.iter().any(|s| s.opacity < 1.0) {
            return Err(feature(
                "semi-transparent surfaces over a stopped integration; give --set mixing=smooth",
            ));
        }
        Ok(())
    }
}

pub(super) fn feature(what: &str) -> Unsupported {
    Unsupported::Feature {
        method: INFO.id,
        what: what.into(),
    }
}

pub(super) fn check_layers(request: &Request) -> Result<(), Unsupported> {
    if request.layers > 1 {
        return Err(feature("several layers; a texel holds one surface, leave out --layers"));
    }
    Ok(())
}
