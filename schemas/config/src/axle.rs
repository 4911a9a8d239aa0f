//! One axle: the suspension's named hardpoints, its type, stabiliser, friction and compliance.
//!
//! Frame: car body, ISO 8855 (x forward, y left, z up), metres, origin at the middle between the two wheel
//! centres at design height. Hardpoints are given at design height with the rack centred. A side that is
//! left out is the mirror image (y → −y) of the other. Files are TOML; a plain hardpoint JSON file (points
//! by name, left and right) is read by [`Axle::from_hardpoint_json`].

// A point that is not finite is reported once, as such, and not again by rules of distance: `!(a < b)`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use std::collections::BTreeMap;

use crate::{Broken, Check, Checker};

mod hardpoint_json;

/// Two points closer than this cannot carry a link. [m]
const LINK_LENGTH_MIN_M: f64 = 1e-3;
/// Static angles and an explicit spin axis must agree to this, and to the second order of the angles: toe
/// and camber may have been turned one after the other, or drawn as slopes. The axis is what counts. [rad]
const SPIN_AXIS_TOLERANCE_RAD: f64 = 1e-5;
/// An explicit spin axis may be as long as its rounded coordinates make it; it is then brought to unit length.
const SPIN_AXIS_LENGTH_TOLERANCE: f64 = 1e-4;

/// A steered axle with a rack: geometry and what acts in it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Axle {
    /// Name of this axle.
    pub name: String,
    /// Where its numbers come from.
    pub source: String,
    /// Rack displacement at full lock, each way. [m], (0, 0.3]
    #[schemars(range(max = 0.3), extend("exclusiveMinimum" = 0.0))]
    pub rack_stroke_m: f64,
    /// Loaded tyre radius at design load. [m], (0, 2]
    #[schemars(range(max = 2.0), extend("exclusiveMinimum" = 0.0))]
    pub loaded_radius_m: f64,
    /// Static toe, left and right, + = toe-in. [rad], [-0.2, 0.2]
    pub static_toe_in_rad: [f64; 2],
    /// Static camber, left and right, + = top outward. [rad], [-0.3, 0.3]
    pub static_camber_rad: [f64; 2],
    /// The linkage and its hardpoints.
    pub geometry: Geometry,
    /// Stabiliser bar with drop links to the knuckles; absent: none.
    pub stabiliser: Option<Stabiliser>,
    /// Rubber bushings at arm-to-body points, by hardpoint name without its unit (`lca_front`), both sides
    /// alike; absent: rigid joints everywhere. Points not listed stay rigid ball joints.
    pub bushings: Option<BTreeMap<String, Bushing>>,
    /// Friction about the kingpin axis; absent: none.
    pub kingpin_friction: Option<KingpinFriction>,
}

/// The linkage of both sides.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Geometry {
    /// Upper and lower triangular arm, spring on the lower arm.
    DoubleWishbone(DoubleWishbone),
    /// McPherson strut: lower triangular arm, telescopic strut fixed to the knuckle.
    Strut(Strut),
    /// Four links and the tie rod; spring on one of the links.
    FiveLink(FiveLink),
}

/// Double wishbone, both sides.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DoubleWishbone {
    /// Left side.
    pub left: DoubleWishbonePoints,
    /// Right side; absent: the mirror image of the left one.
    pub right: Option<DoubleWishbonePoints>,
}

/// Strut, both sides.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Strut {
    /// The line that carries the vertical load in the force stage.
    pub reaction_line: StrutReactionLine,
    /// Left side.
    pub left: StrutPoints,
    /// Right side; absent: the mirror image of the left one.
    pub right: Option<StrutPoints>,
}

/// The line along which the strut's spring force acts. The tie-rod force is the same for both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StrutReactionLine {
    /// Lower ball joint to top mount: the kingpin axis.
    LowerBallToTop,
    /// Strut lower point to top mount: the strut's own axis.
    StrutAxis,
}

