//! The console: a small web server that shows a bench, live or from a log, and passes on what an operator asks.
//!
//! It is a reader of the table, read-only, away from the real-time cores and with low priority. What writes
//! (parameters, arming, steering, starting a run) goes over the operator's link to the supervisor, which
//! checks it, and needs the token that only whoever started the console knows. Everything the page needs is
//! inside the executable: it works offline.
//!
//! Who may connect: requests whose `Host` is one the console listens as (against rebinding of names), and
//! WebSockets whose `Origin` is that host. Messages are at most [`session::MESSAGE_MAX`] long. Each client has a
//! task of its own that reads the table when it sends: one that stops reading waits for itself alone, and
//! gets the present, not the past, when it reads again.

mod door;
mod hub;
mod message;
mod operator;
mod page;
mod replay;
mod runs;
mod server;
mod session;
mod signals;
mod source;
mod token;

pub use door::{Door, ServeError};
pub use hub::keep_off;
pub use operator::Operator;
pub use server::{Console, Options};
pub use session::MESSAGE_MAX;
pub use token::Token;
