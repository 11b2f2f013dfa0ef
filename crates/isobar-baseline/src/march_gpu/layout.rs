//! Structures shared with `shaders/march_layout.wgsl`; a test compares them with what naga makes of the WGSL.

use bytemuck::{Pod, Zeroable};
use isobar_core::DVec3;
use isobar_gpu::rays::{Entry, ToIndex};
use std::mem::offset_of;

/// `Params`: one uniform for all kernels.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Params {
    pub(super) last: [f32; 3],
    pub(super) step: f32,
    pub(super) bias_hi: f32,
    pub(super) bias_lo: f32,
    pub(super) fractions: f32,
    pub(super) bisections: u32,
    pub(super) fine: [u32; 3],
    pub(super) fine_side: u32,
    pub(super) coarse: [u32; 3],
    pub(super) coarse_side: u32,
    pub(super) levels: u32,
    pub(super) layers: u32,
    pub(super) flags: u32,
    pub(super) pad: u32,
    pub(super) width: u32,
    pub(super) unused: [u32; 3],
    /// Columns, each padded to four.
    pub(super) axes: [[f32; 4]; 3],
    /// Columns, each padded to four.
    pub(super) gradients: [[f32; 4]; 3],
}

/// Bits of [`Params::flags`].
pub(super) const SKIP: u32 = 1;
/// All hits are counted: the search goes on to the exit.
pub(super) const COUNT_ALL: u32 = 2;
/// Colour is asked for.
pub(super) const COLOUR: u32 = 4;
/// Normals are asked for.
pub(super) const NORMALS: u32 = 8;

/// `Ray`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Ray {
    pub(super) origin: [f32; 3],
    pub(super) length: f32,
    pub(super) direction: [f32; 3],
    pub(super) unused: f32,
}

impl Ray {
    /// The part of a ray inside the domain and in the `kept` part of it; `length` is -1 where there is none. Its entry is in voxels.
    pub(super) fn new(to: &ToIndex, ray: &isobar_core::Ray, kept: Option<(f64, f64)>) -> (Self, Entry) {
        let Some(p) = to.part(ray, kept) else {
            let miss = Self {
                length: -1.0,
                ..Self::default()
            };
            return (miss, Entry::default());
        };
        let speed = p.direction.length();
        let entry = (p.origin + p.direction * p.t0).clamp(DVec3::ZERO, to.domain().hi);
        let new = Self {
            origin: entry.as_vec3().to_array(),
            length: ((p.t1 - p.t0) * speed) as f32,
            direction: (p.direction / speed).as_vec3().to_array(),
            unused: 0.0,
        };
        (new, Entry { t: p.t0, speed })
    }
}

