//! From poses and multipliers to the outputs: alignment, joint forces, loads.

use spatial::{Vector3, Wrench};

use super::model::{Side, SteeringAxis};
use super::solver::Solver;
use super::{SideOutput, Suspension, SuspensionInput, link_force};
use crate::body::{Pose, Twist};

/// Unit direction of the steering axis, upwards.
#[inline]
pub(super) fn steering_direction(side: &Side, poses: &[Pose], axis_twists: &[Twist]) -> Vector3<f64> {
    let d = match &side.steering_axis {
        SteeringAxis::Points { lower, upper } => {
            poses[upper.0].point(&upper.1) - poses[lower.0].point(&lower.1)
        }
        SteeringAxis::Instantaneous => {
            let omega = poses[side.knuckle].p.matrix() * axis_twists[side.knuckle].omega;
            if omega.z < 0.0 { -omega } else { omega }
        }
    };
    // A knuckle that does not turn with the rack has no steering axis; up is as good as any.
    d.try_normalize(1e-12).unwrap_or_else(Vector3::z)
}

/// Lower and upper point of the steering axis.
fn steering_points(
    side: &Side,
    poses: &[Pose],
    axis_twists: &[Twist],
    contact: &Vector3<f64>,
) -> [Vector3<f64>; 2] {
    match &side.steering_axis {
        SteeringAxis::Points { lower, upper } => {
            [poses[lower.0].point(&lower.1), poses[upper.0].point(&upper.1)]
        }
        SteeringAxis::Instantaneous => {
            let (pose, twist) = (&poses[side.knuckle], &axis_twists[side.knuckle]);
            let omega = pose.p.matrix() * twist.omega;
            // The screw axis passes r + ω × v/ω².
            let foot = pose.r + omega.cross(&twist.v) / omega.norm_squared().max(1e-24);
            let along = steering_direction(side, poses, axis_twists);
            let at_height = |z: f64| {
                if along.z.abs() < 1e-6 { foot } else { foot + along * ((z - foot.z) / along.z) }
            };
            [at_height(contact.z), at_height(pose.r.z)]
        }
    }
}

impl Suspension {
    /// Everything that follows from pose and velocity; the loads turned into B.
    pub(super) fn read_pose(&mut self, input: &SuspensionInput, out: &mut [SideOutput; 2]) {
        for (side, to) in self.sides.iter().zip(out.iter_mut()).enumerate().map(|(k, (s, t))| ((k, s), t)) {
            let (index, side) = side;
            let (pose, twist) = (&self.trial[side.knuckle], &self.twists[side.knuckle]);
            let a = pose.p.matrix();
            let outward = if index == 0 { 1.0 } else { -1.0 };
            let spin = a * side.spin_axis;
            let omega = a * twist.omega;
            let ball = a * side.tie_rod_outer;
            to.tie_rod_ball_m = pose.r + ball;
            to.tie_rod_ball_velocity_m_s = twist.v + omega.cross(&ball);
            to.wheel_centre_m = pose.r;
            to.knuckle_quaternion = pose.p.to_array_positive();
            to.knuckle_angular_velocity_rad_s = omega;
            to.steer_rad = (-spin.x).atan2(spin.y);
            to.toe_rad = -outward * to.steer_rad;
            to.camber_rad = (-outward * spin.z).clamp(-1.0, 1.0).asin();
            to.contact_patch_m = pose.r + a * side.contact_patch;
            let [lower, upper] = steering_points(side, &self.trial, &self.axis_twists, &to.contact_patch_m);
            let d = steering_direction(side, &self.trial, &self.axis_twists);
            to.lower_joint_m = lower;
            to.upper_joint_m = upper;
            to.caster_rad = (-d.x).atan2(d.z);
            to.kingpin_inclination_rad = (-outward * d.y).atan2(d.z);
            to.wheel_force_n = a * input.wheel_force_n[index];
            to.wheel_moment_n_m = a * input.wheel_moment_n_m[index];
            let arm = pose.r - lower;
            to.kingpin_moment_n_m = (arm.cross(&to.wheel_force_n) + to.wheel_moment_n_m).dot(&d);
            to.kingpin_friction_n_m = self.friction.map_or(0.0, |f| -f[index].moment_n_m());
            let [(i, s_i), (j, s_j)] = &side.spring_ends;
            to.spring_length_m = (self.force_poses[*j].point(s_j) - self.force_poses[*i].point(s_i)).norm();
        }
    }

