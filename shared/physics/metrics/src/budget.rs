//! An error split into parts that add up to it.
//!
//! The parts e_i are signals whose sum is the error e at every sample. The root mean square of a sum is not the sum
//! of root mean squares; the shares s_i = ⟨e_i e⟩ / rms(e) do add up to rms(e), exactly: Σ s_i = ⟨e e⟩ / rms(e). A share
//! is negative where a part makes up for others. (Variance decomposition by covariance, as in risk budgets.)
//!
//! [`explain`] splits a signal by causes that are known as signals, one after the other: each takes what it explains,
//! by least squares, of what the earlier ones left, and the rest remains. So the parts add up whatever the order; the
//! order says who goes first where two causes are alike.

use crate::statistics::{peak, rms};

/// One part of an error.
#[derive(Debug, Clone, PartialEq)]
pub struct BudgetPart {
    /// Its own root mean square. [unit of the signal]
    pub rms: f64,
    /// Its largest magnitude. [unit of the signal]
    pub peak: f64,
    /// What it contributes to the root mean square of the whole. [unit of the signal]
    pub share: f64,
}

/// An error and its parts.
#[derive(Debug, Clone, PartialEq)]
pub struct Budget {
    /// Root mean square of the whole. [unit of the signal]
    pub rms: f64,
    /// Largest magnitude of the whole. [unit of the signal]
    pub peak: f64,
    /// The parts in the order given; their shares add up to `rms`.
    pub parts: Vec<BudgetPart>,
    /// Samples used: those where every part is finite.
    pub samples: usize,
}

/// The budget of the error whose parts these are, over the samples where all are finite. None without such samples or
/// without any error.
pub fn budget(parts: &[Vec<f64>]) -> Option<Budget> {
    let len = parts.iter().map(Vec::len).min()?;
    let used: Vec<usize> = (0..len).filter(|&i| parts.iter().all(|part| part[i].is_finite())).collect();
    let whole: Vec<f64> = used.iter().map(|&i| parts.iter().map(|part| part[i]).sum()).collect();
    let level = rms(&whole);
    if level.is_nan() || level <= 0.0 {
        return None;
    }
    let parts = parts
        .iter()
        .map(|part| {
            let values: Vec<f64> = used.iter().map(|&i| part[i]).collect();
            let product: f64 = values.iter().zip(&whole).map(|(e, whole)| e * whole).sum();
            BudgetPart { rms: rms(&values), peak: peak(&values), share: product / used.len() as f64 / level }
        })
        .collect();
    Some(Budget { rms: level, peak: peak(&whole), parts, samples: used.len() })
}

/// What each cause explains of a signal, in their order, and last what none does: as many signals as causes and one.
/// Samples where the signal or a cause is not finite are NaN in all of them.
pub fn explain(signal: &[f64], causes: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let len = causes.iter().map(Vec::len).min().unwrap_or(signal.len()).min(signal.len());
    let used: Vec<usize> = (0..len)
        .filter(|&i| signal[i].is_finite() && causes.iter().all(|cause| cause[i].is_finite()))
        .collect();
    let mut rest: Vec<f64> = used.iter().map(|&i| signal[i]).collect();
    let mut before: Vec<Vec<f64>> = Vec::new();
    let mut found = Vec::new();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut put = |values: &[f64]| {
        let mut whole = vec![f64::NAN; signal.len()];
        used.iter().zip(values).for_each(|(&i, &value)| whole[i] = value);
        found.push(whole);
    };
    for cause in causes {
        let mut own: Vec<f64> = used.iter().map(|&i| cause[i]).collect();
        let size = dot(&own, &own);
        // Modified Gram-Schmidt: what earlier causes explain is theirs.
        for earlier in &before {
            let along = dot(&own, earlier);
            own.iter_mut().zip(earlier).for_each(|(own, earlier)| *own -= along * earlier);
        }
        let left = dot(&own, &own);
        // A cause that is all in the earlier ones explains nothing more.
        let scale = if left > 1e-12 * size { left.sqrt().recip() } else { 0.0 };
        own.iter_mut().for_each(|own| *own *= scale);
        let along = dot(&rest, &own);
        let part: Vec<f64> = own.iter().map(|own| along * own).collect();
        rest.iter_mut().zip(&part).for_each(|(rest, part)| *rest -= part);
        put(&part);
        before.push(own);
    }
    put(&rest);
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn wave(amplitude: f64, cycles: f64, phase: f64) -> Vec<f64> {
        (0..1000).map(|i| amplitude * (TAU * cycles * i as f64 / 1000.0 + phase).sin()).collect()
    }

    #[test]
    fn shares_of_independent_parts_are_their_variances_over_the_whole() {
        let found = budget(&[wave(3.0, 5.0, 0.0), wave(4.0, 7.0, 0.3)]).unwrap();
        let whole = (4.5_f64 + 8.0).sqrt();
        assert!((found.rms - whole).abs() < 1e-12);
        assert!((found.parts[0].share - 4.5 / whole).abs() < 1e-12);
        assert!((found.parts[1].share - 8.0 / whole).abs() < 1e-12);
        assert!((found.parts[0].rms - 4.5_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn shares_add_up_however_the_parts_hang_together() {
        let mut parts = vec![wave(3.0, 5.0, 0.0), wave(-2.5, 5.0, 0.1), wave(1.0, 5.0, 2.0), vec![0.7; 1000]];
        parts[1][17] = f64::NAN;
        let found = budget(&parts).unwrap();
        let sum: f64 = found.parts.iter().map(|p| p.share).sum();
        assert!((sum - found.rms).abs() < 1e-12 * found.rms, "{sum} {}", found.rms);
        assert!(found.parts[1].share < 0.0, "what makes up for another is negative");
        assert_eq!(found.samples, 999);
        assert_eq!(budget(&[vec![0.0; 10]]), None);
        assert_eq!(budget(&[vec![f64::NAN; 10]]), None);
    }

    #[test]
    fn causes_take_what_they_explain_and_the_rest_remains() {
        let (a, b) = (wave(1.0, 3.0, 0.0), wave(1.0, 3.0, 0.4));
        let other = wave(0.2, 11.0, 0.0);
        let signal: Vec<f64> = (0..1000).map(|i| 2.0 * a[i] - 5.0 * b[i] + other[i]).collect();
        let found = explain(&signal, &[a.clone(), b.clone()]);
        let off = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        assert!(off(&found[2], &other) < 1e-12, "both together explain all but the other wave");
        let sum: Vec<f64> = (0..1000).map(|i| found[0][i] + found[1][i] + found[2][i]).collect();
        assert!(off(&sum, &signal) < 1e-12);
        // The first takes what is along it: b has cos 0.4 along a.
        let along = 2.0 - 5.0 * 0.4_f64.cos();
        let expected: Vec<f64> = a.iter().map(|a| along * a).collect();
        assert!(off(&found[0], &expected) < 1e-12);
        // Twice the same cause explains nothing twice.
        let twice = explain(&signal, &[a.clone(), a]);
        assert!(peak(&twice[1]) < 1e-9);
    }
}
