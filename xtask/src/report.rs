//! `cargo xtask report` and `cargo xtask data`: start the crate isobar-report, after the benches it reads.

use crate::adapter;
use crate::run::{cargo, lines, root, target};
use anyhow::{Result, bail};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Seconds the plain report gives to criterion.
const BENCH_SECONDS: u64 = 60;

/// The crates whose benches the plain report runs, and criterion's settings for it.
const SHORT_BENCHES: [&str; 1] = ["isobar-poly"];
const SHORT_SETTINGS: [&str; 6] = ["--warm-up-time", "0.2", "--measurement-time", "0.6", "--sample-size", "12"];

/// Builds, runs the benches, measures and writes the page.
pub(crate) fn report(args: &[String]) -> Result<bool> {
    let known = ["--full", "--record", "--no-bench", "--no-install", "--only"];
    let mut rest = Vec::new();
    let mut i = args.iter();
    while let Some(a) = i.next() {
        match a.as_str() {
            "--only" => {
                let Some(names) = i.next() else {
                    bail!("--only needs the names of definitions")
                };
                rest.extend([a.as_str(), names.as_str()]);
            }
            "--no-install" | "--no-bench" => {}
            "--full" | "--record" => rest.push(a),
            other => bail!("there is no flag {other}; this command has {}", known.join(", ")),
        }
    }
    let has = |f: &str| args.iter().any(|a| a == f);
    let adapter = adapter::ensure(has("--no-install"));
    println!("{}", adapter.said);
    let with = |mut c: Command| -> Command {
        c.envs(adapter.env.iter().map(|(k, v)| (k, v)));
        c
    };
    // The build first: nothing is measured while the compiler runs.
    if !with(cargo(&["build", "--release", "-p", "isobar-report"]))
        .status()?
        .success()
    {
        bail!("isobar-report did not build; the compiler's reason is above");
    }
    let benched = !has("--no-bench");
    let began = SystemTime::now();
    if benched && !benches(has("--full"), &with)? {
        eprintln!("xtask: the criterion pass did not finish; the page shows what it left");
    }
    let mut c = with(cargo(&["run", "--release", "--quiet", "-p", "isobar-report", "--", "report"]));
    c.args(&rest)
        .args(["--command", &("cargo xtask report ".to_owned() + &args.join(" "))]);
    if benched {
        // Estimates of earlier runs may lie there too.
        let since = began.duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
        c.arg("--criterion")
            .arg(target().join("criterion"))
            .args(["--criterion-since", &since.to_string()]);
    }
    Ok(c.status()?.success())
}

/// The criterion pass: short for the plain report, everything with `--full`. `false` where it failed or was cut short.
fn benches(full: bool, with: &dyn Fn(Command) -> Command) -> Result<bool> {
    if full {
        return Ok(with(cargo(&["bench", "--workspace"])).status()?.success());
    }
    let mut build = cargo(&["bench", "--no-run", "--message-format", "json-render-diagnostics"]);
    for p in SHORT_BENCHES {
        build.args(["-p", p]);
    }
    let mut programs = Vec::new();
    let built = lines(with(build), &mut |line| match executable(line) {
        Some(path) => programs.push(path),
        None if !line.starts_with('{') => eprintln!("{line}"),
        None => {}
    })?;
    let start = Instant::now();
    let mut whole = built && !programs.is_empty();
    for program in programs {
        // The program itself, not cargo, so that the time limit ends the right process.
        let mut c = Command::new(&program);
        c.arg("--bench")
            .args(SHORT_SETTINGS)
            .current_dir(root())
            .stdin(Stdio::null())
            .stdout(Stdio::null());
        c.env("CRITERION_HOME", target().join("criterion"));
        println!("benches: {}", program.display());
        whole &= ends_by(&mut with(c).spawn()?, start + Duration::from_secs(BENCH_SECONDS))?;
    }
    Ok(whole)
}

/// Waits for a child; kills it at the deadline. Whether it ended by itself and well.
fn ends_by(child: &mut Child, deadline: Instant) -> Result<bool> {
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status.success());
        }
        if Instant::now() > deadline {
            child.kill()?;
            child.wait()?;
            return Ok(false);
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// The program that a line of cargo's JSON messages says was built.
fn executable(line: &str) -> Option<PathBuf> {
    let (_, rest) = line.split_once("\"executable\":\"")?;
    let (path, _) = rest.split_once('"')?;
    Some(PathBuf::from(path.replace("\\\\", "\\")))
}

/// Lists, verifies and generates data.
pub(crate) fn data(args: &[String]) -> Result<bool> {
    crate::flags(args, &["--no-generate"])?;
    let mut c = cargo(&["run", "--release", "--quiet", "-p", "isobar-report", "--", "data"]);
    Ok(c.args(args).status()?.success())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn executables_are_read_from_cargos_messages() {
        let line =
            r#"{"reason":"compiler-artifact","filenames":["/t/x.d"],"executable":"/t/release/deps/solve-0a","fresh":true}"#;
        assert_eq!(executable(line), Some(PathBuf::from("/t/release/deps/solve-0a")));
        assert_eq!(executable(r#"{"reason":"compiler-artifact","executable":null}"#), None);
    }

    #[test]
    #[cfg(unix)]
    fn a_bench_that_runs_too_long_is_ended() {
        let start = Instant::now();
        let mut child = Command::new("sleep").arg("20").spawn().unwrap();
        assert!(!ends_by(&mut child, start + Duration::from_millis(200)).unwrap());
        assert!(start.elapsed() < Duration::from_secs(10));
        assert!(ends_by(&mut Command::new("true").spawn().unwrap(), start + Duration::from_secs(20)).unwrap());
    }
}
