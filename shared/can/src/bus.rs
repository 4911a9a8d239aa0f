//! What a bus is: frames go out, frames come in, nothing waits.

use crate::frame::Frame;

/// What went wrong on a bus.
#[derive(Debug)]
pub enum BusError {
    /// The queue towards the bus is full: nobody acknowledges, or too much is sent.
    Full,
    /// The interface is gone or down, or refuses this kind of frame.
    Io(std::io::Error),
}

impl std::fmt::Display for BusError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            BusError::Full => write!(f, "the CAN interface's queue is full: is anybody else on the bus?"),
            BusError::Io(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for BusError {}

/// Something that came from a bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A data frame.
    Frame(Frame),
    /// An error frame of the controller: its class bits (`linux/can/error.h`).
    Error(u32),
}

/// A bus. Neither sending nor receiving waits.
pub trait Bus: Send {
    /// Hands a frame to the bus.
    ///
    /// # Errors
    /// [`BusError`]; the frame is lost.
    fn send(&mut self, frame: &Frame) -> Result<(), BusError>;

    /// The next thing that came, if any.
    ///
    /// # Errors
    /// [`BusError`].
    fn receive(&mut self) -> Result<Option<Event>, BusError>;

    /// Lets whoever lives on a bus in memory act, up to `now`. [ns]
    fn advance(&mut self, now_ns: u64) {
        let _ = now_ns;
    }

    /// Whether this is a bus in memory.
    fn in_memory(&self) -> bool {
        false
    }
}

/// Room for frames, first in, first out; allocated once.
#[derive(Debug, Clone)]
pub struct Queue {
    frames: std::collections::VecDeque<(u64, Frame)>,
    room: usize,
}

impl Queue {
    /// For at most `room` frames.
    pub fn new(room: usize) -> Self {
        Queue { frames: std::collections::VecDeque::with_capacity(room), room }
    }

    /// Appends a frame that is due at an instant; `false` when it is full.
    pub fn push(&mut self, due_ns: u64, frame: Frame) -> bool {
        let fits = self.frames.len() < self.room;
        if fits {
            self.frames.push_back((due_ns, frame));
        }
        fits
    }

    /// Takes the first frame if it is due.
    pub fn pop(&mut self, now_ns: u64) -> Option<Frame> {
        if self.frames.front().is_some_and(|(due, _)| *due <= now_ns) {
            self.frames.pop_front().map(|(_, frame)| frame)
        } else {
            None
        }
    }
}
