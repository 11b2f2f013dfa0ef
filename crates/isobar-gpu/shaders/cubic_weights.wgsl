// Weights of the uniform cubic B-spline on a cell, and their derivatives.

const SIXTH: f32 = 1.0 / 6.0;

fn weights(w: f32) -> vec4<f32> {
    let v = 1.0 - w;
    let ww = w * w;
    let vv = v * v;
    return vec4(SIXTH * vv * v, SIXTH * (4.0 - 3.0 * ww * (1.0 + v)), SIXTH * (4.0 - 3.0 * vv * (1.0 + w)), SIXTH * ww * w);
}

fn slopes(w: f32) -> vec4<f32> {
    let v = 1.0 - w;
    return vec4(-0.5 * v * v, w * (1.5 * w - 2.0), v * (2.0 - 1.5 * v), 0.5 * w * w);
}
