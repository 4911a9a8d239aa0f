//! Receiving: each frame judged (length, protection, plausibility), each message timed, absent values said.

use crate::bus::Queue;
use crate::e2e::{CheckState, Verdict};
use crate::fault::{self, Faults, LATE_MAX};
use crate::frame::Frame;
use crate::mapping::ReceivePlan;

/// Bits of a message's status.
pub mod status {
    /// No good frame was ever received.
    pub const NEVER: u64 = 1 << 0;
    /// The last good frame is older than the time-out.
    pub const TIMEOUT: u64 = 1 << 1;
    /// The last frame's checksum, counter value or Data ID was wrong.
    pub const CHECKSUM: u64 = 1 << 2;
    /// The last frame repeated the counter.
    pub const REPEATED: u64 = 1 << 3;
    /// The last frame was out of sequence.
    pub const SEQUENCE: u64 = 1 << 4;
    /// Frames before the last one were lost, within what is allowed.
    pub const SOME_LOST: u64 = 1 << 5;
    /// A value of the last good frame was implausible.
    pub const IMPLAUSIBLE: u64 = 1 << 6;
    /// The last frame was too short.
    pub const LENGTH: u64 = 1 << 7;
    /// What makes a message's values absent.
    pub const ABSENT: u64 = NEVER | TIMEOUT;
}

/// What is known of one message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// Bits, see [`status`].
    pub status: u64,
    /// Good frames.
    pub good: u64,
    /// Frames with wrong checksum, counter value, Data ID or length.
    pub wrong: u64,
    /// Frames repeated or out of sequence.
    pub sequence: u64,
    /// Frames known to be lost from the counter's steps.
    pub lost: u64,
    /// Implausible values.
    pub implausible: u64,
    /// Times the message timed out.
    pub timeouts: u64,
    /// Instant of the last good frame. [ns]
    pub last_ns: Option<u64>,
}

#[derive(Debug, Clone)]
struct State {
    known: Known,
    check: CheckState,
    /// Last plausible value and its instant, by field.
    last: Vec<Option<(f64, u64)>>,
    late: Option<Queue>,
    stale: Option<u64>,
}

/// Receives the messages of a plan.
#[derive(Debug, Clone)]
pub struct Receiver {
    plan: Vec<ReceivePlan>,
    faults: Vec<Vec<fault::Spell>>,
    states: Vec<State>,
    unknown: u64,
    injected: u64,
    started_ns: Option<u64>,
}

impl Receiver {
    /// At time 0: everything absent.
    pub fn new(plan: Vec<ReceivePlan>, faults: &Faults) -> Self {
        let delays = |spells: &[fault::Spell]| spells.iter().any(|spell| spell.delay_ns > 0);
        let states = plan
            .iter()
            .zip(&faults.receive)
            .map(|(message, spells)| State {
                known: Known {
                    status: status::NEVER,
                    good: 0,
                    wrong: 0,
                    sequence: 0,
                    lost: 0,
                    implausible: 0,
                    timeouts: 0,
                    last_ns: None,
                },
                check: CheckState::default(),
                last: vec![None; message.fields.len()],
                late: delays(spells).then(|| Queue::new(LATE_MAX)),
                stale: None,
            })
            .collect();
        Receiver { plan, faults: faults.receive.clone(), states, unknown: 0, injected: 0, started_ns: None }
    }

    /// Puts a fault on message `index` from now on, as a fault campaign orders it. What is over is forgotten. Allocates:
    /// not for the tick's path.
    pub fn inject(&mut self, index: usize, now_ns: u64, spell: fault::Spell) {
        if let (Some(spells), Some(state)) = (self.faults.get_mut(index), self.states.get_mut(index)) {
            fault::order(spells, &mut state.late, now_ns, spell);
        }
    }

    /// The messages received.
    pub fn plan(&self) -> &[ReceivePlan] {
        &self.plan
    }

    /// What is known of message `index`.
    pub fn known(&self, index: usize) -> &Known {
        &self.states[index].known
    }

    /// Frames of messages that are not in the plan.
    pub fn unknown(&self) -> u64 {
        self.unknown
    }

    /// Frames touched by an injected fault.
    pub fn injected(&self) -> u64 {
        self.injected
    }

