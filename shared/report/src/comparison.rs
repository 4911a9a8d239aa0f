//! Two or more runs on one page: what differs in their configuration, their figures side by side, their curves laid over
//! each other with the differences from the first one below.
//!
//! The runs are put on one clock by the beginning of their steering, so that another warm-up or a start by hand does not
//! shift them. Differences: linear interpolation onto the first run's ticks.

use std::collections::BTreeMap;

use metrics::resample::linear;
use metrics::statistics::{peak, rms};
use record::LogReader;
use serde_json::{Value, json};

use crate::decimate::stride;
use crate::figure::{BLACK, BLUE, Figure, GREEN, ORANGE, POINTS_MAX, PURPLE, escaped, full, pretty_unit};
use crate::html::{ReportOptions, fixed};
use crate::run::Run;
use crate::shell;
use crate::source_figures::title;
use crate::summary::{RunSummary, summarise};

const DEG: f64 = 180.0 / std::f64::consts::PI;
/// Most differing values of the configuration that are listed.
const DIFFERENCES_MAX: usize = 120;
const COLOURS: [&str; 6] = [BLUE, ORANGE, GREEN, PURPLE, BLACK, "#e0a100"];

/// A run to compare.
#[derive(Debug)]
pub struct Compared<'a> {
    /// What it is called on the page.
    pub name: String,
    /// Its log.
    pub log: &'a LogReader,
    /// Measured records and limits it is judged by.
    pub options: ReportOptions,
}

/// A figure of the table: name, unit, scale from SI, decimals, where it is.
type Row = (&'static str, &'static str, f64, usize, fn(&RunSummary) -> Option<f64>);

const ROWS: &[Row] = &[
    ("Duration", "s", 1.0, 2, |s| Some(s.duration_s)),
    ("Largest speed", "km/h", 3.6, 2, |s| s.speed_m_s.map(|v| v.max)),
    ("Peak lateral acceleration", "m/s²", 1.0, 3, |s| s.peaks.lateral_acceleration_m_s2),
    ("Peak yaw rate", "°/s", DEG, 3, |s| s.peaks.yaw_rate_rad_s),
    ("Peak roll angle", "°", DEG, 3, |s| s.peaks.roll_rad),
    ("Peak side-slip angle", "°", DEG, 3, |s| s.peaks.side_slip_rad),
    ("Peak steering-wheel angle", "°", DEG, 2, |s| s.peaks.steering_wheel_angle_rad),
    ("Peak steering torque", "N·m", 1.0, 3, |s| s.peaks.steering_wheel_torque_n_m),
    ("Peak rack displacement", "mm", 1e3, 3, |s| s.peaks.rack_displacement_m),
    ("Peak tie-rod force, left", "N", 1.0, 1, |s| s.peaks.tie_rod_force_n[0]),
    ("Peak tie-rod force, right", "N", 1.0, 1, |s| s.peaks.tie_rod_force_n[1]),
    ("Torque over angle: gradient at 0", "N·m/°", 1.0 / DEG, 4, |s| s.torque_over_angle.gradient),
    ("Torque over angle: width at 0", "N·m", 1.0, 3, |s| s.torque_over_angle.width_n_m),
    ("Torque over lateral acceleration: gradient at 0", "N·m/(m/s²)", 1.0, 4, |s| {
        s.torque_over_acceleration.gradient
    }),
    ("Torque over lateral acceleration: width at 0", "N·m", 1.0, 3, |s| {
        s.torque_over_acceleration.width_n_m
    }),
    ("Tie-rod force error left, peak", "%", 1.0, 3, |s| s.force_tracking[0].error_max_percent),
    ("Tie-rod force error left, rms", "%", 1.0, 3, |s| s.force_tracking[0].error_rms_percent),
    ("Tie-rod force error right, peak", "%", 1.0, 3, |s| s.force_tracking[1].error_max_percent),
    ("Tie-rod force error right, rms", "%", 1.0, 3, |s| s.force_tracking[1].error_rms_percent),
    ("Tie-rod force lag, left", "ms", 1e3, 3, |s| s.force_tracking[0].lag_s),
    ("Tie-rod force lag, right", "ms", 1e3, 3, |s| s.force_tracking[1].lag_s),
    ("Force error felt, left, rms", "N", 1.0, 2, |s| s.force_budget[0].rms_n),
    ("Force error felt, right, rms", "N", 1.0, 2, |s| s.force_budget[1].rms_n),
    ("Energy fed into the steering", "J", 1.0, 3, |s| s.port_energy_j),
    ("Largest delay, command to force", "ms", 1e3, 2, |s| s.loop_delay_max_s),
    ("Commands late", "1", 1.0, 0, |s| s.late_command_count.map(|n| n as f64)),
];

