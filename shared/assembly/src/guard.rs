//! What a model makes of an input that did not come, is too old or says nonsense.
//!
//! Fresh and plausible: used. Missing for less than the limit, or implausible: the last good value is used
//! and flagged. Older than the limit: the model holds its last outputs and flags them (spec 1.5).

use regions::model_flags;
use runtime::{Input, Step};

/// Judges one input.
#[derive(Debug, Clone, Copy)]
pub struct Guard {
    stale_after: u64,
    refused_in_row: u64,
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
        Guard { stale_after: u64::from(stale_after), refused_in_row: 0, held_count: 0 }
    }

    /// Judges the input of a step; sets the flags that go with the verdict.
    pub fn judge(&mut self, step: &Step, input: &Input, plausible: bool, flags: &mut u64) -> Verdict {
        if step.caught_up {
            *flags |= model_flags::CAUGHT_UP;
        }
        let refused = input.fresh() && !plausible;
        self.refused_in_row = if refused { self.refused_in_row + 1 } else { 0 };
        if input.fresh() && plausible {
            return Verdict::Good;
        }
        self.held_count += 1;
        *flags |= if refused { model_flags::REFUSED_INPUT } else { model_flags::HELD_INPUT };
        if input.age(step.n).max(self.refused_in_row) >= self.stale_after {
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
        self.refused_in_row = 0;
    }
}
