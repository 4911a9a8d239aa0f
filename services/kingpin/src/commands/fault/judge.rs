//! The expected reactions, checked in the log of a run.
//!
//! Rules that hold at every output phase the rig executed, whatever the host did: it never follows commands at
//! or beyond its staleness limit; holding and tripped ramp the force as the rig file says with the steer torque off and
//! heights frozen; it resumes only after enough fresh commands; a rig that comes up does so at zero force, and
//! starts only when asked; nothing that it applies is not finite. And what each fault should have caused, which
//! a host that stalled can have prevented: then the fault says nothing, and is made again.

use super::judge_can::Bus;
use super::round::{DENSE, Made, Round};
use super::schedule::fault_ticks;
use config::ResolvedBench;
use config::campaign::{CampaignDrive, Content, FaultKind, Place, SensorEffect, Target};
use record::LogReader;
use regions::{RigStatus, model_flags, rig_flags};
use serde::Serialize;
use std::collections::BTreeSet;

const OFF: u64 = 0;
const IDLE: u64 = 1;
const STARTING: u64 = 3;
pub const RUNNING: u64 = 4;
const HOLDING: u64 = 5;
const RESUMING: u64 = 6;
const TRIPPED: u64 = 8;

/// How a fault ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// As expected.
    Passed,
    /// Not as expected.
    Failed,
    /// The host stalled the rig or a service that was not meant: it says nothing.
    HostStalled,
    /// Not made.
    Skipped,
}

/// The judgement on one fault.
#[derive(Debug, Clone, Serialize)]
pub struct Judgement {
    /// Number in the campaign.
    pub number: usize,
    /// Kind of fault.
    pub kind: &'static str,
    /// Service.
    pub target: &'static str,
    /// Tick.
    pub tick: u64,
    /// How it ended.
    pub outcome: Outcome,
    /// What was not as expected.
    pub faults: Vec<String>,
    /// What is worth knowing.
    pub notes: Vec<String>,
    /// Output phases without a fresh command at which the rig began to hold.
    pub held_at_stale_count: Option<u64>,
    /// From the fault to the first output phase with a fresh command again. [ms]
    pub loop_closed_ms: Option<f64>,
    /// From the fault to the new process having claimed its region. [ms]
    pub back_ms: Option<f64>,
    /// A process that only starts, attaches and ends, just before. [ms]
    pub bare_ms: Option<f64>,
    /// From the fault to the bench running with full force again. [ms]
    pub running_ms: Option<f64>,
    /// Ticks that the service caught up or left out.
    pub missed_ticks: u64,
    /// Largest difference between a tick's step of position and its speed times the period, around the fault. [m]
    pub jump_m: Option<f64>,
}

/// An output phase that the rig executed.
#[derive(Debug, Clone, Copy)]
pub struct Phase {
    pub tick: u64,
    pub state: u64,
    pub flags: u64,
    pub stale: u64,
    pub late: u64,
    pub trip_code: u64,
    pub fade: f64,
    pub applied_n: [f64; 2],
    pub height_m: [f64; 2],
    pub steer_torque_n_m: f64,
}

/// All output phases of a log.
pub fn phases(log: &LogReader) -> Result<Vec<Phase>, String> {
    let region = log.region("rig_status").map_err(|e| e.to_string())?;
    Ok((0..region.ticks.len())
        .map(|row| {
            let words = region.row(row);
            let mut status = <RigStatus as regions::Payload>::absent();
            regions::Payload::words_mut(&mut status).copy_from_slice(words);
            Phase {
                tick: region.ticks[row],
                state: status.state,
                flags: status.flags,
                stale: status.stale_count,
                late: status.late_command_count,
                trip_code: status.trip_code,
                fade: status.force_fade_ratio,
                applied_n: status.tie_rod_force_applied_n,
                height_m: status.ball_height_applied_m,
                steer_torque_n_m: status.steer_torque_command_n_m,
            }
        })
        .collect())
}

