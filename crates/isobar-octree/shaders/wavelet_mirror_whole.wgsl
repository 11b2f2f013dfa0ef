// The slot that stands for slot i of a line of n, and the factor of its value: mirrored about the last sample.
fn mirrored(i: i32, n: i32) -> vec2<i32> {
    if i >= 0 && i < n {
        return vec2(i, 1);
    }
    if n == 1 {
        return vec2(0, 1 - (i & 1));
    }
    let period = 2 * (n - 1);
    let r = i % period;
    let m = select(r, r + period, r < 0);
    return vec2(select(m, period - m, m >= n), 1);
}
