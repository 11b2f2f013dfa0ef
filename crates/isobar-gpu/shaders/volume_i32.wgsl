@group(0) @binding(0) var volume: texture_3d<i32>;

// 16-bit integers are exact in f32.
fn texel(p: vec3<i32>) -> f32 {
    return f32(textureLoad(volume, p, 0).x);
}
