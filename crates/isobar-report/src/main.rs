//! `isobar-report`: does the work of `cargo xtask report` and `cargo xtask data`.

use anyhow::{Context, Result};
use clap::{Parser, Subcommand};
use isobar_report::{counts, data, definitions, measure::peak, report};
use std::path::{Path, PathBuf};
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
    /// Print the certified hits of every pixel, at both sizes: what `expect` in a definition holds
    Counts {
        /// Only these definitions, parted by commas
        #[arg(long, value_delimiter = ',')]
        only: Vec<String>,
    },
    /// Draw a definition by one method and print the memory this process needed
    #[command(hide = true)]
    Peak {
        /// The definition
        definition: String,
        /// The method
        method: String,
        /// The reconstruction
        reconstruction: String,
        /// The size of `report --full`
        #[arg(long)]
        full: bool,
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
            let target = target(&root);
            let done = report::run(&report::Options {
                root: root.clone(),
                target,
                full,
                record,
                only,
                criterion,
                criterion_since: SystemTime::UNIX_EPOCH + Duration::from_secs(criterion_since),
                command: command.trim().to_owned(),
            })?;
            println!("{}", done.page.strip_prefix(&root).unwrap_or(&done.page).display());
            for line in &done.trouble {
                eprintln!("not as said: {line}");
            }
            if !done.trouble.is_empty() {
                let n = done.trouble.len();
                eprintln!(
                    "isobar-report: the page is complete, and {n} results in it are not what the definitions and cases say"
                );
            }
            Ok(done.trouble.is_empty())
        }
        Verb::Counts { only } => {
            let target = target(&root);
            counts::print(&root, &isobar_report::measure::truth_folder(&target), &only)?;
            Ok(true)
        }
        Verb::Peak {
            definition,
            method,
            reconstruction,
            full,
        } => {
            let all = definitions::read_all(&root.join("bench-data/definitions"))?;
            let found = all.iter().find(|d| d.id == definition);
            let d = found.with_context(|| format!("there is no definition {definition}"))?;
            let memory = peak::here(d, &root, &method, &reconstruction, full)?;
            println!("{}", serde_json::to_string(&memory)?);
            Ok(true)
        }
        Verb::Data { no_generate } => data::list(&root.join("bench-data"), !no_generate),
    }
}

/// Cargo's target folder.
fn target(root: &Path) -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), |t| root.join(t))
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
