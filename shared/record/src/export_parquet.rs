//! A log as one Parquet table: for pandas, polars, DuckDB, MATLAB's `parquetread` and their kind.
//!
//! Rows are the ticks that any selected region has; columns `tick`, `time_s` (start of the tick, n·T), then
//! `region.field.label`. Floats are doubles and counters unsigned 64-bit integers, both to the bit; null where the
//! region has no such tick (a value that is itself absent is NaN). Key-value metadata of the file: `kingpin.columns`
//! (JSON, by column: unit and comment), `PANDAS_ATTRS` (the same where pandas puts it into `DataFrame.attrs`),
//! `kingpin.header`, `kingpin.configuration` and `kingpin.source/…` (attached files). Columns with few different
//! values are stored by dictionary, the others plain; nothing is compressed further: noise does not shrink.
//!
//! Format: Apache Parquet 2 (parquet.apache.org/docs/file-format), by the crate `parquet`.

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Arc;

use parquet::basic::{ConvertedType, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties, WriterVersion};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{ColumnPath, Type};
use regions::Kind;
use serde_json::json;

use crate::error::LogError;
use crate::header::SOURCE_PREFIX;
use crate::reader::LogReader;
use crate::select::{docs_of, pretty, select};

/// Rows of a row group: one for most runs, so that a column lies in one piece. About 17 min at 1 kHz.
const ROWS_MAX: usize = 1 << 20;
/// A column is stored by dictionary if so many values, evenly spread, hold at most so many different ones.
const PROBES: usize = 256;
const DIFFERENT_MAX: usize = 16;

/// Where a column's values come from.
enum Source {
    Tick,
    Time,
    Word(usize, usize),
}

struct Column {
    name: String,
    unit: String,
    comment: String,
    kind: Kind,
    source: Source,
    optional: bool,
}

/// Writes the selected columns (as `kingpin export --select` takes them; none: all) of a log. Returns the number of rows.
///
/// # Errors
/// For a selection that is not in the log, and for an output that refuses.
pub fn export_parquet(
    log: &LogReader,
    selection: &[String],
    out: &mut (dyn Write + Send),
) -> Result<u64, LogError> {
    let selected = select(log, selection)?;
    let mut regions: Vec<usize> = selected.iter().map(|(region, _)| *region).collect();
    regions.sort_unstable();
    regions.dedup();
    let mut ticks: Vec<u64> =
        regions.iter().flat_map(|&region| log.regions()[region].ticks.iter().copied()).collect();
    ticks.sort_unstable();
    ticks.dedup();
    let columns = columns(log, &selected, &ticks);
    let failed = |error: ParquetError| LogError::Output(error.to_string());
    let schema = schema(&columns).map_err(failed)?;
    let mut writer = SerializedFileWriter::new(out, Arc::new(schema), Arc::new(properties(log, &columns)))
        .map_err(failed)?;
    for ticks in ticks.chunks(ROWS_MAX) {
        let mut group = writer.next_row_group().map_err(failed)?;
        for column in &columns {
            write_column(log, column, ticks, &mut group).map_err(failed)?;
        }
        group.close().map_err(failed)?;
    }
    writer.close().map_err(failed)?;
    Ok(ticks.len() as u64)
}

fn columns(log: &LogReader, selected: &[(usize, usize)], ticks: &[u64]) -> Vec<Column> {
    let base = |name: &str, unit: &str, comment: &str, kind, source| Column {
        name: name.to_owned(),
        unit: unit.to_owned(),
        comment: comment.to_owned(),
        kind,
        source,
        optional: false,
    };
    let mut columns = vec![
        base("tick", "", "tick number", Kind::U64, Source::Tick),
        base("time_s", "s", "start of the tick since tick 0", Kind::F64, Source::Time),
    ];
    let docs: BTreeMap<usize, _> = selected
        .iter()
        .map(|&(region, _)| {
            let log = &log.regions()[region];
            (region, docs_of(&log.name, &log.layout_hash))
        })
        .collect();
    for &(r, c) in selected {
        let region = &log.regions()[r];
        let column = &region.columns[c];
        let doc = docs[&r].iter().find(|(name, _)| *name == column.name).map_or("", |(_, doc)| doc);
        columns.push(Column {
            name: format!("{}.{}", region.name, column.name),
            unit: if column.unit == "1" { String::new() } else { pretty(&column.unit) },
            comment: doc.to_owned(),
            kind: column.kind,
            source: Source::Word(r, c),
            optional: region.ticks.len() != ticks.len(),
        });
    }
    columns
}

