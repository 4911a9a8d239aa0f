//! Mending a log: everything that can still be read, written anew as a finished log.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::path::Path;

use mcap::records::MessageHeader;

use crate::error::LogError;
use crate::scan::{Item, ScanReport, Schema, scan};
use crate::sink::{BACKLOG_BYTES, SharedSink, Sink};
use crate::writer::{EVENTS_TOPIC, write_options};

/// What a recovery found.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct RecoverReport {
    /// Region messages in the new log.
    pub messages: u64,
    /// Events in the new log.
    pub events: u64,
    /// Last tick of each region.
    pub last_tick: BTreeMap<String, u64>,
    /// Bytes of the old log that could not be read.
    pub bytes_dropped: u64,
    /// How the old log was.
    pub scan: ScanReport,
}

/// Writes what can be read of the log at `path_in` as a new log at `path_out`.
///
/// # Errors
/// If `path_in` is no log, `path_out` exists, or it cannot be written; then nothing is left at `path_out`.
pub fn recover(path_in: &Path, path_out: &Path) -> Result<RecoverReport, LogError> {
    // Looked at first, so that a path that is no log leaves no output behind.
    scan_head(path_in)?;
    let file = OpenOptions::new().write(true).create_new(true).open(path_out).map_err(|error| match error
        .kind()
    {
        std::io::ErrorKind::AlreadyExists => LogError::Exists(path_out.to_owned()),
        _ => LogError::io(path_out, "create the recovered log", error),
    })?;
    let recovered = copy(path_in, path_out, file);
    if recovered.is_err() {
        // Best effort: the error that is returned says what went wrong.
        let _ = std::fs::remove_file(path_out);
    }
    recovered
}

fn scan_head(path: &Path) -> Result<(), LogError> {
    if path.metadata().map_err(|error| LogError::io(path, "open the log", error))?.is_file() {
        Ok(())
    } else {
        Err(LogError::NotRegularFile(path.to_owned()))
    }
}

fn copy(path_in: &Path, path_out: &Path, file: std::fs::File) -> Result<RecoverReport, LogError> {
    let failed =
        |reason: String| LogError::io(path_out, "write the recovered log", std::io::Error::other(reason));
    let sink = SharedSink::new(Sink::new(file, BACKLOG_BYTES));
    let mut out = write_options().create(sink.clone()).map_err(|error| failed(error.to_string()))?;
    let mut report = RecoverReport::default();
    let mut channels: BTreeMap<u16, u16> = BTreeMap::new();
    let mut refused: Option<mcap::McapError> = None;
    let scanned = scan(path_in, |item| {
        if refused.is_some() {
            return;
        }
        if let Err(error) = copy_item(&item, &mut out, &mut channels, &mut report) {
            refused = Some(error);
        }
    })?;
    if let Some(error) = refused {
        return Err(failed(error.to_string()));
    }
    out.finish().map_err(|error| failed(error.to_string()))?;
    drop(out);
    let mut sink = sink.lock();
    if !sink.drain() {
        return Err(failed(sink.last_error.clone().unwrap_or_default()));
    }
    sink.file().sync_data().map_err(|error| LogError::io(path_out, "write the recovered log", error))?;
    report.bytes_dropped = scanned.bytes_dropped;
    report.scan = scanned;
    Ok(report)
}

fn copy_item(
    item: &Item<'_>,
    out: &mut mcap::Writer<SharedSink<std::fs::File>>,
    channels: &mut BTreeMap<u16, u16>,
    report: &mut RecoverReport,
) -> mcap::McapResult<()> {
    match item {
        Item::Metadata(name, map) => out
            .write_metadata(&mcap::records::Metadata { name: (*name).to_owned(), metadata: (*map).clone() }),
        Item::Attachment(name, media_type, time, data) => out.attach(&mcap::Attachment {
            log_time: *time,
            create_time: *time,
            name: (*name).to_owned(),
            media_type: (*media_type).to_owned(),
            data: Cow::Borrowed(data),
        }),
        Item::Message(id, channel, sequence, log_time, data) => {
            let channel_id = match channels.get(id) {
                Some(&known) => known,
                None => {
                    let schema = match &channel.schema {
                        Some(Schema { name, encoding, data }) => out.add_schema(name, encoding, data)?,
                        None => 0,
                    };
                    let new =
                        out.add_channel(schema, &channel.topic, &channel.encoding, &channel.metadata)?;
                    channels.insert(*id, new);
                    new
                }
            };
            let header = MessageHeader {
                channel_id,
                sequence: *sequence,
                log_time: *log_time,
                publish_time: *log_time,
            };
            out.write_to_known_channel(&header, data)?;
            if channel.topic == EVENTS_TOPIC {
                report.events += 1;
                return Ok(());
            }
            report.messages += 1;
            if let (Some(region), Some(tick)) = (channel.metadata.get("region"), data.get(4..12)) {
                let tick = tick.iter().rev().fold(0, |sum, &byte| sum << 8 | u64::from(byte));
                let last = report.last_tick.entry(region.clone()).or_insert(tick);
                *last = tick.max(*last);
            }
            Ok(())
        }
    }
}
