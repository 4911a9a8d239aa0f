//! Manoeuvres: driver inputs over time, recorded histories, a path-following driver.
//!
//! In: a [`Scenario`] and, where it names one, its [`RecordedHistory`]. Out: [`DriverCommand`] as a pure
//! function of the run's time: no state, no allocation, the same in any order of calls. Angles at the hand
//! wheel [rad], left positive (ISO 8855); rates are exact derivatives. Only the path-following driver
//! ([`path::PathDriver`]) has state, because it looks at the car.
//!
//! Times: a scenario's times count from manoeuvre time τ = t − `warm_up_s`; see [`config::scenario`].
//! Definitions: ISO 7401 (one-period and continuous sine, step, random), ISO 13674-1 (weave), FMVSS 126 and
//! UN R13-H (sine with dwell, slowly increasing steer), ISO 3888-1 and -2 (tracks).
//! Where a standard's input starts abruptly (one-period sine, sine with dwell) the rate jumps; everything
//! else has a continuous rate.

pub mod curve;
pub mod history;
pub mod path;
pub mod random;
pub mod shape;
mod steering;

use config::RecordedHistory;
use config::scenario::{Crosswind, PedalSpell, Scenario, Speed};
use curve::Curve;
use shape::{Motion, pulse};
use std::fmt;
use steering::Steering;

/// Who turns the hand wheel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HandWheel {
    /// The steer actuator, to `steering_wheel_angle_rad`.
    Commanded,
    /// Nobody (or a human at the rig): the steer actuator gives no torque.
    Free,
    /// A [`path::PathDriver`], which the vehicle service steps; the angle here is zero.
    PathDriver,
}

/// Pedals that replace the speed controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pedals {
    /// Throttle. [-], [0, 1]
    pub throttle: f64,
    /// Brake master-cylinder pressure. [Pa]
    pub brake_pressure_pa: f64,
}

/// What the driver does at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriverCommand {
    /// Who turns the hand wheel.
    pub hand_wheel: HandWheel,
    /// Hand-wheel angle, left positive. [rad]
    pub steering_wheel_angle_rad: f64,
    /// Its rate. [rad/s]
    pub steering_wheel_rate_rad_s: f64,
    /// Whether the manoeuvre's steering is going on: the window in which tracking is judged.
    pub active: bool,
    /// Speed to be held. [m/s]
    pub target_speed_m_s: f64,
    /// Its derivative. [m/s²]
    pub target_acceleration_m_s2: f64,
    /// Pedals; `None`: the speed controller works them.
    pub pedals: Option<Pedals>,
}

/// What keeps a scenario from being driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ManoeuvreError {
    /// The scenario steers by a recorded angle and no history with samples was given.
    SteeringRecordMissing,
    /// The scenario follows a recorded speed and no history with samples was given.
    SpeedRecordMissing,
}

impl fmt::Display for ManoeuvreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = match self {
            Self::SteeringRecordMissing => "steer",
            Self::SpeedRecordMissing => "speed",
        };
        write!(f, "{what}: a recorded history is named, but none was loaded")
    }
}

impl std::error::Error for ManoeuvreError {}

#[derive(Debug, Clone, PartialEq)]
enum Target {
    Constant(f64),
    Over(Curve),
    Free(f64),
}

/// A scenario's driver as a function of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Manoeuvre {
    warm_up_s: f64,
    steering: Steering,
    hands_off_s: f64,
    target: Target,
    pedals: Vec<PedalSpell>,
    wind: Option<Crosswind>,
}

