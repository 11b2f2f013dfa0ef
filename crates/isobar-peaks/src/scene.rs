//! What the renderers of this crate, on CPU and GPU, keep of their inputs, and what they make of it for all images: macrocells, tables.

use crate::exact::MARGIN;
use crate::interval::Intervals;
use crate::knobs::{Sampled, Scheme, Settings, Variant};
use crate::macrocells::{Macrocells, Visible, multipliers};
use crate::medium::Medium;
use crate::paper::{Integration, Mode};
use crate::sampling::Sampler;
use crate::tables::{Bins, Lookup, PeakTable, SegmentTable};
use crate::volume::Volume;
use isobar_core::{
    Data, DataKind, Function, Grid, Knobs, Memory, MethodInfo, RenderError, Request, Scene, Stage, Surface, TransferFunction,
    Unsupported, View,
};
use isobar_cpu::scene::{Isovalues, check_open_cuts, check_request, grid};
use isobar_cpu::{Level, Pool};
use isobar_fields::GridSpline;
use std::sync::Arc;

/// Whether a scene can be drawn by the method of `info`.
pub(crate) fn check(info: &'static MethodInfo, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
    if DataKind::of(scene.data) != DataKind::GRID {
        return Err(Unsupported::DataKind {
            method: info.id,
            can: info.data.words(),
            given: scene.data.kind(),
        });
    }
    let mut surfaces = scene.surfaces.to_vec();
    surfaces.extend(scene.medium.iter().flat_map(|m| m.peaks()).map(|p| p.surface()));
    Isovalues::new(info, &surfaces)?;
    check_open_cuts(info, scene.view)?;
    check_request(info, request)
}

/// What depends on data and reconstruction.
#[derive(Debug)]
pub(crate) struct Field {
    pub(crate) volume: Volume,
    pub(crate) macrocells: Macrocells,
    pub(crate) multipliers: Option<Vec<u8>>,
}

/// What depends on surfaces and transfer function too.
#[derive(Debug)]
pub(crate) struct Prepared {
    pub(crate) values: Isovalues,
    pub(crate) medium: Option<Medium>,
    pub(crate) visible: Visible,
    pub(crate) tables: Option<(PeakTable, Option<Integration>)>,
}

/// What was set, and what was made of it for all images.
#[derive(Debug)]
pub(crate) struct Inputs {
    pub(crate) variant: Variant,
    pub(crate) settings: Settings,
    pub(crate) pool: Pool,
    pub(crate) level: Level,
    pub(crate) request: Request,
    pub(crate) grid: Option<Grid>,
    pub(crate) field: Option<Field>,
    surfaces: Option<Vec<Surface>>,
    transfer: Option<TransferFunction>,
    pub(crate) view: Option<View>,
    /// Made when the next image is drawn.
    pub(crate) scene: Option<Prepared>,
}

impl Inputs {
    /// Nothing yet.
    pub(crate) fn new(variant: Variant, request: &Request) -> Result<Self, RenderError> {
        check_request(variant.info(), request)?;
        Ok(Self {
            variant,
            settings: Settings::new(variant, &request.knobs)?,
            pool: Pool::new(request.threads)?,
            level: Level::detect(),
            request: request.clone(),
            grid: None,
            field: None,
            surfaces: None,
            transfer: None,
            view: None,
            scene: None,
        })
    }

    fn load(&mut self) -> Result<(), RenderError> {
        (self.field, self.scene) = (None, None);
        let Some(grid) = &self.grid else { return Ok(()) };
        let filter = self.settings.filter;
        let (exact, level) = (self.variant == Variant::Exact, self.level);
        self.field = Some(self.pool.install(|| {
            let volume = Volume::new(grid, filter)?;
            let macrocells = Macrocells::new(&volume, exact, level);
            Ok::<_, RenderError>(Field {
                volume,
                macrocells,
                multipliers: None,
            })
        })?);
        Ok(())
    }

    /// Makes what depends on surfaces and transfer function, where that is not done; returns whether it was made anew.
    pub(crate) fn prepare(&mut self) -> Result<bool, RenderError> {
        let field = self.field.as_mut().ok_or(RenderError::NotReady("set_data"))?;
        if self.surfaces.is_none() && self.transfer.is_none() {
            return Err(RenderError::NotReady("set_surfaces"));
        }
        let sampled = self.settings.sampled.as_ref();
        if sampled.is_some_and(|s| s.multiplier) && field.multipliers.is_none() {
            field.multipliers = Some(self.pool.install(|| multipliers(&field.volume, &field.macrocells)));
        }
        if self.scene.is_some() {
            return Ok(false);
        }
        let mode = self.settings.mode;
        let surfaces = all_surfaces(self.surfaces.as_deref(), self.transfer.as_ref(), mode);
        let values = Isovalues::new(self.variant.info(), &surfaces)?;
        let medium = match &self.transfer {
            Some(tf) if mode != Mode::Peaks => Some(Medium::new(tf)),
            _ => None,
        };
        let (lo, hi) = field.macrocells.range;
        let wanted = values.values().iter().map(|&v| (v, v));
        let wanted = wanted.chain(medium.iter().flat_map(|m| m.support().iter()));
        let wanted = Intervals::new(wanted, MARGIN * (hi - lo));
        let all = !self.settings.macrocells;
        let visible = self
            .pool
            .install(|| Visible::new(&field.volume, &field.macrocells, &wanted, all, self.level));
        let tables = sampled.map(|s| tables(s, values.values(), medium.as_ref(), (lo, hi)));
        self.scene = Some(Prepared {
            values,
            medium,
            visible,
            tables,
        });
        Ok(true)
    }

