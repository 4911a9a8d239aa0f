//! Equations of motion of body and four wheel stations, 10 freedoms, by Kane's method.
//!
//! Generalised speeds: velocity of the sprung centre of gravity and angular velocity (6, body axes), wheel
//! travel rates ż (4). Bodies: sprung mass, four wheel stations as point masses at the wheel centres with the
//! wheels' diametral inertia and spin momentum. Spins are absolute and their equations stand apart
//! (`driveline`), so the spin axis carries no inertia here but the gyroscopic moment −Ω × (I_s ω_s s).
//!   M u̇ = Q,  M = [M_b, c; cᵀ, m_z] with diagonal m_z: eliminate z̈, solve 6×6 by Cholesky.
//! Kinematics enter through partial velocities: jacking, roll centre, anti-dive follow by virtual work.
//! Dampers implicit: m_z + h d. Valid for any attitude of the body.
//! [Kane & Levinson, Dynamics: Theory and Applications, ch. 4–6.]

use crate::station::Station;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Masses of the car.
#[derive(Debug, Clone, PartialEq)]
pub struct Masses {
    /// Sprung mass. [kg]
    pub sprung_kg: f64,
    /// Inertia of the sprung mass about its centre of gravity. [kg m²]
    pub inertia_kg_m2: Matrix3<f64>,
    /// Mass of each wheel station. [kg]
    pub unsprung_kg: [f64; 4],
    /// Mass of each wheel. [kg]
    pub wheel_kg: [f64; 4],
    /// Spin inertia of each wheel. [kg m²]
    pub spin_kg_m2: [f64; 4],
    /// Diametral inertia of each wheel. [kg m²]
    pub diametral_kg_m2: [f64; 4],
    /// Added to the first moment of mass that couples yaw and lateral motion, for models that leave it out. [kg m]
    pub yaw_lateral_kg_m: f64,
}

/// What acts on one wheel station.
#[derive(Debug, Clone, Copy)]
pub struct StationLoad {
    /// Road on tyre. [N]
    pub force: Vector3<f64>,
    /// Moment at the wheel centre on the knuckle: tyre without its part about the spin axis, brake reaction.
    /// [N·m]
    pub moment: Vector3<f64>,
    /// Spin speed. [rad/s]
    pub spin: f64,
    /// Suspension force along the travel, pushing the wheel down. [N]
    pub suspension: f64,
    /// Damper slope for the implicit part. [N·s/m]
    pub damping: f64,
}

/// Accelerations.
#[derive(Debug, Clone, Copy)]
pub struct Accelerations {
    /// Of the sprung centre of gravity against inertial space, body axes. [m/s²]
    pub body: Vector3<f64>,
    /// Angular. [rad/s²]
    pub angular: Vector3<f64>,
    /// Of the travels. [m/s²]
    pub travel: [f64; 4],
}

/// What a wheel hands its knuckle, and what reaches the rack, body axes.
#[derive(Debug, Clone, Copy)]
pub struct Handed {
    /// Force at the wheel centre. [N]
    pub force: Vector3<f64>,
    /// Moment at the wheel centre. [N·m]
    pub moment: Vector3<f64>,
    /// Acceleration of the wheel centre. [m/s²]
    pub acceleration: Vector3<f64>,
    /// Generalised force of the whole station on the rack. [N]
    pub on_rack: f64,
}