/// A signal of a figure over time: title, title of the ordinate, scale, full name of the signal.
const SIGNALS: &[(&str, &str, f64, &str)] = &[
    (title::ANGLE, "angle in °", DEG, "rig_measurement.steering_wheel_angle_rad"),
    ("Steering-wheel torque", "torque in N·m", 1.0, "rig_measurement.steering_wheel_torque_n_m"),
    (title::ACCELERATION, "acceleration in m/s²", 1.0, "vehicle_state.acceleration_m_s2.y"),
    ("Yaw rate", "yaw rate in °/s", DEG, "vehicle_state.angular_velocity_rad_s.z"),
    (title::FORCE_LEFT, "force in N (tension positive)", 1.0, "rig_measurement.tie_rod_force_n.left"),
    (title::FORCE_RIGHT, "force in N (tension positive)", 1.0, "rig_measurement.tie_rod_force_n.right"),
    ("Rack displacement", "displacement in mm", 1e3, "rig_measurement.rack_displacement_m"),
    ("Roll angle", "angle in °", DEG, "vehicle_state.roll_rad"),
    ("Speed", "speed in km/h", 3.6, "vehicle_state.velocity_m_s.x"),
];

/// The figures of runs side by side, for programs.
pub fn comparison_json(runs: &[Compared<'_>]) -> Value {
    let summaries = summaries(runs);
    let figures: Vec<Value> = ROWS
        .iter()
        .map(|(name, unit, scale, _, of)| {
            let values: Vec<Option<f64>> = summaries.iter().map(|s| of(s).map(|v| v * scale)).collect();
            let from_first: Vec<Option<f64>> =
                values.iter().map(|v| v.zip(values[0]).map(|(v, first)| v - first)).collect();
            json!({ "figure": name, "unit": unit, "values": values, "minus_first": from_first })
        })
        .collect();
    let (differences, more) = differences(runs);
    json!({
        "runs": runs.iter().map(|r| r.name.clone()).collect::<Vec<_>>(),
        "figures": figures,
        "configuration_differences": differences.into_iter()
            .map(|(path, values)| json!({ "path": path, "values": values })).collect::<Vec<_>>(),
        "further_differences": more,
    })
}

/// A page on two or more runs. Self-contained, offline, printable.
pub fn comparison_html(runs: &[Compared<'_>]) -> String {
    let summaries = summaries(runs);
    let mut page = shell::open("Comparison – Kingpin");
    let facts: Vec<String> = runs
        .iter()
        .zip(&summaries)
        .enumerate()
        .map(|(i, (run, summary))| {
            format!(
                "<span><b style=\"color:{}\">■</b> {}: {}, run {}</span>",
                COLOURS[i % COLOURS.len()],
                escaped(&run.name),
                escaped(&summary.scenario),
                escaped(&summary.run_id)
            )
        })
        .collect();
    page += &format!(
        "<header><div class=\"bar\"><div><div class=\"brand\">Kingpin · comparison</div><h1>{} runs</h1>\
         <div class=\"facts\">{}</div></div></div></header>\n<main>\n",
        runs.len(),
        facts.join("")
    );
    let runs_read: Vec<Run<'_>> = runs.iter().map(|r| Run::new(r.log)).collect();
    let names: Vec<&str> = runs.iter().map(|r| r.name.as_str()).collect();
    let (figures, apart) = draw(&runs_read, &names);
    side_by_side(&mut page, &names, &summaries);
    curves_apart(&mut page, &names, &apart);
    configuration(&mut page, runs);
    shell::section(&mut page, &figures);
    page += "</main>\n";
    shell::close(&mut page, &figures);
    page
}

fn summaries(runs: &[Compared<'_>]) -> Vec<RunSummary> {
    runs.iter().map(|r| summarise(r.log, &r.options.overlays, &r.options.limits)).collect()
}

fn heads(page: &mut String, first: &[&str], names: &[&str]) {
    *page += "<table class=\"numbers\"><thead><tr>";
    for head in first.iter().chain(names) {
        *page += &format!("<th>{}</th>", escaped(head));
    }
    for name in &names[1.min(names.len())..] {
        *page += &format!("<th>{} − first</th>", escaped(name));
    }
    *page += "</tr></thead><tbody>";
}

fn side_by_side(page: &mut String, names: &[&str], summaries: &[RunSummary]) {
    *page += "<section id=\"side\"><h2>Side by side</h2>";
    heads(page, &["Figure"], names);
    let verdict = |s: &RunSummary| (if s.passed { "PASS" } else { "FAIL" }).to_owned();
    let mut text = |name: &str, cells: Vec<String>| {
        *page += &format!("<tr><td>{name}</td>");
        cells.iter().for_each(|cell| *page += &format!("<td>{}</td>", escaped(cell)));
        *page += &"<td></td>".repeat(cells.len() - 1);
        *page += "</tr>";
    };
    text("Against stated limits", summaries.iter().map(verdict).collect());
    text(
        "End state",
        summaries.iter().map(|s| s.end_state.clone().unwrap_or_else(|| "–".to_owned())).collect(),
    );
    for (name, unit, scale, digits, of) in ROWS {
        let values: Vec<Option<f64>> = summaries.iter().map(of).collect();
        if values.iter().all(Option::is_none) {
            continue;
        }
        let unit = if *unit == "1" { String::new() } else { format!(" [{unit}]") };
        *page += &format!("<tr><td>{}{}</td>", escaped(name), escaped(&unit));
        for value in &values {
            *page += &format!("<td>{}</td>", fixed(*value, *scale, *digits));
        }
        for value in &values[1..] {
            let apart = value.zip(values[0]).map(|(v, first)| v - first);
            let sign = if apart.is_some_and(|a| a > 0.0) { "+" } else { "" };
            *page += &format!("<td>{sign}{}</td>", fixed(apart, *scale, *digits));
        }
        *page += "</tr>";
    }
    *page += "</tbody></table></section>\n";
}

/// How far the curves are apart: signal, unit, and for each run but the first the largest and root mean square difference.
type Apart = (String, String, Vec<(f64, f64)>);

fn curves_apart(page: &mut String, names: &[&str], apart: &[Apart]) {
    *page += "<section id=\"apart\"><h2>How far the curves are apart</h2><table class=\"numbers\"><thead><tr><th>Signal</th>";
    for name in &names[1..] {
        *page += &format!("<th>{0} − first, rms</th><th>{0} − first, largest</th>", escaped(name));
    }
    *page += "</tr></thead><tbody>";
    for (name, unit, values) in apart {
        *page += &format!("<tr><td>{} [{}]</td>", escaped(name), escaped(unit));
        for (rms, peak) in values {
            let known = |v: f64| v.is_finite().then_some(v);
            *page +=
                &format!("<td>{}</td><td>{}</td>", fixed(known(*rms), 1.0, 4), fixed(known(*peak), 1.0, 4));
        }
        *page += "</tr>";
    }
    *page += "</tbody></table></section>\n";
}

fn configuration(page: &mut String, runs: &[Compared<'_>]) {
    let (found, more) = differences(runs);
    *page += "<section id=\"configuration\"><h2>What differs in the configuration</h2>";
    if found.is_empty() {
        *page += "<p class=\"note\">Nothing: the resolved configurations are equal.</p></section>\n";
        return;
    }
    *page += "<table><thead><tr><th>Value</th>";
    runs.iter().for_each(|run| *page += &format!("<th>{}</th>", escaped(&run.name)));
    *page += "</tr></thead><tbody>";
    for (path, values) in &found {
        *page += &format!("<tr><td><code>{}</code></td>", escaped(path));
        for value in values {
            let text = value.as_ref().map_or_else(|| "–".to_owned(), |v| shortened(&v.to_string()));
            *page += &format!("<td>{}</td>", escaped(&text));
        }
        *page += "</tr>";
    }
    *page += "</tbody></table>";
    if more > 0 {
        *page += &format!("<p class=\"note\">And {more} more.</p>");
    }
    *page += "</section>\n";
}

fn shortened(text: &str) -> String {
    const MOST: usize = 80;
    if text.chars().count() <= MOST {
        text.to_owned()
    } else {
        text.chars().take(MOST).chain(['…']).collect()
    }
}

/// A key of the configuration with its value in each run.
type Differing = (String, Vec<Option<Value>>);

/// Values of the configuration that are not the same in all runs, by their paths, and how many more there are.
fn differences(runs: &[Compared<'_>]) -> (Vec<Differing>, usize) {
    let leaves: Vec<BTreeMap<String, Value>> = runs
        .iter()
        .map(|run| {
            let mut found = BTreeMap::new();
            if let Ok(value) = serde_json::from_str::<Value>(&run.log.header.configuration) {
                flatten(&value, "", &mut found);
            }
            found
        })
        .collect();
    let paths: std::collections::BTreeSet<&String> = leaves.iter().flat_map(BTreeMap::keys).collect();
    let mut found: Vec<(String, Vec<Option<Value>>)> = paths
        .into_iter()
        .map(|path| (path.clone(), leaves.iter().map(|l| l.get(path).cloned()).collect::<Vec<_>>()))
        .filter(|(_, values)| values.windows(2).any(|pair| pair[0] != pair[1]))
        .collect();
    let more = found.len().saturating_sub(DIFFERENCES_MAX);
    found.truncate(DIFFERENCES_MAX);
    (found, more)
}

fn flatten(value: &Value, path: &str, found: &mut BTreeMap<String, Value>) {
    let below = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match value {
        Value::Object(map) => map.iter().for_each(|(key, value)| flatten(value, &below(key), found)),
        // Lists of numbers are one value; lists of tables are taken apart.
        Value::Array(list) if list.iter().any(Value::is_object) => {
            list.iter().enumerate().for_each(|(i, value)| flatten(value, &format!("{path}[{i}]"), found));
        }
        leaf => {
            found.insert(path.to_owned(), leaf.clone());
        }
    }
}

/// Time at which steering begins, on the run's own clock; its first tick if it never does. [s]
fn beginning_s(run: &Run<'_>) -> f64 {
    let time_s = run.time_s();
    let active = run.words("vehicle_state", "manoeuvre_active").unwrap_or_default();
    let first = active.iter().position(|word| *word == Some(1)).unwrap_or(0);
    time_s.get(first).copied().unwrap_or(0.0)
}

/// All figures, and how far the curves are apart.
fn draw(runs: &[Run<'_>], names: &[&str]) -> (Vec<Figure>, Vec<Apart>) {
    let begins: Vec<f64> = runs.iter().map(beginning_s).collect();
    let (mut figures, mut apart) = (Vec::new(), Vec::new());
    for (title, y_title, scale, signal) in SIGNALS {
        let curves: Vec<Option<(Vec<f64>, Vec<f64>)>> = runs
            .iter()
            .zip(&begins)
            .map(|(run, begin_s)| {
                let signal = run.log.signal(signal).ok()?;
                Some((signal.time_s.iter().map(|t| t - begin_s).collect(), signal.value))
            })
            .collect();
        let mut over = Figure::over_time(title, y_title);
        over.layout["xaxis"]["title"]["text"] = json!("time since the beginning of steering in s");
        for (i, curve) in curves.iter().enumerate() {
            if let Some((t, v)) = curve {
                over.curve(names[i], t, v, *scale, full(COLOURS[i % COLOURS.len()]));
            }
        }
        let mut away = Figure::over_time(&format!("{title}: minus the first run"), y_title);
        away.layout["xaxis"]["title"]["text"] = json!("time since the beginning of steering in s");
        let mut figures_apart = Vec::new();
        if let Some(Some((t, first))) = curves.first() {
            for (i, curve) in curves.iter().enumerate().skip(1) {
                let Some((other_t, other)) = curve else {
                    figures_apart.push((f64::NAN, f64::NAN));
                    continue;
                };
                let there = linear(other_t, other, t);
                let difference: Vec<f64> = there.iter().zip(first).map(|(o, f)| o - f).collect();
                away.curve(names[i], t, &difference, *scale, full(COLOURS[i % COLOURS.len()]));
                figures_apart.push((scale.abs() * rms(&difference), scale.abs() * peak(&difference)));
            }
        }
        let unit = y_title.split(" in ").nth(1).unwrap_or("").split(" (").next().unwrap_or("");
        apart.push(((*title).to_owned(), pretty_unit(unit), figures_apart));
        figures.extend([over, away]);
    }
    let torque = "rig_measurement.steering_wheel_torque_n_m";
    let y_title = "steering-wheel torque in N·m";
    figures.push(cross(
        runs,
        names,
        (title::TORQUE_ANGLE, "steering-wheel angle in °", y_title),
        ("rig_measurement.steering_wheel_angle_rad", DEG),
        torque,
    ));
    figures.push(cross(
        runs,
        names,
        (title::TORQUE_ACCELERATION, "lateral acceleration in m/s²", y_title),
        ("vehicle_state.acceleration_m_s2.y", 1.0),
        torque,
    ));
    let path = ("Path of the car", "x in m", "y in m (left positive)");
    figures.push(cross(runs, names, path, ("vehicle_state.position_m.x", 1.0), "vehicle_state.position_m.y"));
    figures.retain(|figure| !figure.is_empty());
    (figures, apart)
}

/// One signal over another, of all runs, while steering is active.
fn cross(runs: &[Run<'_>], names: &[&str], titles: (&str, &str, &str), x: (&str, f64), y: &str) -> Figure {
    let mut figure = Figure::new(titles.0, titles.1, titles.2).layout(&json!({ "hovermode": "closest" }));
    for (i, run) in runs.iter().enumerate() {
        let column =
            |name: &str| name.split_once('.').and_then(|(region, column)| run.numbers(region, column));
        let (Some(a), Some(b)) = (column(x.0), column(y)) else { continue };
        let active = run.active().filter(|a| a.contains(&true));
        let points: Vec<(f64, f64)> = (0..a.len())
            .filter(|&k| active.as_ref().is_none_or(|on| on[k]) && a[k].is_finite() && b[k].is_finite())
            .map(|k| (a[k] * x.1, b[k]))
            .collect();
        let step = stride(points.len(), 2 * POINTS_MAX);
        let (a, b): (Vec<f64>, Vec<f64>) = points.into_iter().step_by(step).unzip();
        if a.len() > 1 {
            figure.push(names[i], &a, &b, full(COLOURS[i % COLOURS.len()]), &json!({}));
        }
    }
    figure
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn configurations_are_taken_apart_to_values() {
        let mut found = BTreeMap::new();
        flatten(&json!({"a": {"b": 1, "c": [1, 2]}, "d": [{"e": 2}]}), "", &mut found);
        let paths: Vec<&str> = found.keys().map(String::as_str).collect();
        assert_eq!(paths, ["a.b", "a.c", "d[0].e"]);
    }
}
