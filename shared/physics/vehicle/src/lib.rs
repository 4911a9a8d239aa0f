//! The 27-freedom car: chassis, driveline, brakes, environment.
