// K27: the kinds of active cubes that the view frustum may hold, and how many of each kind every block of 256 cubes has; then the scans and compactions of K10 as for all
// active tetrahedra.

// a.q + d >= 0 for the centre q of every cube that reaches into the frustum, for each of its four sides
@group(0) @binding(2) var<storage, read> frustum: array<vec4<f32>, 4>;
@group(0) @binding(3) var<storage, read> state: array<u32>;
@group(0) @binding(4) var<storage, read> cubes: array<u32>;
@group(0) @binding(5) var<storage, read> masks: array<u32>;
@group(0) @binding(6) var<storage, read_write> totals: array<u32>;
@group(0) @binding(7) var<storage, read_write> visible: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let count = min(state[3], params.room_cubes);
    let block = group.y * ROW + group.x;
    let slot = block * 256u + local;
    var mask = 0u;
    if slot < count {
        let q = vec4(vec3<f32>(cube_of(cubes[slot])), 1.0);
        let inside = vec4(dot(frustum[0], q), dot(frustum[1], q), dot(frustum[2], q), dot(frustum[3], q));
        mask = select(0u, masks[slot], all(inside >= vec4(0.0)));
        visible[slot] = mask;
    }
    let sum = inclusive(local, spread(mask));
    if local == 255u && block * 256u < count {
        for (var kind = 0u; kind < 24u; kind++) {
            totals[kind * params.blocks + block] = count_of(sum, kind);
        }
    }
}