/// Five-link suspension, both sides.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FiveLink {
    /// The link that carries the spring.
    pub spring_on: Link,
    /// Left side.
    pub left: FiveLinkPoints,
    /// Right side; absent: the mirror image of the left one.
    pub right: Option<FiveLinkPoints>,
}

/// One of the four links of a five-link suspension (the fifth is the tie rod).
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Link {
    /// Upper front link.
    UpperFront,
    /// Upper rear link.
    UpperRear,
    /// Lower front link.
    LowerFront,
    /// Lower rear link.
    LowerRear,
}

impl Link {
    /// All four, in the order of the solver.
    pub const ALL: [Self; 4] = [Self::UpperFront, Self::UpperRear, Self::LowerFront, Self::LowerRear];

    /// Name as in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::UpperFront => "upper_front",
            Self::UpperRear => "upper_rear",
            Self::LowerFront => "lower_front",
            Self::LowerRear => "lower_rear",
        }
    }
}

/// Defines one side's hardpoint struct: its named points, and how to walk, mirror and name them.
macro_rules! hardpoints {
    ($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident = $short:literal),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: [f64; 3],)+
            /// Unit wheel axis at design, pointing to +y on both sides; absent: from static toe and camber.
            pub spin_axis: Option<[f64; 3]>,
        }

        impl $name {
            /// Names of the points without their unit, in file order.
            pub const NAMES: &'static [&'static str] = &[$($short),+];

            /// The points by name, in file order. [m]
            pub fn points(&self) -> impl Iterator<Item = (&'static str, [f64; 3])> {
                [$(($short, self.$field)),+].into_iter()
            }

            /// The mirror image in the xz plane.
            #[must_use]
            pub fn mirrored(&self) -> Self {
                Self {
                    $($field: mirrored(self.$field),)+
                    // The spin axis points to +y on both sides: mirror, then reverse.
                    spin_axis: self.spin_axis.map(|s| [-s[0], s[1], -s[2]]),
                }
            }

            fn from_named(
                mut point: impl FnMut(&'static str) -> [f64; 3],
                spin_axis: Option<[f64; 3]>,
            ) -> Self {
                Self { $($field: point($short),)+ spin_axis }
            }
        }
    };
}

hardpoints! {
    /// Hardpoints of one double-wishbone side. [m]
    DoubleWishbonePoints {
        /// Upper arm, front body point. [m]
        uca_front_m = "uca_front",
        /// Upper arm, rear body point. [m]
        uca_rear_m = "uca_rear",
        /// Upper ball joint. [m]
        uca_ball_m = "uca_ball",
        /// Lower arm, front body point. [m]
        lca_front_m = "lca_front",
        /// Lower arm, rear body point. [m]
        lca_rear_m = "lca_rear",
        /// Lower ball joint. [m]
        lca_ball_m = "lca_ball",
        /// Tie rod, inner ball on the rack. [m]
        tierod_inner_m = "tierod_inner",
        /// Tie rod, outer ball on the knuckle. [m]
        tierod_outer_m = "tierod_outer",
        /// Spring and damper, body point. [m]
        spring_upper_m = "spring_upper",
        /// Spring and damper, lower-arm point. [m]
        spring_lower_m = "spring_lower",
        /// Wheel centre. [m]
        wheel_centre_m = "wheel_centre",
        /// Contact patch, fixed to the knuckle. [m]
        contact_patch_m = "contact_patch",
    }
}

hardpoints! {
    /// Hardpoints of one strut side. [m]
    StrutPoints {
        /// Lower arm, front body point. [m]
        lca_front_m = "lca_front",
        /// Lower arm, rear body point. [m]
        lca_rear_m = "lca_rear",
        /// Lower ball joint. [m]
        lca_ball_m = "lca_ball",
        /// Strut top mount on the body. [m]
        strut_top_m = "strut_top",
        /// Lower point of the strut's axis on the knuckle. [m]
        strut_lower_m = "strut_lower",
        /// Tie rod, inner ball on the rack. [m]
        tierod_inner_m = "tierod_inner",
        /// Tie rod, outer ball on the knuckle. [m]
        tierod_outer_m = "tierod_outer",
        /// Wheel centre. [m]
        wheel_centre_m = "wheel_centre",
        /// Contact patch, fixed to the knuckle. [m]
        contact_patch_m = "contact_patch",
    }
}

