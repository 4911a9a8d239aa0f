//! Which run has which values, and what comes of it.
//!
//! Everything drawn is a hash of the study's seed, the run's number and the parameter's place (SplitMix64 [Steele, Lea,
//! Flood 2014] over each in turn), so a run can be made without the ones before it.

use config::study::{Effect, Sampling, Scale, Study, Values};
use config::{Mistake, Problems, ResolvedBench, Violation};
use record::text_hash;
use serde_json::Value;

use crate::figures;
use crate::memory::{Interrupted, RunFault, run};
use crate::results::{Cell, Row};

/// The streams that are drawn besides the parameters'.
const SEEDS: u64 = 1 << 32;
const STRATA: u64 = 1 << 33;

/// A study, ready to be run.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The study.
    pub study: Study,
    /// Tells it from every other: of the study, everything its scenario names, and the program's version.
    pub hash: String,
    /// The scenario's own seed.
    seed: u64,
    /// By parameter and key, the number or list of numbers that stands there.
    bases: Vec<Vec<Option<Value>>>,
    /// Latin hypercube: by parameter the stratum of each run.
    strata: Vec<Vec<u32>>,
}

impl Prepared {
    /// Loads what the study is about.
    ///
    /// # Errors
    /// A scenario that does not load as it is, and keys that cannot be scaled.
    pub fn new(study: Study) -> Result<Self, Problems> {
        let base = ResolvedBench::load(&study.scenario, &study.set)?;
        let tree = base.to_json();
        let mut problems = Problems::default();
        let mut bases = Vec::new();
        for (i, parameter) in study.parameter.iter().enumerate() {
            let mut found = Vec::new();
            for (k, key) in parameter.keys.iter().enumerate() {
                let value = value_at(&tree, key).filter(|value| scaled(value, 1.0).is_some());
                if value.is_none() && parameter.effect == Effect::Scale {
                    problems.push(Violation {
                        key: format!("parameter[{i}].keys[{k}]"),
                        value: key.clone(),
                        ..Violation::of_file(
                            Mistake::Reference,
                            study.name.clone(),
                            "must name a number, or a list of numbers, that the scenario has",
                        )
                    });
                }
                found.push(value.cloned());
            }
            bases.push(found);
        }
        let strata = match study.sampling {
            Sampling::LatinHypercube { runs } => {
                (0..study.parameter.len()).map(|p| shuffled(study.seed, p as u64, runs as u32)).collect()
            }
            _ => Vec::new(),
        };
        let text = serde_json::to_string(&study).unwrap_or_default();
        let hash = text_hash(&format!("{text}\n{}\n{}", base.hash(), env!("CARGO_PKG_VERSION")));
        problems.or(Prepared { seed: base.scenario.seed, hash, bases, strata, study })
    }

    /// Number of runs.
    pub fn runs(&self) -> u64 {
        self.study.runs()
    }

    /// The parameters of a run.
    pub fn parameters(&self, run: u64) -> Vec<Cell> {
        let parameters = self.study.parameter.iter().enumerate();
        let mut rest = run;
        let mut places: Vec<u64> = vec![0; self.study.parameter.len()];
        if self.study.sampling == Sampling::Grid {
            for (place, parameter) in places.iter_mut().zip(&self.study.parameter).rev() {
                let count = parameter.values.count();
                *place = rest % count;
                rest /= count;
            }
        }
        parameters
            .map(|(p, parameter)| {
                let drawn = || unit(hash(&[self.study.seed, run, p as u64]));
                match self.study.sampling {
                    Sampling::Grid => on_grid(&parameter.values, places[p]),
                    Sampling::Random { .. } => drawn_from(&parameter.values, drawn()),
                    Sampling::LatinHypercube { runs } => {
                        let stratum = self.strata[p].get(run as usize).copied().unwrap_or(0);
                        drawn_from(&parameter.values, (f64::from(stratum) + drawn()) / runs as f64)
                    }
                }
            })
            .collect()
    }

    /// Seed of a run.
    pub fn seed(&self, run: u64) -> u64 {
        // 53 bits: what a number in JSON holds exactly.
        if self.study.vary_seed { hash(&[self.study.seed, run, SEEDS]) >> 11 } else { self.seed }
    }

