// K8, the classification of cubes: 1 in `flags` where a cube can hold a piece of the surface. One invocation per cube of the chunk.

@group(0) @binding(3) var<storage, read_write> flags: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let i = (group.y * ROW + group.x) * 256u + local;
    if i < params.count {
        flags[i] = select(0u, 1u, is_active(cube_of(params.first + i)));
    }
}
