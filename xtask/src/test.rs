//! `cargo xtask test`: every check of the project, counted.

use crate::adapter::{self, Adapter};
use crate::run::{cargo, has_cargo, lines, root, shown};
use crate::tests_seen::{Counts, Reader};
use anyhow::Result;
use std::process::{Command, Stdio};
use std::time::Instant;

/// Seconds each fuzz target runs under `--full`.
const FUZZ_SECONDS: u32 = 600;

/// A step of the run and what it counted.
struct Step {
    name: String,
    counts: Counts,
    seconds: f64,
    note: String,
}

/// All steps so far.
struct Run {
    steps: Vec<Step>,
    adapter: Adapter,
}

/// Runs everything; `true` where nothing failed. The last line printed is `N passed, N failed, N skipped`.
pub(crate) fn test(full: bool, no_install: bool) -> Result<bool> {
    let mut adapter = adapter::ensure(no_install);
    println!("{}", adapter.said);
    if ci() {
        // A GPU test that finds no adapter fails instead of saying SKIPPED.
        adapter.env.push(("ISOBAR_REQUIRE_GPU", "1".into()));
    }
    if full {
        // Tests with a longer form: as many random rays as their README says.
        adapter.env.push(("ISOBAR_FULL", "1".into()));
    }
    let mut run = Run {
        steps: Vec::new(),
        adapter,
    };
    if !run.adapter.found {
        // Tests that need an adapter say SKIPPED themselves; in CI the missing adapter is a failure of its own.
        run.push("adapter", absent(), Instant::now(), "no Vulkan driver");
    }
    run.check(
        "formatting",
        "rustfmt",
        &["fmt", "--version"],
        cargo(&["fmt", "--all", "--check"]),
    )?;
    let clippy = cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"]);
    run.check("lints", "clippy", &["clippy", "--version"], clippy)?;
    if has_cargo(&["nextest", "--version"]) {
        run.tests(
            "tests",
            cargo(&[
                "nextest",
                "run",
                "--workspace",
                "--no-fail-fast",
                // Not the examples, which lints have looked at.
                "--lib",
                "--bins",
                "--tests",
                "--success-output",
                "immediate",
            ]),
        )?;
    } else {
        let kinds = [
            "test",
            "--workspace",
            "--no-fail-fast",
            "--lib",
            "--bins",
            "--tests",
            "--",
            "--show-output",
        ];
        run.tests("tests", cargo(&kinds))?;
    }
    run.tests("doc tests", cargo(&["test", "--workspace", "--no-fail-fast", "--doc"]))?;
    let mut doc = cargo(&["doc", "--workspace", "--no-deps"]);
    doc.env("RUSTDOCFLAGS", "-D warnings");
    run.check("documentation", "rustdoc", &["--version"], doc)?;
    run.check(
        "without the GPU",
        "cargo",
        &["--version"],
        cargo(&["check", "-p", "isobar", "--no-default-features", "--all-targets"]),
    )?;
    if full {
        run.fuzz()?;
    }
    Ok(run.finish())
}

impl Run {
    fn push(&mut self, name: &str, counts: Counts, start: Instant, note: &str) {
        self.steps.push(Step {
            name: name.to_owned(),
            counts,
            seconds: start.elapsed().as_secs_f64(),
            note: note.to_owned(),
        });
    }

    /// A step that counts as one check; skipped where its tool is not installed (`probe`), which in CI is a failure.
    fn check(&mut self, name: &str, tool: &str, probe: &[&str], mut c: Command) -> Result<()> {
        println!("\n== {name}: {}", shown(&c));
        if !has_cargo(probe) {
            self.push(name, absent(), Instant::now(), &format!("{tool} is not installed"));
            return Ok(());
        }
        let start = Instant::now();
        let ok = c.envs(self.adapter.env.iter().map(|(k, v)| (k, v))).status()?.success();
        self.push(name, Counts::one(ok), start, "");
        Ok(())
    }

    /// A step whose tests are counted.
    fn tests(&mut self, name: &str, mut c: Command) -> Result<()> {
        println!("\n== {name}: {}", shown(&c));
        let start = Instant::now();
        c.envs(self.adapter.env.iter().map(|(k, v)| (k, v)));
        let mut reader = Reader::default();
        let ok = lines(c, &mut |line| {
            if reader.line(line) {
                println!("{line}");
            }
        })?;
        let mut counts = reader.counts();
        let mut note = "";
        if !ok && counts.failed == 0 {
            // It did not build, or the runner itself failed.
            counts.failed = 1;
            note = "the runner failed: see above";
        }
        self.push(name, counts, start, note);
        Ok(())
    }

    /// Every target of every `crates/*/fuzz`.
    fn fuzz(&mut self) -> Result<()> {
        if !rustup_cargo(&["fuzz", "--version"])
            .output()
            .is_ok_and(|o| o.status.success())
        {
            self.push(
                "fuzzing",
                Counts::SKIPPED,
                Instant::now(),
                "cargo-fuzz and a nightly toolchain are needed: cargo install cargo-fuzz",
            );
            return Ok(());
        }
        let mut crates: Vec<_> = std::fs::read_dir(root().join("crates"))?
            .flatten()
            .map(|e| e.path())
            .collect();
        crates.sort();
        for folder in crates.iter().filter(|f| f.join("fuzz/Cargo.toml").is_file()) {
            let list = rustup_cargo(&["fuzz", "list"]).current_dir(folder).output()?;
            for target in String::from_utf8_lossy(&list.stdout).split_whitespace() {
                let name = format!("fuzz {target}");
                let mut c = rustup_cargo(&["fuzz", "run", target, "--", &format!("-max_total_time={FUZZ_SECONDS}")]);
                println!("\n== {name}: {}", shown(&c));
                let start = Instant::now();
                let ok = c.current_dir(folder).status()?.success();
                self.push(&name, Counts::one(ok), start, "");
            }
        }
        Ok(())
    }

    /// Prints the table and the last line.
    fn finish(&self) -> bool {
        let mut all = Counts::default();
        println!(
            "\n{:<18} {:>7} {:>7} {:>8} {:>9}",
            "step", "passed", "failed", "skipped", "seconds"
        );
        for s in &self.steps {
            all.add(s.counts);
            let c = s.counts;
            println!(
                "{:<18} {:>7} {:>7} {:>8} {:>9.1}  {}",
                s.name, c.passed, c.failed, c.skipped, s.seconds, s.note
            );
        }
        println!("\n{} passed, {} failed, {} skipped", all.passed, all.failed, all.skipped);
        all.failed == 0
    }
}

fn ci() -> bool {
    std::env::var("CI").is_ok_and(|v| v == "true" || v == "1")
}

/// What a missing tool or driver counts as: skipped, but in CI failed.
fn absent() -> Counts {
    if ci() { Counts::one(false) } else { Counts::SKIPPED }
}

/// `cargo +nightly ARGS` through rustup: the cargo that runs xtask is a toolchain's own and knows no `+nightly`.
fn rustup_cargo(args: &[&str]) -> Command {
    let mut c = Command::new("rustup");
    c.args(["run", "nightly", "cargo"]).args(args);
    for variable in [
        "RUSTUP_TOOLCHAIN",
        "CARGO",
        "RUSTC",
        "CARGO_MANIFEST_DIR",
        "CARGO_MANIFEST_PATH",
    ] {
        c.env_remove(variable);
    }
    c.current_dir(root()).stdin(Stdio::null());
    c
}