hardpoints! {
    /// Hardpoints of one five-link side. [m]
    FiveLinkPoints {
        /// Upper front link, body point. [m]
        upper_front_inner_m = "upper_front_inner",
        /// Upper front link, knuckle point. [m]
        upper_front_outer_m = "upper_front_outer",
        /// Upper rear link, body point. [m]
        upper_rear_inner_m = "upper_rear_inner",
        /// Upper rear link, knuckle point. [m]
        upper_rear_outer_m = "upper_rear_outer",
        /// Lower front link, body point. [m]
        lower_front_inner_m = "lower_front_inner",
        /// Lower front link, knuckle point. [m]
        lower_front_outer_m = "lower_front_outer",
        /// Lower rear link, body point. [m]
        lower_rear_inner_m = "lower_rear_inner",
        /// Lower rear link, knuckle point. [m]
        lower_rear_outer_m = "lower_rear_outer",
        /// Tie rod, inner ball on the rack. [m]
        tierod_inner_m = "tierod_inner",
        /// Tie rod, outer ball on the knuckle. [m]
        tierod_outer_m = "tierod_outer",
        /// Spring and damper, body point. [m]
        spring_upper_m = "spring_upper",
        /// Spring and damper, point on the link that carries it. [m]
        spring_lower_m = "spring_lower",
        /// Wheel centre. [m]
        wheel_centre_m = "wheel_centre",
        /// Contact patch, fixed to the knuckle. [m]
        contact_patch_m = "contact_patch",
    }
}

/// Stabiliser (anti-roll) bar: two halves hinged on the body, joined by a torsion spring, with drop links
/// to the knuckles. Unstressed at design.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Stabiliser {
    /// Torque per relative rotation of the two halves. [N m/rad], [0, 1e6]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub stiffness_n_m_per_rad: f64,
    /// Left side.
    pub left: StabiliserPoints,
    /// Right side; absent: the mirror image of the left one.
    pub right: Option<StabiliserPoints>,
}

/// Points of one half of the stabiliser. [m]
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StabiliserPoints {
    /// Bar bush on the body; the bar's axis runs from the right one to the left one. [m]
    pub arb_bush_m: [f64; 3],
    /// End of the bar's arm: the drop link's lower ball. [m]
    pub arb_arm_end_m: [f64; 3],
    /// The drop link's ball on the knuckle (or on the strut fixed to it). [m]
    pub droplink_upper_m: [f64; 3],
}

impl StabiliserPoints {
    /// The mirror image in the xz plane.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        Self {
            arb_bush_m: mirrored(self.arb_bush_m),
            arb_arm_end_m: mirrored(self.arb_arm_end_m),
            droplink_upper_m: mirrored(self.droplink_upper_m),
        }
    }
}

/// A rubber bushing between an arm and the body, undeformed at design without load.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Bushing {
    /// Stiffness across the bushing's axis. [N/m], (0, 1e9]
    #[schemars(range(max = 1e9), extend("exclusiveMinimum" = 0.0))]
    pub radial_n_per_m: f64,
    /// Stiffness along the bushing's axis. [N/m], (0, 1e9]
    #[schemars(range(max = 1e9), extend("exclusiveMinimum" = 0.0))]
    pub axial_n_per_m: f64,
    /// Stiffness against rotation, the same about every axis. [N m/rad], [0, 1e6]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub torsional_n_m_per_rad: f64,
    /// The bushing's axis on the left side (mirrored on the right); absent: the line from the arm's rear to
    /// its front body point. Required where the arm has one body point only (links).
    pub axis: Option<[f64; 3]>,
    /// Damping beside the stiffness; absent: none. Acts where the solver is told the time between its ticks.
    pub damping: Option<BushingDamping>,
}

