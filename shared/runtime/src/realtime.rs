//! Making a thread real-time, as far as the host allows: core, SCHED_FIFO, locked memory.
//!
//! Nothing here is needed for correctness; what the host refuses is said in one line and the bench runs on.
#![allow(unsafe_code)] // sched_setscheduler has no safe wrapper in rustix.

use rustix::mm::MlockAllFlags;
use rustix::thread::CpuSet;

/// What is wanted of a thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Wish {
    /// Core to run on.
    pub core: Option<usize>,
    /// SCHED_FIFO priority, 1 to 99.
    pub priority: Option<i32>,
    /// Lock all memory mapped so far.
    pub lock_memory: bool,
}

/// Applies the wish to the calling thread; returns a line for each part the host refused.
pub fn apply(wish: &Wish) -> Vec<String> {
    let mut notes = Vec::new();
    if let Some(core) = wish.core {
        let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        let mut set = CpuSet::new();
        if core < CpuSet::MAX_CPU {
            set.set(core);
        }
        if let Err(error) = rustix::thread::sched_setaffinity(None, &set) {
            notes.push(format!("not pinned to core {core} of {cores}: {error}"));
        }
    }
    if let Some(priority) = wish.priority {
        let param = libc::sched_param { sched_priority: priority };
        // SAFETY: `param` is a valid sched_param that outlives the call; 0 is the calling thread.
        let done = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const param) };
        if done != 0 {
            let error = std::io::Error::last_os_error();
            notes.push(format!(
                "no SCHED_FIFO {priority} ({error}): ordinary scheduling; allow rtprio in limits.conf"
            ));
        }
    }
    if wish.lock_memory
        && let Err(error) = rustix::mm::mlockall(MlockAllFlags::CURRENT)
    {
        notes.push(format!("memory not locked ({error}): page faults may delay ticks; raise memlock"));
    }
    notes
}

/// Back to ordinary scheduling on all cores (for threads that inherit a real-time parent).
pub fn relax() {
    let param = libc::sched_param { sched_priority: 0 };
    // SAFETY: `param` is a valid sched_param that outlives the call; 0 is the calling thread.
    let _ = unsafe { libc::sched_setscheduler(0, libc::SCHED_OTHER, &raw const param) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_host_refuses_is_said_in_a_line() {
        std::thread::spawn(|| {
            let notes = apply(&Wish { core: Some(1000), priority: Some(1000), lock_memory: false });
            assert_eq!(notes.len(), 2, "{notes:?}");
            assert!(notes[0].contains("core 1000") && notes[1].contains("SCHED_FIFO 1000"));
        })
        .join()
        .unwrap();
    }
}
