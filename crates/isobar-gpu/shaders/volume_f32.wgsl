@group(0) @binding(0) var volume: texture_3d<f32>;

fn texel(p: vec3<i32>) -> f32 {
    return textureLoad(volume, p, 0).x;
}
