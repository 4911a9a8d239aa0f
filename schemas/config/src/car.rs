//! The car: masses, suspension characteristics, tyres, driveline, brakes, aerodynamics.
