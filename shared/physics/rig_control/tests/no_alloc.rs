//! No step of the controller allocates.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use rig_control::{ControlDiagnostics, Fade, RigCommand, RigController, SteerCommand};
use rig_plant::{Actuation, Measurement};

#[global_allocator]
static ALLOCATOR: assert_no_alloc::AllocDisabler = assert_no_alloc::AllocDisabler;

#[test]
fn a_step_does_not_allocate() {
    let rig = toml::from_str(include_str!("../../../../schemas/rigs/virtual.toml")).unwrap();
    let unit = toml::from_str(include_str!("../../../../schemas/units/column_eps.toml")).unwrap();
    let mut control = RigController::new(&rig, &unit, 1e-3).unwrap();
    let mut state = vec![0.0; control.state_len()];
    let (mut act, mut diag) = (Actuation::default(), ControlDiagnostics::default());
    let m = Measurement { validity: Measurement::ALL_VALID, ..Measurement::default() };
    let command = RigCommand {
        steer: SteerCommand::Angle { angle_rad: 0.1, rate_rad_s: 0.0 },
        fade: Fade::FULL,
        ..RigCommand::default()
    };
    assert_no_alloc::assert_no_alloc(|| {
        for _ in 0..50 {
            control.step(&command, &m, &mut act, &mut diag);
            control.save_state(&mut state);
            control.load_state(&state);
        }
    });
    assert_eq!(assert_no_alloc::violation_count(), 0);
}
