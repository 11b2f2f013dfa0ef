//! Ctrl-C, and the other signals that ask a program to end: a file being written is completed, then the program ends with one line and
//! [`STATUS`], whatever it is doing. Only drawing on a device is waited for, as far as the next stop it hears: the driver's own threads must not run
//! into the end of the process. A second signal ends that too.

use anyhow::{Result, ensure};
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Exit status of an interrupted run, as shells have it: 128 + SIGINT.
pub const STATUS: u8 = 130;

static ASKED: AtomicBool = AtomicBool::new(false);
/// Pieces of work that end by themselves when they are asked to.
static WATCHED: AtomicUsize = AtomicUsize::new(0);
/// Whether the end has been told.
static TOLD: AtomicBool = AtomicBool::new(false);
/// Work that goes on for longer after a signal is told of.
const PATIENCE: Duration = Duration::from_secs(1);
/// Held while files are written: the program does not end then.
static WRITING: Mutex<()> = Mutex::new(());

thread_local! {
    static DEPTH: Cell<u32> = const { Cell::new(0) };
}

/// Listens from now on; once per process. Without it, signals end the program as they always do.
pub fn listen() {
    // Where no handler can be had, the system's own stays: the program still ends.
    let _ = ctrlc::set_handler(|| {
        let again = ASKED.swap(true, Ordering::SeqCst);
        if WATCHED.load(Ordering::SeqCst) > 0 && !again {
            // Where no thread can be had, the line is not said.
            let _ = std::thread::Builder::new().spawn(|| {
                std::thread::sleep(PATIENCE);
                if WATCHED.load(Ordering::SeqCst) > 0 {
                    crate::cli::complain("stopping the device; Ctrl-C again ends at once");
                }
            });
            return;
        }
        let _no_file_is_half_written = WRITING.lock().unwrap_or_else(PoisonError::into_inner);
        tell();
        std::process::exit(i32::from(STATUS));
    });
}

/// Says once that the program ends because it was asked to.
pub fn tell() {
    if !TOLD.swap(true, Ordering::SeqCst) {
        crate::cli::complain("interrupted");
    }
}

/// Whether the program was asked to end.
#[must_use]
pub fn is_asked() -> bool {
    ASKED.load(Ordering::SeqCst)
}

/// Work that asks [`is_asked`] now and then and ends.
#[derive(Debug)]
#[must_use]
pub struct Watched(());

/// Says that the work until the answer is dropped will end by itself when the program is asked to end.
pub fn watched() -> Watched {
    WATCHED.fetch_add(1, Ordering::SeqCst);
    Watched(())
}

impl Drop for Watched {
    fn drop(&mut self) {
        WATCHED.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Files are being written.
#[derive(Debug)]
#[must_use]
pub struct Writing {
    _lock: Option<MutexGuard<'static, ()>>,
}

/// Keeps the program from ending until the answer is dropped. May be nested in one thread.
///
/// # Errors
/// When the program was asked to end: nothing is to be written any more.
pub fn writing() -> Result<Writing> {
    let outermost = DEPTH.get() == 0;
    let lock = outermost.then(|| WRITING.lock().unwrap_or_else(PoisonError::into_inner));
    ensure!(!outermost || !is_asked(), "interrupted");
    DEPTH.set(DEPTH.get() + 1);
    Ok(Writing { _lock: lock })
}

impl Drop for Writing {
    fn drop(&mut self) {
        DEPTH.set(DEPTH.get() - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn writing_nests_and_lets_go() {
        let a = writing().unwrap();
        let b = writing().unwrap();
        assert!(WRITING.try_lock().is_err());
        drop(b);
        assert!(WRITING.try_lock().is_err());
        drop(a);
        assert_eq!(DEPTH.get(), 0);
        let _again = writing().unwrap();
    }
}
