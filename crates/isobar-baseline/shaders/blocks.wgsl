// Least and greatest coefficient per block: `fine` from the volume, then `coarse` from the fine ones, both in one buffer. A block covers the
// closed stretch [b side, (b + 1) side] of index space per axis and all coefficients of that stretch's stencils; s lies between them
// there, because B-spline bases are non-negative and sum to one. What the border rule takes from elsewhere lies inside the stretch.

@group(0) @binding(2) var<storage, read_write> ranges: array<vec2<f32>>;

@compute @workgroup_size(64)
fn fine(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let n = params.fine;
    let i = id.y * groups.x * 64u + id.x;
    if i >= n.x * n.y * n.z {
        return;
    }
    let b = vec3(i % n.x, i / n.x % n.y, i / (n.x * n.y));
    let pad = i32(params.pad);
    // Splines of more than two coefficients per axis reach one further, and only their textures are padded.
    let lo = max(vec3<i32>(b * params.fine_side) - pad, vec3(0));
    let hi = min(vec3<i32>((b + 1u) * params.fine_side) + pad, vec3<i32>(params.last));
    let first = texel(lo + pad);
    var range = vec2(first, first);
    for (var z = lo.z; z <= hi.z; z++) {
        for (var y = lo.y; y <= hi.y; y++) {
            for (var x = lo.x; x <= hi.x; x++) {
                let c = texel(vec3(x, y, z) + pad);
                range = vec2(min(range.x, c), max(range.y, c));
            }
        }
    }
    ranges[i] = range;
}

@compute @workgroup_size(64)
fn coarse(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let n = params.coarse;
    let i = id.y * groups.x * 64u + id.x;
    if i >= n.x * n.y * n.z {
        return;
    }
    let m = params.fine;
    let up = params.coarse_side / params.fine_side;
    let lo = vec3(i % n.x, i / n.x % n.y, i / (n.x * n.y)) * up;
    let hi = min(lo + up, m);
    var range = ranges[(lo.z * m.y + lo.y) * m.x + lo.x];
    for (var z = lo.z; z < hi.z; z++) {
        for (var y = lo.y; y < hi.y; y++) {
            for (var x = lo.x; x < hi.x; x++) {
                let r = ranges[(z * m.y + y) * m.x + x];
                range = vec2(min(range.x, r.x), max(range.y, r.y));
            }
        }
    }
    ranges[m.x * m.y * m.z + i] = range;
}
