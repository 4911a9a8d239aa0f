//! Outputs of the car from its state and the last sub-step's findings.

use crate::io::{VehicleInput, WHEELS};
use crate::vehicle::{Control, Found, GRAVITY_M_S2, Vehicle, horizontal_forward};
use nalgebra::Vector3;

/// Speed below which no side-slip angle is shown. [m/s]
const SIDE_SLIP_SPEED_M_S: f64 = 0.5;

impl Vehicle {
    /// Outputs from the state and the last sub-step.
    pub(crate) fn put_out(&mut self, input: &VehicleInput, control: &Control, found: &Found) {
        let to_earth = self.state.attitude.matrix();
        let (cy, sy) = horizontal_forward(&to_earth);
        let yaw = sy.atan2(cy);
        let turns = ((self.state.yaw - yaw) / std::f64::consts::TAU).round();
        self.state.yaw = yaw + turns * std::f64::consts::TAU;
        let s = &self.state;
        let w = s.angular;
        let velocity = to_earth.transpose() * s.velocity + w.cross(&self.centre);
        let ground = to_earth * velocity;
        let acceleration = |at: &Vector3<f64>| found.body + found.angular.cross(at) + w.cross(&w.cross(at));
        let at_centre = to_earth * acceleration(&self.centre);
        let at_sensor = acceleration(&self.accelerometer);
        let sensor_ground = to_earth * at_sensor;
        let specific = at_sensor + to_earth.transpose() * Vector3::new(0.0, 0.0, GRAVITY_M_S2);
        let pitch = (-to_earth[(2, 0)]).clamp(-1.0, 1.0).asin();
        let roll = to_earth[(2, 1)].atan2(to_earth[(2, 2)]);
        let forward = cy * ground.x + sy * ground.y;
        let left = -sy * ground.x + cy * ground.y;
        let o = &mut self.output;
        o.time_s = s.time;
        o.position_m = (s.position + to_earth * self.centre).into();
        o.roll_rad = roll;
        o.pitch_rad = pitch;
        o.yaw_rad = s.yaw;
        o.velocity_m_s = velocity.into();
        o.horizontal_velocity_m_s = [forward, left];
        o.angular_velocity_rad_s = w.into();
        o.yaw_rate_rad_s = (w.y * roll.sin() + w.z * roll.cos()) / pitch.cos().abs().max(1e-6);
        o.longitudinal_acceleration_m_s2 = cy * at_centre.x + sy * at_centre.y;
        o.lateral_acceleration_cg_m_s2 = -sy * at_centre.x + cy * at_centre.y;
        o.lateral_acceleration_m_s2 = -sy * sensor_ground.x + cy * sensor_ground.y;
        o.vertical_acceleration_m_s2 = at_centre.z;
        o.accelerometer_m_s2 = specific.into();
        o.side_slip_angle_rad =
            if forward.hypot(left) > SIDE_SLIP_SPEED_M_S { left.atan2(forward) } else { 0.0 };
        o.throttle = control.throttle;
        o.master_pressure_pa = control.master_pa;
        o.gear = s.driveline.gear;
        o.engine_speed_rad_s = if self.driveline.has_engine() { s.driveline.engine_rad_s } else { 0.0 };
        o.engine_torque_n_m = found.spins.engine_n_m;
        o.rack_displacement_m = s.rack;
        o.rack_force_n = s.rack_force;
        o.steering_wheel_angle_rad = if input.rack_displacement_m.is_some() {
            self.steering.steering_wheel_rad(s.rack)
        } else {
            input.steering_wheel_angle_rad
        };
        o.steering_torque_n_m = found.steering_n_m;
        o.held_steps = s.held;
        for i in 0..WHEELS {
            let (axle, side) = (i / 2, i % 2);
            let (station, contact, f, handed) =
                (&found.stations[i], &found.contacts[i], &found.tyre[i], &found.handed[i]);
            let to_knuckle = station.knuckle.transpose();
            let outward = if side == 0 { -1.0 } else { 1.0 };
            let map = &self.kinematics[axle].sides[side];
            let pose = map.pose(s.travel[i], s.rack);
            let by_map = crate::kinematics::knuckle_matrix(&pose.value) * map.spin_axis_k;
            let now = design_with(&self.design[i], &pose.value, &s.deflection[i], s.travel[i]);
            let centre = s.position + to_earth * now;
            let wheel = &mut o.wheels[i];
            wheel.fx_n = f.fx_n;
            wheel.fy_n = f.fy_n;
            wheel.fz_n = found.load_n[i];
            wheel.mx_n_m = f.mx_n_m;
            wheel.my_n_m = f.my_n_m;
            wheel.mz_n_m = f.mz_n_m;
            wheel.slip_ratio = s.tyre[i].slip_ratio;
            wheel.slip_angle_rad = s.tyre[i].slip_tangent.atan();
            wheel.centre_force_n = (to_knuckle * handed.force).into();
            wheel.centre_moment_n_m = (to_knuckle * handed.moment).into();
            wheel.centre_position_m = centre.into();
            wheel.travel_m = s.travel[i];
            wheel.travel_rate_m_s = s.travel_rate[i];
            let relative = Vector3::new(0.0, 0.0, s.travel_rate[i]);
            let velocity = s.velocity + to_earth * (w.cross(&now) + relative);
            wheel.vertical_velocity_m_s = velocity.z;
            wheel.vertical_acceleration_m_s2 = (to_earth * handed.acceleration).z;
            wheel.brake_torque_n_m = found.spins.brake_n_m[i];
            wheel.drive_torque_n_m = found.spins.drive_n_m[i];
            wheel.brake_pressure_pa = s.brake_pressure[i];
            wheel.inclination_rad = contact.inclination_rad;
            wheel.camber_rad = outward * station.s.z.clamp(-1.0, 1.0).asin();
            wheel.steer_rad = (-station.s.x).atan2(station.s.y);
            wheel.kinematic_steer_rad = (-by_map.x).atan2(by_map.y);
            wheel.kinematic_camber_rad = outward * by_map.z.clamp(-1.0, 1.0).asin();
            wheel.spin_rad_s = s.spin[i];
            wheel.damper_force_n = found.damper_n[i];
            wheel.spring_force_n = self.suspension[axle].spring_n(side, s.travel[i]);
            wheel.loaded_radius_m = contact.radius_m;
            wheel.tyre_power_w = found.power_w[i];
            if axle == 0 {
                let kingpin = map.kingpin(s.travel[i], s.rack);
                let arm = station.r - self.design[i] - kingpin.point_m;
                o.kingpin_moment_n_m[side] =
                    (arm.cross(&handed.force) + handed.moment).dot(&kingpin.direction);
            }
        }
    }
}

fn design_with(design: &Vector3<f64>, value: &[f64; 5], deflection: &[f64; 4], travel: f64) -> Vector3<f64> {
    design + Vector3::new(value[3] + deflection[2], value[4] + deflection[3], travel)
}
