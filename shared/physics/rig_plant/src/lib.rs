//! The virtual rig: actuators, linkage, sensors, steering unit.
