// One ray per invocation: a digital differential analyser over nodes of 16^3 cells and bricks of 4^3 in f32, and in each active brick a second
// one over cells, in coordinates about the brick's centre that come from the ray's fixed-point numbers: a position there is off by at most some
// 2^-22 of a cell, however far the entry is.

@group(0) @binding(2) var<storage, read> rays: array<Ray>;
@group(0) @binding(3) var<storage, read> nodes: array<Node>;
@group(0) @binding(4) var<storage, read> cells: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> levels: array<Level>;
@group(0) @binding(6) var<storage, read_write> hits: array<Hit>;
@group(0) @binding(7) var<storage, read_write> pixels: array<Pixel>;

// Further than any ray is long.
const FAR: f32 = 1e30;
const FRACTION: f32 = 2.3283064365386963e-10;

fn least(t: vec3<f32>) -> f32 {
    return min(t.x, min(t.y, t.z));
}

// The axis whose plane comes first, as a mask.
fn nearest(t: vec3<f32>) -> vec3<bool> {
    let x = t.x < t.y && t.x < t.z;
    let y = !x && t.y <= t.x && t.y < t.z;
    return vec3(x, y, !x && !y);
}

// Bit of (x, y, z) in a word of 4^3; the lowest two bits of each count.
fn is_set(word: vec2<u32>, at: vec3<i32>) -> bool {
    let b = vec3<u32>(at) & vec3(3u);
    let half = select(word.x, word.y, b.z >= 2u);
    return (half >> (((b.z & 1u) << 4u) | (b.y << 2u) | b.x) & 1u) == 1u;
}

// The ray's point `whole` half voxels behind its entry, less `centre`, along one axis.
fn rebased(cell: u32, fraction: u32, direction: u32, tail: u32, falls: bool, whole: u32, centre: i32) -> f32 {
    // whole * (direction * 2^-32 + tail * 2^-42), whole below 2^16, in whole cells and 2^-32
    let a = whole * (direction >> 16u);
    let b = whole * (direction & 0xffffu);
    let c = (whole * tail) >> 10u;
    let low = b + c;
    let low_carry = select(0u, 1u, low < b);
    let part = (a << 16u) + low;
    let part_carry = select(0u, 1u, part < low);
    let cells_on = (a >> 16u) + low_carry + part_carry;
    if falls {
        let f = fraction - part;
        let borrow = select(0, 1, fraction < part);
        return f32(i32(cell) - i32(cells_on) - borrow - centre) + f32(f) * FRACTION;
    }
    let f = fraction + part;
    let over_one = select(0, 1, f < part);
    return f32(i32(cell) + i32(cells_on) + over_one - centre) + f32(f) * FRACTION;
}

fn cast_cell(s: Segment) {
    var p = compose(s.cell, s.a, s.b);
    if way.carries {
        // Both cells give their common point one value, so that no sign change is lost or seen twice.
        p = with_first(p, way.carry);
    } else {
        way.tail = false;
        way.dip = NONE;
    }
    way.carry = last_of(p);
    way.carries = true;
    roots(p, s);
}

// Behind a loop that ends only where nothing more is wanted, or by returning: whether the driver ended it.
fn note_cut() {
    if way.more {
        way.work = CUT;
        way.more = false;
    }
}

// The cells of an active brick, from t0 to t1 behind the entry.
fn cast_brick(ray: Ray, d: vec3<f32>, inverse: vec3<f32>, brick: vec3<i32>, mask: vec2<u32>, t0: f32, t1: f32) {
    let whole = u32(clamp(round(0.5 * (t0 + t1)), 0.0, 65535.0));
    let centre = brick * 4 + 2;
    let falls = vec3((ray.length & 0x10000u) != 0u, (ray.length & 0x20000u) != 0u, (ray.length & 0x40000u) != 0u);
    let o = vec3(
        rebased(ray.cell.x, ray.fraction.x, ray.direction.x, ray.fine & 1023u, falls.x, whole, centre.x),
        rebased(ray.cell.y, ray.fraction.y, ray.direction.y, ray.fine >> 10u & 1023u, falls.y, whole, centre.y),
        rebased(ray.cell.z, ray.fraction.z, ray.direction.z, ray.fine >> 20u & 1023u, falls.z, whole, centre.z),
    );
    way.last_u += f32(i32(way.whole) - i32(whole));
    way.whole = whole;
    let start = t0 - f32(whole);
    let stop = min(t1 - f32(whole), f32(i32(ray.length & 0xffffu) - i32(whole)) + ray.rest);
    let flat = d == vec3(0.0);
    let up = select(vec3(0), vec3(1), d >= vec3(0.0));
    let step = 2 * up - 1;
    // Cells of the brick, counted from its centre. A ray leaves it where the walk over bricks says so, not by its faces: along an axis on which
    // it is at the end, it stays in the last cell.
    let top = min(vec3(1), vec3<i32>(params.cells) - 1 - centre);
    let end = select(vec3(-2), top, d >= vec3(0.0));
    var p = o + start * d;
    var c = clamp(vec3<i32>(floor(p)), vec3(-2), top);
    var t = start;
    var exits = select((vec3<f32>(c + up) - o) * inverse, vec3(FAR), flat | (c == end));
    while way.more {
        let axis = nearest(exits);
        let te = max(t, min(least(exits), stop));
        let leaves = least(exits) >= stop;
        // The plane left by has its exact coordinate.
        let q = select(o + te * d, vec3<f32>(c + up), axis & vec3(!leaves));
        way.work++;
        if is_set(mask, c + 2) {
            cast_cell(Segment(c + centre, p - vec3<f32>(c), q - vec3<f32>(c), t, te));
        } else {
            way.carries = false;
        }
        if leaves {
            return;
        }
        c = select(c, c + step, axis);
        exits = select(exits, select((vec3<f32>(c + up) - o) * inverse, vec3(FAR), c == end), axis);
        t = te;
        p = q;
    }
    note_cut();
}

