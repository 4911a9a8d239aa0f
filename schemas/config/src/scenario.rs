//! The scenario: which car, rig and steering unit, which manoeuvre on which road, for how long.
//!
//! Times: `duration_s` and `warm_up_s` count from tick 0. Every other time in a scenario (`start_s`, points of
//! a profile, recorded histories) is *manoeuvre time* τ, which is zero at the end of the warm-up:
//! τ = n·T − `warm_up_s`. During the warm-up the car runs straight at its first speed and the rig fades in.
//!
//! Signs: hand-wheel angles are positive to the left (ISO 8855: z up, a left turn has positive yaw rate).
//! Definitions of the inputs: sine, one-period sine, step and random input ISO 7401:2011 (clauses 10 to 14),
//! weave ISO 13674-1, sine with dwell FMVSS 126 / UN R13-H, lane changes ISO 3888-1 and -2.
//! A file rarely states all of it: the shipped ones `extends = "_bench"`, which states the bench's own keys.

use crate::check::{Check, Checker};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use crate::can::CanRun;
pub use crate::equations::Equations;
pub use crate::fmu::FmuRun;
pub use crate::live::ParameterChange;
pub use crate::road::{Crosswind, Friction, FrictionPatch, Outside, Road, Surface};
pub use crate::steer::{
    DriverPath, Frequencies, GrowingSine, LaneChange, Parking, PathFollowing, Ramp, RandomSteer,
    RecordedSteer, Sine, SineWithDwell, Steer, SteerTable, Step, Weave,
};
pub use crate::wheel::{WheelInput, WheelSource};

/// One run of the bench.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Short name, used for the run's directory. Letters, digits, `_` and `-`, 1 to 60 of them.
    #[schemars(length(min = 1, max = 60))]
    pub name: String,
    /// What the run shows, in a sentence or two.
    pub description: String,
    /// The car: a path beside this file, or the bare name of a shipped one.
    pub car_file: String,
    /// The rig: a path beside this file, or the bare name of a shipped one.
    pub rig_file: String,
    /// The steering unit: a path beside this file, or the bare name of a shipped one.
    pub unit_file: String,
    /// Length of the whole run, warm-up included. [s], (0, 86400]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 86400.0))]
    pub duration_s: f64,
    /// Straight running before manoeuvre time zero. [s], [0, 600]
    #[schemars(range(min = 0.0, max = 600.0))]
    pub warm_up_s: f64,
    /// Seed of everything random in the run (sensor noise, random steer).
    #[schemars(range(max = 9_007_199_254_740_992_u64))]
    pub seed: u64,
    /// The beat of the bench.
    pub timing: Timing,
    /// When missing data stop being tolerated; how old inputs may be is one of the rig's `limits`.
    pub limits: Limits,
    /// Cores, priority and memory of the services.
    pub realtime: Realtime,
    /// What the car's speed does.
    pub speed: Speed,
    /// Gear selector.
    pub gear: Gear,
    /// What the hand wheel does.
    pub steer: Steer,
    /// From this manoeuvre time on nobody holds the hand wheel (returnability). [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub hands_off_s: Option<f64>,
    /// A human at a wheel device steers instead of `steer`, which then only says when the manoeuvre is active.
    pub wheel: Option<WheelInput>,
    /// Spells in which pedals replace the speed controller, in order, not overlapping.
    pub pedals: Option<Vec<PedalSpell>>,
    /// The road and the wind.
    pub road: Road,
    /// Variables, imports and outputs defined as expressions.
    pub equations: Option<Equations>,
    /// Where recorded histories lie and which part of them is replayed.
    pub record: Option<Record>,
    /// A CAN bus with the ECU under test, or a virtual one; absent: none.
    pub can: Option<CanRun>,
    /// Users' own models as FMUs, in the loop beside the car.
    pub fmu: Option<Vec<FmuRun>>,
    /// Measured signals to lay over the results.
    pub compare: Option<Vec<Compare>>,
    /// Changes of live parameters during the run, in order of time.
    pub parameters: Option<Vec<ParameterChange>>,
}

