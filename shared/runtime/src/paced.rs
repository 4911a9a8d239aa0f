//! Paced: by the wall clock. Tick n starts at t0 + n·T for everybody; a restart never moves the grid.
//!
//! The rig is the time base ([`lead`]): it samples at the start of the tick and applies its commands at the
//! output phase, there or not. The others follow the data ([`follow`]): they wait for the inputs of the
//! tick until their latest start, then step on the last ones. Who comes late, for whatever reason (overrun,
//! stop, restart), steps every missed tick from the recorded inputs, up to a limit, and goes on: model time
//! is always n·T. Late wake-ups, overruns and late commands are counted apart.

use crate::clock::{self, Grid, Nanos};
use crate::{Bound, Model, TickError};
use regions::{Payload, RegionId, Timing};
use table::{RegionWriter, Table, Wait};

/// When a follower does what, in a tick.
#[derive(Debug, Clone, Copy)]
pub struct FollowPlan {
    /// Step on the last inputs when those of the tick are not there by then. [fraction of T]
    pub latest_start: f64,
    /// Share of the period by which the step must be done, else it is an overrun. [fraction of T]
    pub done_by: f64,
    /// Start looking this long before the data are due. [ns]
    pub spin_lead_ns: Nanos,
    /// Keep looking this long after. [ns]
    pub spin_tail_ns: Nanos,
    /// When the data usually come. [fraction of T]
    pub due: f64,
    /// When what this service writes is used: its margin before that is recorded. [fraction of T]
    pub used_at: f64,
    /// Most ticks stepped to catch up.
    pub catch_up_max: u64,
}

/// When the rig does what, in a tick.
#[derive(Debug, Clone, Copy)]
pub struct LeadPlan {
    /// Output phase φ. [fraction of T]
    pub output_phase: f64,
    /// Spin this long before each time aimed at. [ns]
    pub spin_ns: Nanos,
}

/// Keeps the timing region of a service.
struct Clockwork {
    writer: RegionWriter,
    grid: Grid,
    timing: Timing,
}

impl Clockwork {
    fn new(table: &Table, region: RegionId, grid: Grid) -> Result<Self, TickError> {
        let writer = table.claim_writer(region as usize).map_err(TickError::Table)?;
        let mut timing = Timing::absent();
        // The counters go on after a restart.
        let reader = writer.reader();
        let mut last = Timing::absent();
        if reader.latest(reader.head(), last.words_mut()).is_some() {
            timing.late_wake_count = last.late_wake_count;
            timing.overrun_count = last.overrun_count;
            timing.missed_count = last.missed_count;
            timing.caught_up_count = last.caught_up_count;
        }
        timing.epoch = writer.epoch();
        Ok(Clockwork { writer, grid, timing })
    }

    fn woke(&mut self, aimed: Nanos, woke: Nanos) {
        let lateness = (woke as i128 - aimed as i128).max(0) as f64 * 1e-9;
        self.timing.wake_lateness_s = lateness;
        if lateness > 0.1 * self.grid.period as f64 * 1e-9 {
            self.timing.late_wake_count += 1;
        }
    }

    fn stepped(&mut self, n: u64, start: Nanos, end: Nanos, done_by: f64) {
        self.timing.tick = n;
        self.timing.start_s = self.grid.since(n, start);
        self.timing.compute_s = (end - start) as f64 * 1e-9;
        self.timing.done_s = self.grid.since(n, end);
        if self.timing.compute_s > done_by * self.grid.period as f64 * 1e-9 {
            self.timing.overrun_count += 1;
        }
    }

    fn publish(&mut self) {
        // Refused only for a tick a dead predecessor published.
        let _ = self.writer.write(self.timing.tick, self.timing.words());
    }
}

/// Does to this service what a campaign asks for before tick `n`: computing for nothing, a step of the wall clock.
fn disturb(bound: &mut Bound<dyn Model>, grid: Grid, n: u64) {
    let Some(hooks) = bound.look_at_orders(n) else { return };
    if let Some(step_s) = hooks.clock_step_s(n) {
        clock::step_wall(step_s);
    }
    if let Some(stall_s) = hooks.stall_s(n) {
        let until = clock::now().max(grid.at(n, 0.0)) + (stall_s * clock::SECOND as f64) as Nanos;
        while clock::now() < until {
            std::hint::spin_loop();
        }
    }
}

