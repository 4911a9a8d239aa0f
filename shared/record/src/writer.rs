//! Writing a log. For a process of its own: it allocates and it waits for the disk.
//!
//! Chunks are lz4-compressed, at most 256 KiB, and put together in memory, so that the file only ever grows
//! by whole chunks. [`LogWriter::flush`] ends a chunk and hands it to the system: called every 50 ms, a kill
//! at any point loses at most those 50 ms. Against loss of power only [`LogWriter::sync`] helps.
//! Writing has no error to handle: what the disk refused is counted in [`WriteStats`].

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::{Seek, Write};
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use mcap::{Attachment, Compression, WriteOptions, Writer};
use regions::{ALL, Kind, REGIONS, Region, RegionId};

use crate::error::LogError;
use crate::header::{CONFIGURATION_ATTACHMENT, HEADER_ATTACHMENT, LogHeader, METADATA_NAME, SOURCE_PREFIX};
use crate::sink::{BACKLOG_BYTES, Medium, SharedSink, Sink};

/// Topic of the events.
pub const EVENTS_TOPIC: &str = "/events";
/// Uncompressed size of a chunk. [B]
const CHUNK_BYTES: u64 = 256 << 10;
/// CDR, little endian, no options.
pub(crate) const CDR_HEADER: [u8; 4] = [0, 1, 0, 0];
/// Words a message's buffer starts with; it grows once if a region has more.
const WORDS_TYPICAL: usize = 1024;

pub(crate) const EVENT_SCHEMA: &str = r#"{"type":"object","properties":{"tick":{"type":"integer"},"time_s":{"type":"number"},"kind":{"type":"string"},"detail":{}},"required":["tick","time_s","kind","detail"]}"#;

/// What a writer did so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WriteStats {
    /// Region messages accepted.
    pub messages: u64,
    /// Events accepted.
    pub events: u64,
    /// Messages and events refused: wrong length, or the disk stayed full for too long.
    pub refused: u64,
    /// Attempts to write that the system refused.
    pub write_errors: u64,
    /// Bytes of the log so far, as in the file.
    pub bytes: u64,
    /// Bytes that wait for a disk that refused them.
    pub pending_bytes: u64,
}

/// A log being written.
pub struct LogWriter {
    path: PathBuf,
    // None once a write has failed for good: nothing may follow a gap.
    writer: Option<Writer<SharedSink<Box<dyn Medium>>>>,
    sink: SharedSink<Box<dyn Medium>>,
    channels: [u16; REGIONS.len()],
    events_channel: u16,
    header: LogHeader,
    buffer: Vec<u8>,
    stats: WriteStats,
    sequence: u32,
}

impl LogWriter {
    /// Makes a new log with its header, configuration and the definitions of all regions, already flushed.
    ///
    /// # Errors
    /// [`LogError::Exists`] for anything that is there already, [`LogError::Io`] if the file cannot be made
    /// or its head cannot be written.
    pub fn create(path: &Path, header: &LogHeader) -> Result<LogWriter, LogError> {
        // create_new also refuses a dangling symbolic link and whatever else has the name.
        let file = OpenOptions::new().write(true).create_new(true).open(path).map_err(|error| match error
            .kind()
        {
            std::io::ErrorKind::AlreadyExists => LogError::Exists(path.to_owned()),
            _ => LogError::io(path, "create the log", error),
        })?;
        let made = Self::create_on(Box::new(file), BACKLOG_BYTES, path, header);
        if made.is_err() {
            // A head that could not be written is no log: leave nothing half-written. Best effort.
            let _ = std::fs::remove_file(path);
        }
        made
    }

