//! Where two logs differ, bit for bit, in the regions that two lockstep runs of one scenario must agree on.

use crate::reader::{LogReader, RegionLog, number};

/// A place where two logs differ.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Difference {
    /// The region.
    pub region: String,
    /// The tick, where it is about one.
    pub tick: Option<u64>,
    /// The column, where it is about one.
    pub column: Option<String>,
    /// What differs.
    pub what: String,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.region)?;
        if let Some(column) = &self.column {
            write!(f, ".{column}")?;
        }
        if let Some(tick) = self.tick {
            write!(f, " at tick {tick}")?;
        }
        write!(f, ": {}", self.what)
    }
}

/// The first differences of two logs: for each compared region the first tick that only one of them has,
/// and every column of the first tick whose words differ. Empty: bit-identical. NaNs are compared by their
/// bits too.
pub fn compare(log_a: &LogReader, log_b: &LogReader) -> Vec<Difference> {
    let mut differences = Vec::new();
    let mut compared = 0;
    for a in log_a.regions().iter().filter(|region| region.compared) {
        compared += 1;
        match log_b.region(&a.name) {
            Ok(b) => compare_region(a, b, &mut differences),
            Err(_) => differences.push(whole(a, "only in the first log")),
        }
    }
    for b in log_b.regions().iter().filter(|region| region.compared) {
        if log_a.region(&b.name).is_err() {
            differences.push(whole(b, "only in the second log"));
        }
    }
    if compared == 0 && differences.is_empty() {
        // Two empty logs agree on nothing that matters: that must not pass as equal.
        differences.push(Difference {
            region: "log".to_owned(),
            tick: None,
            column: None,
            what: "neither log has a region to compare".to_owned(),
        });
    }
    differences
}

fn whole(region: &RegionLog, what: &str) -> Difference {
    Difference { region: region.name.clone(), tick: None, column: None, what: what.to_owned() }
}

fn compare_region(a: &RegionLog, b: &RegionLog, differences: &mut Vec<Difference>) {
    if a.columns != b.columns {
        differences.push(whole(a, "the layouts differ"));
        return;
    }
    let (mut i, mut j) = (0, 0);
    let mut only_reported = false;
    while i < a.ticks.len() || j < b.ticks.len() {
        let (tick_a, tick_b) = (a.ticks.get(i), b.ticks.get(j));
        if tick_a != tick_b {
            let in_a = tick_b.is_none_or(|tb| tick_a.is_some_and(|ta| ta < tb));
            let tick = if in_a { tick_a } else { tick_b };
            if !only_reported {
                only_reported = true;
                differences.push(Difference {
                    region: a.name.clone(),
                    tick: tick.copied(),
                    column: None,
                    what: format!("tick only in the {} log", if in_a { "first" } else { "second" }),
                });
            }
            i += usize::from(in_a);
            j += usize::from(!in_a);
            continue;
        }
        let (row_a, row_b) = (a.row(i), b.row(j));
        if row_a != row_b {
            let columns = a.columns.iter().zip(row_a.iter().zip(row_b)).filter(|(_, (x, y))| x != y);
            differences.extend(columns.map(|(column, (&x, &y))| Difference {
                region: a.name.clone(),
                tick: Some(a.ticks[i]),
                column: Some(column.name.clone()),
                what: format!("{} against {}", shown(column.kind, x), shown(column.kind, y)),
            }));
            return;
        }
        i += 1;
        j += 1;
    }
}

fn shown(kind: regions::Kind, word: u64) -> String {
    match kind {
        regions::Kind::F64 => format!("{:e} (0x{word:016x})", number(kind, word)),
        regions::Kind::U64 => word.to_string(),
    }
}