const _: () = {
    assert!(size_of::<Params>() == 192);
    assert!(offset_of!(Params, step) == 12 && offset_of!(Params, bisections) == 28);
    assert!(offset_of!(Params, fine) == 32 && offset_of!(Params, coarse) == 48);
    assert!(offset_of!(Params, levels) == 64 && offset_of!(Params, width) == 80);
    assert!(offset_of!(Params, axes) == 96 && offset_of!(Params, gradients) == 144);
    assert!(size_of::<Ray>() == 32 && offset_of!(Ray, length) == 12 && offset_of!(Ray, direction) == 16);
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::march_gpu::programs;
    use isobar_core::{DMat3, Domain, Grid, Ray as WorldRay, Samples};
    use isobar_gpu::testing::assert_bits;
    use isobar_gpu::{assert_laid_out, shader};

    #[test]
    fn structures_are_laid_out_as_in_wgsl() {
        let source = &shader::compose(&[programs::SNIPPETS], &["march_layout"]).unwrap();
        assert_laid_out!(
            source,
            Params {
                last,
                step,
                bias_hi,
                bias_lo,
                fractions,
                bisections,
                fine,
                fine_side,
                coarse,
                coarse_side,
                levels,
                layers,
                flags,
                pad,
                width,
                axes,
                gradients
            }
        );
        assert_laid_out!(
            source,
            Ray {
                origin,
                length,
                direction
            }
        );
    }

    #[test]
    fn flags_are_those_of_wgsl() {
        let (_, text) = programs::SNIPPETS.iter().find(|(n, _)| *n == "march_layout").unwrap();
        let bits = [
            ("SKIP", SKIP),
            ("COUNT_ALL", COUNT_ALL),
            ("COLOUR", COLOUR),
            ("NORMALS", NORMALS),
        ];
        assert_bits(text, &bits);
    }

    const EVERYWHERE: Option<(f64, f64)> = Some((0.0, f64::INFINITY));

    fn domain(direction: DMat3, spacing: DVec3) -> Domain {
        let samples = Samples::U8(vec![0; 5 * 6 * 7].into());
        Grid::new([5, 6, 7], spacing, DVec3::new(1.0, -2.0, 0.5), direction, samples)
            .unwrap()
            .domain()
    }

    #[test]
    fn rays_start_at_their_entry_and_end_at_their_exit() {
        let skew = DMat3::from_cols(
            DVec3::new(0.0, 1.0, 0.0),
            DVec3::new(-0.6, 0.0, 0.8),
            DVec3::new(1.0, 0.0, 0.0),
        );
        for d in [
            domain(DMat3::IDENTITY, DVec3::new(0.5, 2.0, 1e-3)),
            domain(skew, DVec3::new(0.5, 1.0, 3.0)),
        ] {
            let to = ToIndex::new(&d, false);
            let (from, at) = (d.world(DVec3::new(-3.0, 2.0, 9.0)), d.world(DVec3::new(2.0, 2.5, 3.0)));
            let r = WorldRay {
                origin: from,
                direction: (at - from) * 0.25,
            };
            let (ray, entry) = Ray::new(&to, &r, EVERYWHERE);
            let u = |t: f64| d.local(r.at(t));
            let start = u(entry.t);
            let stop = u(entry.t + f64::from(ray.length) / entry.speed);
            assert!(
                (start - DVec3::from_array(ray.origin.map(f64::from))).length() < 1e-5,
                "{start} {ray:?}"
            );
            for p in [start, stop] {
                let faces = (0..3).filter(|&a| p[a].abs() < 1e-5 || (p[a] - d.hi[a]).abs() < 1e-5).count();
                assert!(
                    faces >= 1 && p.cmpgt(DVec3::splat(-1e-5)).all() && p.cmplt(d.hi + 1e-5).all(),
                    "{p}"
                );
            }
            let unit = DVec3::from_array(ray.direction.map(f64::from)).length();
            assert!((unit - 1.0).abs() < 1e-6);
            // World direction back from the index direction.
            let world = to
                .axes()
                .map(|c| DVec3::new(f64::from(c[0]), f64::from(c[1]), f64::from(c[2])));
            let back = DMat3::from_cols(world[0], world[1], world[2]) * DVec3::from_array(ray.direction.map(f64::from));
            assert!(back.normalize().dot(r.direction.normalize()) > 1.0 - 1e-6);
        }
    }

    #[test]
    fn rays_past_the_domain_miss_and_from_inside_start_at_zero() {
        let to = ToIndex::new(&domain(DMat3::IDENTITY, DVec3::ONE), false);
        let ray = |o: [f64; 3], d: [f64; 3]| {
            let r = WorldRay {
                origin: DVec3::from(o),
                direction: DVec3::from(d),
            };
            Ray::new(&to, &r, EVERYWHERE)
        };
        assert_eq!(ray([0.0, 5.0, 0.0], [1.0, 0.0, 0.0]).0.length, -1.0);
        assert_eq!(ray([9.0, 0.0, 1.0], [1.0, 0.0, 0.0]).0.length, -1.0);
        let (r, e) = ray([2.0, 0.0, 1.5], [2.0, 0.0, 0.0]);
        assert_eq!((r.origin, r.length, r.direction), ([1.0, 2.0, 1.0], 3.0, [1.0, 0.0, 0.0]));
        assert_eq!(e, Entry { t: 0.0, speed: 2.0 });
    }
}
