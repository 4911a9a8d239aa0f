//! Going through a log file record by record, whatever state it is in.
//!
//! The frame of MCAP (opcode, length, body) is walked here, because a reader that stops at the first bad
//! byte loses an hour for a flipped bit: a chunk whose checksum fails is skipped; where the frame itself is
//! lost, the next chunk is searched for by its signature and believed only with a valid checksum. Records
//! are decoded by the `mcap` crate. Memory: one record. Nothing in a file may make this panic.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use mcap::records::{Record, op};
use mcap::sans_io::{LinearReader, LinearReaderOptions, linear_reader::LinearReadEvent};

use crate::error::LogError;

/// Opcode and length.
const FRAME_BYTES: u64 = 9;
/// No record of ours comes near; a longer one is a broken length.
const RECORD_BYTES_MAX: u64 = 256 << 20;
/// A chunk's compression field, `lz4`, and its distance from the chunk's first byte.
const SIGNATURE: &[u8; 7] = b"\x03\0\0\0lz4";
const SIGNATURE_OFFSET: u64 = 1 + 8 + 8 + 8 + 8 + 4;
const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Footer record and end magic.
const FOOTER_BYTES: u64 = FRAME_BYTES + 20 + 8;

/// A definition of a message type.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schema {
    /// Name.
    pub name: String,
    /// Encoding of the definition.
    pub encoding: String,
    /// Definition.
    pub data: Vec<u8>,
}

/// A channel of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Topic.
    pub topic: String,
    /// Encoding of its messages.
    pub encoding: String,
    /// Metadata.
    pub metadata: BTreeMap<String, String>,
    /// Type of its messages.
    pub schema: Option<Schema>,
}

/// What a scan meets.
#[derive(Debug)]
pub enum Item<'a> {
    /// A metadata record.
    Metadata(&'a str, &'a BTreeMap<String, String>),
    /// An attachment: name, media type, time, content.
    Attachment(&'a str, &'a str, u64, &'a [u8]),
    /// A message: channel id, channel, sequence number, time, content.
    Message(u16, &'a Channel, u32, u64, &'a [u8]),
}

/// How a file was.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct ScanReport {
    /// Messages read.
    pub messages: u64,
    /// Messages of channels whose definition is lost.
    pub orphans: u64,
    /// Chunks with a wrong checksum or undecodable content.
    pub damaged_chunks: u64,
    /// Bytes that could not be read as records.
    pub bytes_dropped: u64,
    /// Whether the writer ended the file: nothing can be missing at its end.
    pub finished: bool,
}

#[derive(Default)]
struct Definitions {
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, Channel>,
}

impl Definitions {
    fn add(&mut self, record: &Record<'_>) {
        match record {
            Record::Schema { header, data } => {
                let schema = Schema {
                    name: header.name.clone(),
                    encoding: header.encoding.clone(),
                    data: data.to_vec(),
                };
                self.schemas.entry(header.id).or_insert(schema);
            }
            Record::Channel(c) => {
                let channel = Channel {
                    topic: c.topic.clone(),
                    encoding: c.message_encoding.clone(),
                    metadata: c.metadata.clone(),
                    schema: self.schemas.get(&c.schema_id).cloned(),
                };
                self.channels.entry(c.id).or_insert(channel);
            }
            _ => {}
        }
    }
}

struct Scanner<R: Read + Seek> {
    file: R,
    len: u64,
    // Where the next byte read comes from, to save seeks.
    at: u64,
    body: Vec<u8>,
}

impl<R: Read + Seek> Scanner<R> {
    fn seek(&mut self, to: u64) -> io::Result<()> {
        if self.at != to {
            self.file.seek(SeekFrom::Start(to))?;
            self.at = to;
        }
        Ok(())
    }

    /// The record at `start`: its opcode, with its body in `self.body`. None if there is no whole one.
    fn record(&mut self, start: u64) -> io::Result<Option<u8>> {
        if start + FRAME_BYTES > self.len {
            return Ok(None);
        }
        self.seek(start)?;
        let mut frame = [0; FRAME_BYTES as usize];
        self.file.read_exact(&mut frame)?;
        self.at += FRAME_BYTES;
        let [opcode, length @ ..] = frame;
        let length = u64::from_le_bytes(length);
        let fits = length <= RECORD_BYTES_MAX && length <= self.len - self.at;
        let known = (op::HEADER..=op::DATA_END).contains(&opcode) || opcode >= 0x80;
        if !fits || !known {
            return Ok(None);
        }
        self.body.resize(length as usize, 0);
        self.file.read_exact(&mut self.body)?;
        self.at += length;
        Ok(Some(opcode))
    }

