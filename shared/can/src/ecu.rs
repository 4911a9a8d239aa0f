//! A virtual steering ECU: the other end of the bus, made of the same receiver and sender as the bench's.
//!
//! It reads the rest-bus (speed, engine, ignition, angle) and the torsion-bar torque that the bench measures in
//! the place of its own sensor, assists, and answers with torque, state and the faults it saw. Assist: torque
//! above a dead band times a gain that falls with speed, limited in size and rate. Not a maker's logic; enough to
//! show what a lost or corrupted message does: no speed → degraded (assist as at [`FALLBACK_SPEED_M_S`]), no
//! torque → no assist, ignition or engine off → no assist.

use crate::bus::{Bus, BusError, Event, Queue};
use crate::fault::Faults;
use crate::frame::Frame;
use crate::mapping::{Plan, Variable};
use crate::receive::Receiver;
use crate::restbus::RestBus;
use std::collections::VecDeque;

/// Speed assumed while none is known. [m/s]
pub const FALLBACK_SPEED_M_S: f64 = 30.0;
/// Torque without assist to either side. [N·m]
const DEAD_BAND_N_M: f64 = 0.5;
/// Assist per torque at standstill. [-]
const GAIN: f64 = 8.0;
/// Speed at which the gain has halved. [m/s]
const GAIN_SPEED_M_S: f64 = 12.0;
/// Lag of each of two in a row that the torque passes before the map. The torque comes over the bus, and the assist
/// goes back over it: some 20 ms, in which a torsion bar against a rack's inertia (13 Hz) would start to swing at a gain
/// above 1. What is left of the gain at 13 Hz behind both lags is a fourteenth. [s]
const TORQUE_LAG_S: f64 = 0.04;
/// Greatest assist. [N·m]
const ASSIST_MAX_N_M: f64 = 60.0;
/// Greatest change of the assist. [N·m/s]
const ASSIST_RATE_N_M_S: f64 = 400.0;
/// Time from ignition to readiness. [ns]
const START_NS: u64 = 100_000_000;
/// Engine speed from which the engine counts as running. [rad/s]
const RUNNING_RAD_S: f64 = 40.0;
/// Longest time between two looks that the assist's rate is reckoned with. [s]
const LOOK_MAX_S: f64 = 0.1;

/// States that the ECU reports.
pub mod state {
    /// Ignition off.
    pub const OFF: f64 = 0.0;
    /// Starting.
    pub const STARTING: f64 = 1.0;
    /// Ready; the engine does not run.
    pub const READY: f64 = 2.0;
    /// Assisting.
    pub const ASSISTING: f64 = 3.0;
    /// Assisting at the fall-back speed: the speed message is missing.
    pub const DEGRADED: f64 = 4.0;
    /// Not assisting: the torque is missing.
    pub const FAULT: f64 = 5.0;
}

/// What the ECU hears, in the order of its inputs: name, unit.
const HEARD: [(&str, &str); 7] = [
    ("ecu.vehicle_speed_m_s", "m/s"),
    ("ecu.engine_speed_rad_s", "rad/s"),
    ("ecu.ignition", "1"),
    ("ecu.torsion_bar_torque_n_m", "N*m"),
    ("ecu.steering_wheel_angle_rad", "rad"),
    ("ecu.yaw_rate_rad_s", "rad/s"),
    ("ecu.wheel_speed_rad_s", "rad/s"),
];
const SPEED: usize = 0;
const ENGINE: usize = 1;
const IGNITION: usize = 2;
const TORQUE: usize = 3;
const ANGLE: usize = 4;

/// What the ECU says.
const SAID: [(&str, &str); 10] = [
    ("ecu.state", "1"),
    ("ecu.driver_torque_n_m", "N*m"),
    ("ecu.assist_torque_n_m", "N*m"),
    ("ecu.steering_angle_rad", "rad"),
    ("ecu.temperature_k", "K"),
    ("ecu.supply_v", "V"),
    ("ecu.checksum_errors", "1"),
    ("ecu.sequence_errors", "1"),
    ("ecu.timeouts", "1"),
    ("ecu.lost_frames", "1"),
];

fn variables(list: &[(&str, &str)]) -> Vec<Variable> {
    list.iter().map(|(name, unit)| Variable { name: (*name).to_owned(), unit: (*unit).to_owned() }).collect()
}

/// Variables that the ECU's mapping may send: (name, unit).
pub fn sources() -> Vec<Variable> {
    variables(&SAID)
}

/// Variables that the ECU's mapping may receive into.
pub fn targets() -> Vec<Variable> {
    variables(&HEARD)
}

/// Faults the ECU has seen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Seen {
    /// Good frames.
    pub good: u64,
    /// Frames with a wrong checksum, counter value, Data ID or length.
    pub checksum_errors: u64,
    /// Frames repeated or out of sequence.
    pub sequence_errors: u64,
    /// Frames lost, by the counters.
    pub lost: u64,
    /// Time-outs.
    pub timeouts: u64,
    /// Frames sent.
    pub sent: u64,
}

/// The ECU.
#[derive(Debug, Clone)]
pub struct VirtualEcu {
    receiver: Receiver,
    rest_bus: RestBus,
    heard: [f64; HEARD.len()],
    said: [f64; SAID.len()],
    on_since_ns: Option<u64>,
    assist_n_m: f64,
    lagged_n_m: [f64; 2],
    looked_ns: Option<u64>,
}

impl VirtualEcu {
    /// With the plan of its own mapping, compiled against [`sources`] and [`targets`].
    pub fn new(plan: Plan) -> Self {
        let faults = Faults::none(&plan);
        VirtualEcu {
            receiver: Receiver::new(plan.receive, &faults),
            rest_bus: RestBus::new(plan.send, &faults),
            heard: [f64::NAN; HEARD.len()],
            said: [0.0; SAID.len()],
            on_since_ns: None,
            assist_n_m: 0.0,
            lagged_n_m: [0.0; 2],
            looked_ns: None,
        }
    }

