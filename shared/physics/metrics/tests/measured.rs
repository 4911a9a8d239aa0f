//! Lag, gain and fit on a measured drive whose figures are known: a BMW M8's double lane change
//! (`reference/measured/bmw_m8_roadview`, its README states the figures).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use std::path::Path;

use metrics::compare::compare_record;
use metrics::correlation::lag;
use metrics::filter::LowPass;
use metrics::fit::line;
use metrics::resample::{linear, uniform};
use metrics::statistics::{mean, peak};

/// The columns of a reference file by name, NaN for what is no number. None, with what is missing printed,
/// where the reference files are not there.
fn reference(file: &str, names: &[&str]) -> Option<Vec<Vec<f64>>> {
    let root =
        Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().find(|p| p.join("Cargo.lock").exists()).unwrap();
    let path = root.join("../shared/reference/measured/bmw_m8_roadview").join(file);
    if !path.exists() {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "missing: {file}");
        println!("missing: reference file {file}; not tested: figures of a measured drive");
        return None;
    }
    let mut reader = csv::Reader::from_path(path).unwrap();
    let headers = reader.headers().unwrap().clone();
    let columns: Vec<usize> = names.iter().map(|n| headers.iter().position(|h| h == *n).unwrap()).collect();
    let mut out = vec![Vec::new(); names.len()];
    for record in reader.records() {
        let record = record.unwrap();
        for (values, &column) in out.iter_mut().zip(&columns) {
            values.push(record[column].parse().unwrap_or(f64::NAN));
        }
    }
    Some(out)
}

#[test]
fn a_measured_lane_change_has_its_known_lag_gain_and_fit() {
    let inputs = reference("double_lane_change_inputs_200Hz.csv", &["time", "steering"]);
    let bus = reference(
        "double_lane_change_car_bus.csv",
        &["car_time", "Yaw_Velocity", "Velocity_X", "Acceleration_Y"],
    );
    let (Some(inputs), Some(bus)) = (inputs, bus) else { return };
    let step = 0.01;
    let grid = uniform(0.0, 23.0, step);
    let steer = linear(&inputs[0], &inputs[1], &grid);
    let [yaw_rate, speed, lateral] = [1, 2, 3].map(|i| linear(&bus[0], &bus[i], &grid));
    // From standstill to the manoeuvre: the part at speed.
    let fast: Vec<usize> = (0..grid.len()).filter(|&i| speed[i] > 15.0).collect();
    let (from, to) = (fast[0], fast[fast.len() - 1]);
    // Normalised: x20 is the hand-wheel angle [rad], /14.3 the road wheel's.
    let road_wheel: Vec<f64> = steer[from..to].iter().map(|s| s * 20.0 / 14.3).collect();
    let yaw_rate = &yaw_rate[from..to];

    let found = lag(&road_wheel, yaw_rate, step, 0.5).unwrap();
    println!("lag {:.1} ms, correlation {:.5}", found.lag_s * 1e3, found.correlation);
    assert!((found.lag_s - 0.04).abs() < 0.01, "{found:?}");
    let samples = (found.lag_s / step).round() as usize;
    let fit = line(&road_wheel[..road_wheel.len() - samples], &yaw_rate[samples..]).unwrap();
    println!(
        "gain {:.3} 1/s, R² {:.5}, mean speed {:.2} m/s",
        fit.slope,
        fit.r_squared,
        mean(&speed[from..to])
    );
    assert!((fit.slope - 6.49).abs() < 0.02, "{fit:?}");
    assert!(fit.r_squared > 0.998, "{fit:?}");

    // The known peak of lateral acceleration is that of the smoothed signal.
    let smooth = LowPass::butterworth(5.0, step).unwrap().zero_phase(&lateral);
    println!("peak lateral acceleration {:.3} raw, {:.3} smoothed to 5 Hz", peak(&lateral), peak(&smooth));
    assert!((peak(&lateral) - 6.23).abs() < 0.005, "{}", peak(&lateral));

    // As a simulation of itself with the gain and no lag, the yaw rate is as far off as the lag makes it.
    let time: Vec<f64> = grid[from..to].to_vec();
    let model: Vec<f64> = road_wheel.iter().map(|s| fit.slope * s + fit.intercept).collect();
    let result = compare_record((&time, yaw_rate), (&time, &model), 0.5).unwrap();
    assert!((result.lag_s + found.lag_s).abs() < 0.005, "the model is early: {result:?}");
    assert!(result.normalised_rms_error < 0.06, "{result:?}");
    assert!(result.rms_error > 2.0 * result.rms_error_aligned, "{result:?}");
}
