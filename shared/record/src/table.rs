//! Any table of results as Parquet or CSV: a study's runs.
//!
//! Numbers that are absent are NaN in memory, null in Parquet and empty in CSV. Integers are unsigned, texts UTF-8.

use std::io::Write;
use std::sync::Arc;

use parquet::basic::{ConvertedType, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

use crate::error::LogError;
use crate::export::shortest;

/// A column of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct TableColumn {
    /// Its name.
    pub name: String,
    /// Its values.
    pub values: TableValues,
}

/// Values of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum TableValues {
    /// Unsigned integers.
    Integers(Vec<u64>),
    /// Numbers, NaN where absent.
    Numbers(Vec<f64>),
    /// Texts.
    Texts(Vec<String>),
}

/// Writes a table as Parquet, with these pairs as the file's metadata. All columns are of one length.
///
/// # Errors
/// For an output that refuses.
pub fn table_parquet(
    columns: &[TableColumn],
    about: &[(String, String)],
    out: &mut (dyn Write + Send),
) -> Result<(), LogError> {
    parquet_of(columns, about, out).map_err(|error| LogError::Output(error.to_string()))
}

fn parquet_of(
    columns: &[TableColumn],
    about: &[(String, String)],
    out: &mut (dyn Write + Send),
) -> Result<(), ParquetError> {
    let field = |column: &TableColumn| {
        let of = |physical, repetition| {
            Type::primitive_type_builder(&column.name, physical).with_repetition(repetition)
        };
        let field = match column.values {
            TableValues::Integers(_) => of(Physical::INT64, Repetition::REQUIRED)
                .with_logical_type(Some(LogicalType::integer(64, false)))
                .with_converted_type(ConvertedType::UINT_64),
            TableValues::Numbers(_) => of(Physical::DOUBLE, Repetition::OPTIONAL),
            TableValues::Texts(_) => of(Physical::BYTE_ARRAY, Repetition::REQUIRED)
                .with_logical_type(Some(LogicalType::String))
                .with_converted_type(ConvertedType::UTF8),
        };
        field.build().map(Arc::new)
    };
    let fields = columns.iter().map(field).collect::<Result<Vec<_>, _>>()?;
    let schema = Type::group_type_builder("table").with_fields(fields).build()?;
    let pairs = about.iter().map(|(key, value)| KeyValue::new(key.clone(), value.clone())).collect();
    let properties = WriterProperties::builder()
        .set_created_by(format!("kingpin {}", env!("CARGO_PKG_VERSION")))
        .set_key_value_metadata(Some(pairs))
        .build();
    let mut writer = SerializedFileWriter::new(out, Arc::new(schema), Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for column in columns {
        let Some(mut writer) = group.next_column()? else { break };
        match &column.values {
            TableValues::Integers(values) => {
                let values: Vec<i64> = values.iter().map(|v| v.cast_signed()).collect();
                writer.typed::<Int64Type>().write_batch(&values, None, None)?;
            }
            TableValues::Numbers(values) => {
                let levels: Vec<i16> = values.iter().map(|v| i16::from(!v.is_nan())).collect();
                let there: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
                writer.typed::<DoubleType>().write_batch(&there, Some(&levels), None)?;
            }
            TableValues::Texts(values) => {
                let values: Vec<ByteArray> = values.iter().map(|v| ByteArray::from(v.as_str())).collect();
                writer.typed::<ByteArrayType>().write_batch(&values, None, None)?;
            }
        }
        writer.close()?;
    }
    group.close()?;
    writer.close()?;
    Ok(())
}

/// Writes a table as CSV. Numbers are the shortest that read back to the same bits.
///
/// # Errors
/// For an output that refuses.
pub fn table_csv(columns: &[TableColumn], out: &mut dyn Write) -> Result<(), LogError> {
    let failed = |error: csv::Error| LogError::Output(error.to_string());
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(columns.iter().map(|column| &column.name)).map_err(failed)?;
    let rows = columns.first().map_or(0, |column| match &column.values {
        TableValues::Integers(values) => values.len(),
        TableValues::Numbers(values) => values.len(),
        TableValues::Texts(values) => values.len(),
    });
    for row in 0..rows {
        let cells = columns.iter().map(|column| match &column.values {
            TableValues::Integers(values) => values[row].to_string(),
            TableValues::Numbers(values) if values[row].is_nan() => String::new(),
            TableValues::Numbers(values) => shortest(values[row]),
            TableValues::Texts(values) => values[row].clone(),
        });
        csv.write_record(cells).map_err(failed)?;
    }
    csv.flush().map_err(|error| LogError::Output(error.to_string()))
}
