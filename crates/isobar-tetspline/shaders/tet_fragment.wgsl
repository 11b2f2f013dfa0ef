// K14 to K18, the fragment stage (Kalbe et al. 2009, section 4.4): the univariate cubic on the ray by blossoming, its first root, the normal by what the blossoms leave behind, and the depth.

// What a fragment knows of its ray: barycentric coordinates at parameter 0 and per unit of it, and the parameters between which a root counts. A ray's parameters are
// those of `whole` half voxels behind its entry (exact), or units behind the face (interpolated).
struct Span {
    phi: vec4<f32>,
    step: vec4<f32>,
    from_s: f32,
    to_s: f32,
    whole: u32,
    // 2^shift parts of a half voxel are told in the depth
    shift: u32,
}

// How far beyond its faces a tetrahedron's cubic is looked at, in barycentric coordinates: its neighbours join with C1, so that they agree there to 1e-8 of
// the data, and no root on a face is lost to rounding.
const BEYOND: f32 = 1e-4;
const FAR: f32 = 1e30;

struct Out {
    @location(0) hit: vec4<u32>,
    @builtin(frag_depth) depth: f32,
}

// The parameters between which all barycentric coordinates are at least -beyond.
fn inside(phi: vec4<f32>, step: vec4<f32>, beyond: f32) -> vec2<f32> {
    let t = (-beyond - phi) / step;
    let lo = select(vec4(-FAR), t, step > vec4(0.0));
    let hi = select(vec4(FAR), t, step < vec4(0.0));
    let out = any((step == vec4(0.0)) & (phi < vec4(-beyond)));
    let from_s = max(max(lo.x, lo.y), max(lo.z, lo.w));
    let to_s = min(min(hi.x, hi.y), min(hi.z, hi.w));
    return vec2(from_s, select(to_s, -FAR, out));
}

// The first step of de Casteljau's rule: ten inner products.
struct Quadratic {
    // 2000, 1100, 1010, 1001
    q0: vec4<f32>,
    // 0200, 0110, 0101
    q1: vec3<f32>,
    // 0020, 0011, 0002
    q2: vec3<f32>,
}

fn first_step(b: Patch, p: vec4<f32>) -> Quadratic {
    return Quadratic(
        vec4(
            dot(p, b.b0),
            dot(p, vec4(b.b0.y, b.b1.x, b.b1.y, b.b1.z)),
            dot(p, vec4(b.b0.z, b.b1.y, b.b1.w, b.b2.x)),
            dot(p, vec4(b.b0.w, b.b1.z, b.b2.x, b.b2.y)),
        ),
        vec3(
            dot(p, vec4(b.b1.x, b.b2.z, b.b2.w, b.b3.x)),
            dot(p, vec4(b.b1.y, b.b2.w, b.b3.y, b.b3.z)),
            dot(p, vec4(b.b1.z, b.b3.x, b.b3.z, b.b3.w)),
        ),
        vec3(
            dot(p, vec4(b.b1.w, b.b3.y, b.b4.x, b.b4.y)),
            dot(p, vec4(b.b2.x, b.b3.z, b.b4.y, b.b4.z)),
            dot(p, vec4(b.b2.y, b.b3.w, b.b4.z, b.b4.w)),
        ),
    );
}

// The second step: four inner products.
fn second_step(q: Quadratic, p: vec4<f32>) -> vec4<f32> {
    return vec4(
        dot(p, q.q0),
        dot(p, vec4(q.q0.y, q.q1.x, q.q1.y, q.q1.z)),
        dot(p, vec4(q.q0.z, q.q1.y, q.q2.x, q.q2.y)),
        dot(p, vec4(q.q0.w, q.q1.z, q.q2.y, q.q2.z)),
    );
}

// An octahedral map of the unit sphere: two numbers of 24 bits, above eight bits each that are left for the paint.
fn packed(n: vec3<f32>) -> vec2<u32> {
    let size = abs(n.x) + abs(n.y) + abs(n.z);
    if !(size > 0.0) {
        return vec2(0x80000000u, 0u);
    }
    let m = n / size;
    let folded = (1.0 - abs(m.yx)) * select(vec2(-1.0), vec2(1.0), m.xy >= vec2(0.0));
    let p = clamp(select(m.xy, folded, m.z < 0.0), vec2(-1.0), vec2(1.0));
    return bitcast<vec2<u32>>(vec2<i32>(round(p * 8388607.0))) << vec2(8u);
}

// Bits of the word beside the parameter: 0 to 15 whole half voxels, 16 to 23 the surface, 24 hit, 25 rising, 26 the parameter is a distance in the world, 27 on a curve.
const HIT: u32 = 0x1000000u;
const RISES: u32 = 0x2000000u;
const WORLD: u32 = 0x4000000u;
const CURVE: u32 = 0x8000000u;

@fragment
fn fs(in: Varying) -> Out {
    let pixel = vec2<u32>(in.position.xy);
    count_fragment(pixel);
    let axes = frame(u32(in.cube.w));
    let span = span_of(in, pixel, axes);
    if !(span.from_s <= span.to_s) {
        discard;
    }
    let b = Patch(in.b0, in.b1, in.b2, in.b3, in.b4);
    let before = behind_layer(pixel, span);
    let found = find(b, span, before);
    if found.level < 0 {
        discard;
    }
    // K17: de Casteljau's first step is multi-affine, so at the root it lies between those at the ends; then the second step.
    let x = found.x;
    let phi = mix(found.a, found.b, x);
    let q = Quadratic(
        mix(found.qa.q0, found.qb.q0, x),
        mix(found.qa.q1, found.qb.q1, x),
        mix(found.qa.q2, found.qb.q2, x),
    );
    let l = second_step(q, phi);
    // Equation (4): the gradients of the barycentric coordinates are those of the canonical frame.
    let g = vec3(2.0 * (l.y - l.x), (l.z + l.w) - 2.0 * l.y, l.z - l.w);
    let normal = normalize(view.gradients * (axes * g));
    let paint = paint_of(in, phi, axes, normal);
    let word = levels[found.level].surface << 16u | HIT | select(0u, RISES, found.rises) | select(0u, CURVE, (paint & 0x10000u) != 0u);
    return placed(in, span, found.s, phi, axes, word, packed(normal) | vec2(paint & 0xffu, paint >> 8u & 0xffu));
}

// A hit of the layer before on this pixel, as parameter, level and direction.
struct Before {
    s: f32,
    surface: u32,
    // 1 where the hit rose, -1 where it fell, 0: there is none
    sense: i32,
}

struct Found {
    s: f32,
    x: f32,
    level: i32,
    rises: bool,
    a: vec4<f32>,
    b: vec4<f32>,
    qa: Quadratic,
    qb: Quadratic,
}
