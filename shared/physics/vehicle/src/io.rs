//! What goes into the car and what comes out of it (spec Table 2.7), as plain data.
//!
//! Axes ISO 8855: earth axes and body axes x forward, y left, z up. Wheels in the order front left, front
//! right, rear left, rear right; sides left, right. Slip angles after ISO-W: α > 0 when the wheel slides to
//! the left, so α < 0 gives Fy > 0.

/// Number of wheels.
pub const WHEELS: usize = 4;

/// What the driver asks of the gearbox.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GearMode {
    /// Driven wheels locked.
    Park,
    /// Reverse.
    Reverse,
    /// No connection between engine and wheels.
    Neutral,
    /// Forward, gears by the shift map.
    #[default]
    Drive,
    /// A forward gear held, 1 the first; the top gear when there is none so high.
    Manual(u8),
}

/// The road under one wheel: a plane through the given height straight below the wheel centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoadContact {
    /// Road height below the wheel centre, earth axes. [m]
    pub height_m: f64,
    /// Slope of the road along earth x. [-]
    pub slope_x: f64,
    /// Slope of the road along earth y. [-]
    pub slope_y: f64,
    /// Friction relative to that of the tyre's test surface. [-], [0, 2]
    pub friction: f64,
}

impl Default for RoadContact {
    fn default() -> Self {
        Self { height_m: 0.0, slope_x: 0.0, slope_y: 0.0, friction: 1.0 }
    }
}

/// Inputs of one step, held during it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleInput {
    /// Measured rack displacement, left positive; replaces the car's own steering. [m]
    pub rack_displacement_m: Option<f64>,
    /// Steering-wheel angle, left positive; used without a measured rack. [rad]
    pub steering_wheel_angle_rad: f64,
    /// Throttle; used without a target speed. [-], [0, 1]
    pub throttle: f64,
    /// Master-cylinder pressure, added to the speed controller's. [Pa]
    pub brake_pressure_pa: f64,
    /// Hand brake pull. [-], [0, 1]
    pub hand_brake: f64,
    /// Gear selector.
    pub gear_mode: GearMode,
    /// Speed for the internal controller to hold; negative only with [`GearMode::Reverse`]. [m/s]
    pub target_speed_m_s: Option<f64>,
    /// Road under each wheel.
    pub road: [RoadContact; WHEELS],
    /// Wind velocity over ground, earth axes x and y. [m/s]
    pub wind_m_s: [f64; 2],
    /// Time at the start of the step (carried to the output, not used by the physics). [s]
    pub time_s: f64,
}

impl Default for VehicleInput {
    fn default() -> Self {
        Self {
            rack_displacement_m: None,
            steering_wheel_angle_rad: 0.0,
            throttle: 0.0,
            brake_pressure_pa: 0.0,
            hand_brake: 0.0,
            gear_mode: GearMode::Drive,
            target_speed_m_s: None,
            road: [RoadContact::default(); WHEELS],
            wind_m_s: [0.0; 2],
            time_s: 0.0,
        }
    }
}

impl VehicleInput {
    /// Whether every number is finite.
    #[must_use]
    pub fn finite(&self) -> bool {
        self.rack_displacement_m.is_none_or(f64::is_finite)
            && self.target_speed_m_s.is_none_or(f64::is_finite)
            && [
                self.steering_wheel_angle_rad,
                self.throttle,
                self.brake_pressure_pa,
                self.hand_brake,
                self.wind_m_s[0],
                self.wind_m_s[1],
                self.time_s,
            ]
            .iter()
            .all(|v| v.is_finite())
            && self.road.iter().all(|r| {
                r.height_m.is_finite()
                    && r.slope_x.is_finite()
                    && r.slope_y.is_finite()
                    && r.friction.is_finite()
            })
    }
}

