//! Each input has the values that its definition gives, its rate is its derivative, and nothing jumps that
//! should not.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use config::scenario::{Frequencies, Record, Scenario, Speed, Steer};
use config::{RecordedHistory, TimeSeries, load};
use manoeuvre::{DriverCommand, HandWheel, Manoeuvre, ManoeuvreError};
use proptest::prelude::*;

fn shipped(name: &str) -> Scenario {
    load::<Scenario>(name).unwrap_or_else(|problems| panic!("{name}:\n{problems}")).value
}

fn manoeuvre(name: &str) -> (Scenario, Manoeuvre) {
    let scenario = shipped(name);
    let manoeuvre = Manoeuvre::new(&scenario, None).unwrap();
    (scenario, manoeuvre)
}

/// Angle in degrees at manoeuvre time.
fn deg(scenario: &Scenario, manoeuvre: &Manoeuvre, tau: f64) -> f64 {
    manoeuvre.at(tau + scenario.warm_up_s).steering_wheel_angle_rad.to_degrees()
}

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} is not {b} within {tolerance}");
}

#[test]
fn growing_slalom_grows_linearly_to_its_last_amplitude() {
    let (s, m) = manoeuvre("growing_slalom_80");
    // Peaks of 0.3 Hz at quarter periods: amplitude there is 75·(τ/T), T = 10 periods.
    for quarter in [1.0, 5.0, 21.0, 37.0] {
        let tau = quarter / 4.0 / 0.3;
        close(deg(&s, &m, tau), 75.0 * (quarter / 40.0), 1e-9);
    }
    close(deg(&s, &m, 3.0 / 4.0 / 0.3), -75.0 * 3.0 / 40.0, 1e-9);
    close(deg(&s, &m, 10.5 / 0.3 + 1e-9), 0.0, 1e-9);
    close(m.at(10.0).target_speed_m_s, 80.0 / 3.6, 1e-12);
}

#[test]
fn weave_is_a_sine_of_a_fifth_of_a_hertz() {
    let (s, m) = manoeuvre("weave_100");
    let Steer::Weave(weave) = &s.steer else { panic!() };
    close(deg(&s, &m, weave.start_s + 5.0 + 1.25), weave.amplitude_deg, 1e-9);
    close(deg(&s, &m, weave.start_s + 15.0 + 3.75), -weave.amplitude_deg, 1e-9);
    assert_eq!(m.active_window_s(), (s.warm_up_s + weave.start_s, s.warm_up_s + weave.start_s + 50.0));
}

#[test]
fn lane_change_is_one_period() {
    let (s, m) = manoeuvre("lane_change_120");
    for (tau, angle) in [(0.9, 0.0), (1.25, 45.0), (1.5, 0.0), (1.75, -45.0), (2.1, 0.0)] {
        close(deg(&s, &m, tau), angle, 1e-9);
    }
    assert!(!m.at(s.warm_up_s + 0.99).active && m.at(s.warm_up_s + 1.01).active && !m.at(6.0).active);
}

#[test]
fn sine_with_dwell_dwells_half_a_second_at_three_quarters() {
    let (s, m) = manoeuvre("sine_with_dwell_80");
    let Steer::SineWithDwell(sine) = &s.steer else { panic!() };
    let (begin, period) = (sine.start_s, 1.0 / 0.7);
    close(deg(&s, &m, begin + 0.25 * period), 100.0, 1e-9);
    for share in [0.0, 0.3, 0.999] {
        close(deg(&s, &m, begin + 0.75 * period + share * 0.5), -100.0, 1e-9);
    }
    close(deg(&s, &m, begin + 0.5 + 0.875 * period), -100.0 * 0.5_f64.sqrt(), 1e-9);
    close(deg(&s, &m, begin + 0.5 + period), 0.0, 1e-9);
    // The regulation measures from the end of steer: 1/f + dwell after its begin.
    close(m.active_window_s().1, s.warm_up_s + begin + 0.5 + period, 1e-12);
    // The car coasts.
    assert_eq!(m.at(4.0).pedals.unwrap().throttle, 0.0);
}

#[test]
fn step_rises_in_its_time_with_its_peak_rate() {
    let (s, m) = manoeuvre("step_100");
    close(deg(&s, &m, 1.075), 19.0, 1e-9);
    close(deg(&s, &m, 1.15), 38.0, 1e-12);
    close(deg(&s, &m, 6.0), 38.0, 1e-12);
    let rate = m.at(s.warm_up_s + 1.075).steering_wheel_rate_rad_s.to_degrees();
    close(rate, std::f64::consts::FRAC_PI_2 * 38.0 / 0.15, 1e-6);
}

