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
    /// OpenCRG surface on top of grade and bank; absent: none.
    pub surface: Option<Surface>,
}

/// An OpenCRG surface: elevations over (u, v), u along a reference line, v to its left. Its own global frame is
/// turned and moved so that the reference line begins where it is said here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Surface {
    /// The .crg file: a path beside this file.
    pub file: String,
    /// Where the reference line begins, x. [m], [-100000, 100000]
    #[schemars(range(min = -1e5, max = 1e5))]
    pub begin_x_m: f64,
    /// Where the reference line begins, y. [m], [-100000, 100000]
    #[schemars(range(min = -1e5, max = 1e5))]
    pub begin_y_m: f64,
    /// Height of the surface where the reference line begins, at v = 0. [m], [-1000, 1000]
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub begin_height_m: f64,
    /// Heading of the reference line where it begins, left positive from +x. [deg], [-180, 180]
    #[schemars(range(min = -180.0, max = 180.0))]
    pub heading_deg: f64,
    /// Factor on elevations relative to that of the begin. [-], [-10, 10]
    #[schemars(range(min = -10.0, max = 10.0))]
    pub height_scale: f64,
    /// What is beyond the edges of the grid (and in its holes).
    pub outside: Outside,
    /// Length, along the wheel's heading, over which a plane is laid through the surface under a wheel. [m], [0.01, 1]
    #[schemars(range(min = 0.01, max = 1.0))]
    pub patch_length_m: f64,
    /// Width of that area. [m], [0.01, 1]
    #[schemars(range(min = 0.01, max = 1.0))]
    pub patch_width_m: f64,
}

/// What is beyond the edges of a grid. Wheels out there raise a flag in every case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outside {
    /// The elevation of the nearest edge.
    Hold,
    /// Grade and bank alone.
    Zero,
    /// What the file's own border modes say (repeat, reflect, ...); where they say none, grade and bank alone.
    File,
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
