//! Powertrain: engine, torque converter or clutch, gearbox, differentials — and the wheel spins they drive.
//!
//! One sub-step advances engine and wheel speeds together: explicit for smooth torques, linearly implicit for
//! the converter, and for every Coulomb element (clutch, lock-up, differential locks, brakes) the torque that
//! brings the speed difference to zero within the sub-step, limited to its capacity. So locked elements stay
//! locked without a stiff spring, and friction takes energy only. The engine's torque runs from closed to full
//! throttle in proportion; an idle governor and a rev limiter act on the throttle.
//!
//! Torque converter: pump torque K(ν) ω_e², turbine torque μ(ν) K(ν) ω_e² with ν = ω_t/ω_e (SAE J643); in
//! overrun the sides change places with μ = 1. Spin speeds are absolute (wheel against inertial space about
//! its axis); the small pitch rate of the body is not taken off for the shafts.

use crate::curve::{Curve, Family};
use crate::io::GearMode;
use config::car::{Car, Combustion, Coupling, Powertrain};

const RPM: f64 = std::f64::consts::PI / 30.0;
/// Torque with which the parking lock holds each driven wheel. [N·m]
const PARK_N_M: f64 = 5000.0;
/// Time in which the lock-up clutch closes or opens. [s]
const LOCK_UP_TIME_S: f64 = 0.3;

/// What changes while driving.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrivelineState {
    /// Engine speed. [rad/s]
    pub engine_rad_s: f64,
    /// Gear engaged or being engaged: −1 reverse, 0 neutral.
    pub gear: i32,
    /// Ratio before the shift under way.
    pub old_ratio: f64,
    /// Time since the last shift began. [s]
    pub since_shift_s: f64,
    /// How far the lock-up clutch is closed. [-], [0, 1]
    pub lock_up: f64,
}

/// Result of one sub-step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SpinTorques {
    /// Drive-shaft torque on each wheel. [N·m]
    pub drive_n_m: [f64; 4],
    /// Brake torque on each wheel, signed. [N·m]
    pub brake_n_m: [f64; 4],
    /// Engine torque. [N·m]
    pub engine_n_m: f64,
}

/// What a driveline that is simulated outside the car does to it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OutsideDrive {
    /// Torque of the half shafts on the wheels, driving positive. [N·m]
    pub wheel_n_m: [f64; 4],
    /// Engine speed. [rad/s]
    pub engine_rad_s: f64,
    /// Engine torque. [N·m]
    pub engine_n_m: f64,
}

/// What the car's transmission control asks of a driveline.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DriveDemand {
    /// Pedal. [-], [0, 1]
    pub pedal: f64,
    /// Ratio of the gearbox, 0 in neutral, negative in reverse. [-]
    pub ratio: f64,
    /// How far the lock-up clutch is closed. [-], [0, 1]
    pub lock_up: f64,
}

#[derive(Debug, Clone, PartialEq)]
struct EngineMap {
    full: Curve,
    closed: Curve,
    inertia: f64,
    idle_rad_s: f64,
    limit_rad_s: f64,
}

impl EngineMap {
    /// Torque at closed and at full throttle. [N·m]
    fn ends(&self, speed: f64) -> (f64, f64) {
        (self.closed.held(speed), self.full.held(speed))
    }

    fn torque(&self, speed: f64, throttle: f64) -> f64 {
        let (closed, full) = self.ends(speed);
        let span = (full - closed).max(1.0);
        let idle = (-closed / span + 0.05 * (self.idle_rad_s - speed)).clamp(0.0, 1.0);
        let limit = ((self.limit_rad_s - speed) / 5.0).clamp(0.0, 1.0);
        let idle = if speed < 1.5 * self.idle_rad_s { idle } else { 0.0 };
        closed + throttle.max(idle) * limit * (full - closed)
    }
}

#[derive(Debug, Clone, PartialEq)]
enum CouplingMap {
    Converter {
        torque_ratio: Curve,
        capacity: Curve,
        lock_up_gear: i32,
        lock_up_rad_s: f64,
        lock_up_n_m: f64,
    },
    Clutch {
        torque_n_m: f64,
        launch_rad_s: f64,
    },
}

