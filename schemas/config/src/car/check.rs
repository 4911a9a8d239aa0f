//! Rules of the car section that join several fields: what its schema cannot say.
//!
//! Each rule names the key and what must hold; the loader adds file and line.

use super::{AssistedSteering, Car, CarAxle, Combustion, Coupling, Powertrain, SteeringSystem};
use crate::check::{Check, Checker};

fn increasing(values: &[f64]) -> bool {
    values.len() >= 2 && values.iter().all(|v| v.is_finite()) && values.windows(2).all(|w| w[0] < w[1])
}

fn finite(values: &[f64]) -> bool {
    values.iter().all(|v| v.is_finite())
}

/// Rules of a curve given as two arrays.
fn curve(c: &mut Checker, x_key: &str, x: &[f64], y_key: &str, y: &[f64]) {
    c.require(increasing(x), x_key, "must have at least 2 entries, finite and increasing");
    c.require(
        y.len() == x.len() && finite(y),
        y_key,
        format!("must have one finite entry for each of {x_key}"),
    );
}

impl Check for Car {
    fn check(&self, c: &mut Checker) {
        let b = &self.body;
        c.within("body", |c| {
            c.require(
                b.front_axle_to_sprung_cg_m < b.wheelbase_m,
                "front_axle_to_sprung_cg_m",
                "must be less than wheelbase_m",
            );
            c.require(
                b.roll_inertia_kg_m2 + b.pitch_inertia_kg_m2 > b.yaw_inertia_kg_m2
                    && b.roll_inertia_kg_m2 * b.yaw_inertia_kg_m2 > b.xz_product_kg_m2.powi(2),
                "yaw_inertia_kg_m2",
                "must be less than the sum of roll and pitch inertia, and the inertia tensor positive definite",
            );
        });
        c.within("front", |c| self.front.check(c));
        c.within("rear", |c| self.rear.check(c));
        c.within("steering", |c| match &self.steering {
            SteeringSystem::Kinematic { rack_per_steering_wheel_m_rad, .. } => {
                c.require(
                    *rack_per_steering_wheel_m_rad != 0.0,
                    "rack_per_steering_wheel_m_rad",
                    "must not be 0",
                );
            }
            SteeringSystem::Assisted(s) => s.check(c),
        });
        if let Powertrain::Combustion(p) = &self.powertrain {
            c.within("powertrain", |c| p.check(c));
        }
    }
}

impl Check for CarAxle {
    fn check(&self, c: &mut Checker) {
        c.require(
            self.axle_file.is_some() != self.kinematics.is_some(),
            "axle_file",
            "exactly one of axle_file and kinematics must be given",
        );
        c.require(
            self.wheel_mass_kg <= self.unsprung_mass_kg,
            "wheel_mass_kg",
            "must not be more than unsprung_mass_kg, which includes the wheel",
        );
        c.within("spring", |c| {
            let s = &self.spring;
            curve(c, "compression_m", &s.compression_m, "force_n", &s.force_n);
            c.require(
                s.force_n.windows(2).all(|w| w[0] <= w[1]),
                "force_n",
                "must not fall with compression",
            );
        });
        c.within("damper", |c| {
            let d = &self.damper;
            curve(c, "speed_m_s", &d.speed_m_s, "force_n", &d.force_n);
            c.require(
                d.force_n.windows(2).all(|w| w[0] <= w[1])
                    && d.speed_m_s.iter().zip(&d.force_n).all(|(v, f)| v * f >= 0.0),
                "force_n",
                "must not fall with speed and must oppose it (a damper creates no energy)",
            );
        });
    }
}

impl Check for AssistedSteering {
    fn check(&self, c: &mut Checker) {
        curve(c, "pinion_rad", &self.pinion_rad, "rack_m", &self.rack_m);
        c.require(
            self.rack_m.windows(2).all(|w| w[0] < w[1]) || self.rack_m.windows(2).all(|w| w[0] > w[1]),
            "rack_m",
            "must be strictly monotonic",
        );
        c.require(
            increasing(&self.assist_torque_n_m) && self.assist_torque_n_m.first() == Some(&0.0),
            "assist_torque_n_m",
            "must start at 0 and have at least 2 entries, finite and increasing",
        );
        c.require(
            increasing(&self.assist_speed_m_s),
            "assist_speed_m_s",
            "must have at least 2 entries, finite and increasing",
        );
        c.require(
            self.assist_force_n.len() == self.assist_speed_m_s.len()
                && self.assist_force_n.iter().all(|row| {
                    row.len() == self.assist_torque_n_m.len() && finite(row) && row.first() == Some(&0.0)
                }),
            "assist_force_n",
            "must have one row for each of assist_speed_m_s, each starting at 0 with one finite entry for each of assist_torque_n_m",
        );
    }
}

impl Check for Combustion {
    fn check(&self, c: &mut Checker) {
        c.within("engine", |c| {
            let e = &self.engine;
            curve(c, "speed_rpm", &e.speed_rpm, "full_throttle_n_m", &e.full_throttle_n_m);
            curve(c, "speed_rpm", &e.speed_rpm, "closed_throttle_n_m", &e.closed_throttle_n_m);
            c.require(e.idle_rpm < e.limit_rpm, "idle_rpm", "must be less than limit_rpm");
            c.require(
                e.full_throttle_n_m.iter().zip(&e.closed_throttle_n_m).all(|(f, z)| f >= z),
                "closed_throttle_n_m",
                "must not be more than full_throttle_n_m",
            );
        });
        if let Coupling::TorqueConverter { speed_ratio, torque_ratio, capacity_n_m_s2, .. } = &self.coupling {
            c.within("coupling", |c| {
                curve(c, "speed_ratio", speed_ratio, "torque_ratio", torque_ratio);
                curve(c, "speed_ratio", speed_ratio, "capacity_n_m_s2", capacity_n_m_s2);
                c.require(
                    speed_ratio.first() == Some(&0.0) && speed_ratio.last().is_some_and(|last| *last == 1.0),
                    "speed_ratio",
                    "must run from 0 to 1",
                );
                c.require(
                    capacity_n_m_s2.iter().all(|k| *k >= 0.0) && torque_ratio.iter().all(|r| *r >= 0.0),
                    "capacity_n_m_s2",
                    "and torque_ratio must not be negative",
                );
                c.require(
                    speed_ratio.iter().zip(torque_ratio).all(|(v, m)| v * m <= 1.0 + 1e-9),
                    "torque_ratio",
                    "times speed_ratio must not be more than 1 (a converter creates no energy)",
                );
            });
        }
        c.within("gearbox", |c| {
            let g = &self.gearbox;
            let gears = g.forward_ratios.len();
            c.require(
                (1..=20).contains(&gears)
                    && g.forward_ratios.iter().all(|r| *r > 0.0 && *r <= 30.0)
                    && g.forward_ratios.windows(2).all(|w| w[0] > w[1]),
                "forward_ratios",
                "must have 1 to 20 falling entries in (0, 30]",
            );
            c.require(
                increasing(&g.shift_throttle),
                "shift_throttle",
                "must have at least 2 entries, finite and increasing",
            );
            for (key, map) in [("upshift_rpm", &g.upshift_rpm), ("downshift_rpm", &g.downshift_rpm)] {
                c.require(
                    map.len() + 1 == gears
                        && map.iter().all(|row| row.len() == g.shift_throttle.len() && finite(row)),
                    key,
                    "must have one row less than there are gears, each with one finite entry for each of shift_throttle",
                );
            }
        });
    }
}
