//! One axle: the suspension's named hardpoints, its type, springs, friction and compliance.
