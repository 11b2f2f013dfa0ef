//! The program isobar as a library, and [`methods`], the one list of methods.
//!
//! The program's verbs are thin: what they do is here, so that the report and the tests do exactly the same. [`source`] opens DATA,
//! [`view_spec`] and [`surfaces`] read the flags that make a scene, [`run`] draws and takes the time apart, [`truth`] keeps certified
//! frames, [`checking`] compares a frame with them, [`output`] writes files whole or not at all.
//!
//! Errors are [`anyhow::Error`]s whose text is one line that names the file or flag, the reason and a remedy.

pub mod checking;
pub mod cli;
pub mod compare;
pub mod histogram;
pub mod interrupt;
pub mod machine;
pub mod mesh;
pub mod output;
pub mod progress;
pub mod run;
pub mod settings;
pub mod source;
pub mod surfaces;
pub mod truth;
pub mod verbs;
pub mod view_spec;

use isobar_core::Method;

/// Every method, in the order shown: THE one list. A new method is a crate and a line here.
#[must_use]
pub fn methods() -> Vec<&'static dyn Method> {
    vec![
        &isobar_baseline::MARCH_CPU,
        #[cfg(feature = "gpu")]
        &isobar_baseline::MARCH_GPU,
        &isobar_baseline::MC_CPU,
        &isobar_octree::OCTREE_CPU,
        &isobar_octree::OCTREE_CPU_PAPER,
        #[cfg(feature = "gpu")]
        &isobar_octree::OCTREE_GPU,
        &isobar_tetspline::TETSPLINE_CPU,
        #[cfg(feature = "gpu")]
        &isobar_tetspline::TETSPLINE_GPU,
        &isobar_cellproj::CELLPROJ_CPU,
        &isobar_cellproj::CELLPROJ_CPU_PAPER,
        #[cfg(feature = "gpu")]
        &isobar_cellproj::CELLPROJ_GPU,
        &isobar_nurbs::NURBS_CPU,
        &isobar_nurbs::NURBS_CPU_PAPER,
        &isobar_peaks::PEAKS_CPU,
        &isobar_peaks::PEAKS_CPU_PAPER,
        #[cfg(feature = "gpu")]
        &isobar_peaks::PEAKS_GPU,
    ]
}

/// The method of this id.
///
/// # Errors
/// When there is none; the text lists those there are.
pub fn method(id: &str) -> anyhow::Result<&'static dyn Method> {
    let all = methods();
    all.iter().copied().find(|m| m.info().id == id).ok_or_else(|| {
        let ids: Vec<_> = all.iter().map(|m| m.info().id).collect();
        anyhow::anyhow!(
            "--method {id}: no such method in this build; use one of {} (isobar methods)",
            ids.join(", ")
        )
    })
}
