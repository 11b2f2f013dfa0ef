//! Table 1 of the paper on our data, as a Markdown table: `cargo run --release -p isobar-nurbs --example table -- [CLASS|all] [VIEWS] [FORMS] [PIXELS]`.
//!
//! Without arguments: seven classes (cylinder, bimba, teardrop, vishuman, silicium, torso, cfd), 512x512, a turn about z in 36 views, all hits, 2 threads, `nurbs/cpu`: under six minutes on two idle cores. A class stops its turn after
//! 40 seconds of drawing; the column "views" says how far it came. The distance of the camera is chosen (at 192x192) so that the mean number of hits per frame reaches the paper's column, scaled by the number of pixels.
//! FORMS: words separated by commas, of `corrected` (`nurbs/cpu`) and obb, aabb, pca, knots (`nurbs/cpu-paper` with that bounding volume, or obb with knot insertion); data are $ISOBAR_DATA or shared/data.
//!
//! `silhouettes` in place of CLASS counts subdivisions per pixel of the teardrop: on its silhouette (pixels whose number of hits is not that of all four neighbours) and per frame.

mod common;

use common::{CLASSES, Class, turn};
use isobar_core::{Channels, Data, Frame, Knobs, Method, RenderError, Request, Stage, Stop, Surface};
use isobar_fields::{Kind, spline_to_hexes_where};
use rustix::time::{ClockId, clock_gettime};
use std::sync::Arc;

/// Seconds of drawing after which a class ends its turn.
const ENOUGH: f64 = 40.0;
/// Pixels across while the distance is sought.
const SMALL: usize = 192;

type Failure = Box<dyn std::error::Error>;

fn cpu_seconds() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}

/// What one method does with a class.
struct Scene {
    renderer: Box<dyn isobar_core::Renderer>,
    data: Arc<Data>,
}

