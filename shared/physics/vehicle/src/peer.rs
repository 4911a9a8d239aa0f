//! Simplifications of the models that a car can be matched to (section `peer_model` of a car).
//!
//! Each is a statement of another model in place of ours, after the contacts are known and before the tyres are
//! asked: slip angles without the sideways motion of the contacts by the body's roll, inclination from roll and
//! travel by a constant, shifts of the lateral force by the sign of inclination. Source of the forms: Allen et al.,
//! "Vehicle dynamic stability and rollover" (DOT HS 807 956, 1992) as written out in Althoff & Wuersching,
//! "CommonRoad: Vehicle Models" (2020), mirrored from their axes (y right, z down) to ISO 8855.

use crate::io::WHEELS;
use crate::station::{Contact, Station};
use crate::vehicle::GRAVITY_M_S2;
use config::car::{Car, PeerModel};
use nalgebra::{Matrix3, Vector3};
use tyre::{Forces, Motion, TransientState, Tyre, UseMode};

/// Another model's simplifications.
#[derive(Debug, Clone)]
pub(crate) struct Peer {
    inclination_per_travel: [Option<f64>; 2],
    slip_at_centre: bool,
    height_m: f64,
    axle_height_m: [f64; 2],
    track_m: [f64; 2],
    transition_rad: f64,
    rigid_axles: bool,
    /// Sprung weight on each axle times its wheel centres' height, both, where it is missing. [N·m]
    missing_n_m: f64,
    /// Tyres with reversed shifts.
    reversed: Option<[Tyre; WHEELS]>,
}

impl Peer {
    pub(crate) fn new(p: &PeerModel, car: &Car, tyres: &[Tyre; WHEELS]) -> Self {
        let b = &car.body;
        let front = 1.0 - b.front_axle_to_sprung_cg_m / b.wheelbase_m;
        let weight = b.sprung_mass_kg * GRAVITY_M_S2 * f64::from(u8::from(p.springs_without_side_shift));
        Self {
            rigid_axles: p.rigid_axles,
            missing_n_m: weight
                * (front * car.front.wheel_centre_height_m + (1.0 - front) * car.rear.wheel_centre_height_m),
            inclination_per_travel: [
                p.front_inclination_per_travel_rad_m,
                p.rear_inclination_per_travel_rad_m,
            ],
            slip_at_centre: p.slip_at_centre_of_gravity,
            height_m: car.body.sprung_cg_height_m,
            axle_height_m: [car.front.wheel_centre_height_m, car.rear.wheel_centre_height_m],
            track_m: [car.front.track_m, car.rear.track_m],
            transition_rad: p.shift_transition_rad,
            reversed: p
                .shifts_follow_inclination
                .then(|| [0, 1, 2, 3].map(|i| tyres[i].with_reversed_shifts())),
        }
    }

    /// Another tyre on a wheel, already mirrored to its side.
    pub(crate) fn set_tyre(&mut self, wheel: usize, tyre: &Tyre) {
        if let Some(reversed) = &mut self.reversed {
            reversed[wheel] = tyre.with_reversed_shifts();
        }
    }

    /// Puts the other model's inclination and slip into the contacts. `angular`: of the body, its axes.
    pub(crate) fn adjust(
        &self,
        contacts: &mut [Contact; WHEELS],
        stations: &[Station; WHEELS],
        travel: &[f64; WHEELS],
        angular: &Vector3<f64>,
        to_earth: &Matrix3<f64>,
    ) {
        let roll = to_earth[(2, 1)].atan2(to_earth[(2, 2)]);
        for axle in 0..2 {
            let (left, right) = (2 * axle, 2 * axle + 1);
            if let Some(gain) = self.inclination_per_travel[axle] {
                contacts[left].inclination_rad = roll - gain * travel[left];
                contacts[right].inclination_rad = roll + gain * travel[right];
            }
            if self.slip_at_centre {
                // The axle's own roll rate, by its tyres' deflection.
                let rise = |i: usize| stations[i].v.dot(&contacts[i].n);
                let axle_roll = (rise(left) - rise(right)) / self.track_m[axle];
                let over = self.axle_height_m[axle] * axle_roll - self.height_m * angular.x;
                contacts[left].vy_m_s += over;
                contacts[right].vy_m_s += over;
            }
        }
    }

    /// Puts the other model's couples on the wheels (`moments`, at their centres) and gives that on the body.
    pub(crate) fn couple(
        &self,
        moments: &mut [Vector3<f64>; WHEELS],
        contacts: &[Contact; WHEELS],
        tyres: &[Forces; WHEELS],
        to_earth: &Matrix3<f64>,
    ) -> Vector3<f64> {
        if self.rigid_axles {
            for (left, right) in [(0, 1), (2, 3)] {
                let apart = 0.5 * (tyres[left].mx_n_m - tyres[right].mx_n_m);
                moments[left] -= contacts[left].x * apart;
                moments[right] += contacts[right].x * apart;
            }
        }
        Vector3::new(-self.missing_n_m * to_earth[(2, 1)], 0.0, 0.0)
    }

    /// Force of a rigid axle between body and each of its wheels, pushing the wheel down: what its lateral guidance, fixed
    /// in the rolled body, lifts it by. Its wheels' paths (arcs about a point on the road) carry none of it. [N]
    pub(crate) fn lift_n(&self, tyres: &[Forces; WHEELS], to_earth: &Matrix3<f64>) -> [f64; WHEELS] {
        if !self.rigid_axles {
            return [0.0; WHEELS];
        }
        let each = [0, 2].map(|i| 0.5 * to_earth[(2, 1)] * (tyres[i].fy_n + tyres[i + 1].fy_n));
        [each[0], each[0], each[1], each[1]]
    }

    /// A tyre's step with shifts by the sign of its inclination.
    pub(crate) fn tyre_step(
        &self,
        wheel: usize,
        tyre: &Tyre,
        state: &mut TransientState,
        motion: &Motion,
        mode: UseMode,
        dt_s: f64,
    ) -> Forces {
        let Some(reversed) = &self.reversed else { return tyre.transient_step(state, motion, mode, dt_s) };
        let lean = motion.camber_rad;
        let right = if self.transition_rad > 0.0 {
            0.5 + 0.5 * (lean / self.transition_rad).clamp(-1.0, 1.0)
        } else if lean == 0.0 {
            0.5
        } else {
            f64::from(u8::from(lean > 0.0))
        };
        let other = &reversed[wheel];
        if right >= 1.0 {
            return tyre.transient_step(state, motion, mode, dt_s);
        }
        if right <= 0.0 {
            return other.transient_step(state, motion, mode, dt_s);
        }
        // Both lie close together: their mean, in force and in state.
        let mut twin = *state;
        let (a, b) = (
            tyre.transient_step(state, motion, mode, dt_s),
            other.transient_step(&mut twin, motion, mode, dt_s),
        );
        let mix = |x: f64, y: f64| y + right * (x - y);
        let mut numbers = [[0.0; TransientState::LEN]; 2];
        state.save_state(&mut numbers[0]);
        twin.save_state(&mut numbers[1]);
        let [mut of, with] = numbers;
        for (x, y) in of.iter_mut().zip(with) {
            *x = mix(*x, y);
        }
        state.load_state(&of);
        Forces {
            fx_n: mix(a.fx_n, b.fx_n),
            fy_n: mix(a.fy_n, b.fy_n),
            mx_n_m: mix(a.mx_n_m, b.mx_n_m),
            my_n_m: mix(a.my_n_m, b.my_n_m),
            mz_n_m: mix(a.mz_n_m, b.mz_n_m),
            ..a
        }
    }
}
