//! Steady-state circular driving, ISO 4138: understeer, side-slip, roll and torque gradients over lateral
//! acceleration.
//!
//! Understeer gradient [ISO 4138, 9; Milliken: Race Car Vehicle Dynamics, 5]: U = (1/i_S)·dδ_H/da_y at
//! constant radius; at constant speed the Ackermann angle L·a_y/v² grows too, so U = (1/i_S)·dδ_H/da_y −
//! L/v². Gradients are least-squares lines over the lateral acceleration from 1 to 4 m/s², and local ones at
//! 2 and 4 m/s² over ±0.5 m/s². A run is steady enough while the speed changes slowly: the lateral jerk is a
//! condition.

use super::{Assessment, CarFacts, Signals};
use crate::filter::LowPass;
use crate::fit::{Line, line};
use crate::statistics::{mean, peak};

/// How the lateral acceleration was raised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SteadyMethod {
    /// On a circle, by speed. The radius in m.
    ConstantRadius(f64),
    /// At a speed, by the hand wheel.
    ConstantSpeed,
}

/// Corner of the low pass: the manoeuvre is slow. \[Hz\]
const CORNER_HZ: f64 = 0.5;

/// Figures of a slow, quasi-steady rise of lateral acceleration.
pub fn steady_turn(signals: &Signals, method: SteadyMethod, car: &CarFacts) -> Assessment {
    let mut out = Assessment::new("steady-state circular driving, ISO 4138");
    let t = signals.sample_time_s;
    let n = signals.len();
    let filter = LowPass::butterworth(CORNER_HZ, t);
    let filtered =
        |values: &[f64]| filter.as_ref().map_or_else(|| values[..n].to_vec(), |f| f.zero_phase(&values[..n]));
    let acceleration: Vec<f64> = filtered(&signals.lateral_acceleration_m_s2);
    let side = mean(&acceleration).signum();
    let acceleration: Vec<f64> = acceleration.iter().map(|a| side * a).collect();
    let upto =
        acceleration.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(i, _)| i + 1);
    // The rise from 1 m/s² to the top, once.
    let from = acceleration[..upto].iter().rposition(|&a| a < 1.0).map_or(0, |i| i + 1);
    let window = from..upto;
    let jerk = acceleration[window.clone()].windows(2).map(|w| (w[1] - w[0]) / t).collect::<Vec<_>>();
    let top = acceleration.get(upto.wrapping_sub(1)).copied().unwrap_or(f64::NAN);
    out.condition("largest lateral acceleration", top, 4.0, f64::INFINITY, "m/s²");
    out.condition("largest lateral jerk", peak(&jerk), 0.0, 0.5, "m/s³");
    let speed = filtered(&signals.speed_m_s);
    let in_window = |values: &[f64]| values[window.clone()].to_vec();
    match method {
        SteadyMethod::ConstantRadius(radius_m) => {
            let deviation: Vec<f64> =
                window.clone().map(|i| speed[i] * speed[i] / acceleration[i] / radius_m - 1.0).collect();
            out.condition(
                "largest deviation of v²/a_y from the radius",
                100.0 * peak(&deviation),
                0.0,
                10.0,
                "%",
            );
        }
        SteadyMethod::ConstantSpeed => {
            let deviation = super::on_centre::speed_deviation_km_h(&in_window(&speed));
            out.condition("largest deviation of speed", deviation, 0.0, 3.0, "km/h");
        }
    }
    let x = in_window(&acceleration);
    let oriented =
        |values: &[f64]| -> Vec<f64> { in_window(&filtered(values)).iter().map(|v| side * v).collect() };
    let angle = oriented(&signals.hand_wheel_angle_rad);
    let torque = oriented(&signals.hand_wheel_torque_n_m);
    let slip = oriented(&signals.side_slip_rad);
    let roll = oriented(&signals.roll_rad);
    let over = |y: &[f64], low: f64, high: f64| -> Option<Line> {
        let (a, b): (Vec<f64>, Vec<f64>) =
            x.iter().zip(y).filter(|(a, _)| (low..=high).contains(*a)).map(|(a, b)| (*a, *b)).unzip();
        line(&a, &b)
    };
    let ackermann = match method {
        SteadyMethod::ConstantRadius(_) => 0.0,
        SteadyMethod::ConstantSpeed => car.wheelbase_m / mean(&in_window(&speed)).powi(2),
    };
    let understeer =
        |low, high| over(&angle, low, high).map(|l| (l.slope / car.steering_ratio - ackermann).to_degrees());
    out.figure("understeer gradient, 1 to 4 m/s²", understeer(1.0, 4.0), "° per m/s²");
    out.figure("understeer gradient at 2 m/s²", understeer(1.5, 2.5), "° per m/s²");
    out.figure("understeer gradient at 4 m/s²", understeer(3.5, 4.5), "° per m/s²");
    out.figure(
        "steering-wheel angle gradient",
        over(&angle, 1.0, 4.0).map(|l| l.slope.to_degrees()),
        "° per m/s²",
    );
    out.figure("side-slip angle gradient", over(&slip, 1.0, 4.0).map(|l| l.slope.to_degrees()), "° per m/s²");
    out.figure("roll angle gradient", over(&roll, 1.0, 4.0).map(|l| l.slope.to_degrees()), "° per m/s²");
    out.figure("steering-wheel torque gradient", over(&torque, 1.0, 4.0).map(|l| l.slope), "N·m per m/s²");
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handling::tests::CAR;

    /// A linear car with understeer gradient U, on a circle or at a speed, turning right.
    fn run(understeer: f64, radius: Option<f64>) -> Signals {
        let (t, n) = (1e-2, 6000);
        let acceleration = |i: usize| 5.0 * i as f64 / n as f64;
        let speed = |i: usize| radius.map_or(25.0, |r| (acceleration(i) * r).sqrt());
        let angle = |i: usize| {
            let ackermann = radius.map_or(2.7 * acceleration(i) / 625.0, |r| 2.7 / r);
            16.0 * (ackermann + understeer * acceleration(i))
        };
        let column = |f: &dyn Fn(usize) -> f64| (0..n).map(f).collect::<Vec<_>>();
        Signals {
            sample_time_s: t,
            hand_wheel_angle_rad: column(&|i| -angle(i)),
            hand_wheel_torque_n_m: column(&|i| -0.7 * acceleration(i)),
            lateral_acceleration_m_s2: column(&|i| -acceleration(i)),
            yaw_rate_rad_s: column(&|i| -acceleration(i) / speed(i)),
            yaw_rad: column(&|_| 0.0),
            roll_rad: column(&|i| -0.005 * acceleration(i)),
            side_slip_rad: column(&|i| 0.01 * acceleration(i)),
            speed_m_s: column(&speed),
            x_m: column(&|_| 0.0),
            y_m: column(&|_| 0.0),
        }
    }

    #[test]
    fn both_methods_give_the_understeer_gradient_of_a_linear_car() {
        for (radius, method) in
            [(Some(80.0), SteadyMethod::ConstantRadius(80.0)), (None, SteadyMethod::ConstantSpeed)]
        {
            let out = steady_turn(&run(0.003, radius), method, &CAR);
            assert!(out.valid(), "{:?}", out.conditions);
            let value = out.value("understeer gradient, 1 to 4 m/s²").unwrap();
            assert!((value - 0.003_f64.to_degrees()).abs() < 2e-3 * 0.17, "{value}");
            assert!((out.value("roll angle gradient").unwrap() - 0.005_f64.to_degrees()).abs() < 1e-4);
            assert!((out.value("side-slip angle gradient").unwrap() + 0.01_f64.to_degrees()).abs() < 1e-3);
            assert!((out.value("steering-wheel torque gradient").unwrap() - 0.7).abs() < 1e-3);
        }
    }

    #[test]
    fn a_hasty_or_short_run_is_withheld() {
        let mut hasty = run(0.003, None);
        hasty.sample_time_s = 1e-3;
        let out = steady_turn(&hasty, SteadyMethod::ConstantSpeed, &CAR);
        assert!(out.figures.iter().all(|f| f.value.as_ref().is_err_and(|e| e.contains("jerk"))), "{out:?}");
        let short = run(0.003, None).part(0..4000);
        let out = steady_turn(&short, SteadyMethod::ConstantSpeed, &CAR);
        assert!(
            out.figures[0].value.as_ref().unwrap_err().contains("largest lateral acceleration 3.3"),
            "{out:?}"
        );
    }
}
