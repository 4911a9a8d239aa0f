//! Part of a log as another log: selected regions and signals, fewer ticks. MCAP and ROS 2 tools read it as they read a
//! log, and so does everything here; events, header and attachments come along.
//!
//! A region taken whole keeps its message definition. Of others each column is a field of its own name with `.` as `_`
//! (`position_m.x`: `float64 position_m_x`), behind `tick`, which always comes first.

use std::collections::BTreeMap;
use std::io::{Seek, Write};

use mcap::records::MessageHeader;
use regions::Kind;

use crate::error::LogError;
use crate::reader::{LogReader, RegionLog};
use crate::select::select;
use crate::writer::{CDR_HEADER, EVENT_SCHEMA, EVENTS_TOPIC, put_header, write_options};

/// Writes the selected columns (as `kingpin export --select` takes them; none: all) of a log. Returns the number of
/// messages.
///
/// # Errors
/// For a selection that is not in the log, and for an output that refuses.
pub fn export_mcap<W: Write + Seek>(log: &LogReader, selection: &[String], out: W) -> Result<u64, LogError> {
    let selected = select(log, selection)?;
    let failed = |error: mcap::McapError| LogError::Output(error.to_string());
    let mut writer = write_options().create(out).map_err(failed)?;
    put_header(&mut writer, &log.header).map_err(failed)?;
    // By region: channel, columns, and the next row.
    let mut channels: Vec<(u16, &RegionLog, Vec<usize>, usize)> = Vec::new();
    for (index, region) in log.regions().iter().enumerate() {
        let mut columns: Vec<usize> = selected.iter().filter(|(r, _)| *r == index).map(|(_, c)| *c).collect();
        if columns.is_empty() {
            continue;
        }
        columns.retain(|&column| column != 0);
        columns.insert(0, 0);
        if columns.len() == region.columns.len() {
            columns.sort_unstable();
        }
        let (name, definition) = definition(region, &columns);
        let schema = writer.add_schema(&name, "ros2msg", definition.as_bytes()).map_err(failed)?;
        let channel = writer
            .add_channel(schema, &format!("/{}", region.name), "cdr", &metadata(region, &columns))
            .map_err(failed)?;
        channels.push((channel, region, columns, 0));
    }
    let schema = writer.add_schema("kingpin.Event", "jsonschema", EVENT_SCHEMA.as_bytes()).map_err(failed)?;
    let events = writer.add_channel(schema, EVENTS_TOPIC, "json", &BTreeMap::new()).map_err(failed)?;

    let (mut sequence, mut messages) = (0_u32, 0_u64);
    let mut put = |writer: &mut mcap::Writer<W>, channel_id, tick, data: &[u8]| {
        sequence = sequence.wrapping_add(1);
        let log_time = log.header.log_time_ns(tick);
        let head = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        writer.write_to_known_channel(&head, data)
    };
    let mut next_event = log.events.iter().peekable();
    let mut buffer = Vec::new();
    // Tick by tick over all regions, as a log is written.
    while let Some(tick) = channels.iter().filter_map(|(_, region, _, row)| region.ticks.get(*row)).min() {
        let tick = *tick;
        for (channel, region, columns, row) in &mut channels {
            if region.ticks.get(*row) != Some(&tick) {
                continue;
            }
            let words = region.row(*row);
            buffer.clear();
            buffer.extend_from_slice(&CDR_HEADER);
            buffer.extend(columns.iter().flat_map(|&column| words[column].to_le_bytes()));
            put(&mut writer, *channel, tick, &buffer).map_err(failed)?;
            *row += 1;
            messages += 1;
        }
        while let Some(event) = next_event.next_if(|event| event.tick <= tick) {
            put(&mut writer, events, event.tick, event.json().as_bytes()).map_err(failed)?;
        }
    }
    for event in next_event {
        put(&mut writer, events, event.tick, event.json().as_bytes()).map_err(failed)?;
    }
    writer.finish().map_err(failed)?;
    Ok(messages)
}

/// Name and text of a region's message definition.
fn definition(region: &RegionLog, columns: &[usize]) -> (String, String) {
    let known = regions::REGIONS.iter().find(|known| {
        known.name == region.name && format!("{:016x}", known.layout.hash()) == region.layout_hash
    });
    if let Some(known) = known.filter(|_| columns.len() == region.columns.len()) {
        return (format!("kingpin/msg/{}", known.layout.name), known.layout.ros2_message());
    }
    let fields = columns.iter().map(|&column| {
        let column = &region.columns[column];
        let kind = match column.kind {
            Kind::F64 => "float64",
            Kind::U64 => "uint64",
        };
        format!("{kind} {}\n", column.name.replace('.', "_").to_lowercase())
    });
    (format!("kingpin/msg/{}Part", region.layout), fields.collect())
}

/// What a reader of ours needs to know of a channel.
fn metadata(region: &RegionLog, columns: &[usize]) -> BTreeMap<String, String> {
    let columns: Vec<[&str; 3]> = columns
        .iter()
        .map(|&column| {
            let column = &region.columns[column];
            let kind = match column.kind {
                Kind::F64 => "f64",
                Kind::U64 => "u64",
            };
            [column.name.as_str(), kind, column.unit.as_str()]
        })
        .collect();
    BTreeMap::from([
        ("region".to_owned(), region.name.clone()),
        ("compared".to_owned(), region.compared.to_string()),
        ("layout".to_owned(), region.layout.clone()),
        ("layout_hash".to_owned(), region.layout_hash.clone()),
        ("columns".to_owned(), serde_json::to_string(&columns).unwrap_or_default()),
    ])
}
