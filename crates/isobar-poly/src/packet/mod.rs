//! Roots of sixteen polynomials at a time, f32.
//!
//! The sixteen lanes walk the tree of halvings together: a cell is visited if any lane needs it, and each lane does exactly the arithmetic of
//! the scalar f32 solver in the cells it needs, so results agree with [`crate::first_root`] and [`crate::all_roots`] bit for bit. Then all lanes run
//! Newton's iteration in lockstep, and the last digits in f64 (`sharpen.rs`). For all roots the cells found are first gathered: sixteen of them,
//! of whatever polynomials, are refined together. A lane that meets anything but the plain case (a coefficient of uncertain sign, a cell deeper
//! than [`LEVELS`], a failed check) is handed to the scalar solver.
//!
//! The bodies are inlined into functions compiled for AVX-512, AVX2 or the build's base level, chosen at run time.

mod gather;
mod refine;
mod walk;

use crate::answer::{First, Root, RootKind, Roots, Tolerance};
use crate::simd::{LANES, Plain, Wide};
use crate::{MAX_DEGREE, all_roots, first_root};
use gather::many as many_all;
use refine::Isolated;
use walk::{Cell, Keep, isolate};

/// Depth to which lanes stay together.
const LEVELS: usize = 12;

/// Coefficients of sixteen polynomials as a packet: `packet[i][lane]` is coefficient i of polynomial `lane`.
#[must_use]
pub fn packet<const M: usize>(polynomials: &[[f32; M]; LANES]) -> [[f32; LANES]; M] {
    std::array::from_fn(|i| std::array::from_fn(|lane| polynomials[lane][i]))
}

/// Instructions used by [`first_roots_at`] and [`roots_of_packets_at`]. Answers do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// What the crate was compiled for.
    Base,
    /// AVX2.
    Avx2,
    /// AVX-512 F and DQ.
    Avx512,
}

impl Level {
    /// The best level of this processor.
    #[must_use]
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") {
                return Self::Avx512;
            }
            if is_x86_feature_detected!("avx2") {
                return Self::Avx2;
            }
        }
        Self::Base
    }
}

/// [`crate::first_root`] for packets of sixteen polynomials with M Bernstein coefficients each (`packets[p][i][lane]`, degree M - 1): the
/// same answers, bit for bit, into `out[p][lane]`. Fastest for many packets per call.
///
/// # Panics
/// If `out` is not as long as `packets`.
pub fn first_roots<const M: usize>(packets: &[[[f32; LANES]; M]], tolerance: &Tolerance<f32>, out: &mut [[First<f32>; LANES]]) {
    first_roots_at(Level::detect(), packets, tolerance, out);
}

/// [`crate::all_roots`] for packets, as [`first_roots`]: the same answers, bit for bit, into `out[p][lane]`.
///
/// # Panics
/// If `out` is not as long as `packets`.
pub fn roots_of_packets<const M: usize>(
    packets: &[[[f32; LANES]; M]],
    tolerance: &Tolerance<f32>,
    out: &mut [[Roots<f32>; LANES]],
) {
    roots_of_packets_at(Level::detect(), packets, tolerance, out);
}

