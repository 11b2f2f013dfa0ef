//! Figures 4.5, 4.6, 6.7 and 6.8: levels of detail of a distance field. Rows and pictures are those of [`Setting::rows`] and [`Setting::compressions`].

use super::{Image, nearest_to_middle};
use crate::wavelet::table::{Picture, Row, Setting, level_picture};
use crate::wavelet::{Criteria, Multiresolution, Pyramid, Selection};
use glam::DVec3;
use isobar_core::{Camera, Channels, RenderError, Stop, Surface, View};
use std::sync::Arc;
use std::time::Duration;

/// Shares of the coefficients that Figure 4.5 keeps; the thesis does not print its own.
pub const SHARES: [f64; 4] = [0.2, 0.05, 0.01, 0.002];

/// The eye of a view in perspective.
///
/// # Errors
/// [`RenderError::View`] for other cameras.
pub fn eye(view: &View) -> Result<DVec3, RenderError> {
    match view.camera {
        Camera::Perspective { eye, .. } => Ok(eye),
        _ => Err(RenderError::View(
            "levels of detail are chosen by a view in perspective".to_owned(),
        )),
    }
}

/// One picture of Figure 6.8.
#[derive(Debug, Clone)]
pub struct Shot {
    /// What it shows of the scene.
    pub name: &'static str,
    /// The camera.
    pub view: View,
    /// Drawn over levels of detail; its grid is the row's reconstruction.
    pub picture: Picture,
    /// Shaded.
    pub shaded: Image,
    /// By level of detail, outlines where the level changes.
    pub by_level: Image,
}

/// The levels chosen for the view of `setting` (a row of [`Setting::rows`] with its picture), seen from the other side, and the border of levels next to the middle of
/// that picture from 20 voxels before it. Without a border in view there is no close-up.
///
/// # Errors
/// Those of the renderer over levels.
pub fn transition(setting: &Setting<'_>, row: &Row, of: &Picture) -> Result<Vec<Shot>, RenderError> {
    let pyramid = Arc::new(Pyramid::new(setting.grid, setting.bank)?);
    let criteria = Criteria {
        view: Some((eye(setting.view)?, row.epsilon)),
        ..Criteria::default()
    };
    let channels = Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA;
    let mut levels = Multiresolution::new(pyramid.clone(), channels, setting.threads)?;
    levels.set_surfaces(&[Surface::isovalue(setting.isovalue, 0)])?;
    levels.select(&Selection::new(&pyramid, &criteria))?;
    let mut draw = |name: &'static str, view: View| -> Result<(Shot, Vec<[f32; 4]>), RenderError> {
        levels.render(&view, &Stop::default())?;
        let picture = Picture {
            frame: levels.frame().clone(),
            grid: of.grid.clone(),
            render: Duration::ZERO,
        };
        let by_level = level_picture(&Setting { view: &view, ..*setting }, row, &picture);
        let shot = Shot {
            name,
            shaded: Image::linear(&view, &picture.frame.rgba),
            by_level: Image::linear(&view, &by_level),
            view,
            picture,
        };
        Ok((shot, by_level))
    };
    let (width, height) = (setting.view.width, setting.view.height);
    let bounds = setting.grid.domain().world_bounds();
    let (far, by_level) = draw(
        "other side",
        View::fit_from(bounds, DVec3::new(-1.9, 2.6, 2.2), DVec3::Z, 40.0, width, height),
    )?;
    // Outlines of levels are black.
    let border = nearest_to_middle(&far.view, |i| by_level[i] == [0.0, 0.0, 0.0, 1.0]);
    let Some(i) = border else {
        return Ok(vec![far]);
    };
    let ray = far.view.ray(i % width, i / width);
    let point = ray.at(far.picture.frame.t[i]);
    let normal = DVec3::from_array(far.picture.frame.normal[i].map(f64::from));
    let out = (normal * -normal.dot(ray.direction).signum() - ray.direction).normalize();
    let from = point + out * 20.0 * setting.grid.spacing.min_element();
    let up = if out.z.abs() < 0.9 { DVec3::Z } else { DVec3::X };
    let (close, _) = draw("close-up", View::perspective(from, point, up, 40.0, width, height))?;
    Ok(vec![far, close])
}
