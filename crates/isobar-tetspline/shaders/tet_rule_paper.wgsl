// Cubes by their determining set alone, as printed (Kalbe et al. 2009, section 4.1): not conservative.
fn is_active(q: vec3<i32>) -> bool {
    return determining_set_meets(
        datum(q + vec3(-1, -1, -1)), datum(q + vec3(0, -1, -1)), datum(q + vec3(1, -1, -1)),
        datum(q + vec3(-1, 0, -1)), datum(q + vec3(0, 0, -1)), datum(q + vec3(1, 0, -1)),
        datum(q + vec3(-1, 1, -1)), datum(q + vec3(0, 1, -1)), datum(q + vec3(1, 1, -1)),
        datum(q + vec3(-1, -1, 0)), datum(q + vec3(0, -1, 0)), datum(q + vec3(1, -1, 0)),
        datum(q + vec3(-1, 0, 0)), datum(q), datum(q + vec3(1, 0, 0)),
        datum(q + vec3(-1, 1, 0)), datum(q + vec3(0, 1, 0)), datum(q + vec3(1, 1, 0)),
        datum(q + vec3(-1, -1, 1)), datum(q + vec3(0, -1, 1)), datum(q + vec3(1, -1, 1)),
        datum(q + vec3(-1, 0, 1)), datum(q + vec3(0, 0, 1)), datum(q + vec3(1, 0, 1)),
        datum(q + vec3(-1, 1, 1)), datum(q + vec3(0, 1, 1)), datum(q + vec3(1, 1, 1)),
    );
}
