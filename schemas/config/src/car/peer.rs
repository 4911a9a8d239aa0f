//! Simplifications of other people's vehicle models, to be switched on in a car that is matched to one of them.
//!
//! A comparison shows what it should only where both models say the same; where a peer leaves something out, its
//! omission is switched here by name, so that each remaining difference can be told by switching it off.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the model that a car is matched to leaves out or does in its own way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PeerModel {
    /// The constant and load shifts of the lateral force (PHY1, PVY1) take the sign of the inclination: written for a wheel
    /// that leans right, reversed on one that leans left.
    pub shifts_follow_inclination: bool,
    /// Inclination over which that change of sign is spread, either side of zero; a peer's step at zero lets its car
    /// hunt about straight running. [rad], [0, 0.1]
    #[schemars(range(min = 0.0, max = 0.1))]
    pub shift_transition_rad: f64,
    /// No gyroscopic moments of the wheels' spin on body and knuckles.
    pub no_gyroscopic_moments: bool,
    /// Slip angles from the lateral velocity of the sprung centre of gravity (and the roll of the axle about the wheel
    /// centres) instead of that of the contact: the body's roll does not move the contacts sideways.
    pub slip_at_centre_of_gravity: bool,
    /// Rigid axles: lateral forces and overturning couples of both tyres act on the axle as a whole, half of each on each
    /// wheel's travel.
    pub rigid_axles: bool,
    /// Springs act on body and axle at the same distance from the middle, though roll about an axis on the road shifts one
    /// against the other by the wheel centres' height times the roll angle: weight times that shift is missing from
    /// the moments on body and axle.
    pub springs_without_side_shift: bool,
    /// Yaw moments are about the sprung centre of gravity as if it were the whole car's: the unsprung masses, though they
    /// weigh on their axles, have no lateral inertia about it. Motion is told at that point.
    pub yaw_about_sprung_centre: bool,
    /// The tyres' inclination is the body's roll and a share of the front wheels' travel, whatever the wheel's
    /// attitude is (for peers whose axle stays upright while its tyres lean). Absent: the wheel's own. [rad/m], [-3, 3]
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -3.0, max = 3.0))]
    pub front_inclination_per_travel_rad_m: Option<f64>,
    /// The same at the rear. [rad/m], [-3, 3]
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -3.0, max = 3.0))]
    pub rear_inclination_per_travel_rad_m: Option<f64>,
}