    /// The sampler of a view.
    pub(crate) fn sampler(&self, s: &Sampled, field: &Field, view: &View) -> Result<Sampler, RenderError> {
        let space = &field.volume.space;
        let sampler = Sampler::new(s.law, s.s_k, space.extent, s.step * space.domain.voxel(), view);
        sampler.check(view, space.domain.world_bounds())?;
        Ok(sampler)
    }

    pub(crate) fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let grid = grid(self.variant.info(), data)?;
        if grid.dims.iter().any(|&n| n > 1 << 30) {
            return Err(isobar_core::DataError::Dims(grid.dims).into());
        }
        let former = self.grid.replace(grid.clone());
        if let Err(e) = self.load() {
            // The former data stay.
            self.restore(former)?;
            return Err(e);
        }
        Ok(())
    }

    /// Back to data that were set before.
    pub(crate) fn restore(&mut self, grid: Option<Grid>) -> Result<(), RenderError> {
        self.grid = grid;
        self.load()
    }

    pub(crate) fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        Isovalues::new(
            self.variant.info(),
            &all_surfaces(Some(surfaces), self.transfer.as_ref(), Mode::Both),
        )?;
        (self.surfaces, self.scene) = (Some(surfaces.to_vec()), None);
        Ok(())
    }

    pub(crate) fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        let checked = medium.map(|m| TransferFunction::new(m.points.clone(), m.unit)).transpose()?;
        Isovalues::new(
            self.variant.info(),
            &all_surfaces(self.surfaces.as_deref(), checked.as_ref(), Mode::Both),
        )?;
        if checked != self.transfer {
            (self.transfer, self.scene) = (checked, None);
        }
        Ok(())
    }

    pub(crate) fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        view.validate()?;
        check_open_cuts(self.variant.info(), view)?;
        self.view = Some(view.clone());
        Ok(())
    }

    pub(crate) fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let settings = Settings::new(self.variant, knobs)?;
        let former = std::mem::replace(&mut self.settings, settings);
        if former.filter != self.settings.filter {
            if let Err(e) = self.load() {
                // The former settings stay, and what was made for them.
                self.settings = former;
                self.load()?;
                return Err(e);
            }
        } else if former != self.settings {
            self.scene = None;
        }
        Ok(())
    }

    /// The function drawn. `None` for `bc21`, which has no description that the oracle could use, since its weights are negative.
    pub(crate) fn reconstruction(&self, stage: Stage) -> Option<Arc<dyn Function>> {
        let volume = &self.field.as_ref()?.volume;
        if volume.filter.has_negative_lobes() {
            return None;
        }
        Some(match stage {
            Stage::Stored => Arc::new(volume.spline.clone()),
            Stage::Ideal => Arc::new(GridSpline::new(volume.spline.grid(), volume.filter.coefficients(), stage).ok()?),
        })
    }

    /// What is held on the host for all images.
    pub(crate) fn memory(&self) -> Memory {
        let field = self.field.as_ref();
        let scene = self.scene.as_ref();
        let index = field.map_or(0, |f| f.macrocells.bytes() + f.multipliers.as_ref().map_or(0, Vec::len));
        let tables = scene.and_then(|s| s.tables.as_ref()).map_or(0, |(t, i)| {
            t.bytes()
                + match i {
                    Some(Integration::Post(l)) => l.bytes(),
                    Some(Integration::Table(t) | Integration::Smooth(t)) => t.bytes(),
                    Some(Integration::Analytic(_)) | None => 0,
                }
        });
        Memory {
            coefficients: field.map_or(0, |f| f.volume.spline.own_bytes()) as u64,
            index: (index + tables + scene.map_or(0, |s| s.visible.bytes())) as u64,
            ..Memory::default()
        }
    }

    /// Of the scene: macrocells and tables.
    pub(crate) fn counters(&self) -> Vec<(&'static str, u64)> {
        let mut out = Vec::new();
        if let Some(scene) = &self.scene {
            out.push(("visible macrocells", scene.visible.count()));
            if let Some((table, _)) = &scene.tables {
                out.push(("peaks in one bin with the next", table.crowded() as u64));
                out.push(("table entries with dropped peaks", table.dropped() as u64));
            }
        }
        out
    }
}

/// The surfaces given, then the peaks.
fn all_surfaces(given: Option<&[Surface]>, transfer: Option<&TransferFunction>, mode: Mode) -> Vec<Surface> {
    if mode == Mode::Medium {
        return Vec::new();
    }
    let mut all = given.unwrap_or_default().to_vec();
    all.extend(transfer.iter().flat_map(|t| t.peaks()).map(|p| p.surface()));
    all
}

fn tables(s: &Sampled, values: &[f64], medium: Option<&Medium>, range: (f64, f64)) -> (PeakTable, Option<Integration>) {
    let table = PeakTable::new(values, Bins::new(range, s.bins), s.reach, s.peaks);
    let segments = |m: &Medium| SegmentTable::new(m, Bins::new(range, s.segments));
    let integration = medium.map(|m| match s.scheme {
        Scheme::Post => Integration::Post(Lookup::new(m, range)),
        Scheme::Table => Integration::Table(segments(m)),
        Scheme::Smooth => Integration::Smooth(segments(m)),
        Scheme::Analytic => Integration::Analytic(m.clone()),
    });
    (table, integration)
}
