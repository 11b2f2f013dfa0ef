//! Section 2, step 3: a projected tetrahedron as a fan of triangles around its thick vertex.
//!
//! Corners are snapped to 1/256 of a pixel as on graphics hardware, so every sign below is exact: it is that of an integer. With A_i the signed area of the
//! triangle of the other three corners (alternating signs), `sum A_i = 0` and `sum A_i q_i = 0`: the corners with A > 0 and those with A < 0 span two simplices that meet in
//! one point of the screen, the *thick vertex*, and the shares of A are the weights of both. This is the whole classification of Shirley and Tuchman:
//!
//! | positive, negative | class | triangles | the thick vertex |
//! |---|---|---|---|
//! | 3, 1 or 1, 3 | 1 | 3 | a corner in front of or behind a face |
//! | 2, 2 | 2 | 4 | where two edges cross: the inserted vertex |
//! | 2, 1 or 1, 2 | 3 | 2 | a corner on an edge |
//! | 1, 1 | 4 | 1 | a corner on a corner |
//! | none | degenerate | 0 | the cell is seen edge-on |
//!
//! Values, lengths and colours at the inserted vertex are those the hardware interpolates between the corners of the edge (section 8, against hanging nodes).

/// Sub-pixel positions per pixel.
pub(crate) const SUB: f64 = 256.0;
/// Pixels from the centre of the first one beyond which a corner cannot be snapped: edge functions of what is within are exact in f64.
pub(crate) const GUARD: f64 = 65_536.0;

/// A projected cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fan {
    /// 1 to 4.
    pub(crate) class: u8,
    /// The thick vertex.
    pub(crate) middle: [i32; 2],
    /// Corners around it; triangle i has `ring[i]` and the next.
    pub(crate) ring: [u8; 4],
    /// Bit i: triangle i has an area. An inserted vertex that is snapped past an edge turns the triangle there over; it is left out.
    pub(crate) triangles: u8,
    /// Weights of the corners at the two ends of the cell's stay behind the thick vertex.
    pub(crate) ends: [[f64; 4]; 2],
}

/// Twice the signed area.
fn area(a: [i32; 2], b: [i32; 2], c: [i32; 2]) -> i64 {
    let d = |p: [i32; 2]| [i64::from(p[0]) - i64::from(a[0]), i64::from(p[1]) - i64::from(a[1])];
    let (u, v) = (d(b), d(c));
    u[0] * v[1] - u[1] * v[0]
}

