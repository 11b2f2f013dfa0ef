//! Pre-integration: what a stretch adds, looked up by the values at its ends and its length.
//!
//! - [`Table3`], section 3: (s_f, s_b, l), trilinear.
//! - [`Table2`], section 4, equation (2): (s_f, s_b) at the average length, times l over that. The paper scales vertex colours by the greatest
//!   opacity in the table and the table by the reciprocal, so that fixed-point colours are not clamped where l is greater than the average; in floating point
//!   both factors cancel. What no scaling removes is an opacity above 1 (hardcases E6: l twice the average at an optical depth of 1 gives 1.26): there the
//!   factor is held at the one that makes the fragment opaque, so that it hides what is behind and never subtracts from it.
//!
//! Nodes lie at both ends of every axis.

use crate::lanes::{Eight, LANES};
use crate::medium::Medium;
use glam::Vec4;
use rayon::prelude::*;

/// Premultiplied colour and minus the opacity.
pub(crate) type Texel = Vec4;

/// How a stretch is integrated, in two steps, of which the first is taken for all lanes at once.
pub(crate) trait Integrator: Sync {
    /// Where lanes are looked up.
    type Places;

    /// Where stretches of world length `l` on which s goes linearly from `front` to `back` are looked up.
    fn places(&self, front: &[f64; LANES], back: &[f64; LANES], l: &[f64; LANES]) -> Self::Places;

    /// Premultiplied colour and minus the opacity of lane `i`, below [`LANES`].
    fn at(&self, places: &Self::Places, i: usize) -> Texel;

    /// Both steps for one stretch.
    fn stretch(&self, front: f64, back: f64, l: f64) -> Texel {
        self.at(&self.places(&[front; LANES], &[back; LANES], &[l; LANES]), 0)
    }
}

/// A table looked up in f32.
pub(crate) trait Table: Integrator {
    /// The value of the first node and nodes per value.
    fn axis(&self) -> (f64, f64);

    /// Units of length per world length.
    fn per_length(&self) -> f64;

    /// Where stretches of length `length` (in units) between values `front` and `back`, in nodes inside the table, are looked up; the lanes `covered` count.
    fn spots<F: Eight>(&self, front: F, back: F, length: F, covered: u32) -> Spots;

    /// Premultiplied colour and minus the opacity there: nothing for length 0.
    fn texel<F: Eight>(&self, spot: Spot) -> Texel;

    /// Both steps for one stretch.
    fn one<F: Eight>(&self, front: f32, back: f32, length: f32) -> Texel {
        let spots = self.spots(F::splat(front), F::splat(back), F::splat(length), 1);
        self.texel::<F>(Spot {
            first: spots.first[0],
            shares: [spots.shares[0][0], spots.shares[1][0], spots.shares[2][0]],
            dense: spots.dense,
        })
    }
}

/// The first of the texels around each lane's stretch, the shares of those next to it along each axis (the last is the length in the 2D table), and whether the opacity of some lane may
/// exceed 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spots {
    pub(crate) first: [u32; LANES],
    pub(crate) shares: [[f32; LANES]; 3],
    pub(crate) dense: bool,
}

/// The same of one stretch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spot {
    pub(crate) first: u32,
    pub(crate) shares: [f32; 3],
    pub(crate) dense: bool,
}

/// The node before each number of nodes, not the last, and the share of the next.
#[inline(always)]
fn split<F: Eight>(x: F, last: F) -> (F, F) {
    let node = x.floor().min(last);
    (node, x.sub(node))
}

/// Each fragment by itself, to rounding.
impl Integrator for Medium {
    type Places = [[f64; LANES]; 3];

    #[inline(always)]
    fn places(&self, front: &[f64; LANES], back: &[f64; LANES], l: &[f64; LANES]) -> Self::Places {
        [*front, *back, *l]
    }

    #[inline(always)]
    fn at(&self, places: &Self::Places, i: usize) -> Texel {
        let [front, back, l] = places.map(|p| p[i % LANES]);
        Vec4::from_array(self.integrate(front, back, l).map(|v| v as f32))
    }
}

/// The first of the texels around each lane's stretch, and the shares of those next to it along each axis; the last share is the length over the average in the
/// 2D table.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Texels {
    first: [u32; LANES],
    shares: [[f32; LANES]; 3],
}

