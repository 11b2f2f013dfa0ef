// The medium of a band of the image, a workgroup for 8 x 8 pixels, so many cells a pass that no device's limit of loop turns is met; what a pass leaves is where the next goes on. In a pass: the cells of these, front to back, set up side by side and then met by every ray; sections 2 to 4 and 10 of Roettger, Kraus, Ertl 2000. Entry,
// exit and the values there are those of the ray in perspective too; a stay is cut at the hits of the pixel, as in volume.rs.

struct Table {
    value: f32,
    per: f32,
    nodes: u32,
    // 1: (s_f, s_b) for one length, 0: (s_f, s_b, l)
    planar: u32,
    // Nodes per length, or 1 over the length.
    length: f32,
    // The first row of squares of the band; the cells of each square that passes before went through, and how many this one takes.
    row: u32,
    passed: u32,
    most: u32,
}

struct Cell {
    // Keys of the faces rays enter by, then of those they leave by: 1/z, or -z of parallel rays.
    keys: array<vec3<f32>, 4>,
    // s = start . p + z rise . p
    start: vec3<f32>,
    least: f32,
    rise: vec3<f32>,
    most: f32,
    entries: u32,
}

@group(0) @binding(3) var<uniform> table: Table;
@group(0) @binding(4) var<storage, read> texels: array<vec4<f32>>;
// Of each square where its cells begin, and the end; then the cells, or APART and the place of a cell and of the one pixel it is for: those that hide each other in a cycle come once for each
// pixel, in the pixel's own order.
@group(0) @binding(5) var<storage, read> starts: array<u32>;
@group(0) @binding(6) var<storage, read> listed: array<u32>;
// Of each pixel which of its hits is next, and the end; then depth, colour and minus the opacity of each.
@group(0) @binding(7) var<storage, read_write> hit_ranges: array<vec2<u32>>;
@group(0) @binding(8) var<storage, read> hits: array<f32>;
// Premultiplied colour and transmittance.
@group(0) @binding(9) var<storage, read_write> image: array<vec4<f32>>;

const APART: u32 = 0x80000000u;
// As in cells.rs, but above the rounding of f32 in a whole image.
const BESIDE: vec2<f32> = vec2(2e-4, 1.236068e-4);
const OPAQUE: f32 = 1.5e-6;
const FAR: f32 = 3e38;
const BATCH: u32 = 64u;

// Every pixel of the square.
const ALL: u32 = 64u;

// Cells set up, and the pixel each is for.
var<workgroup> batch: array<Cell, 64>;
var<workgroup> wanted: array<u32, 64>;

// The pixel at hand: its ray, what is kept of it, colour and transmittance, and its next hit.
var<private> ray: vec3<f32>;
var<private> stretch: f32;
var<private> kept: vec2<f32>;
var<private> colour: vec4<f32>;
var<private> next: u32;
var<private> end: u32;

fn set_up(number: u32) -> Cell {
    let corners = cells[number];
    let h = place(corners.x);
    // From the table's first value on: what far values have in common would take their digits.
    let s = vec4(points[corners.x].value, points[corners.y].value, points[corners.z].value, points[corners.w].value) - table.value;
    var a = place(corners.y) - h;
    var b = place(corners.z) - h;
    var d = place(corners.w) - h;
    let size = max(largest(a), max(largest(b), largest(d)));
    a /= size;
    b /= size;
    d /= size;
    let n1 = cross(b, d);
    let n2 = cross(d, a);
    let n3 = cross(a, b);
    // Less is lost in the rounding of its edges.
    let volume = max(dot(a, n1), 1e-20);
    let begin = h / size;
    let l = -vec3(dot(n1, begin), dot(n2, begin), dot(n3, begin));
    var normals = array(-(n1 + n2 + n3), n1, n2, n3);
    var at = array(volume - (l.x + l.y + l.z), l.x, l.y, l.z);
    var out: Cell;
    out.entries = 0u;
    var exits = 4u;
    for (var k = 0u; k < 4u; k++) {
        let n = normals[k];
        let parallel = view.parallel != 0u;
        let fixed = select(at[k], n.z, parallel);
        let enters = (fixed > 0.0) == parallel && fixed != 0.0;
        // A face seen edge-on only limits.
        let tiny = select(1e-30, -1e-30, parallel);
        let one = 1.0 / select(fixed, tiny, fixed == 0.0);
        let key = select(-n * (one / size), vec3(n.xy, at[k] * size) * one, parallel);
        if enters {
            out.keys[out.entries] = key;
            out.entries++;
        } else {
            exits--;
            out.keys[exits] = key;
        }
    }
    let rises = (s.yzw - s.x) / volume;
    let g = n1 * rises.x + n2 * rises.y + n3 * rises.z;
    let constant = s.x - dot(g, begin);
    if view.parallel != 0u {
        out.start = vec3(g.xy / size, constant);
        out.rise = vec3(0.0, 0.0, g.z / size);
    } else {
        out.start = vec3(0.0, 0.0, constant);
        out.rise = g / size;
    }
    out.least = min(min(s.x, s.y), min(s.z, s.w));
    out.most = max(max(s.x, s.y), max(s.z, s.w));
    return out;
}

