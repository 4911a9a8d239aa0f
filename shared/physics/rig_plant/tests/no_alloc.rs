//! No step of the virtual rig allocates.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use rig_plant::{Actuation, Measurement, RigEnvironment, VirtualRig};

#[global_allocator]
static ALLOCATOR: assert_no_alloc::AllocDisabler = assert_no_alloc::AllocDisabler;

#[test]
fn a_tick_does_not_allocate() {
    let rig = toml::from_str(include_str!("../../../../schemas/rigs/virtual.toml")).unwrap();
    let unit = toml::from_str(include_str!("../../../../schemas/units/column_eps.toml")).unwrap();
    let mut plant = VirtualRig::new(&rig, &unit, 1, 1e-3).unwrap();
    let mut state = vec![0.0; plant.state_len()];
    let mut m = Measurement::default();
    assert_no_alloc::assert_no_alloc(|| {
        for _ in 0..50 {
            plant.set_environment(&RigEnvironment::default());
            plant.sample(&mut m);
            plant.set_actuation(&Actuation { steer_torque_n_m: 1.0, ..Actuation::default() });
            plant.advance(1e-3);
            plant.save_state(&mut state);
            plant.load_state(&state);
        }
    });
    assert_eq!(assert_no_alloc::violation_count(), 0);
}
