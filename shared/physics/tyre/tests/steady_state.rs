//! Steady state beyond the reference tables: finite for any finite input, turn slip, spring and radius.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use proptest::prelude::*;
use std::sync::OnceLock;
use support::{reference, shipped, tyres};
use tyre::{Contact, Motion, TransientState, Tyre, UseMode};

const MODES: [UseMode; 4] =
    [UseMode::SmallAngle, UseMode::AlphaStar, UseMode::SmallAngleTurnSlip, UseMode::AlphaStarTurnSlip];

fn all() -> &'static [Tyre] {
    static TYRES: OnceLock<Vec<Tyre>> = OnceLock::new();
    TYRES.get_or_init(tyres)
}

fn contact(tyre: &Tyre) -> Contact {
    Contact {
        vertical_load_n: tyre.info().nominal_load_n,
        slip_ratio: 0.0,
        slip_angle_rad: 0.0,
        camber_rad: 0.0,
        turn_slip_per_m: 0.0,
        speed_m_s: 16.7,
        pressure_pa: tyre.info().inflation_pressure_pa,
        friction_scale: [1.0; 2],
    }
}

/// Any finite number, with the awkward ones often.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        3 => -10.0..10.0_f64,
        1 => -1e6..1e6_f64,
        2 => prop::sample::select(vec![0.0, -0.0, 1.0, -1.0, 1e-300, 1e300, -1e300, std::f64::consts::FRAC_PI_2, -1e-12, f64::MAX, f64::MIN]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn finite_for_any_finite_input(
        n in prop::array::uniform9(any_number()), which in 0..6_usize, mode in 0..4_usize, dt in 0.0..0.1_f64
    ) {
        let tyre = &all()[which % all().len()];
        let c = Contact {
            vertical_load_n: n[0] * 1000.0,
            slip_ratio: n[1],
            slip_angle_rad: n[2],
            camber_rad: n[3],
            turn_slip_per_m: n[4],
            speed_m_s: n[5],
            pressure_pa: n[6] * 1e5,
            friction_scale: [n[7], n[8]],
        };
        let c = Contact { vertical_load_n: if c.vertical_load_n.is_finite() { c.vertical_load_n } else { n[0] }, ..c };
        let c = Contact { pressure_pa: if c.pressure_pa.is_finite() { c.pressure_pa } else { n[6] }, ..c };
        let f = tyre.steady_state(&c, MODES[mode]);
        for v in [f.fx_n, f.fy_n, f.mx_n_m, f.my_n_m, f.mz_n_m, f.trail_m, f.mu_x, f.mu_y] {
            prop_assert!(v.is_finite(), "{f:?} at {c:?}");
        }
        let s = tyre.shape(&c, &f);
        for v in [s.effective_rolling_radius_m, s.deflection_m, s.loaded_radius_m, s.contact_length_m, s.relaxation_length_m[0], s.relaxation_length_m[1]] {
            prop_assert!(v.is_finite(), "{s:?} at {c:?} {f:?}");
        }
        let mut state = TransientState::default();
        let m = Motion {
            vertical_load_n: c.vertical_load_n,
            speed_m_s: n[1],
            slip_speed_x_m_s: n[2],
            slip_speed_y_m_s: n[3],
            spin_rate_rad_s: n[4],
            camber_rad: n[5],
            pressure_pa: c.pressure_pa,
            friction_scale: c.friction_scale,
        };
        for _ in 0..3 {
            let f = tyre.transient_step(&mut state, &m, MODES[mode], dt);
            for v in [f.fx_n, f.fy_n, f.mx_n_m, f.my_n_m, f.mz_n_m, state.u_m, state.v_m, state.yaw_rad, state.energy_j()] {
                prop_assert!(v.is_finite(), "{f:?} {state:?} at {m:?}");
            }
        }
    }
}

#[test]
fn no_load_no_force() {
    for tyre in all() {
        for load in [0.0, -100.0, f64::NAN] {
            let c = Contact { vertical_load_n: load, slip_angle_rad: 0.1, slip_ratio: 0.1, ..contact(tyre) };
            assert_eq!(tyre.steady_state(&c, UseMode::SmallAngle).fy_n, 0.0);
        }
        let tiny = Contact { vertical_load_n: 1e-6, slip_angle_rad: 0.1, slip_ratio: 0.1, ..contact(tyre) };
        assert!(tyre.steady_state(&tiny, UseMode::SmallAngle).fy_n.abs() < 1e-3);
    }
}

/// Reverse driving is the mirrored picture: with odd curves, Fx and Fy keep opposing the slip.
#[test]
fn forces_oppose_the_slip_in_reverse() {
    for tyre in all() {
        for speed in [-16.7, 16.7] {
            // Vsx = -κ Vcx, Vsy = tan α |Vcx|.
            let c = Contact { speed_m_s: speed, slip_ratio: -0.1, slip_angle_rad: 0.1, ..contact(tyre) };
            let f = tyre.steady_state(&c, UseMode::AlphaStar);
            assert!(f.fx_n * 0.1 * speed < 0.0 && f.fy_n < 0.0 && f.my_n_m * speed < 0.0, "{f:?}");
            // Behind the centre, seen in the direction of travel.
            let small = Contact { slip_ratio: 0.0, slip_angle_rad: 0.03, ..c };
            let f = tyre.steady_state(&small, UseMode::AlphaStar);
            assert!(f.trail_m * speed > 0.0, "{f:?}");
        }
    }
}

