//! On-centre handling: the weave of ISO 13674-1 and a slow friction ramp.
//!
//! The weave's figures come from three cross plots over whole cycles [Norman, SAE 840069; ISO 13674-1, 11]:
//! lateral acceleration over hand-wheel angle, torque over lateral acceleration, torque over angle; with the
//! phase lag of the yaw rate. Gradients are those of least-squares lines through both branches within a tenth
//! of the peak (0.1 g figures: within ±0.25 m/s² of ±1 m/s²); values "at 0" are half the difference of the two
//! branches. All signals pass the same zero-phase 5 Hz low pass, so that sensor noise does not make branches cross
//! more than once and no phase is added.

use super::{Assessment, Signals};
use crate::filter::LowPass;
use crate::fit::{crossing, gradient};
use crate::statistics::{amplitude, mean, peak, range};
use std::f64::consts::TAU;

/// Corner of the low pass before the cross plots. \[Hz\]
const CORNER_HZ: f64 = 5.0;
/// Lateral acceleration of the figures "at 0.1 g". [m/s²]
const TENTH_G: f64 = 0.980_665;

/// In-phase and quadrature amplitude of a signal at a frequency, over whole cycles.
pub(super) fn harmonic(values: &[f64], frequency_hz: f64, sample_time_s: f64) -> (f64, f64) {
    let mid = mean(values);
    let scale = 2.0 / values.len().max(1) as f64;
    let (mut s, mut c) = (0.0, 0.0);
    for (i, value) in values.iter().enumerate() {
        let (sine, cosine) = (TAU * frequency_hz * i as f64 * sample_time_s).sin_cos();
        s += (value - mid) * sine;
        c += (value - mid) * cosine;
    }
    (scale * s, scale * c)
}

/// Figures of a weave (ISO 13674-1: 100 km/h, 0.2 Hz, peak lateral acceleration about 2 m/s²).
///
/// `frequency_hz` is what the hand wheel was asked to do; the first and the last cycle of `signals` must lie
/// outside what is judged: at least three whole cycles are left.
pub fn weave(signals: &Signals, frequency_hz: f64) -> Assessment {
    let mut out = Assessment::new("weave, ISO 13674-1");
    let t = signals.sample_time_s;
    let filter = LowPass::butterworth(CORNER_HZ, t);
    let filtered = |values: &[f64]| filter.as_ref().map_or_else(|| values.to_vec(), |f| f.zero_phase(values));
    let angle = filtered(&signals.hand_wheel_angle_rad);
    // Whole cycles between rising passages through the middle, the first and last one left out.
    let middle = range(&angle).map_or(0.0, |(low, high)| 0.5 * (low + high));
    let tops: Vec<usize> = rising_passages(&angle, middle, 0.3 * amplitude(&angle));
    let window = match tops.as_slice() {
        [_, first, .., last, _] if last > first => *first..*last,
        _ => 0..0,
    };
    let cycles = tops.len().saturating_sub(3);
    let achieved_hz = if window.is_empty() { f64::NAN } else { cycles as f64 / (window.len() as f64 * t) };
    let part = |values: &[f64]| values.get(window.clone()).unwrap_or(&[]).to_vec();
    let angle = part(&angle);
    let torque = part(&filtered(&signals.hand_wheel_torque_n_m));
    let acceleration = part(&filtered(&signals.lateral_acceleration_m_s2));
    let yaw_rate = part(&filtered(&signals.yaw_rate_rad_s));
    let speed = part(&signals.speed_m_s);

    out.condition("mean speed", 3.6 * mean(&speed), 97.0, 103.0, "km/h");
    out.condition("largest deviation of speed", speed_deviation_km_h(&speed), 0.0, 3.0, "km/h");
    out.condition("steering frequency", achieved_hz, 0.9 * 0.2, 1.1 * 0.2, "Hz");
    out.condition("peak lateral acceleration", amplitude(&acceleration), 1.6, 2.4, "m/s²");
    out.condition("whole cycles judged", cycles as f64, 3.0, f64::INFINITY, "1");
    let asked = if frequency_hz > 0.0 { achieved_hz / frequency_hz } else { f64::NAN };
    out.condition("frequency achieved over asked", asked, 0.98, 1.02, "1");

    let near = |values: &[f64]| 0.1 * peak(values);
    let half_width = |x: &[f64], y: &[f64]| crossing(x, y, 0.0).map(|c| 0.5 * c.width.abs());
    // Lateral acceleration over angle, per 100 degrees as the trade quotes it.
    let hundred = 100_f64.to_radians();
    let sensitivity =
        |at: f64, half: f64| gradient(&angle, &acceleration, at, half).map(|l| l.slope * hundred);
    out.figure("steering sensitivity at 0 g", sensitivity(0.0, near(&angle)), "m/s² per 100°");
    let angle_tenth = mean_abs_at(&acceleration, &angle, TENTH_G);
    let tenth = angle_tenth.and_then(|at| {
        let half = near(&angle).max(0.1 * at);
        Some(0.5 * (sensitivity(at, half)? + sensitivity(-at, half)?))
    });
    out.figure("steering sensitivity at 0.1 g", tenth, "m/s² per 100°");
    out.figure("steering hysteresis", half_width(&acceleration, &angle).map(|w| 2.0 * w.to_degrees()), "°");
    // Torque over lateral acceleration.
    out.figure("torque at 0 g", half_width(&acceleration, &torque), "N·m");
    let at_tenth = mean_abs_at(&acceleration, &torque, TENTH_G);
    out.figure("torque at 0.1 g", at_tenth, "N·m");
    let torque_slope = |at: f64, half: f64| gradient(&acceleration, &torque, at, half).map(|l| l.slope);
    out.figure("torque gradient at 0 g", torque_slope(0.0, near(&acceleration)), "N·m per m/s²");
    let both = torque_slope(TENTH_G, 0.25).zip(torque_slope(-TENTH_G, 0.25)).map(|(a, b)| 0.5 * (a + b));
    out.figure("torque gradient at 0.1 g", both, "N·m per m/s²");
    out.figure("lateral acceleration at 0 N·m", half_width(&torque, &acceleration), "m/s²");
    // Torque over angle.
    let stiffness = gradient(&angle, &torque, 0.0, near(&angle)).map(|l| l.slope.to_radians());
    out.figure("steering stiffness at 0°", stiffness, "N·m/°");
    out.figure(
        "average steering stiffness",
        crate::fit::line(&angle, &torque).map(|l| l.slope.to_radians()),
        "N·m/°",
    );
    out.figure("friction torque (at 0°)", half_width(&angle, &torque), "N·m");
    out.figure("angle hysteresis (at 0 N·m)", half_width(&torque, &angle).map(|w| 2.0 * w.to_degrees()), "°");
    // Yaw rate behind angle.
    let lag = (!angle.is_empty()).then(|| {
        let (a, b) = (harmonic(&angle, achieved_hz, t), harmonic(&yaw_rate, achieved_hz, t));
        let phase = b.1.atan2(b.0) - a.1.atan2(a.0);
        let phase = phase - TAU * (phase / TAU).round();
        (-phase, b.0.hypot(b.1) / a.0.hypot(a.1))
    });
    out.figure("yaw rate gain", lag.map(|(_, gain)| gain), "1/s");
    out.figure("yaw rate phase lag", lag.map(|(phase, _)| phase.to_degrees()), "°");
    out.figure("yaw rate time lag", lag.map(|(phase, _)| 1e3 * phase / (TAU * achieved_hz)), "ms");
    out
}

