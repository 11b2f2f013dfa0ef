//! Tiles of an image, drawn in parallel and written into the frame in place.

use crate::Pool;
use glam::DVec3;
use isobar_core::{Channels, Claim, Frame, Hit, Pixel, RenderError, Request, Stop, View};
use rayon::prelude::*;
use std::marker::PhantomData;

/// Side of a tile in pixels: 256 rays share a kernel call, a look at [`Stop`] and neighbouring samples.
pub const TILE: usize = 16;

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tile {
    /// Left column.
    pub x: usize,
    /// Top row.
    pub y: usize,
    /// Columns, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
}

impl Tile {
    /// Its pixels (x, y) of the image, row by row.
    pub fn pixels(self) -> impl Iterator<Item = (usize, usize)> {
        (self.y..self.y + self.height).flat_map(move |y| (self.x..self.x + self.width).map(move |x| (x, y)))
    }

    /// Whether pixel (x, y) of the image lies in it.
    #[must_use]
    pub const fn contains(self, x: usize, y: usize) -> bool {
        x >= self.x && x - self.x < self.width && y >= self.y && y - self.y < self.height
    }
}

/// One channel of the frame, shared by the tiles.
#[derive(Debug)]
struct Plane<'a, T> {
    first: *mut T,
    len: usize,
    frame: PhantomData<&'a mut [T]>,
}

impl<T> Clone for Plane<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for Plane<'_, T> {}

#[expect(unsafe_code, reason = "tiles of one frame are written by several threads")]
// SAFETY: a plane is only written through `TileOut`, at pixels of its own tile; tiles do not overlap.
unsafe impl<T: Send> Send for Plane<'_, T> {}
#[expect(unsafe_code, reason = "as above")]
// SAFETY: as above; sharing the plane itself gives no access.
unsafe impl<T: Send> Sync for Plane<'_, T> {}

impl<'a, T: Copy> Plane<'a, T> {
    fn new(v: &'a mut [T]) -> Self {
        Self {
            first: v.as_mut_ptr(),
            len: v.len(),
            frame: PhantomData,
        }
    }

    /// Writes entry `at`; nothing where the channel is not held.
    ///
    /// # Safety
    /// No other thread may access that entry meanwhile.
    #[inline]
    #[expect(unsafe_code, reason = "tiles of one frame are written by several threads")]
    unsafe fn set(self, at: usize, value: T) {
        if self.len > 0 {
            assert!(at < self.len, "inside the image");
            // SAFETY: in range by the check above; exclusive by this function's contract.
            unsafe { self.first.add(at).write(value) };
        }
    }

    /// Entry `at`; `None` where the channel is not held.
    ///
    /// # Safety
    /// No other thread may write that entry meanwhile.
    #[inline]
    #[expect(unsafe_code, reason = "tiles of one frame are written by several threads")]
    unsafe fn get(self, at: usize) -> Option<T> {
        (self.len > 0).then(|| {
            assert!(at < self.len, "inside the image");
            // SAFETY: in range by the check above; not written meanwhile by this function's contract; the frame's memory is initialised.
            unsafe { self.first.add(at).read() }
        })
    }

    /// Writes `n` entries from `at` on; nothing where the channel is not held.
    ///
    /// # Safety
    /// No other thread may access these entries meanwhile.
    #[expect(unsafe_code, reason = "tiles of one frame are written by several threads")]
    unsafe fn fill(self, at: usize, n: usize, value: T) {
        if self.len > 0 {
            assert!(at + n <= self.len, "inside the image");
            // SAFETY: in range by the check above; exclusive by this function's contract; the frame's memory is initialised.
            unsafe { std::slice::from_raw_parts_mut(self.first.add(at), n) }.fill(value);
        }
    }
}

