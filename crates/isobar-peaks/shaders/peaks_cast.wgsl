// One ray per invocation: the twin of src/paper.rs in f32. Knoll et al. 2009, sections 4.2, 5.3 and 6.1.

// Per node the bits of its visible macrocells, two halves.
@group(0) @binding(3) var<storage, read> nodes: array<vec2<u32>>;
// The values of peaks and isovalues, ascending, less the bias.
@group(0) @binding(4) var<storage, read> values: array<Level>;
// Per pair of bins up to four peaks in the order met, a byte each; 255 ends the list.
@group(0) @binding(5) var<storage, read> peak_table: array<u32>;
// Step multipliers, a byte for each macrocell, 64 a node.
@group(0) @binding(7) var<storage, read> multipliers: array<u32>;
@group(0) @binding(8) var<storage, read_write> hits: array<Hit>;
@group(0) @binding(9) var<storage, read_write> pixels: array<Pixel>;
// Rays that paused in this pass.
@group(0) @binding(10) var<storage, read_write> unfinished: atomic<u32>;

// The number after which whole numbers are no longer exact, and no ray has more samples.
const MOST_SAMPLES: f32 = 16777216.0;
// Parameter of planes that a ray is parallel to.
const FAR: f32 = 1e30;

var<private> pixel: u32;
var<private> found: u32;
var<private> work: u32;
// Where the last segment ended, the number of the sample there and the field there.
var<private> begun: bool;
var<private> end: f32;
var<private> next: f32;
var<private> before: f32;
// A stretch that was begun in the pass before goes on where it stopped.
var<private> inside: bool;
// The macrocells of a node go on at that of the pass before.
var<private> within: bool;
// As in Ray.
var<private> state: u32;
var<private> resume: f32;
var<private> block: vec3<i32>;

// Takes one turn of a loop; where there is none left, the ray pauses, to go on at u in the next pass.
fn spent(u: f32, where_it_is: u32) -> bool {
    turns++;
    if turns <= params.turns {
        return false;
    }
    state = where_it_is;
    resume = u;
    return true;
}

fn field(u: f32) -> f32 {
    work++;
    return value(position(u));
}

fn wants_more(any_value: bool) -> bool {
    let wants_hits = (params.flags & COUNT_ALL) != 0u || found < params.layers;
    return is_clear() || (any_value && wants_hits);
}

fn secant(t: vec2<f32>, d: vec2<f32>) -> f32 {
    return clamp(t.x - d.x * (t.y - t.x) / (d.y - d.x), t.x, t.y);
}

// The secant method inside a bracket, and what is found there. Returns whether to go on.
fn peak(which: u32, bracket: vec2<f32>, less: vec2<f32>) -> bool {
    let level = values[which];
    var t = bracket;
    var d = less;
    var x = secant(t, d);
    turns += params.iterations;
    for (var i = 1u; i < params.iterations; i++) {
        let f = field(x) - level.value;
        if (f < 0.0) != (d.x < 0.0) {
            t.y = x;
            d.y = f;
        } else {
            t.x = x;
            d.x = f;
        }
        x = secant(t, d);
    }
    let stored = found < params.layers;
    let coloured = is_clear();
    var normal = vec3(0.0);
    if coloured || (stored && (params.flags & NORMALS) != 0u) {
        normal = normal_at(x);
    }
    if stored {
        hits[found * arrayLength(&pixels) + pixel] = Hit(x, level.surface, normal.x, normal.y, normal.z);
    }
    found++;
    if coloured {
        behind(shade(level.colour, normal, seen), level.opacity);
    }
    return wants_more(true);
}

fn bin(v: f32) -> u32 {
    return u32(clamp((v - params.least) * params.peak_bins_per_value, 0.0, f32(params.peak_bins - 1u)));
}