/// The beat of the bench.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Timing {
    /// Tick period. [ms], one of 1, 0.5, 0.25
    #[schemars(range(min = 0.25, max = 1.0))]
    pub period_ms: f64,
    /// When in the tick the rig applies its commands, as a fraction of the period. [-], [0.1, 0.95]
    #[schemars(range(min = 0.1, max = 0.95))]
    pub output_phase: f64,
    /// Latest start of the vehicle service in a tick, as a fraction of the period; later it steps on its last
    /// input. [-], [0.05, 0.9]
    #[schemars(range(min = 0.05, max = 0.9))]
    pub vehicle_latest_start: f64,
    /// Latest start of the multibody service in a tick, as a fraction of the period. [-], [0.05, 0.9]
    #[schemars(range(min = 0.05, max = 0.9))]
    pub multibody_latest_start: f64,
}

impl Timing {
    /// Tick period. [s]
    pub fn period_s(&self) -> f64 {
        self.period_ms * 1e-3
    }

    /// Tick period. [ns], exact for the allowed periods.
    pub fn period_ns(&self) -> u64 {
        (self.period_ms * 1e6).round() as u64
    }

    /// Output phase. [s]
    pub fn output_phase_s(&self) -> f64 {
        self.output_phase * self.period_s()
    }
}

/// When missing data stop being tolerated; how old inputs may be is one of the rig's `limits`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Most missed ticks a restarted service steps through to catch up. [ticks], [1, 100000]
    #[schemars(range(min = 1, max = 100_000))]
    pub catch_up_max_ticks: u32,
    /// Longest wait in lockstep before the run ends naming the late service. [s], (0, 600]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 600.0))]
    pub lockstep_wait_max_s: f64,
}

/// Cores, priority and memory of the services. What the host does not allow is noted, not an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Realtime {
    /// SCHED_FIFO priority of the tick services; absent: ordinary scheduling. [1, 98]
    #[schemars(range(min = 1, max = 98))]
    pub priority: Option<u8>,
    /// Lock the services' memory.
    pub lock_memory: bool,
    /// Core of each service; absent: wherever the kernel puts it. Several may share one.
    pub cores: Cores,
}

/// Core number of each service, counted from 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Cores {
    /// Core of the rig service. [0, 1023]
    #[schemars(range(max = 1023))]
    pub rig: Option<u16>,
    /// Core of the vehicle service. [0, 1023]
    #[schemars(range(max = 1023))]
    pub vehicle: Option<u16>,
    /// Core of the multibody service. [0, 1023]
    #[schemars(range(max = 1023))]
    pub multibody: Option<u16>,
    /// Core of the logger. [0, 1023]
    #[schemars(range(max = 1023))]
    pub logger: Option<u16>,
    /// Core of the supervisor. [0, 1023]
    #[schemars(range(max = 1023))]
    pub supervisor: Option<u16>,
}

/// Target speed over manoeuvre time, held by the speed controller.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Speed {
    /// One speed throughout.
    Constant {
        /// Target speed; negative: reversing. [km/h], [-30, 300]
        #[schemars(range(min = -30.0, max = 300.0))]
        speed_km_h: f64,
    },
    /// Points in time joined smoothly without overshoot (monotone cubic); constant before and after.
    Profile {
        /// Manoeuvre times, increasing. [s]
        #[schemars(length(min = 2, max = 10000))]
        time_s: Vec<f64>,
        /// Target speed at those times. [km/h], [-30, 300]
        #[schemars(length(min = 2, max = 10000), inner(range(min = -30.0, max = 300.0)))]
        speed_km_h: Vec<f64>,
    },
    /// A measured speed.
    RecordedHistory {
        /// CSV file.
        file: String,
        /// Name of its time column (seconds).
        time_column: String,
        /// Added to the time column. [s]
        time_offset_s: f64,
        /// Name of the speed column.
        column: String,
        /// Speed of one unit of the column. [m/s], not 0
        scale_m_s: f64,
        /// Zero-phase low-pass against noise and quantisation; absent: as recorded. [Hz], [0.1, 100]
        #[schemars(range(min = 0.1, max = 100.0))]
        low_pass_hz: Option<f64>,
    },
    /// No controller: the car starts at this speed and rolls (pedals, if given, act).
    Free {
        /// Speed at tick 0. [km/h], [-30, 300]
        #[schemars(range(min = -30.0, max = 300.0))]
        initial_speed_km_h: f64,
    },
}

