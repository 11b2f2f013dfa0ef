//! Figure 6.1: the frustum form beside compositions.

use super::{Album, Figures, Table};
use anyhow::{Context, Result};
use isobar_core::{Function, Ray, Stop, Surface, View};
use isobar_fields::AlgebraicFunction;
use isobar_octree::comparators::algebraic::{Composition, Drawn};
use isobar_octree::figures::Image;
use isobar_octree::figures::surfaces::{Contender, SURFACES, contenders, searched, view};
use isobar_oracle::Truth;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// Sides of the square images, and frames of which the fastest counts.
pub const SIZES: [(usize, usize); 5] = [(64, 5), (128, 5), (256, 3), (512, 2), (1024, 1)];

/// Pixels per axis that are checked, at most.
const LATTICE: usize = 256;

/// The image that is shown.
const PICTURE: usize = 512;

/// One way at one size, f32, LR81 with 6 (d + 1) iterations, one thread, wall clock.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SurfaceTime {
    /// The surface.
    pub letter: char,
    /// Pixels along the image.
    pub size: u64,
    /// Where the polynomials of the rays come from.
    pub how: String,
    /// Milliseconds: making the frustum form; 0 for compositions.
    pub preprocessing: f64,
    /// Milliseconds of all rays' polynomials.
    pub composition: f64,
    /// Milliseconds of all root finding.
    pub rootfind: f64,
    /// Milliseconds of the frame, preprocessing included.
    pub frame: f64,
    /// Pixels hit.
    pub hits: u64,
    /// Pixels held against certified roots; undecidable ones are left out.
    pub checked: u64,
    /// Of these, hit or not hit wrongly, or more than a pixel's width from the first root.
    pub wrong: u64,
}

/// Measures the figure, one surface after the other.
///
/// # Errors
/// When a surface cannot be drawn or checked, or a picture not be written.
pub fn measure(sizes: &[(usize, usize)], album: Album<'_>, out: &mut Figures) -> Result<()> {
    for (letter, _, _) in SURFACES {
        for &(size, repeats) in sizes {
            let all = contenders(letter, size, repeats)?;
            let truth = Certified::new(letter, size).with_context(|| format!("surface ({letter})"))?;
            for c in &all {
                out.surfaces.push(row(letter, size, c, &truth));
            }
            // The thesis's own way.
            let thesis = all.iter().find(|c| c.how == Composition::Sb1);
            if let (true, Some(c)) = (size == PICTURE || sizes.len() == 1, thesis) {
                let name = format!("figure-6.1-{letter}");
                let file = album.save(&name, &image(&view(size), &c.drawn))?;
                out.surface_pictures.push((letter, file));
            }
        }
    }
    Ok(())
}

fn row(letter: char, size: usize, c: &Contender, truth: &Certified) -> SurfaceTime {
    let ms = |d: Duration| d.as_secs_f64() * 1e3;
    let (checked, wrong) = truth.judge(&c.drawn);
    SurfaceTime {
        letter,
        size: size as u64,
        how: c.how.name().into(),
        preprocessing: ms(c.drawn.preprocessing),
        composition: ms(c.drawn.stages[3]),
        rootfind: ms(c.drawn.stages[4]),
        frame: ms(c.drawn.total()),
        hits: c.drawn.points.iter().filter(|p| p.is_finite()).count() as u64,
        checked,
        wrong,
    }
}

fn image(view: &View, drawn: &Drawn) -> Image {
    let rgba: Vec<[f32; 4]> = drawn.colours.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    Image::linear(view, &rgba)
}

/// Certified first roots between the planes, on a lattice of pixels.
struct Certified {
    view: View,
    /// Places in the image.
    pixels: Vec<usize>,
    rays: Vec<Ray>,
    truth: Truth,
}

impl Certified {
    fn new(letter: char, size: usize) -> Result<Self> {
        let (polynomial, view) = searched(letter, size)?;
        let function: Arc<dyn Function> = Arc::new(AlgebraicFunction::new(polynomial)?);
        let step = size.div_ceil(LATTICE);
        let along = || (step / 2..size).step_by(step);
        let pixels: Vec<usize> = along().flat_map(|y| along().map(move |x| y * size + x)).collect();
        let rays: Vec<Ray> = pixels.iter().map(|i| view.ray(i % size, i / size)).collect();
        let mut chosen = View::rays(rays.clone());
        chosen.clips.clone_from(&view.clips);
        let truth = Truth::compute(&function, &[Surface::isovalue(0.0, 0)], &chosen, &Stop::default())?;
        Ok(Self {
            view,
            pixels,
            rays,
            truth,
        })
    }

    /// Pixels compared, and wrong ones.
    fn judge(&self, drawn: &Drawn) -> (u64, u64) {
        let (mut checked, mut wrong) = (0, 0);
        for ((&i, ray), p) in self.pixels.iter().zip(&self.rays).zip(&self.truth.pixels) {
            if p.undecidable {
                continue;
            }
            checked += 1;
            let found = drawn.points[i];
            let right = match (found.is_finite(), p.is_hit()) {
                (true, true) => found.distance(ray.at(p.t())) <= self.view.footprint(found.distance(ray.origin)),
                (a, b) => a == b,
            };
            wrong += u64::from(!right);
        }
        (checked, wrong)
    }
}

pub(super) fn table(f: &Figures) -> Table {
    let row = |s: &SurfaceTime| {
        let mut line = vec![s.letter.to_string(), s.size.to_string(), s.how.clone()];
        line.extend([s.preprocessing, s.composition, s.rootfind, s.frame].map(|ms| format!("{ms:.4}")));
        line.extend([s.hits, s.checked, s.wrong].map(|n| n.to_string()));
        line
    };
    Table {
        name: "figure-6.1.csv",
        head: vec![
            "surface",
            "pixels_along",
            "polynomials",
            "preprocessing_ms",
            "composition_ms",
            "rootfind_ms",
            "frame_ms",
            "hits",
            "checked",
            "wrong",
        ],
        rows: f.surfaces.iter().map(row).collect(),
    }
}
