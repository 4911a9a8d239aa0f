//! Commands cut to their limits, every cut reported.

use config::rig::Limits;
use rig_control::{RigCommand, SteerCommand};
use rig_plant::Actuation;

/// Bits that tell what was clamped.
pub mod flags {
    /// Commanded force (left; right at the next bit).
    pub const FORCE: u64 = 1;
    /// Rate of commanded force (left; right at the next bit).
    pub const FORCE_RATE: u64 = 1 << 2;
    /// Commanded height (left; right at the next bit).
    pub const HEIGHT: u64 = 1 << 4;
    /// Speed of commanded height (left; right at the next bit).
    pub const HEIGHT_SPEED: u64 = 1 << 6;
    /// Commanded steering angle.
    pub const STEER_ANGLE: u64 = 1 << 8;
    /// Commanded steering rate.
    pub const STEER_RATE: u64 = 1 << 9;
    /// Commanded steering torque.
    pub const STEER_TORQUE: u64 = 1 << 10;
    /// A command that is not finite: the last good one was used.
    pub const NOT_FINITE: u64 = 1 << 11;
    /// Valve opening of an actuation.
    pub const VALVE: u64 = 1 << 12;
    /// Steer torque of an actuation.
    pub const ACTUATOR_TORQUE: u64 = 1 << 13;
    /// An actuation that is not finite: that axis is closed.
    pub const ACTUATION_NOT_FINITE: u64 = 1 << 14;
    /// Assist torque that the ECU on the bus asks for.
    pub const ECU_ASSIST: u64 = 1 << 15;
    /// Its rate.
    pub const ECU_ASSIST_RATE: u64 = 1 << 16;
    /// The ECU's request is absent or stale: ramped to zero.
    pub const ECU_ABSENT: u64 = 1 << 17;
}

/// Cuts to ±limit and notes it.
fn cut(value: &mut f64, limit: f64, bit: u64, bits: &mut u64) {
    if value.abs() > limit {
        *value = value.clamp(-limit, limit);
        *bits |= bit;
    }
}

/// Moves from `last` towards `value` by at most `step` and notes a slowing.
fn slow(value: &mut f64, last: f64, step: f64, bit: u64, bits: &mut u64) {
    if (*value - last).abs() > step {
        *value = last + (*value - last).clamp(-step, step);
        *bits |= bit;
    }
}

/// Takes over what is finite of `command` and keeps `last` for the rest.
pub fn finite(command: &RigCommand, last: &RigCommand, bits: &mut u64) -> RigCommand {
    let mut out = *command;
    let mut keep = |value: &mut f64, last: f64| {
        if !value.is_finite() {
            *value = last;
            *bits |= flags::NOT_FINITE;
        }
    };
    for side in 0..2 {
        keep(&mut out.tie_rod_force_n[side], last.tie_rod_force_n[side]);
        keep(&mut out.ball_height_m[side], last.ball_height_m[side]);
        keep(&mut out.ball_height_velocity_m_s[side], 0.0);
    }
    let steer_finite = match out.steer {
        SteerCommand::Free => true,
        SteerCommand::Angle { angle_rad, rate_rad_s } => angle_rad.is_finite() && rate_rad_s.is_finite(),
        SteerCommand::Torque { torque_n_m } => torque_n_m.is_finite(),
    };
    if !steer_finite {
        out.steer = last.steer;
        *bits |= flags::NOT_FINITE;
    }
    out
}

/// Cuts a finite command to its limits; rates are judged against `last`, one period ago. With
/// `following` false (nothing reaches the axes) positions may jump, since fades start from where they are.
pub fn command(
    out: &mut RigCommand,
    last: &RigCommand,
    limits: &Limits,
    period_s: f64,
    following: bool,
) -> u64 {
    let mut bits = 0;
    for side in 0..2 {
        let bit = |flag: u64| flag << side;
        let force = &mut out.tie_rod_force_n[side];
        cut(force, limits.command_force_n, bit(flags::FORCE), &mut bits);
        if following {
            let step = limits.command_force_rate_n_s * period_s;
            slow(force, last.tie_rod_force_n[side], step, bit(flags::FORCE_RATE), &mut bits);
        }
        let height = &mut out.ball_height_m[side];
        cut(height, limits.command_height_m, bit(flags::HEIGHT), &mut bits);
        let speed = limits.command_height_speed_m_s;
        if following {
            let last = last.ball_height_m[side];
            slow(height, last, speed * period_s, bit(flags::HEIGHT_SPEED), &mut bits);
        }
        cut(&mut out.ball_height_velocity_m_s[side], speed, bit(flags::HEIGHT_SPEED), &mut bits);
    }
    match &mut out.steer {
        SteerCommand::Free => {}
        SteerCommand::Angle { angle_rad, rate_rad_s } => {
            cut(angle_rad, limits.command_steer_angle_rad, flags::STEER_ANGLE, &mut bits);
            let rate = limits.command_steer_rate_rad_s;
            if following && let SteerCommand::Angle { angle_rad: before, .. } = last.steer {
                slow(angle_rad, before, rate * period_s, flags::STEER_RATE, &mut bits);
            }
            cut(rate_rad_s, rate, flags::STEER_RATE, &mut bits);
        }
        SteerCommand::Torque { torque_n_m } => {
            cut(torque_n_m, limits.command_steer_torque_n_m, flags::STEER_TORQUE, &mut bits);
        }
    }
    bits
}

/// Cuts an actuation; what is not finite closes its valve or takes the torque off.
pub fn actuation(out: &mut Actuation, limits: &Limits, steer_on: bool) -> u64 {
    let mut bits = 0;
    for valve in out.horizontal_valve.iter_mut().chain(out.vertical_valve.iter_mut()) {
        if !valve.is_finite() {
            *valve = 0.0;
            bits |= flags::ACTUATION_NOT_FINITE;
        }
        cut(valve, limits.command_valve, flags::VALVE, &mut bits);
    }
    if !out.steer_torque_n_m.is_finite() {
        out.steer_torque_n_m = 0.0;
        bits |= flags::ACTUATION_NOT_FINITE;
    }
    cut(&mut out.steer_torque_n_m, limits.command_steer_torque_n_m, flags::ACTUATOR_TORQUE, &mut bits);
    if !steer_on {
        out.steer_torque_n_m = 0.0;
    }
    bits
}
