//! Steering units composed from model files, in the place of the built-in one.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use config::unit::SteeringUnit;
use config::{Kind, Library, ModelFiles};
use functional_model::Model;
use rig_plant::state::{StateReader, StateWriter};
use rig_plant::{ColumnEps, ComposedUnit, SteeringUnitModel, UnitInput, UnitOutput};
use std::f64::consts::TAU;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const MODELS: [&str; 6] =
    ["column_eps_lumped", "column_eps", "rack_eps", "hydraulic", "recirculating_ball", "steer_by_wire"];

fn model(name: &str) -> Model {
    let files = ModelFiles::load(name).unwrap();
    Model::from_toml(&files.main.text, name, &|part| files.part(part)).unwrap_or_else(|e| panic!("{e:?}"))
}

fn composed(name: &str, travel_m_per_rev: f64, step_s: f64) -> ComposedUnit {
    ComposedUnit::new(&model(name), &[], 0.035, travel_m_per_rev / TAU, step_s)
        .unwrap_or_else(|e| panic!("{e:?}"))
}

fn built_in(travel_m_per_rev: f64) -> ColumnEps {
    let text = Library::get(Kind::Unit, "column_eps").unwrap().text;
    let mut unit: SteeringUnit = toml::from_str(text).unwrap();
    unit.rack_travel_m_per_rev = travel_m_per_rev;
    ColumnEps::new(&unit, 0.035)
}

/// A driver's sine against a spring at the rack.
fn drive(unit: &mut dyn SteeringUnitModel, t: f64, step_s: f64) -> UnitOutput {
    let o = *unit.output();
    let input = UnitInput {
        hand_wheel_torque_n_m: 4.0 * (TAU * 0.4 * t).sin(),
        rack_force_n: -1.0e5 * o.rack_displacement_m - 300.0 * o.rack_velocity_m_s,
        vehicle_speed_m_s: 20.0,
        engine_on: true,
        assist_request_n_m: None,
    };
    unit.step(&input, step_s);
    *unit.output()
}

/// Largest differences of hand-wheel angle [rad] and torsion-bar torque [N·m] over 3 s.
fn difference(travel: f64, step_s: f64) -> (f64, f64) {
    let (mut a, mut b) = (built_in(travel), composed("column_eps_lumped", travel, step_s));
    let (mut angle, mut torque) = (0.0f64, 0.0f64);
    for k in 0..(3.0 / step_s) as u32 {
        let t = f64::from(k) * step_s;
        let (p, q) = (drive(&mut a, t, step_s), drive(&mut b, t, step_s));
        angle = angle.max((p.hand_wheel_angle_rad - q.hand_wheel_angle_rad).abs());
        torque = torque.max((p.torsion_bar_torque_n_m - q.torsion_bar_torque_n_m).abs());
    }
    (angle, torque)
}

#[test]
fn the_built_in_unit_and_its_model_file_are_the_same_machine() {
    for travel in [0.05, -0.05] {
        let (coarse, fine) = (difference(travel, 1e-4), difference(travel, 2.5e-5));
        println!("travel {travel}: angle and torque differ by {coarse:?} at 0.1 ms, {fine:?} at 0.025 ms");
        // The built-in rule is of first order: what differs is its step, and goes with it.
        assert!(coarse.0 < 0.02 && coarse.1 < 0.15, "{coarse:?}");
        assert!(fine.0 < 0.4 * coarse.0 && fine.1 < 0.5 * coarse.1, "{coarse:?} {fine:?}");
    }
}