/// Breaches of the rules that always hold: tick and what.
fn breaches(phases: &[Phase], log: &LogReader, resolved: &ResolvedBench) -> Vec<(u64, String)> {
    let limits = &resolved.rig.limits;
    let period_s = resolved.scenario.timing.period_s();
    let mut found = Vec::new();
    let requests = log.column_u64("bench", "request_count").unwrap_or_default();
    let bench_ticks = log.region("bench").map(|r| r.ticks.clone()).unwrap_or_default();
    let asked_by = |tick: u64| {
        let row = bench_ticks.partition_point(|&t| t <= tick);
        row.checked_sub(1).and_then(|row| requests.get(row)).copied().unwrap_or(0)
    };
    let mut fresh_in_row = 0_u32;
    let mut came_up_at = None;
    for (i, now) in phases.iter().enumerate() {
        let before = i.checked_sub(1).map(|k| phases[k]);
        // The late count starts anew with the process.
        let reborn = before.is_none_or(|before| is_reborn(&before, now));
        let mut breach = |what: String| found.push((now.tick, what));
        fresh_in_row = if reborn { 0 } else { fresh_in_row };
        fresh_in_row = if now.stale == 0 { fresh_in_row + 1 } else { 0 };
        if !now.applied_n.iter().all(|f| f.is_finite() && f.abs() <= limits.command_force_n + 1e-6)
            || !now.steer_torque_n_m.is_finite()
            || !now.height_m.iter().all(|h| h.is_finite())
        {
            breach(format!("applied {:?} N, {} N·m", now.applied_n, now.steer_torque_n_m));
        }
        let following = matches!(now.state, STARTING | RUNNING | RESUMING);
        if following && now.stale > u64::from(limits.stale_ticks) {
            breach(format!("followed commands {} output phases old", now.stale));
        }
        if reborn {
            came_up_at = Some(now.tick);
            if !matches!(now.state, OFF | IDLE) || now.fade != 0.0 || now.steer_torque_n_m != 0.0 {
                breach(format!("a new rig came up in state {} at fade {}", now.state, now.fade));
            }
        }
        let Some(before) = before.filter(|_| !reborn) else { continue };
        if now.state == STARTING
            && before.state != STARTING
            && let Some(up) = came_up_at
            && up > 10
            && asked_by(now.tick) <= asked_by(up)
        {
            breach("a new rig started without being asked anew".to_owned());
        }
        if matches!(now.state, HOLDING | TRIPPED) {
            let expected = (before.fade - period_s / limits.safe_ramp_s).max(0.0);
            if (now.fade - expected).abs() > 1e-6 {
                breach(format!("force fade {} where the ramp gives {expected}", now.fade));
            }
            if now.steer_torque_n_m != 0.0 {
                breach(format!("steer torque {} N·m in the safe state", now.steer_torque_n_m));
            }
            if before.state == now.state && before.height_m != now.height_m {
                breach("heights moved in the safe state".to_owned());
            }
        }
        if now.state == RESUMING {
            if before.state == HOLDING && fresh_in_row < limits.resume_fresh_ticks {
                breach(format!("resumed after {fresh_in_row} fresh commands"));
            }
            if now.fade - before.fade > period_s / limits.resume_fade_s + 1e-6 {
                breach(format!("force fade rose from {} to {}", before.fade, now.fade));
            }
        }
    }
    found
}

/// Whether a new rig process speaks: its counts start anew, and it is off or idle without having stopped.
fn is_reborn(before: &Phase, now: &Phase) -> bool {
    let idle = matches!(now.state, OFF | IDLE);
    now.late < before.late || idle && matches!(before.state, STARTING | RUNNING | HOLDING | RESUMING)
}

/// Flags of a model's region by tick.
struct Flags<'a> {
    ticks: &'a [u64],
    flags: Vec<u64>,
}

impl Flags<'_> {
    fn of<'a>(log: &'a LogReader, region: &str) -> Result<Flags<'a>, String> {
        let flags = log.column_u64(region, "flags").map_err(|e| e.to_string())?;
        Ok(Flags { ticks: &log.region(region).map_err(|e| e.to_string())?.ticks, flags })
    }

    fn count(&self, from: u64, to: u64, bit: u64) -> u64 {
        let range = self.ticks.partition_point(|&t| t < from)..self.ticks.partition_point(|&t| t < to);
        self.flags[range].iter().filter(|f| *f & bit != 0).count() as u64
    }

    /// Ticks from `from` to `to` that are not there.
    fn gaps(&self, from: u64, to: u64) -> u64 {
        let there = self.ticks.partition_point(|&t| t < to) - self.ticks.partition_point(|&t| t < from);
        let last = self.ticks.last().map_or(0, |t| t + 1).min(to);
        last.saturating_sub(from).saturating_sub(there as u64)
    }
}

