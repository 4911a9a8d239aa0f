//! Live parameters on their way into the models: taken over at the beginning of a tick, when they are new.
//!
//! A node that has read no parameters yet runs on its configuration; the defaults of the list are the same
//! numbers, so that taking them over changes no bit.

use config::ResolvedBench;
use config::rig::{Control, Switches};
use params::{Id, Values, value};
use regions::{Bench, NO_TICK, Parameters};
use rig_control::{RigController, SteerCommand};
use rig_plant::{UnitTuning, VirtualRig};
use runtime::Input;

/// Which version a node runs on.
#[derive(Debug, Clone, Copy, Default)]
pub struct Live {
    version: u64,
}

impl Live {
    /// The values, when there are other ones than this node runs on.
    pub fn news<'a>(&mut self, parameters: &'a Parameters, input: &Input) -> Option<&'a Values> {
        if !input.fresh() || parameters.version == self.version {
            return None;
        }
        self.version = parameters.version;
        Some(&parameters.value)
    }

    /// The version the node runs on, 0 before any was read.
    pub fn version(&self) -> u64 {
        self.version
    }
}

/// The manoeuvre's clock at the begin of tick `n`: it starts when the operator starts it, at tick 0 in a run
/// that runs by itself, and stands at 0 until then. [s]
pub fn manoeuvre_time_s(bench: &Bench, input: &Input, n: u64, period_s: f64) -> f64 {
    if input.tick() == NO_TICK || bench.manoeuvre_start_tick == NO_TICK {
        return 0.0;
    }
    n.saturating_sub(bench.manoeuvre_start_tick) as f64 * period_s
}

/// The rig's share of the parameters.
#[derive(Debug, Clone)]
pub struct RigTuning {
    control: Control,
}

impl RigTuning {
    /// On top of a configuration.
    pub fn new(resolved: &ResolvedBench) -> Self {
        RigTuning { control: resolved.rig.control.clone() }
    }

    /// Takes new values over.
    pub fn apply(&mut self, values: &Values, controller: &mut RigController, plant: &mut VirtualRig) {
        let get = |id| value(values, id);
        let on = |id| value(values, id) != 0.0;
        controller.set_switches(Switches {
            force_conversion: on(Id::ForceConversion),
            rack_feed_forward: on(Id::RackFeedForward),
            inertia_feed_forward: on(Id::InertiaFeedForward),
            delay_compensation: on(Id::DelayCompensation),
            force_rate_feed_forward: on(Id::ForceRateFeedForward),
            pressure_compensation: on(Id::PressureCompensation),
            gain_adaptation: on(Id::GainAdaptation),
        });
        let c = &mut self.control;
        c.force.bandwidth_rad_s = get(Id::ForceBandwidth);
        c.force.integral_rad_s = get(Id::ForceIntegral);
        c.force.observer_rad_s = get(Id::ForceObserver);
        c.force.derivative_s = get(Id::ForceDerivative);
        c.force.cell_crossover_rad_s = get(Id::ForceCrossover);
        c.height.bandwidth_rad_s = get(Id::HeightBandwidth);
        c.height.integral_rad_s = get(Id::HeightIntegral);
        c.steer.bandwidth_rad_s = get(Id::SteerBandwidth);
        c.steer.damping_ratio = get(Id::SteerDamping);
        c.steer.integral_rad_s = get(Id::SteerIntegral);
        c.steer.load_torque_rad_s = get(Id::SteerLoad);
        c.steer.torque_gain = get(Id::SteerTorqueGain);
        c.steer.torque_damping_n_m_s_rad = get(Id::SteerTorqueDamping);
        controller.tune(c);
        plant.tune_unit(&UnitTuning {
            assist_scale: get(Id::AssistScale),
            assist_damping_scale: get(Id::AssistDampingScale),
            assist_return_scale: get(Id::AssistReturnScale),
            rack_friction_n: get(Id::RackFriction),
            column_friction_n_m: get(Id::ColumnFriction),
        });
    }
}

/// What the hand on the wheel does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum HumanMode {
    #[default]
    Off,
    Angle,
    Torque,
}

/// A human's steering, that comes in a few tens of times a second, made smooth, and handed over without a
/// jump.
///
/// The angle asked for is followed by a critically damped tracker of second order with a bounded rate; taking
/// over from the manoeuvre and giving back are a fade of [`HumanSteer::FADE_S`] between the two angles. Torque is followed by a
/// first-order lag that starts from the torque at the wheel.
#[derive(Debug, Clone, Copy, Default)]
pub struct HumanSteer {
    mode: HumanMode,
    wanted_rad: f64,
    wanted_n_m: f64,
    angle_rad: f64,
    rate_rad_s: f64,
    torque_n_m: f64,
    weight: f64,
    taken: bool,
}

impl HumanSteer {
    /// Fade between manoeuvre and human. [s]
    pub const FADE_S: f64 = 0.5;
    /// Natural frequency of the angle's tracker; damping ratio 1. [rad/s]
    const TRACKER_RAD_S: f64 = 20.0;
    /// Fastest hand. [rad/s]
    const RATE_MAX_RAD_S: f64 = 12.0;
    /// Lag of the torque. [s]
    const TORQUE_LAG_S: f64 = 0.05;

    /// Takes new values over.
    pub fn apply(&mut self, values: &Values) {
        self.mode = match value(values, Id::HumanMode) as u64 {
            1 => HumanMode::Angle,
            2 => HumanMode::Torque,
            _ => HumanMode::Off,
        };
        self.wanted_rad = value(values, Id::HumanAngle);
        self.wanted_n_m = value(values, Id::HumanTorque);
    }

