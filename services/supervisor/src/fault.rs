//! Faults in lockstep, in this process: a service that is killed or stopped is not stepped, one that is late is
//! stepped after the rig has applied; a killed one comes back as a new model from the last checkpoint. All by
//! tick, so that the same plan gives the same bits.

use assembly::{AssemblyError, ServiceKind, build, build_can};
use config::ResolvedBench;
use regions::{Fault, Payload, RegionId, fault_kind};
use runtime::{Bound, Hooks, Model, TickError};
use table::{RegionWriter, Table};

/// What is done to a service at a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedFault {
    /// First tick of it.
    pub tick: u64,
    /// To which service.
    pub target: ServiceKind,
    /// What.
    pub action: Action,
}

/// What is done to a service.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    /// Killed before the tick; a new one is there after so many ticks.
    Kill {
        /// Ticks without the service.
        away_ticks: u64,
    },
    /// Stopped before the tick, continued after so many ticks.
    Stop {
        /// Ticks without the service.
        away_ticks: u64,
    },
    /// Killed in the middle of writing the tick's slot; a new one is there after so many ticks.
    TornWrite {
        /// Ticks without the service, that of the torn write included.
        away_ticks: u64,
    },
    /// Its step comes after the rig has applied.
    Late {
        /// Ticks in a row.
        ticks: u64,
    },
    /// An order of the region `faults`, obeyed by the service itself; `value` by its kind.
    Order {
        /// See [`fault_kind`].
        kind: u64,
        /// Ticks in a row.
        ticks: u64,
        /// See [`Fault::value`].
        value: [f64; 4],
    },
    /// An order to the CAN node, whatever the target.
    Can {
        /// Ticks in a row.
        ticks: u64,
        /// See [`Fault::value`].
        value: [f64; 4],
    },
}

/// The CAN node's number in [`Fault::target`].
const CAN_TARGET: u64 = 4;

struct Slot {
    kind: ServiceKind,
    bound: Option<Bound<dyn Model>>,
    /// First tick that is not stepped yet.
    next: u64,
    back_at: u64,
    reborn: bool,
    torn_at: Option<u64>,
    late_until: u64,
}

/// The chain of the bench with faults.
pub(crate) struct FaultChain<'a> {
    resolved: &'a ResolvedBench,
    table: &'a Table,
    plan: &'a [PlannedFault],
    orders: RegionWriter,
    slots: [Slot; 3],
    can: Option<Bound<dyn Model>>,
    catch_up_max: u64,
}

fn bind(kind: ServiceKind, resolved: &ResolvedBench, table: &Table) -> Result<Bound<dyn Model>, FaultError> {
    let model = build(kind, resolved).map_err(FaultError::Assembly)?;
    // Inputs that are not there are what the plan is about: they count as stale, as in real time.
    let mut bound = Bound::new(model, table, false).map_err(FaultError::Tick)?;
    bound.set_hooks(Hooks::in_process(table, kind as u64));
    Ok(bound)
}

/// Why the chain broke off.
#[derive(Debug)]
pub(crate) enum FaultError {
    Assembly(AssemblyError),
    Tick(TickError),
}

impl<'a> FaultChain<'a> {
    pub fn new(
        resolved: &'a ResolvedBench,
        table: &'a Table,
        plan: &'a [PlannedFault],
    ) -> Result<Self, FaultError> {
        let slot = |kind| -> Result<Slot, FaultError> {
            let bound = Some(bind(kind, resolved, table)?);
            Ok(Slot { kind, bound, next: 0, back_at: 0, reborn: false, torn_at: None, late_until: 0 })
        };
        let can = build_can(resolved, None, false).map_err(FaultError::Assembly)?;
        let can = can
            .map(|model| {
                let mut bound = Bound::new(model, table, false)?;
                bound.set_hooks(Hooks::in_process(table, CAN_TARGET));
                Ok(bound)
            })
            .transpose()
            .map_err(FaultError::Tick)?;
        let [rig, vehicle, multibody] = ServiceKind::ALL;
        let orders = table.claim_writer(RegionId::Faults as usize);
        Ok(FaultChain {
            resolved,
            table,
            plan,
            orders: orders.map_err(|e| FaultError::Tick(TickError::Table(e)))?,
            slots: [slot(rig)?, slot(vehicle)?, slot(multibody)?],
            can,
            catch_up_max: u64::from(resolved.scenario.limits.catch_up_max_ticks),
        })
    }

