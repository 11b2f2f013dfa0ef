// One ray per invocation: samples at a fixed step, bisection where the class changes. Twin of src/march (march/cpu), in f32 and with
// distances u in voxels behind the entry into the domain.

@group(0) @binding(2) var<storage, read> rays: array<Ray>;
@group(0) @binding(3) var<storage, read> ranges: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> levels: array<Level>;
@group(0) @binding(5) var<storage, read_write> hits: array<Hit>;
@group(0) @binding(6) var<storage, read_write> pixels: array<Pixel>;

// Rounding of an evaluation, relative to the largest coefficient of the block: a block counts as free of an isovalue only beyond it. 64
// products and sums of f32 stay far below 2^-18.
const SLACK: f32 = 3.8147e-6;

// Further than any ray is long, in voxels.
const FAR: f32 = 1e30;

fn position(ray: Ray, u: f32) -> vec3<f32> {
    return clamp(ray.origin + u * ray.direction, vec3(0.0), params.last);
}

// How many isovalues are not above s: a surface lies between two samples of different class.
fn class_of(s: f32) -> u32 {
    var n = 0u;
    while n < params.levels && s >= levels[n].value {
        n++;
    }
    return n;
}

// Where the ray is among the blocks: the way to the block's end, and whether an isovalue lies in the block's range, else its class.
struct Found {
    is_active: bool,
    class_here: u32,
    ahead: f32,
}

fn block_at(p: vec3<f32>, n: vec3<u32>, side: u32) -> vec3<u32> {
    return min(vec3<u32>(p / f32(side)), n - 1u);
}

// (class of the lower, class of the upper end) of the range of block i.
fn classes(i: u32) -> vec2<u32> {
    let r = (ranges[i] - params.bias_hi) - params.bias_lo;
    let slack = SLACK * max(abs(r.x), abs(r.y));
    return vec2(class_of(r.x - slack), class_of(r.y + slack));
}

fn ahead(p: vec3<f32>, direction: vec3<f32>, b: vec3<u32>, side: u32) -> f32 {
    let face = vec3<f32>((b + select(vec3(0u), vec3(1u), direction > vec3(0.0))) * side);
    let flat = abs(direction) < vec3(1e-12);
    let way = select((face - p) / select(direction, vec3(1.0), flat), vec3(FAR), flat);
    return max(min(way.x, min(way.y, way.z)), 0.0);
}

fn find(p: vec3<f32>, direction: vec3<f32>) -> Found {
    let n = params.fine;
    let b = block_at(p, n, params.fine_side);
    let fine = classes((b.z * n.y + b.y) * n.x + b.x);
    if fine.x != fine.y {
        return Found(true, 0u, ahead(p, direction, b, params.fine_side));
    }
    let m = params.coarse;
    let c = block_at(p, m, params.coarse_side);
    let coarse = classes(n.x * n.y * n.z + (c.z * m.y + c.y) * m.x + c.x);
    if coarse.x != coarse.y {
        return Found(false, fine.x, ahead(p, direction, b, params.fine_side));
    }
    return Found(false, coarse.x, ahead(p, direction, c, params.coarse_side));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let count = arrayLength(&pixels);
    let i = id.y * params.width + id.x;
    if id.x >= params.width || i >= count {
        return;
    }
    let ray = rays[i];
    let last = u32(ceil(max(ray.length, 0.0) / params.step));
    let seen = unit(params.axes * ray.direction);
    var colour = vec4(0.0);
    var found = 0u;
    var work = 0u;
    var before = 0u;
    var k = 0u;
    // Samples before this one lie in a block known to be active.
    var known = 0u;
    var more = ray.length >= 0.0;
    while more {
        let u = min(f32(k) * params.step, ray.length);
        let p = position(ray, u);
        var next = k + 1u;
        var now = 0u;
        var sampled = true;
        if (params.flags & SKIP) != 0u && k >= known {
            let f = find(p, ray.direction);
            let end = min(u32((u + f.ahead) / params.step), last);
            if f.is_active {
                known = end + 1u;
            } else {
                // All samples in the block have its class: go on at the last of them.
                sampled = false;
                now = f.class_here;
                next = max(next, end);
            }
        }
        if sampled {
            now = class_of(value(p));
            work++;
        }
        if k == 0u {
            before = now;
        }
        // The isovalues between the classes, in the order in which the ray meets them.
        while now != before && more {
            let rising = now > before;
            let j = select(before - 1u, before, rising);
            let level = levels[j];
            var lo = min(f32(k - 1u) * params.step, ray.length);
            var hi = u;
            for (var n = 0u; n < params.bisections; n++) {
                let mid = 0.5 * (lo + hi);
                if mid <= lo || mid >= hi {
                    break;
                }
                work++;
                if (value(position(ray, mid)) >= level.value) == rising {
                    hi = mid;
                } else {
                    lo = mid;
                }
            }
            let at = 0.5 * (lo + hi);
            let shaded = (params.flags & COLOUR) != 0u && colour.w < 1.0;
            var normal = vec3(0.0);
            if shaded || ((params.flags & NORMALS) != 0u && found < params.layers) {
                normal = unit(params.gradients * gradient(position(ray, at)));
            }
            if found < params.layers {
                hits[found * count + i] = Hit(at, level.surface, normal.x, normal.y, normal.z);
            }
            if shaded {
                let c = shade(level.colour, normal, seen) * level.opacity;
                colour = over(colour, vec4(c, level.opacity));
            }
            found++;
            more = found < params.layers || (params.flags & COUNT_ALL) != 0u || ((params.flags & COLOUR) != 0u && colour.w < 1.0);
            before = select(before - 1u, before + 1u, rising);
        }
        more = more && k < last;
        k = next;
    }
    if more {
        work = CUT;
    }
    pixels[i] = Pixel(colour.x, colour.y, colour.z, colour.w, found, work);
}
