//! Counts heap calls of the whole process, those of C libraries that were loaded later included: the executable defines
//! malloc and its like and hands each call on to the C library's own (`__libc_malloc`, glibc). A symbol of the
//! executable comes before that of a library, so no preloading is needed. Off, a call costs one load more.
#![allow(unsafe_code)]

use std::ffi::{c_int, c_void};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

static ON: AtomicBool = AtomicBool::new(false);
static CALLS: AtomicU64 = AtomicU64::new(0);

/// Counts from now on.
pub fn count_from_now() {
    ON.store(true, Ordering::Relaxed);
}

/// Calls of malloc, calloc, realloc, aligned_alloc and posix_memalign since [`count_from_now`].
pub fn calls() -> u64 {
    CALLS.load(Ordering::Relaxed)
}

fn count() {
    if ON.load(Ordering::Relaxed) {
        CALLS.fetch_add(1, Ordering::Relaxed);
    }
}

unsafe extern "C" {
    fn __libc_malloc(size: usize) -> *mut c_void;
    fn __libc_calloc(count: usize, size: usize) -> *mut c_void;
    fn __libc_realloc(block: *mut c_void, size: usize) -> *mut c_void;
    fn __libc_memalign(alignment: usize, size: usize) -> *mut c_void;
}

// SAFETY: the C library's signatures; each is handed on to the C library's own.
#[unsafe(no_mangle)]
unsafe extern "C" fn malloc(size: usize) -> *mut c_void {
    count();
    // SAFETY: as the caller promises.
    unsafe { __libc_malloc(size) }
}

// SAFETY: as above.
#[unsafe(no_mangle)]
unsafe extern "C" fn calloc(number: usize, size: usize) -> *mut c_void {
    count();
    // SAFETY: as the caller promises.
    unsafe { __libc_calloc(number, size) }
}

// SAFETY: as above.
#[unsafe(no_mangle)]
unsafe extern "C" fn realloc(block: *mut c_void, size: usize) -> *mut c_void {
    count();
    // SAFETY: as the caller promises.
    unsafe { __libc_realloc(block, size) }
}

// SAFETY: as above.
#[unsafe(no_mangle)]
unsafe extern "C" fn aligned_alloc(alignment: usize, size: usize) -> *mut c_void {
    count();
    // SAFETY: as the caller promises.
    unsafe { __libc_memalign(alignment, size) }
}

// SAFETY: as above.
#[unsafe(no_mangle)]
unsafe extern "C" fn posix_memalign(place: *mut *mut c_void, alignment: usize, size: usize) -> c_int {
    const INVALID: c_int = 22;
    const NO_MEMORY: c_int = 12;
    count();
    if !alignment.is_power_of_two() || !alignment.is_multiple_of(size_of::<usize>()) {
        return INVALID;
    }
    // SAFETY: POSIX: the place is the caller's to be written.
    unsafe {
        let block = __libc_memalign(alignment, size);
        if block.is_null() {
            return NO_MEMORY;
        }
        *place = block;
    }
    0
}
