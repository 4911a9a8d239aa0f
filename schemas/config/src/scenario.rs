//! The scenario: which car, rig and manoeuvre, for how long.