/// ζ factors of no turn slip are 1; with turn slip forces fall, and a turn to the left meets a torque to the right.
#[test]
fn turn_slip_limits() {
    let Some(text) = reference("tyre/mfeval_MF61.tir") else { return };
    let tyre = Tyre::from_tir(&text, "mfeval_MF61.tir").unwrap();
    assert!(tyre.info().has_turn_slip);
    let c = Contact { slip_angle_rad: 0.06, slip_ratio: 0.03, ..contact(&tyre) };
    for (plain, turning) in
        [(UseMode::SmallAngle, UseMode::SmallAngleTurnSlip), (UseMode::AlphaStar, UseMode::AlphaStarTurnSlip)]
    {
        let a = tyre.steady_state(&c, plain);
        let b = tyre.steady_state(&c, turning);
        assert!(
            (a.fx_n - b.fx_n).abs() < 1e-6
                && (a.fy_n - b.fy_n).abs() < 1e-6
                && (a.mz_n_m - b.mz_n_m).abs() < 1e-6,
            "{a:?} {b:?}"
        );
        let mut before = b;
        for turn in [0.05, 0.1, 0.2, 0.4] {
            let f = tyre.steady_state(&Contact { turn_slip_per_m: turn, ..c }, turning);
            assert!(f.fx_n.abs() < before.fx_n.abs(), "peak falls with spin (4.105)");
            before = f;
        }
    }
    // Pure turn slip: Mz changes sign with it.
    let spin = |turn: f64| {
        let at = |t| {
            tyre.steady_state(&Contact { turn_slip_per_m: t, ..contact(&tyre) }, UseMode::SmallAngleTurnSlip)
                .mz_n_m
        };
        at(turn) - at(0.0)
    };
    assert!(spin(0.1) * spin(-0.1) < 0.0, "{} {}", spin(0.1), spin(-0.1));
}

/// Spring, its slope and its inverse belong together; the effective radius lies between loaded and free radius.
#[test]
fn spring_and_radii_are_consistent() {
    for tyre in all() {
        let info = tyre.info();
        let p = info.inflation_pressure_pa;
        for load in [0.2, 0.6, 1.0, 1.4] {
            let load = load * info.nominal_load_n;
            let omega = 60.0;
            let loaded = tyre.loaded_radius_m(load, omega, 0.0, p);
            let rho = tyre.free_radius_m(omega) - loaded;
            let force = tyre.vertical_force_n(rho, 0.0, omega, 0.0, 0.0, p);
            assert!((force / load - 1.0).abs() < 1e-9, "{}: {force} of {load}", info.file_name);
            let h = 1e-6;
            let slope = (tyre.vertical_force_n(rho + h, 0.0, omega, 0.0, 0.0, p)
                - tyre.vertical_force_n(rho - h, 0.0, omega, 0.0, 0.0, p))
                / (2.0 * h);
            assert!((slope / tyre.vertical_stiffness_n_m(rho, omega, p) - 1.0).abs() < 1e-6);
            let effective = tyre.effective_rolling_radius_m(load, omega, p);
            // (At light loads the files' BREFF makes it fall faster than the loaded radius.)
            assert!(effective < tyre.free_radius_m(omega), "{}", info.file_name);
            assert!(loaded < effective || load < 0.5 * info.nominal_load_n, "{}", info.file_name);
        }
        assert_eq!(tyre.vertical_force_n(-0.01, 1.0, 0.0, 0.0, 0.0, p), 0.0);
        assert_eq!(tyre.vertical_force_n(0.001, -1e3, 0.0, 0.0, 0.0, p), 0.0);
    }
}

/// Numbers of the book: peak friction, slip stiffness and cornering stiffness of 205/60 R15 at nominal load
/// (coefficients PDX1, PKX1, PDY1, PKY1 with PKY2).
#[test]
fn shipped_tyre_has_the_books_figures() {
    let tyre = shipped();
    let f = tyre.steady_state(&contact(&tyre), UseMode::AlphaStar);
    assert!((f.mu_x - 1.21).abs() < 1e-12 && (f.mu_y.abs() - 0.99).abs() < 1e-12);
    assert!((f.longitudinal_slip_stiffness_n - 4000.0 * 21.51).abs() < 1e-6);
    let cornering = 14.95 * 4000.0 * (2.0 * (1.0_f64 / 2.13).atan()).sin();
    assert!((f.cornering_stiffness_n_rad.abs() - cornering).abs() < 1e-6);
}

/// The arm of Fx in Mz takes side force over Fz0, not over Fz0' (A56): seen only with LFZO other than 1, which no
/// reference table has together with SSZ2.
#[test]
fn arm_of_fx_is_over_the_nominal_load() {
    let path = support::workspace().join("schemas/tyres/car_205_60r15.tir");
    let text = std::fs::read_to_string(path).unwrap();
    let text = text
        .replace("LFZO = 1\n", "LFZO = 0.7\n")
        .replace("SSZ2 = 0.001", "SSZ2 = 0.03")
        .replace("RVY1 = 0.053", "RVY1 = 0")
        .replace("RVY2 = -0.073", "RVY2 = 0");
    let tyre = Tyre::from_tir(&text, "x.tir").unwrap();
    let c = Contact { slip_ratio: -0.05, slip_angle_rad: 0.05, ..contact(&tyre) };
    let f = tyre.steady_state(&c, UseMode::SmallAngle);
    // At zero camber and without κ-induced side force Fy' is Fy (4.E71), (4.E72).
    let arm = (f.mz_n_m + f.trail_m * f.fy_n - f.residual_torque_n_m) / f.fx_n;
    let expected = 0.313 * (0.043 + 0.03 * f.fy_n / 4000.0);
    assert!((arm - expected).abs() < 1e-12, "{arm} {expected}");
}
