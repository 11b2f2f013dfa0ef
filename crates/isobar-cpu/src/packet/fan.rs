//! The rays of a tile, eight at a time, with the bits of [`View::ray`].
//!
//! One by one a ray takes four divisions and a root, and making them was an eighth of a frame of trilinear first hits. Here what a column or a row of pixels shares is worked out
//! once, the rest in lanes, by the same operations in the same order.

use super::lanes::{LANES, Lanes};
use super::three;
use crate::{TILE, Tile};
use glam::DVec3;
use isobar_core::{Lens, View};

/// Where the rays of a tile come from.
#[derive(Debug)]
pub(super) struct Fan {
    pub(super) lens: Lens,
    /// Steps to the right, of the four columns of blocks, and up, of the eight rows.
    columns: [[f64; LANES]; TILE / 4],
    rows: [[f64; LANES]; TILE / 2],
}

/// `from` + `right` x + `up` y.
#[inline(always)]
fn along<S: Lanes>(from: DVec3, right: DVec3, up: DVec3, x: S, y: S) -> [S; 3] {
    let (f, r, u) = (from.to_array(), right.to_array(), up.to_array());
    three(|a| S::splat(f[a]).add(S::splat(r[a]).mul(x)).add(S::splat(u[a]).mul(y)))
}

impl Fan {
    /// `None` for lists of rays. Pixels beyond the tile repeat its last ones.
    pub(super) fn new(view: &View, tile: Tile) -> Option<Self> {
        let lens = view.lens()?;
        let (width, height) = (view.width as f64, view.height as f64);
        let aspect = width / height;
        let mut fan = Self {
            lens,
            columns: [[0.0; LANES]; TILE / 4],
            rows: [[0.0; LANES]; TILE / 2],
        };
        for n in 0..TILE {
            let x = (tile.x + n.min(tile.width - 1)) as f64;
            let y = (tile.y + n.min(tile.height - 1)) as f64;
            let sx = (2.0 * (x + 0.5) / width - 1.0) * lens.half * aspect;
            let sy = (1.0 - 2.0 * (y + 0.5) / height) * lens.half;
            // Pixel (x, y) is lane 4 (y & 1) + (x & 3) of its block.
            (fan.columns[n / 4][n % 4], fan.columns[n / 4][4 + n % 4]) = (sx, sx);
            fan.rows[n / 2][4 * (n % 2)..][..4].fill(sy);
        }
        Some(fan)
    }

    /// Origins and directions of block `b`.
    #[inline(always)]
    pub(super) fn rays<S: Lanes>(&self, b: usize) -> [[S; 3]; 2] {
        let (x, y) = (S::load(&self.columns[b & 3]), S::load(&self.rows[b >> 2]));
        let lens = &self.lens;
        let (eye, forward) = (lens.eye.to_array(), lens.forward.to_array());
        if lens.parallel {
            return [along(lens.eye, lens.right, lens.up, x, y), three(|a| S::splat(forward[a]))];
        }
        let d = along(lens.forward, lens.right, lens.up, x, y);
        let square = d[0].mul(d[0]).add(d[1].mul(d[1])).add(d[2].mul(d[2]));
        let scale = S::splat(1.0).div(square.sqrt());
        [three(|a| S::splat(eye[a])), three(|a| d[a].mul(scale))]
    }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::{WithLanes, run};
    use super::super::{BLOCKS, pixel};
    use super::*;
    use crate::Level;
    use isobar_core::Camera;

    struct All<'a>(&'a Fan);

    impl WithLanes for All<'_> {
        type Output = Vec<[f64; 6]>;
        #[inline(always)]
        fn run<S: Lanes>(self) -> Self::Output {
            let mut out = Vec::new();
            for b in 0..BLOCKS {
                let [o, d] = self.0.rays::<S>(b);
                let mut lanes = [[0.0; LANES]; 6];
                for (to, v) in lanes.iter_mut().zip(o.into_iter().chain(d)) {
                    v.store(to);
                }
                out.extend((0..LANES).map(|l| lanes.map(|v| v[l])));
            }
            out
        }
    }

    /// Claims speak of the bits of `View::ray`.
    #[test]
    fn rays_are_those_of_the_view_bit_by_bit() {
        let (eye, target) = (DVec3::new(2.61, -1.9, 0.37), DVec3::new(0.1, 0.2, -0.3));
        let up = DVec3::new(0.1, 0.2, 0.7);
        let camera = Camera::Orthographic {
            eye,
            target,
            up,
            height: 3.7,
        };
        let views = [
            View::bench(1024, 768),
            View::perspective(eye, target, up, 61.7, 333, 117),
            View {
                camera,
                ..View::bench(101, 77)
            },
        ];
        for view in &views {
            for (x, y) in [
                (0, 0),
                (view.width / 32 * 16, view.height / 32 * 16),
                (view.width / 16 * 16, view.height / 16 * 16),
            ] {
                let tile = Tile {
                    x: x.min(view.width - 1),
                    y: y.min(view.height - 1),
                    width: TILE.min(view.width - x.min(view.width - 1)),
                    height: TILE.min(view.height - y.min(view.height - 1)),
                };
                let fan = Fan::new(view, tile).unwrap();
                for level in Level::ALL {
                    for (n, got) in run(level, All(&fan)).into_iter().enumerate() {
                        let (x, y) = pixel(n / LANES, n % LANES);
                        let ray = view.ray(tile.x + x.min(tile.width - 1), tile.y + y.min(tile.height - 1));
                        let want: Vec<f64> = ray.origin.to_array().into_iter().chain(ray.direction.to_array()).collect();
                        assert_eq!(
                            got.map(f64::to_bits).to_vec(),
                            want.iter().map(|v| v.to_bits()).collect::<Vec<_>>()
                        );
                    }
                }
            }
        }
        assert!(
            Fan::new(
                &View::rays([view_ray(&views[0])]),
                Tile {
                    x: 0,
                    y: 0,
                    width: 1,
                    height: 1
                }
            )
            .is_none()
        );
    }

    fn view_ray(view: &View) -> isobar_core::Ray {
        view.ray(0, 0)
    }
}
