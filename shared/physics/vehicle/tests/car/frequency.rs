//! Yaw-rate frequency response against the same car's linear model: lateral velocity, yaw rate, roll, and lateral
//! force with relaxation at each axle (spec 3.3).
//!
//! Linear model, small motions about straight running at V, sprung centre of gravity as origin, roll axis at h'
//! below it. Contacts move sideways with v + h' p; the wheels lean with the body, so wheel stations with
//! v + (h' − h_u) p (h_u: wheel-centre height). With u = v̇ + V r:
//!   (m_s + m_u) u + Σ m_u (h' − h_u) ṗ + Σ m_u x ṙ = Y_f + Y_r
//!   I_x ṗ + Σ m_u (h' − h_u)(u + (h' − h_u) ṗ + x ṙ) = Σ h' Y − K φ − C p + g (m_s h' + Σ m_u h_u) φ + H r
//!   I_z ṙ + Σ m_u x (u + (h' − h_u) ṗ + x ṙ) = a Y_f − b Y_r + N − H p
//!   σ/V Ẏ + Y = C α + C_γ φ, N in proportion to Y, with H the spin momentum of the wheels.

use crate::analytic::{axle_loads, linear_tyre, plain_car, plain_tyre, stand_on};
use crate::support::*;
use std::f64::consts::TAU;

#[derive(Clone, Copy)]
struct Complex(f64, f64);

impl Complex {
    fn times(self, o: Self) -> Self {
        Self(self.0 * o.0 - self.1 * o.1, self.0 * o.1 + self.1 * o.0)
    }
    fn over(self, o: Self) -> Self {
        let n = o.0 * o.0 + o.1 * o.1;
        Self((self.0 * o.0 + self.1 * o.1) / n, (self.1 * o.0 - self.0 * o.1) / n)
    }
    fn minus(self, o: Self) -> Self {
        Self(self.0 - o.0, self.1 - o.1)
    }
}

/// Solves A x = b by elimination with pivoting.
fn solve(mut a: Vec<Vec<Complex>>, mut b: Vec<Complex>) -> Vec<Complex> {
    let n = b.len();
    for k in 0..n {
        let size = |z: Complex| z.0.hypot(z.1);
        let best = (k..n).max_by(|i, j| size(a[*i][k]).total_cmp(&size(a[*j][k]))).unwrap();
        a.swap(k, best);
        b.swap(k, best);
        for i in k + 1..n {
            let f = a[i][k].over(a[k][k]);
            for j in k..n {
                a[i][j] = a[i][j].minus(f.times(a[k][j]));
            }
            b[i] = b[i].minus(f.times(b[k]));
        }
    }
    for k in (0..n).rev() {
        for j in k + 1..n {
            b[k] = b[k].minus(a[k][j].times(b[j]));
        }
        b[k] = b[k].over(a[k][k]);
    }
    b
}

