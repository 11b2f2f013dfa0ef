//! Table 1 of the paper on our data, as a Markdown table: `cargo run --release -p isobar-nurbs --example nurbs_table -- [CLASS|all] [VIEWS] [FORMS] [PIXELS]`.
//!
//! Without arguments: seven classes (cylinder, bimba, teardrop, vishuman, silicium, torso, cfd), 512x512, a turn about z in 36 views, all hits, 2 threads, `nurbs/cpu`: under six minutes on two idle cores. A class stops its turn after
//! 40 seconds of drawing; the column "views" says how far it came. The distance of the camera is chosen (at 192x192) so that the mean number of hits per frame reaches the paper's column, scaled by the number of pixels;
//! bimba and cfd have two isovalues, because one has fewer hits from any distance.
//! FORMS: words separated by commas, of `corrected` (`nurbs/cpu`) and obb, aabb, pca, knots (`nurbs/cpu-paper` with that bounding volume, or obb with knot insertion); data are $ISOBAR_DATA or shared/data.
//!
//! `silhouettes [PIXELS]` counts subdivisions per pixel of the teardrop: on folds (pixels whose number of hits is two more or less than a neighbour's), on edges (one), on other pixels with hits, and per frame; for the
//! table's teardrop and for one stretched fourfold along an oblique direction.

mod common;

use common::{CLASSES, Class, turn};
use isobar_core::{Channels, Data, Frame, Knobs, Method, RenderError, Request, Stop, Surface, View};
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

/// Surfaces that light passes through, so that all hits are wanted.
fn lucid(isovalues: &[f64]) -> Vec<Surface> {
    let one = |(n, &c): (usize, &f64)| Surface {
        opacity: 0.5,
        ..Surface::isovalue(c, n)
    };
    isovalues.iter().enumerate().map(one).collect()
}

/// What one method does with a class.
struct Scene {
    renderer: Box<dyn isobar_core::Renderer>,
    data: Arc<Data>,
}

