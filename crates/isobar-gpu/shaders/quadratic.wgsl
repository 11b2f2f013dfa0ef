// Uniform quadratic B-spline in f32 by 27 explicit loads. Cells are centred on samples; the texture holds one more coefficient before the
// first and behind the last sample of each axis, so that texel `cell` is coefficient `cell - 1`.

struct Cell {
    base: vec3<i32>,
    w: vec3<f32>,
}

fn cell_of(u: vec3<f32>) -> Cell {
    let c = min(floor(u + 0.5), params.last);
    return Cell(vec3<i32>(c), (u - c) + 0.5);
}

fn weights(w: f32) -> vec3<f32> {
    let v = 1.0 - w;
    return vec3(0.5 * v * v, 0.5 + w * v, 0.5 * w * w);
}

fn slopes(w: f32) -> vec3<f32> {
    return vec3(w - 1.0, 1.0 - 2.0 * w, w);
}

fn row(b: vec3<i32>, x: vec3<f32>) -> f32 {
    return x.x * coefficient(b) + x.y * coefficient(b + vec3(1, 0, 0)) + x.z * coefficient(b + vec3(2, 0, 0));
}

fn plane(b: vec3<i32>, x: vec3<f32>, y: vec3<f32>) -> f32 {
    return y.x * row(b, x) + y.y * row(b + vec3(0, 1, 0), x) + y.z * row(b + vec3(0, 2, 0), x);
}

fn sum(b: vec3<i32>, x: vec3<f32>, y: vec3<f32>, z: vec3<f32>) -> f32 {
    return z.x * plane(b, x, y) + z.y * plane(b + vec3(0, 0, 1), x, y) + z.z * plane(b + vec3(0, 0, 2), x, y);
}

fn value(u: vec3<f32>) -> f32 {
    let cell = cell_of(u);
    return sum(cell.base, weights(cell.w.x), weights(cell.w.y), weights(cell.w.z));
}

fn gradient(u: vec3<f32>) -> vec3<f32> {
    let cell = cell_of(u);
    let x = weights(cell.w.x);
    let y = weights(cell.w.y);
    let z = weights(cell.w.z);
    return vec3(
        sum(cell.base, slopes(cell.w.x), y, z),
        sum(cell.base, x, slopes(cell.w.y), z),
        sum(cell.base, x, y, slopes(cell.w.z)),
    );
}