    fn create_on(
        medium: Box<dyn Medium>,
        backlog: usize,
        path: &Path,
        header: &LogHeader,
    ) -> Result<LogWriter, LogError> {
        let sink = SharedSink::new(Sink::new(medium, backlog));
        let failed = |error: mcap::McapError| {
            LogError::io(path, "write the head of the log", std::io::Error::other(error.to_string()))
        };
        let mut writer = write_options().create(sink.clone()).map_err(failed)?;
        put_header(&mut writer, header).map_err(failed)?;
        let mut channels = [0; REGIONS.len()];
        for id in ALL {
            channels[id as usize] = add_region(&mut writer, id.region()).map_err(failed)?;
        }
        let schema =
            writer.add_schema("kingpin.Event", "jsonschema", EVENT_SCHEMA.as_bytes()).map_err(failed)?;
        let events_channel =
            writer.add_channel(schema, EVENTS_TOPIC, "json", &BTreeMap::new()).map_err(failed)?;
        writer.flush().map_err(failed)?;
        if let Some(reason) = sink.lock().last_error.clone() {
            return Err(LogError::io(path, "write the head of the log", std::io::Error::other(reason)));
        }
        Ok(LogWriter {
            path: path.to_owned(),
            writer: Some(writer),
            sink,
            channels,
            events_channel,
            header: header.clone(),
            buffer: Vec::with_capacity(4 + 8 * WORDS_TYPICAL),
            stats: WriteStats::default(),
            sequence: 0,
        })
    }

