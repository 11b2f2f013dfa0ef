// Value (less the bias) and index-space gradient at points of the domain: how the tests see the reconstruction alone.

@group(0) @binding(2) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> results: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&points) {
        let u = points[id.x].xyz;
        results[id.x] = vec4(value(u), gradient(u));
    }
}