/// Figures of a slow ramp of the hand wheel from lock to lock of a small range (0.02 Hz triangle or sine,
/// 50 km/h): loop width, which is twice the friction felt, and dead band. Not in a standard.
pub fn slow_ramp(signals: &Signals) -> Assessment {
    let mut out = Assessment::new("slow friction ramp");
    let filter = LowPass::butterworth(CORNER_HZ, signals.sample_time_s);
    let filtered = |values: &[f64]| filter.as_ref().map_or_else(|| values.to_vec(), |f| f.zero_phase(values));
    let angle = filtered(&signals.hand_wheel_angle_rad);
    let torque = filtered(&signals.hand_wheel_torque_n_m);
    let t = signals.sample_time_s;
    let rate: Vec<f64> = angle.windows(2).map(|w| (w[1] - w[0]) / t).collect();
    let found = crossing(&angle, &torque, 0.0);
    out.condition("mean speed", 3.6 * mean(&signals.speed_m_s), 47.0, 53.0, "km/h");
    out.condition("largest hand-wheel rate", peak(&rate).to_degrees(), 0.0, 10.0, "°/s");
    out.condition(
        "crossings of straight ahead",
        found.map_or(0.0, |f| f.count as f64),
        2.0,
        f64::INFINITY,
        "1",
    );
    out.figure("torque loop width at 0°", found.map(|f| f.width.abs()), "N·m");
    out.figure("friction torque (at 0°)", found.map(|f| 0.5 * f.width.abs()), "N·m");
    let stiffness = gradient(&angle, &torque, 0.0, 0.1 * peak(&angle)).map(|l| l.slope.to_radians());
    out.figure("steering stiffness at 0°", stiffness, "N·m/°");
    let dead = crossing(&signals.lateral_acceleration_m_s2, &signals.hand_wheel_angle_rad, 0.0);
    out.figure("dead band of lateral acceleration", dead.map(|c| c.width.abs().to_degrees()), "°");
    out
}

/// Mean over both directions and both branches of |y| where |x| passes `at`.
fn mean_abs_at(x: &[f64], y: &[f64], at: f64) -> Option<f64> {
    let (left, right) = (crossing(x, y, at)?, crossing(x, y, -at)?);
    Some(0.25 * (left.rising + left.falling - right.rising - right.falling).abs())
}

