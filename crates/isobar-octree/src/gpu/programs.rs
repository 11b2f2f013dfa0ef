//! The WGSL of this method: which snippets and which generated text make which kernel.

use super::generate::{self, Loops};
use isobar_fields::Kind;
use isobar_gpu::{Gpu, GpuError, Kernel, Texel, shader};

/// The snippets of `shaders/`, by name.
pub(super) const SNIPPETS: shader::Snippets = &[
    ("octree_layout", include_str!("../../shaders/octree_layout.wgsl")),
    ("octree_ranges", include_str!("../../shaders/octree_ranges.wgsl")),
    ("octree_mark", include_str!("../../shaders/octree_mark.wgsl")),
    ("octree_solve", include_str!("../../shaders/octree_solve.wgsl")),
    ("octree_cast", include_str!("../../shaders/octree_cast.wgsl")),
];

/// Which kernels a scene needs: equal keys share them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Program {
    /// Texel type as the shader sees it.
    snippet: &'static str,
    degree: usize,
    loops: Loops,
}

/// The kernels of a [`Program`].
#[derive(Debug, Clone)]
pub(super) struct Kernels {
    /// Least and greatest coefficient per brick.
    pub(super) ranges: Kernel,
    /// Active cells per active brick.
    pub(super) mark: Kernel,
    /// The caster.
    pub(super) cast: Kernel,
}

impl Program {
    pub(super) fn new(texel: Texel, kind: Kind, loops: Loops) -> Self {
        Self {
            snippet: texel.snippet(),
            degree: kind.basis().degree,
            loops,
        }
    }

    /// WGSL of the kernel `octree_ranges`, `octree_mark` or `octree_cast`.
    pub(super) fn source(self, entry: &str) -> Result<String, GpuError> {
        let cast = entry == "octree_cast";
        let polynomial = if cast {
            generate::polynomial(self.degree, self.loops)
        } else {
            generate::constants(self.degree)
        };
        let own: &[(&str, &str)] = &[("polynomial", &polynomial)];
        let mut names = vec![self.snippet, "bands", "octree_layout", "polynomial"];
        if cast {
            names.extend(["shade", "unit", "octree_solve"]);
        }
        names.push(entry);
        shader::compose(&[own, SNIPPETS, shader::SHARED], &names)
    }

    /// Compiles all three.
    pub(super) fn kernels(self, gpu: &Gpu) -> Result<Kernels, GpuError> {
        let kernel = |what: &str, entry: &str| Kernel::new(gpu, what, &self.source(entry)?, "main");
        Ok(Kernels {
            ranges: kernel("brick ranges", "octree_ranges")?,
            mark: kernel("active cells", "octree_mark")?,
            cast: kernel("octree caster", "octree_cast")?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every module there is, without an adapter and without optional capabilities.
    #[test]
    fn every_module_is_portable() {
        for kind in [Kind::Trilinear, Kind::Quadratic, Kind::Cubic] {
            for texel in [Texel::F32, Texel::U8, Texel::I16] {
                for loops in [Loops::Unrolled, Loops::Looped] {
                    let program = Program::new(texel, kind, loops);
                    for entry in ["octree_ranges", "octree_mark", "octree_cast"] {
                        let source = program.source(entry).unwrap();
                        shader::validate(&format!("{entry} {program:?}"), &source).unwrap();
                    }
                }
            }
        }
    }

    /// The unrolled caster indexes no array by a loop counter, the looped one does.
    #[test]
    fn unrolled_text_has_no_private_arrays() {
        for kind in [Kind::Trilinear, Kind::Cubic] {
            let has = |loops| generate::polynomial(kind.basis().degree, loops).contains("array<");
            assert!(!has(Loops::Unrolled) && has(Loops::Looped), "{kind}");
        }
    }
}
