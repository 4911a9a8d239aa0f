//! No step of the safety monitor allocates.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use rig_control::RigCommand;
use rig_plant::{Actuation, Measurement};
use safety::{OperatorRequest, Safety, SafetyInput};

#[global_allocator]
static ALLOCATOR: assert_no_alloc::AllocDisabler = assert_no_alloc::AllocDisabler;

#[test]
fn a_step_does_not_allocate() {
    let rig = toml::from_str(include_str!("../../../schemas/rigs/virtual.toml")).unwrap();
    let unit = toml::from_str(include_str!("../../../schemas/units/column_eps.toml")).unwrap();
    let mut safety = Safety::new(&rig, &unit, 1e-3, true).unwrap();
    let mut state = vec![0.0; safety.state_len()];
    let mut input = SafetyInput {
        tick: 0,
        request: OperatorRequest::SwitchOn,
        emergency_stop: false,
        interlock_open: false,
        inputs_stale_ticks: 0,
        missed_ticks: 0,
        measurement: Measurement { validity: Measurement::ALL_VALID, ..Measurement::default() },
        command: RigCommand::default(),
        energy_cycle_j: 0.0,
        energy_second_j: 0.0,
        ecu: None,
    };
    assert_no_alloc::assert_no_alloc(|| {
        for tick in 0..100 {
            input.tick = tick;
            input.emergency_stop = tick > 50;
            let out = safety.step(&input);
            let mut actuation = Actuation { steer_torque_n_m: out.fade.force, ..Actuation::default() };
            safety.clamp_actuation(&mut actuation);
            safety.save_state(&mut state);
            safety.load_state(&state);
        }
    });
    assert_eq!(assert_no_alloc::violation_count(), 0);
}