/// Viscous damping of a bushing, along and about the axes of its stiffness.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BushingDamping {
    /// Across the bushing's axis. [N s/m], [0, 1e7]
    #[schemars(range(min = 0.0, max = 1e7))]
    pub radial_n_s_per_m: f64,
    /// Along the bushing's axis. [N s/m], [0, 1e7]
    #[schemars(range(min = 0.0, max = 1e7))]
    pub axial_n_s_per_m: f64,
    /// Against rotation, the same about every axis. [N m s/rad], [0, 1e4]
    #[schemars(range(min = 0.0, max = 1e4))]
    pub torsional_n_m_s_per_rad: f64,
}

/// Friction about the kingpin axis, smooth at reversal.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KingpinFriction {
    /// Moment when sliding, per wheel. [N m], [0, 200]; 5 to 10 is usual
    #[schemars(range(min = 0.0, max = 200.0))]
    pub moment_n_m: f64,
    /// Rotation over which the moment builds up by 63 % after a reversal. [rad], (0, 0.2]
    #[schemars(range(max = 0.2), extend("exclusiveMinimum" = 0.0))]
    pub presliding_rad: f64,
}

fn mirrored(p: [f64; 3]) -> [f64; 3] {
    [p[0], -p[1], p[2]]
}

impl Geometry {
    /// The named points of one side (0 left, 1 right), in file order. [m]
    #[must_use]
    pub fn named_points(&self, side: usize) -> Vec<(&'static str, [f64; 3])> {
        match self {
            Self::DoubleWishbone(g) => g.sides()[side].points().collect(),
            Self::Strut(g) => g.sides()[side].points().collect(),
            Self::FiveLink(g) => g.sides()[side].points().collect(),
        }
    }

    /// One named point of one side (0 left, 1 right). [m]
    #[must_use]
    pub fn point(&self, side: usize, name: &str) -> Option<[f64; 3]> {
        self.named_points(side).into_iter().find(|(n, _)| *n == name).map(|(_, p)| p)
    }

    fn spin_axis(&self, side: usize) -> Option<[f64; 3]> {
        match self {
            Self::DoubleWishbone(g) => g.sides()[side].spin_axis,
            Self::Strut(g) => g.sides()[side].spin_axis,
            Self::FiveLink(g) => g.sides()[side].spin_axis,
        }
    }

    fn has_right(&self) -> bool {
        match self {
            Self::DoubleWishbone(g) => g.right.is_some(),
            Self::Strut(g) => g.right.is_some(),
            Self::FiveLink(g) => g.right.is_some(),
        }
    }

    /// Pairs of point names that are joined by a rigid part and so must not coincide.
    fn links(&self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::DoubleWishbone(_) => &[
                ("uca_front", "uca_ball"),
                ("uca_rear", "uca_ball"),
                ("uca_front", "uca_rear"),
                ("lca_front", "lca_ball"),
                ("lca_rear", "lca_ball"),
                ("lca_front", "lca_rear"),
                ("uca_ball", "lca_ball"),
                ("tierod_inner", "tierod_outer"),
                ("spring_upper", "spring_lower"),
                ("wheel_centre", "contact_patch"),
            ],
            Self::Strut(_) => &[
                ("lca_front", "lca_ball"),
                ("lca_rear", "lca_ball"),
                ("lca_front", "lca_rear"),
                ("strut_top", "strut_lower"),
                ("strut_top", "lca_ball"),
                ("tierod_inner", "tierod_outer"),
                ("wheel_centre", "contact_patch"),
            ],
            Self::FiveLink(_) => &[
                ("upper_front_inner", "upper_front_outer"),
                ("upper_rear_inner", "upper_rear_outer"),
                ("lower_front_inner", "lower_front_outer"),
                ("lower_rear_inner", "lower_rear_outer"),
                ("tierod_inner", "tierod_outer"),
                ("spring_upper", "spring_lower"),
                ("wheel_centre", "contact_patch"),
            ],
        }
    }

    /// Names of the arm-to-body points, where bushings may sit.
    #[must_use]
    pub fn body_points(&self) -> &'static [&'static str] {
        match self {
            Self::DoubleWishbone(_) => &["uca_front", "uca_rear", "lca_front", "lca_rear"],
            Self::Strut(_) => &["lca_front", "lca_rear"],
            Self::FiveLink(_) => {
                &["upper_front_inner", "upper_rear_inner", "lower_front_inner", "lower_rear_inner"]
            }
        }
    }
}

