//! Worker pool: workers, and the threads on which they run.

use std::sync::Mutex;

use stepper_real::Level;

use crate::batch::worker::{LaneScalar, MakeWorker, Worker, WorkerSpec};
use crate::error::Error;

/// Pool of workers and threads. The threads start at the first step, and again after a fork of the process.
pub(super) struct WorkerPool<S: LaneScalar> {
    /// Number of threads that make steps, including the calling thread.
    pub(super) threads: usize,
    lanes: usize,
    /// CPU level of the workers.
    pub(super) level: Level,
    make: MakeWorker<S>,
    idle: Mutex<Vec<Box<dyn Worker<S>>>>,
    /// Thread pool, with the id of the process that started its threads.
    pool: Option<(u32, rayon::ThreadPool)>,
}

impl<S: LaneScalar> Clone for WorkerPool<S> {
    /// Creates a pool with the same parameters, without workers and threads yet.
    fn clone(&self) -> Self {
        Self { threads: self.threads, lanes: self.lanes, level: self.level, make: self.make, idle: Mutex::default(), pool: None }
    }
}

impl<S: LaneScalar> WorkerPool<S> {
    /// Creates a pool for groups of `lanes` lanes, without workers and threads yet.
    pub(super) fn new(threads: usize, lanes: usize, level: Level) -> Self {
        Self { threads, lanes, level, make: S::worker, idle: Mutex::new(Vec::new()), pool: None }
    }

    pub(super) fn make_worker(&self, spec: &WorkerSpec<'_, S>) -> Box<dyn Worker<S>> {
        (self.make)(spec, self.lanes, self.level)
    }

    /// Sets the function that creates workers.
    #[cfg(feature = "internals")]
    pub(super) fn set_maker(&mut self, make: MakeWorker<S>) {
        self.make = make;
        self.idle_workers().clear();
    }

    /// Mutable list of idle workers. The exclusive reference makes a lock unnecessary.
    pub(super) fn idle_workers(&mut self) -> &mut Vec<Box<dyn Worker<S>>> {
        self.idle.get_mut().expect("a worker panicked")
    }

    /// Starts the threads: one less than the number that steps, because the calling thread steps too. Threads do not survive a fork; the
    /// child process starts new ones.
    ///
    /// # Errors
    /// [`Error::Threads`] when the system refuses a thread.
    pub(super) fn start_threads(&mut self) -> Result<(), Error> {
        if self.threads == 1 {
            return Ok(());
        }
        let pid = std::process::id();
        if self.pool.as_ref().is_none_or(|(owner, _)| *owner != pid) {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads - 1).thread_name(|i| format!("stepper-{i}")).build();
            let pool = pool.map_err(|e| Error::Threads { threads: self.threads, reason: e.to_string() })?;
            let stale = self.pool.replace((pid, pool));
            // The parent's threads do not exist in this process. Dropping the pool would wait for them forever.
            std::mem::forget(stale.filter(|(owner, _)| *owner != pid));
        }
        Ok(())
    }

    /// Runs `work` for every chunk of groups, on the calling thread and on the threads of the pool. Each thread uses a separate worker.
    ///
    /// Every thread takes the next chunk when it is free. The calling thread starts at once; the others join when they are awake.
    pub(super) fn share_chunks<P: Send>(
        &self,
        spec: &WorkerSpec<'_, S>,
        chunks: impl Iterator<Item = P> + Send,
        work: impl Fn(&mut dyn Worker<S>, P) + Sync,
    ) {
        let helpers = self.threads.min(chunks.size_hint().0).saturating_sub(1);
        let chunks = Mutex::new(chunks);
        let next = || chunks.lock().expect("taking a chunk does not panic").next();
        let take = || {
            let mut worker = None;
            while let Some(chunk) = next() {
                let idle = || self.idle.lock().expect("a worker panicked").pop();
                work(&mut **worker.get_or_insert_with(|| idle().unwrap_or_else(|| self.make_worker(spec))), chunk);
            }
            self.idle.lock().expect("a worker panicked").extend(worker);
        };
        match &self.pool {
            Some((_, pool)) => pool.in_place_scope(|scope| {
                for _ in 0..helpers {
                    scope.spawn(|_| take());
                }
                take();
            }),
            None => take(),
        }
    }
}
