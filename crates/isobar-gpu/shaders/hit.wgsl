// The twin of isobar_gpu::bands::Hit.
struct Hit {
    // distance behind the entry
    u: f32,
    surface: u32,
    normal_x: f32,
    normal_y: f32,
    normal_z: f32,
}
