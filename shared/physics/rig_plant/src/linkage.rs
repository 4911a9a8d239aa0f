//! Geometry of one side: horizontal cylinder → link → lower arm → column → upper arm → tie rod → rack.
//!
//! Side frame (forward, outboard, up), origin at the rack's centre. The horizontal cylinder moves its rod end
//! along the forward axis; link and lower arm turn it into rotation ψ of the column about the up axis; the
//! upper arm's tip carries the tie rod's outer ball, and the vertical cylinder lifts it. The lower arm stays
//! with the vertical cylinder's body, so the link's plane is horizontal. ψ > 0 moves the ball outboard.
//!
//! With r = lower arm, l = link:  stroke q(ψ) = r sin ψ + l − √(l² − r²(1 − cos ψ)²).

use config::rig::Geometry;

/// The linkage of one side.
#[derive(Debug, Clone, PartialEq)]
pub struct Linkage {
    inner_outboard: f64,
    column_forward: f64,
    column_outboard: f64,
    ball_up: f64,
    upper_arm: f64,
    lower_arm: f64,
    link: f64,
    rest_length: f64,
}

/// The column at one angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmPose {
    /// Column angle. [rad]
    pub angle_rad: f64,
    /// Stroke of the horizontal cylinder. [m]
    pub stroke_m: f64,
    /// dq/dψ. [m/rad]
    pub stroke_per_angle_m_rad: f64,
    /// Tip of the upper arm: forward, outboard. [m]
    pub tip_m: [f64; 2],
    /// Unit vector in which the tip moves: forward, outboard.
    pub tangent: [f64; 2],
}

/// The tie rod between tip and rack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RodPose {
    /// Length from inner ball to the arm's tip, less that at rest. [m]
    pub elongation_m: f64,
    /// Unit vector from the inner to the outer ball: forward, outboard, up.
    pub direction: [f64; 3],
    /// Change of elongation per metre of the tip along its tangent. [-]
    pub per_tip: f64,
}

impl Linkage {
    /// The linkage of a checked geometry.
    pub fn new(geometry: &Geometry) -> Self {
        let [forward, outboard, up] = geometry.tie_rod_m;
        Self {
            inner_outboard: geometry.inner_ball_outboard_m,
            column_forward: forward - geometry.upper_arm_m,
            column_outboard: geometry.inner_ball_outboard_m + outboard,
            ball_up: up,
            upper_arm: geometry.upper_arm_m,
            lower_arm: geometry.lower_arm_m,
            link: geometry.link_m,
            rest_length: (forward * forward + outboard * outboard + up * up).sqrt(),
        }
    }

    /// Length of the upper arm. [m]
    pub fn upper_arm_m(&self) -> f64 {
        self.upper_arm
    }

    /// The column at angle ψ. Valid for |ψ| < 80°.
    pub fn arm(&self, angle_rad: f64) -> ArmPose {
        let (sin, cos) = angle_rad.sin_cos();
        let (r, l) = (self.lower_arm, self.link);
        let sideways = r * (1.0 - cos);
        let along = (l * l - sideways * sideways).max(1e-4 * l * l).sqrt();
        ArmPose {
            angle_rad,
            stroke_m: r * sin + l - along,
            stroke_per_angle_m_rad: r * cos + sideways * r * sin / along,
            tip_m: [self.column_forward + self.upper_arm * cos, self.column_outboard + self.upper_arm * sin],
            tangent: [-sin, cos],
        }
    }

    /// The column at a stroke of the horizontal cylinder: four Newton steps, exact to rounding within
    /// 0.8 of the lower arm.
    pub fn arm_at_stroke(&self, stroke_m: f64) -> ArmPose {
        let limit = 0.85 * self.lower_arm;
        let stroke = stroke_m.clamp(-limit, limit);
        let mut pose = self.arm((stroke / self.lower_arm).asin());
        for _ in 0..4 {
            pose = self.arm(pose.angle_rad - (pose.stroke_m - stroke) / pose.stroke_per_angle_m_rad);
        }
        pose
    }

    /// The tie rod for a column pose, a lift of the outer ball and an outboard displacement of the rack.
    pub fn rod(&self, arm: &ArmPose, lift_m: f64, rack_outboard_m: f64) -> RodPose {
        let d = [arm.tip_m[0], arm.tip_m[1] - self.inner_outboard - rack_outboard_m, self.ball_up + lift_m];
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        let direction = [d[0] / length, d[1] / length, d[2] / length];
        RodPose {
            elongation_m: length - self.rest_length,
            direction,
            per_tip: direction[0] * arm.tangent[0] + direction[1] * arm.tangent[1],
        }
    }

    /// Change of elongation per metre of horizontal stroke: tie-rod force = actuator force / this, at rest.
    pub fn elongation_per_stroke(&self, arm: &ArmPose, rod: &RodPose) -> f64 {
        rod.per_tip * self.upper_arm / arm.stroke_per_angle_m_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn linkage() -> Linkage {
        let rig: config::rig::Rig =
            toml::from_str(include_str!("../../../../schemas/rigs/virtual.toml")).unwrap();
        Linkage::new(&rig.geometry)
    }

    #[test]
    fn stroke_and_angle_are_inverse() {
        let linkage = linkage();
        for i in -12..=12 {
            let stroke = f64::from(i) * 0.01;
            assert!((linkage.arm_at_stroke(stroke).stroke_m - stroke).abs() < 1e-14);
        }
    }

    #[test]
    fn ratios_are_the_derivatives() {
        let linkage = linkage();
        let step = 1e-6;
        for (angle, lift, rack) in [(0.0, 0.0, 0.0), (0.35, 0.08, 0.05), (-0.4, -0.1, -0.07)] {
            let (low, mid, high) = (linkage.arm(angle - step), linkage.arm(angle), linkage.arm(angle + step));
            let slope = (high.stroke_m - low.stroke_m) / (2.0 * step);
            assert!((slope - mid.stroke_per_angle_m_rad).abs() < 1e-9);
            let rod = linkage.rod(&mid, lift, rack);
            let change =
                linkage.rod(&high, lift, rack).elongation_m - linkage.rod(&low, lift, rack).elongation_m;
            let per_stroke = change / (high.stroke_m - low.stroke_m);
            assert!((per_stroke - linkage.elongation_per_stroke(&mid, &rod)).abs() < 1e-8);
            let up = linkage.rod(&mid, lift + step, rack).elongation_m;
            let down = linkage.rod(&mid, lift - step, rack).elongation_m;
            assert!(((up - down) / (2.0 * step) - rod.direction[2]).abs() < 1e-8);
        }
    }
}
