//! Background threads that prepare batches. Thread `w` of `W` makes the steps `w, w + W, ..`, and the consumer takes
//! them in turn, so the order does not depend on the number of threads.

use crate::TrainError;
use crate::task::Task;
use geometry::rng::stream;
use rand::seq::SliceRandom;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::Scope;

/// The visits of an epoch in their random order, cut into steps of at most `batch`, as equal as can be, and each
/// step into `parts`.
pub fn epoch_plan(seed: u64, epoch: u32, visits: usize, batch: usize, parts: usize) -> Vec<Vec<Vec<usize>>> {
    let mut order: Vec<usize> = (0..visits).collect();
    order.shuffle(&mut stream(seed, &format!("train/epoch/{epoch}/order")));
    let steps = visits.div_ceil(batch);
    let cut = |list: &[usize], pieces: usize| -> Vec<Vec<usize>> {
        let n = list.len();
        (0..pieces).map(|i| list[i * n / pieces..(i + 1) * n / pieces].to_vec()).filter(|p| !p.is_empty()).collect()
    };
    cut(&order, steps).iter().map(|step| cut(step, parts)).collect()
}

/// Batches of one epoch in order, each a list of parts.
pub struct Loader<B> {
    queues: Vec<Receiver<Result<Vec<B>, TrainError>>>,
    next: usize,
}

impl<B: Send> Loader<B> {
    /// Starts threads for the steps from `first` on. They end with the plan, or when the loader is dropped.
    pub fn start<'scope, T>(
        scope: &'scope Scope<'scope, '_>,
        task: &'scope T,
        epoch: u32,
        plan: &'scope [Vec<Vec<usize>>],
        first: usize,
        workers: usize,
        ready: usize,
    ) -> Loader<B>
    where
        T: Task<Batch = B>,
        B: 'scope,
    {
        let workers = workers.max(1);
        let queues = (0..workers)
            .map(|w| {
                let (send, receive) = sync_channel(ready);
                scope.spawn(move || {
                    for step in plan.iter().skip(first + w).step_by(workers) {
                        let parts = step.iter().map(|visits| task.batch(epoch, visits)).collect();
                        if send.send(parts).is_err() {
                            return;
                        }
                    }
                });
                receive
            })
            .collect();
        Loader { queues, next: 0 }
    }

    /// The next step's parts; waits for them.
    pub fn next_batch(&mut self) -> Result<Vec<B>, TrainError> {
        let queue = &self.queues[self.next];
        self.next = (self.next + 1) % self.queues.len();
        queue
            .recv()
            .unwrap_or_else(|_| Err(TrainError::Loader("its thread panicked; the panic's message is above".into())))
    }
}

/// Threads for a setting of `workers`: 0 means one per eight cores, at least one.
pub fn worker_count(workers: usize) -> usize {
    match workers {
        0 => std::thread::available_parallelism().map_or(1, |n| n.get() / 8).max(1),
        n => n,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_epoch_visits_everything_once_in_an_order_of_its_own() {
        let plan = epoch_plan(1, 0, 129, 32, 2);
        let sizes: Vec<usize> = plan.iter().map(|s| s.iter().map(Vec::len).sum()).collect();
        assert_eq!(plan.len(), 5);
        assert!(sizes.iter().all(|s| (25..=26).contains(s)), "{sizes:?}");
        assert!(plan.iter().all(|s| s.len() == 2));
        let flat = |p: &[Vec<Vec<usize>>]| p.iter().flatten().flatten().copied().collect::<Vec<_>>();
        let mut all = flat(&plan);
        assert_ne!(all, flat(&epoch_plan(1, 1, 129, 32, 2)), "epochs differ");
        assert_ne!(all, flat(&epoch_plan(2, 0, 129, 32, 2)), "seeds differ");
        assert_eq!(all, flat(&epoch_plan(1, 0, 129, 32, 2)), "the same epoch repeats");
        assert_ne!(all, (0..129).collect::<Vec<_>>(), "shuffled");
        all.sort_unstable();
        assert_eq!(all, (0..129).collect::<Vec<_>>());
        assert!(epoch_plan(1, 0, 0, 32, 1).is_empty());
        assert_eq!(epoch_plan(1, 0, 3, 8, 5)[0].len(), 3, "no part is empty");
    }
}