fn schema(columns: &[Column]) -> Result<Type, ParquetError> {
    let fields = columns.iter().map(|column| {
        let physical = match column.kind {
            Kind::F64 => Physical::DOUBLE,
            Kind::U64 => Physical::INT64,
        };
        let repetition = if column.optional { Repetition::OPTIONAL } else { Repetition::REQUIRED };
        let field = Type::primitive_type_builder(&column.name, physical).with_repetition(repetition);
        let field = match column.kind {
            Kind::F64 => field,
            Kind::U64 => field
                .with_logical_type(Some(LogicalType::integer(64, false)))
                .with_converted_type(ConvertedType::UINT_64),
        };
        field.build().map(Arc::new)
    });
    Type::group_type_builder("log").with_fields(fields.collect::<Result<Vec<_>, _>>()?).build()
}

fn properties(log: &LogReader, columns: &[Column]) -> WriterProperties {
    let header = &log.header;
    let about = |text: fn(&Column) -> &str| {
        columns.iter().map(|c| (c.name.clone(), json!(text(c)))).collect::<serde_json::Map<_, _>>()
    };
    let by_column: serde_json::Map<_, _> =
        columns.iter().map(|c| (c.name.clone(), json!({ "unit": c.unit, "comment": c.comment }))).collect();
    let attributes = json!({
        "units": about(|c| &c.unit),
        "comments": about(|c| &c.comment),
        "scenario": header.scenario,
        "bench": header.bench,
        "period_s": header.period_s(),
        "start_unix_ns": if header.lockstep { 0 } else { header.wall_start_ns },
        "configuration_hash": header.configuration_hash,
        "decimation": header.decimation,
    });
    let mut pairs = vec![
        KeyValue::new("kingpin.columns".to_owned(), serde_json::Value::from(by_column).to_string()),
        KeyValue::new("PANDAS_ATTRS".to_owned(), attributes.to_string()),
        KeyValue::new("kingpin.header".to_owned(), serde_json::to_string(header).unwrap_or_default()),
        KeyValue::new("kingpin.configuration".to_owned(), header.configuration.clone()),
    ];
    let attached = |source: &crate::Source| {
        KeyValue::new(format!("kingpin.{SOURCE_PREFIX}{}", source.name), source.text.clone())
    };
    pairs.extend(header.sources.iter().map(attached));
    let mut builder = WriterProperties::builder()
        .set_writer_version(WriterVersion::PARQUET_1_0)
        .set_created_by(format!("kingpin {}", env!("CARGO_PKG_VERSION")))
        .set_key_value_metadata(Some(pairs))
        .set_statistics_enabled(EnabledStatistics::None)
        .set_offset_index_disabled(true)
        .set_data_page_size_limit(8 << 20)
        .set_data_page_row_count_limit(ROWS_MAX)
        .set_write_batch_size(ROWS_MAX)
        .set_dictionary_enabled(false);
    for column in columns {
        if few_values(log, column) {
            // The name holds dots: a path of one part, not of three.
            let path = ColumnPath::new(vec![column.name.clone()]);
            builder = builder.set_column_dictionary_enabled(path, true);
        }
    }
    builder.build()
}

fn few_values(log: &LogReader, column: &Column) -> bool {
    let Source::Word(r, c) = column.source else { return false };
    let region = &log.regions()[r];
    let rows = region.ticks.len();
    let mut seen: Vec<u64> =
        (0..rows.min(PROBES)).map(|i| region.row(i * rows / rows.min(PROBES))[c]).collect();
    seen.sort_unstable();
    seen.dedup();
    seen.len() <= DIFFERENT_MAX
}

fn write_column<W: Write + Send>(
    log: &LogReader,
    column: &Column,
    ticks: &[u64],
    group: &mut SerializedRowGroupWriter<'_, W>,
) -> Result<(), ParquetError> {
    let Some(mut writer) = group.next_column()? else {
        return Err(ParquetError::General(format!("{}: the schema has no such column", column.name)));
    };
    let mut levels: Option<Vec<i16>> = None;
    let words: Vec<u64> = match column.source {
        Source::Tick => ticks.to_vec(),
        Source::Time => ticks.iter().map(|&tick| log.header.time_s(tick).to_bits()).collect(),
        Source::Word(r, c) => {
            let region = &log.regions()[r];
            let from = ticks.first().map_or(0, |first| region.ticks.partition_point(|t| t < first));
            let to = ticks.last().map_or(from, |last| region.ticks.partition_point(|t| t <= last));
            if column.optional {
                let there = &region.ticks[from..to];
                let mut next = 0;
                let level = |tick: &u64| {
                    let found = there.get(next) == Some(tick);
                    next += usize::from(found);
                    i16::from(found)
                };
                levels = Some(ticks.iter().map(level).collect());
            }
            (from..to).map(|row| region.row(row)[c]).collect()
        }
    };
    match column.kind {
        Kind::F64 => {
            let values: Vec<f64> = words.into_iter().map(f64::from_bits).collect();
            writer.typed::<DoubleType>().write_batch(&values, levels.as_deref(), None)?;
        }
        Kind::U64 => {
            let values: Vec<i64> = words.into_iter().map(u64::cast_signed).collect();
            writer.typed::<Int64Type>().write_batch(&values, levels.as_deref(), None)?;
        }
    }
    writer.close()
}
