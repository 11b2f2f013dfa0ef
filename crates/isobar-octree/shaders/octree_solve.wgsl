// Roots of the polynomial of a cell, left to right, for all isovalues at once. Where all coefficients of a part are clear of an isovalue there is
// no root (convex hull); where they are monotone, or change sign once, there is exactly one, found by Newton's method inside a
// shrinking bracket; other parts are halved. What stays within the rounding of the coefficients is a touching point, reported once.

// Rounding of a coefficient, relative to the largest of the cell: 4 units of 2^-24.
const GUARD: f32 = 2.3842e-7;
// Parts are halved this often at most.
const DEEPEST: u32 = 20u;
// Roots of one isovalue nearer together than this, in half voxels, are one.
const SAME: f32 = 4e-6;
// A dip to an isovalue on a face is looked at from this part of a cell away.
const NEAR: f32 = 0.0078125;
const NONE: u32 = 0xffffffffu;

// The root of p - v on [0, 1], whose ends differ in sign. An end at which p - v is exactly 0 may be another root (a face that the surface
// coincides with): only what lies strictly inside the bracket is taken.
fn refine(p: Poly, v: f32) -> f32 {
    let first = first_of(p) - v;
    let last = last_of(p) - v;
    let negative = first < 0.0;
    var lo = 0.0;
    var hi = 1.0;
    var x = clamp(first / (first - last), 0.0, 1.0);
    for (var i = 0u; i < 40u; i++) {
        let f = evaluate(p, x);
        let value = f.x - v;
        if value == 0.0 && x > lo && x < hi {
            break;
        }
        if (value < 0.0) == negative {
            lo = x;
        } else {
            hi = x;
        }
        let newton = x - value / f.y;
        // Anything outside the bracket, and NaN, falls back to halving it; so does a step when Newton's method is slow.
        var next = 0.5 * (lo + hi);
        if newton > lo && newton < hi && i < 12u {
            next = newton;
        }
        let step = abs(next - x);
        x = next;
        if step <= 6e-8 {
            break;
        }
    }
    return x;
}

// What the walk and the solver keep of a ray.
struct Way {
    pixel: u32,
    // half voxels to the point from which u is counted in this brick
    whole: u32,
    found: u32,
    work: u32,
    more: bool,
    // s - bias at the end of the cell before, where that was looked at
    carry: f32,
    carries: bool,
    // level and place (in u) of the last hit, or of the end of the stretch that it began
    last_level: u32,
    last_u: f32,
    // whether s stays within the guard of that level from there to the end of the cell before
    tail: bool,
    // level that the cell before ended within the guard of without a root there, and on which side it came from
    dip: u32,
    dip_below: bool,
    colour: vec4<f32>,
    seen: vec3<f32>,
}
var<private> way: Way;

// The segment of a ray in a cell.
struct Segment {
    cell: vec3<i32>,
    // cell coordinates of entry and exit
    a: vec3<f32>,
    b: vec3<f32>,
    u0: f32,
    u1: f32,
}

// Reports the root x of level j.
fn emit(s: Segment, j: u32, x: f32) {
    let u = s.u0 + x * (s.u1 - s.u0);
    if j == way.last_level && u - way.last_u <= SAME {
        way.last_u = max(u, way.last_u);
        return;
    }
    way.last_level = j;
    way.last_u = u;
    way.tail = false;
    let level = levels[j];
    let shaded = (params.flags & COLOUR) != 0u && way.colour.w < 1.0;
    var normal = vec3(0.0);
    if shaded || ((params.flags & NORMALS) != 0u && way.found < params.layers) {
        normal = unit(params.gradients * gradient(s.cell, s.a + x * (s.b - s.a)));
    }
    if way.found < params.layers {
        hits[way.found * arrayLength(&pixels) + way.pixel] = Hit(way.whole, u, level.surface, normal.x, normal.y, normal.z);
    }
    if shaded {
        let c = shade(level.colour, normal, way.seen) * level.opacity;
        way.colour = over(way.colour, vec4(c, level.opacity));
    }
    way.found++;
    way.more = way.found < params.layers || (params.flags & COUNT_ALL) != 0u
        || ((params.flags & COLOUR) != 0u && way.colour.w < 1.0);
}