/// Gear selector.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Gear {
    /// Forward.
    Drive,
    /// Driveline open.
    Neutral,
    /// Backward.
    Reverse,
}

/// A spell in which the pedals replace the speed controller.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PedalSpell {
    /// Begin, in manoeuvre time. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// End; absent: to the end of the run. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub end_s: Option<f64>,
    /// Time in which the pedals rise at the begin and fall at the end, half a cosine. [s], (0, 60]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 60.0))]
    pub rise_s: f64,
    /// Throttle. [-], [0, 1]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub throttle: f64,
    /// Brake master-cylinder pressure. [kPa], [0, 30000]
    #[schemars(range(min = 0.0, max = 30000.0))]
    pub brake_pressure_kpa: f64,
}

/// Where recorded histories lie and which part of them is replayed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Directory of the recorded files named by `steer`, `speed` and `compare`; relative to the file (or, with
    /// `--set`, the directory of the command) that says it. Absent: beside the file that names each.
    pub directory: Option<String>,
    /// Time of the record that becomes manoeuvre time zero. [s]
    pub start_s: f64,
    /// Time over which a recorded steering angle is faded in from straight ahead. [s], [0, 60]
    #[schemars(range(min = 0.0, max = 60.0))]
    pub fade_in_s: f64,
}

/// A measured column laid over a signal of the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Compare {
    /// The run's signal that it is laid over.
    pub signal: Signal,
    /// CSV file.
    pub file: String,
    /// Name of its time column (seconds).
    pub time_column: String,
    /// Added to the time column. [s]
    pub time_offset_s: f64,
    /// Name of the measured column.
    pub column: String,
    /// The signal's SI units per unit of the column, not 0.
    pub scale: f64,
}

/// Signals that a measurement may be laid over, in SI units and ISO 8855 signs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    /// Hand-wheel angle, left positive. [rad]
    SteeringWheelAngle,
    /// Hand-wheel torque. [N·m]
    SteeringWheelTorque,
    /// Speed along x. [m/s]
    Speed,
    /// Lateral acceleration at the accelerometer. [m/s²]
    LateralAcceleration,
    /// Longitudinal acceleration at the accelerometer. [m/s²]
    LongitudinalAcceleration,
    /// Yaw rate. [rad/s]
    YawRate,
    /// Roll angle of the body. [rad]
    RollAngle,
    /// Roll rate of the body. [rad/s]
    RollRate,
    /// Pitch angle of the body. [rad]
    PitchAngle,
    /// Axial force of the left tie rod, tension positive. [N]
    TieRodForceLeft,
    /// Axial force of the right tie rod, tension positive. [N]
    TieRodForceRight,
}

impl Signal {
    /// The signal's unit as printed.
    pub fn unit(self) -> &'static str {
        match self {
            Self::SteeringWheelAngle | Self::RollAngle | Self::PitchAngle => "rad",
            Self::SteeringWheelTorque => "N·m",
            Self::Speed => "m/s",
            Self::LateralAcceleration | Self::LongitudinalAcceleration => "m/s²",
            Self::YawRate | Self::RollRate => "rad/s",
            Self::TieRodForceLeft | Self::TieRodForceRight => "N",
        }
    }
}

impl Scenario {
    /// Number of ticks of the run, at least 1.
    pub fn ticks(&self) -> u64 {
        ((self.duration_s / self.timing.period_s()).round() as u64).max(1)
    }
}