impl Fan {
    /// Decomposes a cell; `None` where it is seen edge-on.
    pub(crate) fn new(q: &[[i32; 2]; 4]) -> Option<Self> {
        let a = [
            area(q[1], q[2], q[3]),
            -area(q[0], q[2], q[3]),
            area(q[0], q[1], q[3]),
            -area(q[0], q[1], q[2]),
        ];
        let mut sets: [([u8; 4], usize); 3] = [([0; 4], 0); 3];
        for (i, v) in a.iter().enumerate() {
            let set = &mut sets[(v.signum() + 1) as usize];
            set.0[set.1] = i as u8;
            set.1 += 1;
        }
        let [(negative, n), (zero, _), (positive, p)] = sets;
        if n == 0 {
            return None;
        }
        let share = |set: &[u8]| {
            let total: i64 = set.iter().map(|&i| a[usize::from(i)]).sum();
            let mut w = [0.0; 4];
            for &i in set {
                w[usize::from(i)] = a[usize::from(i)] as f64 / total as f64;
            }
            w
        };
        let ends = [share(&positive[..p]), share(&negative[..n])];
        // The smaller of the sets is the thick vertex itself, if it is one corner.
        let (few, many) = if p < n { (positive, negative) } else { (negative, positive) };
        let [i, j, k, _] = many;
        let corner = q[usize::from(few[0])];
        let (class, ring, count, middle) = match (p.min(n), p.max(n)) {
            (1, 3) => (1, [i, j, k, i], 3, corner),
            (1, 2) => (3, [i, zero[0], j, j], 2, corner),
            (1, 1) => (4, [zero[0], zero[1], zero[1], zero[1]], 1, corner),
            _ => {
                let at = |axis: usize| (0..4).map(|c| ends[0][c] * f64::from(q[c][axis])).sum::<f64>().round() as i32;
                (2, [i, few[0], j, few[1]], 4, [at(0), at(1)])
            }
        };
        let at = |i: usize| q[usize::from(ring[i % 4])];
        // The triangles of a fan turn the same way; half of the ring of class 2 tells which.
        let turn = if class == 2 {
            area(at(0), at(1), at(2))
        } else {
            area(middle, at(0), at(1))
        }
        .signum();
        let upright = (0..count).filter(|&i| area(middle, at(i), at(i + 1)).signum() == turn);
        Some(Self {
            class,
            middle,
            ring,
            triangles: upright.map(|i| 1 << i).sum(),
            ends,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twice the area of the hull of four points.
    fn hull(q: &[[i32; 2]; 4]) -> i64 {
        let mut p = *q;
        p.sort_unstable();
        let chain = |p: &[[i32; 2]]| {
            let mut c: Vec<[i32; 2]> = Vec::new();
            for &v in p {
                while c.len() > 1 && area(c[c.len() - 2], c[c.len() - 1], v) <= 0 {
                    c.pop();
                }
                c.push(v);
            }
            c
        };
        let lower = chain(&p);
        p.reverse();
        let upper = chain(&p);
        let ring: Vec<_> = lower[..lower.len() - 1]
            .iter()
            .chain(&upper[..upper.len() - 1])
            .copied()
            .collect();
        (2..ring.len()).map(|i| area(ring[0], ring[i - 1], ring[i])).sum()
    }

    /// All arrangements of four points on a 4 x 4 lattice, and large random ones: the triangles fill the hull, the ends meet at the thick vertex.
    #[test]
    fn all_classes_fill_the_silhouette() {
        let mut classes = [0; 5];
        let mut check = |q: [[i32; 2]; 4], exact: bool| {
            let Some(f) = Fan::new(&q) else {
                classes[0] += 1;
                assert_eq!(hull(&q), 0);
                return;
            };
            classes[usize::from(f.class)] += 1;
            let ring = |i: u8| q[usize::from(f.ring[usize::from(i) % 4])];
            let drawn = (0..4).filter(|i| f.triangles >> i & 1 != 0);
            let total: i64 = drawn.map(|i| area(f.middle, ring(i), ring(i + 1)).abs()).sum();
            let want = hull(&q);
            if exact || f.class != 2 {
                assert_eq!(total, want, "{q:?} {f:?}");
            } else {
                // The inserted vertex is snapped inside, or past an edge by less than one unit.
                assert!(total >= want && total - want < 1 << 26, "{q:?} {f:?}");
            }
            for w in f.ends {
                assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-12 && w.iter().all(|w| *w >= 0.0));
                for axis in 0..2 {
                    let at: f64 = (0..4).map(|i| w[i] * f64::from(q[i][axis])).sum();
                    assert!((at - f64::from(f.middle[axis])).abs() <= 0.5 + 1e-6, "{q:?} {f:?}");
                }
            }
        };
        let lattice = |i: u32| [(i % 4 * 1024) as i32, (i / 4 % 4 * 1024) as i32];
        for n in 0..1u32 << 16 {
            let q = [lattice(n), lattice(n >> 4), lattice(n >> 8), lattice(n >> 12)];
            check(q, false);
        }
        let mut seed = 3u64;
        let mut next = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 40) as i32 - (1 << 23)
        };
        for _ in 0..20_000 {
            check(std::array::from_fn(|_| [next(), next()]), false);
        }
        // Edges that cross on the lattice: nothing is snapped.
        check([[0, 0], [2048, 2048], [0, 2048], [2048, 0]], true);
        assert!(classes.iter().all(|c| *c > 500), "{classes:?}");
    }
}
