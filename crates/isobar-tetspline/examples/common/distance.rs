//! The signed distance to a closed triangle mesh as a grid, exact in a band of a few voxels and constant beyond it.

use isobar_core::{DMat3, DVec3, DataError, Grid, Samples};
use isobar_io::TriangleMesh;

/// Voxels on either side of the mesh that hold its distance.
const BAND: f64 = 4.0;

/// `n` samples along the longest axis and a margin of two bands; positive inside, in voxels.
pub(crate) fn field(mesh: &TriangleMesh, n: usize) -> Result<Grid, DataError> {
    let bounds = |f: fn(DVec3, DVec3) -> DVec3, start: DVec3| mesh.points.iter().copied().fold(start, f);
    let (lo, hi) = (bounds(DVec3::min, DVec3::INFINITY), bounds(DVec3::max, DVec3::NEG_INFINITY));
    let step = (hi - lo).max_element() / (n as f64 - 1.0 - 4.0 * BAND);
    let origin = lo - DVec3::splat(2.0 * BAND * step);
    let dims = ((hi - lo) / step + DVec3::splat(4.0 * BAND + 1.0))
        .ceil()
        .to_array()
        .map(|d| d as usize);
    let points: Vec<DVec3> = mesh.points.iter().map(|p| (*p - origin) / step).collect();
    let mut near = vec![BAND as f32; dims.iter().product()];
    let mut crossings: Vec<Vec<f32>> = vec![Vec::new(); dims[1] * dims[2]];
    for t in &mesh.triangles {
        let t = t.map(|i| points[i as usize]);
        splat(t, dims, &mut near);
        cross(t, dims, &mut crossings);
    }
    // Rows along x: inside behind an odd number of crossings.
    for (row, hits) in near.chunks_mut(dims[0]).zip(&mut crossings) {
        hits.sort_by(f32::total_cmp);
        for (i, d) in row.iter_mut().enumerate() {
            let behind = hits.partition_point(|x| *x < i as f32);
            *d = if behind % 2 == 1 { *d } else { -*d };
        }
    }
    Grid::new(dims, DVec3::splat(step), origin, DMat3::IDENTITY, Samples::F32(near.into()))
}

/// Lowers the distances of the samples within the band of a triangle.
fn splat(t: [DVec3; 3], dims: [usize; 3], near: &mut [f32]) {
    let from = (t[0].min(t[1]).min(t[2]) - BAND).max(DVec3::ZERO).to_array();
    let to = (t[0].max(t[1]).max(t[2]) + BAND + 1.0).to_array();
    for k in from[2] as usize..(to[2] as usize).min(dims[2]) {
        for j in from[1] as usize..(to[1] as usize).min(dims[1]) {
            for i in from[0] as usize..(to[0] as usize).min(dims[0]) {
                let p = DVec3::new(i as f64, j as f64, k as f64);
                let d = (nearest(p, t) - p).length() as f32;
                let at = &mut near[(k * dims[1] + j) * dims[0] + i];
                *at = at.min(d);
            }
        }
    }
}

/// Where the rows along x through samples meet a triangle; every edge belongs to one of its two sides.
fn cross([a, b, c]: [DVec3; 3], dims: [usize; 3], crossings: &mut [Vec<f32>]) {
    let lo = a.min(b).min(c).max(DVec3::ZERO).ceil();
    let hi = a.max(b).max(c).floor();
    let side = |p: DVec3, q: DVec3, y: f64, z: f64| {
        // The same edge in both triangles: from the same end.
        let swap = (p.y, p.z) > (q.y, q.z);
        let (p, q) = if swap { (q, p) } else { (p, q) };
        let s = (q.y - p.y) * (z - p.z) - (q.z - p.z) * (y - p.y);
        (s > 0.0) != swap
    };
    for k in lo.z as usize..((hi.z + 1.0).max(0.0) as usize).min(dims[2]) {
        for j in lo.y as usize..((hi.y + 1.0).max(0.0) as usize).min(dims[1]) {
            let (y, z) = (j as f64, k as f64);
            let sides = [side(a, b, y, z), side(b, c, y, z), side(c, a, y, z)];
            let n = (b - a).cross(c - a);
            if sides[0] == sides[1] && sides[1] == sides[2] && n.x != 0.0 {
                let x = a.x - (n.y * (y - a.y) + n.z * (z - a.z)) / n.x;
                crossings[k * dims[1] + j].push(x as f32);
            }
        }
    }
}

/// The point of a triangle nearest to p.
fn nearest(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let on = |a: DVec3, b: DVec3| {
        let d = b - a;
        a + d * ((p - a).dot(d) / d.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
    };
    let n = (b - a).cross(c - a);
    let inside = [(a, b), (b, c), (c, a)]
        .iter()
        .all(|(u, v)| (*v - *u).cross(p - *u).dot(n) >= 0.0);
    if inside && n.length_squared() > 0.0 {
        return p - n * ((p - a).dot(n) / n.length_squared());
    }
    [on(a, b), on(b, c), on(c, a)]
        .into_iter()
        .min_by(|u, v| (*u - p).length_squared().total_cmp(&(*v - p).length_squared()))
        .unwrap_or(a)
}
