//! A simulated signal against a measured one: what the measurement is like, how far it lies behind, how well the two
//! agree once aligned. Definitions: root mean square (rms) of the difference over the common time; its relative form
//! over the rms of the measured signal about its mean; gain and bias of the least-squares line
//! `measured = gain * model + bias`; Pearson's correlation. The lag is where the correlation is largest, so that gain and bias do not move it.
//! Times rise; values between samples are linear.

/// A signal over rising times.
#[derive(Debug, Clone, Copy)]
pub struct Signal<'a> {
    /// Times, s, rising.
    pub time_s: &'a [f64],
    /// Values, one for each time.
    pub value: &'a [f64],
}

/// What a measured signal is like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Analysis {
    /// Number of samples.
    pub samples: usize,
    /// From the first to the last, s.
    pub duration_s: f64,
    /// Median spacing, s.
    pub spacing_s: f64,
    /// Largest spacing, s: a gap when far above the median.
    pub gap_s: f64,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Mean value.
    pub mean: f64,
    /// Root mean square about the mean.
    pub rms: f64,
    /// Frequency of the largest line of its spectrum, Hz; NaN for a constant.
    pub frequency_hz: f64,
}

/// How well model and measurement agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Samples compared.
    pub samples: usize,
    /// How far the measurement lies behind the model, s; taken out before comparing.
    pub lag_s: f64,
    /// Rms of measured - model.
    pub rms_error: f64,
    /// The same over the measured rms about its mean.
    pub relative: f64,
    /// Largest |measured - model|.
    pub max_error: f64,
    /// Gain of the line measured = gain * model + bias.
    pub gain: f64,
    /// Bias of that line.
    pub bias: f64,
    /// Pearson's correlation.
    pub correlation: f64,
}

/// Most points a lag search or spectrum uses.
const POINTS_MAX: usize = 4000;

impl Signal<'_> {
    fn at(&self, t: f64) -> Option<f64> {
        let (first, last) = (*self.time_s.first()?, *self.time_s.last()?);
        // Rounding at the ends must not lose them.
        let slack = 1e-9 * (last - first);
        if t < first - slack || t > last + slack {
            return None;
        }
        let i = self.time_s.partition_point(|x| *x <= t).clamp(1, self.time_s.len().max(2) - 1);
        if self.time_s.len() == 1 {
            return Some(self.value[0]);
        }
        let (a, b) = (self.time_s[i - 1], self.time_s[i]);
        let part = if b > a { ((t - a) / (b - a)).clamp(0.0, 1.0) } else { 0.0 };
        Some(self.value[i - 1] + part * (self.value[i] - self.value[i - 1]))
    }
}

/// What a measured signal is like.
pub fn analyse(signal: Signal) -> Analysis {
    let n = signal.value.len();
    let mut spacing: Vec<f64> = signal.time_s.windows(2).map(|w| w[1] - w[0]).collect();
    spacing.sort_by(f64::total_cmp);
    let mean = signal.value.iter().sum::<f64>() / n.max(1) as f64;
    let rms = (signal.value.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n.max(1) as f64).sqrt();
    let first = signal.time_s.first().copied().unwrap_or(0.0);
    let duration_s = signal.time_s.last().copied().unwrap_or(0.0) - first;
    Analysis {
        samples: n,
        duration_s,
        spacing_s: spacing.get(spacing.len() / 2).copied().unwrap_or(f64::NAN),
        gap_s: spacing.last().copied().unwrap_or(f64::NAN),
        min: signal.value.iter().copied().fold(f64::INFINITY, f64::min),
        max: signal.value.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        mean,
        rms,
        frequency_hz: strongest_line(signal, mean, rms, first, duration_s),
    }
}

/// Largest line of the spectrum: discrete Fourier transform under a Hann window, its peak refined by a parabola.
fn strongest_line(signal: Signal, mean: f64, rms: f64, first: f64, duration: f64) -> f64 {
    let n = signal.value.len().min(POINTS_MAX / 2);
    if n < 8 || rms <= 1e-12 * mean.abs() || rms == 0.0 {
        return f64::NAN;
    }
    let turn = std::f64::consts::TAU;
    let samples: Vec<f64> = (0..n)
        .map(|k| {
            let part = (k as f64 + 0.5) / n as f64;
            let window = 0.5 - 0.5 * (turn * part).cos();
            window * (signal.at(first + part * duration).unwrap_or(mean) - mean)
        })
        .collect();
    let power = |line: f64| -> f64 {
        let (mut re, mut im) = (0.0, 0.0);
        for (k, v) in samples.iter().enumerate() {
            let (s, c) = (turn * line * (k as f64 + 0.5) / n as f64).sin_cos();
            re += v * c;
            im += v * s;
        }
        re.hypot(im)
    };
    let lines: Vec<f64> = (1..n / 2).map(|k| power(k as f64)).collect();
    let best = (0..lines.len()).max_by(|a, b| lines[*a].total_cmp(&lines[*b])).unwrap_or(0);
    let mut shift = 0.0;
    if best > 0 && best + 1 < lines.len() {
        let (a, b, c) = (lines[best - 1], lines[best], lines[best + 1]);
        let bend = a - 2.0 * b + c;
        if bend < 0.0 {
            shift = 0.5 * (a - c) / bend;
        }
    }
    (best as f64 + 1.0 + shift) / duration
}

