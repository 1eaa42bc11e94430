//! Buffers that are used again.
//!
//! Memory that is asked for and given back frame after frame, by several threads and in many sizes, is never quite given
//! back by allocators: a long run would take more than a short one. It also costs the time to clear new pages.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, PoisonError};

/// Larger buffers are given back to the system: few of them are made, and each weighs.
const KEPT_BYTES: usize = 1 << 23;

/// What can be emptied and filled again.
pub trait Buffer: Default {
    /// Empties it; its memory stays.
    fn clear(&mut self);
    /// The memory it holds, bytes.
    fn held(&self) -> usize;
}

impl<T> Buffer for Vec<T> {
    fn clear(&mut self) {
        self.clear();
    }

    fn held(&self) -> usize {
        self.capacity() * size_of::<T>()
    }
}

impl Buffer for String {
    fn clear(&mut self) {
        self.clear();
    }

    fn held(&self) -> usize {
        self.capacity()
    }
}

/// Empty buffers that wait for their next use. There are as many as were ever in use at a time.
#[derive(Debug)]
pub struct Shelf<B>(Mutex<Vec<B>>);

impl<B> Default for Shelf<B> {
    fn default() -> Self {
        Shelf(Mutex::new(Vec::new()))
    }
}

/// A copy of what has a shelf begins with an empty one.
impl<B> Clone for Shelf<B> {
    fn clone(&self) -> Self {
        Shelf::default()
    }
}

impl<B: Buffer> Shelf<B> {
    /// An empty buffer that comes back by itself.
    pub fn lend(&self) -> Lent<'_, B> {
        Lent { buffer: self.take(), shelf: self }
    }

    /// An empty buffer, to be put back.
    pub fn take(&self) -> B {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    /// Takes back a buffer.
    pub fn put_back(&self, mut buffer: B) {
        if buffer.held() <= KEPT_BYTES {
            buffer.clear();
            self.0.lock().unwrap_or_else(PoisonError::into_inner).push(buffer);
        }
    }
}

/// A buffer that goes back to its shelf.
#[derive(Debug)]
pub struct Lent<'a, B: Buffer> {
    buffer: B,
    shelf: &'a Shelf<B>,
}

impl<B: Buffer> Deref for Lent<'_, B> {
    type Target = B;

    fn deref(&self) -> &B {
        &self.buffer
    }
}

impl<B: Buffer> DerefMut for Lent<'_, B> {
    fn deref_mut(&mut self) -> &mut B {
        &mut self.buffer
    }
}

impl<B: Buffer> Drop for Lent<'_, B> {
    fn drop(&mut self) {
        self.shelf.put_back(std::mem::take(&mut self.buffer));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_are_used_again_empty_unless_they_are_large() {
        let shelf = Shelf::<Vec<u64>>::default();
        shelf.lend().extend(0..1000);
        let (again, other) = (shelf.lend(), shelf.lend());
        assert!(again.is_empty() && again.capacity() >= 1000 && other.capacity() == 0);
        drop((again, other));
        shelf.lend().reserve(KEPT_BYTES);
        assert!(shelf.0.lock().unwrap().iter().all(|buffer| buffer.capacity() < KEPT_BYTES));
    }
}
