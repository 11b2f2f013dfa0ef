//! One hierarchy from many: the hierarchies of blocks of triangles become subtrees of a hierarchy over the blocks.
//!
//! A ray then walks one tree with one stack. Walking the hierarchy over the blocks and, in each of its leaves, that of the block gives the same
//! hits in 9 % more time.

use obvhs::cwbvh::{CwBvh, node::CwBvhNode};

/// Meta byte of an inner child in a slot (the format of `CwBvhNode::child_meta`).
fn inner(slot: usize) -> u8 {
    0b0010_0000 | (24 + slot as u8)
}

/// Hierarchies, one behind the other in one list of nodes, so that none is held twice.
#[derive(Debug)]
pub(super) struct Forest {
    /// The first is kept free for the root of all.
    nodes: Vec<CwBvhNode>,
    roots: Vec<u32>,
}

impl Forest {
    pub(super) fn new() -> Self {
        Self {
            nodes: vec![CwBvhNode::default()],
            roots: Vec::new(),
        }
    }

    /// Bytes that adding `more` nodes asks for.
    pub(super) fn growth(&self, more: usize) -> usize {
        super::cast::growth(&self.nodes, more)
    }

    /// Adds the hierarchy of a block whose primitives are numbered from `first` on.
    pub(super) fn add(&mut self, nodes: &[CwBvhNode], first: u32) {
        let base = self.nodes.len() as u32;
        self.roots.push(base);
        self.nodes.extend(nodes.iter().map(|n| CwBvhNode {
            child_base_idx: n.child_base_idx + base,
            primitive_base_idx: n.primitive_base_idx + first,
            ..*n
        }));
    }

    /// Everything under `top`, whose primitives are the blocks in the order they were added, one to a leaf.
    pub(super) fn under(mut self, top: &CwBvh) -> CwBvh {
        self.place(top, 0, 0);
        self.nodes.shrink_to_fit();
        CwBvh {
            nodes: self.nodes,
            total_aabb: top.total_aabb,
            ..CwBvh::default()
        }
    }

    /// Writes node `from` of `top` at `to`, and its children, which must lie together, behind all nodes there are: copies of the roots of blocks
    /// among them.
    fn place(&mut self, top: &CwBvh, from: usize, to: usize) {
        let source = top.nodes[from];
        let slots: Vec<usize> = (0..8).filter(|&slot| source.child_meta[slot] != 0).collect();
        let first = self.nodes.len();
        self.nodes.resize(first + slots.len(), CwBvhNode::default());
        let mut node = source;
        node.child_base_idx = first as u32;
        node.imask = 0;
        let mut below = source.child_base_idx as usize;
        for (at, slot) in (first..).zip(slots) {
            node.imask |= 1 << slot;
            node.child_meta[slot] = inner(slot);
            if source.imask >> slot & 1 == 1 {
                self.place(top, below, at);
                below += 1;
            } else {
                let leaf = source.primitive_base_idx + u32::from(source.child_meta[slot] & 31);
                let block = top.primitive_indices[leaf as usize] as usize;
                self.nodes[at] = self.nodes[self.roots[block] as usize];
            }
        }
        self.nodes[to] = node;
    }
}
