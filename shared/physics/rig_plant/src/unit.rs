//! The steering unit under test as the rig sees it, and the built-in column EPS.
//!
//! The boundary is [`SteeringUnitModel`]: torque at the hand-wheel shaft and force at the rack go in, hand-wheel
//! angle and rack position come out. A unit composed from functional models takes the same place.
//!
//! [`ColumnEps`] (angles left-turn positive, rack + to the left, i = rack travel per radian):
//!
//! ```text
//! J θ̈ = T_hand + T_friction − T_tb,   T_tb = k(θ − x/i) + c(θ̇ − ẋ/i)
//! m ẍ = T_tb/i + F_assist + F_rod + F_friction − d ẋ − F_stop
//! ```
//!
//! Semi-implicit Euler (velocities first), viscous parts implicit. The ECU: torque sensor lag, lead filter,
//! map over torque and vehicle speed, damping, active return, motor lag; it computes at every sub-step (a real
//! one at 1 kHz or faster). Universal joints, where the unit has them, turn the shaft unevenly: the torsion bar then
//! sees θ_p(θ) instead of θ, and the hub feels T_tb dθ_p/dθ (massless shaft; see [`uneven`]).
//! Not modelled: gear backlash, motor saturation over speed, bearing loads of the joints.

use crate::friction::LuGre;
use crate::state::{StateReader, StateWriter};
use config::unit::{Assist, ElectricAssist, SteeringUnit, UniversalJoints};
use core::f64::consts::TAU;

/// What acts on the unit during one sub-step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UnitInput {
    /// Torque at the hand-wheel shaft, left turn positive. [N·m]
    pub hand_wheel_torque_n_m: f64,
    /// Force of both tie rods on the rack, left positive. [N]
    pub rack_force_n: f64,
    /// Vehicle speed. [m/s]
    pub vehicle_speed_m_s: f64,
    /// Whether assist is available.
    pub engine_on: bool,
    /// Torque that an ECU outside asks of the assist motor, at the pinion, left turn positive. [N·m] `None`: the
    /// unit's own ECU assists.
    pub assist_request_n_m: Option<f64>,
}

/// What of a unit can be tuned while it runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitTuning {
    /// Scale of the assist map. [-]
    pub assist_scale: f64,
    /// Scale of the assist's damping. [-]
    pub assist_damping_scale: f64,
    /// Scale of the active return. [-]
    pub assist_return_scale: f64,
    /// Sliding friction of the rack. [N]
    pub rack_friction_n: f64,
    /// Sliding friction of the column. [N·m]
    pub column_friction_n_m: f64,
}

/// Where the unit stands after a sub-step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UnitOutput {
    /// Hand-wheel angle. [rad]
    pub hand_wheel_angle_rad: f64,
    /// Its rate. [rad/s]
    pub hand_wheel_rate_rad_s: f64,
    /// Its acceleration over the sub-step. [rad/s²]
    pub hand_wheel_acceleration_rad_s2: f64,
    /// Rack displacement. [m]
    pub rack_displacement_m: f64,
    /// Rack velocity. [m/s]
    pub rack_velocity_m_s: f64,
    /// Torsion-bar torque. [N·m]
    pub torsion_bar_torque_n_m: f64,
    /// Assist force at the rack. [N]
    pub assist_force_n: f64,
}

/// Power and energy inside a unit that keeps an account of them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UnitAccount {
    /// Largest sum of the magnitudes of the powers at one joint, now. [W]
    pub power_flow_w: f64,
    /// Largest sum of the powers at one joint, now; 0 but for rounding if power is kept. [W]
    pub power_residual_w: f64,
    /// Stored now. [J]
    pub stored_j: f64,
    /// Entered through hand wheel and rack since the start. [J]
    pub entered_j: f64,
    /// Supplied by motors and pumps since the start. [J]
    pub supplied_j: f64,
    /// Lost since the start. [J]
    pub lost_j: f64,
    /// What the account does not explain; 0 but for rounding. [J]
    pub imbalance_j: f64,
    /// Sub-steps that held a value because a solve failed or a value was not finite. [-]
    pub fault_count: f64,
}

