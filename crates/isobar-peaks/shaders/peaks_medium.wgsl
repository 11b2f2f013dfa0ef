// What a ray gathers front to back, and the medium of one segment: the twins of src/sink.rs and of the tables of src/tables.rs.

// Rows of the transfer function's table (extinction times colour, extinction), or of the pre-integration table, two per entry: (extinction, front)
// and (back, 0).
@group(0) @binding(6) var<storage, read> medium_table: array<vec4<f32>>;

// Where less than this is seen through, colour is done.
const DARK: f32 = 1.0 / 16384.0;

// Premultiplied, and what is still seen through.
var<private> colour: vec3<f32>;
var<private> clear: f32;
// Of loops, in this pass.
var<private> turns: u32;
// The ray's direction in the world.
var<private> seen: vec3<f32>;

fn is_clear() -> bool {
    return (params.flags & COLOUR) != 0u && clear > DARK;
}

// Puts a colour behind what is there.
fn behind(c: vec3<f32>, opacity: f32) {
    let k = clear * opacity;
    colour += k * c;
    clear -= k;
}

fn position(u: f32) -> vec3<f32> {
    return clamp(ray.origin + u * ray.direction, vec3(0.0), params.last);
}

fn normal_at(u: f32) -> vec3<f32> {
    return unit(params.gradients * gradient(position(u)));
}

fn lit(u: f32, c: vec3<f32>) -> vec3<f32> {
    return shade(c, normal_at(u), seen);
}

// Extinction per world length and colour at a value.
fn looked_up(v: f32) -> vec4<f32> {
    let x = clamp((v - params.least) * params.medium_per_value, 0.0, f32(params.medium_bins - 1u));
    let i = min(u32(x), params.medium_bins - 2u);
    let e = mix(medium_table[i], medium_table[i + 1u], x - f32(i));
    let k = select(0.0, 1.0 / e.w, e.w > 0.0);
    return vec4(e.xyz * k, e.w);
}

// Extinction, colour to be shaded at the entry, colour to be shaded at the exit.
struct Segment {
    extinction: f32,
    front: vec3<f32>,
    back: vec3<f32>,
}

fn segment_place(v: f32) -> f32 {
    return clamp((v - params.least) * params.medium_per_value - 0.5, 0.0, f32(params.medium_bins - 1u));
}

fn integrated(a: f32, b: f32) -> Segment {
    let n = params.medium_bins;
    let x = segment_place(a);
    let y = segment_place(b);
    let i = min(u32(x), n - 2u);
    let j = min(u32(y), n - 2u);
    let fx = x - f32(i);
    let fy = y - f32(j);
    var out = Segment(0.0, vec3(0.0), vec3(0.0));
    turns += 4u;
    for (var c = 0u; c < 4u; c++) {
        let p = c >> 1u;
        let q = c & 1u;
        let w = select(1.0 - fx, fx, p == 1u) * select(1.0 - fy, fy, q == 1u);
        let row = 2u * ((i + p) * n + j + q);
        let first = medium_table[row];
        // Colours are interpolated premultiplied.
        let k = w * first.x;
        out.extinction += k;
        out.front += k * first.yzw;
        out.back += k * medium_table[row + 1u].xyz;
    }
    if out.extinction > 0.0 {
        out.front /= out.extinction;
        out.back /= out.extinction;
    }
    return out;
}

fn opacity(depth: f32) -> f32 {
    if depth < 0.0625 {
        return depth * (1.0 - depth * (0.5 - depth * (1.0 / 6.0 - depth * (1.0 / 24.0 - depth / 120.0))));
    }
    return 1.0 - exp(-depth);
}

fn medium(u0: f32, u1: f32, f0: f32, f1: f32) {
    let length = (u1 - u0) * ray.unit;
    let shaded = (params.flags & SHADED) != 0u;
    var depth = 0.0;
    var c = vec3(0.0);
    if params.integration == POST {
        let e = looked_up(f1);
        depth = e.w * length;
        c = e.xyz;
        if shaded && depth > 0.0 {
            c = lit(u1, c);
        }
    } else {
        let s = integrated(f0, f1);
        depth = s.extinction * length;
        c = s.front + s.back;
        if shaded && depth > 0.0 {
            if params.integration == LUM {
                c = lit(u0, s.front) + lit(u1, s.back);
            } else {
                c = lit(u1, c);
            }
        }
    }
    if depth > 0.0 {
        behind(c, opacity(depth));
    }
}
