//! What the operating system says: processor time, peak memory, the name of the processor.

use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;
use std::fs::read_to_string;
use std::time::Duration;

/// Processor time this process has used so far, summed over its threads.
#[must_use]
pub fn cpu_time() -> Duration {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(t.tv_sec.try_into().unwrap_or(0), t.tv_nsec.try_into().unwrap_or(0))
}

/// Greatest resident memory of this process so far, bytes; `None` where the system does not say (it needs `/proc`).
#[must_use]
pub fn peak_bytes() -> Option<u64> {
    kibibytes("/proc/self/status", "VmHWM:")
}

fn kibibytes(path: &str, key: &str) -> Option<u64> {
    let text = read_to_string(path).ok()?;
    let rest = text.lines().find_map(|l| l.strip_prefix(key))?;
    Some(rest.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

/// The device a method ran on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Device {
    /// Its name.
    pub name: String,
    /// Driver and its version; empty for a processor.
    pub driver: String,
}

/// The processor, and how many threads it runs.
#[must_use]
pub fn processor() -> Device {
    let model = read_to_string("/proc/cpuinfo").ok().and_then(|t| {
        let line = t.lines().find(|l| l.starts_with("model name"))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    });
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    Device {
        name: format!(
            "{} ({threads} threads)",
            model.unwrap_or_else(|| std::env::consts::ARCH.to_owned())
        ),
        driver: String::new(),
    }
}

/// The adapter GPU methods use; its name says so where there is none.
#[cfg(feature = "gpu")]
#[must_use]
pub fn gpu() -> Device {
    match isobar_gpu::Gpu::shared() {
        Ok(g) => {
            let r = g.report();
            Device {
                name: r.name.clone(),
                driver: format!("{} {}", r.backend, r.driver),
            }
        }
        Err(e) => Device {
            name: format!("no adapter: {e}"),
            driver: String::new(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::hint::black_box;

    #[test]
    fn time_and_memory_are_told() {
        let before = cpu_time();
        let mut x = 1u64;
        while cpu_time() - before < Duration::from_millis(5) {
            x = black_box(x.wrapping_mul(6_364_136_223_846_793_005));
        }
        assert!(cpu_time() > before);
        if cfg!(target_os = "linux") {
            let block = black_box(vec![1u8; 8 << 20]);
            assert!(peak_bytes().unwrap() > block.len() as u64);
        }
    }
}
