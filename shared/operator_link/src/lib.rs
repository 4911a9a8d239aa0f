//! The operator's link to a running bench: requests and answers between the supervisor and whoever operates
//! it (command line, console), as iceoryx2 request-response with postcard inside. Never on the 1 ms path.
//!
//! Each bench has its own iceoryx2 domain: a prefix in shared memory and a root directory inside the bench's
//! own, mode 0700, so that only the same user can ask. The supervisor polls its [`Server`] a few hundred
//! times a second; a [`Client`] waits for its answer for a bounded time. Who was killed in the middle is
//! cleaned up by the next node that comes; [`remove_left_over`], under the bench's lock, removes all the rest.

mod client;
mod domain;
mod server;
mod wire;

pub use client::Client;
pub use domain::remove_left_over;
pub use server::Server;
pub use wire::{Answer, Entry, Operation, Request};

/// Why the link does not work.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LinkError {
    /// No supervisor answers: the bench is not running, or belongs to another user.
    NobodyThere {
        /// The bench.
        bench: String,
    },
    /// No answer in time.
    TimedOut {
        /// How long was waited. \[ms\]
        waited_ms: u64,
    },
    /// Something that this version does not understand.
    Garbled(String),
    /// iceoryx2 refused.
    Transport(String),
}

impl std::fmt::Display for LinkError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            LinkError::NobodyThere { bench } => {
                write!(
                    f,
                    "bench {bench} takes no requests: it is not running in real time, or is another user's"
                )
            }
            LinkError::TimedOut { waited_ms } => {
                write!(f, "the supervisor did not answer within {waited_ms} ms")
            }
            LinkError::Garbled(what) => write!(f, "not understood: {what}"),
            LinkError::Transport(what) => write!(f, "the link failed: {what}"),
        }
    }
}

impl std::error::Error for LinkError {}

/// Longest request. \[B\]
pub const REQUEST_MAX: usize = 16 * 1024;