/// Of one frame: wall and CPU seconds, counters.
type Drawn = (f64, f64, Vec<(&'static str, u64)>);

impl Scene {
    fn open(method: &dyn Method, knobs: Knobs, data: &Arc<Data>, isovalues: &[f64]) -> Result<Self, RenderError> {
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
        renderer.set_surfaces(&lucid(isovalues))?;
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
        return silhouettes(argument(2, "512").parse::<usize>()?.max(16));
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

/// The rows of a class.
fn rows(class: &Class, views: usize, forms: &str, pixels: usize) -> Result<(), Failure> {
    let (data, isovalue) = (class.make)()?;
    let (data, isovalues) = (Arc::new(data), [&[isovalue], class.more].concat());
    // What grids are made of: a tri-cubic spline through the samples, as the paper's volumes.
    let cubic = Knobs::default().with("reconstruction", "cubic-interpolating");
    let mut ours = Scene::open(&isobar_nurbs::NURBS_CPU, cubic.clone(), &data, &isovalues)?;
    let distance = distance(class, &mut ours)?;
    for form in forms.split(',') {
        if form == "corrected" {
            row(class, form, &mut ours, views, distance, pixels)?;
            continue;
        }
        let knobs = match form {
            "knots" => cubic.clone().with("subdivision", "knots"),
            bounds => cubic.clone().with("bounds", bounds),
        };
        let mut scene = Scene::open(&isobar_nurbs::NURBS_CPU_PAPER, knobs, &data, &isovalues)?;
        row(class, form, &mut scene, views, distance, pixels)?;
    }
    Ok(())
}

/// The distance of the camera at which a class has the paper's hits per frame, by bisection on four views; nearer than that the eye leaves parts of the surface behind.
fn distance(class: &Class, ours: &mut Scene) -> Result<f64, Failure> {
    let (mut near, mut far) = (0.8f64, 12.0f64);
    let part = (SMALL as f64 / 512.0).powi(2);
    for _ in 0..8 {
        let middle = (near * far).sqrt();
        let mut hits = 0.0;
        for k in 0..4 {
            hits += counter(&ours.draw(0.03 + f64::from(k) * 0.25, middle, SMALL)?.2, "hits") / 4.0;
        }
        if hits > class.hits * part {
            near = middle
        } else {
            far = middle
        }
    }
    Ok((near * far).sqrt())
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

/// A frame of the teardrop with counts of hits and of work.
fn counted(method: &dyn Method, knobs: Knobs, data: &Arc<Data>, isovalue: f64, view: &View) -> Result<Frame, RenderError> {
    let request = Request {
        channels: Channels::HITS | Channels::WORK | Channels::T,
        layers: 4,
        threads: 2,
        knobs,
        ..Request::default()
    };
    let mut r = method.open(&request)?;
    r.set_data(data)?;
    r.set_surfaces(&lucid(&[isovalue]))?;
    r.set_view(view)?;
    r.render(&Stop::default())?;
    let mut f = Frame::default();
    r.read(&mut f)?;
    Ok(f)
}

/// Subdivisions per pixel of the teardrop as it is in the table, and stretched fourfold ("stretched and perturbed", section 6), on the same pixels for all bounding volumes.
fn silhouettes(pixels: usize) -> Result<(), Failure> {
    let class = CLASSES.iter().find(|c| c.name == "teardrop").ok_or("no teardrop")?;
    for factor in [1.0, 4.0] {
        println!("Stretched by {factor}:\n");
        volumes(class, common::stretched_teardrop(factor)?, pixels)?;
    }
    Ok(())
}

/// One of them with three bounding volumes.
fn volumes(class: &Class, (data, isovalue): (Data, f64), pixels: usize) -> Result<(), Failure> {
    let data = Arc::new(data);
    let distance = distance(
        class,
        &mut Scene::open(&isobar_nurbs::NURBS_CPU, Knobs::default(), &data, &[isovalue])?,
    )?;
    let view = turn(&data, 0.12, distance, pixels);
    let exact = counted(&isobar_nurbs::NURBS_CPU, Knobs::default(), &data, isovalue, &view)?;
    // A fold of the surface changes the number of hits by two, the end of the surface at the domain's boundary by one.
    let at = |x: usize, y: usize| i32::from(exact.hits[y * pixels + x]);
    let changes = |x: usize, y: usize| {
        let beside = [at(x - 1, y), at(x + 1, y), at(x, y - 1), at(x, y + 1)];
        beside.map(|n| (n - at(x, y)).abs())
    };
    let mut kinds: [Vec<usize>; 3] = std::array::from_fn(|_| Vec::new());
    for y in 1..pixels - 1 {
        for x in 1..pixels - 1 {
            let d = changes(x, y);
            let kind = if d.iter().any(|d| d % 2 == 1) {
                1
            } else if d.iter().any(|&d| d > 0) {
                0
            } else if at(x, y) > 0 {
                2
            } else {
                continue;
            };
            kinds[kind].push(y * pixels + x);
        }
    }
    println!(
        "{pixels}x{pixels} pixels, {distance:.2} half diagonals away\n\n| pixels | bounds | number | subdivisions: mean | median | 90 % | 99 % | most |\n|---|---|---|---|---|---|---|---|"
    );
    let mut per = Vec::new();
    for bounds in ["obb", "aabb", "pca"] {
        let knobs = Knobs::default().with("bounds", bounds);
        let f = counted(&isobar_nurbs::NURBS_CPU_PAPER, knobs, &data, isovalue, &view)?;
        let mut means = Vec::new();
        for (name, list) in ["folds", "edges of the surface", "other pixels with hits"].iter().zip(&kinds) {
            let mut own: Vec<u32> = list.iter().map(|&i| f.work[i]).collect();
            own.sort_unstable();
            let rank = |q: f64| own[((own.len() - 1) as f64 * q) as usize];
            let mean = own.iter().map(|&w| f64::from(w)).sum::<f64>() / own.len().max(1) as f64;
            println!(
                "| {name} | {bounds} | {} | {mean:.1} | {} | {} | {} | {} |",
                own.len(),
                rank(0.5),
                rank(0.9),
                rank(0.99),
                rank(1.0)
            );
            means.extend([mean, f64::from(rank(1.0))]);
        }
        let all: u64 = f.work.iter().map(|&w| u64::from(w)).sum();
        let hits: u64 = f.hits.iter().map(|&n| u64::from(n)).sum();
        println!(
            "| whole frame | {bounds} | {hits} hits | {:.2} a hit | | | | {all} in all |",
            all as f64 / hits as f64
        );
        means.push(all as f64);
        per.push(means);
    }
    let by: Vec<String> = [0, 1, 6]
        .iter()
        .map(|&i: &usize| format!("{:.2}", per[1][i] / per[0][i]))
        .collect();
    println!(
        "\nAABB against OBB, times: on folds mean {} (paper 270 / 35 = 7.7), most {} (380 / 68 = 5.6); per frame {} (2.7)\n",
        by[0], by[1], by[2]
    );
    Ok(())
}
