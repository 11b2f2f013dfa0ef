//! WGSL of the three passes of a bank, written out: every slot of a window and every output is a name of its own (S19).

use crate::wavelet::banks::{REACH, Synthesis};
use crate::wavelet::{Bank, CHUNK, Mirror};
use std::fmt::Write as _;

/// The axis of a pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Axis {
    /// Algorithm 2: gathers the low pass from the coarser level, and details of active chunks.
    Z,
    /// Algorithm 3.
    Y,
    /// Algorithm 3.
    X,
}

impl Axis {
    /// In the order of the passes.
    pub(super) const ALL: [Self; 3] = [Self::Z, Self::Y, Self::X];
}

const COMMON: &str = include_str!("../../../shaders/wavelet_common.wgsl");
const MIRROR_WHOLE: &str = include_str!("../../../shaders/wavelet_mirror_whole.wgsl");
const MIRROR_HALF: &str = include_str!("../../../shaders/wavelet_mirror_half.wgsl");
const LOAD_SLOTS: &str = include_str!("../../../shaders/wavelet_load_slots.wgsl");
const LOAD_VALUES: &str = include_str!("../../../shaders/wavelet_load_values.wgsl");

/// The module of one pass; its entry point is `main`, a workgroup of 64 a chunk, an invocation eight outputs in a row along the axis.
pub(super) fn source(bank: Bank, axis: Axis) -> String {
    let taps = &Synthesis::<f32>::new(bank).taps;
    let mirror = match bank.mirror() {
        Mirror::Whole => MIRROR_WHOLE,
        Mirror::Half => MIRROR_HALF,
    };
    let load = if axis == Axis::Z { LOAD_SLOTS } else { LOAD_VALUES };
    // Position of slot or value `i` of the line of this invocation.
    let (place, length, chunk) = match axis {
        Axis::Z => ("vec3(first.x + a, first.y + b, i)", "params.dims.z", "first.z"),
        Axis::Y => ("vec3(first.x + a, i, first.z + b)", "params.dims.y", "first.y"),
        Axis::X => ("vec3(i, first.y + a, first.z + b)", "params.dims.x", "first.x"),
    };
    let mut body = String::new();
    let used = |slot: isize| (0..CHUNK as isize).any(|j| taps[j as usize % 2].iter().any(|(o, _)| j + o == slot));
    let reach = REACH as isize;
    for slot in (-reach..CHUNK as isize + reach).filter(|s| used(*s)) {
        let name = name(slot);
        let _ = writeln!(body, "    let {name} = slot(first, a, b, start + {slot});");
    }
    for j in 0..CHUNK {
        let terms: Vec<String> = (taps[j % 2].iter())
            .map(|(o, w)| format!("{w:?} * {}", name(j as isize + o)))
            .collect();
        let _ = writeln!(
            body,
            "    result[at(place(first, a, b, start + {j}))] = {};",
            terms.join(" + ")
        );
    }
    format!(
        "{COMMON}{mirror}{load}\
fn place(first: vec3<i32>, a: i32, b: i32, i: i32) -> vec3<i32> {{
    return {place};
}}
fn slot(first: vec3<i32>, a: i32, b: i32, i: i32) -> f32 {{
    let m = mirrored(i, {length});
    return f32(m.y) * load(place(first, a, b, m.x));
}}
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {{
    let i = group.y * PER_ROW + group.x;
    if i >= u32(params.dims.w) {{
        return;
    }}
    let first = first_of(list[i]);
    let a = i32(local & 7u);
    let b = i32(local >> 3u);
    let start = {chunk};
{body}}}
"
    )
}

fn name(slot: isize) -> String {
    format!("s{}", slot + REACH as isize)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All modules, without an adapter and without optional capabilities; and nothing in them is an array that a counter indexes.
    #[test]
    fn every_pass_is_portable_and_written_out() {
        for bank in Bank::ALL {
            for axis in Axis::ALL {
                let source = source(bank, axis);
                isobar_gpu::shader::validate(&format!("{bank} {axis:?}"), &source).unwrap();
                assert!(!source.contains("for (") && !source.contains("for("), "{bank}");
                // The taps of both parities, four times each.
                let taps = &Synthesis::<f32>::new(bank).taps;
                assert_eq!(source.matches(" * s").count(), 4 * (taps[0].len() + taps[1].len()), "{bank}");
            }
        }
    }
}
