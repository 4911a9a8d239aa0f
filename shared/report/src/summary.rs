//! The figures of a run, as `summary.json` has them. SI units; absent is `null`.

use std::collections::BTreeMap;

use metrics::fit::{gradient, passage};
use metrics::statistics::{Distribution, mean, peak, range};
use metrics::tracking::{Tracking, tracking};
use record::LogReader;
use regions::History;

use crate::force_budget::{ForceBudget, force_budgets};
use crate::overlay::{Overlay, OverlayResult, RecordLoop, compare_overlay, record_loops};
use crate::run::Run;
use crate::table::{FLAGGED, TRIPPED, state_name};
use crate::verdict::{Limits, Verdict, judge};

/// Format of the summary, raised with every change of meaning.
const FORMAT: &str = "kingpin.summary/1";

/// A run in figures.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RunSummary {
    /// Format of this summary.
    pub format: String,
    /// Name of the bench.
    pub bench: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Number of the run, 16 hexadecimal digits.
    pub run_id: String,
    /// Whether the run was in lockstep: then it says nothing about real time.
    pub lockstep: bool,
    /// Seed of everything random.
    pub seed: u64,
    /// Period. \[s\]
    pub period_s: f64,
    /// Hash of the configuration.
    pub configuration_hash: String,
    /// Versions of the parts.
    pub versions: BTreeMap<String, String>,
    /// Whether every verdict that could be reached is a pass.
    pub passed: bool,
    /// Verdicts against stated limits.
    pub verdicts: Vec<Verdict>,
    /// Ticks from the first to the last in the log.
    pub ticks: u64,
    /// Their duration. \[s\]
    pub duration_s: f64,
    /// Bench state at the end.
    pub end_state: Option<String>,
    /// Ticks spent in each bench state.
    pub state_ticks: BTreeMap<String, u64>,
    /// The first trip, if there was one.
    pub trip: Option<Trip>,
    /// Speed of the car. [m/s]
    pub speed_m_s: Option<Span>,
    /// Largest magnitudes.
    pub peaks: Peaks,
    /// Tie-rod force, left and right: command against load cell.
    pub force_tracking: [TrackingFigures; 2],
    /// Tie-rod force, left and right: command against the virtual plant's true force.
    pub true_force_tracking: [TrackingFigures; 2],
    /// Where the tie-rod force error comes from, left and right.
    #[serde(default)]
    pub force_budget: [ForceBudget; 2],
    /// Ball height, left and right: command against measured stroke.
    pub height_tracking: [TrackingFigures; 2],
    /// Steering torque over steering-wheel angle.
    pub torque_over_angle: LoopFigures,
    /// Steering torque over lateral acceleration.
    pub torque_over_acceleration: LoopFigures,
    /// Energy fed into the steering by the tracking error over the run. \[J\]
    pub port_energy_j: Option<f64>,
    /// Largest of it in one steering cycle. \[J\]
    pub port_energy_cycle_max_j: Option<f64>,
    /// Largest of it in one second. \[J\]
    pub port_energy_second_max_j: Option<f64>,
    /// Largest estimated delay from force command to measured force. \[s\]
    pub loop_delay_max_s: Option<f64>,
    /// The multibody solver.
    pub solver: SolverSummary,
    /// Timing of each service by the wall clock.
    pub timing: Vec<ServiceTiming>,
    /// Command's arrival before the output phase: smallest, mean, largest. \[s\]
    pub margin_s: Option<Span>,
    /// Commands that were not there at the output phase.
    pub late_command_count: Option<u64>,
    /// Ticks on which each flag was set.
    pub flag_ticks: BTreeMap<String, u64>,
    /// The log itself.
    pub log: LogSummary,
    /// Measured records against this run.
    pub overlays: Vec<OverlayResult>,
    /// Measured steering-torque loops against this run's, where torque and its abscissa are recorded.
    #[serde(default)]
    pub record_loops: Vec<RecordLoop>,
}

