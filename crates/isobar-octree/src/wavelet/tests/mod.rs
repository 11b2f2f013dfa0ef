//! Tests of the wavelets: exact where numbers allow it.

mod banks;
mod borders;
mod dyadic;
mod exact;
mod multires;
mod rays;
mod real;

/// Numbers that look random, from -128 to 127.
fn noise(n: usize, seed: u64) -> Vec<i32> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    (0..n)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 40) as i32 % 256 - 128
        })
        .collect()
}
