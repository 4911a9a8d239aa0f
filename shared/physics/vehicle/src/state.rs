//! Everything that changes from step to step, with one list of its numbers for checkpoints.

use crate::driveline::DrivelineState;
use crate::io::{GearMode, VehicleInput};
use crate::suspension::Deflection;
use nalgebra::Vector3;
use spatial::EulerParameters;
use tyre::TransientState;

/// State of the car: 27 freedoms of the model, deflections, steering, controllers, the input last held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Sprung centre of gravity, earth axes. [m]
    pub position: Vector3<f64>,
    /// Attitude of the body.
    pub attitude: EulerParameters,
    /// Velocity of the sprung centre of gravity, earth axes. [m/s]
    pub velocity: Vector3<f64>,
    /// Angular velocity, body axes. [rad/s]
    pub angular: Vector3<f64>,
    /// Wheel travels. [m]
    pub travel: [f64; 4],
    /// Their rates. [m/s]
    pub travel_rate: [f64; 4],
    /// Wheel spin speeds. [rad/s]
    pub spin: [f64; 4],
    /// Tyre transients, by wheel.
    pub tyre: [TransientState; 4],
    /// Tyre forces of the last sub-step along x and y, for the tyre's vertical spring. [N]
    pub tyre_force: [[f64; 2]; 4],
    /// Wheel brake pressures. [Pa]
    pub brake_pressure: [f64; 4],
    /// Elastic deflections of the wheels.
    pub deflection: [Deflection; 4],
    /// Powertrain.
    pub driveline: DrivelineState,
    /// Rack displacement. [m]
    pub rack: f64,
    /// Rack rate. [m/s]
    pub rack_rate: f64,
    /// Force of the wheels on the rack in the last sub-step. [N]
    pub rack_force: f64,
    /// Steering-wheel angle at the end of the last step. [rad]
    pub steering_wheel: f64,
    /// Integral of the speed controller. [m/s²]
    pub speed_integral: f64,
    /// Yaw angle counted on past ±π. [rad]
    pub yaw: f64,
    /// Road heights of the last step. [m]
    pub road_height: [f64; 4],
    /// Model time. [s]
    pub time: f64,
    /// Steps held.
    pub held: u64,
    /// Last good input.
    pub input: VehicleInput,
}

/// As presence and value, both finite, so that a saved state can be checked for soundness.
fn option(value: &mut Option<f64>, f: &mut impl FnMut(&mut f64)) {
    let (mut present, mut v) = (f64::from(u8::from(value.is_some())), value.unwrap_or(0.0));
    f(&mut present);
    f(&mut v);
    *value = (present != 0.0).then_some(v);
}

impl State {
    /// At rest at the origin.
    #[must_use]
    pub fn zero() -> Self {
        Self {
            position: Vector3::zeros(),
            attitude: EulerParameters::IDENTITY,
            velocity: Vector3::zeros(),
            angular: Vector3::zeros(),
            travel: [0.0; 4],
            travel_rate: [0.0; 4],
            spin: [0.0; 4],
            tyre: [TransientState::default(); 4],
            tyre_force: [[0.0; 2]; 4],
            brake_pressure: [0.0; 4],
            deflection: [[0.0; 4]; 4],
            driveline: DrivelineState {
                engine_rad_s: 0.0,
                gear: 0,
                old_ratio: 0.0,
                since_shift_s: 0.0,
                lock_up: 0.0,
            },
            rack: 0.0,
            rack_rate: 0.0,
            rack_force: 0.0,
            steering_wheel: 0.0,
            speed_integral: 0.0,
            yaw: 0.0,
            road_height: [0.0; 4],
            time: 0.0,
            held: 0,
            input: VehicleInput::default(),
        }
    }

