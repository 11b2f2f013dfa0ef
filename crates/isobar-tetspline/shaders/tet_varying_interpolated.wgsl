struct Varying {
    @builtin(position) @invariant position: vec4<f32>,
    @location(0) @interpolate(flat) cube: vec4<i32>,
    @location(1) @interpolate(flat) b0: vec4<f32>,
    @location(2) @interpolate(flat) b1: vec4<f32>,
    @location(3) @interpolate(flat) b2: vec4<f32>,
    @location(4) @interpolate(flat) b3: vec4<f32>,
    @location(5) @interpolate(flat) b4: vec4<f32>,
    @location(6) phi: vec4<f32>,
    @location(7) phi_behind: vec4<f32>,
}

// K12 as printed: the second point is the vertex moved by a unit vector away from the eye. Interpolated over a face the two are not exactly on one line with the eye.
fn set_ray(out: ptr<function, Varying>, c: vec3<f32>, p: vec3<f32>, axes: mat3x3<f32>) {
    (*out).phi = barycentric(c);
    var d = view.eye;
    if view.parallel == 0u {
        d = p - view.eye;
    }
    (*out).phi_behind = barycentric(c) + barycentric_step(normalize(d) * axes);
}
