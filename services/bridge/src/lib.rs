//! The bridge: a live bench for programs that speak the Foxglove WebSocket protocol (Foxglove, Lichtblick, PlotJuggler).
//!
//! Each region of the table is a channel with the same topic, schema (`ros2msg`), encoding (CDR) and time stamps as
//! in the log. A client gets every tick of what it subscribes to, in bursts at [`session::BEAT_HZ`]; the live
//! parameters are the protocol's parameters.
//!
//! It is a reader of the table, read-only, off the real-time cores and with low priority, as the console is. Setting
//! a parameter goes over the operator's link to the supervisor and needs the token, in the address
//! (`ws://127.0.0.1:8765/?token=…`). Pages in a browser say where they come from: those from elsewhere than this
//! machine are let in only if they were named at the start.
//!
//! Protocol: Foxglove WebSocket protocol, subprotocols `foxglove.sdk.v1` and `foxglove.websocket.v1`. It is spoken
//! here on the console's own web server rather than through the `foxglove` crate, because that one has neither
//! a token nor a check of the origin, and leaves Nagle's algorithm on, which delays messages by up to 40 ms.

mod protocol;
mod server;
mod session;
mod source;

pub use server::{Bridge, Options};
pub use session::{BEAT_HZ, MESSAGE_MAX};
