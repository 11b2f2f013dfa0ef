//! Exact numbers m / 2^e: the whole transform, with no rounding.

use crate::wavelet::Number;
use std::ops::{Add, Mul};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Dyadic {
    m: i128,
    e: u32,
}

impl Dyadic {
    pub(super) fn int(m: i64) -> Self {
        Self { m: m.into(), e: 0 }
    }

    /// Lowest terms, so that equal numbers are equal.
    fn reduced(m: i128, e: u32) -> Self {
        let shift = if m == 0 { e } else { m.trailing_zeros().min(e) };
        Self {
            m: m >> shift,
            e: e - shift,
        }
    }

    fn up(self, e: u32) -> i128 {
        let m = self.m.checked_mul(1i128 << (e - self.e));
        m.expect("the test's numbers fit in 128 bits")
    }
}

impl Add for Dyadic {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        let e = self.e.max(o.e);
        Self::reduced(self.up(e).checked_add(o.up(e)).expect("fits"), e)
    }
}

impl Mul for Dyadic {
    type Output = Self;
    #[expect(clippy::suspicious_arithmetic_impl, reason = "exponents add")]
    fn mul(self, o: Self) -> Self {
        Self::reduced(self.m.checked_mul(o.m).expect("fits"), self.e + o.e)
    }
}

impl Number for Dyadic {
    fn dyadic(numerator: i32, log2: u32) -> Self {
        Self::reduced(numerator.into(), log2)
    }

    fn to_f64(self) -> f64 {
        self.m as f64 / 2f64.powi(self.e as i32)
    }
}