// Depths of entry and exit; the exit is not behind the entry where the ray passes by.
fn stay(c: ptr<function, Cell>) -> vec2<f32> {
    let parallel = view.parallel != 0u;
    var entry = select(FAR, 0.0, parallel);
    var exit = select(0.0, -FAR, parallel);
    for (var k = 0u; k < 4u; k++) {
        let key = dot((*c).keys[k], ray);
        if k < (*c).entries {
            entry = min(entry, key);
        } else {
            exit = max(exit, key);
        }
    }
    if !(entry > exit) || (!parallel && exit <= 0.0) {
        return vec2(1.0, 0.0);
    }
    let depths = select(vec2(select(1.0 / entry, 0.0, entry == FAR), 1.0 / exit), vec2(-entry, -exit), parallel);
    return vec2(max(depths.x, kept.x), min(depths.y, kept.y));
}

struct Node {
    node: u32,
    share: f32,
}

fn node(v: f32, per: f32) -> Node {
    let last = f32(table.nodes - 1u);
    var x = v * per;
    x = select(0.0, min(x, last), x > 0.0);
    let whole = min(floor(x), last - 1.0);
    return Node(u32(whole), x - whole);
}

fn plane_at(i: u32, u: f32, v: f32) -> vec4<f32> {
    let n = table.nodes;
    return mix(mix(texels[i], texels[i + 1u], u), mix(texels[i + n], texels[i + n + 1u], u), v);
}

// Premultiplied colour and minus the opacity of a stretch.
fn lookup(front: f32, back: f32, l: f32) -> vec4<f32> {
    let n = table.nodes;
    let f = node(front, table.per);
    let b = node(back, table.per);
    let i = b.node * n + f.node;
    if table.planar != 0u {
        let texel = plane_at(i, f.share, b.share);
        let share = l * table.length;
        // Opacity held at 1.
        return texel * select(share, -1.0 / texel.w, share * -texel.w > 1.0);
    }
    let k = node(l, table.length);
    let at = k.node * n * n + i;
    return mix(plane_at(at, f.share, b.share), plane_at(at + n * n, f.share, b.share), k.share);
}

fn add(texel: vec4<f32>) {
    colour += texel * colour.w;
}

fn add_hit() {
    let i = 5u * next;
    add(vec4(hits[i + 1u], hits[i + 2u], hits[i + 3u], hits[i + 4u]));
    next++;
}

fn blend(c: ptr<function, Cell>, depths: vec2<f32>) {
    let start = dot((*c).start, ray);
    let rise = dot((*c).rise, ray);
    let range = vec2((*c).least, (*c).most);
    var begin = depths.x;
    var front = clamp(start + begin * rise, range.x, range.y);
    while next < end && hits[5u * next] < depths.y {
        let depth = max(hits[5u * next], begin);
        if depth > begin {
            let value = clamp(start + depth * rise, range.x, range.y);
            add(lookup(front, value, (depth - begin) * stretch));
            begin = depth;
            front = value;
        }
        add_hit();
    }
    if colour.w > OPAQUE {
        add(lookup(front, clamp(start + depths.y * rise, range.x, range.y), (depths.y - begin) * stretch));
    }
}

// What the planes keep of the ray; nothing where the second is not above the first.
fn keep() -> vec2<f32> {
    var out = vec2(0.0, FAR);
    let origin = select(vec3(0.0), vec3(ray.xy, 0.0), view.parallel != 0u);
    let direction = select(ray, vec3(0.0, 0.0, 1.0), view.parallel != 0u);
    for (var i = 0u; i < view.planes; i++) {
        let rest = view.plane[i].w - dot(view.plane[i].xyz, origin);
        let rate = dot(view.plane[i].xyz, direction);
        if rate == 0.0 {
            out.y = select(out.y, -1.0, rest < 0.0);
        } else if rate > 0.0 {
            out.y = min(out.y, rest / rate);
        } else {
            out.x = max(out.x, rest / rate);
        }
    }
    return out;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let square = group.y * view.columns + group.x;
    let last = starts[square + 1u];
    let first = starts[square] + table.passed;
    if table.passed != 0u && first >= last {
        return;
    }
    let end_of_pass = min(last, first + table.most);
    let x = group.x * 8u + local.x;
    let y = (table.row + group.y) * 8u + local.y;
    let width = u32(view.width);
    let drawn = x < width && y < u32(view.height);
    let pixel = select(0u, (group.y * 8u + local.y) * width + x, drawn);
    ray = pixel_vector(vec2(f32(x), f32(y)) + 0.5 + BESIDE);
    stretch = select(length(ray), 1.0, view.parallel != 0u);
    kept = keep();
    colour = select(image[pixel], vec4(0.0, 0.0, 0.0, 1.0), table.passed == 0u);
    next = hit_ranges[pixel].x;
    end = hit_ranges[pixel].y;
    for (var begin = first; begin < end_of_pass; begin += BATCH) {
        let count = min(BATCH, end_of_pass - begin);
        workgroupBarrier();
        if lane < count {
            let code = listed[begin + lane];
            if (code & APART) == 0u {
                batch[lane] = set_up(code);
                wanted[lane] = ALL;
            } else {
                batch[lane] = set_up(listed[code & ~APART]);
                wanted[lane] = listed[(code & ~APART) + 1u];
            }
        }
        workgroupBarrier();
        for (var i = 0u; i < count; i++) {
            if !drawn || colour.w <= OPAQUE {
                break;
            }
            if wanted[i] == ALL || wanted[i] == lane {
                var c = batch[i];
                let depths = stay(&c);
                if depths.y > depths.x {
                    blend(&c, depths);
                }
            }
        }
    }
    if end_of_pass == last {
        while next < end {
            add_hit();
        }
    }
    if drawn {
        image[pixel] = colour;
        hit_ranges[pixel].x = next;
    }
}
