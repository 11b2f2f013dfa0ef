//! The renderer: grid, mesh and hierarchy, and the tiles.

use super::INFO;
use super::cast::{Builder, NoMesh, Part, Scene, Space, Tree, TriangleHit};
use super::mesh::{self, Lattice};
use crate::given::Given;
use crate::index_space::{IndexRay, ToIndex};
use crate::march::volume::{Point, Sample, Volume};
use crate::support::{self, Isovalues};
use isobar_core::{
    Channels, Claim, Counters, Data, Frame, Function, Grid, Hit, Knobs, Memory, Ray, RenderError, RenderTime, Renderer, Request,
    ResolvedKnobs, Samples, Stage, Stop, Surface, TransferFunction, Unsupported, View,
};
use isobar_cpu::{PixelSink, Pool, TileOut, copy_frame, render_tiles};
use isobar_fields::{Border, GridSpline, Kind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Settings, read once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Settings {
    subdivide: usize,
    face_normals: bool,
}

impl Settings {
    fn new(knobs: &Knobs) -> Result<Self, RenderError> {
        let k = ResolvedKnobs::new(INFO.knobs, knobs)?;
        Ok(Self {
            subdivide: k.word("subdivide").parse().map_err(|_| RenderError::Knob {
                name: "subdivide".into(),
                reason: format!("{} cannot be read", k.word("subdivide")),
            })?,
            face_normals: k.word("normals") == "face",
        })
    }
}

/// What is kept of the data.
#[derive(Debug)]
struct Source {
    spline: GridSpline,
    to_index: ToIndex,
}

impl Source {
    fn new(data: &Data) -> Result<Self, RenderError> {
        let spline = GridSpline::new(support::grid(&INFO, data)?, Kind::Trilinear, Stage::Stored)?;
        Ok(Self {
            to_index: ToIndex::new(&spline.grid().domain()),
            spline,
        })
    }
}

/// A renderer of `mc/cpu`.
#[derive(Debug)]
pub(crate) struct McRenderer {
    pool: Pool,
    request: Request,
    settings: Settings,
    source: Option<Source>,
    given: Given,
    scene: Option<Scene>,
    frame: Frame,
    tests: AtomicU64,
}

impl McRenderer {
    pub(crate) fn new(request: &Request) -> Result<Self, RenderError> {
        Ok(Self {
            given: Given::new(&INFO, request)?,
            pool: Pool::new(request.threads)?,
            settings: Settings::new(&request.knobs)?,
            request: request.clone(),
            source: None,
            scene: None,
            frame: Frame::default(),
            tests: AtomicU64::new(0),
        })
    }

    /// The mesh and its hierarchy, where data and surfaces are both known.
    fn build(
        &self,
        source: Option<&Source>,
        surfaces: Option<&Isovalues>,
        subdivide: usize,
    ) -> Result<Option<Scene>, RenderError> {
        let (Some(source), Some(surfaces)) = (source, surfaces) else {
            return Ok(None);
        };
        let grid = source.spline.grid();
        let scene = self.pool.install(|| match &grid.samples {
            Samples::U8(s) => extract(s, grid, surfaces, subdivide),
            Samples::I16(s) => extract(s, grid, surfaces, subdivide),
            Samples::U16(s) => extract(s, grid, surfaces, subdivide),
            Samples::F32(s) => extract(s, grid, surfaces, subdivide),
        })?;
        Ok(Some(scene))
    }
}

fn extract<T: Sample>(samples: &[T], grid: &Grid, surfaces: &Isovalues, subdivide: usize) -> Result<Scene, RenderError> {
    let lattice = Lattice::new(samples, grid.dims, subdivide);
    let space = Space::new(grid.dims, subdivide);
    let mut builder = Builder::new(space);
    for (i, c) in (0..).zip(surfaces.values()) {
        let add = |t: Option<Tree>| t.map_or(Ok(()), |t| builder.add(&t));
        mesh::blocks(&lattice, *c, i, |block| Tree::new(block, space), add).map_err(|e| match e {
            NoMesh::Memory(e) => e,
            NoMesh::TooLarge => RenderError::Unsupported(Unsupported::Feature {
                method: INFO.id,
                what: format!(
                    "{:?} samples subdivided by {subdivide}; {} points along an axis and 2^32 triangles are the most",
                    grid.dims,
                    mesh::MOST_POINTS
                ),
            }),
        })?;
    }
    Ok(builder.finish())
}

impl Renderer for McRenderer {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let source = self.pool.install(|| Source::new(data))?;
        self.scene = self.build(Some(&source), self.given.surfaces(), self.settings.subdivide)?;
        self.source = Some(source);
        self.given.changed();
        Ok(())
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        let surfaces = self.given.isovalues(surfaces)?;
        // other colours need no other mesh
        let same = self.given.surfaces().is_some_and(|s| s.values() == surfaces.values());
        if !(same && self.scene.is_some()) {
            self.scene = self.build(self.source.as_ref(), Some(&surfaces), self.settings.subdivide)?;
        }
        self.given.set_surfaces(surfaces);
        Ok(())
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        self.given.set_medium(medium)
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        self.given.check_view(view)?;
        self.given.set_view(view);
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let settings = Settings::new(knobs)?;
        if settings.subdivide != self.settings.subdivide {
            self.scene = self.build(self.source.as_ref(), self.given.surfaces(), settings.subdivide)?;
        }
        self.settings = settings;
        self.given.changed();
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let source = self.source.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        self.given.changed();
        let (surfaces, view) = self.given.scene()?;
        let scene = self.scene.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let start = Instant::now();
        self.tests = AtomicU64::new(0);
        let job = Job {
            source,
            surfaces,
            scene,
            view,
            face_normals: self.settings.face_normals,
            tests: &self.tests,
        };
        render_tiles(&self.pool, view, &self.request, stop, &mut self.frame, |_, out| job.draw(out))?;
        self.given.drew();
        Ok(RenderTime {
            wall: start.elapsed(),
            device: None,
        })
    }

    fn read(&mut self, out: &mut Frame) -> Result<(), RenderError> {
        self.given.frame()?;
        copy_frame(&self.frame, out);
        Ok(())
    }

    fn reconstruction(&self, _: Stage) -> Option<Arc<dyn Function>> {
        let s = self.source.as_ref()?;
        Some(Arc::new(s.spline.clone()))
    }

    fn memory(&self) -> Memory {
        Memory {
            index: self.scene.as_ref().map_or(0, |s| s.bytes() as u64),
            ..Memory::default()
        }
    }

    fn counters(&self) -> Counters {
        Counters(vec![
            ("triangle tests", self.tests.load(Ordering::Relaxed)),
            ("triangles", self.scene.as_ref().map_or(0, |s| s.len() as u64)),
        ])
    }
}

