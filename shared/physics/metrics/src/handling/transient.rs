//! Lateral transient response, ISO 7401: step input (clause 10) and random input (clause 12).
//!
//! Step: time counts from the instant at which the hand wheel has reached half of its steady change; the
//! response time is that to 90 % of the new steady state, the peak response time that to the first peak,
//! overshoot is peak over steady state minus 1. Steady state: the mean from 2.5 s to 4 s after the step.
//! "TB" is the vehicle characteristic T_ψ̇max·β: the product of the yaw rate's peak response time and the steady
//! side-slip angle. Random: gain and phase by [`super::frequency_response`].

use super::{Assessment, CarFacts, Signals, first_passage, frequency_response, mean_of};
use crate::filter::LowPass;
use crate::statistics::{mean, rms};

/// Corner of the low pass on motion signals. \[Hz\]
const CORNER_HZ: f64 = 10.0;

/// Figures of a step of the hand wheel (ISO 7401: 100 km/h, to 4 m/s²).
pub fn step_steer(signals: &Signals) -> Assessment {
    let mut out = Assessment::new("step input, ISO 7401 clause 10");
    let t = signals.sample_time_s;
    let n = signals.len();
    let filter = LowPass::butterworth(CORNER_HZ, t);
    let filtered =
        |values: &[f64]| filter.as_ref().map_or_else(|| values[..n].to_vec(), |f| f.zero_phase(&values[..n]));
    let angle = &signals.hand_wheel_angle_rad[..n];
    // The step: where the angle changes most within 0.1 s.
    let reach = ((0.1 / t) as usize).max(1);
    let change = |i: usize| (angle[i + reach] - angle[i]).abs();
    let steepest = (0..n.saturating_sub(reach)).max_by(|&a, &b| change(a).total_cmp(&change(b))).unwrap_or(0);
    let seconds = |s: f64| (s / t) as usize;
    let before = steepest.saturating_sub(seconds(1.0))..steepest.saturating_sub(seconds(0.2));
    let after = steepest + seconds(2.5)..(steepest + seconds(4.0)).min(n);
    let steady = |values: &[f64]| mean_of(values, after.clone());
    let start = |values: &[f64]| mean_of(values, before.clone());
    let (low, high) = (start(angle), steady(angle));
    let side = (high - low).signum();
    let normal = |values: &[f64], to: f64| -> Vec<f64> {
        let from = start(values);
        values.iter().map(|v| (v - from) / (to - from)).collect()
    };
    let wheel = normal(angle, high);
    let window_start = before.start;
    let passing = |values: &[f64], level: f64| {
        first_passage(values.get(window_start..).unwrap_or(&[]), level, true).map(|i| i + window_start as f64)
    };
    let half = passing(&wheel, 0.5);
    let rise = passing(&wheel, 0.1).zip(passing(&wheel, 0.9)).map(|(a, b)| (b - a) * t);
    let speed = &signals.speed_m_s[..n];
    let acceleration = filtered(&signals.lateral_acceleration_m_s2);
    let yaw = filtered(&signals.yaw_rate_rad_s);
    let slip = filtered(&signals.side_slip_rad);
    let level = |values: &[f64]| steady(values) - start(values);

    out.condition("speed before the step", 3.6 * mean_of(speed, before.clone()), 98.0, 102.0, "km/h");
    out.condition("time from 10 % to 90 % of the step", rise.unwrap_or(f64::NAN), 0.0, 0.15, "s");
    out.condition("steady lateral acceleration", side * level(&acceleration), 3.6, 4.4, "m/s²");
    let unrest = rms(&signals
        .yaw_rate_rad_s
        .get(before.clone())
        .unwrap_or(&[])
        .iter()
        .map(|r| r - start(&signals.yaw_rate_rad_s))
        .collect::<Vec<_>>());
    out.condition("yaw rate before the step, rms", unrest.to_degrees(), 0.0, 0.5, "°/s");
    out.condition("steady time after the step", after.len() as f64 * t, 1.4, f64::INFINITY, "s");

    out.figure("steady yaw rate gain", Some(level(&yaw) / (high - low)), "1/s");
    out.figure(
        "steady lateral acceleration gain",
        Some(level(&acceleration) / (high - low).to_degrees()),
        "m/s² per °",
    );
    let mut peak_time_yaw = None;
    for (signal, names) in [
        (&yaw, ["yaw rate response time", "yaw rate peak response time", "yaw rate overshoot"]),
        (
            &acceleration,
            [
                "lateral acceleration response time",
                "lateral acceleration peak response time",
                "lateral acceleration overshoot",
            ],
        ),
    ] {
        let relative = normal(signal, steady(signal));
        let response = half.zip(passing(&relative, 0.9)).map(|(a, b)| (b - a) * t);
        let top = half.map(|h| {
            let upto = (h as usize + seconds(2.0)).min(n);
            (h as usize..upto)
                .fold((h as usize, 0.0), |best, i| if relative[i] > best.1 { (i, relative[i]) } else { best })
        });
        out.figure(names[0], response, "s");
        let peaks = top.filter(|(_, value)| *value > 1.0);
        let peak_time = peaks.zip(half).map(|((i, _), h)| (i as f64 - h) * t);
        if names[1].starts_with("yaw") {
            peak_time_yaw = peak_time;
        }
        out.figure(names[1], peak_time, "s");
        out.figure(names[2], top.map(|(_, value)| 100.0 * (value - 1.0).max(0.0)), "%");
    }
    out.figure("steady side-slip angle", Some(level(&slip).to_degrees()), "°");
    let tb = peak_time_yaw.map(|time| time * (side * level(&slip)).to_degrees().abs());
    out.figure("TB value", tb, "s·°");
    out
}

