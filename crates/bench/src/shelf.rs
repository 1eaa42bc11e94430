//! Buffers that are used again.
//!
//! Memory that is asked for and given back frame after frame, by several threads and in many sizes, is never quite given back by
//! allocators: a long run would take more than a short one. It also costs the time to clear new pages.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, PoisonError};

/// Larger buffers are given back to the system: few of them are made, and each weighs.
const KEPT_BYTES: usize = 1 << 23;

/// Empty buffers that wait for their next use. There are as many as were ever in use at a time.
#[derive(Debug)]
pub(crate) struct Shelf<T>(Mutex<Vec<Vec<T>>>);

impl<T> Default for Shelf<T> {
    fn default() -> Self {
        Shelf(Mutex::default())
    }
}

impl<T> Shelf<T> {
    /// An empty buffer.
    pub(crate) fn take(&self) -> Lent<'_, T> {
        let buffer = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        Lent { buffer: buffer.unwrap_or_default(), shelf: self }
    }
}

/// A buffer that goes back to its shelf.
#[derive(Debug)]
pub(crate) struct Lent<'a, T> {
    buffer: Vec<T>,
    shelf: &'a Shelf<T>,
}

impl<T> Deref for Lent<'_, T> {
    type Target = Vec<T>;

    fn deref(&self) -> &Vec<T> {
        &self.buffer
    }
}

impl<T> DerefMut for Lent<'_, T> {
    fn deref_mut(&mut self) -> &mut Vec<T> {
        &mut self.buffer
    }
}

impl<T> Drop for Lent<'_, T> {
    fn drop(&mut self) {
        let mut buffer = std::mem::take(&mut self.buffer);
        if buffer.capacity() * size_of::<T>() <= KEPT_BYTES {
            buffer.clear();
            self.shelf.0.lock().unwrap_or_else(PoisonError::into_inner).push(buffer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_are_used_again_empty_unless_they_are_large() {
        let shelf = Shelf::<u64>::default();
        shelf.take().extend(0..1000);
        let (again, other) = (shelf.take(), shelf.take());
        assert!(again.is_empty() && again.capacity() >= 1000 && other.capacity() == 0);
        drop((again, other));
        shelf.take().reserve(KEPT_BYTES);
        assert!(shelf.0.lock().unwrap().iter().all(|buffer| buffer.capacity() < KEPT_BYTES));
    }
}
