//! An FMU in a process of its own, asked step by step over a socket: for runs in one process and for checks, so that
//! an FMU that crashes or hangs takes nothing with it.
//!
//! The child has the socket as its standard input; what the FMU prints goes where the child's standard error goes.
//! First a [`Setup`] as JSON behind its length, then for each step time, step and inputs (little-endian doubles); back
//! comes a status byte, cost and outputs, or a text. Each question has one answer, so that runs are repeatable.

use crate::FmuError;
use crate::bind::Setup;
use crate::runner::{Cost, Runner, Stepper};
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Longest message of words. [bytes]
const WORDS_MAX: usize = 16 << 20;
/// How long a process may take to end once its socket is shut.
const END_MAX: Duration = Duration::from_millis(500);

/// An FMU hosted by a child process.
#[derive(Debug)]
pub struct Hosted {
    child: Child,
    socket: UnixStream,
    patience: Duration,
    outgoing: Vec<u8>,
    incoming: Vec<u8>,
}

impl Hosted {
    /// Starts `executable arguments…` and has it load and initialise the FMU. Each answer is waited for at most
    /// `patience`.
    ///
    /// # Errors
    /// [`FmuError`], as the child tells it, or that it died or hung.
    pub fn start(
        executable: &Path,
        arguments: &[&str],
        setup: &Setup,
        patience: Duration,
    ) -> Result<Self, FmuError> {
        let io = |e: std::io::Error| FmuError::Io { path: executable.to_owned(), why: e.to_string() };
        let (socket, theirs) = UnixStream::pair().map_err(io)?;
        socket.set_read_timeout(Some(patience)).map_err(io)?;
        socket.set_write_timeout(Some(patience)).map_err(io)?;
        let child = Command::new(executable)
            .args(arguments)
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .stdout(std::io::stderr())
            .spawn()
            .map_err(io)?;
        let values = 2 + setup.inputs.len();
        let mut hosted = Hosted {
            child,
            socket,
            patience,
            outgoing: vec![0; 8 * values],
            incoming: vec![0; 8 * (2 + setup.outputs.len())],
        };
        let text = serde_json::to_vec(setup).unwrap_or_default();
        let sent = put_words(&mut hosted.socket, &text);
        sent.map_err(|e| hosted.lost(&e))?;
        hosted.verdict()?;
        Ok(hosted)
    }

    /// Reads the status of an answer.
    fn verdict(&mut self) -> Result<(), FmuError> {
        let mut status = [0];
        self.socket.read_exact(&mut status).map_err(|e| self.lost(&e))?;
        if status[0] == 0 {
            return Ok(());
        }
        let text = get_words(&mut self.socket).map_err(|e| self.lost(&e))?;
        Err(FmuError::Told { text: String::from_utf8_lossy(&text).into_owned() })
    }

    /// Why there is no answer.
    fn lost(&mut self, error: &std::io::Error) -> FmuError {
        if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) {
            let _ = self.child.kill();
            let _ = self.child.wait();
            return FmuError::Hung { waited_ms: self.patience.as_millis() as u64 };
        }
        let end = self.wait();
        FmuError::Died { how: end.map_or_else(|| error.to_string(), how) }
    }

    fn wait(&mut self) -> Option<ExitStatus> {
        let limit = Instant::now() + END_MAX;
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return Some(status),
                Ok(None) if Instant::now() < limit => std::thread::sleep(Duration::from_millis(1)),
                _ => {
                    let _ = self.child.kill();
                    return self.child.wait().ok();
                }
            }
        }
    }
}

/// How a process ended, in words.
fn how(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (_, Some(signal)) => {
            let name = match signal {
                libc::SIGSEGV => " (segmentation fault)",
                libc::SIGABRT => " (abort)",
                libc::SIGFPE => " (arithmetic exception)",
                libc::SIGILL => " (illegal instruction)",
                libc::SIGBUS => " (bus error)",
                libc::SIGKILL => " (kill)",
                _ => "",
            };
            format!("signal {signal}{name}")
        }
        (Some(code), _) => format!("exit status {code}"),
        _ => "ended".to_owned(),
    }
}

