//! What a rig and its controller exchange once a tick. No virtual state passes here.

/// Commands to the actuators; held until the next.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Actuation {
    /// Valve opening of the horizontal cylinders; + pulls the tie rod (outer ball outboard). [-], [-1, 1]
    pub horizontal_valve: [f64; 2],
    /// Valve opening of the vertical cylinders; + lifts. [-], [-1, 1]
    pub vertical_valve: [f64; 2],
    /// Torque of the steer actuator, left turn positive. [N·m]
    pub steer_torque_n_m: f64,
}

/// What surrounds the rig and the unit under test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigEnvironment {
    /// Vehicle speed as the ECU gets it. [m/s]
    pub vehicle_speed_m_s: f64,
    /// Ignition and engine on: assist is available.
    pub engine_on: bool,
    /// Torque of human hands on the measuring wheel, left turn positive. [N·m]
    pub hand_torque_n_m: f64,
    /// Assist torque that an ECU outside asks of the unit's motor, at the pinion, left turn positive. [N·m]
    /// `None`: the unit's own ECU assists.
    pub assist_request_n_m: Option<f64>,
}

impl Default for RigEnvironment {
    fn default() -> Self {
        Self { vehicle_speed_m_s: 0.0, engine_on: true, hand_torque_n_m: 0.0, assist_request_n_m: None }
    }
}

/// The channels of a [`Measurement`], in the order of its validity bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Channel {
    /// Steering-wheel angle.
    SteeringAngle = 0,
    /// Steering-wheel torque.
    SteeringTorque = 1,
    /// Torsion-bar torque.
    TorsionBarTorque = 2,
    /// Assist torque.
    AssistTorque = 3,
    /// Rack displacement.
    RackDisplacement = 4,
    /// Tie-rod force, left.
    TieRodForceLeft = 5,
    /// Tie-rod force, right.
    TieRodForceRight = 6,
    /// Actuator force, left.
    ActuatorForceLeft = 7,
    /// Actuator force, right.
    ActuatorForceRight = 8,
    /// Horizontal stroke, left.
    HorizontalStrokeLeft = 9,
    /// Horizontal stroke, right.
    HorizontalStrokeRight = 10,
    /// Vertical stroke, left.
    VerticalStrokeLeft = 11,
    /// Vertical stroke, right.
    VerticalStrokeRight = 12,
}

impl Channel {
    /// Number of channels.
    pub const COUNT: usize = 13;

    /// All channels, in the order of the validity bits.
    pub const ALL: [Self; Self::COUNT] = [
        Self::SteeringAngle,
        Self::SteeringTorque,
        Self::TorsionBarTorque,
        Self::AssistTorque,
        Self::RackDisplacement,
        Self::TieRodForceLeft,
        Self::TieRodForceRight,
        Self::ActuatorForceLeft,
        Self::ActuatorForceRight,
        Self::HorizontalStrokeLeft,
        Self::HorizontalStrokeRight,
        Self::VerticalStrokeLeft,
        Self::VerticalStrokeRight,
    ];

    /// Name for messages and logs.
    pub fn name(self) -> &'static str {
        match self {
            Self::SteeringAngle => "steering-wheel angle",
            Self::SteeringTorque => "steering-wheel torque",
            Self::TorsionBarTorque => "torsion-bar torque",
            Self::AssistTorque => "assist torque",
            Self::RackDisplacement => "rack displacement",
            Self::TieRodForceLeft => "tie-rod force left",
            Self::TieRodForceRight => "tie-rod force right",
            Self::ActuatorForceLeft => "actuator force left",
            Self::ActuatorForceRight => "actuator force right",
            Self::HorizontalStrokeLeft => "horizontal stroke left",
            Self::HorizontalStrokeRight => "horizontal stroke right",
            Self::VerticalStrokeLeft => "vertical stroke left",
            Self::VerticalStrokeRight => "vertical stroke right",
        }
    }
}

/// What the sensors say, with all their errors. Left is index 0, right is 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Measurement {
    /// Steering-wheel angle, left turn positive. [rad]
    pub steering_wheel_angle_rad: f64,
    /// Torque that the driver or the actuator puts into the column, left turn positive. [N·m]
    pub steering_wheel_torque_n_m: f64,
    /// Torsion-bar torque of the unit's own sensor, left turn positive. [N·m]
    pub torsion_bar_torque_n_m: f64,
    /// Assist as torque at the pinion, left turn positive. [N·m]
    pub assist_torque_n_m: f64,
    /// Rack displacement, left positive. [m]
    pub rack_displacement_m: f64,
    /// Tie-rod force, tension positive. [N]
    pub tie_rod_force_n: [f64; 2],
    /// Force of the horizontal cylinder's rod; + pulls the tie rod. [N]
    pub actuator_force_n: [f64; 2],
    /// Stroke of the horizontal cylinder; + moves the outer ball outboard. [m]
    pub horizontal_stroke_m: [f64; 2],
    /// Stroke of the vertical cylinder; + up. [m]
    pub vertical_stroke_m: [f64; 2],
    /// Bit `Channel as u8` set: that channel is within its range and converted.
    pub validity: u64,
}

impl Measurement {
    /// All channels valid.
    pub const ALL_VALID: u64 = (1 << Channel::COUNT) - 1;

    /// Whether a channel is within range.
    pub fn is_valid(&self, channel: Channel) -> bool {
        self.validity & (1 << channel as u8) != 0
    }

    /// The readings in the order of [`Channel`].
    pub fn channels(&self) -> [f64; Channel::COUNT] {
        [
            self.steering_wheel_angle_rad,
            self.steering_wheel_torque_n_m,
            self.torsion_bar_torque_n_m,
            self.assist_torque_n_m,
            self.rack_displacement_m,
            self.tie_rod_force_n[0],
            self.tie_rod_force_n[1],
            self.actuator_force_n[0],
            self.actuator_force_n[1],
            self.horizontal_stroke_m[0],
            self.horizontal_stroke_m[1],
            self.vertical_stroke_m[0],
            self.vertical_stroke_m[1],
        ]
    }

    /// A measurement from readings in the order of [`Channel`].
    pub fn from_channels(v: &[f64; Channel::COUNT], validity: u64) -> Self {
        Self {
            steering_wheel_angle_rad: v[0],
            steering_wheel_torque_n_m: v[1],
            torsion_bar_torque_n_m: v[2],
            assist_torque_n_m: v[3],
            rack_displacement_m: v[4],
            tie_rod_force_n: [v[5], v[6]],
            actuator_force_n: [v[7], v[8]],
            horizontal_stroke_m: [v[9], v[10]],
            vertical_stroke_m: [v[11], v[12]],
            validity,
        }
    }
}
