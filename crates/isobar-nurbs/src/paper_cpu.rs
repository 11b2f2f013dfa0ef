//! `nurbs/cpu-paper` on a tile: its epsilon, its filter, its pixels.

use crate::frustum::Frustum;
use crate::paper::{Kept, Manner, Paper, Work};
use crate::solve::Found;
use crate::tile::Index;
use isobar_core::{Camera, Claim, Hit, Stop, Surface, View};
use isobar_cpu::{PixelSink, Tile, TileOut};

/// The paper's 1/(2h): as a slope or offset in the frame of the tile, and as the number it is. Lists of rays have no pixels: 1e-8 of the distance.
pub(crate) fn epsilon(view: &View) -> [f64; 2] {
    let printed = 0.5 / view.height as f64;
    match &view.camera {
        Camera::Perspective { fov, .. } => [(fov.to_radians() * 0.5).tan() * printed, printed],
        Camera::Orthographic { height, .. } => [0.5 * height * printed, printed],
        Camera::Rays(_) => [1e-8; 2],
    }
}

/// A scene as the tiles see it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DrawPaper<'a> {
    pub(crate) index: &'a Index,
    pub(crate) view: &'a View,
    pub(crate) surfaces: &'a [Surface],
    pub(crate) manner: Manner,
    pub(crate) kept: &'a Kept,
    pub(crate) stop: &'a Stop,
}

impl DrawPaper<'_> {
    /// Draws one tile.
    pub(crate) fn tile(&self, tile: Tile, out: &mut TileOut<'_>) -> Work {
        let mut solver = Paper {
            stop: Some(self.stop),
            ..Paper::default()
        };
        for (frustum, (x0, y0)) in Frustum::of_tile(self.view, tile) {
            solver.draw(&frustum, &frustum.widened(), self.index, &self.manner, self.kept);
            let sorted = |list: &[Found]| {
                let mut own: Vec<Vec<Found>> = vec![Vec::new(); frustum.rays.len()];
                list.iter().for_each(|f| own[usize::from(f.pixel)].push(*f));
                own
            };
            let (mut own, beside) = (sorted(&solver.found), sorted(&solver.beside));
            for (i, ray) in frustum.rays.iter().enumerate() {
                let list = &mut own[i];
                Paper::filter(list, ray.ray.direction, self.manner.epsilon[1]);
                if list.is_empty() {
                    // S_S of the pixel: the nearest point of a silhouette stands for the surface.
                    list.extend(beside[i].iter().min_by(|a, b| a.t.total_cmp(&b.t)));
                }
                let (x, y) = (x0 + i % frustum.width, y0 + i / frustum.width);
                let mut sink = PixelSink::new(out, x, y, &ray.ray, self.surfaces);
                let kept = self.view.kept(&ray.ray).unwrap_or((f64::INFINITY, f64::INFINITY));
                for f in list.iter().filter(|f| f.t >= kept.0 && f.t <= kept.1) {
                    let more = sink.push(&Hit {
                        t: f.t,
                        point: ray.ray.at(f.t),
                        normal: f.normal.as_vec3().to_array(),
                        surface: f.surface,
                        t_error: f64::INFINITY,
                    });
                    if !more {
                        break;
                    }
                }
                solver.work.hits += u64::from(sink.hits());
                let claim = if solver.undecided[i] { Claim::LIMIT } else { Claim::empty() };
                sink.finish(claim, solver.seen[i]);
            }
        }
        solver.work
    }
}
