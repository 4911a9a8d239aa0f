//! Shapes over time with their exact derivatives: half-cosine step, blended ramp, sine under a trapezoid
//! envelope, sine with dwell. Each returns value and rate; units are the caller's.

use std::f64::consts::{PI, TAU};

/// A value and its time derivative.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Motion {
    /// Value.
    pub value: f64,
    /// Its rate, per second.
    pub rate: f64,
}

impl Motion {
    /// At rest at a value.
    pub fn rest(value: f64) -> Self {
        Self { value, rate: 0.0 }
    }

    /// Product rule.
    pub fn times(self, other: Self) -> Self {
        Self { value: self.value * other.value, rate: self.rate * other.value + self.value * other.rate }
    }

    /// Both scaled.
    pub fn scaled(self, factor: f64) -> Self {
        Self { value: self.value * factor, rate: self.rate * factor }
    }
}

/// From 0 to 1 as half a cosine over `rise_s`, beginning at `time_s` = 0. A rise of 0 is a jump (rate 0).
pub fn half_cosine(time_s: f64, rise_s: f64) -> Motion {
    if time_s <= 0.0 && rise_s > 0.0 || time_s < 0.0 {
        return Motion::rest(0.0);
    }
    if time_s >= rise_s {
        return Motion::rest(1.0);
    }
    let (sine, cosine) = (PI * time_s / rise_s).sin_cos();
    Motion { value: 0.5 * (1.0 - cosine), rate: 0.5 * PI / rise_s * sine }
}

/// Up at `start_s`, down before `end_s`, each as half a cosine over `rise_s`; 1 between.
pub fn pulse(time_s: f64, start_s: f64, end_s: f64, rise_s: f64) -> Motion {
    let up = half_cosine(time_s - start_s, rise_s);
    let down = half_cosine(time_s - (end_s - rise_s), rise_s);
    up.times(Motion { value: 1.0 - down.value, rate: -down.rate })
}

/// From 0 to `distance` at a constant rate, the rate itself rising and falling linearly over `blend_s`
/// (constant angular acceleration). Takes |distance| / rate + blend. Needs blend · rate ≤ |distance|.
pub fn blended_ramp(time_s: f64, distance: f64, rate: f64, blend_s: f64) -> Motion {
    let length = distance.abs();
    let total_s = blended_ramp_s(distance, rate, blend_s);
    if time_s <= 0.0 || length == 0.0 {
        return Motion::rest(0.0);
    }
    if time_s >= total_s {
        return Motion::rest(distance);
    }
    let from_end_s = total_s - time_s;
    let along = if time_s < blend_s {
        Motion { value: 0.5 * rate * time_s * time_s / blend_s, rate: rate * time_s / blend_s }
    } else if from_end_s < blend_s {
        let left = 0.5 * rate * from_end_s * from_end_s / blend_s;
        Motion { value: length - left, rate: rate * from_end_s / blend_s }
    } else {
        Motion { value: rate * (time_s - 0.5 * blend_s), rate }
    };
    along.scaled(distance.signum())
}

/// Duration of [`blended_ramp`]. [s]
pub fn blended_ramp_s(distance: f64, rate: f64, blend_s: f64) -> f64 {
    distance.abs() / rate + blend_s
}

/// A sine whose amplitude runs linearly through the corners (period, amplitude), in periods from its begin.
/// Before the first corner and after the last it is zero. With corners at multiples of half a period, the
/// rate has no jump at inner corners, since the sine is zero there.
pub fn enveloped_sine(time_s: f64, frequency_hz: f64, corners: &[(f64, f64)]) -> Motion {
    let period = time_s * frequency_hz;
    let Some(pair) = corners.windows(2).find(|pair| (pair[0].0..pair[1].0).contains(&period)) else {
        return Motion::rest(0.0);
    };
    let [(from, first), (to, last)] = [pair[0], pair[1]];
    let slope = (last - first) / (to - from);
    let amplitude = Motion { value: first + slope * (period - from), rate: slope * frequency_hz };
    // The phase within the period, so that whole periods are exact after any number of them.
    let (sine, cosine) = (TAU * period.fract()).sin_cos();
    amplitude.times(Motion { value: sine, rate: TAU * frequency_hz * cosine })
}

/// One period of a unit sine, held at three quarters of it for the dwell.
pub fn sine_with_dwell(time_s: f64, frequency_hz: f64, dwell_s: f64) -> Motion {
    let peak_s = 0.75 / frequency_hz;
    let end_s = 1.0 / frequency_hz + dwell_s;
    let moved_s = if time_s <= 0.0 || time_s >= end_s {
        return Motion::rest(0.0);
    } else if time_s < peak_s {
        time_s
    } else if time_s <= peak_s + dwell_s {
        return Motion::rest(-1.0);
    } else {
        time_s - dwell_s
    };
    let (sine, cosine) = (TAU * frequency_hz * moved_s).sin_cos();
    Motion { value: sine, rate: TAU * frequency_hz * cosine }
}
