//! What the hand wheel does in a scenario. Angles at the hand wheel, left positive, in manoeuvre time.
//! The exact functions of time are defined in the crate `manoeuvre`.

use crate::check::{Check, Checker};
use crate::scenario::check_increasing;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the hand wheel does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Steer {
    /// Held at one angle throughout.
    Hold {
        /// Hand-wheel angle. [deg], [-900, 900]
        #[schemars(range(min = -900.0, max = 900.0))]
        angle_deg: f64,
    },
    /// Nobody holds the hand wheel, or a human turns it: no command.
    Free {},
    /// Continuous sine.
    Sine(Sine),
    /// Sine of linearly growing amplitude.
    GrowingSine(GrowingSine),
    /// On-centre weave (ISO 13674-1).
    Weave(Weave),
    /// One period of a sine (ISO 7401, clause 11).
    LaneChange(LaneChange),
    /// Sine with dwell (FMVSS 126, UN R13-H).
    SineWithDwell(SineWithDwell),
    /// Step (ISO 7401, clause 10).
    Step(Step),
    /// Slow ramp.
    Ramp(Ramp),
    /// Turning from one side to the other at a constant rate, usually at standstill.
    Parking(Parking),
    /// Random input (ISO 7401, clause 12).
    Random(RandomSteer),
    /// Points in time joined smoothly.
    Table(SteerTable),
    /// A measured hand-wheel angle.
    RecordedHistory(RecordedSteer),
    /// A driver follows a path (closed loop).
    Path(PathFollowing),
}

/// Continuous sine: `amplitude · sin(2πf(τ − start))`, its amplitude rising and falling linearly over whole
/// numbers of half periods so that rate has no jump (a fade of 0 cycles starts or ends abruptly).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sine {
    /// Begin. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// Amplitude; negative: right first. [deg], [-900, 900]
    #[schemars(range(min = -900.0, max = 900.0))]
    pub amplitude_deg: f64,
    /// Frequency. [Hz], [0.01, 20]
    #[schemars(range(min = 0.01, max = 20.0))]
    pub frequency_hz: f64,
    /// Periods over which the amplitude rises, before the full ones. [-], [0, 100], steps of 0.5
    #[schemars(range(min = 0.0, max = 100.0), extend("multipleOf" = 0.5))]
    pub fade_in_cycles: f64,
    /// Periods at full amplitude. [-], [0.5, 100000], steps of 0.5
    #[schemars(range(min = 0.5, max = 100000.0), extend("multipleOf" = 0.5))]
    pub cycles: f64,
    /// Periods over which the amplitude falls, after the full ones. [-], [0, 100], steps of 0.5
    #[schemars(range(min = 0.0, max = 100.0), extend("multipleOf" = 0.5))]
    pub fade_out_cycles: f64,
}

/// Growing sine: amplitude linear in time from the first to the last value, then falling to zero.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GrowingSine {
    /// Begin. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// Amplitude at the begin. [deg], [-900, 900]
    #[schemars(range(min = -900.0, max = 900.0))]
    pub first_amplitude_deg: f64,
    /// Amplitude at the end of the growth. [deg], [-900, 900]
    #[schemars(range(min = -900.0, max = 900.0))]
    pub last_amplitude_deg: f64,
    /// Frequency. [Hz], [0.01, 20]
    #[schemars(range(min = 0.01, max = 20.0))]
    pub frequency_hz: f64,
    /// Periods over which it grows. [-], [0.5, 10000], steps of 0.5
    #[schemars(range(min = 0.5, max = 10000.0), extend("multipleOf" = 0.5))]
    pub cycles: f64,
    /// Periods over which it falls to zero afterwards. [-], [0, 100], steps of 0.5
    #[schemars(range(min = 0.0, max = 100.0), extend("multipleOf" = 0.5))]
    pub fade_out_cycles: f64,
}

/// On-centre weave of ISO 13674-1: a continuous sine, 0.2 Hz in the standard, about 2 m/s² peak.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Weave {
    /// Begin. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// Amplitude; negative: right first. [deg], [-180, 180]
    #[schemars(range(min = -180.0, max = 180.0))]
    pub amplitude_deg: f64,
    /// Frequency, 0.2 in the standard. [Hz], [0.02, 1]
    #[schemars(range(min = 0.02, max = 1.0))]
    pub frequency_hz: f64,
    /// Periods at full amplitude; one more at each end fades in and out. [-], [1, 1000], whole
    #[schemars(range(min = 1, max = 1000))]
    pub cycles: u32,
}

/// One period of a sine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LaneChange {
    /// Begin. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// Amplitude; negative: right first. [deg], [-900, 900]
    #[schemars(range(min = -900.0, max = 900.0))]
    pub amplitude_deg: f64,
    /// Frequency. [Hz], [0.05, 5]
    #[schemars(range(min = 0.05, max = 5.0))]
    pub frequency_hz: f64,
}