    /// One tick: the steer command, from the manoeuvre's and the human's. `None`: it is the manoeuvre's.
    pub fn step(
        &mut self,
        manoeuvre: SteerCommand,
        measured_rad: f64,
        measured_n_m: f64,
        period_s: f64,
    ) -> Option<SteerCommand> {
        if self.mode == HumanMode::Off && self.weight == 0.0 {
            self.taken = false;
            return None;
        }
        if !std::mem::replace(&mut self.taken, true) {
            let finite = |value: f64| if value.is_finite() { value } else { 0.0 };
            (self.angle_rad, self.rate_rad_s) = match manoeuvre {
                SteerCommand::Angle { angle_rad, rate_rad_s } => (finite(angle_rad), finite(rate_rad_s)),
                SteerCommand::Free | SteerCommand::Torque { .. } => (finite(measured_rad), 0.0),
            };
            self.torque_n_m = finite(measured_n_m);
        }
        if self.mode == HumanMode::Torque {
            self.torque_n_m +=
                period_s / (Self::TORQUE_LAG_S + period_s) * (self.wanted_n_m - self.torque_n_m);
            // What angle mode would start from.
            if measured_rad.is_finite() {
                (self.angle_rad, self.rate_rad_s) = (measured_rad, 0.0);
            }
            self.weight = 1.0;
            return Some(SteerCommand::Torque { torque_n_m: self.torque_n_m });
        }
        let w = Self::TRACKER_RAD_S;
        let acceleration = w * w * (self.wanted_rad - self.angle_rad) - 2.0 * w * self.rate_rad_s;
        let rate = self.rate_rad_s + period_s * acceleration;
        self.rate_rad_s = rate.clamp(-Self::RATE_MAX_RAD_S, Self::RATE_MAX_RAD_S);
        self.angle_rad += period_s * self.rate_rad_s;
        let before = self.weight;
        let step = period_s / Self::FADE_S;
        self.weight = match self.mode {
            HumanMode::Angle => (before + step).min(1.0),
            HumanMode::Off | HumanMode::Torque => (before - step).max(0.0),
        };
        let weight_rate = (self.weight - before) / period_s;
        Some(match manoeuvre {
            SteerCommand::Angle { angle_rad, rate_rad_s } => {
                let away = self.angle_rad - angle_rad;
                SteerCommand::Angle {
                    angle_rad: angle_rad + self.weight * away,
                    rate_rad_s: rate_rad_s
                        + self.weight * (self.rate_rad_s - rate_rad_s)
                        + weight_rate * away,
                }
            }
            // Nobody else wants an angle: the wheel is let go at the end of the fade.
            other if self.mode == HumanMode::Off => {
                self.weight = 0.0;
                other
            }
            _ => SteerCommand::Angle { angle_rad: self.angle_rad, rate_rad_s: self.rate_rad_s },
        })
    }

    /// Whether a human steers, or gives back.
    #[cfg(test)]
    fn steers(&self) -> bool {
        self.taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const T: f64 = 1e-3;

    fn values(mode: f64, angle: f64) -> Values {
        let mut values = [0.0; 62];
        values[Id::HumanMode as usize] = mode;
        values[Id::HumanAngle as usize] = angle;
        values
    }

    #[test]
    fn taking_over_and_giving_back_make_no_jump() {
        let manoeuvre = |n: u32| {
            let t = f64::from(n) * T;
            SteerCommand::Angle { angle_rad: (2.0 * t).sin(), rate_rad_s: 2.0 * (2.0 * t).cos() }
        };
        let mut human = HumanSteer::default();
        let mut last: Option<f64> = None;
        for n in 0..4000 {
            match n {
                500 => human.apply(&values(1.0, 0.5)),
                1500 => human.apply(&values(1.0, -1.0)),
                2500 => human.apply(&values(0.0, -1.0)),
                _ => {}
            }
            let command = human.step(manoeuvre(n), 0.0, 0.0, T).unwrap_or(manoeuvre(n));
            let SteerCommand::Angle { angle_rad, rate_rad_s } = command else { unreachable!() };
            if let Some(last) = last {
                let step: f64 = angle_rad - last;
                assert!(step.abs() < 0.016, "jump of {step} rad at tick {n}");
                assert!((step / T - rate_rad_s).abs() < 0.5, "rate {rate_rad_s} against {} at {n}", step / T);
            }
            last = Some(angle_rad);
            if n == 2499 {
                assert!((angle_rad + 1.0).abs() < 1e-3, "follows the human: {angle_rad}");
            }
        }
        assert!(!human.steers());
    }

    #[test]
    fn torque_starts_from_the_torque_at_the_wheel() {
        let mut human = HumanSteer::default();
        let mut wanted = values(2.0, 0.0);
        wanted[Id::HumanTorque as usize] = 4.0;
        human.apply(&wanted);
        let first = human.step(SteerCommand::Free, 0.1, -2.0, T);
        assert!(matches!(first, Some(SteerCommand::Torque { torque_n_m }) if (torque_n_m + 2.0).abs() < 0.2));
        let last = (0..500).filter_map(|_| human.step(SteerCommand::Free, 0.1, 0.0, T)).last();
        assert!(matches!(last, Some(SteerCommand::Torque { torque_n_m }) if (torque_n_m - 4.0).abs() < 0.01));
    }
}