/// Judges all faults of a run. Also returns what is wrong with the run as a whole.
pub fn judge(
    round: &Round,
    log: &LogReader,
    resolved: &ResolvedBench,
    drive: CampaignDrive,
) -> Result<(Vec<Judgement>, Vec<String>), String> {
    let phases = phases(log)?;
    let timing = &resolved.scenario.timing;
    let period_s = timing.period_s();
    let breaches = breaches(&phases, log, resolved);
    let (vehicle, multibody) = (Flags::of(log, "vehicle_state")?, Flags::of(log, "suspension_state")?);
    let rig = Flags {
        ticks: &log.region("rig_status").map_err(|e| e.to_string())?.ticks,
        flags: phases.iter().map(|p| p.flags).collect(),
    };
    let jumps = Jumps::of(log, period_s)?;
    let bus = Bus::of(log);
    let late_samples = late_samples(log, timing.vehicle_latest_start * period_s)?;
    let mut whole = round.faults.clone();
    let missing = missing_in_log(round, log);
    let origins: BTreeSet<u64> = log.files.iter().filter_map(|f| f.wall_start_ns).collect();
    if origins.len() > 1 {
        whole.push(format!("the log's files disagree on the wall clock at tick 0: {origins:?}"));
    }
    let limit = u64::from(resolved.rig.limits.stale_ticks);
    let end_of_log = phases.last().map_or(0, |p| p.tick + 1);
    let mut judgements = Vec::new();
    for (i, made) in round.made.iter().enumerate() {
        let from = made.tick.saturating_sub(3);
        let next = round.made.get(i + 1).map_or(end_of_log, |next| next.tick.saturating_sub(3));
        let to = next.max(from);
        // The reaction is over when the bench ran again; later is settling.
        let over = made.running_tick.map_or(to, |tick| (tick + 1).min(to));
        let (kind, target) = (&made.injection.kind, made.injection.target);
        let mut j = Judgement {
            number: made.injection.number,
            kind: kind.name(),
            target: target.name(),
            tick: made.tick,
            outcome: Outcome::Passed,
            faults: Vec::new(),
            notes: Vec::new(),
            held_at_stale_count: None,
            loop_closed_ms: None,
            back_ms: made.back_ns.map(|ns| (ns.saturating_sub(made.at_ns)) as f64 * 1e-6),
            bare_ms: made.bare_ns.map(|ns| ns as f64 * 1e-6),
            running_ms: None,
            missed_ticks: 0,
            jump_m: None,
        };
        if let Some(why) = &made.skipped {
            j.outcome = Outcome::Skipped;
            j.notes.push(why.clone());
            judgements.push(j);
            continue;
        }
        let window =
            &phases[phases.partition_point(|p| p.tick < from)..phases.partition_point(|p| p.tick < over)];
        let whole_window =
            &phases[phases.partition_point(|p| p.tick < from)..phases.partition_point(|p| p.tick < to)];
        let at_ms = made.at_ns as f64 * 1e-6;
        let phase_ms = |tick: u64| (tick as f64 + timing.output_phase) * period_s * 1e3;
        if let Some(tick) = made.running_tick {
            let full = whole_window.iter().rev().find(|p| p.tick <= tick && p.state != RUNNING);
            j.running_ms = Some(full.map_or(0.0, |p| (phase_ms(p.tick + 1) - at_ms).max(0.0)));
        }
        let held = window.windows(2).find(|w| w[0].state != HOLDING && w[1].state == HOLDING);
        j.held_at_stale_count = held.map(|w| w[1].stale);
        let first_stale = if target == Target::Rig {
            // The loop of a rig that died closes with its first output phase that has a fresh command.
            let back = |w: &[Phase]| is_reborn(&w[0], &w[1]) || w[1].tick - w[0].tick > 2;
            window.windows(2).position(back).map(|i| i + 1)
        } else {
            window.iter().position(|p| p.tick + 1 >= made.tick && p.stale > 0)
        };
        if let Some(first) =
            first_stale.filter(|_| !matches!(target, Target::Logger | Target::Supervisor | Target::Can))
        {
            let closed = window[first..].iter().find(|p| p.stale == 0 && p.tick > made.tick);
            j.loop_closed_ms = closed.map(|p| phase_ms(p.tick) - at_ms);
        }
        j.jump_m = jumps.largest(from, over, &made.scribbled);
        let caught_up =
            |flags: &Flags<'_>| flags.count(from, over, model_flags::CAUGHT_UP) + flags.gaps(from, over);
        j.missed_ticks = match target {
            Target::Vehicle => caught_up(&vehicle),
            Target::Multibody => caught_up(&multibody),
            Target::Rig => rig.gaps(from, over),
            Target::Logger | Target::Supervisor | Target::Can => 0,
        };

        // Hard rules.
        for (tick, what) in breaches.iter().filter(|(tick, _)| (from..to).contains(tick)) {
            j.faults.push(format!("tick {tick}: {what}"));
        }
        let lacks = missing.iter().filter(|(_, tick)| (from..to).contains(tick)).count();
        if lacks > 0 {
            j.faults.push(format!("{lacks} published ticks are not in the log"));
        }
        if made.running_tick.is_none() {
            j.faults.push("the bench did not run again".to_owned());
        }
        if let Some(jump) = j.jump_m.filter(|&jump| jump > JUMP_MAX_M) {
            j.faults.push(format!("position jumped by {jump:.6} m"));
        }
        if let Some(stale) = j.held_at_stale_count.filter(|&stale| stale > limit + 1) {
            j.faults.push(format!("held only at {stale} output phases without a command, limit {limit}"));
        }

        // What the fault should have caused.
        let mut unmet = Vec::new();
        expect(made, &j, window, period_s, limit, &vehicle, &multibody, from, over, &mut unmet);
        if let FaultKind::Can { effect, ticks, .. } = kind {
            unmet.extend(bus.unmet(made, *effect, u64::from(*ticks), over));
        }
        let meant = |t: Target| t == target;
        let rig_late = late_samples.iter().filter(|tick| (from..over).contains(*tick)).count() as u64;
        let others = [
            if meant(Target::Rig) { 0 } else { rig.gaps(from, over) + rig_late },
            if meant(Target::Vehicle) { 0 } else { caught_up(&vehicle) },
            if meant(Target::Multibody) { 0 } else { caught_up(&multibody) },
        ];
        // A follower of a dead rig steps on held inputs; it is the host only if it missed its own time.
        let mut disturbed = drive == CampaignDrive::Paced && others.iter().any(|&ticks| ticks > 0);
        // An order takes effect some ticks after it was given: by then the host may have had its say.
        let unsettled = window.iter().any(|p| p.tick < made.tick && (p.state != RUNNING || p.stale > 0));
        if unsettled && drive == CampaignDrive::Paced {
            disturbed = true;
            unmet.push("the bench was not running undisturbed when the fault came".to_owned());
        }
        if disturbed {
            j.notes.push(format!(
                "the host stalled others meanwhile: rig {}, vehicle {}, multibody {} ticks",
                others[0], others[1], others[2]
            ));
        }
        if !j.faults.is_empty() {
            j.outcome = Outcome::Failed;
        } else if !unmet.is_empty() {
            j.outcome = if disturbed { Outcome::HostStalled } else { Outcome::Failed };
        }
        j.faults.extend(unmet);
        judgements.push(j);
    }
    let first = round.made.first().map_or(end_of_log, |made| made.tick.saturating_sub(3));
    for (tick, what) in breaches.iter().filter(|(tick, _)| *tick < first) {
        whole.push(format!("tick {tick}, before the first fault: {what}"));
    }
    let total: usize = missing.len();
    if total > 0 {
        let (region, tick) = missing[0];
        whole.push(format!("the log lacks {total} published ticks, the first of {region} at {tick}"));
    }
    Ok((judgements, whole))
}