/// One period of a sine, held for the dwell at its second peak (three quarters of the period).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SineWithDwell {
    /// Begin. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// Amplitude; negative: right first. [deg], [-900, 900]
    #[schemars(range(min = -900.0, max = 900.0))]
    pub amplitude_deg: f64,
    /// Frequency, 0.7 in the regulation. [Hz], [0.05, 5]
    #[schemars(range(min = 0.05, max = 5.0))]
    pub frequency_hz: f64,
    /// Dwell, 0.5 in the regulation. [s], [0, 10]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub dwell_s: f64,
}

/// Step: half a cosine from zero to the angle (10 to 90 % in 0.59 of the rise), held, and optionally back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Begin. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// Angle. [deg], [-900, 900]
    #[schemars(range(min = -900.0, max = 900.0))]
    pub angle_deg: f64,
    /// Rise time from 0 to 100 %; the peak rate is π/2 · angle / rise. [s], [0.01, 10]
    #[schemars(range(min = 0.01, max = 10.0))]
    pub rise_s: f64,
    /// Time at the angle before going back in the same way; absent: held to the end. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub hold_s: Option<f64>,
}

/// Ramp at constant rate to an angle, its corners rounded by constant angular acceleration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Ramp {
    /// Begin. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// Final angle; its sign tells the side. [deg], [-900, 900], not 0
    #[schemars(range(min = -900.0, max = 900.0))]
    pub angle_deg: f64,
    /// Rate, 13.5 for the slowly increasing steer of FMVSS 126. [deg/s], (0, 2000]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 2000.0))]
    pub rate_deg_s: f64,
    /// Time in which the rate is reached and left. [s], [0, 10]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub blend_s: f64,
    /// Time at the angle before ramping back; absent: held to the end. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub hold_s: Option<f64>,
}

/// From straight ahead to one side, to the other, ... and back to straight, each at a constant rate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Parking {
    /// Begin. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// Angle reached on both sides; negative: right first. [deg], [-900, 900], not 0
    #[schemars(range(min = -900.0, max = 900.0))]
    pub angle_deg: f64,
    /// Rate. [deg/s], (0, 2000]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 2000.0))]
    pub rate_deg_s: f64,
    /// Time in which the rate is reached and left. [s], [0, 10]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub blend_s: f64,
    /// Rest at each side. [s], [0, 60]
    #[schemars(range(min = 0.0, max = 60.0))]
    pub pause_s: f64,
    /// How often both sides are reached. [-], [1, 100]
    #[schemars(range(min = 1, max = 100))]
    pub cycles: u32,
}

/// Sum of sines with seeded phases, frequencies spread evenly over the band with seeded jitter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RandomSteer {
    /// Begin. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// End. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub end_s: f64,
    /// Root mean square. [deg], (0, 300]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 300.0))]
    pub rms_deg: f64,
    /// The band.
    pub band: Frequencies,
    /// Number of sines. [-], [4, 128]
    #[schemars(range(min = 4, max = 128))]
    pub components: u32,
    /// Rise at the begin and fall at the end, half a cosine. [s], [0.1, 60]
    #[schemars(range(min = 0.1, max = 60.0))]
    pub fade_s: f64,
}

/// A band of frequencies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Frequencies {
    /// Lower edge. [Hz], [0.01, 50]
    #[schemars(range(min = 0.01, max = 50.0))]
    pub low_hz: f64,
    /// Upper edge. [Hz], [0.01, 50]
    #[schemars(range(min = 0.01, max = 50.0))]
    pub high_hz: f64,
}

/// Points joined by monotone cubics (no overshoot, continuous rate); constant before and after.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SteerTable {
    /// Times, increasing. [s]
    #[schemars(length(min = 2, max = 100000))]
    pub time_s: Vec<f64>,
    /// Angles at those times. [deg], [-900, 900]
    #[schemars(length(min = 2, max = 100000), inner(range(min = -900.0, max = 900.0)))]
    pub angle_deg: Vec<f64>,
}

/// A measured hand-wheel angle: `angle = scale_rad · column + offset_deg`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordedSteer {
    /// CSV file.
    pub file: String,
    /// Name of its time column (seconds).
    pub time_column: String,
    /// Added to the time column. [s]
    pub time_offset_s: f64,
    /// Name of the angle column.
    pub column: String,
    /// Hand-wheel angle of one unit of the column, left positive. [rad], not 0
    pub scale_rad: f64,
    /// Added after scaling. [deg], [-180, 180]
    #[schemars(range(min = -180.0, max = 180.0))]
    pub offset_deg: f64,
    /// Angles beyond this are clipped to it. [deg], (0, 900]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 900.0))]
    pub clip_deg: f64,
    /// Zero-phase low-pass against noise and quantisation; absent: as recorded. [Hz], [0.1, 100]
    #[schemars(range(min = 0.1, max = 100.0))]
    pub low_pass_hz: Option<f64>,
}