    /// What is laid over the scenario for a run, as `kingpin run --set` takes it.
    pub fn overrides(&self, run: u64) -> Vec<String> {
        let mut overrides = self.study.set.clone();
        for ((parameter, cell), bases) in
            self.study.parameter.iter().zip(self.parameters(run)).zip(&self.bases)
        {
            for (k, key) in parameter.keys.iter().enumerate() {
                let base = bases.get(k).and_then(Option::as_ref);
                let value = match (&cell, base) {
                    (Cell::Number(factor), Some(base)) if parameter.effect == Effect::Scale => {
                        scaled(base, *factor).map(|v| v.to_string()).unwrap_or_default()
                    }
                    // A whole number stays one: 5, not 5.0.
                    (Cell::Number(value), Some(Value::Number(base)))
                        if !base.is_f64() && value.fract() == 0.0 =>
                    {
                        format!("{value:.0}")
                    }
                    (Cell::Number(value), _) => toml_number(*value),
                    (Cell::Text(text), _) => serde_json::to_string(text).unwrap_or_default(),
                };
                overrides.push(format!("{key}={value}"));
            }
        }
        if self.study.vary_seed {
            overrides.push(format!("seed={}", self.seed(run)));
        }
        overrides
    }

    /// Makes a run. What is wrong with it stands in its row; only the end that `look` (see [`crate::run`]) asked for
    /// gives none.
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn evaluate(
        &self,
        number: u64,
        look: impl FnMut(u64, u64) -> Result<(), Interrupted>,
    ) -> Result<Row, Interrupted> {
        let mut row = Row {
            run: number,
            seed: self.seed(number),
            parameters: self.parameters(number),
            metrics: vec![None; self.study.metric.len()],
            error: String::new(),
        };
        let resolved = match ResolvedBench::load(&self.study.scenario, &self.overrides(number)) {
            Ok(resolved) => resolved,
            Err(problems) => {
                row.error = problems.to_string();
                return Ok(row);
            }
        };
        match run(&resolved, look) {
            Err(RunFault::Interrupted) => return Err(Interrupted),
            Err(fault) => row.error = fault.to_string(),
            Ok(log) => {
                let (metrics, error) = figures::measure(&self.study.metric, &log, &resolved);
                (row.metrics, row.error) = (metrics, error);
            }
        }
        Ok(row)
    }
}

/// The value at a key as `--set` names it: without a section ahead it is the scenario's.
fn value_at<'a>(tree: &'a Value, key: &str) -> Option<&'a Value> {
    const SECTIONS: [&str; 5] = ["car", "front_axle", "rear_axle", "rig", "unit"];
    let parts: Vec<&str> = key.split('.').collect();
    let start = if SECTIONS.contains(&parts[0]) { tree } else { tree.get("scenario")? };
    parts.iter().try_fold(start, |value, part| value.get(part))
}

/// Every number of a value times a factor; None if it holds anything else.
fn scaled(value: &Value, factor: f64) -> Option<Value> {
    match value {
        Value::Number(number) => {
            let text = toml_number(number.as_f64()? * factor);
            serde_json::from_str(&text).ok()
        }
        Value::Array(values) => {
            values.iter().map(|value| scaled(value, factor)).collect::<Option<Vec<_>>>().map(Value::Array)
        }
        _ => None,
    }
}

/// A number as TOML has it: a float stays a float.
fn toml_number(value: f64) -> String {
    format!("{value:?}")
}

fn on_grid(values: &Values, place: u64) -> Cell {
    match values {
        Values::List { values } => Cell::Number(values[place as usize]),
        Values::Texts { values } => Cell::Text(values[place as usize].clone()),
        Values::Range { steps: 1, from, .. } => Cell::Number(*from),
        Values::Range { from, to, steps, scale } => {
            // The ends exactly.
            let share = place as f64 / (steps - 1) as f64;
            Cell::Number(if place + 1 == *steps { *to } else { between(*from, *to, *scale, share) })
        }
    }
}

