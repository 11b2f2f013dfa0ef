// Weights on a cell of the filter of Mitchell and Netravali with B = 2, C = 1, and their derivatives. Some are negative.

const SIXTH: f32 = 1.0 / 6.0;

fn weights(w: f32) -> vec4<f32> {
    let ww = w * w;
    return SIXTH * vec4(
        2.0 + w * (-12.0 + w * (18.0 - 8.0 * w)),
        2.0 + ww * (12.0 - 12.0 * w),
        2.0 + w * (12.0 + w * (-24.0 + 12.0 * w)),
        ww * (-6.0 + 8.0 * w),
    );
}

fn slopes(w: f32) -> vec4<f32> {
    return vec4(-2.0 + w * (6.0 - 4.0 * w), w * (4.0 - 6.0 * w), 2.0 + w * (-8.0 + 6.0 * w), w * (-2.0 + 4.0 * w));
}