/// Values to places in a table.
#[derive(Debug, Clone, Copy)]
struct Axis {
    from: f64,
    per: f64,
    nodes: usize,
}

impl Axis {
    fn new(from: f64, to: f64, nodes: usize) -> Self {
        let per = if to > from { (nodes - 1) as f64 / (to - from) } else { 0.0 };
        Self {
            from,
            per: if per.is_finite() { per } else { 0.0 },
            nodes,
        }
    }

    fn value(&self, i: usize) -> f64 {
        if self.per == 0.0 {
            self.from
        } else {
            self.from + i as f64 / self.per
        }
    }

    /// For each value the node before it, not the last, and the share of the next.
    #[inline(always)]
    fn nodes(&self, v: &[f64; LANES]) -> ([u32; LANES], [f32; LANES]) {
        let most = (self.nodes - 1) as f64;
        let mut x = [0.0; LANES];
        for i in 0..LANES {
            x[i] = (v[i] - self.from) * self.per;
        }
        for x in &mut x {
            // NaN, of which there is none in a stay, would become 0.
            *x = if *x > 0.0 { *x } else { 0.0 };
        }
        for x in &mut x {
            *x = if *x < most { *x } else { most };
        }
        // Adding 2^52 rounds to whole numbers, which are then the low bits: a cast that lanes have. Rounding half a step before is the node before, or where both
        // have share 0 or 1 either.
        const WHOLE: f64 = (1u64 << 52) as f64;
        let last = (self.nodes - 2) as f64;
        let (mut node, mut share) = ([0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let half = x[i] - 0.5;
            let half = if half > 0.0 { half } else { 0.0 };
            let half = if half < last { half } else { last };
            let whole = half + WHOLE;
            node[i] = whole.to_bits() as u32;
            share[i] = (x[i] - (whole - WHOLE)) as f32;
        }
        (node, share)
    }
}

#[inline(always)]
fn mix(a: Texel, b: Texel, w: f32) -> Texel {
    a + (b - a) * w
}

/// A table as a GPU has it: texels with (s_f, s_b, l) going fastest to slowest, value `from` at the first node and `per` nodes in a unit of value. `length`: nodes per world length, or
/// in a 2D table 1 over the length it holds.
#[derive(Debug, Clone, Copy)]
#[cfg(feature = "gpu")]
pub(crate) struct Parts<'a> {
    pub(crate) texels: &'a [Texel],
    pub(crate) from: f64,
    pub(crate) per: f64,
    pub(crate) nodes: usize,
    pub(crate) length: f64,
}

/// The 3D table.
#[derive(Debug)]
pub(crate) struct Table3 {
    value: Axis,
    length: Axis,
    texels: Vec<Texel>,
}

impl Table3 {
    /// `nodes` along each axis; lengths from 0 to `longest`.
    pub(crate) fn new(medium: &Medium, range: (f64, f64), longest: f64, nodes: usize) -> Self {
        let value = Axis::new(range.0, range.1, nodes);
        let length = Axis::new(0.0, longest, nodes);
        let texels = (0..nodes * nodes * nodes)
            .into_par_iter()
            .with_min_len(nodes)
            .map(|i| {
                let (f, b, l) = (i % nodes, i / nodes % nodes, i / nodes / nodes);
                medium.stretch(value.value(f), value.value(b), length.value(l))
            })
            .collect();
        Self { value, length, texels }
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn parts(&self) -> Parts<'_> {
        Parts {
            texels: &self.texels,
            from: self.value.from,
            per: self.value.per,
            nodes: self.value.nodes,
            length: self.length.per,
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        self.texels.len() * size_of::<Texel>()
    }
}

impl Integrator for Table3 {
    type Places = Texels;

    #[inline(always)]
    fn places(&self, front: &[f64; LANES], back: &[f64; LANES], l: &[f64; LANES]) -> Texels {
        let n = self.value.nodes as u32;
        let ((i, u), (j, v), (k, w)) = (self.value.nodes(front), self.value.nodes(back), self.length.nodes(l));
        let mut first = [0; LANES];
        for lane in 0..LANES {
            first[lane] = (k[lane] * n + j[lane]) * n + i[lane];
        }
        Texels {
            first,
            shares: [u, v, w],
        }
    }

