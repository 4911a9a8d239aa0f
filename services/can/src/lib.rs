//! The CAN service: keeps the rest-bus going and takes what the ECU says, beside the loop.
//!
//! Nobody waits for it. It looks at the table once a tick, behind the output phase, sends what is due and
//! publishes region `can`; when it comes late it leaves ticks out and goes on with the one that is running, and
//! the rest-bus counts the cycles that cost. In lockstep, and where the host has no such interface, the bus is in
//! memory and the virtual ECU is on it.

use assembly::build_can;
use assembly::manifest::{Drive, Manifest};
use assembly::service::{EndWatch, ServiceError, open_table, wait_for_start};
use can::bus::Bus;
use can::socket::SocketBus;
use runtime::clock::{self, Grid, Nanos, SECOND};
use runtime::lockstep::{self, Patience};
use runtime::realtime::{self, Wish};
use runtime::{Bound, Hooks, Model};
use table::Bench;

/// This service's number in region `faults`.
pub const TARGET: u64 = 4;

/// When in the tick the service looks at the table: behind the rig's output phase. [fraction of T]
const LOOK_AT: f64 = 0.9;

/// Runs the service of a bench to the end of the run. Notes of what the host refused go to `note`.
///
/// # Errors
/// [`ServiceError`].
pub fn run(bench: &Bench, mut note: impl FnMut(&str)) -> Result<(), ServiceError> {
    let manifest = Manifest::read(&bench.directory()).map_err(ServiceError::Manifest)?;
    let scenario = &manifest.resolved.scenario;
    let table = open_table(bench, &manifest).map_err(ServiceError::Table)?;
    let wanted = scenario.can.as_ref().and_then(|can| can.interface.as_deref());
    let mut bus: Option<Box<dyn Bus>> = None;
    let mut fallback = false;
    if let (Some(name), Drive::Paced) = (wanted, manifest.drive) {
        match SocketBus::open(name) {
            Ok(socket) => bus = Some(Box::new(socket)),
            Err(error) => {
                fallback = true;
                note(&format!("{error}\nthe run goes on with a bus in memory and the virtual ECU on it"));
            }
        }
    }
    let model = build_can(&manifest.resolved, bus, fallback).map_err(ServiceError::Assembly)?;
    let Some(model) = model else { return Ok(()) };
    let lock = manifest.drive == Drive::Lockstep;
    let mut bound: Bound<dyn Model> = Bound::new(model, &table, lock).map_err(ServiceError::Tick)?;
    // Beside the loop: ordinary scheduling, whatever core is free.
    for line in realtime::apply(&Wish { core: None, priority: None, lock_memory: false }) {
        note(&line);
    }
    let t0 = wait_for_start(&table).map_err(ServiceError::Tick)?;
    let period = scenario.timing.period_ns();
    let mut watch = EndWatch::new(&table, scenario.timing.period_s());
    if lock {
        let limit_ns = (scenario.limits.lockstep_wait_max_s * SECOND as f64) as Nanos;
        let patience = Patience { spin_ns: 0, limit_ns };
        let done = lockstep::follow(&mut bound, 0, patience, |n| watch.ended(n, manifest.drive));
        return done.map(drop).map_err(ServiceError::Tick);
    }
    if manifest.faults {
        bound.set_hooks(Hooks::new(&table, TARGET));
    }
    let grid = Grid { t0, period };
    let mut n = grid.tick_at(clock::now());
    while !watch.ended(n, manifest.drive) {
        clock::sleep_until(grid.at(n, LOOK_AT), 0);
        bound.look_at_orders(n);
        bound.tick(0, n, false).map_err(ServiceError::Tick)?;
        n = (n + 1).max(grid.tick_at(clock::now()));
    }
    Ok(())
}
