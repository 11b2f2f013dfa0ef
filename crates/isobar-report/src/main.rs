//! `isobar-report`: does the work of `cargo xtask report` and `cargo xtask data`.

use anyhow::Result;
use clap::{Parser, Subcommand};
use isobar_report::{data, report};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, SystemTime};

/// Measures the definitions and writes the report; lists, verifies and generates data.
#[derive(Parser)]
#[command(version, max_term_width = 100)]
struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Measure and write reports/index.html
    Report {
        /// Larger images, the orbit, the data under ISOBAR_DATA
        #[arg(long)]
        full: bool,
        /// Also keep the run under reports/recorded
        #[arg(long)]
        record: bool,
        /// Only these definitions, parted by commas
        #[arg(long, value_delimiter = ',')]
        only: Vec<String>,
        /// Folder of criterion's estimates
        #[arg(long)]
        criterion: Option<PathBuf>,
        /// Seconds since 1970: older estimates belong to another run
        #[arg(long, default_value_t = 0)]
        criterion_since: u64,
        /// The command shown in the page
        #[arg(long, default_value = "isobar-report report")]
        command: String,
    },
    /// List and verify the data; generate the cached ones
    Data {
        /// Only list and verify
        #[arg(long)]
        no_generate: bool,
    },
}

fn main() -> ExitCode {
    match run(Args::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(e) => {
            eprintln!("isobar-report: {e:#}");
            ExitCode::from(2)
        }
    }
}

fn run(args: Args) -> Result<bool> {
    let root = root();
    match args.verb {
        Verb::Report {
            full,
            record,
            only,
            criterion,
            criterion_since,
            command,
        } => {
            let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), |t| root.join(t));
            let page = report::run(&report::Options {
                root: root.clone(),
                target,
                full,
                record,
                only,
                criterion,
                criterion_since: SystemTime::UNIX_EPOCH + Duration::from_secs(criterion_since),
                command: command.trim().to_owned(),
            })?;
            println!("{}", page.strip_prefix(&root).unwrap_or(&page).display());
            Ok(true)
        }
        Verb::Data { no_generate } => data::list(&root.join("bench-data"), !no_generate),
    }
}

/// The folder of the workspace: told by cargo, else the one around the current folder.
fn root() -> PathBuf {
    let here = std::env::var_os("CARGO_MANIFEST_DIR")
        .map(PathBuf::from)
        .or_else(|| std::env::current_dir().ok());
    let here = here.unwrap_or_else(|| PathBuf::from("."));
    let found = here
        .ancestors()
        .find(|a| a.join("bench-data/MANIFEST.toml").is_file())
        .map(PathBuf::from);
    found.unwrap_or(here)
}
