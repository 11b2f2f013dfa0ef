//! Structures shared with `shaders/peaks_layout.wgsl`; a test compares them with what naga makes of the WGSL.

use crate::sampling::Sampler;
use crate::space::{Entry as Meets, Space, Walk, three};
use bytemuck::{Pod, Zeroable};
use isobar_core::{ClipPlane, Ray as WorldRay};
use isobar_gpu::rays::Entry;
use std::mem::offset_of;

/// `Params`: the uniform.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Params {
    pub(super) last: [f32; 3],
    pub(super) shift: f32,
    pub(super) macrocells: [i32; 3],
    pub(super) flags: u32,
    pub(super) nodes: [i32; 3],
    pub(super) law: u32,
    pub(super) bias_hi: f32,
    pub(super) bias_lo: f32,
    pub(super) least: f32,
    pub(super) width: u32,
    pub(super) peak_bins_per_value: f32,
    pub(super) peak_bins: u32,
    pub(super) medium_per_value: f32,
    pub(super) medium_bins: u32,
    pub(super) integration: u32,
    pub(super) mode: u32,
    pub(super) iterations: u32,
    pub(super) layers: u32,
    pub(super) values: u32,
    pub(super) turns: u32,
    pub(super) pass_number: u32,
    /// 0.
    pub(super) nothing: u32,
    /// Columns, each padded to four.
    pub(super) axes: [[f32; 4]; 3],
    /// Columns, each padded to four.
    pub(super) gradients: [[f32; 4]; 3],
}

/// All hits are counted.
pub(super) const COUNT_ALL: u32 = 1;
/// Colour is asked for.
pub(super) const COLOUR: u32 = 2;
/// Normals are asked for.
pub(super) const NORMALS: u32 = 4;
/// Macrocells in which nothing can be seen are passed.
pub(super) const MACROCELLS: u32 = 8;
/// Steps are lengthened by the multipliers of macrocells.
pub(super) const MULTIPLIERS: u32 = 16;
/// The medium is shaded.
pub(super) const SHADED: u32 = 32;

/// `Ray`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Ray {
    pub(super) origin: [f32; 3],
    pub(super) length: f32,
    pub(super) direction: [f32; 3],
    pub(super) first: f32,
    pub(super) step: f32,
    pub(super) growth: f32,
    pub(super) unit: f32,
    /// From one pass to the next; the first does not look at it.
    pub(super) state: u32,
    pub(super) end: f32,
    pub(super) next: f32,
    pub(super) clear: f32,
    pub(super) resume: f32,
    pub(super) block: [i32; 3],
    pub(super) unused: f32,
}

impl Ray {
    /// The kept part of a ray inside the domain, its samples counted from the last one at or before the entry; all of it worked out in f64. `length` is -1 where there is
    /// none. The entry's speed is in voxels.
    pub(super) fn new(space: &Space, sampler: &Sampler, clips: &[ClipPlane], ray: &WorldRay) -> (Self, Entry) {
        let miss = Self {
            length: -1.0,
            ..Self::default()
        };
        let Meets::Through(walk) = Walk::enter(ray, space, clips, None) else {
            return (miss, Entry::default());
        };
        let [x, y, z] = walk.d;
        let speed = (x * x + y * y + z * z).sqrt();
        let length = (walk.t1 - walk.t0) * speed;
        if !(speed > 0.0 && speed.is_finite() && length.is_finite()) {
            return (miss, Entry::default());
        }
        let steps = sampler.steps(ray.direction);
        let [first, step, growth] = steps.counted_from(steps.before(walk.t0).0);
        let geometric = steps.law() == crate::sampling::Law::Geometric && growth > 0.0;
        let new = Self {
            origin: three(|a| (walk.at(a, walk.t0).clamp(space.lo[a], space.hi[a]) - space.shift()) as f32),
            length: length as f32,
            direction: three(|a| (walk.d[a] / speed) as f32),
            first: ((first - walk.t0) * speed) as f32,
            step: (step * speed) as f32,
            growth: (if geometric { growth } else { growth * speed }) as f32,
            unit: (ray.direction.length() / speed) as f32,
            ..Self::default()
        };
        (new, Entry { t: walk.t0, speed })
    }
}

const _: () = {
    assert!(size_of::<Params>() == 208);
    assert!(offset_of!(Params, bias_hi) == 48 && offset_of!(Params, integration) == 80 && offset_of!(Params, axes) == 112);
    assert!(size_of::<Ray>() == 80 && offset_of!(Ray, direction) == 16);
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::programs;
    use isobar_gpu::{shader, wgpu::naga};

    /// Size and member offsets of a structure as naga lays it out.
    fn wgsl(name: &str) -> (u32, Vec<(String, u32)>) {
        let source = shader::compose(&[programs::SNIPPETS], &["peaks_layout"]).unwrap();
        let module = naga::front::wgsl::parse_str(&source).unwrap();
        let (_, found) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).unwrap();
        match &found.inner {
            naga::TypeInner::Struct { members, span } => {
                let members = members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect();
                (*span, members)
            }
            other => panic!("{name} is {other:?}"),
        }
    }

    macro_rules! same {
        ($t:ident { $($member:ident),* $(,)? }) => {{
            let (span, members) = wgsl(stringify!($t));
            assert_eq!(span as usize, size_of::<$t>(), stringify!($t));
            $(
                let at = members.iter().find(|(n, _)| n == stringify!($member)).map(|(_, at)| *at as usize);
                assert_eq!(at, Some(offset_of!($t, $member)), "{}.{}", stringify!($t), stringify!($member));
            )*
        }};
    }

    #[test]
    fn structures_are_laid_out_as_in_wgsl() {
        same!(Params {
            last,
            shift,
            macrocells,
            flags,
            nodes,
            law,
            bias_hi,
            bias_lo,
            least,
            width,
            peak_bins_per_value,
            peak_bins,
            medium_per_value,
            medium_bins,
            integration,
            mode,
            iterations,
            layers,
            values,
            turns,
            pass_number,
            nothing,
            axes,
            gradients
        });
        same!(Ray {
            origin,
            length,
            direction,
            first,
            step,
            growth,
            unit,
            state,
            end,
            next,
            clear,
            resume,
            block
        });
    }

    #[test]
    fn flags_are_those_of_wgsl() {
        let (_, text) = programs::SNIPPETS.iter().find(|(n, _)| *n == "peaks_layout").unwrap();
        for (name, bit) in [
            ("COUNT_ALL", COUNT_ALL),
            ("COLOUR", COLOUR),
            ("NORMALS", NORMALS),
            ("MACROCELLS", MACROCELLS),
            ("MULTIPLIERS", MULTIPLIERS),
            ("SHADED", SHADED),
        ] {
            assert!(text.contains(&format!("const {name}: u32 = {bit}u;")), "{name}");
        }
    }
}
