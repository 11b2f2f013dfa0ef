//! Progress on a terminal, for anything that takes more than a second.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use isobar_core::Stop;
use std::io::IsTerminal;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Runs `work`, showing what `stop` says of its progress after the first second, on standard error and only where that is a terminal.
/// Work that reports no steps gets a spinner. The line is gone afterwards.
pub fn watch<T>(label: &str, stop: &Stop, work: impl FnOnce() -> T) -> T {
    if !std::io::stderr().is_terminal() {
        return work();
    }
    let (done, waits) = channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            if !matches!(waits.recv_timeout(Duration::from_secs(1)), Err(RecvTimeoutError::Timeout)) {
                return;
            }
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
            bar.set_message(label.to_owned());
            while matches!(waits.recv_timeout(Duration::from_millis(100)), Err(RecvTimeoutError::Timeout)) {
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
            bar.finish_and_clear();
        });
        // Dropped on return and on a panic alike: the watcher ends.
        let _ends_the_watcher = done;
        work()
    })
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
