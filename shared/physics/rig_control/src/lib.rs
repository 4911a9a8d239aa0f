//! The rig's controller: inner loops, feed-forward, delay compensation, force conversion.