/// A steering unit between hand-wheel shaft and inner tie-rod balls.
pub trait SteeringUnitModel: Send {
    /// Advances by `step_s`.
    fn step(&mut self, input: &UnitInput, step_s: f64);
    /// Where it stands.
    fn output(&self) -> &UnitOutput;
    /// Takes over a tuning from the next sub-step on. A unit that cannot be tuned stays as it is.
    fn tune(&mut self, _: &UnitTuning) {}
    /// Whether [`UnitInput::assist_request_n_m`] has a motor to act on.
    fn takes_assist_request(&self) -> bool {
        false
    }
    /// Rack travel per radian of the hand wheel at the centre, signed. [m/rad]
    fn rack_per_radian_m(&self) -> f64;
    /// Highest natural frequency with `rack_stiffness_n_m` at the rack, for choosing a sub-step. [rad/s]
    fn frequency_max_rad_s(&self, rack_stiffness_n_m: f64) -> f64;
    /// Length of the flat state.
    fn state_len(&self) -> usize;
    /// Writes the state.
    fn save(&self, out: &mut StateWriter);
    /// Reads the state; zeros are the state at rest.
    fn load(&mut self, from: &mut StateReader);
    /// Its account of power and energy, if it keeps one.
    fn account(&self) -> Option<&UnitAccount> {
        None
    }
}

/// Torsion-bar column, rack, electric assist.
#[derive(Debug, Clone)]
pub struct ColumnEps {
    unit: SteeringUnit,
    ratio: f64,
    hub_inertia: f64,
    rack_mass: f64,
    column_friction: LuGre,
    rack_friction: LuGre,
    ecu: Option<Ecu>,
    out: UnitOutput,
}

impl ColumnEps {
    /// The unit at rest and centred. `upstream_inertia_kg_m2` is what is fixed to the shaft: hand wheel or actuator.
    pub fn new(unit: &SteeringUnit, upstream_inertia_kg_m2: f64) -> Self {
        let ecu = match &unit.assist {
            Assist::None {} => None,
            Assist::Electric(assist) => Some(Ecu::new(assist)),
        };
        Self {
            unit: unit.clone(),
            ratio: unit.rack_travel_m_per_rev / TAU,
            hub_inertia: upstream_inertia_kg_m2 + unit.column_inertia_kg_m2,
            rack_mass: unit.rack_mass_kg + unit.assist_inertia_at_rack_kg,
            column_friction: LuGre::new(&unit.column_friction),
            rack_friction: LuGre::new(&unit.rack_friction),
            ecu,
            out: UnitOutput::default(),
        }
    }
}

impl SteeringUnitModel for ColumnEps {
    fn step(&mut self, input: &UnitInput, step_s: f64) {
        let (u, o, i) = (&self.unit, &mut self.out, self.ratio);
        let (shaft, even) = match &u.universal_joints {
            Some(joints) => uneven(joints, o.hand_wheel_angle_rad),
            None => (o.hand_wheel_angle_rad, 1.0),
        };
        let twist = shaft - o.rack_displacement_m / i;
        let twist_rate = even * o.hand_wheel_rate_rad_s - o.rack_velocity_m_s / i;
        let torque = u.torsion_bar_stiffness_n_m_rad * twist + u.torsion_bar_damping_n_m_s_rad * twist_rate;
        let assist = match &mut self.ecu {
            Some(ecu) => {
                let wanted = match input.assist_request_n_m {
                    Some(request) => request / i,
                    None => ecu.wanted(torque, o, i.signum(), input, step_s),
                };
                ecu.motor(wanted, input.engine_on, step_s)
            }
            None => 0.0,
        };

        let column_friction = self.column_friction.step(o.hand_wheel_rate_rad_s, step_s);
        let before = o.hand_wheel_rate_rad_s;
        o.hand_wheel_rate_rad_s +=
            step_s / self.hub_inertia * (input.hand_wheel_torque_n_m + column_friction - even * torque);
        o.hand_wheel_acceleration_rad_s2 = (o.hand_wheel_rate_rad_s - before) / step_s;

        let excess = o.rack_displacement_m.abs() - u.rack_stop_m;
        let stop = if excess > 0.0 {
            let side = o.rack_displacement_m.signum();
            let outward = o.rack_velocity_m_s * side;
            side * (u.rack_stop_stiffness_n_m * excess + u.rack_stop_damping_n_s_m * outward).max(0.0)
        } else {
            0.0
        };
        let rack_friction = self.rack_friction.step(o.rack_velocity_m_s, step_s);
        let force = torque / i + assist + input.rack_force_n + rack_friction - stop;
        o.rack_velocity_m_s = (o.rack_velocity_m_s + step_s * force / self.rack_mass)
            / (1.0 + step_s * u.rack_damping_n_s_m / self.rack_mass);

        o.hand_wheel_angle_rad += step_s * o.hand_wheel_rate_rad_s;
        o.rack_displacement_m += step_s * o.rack_velocity_m_s;
        o.torsion_bar_torque_n_m = torque;
        o.assist_force_n = assist;
    }