#[test]
fn yaw_rate_response_follows_the_linear_model() {
    let mut c = plain_car();
    let vertical = 4e6; // stiff, so that tyres do not roll: the linear model has none of that
    stand_on(&mut c, vertical);
    let text = with_keys(&plain_tyre(vertical), &[("Q_FZ2", 0.0)]);
    let speed = 25.0;
    let b = &c.body;
    let (a, l) = (b.front_axle_to_sprung_cg_m, b.wheelbase_m);
    let r = l - a;
    let loads = axle_loads(&c);
    let (f, k) = (linear_tyre(&text, loads[0], speed), linear_tyre(&text, loads[1], speed));
    let (ms, uf, ur) = (b.sprung_mass_kg, 2.0 * c.front.unsprung_mass_kg, 2.0 * c.rear.unsprung_mass_kg);
    let mu = uf + ur;
    let mux = uf * a - ur * r;
    // Yaw inertia of the stations about the sprung centre, their tracks included.
    let muxx = uf * (a * a + 0.25 * c.front.track_m.powi(2))
        + ur * (r * r + 0.25 * c.rear.track_m.powi(2))
        + 4.0 * 0.6;
    let rc = [&c.front, &c.rear].map(|x| x.kinematics.as_ref().unwrap().roll_centre_height_m);
    // Roll axis below the sprung centre of gravity, and at the axles.
    let axis = rc[0] + (rc[1] - rc[0]) * a / l;
    let h = b.sprung_cg_height_m - axis;
    let (hf, hr) = (b.sprung_cg_height_m - rc[0], b.sprung_cg_height_m - rc[1]);
    let mut stiffness = 0.0;
    let mut damping = 0.0;
    for axle in [&c.front, &c.rear] {
        let i2 = axle.spring.lever_ratio.powi(2);
        let spring = axle.spring.force_n[2] / axle.spring.compression_m[2];
        let damper = axle.damper.force_n[1] / axle.damper.speed_m_s[1];
        stiffness += 0.5 * axle.track_m.powi(2) * spring * i2 + axle.anti_roll_bar_n_m_rad;
        damping += 0.5 * axle.track_m.powi(2) * damper * axle.damper.lever_ratio.powi(2);
    }
    let re = 0.311;
    let momentum = 4.0 * 1.05 * speed / re;
    let (sf, sr) = (hf - c.front.wheel_centre_height_m, hr - c.rear.wheel_centre_height_m);
    let gravity = vehicle::GRAVITY_M_S2
        * (ms * h + uf * c.front.wheel_centre_height_m + ur * c.rear.wheel_centre_height_m);
    let mut worst = (0.0f64, 0.0f64);
    for frequency in [0.2, 0.5, 1.0, 1.5, 2.0] {
        let w = TAU * frequency;
        // Unknowns: v, r, p, Y_f, Y_r; φ = p/(jw).
        let j = |x: f64| Complex(0.0, w * x);
        let re_ = |x: f64| Complex(x, 0.0);
        let per = |x: f64| Complex(0.0, -x / w); // x/(jw)
        let lag = |s: f64| Complex(1.0, w * s / speed);
        let add = |x: Complex, y: Complex| Complex(x.0 + y.0, x.1 + y.1);
        let muh = uf * sf + ur * sr;
        let rows = vec![
            vec![j(ms + mu), add(j(mux), re_((ms + mu) * speed)), j(muh), re_(-1.0), re_(-1.0)],
            vec![
                j(muh),
                add(j(uf * sf * a - ur * sr * r), re_(muh * speed - momentum)),
                add(
                    add(j(b.roll_inertia_kg_m2 + uf * sf * sf + ur * sr * sr + 4.0 * 0.6), re_(damping)),
                    per(stiffness - gravity),
                ),
                re_(-hf),
                re_(-hr),
            ],
            vec![
                j(mux),
                add(j(b.yaw_inertia_kg_m2 + muxx), re_(mux * speed)),
                add(j(uf * sf * a - ur * sr * r), re_(momentum)),
                // Aligning moments in proportion to the slip part of the lateral forces.
                re_(-(a + f.mz / f.c)),
                re_(r - k.mz / k.c),
            ],
            vec![
                re_(2.0 * f.c / speed),
                re_(2.0 * f.c * a / speed),
                add(re_(2.0 * f.c * hf / speed), per(-2.0 * f.gamma)),
                lag(f.sigma),
                re_(0.0),
            ],
            vec![
                re_(2.0 * k.c / speed),
                re_(-2.0 * k.c * r / speed),
                add(re_(2.0 * k.c * hr / speed), per(-2.0 * k.gamma)),
                re_(0.0),
                lag(k.sigma),
            ],
        ];
        let zero = re_(0.0);
        let gain = solve(rows, vec![zero, zero, zero, re_(2.0 * f.c), zero])[1];
        // The car: sine steer of about 0.05 g.
        let amplitude = 0.004;
        let mut car = build_on(&c, &text);
        let mut input = hold(speed);
        car.reset(speed, &input);
        let periods = (3.0 * frequency).ceil() + 2.0;
        let steps = (periods / frequency * 1000.0).round() as usize;
        let window = ((2.0 / frequency) * 1000.0).round() as usize;
        let mut sums = [[0.0; 2]; 2];
        for n in 0..steps {
            input.time_s = 1e-3 * n as f64;
            input.steering_wheel_angle_rad = amplitude * (w * (input.time_s + 1e-3)).sin();
            car.step(&input);
            if n >= steps - window {
                let o = car.output();
                let (s, cos) = (w * o.time_s).sin_cos();
                let steer = 0.5 * (o.wheels[0].kinematic_steer_rad + o.wheels[1].kinematic_steer_rad);
                for (q, value) in sums.iter_mut().zip([steer, o.yaw_rate_rad_s]) {
                    q[0] += value * s;
                    q[1] += value * cos;
                }
            }
        }
        let measured = Complex(sums[1][0], sums[1][1]).over(Complex(sums[0][0], sums[0][1]));
        let ratio = measured.over(gain);
        let db = 20.0 * ratio.0.hypot(ratio.1).log10();
        let degrees = ratio.1.atan2(ratio.0).to_degrees();
        println!(
            "{frequency} Hz: yaw rate/steer {:.3} 1/s at {:.2} deg, linear {:.3} at {:.2}: {db:+.3} dB {degrees:+.2} deg",
            measured.0.hypot(measured.1),
            measured.1.atan2(measured.0).to_degrees(),
            gain.0.hypot(gain.1),
            gain.1.atan2(gain.0).to_degrees()
        );
        worst = (worst.0.max(db.abs()), worst.1.max(degrees.abs()));
    }
    assert!(worst.0 <= 1.0 && worst.1 <= 3.0, "worst {worst:?} dB, degrees");
}
