// The twins of isobar_gpu::levels::Level and isobar_gpu::bands::Pixel.

// An isovalue less the bias, with its surface; ascending.
struct Level {
    value: f32,
    opacity: f32,
    surface: u32,
    unused: u32,
    colour: vec3<f32>,
    unused_1: f32,
}

// The work of a pixel whose loops the driver ended before the shader did (software Vulkan does so after 65,535 turns in all, without an error): its
// hits are not all, and `Bands::read` refuses the frame.
const CUT: u32 = 0xffffffffu;

struct Pixel {
    red: f32,
    green: f32,
    blue: f32,
    alpha: f32,
    hits: u32,
    work: u32,
}
