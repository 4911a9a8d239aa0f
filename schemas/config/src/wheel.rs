//! A human's wheel device: where its events come from, and how they are scaled.
//!
//! The device's angle goes the way of the steer actuator's command; the measured steering torque goes back to the
//! device as a constant force.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A wheel device at the bench.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WheelInput {
    /// Where the events come from.
    pub source: WheelSource,
    /// Hand-wheel angle at either end of the device's axis. [rad], (0, 20]
    #[schemars(range(max = 20.0), extend("exclusiveMinimum" = 0.0))]
    pub angle_at_end_rad: f64,
    /// Steering torque that becomes the device's full force. [N·m], (0, 50]
    #[schemars(range(max = 50.0), extend("exclusiveMinimum" = 0.0))]
    pub torque_at_full_force_n_m: f64,
    /// Corner of the filter that makes the device's steps smooth, and its rate. [rad/s], [5, 500]
    #[schemars(range(min = 5.0, max = 500.0))]
    pub smoothing_rad_s: f64,
}

/// Where wheel events come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum WheelSource {
    /// A Linux input device.
    Evdev {
        /// Device file, for example `/dev/input/by-id/usb-...-event-joystick`.
        device: String,
    },
    /// Recorded events, played back in time: a CSV with the columns `time_s` and `position` (-1 to 1, + left).
    Recorded {
        /// CSV file, relative to the directory of the command.
        file: String,
    },
}
