//! A study: one scenario run again and again with other parameters, a few figures kept of each run.
//!
//! What is run is a pure function of the study and of a run's number: the same file gives the same table, whoever runs
//! it, in whatever order. How runs are drawn and what is kept is carried out by the crate `study`.

use crate::check::{Check, Checker};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most runs of a study.
pub const RUNS_MAX: u64 = 1_000_000;

/// A study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// Short name. Letters, digits, `_` and `-`, 1 to 60 of them.
    #[schemars(length(min = 1, max = 60))]
    pub name: String,
    /// What the study shows, in a sentence or two.
    pub description: String,
    /// The scenario that is run: a path as seen from where the study is started, or the bare name of a shipped one.
    pub scenario: String,
    /// Values replaced in every run, as with `kingpin run --set`.
    pub set: Vec<String>,
    /// Seed of everything that is drawn.
    #[schemars(range(max = 9_007_199_254_740_992_u64))]
    pub seed: u64,
    /// Whether every run gets a seed of its own for its sensors' noise (drawn from `seed` and the run's number), or all
    /// have the scenario's.
    pub vary_seed: bool,
    /// How the runs are chosen.
    pub sampling: Sampling,
    /// What is varied.
    #[schemars(length(min = 1, max = 64))]
    pub parameter: Vec<Parameter>,
    /// What is kept of each run.
    #[schemars(length(min = 1, max = 256))]
    pub metric: Vec<Metric>,
}

/// How runs are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Sampling {
    /// Every value of every parameter with every other; the last parameter changes fastest.
    Grid,
    /// Each parameter drawn evenly over its range, or among its values.
    Random {
        /// Number of runs. [1, 1000000]
        #[schemars(range(min = 1, max = 1_000_000))]
        runs: u64,
    },
    /// Each parameter's range divided into as many equal strata as there are runs, one run in each; the strata of
    /// different parameters are paired at random [McKay, Beckman, Conover 1979].
    LatinHypercube {
        /// Number of runs. [1, 1000000]
        #[schemars(range(min = 1, max = 1_000_000))]
        runs: u64,
    },
}

/// What is varied.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Parameter {
    /// Its column in the table. Letters, digits and `_`, 1 to 60 of them.
    #[schemars(length(min = 1, max = 60))]
    pub name: String,
    /// Keys that take the value, as `kingpin run --set` names them: `unit.assist.lead_s`, `speed.speed_km_h`.
    #[schemars(length(min = 1, max = 32))]
    pub keys: Vec<String>,
    /// Whether the value replaces what stands there or multiplies it (every number of it, if it is a list).
    pub effect: Effect,
    /// The values.
    pub values: Values,
}

/// What a value does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Effect {
    /// Takes the place of what stands there.
    Replace,
    /// Multiplies what stands there.
    Scale,
}

/// Values of a parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Values {
    /// These numbers.
    List {
        /// The numbers.
        #[schemars(length(min = 1, max = 100_000))]
        values: Vec<f64>,
    },
    /// These texts, such as names of files.
    Texts {
        /// The texts.
        #[schemars(length(min = 1, max = 1000))]
        values: Vec<String>,
    },
    /// A range.
    Range {
        /// Its beginning.
        from: f64,
        /// Its end.
        to: f64,
        /// Number of values on a grid, both ends among them. [1, 100000]
        #[schemars(range(min = 1, max = 100_000))]
        steps: u64,
        /// How it is divided.
        scale: Scale,
    },
}

/// How a range is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// Evenly.
    Linear,
    /// Evenly in the logarithm.
    Logarithmic,
}

