//! Sets of values.

/// Closed intervals, ascending and disjoint.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Intervals(Vec<(f64, f64)>);

impl Intervals {
    /// The union of `of`, each grown by `margin` on both sides.
    pub(crate) fn new(of: impl IntoIterator<Item = (f64, f64)>, margin: f64) -> Self {
        let mut all: Vec<_> = of.into_iter().map(|(lo, hi)| (lo - margin, hi + margin)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut out: Vec<(f64, f64)> = Vec::new();
        for (lo, hi) in all {
            match out.last_mut() {
                Some(last) if lo <= last.1 => last.1 = last.1.max(hi),
                _ => out.push((lo, hi)),
            }
        }
        Self(out)
    }

    /// Whether a value of the set lies in [lo, hi].
    #[inline(always)]
    pub(crate) fn meets(&self, lo: f64, hi: f64) -> bool {
        if self.0.len() <= 4 {
            return self.0.iter().any(|&(a, b)| a <= hi && b >= lo);
        }
        let first = self.0.partition_point(|i| i.1 < lo);
        self.0.get(first).is_some_and(|i| i.0 <= hi)
    }

    /// The same in single precision, rounded so that it holds all of these.
    pub(crate) fn outward(&self) -> Bands {
        Bands(self.0.iter().map(|&(lo, hi)| outward(lo, hi)).collect())
    }

    /// The intervals.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.0.iter().copied()
    }
}

/// Rounded to single precision so that it encloses.
pub(crate) fn outward(lo: f64, hi: f64) -> [f32; 2] {
    let (a, b) = (lo as f32, hi as f32);
    [
        if f64::from(a) > lo { a.next_down() } else { a },
        if f64::from(b) < hi { b.next_up() } else { b },
    ]
}

/// Closed intervals of f32, ascending: what many ranges at once are held against.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Bands(Vec<[f32; 2]>);

impl Bands {
    /// The intervals.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &[f32; 2]> {
        self.0.iter()
    }

    /// For each of 64 ranges one bit: those that meet an interval, and those that lie in one. A range that is no number meets none.
    #[inline(always)]
    pub(crate) fn bits(&self, least: &[f32; 64], most: &[f32; 64]) -> (u64, u64) {
        let (mut lo, mut hi) = (f32::INFINITY, f32::NEG_INFINITY);
        let all = &self.0;
        let near = if all.len() <= 8 {
            &all[..]
        } else {
            for i in 0..64 {
                lo = lo.min(least[i]);
                hi = hi.max(most[i]);
            }
            &all[all.partition_point(|b| b[1] < lo)..]
        };
        let (mut meets, mut inside) = ([0u8; 64], [0u8; 64]);
        for &[a, b] in near {
            if all.len() > 8 && a > hi {
                break;
            }
            for i in 0..64 {
                meets[i] |= u8::from(least[i] <= b) & u8::from(most[i] >= a);
                inside[i] |= u8::from(least[i] >= a) & u8::from(most[i] <= b);
            }
        }
        let meets = packed(&meets);
        (meets, meets & packed(&inside))
    }
}

/// Bit i is byte i, which is 0 or 1.
#[inline(always)]
pub(crate) fn packed(bytes: &[u8; 64]) -> u64 {
    let mut out = 0;
    for (k, eight) in bytes.as_chunks::<8>().0.iter().enumerate() {
        // Each byte's bit to its place in the uppermost byte; no two sums meet.
        let bits = u64::from_le_bytes(*eight).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        out |= bits << (8 * k);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unions_are_joined_and_searched() {
        let i = Intervals::new([(3.0, 4.0), (0.0, 1.0), (0.5, 2.0)], 0.0);
        assert_eq!(i.iter().collect::<Vec<_>>(), [(0.0, 2.0), (3.0, 4.0)]);
        assert!(i.meets(2.0, 2.5) && i.meets(-1.0, 9.0) && !i.meets(2.1, 2.9) && !i.meets(5.0, 6.0));
        let many = Intervals::new((0..20).map(|k| (f64::from(k), f64::from(k) + 0.25)), 0.125);
        for k in 0..19 {
            let x = f64::from(k);
            assert!(many.meets(x + 0.3, x + 0.3) && !many.meets(x + 0.4, x + 0.8) && many.meets(x + 0.5, x + 0.9));
        }
        assert!(!Intervals::default().meets(f64::NEG_INFINITY, f64::INFINITY));
    }

    #[test]
    fn bits_are_those_of_the_ranges() {
        let few = Intervals::new([(0.25, 0.5), (0.75, 0.8)], 0.0);
        let many = Intervals::new((0..40).map(|k| (f64::from(k) / 40.0, f64::from(k) / 40.0 + 0.01)), 0.0);
        let mut seed = 7u32;
        let mut unit = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / (1u32 << 24) as f32
        };
        for set in [few, many, Intervals::default()] {
            let bands = set.outward();
            for _ in 0..50 {
                let (mut least, mut most) = ([0.0f32; 64], [0.0f32; 64]);
                for i in 0..64 {
                    (least[i], most[i]) = (unit(), unit());
                    if least[i] > most[i] && i % 7 != 0 {
                        std::mem::swap(&mut least[i], &mut most[i]);
                    }
                    if i % 5 == 0 {
                        most[i] = least[i] + 1e-3;
                    }
                }
                let (meets, inside) = bands.bits(&least, &most);
                for i in 0..64 {
                    let (lo, hi) = (f64::from(least[i]), f64::from(most[i]));
                    if lo <= hi {
                        assert_eq!(meets >> i & 1 != 0, set.meets(lo, hi), "{lo} {hi}");
                        assert_eq!(inside >> i & 1 != 0, set.iter().any(|(a, b)| a <= lo && hi <= b));
                    }
                }
            }
            assert_eq!(bands.bits(&[f32::NAN; 64], &[f32::NAN; 64]), (0, 0));
        }
    }
}
