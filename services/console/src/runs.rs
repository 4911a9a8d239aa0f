//! Recorded runs: the list, their reports, two of them compared.

use crate::hub::{Hub, log_name};
use crate::signals;
use serde_json::{Value, json};
use std::path::Path;

/// Runs listed at most, newest first.
const LIST_MAX: usize = 200;
/// Points of a compared curve.
const POINTS: usize = 1000;

fn about(name: &str, directory: &Path) -> Value {
    let read = |file: &str| std::fs::read(directory.join(file)).ok();
    let summary: Value =
        read("summary.json").and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default();
    let seconds = std::fs::metadata(directory)
        .and_then(|data| data.modified())
        .ok()
        .and_then(|at| at.duration_since(std::time::UNIX_EPOCH).ok())
        .map_or(0, |since| since.as_secs());
    json!({
        "name": name, "unix_s": seconds, "report": directory.join("report.html").is_file(),
        "scenario": summary["scenario"], "duration_s": summary["duration_s"], "end_state": summary["end_state"],
        "failures": summary["run"]["failures"], "mode": summary["run"]["mode"],
    })
}

/// All runs there are.
pub(crate) fn list(hub: &Hub) -> Value {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(&hub.runs).into_iter().flatten().flatten() {
        let path = entry.path();
        if record::log_files(&path).is_ok_and(|files| !files.is_empty()) {
            found.push(about(&entry.file_name().to_string_lossy(), &path));
        }
    }
    found.sort_by_key(|run| std::cmp::Reverse(run["unix_s"].as_u64()));
    found.truncate(LIST_MAX);
    if let Some(log) = &hub.log {
        let directory = if log.is_dir() { log.as_path() } else { log.parent().unwrap_or(Path::new(".")) };
        found.insert(0, about(&log_name(log), directory));
    }
    Value::Array(found)
}

/// Two runs side by side: their summaries, and a signal of both, thinned out to extremes.
pub(crate) fn compare(hub: &Hub, a: &str, b: &str, signal: &str) -> Result<Value, String> {
    if signals::find(signal).is_none() {
        return Err(format!("there is no signal `{signal}`"));
    }
    let one = |name: &str| -> Result<Value, String> {
        let directory = hub.run_directory(name)?;
        let summary: Value = std::fs::read(directory.join("summary.json"))
            .ok()
            .and_then(|text| serde_json::from_slice(&text).ok())
            .unwrap_or_default();
        let (log, _) = hub.open_log(name)?;
        let signal = log.signal(signal).map_err(|e| e.to_string())?;
        let (time_s, value) = thin(&signal.time_s, &signal.value, POINTS);
        Ok(json!({"name": name, "summary": summary, "unit": signal.unit, "time_s": time_s, "value": value}))
    };
    Ok(json!({"signal": signal, "runs": [one(a)?, one(b)?]}))
}

/// The page that compares two runs.
pub(crate) fn comparison(hub: &Hub, a: &str, b: &str) -> Result<String, String> {
    let logs = [(a, hub.open_log(a)?.0), (b, hub.open_log(b)?.0)];
    let compared = logs.each_ref().map(|(name, log)| report::Compared {
        name: (*name).to_owned(),
        log,
        options: report::ReportOptions::default(),
    });
    Ok(report::comparison_html(&compared))
}

/// A curve of at most `points` points that keeps each stretch's smallest and largest value.
fn thin(time_s: &[f64], value: &[f64], points: usize) -> (Vec<f64>, Vec<Option<f64>>) {
    let finite = |v: f64| v.is_finite().then_some(v);
    if value.len() <= points {
        return (time_s.to_vec(), value.iter().copied().map(finite).collect());
    }
    let stretch = value.len().div_ceil(points / 2);
    let mut thinned = (Vec::new(), Vec::new());
    for (times, values) in time_s.chunks(stretch).zip(value.chunks(stretch)) {
        let by = |a: &usize, b: &usize| values[*a].total_cmp(&values[*b]);
        let numbers = || (0..values.len()).filter(|&i| values[i].is_finite());
        match (numbers().min_by(by), numbers().max_by(by)) {
            (Some(low), Some(high)) => {
                for at in [low.min(high), low.max(high)] {
                    thinned.0.push(times[at]);
                    thinned.1.push(Some(values[at]));
                }
            }
            // A stretch without a number is a gap.
            _ => {
                thinned.0.push(times[0]);
                thinned.1.push(None);
            }
        }
    }
    thinned
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_extremes_order_and_gaps() {
        let time: Vec<f64> = (0..10_000).map(f64::from).collect();
        let mut value: Vec<f64> = time.iter().map(|t| (t * 0.01).sin()).collect();
        value[4321] = 9.0;
        value[1234] = -9.0;
        value[6000..6100].fill(f64::NAN);
        let (t, v) = thin(&time, &value, 1000);
        assert!(t.len() <= 1000 && t.is_sorted());
        assert!(v.contains(&Some(9.0)) && v.contains(&Some(-9.0)) && v.contains(&None));
        assert_eq!(thin(&time[..10], &value[..10], 1000).0.len(), 10);
    }
}
