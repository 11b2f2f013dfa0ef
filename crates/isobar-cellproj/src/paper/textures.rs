//! The textures of sections 3, 4, 7, 8 and 10. Values and lengths are scaled so that the first and the last texel's centre are the ends of their range; isosurfaces take
//! the nearest texel, as theirs hold 0 and 1, volumes are interpolated. What is beyond an end is clamped to it.

use crate::faces::Inside;
use crate::medium::Medium;
use crate::normals::front_weight;
use glam::Vec4;
use isobar_core::Surface;
use rayon::prelude::*;

/// [`Mark::surface`] where the texel is transparent.
pub(crate) const NO_SURFACE: u8 = 255;

/// Values to texels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Axis {
    from: f64,
    per: f64,
    nodes: usize,
}

impl Axis {
    pub(crate) fn new((from, to): (f64, f64), nodes: usize) -> Self {
        let per = (nodes - 1) as f64 / (to - from);
        Self {
            from,
            per: if per.is_finite() { per } else { 0.0 },
            nodes,
        }
    }

    /// The value at a texel's centre.
    fn value(self, i: usize) -> f64 {
        if self.per == 0.0 {
            self.from
        } else {
            self.from + i as f64 / self.per
        }
    }

    pub(crate) fn nodes(self) -> usize {
        self.nodes
    }

    /// The width of a texel.
    pub(crate) fn texel(self) -> f64 {
        if self.per == 0.0 { 0.0 } else { 1.0 / self.per }
    }

    fn place(self, v: f64) -> f64 {
        ((v - self.from) * self.per).clamp(0.0, (self.nodes - 1) as f64)
    }

    fn nearest(self, v: f64) -> usize {
        (self.place(v) + 0.5) as usize
    }

    /// The texel before a value and the share of the next.
    fn between(self, v: f64) -> (usize, f32) {
        let x = self.place(v);
        let i = (x as usize).min(self.nodes - 2);
        (i, (x - i as f64) as f32)
    }
}

/// Rounded to 8 bits and held in [0, 1], for fixed-point textures and frame buffers.
#[inline(always)]
pub(crate) fn fixed(v: Vec4) -> Vec4 {
    (v.clamp(Vec4::ZERO, Vec4::ONE) * 255.0 + 0.5).floor() / 255.0
}

/// What a texel says of the isosurfaces between its two values besides their colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Mark {
    /// The nearest one, as the scene counts; [`NO_SURFACE`]: none.
    pub(crate) surface: u8,
    /// How many.
    pub(crate) count: u8,
    /// Weight of the front face for the nearest one.
    pub(crate) weight: f32,
}

/// The isosurface textures over (s_f, s_b). Premultiplied colour without shading, and opacity.
#[derive(Debug)]
pub(crate) struct Isosurfaces {
    axis: Axis,
    /// Section 7: the single pass.
    flat: Vec<Vec4>,
    /// Section 8: first and second pass.
    back: Vec<Vec4>,
    front: Vec<Vec4>,
    marks: Vec<Mark>,
}

/// How isosurface textures are made.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Making<'a> {
    /// Ascending isovalues with the surface of each.
    pub(crate) isovalues: &'a [(f64, u8)],
    pub(crate) surfaces: &'a [Surface],
    /// The colour of faces towards greater values: texels with s_f > s_b.
    pub(crate) inside: Inside,
    /// Texels beside an isovalue that are set as well.
    pub(crate) thickening: f64,
    /// Whether texels have 8 bits.
    pub(crate) fixed: bool,
}

/// The isovalues between two values front to back, and those that thickening adds.
fn crossed<'a>(making: &'a Making<'_>, front: f64, back: f64, texel: f64) -> impl Iterator<Item = (f64, u8)> + 'a {
    let reach = making.thickening * texel;
    let n = making.isovalues.len();
    (0..n)
        .map(move |i| making.isovalues[if front <= back { i } else { n - 1 - i }])
        .filter(move |&(c, _)| {
            let near = |s: f64| reach > 0.0 && (s - c).abs() <= reach;
            (front < c) != (back < c) || near(front) || near(back)
        })
}

