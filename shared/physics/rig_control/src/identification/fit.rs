//! Parameters from frequency responses: servo-hydraulic axis, series stiffness, moving mass, steer actuator.
//!
//! Axis (valve command to stroke), with s = jω:
//! ```text
//! G = K e^{−sτ} Z(s)/(s (1 + 2ζ s/ω_v + s²/ω_v²)),   Z = (1 − e^{−sT})/(sT): the hold over a tick
//! ```
//! Gauss-Newton on ln(G_measured/G), so that gain and phase count alike at all frequencies, weighted by the
//! inverse variance of the measurement. τ is transport and output phase together.
//! Hub: J s² Θ + T_cell = T_sent e^{−sτ} Z(s). Stiffness and mass: weighted means of real parts.

use super::FrequencyResponse;
use core::f64::consts::TAU;
use num_complex::Complex64;

/// A fitted axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AxisFit {
    /// Speed at full opening. [m/s]
    pub speed_m_s: f64,
    /// Delay from command to reading, without the hold's half tick. [s]
    pub delay_s: f64,
    /// Natural frequency of the valve. [Hz]
    pub valve_frequency_hz: f64,
    /// Its damping ratio. [-]
    pub valve_damping_ratio: f64,
    /// Root mean square of |ln(measured/fitted)|. [-]
    pub misfit: f64,
}

/// A fitted number with the spread of what it was made of.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SeriesFit {
    /// Value, in the unit of the response.
    pub value: f64,
    /// Standard deviation over the lines used.
    pub deviation: f64,
    /// Lines used.
    pub lines: usize,
}

/// A fitted steer actuator.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HubFit {
    /// Inertia on the motor's side of the torque cell. [kg·m²]
    pub inertia_kg_m2: f64,
    /// Delay and lag from torque command to reading, without the hold's half tick. [s]
    pub delay_s: f64,
    /// Root mean square of the relative residual. [-]
    pub misfit: f64,
}

/// Zero-order hold over `period_s`.
fn hold(s: Complex64, period_s: f64) -> Complex64 {
    (Complex64::ONE - (-s * period_s).exp()) / (s * period_s)
}

fn model(p: &[f64; 4], f_hz: f64, period_s: f64) -> Complex64 {
    let s = Complex64::new(0.0, TAU * f_hz);
    let w = TAU * p[2].exp();
    let valve = Complex64::ONE + s * (2.0 * p[3] / w) + s * s / (w * w);
    p[0].exp() * (-s * p[1]).exp() * hold(s, period_s) / (s * valve)
}

/// Fits an axis to the response from valve command to stroke. `sign` is that of the gain. `None` if there are
/// too few coherent lines.
pub fn fit_axis(measured: &FrequencyResponse, sign: f64, period_s: f64) -> Option<AxisFit> {
    let used: Vec<usize> = (0..measured.frequency_hz.len())
        .filter(|&i| measured.coherence[i] > 0.7 && measured.response[i].norm() > 0.0)
        .collect();
    if used.len() < 8 {
        return None;
    }
    let mut p = [(0.5_f64).ln(), 2e-3, (60.0_f64).ln(), 0.7];
    let weight = |i: usize| 1.0 / (measured.spread(i).powi(2) + 1e-4);
    let residual = |p: &[f64; 4], i: usize| {
        (sign * measured.response[i] / model(p, measured.frequency_hz[i], period_s)).ln()
    };
    let cost = |p: &[f64; 4]| used.iter().map(|&i| weight(i) * residual(p, i).norm_sqr()).sum::<f64>();
    let mut damping = 1e-3;
    let mut best = cost(&p);
    for _ in 0..60 {
        let (mut a, mut b) = ([[0.0; 4]; 4], [0.0; 4]);
        for &i in &used {
            let r = residual(&p, i);
            let mut slope = [Complex64::ZERO; 4];
            for k in 0..4 {
                let mut q = p;
                let h = [1e-6, 1e-8, 1e-6, 1e-6][k];
                q[k] += h;
                slope[k] = (residual(&q, i) - r) / h;
            }
            for k in 0..4 {
                b[k] -= weight(i) * (slope[k].conj() * r).re;
                for l in 0..4 {
                    a[k][l] += weight(i) * (slope[k].conj() * slope[l]).re;
                }
            }
        }
        for k in 0..4 {
            a[k][k] *= 1.0 + damping;
        }
        let step = solve(a, b)?;
        let mut q = p;
        for k in 0..4 {
            q[k] += step[k];
        }
        q[1] = q[1].clamp(0.0, 0.05);
        q[2] = q[2].clamp((5.0_f64).ln(), (500.0_f64).ln());
        q[3] = q[3].clamp(0.2, 3.0);
        let now = cost(&q);
        if now.is_finite() && now <= best {
            let settled = best - now < 1e-12 * best;
            (p, best) = (q, now);
            damping = (damping * 0.3_f64).max(1e-9);
            if settled {
                break;
            }
        } else {
            damping *= 10.0;
        }
    }
    let square = used.iter().map(|&i| residual(&p, i).norm_sqr()).sum::<f64>() / used.len() as f64;
    Some(AxisFit {
        speed_m_s: p[0].exp(),
        delay_s: p[1],
        valve_frequency_hz: p[2].exp(),
        valve_damping_ratio: p[3],
        misfit: square.sqrt(),
    })
}

