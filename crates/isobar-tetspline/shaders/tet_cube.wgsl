// The 27 data of a cube and whether they can meet an isovalue.

@group(0) @binding(2) var<storage, read> levels: array<Level>;

// What rounding may hide, as a part of the greatest |datum - bias| of the cube: coefficients are off by some 12 units of 2^-24.
const SLACK: f32 = 3.8146973e-6;

// Whether a hull, in units of 1/scale, holds an isovalue.
fn meets(lo: f32, hi: f32, scale: f32, slack: f32) -> bool {
    for (var j = 0u; j < params.levels; j++) {
        let v = levels[j].value * scale;
        if lo - slack <= v && v <= hi + slack {
            return true;
        }
    }
    return false;
}

// Least and greatest of the 27 data.
fn data_hull(q: vec3<i32>) -> vec2<f32> {
    let first = datum(q);
    var hull = vec2(first, first);
    for (var z = -1; z <= 1; z++) {
        for (var y = -1; y <= 1; y++) {
            for (var x = -1; x <= 1; x++) {
                let d = datum(q + vec3(x, y, z));
                hull = vec2(min(hull.x, d), max(hull.y, d));
            }
        }
    }
    return hull;
}

fn slack_of(hull: vec2<f32>) -> f32 {
    return SLACK * max(abs(hull.x), abs(hull.y));
}