impl Isosurfaces {
    pub(crate) fn new(range: (f64, f64), nodes: usize, making: &Making<'_>) -> Self {
        let axis = Axis::new(range, nodes);
        let all: Vec<([Vec4; 3], Mark)> = (0..nodes * nodes)
            .into_par_iter()
            .with_min_len(nodes)
            .map(|i| Self::texel(making, axis.value(i % nodes), axis.value(i / nodes), axis.texel()))
            .collect();
        let pick = |k: usize| {
            all.iter()
                .map(|t| if making.fixed { fixed(t.0[k]) } else { t.0[k] })
                .collect()
        };
        Self {
            axis,
            flat: pick(0),
            back: pick(1),
            front: pick(2),
            marks: all.iter().map(|t| t.1).collect(),
        }
    }

    /// The three textures' texels. With opacities o_i, weights w_i and the light T_i that reaches surface i from the eye, the picture wanted is
    /// `sum T_i o_i c_i (w_i F + (1 - w_i) B)` over what is behind, F and B the shading of the faces. The front pass adds the F part and covers
    /// `f = sum T_i o_i w_i` of the back pass, whose texel is therefore divided by `1 - f`. One opaque surface: the texel of section 7, and w on top.
    fn texel(making: &Making<'_>, s_front: f64, s_back: f64, width: f64) -> ([Vec4; 3], Mark) {
        let mut mark = Mark {
            surface: NO_SURFACE,
            count: 0,
            weight: 0.0,
        };
        let (mut front, mut behind, mut light) = (Vec4::ZERO, Vec4::ZERO, 1.0f32);
        for (c, index) in crossed(making, s_front, s_back, width) {
            let surface = &making.surfaces[usize::from(index)];
            let weight = front_weight(s_front, s_back, c) as f32;
            if mark.count == 0 {
                (mark.surface, mark.weight) = (index, weight);
            }
            mark.count = mark.count.saturating_add(1);
            let opacity = surface.opacity.clamp(0.0, 1.0);
            let [r, g, b] = making.inside.colour(making.surfaces, index, s_front > s_back);
            let colour = Vec4::new(r, g, b, 1.0) * (light * opacity);
            front += colour * weight;
            behind += colour * (1.0 - weight);
            light *= 1.0 - opacity;
        }
        let rest = 1.0 - front.w;
        let back = if rest > 1e-6 {
            (behind / rest).with_w(1.0 - light / rest)
        } else {
            Vec4::ZERO
        };
        ([front + behind, back, front], mark)
    }

    /// Texels along a side, and those of the single pass (0), the back faces (1) or the front faces (2).
    pub(crate) fn map(&self, pass: usize) -> (usize, &[Vec4]) {
        let texels = match pass {
            0 => &self.flat,
            1 => &self.back,
            _ => &self.front,
        };
        (self.axis.nodes, texels)
    }

    fn at(&self, front: f64, back: f64) -> usize {
        self.axis.nearest(back) * self.axis.nodes + self.axis.nearest(front)
    }

    pub(crate) fn flat(&self, front: f64, back: f64) -> (Vec4, Mark) {
        let i = self.at(front, back);
        (self.flat[i], self.marks[i])
    }

    pub(crate) fn back(&self, front: f64, back: f64) -> (Vec4, Mark) {
        let i = self.at(front, back);
        (self.back[i], self.marks[i])
    }

    pub(crate) fn front(&self, front: f64, back: f64) -> Vec4 {
        self.front[self.at(front, back)]
    }

    pub(crate) fn bytes(&self) -> usize {
        self.flat.len() * (3 * size_of::<Vec4>() + size_of::<Mark>())
    }
}

fn mix(a: Vec4, b: Vec4, w: f32) -> Vec4 {
    a + (b - a) * w
}

/// A texture over two values, or two other numbers.
#[derive(Debug)]
pub(crate) struct Texture2 {
    pub(crate) axes: [Axis; 2],
    pub(crate) texels: Vec<Vec4>,
}

impl Texture2 {
    fn new(axes: [Axis; 2], texel: impl Fn(f64, f64) -> Vec4 + Sync) -> Self {
        let n = axes[0].nodes;
        let texels = (0..n * axes[1].nodes)
            .into_par_iter()
            .with_min_len(n)
            .map(|i| texel(axes[0].value(i % n), axes[1].value(i / n)))
            .collect();
        Self { axes, texels }
    }