    fn output(&self) -> &UnitOutput {
        &self.out
    }

    fn tune(&mut self, tuning: &UnitTuning) {
        self.rack_friction.set_sliding(&self.unit.rack_friction, tuning.rack_friction_n);
        self.column_friction.set_sliding(&self.unit.column_friction, tuning.column_friction_n_m);
        if let Some(ecu) = &mut self.ecu {
            ecu.scale = [tuning.assist_scale, tuning.assist_damping_scale, tuning.assist_return_scale];
        }
    }

    fn takes_assist_request(&self) -> bool {
        self.ecu.is_some()
    }

    fn rack_per_radian_m(&self) -> f64 {
        self.ratio
    }

    fn frequency_max_rad_s(&self, rack_stiffness_n_m: f64) -> f64 {
        let bar = self.unit.torsion_bar_stiffness_n_m_rad;
        let slope = self.ecu.as_ref().map_or(0.0, |ecu| ecu.slope_max) * self.ratio.abs();
        let hub = (bar + self.column_friction.stiffness()) / self.hub_inertia;
        let rack = (bar * (1.0 + slope) / (self.ratio * self.ratio)
            + self.rack_friction.stiffness()
            + self.unit.rack_stop_stiffness_n_m
            + rack_stiffness_n_m)
            / self.rack_mass;
        (hub + rack).sqrt()
    }

    fn state_len(&self) -> usize {
        6 + 2 + Ecu::STATE
    }

    fn save(&self, out: &mut StateWriter) {
        let o = &self.out;
        out.put_all(&[
            o.hand_wheel_angle_rad,
            o.hand_wheel_rate_rad_s,
            o.hand_wheel_acceleration_rad_s2,
            o.rack_displacement_m,
            o.rack_velocity_m_s,
            o.torsion_bar_torque_n_m,
            self.column_friction.deflection,
            self.rack_friction.deflection,
        ]);
        out.put_all(&self.ecu.as_ref().map_or([0.0; Ecu::STATE], |ecu| ecu.state));
    }

    fn load(&mut self, from: &mut StateReader) {
        let o = &mut self.out;
        [
            o.hand_wheel_angle_rad,
            o.hand_wheel_rate_rad_s,
            o.hand_wheel_acceleration_rad_s2,
            o.rack_displacement_m,
            o.rack_velocity_m_s,
            o.torsion_bar_torque_n_m,
            self.column_friction.deflection,
            self.rack_friction.deflection,
        ] = from.take_array();
        let state = from.take_array();
        if let Some(ecu) = &mut self.ecu {
            ecu.state = state;
            o.assist_force_n = state[2];
        }
    }
}

/// Angle behind two universal joints, zero where the hand wheel is, and its slope over the hand-wheel angle.
///
/// One joint: tan φ₂ = tan φ₁ cos β, dφ₂/dφ₁ = cos β/(1 − sin²β sin²φ₁), φ₁ counted from where the driving yoke
/// lies in the plane of the shafts. [Schmelz, Seherr-Thoss, Aucktor 1992, Universal Joints and Driveshafts, §1.2]
pub fn uneven(joints: &UniversalJoints, angle_rad: f64) -> (f64, f64) {
    let joint = |phi: f64, beta: f64| {
        let (sin, cos) = phi.sin_cos();
        let (sin_b, cos_b) = beta.sin_cos();
        // The branch that stays within a quarter turn of phi, at any number of turns.
        let ahead = (sin * cos * (cos_b - 1.0)).atan2(cos * cos + sin * sin * cos_b);
        (phi + ahead, cos_b / (1.0 - sin_b * sin_b * sin * sin))
    };
    let through = |angle: f64| {
        let (middle, slope_1) = joint(angle + joints.yoke_rad, joints.upper_angle_rad);
        // The second joint is turned by a quarter, so that equal angles undo each other.
        let quarter = core::f64::consts::FRAC_PI_2 + joints.phase_rad;
        let (out, slope_2) = joint(middle + quarter, joints.lower_angle_rad);
        (out - quarter, slope_1 * slope_2)
    };
    let (out, slope) = through(angle_rad);
    (out - through(0.0).0, slope)
}

