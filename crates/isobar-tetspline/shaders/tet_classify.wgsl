// K8, the classification of cubes: 1 in `flags` where a cube can hold a piece of the surface. One invocation per cube of the chunk. Cubes among 256 whose data cannot meet an
// isovalue are not looked at (K27): the data are read without the bias here, and subtracting it is monotone, so the range less the bias holds each hull less the bias.

@group(0) @binding(3) var<storage, read_write> flags: array<u32>;
@group(0) @binding(4) var<storage, read> ranges: array<vec2<f32>>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let i = (group.y * ROW + group.x) * 256u + local;
    if i < params.count {
        let cube = params.first + i;
        let range = (ranges[cube / 256u] - params.bias_hi) - params.bias_lo;
        var flag = 0u;
        if meets(range.x, range.y, 1.0, slack_of(range)) {
            flag = select(0u, 1u, is_active(cube_of(cube)));
        }
        flags[i] = flag;
    }
}