#[test]
fn every_shipped_unit_turns_left_with_the_rack_on_either_side() {
    for name in MODELS {
        for travel in [0.05, -0.05] {
            let mut unit = composed(name, travel, 1e-4);
            assert!(unit.state_len() <= 256);
            let input = UnitInput {
                hand_wheel_torque_n_m: 5.0,
                vehicle_speed_m_s: 10.0,
                engine_on: true,
                assist_request_n_m: None,
                ..UnitInput::default()
            };
            let mut assisted = 0.0f64;
            for _ in 0..3000 {
                let force = -8.0e4 * unit.output().rack_displacement_m;
                unit.step(&UnitInput { rack_force_n: force, ..input }, 1e-4);
                assisted = assisted.max(unit.output().assist_force_n * travel.signum());
            }
            let o = unit.output();
            assert!(o.hand_wheel_angle_rad > 0.1 && o.rack_displacement_m * travel > 0.0, "{name}: {o:?}");
            assert!(o.torsion_bar_torque_n_m > 1.0 && assisted > 200.0, "{name}: {assisted} N, {o:?}");
            let a = unit.account().unwrap();
            assert!(
                a.fault_count == 0.0 && a.power_residual_w <= 1e-12 * a.power_flow_w.max(1e-3),
                "{name}: {a:?}"
            );
            assert!(
                a.imbalance_j.abs() <= 1e-11 * (a.entered_j.abs() + a.supplied_j + a.lost_j).max(1.0),
                "{name}: {a:?}"
            );
        }
    }
}

#[test]
fn a_checkpoint_continues_to_the_bit_and_no_step_allocates() {
    for name in MODELS {
        let mut a = composed(name, -0.05, 1e-4);
        let mut saved = vec![0.0; a.state_len()];
        assert_no_alloc(|| {
            for k in 0..2000 {
                drive(&mut a, f64::from(k) * 1e-4, 1e-4);
            }
            a.save(&mut StateWriter::new(&mut saved));
        });
        assert_eq!(violation_count(), 0, "{name}");
        let mut b = composed(name, -0.05, 1e-4);
        b.load(&mut StateReader::new(&saved));
        for k in 2000..3000 {
            let (p, q) = (drive(&mut a, f64::from(k) * 1e-4, 1e-4), drive(&mut b, f64::from(k) * 1e-4, 1e-4));
            assert_eq!(format!("{p:?}"), format!("{q:?}"), "{name}");
        }
        b.load(&mut StateReader::new(&vec![0.0; b.state_len()]));
        assert_eq!(b.output().hand_wheel_angle_rad, 0.0, "zeros are the state at rest");
    }
}

#[test]
fn what_is_no_steering_unit_is_refused_with_all_it_lacks() {
    let refused = |name: &str, travel: f64| {
        let found = ComposedUnit::new(&model(name), &[], 0.035, travel / TAU, 1e-4).err().expect("refused");
        found.into_iter().map(|b| format!("{}: {}", b.key, b.rule)).collect::<Vec<_>>().join("\n")
    };
    let told = refused("one_wheel", 0.05);
    assert!(told.contains("upstream_inertia") || told.contains("travel"), "{told}");
    let text = Library::get(Kind::Model, "rack_eps").unwrap().text;
    let broken = text.replace("torsion_torque = \"bar.torque\"\n", "").replace("vehicle_speed", "velocity");
    let model =
        Model::from_toml(&broken, "broken.toml", &|n| Err(n.to_owned())).unwrap_or_else(|e| panic!("{e:?}"));
    let found = ComposedUnit::new(&model, &[], 0.035, 0.05 / TAU, 1e-4).err().expect("refused");
    let told = format!("{found:?}");
    assert!(told.contains("torsion_torque") && told.contains("vehicle_speed"), "{told}");
    // A pinion that turns the other way than the file says.
    let text = text.replace("set = { travel = \"travel\" }", "set = { travel = \"-travel\" }");
    let model =
        Model::from_toml(&text, "turned.toml", &|n| Err(n.to_owned())).unwrap_or_else(|e| panic!("{e:?}"));
    let found = ComposedUnit::new(&model, &[], 0.035, 0.05 / TAU, 1e-4).err().expect("refused");
    assert!(format!("{found:?}").contains("m/rev"), "{found:?}");
}