    /// Loads of an elastic equilibrium, before it is solved: `share` of the way from the `last` loads
    /// to these, fixed in their bodies; kingpin friction about the axis as it last was.
    pub(super) fn prepare_loads(&mut self, last: &SuspensionInput, input: &SuspensionInput, share: f64) {
        let Solver::Elastic { wrenches, .. } = &mut self.solver else { return };
        let between = |from: &Vector3<f64>, to: &Vector3<f64>| from + (to - from) * share;
        for (index, side) in self.sides.iter().enumerate() {
            let a = self.trial[side.knuckle].p.matrix();
            let mut moment = between(&last.wheel_moment_n_m[index], &input.wheel_moment_n_m[index]);
            if let Some(friction) = &self.friction {
                let d = steering_direction(side, &self.trial, &self.axis_twists);
                moment -= a.tr_mul(&d) * friction[index].moment_n_m();
            }
            let force = between(&last.wheel_force_n[index], &input.wheel_force_n[index]);
            wrenches[side.knuckle] = Wrench { force_n: force, moment_n_m: moment };
            // As the bodies stand now, for analyses at a pose that is not solved again.
            let at = 6 * side.knuckle;
            self.load[at..at + 3].copy_from_slice((a * force).as_slice());
            self.load[at + 3..at + 6].copy_from_slice(moment.as_slice());
        }
    }

    /// Applied loads of the rigid force stage: wheels, kingpin friction, stabiliser spring.
    pub(super) fn fill_load(&mut self, input: &SuspensionInput, out: &mut [SideOutput; 2]) {
        let rigid = matches!(self.solver, Solver::Rigid { .. });
        if rigid {
            self.load.fill(0.0);
        }
        for (index, side) in self.sides.iter().enumerate().filter(|_| rigid) {
            let a = self.trial[side.knuckle].p.matrix();
            let mut moment = input.wheel_moment_n_m[index];
            if self.friction.is_some() {
                let d = steering_direction(side, &self.trial, &self.axis_twists);
                moment += a.tr_mul(&d) * out[index].kingpin_friction_n_m;
            }
            let at = 6 * side.knuckle;
            self.load[at..at + 3].copy_from_slice(out[index].wheel_force_n.as_slice());
            self.load[at + 3..at + 6].copy_from_slice(moment.as_slice());
        }
        if let Some(bar) = &self.bar {
            for side in 0..2 {
                let p = self.trial[bar.kinematic[side]].p;
                self.good.stabiliser_angle_rad[side] = 2.0 * bar.axis.dot(&p.e).atan2(p.e0);
            }
            let [left, right] = self.good.stabiliser_angle_rad;
            let torque = bar.stiffness * (left - right);
            self.good.stabiliser_torque_n_m = torque;
            for (side, sign) in [(0, -1.0), (1, 1.0)] {
                // The axis is the same in the bar's own frame: it turns about it. (An elastic equilibrium
                // has the spring among its own elements.)
                let at = 6 * bar.reaction[side] + 3;
                for k in 0..3 {
                    self.load[at + k] = if rigid { sign * torque * bar.axis[k] } else { 0.0 };
                }
            }
        }
    }

    /// Everything that follows from the multipliers; writes `good`.
    pub(super) fn read_forces(&mut self, out: &mut [SideOutput; 2]) {
        let mechanism = self.solver.force_mechanism();
        let rows = self.solver.force_rows();
        for (side, to) in self.sides.iter().zip(out.iter_mut()) {
            let axial = |constraint: usize| {
                let c = &mechanism.constraints()[constraint];
                let (i, j) = (&self.force_poses[c.i], &self.force_poses[c.j]);
                let length = (j.point(&c.point_on(false)) - i.point(&c.point_on(true))).norm();
                link_force(&c.kind, length, self.lambda[mechanism.first_row(constraint)])
            };
            to.tie_rod_force_n = axial(side.tie_rod);
            to.spring_force_n = axial(side.spring);
            to.drop_link_force_n = side.drop_link.map_or(0.0, axial);
            let sum = |constraints: &[usize]| {
                constraints.iter().fold(Vector3::zeros(), |sum, &c| {
                    let on_i = mechanism.constraints()[c].i == side.knuckle;
                    sum + mechanism.action(c, rows, &self.lambda, on_i).force_n
                })
            };
            to.upper_joint_force_n = sum(&side.upper);
            to.lower_joint_force_n = sum(&side.lower);
        }
        if let Solver::Elastic { equilibrium, .. } = &self.solver {
            for (bushing, (_, side, place)) in equilibrium.bushings().iter().zip(&self.bushings) {
                let moved = self.force_poses[bushing.body].point(&bushing.s) - bushing.anchor;
                out[*side].bushing_deflection_m[*place] = moved;
            }
        }
        // The drive holds the rack against both tie rods.
        let pull = |side: &Side| mechanism.action(side.tie_rod, rows, &self.lambda, true).force_n.y;
        self.good.rack_force_n = -(pull(&self.sides[0]) + pull(&self.sides[1]));
        self.good.side = *out;
    }
}