    #[inline(always)]
    fn at(&self, places: &Texels, i: usize) -> Texel {
        let n = self.value.nodes;
        let (at, [u, v, w]) = (places.first[i % LANES] as usize, places.shares.map(|s| s[i % LANES]));
        let near: &[Texel] = &self.texels[at..at + n + 2];
        let far: &[Texel] = &self.texels[at + n * n..at + n * n + n + 2];
        let plane = |t: &[Texel]| mix(mix(t[0], t[1], u), mix(t[n], t[n + 1], u), v);
        mix(plane(near), plane(far), w)
    }
}

impl Table for Table3 {
    fn axis(&self) -> (f64, f64) {
        (self.value.from, self.value.per)
    }

    fn per_length(&self) -> f64 {
        self.length.per
    }

    #[inline(always)]
    fn spots<F: Eight>(&self, front: F, back: F, length: F, _: u32) -> Spots {
        // Numbers of texels are below 2^24, which f32 has.
        let (n, last) = (F::splat(self.value.nodes as f32), F::splat((self.value.nodes - 2) as f32));
        let most = F::splat((self.value.nodes - 1) as f32);
        let length = length.max(F::splat(0.0)).min(most);
        let ((i, u), (j, v), (k, w)) = (split(front, last), split(back, last), split(length, last));
        let mut shares = [[0.0; LANES]; 3];
        u.store(&mut shares[0]);
        v.store(&mut shares[1]);
        w.store(&mut shares[2]);
        Spots {
            first: k.mul(n).add(j).mul(n).add(i).whole(),
            shares,
            dense: false,
        }
    }

    #[inline(always)]
    fn texel<F: Eight>(&self, spot: Spot) -> Texel {
        let (n, at, [u, v, w]) = (self.value.nodes, spot.first, spot.shares);
        let near = F::between(&self.texels, at, n, u, v);
        let far = F::between(&self.texels, at + (n * n) as u32, n, u, v);
        mix(near, far, w)
    }
}

/// The 2D table.
#[derive(Debug)]
pub(crate) struct Table2 {
    value: Axis,
    per_length: f64,
    /// The greatest opacity of a texel.
    densest: f32,
    texels: Vec<Texel>,
}

impl Table2 {
    /// `nodes` along each axis, integrated over the `average` length.
    pub(crate) fn new(medium: &Medium, range: (f64, f64), average: f64, nodes: usize) -> Self {
        let value = Axis::new(range.0, range.1, nodes);
        let texels: Vec<Texel> = (0..nodes * nodes)
            .into_par_iter()
            .with_min_len(nodes)
            .map(|i| medium.stretch(value.value(i % nodes), value.value(i / nodes), average))
            .collect();
        Self {
            value,
            per_length: 1.0 / average,
            densest: texels.iter().fold(0.0, |m, t| m.max(-t.w)),
            texels,
        }
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn parts(&self) -> Parts<'_> {
        Parts {
            texels: &self.texels,
            from: self.value.from,
            per: self.value.per,
            nodes: self.value.nodes,
            length: self.per_length,
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        self.texels.len() * size_of::<Texel>()
    }
}

impl Integrator for Table2 {
    type Places = Texels;

    #[inline(always)]
    fn places(&self, front: &[f64; LANES], back: &[f64; LANES], l: &[f64; LANES]) -> Texels {
        let n = self.value.nodes as u32;
        let ((i, u), (j, v)) = (self.value.nodes(front), self.value.nodes(back));
        let (mut first, mut lengths) = ([0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            first[lane] = j[lane] * n + i[lane];
            lengths[lane] = (l[lane] * self.per_length) as f32;
        }
        Texels {
            first,
            shares: [u, v, lengths],
        }
    }

    #[inline(always)]
    fn at(&self, places: &Texels, i: usize) -> Texel {
        let n = self.value.nodes;
        let (at, [u, v, l]) = (places.first[i % LANES] as usize, places.shares.map(|s| s[i % LANES]));
        let t: &[Texel] = &self.texels[at..at + n + 2];
        let texel = mix(mix(t[0], t[1], u), mix(t[n], t[n + 1], u), v);
        let factor = if l * -texel.w > 1.0 { -1.0 / texel.w } else { l };
        texel * factor
    }
}

impl Table for Table2 {
    fn axis(&self) -> (f64, f64) {
        (self.value.from, self.value.per)
    }

