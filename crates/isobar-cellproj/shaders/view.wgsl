// What all stages share: the view, and the points of the mesh seen from it. Lengths are in units of the mesh: a power of two that makes it about 1.
struct View {
    // The camera's frame.
    right: vec3<f32>,
    width: f32,
    down: vec3<f32>,
    height: f32,
    forward: vec3<f32>,
    // Length of a pixel, at depth 1 or, of parallel rays, anywhere.
    pixel: f32,
    // The eye in two parts, as points are.
    eye: vec3<f32>,
    parallel: u32,
    eye_rest: vec3<f32>,
    // Makes depths less than 1.
    depth_scale: f32,
    // Clipping planes: kept where xyz . p <= w.
    planes: u32,
    // Whether only what lies behind the layer before is drawn.
    peel: u32,
    // Squares side by side.
    columns: u32,
    unused: u32,
    plane: array<vec4<f32>, 8>,
}

struct Point {
    at: vec3<f32>,
    value: f32,
    rest: vec3<f32>,
    unused: f32,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> points: array<Point>;
@group(0) @binding(2) var<storage, read> cells: array<vec4<u32>>;

// The same bits for the same point in whatever cell, so neighbours agree on their common corners.
fn place(i: u32) -> vec3<f32> {
    let p = points[i];
    let q = (p.at - view.eye) + (p.rest - view.eye_rest);
    return vec3(dot(view.right, q), dot(view.down, q), dot(view.forward, q));
}

// A pixel's centre: the direction with depth 1, or where on the plane of starts a parallel ray starts.
fn pixel_vector(position: vec2<f32>) -> vec3<f32> {
    return vec3((position - 0.5 * vec2(view.width, view.height)) * view.pixel, 1.0);
}

// The point of a pixel's ray at a depth.
fn at_depth(p: vec3<f32>, z: f32) -> vec3<f32> {
    return select(p * z, vec3(p.xy, z), view.parallel != 0u);
}

fn largest(v: vec3<f32>) -> f32 {
    return max(abs(v.x), max(abs(v.y), abs(v.z)));
}