fn cast_ray(ray: Ray, d: vec3<f32>) {
    let flat = d == vec3(0.0);
    let inverse = select(1.0 / select(d, vec3(1.0), flat), vec3(0.0), flat);
    let o = vec3<f32>(ray.cell) + vec3<f32>(ray.fraction) * FRACTION;
    let up = select(vec3(0), vec3(1), d >= vec3(0.0));
    let step = 2 * up - 1;
    let stop = f32(ray.length & 0xffffu) + ray.rest;
    let last = (vec3<i32>(params.cells) - 1) >> vec3(2u);
    var brick = clamp(vec3<i32>(ray.cell) >> vec3(2u), vec3(0), last);
    var t = 0.0;
    while way.more {
        let at = brick >> vec3(2u);
        let node = nodes[(u32(at.z) * params.nodes.y + u32(at.y)) * params.nodes.x + u32(at.x)];
        if (node.lo | node.hi) != 0u {
            var exits = select((vec3<f32>((brick + up) * 4) - o) * inverse, vec3(FAR), flat);
            while way.more && all((brick >> vec3(2u)) == at) {
                let axis = nearest(exits);
                let te = min(least(exits), stop);
                if is_set(vec2(node.lo, node.hi), brick) {
                    let b = vec3<u32>(brick) & vec3(3u);
                    let bit = ((b.z & 1u) << 4u) | (b.y << 2u) | b.x;
                    let below = (1u << bit) - 1u;
                    let before = select(
                        countOneBits(node.lo & below),
                        countOneBits(node.lo) + countOneBits(node.hi & below),
                        b.z >= 2u,
                    );
                    cast_brick(ray, d, inverse, brick, cells[node.first + before], t, max(t, te));
                } else {
                    way.carries = false;
                }
                if least(exits) >= stop {
                    return;
                }
                brick = select(brick, brick + step, axis);
                if any(brick < vec3(0)) || any(brick > last) {
                    return;
                }
                t = max(t, te);
                exits = select(exits, (vec3<f32>((brick + up) * 4) - o) * inverse, axis);
            }
        } else {
            way.carries = false;
            let exits = select((vec3<f32>((at + up) * 16) - o) * inverse, vec3(FAR), flat);
            let axis = nearest(exits);
            if least(exits) >= stop {
                return;
            }
            t = max(t, least(exits));
            let here = clamp(vec3<i32>(floor(o + t * d)) >> vec3(2u), at * 4, min(at * 4 + 3, last));
            brick = select(here, select(at * 4 - 1, at * 4 + 4, d >= vec3(0.0)), axis);
            if any(brick < vec3(0)) || any(brick > last) {
                return;
            }
        }
    }
    note_cut();
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let count = arrayLength(&pixels);
    let i = id.y * params.width + id.x;
    if id.x >= params.width || i >= count {
        return;
    }
    let ray = rays[i];
    way.pixel = i;
    way.whole = 0u;
    way.found = 0u;
    way.work = 0u;
    way.carry = 0.0;
    way.carries = false;
    way.last_level = NONE;
    way.last_u = 0.0;
    way.tail = false;
    way.dip = NONE;
    way.colour = vec4(0.0);
    way.more = (ray.length & 0x80000000u) == 0u;
    if way.more {
        let size = vec3<f32>(ray.direction) * FRACTION;
        let falls = vec3((ray.length & 0x10000u) != 0u, (ray.length & 0x20000u) != 0u, (ray.length & 0x40000u) != 0u);
        let d = select(size, -size, falls);
        way.seen = unit(params.axes * d);
        cast_ray(ray, d);
    }
    pixels[i] = Pixel(way.colour.x, way.colour.y, way.colour.z, way.colour.w, way.found, way.work);
}