/// What the tiles of a frame share.
struct Job<'a> {
    source: &'a Source,
    surfaces: &'a Isovalues,
    scene: &'a Scene,
    view: &'a View,
    face_normals: bool,
    tests: &'a AtomicU64,
}

impl Job<'_> {
    fn draw(&self, out: &mut TileOut<'_>) {
        match &self.source.spline.grid().samples {
            Samples::U8(s) => self.typed(s, out),
            Samples::I16(s) => self.typed(s, out),
            Samples::U16(s) => self.typed(s, out),
            Samples::F32(s) => self.typed(s, out),
        }
    }

    fn typed<T: Sample>(&self, samples: &[T], out: &mut TileOut<'_>) {
        let volume = Volume::<T, 2>::new(samples, self.source.spline.grid().dims, Border::Clamp);
        let rays = self.view.generator();
        let opaque = self.surfaces.all().iter().all(|s| s.opacity >= 1.0);
        let first_only = out.layers() == 1 && !out.holds(Channels::HITS) && (opaque || !out.holds(Channels::RGBA));
        let with_normal = out.holds(Channels::NORMAL | Channels::RGBA);
        let mut hits = Vec::new();
        let mut total = 0;
        for (x, y) in out.tile().pixels() {
            let world = rays.ray(x, y);
            let ray = self.source.to_index.ray(&world);
            let mut tests = 0;
            hits.clear();
            if let (Some(kept), Some((t0, t1))) = (rays.kept(&world), ray.clip(volume.last())) {
                let part = Part { kept, inside: (t0, t1) };
                if first_only {
                    hits.extend(self.scene.first(&ray, part, &mut tests));
                } else {
                    self.scene.all(&ray, part, &mut tests, &mut hits);
                }
            }
            let mut sink = PixelSink::new(out, x, y, &world, self.surfaces.all());
            for h in &hits {
                let normal = if with_normal {
                    self.normal(&volume, &ray, h)
                } else {
                    [0.0; 3]
                };
                if !sink.push(&self.hit(&world, h, normal)) {
                    break;
                }
            }
            sink.finish(Claim::empty(), tests);
            total += u64::from(tests);
        }
        self.tests.fetch_add(total, Ordering::Relaxed);
    }

    fn normal<T: Sample>(&self, volume: &Volume<'_, T, 2>, ray: &IndexRay, h: &TriangleHit) -> [f32; 3] {
        let g = if self.face_normals {
            self.scene.normal(h.triangle)
        } else {
            volume.gradient(volume.clamp(Point::new(ray.at(h.t).get())))
        };
        self.source.to_index.normal(g)
    }

    fn hit(&self, world: &Ray, h: &TriangleHit, normal: [f32; 3]) -> Hit {
        Hit {
            t: h.t,
            point: world.at(h.t),
            normal,
            surface: self.surfaces.surface(h.isovalue),
            t_error: f64::INFINITY,
        }
    }
}
