//! Manoeuvres: driver inputs over time, recorded histories, speed control.
