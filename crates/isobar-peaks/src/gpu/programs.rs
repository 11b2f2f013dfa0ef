//! The WGSL of this method: which snippets make which kernel.

use crate::filter::Filter;
use isobar_gpu::{Gpu, GpuError, Kernel, Texel, shader};

/// The snippets of `shaders/`, by name.
pub(super) const SNIPPETS: shader::Snippets = &[
    ("peaks_layout", include_str!("../../shaders/peaks_layout.wgsl")),
    ("bc21_weights", include_str!("../../shaders/bc21_weights.wgsl")),
    ("peaks_steps", include_str!("../../shaders/peaks_steps.wgsl")),
    ("peaks_medium", include_str!("../../shaders/peaks_medium.wgsl")),
    ("peaks_cast", include_str!("../../shaders/peaks_cast.wgsl")),
];

/// Which kernel a scene needs: equal keys share one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Program {
    /// Texel type as the shader sees it.
    snippet: &'static str,
    degree: usize,
    bc21: bool,
}

impl Program {
    pub(super) fn new(texel: Texel, filter: Filter) -> Self {
        Self {
            snippet: texel.snippet(),
            degree: filter.basis().degree,
            bc21: filter == Filter::Bc21,
        }
    }

    /// WGSL of the kernel.
    pub(super) fn source(self) -> Result<String, GpuError> {
        let field: &[&str] = match (self.degree, self.bc21) {
            (1, _) => &["trilinear"],
            (2, _) => &["quadratic"],
            (_, false) => &["cubic_weights", "cubic"],
            (_, true) => &["bc21_weights", "cubic"],
        };
        let mut names = vec![self.snippet, "bands", "hit", "peaks_layout", "coefficient"];
        names.extend(field);
        names.extend(["shade", "unit", "peaks_steps", "peaks_medium", "peaks_cast"]);
        shader::compose(&[SNIPPETS, shader::SHARED], &names)
    }

    /// Compiles it.
    pub(super) fn kernel(self, gpu: &Gpu) -> Result<Kernel, GpuError> {
        Kernel::new(gpu, "peaks", &self.source()?, "main")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every module there is, without an adapter and without optional capabilities.
    #[test]
    fn every_module_is_portable() {
        for name in ["trilinear", "quadratic", "cubic", "bc21"] {
            for texel in [Texel::F32, Texel::U8, Texel::I16] {
                let program = Program::new(texel, name.parse().unwrap());
                shader::validate(&format!("{program:?}"), &program.source().unwrap()).unwrap();
            }
        }
    }
}
