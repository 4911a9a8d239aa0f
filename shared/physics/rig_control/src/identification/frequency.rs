//! Frequency response between two signals of a periodic test, with coherence and spread.
//!
//! For each of M whole periods the Fourier coefficients U_m, Y_m at a line; G = Ȳ/Ū, coherence
//! γ² = |Σ Y_m U_m*|²/(Σ|U_m|² Σ|Y_m|²). What does not repeat from period to period (noise, friction that
//! depends on history) lowers γ². The relative standard deviation of G is √((1 − γ²)/(2 M γ²))
//! [Bendat, Piersol 2010, Random Data, eq. 9.90].

use super::Periodic;
use core::f64::consts::TAU;
use num_complex::Complex64;

/// A measured frequency response.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrequencyResponse {
    /// Frequencies. [Hz]
    pub frequency_hz: Vec<f64>,
    /// Response at each.
    pub response: Vec<Complex64>,
    /// Coherence at each. [-], 0 to 1
    pub coherence: Vec<f64>,
    /// Periods averaged.
    pub periods: usize,
}

impl FrequencyResponse {
    /// Relative standard deviation of the response at index `i`. [-]
    pub fn spread(&self, i: usize) -> f64 {
        let c = self.coherence[i].clamp(1e-12, 1.0);
        ((1.0 - c) / (2.0 * self.periods.max(1) as f64 * c)).sqrt()
    }

    /// Magnitudes.
    pub fn magnitude(&self) -> Vec<f64> {
        self.response.iter().map(|g| g.norm()).collect()
    }

    /// Phases without jumps. [deg]
    pub fn phase_deg(&self) -> Vec<f64> {
        let mut last = 0.0;
        self.response
            .iter()
            .map(|g| {
                let raw = g.arg().to_degrees();
                last = raw - 360.0 * ((raw - last) / 360.0).round();
                last
            })
            .collect()
    }

    /// A part of it, by frequency. [Hz]
    pub fn within(&self, low_hz: f64, high_hz: f64) -> Self {
        let keep: Vec<usize> = (0..self.frequency_hz.len())
            .filter(|&i| (low_hz..=high_hz).contains(&self.frequency_hz[i]))
            .collect();
        Self {
            frequency_hz: keep.iter().map(|&i| self.frequency_hz[i]).collect(),
            response: keep.iter().map(|&i| self.response[i]).collect(),
            coherence: keep.iter().map(|&i| self.coherence[i]).collect(),
            periods: self.periods,
        }
    }
}

/// Fourier coefficient of `signal` at `line` over a whole period.
fn coefficient(signal: &[f64], line: usize) -> Complex64 {
    let n = signal.len();
    // One rotation a sample; its rounding is far below any sensor's.
    let turn = Complex64::from_polar(1.0, -TAU * line as f64 / n as f64);
    let (mut sum, mut at) = (Complex64::ZERO, Complex64::ONE);
    for value in signal {
        sum += at * value;
        at *= turn;
    }
    sum * (2.0 / n as f64)
}

/// Response from `input` to `output`, both sampled with the test; the first `skip` periods are left out, because
/// they hold the transient. `None` when less than two whole periods are left.
pub fn response(test: &Periodic, skip: usize, input: &[f64], output: &[f64]) -> Option<FrequencyResponse> {
    let n = test.values.len();
    let all = input.len().min(output.len()) / n;
    if all < skip + 2 {
        return None;
    }
    let mut result = FrequencyResponse { periods: all - skip, ..FrequencyResponse::default() };
    for &line in &test.lines {
        let (mut u, mut y, mut cross) = (Complex64::ZERO, Complex64::ZERO, Complex64::ZERO);
        let (mut uu, mut yy) = (0.0, 0.0);
        for m in skip..all {
            let part = m * n..(m + 1) * n;
            let (um, ym) = (coefficient(&input[part.clone()], line), coefficient(&output[part], line));
            u += um;
            y += ym;
            cross += ym * um.conj();
            uu += um.norm_sqr();
            yy += ym.norm_sqr();
        }
        result.frequency_hz.push(test.frequency_hz(line));
        result.response.push(if u.norm_sqr() > 0.0 { y / u } else { Complex64::new(f64::NAN, 0.0) });
        result.coherence.push(if uu > 0.0 && yy > 0.0 { cross.norm_sqr() / (uu * yy) } else { 0.0 });
    }
    Some(result)
}

#[cfg(test)]
mod tests {
    use super::super::Excitation;
    use super::*;

    #[test]
    fn a_first_order_lag_with_delay_is_found_and_noise_lowers_the_coherence() {
        let kinds = [
            Excitation::Multisine { offset: 0, stride: 1, corner_hz: 5.0 },
            Excitation::Chirp,
            Excitation::BinarySequence { bits: 8 },
        ];
        for kind in kinds {
            let test = Periodic::new(kind, 4.0, 0.5, 40.0, 1e-3);
            let pole = (-1e-3_f64 / 0.01).exp();
            let run = |noise: f64| {
                let (mut state, mut seed) = (0.0, 1_u64);
                let mut u = Vec::new();
                let mut y = vec![0.0; 7];
                for i in 0..20_000 {
                    u.push(test.at(i));
                    state = pole * state + (1.0 - pole) * test.at(i);
                    seed =
                        seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    y.push(state + noise * ((seed >> 40) as f64 / 8_388_608.0 - 1.0));
                }
                y.truncate(20_000);
                response(&test, 1, &u, &y).unwrap()
            };
            let clean = run(0.0);
            for (i, f) in clean.frequency_hz.iter().enumerate() {
                let z = Complex64::from_polar(1.0, TAU * f * 1e-3);
                let expected = (1.0 - pole) / (1.0 - pole / z) * z.powi(-7);
                assert!((clean.response[i] - expected).norm() < 1e-6, "{kind:?} {f}");
                assert!(clean.coherence[i] > 1.0 - 1e-9);
            }
            let noisy = run(0.3);
            let mean = |r: &FrequencyResponse| r.coherence.iter().sum::<f64>() / r.coherence.len() as f64;
            assert!(mean(&noisy) < 0.999 && mean(&noisy) > 0.5, "{kind:?} {}", mean(&noisy));
        }
    }
}
