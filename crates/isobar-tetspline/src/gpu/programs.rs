//! WGSL of the kernels and of the drawing stages, put together, and compiled at first use.

use super::generate;
use crate::classify::Rule;
use isobar_gpu::shader::{self, Snippets};
use isobar_gpu::{Gpu, GpuError, Kernel, Raster, RasterOptions, Texel, wgpu};

/// Colour of the target: a hit in four words.
pub(super) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;

/// This crate's snippets.
pub(super) const SNIPPETS: Snippets = &[
    ("tet_layout", include_str!("../../shaders/tet_layout.wgsl")),
    ("tet_cube", include_str!("../../shaders/tet_cube.wgsl")),
    ("tet_kinds_of", include_str!("../../shaders/tet_kinds_of.wgsl")),
    ("tet_rule_data", include_str!("../../shaders/tet_rule_data.wgsl")),
    (
        "tet_rule_coefficients",
        include_str!("../../shaders/tet_rule_coefficients.wgsl"),
    ),
    ("tet_rule_paper", include_str!("../../shaders/tet_rule_paper.wgsl")),
    ("tet_classify", include_str!("../../shaders/tet_classify.wgsl")),
    ("tet_scan", include_str!("../../shaders/tet_scan.wgsl")),
    ("tet_sums", include_str!("../../shaders/tet_sums.wgsl")),
    ("tet_compact", include_str!("../../shaders/tet_compact.wgsl")),
    ("tet_counts", include_str!("../../shaders/tet_counts.wgsl")),
    ("tet_tetrahedra", include_str!("../../shaders/tet_tetrahedra.wgsl")),
    ("tet_offsets", include_str!("../../shaders/tet_offsets.wgsl")),
    ("tet_arguments", include_str!("../../shaders/tet_arguments.wgsl")),
    ("tet_lists", include_str!("../../shaders/tet_lists.wgsl")),
    ("tet_ranges", include_str!("../../shaders/tet_ranges.wgsl")),
    ("tet_smooth", include_str!("../../shaders/tet_smooth.wgsl")),
    ("tet_cull", include_str!("../../shaders/tet_cull.wgsl")),
    ("tet_sets", include_str!("../../shaders/tet_sets.wgsl")),
    ("tet_draw_layout", include_str!("../../shaders/tet_draw_layout.wgsl")),
    ("tet_vertex", include_str!("../../shaders/tet_vertex.wgsl")),
    ("tet_owner_texels", include_str!("../../shaders/tet_owner_texels.wgsl")),
    ("tet_owner_sets", include_str!("../../shaders/tet_owner_sets.wgsl")),
    ("tet_varying_exact", include_str!("../../shaders/tet_varying_exact.wgsl")),
    (
        "tet_varying_interpolated",
        include_str!("../../shaders/tet_varying_interpolated.wgsl"),
    ),
    ("tet_roots", include_str!("../../shaders/tet_roots.wgsl")),
    ("tet_root_bracketed", include_str!("../../shaders/tet_root_bracketed.wgsl")),
    ("tet_root_hull", include_str!("../../shaders/tet_root_hull.wgsl")),
    ("tet_root_analytic", include_str!("../../shaders/tet_root_analytic.wgsl")),
    ("tet_root_newton3", include_str!("../../shaders/tet_root_newton3.wgsl")),
    ("tet_fragment", include_str!("../../shaders/tet_fragment.wgsl")),
    ("tet_find_interval", include_str!("../../shaders/tet_find_interval.wgsl")),
    ("tet_find_newton3", include_str!("../../shaders/tet_find_newton3.wgsl")),
    ("tet_span_exact", include_str!("../../shaders/tet_span_exact.wgsl")),
    (
        "tet_span_interpolated",
        include_str!("../../shaders/tet_span_interpolated.wgsl"),
    ),
    ("tet_paint_on", include_str!("../../shaders/tet_paint_on.wgsl")),
    ("tet_paint_off", include_str!("../../shaders/tet_paint_off.wgsl")),
    ("tet_count_on", include_str!("../../shaders/tet_count_on.wgsl")),
    ("tet_count_off", include_str!("../../shaders/tet_count_off.wgsl")),
];

/// How the fragment stage finds roots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Roots {
    Bracketed,
    Newton3,
    Analytic,
    Hull,
}

