//! What an ECU on the bus asks of the unit's assist motor, judged before it acts.
//!
//! A request that is missing (NaN, or its region older than `ecu_stale_s`) ramps to zero within `safe_ramp_s`, as a
//! unit's own ECU switches off: the driver then steers without assist, which is no danger to the rig, and the bench
//! goes on; what comes back fades in within `resume_fade_s`. Missing longer than `ecu_absent_max_s` it trips. A request beyond its limit is cut, one faster than its rate
//! is slowed, both are reported. One that pushes against the driver (its sign opposite to the torsion bar's torque, its
//! size above `ecu_against_n_m`) for longer than `disagreement_s` trips: self-steering, the gravest fault of an assist;
//! an active return and damping stay far below. Whatever is left fades with the tie-rod forces, so that an idle or
//! tripped bench has no assist.

use crate::clamp::flags;
use crate::trip::TripCode;
use crate::watch::Finding;
use config::rig::Limits;
use rig_plant::state::{StateReader, StateWriter};

/// What was last heard from the ECU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EcuWord {
    /// Assist torque at the pinion, left turn positive; NaN while its message is absent or not believed. [N·m]
    pub assist_torque_n_m: f64,
    /// Ticks since this was written, `u32::MAX` if never.
    pub age_ticks: u32,
}

/// Judges the words from tick to tick.
#[derive(Debug, Clone, Default)]
pub struct EcuGate {
    request_n_m: f64,
    /// Share of the request that is let through: an ECU that was not heard knows nothing of it, and asks for more and
    /// more; it comes back by a fade.
    share: f64,
    absent_ticks: u32,
    against_ticks: u32,
}

impl EcuGate {
    /// Values of its flat state.
    pub const STATE: usize = 4;

    /// One tick: the first broken rule, if there is one, and the bits of what was cut.
    pub fn step(
        &mut self,
        word: &EcuWord,
        torsion_bar_n_m: f64,
        limits: &Limits,
        period_s: f64,
    ) -> (Option<Finding>, u64) {
        let mut bits = 0;
        let stale = f64::from(word.age_ticks) * period_s > limits.ecu_stale_s;
        let absent = stale || !word.assist_torque_n_m.is_finite();
        self.absent_ticks = if absent { self.absent_ticks.saturating_add(1) } else { 0 };
        let most = limits.ecu_assist_torque_n_m;
        if absent {
            bits |= flags::ECU_ABSENT;
            self.share = 0.0;
            let step = most * period_s / limits.safe_ramp_s;
            self.request_n_m -= self.request_n_m.clamp(-step, step);
        } else {
            let mut wanted = word.assist_torque_n_m;
            if wanted.abs() > most {
                wanted = wanted.clamp(-most, most);
                bits |= flags::ECU_ASSIST;
            }
            self.share = (self.share + period_s / limits.resume_fade_s).min(1.0);
            let step = limits.ecu_assist_rate_n_m_s * period_s;
            let change = self.share * wanted - self.request_n_m;
            if change.abs() > step {
                bits |= flags::ECU_ASSIST_RATE;
            }
            self.request_n_m += change.clamp(-step, step);
        }
        let against =
            self.request_n_m * torsion_bar_n_m < 0.0 && self.request_n_m.abs() > limits.ecu_against_n_m;
        self.against_ticks = if against { self.against_ticks.saturating_add(1) } else { 0 };

        let absent_s = f64::from(self.absent_ticks) * period_s;
        let finding = if absent_s > limits.ecu_absent_max_s {
            Some((TripCode::EcuAbsent, 0, limits.ecu_absent_max_s, absent_s))
        } else if f64::from(self.against_ticks) * period_s > limits.disagreement_s {
            Some((TripCode::EcuAgainstDriver, 0, limits.ecu_against_n_m, self.request_n_m))
        } else {
            None
        };
        (finding, bits)
    }

    /// The request within its limits, before the fade. [N·m]
    pub fn request_n_m(&self) -> f64 {
        self.request_n_m
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        w.put_all(&[
            self.request_n_m,
            self.share,
            f64::from(self.absent_ticks),
            f64::from(self.against_ticks),
        ]);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        self.request_n_m = r.take();
        self.share = r.take();
        self.absent_ticks = r.take() as u32;
        self.against_ticks = r.take() as u32;
    }
}
