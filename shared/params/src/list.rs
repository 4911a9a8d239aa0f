//! The list of live parameters.
//!
//! Values are f64 in SI units; a switch is 0 or 1, a choice the number of its name. The default is the
//! configuration's own value where there is one. Where a configuration lies outside the live range the range
//! reaches that far ([`Parameter::range`]), so that going back is always possible.

use config::ResolvedBench;
use config::unit::Assist;

/// What a parameter's values are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A number within the range.
    Number,
    /// 0 or 1.
    Switch,
    /// One of the names, by its number.
    Choice(&'static [&'static str]),
}

/// In which bench states a parameter may be changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum States {
    /// In all.
    Any,
    /// Not while forces fade or the bench is tripped: in off, idle, armed, running.
    Steady,
    /// Only at rest: in off, idle, armed.
    Rest,
}

impl States {
    /// Whether a change is allowed in a state, by the code of `RigStatus::state`.
    pub fn allow(self, state: u64) -> bool {
        match self {
            States::Any => true,
            States::Steady => matches!(regions::state_name(state), "off" | "idle" | "armed" | "running"),
            States::Rest => matches!(regions::state_name(state), "off" | "idle" | "armed"),
        }
    }

    /// The states in words.
    pub fn text(self) -> &'static str {
        match self {
            States::Any => "any state",
            States::Steady => "off, idle, armed or running",
            States::Rest => "off, idle or armed",
        }
    }
}

/// The service that applies a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tuner {
    /// Controller, virtual plant, human steering.
    Rig,
    /// Car and manoeuvre.
    Vehicle,
    /// Front suspension.
    Multibody,
}

impl Tuner {
    /// Name of the service.
    pub fn name(self) -> &'static str {
        match self {
            Tuner::Rig => "rig",
            Tuner::Vehicle => "vehicle",
            Tuner::Multibody => "multibody",
        }
    }
}

/// One live parameter.
#[derive(Debug, Clone, Copy)]
pub struct Parameter {
    /// Which.
    pub id: Id,
    /// Path by which it is set.
    pub path: &'static str,
    /// Unit symbol, `1` for ratios, switches and choices.
    pub unit: &'static str,
    /// What its values are.
    pub kind: Kind,
    /// Smallest live value.
    pub min: f64,
    /// Largest live value.
    pub max: f64,
    /// When it may be changed.
    pub states: States,
    /// Who applies it.
    pub tuner: Tuner,
    /// What it is, in a line.
    pub doc: &'static str,
    /// The configuration's value.
    pub default: fn(&ResolvedBench) -> f64,
}

impl Parameter {
    /// Range, stretched to the default where that lies outside.
    pub fn range(&self, default: f64) -> (f64, f64) {
        (self.min.min(default), self.max.max(default))
    }

    /// A value as people read it.
    pub fn text(&self, value: f64) -> String {
        match self.kind {
            Kind::Number => format!("{value}"),
            Kind::Switch => (if value == 0.0 { "off" } else { "on" }).to_owned(),
            Kind::Choice(names) => {
                let name = (value >= 0.0).then(|| names.get(value as usize)).flatten();
                name.map_or_else(|| format!("{value}"), |name| (*name).to_owned())
            }
        }
    }
}

