//! The rig: actuators, linkage, sensors, control, limits.
