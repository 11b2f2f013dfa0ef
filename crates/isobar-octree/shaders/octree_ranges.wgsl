// Least and greatest coefficient per brick of 4^3 cells: all that the stencils of its cells reach. s lies between them there, because B-spline
// bases are non-negative and sum to one.

@group(0) @binding(2) var<storage, read_write> ranges: array<vec2<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let n = (params.cells + 3u) / 4u;
    let i = id.y * groups.x * 64u + id.x;
    if i >= params.bricks {
        return;
    }
    let b = vec3<i32>(vec3(i % n.x, i / n.x % n.y, i / (n.x * n.y))) * 4;
    let top = min(b + 3, vec3<i32>(params.cells) - 1) + BEFORE + DEGREE;
    // What the border rule puts outside lies inside the reach of the same stencils.
    let lo = max(b + BEFORE, vec3(0));
    let hi = min(top, params.last);
    let first = texel(lo);
    var range = vec2(first, first);
    for (var z = lo.z; z <= hi.z; z++) {
        for (var y = lo.y; y <= hi.y; y++) {
            for (var x = lo.x; x <= hi.x; x++) {
                let c = texel(vec3(x, y, z));
                range = vec2(min(range.x, c), max(range.y, c));
            }
        }
    }
    ranges[i] = range;
}
