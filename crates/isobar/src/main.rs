//! The program isobar; everything it does is in the library of the same name.

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

fn main() -> ExitCode {
    static SAID: AtomicBool = AtomicBool::new(false);
    std::panic::set_hook(Box::new(|info| {
        if !SAID.swap(true, Ordering::Relaxed) {
            let line = info.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
            eprintln!("isobar: internal error, please report it with the command that led here: {line}");
        }
    }));
    isobar::interrupt::listen();
    ExitCode::from(isobar::cli::run(std::env::args_os().collect()))
}