/// How far `measured` lies behind `model`, s, within +-`lag_max_s`: where their correlation is largest. Zero where
/// either is constant.
pub fn lag_s(model: Signal, measured: Signal, lag_max_s: f64) -> f64 {
    let spacing = analyse_spacing(model).max(lag_max_s / 2000.0);
    if spacing.is_nan() || spacing <= 0.0 || lag_max_s <= 0.0 {
        return 0.0;
    }
    let value = |lag: f64| {
        let c = compare(model, measured, lag, POINTS_MAX).correlation;
        if c.is_finite() { c } else { f64::NEG_INFINITY }
    };
    let steps = (lag_max_s / spacing).ceil() as i64;
    let mut best = (value(0.0), 0.0);
    for k in -steps..=steps {
        let lag = (k as f64 * spacing).clamp(-lag_max_s, lag_max_s);
        let v = value(lag);
        if v > best.0 {
            best = (v, lag);
        }
    }
    if best.0 == f64::NEG_INFINITY {
        return 0.0;
    }
    // Golden section in the neighbourhood of the best grid point.
    let golden = 0.5 * (5.0f64.sqrt() - 1.0);
    let (mut a, mut b) = (best.1 - spacing, best.1 + spacing);
    for _ in 0..40 {
        let (c, d) = (b - golden * (b - a), a + golden * (b - a));
        if value(c) > value(d) { b = d } else { a = c }
    }
    let middle = (0.5 * (a + b)).clamp(-lag_max_s, lag_max_s);
    if value(middle) >= best.0 { middle } else { best.1 }
}

fn analyse_spacing(signal: Signal) -> f64 {
    let mut spacing: Vec<f64> = signal.time_s.windows(2).map(|w| w[1] - w[0]).collect();
    spacing.sort_by(f64::total_cmp);
    spacing.get(spacing.len() / 2).copied().unwrap_or(0.0)
}

/// Compares measured(t + lag) with model(t) at the model's times.
pub fn agreement(model: Signal, measured: Signal, lag_s: f64) -> Agreement {
    compare(model, measured, lag_s, usize::MAX)
}

fn compare(model: Signal, measured: Signal, lag_s: f64, points: usize) -> Agreement {
    let every = model.time_s.len().div_ceil(points.max(1)).max(1);
    let pairs: Vec<(f64, f64)> = (0..model.time_s.len())
        .step_by(every)
        .filter_map(|k| measured.at(model.time_s[k] + lag_s).map(|m| (model.value[k], m)))
        .collect();
    let n = pairs.len() as f64;
    let mean = |f: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(f).sum::<f64>() / n;
    let (mx, my) = (mean(&|p| p.0), mean(&|p| p.1));
    let (xx, yy) = (mean(&|p| (p.0 - mx).powi(2)), mean(&|p| (p.1 - my).powi(2)));
    let xy = mean(&|p| (p.0 - mx) * (p.1 - my));
    let rms_error = mean(&|p| (p.1 - p.0).powi(2)).sqrt();
    let gain = xy / xx;
    Agreement {
        samples: pairs.len(),
        lag_s,
        rms_error,
        relative: rms_error / yy.sqrt(),
        max_error: pairs.iter().fold(0.0, |m, p| m.max((p.1 - p.0).abs())),
        gain,
        bias: my - gain * mx,
        correlation: xy / (xx * yy).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shifted_scaled_and_offset_copy_is_found_out() {
        let f = |t: f64| (3.0 * t).sin() + 0.4 * (11.0 * t).cos();
        let time: Vec<f64> = (0..4000).map(|k| k as f64 * 1e-3).collect();
        let model: Vec<f64> = time.iter().map(|t| f(*t)).collect();
        // Another rate, 30 ms late, 2 % more, 0.05 up.
        let late: Vec<f64> = (0..1000).map(|k| k as f64 * 4e-3 + 5e-4).collect();
        let measured: Vec<f64> = late.iter().map(|t| 1.02 * f(t - 0.0303) + 0.05).collect();
        let (a, b) = (Signal { time_s: &time, value: &model }, Signal { time_s: &late, value: &measured });
        let lag = lag_s(a, b, 0.1);
        assert!((lag - 0.0303).abs() < 2e-4, "{lag}");
        let g = agreement(a, b, lag);
        assert!((g.gain - 1.02).abs() < 1e-3 && (g.bias - 0.05).abs() < 1e-3, "{g:?}");
        assert!(g.correlation > 0.9999);
        // rms of 0.02 f + 0.05 about: known from the samples.
        let want = model.iter().map(|v| (0.02 * v + 0.05).powi(2)).sum::<f64>() / 4000.0;
        assert!((g.rms_error - want.sqrt()).abs() < 2e-3, "{g:?} {}", want.sqrt());
    }

    #[test]
    fn a_sine_is_analysed() {
        let time: Vec<f64> = (0..3000).map(|k| k as f64 * 2e-3).collect();
        let value: Vec<f64> = time.iter().map(|t| 2.0 + 3.0 * (14.0 * t).sin()).collect();
        let a = analyse(Signal { time_s: &time, value: &value });
        assert!((a.frequency_hz - 14.0 / std::f64::consts::TAU).abs() < 0.02, "{a:?}");
        assert!((a.spacing_s - 2e-3).abs() < 1e-12 && (a.max - 5.0).abs() < 1e-3);
        let flat = vec![1.0; 3000];
        assert!(analyse(Signal { time_s: &time, value: &flat }).frequency_hz.is_nan());
        assert_eq!(
            lag_s(Signal { time_s: &time, value: &flat }, Signal { time_s: &time, value: &flat }, 0.1),
            0.0
        );
    }
}
