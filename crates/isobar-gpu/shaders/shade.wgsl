// Twin of isobar_core::shade: two-sided Lambert, light at the eye, 0.15 ambient; linear colours. Normal and direction are unit vectors; a
// zero normal gives the ambient part.
const AMBIENT: f32 = 0.15;

fn shade(colour: vec3<f32>, normal: vec3<f32>, direction: vec3<f32>) -> vec3<f32> {
    let k = AMBIENT + (1.0 - AMBIENT) * min(abs(dot(normal, direction)), 1.0);
    return colour * k;
}

// `front` over `back`, both linear and premultiplied.
fn over(front: vec4<f32>, back: vec4<f32>) -> vec4<f32> {
    return front + (1.0 - front.w) * back;
}
