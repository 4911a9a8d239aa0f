//! Random steering input (ISO 7401, clause 12) as a sum of sines, so that it is a function of time with an
//! exact rate. Frequencies are spread evenly over the band with seeded jitter (so that it does not repeat),
//! phases are seeded, amplitudes equal: a flat spectrum in the band and nothing outside.

use crate::shape::Motion;
use std::f64::consts::TAU;

/// A sum of sines.
#[derive(Debug, Clone, PartialEq)]
pub struct RandomSines {
    amplitude: f64,
    /// Frequency [rad/s] and phase [rad].
    sines: Vec<(f64, f64)>,
}

impl RandomSines {
    /// `components` sines in `[low_hz, high_hz]` of root mean square `rms` together.
    pub fn new(seed: u64, components: u32, low_hz: f64, high_hz: f64, rms: f64) -> Self {
        let mut state = seed;
        let width = (high_hz - low_hz) / f64::from(components);
        let sines = (0..components)
            .map(|k| {
                let hz = low_hz + width * (f64::from(k) + uniform(&mut state));
                (TAU * hz, TAU * uniform(&mut state))
            })
            .collect();
        Self { amplitude: rms * (2.0 / f64::from(components)).sqrt(), sines }
    }

    /// Value and rate.
    pub fn at(&self, time_s: f64) -> Motion {
        let mut sum = Motion::default();
        for (omega, phase) in &self.sines {
            let (sine, cosine) = (omega * time_s + phase).sin_cos();
            sum.value += sine;
            sum.rate += omega * cosine;
        }
        sum.scaled(self.amplitude)
    }
}

/// SplitMix64 [Steele, Lea, Flood 2014], upper 53 bits as a number in [0, 1).
fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}
