//! A log as ASAM MDF 4.10, the measurement file of CANape, INCA, asammdf and their kind.
//!
//! One channel group a region, named as the region, its master channel the start of the tick in seconds since tick 0
//! (n·T); every other channel is named `region.field.label` and carries its unit and its description as comment.
//! Values are stored as they are: 8-byte floats and 8-byte unsigned counters, little endian, no conversion, so they
//! read back to the same bits. Units are written as these tools print them (m/s², N·m). The file's start time is the
//! wall clock at tick 0 (zero in lockstep, which has none); the resolved configuration, its sources and the log's header
//! are embedded attachments; a history block names the program. Uncompressed and sorted, finalised by construction.
//!
//! Source: ASAM MDF 4.1 block structure as its public implementations document it. Only the blocks named above.

use std::io::Write;

use regions::Kind;

use crate::error::LogError;
use crate::header::{CONFIGURATION_ATTACHMENT, HEADER_ATTACHMENT, SOURCE_PREFIX};
use crate::reader::LogReader;
use crate::select::{docs_of, pretty, select};

/// What to export.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Mf4Options {
    /// As in [`crate::CsvOptions::selection`].
    pub selection: Vec<String>,
    /// Every how manieth tick is exported, counted from tick 0; 0 and 1: all.
    pub decimation: u64,
}

/// Length of the identification block, after which the header block stands.
const IDENTIFICATION: usize = 64;
/// Length of a block's own header.
const BLOCK_HEADER: usize = 24;

/// The blocks before the data, in memory; links are absolute positions in the file.
struct Blocks {
    bytes: Vec<u8>,
}

impl Blocks {
    /// Appends a block; returns its position.
    fn push(&mut self, id: &str, links: &[u64], data: &[u8]) -> u64 {
        let at = self.bytes.len();
        let length = BLOCK_HEADER + 8 * links.len() + data.len();
        self.bytes.extend_from_slice(format!("##{id}").as_bytes());
        self.bytes.extend_from_slice(&[0; 4]);
        self.bytes.extend_from_slice(&(length as u64).to_le_bytes());
        self.bytes.extend_from_slice(&(links.len() as u64).to_le_bytes());
        for link in links {
            self.bytes.extend_from_slice(&link.to_le_bytes());
        }
        self.bytes.extend_from_slice(data);
        // Every block begins on a multiple of 8.
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        at as u64
    }

    /// A text block; empty text is no block.
    fn text(&mut self, id: &str, text: &str) -> u64 {
        if text.is_empty() {
            return 0;
        }
        let mut data = text.as_bytes().to_vec();
        data.push(0);
        data.resize(data.len().next_multiple_of(8), 0);
        self.push(id, &[], &data)
    }

    /// Sets link `index` of the block at `at`.
    fn link(&mut self, at: u64, index: usize, to: u64) {
        let from = at as usize + BLOCK_HEADER + 8 * index;
        self.bytes[from..from + 8].copy_from_slice(&to.to_le_bytes());
    }

    /// An embedded file, linked behind `previous` (block and link).
    fn attachment(&mut self, previous: (u64, usize), name: &str, mime: &str, content: &[u8]) -> (u64, usize) {
        let (name, mime) = (self.text("TX", name), self.text("TX", mime));
        let mut data = Vec::with_capacity(40 + content.len());
        // Embedded, not compressed, no check sum.
        data.extend_from_slice(&1_u16.to_le_bytes());
        data.extend_from_slice(&[0; 2 + 4 + 16]);
        data.extend_from_slice(&(content.len() as u64).to_le_bytes());
        data.extend_from_slice(&(content.len() as u64).to_le_bytes());
        data.extend_from_slice(content);
        let at = self.push("AT", &[0, name, mime, 0], &data);
        self.link(previous.0, previous.1, at);
        (at, 0)
    }

    /// A channel of 64 bits.
    fn channel(&mut self, name: &str, unit: &str, comment: &str, kind: Kind, byte: u32, master: bool) -> u64 {
        let links = [0, 0, self.text("TX", name), 0, 0, 0, self.text("TX", unit), self.text("TX", comment)];
        let mut data =
            vec![if master { 2 } else { 0 }, u8::from(master), if kind == Kind::F64 { 4 } else { 0 }, 0];
        data.extend_from_slice(&byte.to_le_bytes());
        data.extend_from_slice(&64_u32.to_le_bytes());
        // Flags, invalidation bit, precision, attachments, six limits: none.
        data.resize(72, 0);
        self.push("CN", &links, &data)
    }
}

