//! `peaks/gpu` against `peaks/cpu-paper`: the same samples, in f32 and in f64.

use super::*;
use crate::{PEAKS_CPU_PAPER, PEAKS_GPU};
use isobar_core::{Camera, ClipPlane, DMat3};
use isobar_gpu::{Gpu, test_adapter};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The shared device, for one test at a time: a test that waits for the device also runs what another one waits for.
pub(super) fn adapter(name: &str) -> Option<(Gpu, MutexGuard<'static, ()>)> {
    static ONE: Mutex<()> = Mutex::new(());
    let guard = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    test_adapter(name).map(|gpu| (gpu, guard))
}

/// A crossing on the GPU against that on the CPU, in voxels (spacing 1): positions are off by 2^-23 of the axis, and secants by what the field's rounding does to them.
const VOXELS: f64 = 1e-3;
/// Their colours.
const COLOUR: f32 = 2e-3;
/// Their normals.
const NORMAL: f32 = 1e-2;

const WIDTH: usize = 56;
const HEIGHT: usize = 42;

/// Waves, samples in one of the four types.
pub(super) fn waves(dims: [usize; 3], which: usize) -> Grid {
    let value = |i: usize| {
        let (x, y, z) = (i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]);
        ((x * y) as f64 * 0.07).sin() + (z as f64 * 0.45).cos() + 0.3 * ((x + 2 * y + 3 * z) as f64 * 0.9).sin()
    };
    let n = dims.iter().product();
    let all = |scale: f64, offset: f64| (0..n).map(move |i| value(i) * scale + offset);
    let samples = match which {
        0 => Samples::U8(all(50.0, 120.0).map(|v| v as u8).collect()),
        1 => Samples::I16(all(9000.0, 100.0).map(|v| v as i16).collect()),
        2 => Samples::U16(all(9000.0, 30_000.0).map(|v| v as u16).collect()),
        _ => Samples::F32(all(1.0, 0.0).map(|v| v as f32).collect()),
    };
    Grid::unit(dims, samples).unwrap()
}

/// Two peaks and a soft medium between them, scaled to the data.
pub(super) fn mixed(scale: f64, offset: f64) -> TransferFunction {
    let v = |x: f64| x * scale + offset;
    let points = vec![
        (v(-0.9), BLUE, 0.0),
        (v(-0.6), BLUE, 0.05),
        (v(-0.31), GREEN, 0.02),
        (v(-0.3), RED, density(0.4)),
        (v(-0.29), RED, 0.01),
        (v(0.4), GREEN, 0.06),
        (v(0.69), BLUE, 0.0),
        (v(0.7), BLUE, density(0.5)),
        (v(0.71), BLUE, 0.0),
    ];
    TransferFunction::new(points, 1.0).unwrap()
}

/// Pixels whose answers are not the same within the constants above, hits of the GPU's frame, and the greatest distance of two colours.
fn compared(gpu: &Frame, cpu: &Frame) -> (usize, u64, f32) {
    let n = cpu.width * cpu.height;
    let (mut unlike, mut hits, mut worst) = (0, 0, 0.0f32);
    for i in 0..n {
        let mut same = gpu.hits[i] == cpu.hits[i];
        for at in (0..cpu.layers).map(|l| l * n + i) {
            let apart = (0..3)
                .map(|k| (gpu.normal[at][k] - cpu.normal[at][k]).abs())
                .fold(0.0, f32::max);
            same &= gpu.surface[at] == cpu.surface[at]
                && (gpu.t[at] == cpu.t[at] || (gpu.t[at] - cpu.t[at]).abs() <= VOXELS)
                && apart <= NORMAL;
        }
        let colour = (0..4).map(|k| (gpu.rgba[i][k] - cpu.rgba[i][k]).abs()).fold(0.0, f32::max);
        same &= colour <= COLOUR;
        if same {
            worst = worst.max(colour);
        }
        unlike += usize::from(!same);
        hits += u64::from(gpu.hits[i]);
    }
    (unlike, hits, worst)
}

/// One renderer for all scenes of a test: kernels are compiled once.
struct Both(Box<dyn Renderer>);

impl Both {
    fn new() -> Self {
        Self(PEAKS_GPU.open(&request(3, &[])).unwrap())
    }

    /// [`compared`] of this scene.
    fn draw(
        &mut self,
        data: &Arc<Data>,
        surfaces: &[Surface],
        tf: Option<&TransferFunction>,
        view: &View,
        k: &[(&str, &str)],
    ) -> (usize, u64, f32) {
        self.0.set_knobs(&knobs(k)).unwrap();
        self.0.set_data(data).unwrap();
        self.0.set_surfaces(surfaces).unwrap();
        self.0.set_medium(tf).unwrap();
        let gpu = image(self.0.as_mut(), view);
        compared(&gpu, &draw(&PEAKS_CPU_PAPER, data, surfaces, tf, view, (3, k)))
    }
}