    /// The first of `log.mcap`, `log.1.mcap`, `log.2.mcap`, … that is not there yet: the file a logger
    /// writes after a restart.
    pub fn next_path(directory: &Path) -> PathBuf {
        let mut index = 0_u32;
        loop {
            let path = directory.join(file_name(index));
            // symlink_metadata: a dangling link is there too.
            if path.symlink_metadata().is_err() || index == u32::MAX {
                return path;
            }
            index += 1;
        }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the log says about its run.
    pub fn header(&self) -> &LogHeader {
        &self.header
    }

    /// Names of the file in its directories: 0 when it was removed. `None` when that cannot be told.
    pub fn links(&self) -> Option<u64> {
        self.sink.lock().file().links()
    }

    /// Whether it still takes messages: not after the disk has refused bytes for too long.
    pub fn is_open(&self) -> bool {
        self.writer.is_some()
    }

    /// Writes the words of a region of a tick; `false` when they are lost.
    pub fn write(&mut self, region: RegionId, tick: u64, words: &[u64]) -> bool {
        let expected = region.region().layout.words();
        debug_assert_eq!(words.len(), expected, "{}", region.region().name);
        if words.len() != expected {
            self.stats.refused += 1;
            return false;
        }
        self.buffer.clear();
        put_message(words, &mut self.buffer);
        let put = self.put(self.channels[region as usize], tick);
        self.stats.messages += u64::from(put);
        put
    }

    /// Writes an event: what happened at which tick, with any detail, a text or a JSON value.
    pub fn event(&mut self, tick: u64, kind: &str, detail: impl Into<serde_json::Value>) {
        let time_s = self.header.time_s(tick);
        let event =
            serde_json::json!({ "tick": tick, "time_s": time_s, "kind": kind, "detail": detail.into() });
        self.buffer.clear();
        self.buffer.extend_from_slice(event.to_string().as_bytes());
        if self.put(self.events_channel, tick) {
            self.stats.events += 1;
        }
    }

    fn put(&mut self, channel_id: u16, tick: u64) -> bool {
        let log_time = self.header.log_time_ns(tick);
        self.sequence = self.sequence.wrapping_add(1);
        let head = MessageHeader { channel_id, sequence: self.sequence, log_time, publish_time: log_time };
        let written = match &mut self.writer {
            Some(writer) => writer.write_to_known_channel(&head, &self.buffer).is_ok(),
            None => false,
        };
        if !written {
            self.stats.refused += 1;
            self.writer = None;
        }
        written
    }

    /// Ends the chunk and hands it to the system. Everything before it then survives the writer's death.
    pub fn flush(&mut self) {
        match &mut self.writer {
            Some(writer) => {
                if writer.flush().is_err() {
                    self.writer = None;
                }
            }
            // What was accepted before the gap still belongs into the file.
            None => drop(self.sink.lock().drain()),
        }
    }

    /// Flushes, then waits until the disk has it: survives loss of power.
    ///
    /// # Errors
    /// What the system said.
    pub fn sync(&mut self) -> Result<(), LogError> {
        self.flush();
        let mut sink = self.sink.lock();
        if let Err(error) = sink.file().sync_data() {
            sink.errors += 1;
            return Err(LogError::io(&self.path, "wait for the disk", error));
        }
        Ok(())
    }

    /// What was written and refused so far.
    pub fn stats(&self) -> WriteStats {
        let sink = self.sink.lock();
        WriteStats {
            write_errors: sink.errors,
            bytes: sink.position() - sink.pending() as u64,
            pending_bytes: sink.pending() as u64,
            ..self.stats
        }
    }

    /// What the system said to the last refused attempt, until one succeeds.
    pub fn last_error(&self) -> Option<String> {
        self.sink.lock().last_error.clone()
    }

    /// Ends the log with its index and waits for the disk.
    ///
    /// # Errors
    /// If messages were refused or the disk does not take the rest: what is in the file is readable all the
    /// same, and can be mended.
    pub fn finish(mut self) -> Result<WriteStats, LogError> {
        let ended = match &mut self.writer {
            Some(writer) => writer.finish().map(drop).map_err(|error| error.to_string()),
            None => Err("the disk refused bytes for too long".to_owned()),
        };
        self.writer = None;
        let mut sink = self.sink.lock();
        let drained = sink.drain();
        let synced = sink.file().sync_data();
        let refusal = sink.last_error.clone();
        drop(sink);
        let reason = match (ended, drained, synced) {
            (Ok(()), true, Ok(())) => return Ok(self.stats()),
            (Err(reason), ..) => reason,
            (_, false, _) => refusal.unwrap_or_else(|| "bytes left over".to_owned()),
            (_, _, Err(error)) => error.to_string(),
        };
        Err(LogError::io(&self.path, "end the log", std::io::Error::other(reason)))
    }
}

impl Drop for LogWriter {
    /// Ends the log as well as it can: dropping the library's writer hands the index to the sink.
    fn drop(&mut self) {
        self.writer = None;
        self.sink.lock().drain();
    }
}

/// Name of the file number `index` of a run.
pub(crate) fn file_name(index: u32) -> String {
    if index == 0 { "log.mcap".to_owned() } else { format!("log.{index}.mcap") }
}

pub(crate) fn write_options() -> WriteOptions {
    WriteOptions::new()
        .profile("ros2")
        .library(concat!("kingpin ", env!("CARGO_PKG_VERSION")))
        .compression(Some(Compression::Lz4))
        .chunk_size(Some(CHUNK_BYTES))
        .disable_seeking(true)
}

/// Header and configuration as metadata and attachments.
pub(crate) fn put_header<W: Write + Seek>(
    writer: &mut Writer<W>,
    header: &LogHeader,
) -> mcap::McapResult<()> {
    writer.write_metadata(&mcap::records::Metadata {
        name: METADATA_NAME.to_owned(),
        metadata: header.metadata(),
    })?;
    let json = serde_json::to_vec_pretty(header).unwrap_or_default();
    let time = header.log_time_ns(0);
    let mut attach = |name: String, media_type: &str, data: &[u8]| {
        writer.attach(&Attachment {
            log_time: time,
            create_time: time,
            name,
            media_type: media_type.to_owned(),
            data: Cow::Borrowed(data),
        })
    };
    attach(HEADER_ATTACHMENT.to_owned(), "application/json", &json)?;
    attach(CONFIGURATION_ATTACHMENT.to_owned(), "application/toml", header.configuration.as_bytes())?;
    for source in &header.sources {
        attach(format!("{SOURCE_PREFIX}{}", source.name), "application/toml", source.text.as_bytes())?;
    }
    Ok(())
}

/// Topic of a region.
pub fn topic(region: &Region) -> String {
    format!("/{}", region.name)
}

/// Name of a region's schema; its text is [`regions::Layout::ros2_message`].
pub fn schema_name(region: &Region) -> String {
    format!("kingpin/msg/{}", region.layout.name)
}

/// Appends a region's words as a message: CDR, little endian.
pub fn put_message(words: &[u64], message: &mut Vec<u8>) {
    message.extend_from_slice(&CDR_HEADER);
    message.extend_from_slice(bytemuck::cast_slice(words));
}

/// Schema and channel of a region. The channel's metadata name every word, so that a log can be read
/// without the program that wrote it.
fn add_region<W: Write + Seek>(writer: &mut Writer<W>, region: &Region) -> mcap::McapResult<u16> {
    let layout = &region.layout;
    let schema = writer.add_schema(&schema_name(region), "ros2msg", layout.ros2_message().as_bytes())?;
    let columns: Vec<[String; 3]> = layout
        .columns()
        .into_iter()
        .map(|column| {
            let kind = match column.kind {
                Kind::F64 => "f64",
                Kind::U64 => "u64",
            };
            [column.name, kind.to_owned(), column.unit.to_owned()]
        })
        .collect();
    let metadata = BTreeMap::from([
        ("region".to_owned(), region.name.to_owned()),
        ("writer".to_owned(), region.writer.to_owned()),
        ("compared".to_owned(), region.compared.to_string()),
        ("layout".to_owned(), layout.name.to_owned()),
        ("layout_version".to_owned(), layout.version.to_string()),
        ("layout_hash".to_owned(), format!("{:016x}", layout.hash())),
        ("columns".to_owned(), serde_json::to_string(&columns).unwrap_or_default()),
    ]);
    writer.add_channel(schema, &topic(region), "cdr", &metadata)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::{Item, scan_stream};
    use std::io;
    use std::sync::{Arc, Mutex};

    /// A disk with room for so many bytes, seen from outside.
    #[derive(Clone)]
    struct Disk(Arc<Mutex<(Vec<u8>, usize)>>);

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let (written, room) = &mut *self.0.lock().unwrap();
            let taken = bytes.len().min(*room - written.len());
            written.extend_from_slice(&bytes[..taken]);
            if taken == 0 { Err(io::ErrorKind::StorageFull.into()) } else { Ok(taken) }
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Medium for Disk {
        fn sync_data(&self) -> io::Result<()> {
            Ok(())
        }
    }

    fn words(tick: u64) -> Vec<u64> {
        let mut words: Vec<u64> = (0..RegionId::Bench.region().layout.words() as u64)
            .map(|i| (tick * 17 + i).wrapping_mul(0x9e37_79b9_7f4a_7c15))
            .collect();
        words[0] = tick;
        words
    }

    /// Writes ticks with a flush each, giving the disk more room after half of them.
    fn run(
        room: usize,
        later: usize,
        backlog: usize,
    ) -> (Result<WriteStats, LogError>, WriteStats, Vec<u64>, bool) {
        let disk = Disk(Arc::new(Mutex::new((Vec::new(), room))));
        let header = LogHeader { period_ns: 1_000_000, ..LogHeader::default() };
        let mut log =
            LogWriter::create_on(Box::new(disk.clone()), backlog, Path::new("disk"), &header).unwrap();
        for tick in 0..400 {
            if tick == 200 {
                disk.0.lock().unwrap().1 = later;
            }
            log.write(RegionId::Bench, tick, &words(tick));
            log.flush();
        }
        let stats = log.stats();
        let finished = log.finish();
        let bytes = disk.0.lock().unwrap().0.clone();
        let mut ticks = Vec::new();
        let mut collect = |item: Item<'_>| {
            if let Item::Message(.., data) = item {
                ticks.push(u64::from_le_bytes(data[4..12].try_into().unwrap()));
            }
        };
        let report = scan_stream(io::Cursor::new(bytes), &mut collect).ok().unwrap();
        (finished, stats, ticks, report.finished)
    }

    #[test]
    fn a_disk_full_for_a_while_leaves_no_gap() {
        let (finished, stats, ticks, ended) = run(45_000, 1 << 30, 1 << 20);
        assert!(stats.write_errors > 10, "{stats:?}");
        assert_eq!((stats.refused, stats.messages), (0, 400));
        assert!(finished.is_ok() && ended);
        assert_eq!(ticks, (0..400).collect::<Vec<_>>());
    }

    #[test]
    fn a_disk_that_stays_full_keeps_what_was_written() {
        let (finished, stats, ticks, ended) = run(60_000, 60_000, 20_000);
        assert!(finished.unwrap_err().to_string().contains("end the log"));
        assert!(stats.refused > 0 && stats.messages + stats.refused == 400, "{stats:?}");
        assert!(!ended && ticks.len() > 50, "{}", ticks.len());
        assert_eq!(ticks, (0..ticks.len() as u64).collect::<Vec<_>>(), "a prefix");
    }
}