/// The ECU of an electric assist.
#[derive(Debug, Clone)]
struct Ecu {
    assist: ElectricAssist,
    slope_max: f64,
    /// Live scales of map, damping, return.
    scale: [f64; 3],
    /// Sensed torque [N·m], lag state of the lead filter [N·m], assist force [N].
    state: [f64; 3],
}

impl Ecu {
    const STATE: usize = 3;

    fn new(assist: &ElectricAssist) -> Self {
        let mut slope_max = 0.0_f64;
        for row in &assist.force_n {
            for (force, torque) in row.windows(2).zip(assist.torque_nodes_n_m.windows(2)) {
                slope_max = slope_max.max((force[1] - force[0]) / (torque[1] - torque[0]));
            }
        }
        Self {
            assist: assist.clone(),
            slope_max: slope_max * assist.lead_s / assist.lead_lag_s,
            scale: [1.0; 3],
            state: [0.0; 3],
        }
    }

    /// Force that the ECU wants of its motor, at the rack. [N]
    fn wanted(&mut self, torque: f64, o: &UnitOutput, sign: f64, input: &UnitInput, step_s: f64) -> f64 {
        let a = &self.assist;
        let [sensed, lagged, _] = &mut self.state;
        *sensed += step_s / (a.sensor_lag_s + step_s) * (torque - *sensed);
        // (1 + lead s)/(1 + lag s) = r + (1 - r)/(1 + lag s), r = lead/lag
        *lagged += step_s / (a.lead_lag_s + step_s) * (*sensed - *lagged);
        let ratio = a.lead_s / a.lead_lag_s;
        let led = ratio * *sensed + (1.0 - ratio) * *lagged;
        let (row, part) = bracket(&a.speed_nodes_m_s, input.vehicle_speed_m_s.abs());
        let next = (row + 1).min(a.speed_nodes_m_s.len() - 1);
        let blend = |low: f64, high: f64| low + part * (high - low);
        let (column, along) = bracket(&a.torque_nodes_n_m, led.abs());
        let on_row = |row: usize| {
            let f = &a.force_n[row];
            f[column] + along * (f[column + 1] - f[column])
        };
        let map = blend(on_row(row), on_row(next)) * led.signum() * sign;
        let damping = blend(a.damping_n_s_m[row], a.damping_n_s_m[next]) * o.rack_velocity_m_s;
        let back = blend(a.return_n_m[row], a.return_n_m[next]) * o.rack_displacement_m;
        let back = back.clamp(-a.return_limit_n, a.return_limit_n);
        let [map_scale, damping_scale, return_scale] = self.scale;
        map_scale * map - damping_scale * damping - return_scale * back
    }

    /// Force of the motor, at the rack. [N]
    fn motor(&mut self, wanted: f64, engine_on: bool, step_s: f64) -> f64 {
        let a = &self.assist;
        let wanted = if engine_on { wanted.clamp(-a.force_limit_n, a.force_limit_n) } else { 0.0 };
        let force = &mut self.state[2];
        *force += step_s / (a.motor_lag_s + step_s) * (wanted - *force);
        *force
    }
}

/// Interval of `nodes` that holds `value`, and where in it; beyond the ends: the end's value.
fn bracket(nodes: &[f64], value: f64) -> (usize, f64) {
    if nodes.len() < 2 {
        return (0, 0.0);
    }
    let at = nodes.iter().rposition(|node| *node <= value).unwrap_or(0).min(nodes.len() - 2);
    let part = (value - nodes[at]) / (nodes[at + 1] - nodes[at]);
    (at, part.clamp(0.0, 1.0))
}
