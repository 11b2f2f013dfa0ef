//! Values in chunks of 8^3, and sets of chunks.

use super::Number;

/// Samples of a chunk along an axis: the k of Steinberger 2010, section 4.4.
pub const CHUNK: usize = 8;
/// Samples of a chunk.
pub(super) const VOLUME: usize = CHUNK * CHUNK * CHUNK;

/// Number of chunks that cover a lattice.
pub(super) fn chunks_of(dims: [usize; 3]) -> [usize; 3] {
    dims.map(|n| n.div_ceil(CHUNK))
}

/// A lattice of values stored chunk by chunk, each x fastest; the last chunks of an axis are padded.
#[derive(Debug, Clone)]
pub(super) struct Blocks<T> {
    pub(super) dims: [usize; 3],
    pub(super) chunks: [usize; 3],
    pub(super) data: Vec<T>,
}

impl<T: Number> Blocks<T> {
    pub(super) fn new(dims: [usize; 3]) -> Self {
        let chunks = chunks_of(dims);
        Self {
            dims,
            chunks,
            data: vec![T::default(); chunks.iter().product::<usize>() * VOLUME],
        }
    }

    /// From values x fastest.
    pub(super) fn from_rows(dims: [usize; 3], rows: &[T]) -> Self {
        let mut blocks = Self::new(dims);
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                let row = &rows[(z * dims[1] + y) * dims[0]..][..dims[0]];
                for (x, part) in row.chunks(CHUNK).enumerate() {
                    let at = blocks.at([x * CHUNK, y, z]);
                    blocks.data[at..at + part.len()].copy_from_slice(part);
                }
            }
        }
        blocks
    }

    /// The values x fastest.
    pub(super) fn to_rows(&self) -> Vec<T> {
        let dims = self.dims;
        let mut rows = Vec::with_capacity(dims.iter().product());
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in (0..dims[0]).step_by(CHUNK) {
                    let at = self.at([x, y, z]);
                    rows.extend_from_slice(&self.data[at..at + CHUNK.min(dims[0] - x)]);
                }
            }
        }
        rows
    }

    /// Where value (x, y, z) is stored.
    #[inline(always)]
    pub(super) fn at(&self, [x, y, z]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.chunks;
        let chunk = ((z / CHUNK) * ny + y / CHUNK) * nx + x / CHUNK;
        ((chunk * CHUNK + z % CHUNK) * CHUNK + y % CHUNK) * CHUNK + x % CHUNK
    }

    /// The eight values from (x, y, z) on, x a multiple of 8.
    #[inline(always)]
    pub(super) fn row(&self, xyz: [usize; 3]) -> &[T; CHUNK] {
        let at = self.at(xyz);
        self.data[at..].first_chunk().expect("a row lies inside its chunk")
    }
}

/// A set of chunks of one level.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChunkSet {
    chunks: [usize; 3],
    members: Vec<bool>,
}

impl ChunkSet {
    /// A set with none or all of the chunks.
    #[must_use]
    pub fn new(chunks: [usize; 3], all: bool) -> Self {
        Self {
            chunks,
            members: vec![all; chunks.iter().product()],
        }
    }

    /// Chunks per axis.
    #[must_use]
    pub const fn chunks(&self) -> [usize; 3] {
        self.chunks
    }

    /// Position of a chunk in x fastest order.
    #[must_use]
    #[inline(always)]
    pub const fn index(&self, chunk: [usize; 3]) -> usize {
        index_of(self.chunks, chunk)
    }

    /// Chunk at a position.
    #[must_use]
    pub const fn chunk(&self, i: usize) -> [usize; 3] {
        let [nx, ny, _] = self.chunks;
        [i % nx, i / nx % ny, i / (nx * ny)]
    }

    /// Whether a chunk is in the set.
    #[must_use]
    #[inline(always)]
    pub fn contains(&self, chunk: [usize; 3]) -> bool {
        self.members[self.index(chunk)]
    }

    /// Puts a chunk in or takes it out.
    pub fn set(&mut self, chunk: [usize; 3], member: bool) {
        let i = self.index(chunk);
        self.members[i] = member;
    }

    /// Number of chunks in the set.
    #[must_use]
    pub fn count(&self) -> usize {
        self.members.iter().filter(|&&m| m).count()
    }

    /// The chunks in the set.
    pub fn iter(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        (0..self.members.len()).filter(|&i| self.members[i]).map(|i| self.chunk(i))
    }

    pub(super) fn members(&self) -> &[bool] {
        &self.members
    }

    /// Chunk by chunk, `f(of this set, of the other)`.
    pub(super) fn zip(&self, other: &Self, f: impl Fn(bool, bool) -> bool) -> Self {
        let members = self.members.iter().zip(&other.members).map(|(&a, &b)| f(a, b)).collect();
        Self {
            chunks: self.chunks,
            members,
        }
    }

    /// With all chunks within `radius` of a member along every axis.
    #[must_use]
    pub fn dilated(&self, radius: [usize; 3]) -> Self {
        fn join(to: &mut [bool], from: &[bool]) {
            to.iter_mut().zip(from).for_each(|(to, &from)| *to |= from);
        }
        let mut out = self.clone();
        let mut stride = 1;
        for (&n, &radius) in self.chunks.iter().zip(&radius) {
            let line = stride * n;
            if radius > 0 {
                let from = out.members.clone();
                for (to, from) in out.members.chunks_exact_mut(line).zip(from.chunks_exact(line)) {
                    for k in 1..=radius.min(n - 1) {
                        join(&mut to[k * stride..], from);
                        join(to, &from[k * stride..]);
                    }
                }
            }
            stride = line;
        }
        out
    }
}

/// Position of a chunk in x fastest order.
#[inline(always)]
pub(super) const fn index_of([nx, ny, _]: [usize; 3], [x, y, z]: [usize; 3]) -> usize {
    (z * ny + y) * nx + x
}
