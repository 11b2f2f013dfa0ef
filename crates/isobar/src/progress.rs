//! Progress on a terminal, for anything that takes more than a second, and its end when the program is asked to end.

use crate::interrupt;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use isobar_core::Stop;
use std::io::IsTerminal;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Runs `work`, showing what `stop` says of its progress after the first second, on standard error and only where that is a terminal.
/// Work that reports no steps gets a spinner. The line is gone afterwards. Where the program is asked to end, `stop` is raised, and the
/// program ends with the work under way unless that is [`interrupt::watched`].
pub fn watch<T>(label: &str, stop: &Stop, work: impl FnOnce() -> T) -> T {
    let shown = std::io::stderr().is_terminal();
    let (done, waits) = channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let start = Instant::now();
            let mut bar = None;
            while matches!(waits.recv_timeout(Duration::from_millis(100)), Err(RecvTimeoutError::Timeout)) {
                if interrupt::is_asked() {
                    stop.raise();
                }
                if shown && start.elapsed() > Duration::from_secs(1) {
                    show(bar.get_or_insert_with(|| new_bar(label)), stop);
                }
            }
            if let Some(bar) = bar {
                bar.finish_and_clear();
            }
        });
        // Dropped on return and on a panic alike: the watcher ends.
        let _ends_the_watcher = done;
        work()
    })
}

fn new_bar(label: &str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
    bar.set_message(label.to_owned());
    bar
}

fn show(bar: &ProgressBar, stop: &Stop) {
    let (steps, total) = stop.progress();
    if total > 0 {
        if bar.length() != Some(total) {
            bar.set_length(total);
            bar.set_style(style("{msg} [{bar:30}] {percent}% {elapsed}"));
        }
        bar.set_position(steps);
    } else {
        bar.tick();
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_result_comes_through() {
        assert_eq!(watch("counting", &Stop::default(), || 7), 7);
    }
}
