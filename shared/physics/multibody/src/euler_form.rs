//! The same analyses in seven coordinates per body, [r; p], with the normalisation pᵀp = 1 as a row per
//! body [Haug 1989, ch. 9.6 and 11.3]. For checking the six-coordinate form and for teaching; dense, and it
//! allocates.
//!
//! Φ_p = 2 Φ_π G, as δπ' = 2 G δp. Loads: Q_p = 2 Gᵀ n'. Dynamics: 4GᵀJ'G p̈ + Φ_pᵀλ + 2pσ = 2Gᵀn' +
//! 8ĠᵀJ'Ġp, with Φ_p p̈ = γ unchanged since Ġṗ = 0, and pᵀp̈ = −ṗᵀṗ.

use nalgebra::{DMatrix, DVector, Matrix4, Matrix4x3};
use spatial::{EulerParameters, Vector3};

use crate::body::{Pose, Twist};
use crate::constraint::{Drive, Row};
use crate::failure::{Failure, Reason, Solved};
use crate::mechanism::Mechanism;

/// Jacobian of constraints and normalisation rows in [r; p] per body, and all values Φ.
fn system(mechanism: &Mechanism, poses: &[Pose], drives: &[Drive]) -> (DMatrix<f64>, DVector<f64>) {
    let (bodies, rows) = (poses.len(), mechanism.rows());
    let mut evaluated = vec![Row::ZERO; rows];
    mechanism.evaluate(poses, drives, &mut evaluated);
    let mut jacobian = DMatrix::zeros(rows + bodies, 7 * bodies);
    let mut phi = DVector::zeros(rows + bodies);
    for (r, row) in evaluated.iter().enumerate() {
        phi[r] = row.phi;
        let c = &mechanism.constraints()[mechanism.constraint_of_row(r)];
        for (body, jac) in [(c.i, &row.jac[..6]), (c.j, &row.jac[6..])] {
            let pi = Vector3::new(jac[3], jac[4], jac[5]);
            let p = 2.0 * poses[body].p.g_matrix().transpose() * pi;
            for k in 0..3 {
                jacobian[(r, 7 * body + k)] += jac[k];
            }
            for k in 0..4 {
                jacobian[(r, 7 * body + 3 + k)] += p[k];
            }
        }
    }
    for (body, pose) in poses.iter().enumerate() {
        phi[rows + body] = pose.p.norm_squared() - 1.0;
        for (k, x) in pose.p.to_array().into_iter().enumerate() {
            jacobian[(rows + body, 7 * body + 3 + k)] = 2.0 * x;
        }
    }
    (jacobian, phi)
}

fn failure(reason: Reason, iterations: u32, residual: f64) -> Failure {
    Failure { reason, constraint: None, iterations, residual }
}

/// Position analysis: p moves freely and comes back to unit length by its normalisation row.
///
/// # Errors
/// Singular or not converged.
pub fn position(mechanism: &Mechanism, poses: &mut [Pose], drives: &[Drive]) -> Result<Solved, Failure> {
    for iterations in 0..20 {
        let (jacobian, phi) = system(mechanism, poses, drives);
        let residual = phi.amax();
        if residual < 1e-14 {
            return Ok(Solved { iterations, residual });
        }
        let step =
            jacobian.lu().solve(&-phi).ok_or_else(|| failure(Reason::Singular, iterations, residual))?;
        for (pose, x) in poses.iter_mut().zip(step.as_slice().chunks_exact(7)) {
            pose.r += Vector3::new(x[0], x[1], x[2]);
            pose.p.e0 += x[3];
            pose.p.e += Vector3::new(x[4], x[5], x[6]);
        }
        if step.amax() < 1e-13 {
            return Ok(Solved { iterations: iterations + 1, residual });
        }
    }
    Err(failure(Reason::OutOfReach, 20, f64::MAX))
}