    /// Visits every number, always in the same order.
    pub fn visit(&mut self, f: &mut impl FnMut(&mut f64)) {
        for v in [&mut self.position, &mut self.velocity, &mut self.angular] {
            v.iter_mut().for_each(&mut *f);
        }
        let mut attitude = self.attitude.to_array();
        attitude.iter_mut().for_each(&mut *f);
        self.attitude = EulerParameters::from_array(attitude);
        for v in [
            &mut self.travel,
            &mut self.travel_rate,
            &mut self.spin,
            &mut self.brake_pressure,
            &mut self.road_height,
        ] {
            v.iter_mut().for_each(&mut *f);
        }
        for t in &mut self.tyre {
            let mut numbers = [0.0; TransientState::LEN];
            t.save_state(&mut numbers);
            numbers.iter_mut().for_each(&mut *f);
            t.load_state(&numbers);
        }
        self.tyre_force.iter_mut().flatten().for_each(&mut *f);
        self.deflection.iter_mut().flatten().for_each(&mut *f);
        let d = &mut self.driveline;
        for v in [
            &mut d.engine_rad_s,
            &mut d.old_ratio,
            &mut d.since_shift_s,
            &mut d.lock_up,
            &mut self.rack,
            &mut self.rack_rate,
            &mut self.rack_force,
            &mut self.steering_wheel,
            &mut self.speed_integral,
            &mut self.yaw,
            &mut self.time,
        ] {
            f(v);
        }
        let mut gear = f64::from(d.gear);
        f(&mut gear);
        d.gear = gear as i32;
        let mut held = self.held as f64;
        f(&mut held);
        self.held = held as u64;
        let i = &mut self.input;
        option(&mut i.rack_displacement_m, f);
        option(&mut i.target_speed_m_s, f);
        for v in [
            &mut i.steering_wheel_angle_rad,
            &mut i.throttle,
            &mut i.brake_pressure_pa,
            &mut i.hand_brake,
            &mut i.time_s,
        ] {
            f(v);
        }
        i.wind_m_s.iter_mut().for_each(&mut *f);
        for r in &mut i.road {
            for v in [&mut r.height_m, &mut r.slope_x, &mut r.slope_y, &mut r.friction] {
                f(v);
            }
        }
        let mut mode = match i.gear_mode {
            GearMode::Park => -3.0,
            GearMode::Reverse => -2.0,
            GearMode::Neutral => -1.0,
            GearMode::Drive => 0.0,
            GearMode::Manual(g) => f64::from(g),
        };
        f(&mut mode);
        i.gear_mode = match mode as i32 {
            -3 => GearMode::Park,
            -2 => GearMode::Reverse,
            -1 => GearMode::Neutral,
            0 => GearMode::Drive,
            g => GearMode::Manual(g.clamp(1, 255) as u8),
        };
    }

    /// How many numbers there are.
    #[must_use]
    pub fn len() -> usize {
        let mut count = 0;
        Self::zero().visit(&mut |_| count += 1);
        count
    }

    /// Whether the mechanical state is finite and within bounds no car reaches.
    #[must_use]
    pub fn sound(&self) -> bool {
        let bounded = |v: f64, limit: f64| v.abs() <= limit;
        self.position.iter().all(|v| bounded(*v, 1e9))
            && self.velocity.iter().all(|v| bounded(*v, 1e3))
            && self.angular.iter().all(|v| bounded(*v, 1e3))
            && self.attitude.to_array().iter().all(|v| bounded(*v, 2.0))
            && self.travel.iter().all(|v| bounded(*v, 10.0))
            && self.travel_rate.iter().all(|v| bounded(*v, 1e3))
            && self.spin.iter().all(|v| bounded(*v, 1e4))
            && self.tyre.iter().all(|t| bounded(t.u_m, 10.0) && bounded(t.v_m, 10.0))
            && self.deflection.iter().flatten().all(|v| bounded(*v, 1.0))
            && bounded(self.rack, 1.0)
            && bounded(self.rack_rate, 1e3)
            && bounded(self.driveline.engine_rad_s, 1e5)
    }
}