macro_rules! sides {
    ($($name:ident => $points:ident),+) => { $(
        impl $name {
            /// Left and right hardpoints, the right ones mirrored where not given.
            #[must_use]
            pub fn sides(&self) -> [$points; 2] {
                [self.left.clone(), self.right.clone().unwrap_or_else(|| self.left.mirrored())]
            }
        }
    )+ };
}
sides!(
    DoubleWishbone => DoubleWishbonePoints,
    Strut => StrutPoints,
    FiveLink => FiveLinkPoints,
    Stabiliser => StabiliserPoints
);

impl Axle {
    /// Unit wheel axis at design, pointing to +y, of one side (0 left, 1 right): the given one, or the one
    /// that follows from static toe and camber.
    #[must_use]
    pub fn spin_axis(&self, side: usize) -> [f64; 3] {
        self.geometry.spin_axis(side).map_or_else(
            || self.static_spin_axis(side),
            |s| {
                let length = distance(s, [0.0; 3]);
                s.map(|x| x / length)
            },
        )
    }

    fn static_spin_axis(&self, side: usize) -> [f64; 3] {
        let sign = if side == 0 { 1.0 } else { -1.0 };
        let steer = -sign * self.static_toe_in_rad[side];
        let camber = self.static_camber_rad[side];
        [-steer.sin() * camber.cos(), steer.cos() * camber.cos(), -sign * camber.sin()]
    }

    /// The same axle without its stabiliser.
    #[must_use]
    pub fn without_stabiliser(&self) -> Self {
        Self { stabiliser: None, ..self.clone() }
    }

    /// Reads a plain hardpoint JSON file: `type` (`double_wishbone`, `macpherson_strut`, or `five_link` with `spring_on`), `rack_full_m`,
    /// `loaded_radius`, `static_toe_in_rad`, `static_camber_rad`, `left` and `right` with the named points,
    /// and for a stabiliser `arb_stiffness_Nm_per_rad` with its three points a side. The strut's load is
    /// carried along the strut's own axis.
    ///
    /// # Errors
    /// Every missing, misspelt or wrong entry, by its key path; and every broken rule of the axle.
    pub fn from_hardpoint_json(text: &str, name: &str) -> Result<Self, Vec<Broken>> {
        let axle = hardpoint_json::read(text, name)?;
        let broken = axle.broken();
        if broken.is_empty() { Ok(axle) } else { Err(broken) }
    }
}

fn finite(p: &[f64]) -> bool {
    p.iter().all(|x| x.is_finite())
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f64>().sqrt()
}

const SIDES: [&str; 2] = ["left", "right"];

