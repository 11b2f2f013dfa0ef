// K16, after Seland and Dokken 2007 ([15] of the paper): subdivision of the Bernstein hull, leftmost part first, twenty-two times at most. The part [k, k+1] 2^-depth
// is made anew from the whole each time, so nothing need be stacked.

const DEEPEST: u32 = 22u;
// Parts looked at for one isovalue, and half of what all isovalues may take together: a software driver ends the loops of a shader after 65,535 turns in all.
const PARTS: u32 = 200u;
const TURNS: u32 = 30000u;

// The coefficients on [a, b], by blossoms.
fn part_of(c: vec4<f32>, a: f32, b: f32) -> vec4<f32> {
    let p = mix(c.xyz, c.yzw, a);
    let q = mix(c.xyz, c.yzw, b);
    let aa = mix(p.xy, p.yz, a);
    let ab = mix(p.xy, p.yz, b);
    let bb = mix(q.xy, q.yz, b);
    return vec4(mix(aa.x, aa.y, a), mix(aa.x, aa.y, b), mix(ab.x, ab.y, b), mix(bb.x, bb.y, b));
}

fn first_root(c: vec4<f32>, wanted: i32) -> f32 {
    if is_clear(c) {
        return NO_ROOT;
    }
    var k = 0u;
    var depth = 0u;
    let most = min(PARTS, TURNS / max(params.levels, 1u));
    for (var i = 0u; i < most; i++) {
        let width = 1.0 / f32(1u << depth);
        let p = part_of(c, f32(k) * width, f32(k + 1u) * width);
        var next = is_clear(p);
        if !next && depth == DEEPEST {
            if fits(p.x, p.w, wanted) {
                return (f32(k) + 0.5) * width;
            }
            next = true;
        }
        if next {
            k++;
            while depth > 0u && (k & 1u) == 0u {
                k >>= 1u;
                depth--;
            }
            if depth == 0u {
                return NO_ROOT;
            }
        } else {
            k <<= 1u;
            depth++;
        }
    }
    return NO_ROOT;
}
