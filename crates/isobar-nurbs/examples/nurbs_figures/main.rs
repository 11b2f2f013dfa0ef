//! Figures of Martin, Cohen and Kirby with our data: `cargo run --release -p isobar-nurbs --example nurbs_figures -- FOLDER [NAME]` writes PNG files and prints what each took. Data: $ISOBAR_DATA, else shared/data.
//!
//! | name | panels |
//! |---|---|
//! | 1c | the deformed triquintic teardrop |
//! | 2 | the same by marching tetrahedra (300,000), by `nurbs/cpu`, and the attribute on the isoparametric surface u = 1/2 |
//! | 3 | silicium at 130: marching tetrahedra on the samples' cells, the tri-cubic spline direct |
//! | 6 | cylinder: Newton's method on the inverse map with its black pixels in red, `nurbs/cpu` |
//! | 8 | a ball in squares of pixels: type 1 blue, type 2 green, type 3 gold (COVERED, the ray misses) |
//! | 9 | the teardrop's element and a ray; its faces in the space of (alpha, beta, gamma), with the origin |
//! | 10 | the list L of that pixel at level 5, as boxes of parameters: axis-aligned, oriented |
//! | 11 | oriented boxes about one root, levels 0 to 6, in the space of (alpha, beta, gamma) |
//! | 12 | the bent 132^3 grid with three isovalues; the flow of laghos_q2 refined |
//! | 13 | the attribute along a ray: all roots Newton's method gave (gold), those the filter leaves (red) |
//! | 14 | subdivisions per pixel of the teardrop, axis-aligned and oriented |
//! | type3 | a sphere smaller than a pixel's neighbours see: centres, frusta by COVERED, silhouettes of the paper's form |
//! | transparency | two isosurfaces and the boundary of the cylinder |
//! | cell | the Bezier cell (2, 0, 0) with coefficients 0, 1.5, 0 at 0.9 (nothing) and at 0.7 |

#[path = "../common/mod.rs"]
mod common;
mod draw;
mod scenes;
mod spaces;
#[path = "../comparators/tets.rs"]
mod tets;

use draw::Failure;
use isobar_core::{HexPatches, View};
use std::path::Path;
use std::time::Instant;

/// What the marching tetrahedra take.
pub(crate) struct Scene {
    pub(crate) patches: HexPatches,
    pub(crate) isovalue: f64,
    pub(crate) view: View,
}

type Figure = fn(&Path) -> Result<(), Failure>;

fn main() -> Result<(), Failure> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(args.first().ok_or("nurbs_figures FOLDER [name]")?);
    std::fs::create_dir_all(folder)?;
    let all: [(&str, Figure); 14] = [
        ("1c", scenes::one),
        ("2", scenes::two),
        ("3", scenes::three),
        ("6", scenes::six),
        ("8", scenes::eight),
        ("9", spaces::nine),
        ("10", spaces::ten),
        ("11", spaces::eleven),
        ("12", scenes::twelve),
        ("13", spaces::thirteen),
        ("14", scenes::fourteen),
        ("type3", scenes::type3),
        ("transparency", scenes::transparency),
        ("cell", scenes::cell),
    ];
    for (name, figure) in all {
        if args.get(1).is_none_or(|n| n == name) {
            let start = Instant::now();
            if let Err(e) = figure(&folder.join(format!("figure-{name}.png"))) {
                println!("figure {name}: {e}");
            }
            println!("  {:.1} s", start.elapsed().as_secs_f64());
        }
    }
    Ok(())
}