/// Indices at which a signal rises through a level, having been lower by `margin` since the one before.
pub(super) fn rising_passages(values: &[f64], level: f64, margin: f64) -> Vec<usize> {
    let mut armed = true;
    let mut found = Vec::new();
    for (i, pair) in values.windows(2).enumerate() {
        if pair[1] < level - margin {
            armed = true;
        }
        if armed && pair[0] < level && pair[1] >= level {
            found.push(i + 1);
            armed = false;
        }
    }
    found
}

/// Largest deviation of the speed from its mean. [km/h]
pub(super) fn speed_deviation_km_h(speed_m_s: &[f64]) -> f64 {
    let mid = mean(speed_m_s);
    3.6 * peak(&speed_m_s.iter().map(|v| v - mid).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A linear car with Coulomb friction and a lag: everything about it is known.
    fn run(speed_km_h: f64, friction_n_m: f64, lag_rad: f64) -> Signals {
        let (t, f) = (1e-3, 0.2);
        let n = 60_000;
        let phase = |i: usize| TAU * f * i as f64 * t;
        let amplitude = 20_f64.to_radians();
        Signals {
            sample_time_s: t,
            hand_wheel_angle_rad: (0..n).map(|i| amplitude * phase(i).sin()).collect(),
            hand_wheel_torque_n_m: (0..n)
                .map(|i| 4.0 * phase(i).sin() + friction_n_m * (phase(i).cos() / 0.05).tanh())
                .collect(),
            lateral_acceleration_m_s2: (0..n).map(|i| 2.0 * (phase(i) - lag_rad).sin()).collect(),
            yaw_rate_rad_s: (0..n).map(|i| 0.08 * (phase(i) - 0.5 * lag_rad).sin()).collect(),
            yaw_rad: vec![0.0; n],
            roll_rad: vec![0.0; n],
            side_slip_rad: vec![0.0; n],
            speed_m_s: vec![speed_km_h / 3.6; n],
            x_m: vec![0.0; n],
            y_m: vec![0.0; n],
        }
    }

    #[test]
    fn a_known_car_gives_its_figures_back() {
        let lag = 0.2;
        let out = weave(&run(100.0, 1.5, lag), 0.2);
        assert!(out.valid(), "{:?}", out.conditions);
        let close = |name: &str, expected: f64, relative: f64| {
            let value = out.value(name).unwrap();
            assert!((value / expected - 1.0).abs() < relative, "{name}: {value} for {expected}");
        };
        // Angle at ay = 0 on the two branches is ± A sin(lag).
        close("steering hysteresis", 2.0 * 20.0 * lag.sin(), 0.01);
        close("friction torque (at 0°)", 1.5, 0.01);
        // At ay = 0 the torque is 4 sin(lag) + friction.
        close("torque at 0 g", 4.0 * lag.sin() + 1.5, 0.01);
        close("steering stiffness at 0°", 4.0 / 20.0, 0.02);
        close("steering sensitivity at 0 g", 2.0 * lag.cos() / 20.0 * 100.0, 0.03);
        close("yaw rate phase lag", 0.1_f64.to_degrees(), 0.001);
        close("yaw rate time lag", 1e3 * 0.1 / (TAU * 0.2), 0.001);
        close("yaw rate gain", 0.08 / 20_f64.to_radians(), 0.001);
        // At ±0.1 g: sin(p - lag) = ±0.49; both branches have the same mean torque 4 sin(asin(0.49) ± lag)...
        let p = (TENTH_G / 2.0).asin();
        let rising = 4.0 * (p + lag).sin() + 1.5;
        let falling = 4.0 * (std::f64::consts::PI - p + lag).sin() - 1.5;
        close("torque at 0.1 g", 0.5 * (rising + falling), 0.01);
    }

    #[test]
    fn at_another_speed_everything_is_withheld_with_the_reason() {
        let out = weave(&run(120.0, 1.5, 0.2), 0.2);
        assert!(!out.valid());
        for figure in &out.figures {
            let reason = figure.value.as_ref().unwrap_err();
            assert!(reason.contains("mean speed 120"), "{reason}");
        }
        assert_eq!(out.value("torque at 0 g"), None);
    }

    #[test]
    fn loop_width_of_a_slow_ramp_is_twice_the_friction() {
        let mut signals = run(50.0, 0.8, 0.0);
        signals.sample_time_s = 1e-2;
        let out = slow_ramp(&signals);
        assert!(out.valid(), "{:?}", out.conditions);
        assert!((out.value("torque loop width at 0°").unwrap() - 1.6).abs() < 0.02);
        let twice = slow_ramp(&Signals { sample_time_s: 1e-2, ..run(50.0, 1.6, 0.0) });
        assert!((twice.value("torque loop width at 0°").unwrap() - 3.2).abs() < 0.04);
    }
}
