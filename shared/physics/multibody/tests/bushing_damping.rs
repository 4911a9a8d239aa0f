//! Dampers beside the bushings: the lag they give, the work they take, and states that go on bit for bit.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use config::axle::{Axle, BushingDamping, KingpinFriction};
use multibody::{Status, Suspension, SuspensionInput, SuspensionOutput};
use spatial::Vector3;

const PERIOD_S: f64 = 1e-3;

/// The shipped axle on bushings, each damped by its stiffness times `lag_s`.
fn bushed(lag_s: f64) -> Axle {
    let path = format!(
        "{}/../../../schemas/suspensions/sedan_double_wishbone_bushings.toml",
        env!("CARGO_MANIFEST_DIR")
    );
    let mut axle: Axle = toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    for bushing in axle.bushings.as_mut().unwrap().values_mut() {
        bushing.damping = Some(BushingDamping {
            radial_n_s_per_m: lag_s * bushing.radial_n_per_m,
            axial_n_s_per_m: lag_s * bushing.axial_n_per_m,
            torsional_n_m_s_per_rad: lag_s * bushing.torsional_n_m_per_rad,
        });
    }
    axle
}

fn braked(force_n: f64) -> SuspensionInput {
    let force = Vector3::new(force_n, 0.0, 0.0);
    SuspensionInput { wheel_force_n: [force; 2], ..SuspensionInput::DESIGN }
}

/// With every damper its stiffness times τ, small motions are the undamped ones behind a first-order lag τ, which
/// implicit Euler steps as x = (x_static + (τ/h) x₋)/(1 + τ/h).
#[test]
fn proportional_damping_is_a_first_order_lag() {
    let lag = 0.01;
    let (mut damped, mut still) =
        (Suspension::new(&bushed(lag)).unwrap(), Suspension::new(&bushed(lag)).unwrap());
    damped.set_period(Some(PERIOD_S));
    let (mut a, mut b) = (SuspensionOutput::default(), SuspensionOutput::default());
    let (mut expected, mut peak, mut worst, mut apart) = (0.0, 0.0_f64, 0.0_f64, 0.0_f64);
    let mut work = 0.0;
    let mut before = 0.0;
    for k in 1..600_u32 {
        let force = -40.0 * (std::f64::consts::TAU * 5.0 * PERIOD_S * f64::from(k)).sin();
        damped.step(&braked(force), &mut a);
        still.step(&braked(force), &mut b);
        assert_eq!((a.status, b.status), (Status::Converged, Status::Converged));
        let ratio = lag / PERIOD_S;
        expected = (b.side[0].toe_rad + ratio * expected) / (1.0 + ratio);
        peak = peak.max(b.side[0].toe_rad.abs());
        worst = worst.max((a.side[0].toe_rad - expected).abs());
        apart = apart.max((a.side[0].toe_rad - b.side[0].toe_rad).abs());
        let x = a.side[0].wheel_centre_m.x;
        work += force * (x - before);
        before = x;
    }
    println!(
        "toe: lag of 10 ms to {:.1e} of its peak of {:.1e} rad; work taken {work:.2e} J",
        worst / peak,
        peak
    );
    assert!(worst < 2e-3 * peak && apart > 0.2 * peak, "{worst:e} {apart:e} {peak:e}");
    // Three cycles: each takes π F x sin φ.
    assert!(work > 0.0);
}

/// Loads so small that rounding of the coordinates is all that is left of the balance: solved, not held.
#[test]
fn small_loads_are_solved() {
    let mut suspension = Suspension::new(&bushed(0.0)).unwrap();
    let mut output = SuspensionOutput::default();
    for k in 0..2000_u32 {
        let force = 60.0 * (0.1 * f64::from(k)).sin() * f64::from(k % 7) / 7.0;
        suspension.step(&braked(force), &mut output);
        assert_eq!(output.status, Status::Converged, "tick {k}: {force} N");
    }
}

#[test]
fn without_a_period_or_at_rest_the_dampers_do_nothing() {
    let (mut damped, mut plain) =
        (Suspension::new(&bushed(0.01)).unwrap(), Suspension::new(&bushed(0.0)).unwrap());
    let (mut a, mut b) = (SuspensionOutput::default(), SuspensionOutput::default());
    for k in 0..50_u32 {
        damped.step(&braked(-50.0 * f64::from(k)), &mut a);
        plain.step(&braked(-50.0 * f64::from(k)), &mut b);
        assert_eq!(a, b);
    }
    damped.set_period(Some(PERIOD_S));
    for _ in 0..400 {
        damped.step(&braked(-2000.0), &mut a);
    }
    plain.step(&braked(-2000.0), &mut b);
    assert!((a.side[0].toe_rad - b.side[0].toe_rad).abs() < 1e-9);
    assert!((a.side[0].tie_rod_force_n - b.side[0].tie_rod_force_n).abs() < 1e-5);
}

#[test]
fn a_restored_bushed_axle_goes_on_bit_for_bit() {
    let mut axle = bushed(0.005);
    axle.kingpin_friction = Some(KingpinFriction { moment_n_m: 8.0, presliding_rad: 0.002 });
    let (mut one, mut two) = (Suspension::new(&axle).unwrap(), Suspension::new(&axle).unwrap());
    one.set_period(Some(PERIOD_S));
    two.set_period(Some(PERIOD_S));
    let input = |k: u32| {
        let t = PERIOD_S * f64::from(k);
        SuspensionInput {
            // One tick out of reach is held on the way.
            rack_m: if k == 160 { f64::NAN } else { 0.03 * (9.0 * t).sin() },
            rack_speed_m_s: 0.27 * (9.0 * t).cos(),
            wheel_height_m: [0.02 * (20.0 * t).sin(), -0.02 * (17.0 * t).sin()],
            wheel_force_n: [
                Vector3::new(-900.0 * (31.0 * t).sin(), 1500.0, 4000.0),
                Vector3::new(0.0, 900.0, 3000.0),
            ],
            wheel_moment_n_m: [Vector3::new(450.0, 10.0, -40.0), Vector3::new(300.0, -10.0, -60.0)],
            ..SuspensionInput::DESIGN
        }
    };
    let (mut a, mut b) = (SuspensionOutput::default(), SuspensionOutput::default());
    let mut state = vec![0.0; one.state_len()];
    for at in [40_u32, 161] {
        one.reset();
        for k in 0..at {
            one.step(&input(k), &mut a);
        }
        one.save_state(&mut state);
        two.load_state(&state);
        for k in at..at + 150 {
            one.step(&input(k), &mut a);
            two.step(&input(k), &mut b);
            assert_eq!(a, b, "saved at {at}, tick {k}");
        }
    }
}
