// Where a ray is sampled: Knoll et al. 2009, section 5. The twin of src/sampling.rs, counted from the last sample at or before the entry.

@group(0) @binding(2) var<storage, read_write> rays: array<Ray>;

// The ray of this invocation.
var<private> ray: Ray;

// exp(x) - 1.
fn exp_less_one(x: f32) -> f32 {
    if abs(x) < 0.125 {
        return x * (1.0 + x / 2.0 * (1.0 + x / 3.0 * (1.0 + x / 4.0 * (1.0 + x / 5.0 * (1.0 + x / 6.0)))));
    }
    return exp(x) - 1.0;
}

// ln(1 + x), x >= 0.
fn log_of_one_more(x: f32) -> f32 {
    if x < 0.0625 {
        return x * (1.0 - x * (0.5 - x * (1.0 / 3.0 - x * (0.25 - x * (0.2 - x / 6.0)))));
    }
    return log(1.0 + x);
}

// x, rounded: WGSL lets a compiler join a product and a sum into one operation with one rounding, here and not there, so that a sample would have two places.
fn rounded(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) ^ params.nothing);
}

// The place of sample k: the same bits wherever it is asked for.
fn place(k: f32) -> f32 {
    if params.law == GEOMETRIC {
        return ray.first + rounded(ray.step * exp_less_one(ray.growth * k));
    }
    return ray.first + rounded(k * (ray.step + rounded(0.5 * ray.growth * k)));
}

// The last sample at or before u, whatever the rounding of the inverse.
fn sample_before(u: f32) -> f32 {
    let s = max(u - ray.first, 0.0);
    var k = 0.0;
    if params.law == GEOMETRIC {
        k = floor(log_of_one_more(s / ray.step) / ray.growth);
    } else {
        k = floor(2.0 * s / (ray.step + sqrt(ray.step * ray.step + 2.0 * ray.growth * s)));
    }
    k = max(k, 0.0);
    if k > 0.0 && place(k) > u {
        k -= 1.0;
    }
    if place(k + 1.0) <= u {
        k += 1.0;
    }
    return k;
}
