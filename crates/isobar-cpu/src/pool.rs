//! Worker threads.

use isobar_core::RenderError;

/// Threads that live as long as a renderer, so that no `render` pays for starting them.
#[derive(Debug)]
pub struct Pool(rayon::ThreadPool);

impl Pool {
    /// A pool of `threads` workers; 0: as many as the machine offers.
    ///
    /// # Errors
    /// [`RenderError::Device`] where the operating system refuses the threads.
    pub fn new(threads: usize) -> Result<Self, RenderError> {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|i| format!("isobar-{i}"))
            .build()
            .map(Self)
            .map_err(|e| {
                RenderError::Device(format!(
                    "{threads} threads could not be started ({e}); ask for fewer with --threads"
                ))
            })
    }

    /// Workers.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.0.current_num_threads()
    }

    /// Runs `work` on the pool: rayon's parallel iterators inside it use these workers.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.0.install(work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pool_has_the_threads_asked_for() {
        let pool = Pool::new(3).unwrap();
        assert_eq!((pool.threads(), pool.install(rayon::current_num_threads)), (3, 3));
        assert!(Pool::new(0).unwrap().threads() >= 1);
    }
}