/// Solves a 4 × 4 system by elimination with pivoting.
fn solve(mut a: [[f64; 4]; 4], mut b: [f64; 4]) -> Option<[f64; 4]> {
    for c in 0..4 {
        let pivot = (c..4).max_by(|&i, &j| a[i][c].abs().total_cmp(&a[j][c].abs()))?;
        a.swap(c, pivot);
        b.swap(c, pivot);
        if a[c][c].abs() < 1e-300 {
            return None;
        }
        for r in c + 1..4 {
            let f = a[r][c] / a[c][c];
            for k in c..4 {
                a[r][k] -= f * a[c][k];
            }
            b[r] -= f * b[c];
        }
    }
    let mut x = [0.0; 4];
    for r in (0..4).rev() {
        let rest: f64 = (r + 1..4).map(|k| a[r][k] * x[k]).sum();
        x[r] = (b[r] - rest) / a[r][r];
    }
    Some(x)
}

fn weighted(response: &FrequencyResponse, value: impl Fn(usize) -> f64) -> Option<SeriesFit> {
    let used: Vec<usize> = (0..response.frequency_hz.len())
        .filter(|&i| response.coherence[i] > 0.7 && value(i).is_finite())
        .collect();
    if used.len() < 3 {
        return None;
    }
    let weight = |i: usize| 1.0 / (response.spread(i).powi(2) + 1e-6);
    let sum: f64 = used.iter().map(|&i| weight(i)).sum();
    let mean = used.iter().map(|&i| weight(i) * value(i)).sum::<f64>() / sum;
    let square = used.iter().map(|&i| weight(i) * (value(i) - mean).powi(2)).sum::<f64>() / sum;
    Some(SeriesFit { value: mean, deviation: square.sqrt(), lines: used.len() })
}

/// Stiffness from the response of elongation to force. [N/m]
pub fn fit_stiffness(force_over_elongation: &FrequencyResponse) -> Option<SeriesFit> {
    weighted(force_over_elongation, |i| force_over_elongation.response[i].re)
}

/// Mass from the response of displacement to force: −F/(ω² x). [kg]
pub fn fit_mass(force_over_displacement: &FrequencyResponse) -> Option<SeriesFit> {
    weighted(force_over_displacement, |i| {
        let w = TAU * force_over_displacement.frequency_hz[i];
        -force_over_displacement.response[i].re / (w * w)
    })
}