impl Check for Axle {
    fn check(&self, checker: &mut Checker) {
        for (key, value, low, high) in [
            ("rack_stroke_m", self.rack_stroke_m, 0.0, 0.3),
            ("loaded_radius_m", self.loaded_radius_m, 0.0, 2.0),
        ] {
            checker.require(value > low && value <= high, key, format!("must be in ({low}, {high}] m"));
        }
        for (key, pair, limit) in [
            ("static_toe_in_rad", self.static_toe_in_rad, 0.2),
            ("static_camber_rad", self.static_camber_rad, 0.3),
        ] {
            for (side, value) in pair.iter().enumerate() {
                checker.within(key, |c| {
                    let rule = format!("must be in [-{limit}, {limit}] rad");
                    c.require(value.abs() <= limit, &format!("[{side}]"), rule);
                });
            }
        }
        for side in 0..2 {
            if side == 0 || self.geometry.has_right() {
                checker.within("geometry", |c| c.within(SIDES[side], |c| self.check_side(side, c)));
            }
        }
        if let Some(stabiliser) = &self.stabiliser {
            checker.within("stabiliser", |c| check_stabiliser(stabiliser, c));
        }
        if let Some(bushings) = &self.bushings {
            checker.within("bushings", |c| self.check_bushings(bushings, c));
        }
        if let Some(friction) = &self.kingpin_friction {
            checker.within("kingpin_friction", |c| {
                let holds = (0.0..=200.0).contains(&friction.moment_n_m);
                c.require(holds, "moment_n_m", "must be in [0, 200] N m");
                let holds = friction.presliding_rad > 0.0 && friction.presliding_rad <= 0.2;
                c.require(holds, "presliding_rad", "must be in (0, 0.2] rad");
            });
        }
    }
}

impl Axle {
    fn check_side(&self, side: usize, checker: &mut Checker) {
        let points = self.geometry.named_points(side);
        for (name, p) in &points {
            let rule = "must be three finite numbers within 5 m of the axle's centre";
            checker.require(finite(p) && p.iter().all(|x| x.abs() <= 5.0), &format!("{name}_m"), rule);
        }
        let point = |name: &str| points.iter().find(|(n, _)| *n == name).map_or([0.0; 3], |(_, p)| *p);
        for (a, b) in self.geometry.links() {
            let holds = !(distance(point(a), point(b)) < LINK_LENGTH_MIN_M);
            let rule = format!("must be at least {LINK_LENGTH_MIN_M} m away from {a}_m");
            checker.require(holds, &format!("{b}_m"), rule);
        }
        let outward = if side == 0 { 1.0 } else { -1.0 };
        let rule = ["must have y > 0 on the left side", "must have y < 0 on the right side"][side];
        checker.require(!(point("wheel_centre")[1] * outward <= 0.0), "wheel_centre_m", rule);
        let below = !(point("contact_patch")[2] >= point("wheel_centre")[2]);
        checker.require(below, "contact_patch_m", "must be below the wheel centre");
        if let Geometry::DoubleWishbone(_) = self.geometry {
            let above = !(point("uca_ball")[2] <= point("lca_ball")[2]);
            checker.require(above, "uca_ball_m", "must be above the lower ball joint");
        }
        for (arm, front, rear, ball) in
            [("uca", "uca_front", "uca_rear", "uca_ball"), ("lca", "lca_front", "lca_rear", "lca_ball")]
        {
            if points.iter().any(|(n, _)| n == &front) {
                let holds = !(triangle_height(point(front), point(rear), point(ball)) < LINK_LENGTH_MIN_M);
                let rule = format!("must not lie on the line through the {arm} body points");
                checker.require(holds, &format!("{ball}_m"), rule);
            }
        }
        if let Some(s) = self.geometry.spin_axis(side) {
            let length = distance(s, [0.0; 3]);
            let unit = finite(&s) && (length - 1.0).abs() < SPIN_AXIS_LENGTH_TOLERANCE && s[1] > 0.0;
            checker.require(unit, "spin_axis", "must be a unit vector pointing to +y");
            let (toe, camber) = (self.static_toe_in_rad[side], self.static_camber_rad[side]);
            let tolerance = SPIN_AXIS_TOLERANCE_RAD + toe * toe + camber * camber;
            let agrees = distance(self.spin_axis(side), self.static_spin_axis(side)) < tolerance;
            checker.require(
                !unit || agrees,
                "spin_axis",
                "must agree with static toe and camber, to their second order",
            );
        }
    }