    /// The first place from `from` on that looks like a chunk.
    fn find_chunk(&mut self, from: u64) -> io::Result<Option<u64>> {
        const BLOCK: usize = 1 << 16;
        let mut block = vec![0; BLOCK];
        let mut start = from + SIGNATURE_OFFSET;
        while start + SIGNATURE.len() as u64 <= self.len {
            self.seek(start)?;
            let wanted = (self.len - start).min(BLOCK as u64) as usize;
            self.file.read_exact(&mut block[..wanted])?;
            self.at += wanted as u64;
            if let Some(i) = block[..wanted].windows(SIGNATURE.len()).position(|w| w == SIGNATURE) {
                return Ok(Some(start + i as u64 - SIGNATURE_OFFSET));
            }
            start += (wanted + 1 - SIGNATURE.len()) as u64;
        }
        Ok(None)
    }

    /// Definitions repeated at the end of a finished file, in case their first place is damaged.
    fn definitions_at_end(&mut self) -> io::Result<Definitions> {
        let mut definitions = Definitions::default();
        if self.len < FOOTER_BYTES {
            return Ok(definitions);
        }
        self.seek(self.len - FOOTER_BYTES)?;
        let mut footer = [0; FOOTER_BYTES as usize];
        self.file.read_exact(&mut footer)?;
        self.at += FOOTER_BYTES;
        let mut start = [0; 8];
        start.copy_from_slice(&footer[9..17]);
        let mut start = u64::from_le_bytes(start);
        if footer[0] != op::FOOTER || !footer.ends_with(MAGIC) || start == 0 || start >= self.len {
            return Ok(definitions);
        }
        while let Some(opcode) = self.record(start)? {
            if opcode != op::SCHEMA && opcode != op::CHANNEL {
                break;
            }
            match mcap::parse_record(opcode, &self.body) {
                Ok(record) => definitions.add(&record),
                Err(_) => break,
            }
            start = self.at;
        }
        Ok(definitions)
    }
}

