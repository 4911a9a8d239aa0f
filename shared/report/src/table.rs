//! Names of the codes and bits that regions carry.

use regions::{model_flags, rig_flags};

/// Bench states by code.
pub const STATES: [&str; 9] =
    ["off", "idle", "armed", "starting", "running", "holding", "resuming", "stopping", "tripped"];

/// Code of the tripped state.
pub(crate) const TRIPPED: u64 = 8;

/// Name of a bench state.
pub(crate) fn state_name(code: u64) -> String {
    STATES.get(code as usize).map_or_else(|| format!("state {code}"), |name| (*name).to_owned())
}

/// Bits that say something went wrong or was bridged, by region: bit, short name.
pub(crate) const RIG_BITS: [(u64, &str); 4] = [
    (rig_flags::LATE_COMMAND, "late command"),
    (rig_flags::REFUSED_COMMAND, "refused command"),
    (rig_flags::STALLED, "rig stalled"),
    (rig_flags::NO_SUPERVISOR, "no supervisor"),
];

/// The same for the models' regions.
pub(crate) const MODEL_BITS: [(u64, &str); 9] = [
    (model_flags::HELD_INPUT, "held input"),
    (model_flags::REFUSED_INPUT, "refused input"),
    (model_flags::CAUGHT_UP, "caught up"),
    (model_flags::HELD_POSE, "held pose"),
    (model_flags::RESTORED, "restored"),
    (model_flags::MODEL_FAULT, "model fault"),
    (model_flags::STALE, "stale"),
    (model_flags::EQUATION_FAULT, "equation without a finite result"),
    (model_flags::OFF_SURFACE, "beyond the road's surface"),
];

/// Bits of a region and what they are called.
type Bits = &'static [(u64, &'static str)];

/// Region, prefix of the names of its bits, bits.
pub(crate) const FLAGGED: [(&str, &str, Bits); 3] = [
    ("rig_status", "rig", &RIG_BITS),
    ("vehicle_state", "vehicle", &MODEL_BITS),
    ("suspension_state", "multibody", &MODEL_BITS),
];
