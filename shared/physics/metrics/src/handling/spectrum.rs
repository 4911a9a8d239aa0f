//! Frequency response by Welch's method at chosen frequencies.
//!
//! H1 = S_xy / S_xx, coherence |S_xy|²/(S_xx S_yy), over half-overlapping Hann-windowed segments with their
//! means removed [Welch 1967; Bendat, Piersol: Random Data, 4th ed., 6 and 9]. The sums are formed directly at
//! the segment's own frequencies within the band: a steering band has few of them.

use std::f64::consts::TAU;

/// Response at a frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrequencyResponse {
    /// Frequency. \[Hz\]
    pub frequency_hz: f64,
    /// Output over input. [unit of output / unit of input]
    pub gain: f64,
    /// Phase of the output relative to the input, negative when it lags. \[rad\]
    pub phase_rad: f64,
    /// Coherence, 0 to 1.
    pub coherence: f64,
    /// Power of the input at the frequency over that at the strongest frequency of the band. \[1\]
    pub input_power_ratio: f64,
}

/// The response of `output` to `input`, sampled together, between two frequencies; segments of `segment_s`.
///
/// Empty if there are fewer than three segments, or a value is not finite.
pub fn frequency_response(
    input: &[f64],
    output: &[f64],
    sample_time_s: f64,
    segment_s: f64,
    band_hz: std::ops::RangeInclusive<f64>,
) -> Vec<FrequencyResponse> {
    let n = input.len().min(output.len());
    let length = (segment_s / sample_time_s).round() as usize;
    let hop = length / 2;
    if length < 16 || n < length + 2 * hop || input[..n].iter().chain(&output[..n]).any(|v| !v.is_finite()) {
        return Vec::new();
    }
    let segments: Vec<usize> = (0..=n - length).step_by(hop).collect();
    let resolution = 1.0 / (length as f64 * sample_time_s);
    let first = (band_hz.start() / resolution).ceil().max(1.0) as usize;
    let last = ((band_hz.end() / resolution).floor() as usize).min(length / 2);
    let window: Vec<f64> = (0..length).map(|i| 0.5 - 0.5 * (TAU * i as f64 / length as f64).cos()).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / length as f64;
    let mut found: Vec<FrequencyResponse> = Vec::new();
    let mut powers = Vec::new();
    for bin in first..=last {
        let (turn_s, turn_c) = (TAU * bin as f64 / length as f64).sin_cos();
        let (mut xx, mut yy, mut xy_re, mut xy_im) = (0.0, 0.0, 0.0, 0.0);
        for &start in &segments {
            let (x, y) = (&input[start..start + length], &output[start..start + length]);
            let (mean_x, mean_y) = (mean(x), mean(y));
            let (mut s, mut c) = (0.0_f64, 1.0_f64);
            let (mut xr, mut xi, mut yr, mut yi) = (0.0, 0.0, 0.0, 0.0);
            for i in 0..length {
                let (a, b) = (window[i] * (x[i] - mean_x), window[i] * (y[i] - mean_y));
                xr += a * c;
                xi -= a * s;
                yr += b * c;
                yi -= b * s;
                (s, c) = (s * turn_c + c * turn_s, c * turn_c - s * turn_s);
            }
            xx += xr * xr + xi * xi;
            yy += yr * yr + yi * yi;
            xy_re += xr * yr + xi * yi;
            xy_im += xr * yi - xi * yr;
        }
        powers.push(xx);
        found.push(FrequencyResponse {
            frequency_hz: bin as f64 * resolution,
            gain: xy_re.hypot(xy_im) / xx,
            phase_rad: xy_im.atan2(xy_re),
            coherence: (xy_re * xy_re + xy_im * xy_im) / (xx * yy),
            input_power_ratio: 0.0,
        });
    }
    let strongest = powers.iter().copied().fold(0.0, f64::max);
    for (response, power) in found.iter_mut().zip(powers) {
        response.input_power_ratio = power / strongest;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reproducible noise in ±1.
    fn noise(n: usize) -> Vec<f64> {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        (0..n)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
            })
            .collect()
    }

    #[test]
    fn a_first_order_lag_has_its_gain_and_phase() {
        let (t, tau) = (5e-3_f64, 0.15);
        let input = noise(40_000);
        // Exact response of the lag to a held input, so the phase has half a sample of hold in it.
        let decay = (-t / tau).exp();
        let mut y = 0.0;
        let output: Vec<f64> = input
            .iter()
            .map(|u| {
                let now = y;
                y = decay * y + (1.0 - decay) * 3.0 * u;
                now
            })
            .collect();
        let response = frequency_response(&input, &output, t, 8.0, 0.25..=4.0);
        assert_eq!(response.len(), 31);
        for r in &response {
            let w = TAU * r.frequency_hz * t;
            // 3 (1 − d) / (e^{jw} − d), exactly.
            let (re, im) = (w.cos() - decay, w.sin());
            let gain = 3.0 * (1.0 - decay) / re.hypot(im);
            assert!((r.gain / gain - 1.0).abs() < 0.04, "{r:?} {gain}");
            assert!((r.phase_rad + im.atan2(re)).abs() < 0.04, "{r:?}");
            assert!(r.coherence > 0.98, "{r:?}");
        }
    }

    #[test]
    fn what_has_nothing_to_do_with_the_input_has_no_coherence() {
        let both = noise(80_000);
        let response = frequency_response(&both[..40_000], &both[40_000..], 5e-3, 4.0, 0.5..=5.0);
        let mean = response.iter().map(|r| r.coherence).sum::<f64>() / response.len() as f64;
        assert!(mean < 0.06, "{mean}");
        assert!(
            frequency_response(&both[..1000], &both[..1000], 5e-3, 4.0, 0.5..=5.0).is_empty(),
            "too short"
        );
    }
}
