//! A log as a CSV table: one row per tick, one column per signal.
//!
//! Columns: `tick`, `time_s` (start of the tick, n·T), then `region.field.label`, each with its unit as the
//! suffix of the field's name; a second header row with the unit symbols can be asked for. Rows are the
//! ticks that any selected region has. A cell is empty where the region has no such tick and `nan` where
//! the value itself is absent; infinities are `inf` and `-inf`. Numbers are the shortest that read back to
//! the same bits, counters are integers. Note that a region's own `time_s` says what time its values are
//! valid for: that of `vehicle_state` and `suspension_state` is the end of the tick.

use std::io::Write;

use regions::Kind;

use crate::error::LogError;
use crate::reader::LogReader;
use crate::select::select;

/// What to export.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CsvOptions {
    /// Regions (`rig_measurement`), fields (`rig_measurement.tie_rod_force_n`) or single signals
    /// (`rig_measurement.tie_rod_force_n.left`), or patterns (`*force_n*`), in the order of the columns. Empty: everything.
    pub selection: Vec<String>,
    /// Every how manieth tick is exported, counted from tick 0; 1 for all.
    pub decimation: u64,
    /// Whether a second header row names the units.
    pub unit_row: bool,
}

impl Default for CsvOptions {
    fn default() -> Self {
        CsvOptions { selection: Vec::new(), decimation: 1, unit_row: false }
    }
}

/// Writes a log as CSV. Returns the number of data rows.
///
/// # Errors
/// For a selection that is not in the log, and for an output that refuses.
pub fn export_csv(log: &LogReader, options: &CsvOptions, out: &mut dyn Write) -> Result<u64, LogError> {
    let columns = select(log, &options.selection)?;
    let step = options.decimation.max(1);
    let mut regions: Vec<usize> = columns.iter().map(|(region, _)| *region).collect();
    regions.sort_unstable();
    regions.dedup();
    let mut ticks: Vec<u64> = regions
        .iter()
        .flat_map(|&region| log.regions()[region].ticks.iter().copied())
        .filter(|tick| tick % step == 0)
        .collect();
    ticks.sort_unstable();
    ticks.dedup();

    let failed = |error: csv::Error| LogError::Output(error.to_string());
    let mut csv = csv::Writer::from_writer(out);
    let name = |&(region, column): &(usize, usize)| {
        let region = &log.regions()[region];
        format!("{}.{}", region.name, region.columns[column].name)
    };
    let names = columns.iter().map(name);
    csv.write_record(["tick".to_owned(), "time_s".to_owned()].into_iter().chain(names)).map_err(failed)?;
    if options.unit_row {
        let units =
            columns.iter().map(|&(region, column)| log.regions()[region].columns[column].unit.as_str());
        csv.write_record(["1", "s"].into_iter().chain(units)).map_err(failed)?;
    }
    // One cursor per region: ticks ascend in the table as in the regions.
    let mut cursors = vec![0_usize; log.regions().len()];
    for &tick in &ticks {
        for &region in &regions {
            let have = &log.regions()[region].ticks;
            while have.get(cursors[region]).is_some_and(|&t| t < tick) {
                cursors[region] += 1;
            }
        }
        csv.write_field(tick.to_string()).map_err(failed)?;
        csv.write_field(shortest(log.header.time_s(tick))).map_err(failed)?;
        for &(region, column) in &columns {
            let row = cursors[region];
            let region = &log.regions()[region];
            let cell = if region.ticks.get(row) == Some(&tick) {
                let word = region.row(row)[column];
                match region.columns[column].kind {
                    Kind::U64 => word.to_string(),
                    Kind::F64 => shortest(f64::from_bits(word)),
                }
            } else {
                String::new()
            };
            csv.write_field(cell).map_err(failed)?;
        }
        csv.write_record(None::<&[u8]>).map_err(failed)?;
    }
    csv.flush().map_err(|error| LogError::Output(error.to_string()))?;
    Ok(ticks.len() as u64)
}

/// Shortest text that reads back to the same number.
pub(crate) fn shortest(value: f64) -> String {
    if value.is_nan() {
        "nan".to_owned()
    } else if value == 0.0 || (1e-5..1e16).contains(&value.abs()) {
        value.to_string()
    } else if value.is_infinite() {
        (if value > 0.0 { "inf" } else { "-inf" }).to_owned()
    } else {
        format!("{value:e}")
    }
}

#[cfg(test)]
mod tests {
    use super::shortest;

    #[test]
    fn numbers_read_back_to_the_same_bits() {
        let values = [0.0, -0.0, 1.0, 0.1, -1.0 / 3.0, 1e-300, 5e-324, f64::MAX, 1e15, 1e16, 123.456e-6];
        for value in values {
            assert_eq!(shortest(value).parse::<f64>().unwrap().to_bits(), f64::to_bits(value), "{value:e}");
        }
        assert_eq!([shortest(f64::NAN), shortest(f64::NEG_INFINITY)], ["nan", "-inf"]);
        assert_eq!(shortest(0.001), "0.001");
    }
}