/// The functions of the levels, and the choice among them.
macro_rules! levels {
    ($(#[$doc:meta])* $at:ident, $answer:ty, $many:ident, $avx512:ident, $avx2:ident) => {
        $(#[$doc])*
        pub fn $at<const M: usize>(
            level: Level,
            packets: &[[[f32; LANES]; M]],
            tolerance: &Tolerance<f32>,
            out: &mut [[$answer; LANES]],
        ) {
            assert_eq!(packets.len(), out.len(), "one place per packet");
            match level.min(Level::detect()) {
                #[cfg(target_arch = "x86_64")]
                #[expect(unsafe_code, reason = "functions with target features")]
                // SAFETY: `detect` found the features.
                Level::Avx512 => unsafe { $avx512(packets, tolerance, out) },
                #[cfg(target_arch = "x86_64")]
                #[expect(unsafe_code, reason = "functions with target features")]
                // SAFETY: `detect` found the feature.
                Level::Avx2 => unsafe { $avx2(packets, tolerance, out) },
                _ => $many::<Plain, M>(packets, tolerance, out),
            }
        }

        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx512f,avx512dq")]
        fn $avx512<const M: usize>(packets: &[[[f32; LANES]; M]], tolerance: &Tolerance<f32>, out: &mut [[$answer; LANES]]) {
            $many::<crate::simd::Avx512, M>(packets, tolerance, out);
        }

        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2")]
        fn $avx2<const M: usize>(packets: &[[[f32; LANES]; M]], tolerance: &Tolerance<f32>, out: &mut [[$answer; LANES]]) {
            $many::<crate::simd::Avx2, M>(packets, tolerance, out);
        }
    };
}

levels! {
    /// [`first_roots`] with at most the given level (less where the processor has less): to compare levels.
    ///
    /// # Panics
    /// If `out` is not as long as `packets`.
    first_roots_at, First<f32>, many_first, first_avx512, first_avx2
}

levels! {
    /// [`roots_of_packets`] with at most the given level (less where the processor has less): to compare levels.
    ///
    /// # Panics
    /// If `out` is not as long as `packets`.
    roots_of_packets_at, Roots<f32>, many_all, all_avx512, all_avx2
}

/// Whether packets can do what is asked at all.
#[inline(always)]
fn is_plain<const M: usize>(tolerance: &Tolerance<f32>) -> bool {
    (2..=MAX_DEGREE + 1).contains(&M)
        && tolerance.error >= 0.0
        && tolerance.error.is_finite()
        && tolerance.splits >= Tolerance::<f32>::SPLITS
}

/// A root that is not one yet.
const NO_ROOT: Root<f32> = Root {
    lo: 0.0,
    hi: 0.0,
    t: 0.0,
    kind: RootKind::Crossing,
};

#[inline(always)]
fn load<W: Wide, const M: usize>(input: &[[f32; LANES]; M]) -> [W; M] {
    let mut b = [W::splat(0.0); M];
    for (wide, row) in b.iter_mut().zip(input) {
        *wide = W::load(row);
    }
    b
}

#[inline(always)]
fn many_first<W: Wide, const M: usize>(
    packets: &[[[f32; LANES]; M]],
    tolerance: &Tolerance<f32>,
    out: &mut [[First<f32>; LANES]],
) {
    let plain = is_plain::<M>(tolerance);
    let zero = W::splat(0.0);
    let mut stack = walk::stack::<W, M>();
    for (input, out) in packets.iter().zip(out) {
        let mut scalar = u16::MAX;
        if plain {
            let b = load::<W, M>(input);
            let mut found = Isolated {
                b,
                a: zero,
                w: W::splat(1.0),
                error: zero,
                most: zero,
                root: W::none(),
            };
            let left = isolate(b, tolerance, &mut stack, &mut found);
            let mut roots = [NO_ROOT; LANES];
            let open = refine::refine(&found, input, tolerance, &mut roots);
            let root = W::bits(found.root);
            *out = [First::None; LANES];
            for l in 0..LANES {
                if root >> l & 1 != 0 {
                    out[l] = First::Root(roots[l]);
                }
            }
            scalar = W::bits(left) | open;
        }
        if scalar != 0 {
            rest(input, tolerance, scalar, out);
        }
    }
}

/// Keeps the first cell of each lane.
impl<W: Wide, const M: usize> Keep<W, M> for Isolated<W, M> {
    const FIRST: bool = true;

    #[inline(always)]
    fn keep(&mut self, cell: &Cell<W, M>, lanes: W::Mask) {
        for (kept, new) in self.b.iter_mut().zip(cell.b) {
            *kept = new.where_or(lanes, *kept);
        }
        self.a = W::splat(cell.a).where_or(lanes, self.a);
        self.w = W::splat(cell.w).where_or(lanes, self.w);
        self.error = cell.error.where_or(lanes, self.error);
        self.most = cell.most.where_or(lanes, self.most);
        self.root = W::either(self.root, lanes);
    }
}

/// The polynomial of a lane.
fn lane<const M: usize>(input: &[[f32; LANES]; M], lane: usize) -> [f32; M] {
    std::array::from_fn(|i| input[i][lane])
}

/// The scalar solver for the lanes in `which`.
#[cold]
#[inline(never)]
fn rest<const M: usize>(input: &[[f32; LANES]; M], tolerance: &Tolerance<f32>, which: u16, out: &mut [First<f32>; LANES]) {
    for (l, out) in out.iter_mut().enumerate() {
        if which >> l & 1 != 0 {
            *out = first_root(&lane(input, l), tolerance);
        }
    }
}

/// As [`rest`], for all roots.
#[cold]
#[inline(never)]
fn rest_all<const M: usize>(input: &[[f32; LANES]; M], tolerance: &Tolerance<f32>, which: u16, out: &mut [Roots<f32>; LANES]) {
    for (l, out) in out.iter_mut().enumerate() {
        if which >> l & 1 != 0 {
            *out = all_roots(&lane(input, l), tolerance);
        }
    }
}
