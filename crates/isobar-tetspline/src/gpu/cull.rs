//! The view frustum in index space: what the active tetrahedra are culled by (K27).
//!
//! Kalbe et al. 2009, section 6: rendering is bound by the vertex stage, and culling by the frustum would relieve it. Here active cubes outside the image are left out by one more
//! compaction, once per view.

use isobar_core::{DVec3, Domain, Lens, View};

/// Sides of the frustum: (a, d) with a.q + d >= 0 for the centre q of every cube that reaches into it.
pub(super) type Planes = [[f32; 4]; 4];

/// By how many pixels the frustum grows: more than tetrahedra do.
const GROW: f64 = 2.0;

/// The sides of a view; `None` where the whole domain is inside, and for lists of rays.
pub(super) fn planes(view: &View, domain: &Domain) -> Option<Planes> {
    let Lens {
        eye,
        right,
        up,
        forward,
        half,
        parallel,
    } = view.lens()?;
    let (w, h) = (view.width as f64, view.height as f64);
    let (x, y) = (half * (w / h) * (1.0 + 2.0 * GROW / w), half * (1.0 + 2.0 * GROW / h));
    let mut out = [[0.0; 4]; 4];
    let mut whole = true;
    for (to, (side, reach)) in out.iter_mut().zip([(right, x), (-right, x), (up, y), (-up, y)]) {
        // Inside: side.(p - eye) is at most the reach, times the depth where rays are not parallel.
        let (n, offset) = if parallel {
            (-side, reach)
        } else {
            (forward * reach - side, 0.0)
        };
        let a = domain.axes.transpose() * n;
        let d = n.dot(domain.origin - eye) + offset;
        let half = 0.5 * a.abs().element_sum();
        // f32 rounds each of the terms, by at most 2^-24 of it, and their sums.
        let slack = 1e-6 * (a.abs().element_sum() * (domain.hi.max_element() + 1.0) + d.abs() + half);
        let lowest = d + (a * domain.hi).min(DVec3::ZERO).element_sum();
        whole &= lowest - half >= 0.0;
        let d = d + half + slack;
        // Of any scale: voxels may be larger than f32 holds.
        let size = a.abs().max_element().max(d.abs());
        *to = [a.x, a.y, a.z, d].map(|v| (v / size) as f32);
    }
    (!whole).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Camera, Data};
    use isobar_fields::Synthetic;

    /// Every point of the domain that a pixel's ray passes lies in a cube that is kept, and cubes far beside are not.
    #[test]
    fn what_is_seen_is_kept() {
        let Data::Grid(grid) = "sphere,n=20".parse::<Synthetic>().unwrap().data().unwrap() else {
            panic!("a grid")
        };
        let domain = grid.domain();
        let near = View::perspective(DVec3::new(1.4, 0.9, 1.0), DVec3::new(0.2, -0.3, 0.1), DVec3::Z, 25.0, 40, 30);
        let inside = View::perspective(DVec3::new(0.1, 0.1, 0.0), DVec3::X, DVec3::Z, 60.0, 30, 30);
        let mut parallel = near.clone();
        parallel.camera = Camera::Orthographic {
            eye: DVec3::new(3.0, 1.0, 2.0),
            target: DVec3::ZERO,
            up: DVec3::Z,
            height: 0.7,
        };
        for view in [near, inside, parallel] {
            let p = planes(&view, &domain).expect("only a part is seen");
            let kept = |q: DVec3| {
                p.iter()
                    .all(|[a, b, c, d]| a * q.x as f32 + b * q.y as f32 + c * q.z as f32 + d >= 0.0)
            };
            let mut culled = 0;
            for n in 0..20 * 20 * 20 {
                let q = DVec3::new((n % 20) as f64, (n / 20 % 20) as f64, (n / 400) as f64);
                culled += usize::from(!kept(q));
            }
            assert!(culled > 500, "{culled} cubes are culled");
            for i in 0..view.width * view.height {
                let ray = view.ray(i % view.width, i / view.width);
                for k in 0..400 {
                    let q = domain.local(ray.at(f64::from(k) * 0.01));
                    if q.cmpge(DVec3::ZERO).all() && q.cmple(domain.hi).all() {
                        assert!(kept(q.round()), "{q}");
                    }
                }
            }
        }
        assert_eq!(
            planes(&View::fit(grid.domain().world_bounds(), 40.0, 64, 64), &domain),
            None,
            "all of it is seen"
        );
    }
}