    fn begin(&mut self, n: u64) {
        for fault in self.plan.iter().filter(|fault| fault.tick == n) {
            let slot = &mut self.slots[fault.target as usize];
            let mut target = fault.target as u64;
            let (kind, ticks, value) = match fault.action {
                Action::Kill { away_ticks } => {
                    (slot.back_at, slot.reborn) = (n + away_ticks, true);
                    slot.bound = None;
                    continue;
                }
                Action::Stop { away_ticks } => {
                    slot.back_at = n + away_ticks;
                    continue;
                }
                Action::Late { ticks } => {
                    slot.late_until = n + ticks;
                    continue;
                }
                Action::TornWrite { away_ticks } => {
                    // Away from the next tick on: this one it still begins to write.
                    (slot.back_at, slot.reborn, slot.torn_at) = (n + away_ticks, true, Some(n));
                    (fault_kind::TORN_WRITE, 1, [0.0; 4])
                }
                Action::Order { kind, ticks, value } => (kind, ticks, value),
                Action::Can { ticks, value } => {
                    target = CAN_TARGET;
                    (fault_kind::CAN, ticks, value)
                }
            };
            let number = self.orders.head();
            let order = Fault { tick: number, target, kind, from_tick: n, end_tick: n + ticks, value };
            // Sole writer, next number: cannot be refused.
            let _ = self.orders.write(number, order.words());
        }
    }

    /// Brings a service that was away up to tick `n`, if it is back by then. Whether it is there.
    fn there(&mut self, index: usize, n: u64) -> Result<bool, FaultError> {
        let slot = &mut self.slots[index];
        if n < slot.back_at {
            // In the tick of a torn write it is there still.
            return Ok(slot.torn_at == Some(n));
        }
        if slot.reborn {
            slot.reborn = false;
            slot.bound = None;
            let mut bound = bind(slot.kind, self.resolved, self.table)?;
            let restored = bound.restore(self.table);
            slot.next = restored.map_or(slot.next, |tick| tick + 1);
            slot.bound = Some(bound);
        }
        let Some(bound) = &mut slot.bound else { return Ok(false) };
        if slot.kind == ServiceKind::Rig {
            // The rig never publishes the past.
            slot.next = n;
            return Ok(true);
        }
        slot.next = slot.next.max(n.saturating_sub(self.catch_up_max));
        while slot.next < n {
            bound.look_at_orders(slot.next);
            bound.tick(0, slot.next, true).map_err(FaultError::Tick)?;
            slot.next += 1;
        }
        Ok(true)
    }

    fn step(&mut self, index: usize, node: usize, n: u64) -> Result<(), FaultError> {
        if !self.there(index, n)? {
            return Ok(());
        }
        let slot = &mut self.slots[index];
        let Some(bound) = &mut slot.bound else { return Ok(()) };
        bound.look_at_orders(n);
        bound.tick(node, n, false).map_err(FaultError::Tick)?;
        if node + 1 == bound.node_count() {
            slot.next = n + 1;
        }
        Ok(())
    }

    /// One tick of the bench: its region `bench` is written.
    pub fn tick(&mut self, n: u64) -> Result<(), FaultError> {
        self.begin(n);
        let late = |chain: &Self, index: usize| n < chain.slots[index].late_until;
        self.step(0, 0, n)?;
        for index in [1, 2] {
            if !late(self, index) {
                self.step(index, 0, n)?;
            }
        }
        self.step(0, 1, n)?;
        for index in [1, 2] {
            if late(self, index) {
                self.step(index, 0, n)?;
            }
        }
        // Beside the loop, behind everybody.
        if let Some(can) = &mut self.can {
            can.look_at_orders(n);
            can.tick(0, n, false).map_err(FaultError::Tick)?;
        }
        Ok(())
    }
}