/// Smallest, mean and largest value.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Span {
    /// Smallest.
    pub min: f64,
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: f64,
}

/// A trip of the bench's safety.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Trip {
    /// Its code.
    pub code: u64,
    /// Its tick.
    pub tick: u64,
    /// Start of that tick. \[s\]
    pub time_s: f64,
    /// The limit. [SI unit of the quantity]
    pub limit: Option<f64>,
    /// The value that broke it. [SI unit of the quantity]
    pub value: Option<f64>,
}

/// Largest magnitudes of the run.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Peaks {
    /// Lateral acceleration. [m/s²]
    pub lateral_acceleration_m_s2: Option<f64>,
    /// Yaw rate. [rad/s]
    pub yaw_rate_rad_s: Option<f64>,
    /// Roll angle. \[rad\]
    pub roll_rad: Option<f64>,
    /// Side-slip angle at the centre of gravity. \[rad\]
    pub side_slip_rad: Option<f64>,
    /// Hand-wheel angle. \[rad\]
    pub steering_wheel_angle_rad: Option<f64>,
    /// Hand-wheel torque. [N·m]
    pub steering_wheel_torque_n_m: Option<f64>,
    /// Rack displacement. \[m\]
    pub rack_displacement_m: Option<f64>,
    /// Measured tie-rod force, left and right. \[N\]
    pub tie_rod_force_n: [Option<f64>; 2],
}

/// How well a command was reached; see `metrics::tracking`.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TrackingFigures {
    /// Why there are no figures, if there are none.
    pub withheld: Option<String>,
    /// Half the peak-to-peak of the command. [N or m]
    pub amplitude: Option<f64>,
    /// Largest error. [N or m]
    pub error_max: Option<f64>,
    /// Root mean square error. [N or m]
    pub error_rms: Option<f64>,
    /// Largest error over amplitude. [%]
    pub error_max_percent: Option<f64>,
    /// Root mean square error over amplitude. [%]
    pub error_rms_percent: Option<f64>,
    /// Lag behind the command. \[s\]
    pub lag_s: Option<f64>,
}

/// A loop of steering torque while steering is active. The gradient is that of the line through the points
/// within a tenth of the largest deflection around 0, the width the torque at 0 with rising minus with falling
/// deflection. Not the figures of ISO 13674-1: those need its conditions.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LoopFigures {
    /// Gradient at 0. [N·m/rad] or [N·m/(m/s²)]
    pub gradient: Option<f64>,
    /// Width of the hysteresis at 0. [N·m]
    pub width_n_m: Option<f64>,
}

/// The multibody solver over the run.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SolverSummary {
    /// Most Newton iterations of a tick.
    pub iterations_max: Option<u64>,
    /// Largest constraint residual left. \[m\]
    pub residual_max_m: Option<f64>,
    /// Ticks on which the last pose was held.
    pub not_converged_ticks: Option<u64>,
}

/// A service by the wall clock.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ServiceTiming {
    /// Name of the service.
    pub service: String,
    /// Wake-up after the time aimed at. \[s\]
    pub wake_lateness_s: Option<Percentiles>,
    /// Time of a step. \[s\]
    pub compute_s: Option<Percentiles>,
    /// End of the step after the start of the tick. \[s\]
    pub done_s: Option<Percentiles>,
    /// Wake-ups later than a tenth of the period.
    pub late_wake_count: u64,
    /// Steps that ran past their share of the period.
    pub overrun_count: u64,
    /// Ticks stepped from held inputs, or skipped.
    pub missed_count: u64,
    /// Ticks stepped late to catch up.
    pub caught_up_count: u64,
}

/// A distribution in percentiles.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p99_9: f64,
    /// Largest.
    pub max: f64,
}

