//! Faults that a service does to itself when a campaign asks for them: the orders of the region `faults`.
//!
//! Only a run that was started for a campaign has hooks; without them none of this is looked at. An order is
//! obeyed by the process that is there when it comes, once: a restarted service does not take up old orders, or
//! a torn write would kill it for ever. Stalls and late starts need the clock and belong to the paced driver.

use regions::{Fault, Kind, Layout, Payload, RegionId, fault_kind};
use table::{Read, RegionReader, Table};

/// Orders that a service keeps in mind at once.
const ACTIVE_MAX: usize = 8;

/// The orders for one service.
#[derive(Debug)]
pub struct Hooks {
    reader: RegionReader,
    target: u64,
    seen: u64,
    order: Fault,
    active: [Option<Fault>; ACTIVE_MAX],
    own_process: bool,
}

impl Hooks {
    /// For service `target` (see [`Fault::target`]). Orders given before now are not for this process.
    pub fn new(table: &Table, target: u64) -> Self {
        let reader = table.reader(RegionId::Faults as usize).clone();
        let seen = reader.head();
        Hooks { reader, target, seen, order: Fault::absent(), active: [None; ACTIVE_MAX], own_process: true }
    }

    /// For a service that shares its process with others: a torn write leaves the slot torn, but kills nobody.
    pub fn in_process(table: &Table, target: u64) -> Self {
        Hooks { own_process: false, ..Self::new(table, target) }
    }

    /// Ends this process as a kill from outside does: no destructor runs.
    pub(crate) fn die(&self) {
        if self.own_process {
            let _ = rustix::process::kill_process(rustix::process::getpid(), rustix::process::Signal::KILL);
        }
    }

    /// Takes in what is new and forgets what is over at tick `n`. The next new order for this service, if any.
    pub fn look(&mut self, n: u64) -> Option<Fault> {
        for slot in &mut self.active {
            if slot.is_some_and(|order| n >= order.end_tick) {
                *slot = None;
            }
        }
        while self.seen < self.reader.head() {
            let read = self.reader.read(self.seen, self.order.words_mut());
            self.seen += 1;
            if read == Read::Ready && self.order.target == self.target && self.order.end_tick > n {
                if let Some(free) = self.active.iter_mut().find(|slot| slot.is_none()) {
                    *free = Some(self.order);
                }
                return Some(self.order);
            }
        }
        None
    }

    fn now(&self, kind: u64, n: u64) -> Option<&Fault> {
        self.active.iter().flatten().find(|o| o.kind == kind && o.from_tick <= n && n < o.end_tick)
    }

    /// Seconds to compute before the step of tick `n`; asked for once.
    pub fn stall_s(&mut self, n: u64) -> Option<f64> {
        let stall = |o: &Fault| o.kind == fault_kind::STALL && o.from_tick <= n;
        let slot = self.active.iter_mut().find(|slot| slot.as_ref().is_some_and(stall))?;
        slot.take().map(|order| order.value[0])
    }

    /// Fraction of the period before which tick `n` is not to be stepped.
    pub fn late(&self, n: u64) -> Option<f64> {
        self.now(fault_kind::LATE, n).map(|order| order.value[0])
    }

    /// Whether to die in writing tick `n`.
    pub fn torn(&self, n: u64) -> bool {
        self.now(fault_kind::TORN_WRITE, n).is_some()
    }

    /// Step of the wall clock that is due at tick `n`; asked for once. \[s\]
    pub fn clock_step_s(&mut self, n: u64) -> Option<f64> {
        let step = |o: &Fault| o.kind == fault_kind::CLOCK_STEP && o.from_tick <= n;
        let slot = self.active.iter_mut().find(|slot| slot.as_ref().is_some_and(step))?;
        slot.take().map(|order| order.value[0])
    }

    /// Spoils what is about to be published for tick `n`, all but its tick and the ticks of the inputs used: those are for
    /// stepping it again from the log.
    pub fn corrupt(&self, n: u64, layout: &Layout, words: &mut [u64]) {
        let Some(order) = self.now(fault_kind::CORRUPT, n) else { return };
        let mut state = (order.value[1].to_bits()).wrapping_add(n.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let mut next = || {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ (z >> 31)
        };
        let mut word = 0;
        for field in layout.fields {
            for _ in 0..field.len {
                if word > 0 && !field.name.starts_with("used_") {
                    match order.value[0] as u64 {
                        0 if field.kind == Kind::F64 => words[word] = f64::NAN.to_bits(),
                        1 if field.kind == Kind::F64 => words[word] = 1e30_f64.to_bits(),
                        2 => words[word] = next(),
                        _ => {}
                    }
                }
                word += 1;
            }
        }
    }
}