impl Stepper for Hosted {
    fn step(
        &mut self,
        time_s: f64,
        step_s: f64,
        inputs: &[f64],
        outputs: &mut [f64],
    ) -> Result<Cost, FmuError> {
        let values = [time_s, step_s].into_iter().chain(inputs.iter().copied());
        for (place, value) in self.outgoing.chunks_exact_mut(8).zip(values) {
            place.copy_from_slice(&value.to_le_bytes());
        }
        let sent = self.socket.write_all(&self.outgoing);
        sent.map_err(|e| self.lost(&e))?;
        self.verdict()?;
        let read = self.socket.read_exact(&mut self.incoming);
        read.map_err(|e| self.lost(&e))?;
        let mut words = self.incoming.chunks_exact(8).map(|chunk| {
            let mut bytes = [0; 8];
            bytes.copy_from_slice(chunk);
            bytes
        });
        let mut next = || words.next().unwrap_or_default();
        let cost = Cost { seconds: f64::from_le_bytes(next()), allocations: u64::from_le_bytes(next()) };
        for output in outputs {
            *output = f64::from_le_bytes(next());
        }
        Ok(cost)
    }
}

impl Drop for Hosted {
    fn drop(&mut self) {
        // The child ends by itself when its socket is shut: an FMU is freed in order.
        let _ = self.socket.shutdown(std::net::Shutdown::Both);
        let _ = self.wait();
    }
}

fn put_words(socket: &mut UnixStream, words: &[u8]) -> std::io::Result<()> {
    socket.write_all(&(words.len() as u64).to_le_bytes())?;
    socket.write_all(words)
}

fn get_words(socket: &mut UnixStream) -> std::io::Result<Vec<u8>> {
    let mut length = [0; 8];
    socket.read_exact(&mut length)?;
    let length = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX);
    if length > WORDS_MAX {
        return Err(std::io::Error::other("a message too long"));
    }
    let mut words = vec![0; length];
    socket.read_exact(&mut words)?;
    Ok(words)
}

/// The child's side: runs until the socket is shut. `allocations` gives a running count of this process's heap calls.
///
/// # Errors
/// What the socket says.
pub fn serve(mut socket: UnixStream, allocations: fn() -> u64) -> std::io::Result<()> {
    let Ok(words) = get_words(&mut socket) else { return Ok(()) };
    let setup: Setup = serde_json::from_slice(&words).map_err(std::io::Error::other)?;
    let mut runner = match Runner::new(&setup) {
        Ok(runner) => runner,
        Err(error) => return answer(&mut socket, &error),
    };
    socket.write_all(&[0])?;
    let mut question = vec![0; 8 * (2 + setup.inputs.len())];
    let mut values = vec![0.0; 2 + setup.inputs.len()];
    let mut outputs = vec![0.0; setup.outputs.len()];
    let mut reply = vec![0; 1 + 8 * (2 + setup.outputs.len())];
    while socket.read_exact(&mut question).is_ok() {
        for (value, chunk) in values.iter_mut().zip(question.as_chunks::<8>().0) {
            *value = f64::from_le_bytes(*chunk);
        }
        let (count, start) = (allocations(), Instant::now());
        let stepped = runner.step(values[0], values[1], &values[2..], &mut outputs);
        let (seconds, count) = (start.elapsed().as_secs_f64(), allocations().wrapping_sub(count));
        if let Err(error) = stepped {
            return answer(&mut socket, &error);
        }
        reply[0] = 0;
        let all = [seconds.to_le_bytes(), count.to_le_bytes()]
            .into_iter()
            .chain(outputs.iter().map(|output| output.to_le_bytes()));
        for (place, bytes) in reply[1..].as_chunks_mut::<8>().0.iter_mut().zip(all) {
            *place = bytes;
        }
        socket.write_all(&reply)?;
    }
    Ok(())
}

fn answer(socket: &mut UnixStream, error: &FmuError) -> std::io::Result<()> {
    socket.write_all(&[1])?;
    put_words(socket, error.to_string().as_bytes())
}
