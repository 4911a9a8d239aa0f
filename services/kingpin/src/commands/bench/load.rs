//! Stress for `bench jitter --load`: computing, cache misses, memory traffic and disk writes on all cores, at
//! ordinary priority, until the process is ended. It dies with its parent.

use std::hint::black_box;
use std::io::{Seek, Write};

/// Words of the table that the cache misses go through: well beyond any cache. [8 B]
const TABLE_WORDS: usize = 16 << 20;
/// Block that memory traffic copies. [B]
const COPY_BYTES: usize = 64 << 20;
/// Most bytes of the file that is written again and again. [B]
const FILE_BYTES: u64 = 256 << 20;

/// Runs until it is killed.
pub fn load() -> Result<(), String> {
    let _ = rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL));
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    std::thread::scope(|scope| {
        for core in 0..cores {
            scope.spawn(compute);
            if core % 2 == 0 {
                scope.spawn(miss);
                scope.spawn(copy);
            }
        }
        scope.spawn(write);
    });
    Ok(())
}

fn compute() {
    let mut x = 1.0_f64;
    loop {
        for _ in 0..1_000_000 {
            x = black_box((x * 1.000_000_1).sqrt() + 0.1);
        }
    }
}

fn miss() {
    let mut table = vec![0_u64; TABLE_WORDS];
    let mut at = 1_usize;
    loop {
        for _ in 0..1_000_000 {
            at = at.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let slot = (at >> 20) % TABLE_WORDS;
            table[slot] = table[slot].wrapping_add(at as u64);
        }
        black_box(&table);
    }
}

fn copy() {
    let from = vec![1_u8; COPY_BYTES];
    let mut to = vec![0_u8; COPY_BYTES];
    loop {
        to.copy_from_slice(&from);
        black_box(&to);
    }
}

fn write() {
    let block = vec![0x5a_u8; 1 << 20];
    // Unlinked at once: nothing is left however this ends.
    let path = std::env::temp_dir().join(format!("kingpin-load-{}", std::process::id()));
    let file = std::fs::File::create(&path);
    let _ = std::fs::remove_file(&path);
    let Ok(mut file) = file else { return };
    loop {
        let full = file.stream_position().is_ok_and(|at| at > FILE_BYTES);
        if full && file.rewind().is_err() {
            return;
        }
        if file.write_all(&block).is_err() || file.sync_data().is_err() {
            return;
        }
    }
}
