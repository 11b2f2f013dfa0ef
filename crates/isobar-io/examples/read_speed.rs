//! Reads a volume again and again and prints the time of each read and the greatest memory of the process:
//! `cargo run --release -p isobar-io --example read_speed -- FILE [REPEATS]`. Compare with `time gzip -dc FILE >/dev/null`.

use isobar_io::{Options, load};
use std::path::PathBuf;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args_os().skip(1);
    let file = PathBuf::from(arguments.next().ok_or("give a file")?);
    let repeats: usize = match arguments.next() {
        Some(n) => n.to_string_lossy().parse()?,
        None => 9,
    };
    let mut times = Vec::new();
    let mut bytes = 0;
    for _ in 0..repeats.max(1) {
        let start = Instant::now();
        let loaded = load(&file, &Options::default())?;
        times.push(start.elapsed().as_secs_f64());
        bytes = loaded.data.bytes();
    }
    times.sort_by(f64::total_cmp);
    let median = times[times.len() / 2];
    println!(
        "{}: {bytes} bytes, median {:.1} ms, {:.0} MB/s",
        file.display(),
        median * 1e3,
        bytes as f64 / median / 1e6
    );
    if let Ok(status) = std::fs::read_to_string("/proc/self/status") {
        let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or("").trim();
        println!("peak {peak}, samples {} kB", bytes / 1024);
    }
    Ok(())
}
