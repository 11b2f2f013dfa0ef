// The part of an isosurface inside a cell, drawn as the rectangle of its pixels: Roettger, Kraus, Ertl 2000, sections 5 to 7, with the texture replaced by what it stands for.
// The vertex stage makes the lines through the patch's corners and the plane of the isosurface, the fragment stage tells inside from outside and where the ray meets the plane.
//
// Corners are made from the two points of a cell's edge alone, and a line from its two corners in an order of their own. So neighbours have the same line to the bit with opposite
// signs: no pixel is lost between them and none is drawn twice.

@group(0) @binding(3) var<storage, read> patches: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> levels: array<vec2<f32>>;
@group(0) @binding(5) var before: texture_2d<u32>;

struct Varying {
    @builtin(position) position: vec4<f32>,
    // Lines: normal, and the sign of the inside.
    @location(0) @interpolate(flat) e0: vec4<f32>,
    @location(1) @interpolate(flat) e1: vec4<f32>,
    @location(2) @interpolate(flat) e2: vec4<f32>,
    @location(3) @interpolate(flat) e3: vec4<f32>,
    // xyz . p = w
    @location(4) @interpolate(flat) plane: vec4<f32>,
    @location(5) @interpolate(flat) number: u32,
}

// The corners with s >= c first, by the set of them, where it has two.
const PAIRS = array<vec4<u32>, 16>(
    vec4(0u), vec4(0u), vec4(0u), vec4(0u, 1u, 2u, 3u), vec4(0u), vec4(0u, 2u, 1u, 3u), vec4(1u, 2u, 0u, 3u), vec4(0u),
    vec4(0u), vec4(0u, 3u, 1u, 2u), vec4(1u, 3u, 0u, 2u), vec4(0u), vec4(2u, 3u, 0u, 1u), vec4(0u), vec4(0u), vec4(0u),
);
// The corners other than one.
const OTHERS = array<vec3<u32>, 4>(vec3(1u, 2u, 3u), vec3(0u, 2u, 3u), vec3(0u, 1u, 3u), vec3(0u, 1u, 2u));
// The faces opposite each corner, counterclockwise from outside.
const FACES = array<vec3<u32>, 4>(vec3(1u, 2u, 3u), vec3(0u, 3u, 2u), vec3(0u, 1u, 3u), vec3(0u, 2u, 1u));

// On the screen.
fn homogeneous(p: vec3<f32>) -> vec3<f32> {
    return select(p, vec3(p.xy, 1.0), view.parallel != 0u);
}

// Where s = c between v, which is at least c, and a, which is below.
fn between(v: vec3<f32>, a: vec3<f32>, wv: f32, wa: f32) -> vec3<f32> {
    if wv == 0.0 {
        return v;
    }
    let sum = wv - wa;
    return a * (wv / sum) + v * (-wa / sum);
}

fn edge(p: vec3<f32>, q: vec3<f32>) -> vec4<f32> {
    if all(p == q) {
        return vec4(0.0, 0.0, 0.0, 1.0);
    }
    let exchange = p.x > q.x || (p.x == q.x && (p.y > q.y || (p.y == q.y && p.z > q.z)));
    let a = select(p, q, exchange);
    let b = select(q, p, exchange);
    return vec4(cross(a, b - a), select(1.0, -1.0, exchange));
}

// Polygons of three corners have the third twice.
struct Polygon {
    q: array<vec3<f32>, 4>,
    plane: vec4<f32>,
    seen: bool,
}

