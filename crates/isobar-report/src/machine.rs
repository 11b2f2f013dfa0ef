//! What the numbers were measured on: the lines of machine.txt.

use std::path::Path;
use std::process::{Command, Stdio};

/// Names and values, in the order of machine.txt.
#[must_use]
pub fn describe(root: &Path) -> Vec<(String, String)> {
    let mut out = vec![
        ("processor".to_owned(), isobar::machine::processor().name),
        ("instruction sets".into(), features()),
        ("memory".into(), memory()),
        ("governor".into(), governor()),
        ("system".into(), system()),
        ("graphics".into(), graphics()),
        ("compiler".into(), said("rustc", &["--version"], root)),
        ("build".into(), build().into()),
    ];
    out.retain(|(_, v)| !v.is_empty());
    out
}

/// Revision of the sources, with `+` where they were changed since; empty where git cannot say.
#[must_use]
pub fn revision(root: &Path) -> String {
    let head = said("git", &["rev-parse", "--short=12", "HEAD"], root);
    if head.is_empty() {
        return "unknown".into();
    }
    let changed = !said("git", &["status", "--porcelain", "--untracked-files=no"], root).is_empty();
    head + if changed { "+ (with changes)" } else { "" }
}

/// First line of a program's standard output; empty where it cannot be run.
fn said(program: &str, args: &[&str], folder: &Path) -> String {
    let out = Command::new(program)
        .args(args)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output();
    out.ok()
        .filter(|o| o.status.success())
        .and_then(|o| String::from_utf8_lossy(&o.stdout).lines().next().map(|l| l.trim().to_owned()))
        .unwrap_or_default()
}

#[cfg(target_arch = "x86_64")]
fn features() -> String {
    let mut out = vec!["sse2"];
    let mut add = |name, has: bool| {
        if has {
            out.push(name);
        }
    };
    add("avx2", std::arch::is_x86_feature_detected!("avx2"));
    add("fma", std::arch::is_x86_feature_detected!("fma"));
    add("avx512f", std::arch::is_x86_feature_detected!("avx512f"));
    add("avx512dq", std::arch::is_x86_feature_detected!("avx512dq"));
    add("avx512vl", std::arch::is_x86_feature_detected!("avx512vl"));
    out.join(" ")
}

#[cfg(not(target_arch = "x86_64"))]
fn features() -> String {
    std::env::consts::ARCH.to_owned()
}

fn field(path: &str, key: &str, separator: char) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    let line = text.lines().find(|l| l.starts_with(key))?;
    Some(line.split_once(separator)?.1.trim().trim_matches('"').to_owned())
}

fn memory() -> String {
    let kib = field("/proc/meminfo", "MemTotal", ':').and_then(|v| v.split(' ').next()?.parse::<f64>().ok());
    kib.map_or_else(String::new, |k| format!("{:.1} GiB", k / 1024.0 / 1024.0))
}

fn governor() -> String {
    let path = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor";
    std::fs::read_to_string(path).map_or_else(|_| String::new(), |t| t.trim().to_owned())
}

fn system() -> String {
    let name = field("/etc/os-release", "PRETTY_NAME", '=').unwrap_or_else(|| std::env::consts::OS.to_owned());
    let kernel = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    format!("{name}, kernel {}", kernel.trim())
        .trim_end_matches(", kernel ")
        .to_owned()
}

/// The adapter that GPU methods draw with.
#[cfg(feature = "gpu")]
fn graphics() -> String {
    match isobar_gpu::Gpu::shared() {
        Ok(g) => g.report().to_string(),
        Err(e) => format!("no adapter: {e}"),
    }
}

#[cfg(not(feature = "gpu"))]
fn graphics() -> String {
    "built without GPU methods".into()
}

const fn build() -> &'static str {
    if cfg!(debug_assertions) {
        "with debug assertions: times mean nothing"
    } else {
        "release"
    }
}

/// The name of this machine for folders: letters, digits and dashes of its processor.
#[must_use]
pub fn short_name(machine: &[(String, String)]) -> String {
    let cpu = machine
        .iter()
        .find(|(k, _)| k == "processor")
        .map_or("unknown", |(_, v)| v.as_str());
    let mut out = String::new();
    for c in cpu.chars() {
        let c = if c.is_ascii_alphanumeric() {
            c.to_ascii_lowercase()
        } else {
            '-'
        };
        if c != '-' || !out.ends_with('-') {
            out.push(c);
        }
    }
    out.trim_matches('-')
        .chars()
        .take(48)
        .collect::<String>()
        .trim_end_matches('-')
        .to_owned()
}

/// Now, UTC: `YYYY-MM-DD hh:mm`.
#[must_use]
pub fn now() -> String {
    let seconds = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .map_or(0, |d| d.as_secs());
    civil(seconds)
}

/// Days to a date of the Gregorian calendar, by eras of 400 years counted from March.
fn civil(seconds: u64) -> String {
    let days = (seconds / 86_400) as i64 + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    let time = seconds % 86_400;
    format!("{year:04}-{month:02}-{day:02} {:02}:{:02}", time / 3600, time / 60 % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_gregorian() {
        assert_eq!(civil(0), "1970-01-01 00:00");
        assert_eq!(civil(951_782_400), "2000-02-29 00:00");
        assert_eq!(civil(1_767_225_599), "2025-12-31 23:59");
    }

    #[test]
    fn folder_names_are_plain() {
        let m = vec![("processor".to_owned(), "AMD EPYC 9R14, (2 threads)".to_owned())];
        assert_eq!(short_name(&m), "amd-epyc-9r14-2-threads");
        assert!(
            describe(Path::new("."))
                .iter()
                .any(|(k, v)| k == "processor" && !v.is_empty())
        );
    }
}