/// Each mode, law, integration, table and reconstruction. Seen: one pixel unlike in all 97 frames of this test and the next, a crossing at the end of
/// a segment that rounding puts into the other.
#[test]
fn every_pixel_is_the_cpus_for_every_setting() {
    let Some(_gpu) = adapter("every_pixel_is_the_cpus_for_every_setting") else {
        return;
    };
    let mut both = Both::new();
    let data = Arc::new(Data::Grid(waves([26, 22, 24], 3)));
    let tf = mixed(1.0, 0.0);
    let surfaces = [Surface {
        opacity: 0.4,
        ..Surface::isovalue(0.15, 2)
    }];
    let view = View::fit(data.bounds(), 40.0, WIDTH, HEIGHT);
    for k in [
        &[][..],
        &[("mode", "peak_xor_dvr")],
        &[("mode", "peak_only"), ("sampling", "printed")],
        &[("mode", "dvr_only"), ("integration", "engel")],
        &[("sampling", "printed"), ("shading", "on")],
        &[("sampling", "printed"), ("multiplier", "on")],
        &[("sampling", "geometric")],
        &[("sampling", "geometric"), ("multiplier", "on"), ("reconstruction", "cubic")],
        &[
            ("sampling", "uniform"),
            ("step", "0.7"),
            ("integration", "lum"),
            ("shading", "on"),
        ],
        &[("integration", "engel"), ("shading", "on"), ("preintegration", "64")],
        &[("multiplier", "on"), ("sk", "1")],
        &[("macrocells", "off"), ("iterations", "1")],
        &[("table", "printed"), ("bins", "16"), ("peaks", "1")],
        &[("reconstruction", "quadratic")],
        &[("reconstruction", "cubic"), ("sk", "2")],
        &[("reconstruction", "cubic-interpolating"), ("integration", "lum")],
        &[("reconstruction", "bc21"), ("shading", "on")],
    ] {
        let (unlike, hits, worst) = both.draw(&data, &surfaces, Some(&tf), &view, k);
        let peaks = !k.contains(&("mode", "dvr_only"));
        assert!(!peaks || hits > 1500, "{k:?}: {hits}");
        assert!(
            unlike <= 2,
            "{k:?}: {unlike} of {} pixels, the others within {worst}",
            WIDTH * HEIGHT
        );
    }
}

/// Every sample type, odd sizes, skew axes; the eye inside; parallel rays; lists of rays; open cuts; no transfer function.
#[test]
fn every_pixel_is_the_cpus_for_every_input() {
    let Some(_gpu) = adapter("every_pixel_is_the_cpus_for_every_input") else {
        return;
    };
    let mut both = Both::new();
    let skew = |g: Grid| {
        let direction = DMat3::from_cols(
            DVec3::new(0.0, 1.0, 0.0),
            DVec3::new(-0.6, 0.0, 0.8),
            DVec3::new(1.0, 0.0, 0.0),
        );
        Grid::new(
            g.dims,
            DVec3::new(1.0, 0.8, 1.2),
            DVec3::new(3.0, -2.0, 5.0),
            direction,
            g.samples,
        )
        .unwrap()
    };
    let scenes = [
        (waves([7, 21, 18], 0), 50.0, 120.0),
        (skew(waves([17, 20, 11], 1)), 9000.0, 100.0),
        (waves([20, 2, 33], 2), 9000.0, 30_000.0),
        (skew(waves([2, 2, 2], 3)), 1.0, 0.0),
    ];
    for (grid, scale, offset) in scenes {
        let data = Arc::new(Data::Grid(grid));
        let (lo, hi) = data.bounds();
        let middle = 0.5 * (lo + hi);
        let tf = mixed(scale, offset);
        let fit = View::fit(data.bounds(), 40.0, WIDTH, HEIGHT);
        let inside = View::perspective(middle, hi + 0.3, DVec3::Y, 70.0, WIDTH, HEIGHT);
        let parallel = View {
            camera: Camera::Orthographic {
                eye: lo - 3.0,
                target: middle,
                up: DVec3::Y,
                height: (hi - lo).length(),
            },
            ..fit.clone()
        };
        let mut cut = fit.clone();
        cut.clips.push(ClipPlane {
            normal: DVec3::new(0.6, 0.8, 0.0),
            distance: DVec3::new(0.6, 0.8, 0.0).dot(middle),
            cap: false,
        });
        let rays = View::rays((0..200).map(|i| fit.ray(i * 7 % WIDTH, i % HEIGHT)).collect::<Vec<_>>());
        for (name, view) in [
            ("fit", fit),
            ("inside", inside),
            ("parallel", parallel),
            ("cut", cut),
            ("rays", rays),
        ] {
            for k in [
                &[("sampling", "differential")][..],
                &[("sampling", "geometric"), ("reconstruction", "cubic")],
            ] {
                let (unlike, _, worst) = both.draw(&data, &[], Some(&tf), &view, k);
                assert!(
                    unlike <= 2,
                    "{:?} {name} {k:?}: {unlike} unlike, the others within {worst}",
                    data.bounds()
                );
                let surfaces = [Surface::isovalue(0.2 * scale + offset, 0)];
                let (unlike, _, _) = both.draw(&data, &surfaces, None, &view, k);
                assert!(unlike <= 2, "{:?} {name} {k:?}, isovalue: {unlike} unlike", data.bounds());
            }
        }
    }
}
