// What the pass before has left.
fn load(v: vec3<i32>) -> f32 {
    return source[at(v)];
}
