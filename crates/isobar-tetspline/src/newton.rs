//! The paper's root finder: three Newton sequences on the monomial form (Kalbe et al. 2009, section 4.4, as printed).
//!
//! Starting values 0, 1/2 and 1 are folded into the first step; four more steps follow; the first of the three results that is valid is taken. **No guarantee**: it loses the first
//! root of 9.6 % of the random cubics that have one (maths: corrections, section A, caution 4; hardcases A15), gives later ones instead, and values at its results need not vanish.

/// Power coefficients `x_0 .. x_3` of a cubic in Bernstein form.
#[must_use]
#[inline(always)]
pub fn monomial(b: [f64; 4]) -> [f64; 4] {
    [
        b[0],
        3.0 * (b[1] - b[0]),
        3.0 * ((b[2] - b[1]) - (b[1] - b[0])),
        (b[3] - b[0]) - 3.0 * (b[2] - b[1]),
    ]
}

/// The three results after the first step and four iterations, in the order of the paper; some may be NaN or infinite.
#[must_use]
#[inline(always)]
pub fn sequences(x: [f64; 4]) -> [f64; 3] {
    let [x0, x1, x2, x3] = x;
    let mut t = [
        -x0 / x1,
        (0.25 * (x3 + x2) - x0) / (0.75 * x3 + x2 + x1),
        (2.0 * x3 + x2 - x0) / (3.0 * x3 + 2.0 * x2 + x1),
    ];
    for _ in 0..4 {
        for t in &mut t {
            *t = (*t * *t * (x2 + 2.0 * *t * x3) - x0) / (*t * (2.0 * x2 + 3.0 * *t * x3) + x1);
        }
    }
    t
}

/// The first valid zero: the least of the three results in [0, 1] ("the first valid zero t, where all the components of phi are positive"; 0 included, caution 3).
#[must_use]
#[inline(always)]
pub fn first(b: [f64; 4]) -> Option<f64> {
    sequences(monomial(b))
        .into_iter()
        .filter(|t| (0.0..=1.0).contains(t))
        .min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_poly::{First, Tolerance, first_root};

    /// hardcases A15: only the last start converges, to the second root.
    #[test]
    fn the_counter_example_of_the_corrections() {
        let t = first([1.0, 1.0, -4.0, 5.0]).unwrap();
        assert!((t - 0.673_413_701_243).abs() < 1e-5, "{t}");
        let found = sequences(monomial([1.0, 1.0, -4.0, 5.0]));
        assert!(!found[0].is_finite() || !(0.0..=1.0).contains(&found[0]));
    }

    /// Of random cubics (Bernstein coefficients uniform in [-1, 1]) that have a root in [0, 1], how many lose the first one.
    #[test]
    fn a_tenth_of_first_roots_is_lost() {
        let mut s = 2009u64;
        let mut next = || {
            s = s
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (s >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let (mut with, mut lost, mut later) = (0, 0, 0);
        for _ in 0..200_000 {
            let b: [f64; 4] = std::array::from_fn(|_| next());
            if let First::Root(r) = first_root(&b, &Tolerance::new(1e-12)) {
                with += 1;
                match first(b) {
                    Some(t) if (t - r.t).abs() < 1e-3 => {}
                    Some(_) => later += 1,
                    None => lost += 1,
                }
            }
        }
        let share = 100.0 * f64::from(lost + later) / f64::from(with);
        println!("{with} cubics with a root: {lost} lost, {later} another one, {share:.2} % wrong");
        assert!((8.0..11.5).contains(&share), "{share} %");
    }
}
