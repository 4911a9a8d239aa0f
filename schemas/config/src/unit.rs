//! The steering unit under test, when it is a model: hand wheel, column, torsion bar, rack, assist.
//!
//! Signs: angles and torques counter-clockwise seen by the driver are positive (a left turn), rack
//! displacement is positive to the left, both after ISO 8855. The unit ends at the inner tie-rod balls;
//! what lies outboard of them belongs to the rig.

use crate::{Check, Checker};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A column, torsion bar, rack and assist, as one lumped model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SteeringUnit {
    /// What this unit is, for logs and reports.
    pub name: String,
    /// Rack travel for one turn of the pinion. [m/rev]; positive if the rack moves left in a left turn
    /// (rack ahead of the axle), negative behind it. Magnitude (0, 0.2].
    #[schemars(range(min = -0.2, max = 0.2))]
    pub rack_travel_m_per_rev: f64,
    /// Mass of the rack. [kg], (0, 50]
    #[schemars(range(max = 50.0), extend("exclusiveMinimum" = 0.0))]
    pub rack_mass_kg: f64,
    /// Inertia of the assist motor and pinion as a mass at the rack. [kg], [0, 2000]
    #[schemars(range(min = 0.0, max = 2000.0))]
    pub assist_inertia_at_rack_kg: f64,
    /// Viscous damping of rack and assist motor, at the rack. [N·s/m], [0, 100000]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub rack_damping_n_s_m: f64,
    /// Friction of the rack.
    pub rack_friction: LinearFriction,
    /// Rack travel to each side up to the stop. [m], (0, 0.3]
    #[schemars(range(max = 0.3), extend("exclusiveMinimum" = 0.0))]
    pub rack_stop_m: f64,
    /// Stiffness of the stops. [N/m], (0, 1e8]
    #[schemars(range(max = 1e8), extend("exclusiveMinimum" = 0.0))]
    pub rack_stop_stiffness_n_m: f64,
    /// Damping of the stops. [N·s/m], [0, 1e6]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub rack_stop_damping_n_s_m: f64,
    /// Stiffness of the torsion bar. [N·m/rad], (0, 2000]; 2 N·m/deg = 114.59 N·m/rad
    #[schemars(range(max = 2000.0), extend("exclusiveMinimum" = 0.0))]
    pub torsion_bar_stiffness_n_m_rad: f64,
    /// Damping of the torsion bar. [N·m·s/rad], [0, 10]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub torsion_bar_damping_n_m_s_rad: f64,
    /// Universal joints between hand wheel and torsion bar; absent: the shaft turns evenly.
    pub universal_joints: Option<UniversalJoints>,
    /// Friction of the upper column.
    pub column_friction: AngularFriction,
    /// Moment of inertia of the upper column without the wheel. [kg·m²], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub column_inertia_kg_m2: f64,
    /// Moment of inertia of the hand wheel; counts in the measuring-wheel set-up, and the steer
    /// actuator's inertia stands in for it otherwise. [kg·m²], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub hand_wheel_inertia_kg_m2: f64,
    /// The assist.
    pub assist: Assist,
}

/// Two universal joints of the column. One joint of angle β turns unevenly, tan θ₂ = tan θ₁ cos β; the second
/// undoes it when both angles are equal and `phase_rad` is 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct UniversalJoints {
    /// Angle between column and intermediate shaft. [rad], [0, 1.2]
    #[schemars(range(min = 0.0, max = 1.2))]
    pub upper_angle_rad: f64,
    /// Angle between intermediate shaft and pinion. [rad], [0, 1.2]
    #[schemars(range(min = 0.0, max = 1.2))]
    pub lower_angle_rad: f64,
    /// By how much the yokes of the intermediate shaft miss the position in which the joints cancel. [rad], [-1.6, 1.6]
    #[schemars(range(min = -1.6, max = 1.6))]
    pub phase_rad: f64,
    /// Hand-wheel angle, from straight ahead to where the upper yoke lies in the plane of its shafts. [rad], [-1.6, 1.6]
    #[schemars(range(min = -1.6, max = 1.6))]
    pub yoke_rad: f64,
}