/// A figure kept of each run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Metric {
    /// A figure of the standard's procedure that the scenario is driven for, as `kingpin procedure` names it.
    Figure {
        /// Its column in the table. Letters, digits and `_`.
        #[schemars(length(min = 1, max = 60))]
        name: String,
        /// The figure: `torque at 0 g`, `steering sensitivity at 0 g`.
        figure: String,
    },
    /// A number of `summary.json`.
    Summary {
        /// Its column in the table. Letters, digits and `_`.
        #[schemars(length(min = 1, max = 60))]
        name: String,
        /// Where it stands: `peaks.lateral_acceleration_m_s2`, `force_tracking.0.error_rms_percent`.
        path: String,
    },
    /// A statistic of a signal.
    Signal {
        /// Its column in the table. Letters, digits and `_`.
        #[schemars(length(min = 1, max = 60))]
        name: String,
        /// The signal as `kingpin export` names it: `vehicle_state.roll_rad`.
        signal: String,
        /// The statistic.
        statistic: Statistic,
        /// From this time of the manoeuvre on, the warm-up not counted. [s], [0, 86400]
        #[schemars(range(min = 0.0, max = 86400.0))]
        from_s: f64,
        /// Up to this time of the manoeuvre; absent: to the end. [s]
        #[serde(skip_serializing_if = "Option::is_none")]
        to_s: Option<f64>,
    },
}

/// A statistic of a signal; values that are absent do not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Statistic {
    /// Smallest.
    Min,
    /// Largest.
    Max,
    /// Largest magnitude.
    Peak,
    /// Mean.
    Mean,
    /// Root mean square.
    Rms,
    /// Largest minus smallest.
    Range,
    /// The last.
    Last,
}

impl Metric {
    /// Its column.
    pub fn name(&self) -> &str {
        match self {
            Metric::Figure { name, .. } | Metric::Summary { name, .. } | Metric::Signal { name, .. } => name,
        }
    }
}

impl Values {
    /// How many values there are on a grid.
    pub fn count(&self) -> u64 {
        match self {
            Values::List { values } => values.len() as u64,
            Values::Texts { values } => values.len() as u64,
            Values::Range { steps, .. } => *steps,
        }
    }
}

impl Study {
    /// Number of runs.
    pub fn runs(&self) -> u64 {
        match self.sampling {
            Sampling::Grid => {
                self.parameter.iter().fold(1_u64, |runs, p| runs.saturating_mul(p.values.count()))
            }
            Sampling::Random { runs } | Sampling::LatinHypercube { runs } => runs,
        }
    }
}

/// Columns that every table has.
const COLUMNS: [&str; 3] = ["run", "seed", "error"];

impl Check for Study {
    fn check(&self, c: &mut Checker) {
        let plain = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '-';
        c.require(self.name.chars().all(plain), "name", "must consist of letters, digits, `_` and `-`");
        for (i, text) in self.set.iter().enumerate() {
            c.require(text.contains('='), &format!("set[{i}]"), "must be of the form path=value");
        }
        c.require(self.runs() <= RUNS_MAX, "sampling", "must not give more than 1000000 runs");
        let parameters =
            self.parameter.iter().enumerate().map(|(i, p)| (format!("parameter[{i}]"), &p.name[..]));
        let metrics = self.metric.iter().enumerate().map(|(i, m)| (format!("metric[{i}]"), m.name()));
        let mut seen: Vec<&str> = COLUMNS.to_vec();
        for (key, name) in parameters.chain(metrics) {
            c.within(&key, |c| {
                let word = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
                c.require(name.chars().all(word), "name", "must consist of letters, digits and `_`");
                c.require(
                    !seen.contains(&name),
                    "name",
                    "must be of one column only, and not run, seed or error",
                );
            });
            seen.push(name);
        }
        for (i, parameter) in self.parameter.iter().enumerate() {
            c.within(&format!("parameter[{i}]"), |c| parameter.check(c));
        }
        for (i, metric) in self.metric.iter().enumerate() {
            if let Metric::Signal { from_s, to_s: Some(to_s), .. } = metric {
                let key = format!("metric[{i}].to_s");
                c.require(to_s > from_s, &key, "must lie behind from_s");
            }
        }
    }
}

impl Check for Parameter {
    fn check(&self, c: &mut Checker) {
        let text = matches!(self.values, Values::Texts { .. });
        c.require(
            !(text && self.effect == Effect::Scale),
            "effect",
            "must be replace: texts cannot multiply",
        );
        if let Values::Range { from, to, steps, scale } = self.values {
            c.require(to >= from, "values.to", "must not be less than from");
            c.require(steps > 1 || to == from, "values.steps", "must be 2 or more for a range with two ends");
            let logarithmic = scale == Scale::Logarithmic;
            c.require(
                !logarithmic || from > 0.0,
                "values.from",
                "must be more than 0 on a logarithmic scale",
            );
        }
    }
}