/// Goes through a file and shows every item that can be read to `visit`.
///
/// # Errors
/// If the file is not regular, cannot be read, or does not start as an MCAP file does.
pub fn scan(path: &Path, mut visit: impl FnMut(Item<'_>)) -> Result<ScanReport, LogError> {
    // Asked before opening: opening a pipe would wait for its other end.
    let kind = path.metadata().map_err(|error| LogError::io(path, "open the log", error))?;
    if !kind.is_file() {
        return Err(LogError::NotRegularFile(path.to_owned()));
    }
    let file = File::open(path).map_err(|error| LogError::io(path, "open the log", error))?;
    scan_stream(io::BufReader::with_capacity(1 << 18, file), &mut visit).map_err(|error| match error {
        ScanError::Io(error) => LogError::io(path, "read the log", error),
        ScanError::NotMcap => LogError::NotALog {
            path: path.to_owned(),
            reason: "it does not start as an MCAP file does".to_owned(),
        },
    })
}

pub(crate) enum ScanError {
    Io(io::Error),
    NotMcap,
}

impl From<io::Error> for ScanError {
    fn from(error: io::Error) -> Self {
        ScanError::Io(error)
    }
}

pub(crate) fn scan_stream<R: Read + Seek>(
    mut file: R,
    visit: &mut dyn FnMut(Item<'_>),
) -> Result<ScanReport, ScanError> {
    // The length now: a log may be growing while it is read.
    let len = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(0))?;
    let mut magic = [0; 8];
    if len < 8 || file.read_exact(&mut magic).is_err() || &magic != MAGIC {
        return Err(ScanError::NotMcap);
    }
    let mut scanner = Scanner { file, len, at: 8, body: Vec::new() };
    let mut definitions = scanner.definitions_at_end()?;
    let mut report = ScanReport::default();
    let mut position = 8;
    while position < len {
        let opcode = scanner.record(position)?;
        let end = scanner.at;
        let body = std::mem::take(&mut scanner.body);
        let outcome = match opcode {
            None => Outcome::LostFrame,
            Some(op::DATA_END) => {
                report.finished = true;
                break;
            }
            Some(opcode) => one_record(opcode, &body, &mut definitions, &mut report, visit),
        };
        scanner.body = body;
        match outcome {
            Outcome::Read => position = end,
            Outcome::Skipped => {
                report.bytes_dropped += end - position;
                position = end;
            }
            Outcome::LostFrame => {
                let next = scanner.find_chunk(position + 1)?.unwrap_or(len);
                report.bytes_dropped += next - position;
                position = next;
            }
        }
    }
    Ok(report)
}

enum Outcome {
    Read,
    /// The frame is believed, the content is not.
    Skipped,
    LostFrame,
}

fn one_record(
    opcode: u8,
    body: &[u8],
    definitions: &mut Definitions,
    report: &mut ScanReport,
    visit: &mut dyn FnMut(Item<'_>),
) -> Outcome {
    if opcode == op::ATTACHMENT && !attachment_is_whole(body) {
        return Outcome::LostFrame;
    }
    let record = match mcap::parse_record(opcode, body) {
        Ok(record) => record,
        Err(_) => return Outcome::LostFrame,
    };
    match record {
        Record::Chunk { header, data } => {
            // A chunk fills its record exactly; a difference is a broken length.
            let head = 8 + 8 + 8 + 4 + 4 + header.compression.len() + 8;
            if head + data.len() != body.len() || header.uncompressed_size > RECORD_BYTES_MAX {
                return Outcome::LostFrame;
            }
            if decode_chunk(opcode, body, definitions, report, visit).is_err() {
                report.damaged_chunks += 1;
                return Outcome::Skipped;
            }
        }
        other => show(&other, definitions, report, visit),
    }
    Outcome::Read
}

/// Lengths inside an attachment, which the library trusts.
fn attachment_is_whole(body: &[u8]) -> bool {
    let mut rest = body.get(16..).unwrap_or_default();
    for _ in 0..2 {
        let Some((length, after)) = rest.split_first_chunk::<4>() else { return false };
        let Some(after) = after.get(u32::from_le_bytes(*length) as usize..) else { return false };
        rest = after;
    }
    let Some((length, after)) = rest.split_first_chunk::<8>() else { return false };
    u64::from_le_bytes(*length).checked_add(4) == Some(after.len() as u64)
}

/// Shows the records of a chunk, but only after its checksum has been found right.
fn decode_chunk(
    opcode: u8,
    body: &[u8],
    definitions: &mut Definitions,
    report: &mut ScanReport,
    visit: &mut dyn FnMut(Item<'_>),
) -> Result<(), mcap::McapError> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(RECORD_BYTES_MAX as usize);
    let mut reader = LinearReader::new_with_options(options);
    let mut frame = [opcode, 0, 0, 0, 0, 0, 0, 0, 0];
    frame[1..].copy_from_slice(&(body.len() as u64).to_le_bytes());
    let mut source = frame.as_slice().chain(body);
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                let taken = source.read(reader.insert(wanted))?;
                reader.notify_read(taken);
            }
            LinearReadEvent::Record { opcode, data } => {
                show(&mcap::parse_record(opcode, data)?, definitions, report, visit);
            }
        }
    }
    Ok(())
}

fn show(
    record: &Record<'_>,
    definitions: &mut Definitions,
    report: &mut ScanReport,
    visit: &mut dyn FnMut(Item<'_>),
) {
    match record {
        Record::Schema { .. } | Record::Channel(_) => definitions.add(record),
        Record::Metadata(m) => visit(Item::Metadata(&m.name, &m.metadata)),
        Record::Attachment { header, data, .. } => {
            visit(Item::Attachment(&header.name, &header.media_type, header.log_time, data));
        }
        Record::Message { header, data } => match definitions.channels.get(&header.channel_id) {
            Some(channel) => {
                report.messages += 1;
                visit(Item::Message(header.channel_id, channel, header.sequence, header.log_time, data));
            }
            None => report.orphans += 1,
        },
        _ => {}
    }
}
