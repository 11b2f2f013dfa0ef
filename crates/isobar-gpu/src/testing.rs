//! For tests of GPU code: an adapter, or a visible skip.

use crate::Gpu;
use std::io::Write as _;

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
