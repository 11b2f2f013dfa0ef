// K15, the paper's three Newton sequences as printed: starts 0, 1/2 and 1 folded into the first step, four more steps. Which result is valid is for the caller: all barycentric
// coordinates there must be positive.

fn newton_step(m: vec4<f32>, t: f32) -> f32 {
    return (t * t * (m.z + 2.0 * t * m.w) - m.x) / (t * (2.0 * m.z + 3.0 * t * m.w) + m.y);
}

fn newton_sequences(m: vec4<f32>) -> vec3<f32> {
    var t = vec3(
        -m.x / m.y,
        (0.25 * (m.w + m.z) - m.x) / (0.75 * m.w + m.z + m.y),
        (2.0 * m.w + m.z - m.x) / (3.0 * m.w + 2.0 * m.z + m.y),
    );
    for (var i = 0; i < 4; i++) {
        t = vec3(newton_step(m, t.x), newton_step(m, t.y), newton_step(m, t.z));
    }
    return t;
}
