//! From patches a ray meets to hits with their errors: the plane s = c of a cell, integers where that is not sure, roots of neighbours joined.

use crate::camera::UNIT;
use crate::exact::{Meeting, meet};
use crate::mesh::Cells;
use crate::patch::Patch;
use glam::DVec3;
use isobar_core::{ClipPlane, Ray};

/// A root on a ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Root {
    pub(crate) t: f64,
    /// A root lies within this of t.
    pub(crate) error: f64,
    pub(crate) cell: u32,
    pub(crate) isovalue: u8,
    /// The end of the stretch on which s = c.
    pub(crate) end: Option<f64>,
    /// Of the cell, of any length.
    pub(crate) gradient: DVec3,
}

impl Root {
    /// Unit gradient of the cell; 0 where it vanishes.
    #[inline(always)]
    pub(crate) fn normal(&self) -> [f32; 3] {
        self.gradient.normalize_or(DVec3::ZERO).as_vec3().to_array()
    }
}

/// Sum of the sizes of the coordinates: at least the length.
#[inline(always)]
fn size(v: DVec3) -> f64 {
    v.x.abs() + v.y.abs() + v.z.abs()
}

/// The gradient of a cell times six times its volume, and what bounds its error.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gradient {
    /// `sum (s_i - s_0) n_i`; cells have positive volume, so its direction is that of the gradient.
    pub(crate) scaled: DVec3,
    /// Six times the volume.
    pub(crate) volume: f64,
    /// What `volume` is known to [`UNIT`] times of.
    pub(crate) edges: f64,
    /// What `scaled` is known to [`UNIT`] times of.
    pub(crate) bound: f64,
}

impl Gradient {
    #[inline(always)]
    pub(crate) fn new(p: &[DVec3; 4], s: &[f64; 4]) -> Self {
        let (a, b, d) = (p[1] - p[0], p[2] - p[0], p[3] - p[0]);
        let (na, nb, nd) = (b.cross(d), d.cross(a), a.cross(b));
        let (sa, sb, sd) = (s[1] - s[0], s[2] - s[0], s[3] - s[0]);
        let (la, lb, ld) = (size(a), size(b), size(d));
        Self {
            scaled: na * sa + nb * sb + nd * sd,
            volume: a.dot(na),
            edges: la * lb * ld,
            bound: sa.abs() * lb * ld + sb.abs() * ld * la + sd.abs() * la * lb,
        }
    }

    /// The normal of a face in its place.
    pub(crate) fn of_face([a, b, c]: &[DVec3; 3]) -> Self {
        let (u, v) = (*b - *a, *c - *a);
        Self {
            scaled: u.cross(v),
            volume: 0.0,
            edges: 0.0,
            bound: size(u) * size(v),
        }
    }

    /// Where the ray meets G . (x - corner) = rise V, and how far that may be off; infinitely where the ray may be parallel.
    ///
    /// With e the edges from corner 0, V = e1 . (e2 x e3) and G = sum (s_i - s_0) n_i, t = (rise V - G . (o - corner)) / (G . d). Every product of
    /// three factors is off by less than 16 units of the product of the factors' sizes, and there are at most nine; [`UNIT`] is 512.
    #[inline(always)]
    fn meet(&self, ray: &Ray, corner: DVec3, rise: f64) -> (f64, f64) {
        let from = ray.origin - corner;
        divide(
            rise * self.volume - self.scaled.dot(from),
            UNIT * (rise.abs() * self.edges + self.bound * size(from)),
            self.scaled.dot(ray.direction),
            UNIT * self.bound * size(ray.direction),
        )
    }
}

/// The quotient of two numbers with their bounds.
#[inline(always)]
fn divide(n: f64, n_off: f64, d: f64, d_off: f64) -> (f64, f64) {
    let t = n / d;
    let rest = d.abs() - d_off;
    let error = (n_off + t.abs() * d_off) / rest + 4.0 * f64::EPSILON * t.abs();
    // Sums so small that their bounds underflow are for integers.
    if rest > 0.0 && n_off > 1e-280 && d_off > 1e-280 && error.is_finite() {
        (t, error)
    } else {
        (t, f64::INFINITY)
    }
}

/// A mesh with isovalues, for rays.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Resolver<'a> {
    pub(crate) cells: &'a Cells,
    pub(crate) isovalues: &'a [f64],
    /// What is beyond them does not count.
    pub(crate) clips: &'a [ClipPlane],
}

/// Whether a plane certainly keeps a root; `None` where f64 cannot tell.
///
/// `normal . (origin + t direction) - distance` has seven terms, none rounded more than 12 times; [`UNIT`] is 512 units.
fn keeps(clip: &ClipPlane, ray: &Ray, root: &Root) -> Option<bool> {
    let n = clip.normal;
    let beyond = n.dot(ray.origin) + root.t * n.dot(ray.direction) - clip.distance;
    let sizes = n.abs().dot(ray.origin.abs()) + root.t * n.abs().dot(ray.direction.abs()) + clip.distance.abs();
    let off = UNIT * sizes + root.error * n.abs().dot(ray.direction.abs()) * (1.0 + UNIT);
    // Bounds that underflow or overflow say nothing.
    (off > 1e-280 && beyond.abs() > off).then_some(beyond < 0.0)
}