/// Writes a log as MDF 4.10. Returns the number of records over all groups.
///
/// # Errors
/// For a selection that is not in the log, and for an output that refuses.
pub fn export_mf4(log: &LogReader, options: &Mf4Options, out: &mut dyn Write) -> Result<u64, LogError> {
    let selected = select(log, &options.selection)?;
    let step = options.decimation.max(1);
    let header = &log.header;
    let mut blocks = Blocks { bytes: vec![0; IDENTIFICATION] };
    blocks.bytes[..28].copy_from_slice(b"MDF     4.10    kingpin \0\0\0\0");
    blocks.bytes[28..30].copy_from_slice(&410_u16.to_le_bytes());

    let wall = if header.lockstep { 0 } else { header.wall_start_ns };
    let mut time = wall.to_le_bytes().to_vec();
    // Offsets of time zone and summer time: none and valid, so the time is UTC.
    time.extend_from_slice(&[0, 0, 0, 0, 2]);
    let mut head = time.clone();
    head.resize(32, 0);
    let hd = blocks.push("HD", &[0; 6], &head);
    let version = header.versions.get("kingpin").map_or("", String::as_str);
    let comment = blocks.text(
        "MD",
        &format!(
            "<HDcomment><TX>{}</TX><common_properties><e name=\"scenario\">{}</e><e name=\"bench\">{}</e>\
             <e name=\"run_id\">{:016x}</e><e name=\"seed\">{}</e><e name=\"period_s\">{}</e>\
             <e name=\"configuration_hash\">{}</e><e name=\"decimation\">{}</e></common_properties></HDcomment>",
            escaped(&header.scenario),
            escaped(&header.scenario),
            escaped(&header.bench),
            header.run_id,
            header.seed,
            header.period_s(),
            escaped(&header.configuration_hash),
            escaped(header.decimation.as_deref().unwrap_or("none"))
        ),
    );
    blocks.link(hd, 5, comment);
    let history = blocks.text(
        "MD",
        &format!(
            "<FHcomment><TX>exported</TX><tool_id>kingpin</tool_id><tool_vendor>Kingpin</tool_vendor>\
             <tool_version>{}</tool_version></FHcomment>",
            escaped(version)
        ),
    );
    time.resize(16, 0);
    let fh = blocks.push("FH", &[0, history], &time);
    blocks.link(hd, 1, fh);
    let header_json = serde_json::to_string_pretty(header).unwrap_or_default();
    let mut last = blocks.attachment((hd, 3), HEADER_ATTACHMENT, "application/json", header_json.as_bytes());
    last = blocks.attachment(last, CONFIGURATION_ATTACHMENT, "text/plain", header.configuration.as_bytes());
    for source in &header.sources {
        let name = format!("{SOURCE_PREFIX}{}", source.name);
        last = blocks.attachment(last, &name, "text/plain", source.text.as_bytes());
    }

    // One group a region; the data of all follow the blocks, so where they will stand is known only then.
    let mut groups: Vec<(u64, usize, Vec<usize>)> = Vec::new();
    let mut previous = (hd, 0);
    for (index, region) in log.regions().iter().enumerate() {
        let columns: Vec<usize> = selected.iter().filter(|(r, _)| *r == index).map(|(_, c)| *c).collect();
        let rows = region.ticks.iter().filter(|&tick| tick % step == 0).count();
        if columns.is_empty() || rows == 0 {
            continue;
        }
        let record_bytes = 8 * (1 + columns.len()) as u32;
        let name = blocks.text("TX", &region.name);
        let mut data = vec![0; 8];
        data.extend_from_slice(&(rows as u64).to_le_bytes());
        data.extend_from_slice(&[0; 8]);
        data.extend_from_slice(&record_bytes.to_le_bytes());
        data.extend_from_slice(&[0; 4]);
        let cg = blocks.push("CG", &[0, 0, name, 0, 0, 0], &data);
        let dg = blocks.push("DG", &[0, cg, 0, 0], &[0; 8]);
        blocks.link(previous.0, previous.1, dg);
        previous = (dg, 0);
        let docs = docs_of(&region.name, &region.layout_hash);
        let master = "start of the tick since tick 0";
        let mut behind = (cg, 1);
        let time = blocks.channel("time_s", "s", master, Kind::F64, 0, true);
        blocks.link(behind.0, behind.1, time);
        behind = (time, 0);
        for (place, &column) in columns.iter().enumerate() {
            let column = &region.columns[column];
            let doc = docs.iter().find(|(name, _)| *name == column.name).map_or("", |(_, doc)| doc);
            let unit = if column.unit == "1" { String::new() } else { pretty(&column.unit) };
            let name = format!("{}.{}", region.name, column.name);
            let channel = blocks.channel(&name, &unit, doc, column.kind, 8 * (1 + place as u32), false);
            blocks.link(behind.0, behind.1, channel);
            behind = (channel, 0);
        }
        groups.push((dg, index, columns));
    }
    let rows_of = |region: usize| log.regions()[region].ticks.iter().filter(|&tick| tick % step == 0).count();
    let mut at = blocks.bytes.len();
    for (dg, region, columns) in &groups {
        blocks.link(*dg, 2, at as u64);
        at += BLOCK_HEADER + 8 * (1 + columns.len()) * rows_of(*region);
    }

    let failed = |error: std::io::Error| LogError::Output(error.to_string());
    out.write_all(&blocks.bytes).map_err(failed)?;
    let mut records = 0;
    let mut record: Vec<u8> = Vec::new();
    for (_, index, columns) in &groups {
        let region = &log.regions()[*index];
        let length = BLOCK_HEADER + 8 * (1 + columns.len()) * rows_of(*index);
        let mut head = b"##DT\0\0\0\0".to_vec();
        head.extend_from_slice(&(length as u64).to_le_bytes());
        head.extend_from_slice(&[0; 8]);
        out.write_all(&head).map_err(failed)?;
        for (row, &tick) in region.ticks.iter().enumerate() {
            if tick % step != 0 {
                continue;
            }
            record.clear();
            record.extend_from_slice(&header.time_s(tick).to_le_bytes());
            let words = region.row(row);
            for &column in columns {
                record.extend_from_slice(&words[column].to_le_bytes());
            }
            out.write_all(&record).map_err(failed)?;
            records += 1;
        }
    }
    Ok(records)
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
