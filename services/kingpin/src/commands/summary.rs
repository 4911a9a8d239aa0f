//! Summary and report of a run, with the measured records its configuration names laid over.

use super::log::write_whole;
use config::ResolvedBench;
use config::scenario::Signal;
use record::LogReader;
use report::{Limits, Overlay, ReportOptions, RunSummary, report_html, summarise};
use serde_json::Value;
use std::path::Path;

/// The bench's signal a measured one belongs to, and its unit symbol.
fn target(signal: Signal) -> (&'static str, &'static str) {
    match signal {
        Signal::SteeringWheelAngle => ("rig_measurement.steering_wheel_angle_rad", "rad"),
        Signal::SteeringWheelTorque => ("rig_measurement.steering_wheel_torque_n_m", "N*m"),
        Signal::Speed => ("vehicle_state.velocity_m_s.x", "m/s"),
        Signal::LateralAcceleration => ("vehicle_state.acceleration_m_s2.y", "m/s^2"),
        Signal::LongitudinalAcceleration => ("vehicle_state.acceleration_m_s2.x", "m/s^2"),
        Signal::YawRate => ("vehicle_state.angular_velocity_rad_s.z", "rad/s"),
        Signal::RollAngle => ("vehicle_state.roll_rad", "rad"),
        Signal::RollRate => ("vehicle_state.angular_velocity_rad_s.x", "rad/s"),
        Signal::PitchAngle => ("vehicle_state.pitch_rad", "rad"),
        Signal::TieRodForceLeft => ("rig_measurement.tie_rod_force_n.left", "N"),
        Signal::TieRodForceRight => ("rig_measurement.tie_rod_force_n.right", "N"),
    }
}

/// What the report lays over: the records of the configuration, within the run, on the run's clock.
pub fn options(log: &LogReader) -> ReportOptions {
    let mut options =
        ReportOptions { title: None, description: None, overlays: Vec::new(), limits: Limits::default() };
    // A log of another version may carry a configuration this one does not read: then without overlays.
    let Ok(resolved) = ResolvedBench::from_json(&log.header.configuration) else {
        return options;
    };
    let scenario = &resolved.scenario;
    options.description = Some(scenario.description.clone());
    let measured = resolved.record.iter().flat_map(|record| &record.measured);
    for signal in measured {
        let (target, unit) = target(signal.signal);
        let inside = |&(time, _): &(f64, f64)| (0.0..=scenario.duration_s).contains(&time);
        let shifted = signal.series.time_s.iter().map(|tau| tau + scenario.warm_up_s);
        let (time_s, value) = shifted.zip(signal.series.value.iter().copied()).filter(inside).unzip();
        options.overlays.push(Overlay {
            title: format!("measured: {}", signal.column),
            unit: unit.to_owned(),
            time_s,
            value,
            target: target.to_owned(),
        });
    }
    options
}

/// Writes the report of a log and returns its summary.
pub fn write_report(log: &LogReader, path: &Path) -> Result<RunSummary, String> {
    let options = options(log);
    let page = report_html(log, &options);
    write_whole(path, |out| out.write_all(page.as_bytes()).map_err(|e| e.to_string()))?;
    Ok(summarise(log, &options.overlays, &options.limits))
}

/// Writes `summary.json`, with `run` about how the run was made, and, if wanted, `report.html`.
pub fn write_all(log: &LogReader, directory: &Path, report: bool, run: &Value) -> Result<Value, String> {
    let summary = if report {
        write_report(log, &directory.join("report.html"))?
    } else {
        let options = options(log);
        summarise(log, &options.overlays, &options.limits)
    };
    let mut value = serde_json::to_value(&summary).unwrap_or_default();
    value["run"] = run.clone();
    let text = serde_json::to_string_pretty(&value).unwrap_or_default();
    write_whole(&directory.join("summary.json"), |out| {
        out.write_all(text.as_bytes()).map_err(|e| e.to_string())
    })?;
    Ok(value)
}

/// The summary in a few lines.
pub fn text(summary: &Value) -> String {
    let number = |value: &Value, scale: f64, digits: usize| match value.as_f64() {
        Some(number) => format!("{:.digits$}", scale * number),
        None => "-".to_owned(),
    };
    let mut lines = vec![format!(
        "{}: {:.2} s, ended {}",
        summary["scenario"].as_str().unwrap_or_default(),
        summary["duration_s"].as_f64().unwrap_or(0.0),
        summary["end_state"].as_str().unwrap_or("unknown"),
    )];
    let peaks = &summary["peaks"];
    lines.push(format!(
        "  peaks: lateral acceleration {} m/s², yaw rate {} deg/s, tie rods {} N and {} N",
        number(&peaks["lateral_acceleration_m_s2"], 1.0, 2),
        number(&peaks["yaw_rate_rad_s"], 1f64.to_degrees(), 1),
        number(&peaks["tie_rod_force_n"][0], 1.0, 0),
        number(&peaks["tie_rod_force_n"][1], 1.0, 0),
    ));
    for (side, name) in ["left", "right"].iter().enumerate() {
        let figures = &summary["force_tracking"][side];
        lines.push(format!(
            "  tie-rod force {name}: error max {} %, rms {} %, lag {} ms",
            number(&figures["error_max_percent"], 1.0, 2),
            number(&figures["error_rms_percent"], 1.0, 2),
            number(&figures["lag_s"], 1e3, 1),
        ));
    }
    for overlay in summary["overlays"].as_array().into_iter().flatten() {
        lines.push(format!(
            "  {}: error {} {} rms ({} % of the measured rms once aligned, lag {} ms)",
            overlay["title"].as_str().unwrap_or_default(),
            number(&overlay["rms_error"], 1.0, 3),
            overlay["unit"].as_str().unwrap_or_default(),
            number(&overlay["normalised_rms_error_percent"], 1.0, 1),
            number(&overlay["lag_s"], 1e3, 0),
        ));
    }
    if summary["lockstep"] == Value::Bool(false) {
        lines.push(format!("  commands late for the output phase: {}", summary["late_command_count"]));
    }
    lines.join("\n")
}
