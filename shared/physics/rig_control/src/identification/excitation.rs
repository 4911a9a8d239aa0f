//! Periodic test signals of unit peak: multisine, chirp, pseudo-random binary sequence.
//!
//! Multisine: chosen lines, amplitude ∝ 1 below `corner_hz` and 1/f above, phases by Schroeder's rule for
//! that spectrum [Schroeder 1970, IEEE Trans. IT 16(1)]. Chirp: linear sweep up over the period. Binary sequence:
//! maximum length, held for a whole number of samples. All start near zero and can be repeated without a gap.

use core::f64::consts::{PI, TAU};

/// Kind of test signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Excitation {
    /// Sum of sines at every `stride`-th line from `offset` on.
    Multisine {
        /// First line, counted from 1.
        offset: usize,
        /// Distance of the lines; other lines are left to other signals.
        stride: usize,
        /// Amplitudes fall with 1/f from here on. [Hz]
        corner_hz: f64,
    },
    /// Linear sweep.
    Chirp,
    /// Maximum-length sequence of 2^`bits` − 1 steps (5 to 10 bits), low-passed at the highest frequency.
    BinarySequence {
        /// Bits of the shift register.
        bits: u32,
    },
}

/// One period of a test.
#[derive(Debug, Clone, PartialEq)]
pub struct Periodic {
    /// Values of one period; largest magnitude 1.
    pub values: Vec<f64>,
    /// Lines (multiples of one over the period) that carry power and may be evaluated.
    pub lines: Vec<usize>,
    /// Sample time. [s]
    pub sample_time_s: f64,
}

impl Periodic {
    /// One period of `period_s` with power between `low_hz` and `high_hz`.
    pub fn new(kind: Excitation, period_s: f64, low_hz: f64, high_hz: f64, sample_time_s: f64) -> Self {
        let count = (period_s / sample_time_s).round().max(8.0) as usize;
        let step_hz = 1.0 / (count as f64 * sample_time_s);
        let first = ((low_hz / step_hz).ceil() as usize).max(1);
        let last = ((high_hz / step_hz).floor() as usize).min(count / 3).max(first);
        let (mut values, lines) = match kind {
            Excitation::Multisine { offset, stride, corner_hz } => {
                let stride = stride.max(1);
                let lines: Vec<usize> = (first..=last)
                    .filter(|k| (k + stride - offset % stride).is_multiple_of(stride))
                    .collect();
                (multisine(&lines, count, step_hz, corner_hz), lines)
            }
            Excitation::Chirp => {
                let (low, high) = (first as f64 * step_hz, last as f64 * step_hz);
                let span = count as f64 * sample_time_s;
                let values = (0..count).map(|i| {
                    let t = i as f64 * sample_time_s;
                    // The sweep stops at both ends, so that the period can be repeated.
                    let edge = (20.0 * (t / span).min(1.0 - t / span)).min(1.0);
                    (0.5 - 0.5 * (PI * edge).cos())
                        * (TAU * (low * t + 0.5 * (high - low) * t * t / span)).sin()
                });
                (values.collect(), (first..=last).collect())
            }
            Excitation::BinarySequence { bits } => {
                (binary_sequence(bits, count, high_hz * sample_time_s), (first..=last).collect())
            }
        };
        let peak = values.iter().fold(f64::MIN_POSITIVE, |m: f64, v| m.max(v.abs()));
        for value in &mut values {
            *value /= peak;
        }
        Self { values, lines, sample_time_s }
    }

    /// The value at sample `i` of an endless repetition.
    pub fn at(&self, i: usize) -> f64 {
        self.values[i % self.values.len()]
    }

    /// Frequency of a line. [Hz]
    pub fn frequency_hz(&self, line: usize) -> f64 {
        line as f64 / (self.values.len() as f64 * self.sample_time_s)
    }
}