/// Ticks whose sample the rig took so late that nobody can have waited for it: none in lockstep, which has no clock.
fn late_samples(log: &LogReader, latest_s: f64) -> Result<Vec<u64>, String> {
    let Ok(region) = log.region("rig_timing") else { return Ok(Vec::new()) };
    let start_s = log.column("rig_timing", "start_s").map_err(|e| e.to_string())?;
    Ok(region
        .ticks
        .iter()
        .zip(start_s)
        .filter(|(_, start_s)| *start_s > latest_s)
        .map(|(tick, _)| *tick)
        .collect())
}

/// Largest step that a tick may make besides speed times period: the error of the trapezium rule at 100 m/s² and
/// of leaving roll and pitch out. [m]
const JUMP_MAX_M: f64 = 2e-3;

/// What a fault should have caused and did not.
#[allow(clippy::too_many_arguments)]
fn expect(
    made: &Made,
    j: &Judgement,
    window: &[Phase],
    period_s: f64,
    limit: u64,
    vehicle: &Flags<'_>,
    multibody: &Flags<'_>,
    from: u64,
    over: u64,
    unmet: &mut Vec<String>,
) {
    let (kind, target) = (&made.injection.kind, made.injection.target);
    let ticks = fault_ticks(kind, period_s);
    let model = matches!(target, Target::Vehicle | Target::Multibody);
    let held = j.held_at_stale_count.is_some();
    let tripped = window.iter().find(|p| p.state == TRIPPED);
    let disturbed_running = window.iter().any(|p| p.state != RUNNING);
    let mut require = |holds: bool, what: &str| {
        if !holds {
            unmet.push(what.to_owned());
        }
    };
    let late = |n: u64| {
        let first = window.first().map_or(0, |p| p.late);
        window.last().is_some_and(|p| p.late >= first + n)
    };
    if !matches!(kind, FaultKind::Sensor { .. }) {
        let code = tripped.map_or(0, |p| p.trip_code);
        // A rig that was away for longer than its stall limit trips, as it should; and random bits may make a number
        // that is plausible, but a step.
        let stalled = target == Target::Rig && code == 5;
        let random =
            matches!(kind, FaultKind::Corrupt { content: Content::Random, .. } | FaultKind::Scribble { .. });
        let step = random && (20..=21).contains(&code);
        require(tripped.is_none() || stalled || step, &format!("the rig tripped (code {code})"));
    }
    match kind {
        FaultKind::Kill { .. } | FaultKind::TornWrite { .. } if model => {
            require(held, "the rig did not hold");
            require(made.back_ns.is_some(), "the service did not come back");
            let restored = if target == Target::Vehicle { vehicle } else { multibody };
            let restored = restored.count(from, over + 5, model_flags::RESTORED);
            require(restored == 1, &format!("the service was restored {restored} times"));
        }
        FaultKind::Kill { .. } | FaultKind::TornWrite { .. } if target == Target::Rig => {
            let reborn = window.windows(2).filter(|w| is_reborn(&w[0], &w[1])).count();
            require(reborn == 1, &format!("{reborn} new rigs came up"));
        }
        FaultKind::Kill { .. } => {
            require(made.back_ns.is_some(), "nobody took over");
            require(!disturbed_running, "the rig did not just run on");
        }
        FaultKind::Stop { .. } | FaultKind::Stall { .. } if model => {
            require(held || ticks < limit + 2, "the rig did not hold");
            let flags = if target == Target::Vehicle { vehicle } else { multibody };
            require(ticks > 200 || flags.gaps(from, over) == 0, "missed ticks were not caught up");
        }
        FaultKind::Stop { .. } | FaultKind::Stall { .. } if target == Target::Rig => {
            let stalled = window.iter().any(|p| p.flags & rig_flags::STALLED != 0);
            require(stalled || ticks < 2, "the rig did not notice its own stall");
        }
        FaultKind::Stop { .. } | FaultKind::Stall { .. } | FaultKind::DiskFull { .. } => {
            require(!disturbed_running, "the rig did not just run on");
        }
        FaultKind::ClockStep { .. } | FaultKind::Can { .. } => {
            require(!disturbed_running, "the rig did not just run on");
        }
        FaultKind::Late { .. } | FaultKind::Corrupt { .. } => {
            let safe = held || tripped.is_some();
            let counted = late(1) || tripped.is_some();
            // A multibody service that refuses the car's nonsense holds its last good answer for a tick or two.
            let masked = target == Target::Vehicle && ticks < limit;
            require(counted || masked, "the rig did not count the commands as late or refused");
            require(safe || ticks < limit + 1, "the rig did not hold");
            require(!safe || ticks >= limit, "the rig held before the limit");
        }
        FaultKind::Scribble { place: Place::Header, .. } => {
            require(!disturbed_running, "the rig did not just run on");
            require(made.put_right, "the supervisor did not put the header right");
        }
        // A head that its slot does not bear out is not believed: every tick is read all the same.
        FaultKind::Scribble { place: Place::Head, .. } => {
            require(!disturbed_running, "the rig did not just run on");
        }
        // Whoever had read the tick already did not notice.
        FaultKind::Scribble { .. } => {
            require(!held || ticks >= limit, "the rig held before the limit");
        }
        FaultKind::Sensor { effect, .. } => {
            let allowed = match effect {
                SensorEffect::Invalid => 30..=33,
                SensorEffect::Stuck | SensorEffect::Offset => 10..=33,
            };
            let code = tripped.map_or(0, |p| p.trip_code);
            require(allowed.contains(&code), &format!("no trip by a sensor's code (code {code})"));
        }
        FaultKind::TornWrite { .. } => {}
    }
}