/// `share` in [0, 1).
fn drawn_from(values: &Values, share: f64) -> Cell {
    let place = |count: usize| ((share * count as f64) as usize).min(count - 1);
    match values {
        Values::List { values } => Cell::Number(values[place(values.len())]),
        Values::Texts { values } => Cell::Text(values[place(values.len())].clone()),
        Values::Range { from, to, scale, .. } => Cell::Number(between(*from, *to, *scale, share)),
    }
}

fn between(from: f64, to: f64, scale: Scale, share: f64) -> f64 {
    match scale {
        Scale::Linear => from + share * (to - from),
        Scale::Logarithmic => (from.ln() + share * (to.ln() - from.ln())).exp().clamp(from, to),
    }
}

/// SplitMix64's finalizer over each word in turn.
fn hash(words: &[u64]) -> u64 {
    words.iter().fold(0x6b69_6e67_7069_6e21, |state, word| {
        let mut z = (state ^ word).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    })
}

/// [0, 1)
fn unit(word: u64) -> f64 {
    (word >> 11) as f64 / (1_u64 << 53) as f64
}

/// 0 to count-1 in a random order [Fisher, Yates].
fn shuffled(seed: u64, stream: u64, count: u32) -> Vec<u32> {
    let mut order: Vec<u32> = (0..count).collect();
    for i in (1..order.len()).rev() {
        let j = (unit(hash(&[seed, i as u64, STRATA + stream])) * (i + 1) as f64) as usize;
        order.swap(i, j.min(i));
    }
    order
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]
    use super::*;

    fn prepared(sampling: Sampling) -> Prepared {
        let mut study = config::load::<Study>("quick").unwrap().value;
        study.sampling = sampling;
        Prepared::new(study).unwrap()
    }

    fn numbers(prepared: &Prepared, parameter: usize) -> Vec<f64> {
        let of = |run| match &prepared.parameters(run)[parameter] {
            Cell::Number(value) => *value,
            Cell::Text(text) => panic!("{text}"),
        };
        (0..prepared.runs()).map(of).collect()
    }

    #[test]
    fn a_grid_has_every_combination_once() {
        let prepared = prepared(Sampling::Grid);
        assert_eq!(prepared.runs(), 5 * 3 * 6);
        let mut all: Vec<String> =
            (0..prepared.runs()).map(|run| format!("{:?}", prepared.parameters(run))).collect();
        all.sort();
        all.dedup();
        assert_eq!(all.len(), 90);
        let masses = numbers(&prepared, 0);
        assert_eq!((masses[0], masses[89]), (1250.0, 1450.0));
    }

    #[test]
    fn a_latin_hypercube_has_one_run_in_each_stratum() {
        let prepared = prepared(Sampling::LatinHypercube { runs: 50 });
        let mut strata: Vec<u64> =
            numbers(&prepared, 0).iter().map(|m| ((m - 1250.0) / 200.0 * 50.0) as u64).collect();
        assert!(!strata.is_sorted());
        strata.sort_unstable();
        assert_eq!(strata, (0..50).collect::<Vec<_>>());
    }

    #[test]
    fn draws_are_even_and_of_the_run_alone() {
        let prepared = prepared(Sampling::Random { runs: 20_000 });
        let masses = numbers(&prepared, 0);
        let mean = masses.iter().sum::<f64>() / masses.len() as f64;
        // Standard error 200/√12/√20000 = 0.41.
        assert!((mean - 1350.0).abs() < 2.0, "{mean}");
        let again = self::prepared(Sampling::Random { runs: 7 });
        assert_eq!(again.parameters(3), prepared.parameters(3));
        assert_ne!(prepared.seed(3), prepared.seed(4));
    }

    #[test]
    fn scaling_multiplies_every_number_of_what_stands_there() {
        let prepared = prepared(Sampling::Grid);
        let with = |run| ResolvedBench::load(&prepared.study.scenario, &prepared.overrides(run)).unwrap();
        let assist =
            |bench: &ResolvedBench| serde_json::to_value(&bench.unit).unwrap()["assist"]["force_n"].clone();
        // The assist factor is 0.5 in run 0 and 1 in run 6.
        let (half, whole) = (assist(&with(0)), assist(&with(6)));
        assert_eq!(half[2][3].as_f64().unwrap() * 2.0, whole[2][3].as_f64().unwrap());
        assert_ne!(whole[2][3].as_f64().unwrap(), 0.0);
    }
}
