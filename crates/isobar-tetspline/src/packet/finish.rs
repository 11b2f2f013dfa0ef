//! The roots of a tile: parameters, proofs and normals, eight at a time.

use super::pieces::{Lines, coefficients, gradients, two_steps};
use super::{Job, Packet, Paths, Value};
use crate::ray::three;
use glam::DVec3;
use isobar_cpu::packet::{Group, LANES, Lanes, Solved, cubic_roots, ones};

impl Job<'_, '_> {
    /// Solves what is pending; rays of which a root cannot be proved are left to be walked alone.
    #[inline(always)]
    pub(super) fn solve<S: Lanes>(&self, p: &mut Packet, paths: &Paths, values: &[Value]) {
        for at in (0..p.pending.len()).step_by(LANES) {
            let group = p.pending.group(at);
            let mut bound = [0.0; LANES];
            for (to, &v) in bound.iter_mut().zip(&group.value) {
                *to = values[usize::from(v)].bound;
            }
            let [t, error] = cubic_roots::<S>(&group.p, group.root, group.ends, S::load(&bound), group.held, true);
            let gradient = self.gradients(paths, &group, t);
            let mut lanes = [[0.0; LANES]; 2];
            t.store(&mut lanes[0]);
            error.store(&mut lanes[1]);
            for l in ones(group.held.into()) {
                let ray = usize::from(group.ray[l]);
                if !lanes[1][l].is_finite() {
                    p.rays.single[ray / LANES] |= 1 << (ray % LANES);
                    continue;
                }
                let normal = self
                    .space
                    .world_gradient(three(|a| gradient[a][l]).into())
                    .normalize_or(DVec3::ZERO);
                let root = Solved {
                    t: lanes[0][l],
                    error: lanes[1][l],
                    normal: normal.as_vec3().to_array(),
                    value: group.value[l],
                };
                p.add(group.ray[l], root);
            }
        }
    }

    /// Gradients in index space at parameters t.
    #[inline(always)]
    fn gradients<S: Lanes>(&self, paths: &Paths, group: &Group<S, 4>, t: S) -> [[f64; LANES]; 3] {
        let mut data = [0.0; 32 * LANES];
        let mut centres = [0.0; 32];
        for (near, to) in group.near.iter().zip(centres.as_chunks_mut::<LANES>().0) {
            near.store(to);
        }
        for l in ones(group.held.into()) {
            let cube = three(|a| centres[a * LANES + l] as i32);
            data[32 * l..32 * (l + 1)].copy_from_slice(&self.field.data(cube));
        }
        let kind = S::index(u64::from_le_bytes(group.kind));
        let coefficients = coefficients(&data, S::index(0xe0c0_a080_6040_2000), kind);
        let lanes = S::index(0x0706_0504_0302_0100);
        let rays = S::index(u64::from_le_bytes(group.ray));
        let at = Lines::new(paths, rays, &centres, lanes, kind).at(t);
        gradients(two_steps(&coefficients, at), &group.kind)
    }
}
