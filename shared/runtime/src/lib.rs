//! Nodes and ticks: lockstep, paced with output phase, deadlines, real-time threads.