    pub(crate) fn linear(&self, x: f64, y: f64) -> Vec4 {
        let ((i, u), (j, v)) = (self.axes[0].between(x), self.axes[1].between(y));
        let n = self.axes[0].nodes;
        let t = &self.texels[j * n + i..j * n + i + n + 2];
        mix(mix(t[0], t[1], u), mix(t[n], t[n + 1], u), v)
    }
}

/// What a volume's fragments are made of: premultiplied colour and opacity.
#[derive(Debug)]
pub(crate) enum Volume {
    /// Section 3: slices of a texture over (s_f, s_b), one for each length.
    Table3 { lengths: Axis, slices: Vec<Texture2> },
    /// Section 4: the texture at the average length, divided by `most`, its greatest opacity.
    Table2 { texture: Texture2, most: f64, average: f64 },
    /// Section 2, Shirley and Tuchman: colour and opacity linear between vertices.
    Linear(Medium),
    /// Section 2, Stein et al.: opacity by a texture over (tau, l), colour linear.
    Stein { medium: Medium, opacity: Texture2 },
}

/// How volume textures are made.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Filling<'a> {
    pub(crate) range: (f64, f64),
    pub(crate) longest: f64,
    pub(crate) average: f64,
    /// Section 10: where the integration stops; empty: nowhere.
    pub(crate) stops: &'a [(f64, u8)],
    pub(crate) fixed: bool,
}

/// Equation (1), stopped where s first is one of `stops` (ascending).
fn integral(medium: &Medium, filling: &Filling<'_>, front: f64, back: f64, l: f64) -> Vec4 {
    let hit = |&&(c, _): &&(f64, u8)| (front < c) != (back < c);
    let first = if front <= back {
        filling.stops.iter().find(hit)
    } else {
        filling.stops.iter().rfind(hit)
    };
    let [r, g, b, minus] = match first {
        Some(&(c, _)) => medium.integrate(front, c, l * (1.0 - front_weight(front, back, c))),
        None => medium.integrate(front, back, l),
    };
    Vec4::new(r as f32, g as f32, b as f32, -minus as f32)
}

impl Volume {
    pub(crate) fn table3(medium: &Medium, filling: &Filling<'_>, nodes: usize) -> Self {
        let values = Axis::new(filling.range, nodes);
        let lengths = Axis::new((0.0, filling.longest), nodes);
        let slice = |k: usize| {
            Texture2::new([values; 2], |f, b| {
                let t = integral(medium, filling, f, b, lengths.value(k));
                if filling.fixed { fixed(t) } else { t }
            })
        };
        Self::Table3 {
            lengths,
            slices: (0..nodes).map(slice).collect(),
        }
    }

    pub(crate) fn table2(medium: &Medium, filling: &Filling<'_>, nodes: usize) -> Self {
        let values = Axis::new(filling.range, nodes);
        let mut texture = Texture2::new([values; 2], |f, b| integral(medium, filling, f, b, filling.average));
        let most = texture.texels.iter().fold(0.0f32, |m, t| m.max(t.w));
        // Nothing is opaque: there is nothing to scale.
        let most = if most > 0.0 { most } else { 1.0 };
        for t in &mut texture.texels {
            *t /= most;
            if filling.fixed {
                *t = fixed(*t);
            }
        }
        Self::Table2 {
            texture,
            most: f64::from(most),
            average: filling.average,
        }
    }

    pub(crate) fn stein(medium: Medium, greatest: f64, filling: &Filling<'_>, nodes: usize) -> Self {
        let axes = [Axis::new((0.0, greatest), nodes), Axis::new((0.0, filling.longest), nodes)];
        let opacity = Texture2::new(axes, |tau, l| {
            let t = Vec4::splat(-(-tau * l).exp_m1() as f32);
            if filling.fixed { fixed(t) } else { t }
        });
        Self::Stein { medium, opacity }
    }

