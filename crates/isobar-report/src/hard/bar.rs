//! What a hit of a method must keep to be right.

use isobar_core::{Domain, KnobValue, Knobs, Method, Ray, ResolvedKnobs};

/// f32 paths: a hit within this many voxels, where the method proves nothing and has no step (hardcases: 1e-5 of the cell). A double root is known
/// to the square root of the rounding at most, so this is a bar for simple roots; a case's own tolerance counts where it is wider.
const F32: f64 = 1e-5;

/// A mesh does not follow the surface inside a cell: a hundredth of a cell of the mesh.
const MESH: f64 = 0.01;

/// How near a hit of a method must be to the certified root.
#[derive(Debug, Clone, PartialEq)]
pub struct Bar {
    /// Whether the method proves its answers at its default setting: then no claim may be refuted, and only the case's tolerance counts.
    pub proves: bool,
    /// Slack along the ray beside the case's tolerance, in cells; 0 for methods that prove.
    pub cells: f64,
    /// In words, with the setting it follows from.
    pub words: String,
}

impl Bar {
    /// Of a method at its default setting.
    #[must_use]
    pub fn of(m: &dyn Method) -> Self {
        let knobs = ResolvedKnobs::new(m.info().knobs, &Knobs::default());
        let find = |name: &str| {
            let all = knobs.as_ref().ok()?;
            all.iter().find(|(k, _)| *k == name).map(|(_, v)| v.clone())
        };
        let number = |name: &str| match find(name)? {
            KnobValue::Int(v) => Some(v as f64),
            KnobValue::Float(v) => Some(v),
            KnobValue::Word(w) => w.parse().ok(),
        };
        if find("claims").is_some_and(|v| v.to_string() != "off") {
            return Self {
                proves: true,
                cells: 0.0,
                words: "the case's tolerance, no claim refuted".into(),
            };
        }
        let (cells, words) = match (number("step"), number("bisections"), number("subdivide")) {
            (Some(step), Some(n), _) => (step * (-n).exp2(), format!("step {step} halved {n} times")),
            (Some(step), None, _) => (step * MESH, format!("a hundredth of the step {step}")),
            (None, _, Some(n)) => (MESH / n, format!("a hundredth of a cell, {n} to a cell of the grid")),
            _ => (F32, "f32 without a step".to_owned()),
        };
        Self {
            proves: false,
            cells,
            words: format!("within {cells:.1e} cell: {words}"),
        }
    }

    /// The slack in t: the case's tolerance or the bar's, whichever is wider.
    #[must_use]
    pub fn slack(&self, tolerance: f64, domain: &Domain, ray: &Ray) -> f64 {
        // In cells along the ray, so that a spacing of 1e-6 is like any other. A field without cells counts its own units.
        tolerance.max(self.cells / domain.local_vector(ray.direction).length())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::DVec3;

    #[test]
    fn the_bar_follows_from_the_settings() {
        let bar = |id: &str| Bar::of(isobar::method(id).unwrap());
        assert!(bar("octree/cpu").proves && bar("tetspline/cpu").proves);
        let march = bar("march/cpu");
        assert!(!march.proves && march.words.contains("step 0.5 halved 8 times"), "{march:?}");
        assert_eq!(march.cells, 0.5 / 256.0);
        assert_eq!(bar("mc/cpu").cells, 0.01);
        let domain = Domain {
            axes: isobar_core::DMat3::from_diagonal(DVec3::new(1.0, 1.0, 1e-6)),
            ..Domain::world_box(DVec3::ZERO, DVec3::ONE)
        };
        let ray = |direction| Ray {
            origin: DVec3::ZERO,
            direction,
        };
        // A cell along z is 1e-6 long.
        assert_eq!(march.slack(1e-9, &domain, &ray(DVec3::Z)), march.cells * 1e-6);
        assert_eq!(bar("octree/cpu").slack(1e-9, &domain, &ray(DVec3::X)), 1e-9);
    }
}