/// Inertia and delay of the steer actuator from the responses of torque command to angle and to cell torque.
pub fn fit_hub(angle: &FrequencyResponse, cell: &FrequencyResponse, period_s: f64) -> Option<HubFit> {
    let used: Vec<usize> = (0..angle.frequency_hz.len())
        .filter(|&i| angle.coherence[i] > 0.7 && cell.coherence[i] > 0.7)
        .collect();
    if used.len() < 5 {
        return None;
    }
    // For a given delay the inertia is linear: search the delay.
    let at = |delay: f64| {
        let (mut top, mut bottom) = (0.0, 0.0);
        for &i in &used {
            let s = Complex64::new(0.0, TAU * angle.frequency_hz[i]);
            let x = s * s * angle.response[i];
            let y = (-s * delay).exp() * hold(s, period_s) - cell.response[i];
            top += (x.conj() * y).re;
            bottom += x.norm_sqr();
        }
        let inertia = top / bottom;
        let square: f64 = used
            .iter()
            .map(|&i| {
                let s = Complex64::new(0.0, TAU * angle.frequency_hz[i]);
                let y = (-s * delay).exp() * hold(s, period_s) - cell.response[i];
                (inertia * s * s * angle.response[i] - y).norm_sqr()
            })
            .sum();
        (inertia, (square / used.len() as f64).sqrt())
    };
    let mut best = (0.0, at(0.0));
    for step in [2e-4, 2e-5, 2e-6] {
        let centre: f64 = best.0;
        for k in -50..=100 {
            let delay = centre + f64::from(k) * step;
            if delay >= 0.0 && at(delay).1 < best.1.1 {
                best = (delay, at(delay));
            }
        }
    }
    Some(HubFit { inertia_kg_m2: best.1.0, delay_s: best.0, misfit: best.1.1 })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(of: impl Fn(f64) -> Complex64) -> FrequencyResponse {
        let frequency_hz: Vec<f64> = (1..=60).map(|i| 0.5 * f64::from(i)).collect();
        FrequencyResponse {
            response: frequency_hz.iter().map(|&f| of(f)).collect(),
            coherence: vec![0.999; 60],
            periods: 8,
            frequency_hz,
        }
    }

    #[test]
    fn an_axis_is_recovered_from_its_own_response() {
        let p = [(0.44_f64).ln(), 2.6e-3, (72.0_f64).ln(), 0.55];
        let fit = fit_axis(&made(|f| -model(&p, f, 1e-3)), -1.0, 1e-3).unwrap();
        assert!((fit.speed_m_s - 0.44).abs() < 1e-5 && (fit.delay_s - 2.6e-3).abs() < 1e-6, "{fit:?}");
        assert!(
            (fit.valve_frequency_hz - 72.0).abs() < 0.05 && (fit.valve_damping_ratio - 0.55).abs() < 1e-3
        );
        assert!(fit.misfit < 1e-4);
    }

    #[test]
    fn stiffness_mass_and_hub_are_recovered() {
        let stiffness = fit_stiffness(&made(|f| Complex64::new(2.8e5, 2.8e5 * 6e-4 * TAU * f))).unwrap();
        assert!((stiffness.value - 2.8e5).abs() < 1.0 && stiffness.lines == 60);
        let mass = fit_mass(&made(|f| Complex64::new(-25.0 * (TAU * f).powi(2), 0.0))).unwrap();
        assert!((mass.value - 25.0).abs() < 1e-9);
        // Hub against a spring of 30 N·m/rad behind the cell.
        let (j, k, delay) = (0.035, 30.0, 3.6e-3);
        let angle = |f: f64| {
            let s = Complex64::new(0.0, TAU * f);
            (-s * delay).exp() * hold(s, 1e-3) / (s * s * j + s * 0.4 + k)
        };
        let cell = |f: f64| angle(f) * (Complex64::new(0.0, TAU * f) * 0.4 + k);
        let hub = fit_hub(&made(angle), &made(cell), 1e-3).unwrap();
        assert!((hub.inertia_kg_m2 - j).abs() < 1e-5 && (hub.delay_s - delay).abs() < 1e-5, "{hub:?}");
    }
}