    fn per_length(&self) -> f64 {
        self.per_length
    }

    #[inline(always)]
    fn spots<F: Eight>(&self, front: F, back: F, length: F, covered: u32) -> Spots {
        let (n, last) = (F::splat(self.value.nodes as f32), F::splat((self.value.nodes - 2) as f32));
        let ((i, u), (j, v)) = (split(front, last), split(back, last));
        let mut shares = [[0.0; LANES]; 3];
        u.store(&mut shares[0]);
        v.store(&mut shares[1]);
        length.store(&mut shares[2]);
        Spots {
            first: j.mul(n).add(i).whole(),
            shares,
            dense: length.mul(F::splat(self.densest)).above(F::splat(1.0)) & covered != 0,
        }
    }

    #[inline(always)]
    fn texel<F: Eight>(&self, spot: Spot) -> Texel {
        let [u, v, l] = spot.shares;
        let texel = F::between(&self.texels, spot.first, self.value.nodes, u, v);
        let factor = if spot.dense && l * -texel.w > 1.0 { -1.0 / texel.w } else { l };
        texel * factor
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::Model;
    use isobar_core::TransferFunction;

    fn medium(points: &[(f64, [f32; 3], f32)]) -> Medium {
        let transfer = TransferFunction {
            points: points.to_vec(),
            unit: 1.0,
        };
        Medium::new(&transfer, Model::WilliamsMax)
    }

    /// hardcases E5: at the nodes the tables are the closed forms.
    #[test]
    fn tables_hold_the_integral_at_their_nodes() {
        let m = medium(&[(0.0, [1.0, 0.2, 0.0], 0.0), (1.0, [0.0, 1.0, 0.5], 1.0)]);
        let t = Table3::new(&m, (0.0, 1.0), 2.0, 17);
        for (f, b, l) in [(0.0, 1.0, 2.0), (0.5, 0.25, 1.0), (1.0, 1.0, 0.125)] {
            let found = t.stretch(f, b, l);
            let alpha = -(-l * (f + b) / 2.0f64).exp_m1();
            assert!((f64::from(-found[3]) - alpha).abs() < 1e-6);
            let want = m.integrate(f, b, l);
            assert!(
                (0..4).all(|k| (f64::from(found[k]) - want[k]).abs() < 1e-6),
                "{found:?} {want:?}"
            );
        }
        // Between nodes and beyond the ends nothing breaks.
        let between = t.stretch(0.31, 0.77, 0.9);
        let want = m.integrate(0.31, 0.77, 0.9);
        assert!((0..4).all(|k| (f64::from(between[k]) - want[k]).abs() < 1.0 / 255.0));
        assert_eq!(t.stretch(-5.0, 9.0, 99.0), t.stretch(0.0, 1.0, 2.0));
        let constant = Table3::new(&m, (0.5, 0.5), 2.0, 8);
        assert!((f64::from(constant.stretch(0.5, 0.5, 2.0)[3]) - m.integrate(0.5, 0.5, 2.0)[3]).abs() < 1e-6);
    }

    /// hardcases E6: at twice the average length and an optical depth of 1 equation (2) gives an opacity of 1.2642, the integral 0.8647.
    #[test]
    fn the_flat_table_never_passes_an_opacity_of_one() {
        let m = medium(&[(0.0, [1.0, 0.5, 0.0], 1.0)]);
        let t = Table2::new(&m, (0.0, 1.0), 1.0, 16);
        let at = t.stretch(0.5, 0.5, 1.0);
        assert!((f64::from(-at[3]) - 0.632_120_558_8).abs() < 1e-6);
        let double = t.stretch(0.5, 0.5, 2.0);
        assert!((double[3] + 1.0).abs() < 1e-6 && (double[0] - 1.0).abs() < 1e-6, "{double:?}");
        assert!((-2.0 * at[3] - 1.2642).abs() < 1e-4, "as printed");
        assert!((-m.integrate(0.5, 0.5, 2.0)[3] - 0.8647).abs() < 1e-4);
        // below one it is linear in l, as printed
        assert!((t.stretch(0.5, 0.5, 0.25)[0] - 0.25 * at[0]).abs() < 1e-7);
    }
}
