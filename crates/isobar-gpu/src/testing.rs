//! For tests of GPU code: an adapter, or a visible skip; structures shared with WGSL.

use crate::Gpu;
use std::io::Write as _;
use std::sync::{Mutex, MutexGuard, PoisonError};
use wgpu::naga;

/// The shared device for the test `name`, or `None` after a line `SKIPPED: name: no adapter` on standard error (not captured by the test
/// runner). Where a GPU is promised (environment `CI=true` or `ISOBAR_REQUIRE_GPU=1`) a missing adapter fails the test instead.
///
/// # Panics
/// When there is no adapter and one is required.
#[must_use]
pub fn test_adapter(name: &str) -> Option<Gpu> {
    let is = |variable: &str, value: &str| std::env::var(variable).is_ok_and(|v| v.trim() == value);
    match Gpu::shared() {
        Ok(gpu) => Some(gpu),
        Err(e) if is("CI", "true") || is("ISOBAR_REQUIRE_GPU", "1") => panic!("{name}: a GPU is required here: {e}"),
        Err(_) => {
            // Written, not printed: the test runner captures what print macros write, and a skip must be seen.
            let _ = writeln!(std::io::stderr(), "SKIPPED: {name}: no adapter");
            None
        }
    }
}

/// As [`test_adapter`], for one test of the process at a time: a test that waits for the device also runs what another one waits for.
///
/// # Panics
/// As [`test_adapter`].
#[must_use]
pub fn adapter_alone(name: &str) -> Option<(Gpu, MutexGuard<'static, ()>)> {
    static ONE: Mutex<()> = Mutex::new(());
    let guard = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    test_adapter(name).map(|gpu| (gpu, guard))
}

/// Size of a structure of a module, and the names and offsets of its members, in bytes, as naga lays it out.
///
/// # Panics
/// When the source is no WGSL or holds no such structure.
#[must_use]
pub fn laid_out(source: &str, name: &str) -> (usize, Vec<(String, usize)>) {
    let module = naga::front::wgsl::parse_str(source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(source)));
    let found = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name));
    match found.map(|(_, t)| &t.inner) {
        Some(naga::TypeInner::Struct { members, span }) => {
            let member = |m: &naga::StructMember| (m.name.clone().unwrap_or_default(), m.offset as usize);
            (*span as usize, members.iter().map(member).collect())
        }
        other => panic!("{name} is {other:?}"),
    }
}

/// Checks that a structure has the size, and the members named have the offsets, of that of the same name in a module: `assert_laid_out!(source, Ray { origin, normal as "normal_x" })`.
#[macro_export]
macro_rules! assert_laid_out {
    ($source:expr, $t:ident { $($rust:ident $(as $wgsl:literal)?),* $(,)? }) => {{
        let (span, members) = $crate::testing::laid_out($source, stringify!($t));
        assert_eq!(span, size_of::<$t>(), stringify!($t));
        $(
            let name = [$($wgsl,)? stringify!($rust)][0];
            let at = members.iter().find(|(n, _)| n == name).map(|(_, at)| *at);
            assert_eq!(at, Some(std::mem::offset_of!($t, $rust)), "{}.{name}", stringify!($t));
        )*
    }};
}

/// Checks that a snippet declares these bits: `const NAME: u32 = BITu;`.
///
/// # Panics
/// When it does not.
pub fn assert_bits(snippet: &str, bits: &[(&str, u32)]) {
    for (name, bit) in bits {
        assert!(snippet.contains(&format!("const {name}: u32 = {bit}u;")), "{name}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    /// Runs the test below in a process of its own that asks for an adapter which is not there.
    fn without_adapter(variables: &[(&str, &str)]) -> (bool, String) {
        let out = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "testing::tests::an_adapter_is_found_or_the_test_is_skipped"])
            .env_remove("CI")
            .env_remove("ISOBAR_REQUIRE_GPU")
            .env("ISOBAR_ADAPTER", "no such card")
            .envs(variables.iter().copied())
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&[out.stdout, out.stderr].concat()).into_owned();
        (out.status.success(), text)
    }

    #[test]
    fn an_adapter_is_found_or_the_test_is_skipped() {
        if let Some(gpu) = test_adapter("an_adapter_is_found_or_the_test_is_skipped") {
            assert!(!gpu.report().name.is_empty());
        }
    }

    #[test]
    fn a_skip_is_seen_and_fails_where_a_gpu_is_promised() {
        let (passed, text) = without_adapter(&[]);
        let line = "SKIPPED: an_adapter_is_found_or_the_test_is_skipped: no adapter";
        assert!(passed && text.lines().any(|l| l.contains(line)), "{text}");
        for promise in [("CI", "true"), ("ISOBAR_REQUIRE_GPU", "1")] {
            let (passed, text) = without_adapter(&[promise]);
            assert!(!passed && text.contains("a GPU is required here"), "{text}");
        }
        // Without any Vulkan driver.
        let (passed, text) = without_adapter(&[("VK_DRIVER_FILES", "/nonexistent.json"), ("ISOBAR_ADAPTER", "")]);
        assert!(passed && text.contains(line), "{text}");
    }
}
