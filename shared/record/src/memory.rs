//! A log that was never a file: the rows of a run made in memory, read like any other log.

use regions::RegionId;

use crate::header::LogHeader;
use crate::reader::{LogColumn, LogReader, RegionLog, name_user_outputs};

impl LogReader {
    /// A log of these rows: by region the ticks, ascending, and their words, one row behind the other. Regions without
    /// rows are left out.
    pub fn in_memory(header: LogHeader, rows: Vec<(RegionId, Vec<u64>, Vec<u64>)>) -> LogReader {
        let mut regions: Vec<RegionLog> = rows
            .into_iter()
            .filter(|(_, ticks, _)| !ticks.is_empty())
            .map(|(id, ticks, words)| {
                let region = id.region();
                let columns = region
                    .layout
                    .columns()
                    .into_iter()
                    .map(|column| LogColumn {
                        name: column.name,
                        kind: column.kind,
                        unit: column.unit.to_owned(),
                    })
                    .collect();
                let layout_hash = format!("{:016x}", region.layout.hash());
                let (name, layout) = (region.name.to_owned(), region.layout.name.to_owned());
                RegionLog::new(name, layout, layout_hash, region.compared, columns, ticks, words)
            })
            .collect();
        name_user_outputs(&mut regions, &header.configuration);
        LogReader::of_parts(header, regions)
    }
}