// One segment. Returns whether to go on.
fn segment(u0: f32, u1: f32, f0: f32, f1: f32) -> bool {
    var crossed = false;
    if params.mode != MEDIUM {
        turns += 4u;
        var list = peak_table[bin(f0) * params.peak_bins + bin(f1)];
        for (var i = 0u; i < 4u; i++) {
            let which = list & 255u;
            if which == 255u {
                break;
            }
            list >>= 8u;
            let v = values[which].value;
            let d = vec2(f0 - v, f1 - v);
            if (d.x < 0.0) != (d.y < 0.0) {
                crossed = true;
                if !peak(which, vec2(u0, u1), d) {
                    return false;
                }
            }
        }
    }
    if params.integration != 0u && is_clear() && !(crossed && params.mode == EITHER) {
        medium(u0, u1, f0, f1);
    }
    return wants_more(params.values > 0u);
}

// Samples all segments that begin before `stop` and reach over `start`, M steps at once. Returns whether to go on.
fn stretch(start: f32, stop: f32, m: f32) -> bool {
    let summed = params.law == PRINTED;
    if inside {
        inside = false;
    } else if summed || !begun || end < start {
        // Where increments are summed, each macrocell begins with the closed form again, as printed.
        let n = sample_before(select(start, max(start, end), summed && begun));
        if summed || n > next || !begun {
            let u = max(place(n), 0.0);
            if u != end || !begun {
                end = u;
                before = field(u);
            }
            begun = true;
            next = n;
        }
    }
    while end < stop {
        if spent(start, INSIDE) {
            return false;
        }
        let k = next + m;
        if k >= MOST_SAMPLES {
            return false;
        }
        var u = 0.0;
        if summed {
            u = end + (m * (ray.step + ray.growth * next) + 0.5 * ray.growth * m * (m - 1.0));
        } else {
            u = place(k);
        }
        u = min(u, ray.length);
        next = k;
        // Steps below the last digit end nowhere.
        if u <= end {
            if place(k) > stop {
                return true;
            }
            continue;
        }
        let v = field(u);
        if !segment(end, u, before, v) {
            return false;
        }
        end = u;
        before = v;
    }
    return true;
}

// Blocks of 1 << log cells: the block the ray is in, and where it leaves it (3DDDA: Amanatides and Woo 1987).
struct Walk {
    at: vec3<i32>,
    exits: vec3<f32>,
}

// Cell coordinates of the entry, and reciprocals of the direction.
var<private> entry: vec3<f32>;
var<private> inverse: vec3<f32>;
var<private> upwards: vec3<i32>;

fn face_at(axis: u32, at: i32) -> f32 {
    if ray.direction[axis] == 0.0 {
        return FAR;
    }
    return (f32(at) - entry[axis]) * inverse[axis];
}

fn walk_at(log: u32, at: vec3<i32>) -> Walk {
    let faces = (at + upwards) << vec3(log);
    return Walk(at, vec3(face_at(0u, faces.x), face_at(1u, faces.y), face_at(2u, faces.z)));
}

fn walk_begun(log: u32, t: f32, lo: vec3<i32>, hi: vec3<i32>) -> Walk {
    let cell = vec3<i32>(floor(entry + t * ray.direction));
    return walk_at(log, clamp(cell >> vec3(log), lo, hi));
}

fn exit_axis(w: Walk) -> u32 {
    let t = w.exits;
    if t.x < t.y {
        return select(2u, 0u, t.x < t.z);
    }
    return select(2u, 1u, t.y < t.z);
}

fn bit_of(at: vec3<i32>) -> u32 {
    return u32(((at.z & 3) << 4u) | ((at.y & 3) << 2u) | (at.x & 3));
}

fn node_index(at: vec3<i32>) -> u32 {
    return u32((at.z * params.nodes.y + at.y) * params.nodes.x + at.x);
}