#[test]
fn ramp_has_its_rate_and_comes_back() {
    let (s, m) = manoeuvre("ramp_80");
    let rate = |tau: f64| m.at(s.warm_up_s + tau).steering_wheel_rate_rad_s.to_degrees();
    close(rate(2.0), 13.5, 1e-9);
    close(deg(&s, &m, 1.0 + 60.0 / 13.5 + 0.1), 60.0, 1e-9);
    close(rate(6.5), 0.0, 1e-9);
    close(rate(9.5), -13.5, 1e-9);
    close(deg(&s, &m, 12.9), 0.0, 1e-9);
}

#[test]
fn parking_reaches_both_sides_at_its_rate() {
    let (s, m) = manoeuvre("parking");
    let angles: Vec<f64> = (0..s.ticks()).map(|n| deg(&s, &m, n as f64 * 1e-3 - s.warm_up_s)).collect();
    let [low, high] = [f64::min, f64::max].map(|f| angles.iter().copied().fold(0.0, f));
    close(high, 360.0, 1e-9);
    close(low, -360.0, 1e-9);
    close(*angles.last().unwrap(), 0.0, 1e-9);
    let fastest = angles.windows(2).map(|pair| (pair[1] - pair[0]).abs() / 1e-3).fold(0.0, f64::max);
    close(fastest, 120.0, 1e-6);
}

#[test]
fn random_steer_has_its_rms_stays_in_its_band_and_follows_its_seed() {
    let (s, m) = manoeuvre("random_100");
    let sum: f64 = (3000..60000).map(|i| deg(&s, &m, f64::from(i) * 1e-3).powi(2)).sum();
    let rms = (sum / 57000.0).sqrt();
    assert!((rms / 12.0 - 1.0).abs() < 0.1, "{rms}");
    // Projections on sines: power in the band, none well outside.
    let power = |hz: f64| {
        let (mut re, mut im) = (0.0, 0.0);
        for i in 0..5000 {
            let tau = 5.0 + f64::from(i) * 1e-2;
            let window = (std::f64::consts::PI * f64::from(i) / 5000.0).sin().powi(2);
            let (sine, cosine) = (std::f64::consts::TAU * hz * tau).sin_cos();
            re += window * deg(&s, &m, tau) * cosine;
            im += window * deg(&s, &m, tau) * sine;
        }
        re * re + im * im
    };
    let inside: f64 = (4..=56).map(|k| power(f64::from(k) * 0.05)).sum::<f64>() / 53.0;
    assert!(power(4.0) < 1e-4 * inside && power(8.0) < 1e-4 * inside);
    let other = Manoeuvre::new(&Scenario { seed: s.seed + 1, ..s.clone() }, None).unwrap();
    assert!(other.at(20.0) != m.at(20.0));
    assert!(Manoeuvre::new(&s, None).unwrap().at(20.0) == m.at(20.0));
}

#[test]
fn hands_go_off_and_pedals_come_on() {
    let (s, m) = manoeuvre("returnability_60");
    assert_eq!(m.at(s.warm_up_s + 4.99).hand_wheel, HandWheel::Commanded);
    assert_eq!(m.at(s.warm_up_s + 5.0).hand_wheel, HandWheel::Free);
    let (s, m) = manoeuvre("split_friction_braking_100");
    assert_eq!(m.at(s.warm_up_s + 1.9).pedals, None);
    close(m.at(s.warm_up_s + 2.1).pedals.unwrap().brake_pressure_pa, 3e6, 1e-6);
    close(m.at(s.warm_up_s + 9.0).pedals.unwrap().brake_pressure_pa, 6e6, 1e-6);
}

#[test]
fn wind_blows_where_it_is_told() {
    let mut scenario = shipped("step_100");
    let wind = config::scenario::Crosswind {
        speed_m_s: 20.0,
        direction_deg: 90.0,
        start_s: 1.0,
        end_s: 4.0,
        rise_s: 0.5,
    };
    scenario.road.crosswind = Some(wind);
    let m = Manoeuvre::new(&scenario, None).unwrap();
    assert_eq!(m.wind_m_s(0.0), [0.0, 0.0]);
    let [x, y] = m.wind_m_s(scenario.warm_up_s + 2.0);
    close(x, 0.0, 1e-12);
    close(y, 20.0, 1e-12);
    close(m.wind_m_s(scenario.warm_up_s + 1.25)[1], 10.0, 1e-9);
}

