//! Prints what one tick costs: plant (1 ms), sensors, controller. p50, p99.9, max.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, clippy::disallowed_methods)]
use rig_control::{ControlDiagnostics, Fade, RigCommand, RigController, SteerCommand};
use rig_plant::{Actuation, Measurement, VirtualRig};
use std::time::Instant;

fn main() {
    let rig = toml::from_str(include_str!("../../../../schemas/rigs/virtual.toml")).expect("rig");
    let unit = toml::from_str(include_str!("../../../../schemas/units/column_eps.toml")).expect("unit");
    let mut plant = VirtualRig::new(&rig, &unit, 1, 1e-3).expect("plant");
    let mut control = RigController::new(&rig, &unit, 1e-3).expect("control");
    let (mut m, mut act, mut diag) =
        (Measurement::default(), Actuation::default(), ControlDiagnostics::default());
    let mut cost: [Vec<u128>; 3] = Default::default();
    for n in 0..20_000 {
        let t = f64::from(n) * 1e-3;
        let command = RigCommand {
            tie_rod_force_n: [900.0 * (3.0 * t).sin(), -900.0 * (3.0 * t).sin()],
            steer: SteerCommand::Angle { angle_rad: (3.0 * t).sin(), rate_rad_s: 3.0 * (3.0 * t).cos() },
            fade: Fade::FULL,
            ..RigCommand::default()
        };
        let start = Instant::now();
        plant.sample(&mut m);
        cost[0].push(start.elapsed().as_nanos());
        let start = Instant::now();
        control.step(&command, &m, &mut act, &mut diag);
        cost[1].push(start.elapsed().as_nanos());
        plant.set_actuation(&act);
        let start = Instant::now();
        plant.advance(1e-3);
        cost[2].push(start.elapsed().as_nanos());
    }
    for (name, mut ns) in ["sample", "control step", "plant 1 ms"].into_iter().zip(cost) {
        ns.sort_unstable();
        let at = |q: f64| ns[((ns.len() - 1) as f64 * q) as usize] as f64 * 1e-3;
        println!("{name:14} p50 {:.2} µs  p99.9 {:.2} µs  max {:.2} µs", at(0.5), at(0.999), at(1.0));
    }
}
