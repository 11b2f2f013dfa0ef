// What the drawing stages share.

struct View {
    // index space less `origin` to clip space: columns, then the offset; z is half of w, so nothing but w >= 0 clips along the ray
    clip_x: vec4<f32>,
    clip_y: vec4<f32>,
    clip_z: vec4<f32>,
    clip_offset: vec4<f32>,
    // a whole cube near the eye, from which positions are counted
    origin: vec3<i32>,
    // pixels per row of the target
    width: u32,
    // the eye less the origin, in index space; or the direction of all rays
    eye: vec3<f32>,
    // 1: orthographic
    parallel: u32,
    // columns: index-space displacement to world displacement
    axes: mat3x3<f32>,
    // columns: index-space gradient to world gradient, up to a factor
    gradients: mat3x3<f32>,
    // by how much tetrahedra grow per unit of w, so that they cover the pixels whose rays only graze them
    grow: f32,
    // 1: only what lies behind the layer before
    peel: u32,
    // planes a.x <= d, in index space less `origin`: the six faces of the domain, then the clipping planes
    planes: u32,
    depth_scale: f32,
    plane: array<vec4<f32>, 14>,
    // orthographic: distance along the rays, in index space less `origin`
    along: vec4<f32>,
    // one over the longest axis of the domain, in voxels
    unit: f32,
    // half the width of a curve, in world units over those of `gradients`: at distance 1, or of parallel rays everywhere
    reach: f32,
    // bit 0: texture, bit 1: curves
    paint: u32,
}

@group(0) @binding(2) var<storage, read> levels: array<Level>;
@group(0) @binding(3) var<uniform> view: View;

const PART: f32 = 1.0 / 192.0;

// The 20 coefficients, in the order of isobar_fields::type6::INDICES.
struct Patch {
    b0: vec4<f32>,
    b1: vec4<f32>,
    b2: vec4<f32>,
    b3: vec4<f32>,
    b4: vec4<f32>,
}

// Columns: the canonical axes of a kind in index space.
fn frame(kind: u32) -> mat3x3<f32> {
    let a = kind / 8u;
    let b = (a + 1u + (kind / 2u & 1u)) % 3u;
    let c = 3u - a - b;
    let axis = vec3(0u, 1u, 2u);
    let zero = vec3(0.0);
    let x = select(zero, vec3(f32(kind >> 1u & 2u) - 1.0), axis == vec3(a));
    let y = select(zero, vec3(f32(kind << 1u & 2u) - 1.0), axis == vec3(b));
    return mat3x3(x, y, select(zero, vec3(1.0), axis == vec3(c)));
}

// Barycentric coordinates of a canonical point, and of a canonical displacement.
fn barycentric(p: vec3<f32>) -> vec4<f32> {
    return vec4(1.0 - 2.0 * p.x, 2.0 * (p.x - p.y), p.y + p.z, p.y - p.z);
}

fn barycentric_step(d: vec3<f32>) -> vec4<f32> {
    return vec4(-2.0 * d.x, 2.0 * (d.x - d.y), d.y + d.z, d.y - d.z);
}
