//! The project's commands: `cargo xtask test`, `cargo xtask report`, `cargo xtask check`, `cargo xtask data`.
//!
//! This crate stays quick to compile: it starts cargo and the crate `isobar-report`, and counts what tests say.

mod adapter;
mod check;
mod report;
mod run;
mod test;
mod tests_seen;

use anyhow::{Result, bail};
use std::process::ExitCode;

const HELP: &str = "\
The project's commands.

cargo xtask test [--full] [--no-install]
    Formatting, lints, all tests, doc tests, documentation and the feature check. Ends with one line `N passed, N failed, N skipped`.
    --full         longer forms of some tests (ISOBAR_FULL=1: a million rays per hard element of isobar-nurbs), and every fuzz
                   target for ten minutes (cargo-fuzz and a nightly toolchain are needed)
    --no-install   never installs the software Vulkan driver; the command to type is printed instead

cargo xtask report [--full] [--record] [--only NAME[,NAME]] [--no-bench] [--no-install]
    Measures every definition of bench-data/definitions and writes reports/index.html. An interrupted run resumes.
    --full         larger images, the orbit, the data under ISOBAR_DATA, all of cargo bench
    --record       also copies tables, machine.txt, the page and small pictures to reports/recorded/<date>-<machine>
    --only         only the definitions named
    --no-bench     leaves the pass of criterion benches out
    --no-install   as above

cargo xtask check [--size WxH] [--only METHOD]
    `isobar check --strict` of every method that claims, on three synthetic fields and every file and isovalue of MANIFEST.tsv in ISOBAR_DATA
    (default ../shared/data); writes the table reports/checked.md. Fails where a pixel is missed, false or wrong, or a claim refuted.

cargo xtask data [--no-generate]
    Lists the data of bench-data, verifies their sha256 and generates the cached seeded data under bench-data/cache.
";

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match dispatch(&args) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(e) => {
            eprintln!("xtask: {e:#}");
            ExitCode::from(2)
        }
    }
}

/// Runs the command; `false` is an answer (something failed), an error is unusable input.
fn dispatch(args: &[String]) -> Result<bool> {
    let Some((verb, rest)) = args.split_first() else {
        print!("{HELP}");
        return Ok(true);
    };
    if rest.iter().chain([verb]).any(|a| a == "--help" || a == "-h") {
        print!("{HELP}");
        return Ok(true);
    }
    match verb.as_str() {
        "test" => {
            let flags = flags(rest, &["--full", "--no-install"])?;
            test::test(flags[0], flags[1])
        }
        "report" => report::report(rest),
        "check" => check::check(rest),
        "data" => report::data(rest),
        other => bail!("there is no command {other}; the commands are test, report, check and data (cargo xtask --help)"),
    }
}

/// Which of the `known` flags are given.
fn flags(args: &[String], known: &[&str]) -> Result<Vec<bool>> {
    if let Some(a) = args.iter().find(|a| !known.contains(&a.as_str())) {
        bail!("there is no flag {a}; this command has {}", known.join(", "));
    }
    Ok(known.iter().map(|k| args.iter().any(|a| a == k)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_flags_are_refused_by_name() {
        let args = ["--full".to_owned(), "--ful".to_owned()];
        assert_eq!(flags(&args[..1], &["--full", "--no-install"]).unwrap(), [true, false]);
        let e = flags(&args, &["--full", "--no-install"]).unwrap_err().to_string();
        assert!(e.contains("--ful;") && e.contains("--no-install"), "{e}");
        assert!(dispatch(&["tset".into()]).is_err());
    }
}
