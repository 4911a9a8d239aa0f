//! What evaluation costs: no allocation, and the time of one call (printed, not judged).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use std::hint::black_box;
use std::time::Instant;
use support::tyres;
use tyre::{Contact, Motion, TransientState, UseMode};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

/// A different contact each time, all slips combined, with camber.
fn contact(i: u32, load: f64, pressure: f64) -> Contact {
    let t = f64::from(i);
    Contact {
        vertical_load_n: load * (1.0 + 0.4 * (0.37 * t).sin()),
        slip_ratio: 0.1 * (0.23 * t).sin(),
        slip_angle_rad: 0.12 * (0.31 * t).cos(),
        camber_rad: 0.03 * (0.11 * t).sin(),
        turn_slip_per_m: 0.02,
        speed_m_s: 20.0 + 10.0 * (0.07 * t).sin(),
        pressure_pa: pressure,
        friction_scale: [1.0; 2],
    }
}

fn motion(c: &Contact) -> Motion {
    Motion {
        vertical_load_n: c.vertical_load_n,
        speed_m_s: c.speed_m_s,
        slip_speed_x_m_s: -c.slip_ratio * c.speed_m_s,
        slip_speed_y_m_s: c.slip_angle_rad.tan() * c.speed_m_s,
        spin_rate_rad_s: 0.2,
        camber_rad: c.camber_rad,
        pressure_pa: c.pressure_pa,
        friction_scale: [1.0; 2],
    }
}

/// Nanoseconds per call in batches of 64: p50, p99.9, max.
fn time(mut call: impl FnMut(usize)) -> [f64; 3] {
    let mut batches: Vec<f64> = (0..2000)
        .map(|batch| {
            let start = Instant::now();
            for i in 0..64 {
                call((batch * 64 + i) % 1024);
            }
            start.elapsed().as_nanos() as f64 / 64.0
        })
        .collect();
    batches.sort_by(f64::total_cmp);
    [batches[1000], batches[1998], batches[1999]]
}

#[test]
fn does_not_allocate_and_prints_its_time() {
    for tyre in tyres() {
        let info = tyre.info();
        let contacts: Vec<Contact> =
            (0..1024).map(|i| contact(i, info.nominal_load_n, info.inflation_pressure_pa)).collect();
        let motions: Vec<Motion> = contacts.iter().map(motion).collect();
        let mut state = TransientState::default();
        assert_no_alloc(|| {
            for (c, m) in contacts.iter().zip(&motions) {
                for mode in [UseMode::SmallAngle, UseMode::AlphaStarTurnSlip] {
                    let f = tyre.steady_state(c, mode);
                    black_box(tyre.shape(c, &f));
                    black_box(tyre.transient_step(&mut state, m, mode, 1e-3));
                }
                black_box(tyre.vertical_force_n(0.02, 0.1, 60.0, 100.0, 100.0, c.pressure_pa));
            }
        });
        assert_eq!(violation_count(), 0);
        println!("{} [ns per call: p50, p99.9, max]", info.file_name);
        for mode in [UseMode::SmallAngle, UseMode::AlphaStar] {
            let t = time(|i| {
                black_box(tyre.steady_state(black_box(&contacts[i]), mode));
            });
            println!("  steady state {mode:?}: {t:.0?}");
        }
        for mode in [UseMode::SmallAngle, UseMode::AlphaStar] {
            let t = time(|i| {
                black_box(tyre.transient_step(&mut state, black_box(&motions[i]), mode, 1e-3));
            });
            println!("  transient step {mode:?}: {t:.0?}");
        }
    }
}
