//! Scenes of isosurfaces on grids: whether a method that draws only these can draw a given one, and its surfaces as isovalues.

use crate::is_visible;
use isobar_core::{
    Data, DataKind, Grid, MethodInfo, RenderError, Request, Sampling, Scene, Surface, SurfaceKind, TransferFunction, Unsupported,
    View,
};

fn feature(info: &MethodInfo, what: impl Into<String>) -> Unsupported {
    Unsupported::Feature {
        method: info.id,
        what: what.into(),
    }
}

/// Whether a method of isosurfaces on its kinds of data can draw the scene: isovalues, no medium, no clipping planes, pixel centres.
///
/// # Errors
/// [`Unsupported`] with the first thing it cannot do.
pub fn check_scene(info: &'static MethodInfo, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
    check_clipped_scene(info, scene, request)?;
    check_view(info, scene.view)
}

/// As [`check_scene`], for methods that clip: open cuts are allowed.
///
/// # Errors
/// [`Unsupported`] with the first thing it cannot do.
pub fn check_clipped_scene(info: &'static MethodInfo, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
    check_kind(info, scene.data)?;
    check_surfaces(info, scene.surfaces)?;
    check_medium(info, scene.medium)?;
    check_open_cuts(info, scene.view)?;
    check_request(info, request)
}

fn check_kind(info: &'static MethodInfo, data: &Data) -> Result<(), Unsupported> {
    if info.data.contains(DataKind::of(data)) {
        return Ok(());
    }
    Err(Unsupported::DataKind {
        method: info.id,
        can: info.data.words(),
        given: data.kind(),
    })
}

fn check_surfaces(info: &MethodInfo, surfaces: &[Surface]) -> Result<(), Unsupported> {
    if surfaces.len() > MOST {
        return Err(feature(info, format!("{} surfaces; {MOST} are the most", surfaces.len())));
    }
    for s in surfaces {
        match s.kind {
            SurfaceKind::Isovalue(c) if c.is_finite() => {}
            SurfaceKind::Isovalue(c) => return Err(feature(info, format!("the isovalue {c}; give a finite number"))),
            _ => return Err(feature(info, "parametric and boundary surfaces; give isovalues")),
        }
    }
    Ok(())
}

/// `Frame::surface` counts to 254.
const MOST: usize = 255;

/// Refuses a transfer function.
///
/// # Errors
/// [`Unsupported::Feature`] where there is one.
pub fn check_medium(info: &MethodInfo, medium: Option<&TransferFunction>) -> Result<(), Unsupported> {
    medium.map_or(Ok(()), |_| Err(feature(info, "transfer functions; leave out --tf")))
}

/// Refuses clipping planes.
///
/// # Errors
/// [`Unsupported::Feature`] where there is one.
pub fn check_view(info: &MethodInfo, view: &View) -> Result<(), Unsupported> {
    if view.clips.is_empty() {
        return Ok(());
    }
    Err(feature(info, "clipping planes; leave out --clip"))
}

/// Refuses closed cuts.
///
/// # Errors
/// [`Unsupported::Feature`] where a clipping plane is capped.
pub fn check_open_cuts(info: &MethodInfo, view: &View) -> Result<(), Unsupported> {
    if view.clips.iter().all(|c| !c.cap) {
        return Ok(());
    }
    Err(feature(info, "closed cuts; leave out --cap"))
}

/// Refuses pixel frusta.
///
/// # Errors
/// [`Unsupported::Feature`] where they are asked for.
pub fn check_request(info: &MethodInfo, request: &Request) -> Result<(), Unsupported> {
    match request.sampling {
        Sampling::PixelCentre => Ok(()),
        Sampling::PixelFrustum => Err(feature(info, "pixel frusta; it samples pixel centres")),
    }
}

/// The grid inside some data.
///
/// # Errors
/// [`RenderError::Unsupported`] where the data are of another kind.
pub fn grid<'a>(info: &'static MethodInfo, data: &'a Data) -> Result<&'a Grid, RenderError> {
    check_kind(info, data)?;
    match data {
        Data::Grid(g) => Ok(g),
        other => Err(Unsupported::DataKind {
            method: info.id,
            can: info.data.words(),
            given: other.kind(),
        }
        .into()),
    }
}

/// The isovalues to search for.
#[derive(Debug, Clone, PartialEq)]
pub struct Isovalues {
    surfaces: Vec<Surface>,
    /// Ascending and distinct, of the surfaces that can be seen.
    values: Vec<f64>,
    /// The surface each value belongs to.
    index: Vec<u8>,
}

impl Isovalues {
    /// Of two surfaces with the same isovalue the first one is drawn: a root is one hit. Those that cannot be seen are left out.
    ///
    /// # Errors
    /// [`Unsupported::Feature`] where a surface is no isovalue, an isovalue is not finite, or there are more than 255.
    pub fn new(info: &MethodInfo, surfaces: &[Surface]) -> Result<Self, Unsupported> {
        check_surfaces(info, surfaces)?;
        let mut seen: Vec<(f64, u8)> = surfaces
            .iter()
            .enumerate()
            .filter(|(_, s)| is_visible(s))
            .filter_map(|(i, s)| Some((s.value()?, u8::try_from(i).ok()?)))
            .collect();
        seen.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        seen.dedup_by(|b, a| a.0 == b.0);
        Ok(Self {
            surfaces: surfaces.to_vec(),
            values: seen.iter().map(|s| s.0).collect(),
            index: seen.iter().map(|s| s.1).collect(),
        })
    }

    /// Ascending, distinct.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The surface of value `i`.
    ///
    /// # Panics
    /// When there is no such value.
    #[must_use]
    pub fn surface(&self, i: usize) -> u8 {
        self.index[i]
    }

    /// All surfaces, in the order given.
    #[must_use]
    pub fn all(&self) -> &[Surface] {
        &self.surfaces
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    static INFO: MethodInfo = MethodInfo {
        id: "march/cpu",
        summary: "",
        paper: "",
        data: DataKind::GRID,
        hits: true,
        gpu: false,
        work_unit: "",
        knobs: &[],
        sweep: ("", &[]),
    };

    #[test]
    fn isovalues_are_sorted_and_invisible_ones_left_out() {
        let mut s: Vec<Surface> = [3.0, 1.0, 2.0, 1.0]
            .iter()
            .enumerate()
            .map(|(i, c)| Surface::isovalue(*c, i))
            .collect();
        s[2].opacity = 0.0;
        let i = Isovalues::new(&INFO, &s).unwrap();
        assert_eq!((i.values(), i.surface(0), i.surface(1)), (&[1.0, 3.0][..], 1, 0));
        assert_eq!(i.all().len(), 4);
    }

    #[test]
    fn what_cannot_be_drawn_is_said() {
        let bad = [
            vec![Surface::isovalue(f64::NAN, 0)],
            vec![Surface {
                kind: SurfaceKind::Boundary,
                ..Surface::isovalue(0.0, 0)
            }],
            vec![Surface::isovalue(0.0, 0); 256],
        ];
        for surfaces in bad {
            let e = Isovalues::new(&INFO, &surfaces).unwrap_err().to_string();
            assert!(e.starts_with("march/cpu cannot do ") && !e.contains('\n'), "{e}");
        }
    }
}