// The macrocells of one node between two parameters. Returns whether to go on.
fn through_node(node: vec3<i32>, start: f32, stop: f32) -> bool {
    let index = node_index(node);
    let word = nodes[index];
    if (word.x | word.y) == 0u {
        return true;
    }
    let lo = node << vec3(2u);
    let hi = min(lo + 3, params.macrocells - 1);
    var w = walk_begun(2u, start, lo, hi);
    if within {
        w = walk_at(2u, ray.block);
        within = false;
    }
    var t = start;
    loop {
        block = w.at;
        if spent(t, AT_MACROCELL) {
            return false;
        }
        let axis = exit_axis(w);
        let t1 = max(min(w.exits[axis], stop), t);
        let b = bit_of(w.at);
        let half = select(word.x, word.y, b >= 32u);
        if ((half >> (b & 31u)) & 1u) != 0u {
            var m = 1.0;
            if (params.flags & MULTIPLIERS) != 0u {
                let slot = (index << 6u) + b;
                m = f32((multipliers[slot >> 2u] >> (8u * (slot & 3u))) & 255u);
            }
            if !stretch(t, t1, m) {
                return false;
            }
        }
        if t1 >= stop {
            return true;
        }
        w.at[axis] += select(-1, 1, upwards[axis] == 1);
        if w.at[axis] < lo[axis] || w.at[axis] > hi[axis] {
            return true;
        }
        w.exits[axis] = face_at(axis, (w.at[axis] + upwards[axis]) << 2u);
        t = t1;
    }
    return true;
}

fn through_volume(start: f32) {
    let lo = vec3(0);
    let hi = params.nodes - 1;
    var w = walk_begun(4u, start, lo, hi);
    if params.pass_number > 0u {
        w = walk_at(4u, select(ray.block >> vec3(2u), ray.block, ray.state == AT_NODE));
    }
    var t = start;
    loop {
        block = w.at;
        if spent(t, AT_NODE) {
            return;
        }
        let axis = exit_axis(w);
        let t1 = max(min(w.exits[axis], ray.length), t);
        if !through_node(w.at, t, t1) || t1 >= ray.length {
            return;
        }
        w.at[axis] += select(-1, 1, upwards[axis] == 1);
        if w.at[axis] < lo[axis] || w.at[axis] > hi[axis] {
            return;
        }
        w.exits[axis] = face_at(axis, (w.at[axis] + upwards[axis]) << 4u);
        t = t1;
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    pixel = id.y * params.width + id.x;
    if id.x >= params.width || pixel >= arrayLength(&pixels) {
        return;
    }
    ray = rays[pixel];
    if params.pass_number > 0u && ray.state == DONE {
        return;
    }
    seen = unit(params.axes * ray.direction);
    turns = 0u;
    state = DONE;
    colour = vec3(0.0);
    clear = 1.0;
    found = 0u;
    work = 0u;
    begun = false;
    inside = false;
    within = false;
    block = vec3(0);
    end = -FAR;
    next = 0.0;
    var start = 0.0;
    if params.pass_number > 0u {
        let p = pixels[pixel];
        colour = vec3(p.red, p.green, p.blue);
        clear = ray.clear;
        found = p.hits;
        work = p.work;
        end = ray.end;
        next = ray.next;
        start = ray.resume;
        inside = ray.state == INSIDE;
        within = ray.state != AT_NODE;
        begun = end > -FAR;
        if begun {
            before = value(position(end));
        }
    }
    if ray.length >= 0.0 {
        entry = ray.origin + params.shift;
        inverse = select(vec3(0.0), 1.0 / ray.direction, ray.direction != vec3(0.0));
        upwards = select(vec3(0), vec3(1), ray.direction >= vec3(0.0));
        if (params.flags & MACROCELLS) != 0u {
            through_volume(start);
        } else {
            stretch(start, ray.length, 1.0);
        }
    }
    pixels[pixel] = Pixel(colour.x, colour.y, colour.z, 1.0 - clear, found, work);
    rays[pixel].state = state;
    if state != DONE {
        rays[pixel].end = end;
        rays[pixel].next = next;
        rays[pixel].clear = clear;
        rays[pixel].resume = resume;
        rays[pixel].block = block;
        atomicAdd(&unfinished, 1u);
    }
}