/// The channels of a frame.
#[derive(Debug, Clone, Copy)]
struct Planes<'a> {
    width: usize,
    pixels: usize,
    layers: usize,
    channels: Channels,
    t: Plane<'a, f64>,
    point: Plane<'a, DVec3>,
    normal: Plane<'a, [f32; 3]>,
    surface: Plane<'a, u8>,
    t_error: Plane<'a, f64>,
    hits: Plane<'a, u16>,
    claim: Plane<'a, Claim>,
    rgba: Plane<'a, [f32; 4]>,
    work: Plane<'a, u32>,
}

impl<'a> Planes<'a> {
    fn new(f: &'a mut Frame) -> Self {
        Self {
            width: f.width,
            pixels: f.width * f.height,
            layers: f.layers,
            channels: f.channels,
            t: Plane::new(&mut f.t),
            point: Plane::new(&mut f.point),
            normal: Plane::new(&mut f.normal),
            surface: Plane::new(&mut f.surface),
            t_error: Plane::new(&mut f.t_error),
            hits: Plane::new(&mut f.hits),
            claim: Plane::new(&mut f.claim),
            rgba: Plane::new(&mut f.rgba),
            work: Plane::new(&mut f.work),
        }
    }
}

/// Where one tile's pixels are written. Every pixel starts as "no hit, background 0".
#[derive(Debug)]
pub struct TileOut<'a> {
    planes: Planes<'a>,
    tile: Tile,
    /// Whether only hits nearer than what is there count, and the last pixel that had one.
    nearest: (bool, Option<usize>),
}

impl TileOut<'_> {
    /// The tile.
    #[inline]
    #[must_use]
    pub const fn tile(&self) -> Tile {
        self.tile
    }

    /// Layers kept per pixel, at least 1.
    #[inline]
    #[must_use]
    pub const fn layers(&self) -> usize {
        self.planes.layers
    }

    /// Whether the frame holds any of these channels.
    #[inline]
    #[must_use]
    pub const fn holds(&self, channels: Channels) -> bool {
        self.planes.channels.intersects(channels)
    }

    /// From now on a pixel is written only where its first hit is nearer than the one it has: for a volume drawn in parts, each over all of the tile. With one
    /// layer, and t held; hits and their pixels one after the other, as [`crate::PixelSink`] writes them.
    pub const fn keep_nearest(&mut self) {
        self.nearest = (true, None);
    }

    /// Whether [`TileOut::keep_nearest`] is in force.
    #[inline]
    #[must_use]
    pub const fn keeps_nearest(&self) -> bool {
        self.nearest.0
    }

    /// t of the first hit of pixel (x, y) of the image; infinite where there is none so far, or t is not held.
    ///
    /// # Panics
    /// When the pixel lies outside the tile.
    #[inline]
    #[must_use]
    #[expect(unsafe_code, reason = "the tile's own pixels are read in place")]
    pub fn t(&self, x: usize, y: usize) -> f64 {
        let at = self.at(x, y);
        // SAFETY: `at` belongs to a pixel of this tile, which nobody else writes.
        unsafe { self.planes.t.get(at) }.unwrap_or(f64::INFINITY)
    }

    #[inline]
    fn at(&self, x: usize, y: usize) -> usize {
        assert!(self.tile.contains(x, y), "pixel ({x}, {y}) lies outside {:?}", self.tile);
        y * self.planes.width + x
    }

    /// Stores a hit in `layer` of pixel (x, y) of the image; channels not held are dropped.
    ///
    /// # Panics
    /// When the pixel lies outside the tile, or the layer does not exist.
    #[inline]
    #[expect(unsafe_code, reason = "the tile's own pixels are written in place")]
    pub fn set_hit(&mut self, layer: usize, x: usize, y: usize, h: &Hit) {
        let p = self.planes;
        assert!(layer < p.layers, "layer {layer} of {}", p.layers);
        let at = layer * p.pixels + self.at(x, y);
        if self.nearest.0 {
            let nearer = layer == 0 && h.t < self.t(x, y);
            self.nearest.1 = nearer.then_some(at);
            if !nearer {
                return;
            }
        }
        // SAFETY: `at` belongs to a pixel of this tile, tiles are disjoint, and each is handed out once.
        unsafe {
            p.t.set(at, h.t);
            p.point.set(at, h.point);
            p.normal.set(at, h.normal);
            p.surface.set(at, h.surface);
            p.t_error.set(at, h.t_error);
        }
    }

    /// Stores what is known of pixel (x, y) of the image besides its hits.
    ///
    /// # Panics
    /// When the pixel lies outside the tile.
    #[inline]
    #[expect(unsafe_code, reason = "the tile's own pixels are written in place")]
    pub fn set_pixel(&mut self, x: usize, y: usize, pixel: &Pixel) {
        let at = self.at(x, y);
        let p = self.planes;
        if self.nearest.0 && self.nearest.1 != Some(at) {
            return;
        }
        // SAFETY: as in `set_hit`.
        unsafe {
            p.hits.set(at, pixel.hits);
            p.claim.set(at, pixel.claim);
            p.rgba.set(at, pixel.rgba);
            p.work.set(at, pixel.work);
        }
    }

    /// Every pixel of the tile: no hit, background 0.
    #[expect(unsafe_code, reason = "the tile's own pixels are written in place")]
    fn clear(&mut self) {
        let (p, tile) = (self.planes, self.tile);
        let none = Hit::NONE;
        let nothing = Pixel::default();
        for y in tile.y..tile.y + tile.height {
            let row = y * p.width + tile.x;
            for layer in 0..p.layers {
                let at = layer * p.pixels + row;
                // SAFETY: as in `set_hit`; the row lies in the tile.
                unsafe {
                    p.t.fill(at, tile.width, none.t);
                    p.point.fill(at, tile.width, none.point);
                    p.normal.fill(at, tile.width, none.normal);
                    p.surface.fill(at, tile.width, none.surface);
                    p.t_error.fill(at, tile.width, none.t_error);
                }
            }
            // SAFETY: as above.
            unsafe {
                p.hits.fill(row, tile.width, nothing.hits);
                p.claim.fill(row, tile.width, nothing.claim);
                p.rgba.fill(row, tile.width, nothing.rgba);
                p.work.fill(row, tile.width, nothing.work);
            }
        }
    }
}

