//! Faults put on the bus on purpose: which message, what, when.

use crate::bus::Queue;
use crate::mapping::Plan;
use config::Broken;
use config::can::{CanFault, FaultKind};

/// Frames of one message that can be on their way late at once; more are lost, as in a full queue.
pub const LATE_MAX: usize = 128;

/// A fault of one message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Spell {
    /// Kind.
    pub kind: FaultKind,
    /// First instant. [ns]
    pub start_ns: u64,
    /// First instant after it. [ns]
    pub end_ns: u64,
    /// Delay. [ns]
    pub delay_ns: u64,
}

/// The faults of each message of a plan.
#[derive(Debug, Clone, Default)]
pub struct Faults {
    /// By index of the message sent.
    pub send: Vec<Vec<Spell>>,
    /// By index of the message received.
    pub receive: Vec<Vec<Spell>>,
}

/// Puts a fault on a message, beside those it has; what is over by now is forgotten. A delay needs the queue of `late` frames.
/// Allocates: not for the tick's path.
pub(crate) fn order(spells: &mut Vec<Spell>, late: &mut Option<Queue>, now_ns: u64, spell: Spell) {
    spells.retain(|spell| spell.end_ns > now_ns);
    spells.push(spell);
    if spell.delay_ns > 0 {
        late.get_or_insert_with(|| Queue::new(LATE_MAX));
    }
}

/// What is wrong with a message at an instant.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Now {
    /// It is lost.
    pub drop: bool,
    /// It comes this much later. [ns]
    pub delay_ns: u64,
    /// Its counter stands still.
    pub stale: bool,
    /// Its checksum is wrong.
    pub spoiled: bool,
}

impl Now {
    /// Whether anything is wrong.
    pub fn any(self) -> bool {
        self != Now::default()
    }
}

/// What is wrong at `now`, of a message's spells.
#[inline]
pub fn at(spells: &[Spell], now_ns: u64) -> Now {
    let mut now = Now::default();
    for spell in spells.iter().filter(|spell| (spell.start_ns..spell.end_ns).contains(&now_ns)) {
        match spell.kind {
            FaultKind::Drop => now.drop = true,
            FaultKind::Delay => now.delay_ns = now.delay_ns.max(spell.delay_ns),
            FaultKind::StaleCounter => now.stale = true,
            FaultKind::WrongCrc => now.spoiled = true,
        }
    }
    now
}

impl Faults {
    /// None at all.
    pub fn none(plan: &Plan) -> Self {
        Faults { send: vec![Vec::new(); plan.send.len()], receive: vec![Vec::new(); plan.receive.len()] }
    }

    /// A scenario's wishes for a plan.
    ///
    /// # Errors
    /// Each that names no message of the plan, or a counter or checksum that the message does not have.
    pub fn compile(plan: &Plan, wanted: &[CanFault]) -> Result<Self, Vec<Broken>> {
        let mut faults = Faults::none(plan);
        let mut broken = Vec::new();
        for (i, fault) in wanted.iter().enumerate() {
            let of = |name: &String| *name == fault.message;
            let sent: Vec<usize> = (0..plan.send.len()).filter(|&k| of(&plan.send[k].name)).collect();
            let received: Vec<usize> =
                (0..plan.receive.len()).filter(|&k| of(&plan.receive[k].name)).collect();
            let protection = match (sent.first(), received.first()) {
                (Some(&k), _) => &plan.send[k].protection,
                (None, Some(&k)) => &plan.receive[k].protection,
                (None, None) => {
                    let rule = format!("message {}: is neither sent nor received", fault.message);
                    broken.push(Broken { key: format!("can.faults[{i}].message"), rule });
                    continue;
                }
            };
            let counter = protection.as_ref().is_some_and(|p| p.counter.is_some());
            let checksum = protection.as_ref().is_some_and(|p| p.has_checksum());
            let lacks = match fault.fault {
                FaultKind::StaleCounter if !counter => Some("counter"),
                FaultKind::WrongCrc if !checksum => Some("checksum"),
                _ => None,
            };
            if let Some(lacks) = lacks {
                let rule = format!("message {}: has no {lacks} in the mapping", fault.message);
                broken.push(Broken { key: format!("can.faults[{i}].fault"), rule });
            }
            let ns = |seconds: f64| (seconds * 1e9) as u64;
            let spell = Spell {
                kind: fault.fault,
                start_ns: ns(fault.start_s),
                end_ns: fault.end_s.map_or(u64::MAX, ns),
                delay_ns: fault.delay_ms.map_or(0, |ms| (ms * 1e6) as u64),
            };
            sent.iter().for_each(|&k| faults.send[k].push(spell));
            received.iter().for_each(|&k| faults.receive[k].push(spell));
        }
        if broken.is_empty() { Ok(faults) } else { Err(broken) }
    }
}