    /// A frame from the bus.
    pub fn take(&mut self, now_ns: u64, frame: &Frame) {
        self.receiver.take(now_ns, frame, &mut self.heard);
    }

    /// Thinks and sends what is due.
    pub fn step(&mut self, now_ns: u64, bus: &mut dyn Bus) {
        self.receiver.step(now_ns, &mut self.heard);
        self.think(now_ns);
        self.rest_bus.step(now_ns, &self.said, bus);
    }

    fn think(&mut self, now_ns: u64) {
        let passed_ns = now_ns.saturating_sub(self.looked_ns.replace(now_ns).unwrap_or(now_ns));
        let dt_s = (passed_ns as f64 * 1e-9).min(LOOK_MAX_S);
        // A missing ignition message is the ignition off, as it is in a car whose bus sleeps.
        let on = self.heard[IGNITION] >= 2.0;
        self.on_since_ns = if on { self.on_since_ns.or(Some(now_ns)) } else { None };
        let torque = self.heard[TORQUE];
        let mut felt = if torque.is_finite() { torque } else { 0.0 };
        for lagged in &mut self.lagged_n_m {
            *lagged += dt_s / (TORQUE_LAG_S + dt_s) * (felt - *lagged);
            felt = *lagged;
        }
        let running = self.heard[ENGINE] >= RUNNING_RAD_S;
        let state = match self.on_since_ns {
            None => state::OFF,
            Some(since) if now_ns - since < START_NS => state::STARTING,
            Some(_) if torque.is_nan() => state::FAULT,
            Some(_) if !running => state::READY,
            Some(_) if self.heard[SPEED].is_nan() => state::DEGRADED,
            Some(_) => state::ASSISTING,
        };
        let wanted = if state == state::ASSISTING || state == state::DEGRADED {
            let speed = if state == state::DEGRADED { FALLBACK_SPEED_M_S } else { self.heard[SPEED].abs() };
            let gain = GAIN / (1.0 + speed / GAIN_SPEED_M_S);
            let over = felt.abs() - DEAD_BAND_N_M;
            (gain * over.max(0.0)).min(ASSIST_MAX_N_M).copysign(felt)
        } else {
            0.0
        };
        let step = ASSIST_RATE_N_M_S * dt_s;
        self.assist_n_m += (wanted - self.assist_n_m).clamp(-step, step);
        let seen = self.seen();
        self.said = [
            state,
            torque,
            self.assist_n_m,
            self.heard[ANGLE],
            // A housing that has stood in a warm room, on a full battery.
            298.15 + 0.2 * self.assist_n_m.abs(),
            13.8,
            seen.checksum_errors as f64,
            seen.sequence_errors as f64,
            seen.timeouts as f64,
            seen.lost as f64,
        ];
    }

    /// The state it reports, see [`state`].
    pub fn state(&self) -> f64 {
        self.said[0]
    }

    /// Assist. [N·m]
    pub fn assist_n_m(&self) -> f64 {
        self.assist_n_m
    }

    /// What it hears of the car: speed [m/s], torsion-bar torque [N·m]; NaN where absent.
    pub fn heard(&self) -> (f64, f64) {
        (self.heard[SPEED], self.heard[TORQUE])
    }

    /// Faults seen so far.
    pub fn seen(&self) -> Seen {
        let mut seen = Seen { sent: self.rest_bus.counts().sent, ..Seen::default() };
        for index in 0..self.receiver.plan().len() {
            let known = self.receiver.known(index);
            seen.good += known.good;
            seen.checksum_errors += known.wrong;
            seen.sequence_errors += known.sequence;
            seen.lost += known.lost;
            seen.timeouts += known.timeouts;
        }
        seen
    }
}

/// A bus in memory with the virtual ECU on it: deterministic, no thread, no socket.
#[derive(Debug)]
pub struct MemoryBus {
    ecu: VirtualEcu,
    to_ecu: VecDeque<Frame>,
    from_ecu: Outbox,
}

/// Frames held on the memory bus at once.
const HELD: usize = 512;

#[derive(Debug)]
struct Outbox(Queue);

impl Bus for Outbox {
    fn send(&mut self, frame: &Frame) -> Result<(), BusError> {
        if self.0.push(0, *frame) { Ok(()) } else { Err(BusError::Full) }
    }

    fn receive(&mut self) -> Result<Option<Event>, BusError> {
        Ok(None)
    }
}

impl MemoryBus {
    /// With an ECU on it.
    pub fn new(ecu: VirtualEcu) -> Self {
        MemoryBus { ecu, to_ecu: VecDeque::with_capacity(HELD), from_ecu: Outbox(Queue::new(HELD)) }
    }

    /// The ECU.
    pub fn ecu(&self) -> &VirtualEcu {
        &self.ecu
    }
}

impl Bus for MemoryBus {
    fn send(&mut self, frame: &Frame) -> Result<(), BusError> {
        if self.to_ecu.len() == HELD {
            return Err(BusError::Full);
        }
        self.to_ecu.push_back(*frame);
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<Event>, BusError> {
        Ok(self.from_ecu.0.pop(u64::MAX).map(Event::Frame))
    }

    fn advance(&mut self, now_ns: u64) {
        while let Some(frame) = self.to_ecu.pop_front() {
            self.ecu.take(now_ns, &frame);
        }
        self.ecu.step(now_ns, &mut self.from_ecu);
    }

    fn in_memory(&self) -> bool {
        true
    }
}
