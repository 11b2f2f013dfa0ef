// K13 (b): the determining set of every active cube, stored.

@group(0) @binding(3) var<storage, read> state: array<u32>;
@group(0) @binding(4) var<storage, read> cubes: array<u32>;
@group(0) @binding(5) var<storage, read_write> sets: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let slot = (group.y * ROW + group.x) * 256u + local;
    if slot < min(state[3], params.room_cubes) {
        let q = cube_of(cubes[slot]);
        store_set(
            slot,
            datum(q + vec3(-1, -1, -1)), datum(q + vec3(0, -1, -1)), datum(q + vec3(1, -1, -1)),
            datum(q + vec3(-1, 0, -1)), datum(q + vec3(0, 0, -1)), datum(q + vec3(1, 0, -1)),
            datum(q + vec3(-1, 1, -1)), datum(q + vec3(0, 1, -1)), datum(q + vec3(1, 1, -1)),
            datum(q + vec3(-1, -1, 0)), datum(q + vec3(0, -1, 0)), datum(q + vec3(1, -1, 0)),
            datum(q + vec3(-1, 0, 0)), datum(q), datum(q + vec3(1, 0, 0)),
            datum(q + vec3(-1, 1, 0)), datum(q + vec3(0, 1, 0)), datum(q + vec3(1, 1, 0)),
            datum(q + vec3(-1, -1, 1)), datum(q + vec3(0, -1, 1)), datum(q + vec3(1, -1, 1)),
            datum(q + vec3(-1, 0, 1)), datum(q + vec3(0, 0, 1)), datum(q + vec3(1, 0, 1)),
            datum(q + vec3(-1, 1, 1)), datum(q + vec3(0, 1, 1)), datum(q + vec3(1, 1, 1)),
        );
    }
}