// Of a cell with values about the isovalue.
fn isosurface(h: array<vec3<f32>, 4>, w: vec4<f32>, plane: vec4<f32>) -> Polygon {
    var corners = h;
    var values = array<f32, 4>(w.x, w.y, w.z, w.w);
    for (var i = 0u; i < 4u; i++) {
        corners[i] = homogeneous(corners[i]);
    }
    let above = u32(w.x >= 0.0) | u32(w.y >= 0.0) << 1u | u32(w.z >= 0.0) << 2u | u32(w.w >= 0.0) << 3u;
    var out: Polygon;
    out.plane = plane;
    out.seen = true;
    let count = countOneBits(above);
    if count == 2u {
        var pairs = PAIRS;
        let k = pairs[above];
        out.q[0] = between(corners[k.x], corners[k.z], values[k.x], values[k.z]);
        out.q[1] = between(corners[k.x], corners[k.w], values[k.x], values[k.w]);
        out.q[2] = between(corners[k.y], corners[k.w], values[k.y], values[k.w]);
        out.q[3] = between(corners[k.y], corners[k.z], values[k.y], values[k.z]);
        return out;
    }
    var others = OTHERS;
    if count == 1u || count == 3u {
        let v = firstTrailingBit(select(15u - above, above, count == 1u));
        let k = others[v];
        for (var i = 0u; i < 3u; i++) {
            if count == 1u {
                out.q[i] = between(corners[v], corners[k[i]], values[v], values[k[i]]);
            } else {
                out.q[i] = between(corners[k[i]], corners[v], values[k[i]], values[v]);
            }
        }
        out.q[3] = out.q[2];
        return out;
    }
    // All at least c: a face on the surface, or nothing that has pixels.
    out.seen = false;
    for (var v = 0u; v < 4u; v++) {
        let k = others[v];
        if values[k.x] == 0.0 && values[k.y] == 0.0 && values[k.z] == 0.0 {
            out.q = array(corners[k.x], corners[k.y], corners[k.z], corners[k.z]);
            out.seen = true;
        }
    }
    return out;
}

// A face of a cell on which s = c, where rays enter it.
fn entry_face(h: array<vec3<f32>, 4>, face: u32) -> Polygon {
    var corners = h;
    var faces = FACES;
    let k = faces[face];
    let at = corners[k.x];
    let a = corners[k.y] - at;
    let b = corners[k.z] - at;
    let n = cross(a / largest(a), b / largest(b));
    var out: Polygon;
    out.plane = vec4(n, dot(n, at));
    out.seen = select(dot(n, at), n.z, view.parallel != 0u) < 0.0;
    out.q = array(homogeneous(at), homogeneous(corners[k.y]), homogeneous(corners[k.z]), homogeneous(corners[k.z]));
    return out;
}

// The plane s = c: with e the edges from corner 0 and V their volume, sum (s_i - s_0) n_i . (p - p_0) = (c - s_0) V. Edges are divided by the largest number in them and values by the largest difference.
fn plane_of(h: array<vec3<f32>, 4>, s: vec4<f32>, w: f32) -> vec4<f32> {
    var a = h[1] - h[0];
    var b = h[2] - h[0];
    var d = h[3] - h[0];
    let size = max(largest(a), max(largest(b), largest(d)));
    a /= size;
    b /= size;
    d /= size;
    let na = cross(b, d);
    var rise = s.yzw - s.x;
    let most = largest(rise);
    rise /= most;
    let g = na * rise.x + cross(d, a) * rise.y + cross(a, b) * rise.z;
    return vec4(g, size * (-w / most) * dot(a, na) + dot(g, h[0]));
}

struct Box {
    lo: vec2<f32>,
    hi: vec2<f32>,
}

// First and last pixel that may be covered; the last before the first where there is none.
fn pixels(q: array<vec3<f32>, 4>) -> Box {
    var corners = q;
    let last = vec2(view.width, view.height) - 1.0;
    var lo = vec2(3e38);
    var hi = vec2(-3e38);
    var near = false;
    var ahead = false;
    for (var i = 0u; i < 4u; i++) {
        let c = corners[i];
        near = near || !(c.z > 1e-5 * largest(c));
        ahead = ahead || c.z > 0.0;
        let p = c.xy / (c.z * view.pixel) + 0.5 * last;
        lo = min(lo, p);
        hi = max(hi, p);
    }
    if near && view.parallel == 0u {
        // Across the eye plane: anywhere, unless all is behind it.
        return Box(select(vec2(1.0), vec2(0.0), ahead), select(vec2(0.0), last, ahead));
    }
    return Box(max(ceil(lo - 0.02), vec2(0.0)), min(floor(hi + 0.02), last));
}

