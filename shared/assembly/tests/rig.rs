//! The rig's studies: identification of a machine that differs from what the controller was told; every trip on the
//! running machine; nothing outside limits on its way to the plant.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use assembly::identification::{Identified, TestPlan, identify};
use assembly::trips::{RigLoop, demonstrate};
use config::rig::Rig;
use config::unit::SteeringUnit;
use proptest::prelude::*;
use rig_control::study::{MANOEUVRES, Study};
use rig_control::{Fade, RigCommand, SteerCommand};
use safety::{OperatorRequest, TripCode};

fn files() -> (Rig, SteeringUnit) {
    let rig = toml::from_str(include_str!("../../../schemas/rigs/virtual.toml")).unwrap();
    let unit = toml::from_str(include_str!("../../../schemas/units/column_eps.toml")).unwrap();
    (rig, unit)
}

fn found(rig: &Rig, unit: &SteeringUnit) -> Identified {
    identify(rig, unit, 3, 1e-3, 0.5, &TestPlan::default(), |_, _| {}).unwrap()
}

#[test]
fn a_machine_changed_by_a_fifth_is_found_and_its_parameters_improve_tracking() {
    let (rig, unit) = files();
    for (gain, stiffness, delay) in [(1.2, 0.8, 1.2), (0.8, 1.2, 0.8)] {
        let believed = Study::new(&rig, &unit).with_plant(gain, stiffness, delay);
        let machine = believed.rig.clone();
        let found = found(&machine, &unit);
        let p = &machine.plant;
        for side in 0..2 {
            let rod = 1.0 / (1.0 / p.tie_rod_stiffness_n_m + 1.0 / p.leaf_spring_stiffness_n_m);
            let k = found.stiffness_n_m[side].unwrap().value;
            assert!((k / rod - 1.0).abs() < 0.04, "stiffness {k}, true {rod}");
            let h = &p.horizontal;
            let speed =
                h.rated_flow_m3_s / h.piston_area_m2 * (h.supply_pressure_pa / h.rated_drop_pa).sqrt();
            for fit in [found.horizontal[side].unwrap(), found.vertical[side].unwrap()] {
                assert!((fit.speed_m_s / speed - 1.0).abs() < 0.05, "{fit:?}, true speed {speed}");
                assert!((fit.valve_frequency_hz - 60.0).abs() < 9.0, "{fit:?}");
            }
            let mass = found.mass_kg[side].unwrap().value;
            assert!((mass / h.mass_kg - 1.0).abs() < 0.1, "mass {mass}");
        }
        let transport = found.command_delay_s.unwrap();
        // The sensors' own delay is taken as told, so a change of both shows in this one.
        let both = p.command_delay_s + p.measurement_delay_s - rig.control.measurement_delay_s;
        assert!((transport - both).abs() < 3e-4, "delay {transport}, true {both}");
        let inertia = found.hub.unwrap().inertia_kg_m2;
        assert!((inertia / p.steer.inertia_kg_m2 - 1.0).abs() < 0.1, "inertia {inertia}");
        let friction = found.rack_friction_n.unwrap();
        assert!((friction / unit.rack_friction.sliding_n - 1.0).abs() < 0.15, "rack friction {friction}");
        let column = found.column_friction_n_m.unwrap();
        assert!((column / unit.column_friction.sliding_n_m - 1.0).abs() < 0.25, "column friction {column}");

        let informed = Study { control_rig: found.applied_to(&rig), ..believed.clone() };
        let sum = |study: &Study| -> f64 {
            let share = |m| {
                let r = study.run(m).unwrap();
                r.figures().iter().zip(m.published).map(|(ours, theirs)| ours / theirs).sum::<f64>()
            };
            MANOEUVRES.iter().map(share).sum()
        };
        let (before, after) = (sum(&believed), sum(&informed));
        assert!(after < 0.95 * before, "sum of shares {before} as believed, {after} as identified");
    }
}

