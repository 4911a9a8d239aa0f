//! The 27-freedom car: chassis, driveline, brakes, environment.
//!
//! Reading order: [`Vehicle`] (`vehicle`), what goes in and out (`io`), then its parts: kinematics maps
//! (`kinematics`), wheel stations and contacts (`station`), equations of motion (`chassis`), suspension forces
//! (`suspension`), `driveline`, `brakes`, `aerodynamics`, `hull`, `steering`, `speed_control`, start (`settle`), named variables and
//! imports (`variables`), runs from tables (`simulate`), simplifications of other models (`peer`).
//! Axes ISO 8855, SI units. Sees configuration and tyres only: no file, no clock, no heap in a step.

mod aerodynamics;
mod brakes;
mod chassis;
mod curve;
mod driveline;
mod hull;
mod io;
pub mod kinematics;
mod outputs;
mod peer;
mod settle;
mod simulate;
mod speed_control;
mod state;
mod station;
mod steering;
mod suspension;
mod variables;
mod vehicle;

pub use driveline::{DriveDemand, OutsideDrive};
pub use io::{GearMode, RoadContact, VehicleInput, VehicleOutput, WHEELS, WheelOutput};
pub use kinematics::{
    AxleKinematics, Grid, KingpinAxis, KnuckleMap, KnucklePose, KnuckleSample, knuckle_matrix,
};
pub use simulate::{SimulateError, simulate_csv};
pub use variables::{ExportId, Exports, ImportId, ImportMode, Imports, Variable};
pub use vehicle::{GRAVITY_M_S2, Vehicle};
