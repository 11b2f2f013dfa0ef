//! The WGSL of this method: which snippets make which kernel.

use isobar_fields::Kind;
use isobar_gpu::{Gpu, GpuError, Kernel, Texel, shader};

/// The snippets of `shaders/`, by name.
pub(super) const SNIPPETS: shader::Snippets = &[
    ("march_layout", include_str!("../../shaders/march_layout.wgsl")),
    ("fetch", include_str!("../../shaders/fetch.wgsl")),
    ("trilinear_fetch", include_str!("../../shaders/trilinear_fetch.wgsl")),
    ("quadratic_fetch", include_str!("../../shaders/quadratic_fetch.wgsl")),
    ("cubic_fetch", include_str!("../../shaders/cubic_fetch.wgsl")),
    ("blocks", include_str!("../../shaders/blocks.wgsl")),
    ("march", include_str!("../../shaders/march.wgsl")),
];

/// How coefficients are weighted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Filter {
    /// f32 weights, one load per coefficient.
    Exact,
    /// Fetches whose fractions are rounded to this many bits.
    Bits(u32),
}

impl Filter {
    /// The knob's word.
    pub(super) fn named(word: &str) -> Self {
        match word {
            "bits8" => Self::Bits(8),
            "bits9" => Self::Bits(9),
            _ => Self::Exact,
        }
    }

    /// Steps of a fraction; 1 where it is not used.
    pub(super) fn fractions(self) -> f32 {
        match self {
            Self::Exact => 1.0,
            Self::Bits(n) => (1u32 << n) as f32,
        }
    }
}

/// Which kernels a scene needs: equal keys share them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Program {
    /// Texel type as the shader sees it.
    snippet: &'static str,
    degree: usize,
    fetches: bool,
}

impl Program {
    pub(super) fn new(texel: Texel, kind: Kind, filter: Filter) -> Self {
        Self {
            snippet: texel.snippet(),
            degree: kind.basis().degree,
            fetches: filter != Filter::Exact,
        }
    }

    /// One for each way a shader may see texels.
    pub(super) fn all(kind: Kind, filter: Filter) -> [Self; 3] {
        [Texel::F32, Texel::U8, Texel::I16].map(|t| Self::new(t, kind, filter))
    }

    /// WGSL of the kernel whose last snippet, `entry`, uses `value` and `gradient`.
    pub(super) fn source(self, tables: &[&[(&str, &str)]], entry: &str) -> Result<String, GpuError> {
        let mut names = vec![self.snippet, "bands", "hit", "march_layout", "coefficient"];
        names.extend(match (self.degree, self.fetches) {
            (1, false) => &["trilinear"][..],
            (2, false) => &["quadratic"],
            (_, false) => &["cubic_weights", "cubic"],
            (1, true) => &["fetch", "trilinear_fetch"],
            (2, true) => &["fetch", "quadratic_fetch"],
            (_, true) => &["fetch", "cubic_fetch"],
        });
        names.extend(["shade", "unit", entry]);
        shader::compose(tables, &names)
    }

    /// Compiles the marching kernel.
    pub(super) fn march(self, gpu: &Gpu) -> Result<Kernel, GpuError> {
        Kernel::new(gpu, "march", &self.source(&[SNIPPETS, shader::SHARED], "march")?, "main")
    }
}

/// Compiles a kernel of `blocks.wgsl`: `fine` or `coarse`.
pub(super) fn blocks(gpu: &Gpu, texel: Texel, entry: &str) -> Result<Kernel, GpuError> {
    let source = shader::compose(&[SNIPPETS, shader::SHARED], &[texel.snippet(), "march_layout", "blocks"])?;
    Kernel::new(gpu, entry, &source, entry)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every module there is, without an adapter and without optional capabilities.
    #[test]
    fn every_module_is_portable() {
        let tables: &[&[(&str, &str)]] = &[SNIPPETS, shader::SHARED];
        let mut modules = 0;
        for kind in Kind::ALL {
            for filter in [Filter::Exact, Filter::Bits(8)] {
                for program in Program::all(kind, filter) {
                    shader::validate(&format!("{program:?}"), &program.source(tables, "march").unwrap()).unwrap();
                    modules += 1;
                }
            }
        }
        for snippet in ["volume_f32", "volume_u32", "volume_i32"] {
            let source = shader::compose(tables, &[snippet, "march_layout", "blocks"]).unwrap();
            shader::validate(snippet, &source).unwrap();
            modules += 1;
        }
        assert_eq!(modules, 33);
    }

    #[test]
    fn every_snippet_is_used() {
        let tables: &[&[(&str, &str)]] = &[SNIPPETS, shader::SHARED];
        let all: String = Kind::ALL
            .into_iter()
            .flat_map(|k| [Filter::Exact, Filter::Bits(9)].map(|f| Program::new(Texel::F32, k, f)))
            .map(|p| p.source(tables, "march").unwrap())
            .collect();
        for (name, _) in SNIPPETS.iter().filter(|(n, _)| *n != "blocks") {
            assert!(all.contains(&format!("// {name}\n")), "{name}");
        }
    }
}