impl Check for Scenario {
    fn check(&self, c: &mut Checker) {
        let plain = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '-';
        c.require(self.name.chars().all(plain), "name", "must consist of letters, digits, `_` and `-`");
        let rule = format!("must be longer than warm_up_s ({} s)", self.warm_up_s);
        c.require(self.duration_s > self.warm_up_s, "duration_s", rule);
        c.within("timing", |c| {
            let t = &self.timing;
            let allowed = [1.0, 0.5, 0.25].contains(&t.period_ms);
            c.require(allowed, "period_ms", "must be 1, 0.5 or 0.25 ms");
            let ordered = t.vehicle_latest_start < t.multibody_latest_start;
            c.require(ordered, "multibody_latest_start", "must be later than vehicle_latest_start");
            let in_time = t.multibody_latest_start < t.output_phase;
            c.require(in_time, "output_phase", "must be later than multibody_latest_start");
        });
        c.within("speed", |c| self.speed.check(c));
        c.within("steer", |c| self.steer.check(c));
        let recorded = matches!(self.steer, Steer::RecordedHistory(_))
            || matches!(self.speed, Speed::RecordedHistory { .. })
            || self.compare.is_some();
        let placed = !recorded || self.record.is_some();
        c.require(
            placed,
            "record",
            "must be given, with start_s and fade_in_s, because recorded files are named",
        );
        if let Some(spells) = &self.pedals {
            c.within("pedals", |c| check_pedals(spells, c));
        }
        if let Some(columns) = &self.compare {
            c.within("compare", |c| {
                for (i, column) in columns.iter().enumerate() {
                    let key = format!("[{i}].scale");
                    c.require(column.scale != 0.0, &key, "must not be 0");
                }
            });
        }
        if let Some(can) = &self.can {
            c.within("can", |c| can.check(c));
        }
        if let Some(fmus) = &self.fmu {
            c.within("fmu", |c| crate::fmu::check(fmus, c));
        }
        if let Some(changes) = &self.parameters {
            let in_order = changes.windows(2).all(|pair| pair[0].at_s() <= pair[1].at_s());
            c.require(in_order, "parameters", "must be in order of at_s");
        }
        c.within("road", |c| self.road.check(c));
        if let Some(equations) = &self.equations {
            c.within("equations", |c| equations.check(c));
        }
    }
}

impl Check for Speed {
    fn check(&self, c: &mut Checker) {
        match self {
            Self::Profile { time_s, speed_km_h } => {
                check_increasing(time_s, "time_s", c);
                let same = time_s.len() == speed_km_h.len();
                c.require(
                    same,
                    "speed_km_h",
                    format!("must have as many entries as time_s ({})", time_s.len()),
                );
            }
            Self::RecordedHistory { scale_m_s, .. } => {
                c.require(*scale_m_s != 0.0, "scale_m_s", "must not be 0");
            }
            Self::Constant { .. } | Self::Free { .. } => {}
        }
    }
}

fn check_pedals(spells: &[PedalSpell], c: &mut Checker) {
    let mut free_from = Some(f64::NEG_INFINITY);
    for (i, spell) in spells.iter().enumerate() {
        c.within(&format!("[{i}]"), |c| {
            let after = free_from.is_some_and(|end| spell.start_s >= end);
            c.require(after, "start_s", "must not lie before the end of the spell before it");
            if let Some(end) = spell.end_s {
                let fits = end - spell.start_s >= 2.0 * spell.rise_s;
                c.require(fits, "end_s", "must leave room after start_s for twice rise_s");
            }
        });
        free_from = spell.end_s;
    }
}

/// Notes entries of `values` that do not increase.
pub(crate) fn check_increasing(values: &[f64], key: &str, c: &mut Checker) {
    for (i, pair) in values.windows(2).enumerate() {
        let [before, after] = [pair[0], pair[1]];
        c.require(
            after > before,
            &format!("{key}[{}]", i + 1),
            format!("must be greater than {before} before it"),
        );
    }
}
