//! From index space to the pixels of a target: what the vertex stage needs, made in f64.
//!
//! Positions are counted from a whole cube near the eye (or the domain's middle, for parallel rays), so that their f32 differences are exact and the clip coordinates are off by
//! some 2^-22 of their size only, far below a sub-pixel. Clip z is half of w: nothing is cut by a near or far plane, and the depth is the fragment stage's own.

use super::layout::{PLANES, View as Uniform};
use bytemuck::Zeroable;
use glam::DVec4;
use isobar_core::{DMat3, DVec3, Domain, Lens, View};
use isobar_gpu::rays::Rectangle;

/// Radius of the sphere inside a tetrahedron, in voxels: `3 V / A = (1/8) / (1/4 + sqrt(1/8) + 2 sqrt(1/32))`.
const INRADIUS: f64 = 0.130_601_937_5;

/// By how many pixels tetrahedra grow at least: more than a vertex is moved by where the rasteriser rounds it to a sub-pixel (1/512 of a pixel as a rule, 1/32
/// at worst by Vulkan's rules).
const COVER: f64 = 1.0 / 30.0;

/// Clipping planes that interpolated rays can be cut by.
pub(super) const MOST_CLIPS: usize = PLANES - 6;

/// The uniform of some rows of a rectangle of the image. `exact`: tetrahedra grow, and rays are the pixels' own. `None` for lists of rays.
pub(super) fn uniform(view: &View, domain: &Domain, target: Rectangle, exact: bool, gradients: [[f32; 4]; 3]) -> Option<Uniform> {
    let Lens {
        eye,
        right,
        up,
        forward,
        half,
        parallel,
    } = view.lens()?;
    let a = domain.axes;
    let local = domain.local(eye);
    let middle = if parallel {
        domain.hi * 0.5
    } else {
        local.clamp(DVec3::ZERO, domain.hi)
    };
    let origin = middle.round();
    let from = domain.world(origin) - eye;
    let (w, h) = (view.width as f64, view.height as f64);
    // Clip coordinates of the whole image of a world displacement (w = 0 for parallel rays, to which a position adds 1).
    let clip = |v: DVec3| {
        let depth = if parallel { 0.0 } else { v.dot(forward) };
        DVec3::new(v.dot(right) / (half * (w / h)), v.dot(up) / half, depth)
    };
    // From there to the target.
    let (tw, th) = (target.width as f64, target.height as f64);
    let (tx, ty) = (
        w / tw - 2.0 * target.x as f64 / tw - 1.0,
        1.0 - h / th + 2.0 * target.y as f64 / th,
    );
    let moved = |c: DVec3| DVec4::new(c.x * (w / tw) + c.z * tx, c.y * (h / th) + c.z * ty, 0.5 * c.z, c.z);
    let offset = clip(from) + if parallel { DVec3::Z } else { DVec3::ZERO };
    let row = |c: DVec4| c.as_vec4().to_array();
    let index_direction = domain.local_vector(forward);
    let inverse = a.inverse();
    // Pixels per voxel at w = 1, in the direction in which a voxel is shortest.
    let shortest = 1.0 / frobenius(inverse);
    let mut planes = [[0.0; 4]; PLANES];
    let mut count = 0;
    let mut add = |n: DVec3, d: f64| {
        if count < PLANES {
            // Numbers of any size become comparable in f32.
            planes[count] = (n.extend(d) / n.length()).as_vec4().to_array();
        }
        count += 1;
    };
    for axis in DMat3::IDENTITY.to_cols_array_2d().map(DVec3::from_array) {
        add(-axis, origin.dot(axis));
        add(axis, (domain.hi - origin).dot(axis));
    }
    for c in &view.clips {
        add(a.transpose() * c.normal, c.distance - c.normal.dot(domain.world(origin)));
    }
    let far = domain.corners().iter().fold(1e-300f64, |f, c| f.max((*c - eye).length()));
    let along = a.transpose() * forward;
    Some(Uniform {
        clip: [
            row(moved(clip(a.x_axis))),
            row(moved(clip(a.y_axis))),
            row(moved(clip(a.z_axis))),
            row(moved(offset)),
        ],
        origin: [origin.x as i32, origin.y as i32, origin.z as i32],
        width: target.width as u32,
        eye: if parallel {
            index_direction.normalize()
        } else {
            local - origin
        }
        .as_vec3()
        .to_array(),
        parallel: u32::from(parallel),
        axes: a
            .to_cols_array_2d()
            .map(|c| DVec3::from_array(c).extend(0.0).as_vec4().to_array()),
        gradients,
        grow: if exact {
            (COVER / (INRADIUS * shortest * h / (2.0 * half))) as f32
        } else {
            0.0
        },
        planes: count.min(PLANES) as u32,
        depth_scale: (-far.log2().ceil() - 1.0).exp2() as f32,
        plane: planes,
        along: along.extend(forward.dot(from)).as_vec4().to_array(),
        unit: (1.0 / domain.hi.max_element()) as f32,
        // `gradients` are those of index space with a largest entry of 1.
        reach: (view.footprint(1.0) * largest(inverse)) as f32,
        ..Uniform::zeroed()
    })
}

