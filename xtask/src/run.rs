//! Starting cargo and other programs.

use anyhow::{Context, Result};
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::mpsc;

/// The folder of the workspace.
pub(crate) fn root() -> PathBuf {
    let here = std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    here.parent().map_or_else(|| here.clone(), PathBuf::from)
}

/// The target folder of cargo.
pub(crate) fn target() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), |t| root().join(t))
}

/// `cargo ARGS` in the workspace, without standard input.
pub(crate) fn cargo(args: &[&str]) -> Command {
    let mut c = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo")));
    c.args(args).current_dir(root()).stdin(Stdio::null());
    // What cargo told this program about itself is not for the crates built next.
    for (name, _) in std::env::vars_os() {
        if name
            .to_str()
            .is_some_and(|n| n.starts_with("CARGO_PKG_") || n == "CARGO_MANIFEST_DIR" || n == "CARGO_MANIFEST_PATH")
        {
            c.env_remove(name);
        }
    }
    c
}

/// Whether `cargo NAME` exists, by its `--version`.
pub(crate) fn has_cargo(args: &[&str]) -> bool {
    let quiet = cargo(args).stdout(Stdio::null()).stderr(Stdio::null()).status();
    quiet.is_ok_and(|s| s.success())
}

/// The command as a person would type it.
pub(crate) fn shown(c: &Command) -> String {
    let name = PathBuf::from(c.get_program());
    let name = name.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    c.get_args().fold(name, |s, a| s + " " + &a.to_string_lossy())
}

/// Runs `c`, hands every line of its standard output and error to `line`, and says whether it succeeded.
pub(crate) fn lines(mut c: Command, line: &mut dyn FnMut(&str)) -> Result<bool> {
    c.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = c.spawn().with_context(|| format!("{} could not be started", shown(&c)))?;
    let (send, receive) = mpsc::channel();
    let pipes: [Option<Box<dyn std::io::Read + Send>>; 2] = [
        child.stdout.take().map(|p| Box::new(p) as Box<dyn std::io::Read + Send>),
        child.stderr.take().map(|p| Box::new(p) as Box<dyn std::io::Read + Send>),
    ];
    for pipe in pipes.into_iter().flatten() {
        let send = send.clone();
        std::thread::spawn(move || {
            let mut pipe = BufReader::new(pipe);
            let mut bytes = Vec::new();
            // Test output need not be UTF-8.
            while pipe.read_until(b'\n', &mut bytes).is_ok_and(|n| n > 0) {
                let text = String::from_utf8_lossy(&bytes).trim_end_matches(['\n', '\r']).to_owned();
                if send.send(text).is_err() {
                    return;
                }
                bytes.clear();
            }
        });
    }
    drop(send);
    for text in receive {
        line(&text);
    }
    Ok(child.wait()?.success())
}