macro_rules! parameters {
    (@kind switch) => { Kind::Switch };
    (@kind number) => { Kind::Number };
    (@kind [$($name:literal)+]) => { Kind::Choice(&[$($name),+]) };
    ($( #[doc = $doc:literal] $id:ident $path:literal $unit:literal $kind:tt $min:literal..=$max:literal $states:ident $tuner:ident $default:expr; )+) => {
        /// Index of a parameter in [`LIST`] and in the region.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(usize)]
        pub enum Id { $( #[doc = concat!("`", $path, "`:", $doc)] $id, )+ }

        /// Every live parameter, in the order of [`Id`].
        pub const LIST: &[Parameter] = &[ $( Parameter {
            id: Id::$id, path: $path, unit: $unit, kind: parameters!(@kind $kind), min: $min, max: $max,
            states: States::$states, tuner: Tuner::$tuner, doc: $doc.trim_ascii(), default: $default,
        }, )+ ];
    };
}

fn on(switch: bool) -> f64 {
    f64::from(u8::from(switch))
}

parameters! {
    /// Force conversion by the linkage's geometry; off: fixed ratios at rest
    ForceConversion "control.switches.force_conversion" "1" switch 0.0..=1.0 Rest Rig |b| on(b.rig.control.switches.force_conversion);
    /// Stroke that the steering angle will make the rack travel, fed forward
    RackFeedForward "control.switches.rack_feed_forward" "1" switch 0.0..=1.0 Steady Rig |b| on(b.rig.control.switches.rack_feed_forward);
    /// Force that accelerates arm and column, fed forward
    InertiaFeedForward "control.switches.inertia_feed_forward" "1" switch 0.0..=1.0 Steady Rig |b| on(b.rig.control.switches.inertia_feed_forward);
    /// Prediction over actuator lag and transport delays
    DelayCompensation "control.switches.delay_compensation" "1" switch 0.0..=1.0 Steady Rig |b| on(b.rig.control.switches.delay_compensation);
    /// Rate of the commanded force, fed forward
    ForceRateFeedForward "control.switches.force_rate_feed_forward" "1" switch 0.0..=1.0 Steady Rig |b| on(b.rig.control.switches.force_rate_feed_forward);
    /// Valve opening corrected by load pressure
    PressureCompensation "control.switches.pressure_compensation" "1" switch 0.0..=1.0 Steady Rig |b| on(b.rig.control.switches.pressure_compensation);
    /// Valve gain learnt from the measured stroke
    GainAdaptation "control.switches.gain_adaptation" "1" switch 0.0..=1.0 Steady Rig |b| on(b.rig.control.switches.gain_adaptation);
    /// Bandwidth of the force loop
    ForceBandwidth "control.force.bandwidth_rad_s" "rad/s" number 10.0..=300.0 Steady Rig |b| b.rig.control.force.bandwidth_rad_s;
    /// Rate of the force loop's integral part (delay compensation off)
    ForceIntegral "control.force.integral_rad_s" "rad/s" number 0.0..=100.0 Steady Rig |b| b.rig.control.force.integral_rad_s;
    /// Rate at which the force loop observes unexplained motion
    ForceObserver "control.force.observer_rad_s" "rad/s" number 1.0..=200.0 Steady Rig |b| b.rig.control.force.observer_rad_s;
    /// Derivative time of the force loop (delay compensation off)
    ForceDerivative "control.force.derivative_s" "s" number 0.0..=0.02 Steady Rig |b| b.rig.control.force.derivative_s;
    /// Above this the force comes from the actuator's cell, below it from the tie rod's
    ForceCrossover "control.force.cell_crossover_rad_s" "rad/s" number 10.0..=20_000.0 Steady Rig |b| b.rig.control.force.cell_crossover_rad_s;
    /// Bandwidth of the height loop
    HeightBandwidth "control.height.bandwidth_rad_s" "rad/s" number 5.0..=200.0 Steady Rig |b| b.rig.control.height.bandwidth_rad_s;
    /// Rate of the height loop's integral part
    HeightIntegral "control.height.integral_rad_s" "rad/s" number 0.0..=50.0 Steady Rig |b| b.rig.control.height.integral_rad_s;
    /// Bandwidth of the steer loop in angle mode
    SteerBandwidth "control.steer.bandwidth_rad_s" "rad/s" number 5.0..=120.0 Steady Rig |b| b.rig.control.steer.bandwidth_rad_s;
    /// Damping ratio of the steer loop in angle mode
    SteerDamping "control.steer.damping_ratio" "1" number 0.3..=3.0 Steady Rig |b| b.rig.control.steer.damping_ratio;
    /// Rate of the steer loop's integral part
    SteerIntegral "control.steer.integral_rad_s" "rad/s" number 0.0..=50.0 Steady Rig |b| b.rig.control.steer.integral_rad_s;
    /// Bandwidth with which the measured load torque is fed forward
    SteerLoad "control.steer.load_torque_rad_s" "rad/s" number 0.0..=300.0 Steady Rig |b| b.rig.control.steer.load_torque_rad_s;
    /// Gain on torque error in torque mode
    SteerTorqueGain "control.steer.torque_gain" "1" number 0.0..=3.0 Steady Rig |b| b.rig.control.steer.torque_gain;
    /// Damping of the hub in torque mode
    SteerTorqueDamping "control.steer.torque_damping_n_m_s_rad" "N*m*s/rad" number 0.0..=3.0 Steady Rig |b| b.rig.control.steer.torque_damping_n_m_s_rad;
    /// Scale of the steering unit's assist map
    AssistScale "unit.assist_scale" "1" number 0.0..=1.5 Steady Rig |b| match b.unit.assist { Assist::None {} => 0.0, _ => 1.0 };
    /// Scale of the assist's damping
    AssistDampingScale "unit.assist_damping_scale" "1" number 0.0..=3.0 Steady Rig |_| 1.0;
    /// Scale of the assist's active return
    AssistReturnScale "unit.assist_return_scale" "1" number 0.0..=3.0 Steady Rig |_| 1.0;
    /// Sliding friction of the unit's rack
    RackFriction "unit.rack_friction_n" "N" number 0.0..=1000.0 Steady Rig |b| b.unit.rack_friction.sliding_n;
    /// Sliding friction of the unit's column
    ColumnFriction "unit.column_friction_n_m" "N*m" number 0.0..=5.0 Steady Rig |b| b.unit.column_friction.sliding_n_m;
    /// Scale of the front tyres' friction, on top of the road's
    FrontFriction "tyre.front.friction_scale" "1" number 0.05..=1.5 Any Vehicle |_| 1.0;
    /// Scale of the rear tyres' friction, on top of the road's
    RearFriction "tyre.rear.friction_scale" "1" number 0.05..=1.5 Any Vehicle |_| 1.0;
    /// Added to the scenario's target speed
    SpeedOffset "speed.offset_m_s" "m/s" number -40.0..=40.0 Any Vehicle |_| 0.0;
    /// Scale of the tie-rod forces asked of the rig
    TieRodForceScale "suspension.tie_rod_force_scale" "1" number 0.0..=1.2 Steady Multibody |_| 1.0;
    /// Who turns the hand wheel: the manoeuvre, or a human by angle or by torque
    HumanMode "human.mode" "1" ["off" "angle" "torque"] 0.0..=2.0 Any Rig |_| 0.0;
    /// Hand-wheel angle the human asks for, left positive
    HumanAngle "human.steering_wheel_angle_rad" "rad" number -10.0..=10.0 Any Rig |_| 0.0;
    /// Hand-wheel torque the human asks for, left positive
    HumanTorque "human.steering_wheel_torque_n_m" "N*m" number -15.0..=15.0 Any Rig |_| 0.0;
}

const _: () = assert!(LIST.len() <= 62, "more parameters than the region holds");

/// The parameter of that path.
pub fn by_path(path: &str) -> Option<&'static Parameter> {
    LIST.iter().find(|parameter| parameter.path == path)
}

/// The path most like a mistyped one.
pub fn closest(path: &str) -> Option<&'static str> {
    let nearness = |known: &str| strsim::jaro_winkler(known, path);
    LIST.iter()
        .map(|parameter| (nearness(parameter.path), parameter.path))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(nearness, _)| *nearness > 0.8)
        .map(|(_, path)| path)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn ids_and_list_are_in_step_and_paths_unique() {
        for (index, parameter) in LIST.iter().enumerate() {
            assert_eq!(parameter.id as usize, index);
            assert_eq!(by_path(parameter.path).unwrap().id, parameter.id);
            assert!(parameter.min < parameter.max && !parameter.doc.is_empty(), "{}", parameter.path);
        }
    }

    #[test]
    fn defaults_of_the_shipped_bench_lie_in_the_live_ranges() {
        let bench = ResolvedBench::load("growing_slalom_80", &[]).unwrap();
        for parameter in LIST {
            let default = (parameter.default)(&bench);
            assert!((parameter.min..=parameter.max).contains(&default), "{} = {default}", parameter.path);
        }
    }

    #[test]
    fn a_mistyped_path_is_recognised() {
        assert_eq!(closest("tyre.front.friction_scal"), Some("tyre.front.friction_scale"));
        assert_eq!(closest("xyz"), None);
    }
}