/// The largest size of an entry.
fn largest(m: DMat3) -> f64 {
    m.to_cols_array().iter().fold(0.0, |a: f64, v| a.max(v.abs()))
}

fn frobenius(m: DMat3) -> f64 {
    m.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Camera, Grid, Samples};

    /// A point on the ray of a pixel is projected to that pixel of the target, for both kinds of rays, from outside and inside.
    #[test]
    fn points_on_rays_are_projected_to_their_pixels() {
        let samples = Samples::U8(vec![0; 8 * 9 * 10].into());
        let direction = DMat3::from_cols(DVec3::new(0.0, 0.8, 0.6), DVec3::X, DVec3::new(0.0, 0.28, 0.96));
        let grid = Grid::new(
            [8, 9, 10],
            DVec3::new(1.0, 0.5, 2.0),
            DVec3::new(5.0, -2.0, 1.0),
            direction,
            samples,
        )
        .unwrap();
        let domain = grid.domain();
        let near = View::perspective(
            domain.world(DVec3::new(3.0, 4.0, 5.0)),
            domain.world(DVec3::ZERO),
            DVec3::Z,
            70.0,
            90,
            70,
        );
        let far = View::fit(domain.world_bounds(), 40.0, 90, 70);
        let ortho = View {
            camera: Camera::Orthographic {
                eye: DVec3::new(-9.0, 5.0, 5.0),
                target: DVec3::splat(2.0),
                up: DVec3::Z,
                height: 12.0,
            },
            ..far.clone()
        };
        let target = Rectangle {
            x: 11,
            y: 7,
            width: 40,
            height: 24,
        };
        for view in [near, far, ortho] {
            let u = uniform(&view, &domain, target, true, [[0.0; 4]; 3]).unwrap();
            let origin = DVec3::from_array(u.origin.map(f64::from));
            for (x, y, t) in [(11, 7, 1.0), (50, 30, 3.0), (20, 12, 9.0)] {
                let p = domain.local(view.ray(x, y).at(t)) - origin;
                let column = |i: usize| DVec4::from_array(u.clip[i].map(f64::from));
                let c = column(0) * p.x + column(1) * p.y + column(2) * p.z + column(3);
                let px = (c.x / c.w + 1.0) * 0.5 * 40.0;
                let py = (1.0 - c.y / c.w) * 0.5 * 24.0;
                assert!(
                    (px - (x as f64 - 10.5)).abs() < 1e-4 && (py - (y as f64 - 6.5)).abs() < 1e-4,
                    "{px} {py} {x} {y}"
                );
                assert!(c.w > 0.0 && (c.z / c.w - 0.5).abs() < 1e-6);
            }
            assert!(u.grow > 0.0 && u.grow.is_finite() && u.planes == 6);
        }
        assert!(uniform(&View::rays(vec![]), &domain, target, true, [[0.0; 4]; 3]).is_none());
    }

    #[test]
    fn the_inscribed_sphere_touches_all_faces() {
        // Heights of the centre above the four faces of the canonical tetrahedron.
        let c = DVec3::new(0.369_398_06, 0.184_699_03, 0.0);
        let heights = [
            0.5 - c.x,
            (c.x - c.y) / 2f64.sqrt(),
            (c.y - c.z) / 2f64.sqrt(),
            (c.y + c.z) / 2f64.sqrt(),
        ];
        for h in heights {
            assert!((h - INRADIUS).abs() < 1e-6, "{heights:?}");
        }
    }
}
