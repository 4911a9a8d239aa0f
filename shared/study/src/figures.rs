//! The figures kept of a run.

use config::ResolvedBench;
use config::study::{Metric, Statistic};
use metrics::handling::Assessment;
use metrics::statistics::{mean, peak, range, rms};
use record::LogReader;
use report::{Limits, summarise};
use serde_json::Value;

use crate::judge;

/// The figures, in the order of the metrics, and what is wrong with the run: empty if nothing is.
pub(crate) fn measure(
    wanted: &[Metric],
    log: &LogReader,
    resolved: &ResolvedBench,
) -> (Vec<Option<f64>>, String) {
    let mut errors: Vec<String> = Vec::new();
    let mut summary: Option<Value> = None;
    let mut assessment: Option<Result<Assessment, String>> = None;
    let values = wanted
        .iter()
        .map(|metric| {
            let found = match metric {
                Metric::Figure { figure, .. } => {
                    let judged = assessment.get_or_insert_with(|| judge::assess(log, resolved));
                    judged.as_ref().map_err(Clone::clone).and_then(|judged| named(judged, figure))
                }
                Metric::Summary { path, .. } => {
                    let summary = summary.get_or_insert_with(|| {
                        serde_json::to_value(summarise(log, &[], &Limits::default())).unwrap_or_default()
                    });
                    at(summary, path)
                }
                Metric::Signal { signal, statistic, from_s, to_s, .. } => {
                    let warm_up_s = resolved.scenario.warm_up_s;
                    let to_s = to_s.map_or(resolved.scenario.duration_s, |to| warm_up_s + to);
                    statistic_of(log, signal, *statistic, warm_up_s + from_s, to_s)
                }
            };
            match found {
                Ok(value) => Some(value).filter(|value| value.is_finite()),
                Err(why) => {
                    let why = format!("{}: {why}", metric.name());
                    errors.push(why);
                    None
                }
            }
        })
        .collect();
    if let Some(trip) = trip(log) {
        errors.insert(0, trip);
    }
    (values, errors.join("; "))
}

fn named(judged: &Assessment, figure: &str) -> Result<f64, String> {
    match judged.figures.iter().find(|known| known.name == figure) {
        Some(found) => found.value.clone().map_err(|why| format!("withheld: {why}")),
        None => {
            let known: Vec<&str> = judged.figures.iter().map(|known| known.name).collect();
            Err(format!("{} has no figure `{figure}`; it has {}", judged.procedure, known.join(", ")))
        }
    }
}

fn at(summary: &Value, path: &str) -> Result<f64, String> {
    let step = |value: &'_ Value, part: &str| -> Option<Value> {
        match part.parse::<usize>() {
            Ok(index) if value.is_array() => value.get(index).cloned(),
            _ => value.get(part).cloned(),
        }
    };
    let found = path.split('.').try_fold(summary.clone(), |value, part| step(&value, part));
    match found {
        None => Err(format!("the summary has no `{path}`")),
        Some(Value::Null) => Ok(f64::NAN),
        Some(Value::Bool(yes)) => Ok(f64::from(u8::from(yes))),
        Some(value) => value.as_f64().ok_or_else(|| format!("`{path}` of the summary is not a number")),
    }
}

fn statistic_of(
    log: &LogReader,
    name: &str,
    statistic: Statistic,
    from_s: f64,
    to_s: f64,
) -> Result<f64, String> {
    let signal = log.signal(name).map_err(|error| error.to_string())?;
    let inside = signal.time_s.iter().zip(&signal.value).filter(|(t, _)| (from_s..=to_s).contains(*t));
    let values: Vec<f64> = inside.map(|(_, value)| *value).collect();
    let ends = range(&values);
    Ok(match statistic {
        Statistic::Min => ends.map_or(f64::NAN, |(low, _)| low),
        Statistic::Max => ends.map_or(f64::NAN, |(_, high)| high),
        Statistic::Range => ends.map_or(f64::NAN, |(low, high)| high - low),
        Statistic::Peak => peak(&values),
        Statistic::Mean => mean(&values),
        Statistic::Rms => rms(&values),
        Statistic::Last => values.iter().rev().copied().find(|value| value.is_finite()).unwrap_or(f64::NAN),
    })
}

fn trip(log: &LogReader) -> Option<String> {
    let region = log.region("rig_status").ok()?;
    let (code, tick) = (region.column_index("trip_code").ok()?, region.column_index("trip_tick").ok()?);
    let last = region.row(region.ticks.len().checked_sub(1)?);
    (last[code] != 0).then(|| format!("tripped: code {} at tick {}", last[code], last[tick]))
}
