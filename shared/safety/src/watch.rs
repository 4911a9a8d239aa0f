//! Judges the measurement: limits, speeds, sensor range, frozen values, disagreeing sensors.
//!
//! Every comparison is written so that a value that is not a number breaks its limit.

use crate::trip::TripCode;
use config::rig::{Limits, Rig};
use config::unit::SteeringUnit;
use core::f64::consts::TAU;
use rig_plant::state::{StateReader, StateWriter};
use rig_plant::{Channel, Linkage, Measurement};

/// A broken rule: code, channel, limit, value.
pub type Finding = (TripCode, u8, f64, f64);

const MOVING: usize = 5;

/// Watches the sensors from tick to tick.
#[derive(Debug, Clone)]
pub struct Watch {
    limits: Limits,
    linkage: Linkage,
    ratio_m_rad: f64,
    bar_n_m_rad: f64,
    period_s: f64,
    noisy: u64,
    last: [f64; Channel::COUNT],
    same_ticks: [u32; Channel::COUNT],
    ring: Vec<[f64; MOVING]>,
    head: usize,
    seen: u64,
    rack_offset_m: f64,
    disagreeing_ticks: [u32; 3],
}

impl Watch {
    /// A watch that has seen nothing.
    pub fn new(rig: &Rig, unit: &SteeringUnit, period_s: f64) -> Self {
        let s = &rig.sensors;
        // A reading counts as frozen only where its noise spans steps of the 16-bit conversion.
        let noisy = |sensor: config::rig::Sensor| sensor.noise > 0.5 * sensor.range / 32767.0;
        let noisy_channels = [
            false,
            noisy((&s.steering_torque).into()),
            noisy((&s.torsion_bar_torque).into()),
            false,
            noisy((&s.rack_displacement).into()),
            noisy((&s.tie_rod_force).into()),
            noisy((&s.tie_rod_force).into()),
            noisy((&s.actuator_force).into()),
            noisy((&s.actuator_force).into()),
            noisy((&s.horizontal_stroke).into()),
            noisy((&s.horizontal_stroke).into()),
            noisy((&s.vertical_stroke).into()),
            noisy((&s.vertical_stroke).into()),
        ];
        let mut noisy = 0;
        for (i, on) in noisy_channels.into_iter().enumerate() {
            noisy |= u64::from(on) << i;
        }
        let window = (rig.limits.speed_window_s / period_s).round().max(1.0) as usize;
        Self {
            limits: rig.limits.clone(),
            linkage: Linkage::new(&rig.geometry),
            ratio_m_rad: unit.rack_travel_m_per_rev / TAU,
            bar_n_m_rad: unit.torsion_bar_stiffness_n_m_rad,
            period_s,
            noisy,
            last: [0.0; Channel::COUNT],
            same_ticks: [0; Channel::COUNT],
            ring: vec![[0.0; MOVING]; window],
            head: 0,
            seen: 0,
            rack_offset_m: 0.0,
            disagreeing_ticks: [0; 3],
        }
    }