/// Of one frame: wall and CPU seconds, counters.
type Drawn = (f64, f64, Vec<(&'static str, u64)>);

impl Scene {
    fn open(method: &dyn Method, knobs: Knobs, data: &Arc<Data>, isovalue: f64) -> Result<Self, RenderError> {
        let request = Request {
            channels: Channels::T
                | Channels::NORMAL
                | Channels::SURFACE
                | Channels::RGBA
                | Channels::HITS
                | Channels::CLAIM
                | Channels::T_ERROR,
            layers: 4,
            threads: 2,
            knobs,
            ..Request::default()
        };
        let mut renderer = method.open(&request)?;
        renderer.set_data(data)?;
        renderer.set_surfaces(&[Surface {
            opacity: 0.5,
            ..Surface::isovalue(isovalue, 0)
        }])?;
        Ok(Self {
            renderer,
            data: Arc::clone(data),
        })
    }

    fn draw(&mut self, n: f64, distance: f64, pixels: usize) -> Result<Drawn, RenderError> {
        self.renderer.set_view(&turn(&self.data, n, distance, pixels))?;
        let start = cpu_seconds();
        let time = self.renderer.render(&Stop::default())?;
        Ok((time.wall.as_secs_f64(), cpu_seconds() - start, self.renderer.counters().0))
    }
}

fn counter(list: &[(&'static str, u64)], name: &str) -> f64 {
    list.iter().find(|c| c.0 == name).map_or(0.0, |c| c.1 as f64)
}

fn main() -> Result<(), Failure> {
    let argument = |n: usize, default: &str| std::env::args().nth(n).unwrap_or_else(|| default.into());
    let (which, views, forms, pixels) = (
        argument(1, "all"),
        argument(2, "36").parse::<usize>()?.max(1),
        argument(3, "corrected"),
        argument(4, "512").parse::<usize>()?.max(16),
    );
    if which == "silhouettes" {
        return silhouettes(pixels);
    }
    println!(
        "| class | form | views | hits per frame (paper, scaled) | wall s | CPU s | paper s (OBB, 32 cores) | subdivisions per hit (paper OBB / AABB) | polynomials per hit | list size mean/deviation (paper OBB, AABB) | longest list | scratch MB |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    for class in CLASSES.iter().filter(|c| which == "all" || c.name == which) {
        if let Err(e) = rows(class, views, &forms, pixels) {
            println!("{}: {e}", class.name);
        }
    }
    Ok(())
}

/// The data of a class as the paper's form can take them: of a grid the cells that may reach the isovalue.
fn for_paper(data: &Arc<Data>, isovalue: f64) -> Result<Arc<Data>, Failure> {
    let Data::Grid(g) = &**data else { return Ok(Arc::clone(data)) };
    let reaches = |c: &[f64]| {
        let (lo, hi) = c.iter().fold((f64::MAX, f64::MIN), |(a, b), &x| (a.min(x), b.max(x)));
        lo <= isovalue && isovalue <= hi
    };
    let cells = spline_to_hexes_where(g, Kind::CubicInterpolating, Stage::Stored, reaches)?;
    Ok(Arc::new(Data::Hexes(cells)))
}

/// The rows of a class.
fn rows(class: &Class, views: usize, forms: &str, pixels: usize) -> Result<(), Failure> {
    let (data, isovalue) = (class.make)()?;
    let data = Arc::new(data);
    // What grids are made of: a tri-cubic spline through the samples, as the paper's volumes.
    let cubic = Knobs::default().with("reconstruction", "cubic-interpolating");
    let mut ours = Scene::open(&isobar_nurbs::NURBS_CPU, cubic.clone(), &data, isovalue)?;
    // The distance by bisection, on four views; nearer than that the eye leaves parts of the surface behind.
    let (mut near, mut far) = (0.8f64, 12.0f64);
    let part = |n: usize| (n as f64 / 512.0).powi(2);
    for _ in 0..8 {
        let middle = (near * far).sqrt();
        let mut hits = 0.0;
        for k in 0..4 {
            hits += counter(&ours.draw(0.03 + f64::from(k) * 0.25, middle, SMALL)?.2, "hits") / 4.0;
        }
        if hits > class.hits * part(SMALL) {
            near = middle
        } else {
            far = middle
        }
    }
    let distance = (near * far).sqrt();
    for form in forms.split(',') {
        if form == "corrected" {
            row(class, form, &mut ours, views, distance, pixels)?;
            continue;
        }
        let knobs = match form {
            "knots" => cubic.clone().with("subdivision", "knots"),
            bounds => cubic.clone().with("bounds", bounds),
        };
        let own = for_paper(&data, isovalue)?;
        let mut scene = Scene::open(&isobar_nurbs::NURBS_CPU_PAPER, knobs, &own, isovalue)?;
        // The turn is about the whole data.
        scene.data = Arc::clone(&data);
        row(class, form, &mut scene, views, distance, pixels)?;
    }
    Ok(())
}

/// One row of the table.
fn row(class: &Class, form: &str, scene: &mut Scene, views: usize, distance: f64, pixels: usize) -> Result<(), Failure> {
    let (mut wall, mut cpu, mut drawn) = (0.0, 0.0, 0.0);
    let (mut sums, mut most) = (Vec::<(&'static str, u64)>::new(), 0.0f64);
    let mut octants = 0.0f64;
    while (drawn as usize) < views && wall < ENOUGH {
        // Every order of the views is a turn: steps of the golden section cover it evenly, wherever it ends.
        let (w, c, counters) = scene.draw(drawn * 0.618_033_988_749_895 % 1.0, distance, pixels)?;
        (wall, cpu, drawn) = (wall + w, cpu + c, drawn + 1.0);
        most = most.max(counter(&counters, "longest list"));
        octants = octants.max(counter(&counters, "bytes of octants"));
        if sums.is_empty() {
            sums = counters;
        } else {
            sums.iter_mut().zip(counters).for_each(|(a, b)| a.1 += b.1);
        }
    }
    let hits = counter(&sums, "hits");
    let (lists, sizes) = (counter(&sums, "lists"), counter(&sums, "list entries"));
    let list = if lists > 0.0 {
        let mean = sizes / lists;
        let deviation = (counter(&sums, "squares of list sizes") / lists - mean * mean)
            .max(0.0)
            .sqrt();
        format!("{mean:.2}/{deviation:.2} ({}, {})", class.lists[0], class.lists[1])
    } else {
        String::new()
    };
    let scratch = scene.renderer.memory().view as f64 + octants;
    println!(
        "| {} | {form} | {drawn} | {:.0} ({:.0}) | {:.3} | {:.3} | {:.2} | {:.2} ({:.1} / {:.1}) | {:.2} | {list} | {most} | {:.2} |",
        class.name,
        hits / drawn,
        class.hits * (pixels as f64 / 512.0).powi(2),
        wall / drawn,
        cpu / drawn,
        class.seconds,
        counter(&sums, "subdivisions") / hits,
        class.subdivisions / class.hits,
        class.aabb / class.hits,
        counter(&sums, "polynomials") / hits,
        scratch / 1e6,
    );
    Ok(())
}

/// Subdivisions per pixel of the teardrop.
fn silhouettes(pixels: usize) -> Result<(), Failure> {
    let (data, isovalue) = common::teardrop()?;
    let (data, mut per) = (Arc::new(data), Vec::new());
    println!(
        "| bounds | silhouette pixels | subdivisions there, mean / most | pixels with hits elsewhere | mean there | per frame |\n|---|---|---|---|---|---|"
    );
    for bounds in ["obb", "aabb", "pca"] {
        let request = Request {
            channels: Channels::HITS | Channels::WORK | Channels::T,
            layers: 4,
            threads: 2,
            knobs: Knobs::default().with("bounds", bounds),
            ..Request::default()
        };
        let mut r = isobar_nurbs::NURBS_CPU_PAPER.open(&request)?;
        r.set_data(&data)?;
        r.set_surfaces(&[Surface {
            opacity: 0.5,
            ..Surface::isovalue(isovalue, 0)
        }])?;
        r.set_view(&turn(&data, 0.12, 1.9, pixels))?;
        r.render(&Stop::default())?;
        let mut f = Frame::default();
        r.read(&mut f)?;
        let at = |x: usize, y: usize| f.hits[y * pixels + x];
        let (mut edge, mut rest, mut most, mut all) = ((0u64, 0u64), (0u64, 0u64), 0, 0u64);
        for y in 1..pixels - 1 {
            for x in 1..pixels - 1 {
                let (own, work) = (at(x, y), f.work[y * pixels + x]);
                all += u64::from(work);
                if [at(x - 1, y), at(x + 1, y), at(x, y - 1), at(x, y + 1)]
                    .iter()
                    .any(|&n| n != own)
                {
                    edge = (edge.0 + 1, edge.1 + u64::from(work));
                    most = most.max(work);
                } else if own > 0 {
                    rest = (rest.0 + 1, rest.1 + u64::from(work));
                }
            }
        }
        let mean = |(n, sum): (u64, u64)| sum as f64 / n.max(1) as f64;
        println!(
            "| {bounds} | {} | {:.1} / {most} | {} | {:.1} | {all} |",
            edge.0,
            mean(edge),
            rest.0,
            mean(rest)
        );
        per.push((mean(edge), all as f64));
    }
    println!(
        "\nAABB against OBB: {:.2} times on the silhouette (paper 270 / 35 = 7.7), {:.2} per frame (2.7)",
        per[1].0 / per[0].0,
        per[1].1 / per[0].1
    );
    Ok(())
}