/// Makes a section for friction along a line or about an axis.
macro_rules! friction_section {
    ($(#[$doc:meta])* $name:ident, $sliding:ident [$force:literal], $speed:ident [$speed_unit:literal], $travel:ident [$travel_unit:literal]) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            #[doc = concat!("Sliding (Coulomb) friction. [", $force, "], [0, 5000]")]
            #[schemars(range(min = 0.0, max = 5000.0))]
            pub $sliding: f64,
            /// Break-away over sliding friction. [-], [1, 3]
            #[schemars(range(min = 1.0, max = 3.0))]
            pub breakaway_ratio: f64,
            #[doc = concat!("Speed at which break-away has faded to sliding (Stribeck). [", $speed_unit, "], (0, 1]")]
            #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
            pub $speed: f64,
            #[doc = concat!("Elastic travel before sliding: sliding friction over bristle stiffness. [", $travel_unit, "], (0, 0.1]")]
            #[schemars(range(max = 0.1), extend("exclusiveMinimum" = 0.0))]
            pub $travel: f64,
            /// Bristle damping over bristle stiffness. [s], [0, 0.1]
            #[schemars(range(min = 0.0, max = 0.1))]
            pub bristle_time_s: f64,
        }

        impl From<&$name> for Friction {
            fn from(f: &$name) -> Self {
                Self {
                    sliding: f.$sliding,
                    breakaway_ratio: f.breakaway_ratio,
                    stribeck_speed: f.$speed,
                    presliding: f.$travel,
                    bristle_time_s: f.bristle_time_s,
                }
            }
        }
    };
}

friction_section!(
    /// Friction along a line, with pre-sliding (LuGre).
    LinearFriction, sliding_n ["N"], stribeck_speed_m_s ["m/s"], presliding_m ["m"]
);
friction_section!(
    /// Friction about an axis, with pre-sliding (LuGre).
    AngularFriction, sliding_n_m ["N·m"], stribeck_speed_rad_s ["rad/s"], presliding_rad ["rad"]
);

/// Friction of either kind, as the friction model takes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction {
    /// Sliding friction. [N] or [N·m]
    pub sliding: f64,
    /// Break-away over sliding friction. [-]
    pub breakaway_ratio: f64,
    /// Stribeck speed. [m/s] or [rad/s]
    pub stribeck_speed: f64,
    /// Elastic travel before sliding. [m] or [rad]
    pub presliding: f64,
    /// Bristle damping over bristle stiffness. [s]
    pub bristle_time_s: f64,
}

/// Assist of the steering unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Assist {
    /// Manual steering.
    None {},
    /// Electric assist with an ECU: map over torsion-bar torque and speed, lead, damping, active return.
    Electric(ElectricAssist),
}

/// Electric assist and its ECU. All forces as at the rack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ElectricAssist {
    /// Nodes of torsion-bar torque, rising from 0; the map is odd in torque. [N·m]
    pub torque_nodes_n_m: Vec<f64>,
    /// Nodes of vehicle speed, rising from 0. [m/s]
    pub speed_nodes_m_s: Vec<f64>,
    /// Assist force, one row for each speed node, one column for each torque node. [N]
    pub force_n: Vec<Vec<f64>>,
    /// Damping at each speed node, against the rack's speed. [N·s/m]
    pub damping_n_s_m: Vec<f64>,
    /// Active return at each speed node: force per rack displacement towards the centre. [N/m]
    pub return_n_m: Vec<f64>,
    /// Largest active-return force. [N], [0, 5000]
    #[schemars(range(min = 0.0, max = 5000.0))]
    pub return_limit_n: f64,
    /// Lag of the torque sensor. [s], [0, 0.05]
    #[schemars(range(min = 0.0, max = 0.05))]
    pub sensor_lag_s: f64,
    /// Lead of the ECU's stabilising filter (1 + lead s)/(1 + lag s). [s], [0, 0.1]
    #[schemars(range(min = 0.0, max = 0.1))]
    pub lead_s: f64,
    /// Lag of the same filter. [s], (0, 0.1]
    #[schemars(range(max = 0.1), extend("exclusiveMinimum" = 0.0))]
    pub lead_lag_s: f64,
    /// Lag of the motor's torque. [s], [0, 0.05]
    #[schemars(range(min = 0.0, max = 0.05))]
    pub motor_lag_s: f64,
    /// Largest assist force. [N], [0, 30000]
    #[schemars(range(min = 0.0, max = 30000.0))]
    pub force_limit_n: f64,
}

