// The ray as the rasteriser interpolates it, on front faces, as printed: its parameter 0 is on the face.

const UNIT: f32 = 1.0;

fn span_of(in: Varying, pixel: vec2<u32>, axes: mat3x3<f32>) -> Span {
    let step = in.phi_behind - in.phi;
    let s = inside(in.phi, step, 0.0);
    // A face's own coordinate is 0 up to rounding, and leads inside.
    var to_s = s.y;
    var from_s = 0.0;
    // The domain and the clipping planes, in coordinates about the origin.
    let p = point_of(in, in.phi, axes);
    let d = point_of(in, in.phi_behind, axes) - p;
    for (var i = 0u; i < view.planes; i++) {
        let rest = view.plane[i].w - dot(view.plane[i].xyz, p);
        let rate = dot(view.plane[i].xyz, d);
        if rate == 0.0 {
            to_s = select(to_s, -FAR, rest < 0.0);
        } else if rate > 0.0 {
            to_s = min(to_s, rest / rate);
        } else {
            from_s = max(from_s, rest / rate);
        }
    }
    return Span(in.phi, step, from_s, to_s, 0u, 0u);
}

fn point_of(in: Varying, phi: vec4<f32>, axes: mat3x3<f32>) -> vec3<f32> {
    let c = vec3(0.5 * (1.0 - phi.x), 0.5 * (phi.z + phi.w), 0.5 * (phi.z - phi.w));
    return vec3<f32>(in.cube.xyz) + axes * c;
}

fn behind_layer(pixel: vec2<u32>, span: Span) -> Before {
    return Before(0.0, 255u, 0);
}

// The distance from the eye, in f32, and as a depth: a power of two times smaller.
fn placed(in: Varying, span: Span, s: f32, phi: vec4<f32>, axes: mat3x3<f32>, word: u32, normal: vec2<u32>) -> Out {
    let p = point_of(in, phi, axes);
    var t = dot(view.along.xyz, p) + view.along.w;
    if view.parallel == 0u {
        t = length(view.axes * (p - view.eye));
    }
    return Out(vec4(bitcast<u32>(t), word | WORLD, normal), clamp(t * view.depth_scale, 0.0, 1.0));
}
