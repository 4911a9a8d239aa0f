//! Bare shared memory for the baselines of several benches: words and futex words, with nothing in between.

// A baseline that went through the crate it is the baseline for would not be one.
#![allow(unsafe_code)]
#![allow(dead_code, reason = "each bench uses its part")]

use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU32, AtomicU64};

/// A shared file mapping, all of it read and written by anybody who maps it.
#[derive(Debug)]
pub struct RawMemory {
    base: *mut std::ffi::c_void,
    words: usize,
}

// SAFETY: the mapping is accessed through atomics only and stays until drop.
unsafe impl Send for RawMemory {}
// SAFETY: as above.
unsafe impl Sync for RawMemory {}

impl RawMemory {
    /// Maps `words` words of the file (made if need be; best in `/dev/shm`), followed by a page for futex words.
    ///
    /// # Errors
    /// Those of the file system and of `mmap`.
    pub fn map(path: &Path, words: usize) -> io::Result<Self> {
        let file =
            std::fs::OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
        file.set_len(Self::bytes(words) as u64)?;
        let protection = ProtFlags::READ | ProtFlags::WRITE;
        let flags = MapFlags::SHARED | MapFlags::POPULATE;
        // SAFETY: a new mapping at an address of the kernel's choice.
        let base = unsafe { mmap(std::ptr::null_mut(), Self::bytes(words), protection, flags, &file, 0)? };
        Ok(RawMemory { base, words })
    }

    fn bytes(words: usize) -> usize {
        words * 8 + 4096
    }

    /// The words.
    pub fn words(&self) -> &[AtomicU64] {
        // SAFETY: the mapping is that long, page-aligned, and lives as long as self.
        unsafe { std::slice::from_raw_parts(self.base.cast(), self.words) }
    }

    /// One of 64 futex words, a cache line each.
    pub fn futex(&self, i: usize) -> &AtomicU32 {
        assert!(i < 64);
        // SAFETY: within the page after the words, aligned, and never accessed as anything else.
        unsafe { &*self.base.cast::<u8>().add(self.words * 8 + i * 64).cast::<AtomicU32>() }
    }
}

impl Drop for RawMemory {
    fn drop(&mut self) {
        // SAFETY: exactly what was mapped; no borrow outlives self.
        let _ = unsafe { munmap(self.base, Self::bytes(self.words)) };
    }
}
