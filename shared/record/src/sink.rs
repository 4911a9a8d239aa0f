//! The file under a log writer. What reaches it is at every moment a prefix of the log.
//!
//! A disk that refuses bytes must not cost what was written before, nor stop the caller: refused bytes are
//! kept up to [`BACKLOG_BYTES`] and tried again with the next flush, so that a disk that is full for a while
//! leaves no gap. Past that bound the sink is closed for good; the file then ends in the middle of a record,
//! as after a crash, and reads the same way.

use std::collections::VecDeque;
use std::io::{self, Seek, SeekFrom, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most bytes kept while the disk refuses them: at 3 MB/s about twenty seconds.
pub const BACKLOG_BYTES: usize = 64 << 20;
/// Bytes collected before they are handed to the system without a flush.
const COLLECT_BYTES: usize = 256 << 10;

/// What a log is written to.
pub(crate) trait Medium: Write + Send {
    /// Waits until the bytes survive loss of power.
    fn sync_data(&self) -> io::Result<()>;
    /// How many names the file has in its directories; `None` when that cannot be told.
    fn links(&self) -> Option<u64> {
        None
    }
}

impl Medium for std::fs::File {
    fn sync_data(&self) -> io::Result<()> {
        std::fs::File::sync_data(self)
    }

    fn links(&self) -> Option<u64> {
        use std::os::unix::fs::MetadataExt;
        self.metadata().ok().map(|data| data.nlink())
    }
}

/// A writer that never loses the order of bytes and never fails before its backlog is full.
pub(crate) struct Sink<F: Write> {
    file: F,
    pending: VecDeque<u8>,
    position: u64,
    backlog: usize,
    closed: bool,
    /// Attempts that the system refused.
    pub errors: u64,
    /// What it said last.
    pub last_error: Option<String>,
}

impl<F: Write> Sink<F> {
    pub fn new(file: F, backlog: usize) -> Self {
        Sink {
            file,
            pending: VecDeque::with_capacity(2 * COLLECT_BYTES),
            position: 0,
            backlog,
            closed: false,
            errors: 0,
            last_error: None,
        }
    }

    /// Bytes handed in so far, written or not.
    pub fn position(&self) -> u64 {
        self.position
    }

    /// Bytes not yet accepted by the system.
    pub fn pending(&self) -> usize {
        self.pending.len()
    }

    /// Hands as much to the system as it takes. True when nothing is left over.
    pub fn drain(&mut self) -> bool {
        while !self.pending.is_empty() && !self.closed {
            match self.file.write(self.pending.as_slices().0) {
                Ok(0) => {
                    self.refused("the file takes no more bytes".to_owned());
                    return false;
                }
                Ok(taken) => drop(self.pending.drain(..taken)),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => {
                    self.refused(error.to_string());
                    return false;
                }
            }
        }
        self.pending.is_empty()
    }

    fn refused(&mut self, reason: String) {
        self.errors += 1;
        self.last_error = Some(reason);
    }

    pub fn file(&self) -> &F {
        &self.file
    }
}

/// A sink held by the MCAP library, which lends it to nobody, and by the log writer, which asks how it is.
pub(crate) struct SharedSink<F: Write>(Arc<Mutex<Sink<F>>>);

impl<F: Write> SharedSink<F> {
    pub fn new(sink: Sink<F>) -> Self {
        SharedSink(Arc::new(Mutex::new(sink)))
    }

    pub fn lock(&self) -> MutexGuard<'_, Sink<F>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<F: Write> Clone for SharedSink<F> {
    fn clone(&self) -> Self {
        SharedSink(Arc::clone(&self.0))
    }
}

impl<F: Write> Write for SharedSink<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.lock().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lock().flush()
    }
}

impl<F: Write> Seek for SharedSink<F> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.lock().seek(to)
    }
}

impl<F: Write> Write for Sink<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.closed || self.pending.len() + bytes.len() > self.backlog {
            self.closed = true;
            return Err(io::Error::new(io::ErrorKind::StorageFull, "the log's backlog is full"));
        }
        self.pending.extend(bytes);
        self.position += bytes.len() as u64;
        // After a refusal only a flush tries again: else every message would be another refused attempt.
        if self.pending.len() >= COLLECT_BYTES && self.last_error.is_none() {
            self.drain();
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.drain() {
            self.last_error = None;
        }
        Ok(())
    }
}

impl<F: Write> Seek for Sink<F> {
    /// Tells the position; a log is never rewritten.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.position),
            _ => Err(io::Error::from(io::ErrorKind::Unsupported)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk with room for so many bytes.
    struct Disk {
        bytes: Vec<u8>,
        room: usize,
    }

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let taken = bytes.len().min(self.room - self.bytes.len());
            if taken == 0 && !bytes.is_empty() {
                return Err(io::Error::from(io::ErrorKind::StorageFull));
            }
            self.bytes.extend_from_slice(&bytes[..taken]);
            Ok(taken)
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_disk_full_for_a_while_costs_nothing() {
        let mut sink = Sink::new(Disk { bytes: Vec::new(), room: 10 }, 1000);
        let all: Vec<u8> = (0..100).collect();
        for part in all.chunks(7) {
            assert_eq!(sink.write(part).unwrap(), part.len());
            sink.flush().unwrap();
        }
        assert_eq!(sink.file.bytes, all[..10], "what fitted is a prefix");
        assert_eq!(sink.pending(), 90);
        assert!(sink.errors > 5);
        sink.file.room = 1000;
        sink.flush().unwrap();
        assert_eq!(sink.file.bytes, all);
        assert_eq!((sink.pending(), sink.position()), (0, 100));
    }

    #[test]
    fn a_full_backlog_closes_the_sink_and_keeps_a_prefix() {
        let mut sink = Sink::new(Disk { bytes: Vec::new(), room: 10 }, 50);
        let all: Vec<u8> = (0..100).collect();
        let accepted =
            all.chunks(7).take_while(|part| sink.write(part).and_then(|_| sink.flush()).is_ok()).count();
        assert!(accepted < 14);
        sink.file.room = 1000;
        assert!(sink.write(&[1]).is_err(), "bytes after a gap would be no log");
        assert!(!sink.drain());
        assert_eq!(sink.file.bytes, all[..10]);
    }
}