/// Where a fragment's ray comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rays {
    /// The pixel's own, in fixed point.
    Exact,
    /// Interpolated over the front faces, as printed.
    Interpolated,
}

/// Which kernels build the lists of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ListProgram {
    pub(super) texel: Texel,
    pub(super) rule: Rule,
}

/// Kernels of the lists, in the order they run.
#[derive(Debug, Clone)]
pub(super) struct ListKernels {
    pub(super) classify: Kernel,
    pub(super) scan: Kernel,
    pub(super) sums: Kernel,
    pub(super) compact: Kernel,
    pub(super) tetrahedra: Kernel,
    pub(super) offsets: Kernel,
    pub(super) arguments: Kernel,
    pub(super) lists: Kernel,
    pub(super) sets: Kernel,
    /// Once per data set.
    pub(super) ranges: Kernel,
    /// Once per view.
    pub(super) cull: Kernel,
}

impl ListProgram {
    /// WGSL of the kernel `tet_classify`, ..., `tet_sets`.
    pub(super) fn source(self, entry: &str) -> Result<String, GpuError> {
        let kinds = generate::kinds();
        let set_meets = generate::set_meets();
        let store_set = generate::store_set();
        let own: &[(&str, &str)] = &[("kinds", &kinds), ("set_meets", &set_meets), ("store_set", &store_set)];
        let rule: &[&str] = match self.rule {
            Rule::Data => &["tet_cube", "tet_rule_data"],
            Rule::Coefficients => &["tet_cube", "kinds", "tet_kinds_of", "tet_rule_coefficients"],
            Rule::DeterminingSet => &["tet_cube", "set_meets", "tet_rule_paper"],
        };
        let before: &[&str] = match entry {
            "tet_classify" => rule,
            "tet_tetrahedra" => &["tet_cube", "kinds", "tet_kinds_of", "tet_counts"],
            "tet_lists" | "tet_cull" => &["tet_counts"],
            "tet_ranges" => &["tet_cube"],
            "tet_sets" => &["store_set"],
            _ => &[],
        };
        let names = [&[self.texel.snippet(), "tet_layout"], before, &[entry]].concat();
        shader::compose(&[own, SNIPPETS, shader::SHARED], &names)
    }

    pub(super) fn kernels(self, gpu: &Gpu) -> Result<ListKernels, GpuError> {
        let kernel = |what: &str, entry: &str| Kernel::new(gpu, what, &self.source(entry)?, "main");
        Ok(ListKernels {
            classify: kernel("cube classification", "tet_classify")?,
            scan: kernel("prefix scan", "tet_scan")?,
            sums: kernel("scan of sums", "tet_sums")?,
            compact: kernel("compaction", "tet_compact")?,
            tetrahedra: kernel("tetrahedron classification", "tet_tetrahedra")?,
            offsets: kernel("scans of sums", "tet_offsets")?,
            arguments: kernel("draw arguments", "tet_arguments")?,
            lists: kernel("lists of tetrahedra", "tet_lists")?,
            sets: kernel("determining sets", "tet_sets")?,
            ranges: kernel("ranges of blocks", "tet_ranges")?,
            cull: kernel("culling", "tet_cull")?,
        })
    }
}

/// Which stages draw a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct DrawProgram {
    pub(super) texel: Texel,
    pub(super) roots: Roots,
    pub(super) rays: Rays,
    /// Coefficients from stored determining sets.
    pub(super) stored: bool,
    /// Fragments are counted.
    pub(super) counted: bool,
    /// Hits get texture or curves.
    pub(super) painted: bool,
    /// The grid's axes are left-handed.
    pub(super) mirrored: bool,
}

