//! The road and the wind of a scenario: friction, grade, crosswind.
//! Frame: inertial, ISO 8855; the car starts at the origin heading along +x, so +y is its left.

use crate::check::{Check, Checker};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The road and the wind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Road {
    /// Scale of the tyre's own friction, where.
    pub friction: Friction,
    /// Slope along +x, uphill positive. [%], [-40, 40]
    #[schemars(range(min = -40.0, max = 40.0))]
    pub grade_percent: f64,
    /// Slope along +y, rising to the left positive. [%], [-40, 40]
    #[schemars(range(min = -40.0, max = 40.0))]
    pub bank_percent: f64,
    /// Wind; absent: still air.
    pub crosswind: Option<Crosswind>,
}

/// Scale of the tyre's own peak friction (1: the surface on which the tyre was measured).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Friction {
    /// The same everywhere.
    Uniform {
        /// Friction scale. [-], (0, 2]
        #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 2.0))]
        scale: f64,
    },
    /// Different left (y > 0) and right of the x axis, between two stations; `outside_scale` elsewhere.
    Split {
        /// Friction scale for y > 0. [-], (0, 2]
        #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 2.0))]
        left_scale: f64,
        /// Friction scale for y ≤ 0. [-], (0, 2]
        #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 2.0))]
        right_scale: f64,
        /// Friction scale before and after. [-], (0, 2]
        #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 2.0))]
        outside_scale: f64,
        /// Begin. [m]
        from_x_m: f64,
        /// End. [m]
        to_x_m: f64,
    },
    /// Rectangles; the first that holds the point counts, `outside_scale` elsewhere.
    Patches {
        /// Friction scale outside all patches. [-], (0, 2]
        #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 2.0))]
        outside_scale: f64,
        /// The rectangles, at most 256.
        #[schemars(length(min = 1, max = 256))]
        patches: Vec<FrictionPatch>,
    },
}

/// A rectangle of road of one friction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrictionPatch {
    /// Begin along x. [m]
    pub from_x_m: f64,
    /// End along x. [m]
    pub to_x_m: f64,
    /// Right edge. [m]
    pub from_y_m: f64,
    /// Left edge. [m]
    pub to_y_m: f64,
    /// Friction scale. [-], (0, 2]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 2.0))]
    pub scale: f64,
}

/// A wind across the road, between two manoeuvre times.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Crosswind {
    /// Speed of the air. [m/s], [0, 60]
    #[schemars(range(min = 0.0, max = 60.0))]
    pub speed_m_s: f64,
    /// Where the air moves to, from +x towards +y: 90 pushes to the left. [deg], [-180, 180]
    #[schemars(range(min = -180.0, max = 180.0))]
    pub direction_deg: f64,
    /// Begin, in manoeuvre time. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// End, in manoeuvre time. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub end_s: f64,
    /// Rise at the begin and fall at the end, half a cosine. [s], (0, 60]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 60.0))]
    pub rise_s: f64,
}

impl Check for Road {
    fn check(&self, c: &mut Checker) {
        c.within("friction", |c| match &self.friction {
            Friction::Uniform { .. } => {}
            Friction::Split { from_x_m, to_x_m, .. } => {
                c.require(to_x_m > from_x_m, "to_x_m", "must be greater than from_x_m");
            }
            Friction::Patches { patches, .. } => {
                for (i, patch) in patches.iter().enumerate() {
                    c.within(&format!("patches[{i}]"), |c| {
                        c.require(patch.to_x_m > patch.from_x_m, "to_x_m", "must be greater than from_x_m");
                        c.require(patch.to_y_m > patch.from_y_m, "to_y_m", "must be greater than from_y_m");
                    });
                }
            }
        });
        if let Some(wind) = &self.crosswind {
            c.within("crosswind", |c| {
                let fits = wind.end_s - wind.start_s >= 2.0 * wind.rise_s;
                c.require(fits, "end_s", "must leave room after start_s for twice rise_s");
            });
        }
    }
}
