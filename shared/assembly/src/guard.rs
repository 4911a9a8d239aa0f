//! What a model makes of an input that did not come, is too old or says nonsense.
//!
//! Fresh and plausible: used. Missing for less than the limit, or implausible: the last good value is used
//! and flagged. Older than the limit: the model holds its last outputs and flags them (spec 1.5). The age counts from
//! the last *good* input, so that it is known from what the log says was used, and nonsense that stops coming is not
//! younger than nonsense that goes on.

use regions::{NO_TICK, model_flags};
use runtime::{Input, Step};

/// Judges one input.
#[derive(Debug, Clone, Copy)]
pub struct Guard {
    stale_after: u64,
    held_count: u64,
}

/// The verdict on an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Use it.
    Good,
    /// Use the last good one.
    Hold,
    /// Hold the outputs.
    Stale,
}

impl Guard {
    /// With the age from which an input is stale. [ticks]
    pub fn new(stale_after: u32) -> Self {
        Guard { stale_after: u64::from(stale_after), held_count: 0 }
    }

    /// Judges the input of a step; sets the flags that go with the verdict. `used`: tick of the last good input,
    /// [`NO_TICK`] before the first.
    pub fn judge(
        &mut self,
        step: &Step,
        input: &Input,
        plausible: bool,
        used: u64,
        flags: &mut u64,
    ) -> Verdict {
        if step.caught_up {
            *flags |= model_flags::CAUGHT_UP;
        }
        let refused = input.fresh() && !plausible;
        if input.fresh() && plausible {
            return Verdict::Good;
        }
        self.held_count += 1;
        *flags |= if refused { model_flags::REFUSED_INPUT } else { model_flags::HELD_INPUT };
        let age = if used == NO_TICK { u64::MAX } else { step.n.saturating_sub(used) };
        if age >= self.stale_after {
            *flags |= model_flags::STALE;
            return Verdict::Stale;
        }
        Verdict::Hold
    }

    /// Inputs held or refused since the start.
    pub fn held_count(&self) -> u64 {
        self.held_count
    }

    /// For a restart.
    pub fn restore(&mut self, held_count: u64) {
        self.held_count = held_count;
    }
}