    fn check_bushings(&self, bushings: &BTreeMap<String, Bushing>, checker: &mut Checker) {
        let known = self.geometry.body_points();
        for (name, bushing) in bushings {
            checker.within(name, |c| {
                c.require(known.contains(&name.as_str()), "", format!("must be one of {}", known.join(", ")));
                for (key, value) in
                    [("radial_n_per_m", bushing.radial_n_per_m), ("axial_n_per_m", bushing.axial_n_per_m)]
                {
                    c.require(value > 0.0 && value <= 1e9, key, "must be in (0, 1e9] N/m");
                }
                let holds = (0.0..=1e6).contains(&bushing.torsional_n_m_per_rad);
                c.require(holds, "torsional_n_m_per_rad", "must be in [0, 1e6] N m/rad");
                if let Some(damping) = &bushing.damping {
                    c.within("damping", |c| {
                        for (key, value, high, unit) in [
                            ("radial_n_s_per_m", damping.radial_n_s_per_m, 1e7, "N s/m"),
                            ("axial_n_s_per_m", damping.axial_n_s_per_m, 1e7, "N s/m"),
                            ("torsional_n_m_s_per_rad", damping.torsional_n_m_s_per_rad, 1e4, "N m s/rad"),
                        ] {
                            let rule = format!("must be in [0, {high}] {unit}");
                            c.require((0.0..=high).contains(&value), key, rule);
                        }
                    });
                }
                let needs_axis = matches!(self.geometry, Geometry::FiveLink(_));
                c.require(bushing.axis.is_some() || !needs_axis, "axis", "must be given for a link");
                if let Some(axis) = bushing.axis {
                    let holds = finite(&axis) && distance(axis, [0.0; 3]) > 1e-3;
                    c.require(holds, "axis", "must be a finite vector longer than 1e-3");
                }
            });
        }
        checker.require(!bushings.is_empty(), "", "must name at least one point, or be absent");
    }
}

fn check_stabiliser(stabiliser: &Stabiliser, checker: &mut Checker) {
    let stiffness = stabiliser.stiffness_n_m_per_rad;
    let rule = "must be in [0, 1e6] N m/rad";
    checker.require((0.0..=1e6).contains(&stiffness), "stiffness_n_m_per_rad", rule);
    let sides = stabiliser.sides();
    let [left, right] = [sides[0].arb_bush_m, sides[1].arb_bush_m];
    let apart = !(distance(left, right) < LINK_LENGTH_MIN_M);
    checker.require(apart, "left.arb_bush_m", "must be at least 0.001 m away from the right one");
    for (side, points) in sides.iter().enumerate() {
        if side == 1 && stabiliser.right.is_none() {
            continue;
        }
        checker.within(SIDES[side], |c| {
            for (key, p) in [
                ("arb_bush_m", points.arb_bush_m),
                ("arb_arm_end_m", points.arb_arm_end_m),
                ("droplink_upper_m", points.droplink_upper_m),
            ] {
                let rule = "must be three finite numbers within 5 m of the axle's centre";
                c.require(finite(&p) && p.iter().all(|x| x.abs() <= 5.0), key, rule);
            }
            let holds = !(distance(points.arb_arm_end_m, points.droplink_upper_m) < LINK_LENGTH_MIN_M);
            c.require(holds, "droplink_upper_m", "must be at least 0.001 m away from arb_arm_end_m");
            let holds = !(triangle_height(left, right, points.arb_arm_end_m) < LINK_LENGTH_MIN_M);
            c.require(holds, "arb_arm_end_m", "must not lie on the bar's axis");
        });
    }
}

/// Distance of `c` from the line through `a` and `b`; NaN where the line is undefined. [m]
fn triangle_height(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    let d = |p: [f64; 3], k: usize| p[k] - a[k];
    let cross = [
        d(b, 1) * d(c, 2) - d(b, 2) * d(c, 1),
        d(b, 2) * d(c, 0) - d(b, 0) * d(c, 2),
        d(b, 0) * d(c, 1) - d(b, 1) * d(c, 0),
    ];
    distance(cross, [0.0; 3]) / distance(a, b)
}

#[cfg(test)]
mod tests;