    /// Takes a frame that came at `now`. Good values go to `variables` by the plan's indices.
    pub fn take(&mut self, now_ns: u64, frame: &Frame, variables: &mut [f64]) {
        let Some(index) = self.plan.iter().position(|message| message.id == frame.id) else {
            self.unknown += 1;
            return;
        };
        let wrong = fault::at(&self.faults[index], now_ns);
        let (message, state) = (&self.plan[index], &mut self.states[index]);
        if !wrong.any() {
            state.stale = None;
            judge(message, state, now_ns, frame, variables);
            return;
        }
        self.injected += 1;
        let mut frame = *frame;
        if let Some(protection) = &message.protection
            && frame.data().len() >= message.len
        {
            if wrong.stale
                && let Some(bits) = &protection.counter
            {
                let counter = *state.stale.get_or_insert(bits.get(frame.data()));
                protection.protect(message.id, &mut frame.data_mut()[..message.len], counter);
            }
            if wrong.spoiled {
                protection.spoil(frame.data_mut());
            }
        }
        match &mut state.late {
            _ if wrong.drop => {}
            Some(late) if wrong.delay_ns > 0 => {
                late.push(now_ns + wrong.delay_ns, frame);
            }
            _ => judge(message, state, now_ns, &frame, variables),
        }
    }

    /// Looks at the clock: frames on their way late, time-outs. Absent variables become NaN.
    pub fn step(&mut self, now_ns: u64, variables: &mut [f64]) {
        let started = *self.started_ns.get_or_insert(now_ns);
        for (message, state) in self.plan.iter().zip(&mut self.states) {
            while let Some(frame) = state.late.as_mut().and_then(|late| late.pop(now_ns)) {
                judge(message, state, now_ns, &frame, variables);
            }
            let known = &mut state.known;
            let silent = now_ns.saturating_sub(known.last_ns.unwrap_or(started)) > message.timeout_ns;
            if silent && known.status & status::TIMEOUT == 0 {
                known.status |= status::TIMEOUT;
                known.timeouts += 1;
                // The counter is not forgotten: one that stands still would be taken for a fresh start.
                state.last.fill(None);
            }
            if known.status & status::ABSENT != 0 {
                message.fields.iter().for_each(|field| variables[field.target] = f64::NAN);
            }
        }
    }
}

fn judge(message: &ReceivePlan, state: &mut State, now_ns: u64, frame: &Frame, variables: &mut [f64]) {
    let known = &mut state.known;
    known.status &= status::ABSENT;
    if frame.data().len() < message.len {
        known.status |= status::LENGTH;
        known.wrong += 1;
        return;
    }
    let data = &frame.data()[..message.len];
    if let Some(protection) = &message.protection {
        let before = state.check;
        let verdict = protection.check(message.id, data, &mut state.check);
        match verdict {
            Verdict::Initial | Verdict::Ok => {}
            Verdict::SomeLost => {
                known.status |= status::SOME_LOST;
                known.lost += protection.lost(before, state.check);
            }
            Verdict::Repeated => known.status |= status::REPEATED,
            Verdict::WrongSequence => known.status |= status::SEQUENCE,
            Verdict::Wrong => known.status |= status::CHECKSUM,
        }
        if !verdict.good() {
            let count = if verdict == Verdict::Wrong { &mut known.wrong } else { &mut known.sequence };
            *count += 1;
            return;
        }
    }
    known.status &= !status::ABSENT;
    known.good += 1;
    known.last_ns = Some(now_ns);
    for (field, last) in message.fields.iter().zip(&mut state.last) {
        if !message.message.is_there(field.signal, data) {
            continue;
        }
        let value = field.codec.decode(data) * field.factor + field.offset;
        let jumped = last.is_some_and(|(before, at)| {
            let dt_s = now_ns.saturating_sub(at) as f64 * 1e-9;
            (value - before).abs() > field.rate_max * dt_s.max(1e-9)
        });
        // A value that never settles again must not be held against its successors for ever: each is compared
        // with the one before it.
        *last = value.is_finite().then_some((value, now_ns));
        if !(field.min..=field.max).contains(&value) || jumped {
            known.implausible += 1;
            known.status |= status::IMPLAUSIBLE;
            variables[field.target] = f64::NAN;
        } else {
            variables[field.target] = value;
        }
    }
}
