//! Large buffers that one step leaves behind for the next: fresh pages from the system, and the zeros in them, cost a tenth of a step.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard};

/// Forward passes that a buffer may lie unused: those of four steps with two encoders.
const KEPT: u64 = 8;

/// Values in no particular state, left for others when dropped.
#[derive(Debug, Default)]
pub struct Buffer(Vec<f32>);

impl Buffer {
    /// `len` values, whatever they are.
    pub fn of(len: usize) -> Self {
        // The lock is not held while the system clears pages.
        let found = left().take(len);
        Self(found.unwrap_or_else(|| vec![0.0; len]))
    }

    /// `len` zeros.
    pub fn zeros(len: usize) -> Self {
        let mut zeros = Self::of(len);
        zeros.fill(0.0);
        zeros
    }
}

/// A forward pass of training begins: what has long lain unused, of batches of another size, is freed.
pub fn begin() {
    left().begin();
}

/// Frees what steps on the CPU left behind, where no more are to come: after a check on the CPU of a run on a GPU, gigabytes.
pub fn free_buffers() {
    left().buffers.clear();
}

struct Left {
    /// Each with the forward pass in which it was left.
    buffers: Vec<(u64, Vec<f32>)>,
    passes: u64,
}

static LEFT: Mutex<Left> = Mutex::new(Left { buffers: Vec::new(), passes: 0 });

fn left() -> MutexGuard<'static, Left> {
    LEFT.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

impl Left {
    fn take(&mut self, len: usize) -> Option<Vec<f32>> {
        let at = self.buffers.iter().rposition(|(_, buffer)| buffer.len() == len)?;
        Some(self.buffers.swap_remove(at).1)
    }

    fn leave(&mut self, buffer: Vec<f32>) {
        self.buffers.push((self.passes, buffer));
    }

    fn begin(&mut self) {
        self.passes += 1;
        self.buffers.retain(|(left, _)| self.passes - left <= KEPT);
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        if !self.0.is_empty() {
            left().leave(std::mem::take(&mut self.0));
        }
    }
}

impl Deref for Buffer {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.0
    }
}

impl DerefMut for Buffer {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_of_a_size_are_used_again_until_nobody_asks_for_it() {
        let mut left = Left { buffers: Vec::new(), passes: 0 };
        assert!(left.take(20).is_none(), "nothing was left yet");
        left.leave(vec![1.0; 10]);
        left.leave(vec![2.0; 20]);
        assert_eq!(left.take(20), Some(vec![2.0; 20]), "as it was left");
        assert!(left.take(20).is_none(), "the other has 10 values");
        for _ in 0..KEPT {
            left.begin();
        }
        left.leave(vec![3.0; 20]);
        assert_eq!(left.buffers.len(), 2, "both may be asked for");
        left.begin();
        assert!(left.take(10).is_none() && left.take(20).is_some(), "the first lay too long");
    }

    #[test]
    fn zeros_are_zeros_whatever_was_left() {
        let len = 12_345;
        Buffer::of(len).fill(7.0);
        assert!(Buffer::zeros(len).iter().all(|x| *x == 0.0));
    }
}
