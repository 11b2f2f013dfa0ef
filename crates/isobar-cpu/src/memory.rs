//! Memory that can still be had: what is built is asked for before, so that too large a scene is a refusal and not the end of the process.

use isobar_core::RenderError;
use std::fs::read_to_string;

/// Memory that could still be had, bytes: the least of what the system reports as available and what is left of the process group's
/// limit; `None` where the system does not say (it needs `/proc`).
#[must_use]
pub fn available_bytes() -> Option<u64> {
    let number = |path: &str| read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let group =
        number("/sys/fs/cgroup/memory.max").and_then(|max| Some(max.saturating_sub(number("/sys/fs/cgroup/memory.current")?)));
    match (system_bytes(), group) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    }
}

fn system_bytes() -> Option<u64> {
    let text = read_to_string("/proc/meminfo").ok()?;
    let rest = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    rest.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// Whether `bytes` more can be had for `what`; yes where the system does not say. Takes some 20 us: for large pieces only.
///
/// # Errors
/// [`RenderError::Memory`] where they cannot.
pub fn require_memory(what: impl FnOnce() -> String, bytes: u64) -> Result<(), RenderError> {
    match available_bytes() {
        Some(limit) if bytes > limit => Err(RenderError::Memory {
            what: what(),
            bytes,
            limit,
        }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_had_is_refused() {
        let what = || "the universe".to_owned();
        assert_eq!(require_memory(what, 0), Ok(()));
        if cfg!(target_os = "linux") {
            let there = available_bytes().unwrap();
            assert!(there > 1 << 20);
            let refused = require_memory(what, u64::MAX).unwrap_err();
            assert!(
                refused
                    .to_string()
                    .starts_with("the universe needs 18446744073709551615 bytes")
            );
        }
    }
}