    /// What a vertex of a triangle carries, by the values at the ends of the stay behind it and its length.
    pub(crate) fn vertex(&self, front: f64, back: f64, l: f64) -> [f64; 5] {
        let means = |medium: &Medium| {
            let ((c, tau), (d, rho)) = (medium.at(front), medium.at(back));
            let colour: [f64; 3] = std::array::from_fn(|k| 0.5 * (c[k] + d[k]));
            (colour, 0.5 * (tau + rho))
        };
        match self {
            Self::Table3 { .. } => [front, back, l, 0.0, 0.0],
            // A vertex colour, which graphics hardware holds in [0, 1].
            Self::Table2 { most, average, .. } => [front, back, (most * l / average).clamp(0.0, 1.0), 0.0, 0.0],
            Self::Linear(medium) => {
                let ([r, g, b], tau) = means(medium);
                [r, g, b, -(-tau * l).exp_m1(), 0.0]
            }
            Self::Stein { medium, .. } => {
                let ([r, g, b], tau) = means(medium);
                [r, g, b, tau, l]
            }
        }
    }

    /// Premultiplied colour and opacity of a fragment by what was interpolated between vertices.
    pub(crate) fn fragment(&self, v: [f64; 5]) -> Vec4 {
        let over = |alpha: f32| Vec4::new(v[0] as f32, v[1] as f32, v[2] as f32, 1.0) * alpha;
        match self {
            Self::Table3 { lengths, slices } => {
                let (k, w) = lengths.between(v[2]);
                mix(slices[k].linear(v[0], v[1]), slices[k + 1].linear(v[0], v[1]), w)
            }
            Self::Table2 { texture, .. } => texture.linear(v[0], v[1]) * v[2] as f32,
            Self::Linear(_) => over(v[3] as f32),
            Self::Stein { opacity, .. } => over(opacity.linear(v[3], v[4]).w),
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        let texels = match self {
            Self::Table3 { slices, .. } => slices.iter().map(|s| s.texels.len()).sum(),
            Self::Table2 { texture, .. } => texture.texels.len(),
            Self::Linear(_) => 0,
            Self::Stein { opacity, .. } => opacity.texels.len(),
        };
        texels * size_of::<Vec4>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::Model;
    use isobar_core::TransferFunction;

    fn making<'a>(isovalues: &'a [(f64, u8)], surfaces: &'a [Surface]) -> Making<'a> {
        Making {
            isovalues,
            surfaces,
            inside: Inside::Same,
            thickening: 0.0,
            fixed: false,
        }
    }

    /// Figures 6, 8 and 9, hardcases E4 and E7: which texels are set, the weights, the order by the sign of s_b - s_f.
    #[test]
    fn texels_of_the_figures() {
        let surfaces: Vec<Surface> = [0.3, 0.5, 0.75]
            .iter()
            .enumerate()
            .map(|(i, &c)| Surface::isovalue(c, i))
            .collect();
        let one = [(0.3, 0)];
        let m = making(&one, &surfaces);
        for (f, b, set) in [
            (0.2, 0.8, true),
            (0.8, 0.2, true),
            (0.1, 0.2, false),
            (0.4, 0.9, false),
            (0.5, 0.5, false),
        ] {
            let ([flat, _, _], mark) = Isosurfaces::texel(&m, f, b, 0.01);
            assert_eq!((flat.w == 1.0, mark.count), (set, u8::from(set)), "{f} {b}");
        }
        let ([_, back, front], mark) = Isosurfaces::texel(&m, 0.2, 0.8, 0.01);
        assert!((front.w - 5.0 / 6.0).abs() < 1e-6 && (mark.weight - 5.0 / 6.0).abs() < 1e-6 && (back.w - 1.0).abs() < 1e-5);
        let thick = Making { thickening: 1.0, ..m };
        assert_eq!(
            Isosurfaces::texel(&thick, 0.305, 0.305, 0.01).1.count,
            1,
            "thickened, and no NaN where both are equal"
        );
        assert_eq!(Isosurfaces::texel(&thick, 0.32, 0.9, 0.01).1.count, 0);
        let three = [(0.3, 0), (0.5, 1), (0.75, 2)];
        let m = making(&three, &surfaces);
        let nearest = |f, b| Isosurfaces::texel(&m, f, b, 0.01).1;
        assert_eq!((nearest(0.1, 0.9).surface, nearest(0.1, 0.9).count), (0, 3));
        assert_eq!(
            (
                nearest(0.9, 0.1).surface,
                nearest(0.4, 0.9).surface,
                nearest(0.6, 0.1).surface
            ),
            (2, 1, 1)
        );
    }

    /// Both passes over each other are the weighted sum, through any number of surfaces.
    #[test]
    fn two_passes_are_the_weighted_sum() {
        let surfaces: Vec<Surface> = [0.3, 0.5, 0.75]
            .iter()
            .enumerate()
            .map(|(i, &c)| Surface {
                opacity: [0.4, 0.6, 1.0][i],
                ..Surface::isovalue(c, i)
            })
            .collect();
        let three = [(0.3, 0), (0.5, 1), (0.75, 2)];
        let (light_front, light_back, behind) = (0.9f32, 0.3f32, Vec4::new(0.2, 0.4, 0.6, 1.0));
        for (f, b) in [(0.1, 0.9), (0.9, 0.1), (0.1, 0.6), (0.45, 0.2), (0.1, 0.2)] {
            let ([flat, back, front], _) = Isosurfaces::texel(&making(&three, &surfaces), f, b, 0.01);
            let pass = |texel: Vec4, light: f32, below: Vec4| (texel * light).with_w(texel.w) + below * (1.0 - texel.w);
            let found = pass(front, light_front, pass(back, light_back, behind));
            let (mut want, mut light) = (Vec4::ZERO, 1.0);
            for (c, i) in crossed(&making(&three, &surfaces), f, b, 0.01) {
                let (s, w) = (&surfaces[usize::from(i)], front_weight(f, b, c) as f32);
                let [r, g, blue] = s.colour.map(|v| v * (w * light_front + (1.0 - w) * light_back));
                want += Vec4::new(r, g, blue, 1.0) * (light * s.opacity);
                light *= 1.0 - s.opacity;
            }
            want += behind * light;
            assert!((found - want).abs().max_element() < 1e-5, "{f} {b}: {found} {want}");
            assert!((flat.w - (1.0 - light)).abs() < 1e-6);
        }
    }

    fn medium() -> Medium {
        let points = vec![(0.0, [1.0, 0.5, 0.0], 1.0)];
        Medium::new(&TransferFunction { points, unit: 1.0 }, Model::WilliamsMax)
    }

    const FILLING: Filling<'_> = Filling {
        range: (0.0, 1.0),
        longest: 2.0,
        average: 1.0,
        stops: &[],
        fixed: false,
    };

    /// hardcases E5 and E6: constant extinction 1 at the average length and at twice that.
    #[test]
    fn volumes_of_constant_extinction() {
        let m = medium();
        let at = |v: &Volume, l: f64| v.fragment(v.vertex(0.2, 0.7, l)).w;
        let exact = |l: f64| -(-l).exp_m1() as f32;
        let three = Volume::table3(&m, &FILLING, 33);
        let two = Volume::table2(&m, &FILLING, 16);
        let stein = Volume::stein(m.clone(), 1.0, &FILLING, 256);
        let linear = Volume::Linear(m);
        for l in [0.5, 1.0, 2.0] {
            assert!(
                (at(&three, l) - exact(l)).abs() < 1e-4 && (at(&stein, l) - exact(l)).abs() < 1e-4,
                "{l}"
            );
            assert!((at(&linear, l) - exact(l)).abs() < 1e-6, "at a vertex");
        }
        // Linear in l, and held at 1 by the clamped vertex colour where equation (2) gives 1.2642.
        assert!((at(&two, 1.0) - exact(1.0)).abs() < 1e-6 && (at(&two, 0.5) - 0.5 * exact(1.0)).abs() < 1e-6);
        assert!((at(&two, 2.0) - 1.0).abs() < 1e-6);
    }

    /// Section 10: what is behind the first isovalue adds nothing.
    #[test]
    fn integration_stops_at_isovalues() {
        let m = medium();
        let stops = [(0.3, 0), (0.6, 1)];
        let filling = Filling {
            stops: &stops,
            ..FILLING
        };
        for (f, b, l) in [(0.1, 0.9, 0.25), (0.9, 0.1, 0.375), (0.4, 0.5, 1.0), (0.3, 0.0, 0.0)] {
            let alpha = integral(&m, &filling, f, b, 1.0).w;
            assert!((alpha + (-l as f32).exp_m1()).abs() < 1e-6, "{f} {b}: {alpha}");
        }
    }
}