/// Columns and rows of a tile: flat images (lists of rays) get long tiles.
fn tile_size(view: &View) -> (usize, usize) {
    let rows = view.height.clamp(1, TILE);
    (TILE * TILE / rows, rows)
}

/// Whether the frame already has this shape, so that its memory need not be touched before the tiles do.
fn has_shape(f: &Frame, width: usize, height: usize, layers: usize, channels: Channels) -> bool {
    let n = width * height;
    let want = |c, n| if channels.contains(c) { n } else { 0 };
    (f.width, f.height, f.layers, f.channels) == (width, height, layers, channels)
        && f.t.len() == want(Channels::T, n * layers)
        && f.point.len() == want(Channels::POINT, n * layers)
        && f.normal.len() == want(Channels::NORMAL, n * layers)
        && f.surface.len() == want(Channels::SURFACE, n * layers)
        && f.t_error.len() == want(Channels::T_ERROR, n * layers)
        && f.hits.len() == want(Channels::HITS, n)
        && f.claim.len() == want(Channels::CLAIM, n)
        && f.rgba.len() == want(Channels::RGBA, n)
        && f.work.len() == want(Channels::WORK, n)
}

/// Draws an image tile by tile on the pool. `frame` gets the size of the view and the channels and layers of the request; each tile
/// starts empty and is written by one call of `draw`. `stop` is looked at before each tile and told of each that is done.
///
/// # Errors
/// [`RenderError::Stopped`]: the frame is then partly drawn. [`RenderError::View`] as [`View::validate`].
pub fn render_tiles<F>(
    pool: &Pool,
    view: &View,
    request: &Request,
    stop: &Stop,
    frame: &mut Frame,
    draw: F,
) -> Result<(), RenderError>
where
    F: Fn(Tile, &mut TileOut<'_>) + Sync,
{
    view.validate()?;
    let (width, height, layers) = (view.width, view.height, request.layers.max(1));
    if !has_shape(frame, width, height, layers, request.channels) {
        frame.reset(width, height, layers, request.channels);
    }
    let planes = Planes::new(frame);
    let (tw, th) = tile_size(view);
    let (columns, rows) = (width.div_ceil(tw), height.div_ceil(th));
    stop.begin((columns * rows) as u64);
    pool.install(|| {
        (0..columns * rows).into_par_iter().with_max_len(1).for_each(|i| {
            if stop.is_raised() {
                return;
            }
            let (x, y) = (i % columns * tw, i / columns * th);
            let tile = Tile {
                x,
                y,
                width: tw.min(width - x),
                height: th.min(height - y),
            };
            let mut out = TileOut {
                planes,
                tile,
                nearest: (false, None),
            };
            out.clear();
            draw(tile, &mut out);
            stop.step();
        });
    });
    if stop.is_raised() { Err(RenderError::Stopped) } else { Ok(()) }
}

/// Copies a frame, keeping the memory of `to` where it suffices: what `Renderer::read` does on the CPU.
pub fn copy_frame(from: &Frame, to: &mut Frame) {
    (to.width, to.height, to.layers, to.channels) = (from.width, from.height, from.layers, from.channels);
    to.t.clone_from(&from.t);
    to.point.clone_from(&from.point);
    to.normal.clone_from(&from.normal);
    to.surface.clone_from(&from.surface);
    to.t_error.clone_from(&from.t_error);
    to.hits.clone_from(&from.hits);
    to.claim.clone_from(&from.claim);
    to.rgba.clone_from(&from.rgba);
    to.work.clone_from(&from.work);
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::NO_SURFACE;

    const ALL: Channels = Channels::all();

    fn request(layers: usize) -> Request {
        Request {
            channels: ALL,
            layers,
            ..Request::default()
        }
    }

    /// A frame in which every entry tells its own pixel and layer.
    fn draw(pool: &Pool, view: &View, request: &Request, frame: &mut Frame) {
        render_tiles(pool, view, request, &Stop::default(), frame, |tile, out| {
            for (x, y) in tile.pixels() {
                if (x + y) % 3 == 0 {
                    continue;
                }
                for layer in 0..request.layers {
                    let h = Hit {
                        t: (x * 1000 + y) as f64 + layer as f64 * 0.5,
                        point: DVec3::splat(x as f64),
                        normal: [y as f32; 3],
                        surface: layer as u8,
                        t_error: 0.25,
                    };
                    out.set_hit(layer, x, y, &h);
                }
                let p = Pixel {
                    hits: 3,
                    claim: Claim::EXISTS,
                    rgba: [x as f32; 4],
                    work: y as u32,
                };
                out.set_pixel(x, y, &p);
            }
        })
        .unwrap();
    }

    #[test]
    fn every_pixel_is_drawn_once_whatever_the_size() {
        let pool = Pool::new(2).unwrap();
        for (w, h) in [(1, 1), (17, 1), (1, 33), (16, 16), (37, 21), (5, 64)] {
            let view = View::bench(w, h);
            let mut f = Frame::default();
            draw(&pool, &view, &request(2), &mut f);
            for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
                let i = y * w + x;
                for layer in 0..2 {
                    let at = layer * w * h + i;
                    if (x + y) % 3 == 0 {
                        assert_eq!((f.t[at], f.surface[at]), (f64::INFINITY, NO_SURFACE), "{w}x{h}: ({x}, {y})");
                    } else {
                        assert_eq!(f.t[at], (x * 1000 + y) as f64 + layer as f64 * 0.5, "{w}x{h}: ({x}, {y})");
                        assert_eq!((f.normal[at][0], f.surface[at]), (y as f32, layer as u8));
                    }
                }
                let want = if (x + y) % 3 == 0 { (0, 0) } else { (3, y as u32) };
                assert_eq!((f.hits[i], f.work[i]), want);
            }
        }
    }

    /// Two parts, one after the other: of each pixel the nearer hit with its colour, and nothing that is farther.
    #[test]
    fn parts_of_a_volume_keep_the_nearest() {
        let view = View::bench(40, 20);
        let mut f = Frame::default();
        let t = |part: usize, x: usize, y: usize| ((x * 7 + y * 3 + part * 5) % 11) as f64;
        render_tiles(
            &Pool::new(2).unwrap(),
            &view,
            &request(1),
            &Stop::default(),
            &mut f,
            |tile, out| {
                for part in 0..3 {
                    for (x, y) in tile.pixels() {
                        // Part 1 hits in every other pixel.
                        if part != 1 || x % 2 == 0 {
                            let h = Hit {
                                t: t(part, x, y),
                                surface: part as u8,
                                ..Hit::NONE
                            };
                            out.set_hit(0, x, y, &h);
                        }
                        let p = Pixel {
                            rgba: [part as f32; 4],
                            ..Pixel::default()
                        };
                        out.set_pixel(x, y, &p);
                    }
                    out.keep_nearest();
                }
                assert!(out.keeps_nearest());
            },
        )
        .unwrap();
        for (i, &got) in f.t.iter().enumerate() {
            let (x, y) = (i % 40, i / 40);
            let mut want = (t(0, x, y), 0);
            for part in [1, 2] {
                if (part != 1 || x % 2 == 0) && t(part, x, y) < want.0 {
                    want = (t(part, x, y), part);
                }
            }
            assert_eq!(
                (got, usize::from(f.surface[i]), f.rgba[i][0]),
                (want.0, want.1, want.1 as f32)
            );
        }
    }

    #[test]
    fn frames_do_not_depend_on_threads_or_on_what_was_there_before() {
        let view = View::bench(50, 35);
        let mut one = Frame::default();
        draw(&Pool::new(1).unwrap(), &view, &request(1), &mut one);
        // the same frame object, full of another image of the same shape
        let mut two = Frame::new(50, 35, 1, ALL);
        two.t.fill(-1.0);
        two.hits.fill(9);
        two.rgba.fill([4.0; 4]);
        draw(&Pool::new(2).unwrap(), &view, &request(1), &mut two);
        assert_eq!(one, two);
        let mut copy = Frame::new(3, 3, 2, Channels::T);
        copy_frame(&one, &mut copy);
        assert_eq!(copy, one);
    }

    #[test]
    fn only_the_channels_asked_for_are_held() {
        let r = Request {
            channels: Channels::T,
            ..Request::default()
        };
        let mut f = Frame::default();
        draw(&Pool::new(1).unwrap(), &View::bench(20, 20), &r, &mut f);
        assert_eq!((f.t.len(), f.rgba.len(), f.point.len()), (400, 0, 0));
    }

    #[test]
    fn stop_ends_the_work_and_progress_is_told() {
        let (pool, view, stop) = (Pool::new(2).unwrap(), View::bench(64, 64), Stop::default());
        let mut f = Frame::default();
        render_tiles(&pool, &view, &request(1), &stop, &mut f, |_, _| ()).unwrap();
        assert_eq!(stop.progress(), (16, 16));
        let result = render_tiles(&pool, &view, &request(1), &stop, &mut f, |_, _| stop.raise());
        assert_eq!(result, Err(RenderError::Stopped));
        assert!(stop.progress().0 < 16, "{:?}", stop.progress());
    }

    #[test]
    #[should_panic(expected = "outside")]
    fn a_tile_cannot_write_its_neighbours_pixels() {
        let mut f = Frame::default();
        let pool = Pool::new(1).unwrap();
        let _ = render_tiles(
            &pool,
            &View::bench(40, 40),
            &request(1),
            &Stop::default(),
            &mut f,
            |tile, out| {
                out.set_hit(0, tile.x + TILE, tile.y, &Hit::NONE);
            },
        );
    }
}
