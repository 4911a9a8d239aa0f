//! A quarter car on one wheel, stepped explicitly at 1 ms: braking to a stand with a locked and with a rolling
//! wheel, driving off, reversing; and the effect of the step size.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use support::tyres;
use tyre::{Motion, TransientState, Tyre, UseMode};

/// Longitudinal quarter car; brake torque by regularised dry friction of the wheel.
struct Quarter<'a> {
    tyre: &'a Tyre,
    state: TransientState,
    speed: f64,
    omega: f64,
    way: f64,
    fx: f64,
}

impl<'a> Quarter<'a> {
    fn new(tyre: &'a Tyre, speed: f64) -> Self {
        let fz = tyre.info().nominal_load_n;
        let re = tyre.effective_rolling_radius_m(fz, 0.0, tyre.info().inflation_pressure_pa);
        Self { tyre, state: TransientState::default(), speed, omega: speed / re, way: 0.0, fx: 0.0 }
    }

    /// Steps with semi-implicit Euler. `brake`: largest brake torque [N m].
    fn step(&mut self, drive: f64, brake: f64, slope: f64, dt: f64) {
        let fz = self.tyre.info().nominal_load_n;
        let pressure = self.tyre.info().inflation_pressure_pa;
        let re = self.tyre.effective_rolling_radius_m(fz, self.omega, pressure);
        let f = self.tyre.transient_step(
            &mut self.state,
            &Motion {
                vertical_load_n: fz,
                speed_m_s: self.speed,
                slip_speed_x_m_s: self.speed - self.omega * re,
                slip_speed_y_m_s: 0.0,
                spin_rate_rad_s: 0.0,
                camber_rad: 0.0,
                pressure_pa: pressure,
                friction_scale: [1.0; 2],
            },
            UseMode::AlphaStar,
            dt,
        );
        let inertia = 1.2;
        let free = self.omega + dt * (drive - f.fx_n * re + f.my_n_m) / inertia;
        // The brake takes at most what stops the wheel.
        let stop = brake * dt / inertia;
        self.omega = if free.abs() <= stop { 0.0 } else { free - stop * free.signum() };
        self.speed += dt * (f.fx_n / (fz / 9.81) - 9.81 * slope);
        self.way += dt * self.speed;
        self.fx = f.fx_n;
    }
}

#[test]
fn brakes_to_a_stand_and_stays() {
    for tyre in tyres() {
        // Half the grip, and enough to lock.
        for share in [0.5, 5.0] {
            let brake = share * tyre.info().nominal_load_n * tyre.info().unloaded_radius_m;
            let mut car = Quarter::new(&tyre, 15.0);
            for _ in 0..8000 {
                car.step(0.0, brake, 0.0, 1e-3);
            }
            let way = car.way;
            let mut rest = 0.0_f64;
            for _ in 0..2000 {
                car.step(0.0, brake, 0.0, 1e-3);
                rest = rest.max(car.speed.abs());
            }
            println!("{} brake {brake:.0} N m: {way:.2} m, then {rest:.1e} m/s", tyre.info().file_name);
            // v²/(2 μ g) with friction between a half and the peak.
            assert!(way > 7.0 && way < 40.0, "{way}");
            assert!(rest < 1e-3 && (car.way - way).abs() < 1e-3, "{rest} {}", car.way - way);
        }
    }
}

#[test]
fn drives_off_and_reverses_smoothly() {
    for tyre in tyres() {
        let mut car = Quarter::new(&tyre, 0.0);
        let mut before: Option<f64> = None;
        let mut jump = 0.0_f64;
        for i in 0..8000 {
            // Forward for two seconds, then backward through standstill.
            let drive = if i < 2000 { 300.0 } else { -300.0 };
            car.step(drive, 0.0, 0.0, 1e-3);
            if (2500..7900).contains(&i) {
                jump = jump.max(before.map_or(0.0, |b| (car.fx - b).abs()));
                before = Some(car.fx);
            }
        }
        println!(
            "{}: {:.2} m/s, largest change of Fx in a step {jump:.1} N",
            tyre.info().file_name,
            car.speed
        );
        assert!(car.speed < -3.0, "{}", car.speed);
        assert!(jump < 0.02 * tyre.info().nominal_load_n, "{jump} N");
    }
}

#[test]
fn holds_on_a_slope_with_the_brake_and_rolls_without() {
    for tyre in tyres() {
        let mut car = Quarter::new(&tyre, 0.0);
        for _ in 0..5000 {
            car.step(0.0, 3000.0, 0.2, 1e-3);
        }
        assert!(car.way.abs() < 0.05 && car.speed.abs() < 1e-3, "{} m {} m/s", car.way, car.speed);
        for _ in 0..2000 {
            car.step(0.0, 0.0, 0.2, 1e-3);
        }
        assert!(car.speed < -2.5, "{}", car.speed);
    }
}

#[test]
fn half_the_step_changes_little() {
    for tyre in tyres() {
        let way = |dt: f64| {
            let mut car = Quarter::new(&tyre, 15.0);
            for _ in 0..(4.0 / dt) as usize {
                car.step(0.0, 0.6 * tyre.info().nominal_load_n * tyre.info().unloaded_radius_m, 0.0, dt);
            }
            car.way
        };
        let (a, b) = (way(1e-3), way(0.5e-3));
        println!("{}: stops in {a:.4} m, {b:.4} m with half the step", tyre.info().file_name);
        assert!((a / b - 1.0).abs() < 0.005, "{a} {b}");
    }
}
