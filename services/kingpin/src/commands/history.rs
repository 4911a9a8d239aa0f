//! Logs of this bench as recorded histories: what drove one run drives another.
//!
//! `file` is a log (`.mcap`) or a run's directory, `column` a signal as `kingpin export` names it
//! (`rig_measurement.steering_wheel_angle_rad`), `time_column` is `time_s` for the ticks' own time (n·T, warm-up
//! included: set `record.start_s` to the recorded run's warm-up), or another signal of the same region.

use config::record::Samples;
use config::{Problems, ResolvedBench};
use record::LogReader;
use std::path::Path;

/// Loads a bench; recorded histories may be logs.
pub fn load_bench(scenario: &str, overrides: &[String]) -> Result<ResolvedBench, Problems> {
    ResolvedBench::load_with(scenario, overrides, &read)
}

fn read(path: &Path, time_column: &str, column: &str) -> Option<Result<Samples, String>> {
    let log = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    if !log && !path.is_dir() {
        return None;
    }
    let region = column.split('.').next().unwrap_or_default();
    let samples = || {
        let log = LogReader::open_regions(path, |name| name == region)?;
        let signal = log.signal(column)?;
        let time_s = match time_column {
            "time_s" => signal.time_s,
            name => log.signal(name)?.value,
        };
        Ok(Samples { time_s, value: signal.value })
    };
    Some(samples().map_err(|error: record::LogError| error.to_string()))
}