@vertex
fn vs(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Varying {
    let item = patches[instance];
    let cell = cells[item.x];
    let level = levels[item.y & 255u];
    let h = array(place(cell.x), place(cell.y), place(cell.z), place(cell.w));
    let s = vec4(points[cell.x].value, points[cell.y].value, points[cell.z].value, points[cell.w].value);
    // The isovalue has two parts: the sign is that of s - c.
    let w = (s - level.x) - level.y;
    let face = item.y >> 8u;
    var polygon: Polygon;
    if face == 0u {
        polygon = isosurface(h, w, plane_of(h, s, w.x));
    } else {
        polygon = entry_face(h, face - 1u);
    }
    let q = polygon.q;
    // Of the triangles (0, 1, 2) and (0, 2, 3) the larger tells the orientation.
    let first = dot(cross(q[1] - q[0], q[2] - q[0]), q[0]);
    let second = dot(cross(q[2] - q[0], q[3] - q[0]), q[0]);
    let turn = select(second, first, abs(first) >= abs(second));
    let box = pixels(q);
    var out: Varying;
    if !polygon.seen || turn == 0.0 || box.lo.x > box.hi.x || box.lo.y > box.hi.y {
        // Beyond the image.
        out.position = vec4(2.0, 2.0, 0.5, 1.0);
        return out;
    }
    let corner = vec2(select(box.lo.x, box.hi.x + 1.0, (vertex & 1u) != 0u), select(box.lo.y, box.hi.y + 1.0, vertex > 1u));
    let clip = 2.0 * corner / vec2(view.width, view.height) - 1.0;
    out.position = vec4(clip.x, -clip.y, 0.5, 1.0);
    let side = sign(turn);
    out.e0 = turned(edge(q[0], q[1]), side);
    out.e1 = turned(edge(q[1], q[2]), side);
    out.e2 = turned(edge(q[2], q[3]), side);
    out.e3 = turned(edge(q[3], q[0]), side);
    out.plane = polygon.plane;
    out.number = instance + 1u;
    return out;
}

fn turned(e: vec4<f32>, side: f32) -> vec4<f32> {
    // A line that is none has everything inside.
    return vec4(e.xyz, select(e.w * side, 1.0, all(e.xyz == vec3(0.0))));
}

// On the line it belongs to one of the two neighbours.
fn inside(e: vec4<f32>, p: vec3<f32>) -> bool {
    let d = dot(e.xyz, p) * e.w;
    return d > 0.0 || (d == 0.0 && e.w > 0.0);
}

struct Hit {
    // The bits of the depth, and the patch's number plus 1.
    @location(0) hit: vec2<u32>,
    @builtin(frag_depth) depth: f32,
}

@fragment
fn fs(in: Varying) -> Hit {
    let p = pixel_vector(in.position.xy);
    if !(inside(in.e0, p) && inside(in.e1, p) && inside(in.e2, p) && inside(in.e3, p)) {
        discard;
    }
    var z: f32;
    if view.parallel != 0u {
        z = (in.plane.w - dot(in.plane.xy, p.xy)) / in.plane.z;
    } else {
        z = in.plane.w / dot(in.plane.xyz, p);
    }
    if !(z > 0.0 && z < 3e38) {
        discard;
    }
    let point = at_depth(p, z);
    for (var i = 0u; i < view.planes; i++) {
        if dot(view.plane[i].xyz, point) > view.plane[i].w {
            discard;
        }
    }
    if view.peel != 0u {
        let last = textureLoad(before, vec2<i32>(in.position.xy), 0);
        if last.y == 0u || z <= bitcast<f32>(last.x) {
            discard;
        }
    }
    return Hit(vec2(bitcast<u32>(z), in.number), z * view.depth_scale);
}