impl CouplingMap {
    /// Pump and turbine torque of the converter at engine and turbine speed. [N·m]
    fn converter(torque_ratio: &Curve, capacity: &Curve, engine: f64, turbine: f64) -> (f64, f64) {
        if engine >= turbine {
            if engine <= 0.0 {
                return (0.0, 0.0);
            }
            let ratio = (turbine / engine).clamp(0.0, 1.0);
            let pump = capacity.held(ratio) * engine * engine;
            (pump, torque_ratio.held(ratio) * pump)
        } else {
            let ratio = (engine / turbine).clamp(0.0, 1.0);
            let torque = -capacity.held(ratio) * turbine * turbine;
            (torque, torque)
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
struct Gears {
    forward: Vec<f64>,
    reverse: f64,
    efficiency: f64,
    shift_time_s: f64,
    interval_s: f64,
    up: Option<Family>,
    down: Option<Family>,
}

// One of these a car: a box would only add an indirection to the step.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, PartialEq)]
enum Kind {
    WheelTorque { max_n_m: f64, max_w: f64, drag_n_m: f64 },
    Combustion { engine: EngineMap, coupling: CouplingMap, gears: Gears },
}

/// Constants of the powertrain.
#[derive(Debug, Clone, PartialEq)]
pub struct Driveline {
    kind: Kind,
    /// Wheel torque per gearbox torque (or share of the wheel torque), by wheel.
    weight: [f64; 4],
    inertia: [f64; 4],
    preload: [f64; 2],
    locking: [f64; 2],
    centre_lock_n_m: f64,
    front_share: f64,
}

impl Driveline {
    /// For a car.
    #[must_use]
    pub fn new(car: &Car) -> Self {
        let (fi, ri) = (car.front.wheel_spin_inertia_kg_m2, car.rear.wheel_spin_inertia_kg_m2);
        let inertia = [fi, fi, ri, ri];
        match &car.powertrain {
            Powertrain::WheelTorque { max_torque_n_m, max_power_w, drag_torque_n_m, front_share } => {
                let (f, r) = (0.5 * front_share, 0.5 * (1.0 - front_share));
                Self {
                    kind: Kind::WheelTorque {
                        max_n_m: *max_torque_n_m,
                        max_w: *max_power_w,
                        drag_n_m: *drag_torque_n_m,
                    },
                    weight: [f, f, r, r],
                    inertia,
                    preload: [0.0; 2],
                    locking: [0.0; 2],
                    centre_lock_n_m: 0.0,
                    front_share: *front_share,
                }
            }
            Powertrain::Combustion(p) => Self::combustion(p, inertia),
        }
    }

    fn combustion(p: &Combustion, inertia: [f64; 4]) -> Self {
        let e = &p.engine;
        let g = &p.gearbox;
        let rows: Vec<f64> = (0..g.forward_ratios.len()).map(|k| k as f64).collect();
        // Shift maps as families over the gear index, throttle as abscissa.
        let map = |speeds: &[Vec<f64>], first: usize| {
            (!speeds.is_empty())
                .then(|| Family::new(&rows[first..first + speeds.len()], &g.shift_throttle, speeds, RPM))
        };
        let f = 0.5 * p.front_share * p.front_differential.ratio;
        let r = 0.5 * (1.0 - p.front_share) * p.rear_differential.ratio;
        Self {
            kind: Kind::Combustion {
                engine: EngineMap {
                    full: Curve::new(&e.speed_rpm, &e.full_throttle_n_m, RPM, 1.0),
                    closed: Curve::new(&e.speed_rpm, &e.closed_throttle_n_m, RPM, 1.0),
                    inertia: e.inertia_kg_m2,
                    idle_rad_s: e.idle_rpm * RPM,
                    limit_rad_s: e.limit_rpm * RPM,
                },
                coupling: match &p.coupling {
                    Coupling::TorqueConverter {
                        speed_ratio,
                        torque_ratio,
                        capacity_n_m_s2,
                        lock_up_gear,
                        lock_up_rpm,
                        lock_up_torque_n_m,
                    } => CouplingMap::Converter {
                        torque_ratio: Curve::new(speed_ratio, torque_ratio, 1.0, 1.0),
                        capacity: Curve::new(speed_ratio, capacity_n_m_s2, 1.0, 1.0),
                        lock_up_gear: *lock_up_gear as i32,
                        lock_up_rad_s: lock_up_rpm * RPM,
                        lock_up_n_m: *lock_up_torque_n_m,
                    },
                    Coupling::Clutch { torque_n_m, launch_rpm } => {
                        CouplingMap::Clutch { torque_n_m: *torque_n_m, launch_rad_s: launch_rpm * RPM }
                    }
                },
                gears: Gears {
                    forward: g.forward_ratios.clone(),
                    reverse: g.reverse_ratio,
                    efficiency: g.efficiency,
                    shift_time_s: g.shift_time_s,
                    interval_s: g.shift_interval_s,
                    up: map(&g.upshift_rpm, 0),
                    down: map(&g.downshift_rpm, 1),
                },
            },
            weight: [f, f, r, r],
            inertia,
            preload: [p.front_differential.preload_n_m, p.rear_differential.preload_n_m],
            locking: [p.front_differential.locking_ratio, p.rear_differential.locking_ratio],
            centre_lock_n_m: p.centre_lock_torque_n_m,
            front_share: p.front_share,
        }
    }

    /// Whether there is an engine.
    #[must_use]
    pub fn has_engine(&self) -> bool {
        matches!(self.kind, Kind::Combustion { .. })
    }

    /// Ratio of a gear, negative in reverse.
    fn ratio(&self, gear: i32) -> f64 {
        match &self.kind {
            Kind::WheelTorque { .. } => f64::from(gear.signum()),
            Kind::Combustion { gears, .. } => match gear {
                0 => 0.0,
                g if g < 0 => -gears.reverse,
                g => gears.forward[(g as usize - 1).min(gears.forward.len() - 1)],
            },
        }
    }

    /// Ratio in effect, between old and new during a shift.
    pub fn effective_ratio(&self, s: &DrivelineState) -> f64 {
        let new = self.ratio(s.gear);
        let Kind::Combustion { gears, .. } = &self.kind else { return new };
        // Through neutral or from forward to reverse the ratio steps: there is nothing between.
        if s.since_shift_s >= gears.shift_time_s || s.old_ratio * new <= 0.0 {
            new
        } else {
            s.old_ratio + (new - s.old_ratio) * s.since_shift_s / gears.shift_time_s
        }
    }

    /// Speed of the gearbox output shaft. [rad/s]
    fn output_rad_s(&self, spin: &[f64; 4]) -> f64 {
        (0..4).map(|i| self.weight[i] * spin[i]).sum()
    }

    /// State at a steady speed: the lowest gear whose upshift speed is not yet reached.
    #[must_use]
    pub fn start(&self, spin: &[f64; 4], mode: GearMode) -> DrivelineState {
        let mut gear = match mode {
            GearMode::Park | GearMode::Neutral => 0,
            GearMode::Reverse => -1,
            GearMode::Drive => 1,
            GearMode::Manual(g) => i32::from(g.max(1)),
        };
        let mut engine = 0.0;
        if let Kind::Combustion { engine: map, gears, .. } = &self.kind {
            let output = self.output_rad_s(spin);
            let top = gears.forward.len() as i32;
            gear = gear.min(top);
            if mode == GearMode::Drive {
                while gear < top
                    && gears
                        .up
                        .as_ref()
                        .is_some_and(|up| output * self.ratio(gear) > up.held(f64::from(gear - 1), 0.3))
                {
                    gear += 1;
                }
            }
            engine = map.idle_rad_s.max(output * self.ratio(gear));
        }
        DrivelineState {
            engine_rad_s: engine,
            gear,
            old_ratio: self.ratio(gear),
            since_shift_s: 10.0,
            lock_up: 0.0,
        }
    }

    /// Once a step: gear and lock-up for what the driver asks and the map says.
    pub fn select(
        &self,
        s: &mut DrivelineState,
        spin: &[f64; 4],
        throttle: f64,
        mode: GearMode,
        step_s: f64,
    ) {
        s.since_shift_s += step_s;
        let Kind::Combustion { coupling, gears, .. } = &self.kind else {
            s.gear = match mode {
                GearMode::Park | GearMode::Neutral => 0,
                GearMode::Reverse => -1,
                _ => 1,
            };
            return;
        };
        let top = gears.forward.len() as i32;
        let output = self.output_rad_s(spin);
        let target = match mode {
            GearMode::Park | GearMode::Neutral => 0,
            GearMode::Reverse => -1,
            GearMode::Manual(g) => i32::from(g.max(1)).min(top),
            GearMode::Drive if s.gear < 1 => 1,
            GearMode::Drive => {
                let row = |gear: i32| f64::from(gear - 1);
                let turbine = output * self.ratio(s.gear);
                let up_now = s.gear < top
                    && gears.up.as_ref().is_some_and(|up| turbine > up.held(row(s.gear), throttle))
                    && gears.down.as_ref().is_none_or(|down| {
                        output * self.ratio(s.gear + 1) > down.held(row(s.gear + 1), throttle)
                    });
                let down_now = s.gear > 1
                    && gears.down.as_ref().is_some_and(|down| turbine < down.held(row(s.gear), throttle));
                if s.since_shift_s < gears.interval_s + gears.shift_time_s {
                    s.gear
                } else if up_now {
                    s.gear + 1
                } else if down_now {
                    s.gear - 1
                } else {
                    s.gear
                }
            }
        };
        if target != s.gear {
            s.old_ratio = self.effective_ratio(s);
            s.gear = target;
            s.since_shift_s = 0.0;
        }
        if let CouplingMap::Converter { lock_up_gear, lock_up_rad_s, .. } = coupling {
            let turbine = output * self.ratio(s.gear);
            // Hysteresis of a tenth between closing and opening.
            let threshold = if s.lock_up > 0.5 { 0.9 * lock_up_rad_s } else { *lock_up_rad_s };
            let close =
                s.gear >= *lock_up_gear && turbine > threshold && s.since_shift_s >= gears.shift_time_s;
            let change = step_s / LOCK_UP_TIME_S;
            s.lock_up = (s.lock_up + if close { change } else { -change }).clamp(0.0, 1.0);
        }
    }

    /// Throttle that makes the wheels' torques sum to `torque_n_m`, and what is missing of a negative one.
    #[must_use]
    pub fn throttle_for(&self, s: &DrivelineState, spin: &[f64; 4], torque_n_m: f64) -> (f64, f64) {
        match &self.kind {
            Kind::WheelTorque { drag_n_m, .. } => {
                let most = self.wheel_torque_limit(spin);
                let drag = if s.gear == 0 { 0.0 } else { *drag_n_m };
                let throttle = ((torque_n_m + drag) / (most + drag)).clamp(0.0, 1.0);
                (throttle, (torque_n_m + drag).min(0.0))
            }
            Kind::Combustion { engine, coupling, gears } => {
                let ratio = self.effective_ratio(s);
                let sum_weights: f64 = self.weight.iter().sum();
                if ratio == 0.0 {
                    return (0.0, torque_n_m.min(0.0));
                }
                let gain = ratio.abs() * sum_weights * gears.efficiency;
                let turbine = torque_n_m / gain;
                let multiplied = match coupling {
                    CouplingMap::Converter { torque_ratio, .. } if s.lock_up < 1.0 && turbine > 0.0 => {
                        let speed = self.output_rad_s(spin) * ratio;
                        let nu =
                            if s.engine_rad_s > 0.0 { (speed / s.engine_rad_s).clamp(0.0, 1.0) } else { 0.0 };
                        let m = torque_ratio.held(nu).max(0.5);
                        turbine / (m + (1.0 - m) * s.lock_up)
                    }
                    _ => turbine,
                };
                let (closed, full) = engine.ends(s.engine_rad_s);
                let throttle = ((multiplied - closed) / (full - closed).max(1.0)).clamp(0.0, 1.0);
                (throttle, ((turbine - closed) * gain).min(0.0))
            }
        }
    }

    /// Largest sum of wheel torques without an engine model. [N·m]
    fn wheel_torque_limit(&self, spin: &[f64; 4]) -> f64 {
        let Kind::WheelTorque { max_n_m, max_w, .. } = &self.kind else { return 0.0 };
        let speed = self.output_rad_s(spin).abs().max(1.0);
        max_n_m.min(max_w / speed)
    }

    /// One sub-step of engine and wheel speeds under the tyres' torques about the spin axes.
    pub fn advance(
        &self,
        s: &mut DrivelineState,
        spin: &mut [f64; 4],
        tyre_n_m: &[f64; 4],
        brake_capacity_n_m: &[f64; 4],
        throttle: f64,
        mode: GearMode,
        outside: Option<&OutsideDrive>,
        h: f64,
    ) -> SpinTorques {
        let mut out = SpinTorques::default();
        for i in 0..4 {
            spin[i] += h * tyre_n_m[i] / self.inertia[i];
        }
        let mut drag = [0.0; 4];
        match (outside, &self.kind) {
            (Some(o), _) => {
                (out.drive_n_m, out.engine_n_m) = (o.wheel_n_m, o.engine_n_m);
                s.engine_rad_s = o.engine_rad_s;
            }
            (None, Kind::WheelTorque { drag_n_m, .. }) => {
                let direction = f64::from(s.gear.signum());
                // Closed throttle drags, full throttle does not, so that the sum is what throttle_for assumes.
                let drive = (self.wheel_torque_limit(spin) * throttle).max(0.0);
                for i in 0..4 {
                    out.drive_n_m[i] = direction * drive * self.weight[i];
                    drag[i] = direction.abs() * drag_n_m * (1.0 - throttle) * self.weight[i];
                }
            }
            (None, Kind::Combustion { engine, coupling, gears }) => {
                let ratio = self.effective_ratio(s);
                let shift = (s.since_shift_s / gears.shift_time_s).min(1.0);
                let shifting = shift < 1.0;
                let inverse_inertia = ratio
                    * ratio
                    * (0..4).map(|i| self.weight[i] * self.weight[i] / self.inertia[i]).sum::<f64>();
                let mut turbine = ratio * self.output_rad_s(spin);
                let throttle = match coupling {
                    CouplingMap::Clutch { .. } if shifting => 0.0,
                    _ => throttle,
                };
                out.engine_n_m = engine.torque(s.engine_rad_s, throttle);
                let mut crank = s.engine_rad_s + h * out.engine_n_m / engine.inertia;
                let mut shaft = 0.0;
                let clutch_n_m = match coupling {
                    CouplingMap::Converter { torque_ratio, capacity, lock_up_n_m, .. } => {
                        let open = 1.0 - s.lock_up;
                        if ratio != 0.0 && open > 0.0 {
                            // A wheel whose brake holds it through this sub-step does not give way to the turbine's
                            // torque: it stands, and brings no compliance to the implicit step.
                            let (_, first) = CouplingMap::converter(torque_ratio, capacity, crank, turbine);
                            let torque = open * first;
                            let (mut give, mut moving) = (0.0, 0.0);
                            for i in 0..4 {
                                let lever = ratio * self.weight[i];
                                let pull = spin[i].abs() * self.inertia[i] / h + (lever * torque).abs();
                                if pull > brake_capacity_n_m[i] {
                                    give += lever * lever / self.inertia[i];
                                    moving += lever * spin[i];
                                }
                            }
                            turbine = moving;
                            let (pump, wheel) =
                                CouplingMap::converter(torque_ratio, capacity, crank, turbine);
                            let (pump1, _) =
                                CouplingMap::converter(torque_ratio, capacity, crank + 1.0, turbine);
                            let (_, wheel1) =
                                CouplingMap::converter(torque_ratio, capacity, crank, turbine + 1.0);
                            // The turbine is fed by what the pump takes over the sub-step, both implicit in the crank.
                            let fed = open / (1.0 + h * (pump1 - pump).max(0.0) / engine.inertia);
                            let pump = fed * pump;
                            let wheel = fed * wheel / (1.0 + h * (wheel - wheel1).max(0.0) * give);
                            crank -= h * pump / engine.inertia;
                            turbine += h * wheel * give;
                            shaft += wheel;
                        }
                        s.lock_up * lock_up_n_m
                    }
                    CouplingMap::Clutch { torque_n_m, launch_rad_s } => {
                        let idle = engine.idle_rad_s;
                        let launch = ((s.engine_rad_s - 0.9 * idle) / (launch_rad_s - 0.9 * idle).max(1.0))
                            .clamp(0.0, 1.0);
                        torque_n_m * launch * if shifting { (2.0 * shift - 1.0).max(0.0) } else { 1.0 }
                    }
                };
                if ratio != 0.0 && clutch_n_m > 0.0 {
                    let stop = (crank - turbine) / (h * (1.0 / engine.inertia + inverse_inertia));
                    let torque = stop.clamp(-clutch_n_m, clutch_n_m);
                    crank -= h * torque / engine.inertia;
                    shaft += torque;
                }
                s.engine_rad_s = crank.max(0.0);
                // Losses always take: less arrives when driving, more is needed in overrun.
                let efficiency =
                    if shaft * turbine >= 0.0 { gears.efficiency } else { 1.0 / gears.efficiency };
                for i in 0..4 {
                    out.drive_n_m[i] = ratio * self.weight[i] * shaft * efficiency;
                }
            }
        }
        for i in 0..4 {
            spin[i] += h * out.drive_n_m[i] / self.inertia[i];
        }
        self.lock(spin, &mut out, h);
        for i in 0..4 {
            let mut shaft = drag[i];
            if mode == GearMode::Park && self.weight[i] > 0.0 {
                shaft += PARK_N_M;
            }
            let capacity = brake_capacity_n_m[i] + shaft;
            if capacity > 0.0 {
                let stop = spin[i].abs() * self.inertia[i] / h;
                let torque = -spin[i].signum() * stop.min(capacity);
                spin[i] += h * torque / self.inertia[i];
                out.brake_n_m[i] = torque * brake_capacity_n_m[i] / capacity;
                out.drive_n_m[i] += torque * shaft / capacity;
            }
        }
        out
    }

    /// Friction of the differentials.
    fn lock(&self, spin: &mut [f64; 4], out: &mut SpinTorques, h: f64) {
        for axle in 0..2 {
            let (l, r) = (2 * axle, 2 * axle + 1);
            let limit = self.preload[axle] + self.locking[axle] * (out.drive_n_m[l] + out.drive_n_m[r]).abs();
            if limit > 0.0 && self.weight[l] > 0.0 {
                let stop = (spin[l] - spin[r]) / (h * (1.0 / self.inertia[l] + 1.0 / self.inertia[r]));
                let torque = stop.clamp(-limit, limit);
                self.transfer(spin, out, h, l, -torque);
                self.transfer(spin, out, h, r, torque);
            }
        }
        if self.centre_lock_n_m > 0.0 && self.front_share > 0.0 && self.front_share < 1.0 {
            // The lock ties both prop shafts; their torque reaches the wheels through the axle ratios.
            let (f, r) = (
                0.5 * self.weight[0] / (0.5 * self.front_share),
                0.5 * self.weight[2] / (0.5 * (1.0 - self.front_share)),
            );
            let difference = f * (spin[0] + spin[1]) - r * (spin[2] + spin[3]);
            let give = 2.0 * (f * f / self.inertia[0] + r * r / self.inertia[2]);
            let torque = (difference / (h * give)).clamp(-self.centre_lock_n_m, self.centre_lock_n_m);
            for i in 0..4 {
                self.transfer(spin, out, h, i, if i < 2 { -f * torque } else { r * torque });
            }
        }
    }

    fn transfer(&self, spin: &mut [f64; 4], out: &mut SpinTorques, h: f64, wheel: usize, torque: f64) {
        spin[wheel] += h * torque / self.inertia[wheel];
        out.drive_n_m[wheel] += torque;
    }
}
