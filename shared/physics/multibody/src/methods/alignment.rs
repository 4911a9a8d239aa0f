//! Alignment of one wheel at one pose: angles, scrub radius, caster trail, recession, half-track change.
//!
//! Frame B: ISO 8855, origin midway between the wheel centres at design. Scrub and trail lie in the plane
//! through the contact patch parallel to B's xy plane, along the wheel's own heading; the contact patch is
//! the knuckle-fixed point of the hardpoints, not a recomputed tyre contact.

use crate::suspension::SideOutput;

/// Alignment outputs of one side.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Alignment {
    /// Toe, + in. [rad]
    pub toe_rad: f64,
    /// Camber, + top outward. [rad]
    pub camber_rad: f64,
    /// Caster, + top rearward. [rad]
    pub caster_rad: f64,
    /// Kingpin inclination, + top inboard. [rad]
    pub kingpin_inclination_rad: f64,
    /// Scrub radius: from the kingpin axis' ground point outboard to the contact patch, across the wheel's
    /// heading. [m]
    pub scrub_radius_m: f64,
    /// Caster trail: from the contact patch forward to the kingpin axis' ground point, along the wheel's
    /// heading. [m]
    pub caster_trail_m: f64,
    /// Rearward displacement of the wheel centre from design. [m]
    pub wheel_centre_recession_m: f64,
    /// Outward displacement of the contact patch from design. [m]
    pub half_track_change_m: f64,
}

impl Alignment {
    /// Names of the outputs with their units, in the order of [`Self::to_array`].
    pub const NAMES: [&'static str; 8] = [
        "toe_rad",
        "camber_rad",
        "caster_rad",
        "kingpin_inclination_rad",
        "scrub_radius_m",
        "caster_trail_m",
        "wheel_centre_recession_m",
        "half_track_change_m",
    ];

    /// Reads side `index` (0 left, 1 right) of a pose, relative to the same side at design.
    #[must_use]
    pub fn read(index: usize, now: &SideOutput, design: &SideOutput) -> Self {
        debug_assert!(index < 2);
        let outward = if index == 0 { 1.0 } else { -1.0 };
        let d = now.upper_joint_m - now.lower_joint_m;
        let patch = now.contact_patch_m;
        // A level kingpin axis never meets the ground; no suspension has one, and NaN would be no answer.
        let rise = if d.z.abs() > 1e-9 { d.z } else { 1e-9 };
        let ground = now.lower_joint_m + d * ((patch.z - now.lower_joint_m.z) / rise);
        let from_axis = patch - ground;
        let (sin, cos) = now.steer_rad.sin_cos();
        Self {
            toe_rad: now.toe_rad,
            camber_rad: now.camber_rad,
            caster_rad: now.caster_rad,
            kingpin_inclination_rad: now.kingpin_inclination_rad,
            scrub_radius_m: outward * (from_axis.y * cos - from_axis.x * sin),
            caster_trail_m: -(from_axis.x * cos + from_axis.y * sin),
            wheel_centre_recession_m: design.wheel_centre_m.x - now.wheel_centre_m.x,
            half_track_change_m: outward * (patch.y - design.contact_patch_m.y),
        }
    }

    /// The outputs in the order of [`Self::NAMES`].
    #[must_use]
    pub fn to_array(self) -> [f64; 8] {
        [
            self.toe_rad,
            self.camber_rad,
            self.caster_rad,
            self.kingpin_inclination_rad,
            self.scrub_radius_m,
            self.caster_trail_m,
            self.wheel_centre_recession_m,
            self.half_track_change_m,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spatial::Vector3;

    #[test]
    fn scrub_and_trail_of_an_axis_drawn_by_hand() {
        // Axis through (0.03, 0.70, −0.3) on the ground, leaning 0.1 inward and 0.05 rearward per metre.
        let ground = Vector3::new(0.03, 0.70, -0.3);
        let along = Vector3::new(-0.05, -0.1, 1.0);
        let now = SideOutput {
            lower_joint_m: ground + along * 0.2,
            upper_joint_m: ground + along * 0.7,
            contact_patch_m: Vector3::new(0.01, 0.75, -0.3),
            ..SideOutput::default()
        };
        let read = Alignment::read(0, &now, &SideOutput::default());
        assert!((read.scrub_radius_m - 0.05).abs() < 1e-15 && (read.caster_trail_m - 0.02).abs() < 1e-15);
        // Steered by a quarter turn to the left, what was trail is scrub.
        let turned = SideOutput { steer_rad: std::f64::consts::FRAC_PI_2, ..now };
        let read = Alignment::read(0, &turned, &SideOutput::default());
        assert!((read.scrub_radius_m - 0.02).abs() < 1e-15 && (read.caster_trail_m + 0.05).abs() < 1e-15);
    }
}
