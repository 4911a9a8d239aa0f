//! From configuration to nodes: the only place that knows physics, regions and runtime.