fn multisine(lines: &[usize], count: usize, step_hz: f64, corner_hz: f64) -> Vec<f64> {
    let amplitude = |line: usize| (corner_hz / (line as f64 * step_hz)).min(1.0);
    let power: f64 = lines.iter().map(|&line| amplitude(line).powi(2)).sum();
    let mut values = vec![0.0; count];
    // φ_n = φ_1 − 2π Σ_{l<n} (n − l) p_l, p_l the line's share of the power: the frequency sweeps as long over each
    // line as its share is. (For equal lines that is −π n²/N.)
    let (mut phase, mut passed) = (0.0, 0.0);
    for &line in lines {
        let amplitude = amplitude(line);
        for (i, value) in values.iter_mut().enumerate() {
            // The phase by integers: exact over any period.
            let turn = (i * line % count) as f64 / count as f64;
            *value += amplitude * (TAU * turn + phase).sin();
        }
        passed += amplitude * amplitude / power;
        phase -= TAU * passed;
    }
    values
}

fn binary_sequence(bits: u32, count: usize, corner_per_sample: f64) -> Vec<f64> {
    // Primitive polynomials x^n + x^k + 1 (n = 8: four taps).
    let bits = bits.clamp(5, 10);
    let taps: u32 = match bits {
        5 => 0b1_0100,
        6 => 0b11_0000,
        7 => 0b110_0000,
        8 => 0b1011_1000,
        9 => 0b1_0001_0000,
        _ => 0b10_0100_0000,
    };
    let length = (1_usize << bits) - 1;
    let mut register = 1_u32;
    let steps: Vec<f64> = (0..length)
        .map(|_| {
            let out = if register & 1 == 1 { 1.0 } else { -1.0 };
            let lsb = register & taps;
            let feedback = lsb.count_ones() & 1;
            register = (register << 1 | feedback) & ((1 << bits) - 1);
            out
        })
        .collect();
    let mean = steps.iter().sum::<f64>() / length as f64;
    let held: Vec<f64> = (0..count).map(|i| steps[i * length / count] - mean).collect();
    // Two passes over the circle make the low-pass periodic.
    let gain = 1.0 - (-TAU * corner_per_sample).exp();
    let mut state = 0.0;
    let mut out = vec![0.0; count];
    for pass in 0..2 {
        for (o, h) in out.iter_mut().zip(&held) {
            state += gain * (h - state);
            if pass == 1 {
                *o = state;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interleaved_multisines_share_no_line_and_have_a_low_crest() {
        let make = |offset| {
            Periodic::new(Excitation::Multisine { offset, stride: 2, corner_hz: 5.0 }, 4.0, 0.5, 40.0, 1e-3)
        };
        let (a, b) = (make(0), make(1));
        assert!(a.lines.iter().all(|l| !b.lines.contains(l)) && a.lines.len() > 60);
        let rms = (a.values.iter().map(|v| v * v).sum::<f64>() / 4000.0).sqrt();
        assert!(rms > 0.3, "{rms}");
        // No power of one on the lines of the other.
        for &line in &b.lines {
            let (mut re, mut im) = (0.0, 0.0);
            for (i, v) in a.values.iter().enumerate() {
                let w = TAU * (i * line % 4000) as f64 / 4000.0;
                re += v * w.cos();
                im += v * w.sin();
            }
            assert!(re.hypot(im) < 1e-6);
        }
    }

    #[test]
    fn binary_sequences_have_maximum_length() {
        for bits in 5..=10 {
            let length = (1_usize << bits) - 1;
            let values = binary_sequence(bits, length, 1e3);
            // Balanced to one, and no shift but zero correlates.
            let sign: Vec<f64> = values.iter().map(|v| v.signum()).collect();
            assert_eq!(sign.iter().sum::<f64>().abs(), 1.0, "{bits}");
            for shift in 1..length {
                let r: f64 = (0..length).map(|i| sign[i] * sign[(i + shift) % length]).sum();
                assert_eq!(r, -1.0, "{bits} {shift}");
            }
        }
    }
}
