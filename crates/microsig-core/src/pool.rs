//! A pool of reusable buffers.
//!
//! When several threads allocate and free memory in many sizes, allocators do not return all of it, so that
//! the memory of a long run would grow; zeroing new pages also takes time.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, PoisonError};

/// Larger buffers are freed instead of kept: there are few of them, and each takes much memory.
const KEPT_BYTES: usize = 1 << 23;

/// A buffer that can be cleared and refilled.
pub trait Buffer: Default {
    /// Removes the contents and keeps the allocation.
    fn clear(&mut self);
    /// Size of the allocation, bytes.
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

/// Empty buffers for reuse; at most as many as were in use at the same time.
#[derive(Debug)]
pub struct BufferPool<B>(Mutex<Vec<B>>);

impl<B> Default for BufferPool<B> {
    fn default() -> Self {
        BufferPool(Mutex::new(Vec::new()))
    }
}

/// A clone starts with an empty pool.
impl<B> Clone for BufferPool<B> {
    fn clone(&self) -> Self {
        BufferPool::default()
    }
}

impl<B: Buffer> BufferPool<B> {
    /// An empty buffer that returns to the pool when dropped.
    pub fn get(&self) -> Pooled<'_, B> {
        Pooled { buffer: self.take(), pool: self }
    }

    /// An empty buffer; the caller returns it with [`BufferPool::put`].
    pub fn take(&self) -> B {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    /// Returns a buffer to the pool.
    pub fn put(&self, mut buffer: B) {
        if buffer.held() <= KEPT_BYTES {
            buffer.clear();
            self.0.lock().unwrap_or_else(PoisonError::into_inner).push(buffer);
        }
    }
}

/// A buffer that returns to its pool when dropped.
#[derive(Debug)]
pub struct Pooled<'a, B: Buffer> {
    buffer: B,
    pool: &'a BufferPool<B>,
}

impl<B: Buffer> Deref for Pooled<'_, B> {
    type Target = B;

    fn deref(&self) -> &B {
        &self.buffer
    }
}

impl<B: Buffer> DerefMut for Pooled<'_, B> {
    fn deref_mut(&mut self) -> &mut B {
        &mut self.buffer
    }
}

impl<B: Buffer> Drop for Pooled<'_, B> {
    fn drop(&mut self) {
        self.pool.put(std::mem::take(&mut self.buffer));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_are_used_again_empty_unless_they_are_large() {
        let pool = BufferPool::<Vec<u64>>::default();
        pool.get().extend(0..1000);
        let (again, other) = (pool.get(), pool.get());
        assert!(again.is_empty() && again.capacity() >= 1000 && other.capacity() == 0);
        drop((again, other));
        pool.get().reserve(KEPT_BYTES);
        assert!(pool.0.lock().unwrap().iter().all(|buffer| buffer.capacity() < KEPT_BYTES));
    }
}
