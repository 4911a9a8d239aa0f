//! Sine with dwell: FMVSS 126 (49 CFR 571.126, S5.2, S7.9), UN R13-H annex 9, ISO 19365.
//!
//! The hand wheel makes one 0.7 Hz sine with 0.5 s of dwell at its second peak. Beginning of steer: the
//! hand wheel passes 5° [S7.11.4 to .6; there with a rate trigger], here after the low pass; completion of steer: its
//! return to zero after the dwell. Yaw-rate ratios: yaw rate 1.00 s and 1.75 s after completion over the first
//! peak of the yaw rate after the hand wheel's change of sign. Lateral displacement of the centre of gravity
//! 1.07 s after the beginning, in the frame of the course at the beginning; here from the position itself,
//! not by integrating an accelerometer twice. Filters as in S7.11: hand wheel 10 Hz, yaw rate 6 Hz, phaseless.

use super::{Assessment, CarFacts, Signals, mean_of};
use crate::filter::LowPass;
use crate::statistics::peak;

/// Figures of one sine with dwell. `amplitude_at_0_3_g_rad`: hand-wheel angle A that gives 0.3 g in the slowly
/// increasing steer test, if known; the displacement rule holds from 5 A on.
pub fn sine_with_dwell(signals: &Signals, amplitude_at_0_3_g_rad: Option<f64>, car: &CarFacts) -> Assessment {
    let mut out = Assessment::new("sine with dwell, FMVSS 126 / ISO 19365");
    let t = signals.sample_time_s;
    let n = signals.len();
    let filtered = |values: &[f64], corner: f64| {
        LowPass::butterworth(corner, t).map_or_else(|| values[..n].to_vec(), |f| f.zero_phase(&values[..n]))
    };
    let angle = filtered(&signals.hand_wheel_angle_rad, 10.0);
    let yaw = filtered(&signals.yaw_rate_rad_s, 6.0);
    let top = peak(&angle);
    let threshold = 5_f64.to_radians();
    let begin = (top > 3.0 * threshold).then(|| angle.iter().position(|a| a.abs() >= threshold)).flatten();
    let side = begin.map_or(1.0, |i| angle[i].signum());
    let oriented: Vec<f64> = angle.iter().map(|a| side * a).collect();
    let reversal = begin.and_then(|from| (from..n).find(|&i| oriented[i] < 0.0));
    let deep = reversal.and_then(|from| (from..n).find(|&i| oriented[i] < -0.9 * top));
    let completion = deep.and_then(|from| (from..n).find(|&i| oriented[i] >= -0.005 * top));
    // First local peak of the yaw rate in the second direction.
    let first_peak = reversal.and_then(|from| {
        let upto = completion.map_or(n, |c| (c + (1.0 / t) as usize).min(n));
        let largest = (from..upto).map(|i| -side * yaw[i]).fold(0.0, f64::max);
        (from + 1..upto.saturating_sub(1)).find(|&i| {
            -side * yaw[i] > 0.3 * largest
                && side * yaw[i] <= side * yaw[i - 1]
                && side * yaw[i] < side * yaw[i + 1]
        })
    });
    let after = |seconds: f64| completion.map(|c| c + (seconds / t).round() as usize).filter(|&i| i < n);
    let speed = begin.map_or(f64::NAN, |i| 3.6 * signals.speed_m_s[i]);
    let duration = begin.zip(completion).map_or(f64::NAN, |(a, b)| (b - a) as f64 * t);
    out.condition("speed at the beginning of steer", speed, 78.0, 82.0, "km/h");
    // One period of 1/0.7 s and the dwell, less the 5° before the begin.
    out.condition("duration of steering", duration, 1.80, 2.0, "s");
    let still = begin.map_or(f64::NAN, |i| {
        mean_of(
            &signals.yaw_rate_rad_s,
            i.saturating_sub((0.4 / t) as usize)..i.saturating_sub((0.2 / t) as usize),
        )
    });
    out.condition("yaw rate before", still.to_degrees().abs(), 0.0, 0.5, "°/s");
    let normalised = amplitude_at_0_3_g_rad.map(|a| top / a);
    out.figure("hand-wheel amplitude", Some(top.to_degrees()), "°");
    let over = "hand-wheel amplitude over that of 0.3 g";
    out.figure(over, normalised, "1");
    out.figure("first peak of the yaw rate", first_peak.map(|i| yaw[i].to_degrees()), "°/s");
    let ratio = |seconds: f64| first_peak.zip(after(seconds)).map(|(p, i)| 100.0 * yaw[i] / yaw[p]);
    out.figure("yaw rate ratio 1.00 s after completion", ratio(1.0), "%");
    out.figure("yaw rate ratio 1.75 s after completion", ratio(1.75), "%");
    let displacement = begin.and_then(|i| {
        let j = i + (1.07 / t).round() as usize;
        let (dx, dy) = (signals.x_m.get(j)? - signals.x_m[i], signals.y_m.get(j)? - signals.y_m[i]);
        // Course = heading plus side slip.
        let (s, c) = (signals.yaw_rad[i] + signals.side_slip_rad[i]).sin_cos();
        Some(side * (-s * dx + c * dy))
    });
    out.figure("lateral displacement 1.07 s after the beginning", displacement, "m");
    out.rule("yaw rate ratio at 1.00 s at most 35 %", &["yaw rate ratio 1.00 s after completion"], |v| {
        v[0] <= 35.0
    });
    out.rule("yaw rate ratio at 1.75 s at most 20 %", &["yaw rate ratio 1.75 s after completion"], |v| {
        v[0] <= 20.0
    });
    let (rule, least) = if car.mass_kg <= 3500.0 {
        ("lateral displacement at least 1.83 m from 5 A on", 1.83)
    } else {
        ("lateral displacement at least 1.52 m from 5 A on", 1.52)
    };
    match normalised {
        Some(n) if n >= 5.0 => {
            out.rule(rule, &["lateral displacement 1.07 s after the beginning"], |v| v[0] >= least);
        }
        Some(n) => out
            .rulings
            .push(super::Ruling { rule, kept: Err(format!("holds from 5 A on; this run has {n:.2} A")) }),
        None => out.rulings.push(super::Ruling {
            rule,
            kept: Err("the hand-wheel angle A at 0.3 g is not known".to_owned()),
        }),
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handling::tests::CAR;

    /// A car whose yaw rate is proportional to the angle until the completion of steer, then decays.
    fn run(decay_s: f64, side: f64) -> Signals {
        let (t, f, n) = (1e-3, 0.7, 8000);
        let start = 1.0;
        let steer = |time: f64| {
            let tau = time - start;
            let quarter = 0.75 / f;
            if tau < 0.0 || tau > 1.0 / f + 0.5 {
                0.0
            } else if tau < quarter {
                (std::f64::consts::TAU * f * tau).sin()
            } else if tau < quarter + 0.5 {
                -1.0
            } else {
                (std::f64::consts::TAU * f * (tau - 0.5)).sin()
            }
        };
        let amplitude = side * 100_f64.to_radians();
        let end = start + 1.0 / f + 0.5;
        // The car holds its peak yaw rate until the completion and then lets it decay.
        let dwell = start + 0.75 / f;
        let yaw = |time: f64| {
            if time < dwell {
                0.5 * steer(time)
            } else if time < end {
                -0.5 + 0.01 * (time - dwell)
            } else {
                -0.5 * (-(time - end) / decay_s).exp()
            }
        };
        let column = |value: &dyn Fn(f64) -> f64| (0..n).map(|i| value(i as f64 * t)).collect::<Vec<_>>();
        Signals {
            sample_time_s: t,
            hand_wheel_angle_rad: column(&|time| amplitude * steer(time)),
            hand_wheel_torque_n_m: column(&|_| 0.0),
            lateral_acceleration_m_s2: column(&|_| 0.0),
            yaw_rate_rad_s: column(&|time| side * yaw(time)),
            yaw_rad: column(&|_| 0.3),
            roll_rad: column(&|_| 0.0),
            side_slip_rad: column(&|_| 0.0),
            speed_m_s: column(&|_| 80.0 / 3.6),
            // Straight on a course of 0.3 rad, with 2 m/s of sideways motion from the start of steer.
            x_m: column(&|time| {
                22.0 * time * 0.3_f64.cos() - side * 2.0 * (time - start).max(0.0) * 0.3_f64.sin()
            }),
            y_m: column(&|time| {
                22.0 * time * 0.3_f64.sin() + side * 2.0 * (time - start).max(0.0) * 0.3_f64.cos()
            }),
        }
    }

    #[test]
    fn ratios_and_displacement_of_a_known_decay_on_both_sides() {
        for side in [1.0, -1.0] {
            let out = sine_with_dwell(&run(0.7, side), Some(18_f64.to_radians()), &CAR);
            assert!(out.valid(), "{:?}", out.conditions);
            let at = |s: f64| 100.0 * (-s / 0.7_f64).exp();
            assert!(
                (out.value("yaw rate ratio 1.00 s after completion").unwrap() - at(1.0)).abs() < 1.0,
                "{out:?}"
            );
            assert!((out.value("yaw rate ratio 1.75 s after completion").unwrap() - at(1.75)).abs() < 0.5);
            assert!(
                (out.value("lateral displacement 1.07 s after the beginning").unwrap() - 2.14).abs() < 0.01
            );
            assert!(out.rulings.iter().all(|r| r.kept == Ok(true)), "{:?}", out.rulings);
        }
    }

    #[test]
    fn a_car_that_goes_on_turning_fails_and_a_small_amplitude_is_not_judged() {
        let out = sine_with_dwell(&run(2.5, 1.0), Some(30_f64.to_radians()), &CAR);
        assert_eq!(out.rulings[0].kept, Ok(false));
        assert_eq!(out.rulings[1].kept, Ok(false));
        assert!(out.rulings[2].kept.as_ref().unwrap_err().contains("3.3"), "{:?}", out.rulings[2]);
        let unknown = sine_with_dwell(&run(0.5, 1.0), None, &CAR);
        assert!(unknown.rulings[2].kept.as_ref().unwrap_err().contains("not known"));
        let mut slow = run(0.5, 1.0);
        slow.speed_m_s.fill(60.0 / 3.6);
        let slow = sine_with_dwell(&slow, None, &CAR);
        assert!(slow.rulings[0].kept.as_ref().unwrap_err().contains("speed at the beginning of steer 60"));
    }
}
