//! Rigid multibody systems: constraints, kinematics, reactions, dynamics, suspensions.
