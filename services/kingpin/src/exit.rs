//! Exit codes, the same for every command and documented in the README.

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// As asked.
    Done,
    /// The run ended, but not as planned: tripped, a service given up, ticks lost, a comparison that differs.
    Failed,
    /// Wrong input: a file, a key, a value, an argument. Nothing was started.
    BadInput,
    /// The bench is in use, or the host refuses what is needed.
    Unavailable,
    /// Ended early by the user; the rig was stopped safely.
    Interrupted,
}

/// The text for `--help`.
pub const TABLE: &str = "\
Exit codes:
    0  done as asked
    1  ended, but not as planned (tripped, service given up, ticks lost, logs differ)
    2  wrong input: a file, key, value or argument; nothing was started
    3  not available: the bench is in use, or the host refused memory, files or processes
  130  ended early by Ctrl-C; the rig was stopped safely";

impl From<Exit> for std::process::ExitCode {
    fn from(exit: Exit) -> Self {
        std::process::ExitCode::from(match exit {
            Exit::Done => 0,
            Exit::Failed => 1,
            Exit::BadInput => 2,
            Exit::Unavailable => 3,
            Exit::Interrupted => 130,
        })
    }
}
