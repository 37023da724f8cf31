//! Memory aligned to cache lines or, where it is large, to huge pages.

use std::alloc::{Layout, alloc, dealloc, handle_alloc_error};
use std::ptr::NonNull;

use half::bf16;

const CACHE_LINE: usize = 64;

/// Pages of this size save most of the address translations that streaming tens of megabytes of weights costs.
const HUGE_PAGE: usize = 2 << 20;

/// Numbers for which all bits zero mean zero.
pub trait Number: Copy {}
impl Number for f32 {}
impl Number for bf16 {}

/// A growable array of numbers that starts at a cache line.
#[derive(Debug)]
pub struct Buffer<T: Number = f32> {
    numbers: NonNull<T>,
    len: usize,
    capacity: usize,
}

// SAFETY: the buffer owns its numbers.
unsafe impl<T: Number + Send> Send for Buffer<T> {}
// SAFETY: a shared buffer is only read.
unsafe impl<T: Number + Sync> Sync for Buffer<T> {}

impl<T: Number> Buffer<T> {
    /// `len` zeros.
    #[must_use]
    pub fn zeros(len: usize) -> Self {
        if len == 0 {
            return Self::default();
        }
        let layout = Self::layout(len);
        // SAFETY: the layout is not empty.
        let memory = unsafe { alloc(layout) };
        let Some(numbers) = NonNull::new(memory.cast()) else { handle_alloc_error(layout) };
        if layout.align() == HUGE_PAGE {
            ask_for_huge_pages(memory, layout.size());
        }
        // SAFETY: this many bytes were allocated. Not `alloc_zeroed`, which touches the pages before they can be huge.
        unsafe { memory.write_bytes(0, layout.size()) };
        Self { numbers, len, capacity: len }
    }

    /// Makes room for at least `len` numbers; never shrinks, and allocates only when it must.
    pub fn grow(&mut self, len: usize) {
        if len > self.capacity {
            let mut larger = Self::zeros(len);
            larger[..self.len].copy_from_slice(self);
            *self = larger;
        }
        self.len = self.len.max(len);
    }

    fn layout(capacity: usize) -> Layout {
        let bytes = capacity.checked_mul(size_of::<T>()).expect("buffers fit the address space");
        let align = if bytes >= HUGE_PAGE { HUGE_PAGE } else { CACHE_LINE };
        // Whole cache lines, so that nothing else shares the last one.
        Layout::from_size_align(bytes.next_multiple_of(CACHE_LINE), align).expect("buffers fit the address space")
    }
}

/// Asks Linux for huge pages. It may refuse, and the memory is then like any other.
fn ask_for_huge_pages(memory: *mut u8, bytes: usize) {
    #[cfg(target_os = "linux")]
    // SAFETY: the range is ours, and the advice changes no content.
    unsafe {
        libc::madvise(memory.cast(), bytes, libc::MADV_HUGEPAGE);
    }
    #[cfg(not(target_os = "linux"))]
    let _ = (memory, bytes);
}

impl<T: Number> Default for Buffer<T> {
    fn default() -> Self {
        Self { numbers: NonNull::dangling(), len: 0, capacity: 0 }
    }
}

impl<T: Number> Drop for Buffer<T> {
    fn drop(&mut self) {
        if self.capacity > 0 {
            // SAFETY: allocated by `zeros` with this layout.
            unsafe { dealloc(self.numbers.as_ptr().cast(), Self::layout(self.capacity)) }
        }
    }
}

impl<T: Number> Clone for Buffer<T> {
    fn clone(&self) -> Self {
        let mut copy = Self::zeros(self.len);
        copy.copy_from_slice(self);
        copy
    }
}

impl<T: Number> std::ops::Deref for Buffer<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        // SAFETY: `capacity` numbers are allocated, at least `len`, and each is zero or was written since.
        unsafe { std::slice::from_raw_parts(self.numbers.as_ptr(), self.len) }
    }
}

impl<T: Number> std::ops::DerefMut for Buffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: as in `deref`, and `self` is borrowed mutably.
        unsafe { std::slice::from_raw_parts_mut(self.numbers.as_ptr(), self.len) }
    }
}