/// Solves M u̇ = Q. `force` and `moment` act on the body beside gravity and the stations (aerodynamics,
/// drive-shaft reactions), about the sprung centre of gravity. `step_s` is the sub-step, zero for the plain
/// equations.
#[must_use]
pub fn accelerations(
    m: &Masses,
    stations: &[Station; 4],
    loads: &[StationLoad; 4],
    w: &Vector3<f64>,
    gravity: &Vector3<f64>,
    force: &Vector3<f64>,
    moment: &Vector3<f64>,
    step_s: f64,
) -> Accelerations {
    let mut total = m.sprung_kg;
    let mut first = Vector3::zeros();
    let mut second = m.inertia_kg_m2;
    let mut qf = force + gravity * m.sprung_kg;
    let mut qm = moment - w.cross(&(m.inertia_kg_m2 * w));
    // Columns of coupling to each travel, its mass and generalised force.
    let mut coupling = [(Vector3::zeros(), Vector3::zeros()); 4];
    let mut travel = [(0.0, 0.0); 4];
    for i in 0..4 {
        let (st, load) = (&stations[i], &loads[i]);
        let (mass, jd) = (m.unsprung_kg[i], m.diametral_kg_m2[i]);
        let gyroscopic = st.w.cross(&(st.s * (m.spin_kg_m2[i] * load.spin)));
        let active = load.force + (gravity - st.bias) * mass;
        let turning = load.moment - gyroscopic;
        qf += active;
        qm += st.r.cross(&active) + turning;
        total += mass;
        first += st.r * mass;
        let rr = st.r * st.r.transpose();
        second += (Matrix3::identity() * st.r.norm_squared() - rr) * mass
            + (Matrix3::identity() - st.s * st.s.transpose()) * jd;
        let across = (st.a - st.s * st.s.dot(&st.a)) * jd;
        coupling[i] = (st.t * mass, st.r.cross(&st.t) * mass + across);
        travel[i] = (
            mass * st.t.norm_squared() + st.a.dot(&across) + step_s * load.damping,
            st.t.dot(&active) + st.a.dot(&turning) - load.suspension,
        );
    }
    let mut matrix = SMatrix::<f64, 6, 6>::zeros();
    let tilde = first.cross_matrix();
    for i in 0..3 {
        matrix[(i, i)] = total;
        for j in 0..3 {
            matrix[(3 + i, 3 + j)] = second[(i, j)];
            matrix[(3 + i, j)] = tilde[(i, j)];
            matrix[(i, 3 + j)] = -tilde[(i, j)];
        }
    }
    matrix[(5, 1)] += m.yaw_lateral_kg_m;
    matrix[(1, 5)] += m.yaw_lateral_kg_m;
    let mut right = SVector::<f64, 6>::from_column_slice(&[qf.x, qf.y, qf.z, qm.x, qm.y, qm.z]);
    let mut columns = [SVector::<f64, 6>::zeros(); 4];
    for i in 0..4 {
        let (f, g) = &coupling[i];
        let c = SVector::<f64, 6>::from_column_slice(&[f.x, f.y, f.z, g.x, g.y, g.z]);
        let inverse = 1.0 / travel[i].0;
        for col in 0..6 {
            let scaled = c[col] * inverse;
            for row in col..6 {
                matrix[(row, col)] -= c[row] * scaled;
            }
        }
        right -= c * (travel[i].1 * inverse);
        columns[i] = c;
    }
    cholesky_solve(&mut matrix, &mut right);
    let mut out = Accelerations {
        body: Vector3::new(right[0], right[1], right[2]),
        angular: Vector3::new(right[3], right[4], right[5]),
        travel: [0.0; 4],
    };
    for i in 0..4 {
        out.travel[i] = (travel[i].1 - columns[i].dot(&right)) / travel[i].0;
    }
    out
}

/// In place on the lower triangle; the mass matrix is positive definite by construction.
fn cholesky_solve(a: &mut SMatrix<f64, 6, 6>, b: &mut SVector<f64, 6>) {
    for j in 0..6 {
        let mut d = a[(j, j)];
        for k in 0..j {
            d -= a[(j, k)] * a[(j, k)];
        }
        let inverse = 1.0 / d.sqrt();
        a[(j, j)] = inverse;
        for i in j + 1..6 {
            let mut v = a[(i, j)];
            for k in 0..j {
                v -= a[(i, k)] * a[(j, k)];
            }
            a[(i, j)] = v * inverse;
        }
    }
    for i in 0..6 {
        let mut v = b[i];
        for k in 0..i {
            v -= a[(i, k)] * b[k];
        }
        b[i] = v * a[(i, i)];
    }
    for i in (0..6).rev() {
        let mut v = b[i];
        for k in i + 1..6 {
            v -= a[(k, i)] * b[k];
        }
        b[i] = v * a[(i, i)];
    }
}

/// What wheel `i` hands its knuckle, with the accelerations found.
#[must_use]
pub fn handed(
    m: &Masses,
    i: usize,
    st: &Station,
    load: &StationLoad,
    acc: &Accelerations,
    gravity: &Vector3<f64>,
) -> Handed {
    let acceleration = acc.body + acc.angular.cross(&st.r) + st.t * acc.travel[i] + st.bias;
    let turning = acc.angular + st.a * acc.travel[i];
    let gyroscopic = st.w.cross(&(st.s * (m.spin_kg_m2[i] * load.spin)));
    let inertia = (turning - st.s * st.s.dot(&turning)) * m.diametral_kg_m2[i];
    let inertial = gravity - acceleration;
    let moment = load.moment - gyroscopic - inertia;
    Handed {
        force: load.force + inertial * m.wheel_kg[i],
        moment,
        acceleration,
        on_rack: st.p.dot(&(load.force + inertial * m.unsprung_kg[i])) + st.b.dot(&moment),
    }
}
