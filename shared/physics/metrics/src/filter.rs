//! Butterworth low pass of second order, and the same run forwards and backwards for zero phase.
//!
//! Bilinear transform with the corner pre-warped [Oppenheim, Schafer: Discrete-Time Signal Processing,
//! 7.1.2]. Forwards and backwards the phase cancels and the gain is squared: −6 dB at the corner, 1 at 0 Hz,
//! exactly 1/(1 + (tan(π f T)/tan(π f_c T))⁴). The ends are extended by point reflection and the filter
//! starts in the steady state of its first value [Gustafsson 1996], so that a constant or a ramp passes
//! unchanged at both ends.

use std::f64::consts::{PI, SQRT_2};

/// Corner of the filter that force commands and measurements pass before they are compared (spec 4.4). \[Hz\]
pub const TRACKING_CORNER_HZ: f64 = 50.0;

/// Second-order section, direct form II transposed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowPass {
    b: [f64; 3],
    a: [f64; 2],
}

impl LowPass {
    /// A Butterworth low pass. None unless 0 < corner < half the sampling rate.
    pub fn butterworth(corner_hz: f64, sample_time_s: f64) -> Option<LowPass> {
        let ratio = corner_hz * sample_time_s;
        if !(ratio > 0.0 && ratio < 0.5) {
            return None;
        }
        let k = (PI * ratio).tan();
        let norm = 1.0 / (1.0 + SQRT_2 * k + k * k);
        let b = k * k * norm;
        Some(LowPass {
            b: [b, 2.0 * b, b],
            a: [2.0 * (k * k - 1.0) * norm, (1.0 - SQRT_2 * k + k * k) * norm],
        })
    }

    /// Filters in place, starting in the steady state of the first value.
    fn run<'a>(&self, values: impl Iterator<Item = &'a mut f64>) {
        let [b0, b1, b2] = self.b;
        let [a1, a2] = self.a;
        let mut state: Option<[f64; 2]> = None;
        for value in values {
            let x = *value;
            let [s1, s2] = state.unwrap_or([(1.0 - b0) * x, (b2 - a2) * x]);
            let y = b0 * x + s1;
            state = Some([b1 * x - a1 * y + s2, b2 * x - a2 * y]);
            *value = y;
        }
    }

    /// Filters forwards and backwards: no phase shift. Values that are not finite are bridged by straight
    /// lines first and absent again in the result.
    pub fn zero_phase(&self, values: &[f64]) -> Vec<f64> {
        let Some(bridged) = crate::resample::bridge_gaps(values) else { return values.to_vec() };
        let n = bridged.len();
        // Long enough for the transient: the poles' time constant in samples is about 1/(π f_c T).
        let decay = 1.0 - self.a[1].abs().sqrt();
        let pad = ((20.0 / decay.max(1e-6)) as usize).min(n - 1);
        let mut extended = Vec::with_capacity(n + 2 * pad);
        extended.extend((1..=pad).rev().map(|i| 2.0 * bridged[0] - bridged[i]));
        extended.extend_from_slice(&bridged);
        extended.extend((1..=pad).map(|i| 2.0 * bridged[n - 1] - bridged[n - 1 - i]));
        self.run(extended.iter_mut());
        self.run(extended.iter_mut().rev());
        let filtered = &extended[pad..pad + n];
        filtered.iter().zip(values).map(|(&y, x)| if x.is_finite() { y } else { f64::NAN }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const T: f64 = 1e-3;

    fn filtered_sine(frequency_hz: f64) -> Vec<(f64, f64)> {
        let sine: Vec<f64> = (0..4000).map(|i| (2.0 * PI * frequency_hz * i as f64 * T).sin()).collect();
        let out = LowPass::butterworth(50.0, T).unwrap().zero_phase(&sine);
        sine.into_iter().zip(out).skip(1000).take(2000).collect()
    }

    #[test]
    fn gain_is_the_squared_butterworth_gain_and_phase_is_zero() {
        for frequency_hz in [0.5, 5.0, 25.0, 50.0, 80.0, 120.0] {
            let warped = (PI * frequency_hz * T).tan() / (PI * 50.0 * T).tan();
            let gain = 1.0 / (1.0 + warped.powi(4));
            for (x, y) in filtered_sine(frequency_hz) {
                assert!((y - gain * x).abs() < 1e-9, "{frequency_hz} Hz: {x} -> {y}, gain {gain}");
            }
        }
    }

    #[test]
    fn constants_and_ramps_pass_unchanged_to_both_ends() {
        let ramp: Vec<f64> = (0..500).map(|i| 4.0 - 0.01 * i as f64).collect();
        let out = LowPass::butterworth(50.0, T).unwrap().zero_phase(&ramp);
        for (x, y) in ramp.iter().zip(&out) {
            assert!((x - y).abs() < 1e-9, "{x} {y}");
        }
    }

    #[test]
    fn absent_values_stay_absent_and_do_not_spread() {
        let mut values = vec![2.0; 300];
        values[100..110].fill(f64::NAN);
        let out = LowPass::butterworth(50.0, T).unwrap().zero_phase(&values);
        assert!(out[100..110].iter().all(|v| v.is_nan()));
        assert!(out[..100].iter().chain(&out[110..]).all(|v| (v - 2.0).abs() < 1e-12));
        assert!(LowPass::butterworth(50.0, T).unwrap().zero_phase(&[f64::NAN])[0].is_nan());
        assert!((LowPass::butterworth(50.0, T).unwrap().zero_phase(&[3.0])[0] - 3.0).abs() < 1e-12);
    }

    #[test]
    fn impossible_corners_are_refused() {
        for (corner, time) in [(500.0, T), (0.0, T), (-1.0, T), (f64::NAN, T), (50.0, 0.0)] {
            assert_eq!(LowPass::butterworth(corner, time), None);
        }
    }
}