/// A driver who looks ahead and steers towards a path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PathFollowing {
    /// The path.
    pub path: DriverPath,
    /// How far ahead the driver looks. [s], [0.1, 5]
    #[schemars(range(min = 0.1, max = 5.0))]
    pub preview_s: f64,
    /// Reaction and arm lag, first order. [s], [0.02, 1]
    #[schemars(range(min = 0.02, max = 1.0))]
    pub lag_s: f64,
    /// Hand-wheel angle per path curvature that the driver expects of the car at walking pace: steering ratio
    /// times wheelbase. [rad·m], (0, 500]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 500.0))]
    pub expected_rad_m: f64,
    /// Speed at which understeer doubles that angle, as the driver knows the car (the characteristic speed).
    /// [km/h], [20, 1000]
    #[schemars(range(min = 20.0, max = 1000.0))]
    pub characteristic_speed_km_h: f64,
    /// How fast a lasting lateral error is taken out; 0: not at all. [1/s], [0, 5]
    #[schemars(range(min = 0.0, max = 5.0))]
    pub trim_per_s: f64,
    /// Largest hand-wheel angle. [deg], (0, 900]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 900.0))]
    pub angle_max_deg: f64,
    /// Largest hand-wheel rate. [deg/s], (0, 2000]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 2000.0))]
    pub rate_max_deg_s: f64,
}

/// Paths in the road's frame; the car starts at the origin heading along +x.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum DriverPath {
    /// Straight, then a clothoid, then a circle (ISO 4138, constant radius).
    Circle {
        /// Radius; negative: to the right. [m], |R| in [5, 10000]
        #[schemars(range(min = -10000.0, max = 10000.0))]
        radius_m: f64,
        /// Straight before the clothoid. [m], [0, 10000]
        #[schemars(range(min = 0.0, max = 10000.0))]
        straight_m: f64,
        /// Length of the clothoid. [m], [1, 1000]
        #[schemars(range(min = 1.0, max = 1000.0))]
        transition_m: f64,
    },
    /// Double lane change of ISO 3888-1 (severe) along the middle of its gates.
    DoubleLaneChangeIso3888Part1 {
        /// Straight before the first gate. [m], [0, 10000]
        #[schemars(range(min = 0.0, max = 10000.0))]
        straight_m: f64,
        /// Width of the vehicle without mirrors. [m], [0.5, 3]
        #[schemars(range(min = 0.5, max = 3.0))]
        vehicle_width_m: f64,
    },
    /// Obstacle avoidance of ISO 3888-2 along the middle of its gates.
    ObstacleAvoidanceIso3888Part2 {
        /// Straight before the first gate. [m], [0, 10000]
        #[schemars(range(min = 0.0, max = 10000.0))]
        straight_m: f64,
        /// Width of the vehicle without mirrors. [m], [0.5, 3]
        #[schemars(range(min = 0.5, max = 3.0))]
        vehicle_width_m: f64,
    },
    /// Points joined smoothly: lateral position over x.
    Points {
        /// Stations, increasing. [m]
        #[schemars(length(min = 2, max = 10000))]
        x_m: Vec<f64>,
        /// Lateral position at those. [m]
        #[schemars(length(min = 2, max = 10000))]
        y_m: Vec<f64>,
    },
}

impl Check for Steer {
    fn check(&self, c: &mut Checker) {
        match self {
            Self::Hold { .. } | Self::Free {} | Self::Sine(_) | Self::GrowingSine(_) | Self::Weave(_) => {}
            Self::LaneChange(_) | Self::SineWithDwell(_) | Self::Step(_) => {}
            Self::Ramp(ramp) => check_ramp(ramp.angle_deg, ramp.rate_deg_s, ramp.blend_s, c),
            Self::Parking(parking) => check_ramp(parking.angle_deg, parking.rate_deg_s, parking.blend_s, c),
            Self::Random(random) => {
                let band = &random.band;
                c.require(band.high_hz > band.low_hz, "band.high_hz", "must be greater than low_hz");
                let fits = random.end_s - random.start_s >= 2.0 * random.fade_s;
                c.require(fits, "end_s", "must leave room after start_s for twice fade_s");
            }
            Self::Table(table) => {
                check_increasing(&table.time_s, "time_s", c);
                let same = table.time_s.len() == table.angle_deg.len();
                let rule = format!("must have as many entries as time_s ({})", table.time_s.len());
                c.require(same, "angle_deg", rule);
            }
            Self::RecordedHistory(record) => {
                c.require(record.scale_rad != 0.0, "scale_rad", "must not be 0");
            }
            Self::Path(following) => c.within("path", |c| match &following.path {
                DriverPath::Circle { radius_m, .. } => {
                    c.require(radius_m.abs() >= 5.0, "radius_m", "must be at least 5 m to either side");
                }
                DriverPath::Points { x_m, y_m } => {
                    check_increasing(x_m, "x_m", c);
                    let same = x_m.len() == y_m.len();
                    c.require(same, "y_m", format!("must have as many entries as x_m ({})", x_m.len()));
                }
                _ => {}
            }),
        }
    }
}

/// A ramp whose rounded corners do not fit before its angle is reached has no constant-rate part.
fn check_ramp(angle_deg: f64, rate_deg_s: f64, blend_s: f64, c: &mut Checker) {
    c.require(angle_deg != 0.0, "angle_deg", "must not be 0");
    let fits = blend_s * rate_deg_s <= angle_deg.abs() || angle_deg == 0.0;
    c.require(fits, "blend_s", "must not exceed the time of the ramp, angle_deg / rate_deg_s");
}