/// Starts the step of tick `n` late if a campaign asks for it.
fn delay(bound: &mut Bound<dyn Model>, grid: Grid, n: u64) {
    if let Some(phase) = bound.look_at_orders(n).and_then(|hooks| hooks.late(n)) {
        clock::sleep_until(grid.at(n, phase), 0);
    }
}

/// Runs a follower until `end(n)`: the vehicle and the multibody service.
///
/// # Errors
/// [`TickError::Table`] when the timing region is held by another writer.
pub fn follow(
    bound: &mut Bound<dyn Model>,
    table: &Table,
    timing: RegionId,
    grid: Grid,
    first: u64,
    plan: FollowPlan,
    mut end: impl FnMut(u64) -> bool,
) -> Result<u64, TickError> {
    let mut clockwork = Clockwork::new(table, timing, grid)?;
    let trigger = bound.spec(0).reads.iter().rfind(|r| r.when == crate::When::SameTick);
    let trigger = trigger.map(|read| read.region);
    let Some(trigger) = trigger.and_then(|region| bound.reader(0, region).cloned()) else {
        return Ok(first);
    };
    let mut n = first;
    while !end(n) {
        let current = grid.tick_at(clock::now());
        if n < current {
            // Behind: what is recorded is stepped at once; what is out of reach is left out.
            let reachable = current.saturating_sub(plan.catch_up_max);
            if n < reachable {
                clockwork.timing.missed_count += reachable - n;
                n = reachable;
            }
            while n < current && !end(n) {
                bound.look_at_orders(n);
                let start = clock::now();
                bound.tick(0, n, true)?;
                clockwork.timing.caught_up_count += 1;
                clockwork.timing.wake_lateness_s = f64::NAN;
                clockwork.stepped(n, start, clock::now(), f64::INFINITY);
                clockwork.publish();
                n += 1;
            }
            bound.ring(0);
            continue;
        }
        disturb(bound, grid, n);
        let latest = grid.at(n, plan.latest_start);
        let wait = Wait::due(grid.at(n, plan.due), plan.spin_lead_ns, plan.spin_tail_ns, latest);
        let arrived = trigger.wait_for(n, &wait);
        delay(bound, grid, n);
        let start = clock::now();
        if !arrived {
            clockwork.timing.missed_count += 1;
        }
        clockwork.woke(if arrived { grid.at(n, plan.due) } else { latest }, start);
        bound.tick(0, n, false)?;
        bound.ring(0);
        let done = clock::now();
        clockwork.stepped(n, start, done, plan.done_by);
        clockwork.timing.margin_s = plan.used_at * grid.period as f64 * 1e-9 - clockwork.timing.done_s;
        clockwork.publish();
        n += 1;
    }
    Ok(n)
}

/// Runs the rig until `end(n)`: node 0 at the start of each tick, node 1 at the output phase.
///
/// After a stall it goes on with the tick that is running: it never publishes the past.
///
/// # Errors
/// [`TickError::Table`] when the timing region is held by another writer.
pub fn lead(
    bound: &mut Bound<dyn Model>,
    table: &Table,
    timing: RegionId,
    grid: Grid,
    first: u64,
    plan: LeadPlan,
    mut end: impl FnMut(u64) -> bool,
) -> Result<u64, TickError> {
    let mut clockwork = Clockwork::new(table, timing, grid)?;
    let mut n = first;
    while !end(n) {
        let current = grid.tick_at(clock::now());
        if n < current {
            clockwork.timing.missed_count += current - n;
            n = current;
        }
        disturb(bound, grid, n);
        let aimed = grid.at(n, 0.0);
        let on_time = clock::now() <= aimed;
        clock::sleep_until(aimed, plan.spin_ns);
        delay(bound, grid, n);
        let start = clock::now();
        clockwork.woke(aimed, start);
        bound.tick(0, n, !on_time)?;
        bound.ring(0);
        let sampled = clock::now();

        let phase = grid.at(n, plan.output_phase);
        clock::sleep_until(phase, plan.spin_ns);
        let output = clock::now();
        bound.tick(1, n, false)?;
        bound.ring(1);
        let done = clock::now();
        clockwork.timing.output_lateness_s = (output.saturating_sub(phase)) as f64 * 1e-9;
        clockwork.timing.output_compute_s = (done - output) as f64 * 1e-9;
        clockwork.stepped(n, start, sampled, plan.output_phase);
        clockwork.timing.done_s = grid.since(n, done);
        clockwork.publish();
        n += 1;
    }
    Ok(n)
}
