// The pixel's own ray, in fixed point: what the rasteriser says is only which tetrahedra it may meet. Back faces are drawn, which lie before an eye inside the volume too.

@group(0) @binding(9) var<storage, read> rays: array<FixedRay>;
@group(0) @binding(10) var layer_before: texture_2d<u32>;

// One voxel, in half voxels.
const UNIT: f32 = 2.0;
// Roots nearer to the one before than this, in half voxels, are the same one.
const APART: f32 = 4e-6;

fn span_of(in: Varying, pixel: vec2<u32>, axes: mat3x3<f32>) -> Span {
    let ray = rays[pixel.y * view.width + pixel.x];
    let d = fixed_direction(ray);
    let cube = in.cube.xyz + view.origin;
    // Half voxels to where the ray is nearest to the cube's centre; |d| is one half.
    let ahead = vec3<f32>(cube - vec3<i32>(ray.cell)) + 0.5 - vec3<f32>(ray.fraction) * FIXED_UNIT;
    let whole = u32(clamp(round(4.0 * dot(ahead, d)), 0.0, 65535.0));
    let p = (fixed_point(ray, whole, cube) - 0.5) * axes;
    let phi = barycentric(p);
    let step = barycentric_step(d * axes);
    let s = inside(phi, step, BEYOND);
    let length = ray.length & 0xffffu;
    let first = -f32(whole);
    let last = f32(i32(length) - i32(whole)) + ray.rest;
    let missed = (ray.length & 0x80000000u) != 0u;
    let bits = 32u - countLeadingZeros(length + 1u);
    return Span(phi, step, max(s.x, first), select(min(s.y, last), -FAR, missed), whole, 29u - bits);
}

fn behind_layer(pixel: vec2<u32>, span: Span) -> Before {
    if view.peel == 0u {
        return Before(0.0, 255u, 0);
    }
    let hit = textureLoad(layer_before, pixel, 0);
    if (hit.y & HIT) == 0u {
        // Nothing was there: nothing is behind it.
        return Before(FAR, 255u, 1);
    }
    let s = bitcast<f32>(hit.x) + f32(i32(hit.y & 0xffffu) - i32(span.whole)) + APART;
    return Before(s, hit.y >> 16u & 255u, select(-1, 1, (hit.y & RISES) != 0u));
}

// The parameter on this ray as a depth: the bits of an f32 in [0, 1] rise with it, so that 2^-29 of the ray's length still counts. 0x800000: numbers below may be
// taken for 0.
fn placed(in: Varying, span: Span, s: f32, phi: vec4<f32>, axes: mat3x3<f32>, word: u32, normal: vec2<u32>) -> Out {
    let parts = (i32(span.whole) << span.shift) + i32(round(s * f32(1u << span.shift)));
    let depth = bitcast<f32>(u32(max(parts, 0)) + 0x800000u);
    return Out(vec4(bitcast<u32>(s), word | span.whole, normal), depth);
}