/// Figures of random steering (ISO 7401 clause 12: 100 km/h, 0.2 to 2 Hz at least, linear range).
pub fn random_steer(signals: &Signals, car: &CarFacts) -> Assessment {
    let mut out = Assessment::new("random input, ISO 7401 clause 12");
    let t = signals.sample_time_s;
    // Ten samples in the fastest period are plenty: the sums need not run over every tick.
    let every = ((0.02 / t) as usize).max(1);
    let thin = |values: &[f64]| -> Vec<f64> {
        let smooth = LowPass::butterworth(15.0, t).map_or_else(|| values.to_vec(), |f| f.zero_phase(values));
        smooth.into_iter().step_by(every).collect()
    };
    let step = t * every as f64;
    let angle = thin(&signals.hand_wheel_angle_rad);
    let response = |values: &[f64]| frequency_response(&angle, &thin(values), step, 10.0, 0.2..=2.0);
    let yaw = response(&signals.yaw_rate_rad_s);
    let acceleration = response(&signals.lateral_acceleration_m_s2);
    let worst = |list: &[super::FrequencyResponse]| {
        list.iter().map(|r| r.coherence).reduce(f64::min).unwrap_or(f64::NAN)
    };
    out.condition("mean speed", 3.6 * mean(&signals.speed_m_s), 98.0, 102.0, "km/h");
    let top = crate::statistics::peak(&signals.lateral_acceleration_m_s2);
    out.condition("largest lateral acceleration", top, 0.5, 4.0, "m/s²");
    out.condition("least coherence of the yaw rate", worst(&yaw), 0.9, 1.0 + 1e-9, "1");
    let power = yaw.iter().map(|r| r.input_power_ratio).reduce(f64::min).unwrap_or(f64::NAN);
    out.condition("least input power over the band", power, 0.01, 1.0 + 1e-9, "1");
    let at = |list: &[super::FrequencyResponse], hz: f64| {
        list.iter()
            .min_by(|a, b| (a.frequency_hz - hz).abs().total_cmp(&(b.frequency_hz - hz).abs()))
            .copied()
    };
    let steady = at(&yaw, 0.2).map(|r| r.gain);
    out.figure("yaw rate gain at 0.2 Hz", steady, "1/s");
    let natural = yaw.iter().max_by(|a, b| a.gain.total_cmp(&b.gain)).copied();
    out.figure("frequency of the largest yaw rate gain", natural.map(|r| r.frequency_hz), "Hz");
    out.figure(
        "largest yaw rate gain over that at 0.2 Hz",
        natural.zip(steady).map(|(r, s)| r.gain / s),
        "1",
    );
    // Bandwidth: where the phase passes −45 degrees [Weir, DiMarco, SAE 780010].
    let crossing = yaw
        .windows(2)
        .find(|w| w[0].phase_rad > -45_f64.to_radians() && w[1].phase_rad <= -45_f64.to_radians());
    let bandwidth = crossing.map(|w| {
        let part = (w[0].phase_rad + 45_f64.to_radians()) / (w[0].phase_rad - w[1].phase_rad);
        w[0].frequency_hz + part * (w[1].frequency_hz - w[0].frequency_hz)
    });
    out.figure("frequency of −45° of the yaw rate", bandwidth, "Hz");
    out.figure("yaw rate phase at 1 Hz", at(&yaw, 1.0).map(|r| r.phase_rad.to_degrees()), "°");
    out.figure(
        "lateral acceleration gain at 0.2 Hz",
        at(&acceleration, 0.2).map(|r| r.gain.to_radians()),
        "m/s² per °",
    );
    out.figure(
        "lateral acceleration phase at 1 Hz",
        at(&acceleration, 1.0).map(|r| r.phase_rad.to_degrees()),
        "°",
    );
    // The linear car's steady yaw gain v/(L + K v²)/i_S gives the characteristic speed.
    let v = mean(&signals.speed_m_s);
    let characteristic = steady.and_then(|gain| {
        let k = v / (gain * car.steering_ratio * car.wheelbase_m) - 1.0;
        (k > 0.0).then(|| 3.6 * v / k.sqrt())
    });
    out.figure("characteristic speed from the gain at 0.2 Hz", characteristic, "km/h");
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handling::tests::CAR;

    /// Second-order yaw response of known frequency and damping to a fast step, started at rest at 2 s.
    fn second_order(speed_km_h: f64, damping: f64, rise_s: f64) -> Signals {
        let (t, n, w) = (1e-3, 9000, std::f64::consts::TAU);
        let wheel: Vec<f64> = (0..n).map(|i| 0.6 * ((i as f64 * t - 2.0) / rise_s).clamp(0.0, 1.0)).collect();
        let (mut x, mut v) = (0.0, 0.0);
        let mut yaw = Vec::new();
        for u in &wheel {
            // Fine steps: the truth must not owe anything to the sampling.
            for _ in 0..10 {
                v += t / 10.0 * (w * w * (0.3 * u - x) - 2.0 * damping * w * v);
                x += t / 10.0 * v;
            }
            yaw.push(x);
        }
        let zero = vec![0.0; n];
        Signals {
            sample_time_s: t,
            lateral_acceleration_m_s2: yaw.iter().map(|r| r * 4.0 / 0.18).collect(),
            side_slip_rad: yaw.iter().map(|r| -0.1 * r).collect(),
            yaw_rate_rad_s: yaw,
            hand_wheel_angle_rad: wheel,
            hand_wheel_torque_n_m: zero.clone(),
            yaw_rad: zero.clone(),
            roll_rad: zero.clone(),
            speed_m_s: vec![speed_km_h / 3.6; n],
            x_m: zero.clone(),
            y_m: zero,
        }
    }

    #[test]
    fn a_second_order_car_has_its_textbook_step_figures() {
        let damping: f64 = 0.5;
        let out = step_steer(&second_order(100.0, damping, 0.02));
        assert!(out.valid(), "{:?}", out.conditions);
        let root = (1.0 - damping * damping).sqrt();
        let overshoot = 100.0 * (-std::f64::consts::PI * damping / root).exp();
        let peak_time = 0.5 / root;
        assert!((out.value("yaw rate overshoot").unwrap() - overshoot).abs() < 0.3, "{out:?}");
        assert!((out.value("yaw rate peak response time").unwrap() - peak_time).abs() < 0.006);
        assert!((out.value("steady yaw rate gain").unwrap() - 0.3).abs() < 1e-3);
        let tb = peak_time * (0.1_f64 * 0.18).to_degrees();
        assert!((out.value("TB value").unwrap() / tb - 1.0).abs() < 0.02);
        // Of a strongly damped one there is no peak to time.
        let slow = step_steer(&second_order(100.0, 1.2, 0.02));
        assert!(slow.value("yaw rate peak response time").is_none());
        assert!(slow.value("yaw rate overshoot").unwrap() < 0.01);
    }

    #[test]
    fn a_slow_hand_or_wrong_speed_withholds() {
        let slow_hand = step_steer(&second_order(100.0, 0.7, 0.5));
        assert!(slow_hand.figures[0].value.as_ref().unwrap_err().contains("10 % to 90 %"));
        let slow_car = step_steer(&second_order(80.0, 0.7, 0.05));
        assert!(slow_car.figures[0].value.as_ref().unwrap_err().contains("speed before the step 80"));
    }

    #[test]
    fn random_steering_finds_a_known_car() {
        let (t, n) = (2e-3, 60_000);
        let wheel: Vec<f64> = (0..n)
            .map(|i| {
                let time = i as f64 * t;
                (1..=60)
                    .map(|k| {
                        0.01 * (std::f64::consts::TAU * 0.05 * f64::from(k) * time + f64::from(k * k)).sin()
                    })
                    .sum()
            })
            .collect();
        let (mut x, lag) = (0.0, 0.2);
        let yaw: Vec<f64> = wheel
            .iter()
            .map(|u| {
                for _ in 0..10 {
                    x += t / 10.0 * (0.25 * u - x) / lag;
                }
                x
            })
            .collect();
        let zero = vec![0.0; n];
        let signals = Signals {
            sample_time_s: t,
            lateral_acceleration_m_s2: yaw.iter().map(|r| 100.0 / 3.6 * r).collect(),
            yaw_rate_rad_s: yaw,
            hand_wheel_angle_rad: wheel,
            hand_wheel_torque_n_m: zero.clone(),
            yaw_rad: zero.clone(),
            roll_rad: zero.clone(),
            side_slip_rad: zero.clone(),
            speed_m_s: vec![100.0 / 3.6; n],
            x_m: zero.clone(),
            y_m: zero,
        };
        let out = random_steer(&signals, &CAR);
        assert!(out.valid(), "{:?}", out.conditions);
        let at = |hz: f64| 1.0 / (1.0 + (std::f64::consts::TAU * hz * lag).powi(2)).sqrt();
        assert!((out.value("yaw rate gain at 0.2 Hz").unwrap() / (0.25 * at(0.2)) - 1.0).abs() < 0.03);
        // A first-order lag passes −45° at 1/(2π·lag).
        let corner = 1.0 / (std::f64::consts::TAU * lag);
        assert!((out.value("frequency of −45° of the yaw rate").unwrap() / corner - 1.0).abs() < 0.03);
        let phase = -(std::f64::consts::TAU * lag).atan().to_degrees();
        assert!((out.value("yaw rate phase at 1 Hz").unwrap() - phase).abs() < 2.0);
    }
}
