//! A transfer function as bands of values on which colour and extinction are linear.

use super::Model;
use isobar_core::TransferFunction;

/// Values from one knot to the next, or beyond the first or last one, where all is constant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Band {
    pub(crate) from: f64,
    pub(crate) to: f64,
    /// Extinction per world length at both ends.
    pub(crate) density: [f64; 2],
    pub(crate) colour: [[f64; 3]; 2],
    /// Whether the colour is the same all over it.
    pub(crate) flat: bool,
    /// Greatest change of extinction, and of emission in any channel, per unit of the value.
    pub(crate) steepness: f64,
    /// Greatest extinction, and emission in any channel.
    pub(crate) most: f64,
}

/// All bands, ascending: one more than knots.
#[derive(Clone, Debug)]
pub(crate) struct Bands {
    pub(crate) all: Vec<Band>,
    knots: Vec<f64>,
    /// Emission per colour: 1/unit for [`Model::DensityEmitter`], nothing otherwise (then the extinction takes its place).
    pub(crate) glow: Option<f64>,
    /// Greatest of all bands.
    pub(crate) most: f64,
}

impl Bands {
    /// Of a checked transfer function.
    pub(crate) fn new(medium: &TransferFunction, model: Model) -> Self {
        let glow = match model {
            Model::VolumeDensity => None,
            Model::DensityEmitter => Some(1.0 / medium.unit),
        };
        let p = &medium.points;
        let knots: Vec<f64> = p.iter().map(|p| p.0).collect();
        let band = |i: usize| {
            let (a, b) = (&p[i.max(1) - 1], &p[i.min(p.len() - 1)]);
            let density = [a, b].map(|p| f64::from(p.2) / medium.unit);
            let colour = [a, b].map(|p| p.1.map(f64::from));
            let (from, to) = (
                if i == 0 { f64::NEG_INFINITY } else { a.0 },
                if i == p.len() { f64::INFINITY } else { b.0 },
            );
            let rise = |x: f64, y: f64| (y - x).abs() / (to - from);
            let change = (0..3).fold(0.0f64, |m, k| m.max(rise(colour[0][k], colour[1][k])));
            let brightest = colour.iter().flatten().fold(0.0f64, |m, &c| m.max(c));
            let densest = density[0].max(density[1]);
            let (emission, emission_rise) = match glow {
                // |(c d)'| <= |d'| + d |c'| for c <= 1
                None => (densest, rise(density[0], density[1]) + densest * change),
                Some(g) => (g * brightest, g * change),
            };
            Band {
                from,
                to,
                density,
                colour,
                flat: colour[0] == colour[1],
                steepness: rise(density[0], density[1]).max(emission_rise),
                most: densest.max(emission),
            }
        };
        let all: Vec<Band> = (0..=p.len()).map(band).collect();
        let most = all.iter().fold(0.0, |m: f64, b| m.max(b.most));
        Self { all, knots, glow, most }
    }

    /// The band that a value lies in.
    pub(crate) fn find(&self, value: f64) -> usize {
        self.knots.partition_point(|&k| k <= value)
    }

    /// The knots above `lo` and below `hi`.
    pub(crate) fn knots_between(&self, lo: f64, hi: f64) -> &[f64] {
        let first = self.knots.partition_point(|&k| k <= lo);
        let last = self.knots.partition_point(|&k| k < hi);
        &self.knots[first.min(last)..last]
    }

    /// Greatest extinction and emission for values in `[lo, hi]`, rounded up; 0 where there certainly is neither. A linear function is greatest at an end; for the emission
    /// the whole band counts.
    pub(crate) fn most(&self, lo: f64, hi: f64) -> f64 {
        let mut most = 0.0f64;
        for b in &self.all[self.find(lo)..=self.find(hi)] {
            if b.most == 0.0 {
                continue;
            }
            if self.glow.is_some() {
                most = most.max(b.most);
                continue;
            }
            let at = |v: f64| {
                let w = if b.from.is_finite() && b.to.is_finite() {
                    ((v - b.from) / (b.to - b.from)).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                b.density[0] * (1.0 - w) + b.density[1] * w
            };
            most = most.max(at(lo.max(b.from)).max(at(hi.min(b.to))) * (1.0 + 1e-14));
        }
        most
    }

    /// How far extinction and emission can change within a distance `reach` inside the bands that values of `[lo, hi]` lie in: by their steepness, and by no more than all they are.
    pub(crate) fn change(&self, lo: f64, hi: f64, reach: f64) -> f64 {
        let bands = &self.all[self.find(lo)..=self.find(hi)];
        let steepest = bands.iter().fold(0.0f64, |m, b| m.max(b.steepness));
        let most = bands.iter().fold(0.0f64, |m, b| m.max(b.most));
        (steepest * reach).min(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_all_values() {
        let c = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let tf = TransferFunction::new(vec![(0.0, c[0], 0.0), (1.0, c[1], 4.0), (3.0, c[2], 0.0)], 2.0).unwrap();
        let b = Bands::new(&tf, Model::VolumeDensity);
        assert_eq!(b.all.len(), 4);
        assert_eq!([-1.0, 0.0, 0.5, 1.0, 2.9, 3.0, 9.0].map(|v| b.find(v)), [0, 1, 1, 2, 2, 3, 3]);
        assert_eq!((b.all[1].density, b.all[2].flat, b.all[1].flat), ([0.0, 2.0], true, false));
        assert_eq!((b.most(-5.0, 0.0), b.most(3.0, 4.0)), (0.0, 0.0));
        assert!((b.most(0.0, 0.25) - 0.5).abs() < 1e-12 && (b.most(0.5, 2.0) - 2.0).abs() < 1e-12);
        assert_eq!(b.knots_between(0.0, 3.0), [1.0]);
        assert_eq!(b.knots_between(4.0, 4.0), [] as [f64; 0]);
        // 2 from the density, 2 * 1 from the colour
        assert_eq!((b.all[1].steepness, b.all[2].steepness), (4.0, 1.0));
    }
}
