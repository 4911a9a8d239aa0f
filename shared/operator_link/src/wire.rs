//! Requests and answers. Postcard-encoded: both ends are of one version, as the table's layouts are.

use params::{Change, Refusal, Setting};
use serde::{Deserialize, Serialize};

/// What an operator asks for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// All parameters with their values.
    List,
    /// Changes of parameters, all or none.
    Set {
        /// Path and value.
        settings: Vec<(String, Setting)>,
        /// Who asks, for the log.
        source: String,
    },
    /// Take the last change back.
    Undo {
        /// Who asks, for the log.
        source: String,
    },
    /// A human's steering; must be repeated at least every half second, else the manoeuvre takes over again.
    Steer {
        /// 0 give back to the manoeuvre, 1 by angle, 2 by torque.
        mode: u8,
        /// Hand-wheel angle, left positive. \[rad\]
        angle_rad: f64,
        /// Hand-wheel torque, left positive. \[N·m\]
        torque_n_m: f64,
    },
    /// Something the bench should do.
    Operate(Operation),
}

/// What the bench should do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Operation {
    /// Get ready.
    Arm,
    /// Fade in and start the manoeuvre's clock.
    Start,
    /// Fade out.
    Stop,
    /// Acknowledge a trip.
    Acknowledge,
    /// Press the emergency stop.
    EmergencyStop,
    /// Release it; the trip stays until it is acknowledged.
    ReleaseEmergencyStop,
    /// End the run.
    End,
}

/// One parameter with its value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Path.
    pub path: String,
    /// Value in force.
    pub value: f64,
    /// Value of the configuration.
    pub default: f64,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Why it cannot be changed on this bench; empty where it can.
    pub fixed: String,
}

/// What the supervisor answers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Answer {
    /// All parameters.
    Parameters {
        /// Version in force.
        version: u64,
        /// Changes that can be undone.
        undo_depth: u64,
        /// In the order of the list.
        entries: Vec<Entry>,
    },
    /// Changed.
    Changed {
        /// The new version.
        version: u64,
        /// Tick in which it was put into the table; the services take it over at their next tick.
        tick: u64,
        /// What changed.
        changes: Vec<Change>,
    },
    /// Passed on to the rig.
    Done {
        /// Tick in which it was put into the table.
        tick: u64,
    },
    /// Refused, with every reason.
    Refused(Vec<Refusal>),
}

impl Answer {
    /// A refusal of something that is no parameter.
    pub fn refused(what: &str, reason: impl Into<String>) -> Answer {
        Answer::Refused(vec![Refusal { path: what.to_owned(), reason: reason.into() }])
    }
}
