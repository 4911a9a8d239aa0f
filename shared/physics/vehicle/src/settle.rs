//! Start: the car in static equilibrium at a speed, so that nothing moves of itself at t = 0.
//!
//! The model itself finds the equilibrium: it runs with its forward speed pinned and its heading held, heave,
//! pitch, roll and travels critically damped, until springs, tyres, wheel speeds, engine and brakes have come
//! to rest; the speed controller's integral moves until the pin has nothing left to do. Then time, position
//! and heading return to zero. With a target speed this is straight running at constant speed; without, the
//! car starts at the speed with whatever acceleration throttle and brake give it.

use crate::io::{GearMode, VehicleInput};
use crate::state::State;
use crate::vehicle::Vehicle;
use nalgebra::Vector3;
use spatial::EulerParameters;

/// Time the settling run takes. [s]
const SETTLE_S: f64 = 4.0;
/// Rate at which vertical motion is braked meanwhile. [1/s]
const DAMPING_1_S: f64 = 12.0;
/// Rate at which the speed controller's integral follows what the pin has to do. [1/s]
const FOLLOW_1_S: f64 = 5.0;

impl Vehicle {
    /// Puts the car at rest in its motion: straight ahead along earth x at `speed_m_s` (negative: reverse), in
    /// equilibrium with the given inputs, centre of gravity above the earth origin. Not for the 1 ms path (it takes
    /// some thousand steps).
    pub fn reset(&mut self, speed_m_s: f64, input: &VehicleInput) {
        // The user's equations begin with the first step, not with what leads to it.
        let mut equations = self.take_equations();
        let speed = if speed_m_s.is_finite() { speed_m_s } else { 0.0 };
        let mut input = if input.finite() { *input } else { VehicleInput::default() };
        let start_time = input.time_s;
        let holds = input.target_speed_m_s.is_some() && speed != 0.0;
        if holds {
            input.target_speed_m_s = Some(speed);
        }
        let slope = 0.25 * input.road.iter().map(|r| r.slope_x).sum::<f64>();
        let height = 0.25 * input.road.iter().map(|r| r.height_m).sum::<f64>();
        self.state = State::zero();
        self.state.input = input;
        self.state.position = Vector3::new(-self.centre.x, -self.centre.y, height + self.design_height_m);
        // Nose up a positive slope: rotation about −y.
        self.state.attitude = EulerParameters::from_axis_angle(&Vector3::y(), -slope.atan());
        self.state.velocity = Vector3::new(speed, 0.0, speed * slope);
        self.state.spin = self.start_spins(speed * (1.0 + slope * slope).sqrt());
        let rack = match input.rack_displacement_m {
            Some(rack) => rack,
            None => self.steering.unloaded_rack_m(input.steering_wheel_angle_rad),
        };
        self.state.rack = rack.clamp(-self.steering.travel_m(), self.steering.travel_m());
        self.state.steering_wheel = input.steering_wheel_angle_rad;
        self.state.road_height = input.road.map(|r| r.height_m);
        self.start_driveline(input.gear_mode);
        let braked = input.brake_pressure_pa > 0.0
            || input.hand_brake > 0.0
            || input.gear_mode == GearMode::Park
            || input.target_speed_m_s == Some(0.0);
        let stands = speed == 0.0 && braked;
        let sense = if input.gear_mode == GearMode::Reverse { -1.0 } else { 1.0 };
        let keep = (-DAMPING_1_S * self.step_s).exp();
        let steps = (SETTLE_S / self.step_s) as usize;
        for _ in 0..steps {
            self.step(&input);
            let s = &mut self.state;
            if holds {
                s.speed_integral -= sense * (s.velocity.x - speed) * FOLLOW_1_S;
            }
            s.position.z -= slope * (s.position.x + self.centre.x);
            s.position.x = -self.centre.x;
            s.position.y = -self.centre.y;
            if stands {
                // Held by brakes and tyres alone, so that these carry the slope's pull when it begins.
                s.velocity.x *= keep;
                s.velocity.y *= keep;
            } else {
                s.velocity.x = speed;
                s.velocity.y = 0.0;
            }
            s.velocity.z = speed * slope + (s.velocity.z - speed * slope) * keep;
            s.angular.x *= keep;
            s.angular.y *= keep;
            s.angular.z = 0.0;
            let (c, sine) = crate::vehicle::horizontal_forward(&s.attitude.matrix());
            let back = Vector3::new(0.0, 0.0, -sine.atan2(c));
            s.attitude = EulerParameters::from_rotation_vector(&back).then(s.attitude).normalised();
            for rate in &mut s.travel_rate {
                *rate *= keep;
            }
        }
        self.state.yaw = 0.0;
        self.state.held = 0;
        self.state.input.time_s = start_time;
        self.state.time = start_time;
        self.settled_output(start_time);
        if let Some(equations) = &mut equations {
            equations.reset(&self.output);
        }
        self.equations = equations;
    }

    /// Outputs at the start: those of the last settling step with the clock and the pinned quantities put right.
    fn settled_output(&mut self, time_s: f64) {
        let position = self.state.position + self.state.attitude.matrix() * self.centre;
        let height = position.z;
        let o = &mut self.output;
        o.time_s = time_s;
        o.position_m = [0.0, 0.0, height];
        o.yaw_rad = 0.0;
        o.held_steps = 0;
    }
}
