// The kinds of a cube whose coefficients can meet an isovalue; `slack` in units of 1/192.
fn kinds_of(q: vec3<i32>, slack: f32) -> u32 {
    return kinds(
        datum(q + vec3(-1, -1, -1)), datum(q + vec3(0, -1, -1)), datum(q + vec3(1, -1, -1)),
        datum(q + vec3(-1, 0, -1)), datum(q + vec3(0, 0, -1)), datum(q + vec3(1, 0, -1)),
        datum(q + vec3(-1, 1, -1)), datum(q + vec3(0, 1, -1)), datum(q + vec3(1, 1, -1)),
        datum(q + vec3(-1, -1, 0)), datum(q + vec3(0, -1, 0)), datum(q + vec3(1, -1, 0)),
        datum(q + vec3(-1, 0, 0)), datum(q), datum(q + vec3(1, 0, 0)),
        datum(q + vec3(-1, 1, 0)), datum(q + vec3(0, 1, 0)), datum(q + vec3(1, 1, 0)),
        datum(q + vec3(-1, -1, 1)), datum(q + vec3(0, -1, 1)), datum(q + vec3(1, -1, 1)),
        datum(q + vec3(-1, 0, 1)), datum(q + vec3(0, 0, 1)), datum(q + vec3(1, 0, 1)),
        datum(q + vec3(-1, 1, 1)), datum(q + vec3(0, 1, 1)), datum(q + vec3(1, 1, 1)),
        slack,
    );
}
