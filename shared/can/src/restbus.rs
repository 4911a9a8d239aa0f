//! Rest-bus: the messages that the rest of the car would send, in their cycles, from the bench's variables.
//!
//! A message that is due more than once since the last look (the process was stopped) is sent once and the
//! cycles left out are counted: a burst would tell the ECU nothing but that its timing is wrong.

use crate::bus::{Bus, Queue};
use crate::fault::{self, Faults, LATE_MAX};
use crate::frame::Frame;
use crate::mapping::SendPlan;
use crate::signal::Encoded;

/// Counts since the start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SendCounts {
    /// Frames sent.
    pub sent: u64,
    /// Frames that the bus refused.
    pub refused: u64,
    /// Cycles not sent because a variable was absent.
    pub withheld: u64,
    /// Cycles left out because the sender came late.
    pub skipped: u64,
    /// Signals clamped to their range.
    pub clamped: u64,
    /// Frames touched by an injected fault.
    pub injected: u64,
}

#[derive(Debug, Clone)]
struct State {
    next_ns: u64,
    counter: u64,
    late: Option<Queue>,
}

/// Sends the messages of a plan.
#[derive(Debug, Clone)]
pub struct RestBus {
    plan: Vec<SendPlan>,
    faults: Vec<Vec<fault::Spell>>,
    states: Vec<State>,
    counts: SendCounts,
}

impl RestBus {
    /// At time 0.
    pub fn new(plan: Vec<SendPlan>, faults: &Faults) -> Self {
        let delays = |spells: &[fault::Spell]| spells.iter().any(|spell| spell.delay_ns > 0);
        let states = plan
            .iter()
            .zip(&faults.send)
            .map(|(message, spells)| State {
                next_ns: message.offset_ns,
                counter: 0,
                late: delays(spells).then(|| Queue::new(LATE_MAX)),
            })
            .collect();
        RestBus { plan, faults: faults.send.clone(), states, counts: SendCounts::default() }
    }

    /// Counts so far.
    pub fn counts(&self) -> SendCounts {
        self.counts
    }

    /// Puts a fault on message `index` from now on, as a fault campaign orders it. What is over is forgotten. Allocates:
    /// not for the tick's path.
    pub fn inject(&mut self, index: usize, now_ns: u64, spell: fault::Spell) {
        if let (Some(spells), Some(state)) = (self.faults.get_mut(index), self.states.get_mut(index)) {
            fault::order(spells, &mut state.late, now_ns, spell);
        }
    }

    /// The messages sent.
    pub fn plan(&self) -> &[SendPlan] {
        &self.plan
    }

    /// Sends what is due at `now`. `variables` by the plan's indices; NaN where absent.
    pub fn step(&mut self, now_ns: u64, variables: &[f64], bus: &mut dyn Bus) {
        for ((message, state), spells) in self.plan.iter().zip(&mut self.states).zip(&self.faults) {
            if let Some(late) = &mut state.late {
                while let Some(frame) = late.pop(now_ns) {
                    send(&mut self.counts, bus, &frame);
                }
            }
            if now_ns < state.next_ns {
                continue;
            }
            let missed = (now_ns - state.next_ns) / message.cycle_ns;
            self.counts.skipped += missed;
            state.next_ns += (missed + 1) * message.cycle_ns;
            let wrong = fault::at(spells, now_ns);
            let Some(mut frame) = fill(message, variables, &mut self.counts) else {
                self.counts.withheld += 1;
                continue;
            };
            if let Some(protection) = &message.protection {
                protection.protect(message.id, frame.data_mut(), state.counter);
                if wrong.spoiled {
                    protection.spoil(frame.data_mut());
                }
                // A frame that is dropped leaves a gap in the sequence, as one lost on the way does.
                if !wrong.stale {
                    state.counter = protection.next(state.counter);
                }
            }
            self.counts.injected += u64::from(wrong.any());
            if wrong.drop {
                continue;
            }
            match &mut state.late {
                Some(late) if wrong.delay_ns > 0 => {
                    if !late.push(now_ns + wrong.delay_ns, frame) {
                        self.counts.refused += 1;
                    }
                }
                _ => send(&mut self.counts, bus, &frame),
            }
        }
    }
}

fn send(counts: &mut SendCounts, bus: &mut dyn Bus, frame: &Frame) {
    match bus.send(frame) {
        Ok(()) => counts.sent += 1,
        Err(_) => counts.refused += 1,
    }
}

/// The frame with all variables in place; `None` when one is absent and has no raw value for that.
fn fill(message: &SendPlan, variables: &[f64], counts: &mut SendCounts) -> Option<Frame> {
    let mut frame = Frame::new(message.id, message.fd, message.brs, &message.template)?;
    for field in &message.fields {
        let value = variables[field.source] * field.factor + field.offset;
        if !value.is_finite() {
            field.codec.bits.set(frame.data_mut(), field.absent_raw?);
            continue;
        }
        let clamped = value.clamp(field.limits.0, field.limits.1);
        let encoded = field.codec.encode(frame.data_mut(), clamped);
        counts.clamped += u64::from(clamped != value || encoded == Encoded::Clamped);
    }
    Some(frame)
}
