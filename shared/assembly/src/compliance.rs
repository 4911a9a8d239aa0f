//! Compliance of an axle from its own bushings: the multibody solver with its elastic joints, at design, under the
//! static load, each wheel's height and the rack held; slopes of the wheel's steer, inclination and place against
//! forward force, lateral force and aligning moment at the contact patch (central differences) [Reimpell, The Automotive
//! Chassis, 3.6; Milliken & Milliken, ch. 23: compliances are measured so, springs locked].
//!
//! Signs as in [`config::car::Compliance`]: of the left wheel, ISO 8855; the right one is its mirror image. Valid while the
//! bushings are linear, as the solver's are. Not in it: steering gear, wheel bearing, subframe; a car gives those as
//! figures.

use config::axle::Axle;
use config::car::{Car, Compliance};
use multibody::{Status, Suspension, SuspensionInput, SuspensionOutput};
use nalgebra::{UnitQuaternion, Vector3};

/// Size of the loads that the slopes are taken over. [N], [N], [N m]
const LOADS: [f64; 3] = [500.0, 500.0, 50.0];

/// Compliance of a bushed axle with `load_n` on each wheel; `lag_s` is passed on.
///
/// # Errors
/// Sentences that say what is wrong with the axle; one that has no bushings has no compliance.
pub fn axle_compliance(axle: &Axle, load_n: f64, lag_s: f64) -> Result<Compliance, Vec<String>> {
    if axle.bushings.is_none() {
        return Err(vec!["needs bushings: the joints of this axle are rigid".to_owned()]);
    }
    let mut solver = Suspension::new(axle).map_err(|error| vec![error.to_string()])?;
    let mut output = SuspensionOutput::default();
    let spin_axis = Vector3::from(axle.spin_axis(0));
    let point = |side: usize, name: &str| Vector3::from(axle.geometry.point(side, name).unwrap_or_default());
    // Steer, inclination, x and y of the left wheel; the right one mirrored, so that a bar or a rack does not see it.
    let mut pose = |fx: f64, fy: f64, mz: f64| {
        let mut input = SuspensionInput::DESIGN;
        for (side, m) in [(0, 1.0), (1, -1.0)] {
            let force = Vector3::new(fx, m * fy, load_n);
            let to_patch = point(side, "contact_patch") - point(side, "wheel_centre");
            input.wheel_force_n[side] = force;
            input.wheel_moment_n_m[side] = to_patch.cross(&force) + Vector3::new(0.0, 0.0, m * mz);
        }
        solver.reset();
        solver.step(&input, &mut output);
        if output.status != Status::Converged {
            return Err(vec!["the bushed axle finds no equilibrium under its wheel loads".to_owned()]);
        }
        let left = &output.side[0];
        let [w, x, y, z] = left.knuckle_quaternion;
        let s = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z)) * spin_axis;
        let centre = left.wheel_centre_m;
        Ok([(-s.x).atan2(s.y), s.z.clamp(-1.0, 1.0).asin(), centre.x, centre.y])
    };
    let mut slope = [[0.0; 4]; 3];
    for (k, size) in LOADS.into_iter().enumerate() {
        let mut load = [0.0; 3];
        load[k] = size;
        let more = pose(load[0], load[1], load[2])?;
        let less = pose(-load[0], -load[1], -load[2])?;
        for (row, value) in slope[k].iter_mut().enumerate() {
            *value = (more[row] - less[row]) / (2.0 * size);
        }
    }
    let [fx, fy, mz] = slope;
    Ok(Compliance {
        lag_s,
        steer_per_fx_rad_n: fx[0],
        steer_per_fy_rad_n: fy[0],
        steer_per_mz_rad_n_m: mz[0],
        inclination_per_fx_rad_n: fx[1],
        inclination_per_fy_rad_n: fy[1],
        inclination_per_mz_rad_n_m: mz[1],
        x_per_fx_m_n: fx[2],
        y_per_fy_m_n: fy[3],
    })
}

/// The car with the compliance of its bushed axles added to its own figures, front and rear.
pub(crate) fn with_bushings(
    car: &Car,
    axles: [Option<&Axle>; 2],
) -> Result<Car, (&'static str, Vec<String>)> {
    let mut car = car.clone();
    let b = &car.body;
    let front = 1.0 - b.front_axle_to_sprung_cg_m / b.wheelbase_m;
    let weight = 0.5 * b.sprung_mass_kg * vehicle::GRAVITY_M_S2;
    let parts = [("front axle", &mut car.front, front), ("rear axle", &mut car.rear, 1.0 - front)];
    for ((part, own, share), axle) in parts.into_iter().zip(axles) {
        let Some(axle) = axle.filter(|axle| axle.bushings.is_some()) else { continue };
        let load_n = weight * share + own.unsprung_mass_kg * vehicle::GRAVITY_M_S2;
        let c = axle_compliance(axle, load_n, own.compliance.lag_s).map_err(|faults| (part, faults))?;
        let to = &mut own.compliance;
        to.steer_per_fx_rad_n += c.steer_per_fx_rad_n;
        to.steer_per_fy_rad_n += c.steer_per_fy_rad_n;
        to.steer_per_mz_rad_n_m += c.steer_per_mz_rad_n_m;
        to.inclination_per_fx_rad_n += c.inclination_per_fx_rad_n;
        to.inclination_per_fy_rad_n += c.inclination_per_fy_rad_n;
        to.inclination_per_mz_rad_n_m += c.inclination_per_mz_rad_n_m;
        to.x_per_fx_m_n += c.x_per_fx_m_n;
        to.y_per_fy_m_n += c.y_per_fy_m_n;
    }
    Ok(car)
}
