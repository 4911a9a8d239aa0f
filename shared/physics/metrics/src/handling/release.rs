//! Returnability: the hand wheel is let go in a steady turn [ISO 17288-1, free-steer behaviour].
//!
//! Residual figures are means over the last 0.5 s of the third second after release, over the value just before it.
//! Damping: logarithmic decrement of the hand-wheel angle's half swings, where it swings.

use super::{Assessment, Signals, mean_of};
use crate::statistics::{mean, peak};

/// Figures of a release at `release_s` of a run that begins at 0.
pub fn release(signals: &Signals, release_s: f64) -> Assessment {
    let mut out = Assessment::new("release of the hand wheel, ISO 17288-1");
    let t = signals.sample_time_s;
    let n = signals.len();
    let at = (release_s / t).round() as usize;
    let seconds = |s: f64| (s / t) as usize;
    let before = at.saturating_sub(seconds(0.5))..at.min(n);
    let last = at + seconds(2.5)..(at + seconds(3.0)).min(n);
    let turn = |values: &[f64]| mean_of(values, before.clone());
    let rest = |values: &[f64]| mean_of(values, last.clone());
    let (angle, yaw) = (&signals.hand_wheel_angle_rad, &signals.yaw_rate_rad_s);
    out.condition(
        "lateral acceleration before release",
        turn(&signals.lateral_acceleration_m_s2).abs(),
        0.8,
        4.5,
        "m/s²",
    );
    let torque = signals.hand_wheel_torque_n_m.get(at + seconds(0.3)..n).unwrap_or(&[]);
    let held = mean(&torque.iter().map(|v| v.abs()).collect::<Vec<_>>());
    out.condition("mean torque on the free hand wheel", held, 0.0, 0.6, "N·m");
    out.condition("time after release", n.saturating_sub(at) as f64 * t, 3.0, f64::INFINITY, "s");
    out.figure("residual hand-wheel angle", Some(rest(angle).to_degrees()), "°");
    out.figure(
        "residual hand-wheel angle over that in the turn",
        Some(100.0 * rest(angle) / turn(angle)),
        "%",
    );
    out.figure("residual yaw rate", Some(rest(yaw).to_degrees()), "°/s");
    out.figure("residual yaw rate over that in the turn", Some(100.0 * rest(yaw) / turn(yaw)), "%");
    let free = angle.get(at..n).unwrap_or(&[]);
    let target = 0.1 * (turn(angle) - rest(angle)) + rest(angle);
    let returned = super::first_passage(free, target, turn(angle) < rest(angle)).map(|i| i * t);
    out.figure("time to 90 % of the return", returned, "s");
    let rate: Vec<f64> = free.windows(2).map(|w| (w[1] - w[0]) / t).collect();
    out.figure("largest return rate", Some(peak(&rate).to_degrees()), "°/s");
    let final_angle = rest(angle);
    let side = (turn(angle) - final_angle).signum();
    let past = free.iter().map(|a| -side * (a - final_angle)).fold(0.0, f64::max);
    out.figure("overshoot of the return", Some(100.0 * past / (turn(angle) - final_angle).abs()), "%");
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swinging_return_has_its_textbook_overshoot() {
        let (t, n, release_s) = (1e-3, 8000, 3.0);
        let (w, damping) = (std::f64::consts::TAU * 1.2, 0.4_f64);
        let root = (1.0 - damping * damping).sqrt();
        let (turn, rest) = (0.8, 0.1);
        let angle = |time: f64| {
            let tau = time - release_s;
            if tau < 0.0 {
                return turn;
            }
            let swing = (w * root * tau).cos() + damping / root * (w * root * tau).sin();
            rest + (turn - rest) * (-damping * w * tau).exp() * swing
        };
        let column = |value: &dyn Fn(f64) -> f64| (0..n).map(|i| value(i as f64 * t)).collect::<Vec<_>>();
        let signals = Signals {
            sample_time_s: t,
            hand_wheel_angle_rad: column(&angle),
            hand_wheel_torque_n_m: column(&|time| if time < release_s { 3.0 } else { 0.02 }),
            lateral_acceleration_m_s2: column(&|time| 4.0 * angle(time)),
            yaw_rate_rad_s: column(&|time| 0.2 * angle(time)),
            yaw_rad: column(&|_| 0.0),
            roll_rad: column(&|_| 0.0),
            side_slip_rad: column(&|_| 0.0),
            speed_m_s: column(&|_| 16.7),
            x_m: column(&|_| 0.0),
            y_m: column(&|_| 0.0),
        };
        let out = release(&signals, release_s);
        assert!(out.valid(), "{:?}", out.conditions);
        let overshoot = 100.0 * (-std::f64::consts::PI * damping / root).exp();
        assert!((out.value("overshoot of the return").unwrap() - overshoot).abs() < 0.2, "{out:?}");
        assert!((out.value("residual hand-wheel angle over that in the turn").unwrap() - 12.5).abs() < 0.05);
        let mut held = signals;
        held.hand_wheel_torque_n_m.fill(3.0);
        let out = release(&held, release_s);
        assert!(out.figures[0].value.as_ref().unwrap_err().contains("free hand wheel 3"));
    }
}