/// Quasi-static reactions for the load [force global, moment body frame] per body: λ per constraint row.
///
/// # Errors
/// Singular.
pub fn reactions(
    mechanism: &Mechanism,
    poses: &[Pose],
    drives: &[Drive],
    load: &[f64],
) -> Result<Vec<f64>, Failure> {
    let (jacobian, _) = system(mechanism, poses, drives);
    let q = generalised_load(poses, load);
    let lambda = jacobian.transpose().lu().solve(&q).ok_or_else(|| failure(Reason::Singular, 0, 0.0))?;
    Ok(lambda.as_slice()[..mechanism.rows()].to_vec())
}

fn generalised_load(poses: &[Pose], load: &[f64]) -> DVector<f64> {
    let mut q = DVector::zeros(7 * poses.len());
    for (body, pose) in poses.iter().enumerate() {
        let x = &load[6 * body..6 * body + 6];
        let p: nalgebra::Vector4<f64> = 2.0 * pose.p.g_matrix().transpose() * Vector3::new(x[3], x[4], x[5]);
        for k in 0..3 {
            q[7 * body + k] = x[k];
        }
        for k in 0..4 {
            q[7 * body + 3 + k] = p[k];
        }
    }
    q
}

/// Forward dynamics: accelerations [v̇, ω̇'] and λ for the load; every body needs mass and inertia.
///
/// # Errors
/// Singular.
pub fn accelerations(
    mechanism: &Mechanism,
    poses: &[Pose],
    twists: &[Twist],
    drives: &[Drive],
    load: &[f64],
) -> Result<(Vec<Twist>, Vec<f64>), Failure> {
    let (bodies, rows) = (poses.len(), mechanism.rows());
    let (jacobian, _) = system(mechanism, poses, drives);
    let (n, m) = (7 * bodies, rows + bodies);
    let mut matrix = DMatrix::zeros(n + m, n + m);
    let mut right = DVector::zeros(n + m);
    right.rows_mut(0, n).copy_from(&generalised_load(poses, load));
    matrix.view_mut((n, 0), (m, n)).copy_from(&jacobian);
    matrix.view_mut((0, n), (n, m)).copy_from(&jacobian.transpose());
    let mut gamma = vec![0.0; rows];
    mechanism.acceleration_right_side(poses, twists, drives, &mut gamma);
    right.rows_mut(n, rows).copy_from_slice(&gamma);
    for (b, body) in mechanism.bodies().iter().enumerate() {
        let (p, rate): (EulerParameters, EulerParameters) = (poses[b].p, poses[b].p.rate(&twists[b].omega));
        let (g, g_rate) = (p.g_matrix(), rate.g_matrix());
        let inertia: Matrix4<f64> = 4.0 * g.transpose() * body.inertia_kg_m2 * g;
        let turned: Matrix4x3<f64> = g_rate.transpose() * body.inertia_kg_m2;
        let quadratic = 8.0 * turned * (g_rate * p.to_vector());
        for k in 0..3 {
            matrix[(7 * b + k, 7 * b + k)] = body.mass_kg;
        }
        for r in 0..4 {
            right[7 * b + 3 + r] += quadratic[r];
            for c in 0..4 {
                matrix[(7 * b + 3 + r, 7 * b + 3 + c)] = inertia[(r, c)];
            }
        }
        right[n + rows + b] = -2.0 * rate.norm_squared();
    }
    let x = matrix.lu().solve(&right).ok_or_else(|| failure(Reason::Singular, 0, 0.0))?;
    let accelerations = (0..bodies)
        .map(|b| {
            let x = &x.as_slice()[7 * b..7 * b + 7];
            let second = EulerParameters::from_array([x[3], x[4], x[5], x[6]]);
            // ω̇' = 2 G p̈.
            Twist { v: Vector3::new(x[0], x[1], x[2]), omega: poses[b].p.angular_velocity(second) }
        })
        .collect();
    Ok((accelerations, x.as_slice()[n..n + rows].to_vec()))
}
