// Trilinear interpolation in f32 by eight explicit loads. `u` lies in the domain. Interpolation along z, y, x is exact where the ends are
// equal.

struct Cell {
    base: vec3<i32>,
    w: vec3<f32>,
}

fn cell_of(u: vec3<f32>) -> Cell {
    let c = min(floor(u), params.last - 1.0);
    return Cell(vec3<i32>(c), u - c);
}

// The eight corners: z = 0 and z = 1, each (00, 10, 01, 11) in x, y.
struct Corners {
    lo: vec4<f32>,
    hi: vec4<f32>,
}

fn corners(b: vec3<i32>) -> Corners {
    return Corners(
        vec4(
            coefficient(b),
            coefficient(b + vec3(1, 0, 0)),
            coefficient(b + vec3(0, 1, 0)),
            coefficient(b + vec3(1, 1, 0)),
        ),
        vec4(
            coefficient(b + vec3(0, 0, 1)),
            coefficient(b + vec3(1, 0, 1)),
            coefficient(b + vec3(0, 1, 1)),
            coefficient(b + vec3(1, 1, 1)),
        ),
    );
}

fn value(u: vec3<f32>) -> f32 {
    let cell = cell_of(u);
    let c = corners(cell.base);
    let z = c.lo + cell.w.z * (c.hi - c.lo);
    let y = z.xy + cell.w.y * (z.zw - z.xy);
    return y.x + cell.w.x * (y.y - y.x);
}

fn gradient(u: vec3<f32>) -> vec3<f32> {
    let cell = cell_of(u);
    let c = corners(cell.base);
    let w = cell.w;
    let z = c.lo + w.z * (c.hi - c.lo);
    let y = z.xy + w.y * (z.zw - z.xy);
    let dy = z.zw - z.xy;
    let d = c.hi - c.lo;
    let dz = d.xy + w.y * (d.zw - d.xy);
    return vec3(y.y - y.x, dy.x + w.x * (dy.y - dy.x), dz.x + w.x * (dz.y - dz.x));
}
