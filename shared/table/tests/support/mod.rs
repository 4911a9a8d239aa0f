//! A bench of its own for each test, removed at its end, however it ends.
#![allow(dead_code)]

use std::sync::atomic::{AtomicU32, Ordering};
use table::{Bench, BenchLock};

pub struct TestBench {
    pub bench: Bench,
    pub lock: BenchLock,
    pub base: tempfile::TempDir,
}

impl TestBench {
    pub fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = format!("test-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let base = tempfile::tempdir().unwrap();
        let bench = Bench::with_base(&name, base.path()).unwrap();
        let lock = bench.lock().unwrap();
        table::remove_bench(&lock).unwrap(); // of an earlier process with our number
        TestBench { bench, lock, base }
    }

    /// Path of a region's segment.
    pub fn path(&self, region: &str) -> std::path::PathBuf {
        std::path::Path::new("/dev/shm").join(table::segment_name(self.bench.name(), region))
    }
}

impl Drop for TestBench {
    fn drop(&mut self) {
        let _ = table::remove_bench(&self.lock);
    }
}