fn rising_from_zero(nodes: &[f64]) -> bool {
    nodes.first() == Some(&0.0) && nodes.windows(2).all(|pair| pair[0] < pair[1])
}

impl Check for SteeringUnit {
    fn check(&self, c: &mut Checker) {
        c.require(
            self.rack_travel_m_per_rev.abs() >= 0.005,
            "rack_travel_m_per_rev",
            "must have a magnitude of at least 0.005 m/rev",
        );
        if let Assist::Electric(assist) = &self.assist {
            c.within("assist", |c| assist.check(c));
        }
    }
}

impl Check for ElectricAssist {
    fn check(&self, c: &mut Checker) {
        c.require(
            self.torque_nodes_n_m.len() >= 2 && rising_from_zero(&self.torque_nodes_n_m),
            "torque_nodes_n_m",
            "must have at least two values, rising strictly from 0",
        );
        c.require(
            !self.speed_nodes_m_s.is_empty() && rising_from_zero(&self.speed_nodes_m_s),
            "speed_nodes_m_s",
            "must have at least one value, rising strictly from 0",
        );
        let speeds = self.speed_nodes_m_s.len();
        let per_speed = format!("must have one entry for each of the {speeds} speed nodes");
        c.require(self.force_n.len() == speeds, "force_n", per_speed.as_str());
        c.require(self.damping_n_s_m.len() == speeds, "damping_n_s_m", per_speed.as_str());
        c.require(self.return_n_m.len() == speeds, "return_n_m", per_speed.as_str());
        for (i, row) in self.force_n.iter().enumerate() {
            let key = format!("force_n[{i}]");
            c.require(
                row.len() == self.torque_nodes_n_m.len(),
                &key,
                format!("must have one value for each of the {} torque nodes", self.torque_nodes_n_m.len()),
            );
            c.require(
                row.first().is_none_or(|f| *f == 0.0) && row.windows(2).all(|pair| pair[0] <= pair[1]),
                &key,
                "must start at 0 and never fall",
            );
        }
        for (key, values) in [("damping_n_s_m", &self.damping_n_s_m), ("return_n_m", &self.return_n_m)] {
            c.require(values.iter().all(|v| *v >= 0.0 && v.is_finite()), key, "must not be negative");
        }
        c.require(
            self.lead_s >= self.lead_lag_s,
            "lead_s",
            format!("must not be below lead_lag_s = {}", self.lead_lag_s),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_unit_parses_and_holds_its_rules() {
        let unit: SteeringUnit = toml::from_str(include_str!("../../units/column_eps.toml")).unwrap();
        assert_eq!(unit.broken(), []);
        assert!((unit.torsion_bar_stiffness_n_m_rad.to_radians() - 2.0).abs() < 1e-4);
    }

    #[test]
    fn broken_map_is_reported_with_every_rule() {
        let mut unit: SteeringUnit = toml::from_str(include_str!("../../units/column_eps.toml")).unwrap();
        unit.rack_travel_m_per_rev = 0.0;
        if let Assist::Electric(assist) = &mut unit.assist {
            assist.force_n[1][2] = -5.0;
            assist.speed_nodes_m_s[0] = 1.0;
            assist.return_n_m.pop();
        }
        let keys: Vec<String> = unit.broken().into_iter().map(|b| b.key).collect();
        let expected =
            ["rack_travel_m_per_rev", "assist.speed_nodes_m_s", "assist.return_n_m", "assist.force_n[1]"];
        assert_eq!(keys, expected);
    }
}
