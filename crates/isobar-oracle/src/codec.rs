//! Truth as bytes, for a cache, and the key it is cached under.
//!
//! Little endian: the 8 bytes `isotruth`, u32 version, u64 width, u64 height, then per pixel one byte of flags (bits 0-1 stage, 2-4 kind: 0
//! no root, 1 simple, 2 even, 3 odd, 4 stretch, 5 unresolved, 6 unknown; bit 5 undecidable) and, with a root or unresolved, surface u8, slope f32,
//! lo f64, hi as the LEB128 number of representable steps above lo (lo <= hi), and for even and odd the multiplicity u8. Last the
//! first 8 bytes of the SHA-256 of all that.

use crate::{Decided, Multiplicity, TruePixel, Truth, TruthError};
use isobar_core::{Camera, DVec3, NO_SURFACE, Surface, SurfaceKind, View};
use sha2::{Digest, Sha256};

const MAGIC: &[u8; 8] = b"isotruth";

/// To be raised with any change of the format or of what the oracle says of a pixel.
const VERSION: u32 = 3;

/// Position of an f64 among all, so that neighbours differ by one.
fn order(x: f64) -> u64 {
    let b = x.to_bits();
    if b >> 63 == 1 { !b } else { b | 1 << 63 }
}

fn unorder(k: u64) -> f64 {
    f64::from_bits(if k >> 63 == 1 { k & !(1 << 63) } else { !k })
}

impl Truth {
    /// The format of the module's description, which only [`Truth::from_bytes`] of the same version reads.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(36 + self.pixels.len() * 4);
        out.extend_from_slice(MAGIC);
        out.extend_from_slice(&VERSION.to_le_bytes());
        out.extend_from_slice(&(self.width as u64).to_le_bytes());
        out.extend_from_slice(&(self.height as u64).to_le_bytes());
        for p in &self.pixels {
            let (kind, number) = match p.multiplicity {
                None => (if p.unresolved { 5 } else { 0 }, None),
                Some(Multiplicity::Simple) => (1, None),
                Some(Multiplicity::Even(n)) => (2, Some(n)),
                Some(Multiplicity::Odd(n)) => (3, Some(n)),
                Some(Multiplicity::Interval) => (4, None),
                Some(Multiplicity::Unknown) => (6, None),
            };
            let stage = match p.decided {
                Decided::F64 => 0,
                Decided::DoubleDouble => 1,
                Decided::Exact => 2,
            };
            out.push(stage | kind << 2 | u8::from(p.undecidable) << 5);
            if kind == 0 {
                continue;
            }
            out.push(p.surface);
            out.extend_from_slice(&p.slope.to_le_bytes());
            out.extend_from_slice(&p.lo.to_le_bytes());
            let mut steps = order(p.hi) - order(p.lo);
            loop {
                let low = (steps & 127) as u8;
                steps >>= 7;
                out.push(low | if steps > 0 { 128 } else { 0 });
                if steps == 0 {
                    break;
                }
            }
            if let Some(n) = number {
                out.push(u8::try_from(n).unwrap_or(u8::MAX));
            }
        }
        let sum = Sha256::digest(&out);
        out.extend_from_slice(&sum[..8]);
        out
    }

    /// Reads what [`Truth::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`TruthError::Corrupt`] for anything else; never a panic, and no allocation beyond a small multiple of the input.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, TruthError> {
        let bad = |s| Err(TruthError::Corrupt(s));
        let Some((body, sum)) = bytes.split_last_chunk::<8>() else {
            return bad("too short");
        };
        if Sha256::digest(body)[..8] != sum[..] {
            return bad("its checksum is wrong");
        }
        let mut r = Reader(body);
        if r.take::<8>()? != *MAGIC {
            return bad("not a truth");
        }
        if u32::from_le_bytes(r.take()?) != VERSION {
            return bad("of another version");
        }
        let size = |b: [u8; 8]| usize::try_from(u64::from_le_bytes(b)).ok();
        let (Some(width), Some(height)) = (size(r.take()?), size(r.take()?)) else {
            return bad("too large");
        };
        // Every pixel takes at least a byte.
        let Some(n) = width.checked_mul(height).filter(|&n| n <= r.0.len()) else {
            return bad("its size and its length disagree");
        };
        let mut pixels = Vec::with_capacity(n);
        for _ in 0..n {
            pixels.push(r.pixel()?);
        }
        if !r.0.is_empty() {
            return bad("too long");
        }
        Ok(Self { width, height, pixels })
    }
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], TruthError> {
        let (head, tail) = self.0.split_first_chunk::<N>().ok_or(TruthError::Corrupt("too short"))?;
        self.0 = tail;
        Ok(*head)
    }

    fn pixel(&mut self) -> Result<TruePixel, TruthError> {
        let bad = || TruthError::Corrupt("a pixel makes no sense");
        let [flags] = self.take()?;
        let decided = match flags & 3 {
            0 => Decided::F64,
            1 => Decided::DoubleDouble,
            2 => Decided::Exact,
            _ => return Err(bad()),
        };
        let kind = flags >> 2 & 7;
        let mut p = TruePixel {
            decided,
            undecidable: flags >> 5 & 1 == 1,
            ..TruePixel::MISS
        };
        if kind == 0 {
            return Ok(p);
        }
        [p.surface] = self.take()?;
        p.slope = f32::from_le_bytes(self.take()?);
        p.lo = f64::from_le_bytes(self.take()?);
        let (mut steps, mut shift) = (0u64, 0);
        loop {
            let [b] = self.take()?;
            if shift > 63 {
                return Err(bad());
            }
            steps |= u64::from(b & 127) << shift;
            shift += 7;
            if b & 128 == 0 {
                break;
            }
        }
        p.hi = unorder(order(p.lo).checked_add(steps).ok_or_else(bad)?);
        if p.lo.is_nan() || p.hi.is_nan() {
            return Err(bad());
        }
        p.multiplicity = match kind {
            1 => Some(Multiplicity::Simple),
            2 => Some(Multiplicity::Even(u32::from(self.take::<1>()?[0]))),
            3 => Some(Multiplicity::Odd(u32::from(self.take::<1>()?[0]))),
            4 => Some(Multiplicity::Interval),
            6 => Some(Multiplicity::Unknown),
            5 => None,
            _ => return Err(bad()),
        };
        p.unresolved = kind == 5;
        if (p.surface == NO_SURFACE) != p.unresolved {
            return Err(bad());
        }
        Ok(p)
    }
}