/// Ticks that the observer read in the table but that are not in the log.
fn missing_in_log(round: &Round, log: &LogReader) -> Vec<(&'static str, u64)> {
    let Some(seen) = &round.seen else { return Vec::new() };
    let mut missing = Vec::new();
    for (id, ticks) in DENSE.iter().zip(&seen.ticks) {
        let name = id.region().name;
        let logged = log.region(name).map(|r| r.ticks.as_slice()).unwrap_or_default();
        let scribbled = |tick: &u64| round.made.iter().any(|made| made.scribbled.contains(tick));
        let lacks = ticks.iter().filter(|t| logged.binary_search(t).is_err() && !scribbled(t));
        missing.extend(lacks.map(|&t| (name, t)));
    }
    missing
}

/// Steps of the car's position besides speed times period, tick by tick.
struct Jumps(Vec<(u64, f64)>);

impl Jumps {
    fn of(log: &LogReader, period_s: f64) -> Result<Self, String> {
        let column = |name: &str| log.column("vehicle_state", name).map_err(|e| e.to_string());
        let (x, y) = (column("position_m.x")?, column("position_m.y")?);
        let (u, v) = (column("velocity_m_s.x")?, column("velocity_m_s.y")?);
        let yaw = column("yaw_rad")?;
        let flags = log.column_u64("vehicle_state", "flags").map_err(|e| e.to_string())?;
        let ticks = &log.region("vehicle_state").map_err(|e| e.to_string())?.ticks;
        let global = |i: usize| {
            let (sin, cos) = yaw[i].sin_cos();
            [u[i] * cos - v[i] * sin, u[i] * sin + v[i] * cos]
        };
        let steps = (1..ticks.len()).filter_map(|i| {
            // Held outputs stand still and say so; the tick behind them makes up for nothing.
            let held = (flags[i] | flags[i - 1]) & model_flags::STALE != 0;
            // Behind ticks that were left out (more were missed than are caught up) the car goes on where it was.
            let t = period_s;
            let (before, now) = (global(i - 1), global(i));
            let dx = x[i] - x[i - 1] - 0.5 * (before[0] + now[0]) * t;
            let dy = y[i] - y[i - 1] - 0.5 * (before[1] + now[1]) * t;
            let jump = dx.hypot(dy);
            (!held && jump < 1e6).then_some((ticks[i], jump))
        });
        Ok(Jumps(steps.collect()))
    }

    /// Between two ticks, but for steps to and from the `spoilt` ones.
    fn largest(&self, from: u64, to: u64, spoilt: &[u64]) -> Option<f64> {
        let range = self.0.partition_point(|s| s.0 < from)..self.0.partition_point(|s| s.0 < to);
        let sound = |tick: u64| !spoilt.contains(&tick) && !spoilt.contains(&(tick.wrapping_sub(1)));
        self.0[range].iter().filter(|s| sound(s.0)).map(|s| s.1).reduce(f64::max)
    }
}