/// How complete the log is.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LogSummary {
    /// Files, by name.
    pub files: Vec<String>,
    /// Whether the last file was ended by its writer.
    pub finished: bool,
    /// Ticks that lie in gaps, by region; only regions that are written every tick.
    pub missing_ticks: BTreeMap<String, u64>,
    /// First gap of each region that has one: first and last missing tick.
    pub first_gap: BTreeMap<String, (u64, u64)>,
    /// Ticks that two files have, with the same content.
    pub duplicate_ticks: u64,
    /// Ticks that two files have with different content.
    pub conflicting_ticks: u64,
    /// Bytes that could not be read.
    pub bytes_dropped: u64,
    /// Ticks the logger lost because it lagged.
    pub lost_count: Option<u64>,
    /// Writes the disk refused.
    pub write_error_count: Option<u64>,
}

/// A number that can stand in JSON.
pub(crate) fn known(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Makes the figures of a run.
pub fn summarise(log: &LogReader, overlays: &[Overlay], limits: &Limits) -> RunSummary {
    let run = Run::new(log);
    let peak_of = |region: &str, column: &str| known(peak(&run.numbers(region, column)?));
    let state_words = run.words("rig_status", "state").unwrap_or_default();
    let mut state_ticks = BTreeMap::new();
    for code in state_words.iter().flatten() {
        *state_ticks.entry(state_name(*code)).or_insert(0) += 1;
    }
    let side = |i: usize| ["left", "right"][i];
    let mut summary = RunSummary {
        format: FORMAT.to_owned(),
        bench: log.header.bench.clone(),
        scenario: log.header.scenario.clone(),
        run_id: format!("{:016x}", log.header.run_id),
        lockstep: log.header.lockstep,
        seed: log.header.seed,
        period_s: run.period_s(),
        configuration_hash: log.header.configuration_hash.clone(),
        versions: log.header.versions.clone(),
        passed: false,
        verdicts: Vec::new(),
        ticks: run.len() as u64,
        duration_s: run.len() as f64 * run.period_s(),
        end_state: run.last("rig_status", "state").map(state_name),
        state_ticks,
        trip: first_trip(&run),
        speed_m_s: speed(&run).and_then(|speed| span(&speed)),
        peaks: Peaks {
            lateral_acceleration_m_s2: peak_of("vehicle_state", "acceleration_m_s2.y"),
            yaw_rate_rad_s: peak_of("vehicle_state", "angular_velocity_rad_s.z"),
            roll_rad: peak_of("vehicle_state", "roll_rad"),
            side_slip_rad: peak_of("vehicle_state", "side_slip_rad"),
            steering_wheel_angle_rad: peak_of("rig_measurement", "steering_wheel_angle_rad"),
            steering_wheel_torque_n_m: peak_of("rig_measurement", "steering_wheel_torque_n_m"),
            rack_displacement_m: peak_of("rig_measurement", "rack_displacement_m"),
            tie_rod_force_n: [0, 1]
                .map(|i| peak_of("rig_measurement", &format!("tie_rod_force_n.{}", side(i)))),
        },
        force_tracking: [0, 1].map(|i| {
            track(
                &run,
                ("rig_status", "tie_rod_force_command_n"),
                ("rig_measurement", "tie_rod_force_n"),
                side(i),
            )
        }),
        true_force_tracking: [0, 1].map(|i| {
            track(
                &run,
                ("rig_status", "tie_rod_force_command_n"),
                ("rig_status", "true_tie_rod_force_n"),
                side(i),
            )
        }),
        force_budget: force_budgets(&run),
        height_tracking: [0, 1].map(|i| {
            track(
                &run,
                ("rig_status", "ball_height_applied_m"),
                ("rig_measurement", "vertical_stroke_m"),
                side(i),
            )
        }),
        torque_over_angle: torque_loop(&run, "rig_measurement", "steering_wheel_angle_rad"),
        torque_over_acceleration: torque_loop(&run, "vehicle_state", "acceleration_m_s2.y"),
        port_energy_j: run.last("rig_status", "port_energy_j").and_then(|w| known(f64::from_bits(w))),
        port_energy_cycle_max_j: peak_of("rig_status", "port_energy_cycle_j"),
        port_energy_second_max_j: peak_of("rig_status", "port_power_w"),
        loop_delay_max_s: peak_of("rig_status", "loop_delay_s"),
        solver: solver(&run),
        timing: ["rig", "vehicle", "multibody"]
            .into_iter()
            .filter_map(|service| timing(&run, service))
            .collect(),
        margin_s: run.numbers("rig_timing", "margin_s").and_then(|margin| span(&margin)),
        late_command_count: run.last("rig_status", "late_command_count"),
        flag_ticks: flag_ticks(&run),
        log: log_summary(&run),
        overlays: overlays.iter().map(|overlay| compare_overlay(log, overlay)).collect(),
        record_loops: Vec::new(),
    };
    summary.record_loops =
        record_loops(&run, overlays, [summary.torque_over_angle, summary.torque_over_acceleration]);
    summary.verdicts = judge(&summary, limits);
    summary.passed = summary.verdicts.iter().all(|verdict| !verdict.failed());
    summary
}

/// Speed in the horizontal plane of the body. [m/s]
pub(crate) fn speed(run: &Run<'_>) -> Option<Vec<f64>> {
    let x = run.numbers("vehicle_state", "velocity_m_s.x")?;
    let y = run.numbers("vehicle_state", "velocity_m_s.y")?;
    Some(x.iter().zip(&y).map(|(x, y)| x.hypot(*y)).collect())
}

fn span(values: &[f64]) -> Option<Span> {
    let (min, max) = range(values)?;
    Some(Span { min, mean: mean(values), max })
}

fn first_trip(run: &Run<'_>) -> Option<Trip> {
    let region = run.log.region("rig_status").ok()?;
    let index = |name: &str| region.column_index(name).ok();
    let (state, code) = (index("state")?, index("trip_code")?);
    let row =
        (0..region.ticks.len()).map(|row| region.row(row)).find(|r| r[state] == TRIPPED || r[code] != 0)?;
    let number = |name: &str| index(name).and_then(|i| known(f64::from_bits(row[i])));
    let tick = row[index("trip_tick")?];
    Some(Trip {
        code: row[code],
        tick,
        time_s: run.log.header.time_s(tick),
        limit: number("trip_limit"),
        value: number("trip_value"),
    })
}

fn track(run: &Run<'_>, command: (&str, &str), measured: (&str, &str), side: &str) -> TrackingFigures {
    let mut figures = TrackingFigures {
        withheld: None,
        amplitude: None,
        error_max: None,
        error_rms: None,
        error_max_percent: None,
        error_rms_percent: None,
        lag_s: None,
    };
    let column = |(region, column): (&str, &str)| run.numbers(region, &format!("{column}.{side}"));
    let (Some(command), Some(measured), Some(active)) = (column(command), column(measured), run.active())
    else {
        figures.withheld = Some("not in this log".to_owned());
        return figures;
    };
    match tracking(&command, &measured, &active, run.period_s()) {
        Err(reason) => figures.withheld = Some(reason.to_string()),
        Ok(Tracking {
            amplitude, error_max, error_rms, error_max_percent, error_rms_percent, lag_s, ..
        }) => {
            figures.amplitude = known(amplitude);
            figures.error_max = known(error_max);
            figures.error_rms = known(error_rms);
            figures.error_max_percent = known(error_max_percent);
            figures.error_rms_percent = known(error_rms_percent);
            figures.lag_s = known(lag_s);
        }
    }
    figures
}

fn torque_loop(run: &Run<'_>, region: &str, column: &str) -> LoopFigures {
    let torque = run.numbers("rig_measurement", "steering_wheel_torque_n_m");
    let (Some(x), Some(y), Some(active)) = (run.numbers(region, column), torque, run.active()) else {
        return LoopFigures { gradient: None, width_n_m: None };
    };
    let active = (0..x.len()).filter(|&i| active[i] && x[i].is_finite() && y[i].is_finite());
    let (x, y): (Vec<f64>, Vec<f64>) = active.map(|i| (x[i], y[i])).unzip();
    loop_figures(&x, &y)
}

/// Gradient and width at 0 of a loop.
pub(crate) fn loop_figures(x: &[f64], y: &[f64]) -> LoopFigures {
    let near = 0.1 * peak(x);
    LoopFigures {
        gradient: gradient(x, y, 0.0, near).and_then(|line| known(line.slope)),
        // Where the wheel only trembles about the middle there is no loop.
        width_n_m: passage(x, y, 0.0, near).and_then(|passage| known(passage.width)),
    }
}

fn solver(run: &Run<'_>) -> SolverSummary {
    let words = |column: &str| run.words("suspension_state", column);
    SolverSummary {
        iterations_max: words("iterations").and_then(|w| w.into_iter().flatten().max()),
        residual_max_m: run.numbers("suspension_state", "residual_m").and_then(|r| known(peak(&r))),
        not_converged_ticks: words("solver_status")
            .map(|w| w.into_iter().flatten().filter(|&status| status != 0).count() as u64),
    }
}

fn timing(run: &Run<'_>, service: &str) -> Option<ServiceTiming> {
    let region = format!("{service}_timing");
    run.log.region(&region).ok().filter(|r| !r.ticks.is_empty())?;
    let percentiles = |column: &str| {
        let d = Distribution::of(&run.numbers(&region, column)?)?;
        Some(Percentiles { p50: d.p50, p99: d.p99, p99_9: d.p99_9, max: d.max })
    };
    let count = |column: &str| run.last(&region, column).unwrap_or(0);
    Some(ServiceTiming {
        service: service.to_owned(),
        wake_lateness_s: percentiles("wake_lateness_s"),
        compute_s: percentiles("compute_s"),
        done_s: percentiles("done_s"),
        late_wake_count: count("late_wake_count"),
        overrun_count: count("overrun_count"),
        missed_count: count("missed_count"),
        caught_up_count: count("caught_up_count"),
    })
}

fn flag_ticks(run: &Run<'_>) -> BTreeMap<String, u64> {
    let mut counts = BTreeMap::new();
    for (region, prefix, bits) in FLAGGED {
        let Some(words) = run.words(region, "flags") else { continue };
        for (bit, name) in bits {
            let count = words.iter().flatten().filter(|&word| word & bit != 0).count() as u64;
            if count > 0 {
                counts.insert(format!("{prefix}: {name}"), count);
            }
        }
    }
    counts
}

fn log_summary(run: &Run<'_>) -> LogSummary {
    let log = run.log;
    // Regions of other versions of the bench count as written every tick.
    let every_tick = |name: &str| {
        regions::region_by_name(name).is_none_or(|(_, region)| region.history == History::Seconds)
    };
    let mut missing_ticks = BTreeMap::new();
    let mut first_gap = BTreeMap::new();
    for region in log.regions().iter().filter(|region| every_tick(&region.name)) {
        missing_ticks.insert(region.name.clone(), region.missing_count());
        if let Some(&gap) = region.missing().first() {
            first_gap.insert(region.name.clone(), gap);
        }
    }
    let name = |path: &std::path::Path| {
        path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
    };
    LogSummary {
        files: log.files.iter().map(|file| name(&file.path)).collect(),
        finished: log.files.last().is_some_and(|file| file.scan.finished),
        missing_ticks,
        first_gap,
        duplicate_ticks: log.regions().iter().map(|r| r.duplicates).sum(),
        conflicting_ticks: log.regions().iter().map(|r| r.conflicts).sum(),
        bytes_dropped: log.files.iter().map(|file| file.scan.bytes_dropped).sum(),
        lost_count: run.last("logger_status", "lost_count"),
        write_error_count: run.last("logger_status", "write_error_count"),
    }
}
