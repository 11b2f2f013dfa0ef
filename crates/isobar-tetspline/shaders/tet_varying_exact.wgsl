struct Varying {
    @builtin(position) @invariant position: vec4<f32>,
    @location(0) @interpolate(flat) cube: vec4<i32>,
    @location(1) @interpolate(flat) b0: vec4<f32>,
    @location(2) @interpolate(flat) b1: vec4<f32>,
    @location(3) @interpolate(flat) b2: vec4<f32>,
    @location(4) @interpolate(flat) b3: vec4<f32>,
    @location(5) @interpolate(flat) b4: vec4<f32>,
}

fn set_ray(out: ptr<function, Varying>, c: vec3<f32>, p: vec3<f32>, axes: mat3x3<f32>) {}
