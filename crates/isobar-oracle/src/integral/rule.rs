//! Gauss-Legendre rules on [0, 1] for `polynomial * exp(-polynomial)`, with a proved bound.
//!
//! **Bound.** On a leaf the emission E is a polynomial of degree at most m that is not negative, and the depth D one of degree n + 1 that grows from 0 to X. Let P_K be the
//! polynomial of degree K that the Chebyshev series of exp(-x) on [0, X] begins with. With `exp(-X/2 - (X/2) y) = exp(-X/2) (I_0(X/2) + 2 sum (-1)^k I_k(X/2) T_k(y))` the rest is at most
//! `2 exp(-X/2) sum_(k > K) I_k(X/2)`. From the series of I_k, `I_k(x) <= (x/2)^k/k! exp(x^2/(4 (k + 1)))`; for X <= 2 and K >= 1 the last factor is at most 1.14 and the sum at most 1.2
//! times its first term, so
//!
//! `|exp(-x) - P_K(x)| <= eps_K = 2.75 (X/4)^(K+1)/(K+1)!`.
//!
//! `E P_K(D)` is a polynomial of degree at most `m + (n + 1) K`: a rule of N nodes with `2N - 1` at least that is exact for it. What is left is
//! `integral of E (exp(-D) - P_K(D))` less the same by the rule; both are at most `eps_K` times the integral of E, since the weights are positive and the rule is exact for E too. Hence
//!
//! `error <= 2 eps_K integral of E`.

/// Orders of the rules.
const ORDERS: [usize; 13] = [4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 96];

/// X up to which the bound holds.
pub(crate) const DEEPEST: f64 = 2.0;

/// One rule.
#[derive(Clone, Debug)]
pub(crate) struct Rule {
    pub(crate) nodes: Vec<Node>,
    /// K of the bound.
    terms: i32,
    /// `2 * 2.75 / (K+1)!`.
    factor: f64,
}

/// A node with the Bernstein polynomials there.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub(crate) at: f64,
    pub(crate) weight: f64,
    /// Of degree n.
    pub(crate) value: Vec<f64>,
    /// Of degree n + 1.
    pub(crate) depth: Vec<f64>,
}

/// The rules for values of one degree along the ray.
#[derive(Clone, Debug)]
pub(crate) struct Rules {
    /// n.
    pub(crate) degree: usize,
    all: Vec<Rule>,
}

impl Rules {
    /// For values of degree n, an emission of degree 2n.
    pub(crate) fn new(degree: usize) -> Self {
        let all = ORDERS
            .into_iter()
            .filter_map(|order| {
                let room = (2 * order - 1).checked_sub(2 * degree)?;
                let terms = room / (degree + 1);
                // Beyond 14 terms a rule is better than f64 for all depths.
                (1..=14).contains(&terms).then(|| Rule::new(order, degree, terms as i32))
            })
            .collect();
        Self { degree, all }
    }

    /// The least rule whose bound is at most `tolerance` for this depth and integral of E, and the bound.
    pub(crate) fn choose(&self, depth: f64, emission: f64, tolerance: f64) -> Option<(&Rule, f64)> {
        if depth > DEEPEST {
            return None;
        }
        self.all.iter().find_map(|r| {
            let bound = r.factor * (0.25 * depth).powi(r.terms + 1) * emission;
            (bound <= tolerance).then_some((r, bound))
        })
    }
}

impl Rule {
    fn new(order: usize, degree: usize, terms: i32) -> Self {
        let nodes = legendre(order)
            .into_iter()
            .map(|(at, weight)| Node {
                at,
                weight,
                value: bernstein(degree, at),
                depth: bernstein(degree + 1, at),
            })
            .collect();
        let factorial: f64 = (1..=terms + 1).map(f64::from).product();
        Self {
            nodes,
            terms,
            factor: 5.5 / factorial,
        }
    }
}

/// All Bernstein polynomials of a degree at x.
fn bernstein(degree: usize, x: f64) -> Vec<f64> {
    let mut b = vec![0.0; degree + 1];
    b[0] = 1.0;
    for k in 1..=degree {
        for i in (0..=k).rev() {
            let left = if i > 0 { b[i - 1] * x } else { 0.0 };
            b[i] = b[i] * (1.0 - x) + left;
        }
    }
    b
}

/// Nodes and weights on [0, 1]: Newton's iteration on the Legendre polynomial.
fn legendre(n: usize) -> Vec<(f64, f64)> {
    let value = |x: f64| {
        let (mut p, mut q) = (1.0, x);
        for k in 2..=n {
            let k = k as f64;
            (p, q) = (q, ((2.0 * k - 1.0) * x * q - (k - 1.0) * p) / k);
        }
        (q, n as f64 * (p - x * q) / (1.0 - x * x))
    };
    (0..n)
        .map(|i| {
            let mut x = -(std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            for _ in 0..8 {
                let (v, d) = value(x);
                x -= v / d;
            }
            let d = value(x).1;
            (0.5 + 0.5 * x, 1.0 / ((1.0 - x * x) * d * d))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_exact_for_polynomials() {
        for n in ORDERS {
            for power in [0, 1, n, 2 * n - 1] {
                let got: f64 = legendre(n).iter().map(|(x, w)| w * x.powi(power as i32)).sum();
                let want = 1.0 / (power as f64 + 1.0);
                assert!((got - want).abs() < 4e-15 * want.max(0.05), "{n} {power}: {got} {want}");
            }
        }
        let b = bernstein(3, 0.25);
        assert_eq!(b, [27.0 / 64.0, 27.0 / 64.0, 9.0 / 64.0, 1.0 / 64.0]);
    }

    /// The bound holds and is not absurd: E = 1 + 3 x, D = X x^2 by each rule against the largest.
    #[test]
    fn the_bound_holds() {
        let rules = Rules::new(1);
        for depth in [0.02, 0.3, 1.0, 2.0] {
            let by = |r: &Rule| -> f64 {
                let f = |x: f64| (1.0 + 3.0 * x) * (-depth * x * x).exp();
                r.nodes.iter().map(|n| n.weight * f(n.at)).sum()
            };
            let exact = by(rules.all.last().unwrap());
            let mut tightest = 0.0f64;
            for r in &rules.all {
                let bound = r.factor * (0.25 * depth).powi(r.terms + 1) * 2.5;
                let error = (by(r) - exact).abs();
                assert!(error <= bound + 1e-15, "{depth} {}: {error:e} {bound:e}", r.nodes.len());
                tightest = tightest.max(error / bound);
            }
            assert!(depth < 1.0 || tightest > 1e-6, "{depth}: {tightest:e}");
        }
        let (r, bound) = rules.choose(0.5, 0.5, 1e-13).unwrap();
        assert!(bound <= 1e-13 && r.nodes.len() <= 12);
        assert!(rules.choose(2.5, 1.0, 1.0).is_none());
    }
}