/// The key of a truth: hexadecimal, 32 characters (128 bits of SHA-256) over everything it depends on: `data` (a hash of samples and
/// geometry, or whatever names the data uniquely), the reconstruction's name, kinds, isovalues and visibility of the surfaces in order, and
/// the bits of the view; and the version of the format. Colours do not count, nor opacities beyond 0 or not.
#[must_use]
pub fn cache_key(data: &str, reconstruction: &str, surfaces: &[Surface], view: &View) -> String {
    let mut h = Sha256::new();
    h.update(VERSION.to_le_bytes());
    for text in [data, reconstruction] {
        h.update((text.len() as u64).to_le_bytes());
        h.update(text.as_bytes());
    }
    let number = |h: &mut Sha256, x: f64| h.update(x.to_bits().to_le_bytes());
    let vector = |h: &mut Sha256, v: DVec3| v.to_array().into_iter().for_each(|x| h.update(x.to_bits().to_le_bytes()));
    h.update((surfaces.len() as u64).to_le_bytes());
    for s in surfaces {
        match s.kind {
            SurfaceKind::Isovalue(c) => {
                h.update([0, u8::from(s.opacity > 0.0)]);
                number(&mut h, c);
            }
            SurfaceKind::Parameter { axis, value } => {
                h.update([1, u8::from(s.opacity > 0.0), axis]);
                number(&mut h, value);
            }
            SurfaceKind::Boundary => h.update([2, u8::from(s.opacity > 0.0)]),
            _ => h.update([3]),
        }
    }
    h.update((view.width as u64).to_le_bytes());
    h.update((view.height as u64).to_le_bytes());
    match &view.camera {
        Camera::Perspective { eye, target, up, fov } => {
            h.update([0]);
            [eye, target, up].into_iter().for_each(|v| vector(&mut h, *v));
            number(&mut h, *fov);
        }
        Camera::Orthographic { eye, target, up, height } => {
            h.update([1]);
            [eye, target, up].into_iter().for_each(|v| vector(&mut h, *v));
            number(&mut h, *height);
        }
        Camera::Rays(rays) => {
            h.update([2]);
            for r in rays.iter() {
                vector(&mut h, r.origin);
                vector(&mut h, r.direction);
            }
        }
    }
    for c in &view.clips {
        vector(&mut h, c.normal);
        number(&mut h, c.distance);
        h.update([u8::from(c.cap)]);
    }
    h.finalize()[..16].iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth() -> Truth {
        let miss = TruePixel::MISS;
        let hit = TruePixel {
            lo: 1.5,
            hi: 1.5f64.next_up().next_up(),
            surface: 2,
            multiplicity: Some(Multiplicity::Simple),
            slope: -3.25,
            undecidable: true,
            unresolved: false,
            decided: Decided::DoubleDouble,
        };
        let tangent = TruePixel {
            lo: 0.0,
            hi: 0.0,
            multiplicity: Some(Multiplicity::Even(4)),
            decided: Decided::Exact,
            ..hit
        };
        let doubt = TruePixel {
            lo: f64::NEG_INFINITY,
            hi: f64::INFINITY,
            surface: NO_SURFACE,
            multiplicity: None,
            unresolved: true,
            ..hit
        };
        let unknown = TruePixel {
            multiplicity: Some(Multiplicity::Unknown),
            ..hit
        };
        Truth {
            width: 5,
            height: 1,
            pixels: vec![miss, hit, tangent, doubt, unknown],
        }
    }

    #[test]
    fn bytes_come_back() {
        let t = truth();
        assert_eq!(Truth::from_bytes(&t.to_bytes()), Ok(t));
    }

    #[test]
    fn damage_is_found() {
        let b = truth().to_bytes();
        for i in 0..b.len() {
            let mut c = b.clone();
            c[i] ^= 0x40;
            assert!(matches!(Truth::from_bytes(&c), Err(TruthError::Corrupt(_))), "byte {i}");
            assert!(Truth::from_bytes(&b[..i]).is_err());
        }
        // also with a right checksum
        for (at, value) in [(12, 255u8), (19, 255), (28, 3), (29, 0x1d)] {
            let mut c = b[..b.len() - 8].to_vec();
            c[at] = value;
            let sum = Sha256::digest(&c);
            c.extend_from_slice(&sum[..8]);
            assert!(matches!(Truth::from_bytes(&c), Err(TruthError::Corrupt(_))), "byte {at}");
        }
    }

    #[test]
    fn keys_follow_what_the_truth_depends_on() {
        let s = [Surface::isovalue(0.5, 0)];
        let v = View::bench(8, 6);
        let k = cache_key("a", "cubic", &s, &v);
        assert_eq!(k.len(), 32);
        assert_eq!(
            k,
            cache_key(
                "a",
                "cubic",
                &[Surface {
                    colour: [0.0; 3],
                    opacity: 0.5,
                    ..s[0]
                }],
                &v
            )
        );
        for other in [
            cache_key("b", "cubic", &s, &v),
            cache_key("ac", "ubic", &s, &v),
            cache_key("a", "cubic", &[Surface { opacity: 0.0, ..s[0] }], &v),
            cache_key("a", "cubic", &[Surface::isovalue(0.5f64.next_up(), 0)], &v),
            cache_key("a", "cubic", &s, &View::bench(8, 7)),
        ] {
            assert_ne!(k, other);
        }
    }
}