impl Manoeuvre {
    /// Prepares a scenario; allocates, unlike everything after it.
    ///
    /// # Errors
    /// A recorded history that the scenario needs and `record` lacks.
    pub fn new(scenario: &Scenario, record: Option<&RecordedHistory>) -> Result<Self, ManoeuvreError> {
        let km_h = |speed: &f64| speed / 3.6;
        let target = match &scenario.speed {
            Speed::Constant { speed_km_h } => Target::Constant(km_h(speed_km_h)),
            Speed::Profile { time_s, speed_km_h } => {
                Target::Over(Curve::new(time_s.clone(), speed_km_h.iter().map(km_h).collect()))
            }
            Speed::RecordedHistory { low_pass_hz, .. } => {
                let series = record.and_then(|record| record.speed_m_s.as_ref());
                let curve = series.and_then(|series| history::curve(series, *low_pass_hz));
                Target::Over(curve.ok_or(ManoeuvreError::SpeedRecordMissing)?)
            }
            Speed::Free { initial_speed_km_h } => Target::Free(km_h(initial_speed_km_h)),
        };
        Ok(Self {
            warm_up_s: scenario.warm_up_s,
            steering: Steering::new(scenario, record)?,
            hands_off_s: scenario.hands_off_s.unwrap_or(f64::INFINITY),
            target,
            pedals: scenario.pedals.clone().unwrap_or_default(),
            wind: scenario.road.crosswind.clone(),
        })
    }

    /// What the driver does at a time of the run (tick 0 is time 0). A time that is not finite counts as 0.
    pub fn at(&self, time_s: f64) -> DriverCommand {
        let tau = self.manoeuvre_time_s(time_s);
        let hand_wheel = if tau >= self.hands_off_s { HandWheel::Free } else { self.steering.hand_wheel() };
        let angle = match hand_wheel {
            HandWheel::Commanded => self.steering.at(tau, self.warm_up_s),
            HandWheel::Free | HandWheel::PathDriver => Motion::default(),
        };
        let target = match &self.target {
            Target::Constant(speed) | Target::Free(speed) => Motion::rest(*speed),
            // Before manoeuvre time zero the first speed is held, so that the car settles.
            Target::Over(curve) if tau <= 0.0 => Motion::rest(curve.at(0.0).value),
            Target::Over(curve) => curve.at(tau),
        };
        DriverCommand {
            hand_wheel,
            steering_wheel_angle_rad: angle.value,
            steering_wheel_rate_rad_s: angle.rate,
            active: self.steering.active(tau),
            target_speed_m_s: target.value,
            target_acceleration_m_s2: target.rate,
            pedals: self.pedals_at(tau),
        }
    }

    /// Speed at which the car starts. [m/s]
    pub fn initial_speed_m_s(&self) -> f64 {
        self.at(0.0).target_speed_m_s
    }

    /// Velocity of the air over the road, x and y, at a time of the run. [m/s]
    pub fn wind_m_s(&self, time_s: f64) -> [f64; 2] {
        let tau = self.manoeuvre_time_s(time_s);
        let Some(wind) = &self.wind else { return [0.0; 2] };
        let speed = wind.speed_m_s * pulse(tau, wind.start_s, wind.end_s, wind.rise_s).value;
        let (sine, cosine) = wind.direction_deg.to_radians().sin_cos();
        [speed * cosine, speed * sine]
    }

    /// Time in the run at which the steering becomes active and at which it ends (perhaps never). [s]
    pub fn active_window_s(&self) -> (f64, f64) {
        let (start, end) = self.steering.window();
        (start + self.warm_up_s, end + self.warm_up_s)
    }

    fn manoeuvre_time_s(&self, time_s: f64) -> f64 {
        (if time_s.is_finite() { time_s } else { 0.0 }) - self.warm_up_s
    }

    fn pedals_at(&self, tau: f64) -> Option<Pedals> {
        let coasting = matches!(self.target, Target::Free(_));
        let idle = Pedals { throttle: 0.0, brake_pressure_pa: 0.0 };
        let spell =
            self.pedals.iter().find(|spell| tau >= spell.start_s && spell.end_s.is_none_or(|end| tau < end));
        match spell {
            Some(spell) => {
                let share =
                    pulse(tau, spell.start_s, spell.end_s.unwrap_or(f64::INFINITY), spell.rise_s).value;
                Some(Pedals {
                    throttle: share * spell.throttle,
                    brake_pressure_pa: share * spell.brake_pressure_kpa * 1e3,
                })
            }
            None => coasting.then_some(idle),
        }
    }
}
