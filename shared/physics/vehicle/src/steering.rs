//! The car's own steering, used when no measured rack replaces it: steering wheel → torsion bar → pinion →
//! assisted rack.
//!
//! Rack: m ẍ = T_bar dφ/dx + F_assist(T_bar, v) + F_wheels − d ẋ − Coulomb friction, with the pinion angle
//! φ(x) from the ratio map and T_bar = k (δ_H − φ) + c (δ̇_H − φ̇). Semi-implicit; friction and damping
//! implicit, so sticking needs no regularisation. End stops take the rack's speed.

use crate::curve::{Curve, Family};
use config::car::{AssistedSteering, SteeringSystem};

/// Constants.
#[derive(Debug, Clone, PartialEq)]
pub struct Steering {
    travel_m: f64,
    kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    Kinematic { ratio: f64 },
    Assisted(Box<Assisted>),
}

#[derive(Debug, Clone, PartialEq)]
struct Assisted {
    rack: Curve,
    pinion: Curve,
    mass: f64,
    damping: f64,
    friction: f64,
    bar: f64,
    bar_damping: f64,
    assist: Family,
}

impl Steering {
    /// From the car file.
    ///
    /// # Errors
    /// If the ratio map is not monotonic.
    pub fn new(c: &SteeringSystem) -> Result<Self, String> {
        Ok(match c {
            SteeringSystem::Kinematic { rack_per_steering_wheel_m_rad, rack_travel_m } => Self {
                travel_m: *rack_travel_m,
                kind: Kind::Kinematic { ratio: *rack_per_steering_wheel_m_rad },
            },
            SteeringSystem::Assisted(a) => {
                Self { travel_m: a.rack_travel_m, kind: Kind::Assisted(Box::new(Assisted::new(a)?)) }
            }
        })
    }

    /// Largest rack displacement to either side. [m]
    #[must_use]
    pub fn travel_m(&self) -> f64 {
        self.travel_m
    }

    /// Rack displacement for a steering-wheel angle without load. [m]
    #[must_use]
    pub fn unloaded_rack_m(&self, steering_wheel_rad: f64) -> f64 {
        let rack = match &self.kind {
            Kind::Kinematic { ratio } => ratio * steering_wheel_rad,
            Kind::Assisted(a) => a.rack.value(steering_wheel_rad),
        };
        rack.clamp(-self.travel_m, self.travel_m)
    }

    /// Steering-wheel angle that a rigid steering shows at a rack displacement. [rad]
    #[must_use]
    pub fn steering_wheel_rad(&self, rack_m: f64) -> f64 {
        match &self.kind {
            Kind::Kinematic { ratio } => rack_m / ratio,
            Kind::Assisted(a) => a.pinion.value(rack_m),
        }
    }

    /// Whether the rack has a motion of its own.
    #[must_use]
    pub fn dynamic(&self) -> bool {
        matches!(self.kind, Kind::Assisted(_))
    }

    /// One sub-step of rack displacement and rate; gives the torsion-bar torque. [N·m]
    pub fn advance(
        &self,
        rack_m: &mut f64,
        rack_rate_m_s: &mut f64,
        wheel: (f64, f64),
        wheels_force_n: f64,
        speed_m_s: f64,
        h: f64,
    ) -> f64 {
        let Kind::Assisted(a) = &self.kind else { return 0.0 };
        let (angle, rate) = wheel;
        let (pinion, pinion_per_rack) = a.pinion.value_and_slope(*rack_m);
        let torque = a.bar * (angle - pinion) + a.bar_damping * (rate - pinion_per_rack * *rack_rate_m_s);
        // Assist acts the way the torsion bar pushes the rack.
        let assist = a.assist.held(speed_m_s.abs(), torque.abs()) * (torque * pinion_per_rack).signum();
        let push = torque * pinion_per_rack + assist + wheels_force_n;
        let implicit = a.damping + a.bar_damping * pinion_per_rack * pinion_per_rack;
        // Damping is in `push` at the old rate already for the bar; take the rest implicitly.
        let free = (*rack_rate_m_s
            + h * (push + a.bar_damping * pinion_per_rack * pinion_per_rack * *rack_rate_m_s) / a.mass)
            / (1.0 + h * implicit / a.mass);
        let slow = h * a.friction / a.mass;
        *rack_rate_m_s = free.signum() * (free.abs() - slow).max(0.0);
        *rack_m += h * *rack_rate_m_s;
        if rack_m.abs() > self.travel_m {
            *rack_m = rack_m.clamp(-self.travel_m, self.travel_m);
            *rack_rate_m_s = 0.0;
        }
        torque
    }
}

impl Assisted {
    fn new(a: &AssistedSteering) -> Result<Self, String> {
        let rack = Curve::new(&a.pinion_rad, &a.rack_m, 1.0, 1.0);
        Ok(Self {
            pinion: rack.inverse().ok_or("rack_m must be strictly monotonic")?,
            rack,
            mass: a.rack_mass_kg,
            damping: a.rack_damping_n_s_m,
            friction: a.rack_friction_n,
            bar: a.torsion_bar_n_m_rad,
            bar_damping: a.torsion_bar_damping_n_m_s_rad,
            assist: Family::new(&a.assist_speed_m_s, &a.assist_torque_n_m, &a.assist_force_n, 1.0),
        })
    }
}
