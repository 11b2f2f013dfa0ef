//! The algebraic surfaces by name, as exactly expanded polynomials (hardcases, section C).

use crate::polynomial::Polynomial;

/// One named surface: `polynomial / denominator = isovalue` on [-L, L]^3.
pub(crate) struct Surface {
    pub(crate) name: &'static str,
    pub(crate) half: f64,
    pub(crate) isovalue: f64,
    /// Integer (or golden) polynomial and its denominator.
    make: fn(X) -> (Polynomial, i64),
}

impl Surface {
    /// The terms; each coefficient is rounded once, and exact but for `tangle`, `barth-sextic` and `kummer`.
    pub(crate) fn terms(&self) -> Vec<([u8; 3], f64)> {
        let (p, d) = (self.make)(X::default());
        p.terms_over(d)
    }
}

/// The coordinates and what the formulas below repeat.
pub(crate) struct X {
    x: Polynomial,
    y: Polynomial,
    z: Polynomial,
}

impl Default for X {
    fn default() -> Self {
        let [x, y, z] = [0, 1, 2].map(Polynomial::variable);
        Self { x, y, z }
    }
}

impl X {
    fn x(&self, n: u32) -> Polynomial {
        self.x.pow(n)
    }
    fn y(&self, n: u32) -> Polynomial {
        self.y.pow(n)
    }
    fn z(&self, n: u32) -> Polynomial {
        self.z.pow(n)
    }
    /// x^n + y^n + z^n.
    fn sum(&self, n: u32) -> Polynomial {
        self.x(n) + self.y(n) + self.z(n)
    }
    /// (xyz)^n.
    fn xyz(&self, n: u32) -> Polynomial {
        self.x(n) * self.y(n) * self.z(n)
    }
    /// The sum of a^m b^n over the six ordered pairs of different coordinates.
    fn pairs(&self, m: u32, n: u32) -> Polynomial {
        self.sum(m) * self.sum(n) - self.sum(m + n)
    }
}

/// phi^2 a^2 - b^2
fn golden_factor(a: &Polynomial, b: &Polynomial) -> Polynomial {
    Polynomial::golden(1, 1) * a.pow(2) - b.pow(2)
}

macro_rules! surface {
    ($name:literal, $half:literal, $isovalue:literal, $denominator:literal, $v:ident => $p:expr) => {
        Surface {
            name: $name,
            half: $half,
            isovalue: $isovalue,
            make: |$v| ($p, $denominator),
        }
    };
}

/// All of them.
pub(crate) static SURFACES: [Surface; 16] = [
    surface!("sphere", 1.25, 1.0, 1, v => v.sum(2)),
    surface!("torus", 1.5, 0.0, 256, v => (16 * v.sum(2) + 15).pow(2) - 1024 * (v.x(2) + v.y(2))),
    surface!("teardrop", 1.25, 0.0, 2, v => v.x(5) + v.x(4) - 2 * (v.y(2) + v.z(2))),
    // T4(t) = 8 t^4 - 8 t^2 + 1
    surface!("banchoff-chmutov", 1.25, 0.0, 1, v => 8 * v.sum(4) - 8 * v.sum(2) + 4),
    surface!("tangle", 3.0, 0.0, 5, v => 5 * v.sum(4) - 25 * v.sum(2) + 59),
    surface!("barth-sextic", 2.0, 0.0, 1, v =>
        4 * golden_factor(&v.x, &v.y) * golden_factor(&v.y, &v.z) * golden_factor(&v.z, &v.x)
            - Polynomial::golden(1, 2) * (v.sum(2) - 1).pow(2)),
    surface!("steinberger-a", 2.0, 0.0, 1, v => v.sum(1) + v.xyz(1) - 1),
    surface!("steinberger-b", 2.0, 0.0, 1, v => 4 * v.sum(2) + 16 * v.xyz(1) - 1 + v.xyz(2)),
    surface!("steinberger-c", 2.0, 0.0, 1, v => v.sum(2) - v.xyz(3) - v.x(2) * v.y(1) - 1),
    surface!("cayley", 2.0, 0.0, 1, v => 4 * v.sum(2) + 16 * v.xyz(1) - 1),
    // The sum of xy over unordered pairs is half of pairs(1, 1).
    surface!("clebsch", 2.0, 0.0, 1, v =>
        81 * v.sum(3) - 189 * v.pairs(2, 1) + 54 * v.xyz(1) + 63 * v.pairs(1, 1) - 9 * v.sum(2) - 9 * v.sum(1) + 1),
    surface!("steiner", 2.0, 0.0, 1, v => v.x(2) * v.y(2) + v.y(2) * v.z(2) + v.z(2) * v.x(2) - v.xyz(1)),
    surface!("whitney", 2.0, 0.0, 1, v => v.x(2) - v.y(2) * v.z(1)),
    surface!("kiss", 2.0, 0.0, 1, v => v.x(2) + v.y(2) - v.z(4) + v.z(5)),
    // mu^2 = 13/10, lambda = 29/17, and pq = (1 - z)^2 - 2 x^2, rs = (1 + z)^2 - 2 y^2 are free of the square root; times 1700.
    surface!("kummer", 2.0, 0.0, 1700, v =>
        17 * (10 * v.sum(2) - 13).pow(2)
            - 2900 * ((v.z(1) - 1).pow(2) - 2 * v.x(2)) * ((v.z(1) + 1).pow(2) - 2 * v.y(2))),
    surface!("mitchell", 2.5, 0.0, 1, v => {
        let q = v.y(2) + v.z(2);
        4 * (v.x(4) + q.pow(2)) + 17 * v.x(2) * q - 20 * v.sum(2) + 17
    }),
];