    /// Judges one measurement. Returns the first broken rule and the channels not believed.
    pub fn step(&mut self, m: &Measurement) -> (Option<Finding>, u64) {
        let mut first: Option<Finding> = None;
        let mut note = |finding: Finding| {
            if first.is_none() {
                first = Some(finding);
            }
        };
        let readings = m.channels();
        let l = &self.limits;

        let mut faults = 0;
        for i in 0..Channel::COUNT {
            if m.validity & (1 << i) == 0 || !readings[i].is_finite() {
                faults |= 1 << i;
                note((TripCode::SensorRange, i as u8, 0.0, readings[i]));
            }
            let same = self.seen > 0 && readings[i] == self.last[i];
            self.same_ticks[i] = if same { self.same_ticks[i].saturating_add(1) } else { 0 };
            let frozen_s = f64::from(self.same_ticks[i]) * self.period_s;
            if self.noisy & (1 << i) != 0 && frozen_s > l.frozen_s {
                faults |= 1 << i;
                note((TripCode::SensorFrozen, i as u8, l.frozen_s, frozen_s));
            }
        }
        self.last = readings;

        let mut limit = |code: TripCode, channel: usize, limit: f64, value: f64| {
            let within = value.abs() <= limit;
            if !within {
                note((code, channel as u8, limit, value));
            }
        };
        for side in 0..2 {
            limit(TripCode::TieRodForce, side, l.tie_rod_force_n, m.tie_rod_force_n[side]);
            limit(TripCode::ActuatorForce, side, l.actuator_force_n, m.actuator_force_n[side]);
            limit(TripCode::HorizontalStroke, side, l.horizontal_stroke_m, m.horizontal_stroke_m[side]);
            limit(TripCode::VerticalStroke, side, l.vertical_stroke_m, m.vertical_stroke_m[side]);
        }
        limit(TripCode::RackDisplacement, 0, l.rack_displacement_m, m.rack_displacement_m);
        limit(TripCode::SteerAngle, 0, l.steer_angle_rad, m.steering_wheel_angle_rad);
        limit(TripCode::SteerTorque, 0, l.steer_torque_n_m, m.steering_wheel_torque_n_m);

        // Speeds over the window.
        let moving = [
            m.horizontal_stroke_m[0],
            m.horizontal_stroke_m[1],
            m.vertical_stroke_m[0],
            m.vertical_stroke_m[1],
            m.steering_wheel_angle_rad,
        ];
        if self.seen >= self.ring.len() as u64 {
            let span = self.ring.len() as f64 * self.period_s;
            let old = &self.ring[self.head];
            let speed: [f64; MOVING] = core::array::from_fn(|i| (moving[i] - old[i]) / span);
            for side in 0..2 {
                limit(TripCode::HorizontalSpeed, side, l.horizontal_speed_m_s, speed[side]);
                limit(TripCode::VerticalSpeed, side, l.vertical_speed_m_s, speed[2 + side]);
            }
            limit(TripCode::SteerRate, 0, l.steer_rate_rad_s, speed[4]);
        }
        self.ring[self.head] = moving;
        self.head = (self.head + 1) % self.ring.len();

        // Two sensors for one quantity.
        let mut differences = [0.0; 3];
        for side in 0..2 {
            let sign = [1.0, -1.0][side];
            let arm = self.linkage.arm_at_stroke(m.horizontal_stroke_m[side]);
            let rod = self.linkage.rod(&arm, m.vertical_stroke_m[side], sign * m.rack_displacement_m);
            let converted = m.actuator_force_n[side] / self.linkage.elongation_per_stroke(&arm, &rod);
            differences[side] = converted - m.tie_rod_force_n[side];
        }
        let twist = m.torsion_bar_torque_n_m / self.bar_n_m_rad;
        let by_angle = self.ratio_m_rad * (m.steering_wheel_angle_rad - twist);
        if self.seen == 0 {
            // An incremental encoder has no zero of its own: it agrees at the first reading.
            self.rack_offset_m = m.rack_displacement_m - by_angle;
        }
        differences[2] = m.rack_displacement_m - by_angle - self.rack_offset_m;
        let allowed = [l.force_disagreement_n, l.force_disagreement_n, l.rack_disagreement_m];
        let codes =
            [TripCode::ForceCellsDisagree, TripCode::ForceCellsDisagree, TripCode::RackSensorsDisagree];
        for k in 0..3 {
            if differences[k].abs() <= allowed[k] {
                self.disagreeing_ticks[k] = 0;
                continue;
            }
            self.disagreeing_ticks[k] = self.disagreeing_ticks[k].saturating_add(1);
            if f64::from(self.disagreeing_ticks[k]) * self.period_s > l.disagreement_s {
                faults |= match k {
                    0 => 1 << Channel::TieRodForceLeft as u8 | 1 << Channel::ActuatorForceLeft as u8,
                    1 => 1 << Channel::TieRodForceRight as u8 | 1 << Channel::ActuatorForceRight as u8,
                    _ => 1 << Channel::RackDisplacement as u8 | 1 << Channel::SteeringAngle as u8,
                };
                let channel = if k < 2 { k as u8 } else { 0 };
                note((codes[k], channel, allowed[k], differences[k]));
            }
        }
        self.seen += 1;
        (first, faults)
    }

    /// Length of the flat state.
    pub fn state_len(&self) -> usize {
        2 * Channel::COUNT + MOVING * self.ring.len() + 1 + 2 + 1 + 3
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        w.put_all(&self.last);
        w.put_all(&self.same_ticks.map(f64::from));
        for entry in &self.ring {
            w.put_all(entry);
        }
        w.put(self.head as f64);
        w.put_u64(self.seen);
        w.put(self.rack_offset_m);
        w.put_all(&self.disagreeing_ticks.map(f64::from));
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        r.take_all(&mut self.last);
        self.same_ticks = r.take_array::<{ Channel::COUNT }>().map(|v| v as u32);
        for entry in &mut self.ring {
            r.take_all(entry);
        }
        self.head = (r.take() as usize).min(self.ring.len() - 1);
        self.seen = r.take_u64();
        self.rack_offset_m = r.take();
        self.disagreeing_ticks = r.take_array::<3>().map(|v| v as u32);
    }
}
