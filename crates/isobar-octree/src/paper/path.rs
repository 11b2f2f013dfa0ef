//! The parametric traversal of an octree without a stack (thesis, section 3.3.2, after Revelles, Ureña and Lastra 2000), in f32.
//!
//! Where the traversal is in the tree is one word of 32 bits ([`Path`]): three bits a level, one an axis, below a leading 1 that tells the level, so ten levels. A bit is 0 in the
//! half that the ray enters first, which is how Revelles et al. mirror rays of negative directions. A child is chosen from the parameters of the planes in the middle of its parent, the next
//! node by the plane that ends the present one first; where there is no sibling behind that plane the path is cut by a level and the same bit is tried there: bits of the word alone, no plane is
//! asked again, and nothing was stored on the way down.
//!
//! Where it differs from Revelles et al.: they take the parameter of a middle plane as the mean of its parent's two. In f32 that gives the same plane other parameters in other
//! nodes, and a stretch of a ray can fall between them. Here it is one expression of the plane's index ([`Line::plane`]), which rounds monotonically, so that the stretches of the nodes of a level join
//! without gap or overlap. Where two planes end a node at the same parameter both are crossed, and nodes of which a ray has a point only are not visited. The planes around the volume lie at infinity: the caller
//! cuts the ray, in f64, and its rounded ends are not cut again.

/// Levels below the root that a path can tell.
pub(super) const LEVELS: u32 = 10;

/// Node of an octree: three bits a level below a leading 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Path(u32);

/// Every third bit of `x`, ten of them.
#[inline(always)]
const fn every_third(x: u32) -> u32 {
    let x = x & 0x0924_9249;
    let x = (x ^ (x >> 2)) & 0x030c_30c3;
    let x = (x ^ (x >> 4)) & 0x0300_f00f;
    let x = (x ^ (x >> 8)) & 0x0300_00ff;
    (x ^ (x >> 16)) & 0x3ff
}

impl Path {
    const ROOT: Self = Self(1);

    /// Levels below the root.
    #[inline(always)]
    const fn level(self) -> u32 {
        (31 - self.0.leading_zeros()) / 3
    }

    /// Index per axis among the nodes of its level, from the side the ray comes from.
    #[inline(always)]
    fn index(self) -> [u32; 3] {
        let bits = self.0 ^ (1 << (3 * self.level()));
        [every_third(bits), every_third(bits >> 1), every_third(bits >> 2)]
    }

    #[inline(always)]
    const fn child(self, bits: u32) -> Self {
        Self(self.0 << 3 | bits)
    }

    /// The node behind the planes `exit` (a bit an axis) of this one; `None` where that is outside the tree.
    #[inline(always)]
    fn next(self, mut exit: u32) -> Option<Self> {
        let mut word = self.0;
        while word != 1 {
            // Axes along which this is the far half already: the plane is one of the parent's.
            let up = exit & word & 7;
            if up == 0 {
                return Some(Self(word | exit));
            }
            word >>= 3;
            exit = up;
        }
        None
    }
}

/// A ray in index space, cell i between planes i and i + 1, with parameters in f32.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub(super) o: [f32; 3],
    pub(super) d: [f32; 3],
    inverse: [f32; 3],
    /// All ones where the ray goes down an axis, else 0.
    down: [u32; 3],
    cells: [u32; 3],
    /// The cell along an axis that the ray does not move along.
    still: [u32; 3],
}

/// Slower than this along an axis, of 1 along the fastest, is parallel to its planes: the reciprocal stays finite, and a ray of 2^24 cells moves by less than f32 tells.
const STILL: f32 = 1e-30;

impl Line {
    /// From `o` along `d` through `cells` cells per axis, at least 1 each.
    pub(super) fn new(o: [f32; 3], d: [f32; 3], cells: [u32; 3]) -> Self {
        let d = d.map(|d| if d.abs() < STILL { 0.0 } else { d });
        Self {
            o,
            d,
            inverse: d.map(|d| 1.0 / d),
            down: d.map(|d| if d < 0.0 { u32::MAX } else { 0 }),
            cells,
            still: [0, 1, 2].map(|a| (o[a].max(0.0) as u32).min(cells[a] - 1)),
        }
    }

