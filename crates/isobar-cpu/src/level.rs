//! Run-time choice of the instruction set.

use std::fmt;
use std::str::FromStr;

/// An instruction set a kernel is compiled for.
///
/// Kernels are written once in portable Rust and compiled for every level; none uses fused multiply-add, so that all levels give the
/// same bits (Rust never fuses on its own).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// What every processor of the target has (SSE2 on x86-64).
    Scalar,
    /// AVX2 with BMI2.
    Avx2,
    /// AVX-512 F, VL, DQ and BW.
    Avx512,
}

impl Level {
    /// All levels, ascending.
    pub const ALL: [Self; 3] = [Self::Scalar, Self::Avx2, Self::Avx512];

    /// Whether this machine has it.
    #[must_use]
    pub fn is_available(self) -> bool {
        match self {
            Self::Scalar => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                // All that the functions compiled for it may use; a virtual machine may mask any of them.
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("lzcnt")
                    && is_x86_feature_detected!("popcnt")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// The best level of this machine, but not above the environment variable `ISOBAR_SIMD` (`scalar`, `avx2`, `avx512`; other words
    /// are ignored).
    #[must_use]
    pub fn detect() -> Self {
        let cap = std::env::var("ISOBAR_SIMD")
            .ok()
            .and_then(|s| s.parse().ok())
            .unwrap_or(Self::Avx512);
        Self::best(cap)
    }

    /// The best level of this machine not above `cap`.
    #[must_use]
    pub fn best(cap: Self) -> Self {
        Self::ALL
            .into_iter()
            .rev()
            .find(|l| *l <= cap && l.is_available())
            .unwrap_or(Self::Scalar)
    }

    /// Runs a kernel compiled for this level, or for the best one below it where the machine lacks it. Worth calling per tile, not per
    /// ray: the check and the call cost some nanoseconds, and nothing is inlined across.
    #[inline]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        {
            if self == Self::Avx512 && self.is_available() {
                #[expect(
                    unsafe_code,
                    reason = "calling a function compiled for features the line above has detected"
                )]
                // SAFETY: `is_available` has checked every feature that `avx512` enables.
                return unsafe { avx512(kernel) };
            }
            if self >= Self::Avx2 && Self::Avx2.is_available() {
                #[expect(
                    unsafe_code,
                    reason = "calling a function compiled for features the line above has detected"
                )]
                // SAFETY: `is_available` has checked every feature that `avx2` enables.
                return unsafe { avx2(kernel) };
            }
        }
        kernel.run()
    }

    /// Runs a kernel compiled for [`Level::Avx2`] alone: for kernels whose types hold registers of that level, which [`Level::run`] would
    /// compile for the two others as well.
    ///
    /// # Panics
    /// Where the machine lacks the level.
    #[cfg(target_arch = "x86_64")]
    #[inline]
    pub fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
        assert!(Self::Avx2.is_available(), "a kernel for AVX2 on a machine without it");
        #[expect(
            unsafe_code,
            reason = "calling a function compiled for features the line above has detected"
        )]
        // SAFETY: `is_available` has checked every feature that `avx2` enables.
        unsafe {
            avx2(kernel)
        }
    }

    /// As [`Level::run_avx2`], for [`Level::Avx512`].
    ///
    /// # Panics
    /// Where the machine lacks the level.
    #[cfg(target_arch = "x86_64")]
    #[inline]
    pub fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
        assert!(Self::Avx512.is_available(), "a kernel for AVX-512 on a machine without it");
        #[expect(
            unsafe_code,
            reason = "calling a function compiled for features the line above has detected"
        )]
        // SAFETY: `is_available` has checked every feature that `avx512` enables.
        unsafe {
            avx512(kernel)
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi1,bmi2,lzcnt,popcnt")]
fn avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Scalar => "scalar",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        })
    }
}

impl FromStr for Level {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|l| l.to_string() == s)
            .ok_or_else(|| format!("{s} is none of scalar, avx2, avx512"))
    }
}

/// Work compiled once per [`Level`].
pub trait Kernel {
    /// What it gives.
    type Output;
    /// Does the work. Mark it, and all it calls that is to use the level's instructions, `#[inline(always)]`.
    fn run(self) -> Self::Output;
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Dot<'a>(&'a [f32], &'a [f32]);
    impl Kernel for Dot<'_> {
        type Output = [f32; 8];
        #[inline(always)]
        fn run(self) -> [f32; 8] {
            let mut sum = [0.0; 8];
            for (a, b) in self.0.as_chunks::<8>().0.iter().zip(self.1.as_chunks::<8>().0) {
                for i in 0..8 {
                    sum[i] += a[i] * b[i];
                }
            }
            sum
        }
    }

    #[test]
    fn all_levels_give_the_same_bits() {
        let a: Vec<f32> = (0..64).map(|i| (i as f32 * 0.37).sin()).collect();
        let b: Vec<f32> = (0..64).map(|i| (i as f32 * 0.73).cos()).collect();
        let want = Dot(&a, &b).run();
        for l in Level::ALL {
            assert_eq!(l.run(Dot(&a, &b)), want, "{l}");
        }
    }

    #[test]
    fn levels_have_names_and_an_order() {
        for l in Level::ALL {
            assert_eq!(l.to_string().parse(), Ok(l));
            assert!(Level::best(l) <= l && Level::best(l).is_available());
        }
        assert!("mmx".parse::<Level>().is_err());
        assert_eq!(Level::best(Level::Scalar), Level::Scalar);
    }
}