#[test]
fn what_is_written_is_a_rig_file_of_the_same_numbers() {
    let (rig, unit) = files();
    let found = found(&rig, &unit);
    let text = found.to_toml(&rig, "virtual");
    let file = std::env::temp_dir().join(format!("kingpin-identified-{}.toml", std::process::id()));
    std::fs::write(&file, text).unwrap();
    let loaded = config::load::<Rig>(&file.display().to_string()).map_err(|e| e.to_string());
    std::fs::remove_file(&file).unwrap();
    let (loaded, applied) = (loaded.unwrap().value, found.applied_to(&rig));
    let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-5, "{a} {b}");
    near(loaded.control.tie_rod_stiffness_n_m, applied.control.tie_rod_stiffness_n_m);
    near(loaded.control.horizontal.no_load_speed_m_s, applied.control.horizontal.no_load_speed_m_s);
    near(loaded.control.command_delay_s, applied.control.command_delay_s);
    assert_eq!(loaded.plant, rig.plant);
}

#[test]
fn every_trip_reaches_its_safe_state_in_the_tick_of_its_cause() {
    let (rig, unit) = files();
    let list = demonstrate(&rig, &unit, 7).unwrap();
    for code in TripCode::ALL {
        let shown = list.iter().find(|d| d.wanted == code).unwrap();
        println!("{code:?}: {} tick(s) after {} of the rule", shown.reaction_ticks(), shown.rule_ticks);
        assert!(shown.kept(), "{shown:?}");
        assert!(shown.force_n[1] < 100.0, "the machine is unloaded 0.2 s later: {shown:?}");
    }
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![8 => -2.0_f64..2.0, 3 => -1e5_f64..1e5, 1 => proptest::num::f64::ANY]
}

fn any_command() -> impl Strategy<Value = (RigCommand, u8)> {
    (proptest::array::uniform8(any_number()), 0..3_u8, any::<u8>()).prop_map(|(v, mode, hold)| {
        let command = RigCommand {
            tie_rod_force_n: [v[0] * 1500.0, v[1] * 1500.0],
            ball_height_m: [v[2] * 0.02, v[3] * 0.02],
            ball_height_velocity_m_s: [v[4] * 0.1, v[5] * 0.1],
            steer: match mode {
                0 => SteerCommand::Free,
                1 => SteerCommand::Angle { angle_rad: v[6], rate_rad_s: v[7] },
                _ => SteerCommand::Torque { torque_n_m: v[6] * 5.0 },
            },
            fade: Fade::FULL,
        };
        (command, hold)
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    /// Through safety, controller and the last gate, onto the machine: what leaves is within the limits of every tick,
    /// whatever is asked for, from the soft start to the safe state and back.
    #[test]
    fn whatever_is_commanded_what_reaches_the_plant_is_within_limits(
        asked in proptest::collection::vec(any_command(), 5..40),
        seed in 0..1000_u64,
    ) {
        let (rig, unit) = files();
        let limits = &rig.limits;
        let mut bench = RigLoop::new(&rig, &unit, seed, 1e-3, true).unwrap();
        let mut n = 0_usize;
        for (command, hold) in asked {
            for _ in 0..=usize::from(hold) / 4 {
                let request = match n % 400 {
                    0 => OperatorRequest::SwitchOn,
                    1 => OperatorRequest::Arm,
                    2 => OperatorRequest::Start,
                    399 => OperatorRequest::Acknowledge,
                    _ => OperatorRequest::None,
                };
                n += 1;
                let done = bench.step(&command, request, |_| {});
                let (a, c) = (&done.actuation, &done.verdict.command);
                for side in 0..2 {
                    prop_assert!(c.tie_rod_force_n[side].abs() <= limits.command_force_n);
                    prop_assert!(c.ball_height_m[side].abs() <= limits.command_height_m);
                    prop_assert!(a.horizontal_valve[side].abs() <= limits.command_valve);
                    prop_assert!(a.vertical_valve[side].abs() <= limits.command_valve);
                }
                prop_assert!(a.steer_torque_n_m.abs() <= limits.command_steer_torque_n_m);
                prop_assert!(done.verdict.fade.steer > 0.0 || a.steer_torque_n_m == 0.0);
                let t = &done.truth;
                prop_assert!(t.vertical_stroke_m.iter().chain(&t.horizontal_stroke_m).all(|x| x.abs() < 0.14));
            }
        }
    }
}