impl Resolver<'_> {
    /// Whether all planes keep a root; `None` where f64 cannot tell.
    fn is_kept(&self, ray: &Ray, root: &Root) -> Option<bool> {
        let mut all = Some(true);
        for clip in self.clips {
            match keeps(clip, ray, root) {
                Some(true) => {}
                Some(false) => return Some(false),
                None => all = None,
            }
        }
        all
    }

    /// The hit on a patch that the ray certainly meets, planes apart; `None` where f64 cannot say where, or whether before the start of the ray.
    #[inline(always)]
    pub(crate) fn sure(&self, ray: &Ray, patch: &Patch) -> Option<Root> {
        let (p, s) = (self.cells.corners(patch.cell), self.cells.values(patch.cell));
        let g = Gradient::new(&p, &s);
        let (t, error) = match patch.face() {
            None => g.meet(ray, p[0], self.isovalues[usize::from(patch.isovalue)] - s[0]),
            Some(face) => {
                let corners = [1, 2, 3].map(|i| p[(face + i) % 4]);
                Gradient::of_face(&corners).meet(ray, corners[0], 0.0)
            }
        };
        (error < f64::INFINITY && t > error).then_some(Root {
            t,
            error,
            cell: patch.cell,
            isovalue: patch.isovalue,
            // The far end is worked out only where roots are joined.
            end: patch.face().map(|_| t),
            gradient: g.scaled,
        })
    }

    /// The same in integers; also where the ray may not meet the patch.
    #[cold]
    pub(crate) fn exact(&self, ray: &Ray, cell: u32, isovalue: u8) -> Option<Root> {
        let (p, s) = (self.cells.corners(cell), self.cells.values(cell));
        let (t, end) = match meet(ray, &p, &s, self.isovalues[usize::from(isovalue)], self.clips) {
            Meeting::None => return None,
            Meeting::At(t) => (t, None),
            Meeting::Stretch(t, end) => (t, Some(end)),
        };
        Some(Root {
            t,
            error: 4.0 * f64::EPSILON * t,
            cell,
            isovalue,
            end,
            gradient: Gradient::new(&p, &s).scaled,
        })
    }

    /// All roots on the patches a ray may meet (`certain`: it does) that the planes keep, ascending, each once.
    pub(crate) fn roots(&self, ray: &Ray, patches: impl Iterator<Item = (Patch, bool)>, out: &mut Vec<Root>) {
        out.clear();
        for (patch, certain) in patches {
            // A constant cell is a stretch, which has two ends.
            let sure = if certain && patch.face().is_none() {
                self.sure(ray, &patch)
            } else {
                None
            };
            match sure.map(|root| (root, self.is_kept(ray, &root))) {
                Some((_, Some(false))) => {}
                Some((root, Some(true))) => out.push(root),
                _ => out.extend(self.exact(ray, patch.cell, patch.isovalue)),
            }
        }
        out.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.cell.cmp(&b.cell)));
        if out.len() > 1 {
            self.join(ray, out);
        }
    }

    /// Joins what neighbours found on a common face, edge or corner: of roots too close for f64 each is worked out in integers, and those with the same
    /// t to the last bits are one.
    fn join(&self, ray: &Ray, roots: &mut Vec<Root>) {
        let close = |a: &Root, b: &Root| b.t - b.error <= a.end.unwrap_or(a.t) + a.error;
        let unclear = roots
            .iter()
            .enumerate()
            .any(|(i, b)| roots[..i].iter().any(|a| a.isovalue == b.isovalue && close(a, b)));
        if !unclear {
            return;
        }
        let again: Vec<bool> = (0..roots.len())
            .map(|i| {
                let meets = |j: usize| roots[i].isovalue == roots[j].isovalue && close(&roots[i.min(j)], &roots[i.max(j)]);
                (0..roots.len()).any(|j| j != i && meets(j))
            })
            .collect();
        for (root, again) in roots.iter_mut().zip(again) {
            if again && let Some(exact) = self.exact(ray, root.cell, root.isovalue) {
                *root = exact;
            }
        }
        roots.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.cell.cmp(&b.cell)));
        let mut kept: Vec<Root> = Vec::with_capacity(roots.len());
        for &root in roots.iter() {
            let same = kept
                .iter_mut()
                .rev()
                .find(|k| k.isovalue == root.isovalue)
                .filter(|k| root.t <= k.end.unwrap_or(k.t) + 4.0 * f64::EPSILON * root.t);
            match same {
                Some(k) => {
                    k.error = k.error.max(root.error);
                    let end = root.end.unwrap_or(root.t).max(k.end.unwrap_or(k.t));
                    if k.end.is_some() || root.end.is_some() {
                        // A stretch that is a point is a root like others.
                        k.end = (end > k.t).then_some(end);
                    }
                }
                None => kept.push(root),
            }
        }
        *roots = kept;
    }
}