    /// Parameter of the plane of this index; not decreasing along the ray.
    #[inline(always)]
    pub(super) fn plane(&self, axis: usize, index: u32) -> f32 {
        if self.d[axis] == 0.0 {
            return if index <= self.still[axis] {
                f32::NEG_INFINITY
            } else {
                f32::INFINITY
            };
        }
        if index == 0 || index >= self.cells[axis] {
            let behind = (index == 0) == (self.down[axis] == 0);
            return if behind { f32::NEG_INFINITY } else { f32::INFINITY };
        }
        (index as f32 - self.o[axis]) * self.inverse[axis]
    }

    /// Where the ray is at `t`.
    #[inline(always)]
    pub(super) fn at(&self, axis: usize, t: f32) -> f32 {
        self.o[axis] + t * self.d[axis]
    }

    /// Whether the ray goes down this axis.
    #[inline(always)]
    pub(super) fn is_down(&self, axis: usize) -> bool {
        self.down[axis] != 0
    }
}

/// What a traversal asks about a tree.
pub(super) trait Visit {
    /// Whether a node, at `index` among those of its level (0: the root), is to be looked into.
    fn enters(&mut self, level: u32, index: [u32; 3]) -> bool;
    /// A brick that was entered, with the stretch of the ray in it; returns whether to go on.
    fn brick(&mut self, index: [u32; 3], stretch: [f32; 2]) -> bool;
}

/// Visits the nodes on the stretch `span` of a ray front to back. The tree has `depth` levels below the root, at most [`LEVELS`]; its bricks have 2^`side` cells a side.
#[inline(always)]
pub(super) fn traverse(line: &Line, span: [f32; 2], depth: u32, side: u32, visit: &mut impl Visit) {
    let ([mut t, end], mut path) = (span, Path::ROOT);
    loop {
        let level = path.level();
        // From the side of the ray's origin to that of the axis: the bits of the level, complemented.
        let mirror = (1 << level) - 1;
        let mirrored = path.index();
        let index = [0, 1, 2].map(|a| mirrored[a] ^ (line.down[a] & mirror));
        let size = depth - level + side;
        let exits = [0, 1, 2].map(|a| line.plane(a, (index[a] + u32::from(!line.is_down(a))) << size));
        let out = exits[0].min(exits[1]).min(exits[2]);
        let last = out.min(end);
        if t < last && visit.enters(level, index) {
            if level < depth {
                let far = |a: usize| u32::from(line.plane(a, (2 * index[a] + 1) << (size - 1)) <= t) << a;
                path = path.child(far(0) | far(1) | far(2));
                continue;
            }
            if !visit.brick(index, [t, last]) {
                return;
            }
        }
        if out >= end {
            return;
        }
        let exit = |a: usize| u32::from(exits[a] <= out) << a;
        match path.next(exit(0) | exit(1) | exit(2)) {
            Some(next) => path = next,
            None => return,
        }
        t = t.max(out);
    }
}

/// Visits the cells of a brick of 2^`side` a side on its stretch front to back, until `cell` returns false; gives whether all were.
#[inline(always)]
pub(super) fn cells(
    line: &Line,
    brick: [u32; 3],
    side: u32,
    [mut t, end]: [f32; 2],
    mut cell: impl FnMut([u32; 3], [f32; 2]) -> bool,
) -> bool {
    let mut at = [0; 3];
    for a in 0..3 {
        let low = brick[a] << side;
        let high = (low + (1 << side)).min(line.cells[a]) - 1;
        // As rounding has it; then by the planes.
        at[a] = (line.at(a, t).max(0.0) as u32).clamp(low, high);
        let (up, step) = (
            !line.is_down(a),
            |x: u32, forward: bool| if forward { x + 1 } else { x.wrapping_sub(1) },
        );
        let (first, last) = if up { (low, high) } else { (high, low) };
        while at[a] != first && line.plane(a, at[a] + u32::from(!up)) > t {
            at[a] = step(at[a], !up);
        }
        while at[a] != last && line.plane(a, at[a] + u32::from(up)) <= t {
            at[a] = step(at[a], up);
        }
    }
    loop {
        let exits = [0, 1, 2].map(|a| line.plane(a, at[a] + u32::from(!line.is_down(a))));
        let out = exits[0].min(exits[1]).min(exits[2]);
        let last = out.min(end);
        if t < last && !cell(at, [t, last]) {
            return false;
        }
        if out >= end {
            return true;
        }
        for a in 0..3 {
            if exits[a] <= out {
                at[a] = if line.is_down(a) { at[a].wrapping_sub(1) } else { at[a] + 1 };
                if at[a] >> side != brick[a] || at[a] >= line.cells[a] {
                    return true;
                }
            }
        }
        t = t.max(out);
    }
}
