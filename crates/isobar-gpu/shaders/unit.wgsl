// A unit vector along v; zero where v vanishes. Scaled first, so that no square overflows or vanishes.
fn unit(v: vec3<f32>) -> vec3<f32> {
    let largest = max(abs(v.x), max(abs(v.y), abs(v.z)));
    if largest > 0.0 {
        return normalize(v / largest);
    }
    return vec3(0.0);
}
