// Values of the coarser level.
@group(0) @binding(4) var<storage, read> low: array<f32>;
// By chunk, whether its details are used.
@group(0) @binding(5) var<storage, read> details_used: array<u32>;

// A slot: the coarser level's value where all coordinates are even, else a detail.
fn load(v: vec3<i32>) -> f32 {
    if ((v.x | v.y | v.z) & 1) == 0 {
        return low[stored(vec3(v.x >> 1u, v.y >> 1u, v.z >> 1u), params.coarse.xyz)];
    }
    let n = params.chunks;
    let chunk = ((v.z >> 3u) * n.y + (v.y >> 3u)) * n.x + (v.x >> 3u);
    if details_used[chunk] == 0u {
        return 0.0;
    }
    return source[at(v)];
}