fn roots(p: Poly, s: Segment) {
    let whole = bounds(p);
    let guard = GUARD * max(abs(whole.x), abs(whole.y));
    // Nothing near any isovalue: the common case.
    var j0 = 0u;
    while j0 < params.levels && levels[j0].value < whole.x - guard {
        j0++;
    }
    if j0 == params.levels || levels[j0].value > whole.y + guard {
        way.tail = false;
        way.dip = NONE;
        return;
    }
    // A touching point on the face to the cell before, without a change of sign.
    if way.dip != NONE {
        let v = levels[way.dip].value;
        let f = evaluate(p, NEAR).x - v;
        if abs(f) > guard && (f < 0.0) == way.dip_below && (first_of(p) < v) == way.dip_below {
            emit(s, way.dip, 0.0);
        }
        way.dip = NONE;
    }
    var depth = 0u;
    var part = 0u;
    // Within this cell: the last root, its level, and the end of the last stretch within the guard.
    var last_x = -1.0;
    var last_j = NONE;
    var touched = -1.0;
    while way.more {
        let width = exp2(-f32(depth));
        let lo = f32(part) * width;
        var c = p;
        if depth > 0u {
            c = part_of(p, lo, lo + width);
        }
        let r = bounds(c);
        var first = j0;
        while first < params.levels && levels[first].value < r.x - guard {
            first++;
        }
        var end = first;
        while end < params.levels && levels[end].value <= r.y + guard {
            end++;
        }
        var split = false;
        if end > first {
            let v = levels[first].value;
            let close = max(abs(r.x - v), abs(r.y - v)) <= guard;
            if (close && end == first + 1u) || depth == DEEPEST {
                // Not to be told from zero: a touching point, or a stretch, which counts at its entry.
                if touched < lo && !(first == way.last_level && way.tail && lo == 0.0) {
                    emit(s, first, select(lo + 0.5 * width, lo, depth == 0u));
                }
                touched = lo + width;
                last_x = touched;
                last_j = first;
                way.last_u = s.u0 + touched * (s.u1 - s.u0);
            } else if is_monotone(c) || (end == first + 1u && changes(c, v) == 1u) {
                let rising = last_of(c) >= first_of(c);
                for (var n = first; n < end && way.more; n++) {
                    let j = select(first + end - 1u - n, n, rising);
                    let value = levels[j].value;
                    if (first_of(c) < value) != (last_of(c) < value) {
                        let x = lo + width * refine(c, value);
                        // Rounding splits a touching point into two roots between which s cannot be told from the isovalue.
                        var again = false;
                        if j == last_j {
                            again = abs(evaluate(p, 0.5 * (last_x + x)).x - value) <= 2.0 * guard;
                        } else if j == way.last_level && way.tail && last_j == NONE {
                            again = abs(evaluate(p, 0.5 * x).x - value) <= 2.0 * guard;
                        }
                        if !again {
                            emit(s, j, x);
                        }
                        last_x = x;
                        last_j = j;
                    }
                }
            } else {
                split = true;
            }
        }
        if split {
            depth++;
            part = part << 1u;
        } else {
            part++;
            while depth > 0u && (part & 1u) == 0u {
                part = part >> 1u;
                depth--;
            }
            if depth == 0u {
                break;
            }
        }
    }
    if way.more && depth > 0u {
        way.work = CUT;
        way.more = false;
    }
    way.tail = false;
    if last_j != NONE {
        let v = levels[last_j].value;
        way.tail = last_j == way.last_level && abs(last_of(p) - v) <= 2.0 * guard
            && abs(evaluate(p, 0.5 * (last_x + 1.0)).x - v) <= 2.0 * guard;
    }
    for (var j = j0; j < params.levels && !way.tail; j++) {
        let v = levels[j].value;
        if abs(last_of(p) - v) <= guard {
            let f = evaluate(p, 1.0 - NEAR).x - v;
            if abs(f) > guard && (f < 0.0) == (last_of(p) < v) {
                way.dip = j;
                way.dip_below = f < 0.0;
            }
        }
    }
}
