// Trilinear interpolation by one emulated hardware fetch; the gradient by differences of fetches a voxel apart.

fn value(u: vec3<f32>) -> f32 {
    let c = min(floor(u), params.last - 1.0);
    return fetch(vec3<i32>(c), u - c);
}

fn gradient(u: vec3<f32>) -> vec3<f32> {
    let c = min(floor(u), params.last - 1.0);
    let b = vec3<i32>(c);
    let w = u - c;
    return vec3(
        fetch(b + vec3(1, 0, 0), vec3(0.0, w.y, w.z)) - fetch(b, vec3(0.0, w.y, w.z)),
        fetch(b + vec3(0, 1, 0), vec3(w.x, 0.0, w.z)) - fetch(b, vec3(w.x, 0.0, w.z)),
        fetch(b + vec3(0, 0, 1), vec3(w.x, w.y, 0.0)) - fetch(b, vec3(w.x, w.y, 0.0)),
    );
}