impl DrawProgram {
    /// WGSL of both stages.
    pub(super) fn source(self) -> Result<String, GpuError> {
        let patch = if self.stored {
            generate::from_set()
        } else {
            generate::on_the_fly()
        };
        let own: &[(&str, &str)] = &[("patch", &patch)];
        let mut names = vec![self.texel.snippet(), "tet_layout", "tet_draw_layout", "patch"];
        names.push(if self.stored { "tet_owner_sets" } else { "tet_owner_texels" });
        names.push(if self.counted { "tet_count_on" } else { "tet_count_off" });
        names.extend(match self.rays {
            Rays::Exact => &["tet_varying_exact", "fixed_ray", "tet_span_exact"][..],
            Rays::Interpolated => &["tet_varying_interpolated", "tet_span_interpolated"][..],
        });
        names.push(if self.painted { "tet_paint_on" } else { "tet_paint_off" });
        names.extend(["tet_vertex", "tet_fragment", "tet_roots"]);
        names.extend(match self.roots {
            Roots::Bracketed => ["tet_root_bracketed", "tet_find_interval"],
            Roots::Newton3 => ["tet_root_newton3", "tet_find_newton3"],
            Roots::Analytic => ["tet_root_analytic", "tet_find_interval"],
            Roots::Hull => ["tet_root_hull", "tet_find_interval"],
        });
        shader::compose(&[own, SNIPPETS, shader::SHARED], &names)
    }

    pub(super) fn raster(self, gpu: &Gpu) -> Result<Raster, GpuError> {
        let options = RasterOptions {
            primitive: wgpu::PrimitiveState {
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                front_face: if self.mirrored {
                    wgpu::FrontFace::Cw
                } else {
                    wgpu::FrontFace::Ccw
                },
                cull_mode: Some(match self.rays {
                    Rays::Exact => wgpu::Face::Front,
                    Rays::Interpolated => wgpu::Face::Back,
                }),
                ..wgpu::PrimitiveState::default()
            },
            ..RasterOptions::default()
        };
        Raster::new(gpu, "tetrahedra", &self.source()?, FORMAT, &options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every module there is, without an adapter and without optional capabilities.
    #[test]
    fn every_module_is_portable() {
        let entries = [
            "classify",
            "scan",
            "sums",
            "compact",
            "tetrahedra",
            "offsets",
            "arguments",
            "lists",
            "sets",
            "ranges",
            "cull",
        ];
        for texel in [Texel::F32, Texel::U8, Texel::I16] {
            for rule in [Rule::Data, Rule::Coefficients, Rule::DeterminingSet] {
                let program = ListProgram { texel, rule };
                for entry in entries {
                    if entry == "classify" || rule == Rule::Data {
                        let source = program.source(&format!("tet_{entry}")).unwrap();
                        shader::validate(&format!("{entry} {program:?}"), &source).unwrap();
                    }
                }
            }
        }
        shader::validate("smooth", &crate::gpu::smooth::source().unwrap()).unwrap();
        for roots in [Roots::Bracketed, Roots::Newton3, Roots::Analytic, Roots::Hull] {
            for rays in [Rays::Exact, Rays::Interpolated] {
                for (texel, stored) in [(Texel::U8, false), (Texel::F32, true)] {
                    let program = DrawProgram {
                        texel,
                        roots,
                        rays,
                        stored,
                        counted: stored,
                        painted: !stored,
                        mirrored: false,
                    };
                    shader::validate(&format!("{program:?}"), &program.source().unwrap()).unwrap();
                }
            }
        }
    }

    /// The operations of the vertex stage by variant (the paper: on the fly has about a third more instructions), and of a fragment's set-up.
    #[test]
    fn operations_of_the_variants() {
        let count = |text: &str| text.matches(" + ").count() + text.matches(" * ").count() + text.matches(" - ").count();
        let (fly, stored) = (count(&generate::on_the_fly()), count(&generate::from_set()));
        println!("on the fly {fly}, from the determining set {stored} operations");
        let fragment = include_str!("../../shaders/tet_fragment.wgsl");
        let find = include_str!("../../shaders/tet_find_interval.wgsl");
        let of = |name: &str, text: &str| {
            text.split(name)
                .nth(1)
                .unwrap()
                .split("\n}")
                .next()
                .unwrap()
                .matches("dot(")
                .count()
        };
        let (first, second) = (of("fn first_step", fragment), of("fn second_step", fragment));
        assert_eq!((first, second, of("fn find", find)), (10, 4, 4));
        assert_eq!(2 * first + 2 * second + 4, 32, "inner products of a fragment");
        // The normal: one more second step, by linear interpolation of the first ones. Texture and curves come behind it and take no step of the patch.
        assert_eq!(of("fn fs", fragment), 0);
        assert_eq!(fragment.matches("_step(").count() + find.matches("_step(").count(), 2 + 1 + 4);
        assert!(!include_str!("../../shaders/tet_paint_on.wgsl").contains("_step("));
    }
}
