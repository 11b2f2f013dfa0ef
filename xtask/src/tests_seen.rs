//! Counting tests in the output of nextest and of libtest.
//!
//! A test that lacks its data or its adapter prints a line `SKIPPED: reason` and returns: it counts as skipped, not as passed. Both
//! runners are asked for the output of passing tests, test by test, so that such a line is counted once per test.

/// Tests, by how they ended.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    pub(crate) passed: u64,
    pub(crate) failed: u64,
    pub(crate) skipped: u64,
}

impl Counts {
    /// One check that was left out.
    pub(crate) const SKIPPED: Self = Self {
        passed: 0,
        failed: 0,
        skipped: 1,
    };

    /// One check that passed or failed.
    pub(crate) const fn one(ok: bool) -> Self {
        Self {
            passed: ok as u64,
            failed: !ok as u64,
            skipped: 0,
        }
    }

    /// Both together.
    pub(crate) fn add(&mut self, o: Self) {
        self.passed += o.passed;
        self.failed += o.failed;
        self.skipped += o.skipped;
    }
}

/// Reads the output of a test runner line by line.
#[derive(Debug, Default)]
pub(crate) struct Reader {
    counts: Counts,
    /// Passing tests that said they were skipped.
    said: u64,
    /// Inside the output of a passing test.
    inside: bool,
    /// That test already said it was skipped.
    counted: bool,
    /// Inside libtest's list of passing tests' output.
    successes: bool,
    /// Nextest runs: what libtest says inside a test's output is counted by nextest's own summary.
    nextest: bool,
}

impl Reader {
    /// Takes a line; returns whether a person should see it.
    pub(crate) fn line(&mut self, line: &str) -> bool {
        let text = line.trim();
        if let Some(counts) = nextest_summary(text).or_else(|| libtest_summary(text).filter(|_| !self.inside && !self.nextest)) {
            self.counts.add(counts);
            (self.inside, self.successes, self.nextest) = (false, false, false);
            return true;
        }
        if let Some(passed) = nextest_status(text) {
            (self.inside, self.counted, self.nextest) = (passed, false, true);
            return true;
        }
        match text {
            "successes:" => {
                self.successes = true;
                self.inside = false;
                return false;
            }
            "failures:" => {
                (self.inside, self.successes) = (false, false);
                return true;
            }
            _ => {}
        }
        if self.successes && text.starts_with("---- ") && text.ends_with(" stdout ----") {
            (self.inside, self.counted) = (true, false);
            return false;
        }
        // With one thread libtest leaves its own `test name ... ` on the line.
        if self.inside && (text.starts_with("SKIPPED:") || text.contains("... SKIPPED:")) {
            self.said += u64::from(!self.counted);
            self.counted = true;
            return true;
        }
        !self.inside && !self.successes
    }

    /// What was counted, with the tests that said they were skipped taken from the passed ones.
    pub(crate) fn counts(&self) -> Counts {
        let said = self.said.min(self.counts.passed);
        Counts {
            passed: self.counts.passed - said,
            failed: self.counts.failed,
            skipped: self.counts.skipped + said,
        }
    }
}

/// `Summary [   0.062s] 19 tests run: 18 passed (1 slow), 1 failed, 2 skipped`
fn nextest_summary(text: &str) -> Option<Counts> {
    let rest = text.strip_prefix("Summary [")?;
    let (_, list) = rest.split_once("run: ")?;
    let count = |names: &[&str]| -> u64 {
        list.split(", ")
            .filter_map(|part| {
                let mut words = part.split(' ');
                let n = words.next()?.parse::<u64>().ok()?;
                // `18 passed (1 slow, 1 leaky)` splits into parts whose second word is not one of these
                words.next().filter(|w| names.contains(w)).map(|_| n)
            })
            .sum()
    };
    Some(Counts {
        passed: count(&["passed"]),
        failed: count(&["failed", "timed", "exec"]),
        skipped: count(&["skipped"]),
    })
}

/// `test result: ok. 3 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.00s`
fn libtest_summary(text: &str) -> Option<Counts> {
    let rest = text.strip_prefix("test result: ")?;
    let (_, list) = rest.split_once(". ")?;
    let count = |name: &str| -> u64 {
        list.split("; ")
            .filter_map(|p| p.split_once(' ').filter(|(_, w)| *w == name)?.0.parse::<u64>().ok())
            .sum()
    };
    Some(Counts {
        passed: count("passed"),
        failed: count("failed"),
        skipped: count("ignored"),
    })
}

/// Whether the line is nextest's status of one test, and if so whether the test passed.
fn nextest_status(text: &str) -> Option<bool> {
    let (word, rest) = text.split_once(" [")?;
    let status = word
        .chars()
        .all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || " ()/+-".contains(c));
    let timed = rest
        .trim_start()
        .split_once('s')
        .is_some_and(|(t, _)| t.parse::<f64>().is_ok());
    (status && timed && !word.is_empty()).then_some(word == "PASS" || word == "LEAK" || word == "SLOW")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> (Counts, Vec<&str>) {
        let mut r = Reader::default();
        let shown = text.lines().filter(|l| r.line(l)).collect();
        (r.counts(), shown)
    }

    #[test]
    fn nextest_sections_count_a_skip_once_per_test() {
        let (c, shown) = read(
            "        PASS [   0.004s] (1/4) a one\n  stdout ───\n\n    running 1 test\n    SKIPPED: no adapter\n    SKIPPED: again\n    test result: ok. 1 passed; 0 failed; 0 ignored; 0 measured; 18 filtered out; finished in 0.00s\n\n        PASS [   0.004s] (2/4) a two\n    test two ... SKIPPED: no data\n        FAIL [   0.004s] (3/4) a three\n    SKIPPED: but it failed all the same\n    test result: FAILED. 0 passed; 1 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.1s\n        PASS [   1.004s] (4/4) a four\n    chatter\n     Summary [   0.062s] 4 tests run: 3 passed (1 slow), 1 failed, 2 skipped\n",
        );
        assert_eq!(
            c,
            Counts {
                passed: 1,
                failed: 1,
                skipped: 4
            }
        );
        assert!(shown.iter().any(|l| l.contains("no adapter")) && !shown.iter().any(|l| l.contains("chatter")));
        assert!(shown.iter().any(|l| l.contains("but it failed")));
    }

    #[test]
    fn libtest_sections_are_read_too() {
        let (c, _) = read(
            "running 3 tests\ntest a ... ok\n\nsuccesses:\n\n---- a stdout ----\nSKIPPED: no adapter\n\n\nsuccesses:\n    a\n    b\n\ntest result: ok. 3 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.00s\nrunning 1 test\ntest result: FAILED. 0 passed; 1 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.00s\n",
        );
        assert_eq!(
            c,
            Counts {
                passed: 2,
                failed: 1,
                skipped: 2
            }
        );
    }

    #[test]
    fn summaries_of_both_runners() {
        let c = nextest_summary(
            "Summary [  10.3s] 9/12 tests run: 5 passed (1 slow, 1 leaky), 2 failed, 1 timed out, 1 exec failed, 3 skipped",
        );
        assert_eq!(
            c,
            Some(Counts {
                passed: 5,
                failed: 4,
                skipped: 3
            })
        );
        assert_eq!(nextest_summary("Summary of the day"), None);
        assert_eq!(nextest_status("PASS [   0.004s] (16/19) x"), Some(true));
        assert_eq!(nextest_status("SIGABRT [   0.004s] (16/19) x"), Some(false));
        assert_eq!(nextest_status("Compiling foo [bar]"), None);
    }
}
