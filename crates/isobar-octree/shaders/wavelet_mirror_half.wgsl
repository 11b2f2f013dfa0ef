// The slot that stands for slot i of a line of n, and the factor of its value: mirrored half a step beyond the last sample; details change their sign.
fn mirrored(i: i32, n: i32) -> vec2<i32> {
    if i >= 0 && i < n {
        return vec2(i, 1);
    }
    let odd = i & 1;
    let r = (i >> 1u) % n;
    let k = select(r, r + n, r < 0);
    if k < (n + 1 - odd) / 2 {
        return vec2(2 * k + odd, 1);
    }
    if odd == 1 && 2 * k + 1 == n {
        return vec2(0, 0);
    }
    return vec2(2 * (n - 1 - k) + odd, 1 - 2 * odd);
}
