//! Nothing on the tick path allocates.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use config::scenario::{Scenario, Steer};
use config::{Kind, Library, RecordedHistory, TimeSeries, load};
use manoeuvre::Manoeuvre;
use manoeuvre::path::{Observed, PathDriver};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn no_shipped_scenario_allocates_while_driven() {
    let time_s: Vec<f64> = (0..4000).map(|i| f64::from(i) * 5e-3 - 2.0).collect();
    let series = TimeSeries { value: time_s.clone(), time_s };
    let history = RecordedHistory {
        steering_wheel_angle_rad: Some(series.clone()),
        speed_m_s: Some(series),
        measured: Vec::new(),
    };
    for file in Library::list(Kind::Scenario) {
        let scenario = load::<Scenario>(file.name).unwrap().value;
        let manoeuvre = Manoeuvre::new(&scenario, Some(&history)).unwrap();
        let mut driver = match &scenario.steer {
            Steer::Path(following) => Some(PathDriver::new(following)),
            _ => None,
        };
        let sum = assert_no_alloc(|| {
            let mut sum = 0.0;
            for i in 0..5000 {
                let time = f64::from(i) * 5e-3;
                let command = manoeuvre.at(time);
                sum +=
                    command.steering_wheel_angle_rad + command.target_speed_m_s + manoeuvre.wind_m_s(time)[0];
                if let Some(driver) = &mut driver {
                    let seen = Observed { x_m: 0.1 * f64::from(i), speed_m_s: 20.0, ..Observed::default() };
                    sum += driver.step(&seen, 1e-3).wheel.value;
                }
            }
            sum
        });
        assert!(sum.is_finite());
    }
    assert_eq!(violation_count(), 0);
    // The guard itself works: an allocation inside is counted.
    let text = assert_no_alloc(|| String::from("allocated"));
    assert!(violation_count() > 0 && !text.is_empty());
}
