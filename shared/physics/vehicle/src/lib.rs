//! The 27-freedom car: chassis, driveline, brakes, environment.
//!
//! Reading order: [`Vehicle`] (`vehicle`), what goes in and out (`io`), then its parts: kinematics maps
//! (`kinematics`), wheel stations and contacts (`station`), equations of motion (`chassis`), suspension forces
//! (`suspension`), `driveline`, `brakes`, `aerodynamics`, `steering`, `speed_control`, start (`settle`).
//! Axes ISO 8855, SI units. Sees configuration and tyres only: no file, no clock, no heap in a step.

mod aerodynamics;
mod brakes;
mod chassis;
mod curve;
mod driveline;
mod io;
pub mod kinematics;
mod outputs;
mod settle;
mod speed_control;
mod state;
mod station;
mod steering;
mod suspension;
mod vehicle;

pub use io::{GearMode, RoadContact, VehicleInput, VehicleOutput, WHEELS, WheelOutput};
pub use kinematics::{
    AxleKinematics, Grid, KingpinAxis, KnuckleMap, KnucklePose, KnuckleSample, knuckle_matrix,
};
pub use vehicle::{GRAVITY_M_S2, Vehicle};
