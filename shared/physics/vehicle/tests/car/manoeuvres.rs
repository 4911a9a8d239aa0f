//! Step-size study (spec 3.2): halving the step changes the peak of lateral acceleration by less than 0.5 % in every
//! shipped manoeuvre. The scenario files steer the car's own steering here, without a rig.

use crate::support::*;
use config::scenario::Scenario;
use manoeuvre::path::{Observed, PathDriver};
use manoeuvre::{HandWheel, Manoeuvre};
use vehicle::{GearMode, VehicleInput};

/// A scenario with what it extends.
fn scenario(name: &str) -> Scenario {
    let read = |name: &str| -> toml::Table {
        let path = root().join("schemas/scenarios").join(format!("{name}.toml"));
        toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
    };
    let mut chain = vec![read(name)];
    while let Some(base) = chain.last_mut().and_then(|t| t.remove("extends")) {
        chain.push(read(base.as_str().unwrap()));
    }
    let mut whole = toml::Table::new();
    for own in chain.into_iter().rev() {
        for (key, value) in own {
            match (whole.get_mut(&key), value) {
                (Some(toml::Value::Table(under)), toml::Value::Table(over)) if !over.contains_key("type") => {
                    under.extend(over);
                }
                (_, value) => drop(whole.insert(key, value)),
            }
        }
    }
    whole.try_into().unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// Peak of lateral acceleration, from straight running on.
fn peak(name: &str, step_s: f64) -> f64 {
    let s = scenario(name);
    let manoeuvre = Manoeuvre::new(&s, None).unwrap();
    let mut v = build_with_step(&with_constants(car("sedan")), step_s);
    let start = manoeuvre.initial_speed_m_s();
    let gear = if start == 0.0 { GearMode::Park } else { GearMode::Drive };
    let mut input =
        VehicleInput { gear_mode: gear, target_speed_m_s: Some(start), ..VehicleInput::default() };
    v.reset(start, &input);
    let mut driver = match &s.steer {
        config::scenario::Steer::Path(path) => Some(PathDriver::new(path)),
        _ => None,
    };
    let split = matches!(s.road.friction, config::road::Friction::Split { .. });
    let mut most = 0.0f64;
    let (mut held, mut filter) = (0.0, 0.0);
    let steps = (s.duration_s / step_s).round() as usize;
    for n in 0..steps {
        let t = n as f64 * step_s;
        let command = manoeuvre.at(t + step_s);
        let o = *v.output();
        let angle = match (&mut driver, command.hand_wheel) {
            (Some(driver), HandWheel::PathDriver) => {
                let seen = Observed {
                    x_m: o.position_m[0],
                    y_m: o.position_m[1],
                    yaw_rad: o.yaw_rad,
                    speed_m_s: o.horizontal_velocity_m_s[0],
                };
                driver.step(&seen, step_s).wheel.value
            }
            (_, HandWheel::Commanded) => command.steering_wheel_angle_rad,
            // Nobody holds it: here it stays, the car's own steering has no free wheel.
            _ => held,
        };
        held = angle;
        input.time_s = t;
        input.steering_wheel_angle_rad = angle;
        input.wind_m_s = manoeuvre.wind_m_s(t);
        match command.pedals {
            Some(p) => {
                input.target_speed_m_s = None;
                (input.throttle, input.brake_pressure_pa) = (p.throttle, p.brake_pressure_pa);
            }
            None => input.target_speed_m_s = Some(command.target_speed_m_s),
        }
        if split {
            for (road, w) in input.road.iter_mut().zip(&o.wheels) {
                let [x, y, _] = w.centre_position_m;
                road.friction = if (120.0..600.0).contains(&x) && y < 0.0 { 0.3 } else { 0.9 };
            }
        }
        v.step(&input);
        // As a sensor of 100 Hz has it: the stick-slip of a standing tyre is no lateral acceleration of a manoeuvre.
        filter += (v.output().lateral_acceleration_m_s2 - filter) * (step_s / 0.0016);
        most = most.max(filter.abs());
    }
    most
}

#[test]
fn halving_the_step_in_every_shipped_manoeuvre() {
    let mut names: Vec<String> = std::fs::read_dir(root().join("schemas/scenarios"))
        .unwrap()
        .filter_map(|f| f.unwrap().file_name().to_str()?.strip_suffix(".toml").map(str::to_owned))
        .filter(|n| !n.starts_with('_'))
        .collect();
    names.sort();
    let mut broken = Vec::new();
    let mut studied = 0;
    for name in names {
        let s = scenario(&name);
        if s.record.is_some() {
            println!("{name:28} replays a record: `halving_the_step_in_the_measured_lane_change`");
            continue;
        }
        assert_eq!(s.car_file, "sedan", "{name}: a car that this study does not build");
        let (coarse, fine) = (peak(&name, 1e-3), peak(&name, 5e-4));
        let change = 100.0 * (coarse / fine - 1.0);
        println!("{name:28} peak {fine:7.3} m/s2 at 0.5 ms, {change:+.3} % at 1 ms");
        studied += 1;
        // Standing still there is no peak to speak of.
        if fine > 0.05 && change.abs() >= 0.5 {
            broken.push(format!("{name}: {change:.3} %"));
        }
    }
    assert!(broken.is_empty(), "{broken:?}");
    assert!(studied >= 12, "{studied} manoeuvres");
}