/// One wheel at the end of a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct WheelOutput {
    /// Longitudinal tyre force at the contact patch, ISO-W. [N]
    pub fx_n: f64,
    /// Lateral tyre force, left positive, ISO-W. [N]
    pub fy_n: f64,
    /// Vertical tyre force, compression positive. [N]
    pub fz_n: f64,
    /// Overturning moment. [N·m]
    pub mx_n_m: f64,
    /// Rolling resistance moment, about y. [N·m]
    pub my_n_m: f64,
    /// Aligning moment. [N·m]
    pub mz_n_m: f64,
    /// Longitudinal slip with relaxation, driving positive. [-]
    pub slip_ratio: f64,
    /// Slip angle with relaxation, ISO-W. [rad]
    pub slip_angle_rad: f64,
    /// Force the wheel hands the knuckle, in the knuckle frame K. [N]
    pub centre_force_n: [f64; 3],
    /// Moment the wheel hands the knuckle at the wheel centre, in the knuckle frame K, without drive-shaft
    /// torque. [N·m]
    pub centre_moment_n_m: [f64; 3],
    /// Wheel centre in earth axes. [m]
    pub centre_position_m: [f64; 3],
    /// Wheel-centre height relative to the body minus design: wheel travel, bump positive. [m]
    pub travel_m: f64,
    /// Rate of the wheel travel. [m/s]
    pub travel_rate_m_s: f64,
    /// Vertical velocity of the wheel centre, earth axes. [m/s]
    pub vertical_velocity_m_s: f64,
    /// Vertical acceleration of the wheel centre, earth axes. [m/s²]
    pub vertical_acceleration_m_s2: f64,
    /// Brake torque on the wheel; opposes its rotation, so negative when rolling forward. [N·m]
    pub brake_torque_n_m: f64,
    /// Drive-shaft torque on the wheel. [N·m]
    pub drive_torque_n_m: f64,
    /// Wheel brake pressure. [Pa]
    pub brake_pressure_pa: f64,
    /// Inclination to the road, ISO-W: top to the right positive. [rad]
    pub inclination_rad: f64,
    /// Camber relative to the body, top outward positive. [rad]
    pub camber_rad: f64,
    /// Heading relative to the body, left positive, compliance included. [rad]
    pub steer_rad: f64,
    /// Heading relative to the body by the kinematics map alone, left positive. [rad]
    pub kinematic_steer_rad: f64,
    /// Camber relative to the body by the kinematics map alone, top outward positive. [rad]
    pub kinematic_camber_rad: f64,
    /// Spin speed, rolling forward positive. [rad/s]
    pub spin_rad_s: f64,
    /// Force of spring and stops at the wheel, compression positive. [N]
    pub spring_force_n: f64,
    /// Force of the damper at the wheel, bump positive. [N]
    pub damper_force_n: f64,
    /// Loaded radius. [m]
    pub loaded_radius_m: f64,
    /// Power that the tyre's forces in the road plane and its moments give the wheel and the car: negative while it
    /// takes (slides, rolls, is being loaded), positive only while its carcass gives back. [W]
    pub tyre_power_w: f64,
}

/// The car at the end of a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct VehicleOutput {
    /// Time at the end of the step. [s]
    pub time_s: f64,
    /// Position of the car's centre of gravity (at design, fixed in the body), earth axes. [m]
    pub position_m: [f64; 3],
    /// Roll (ISO 8855 sequence yaw, pitch, roll): right side down positive. [rad]
    pub roll_rad: f64,
    /// Pitch: nose down positive. [rad]
    pub pitch_rad: f64,
    /// Yaw, counted on past ±π. [rad]
    pub yaw_rad: f64,
    /// Velocity of the car's centre of gravity in body axes. [m/s]
    pub velocity_m_s: [f64; 3],
    /// Speed forward and to the left in the horizontal plane (ISO 8855 intermediate axes). [m/s]
    pub horizontal_velocity_m_s: [f64; 2],
    /// Angular velocity in body axes: roll, pitch, yaw. [rad/s]
    pub angular_velocity_rad_s: [f64; 3],
    /// Rate of the yaw angle. [rad/s]
    pub yaw_rate_rad_s: f64,
    /// Acceleration of the centre of gravity forward, horizontal. [m/s²]
    pub longitudinal_acceleration_m_s2: f64,
    /// Acceleration to the left, horizontal, at the accelerometer. [m/s²]
    pub lateral_acceleration_m_s2: f64,
    /// Acceleration to the left, horizontal, at the centre of gravity. [m/s²]
    pub lateral_acceleration_cg_m_s2: f64,
    /// Vertical acceleration of the centre of gravity, earth axes. [m/s²]
    pub vertical_acceleration_m_s2: f64,
    /// What the body-fixed accelerometer reads: specific force (gravity included), body axes. [m/s²]
    pub accelerometer_m_s2: [f64; 3],
    /// Side-slip angle at the centre of gravity, zero below walking pace. [rad]
    pub side_slip_angle_rad: f64,
    /// The wheels.
    pub wheels: [WheelOutput; WHEELS],
    /// Throttle in effect. [-]
    pub throttle: f64,
    /// Master pressure in effect. [Pa]
    pub master_pressure_pa: f64,
    /// Gear engaged: 0 neutral, −1 reverse.
    pub gear: i32,
    /// Engine speed, zero without an engine model. [rad/s]
    pub engine_speed_rad_s: f64,
    /// Engine torque. [N·m]
    pub engine_torque_n_m: f64,
    /// Steering-wheel angle: the input's, or what a rigid steering would show for the measured rack. [rad]
    pub steering_wheel_angle_rad: f64,
    /// Torque at the torsion bar, zero with a measured rack or a rigid steering. [N·m]
    pub steering_torque_n_m: f64,
    /// Rack displacement, left positive. [m]
    pub rack_displacement_m: f64,
    /// Force of both front wheels on the rack, left positive (by virtual work of the kinematics maps). [N]
    pub rack_force_n: f64,
    /// Moment of the wheel forces about the left and right kingpin, turning the wheel left positive. [N·m]
    pub kingpin_moment_n_m: [f64; 2],
    /// Steps since reset in which an input or a state was not finite and the last good one was held.
    pub held_steps: u64,
}