/// Everything but the abrupt standard inputs: no jump of the rate, and the rate is the derivative.
#[test]
fn rates_are_derivatives_and_do_not_jump() {
    let abrupt = ["lane_change_120", "sine_with_dwell_80"];
    for file in config::Library::list(config::Kind::Scenario) {
        let scenario = shipped(file.name);
        if matches!(scenario.steer, Steer::RecordedHistory(_)) {
            continue;
        }
        let m = Manoeuvre::new(&scenario, None).unwrap();
        let h = 1e-4;
        let count = ((scenario.duration_s / h) as usize).min(400_000);
        let mut before = m.at(0.0);
        let mut largest: f64 = 0.0;
        for i in 1..count {
            let now = m.at(i as f64 * h);
            if before.hand_wheel == now.hand_wheel {
                let mean = (now.steering_wheel_angle_rad - before.steering_wheel_angle_rad) / h;
                let of_rates = 0.5 * (now.steering_wheel_rate_rad_s + before.steering_wheel_rate_rad_s);
                let jump = (now.steering_wheel_rate_rad_s - before.steering_wheel_rate_rad_s).abs();
                if !abrupt.contains(&file.name) {
                    assert!((mean - of_rates).abs() < 1e-3, "{} at {}", file.name, i as f64 * h);
                    largest = largest.max(jump);
                }
            }
            before = now;
        }
        assert!(largest < 0.06, "{}: the rate jumps by {largest} rad/s", file.name);
    }
}

fn recorded() -> (Scenario, RecordedHistory) {
    let mut scenario = shipped("double_lane_change_measured");
    scenario.duration_s = 8.0;
    scenario.record = Some(Record { directory: None, start_s: 0.0, fade_in_s: 0.5 });
    let time_s: Vec<f64> = (0..1400).map(|i| f64::from(i) * 5e-3 - 1.0).collect();
    let angle = time_s.iter().map(|t| 0.5 * (3.0 * t).sin()).collect();
    let speed = time_s.iter().map(|t| 19.0 - 0.1 * t).collect();
    let history = RecordedHistory {
        steering_wheel_angle_rad: Some(TimeSeries { time_s: time_s.clone(), value: angle }),
        speed_m_s: Some(TimeSeries { time_s, value: speed }),
        measured: Vec::new(),
    };
    (scenario, history)
}

#[test]
fn a_recorded_history_is_replayed_faded_in_and_then_exact() {
    let (scenario, history) = recorded();
    let m = Manoeuvre::new(&scenario, Some(&history)).unwrap();
    assert_eq!(m.at(scenario.warm_up_s).steering_wheel_angle_rad, 0.0);
    assert_eq!(m.at(0.0).steering_wheel_angle_rad, 0.0);
    close(m.initial_speed_m_s(), 19.0, 1e-3);
    for i in 600..4000 {
        let tau = f64::from(i) * 1e-3;
        let command = m.at(tau + scenario.warm_up_s);
        close(command.steering_wheel_angle_rad, 0.5 * (3.0 * tau).sin(), 1e-4);
        close(command.steering_wheel_rate_rad_s, 1.5 * (3.0 * tau).cos(), 1e-2);
        close(command.target_speed_m_s, 19.0 - 0.1 * tau, 1e-3);
    }
}

#[test]
fn a_missing_history_is_an_error() {
    let (scenario, history) = recorded();
    assert_eq!(Manoeuvre::new(&scenario, None), Err(ManoeuvreError::SpeedRecordMissing));
    let half = RecordedHistory { steering_wheel_angle_rad: None, ..history };
    assert_eq!(Manoeuvre::new(&scenario, Some(&half)), Err(ManoeuvreError::SteeringRecordMissing));
}

#[test]
fn a_time_that_is_not_finite_gives_a_finite_command() {
    let (_, m) = manoeuvre("growing_slalom_80");
    for time in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300] {
        assert!(finite(&m.at(time)), "{time}");
    }
}

fn finite(command: &DriverCommand) -> bool {
    command.steering_wheel_angle_rad.is_finite()
        && command.steering_wheel_rate_rad_s.is_finite()
        && command.target_speed_m_s.is_finite()
        && command.target_acceleration_m_s2.is_finite()
}

proptest! {
    #[test]
    fn any_valid_parameters_give_finite_commands(
        start_s in 0.0..100.0_f64,
        length in 0.3..50.0_f64,
        low_hz in 0.01..10.0_f64,
        wide in 0.01..40.0_f64,
        rms_deg in 0.01..300.0_f64,
        times in proptest::collection::vec(-10.0..200.0_f64, 20),
    ) {
        let mut scenario = shipped("random_100");
        scenario.steer = Steer::Random(config::scenario::RandomSteer {
            start_s, end_s: start_s + length, rms_deg,
            band: Frequencies { low_hz, high_hz: low_hz + wide }, components: 16, fade_s: 0.15,
        });
        scenario.speed = Speed::Profile { time_s: vec![0.0, start_s + 0.1], speed_km_h: vec![0.0, 250.0] };
        let m = Manoeuvre::new(&scenario, None).unwrap();
        for time in times {
            prop_assert!(finite(&m.at(time)));
        }
    }
}
