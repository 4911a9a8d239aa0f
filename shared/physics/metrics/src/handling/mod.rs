//! Handling and steering-feel figures by the standards' definitions, each with the conditions it was taken under.
//!
//! A procedure takes [`Signals`] of one run and gives an [`Assessment`]: the conditions that the standard
//! asks for with the values achieved, the figures, and, where a rule states one, the verdict. A figure whose
//! conditions were not met is withheld with the reason.
//!
//! Signs and frames: ISO 8855; a left turn has positive hand-wheel angle, torque, yaw rate and lateral
//! acceleration. Where a clause's wording is open or not public, the definition used stands with the figure's
//! function. Sources: ISO 4138:2021, ISO 7401:2011, ISO 13674-1:2023, ISO 3888-1:2018, ISO 3888-2:2011,
//! ISO 19365:2016, FMVSS 126 (49 CFR 571.126); Norman, SAE 840069 for on-centre figures.

mod dwell;
mod lane_change;
mod on_centre;
mod release;
mod spectrum;
mod steady;
mod transient;

pub use dwell::sine_with_dwell;
pub use lane_change::{Gate, Layout, lane_change};
pub use on_centre::{slow_ramp, weave};
pub use release::release;
pub use spectrum::{FrequencyResponse, frequency_response};
pub use steady::{SteadyMethod, steady_turn};
pub use transient::{random_steer, step_steer};

/// Signals of a run, all sampled together; a sample that is absent is NaN.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Signals {
    /// Time between samples. \[s\]
    pub sample_time_s: f64,
    /// Hand-wheel angle. \[rad\]
    pub hand_wheel_angle_rad: Vec<f64>,
    /// Hand-wheel torque, the driver's. [N·m]
    pub hand_wheel_torque_n_m: Vec<f64>,
    /// Lateral acceleration. [m/s²]
    pub lateral_acceleration_m_s2: Vec<f64>,
    /// Yaw rate. [rad/s]
    pub yaw_rate_rad_s: Vec<f64>,
    /// Yaw angle. \[rad\]
    pub yaw_rad: Vec<f64>,
    /// Roll angle, right side down positive. \[rad\]
    pub roll_rad: Vec<f64>,
    /// Side-slip angle at the centre of gravity. \[rad\]
    pub side_slip_rad: Vec<f64>,
    /// Speed along the car. [m/s]
    pub speed_m_s: Vec<f64>,
    /// Position of the centre of gravity, forward at the start. \[m\]
    pub x_m: Vec<f64>,
    /// Position of the centre of gravity, left at the start. \[m\]
    pub y_m: Vec<f64>,
}

impl Signals {
    /// Samples that all signals have.
    pub fn len(&self) -> usize {
        self.columns().iter().map(|column| column.len()).min().unwrap_or(0)
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn columns(&self) -> [&Vec<f64>; 10] {
        [
            &self.hand_wheel_angle_rad,
            &self.hand_wheel_torque_n_m,
            &self.lateral_acceleration_m_s2,
            &self.yaw_rate_rad_s,
            &self.yaw_rad,
            &self.roll_rad,
            &self.side_slip_rad,
            &self.speed_m_s,
            &self.x_m,
            &self.y_m,
        ]
    }

    /// The samples of a range, as signals of their own.
    pub fn part(&self, range: std::ops::Range<usize>) -> Signals {
        let cut =
            |column: &Vec<f64>| column[range.start.min(column.len())..range.end.min(column.len())].to_vec();
        Signals {
            sample_time_s: self.sample_time_s,
            hand_wheel_angle_rad: cut(&self.hand_wheel_angle_rad),
            hand_wheel_torque_n_m: cut(&self.hand_wheel_torque_n_m),
            lateral_acceleration_m_s2: cut(&self.lateral_acceleration_m_s2),
            yaw_rate_rad_s: cut(&self.yaw_rate_rad_s),
            yaw_rad: cut(&self.yaw_rad),
            roll_rad: cut(&self.roll_rad),
            side_slip_rad: cut(&self.side_slip_rad),
            speed_m_s: cut(&self.speed_m_s),
            x_m: cut(&self.x_m),
            y_m: cut(&self.y_m),
        }
    }
}

/// What the figures need to know of the car.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarFacts {
    /// Hand-wheel angle over mean road-wheel angle near straight running. \[1\]
    pub steering_ratio: f64,
    /// Wheelbase. \[m\]
    pub wheelbase_m: f64,
    /// Mass. \[kg\]
    pub mass_kg: f64,
    /// Width without mirrors. \[m\]
    pub width_m: f64,
    /// Length from the centre of gravity forward to the bumper. \[m\]
    pub front_m: f64,
    /// Length from the centre of gravity rearward to the bumper. \[m\]
    pub rear_m: f64,
}

/// A condition of the standard with what was achieved.
#[derive(Debug, Clone, PartialEq)]
pub struct Condition {
    /// What.
    pub name: &'static str,
    /// Value achieved, in `unit`; NaN if it could not be told.
    pub achieved: f64,
    /// Smallest value allowed.
    pub least: f64,
    /// Largest value allowed.
    pub most: f64,
    /// Unit of the three.
    pub unit: &'static str,
}

impl Condition {
    /// Whether the value achieved is allowed.
    pub fn met(&self) -> bool {
        self.achieved >= self.least && self.achieved <= self.most
    }
}

impl std::fmt::Display for Condition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Condition { name, achieved, least, most, unit } = self;
        let unit = if *unit == "1" { String::new() } else { format!(" {unit}") };
        write!(f, "{name} {}{unit}, ", rounded(*achieved))?;
        match (least.is_finite(), most.is_finite()) {
            (true, true) => write!(f, "to lie in {} to {}", rounded(*least), rounded(*most)),
            (true, false) => write!(f, "at least {}", rounded(*least)),
            _ => write!(f, "at most {}", rounded(*most)),
        }
    }
}

/// Four decimals at most.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// A figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Name, a standard term.
    pub name: &'static str,
    /// Value, or the reason why there is none.
    pub value: Result<f64, String>,
    /// Unit.
    pub unit: &'static str,
}

/// A figure against a rule that has a limit.
#[derive(Debug, Clone, PartialEq)]
pub struct Ruling {
    /// The rule.
    pub rule: &'static str,
    /// Whether it is kept, or the reason why that cannot be told.
    pub kept: Result<bool, String>,
}

/// What a run says by one procedure.
#[derive(Debug, Clone, PartialEq)]
pub struct Assessment {
    /// Procedure and standard.
    pub procedure: &'static str,
    /// Conditions with the values achieved.
    pub conditions: Vec<Condition>,
    /// Figures.
    pub figures: Vec<Figure>,
    /// Rules with a limit.
    pub rulings: Vec<Ruling>,
}

impl Assessment {
    fn new(procedure: &'static str) -> Self {
        Assessment { procedure, conditions: Vec::new(), figures: Vec::new(), rulings: Vec::new() }
    }

    /// The figure of that name, None if withheld or not of this procedure.
    pub fn value(&self, name: &str) -> Option<f64> {
        self.figures.iter().find(|figure| figure.name == name)?.value.as_ref().ok().copied()
    }

    /// Whether all conditions are met.
    pub fn valid(&self) -> bool {
        self.conditions.iter().all(Condition::met)
    }

    /// Adds a condition, with `least` and `most` as limits (infinite: none).
    fn condition(&mut self, name: &'static str, achieved: f64, least: f64, most: f64, unit: &'static str) {
        self.conditions.push(Condition { name, achieved, least, most, unit });
    }

    /// Adds a figure; None is "could not be found", and any unmet condition withholds it.
    fn figure(&mut self, name: &'static str, value: Option<f64>, unit: &'static str) {
        let unmet: Vec<String> =
            self.conditions.iter().filter(|c| !c.met()).map(ToString::to_string).collect();
        let value = if unmet.is_empty() {
            value.filter(|v| v.is_finite()).ok_or_else(|| "could not be found in the signals".to_owned())
        } else {
            Err(format!("condition not met: {}", unmet.join("; ")))
        };
        self.figures.push(Figure { name, value, unit });
    }

    /// Adds a rule on figures already added.
    fn rule(&mut self, rule: &'static str, names: &[&str], kept: impl FnOnce(&[f64]) -> bool) {
        let values: Result<Vec<f64>, String> = names
            .iter()
            .map(|name| {
                let figure = self.figures.iter().find(|figure| figure.name == *name);
                figure.map_or_else(|| Err(format!("{name} is not there")), |f| f.value.clone())
            })
            .collect();
        self.rulings.push(Ruling { rule, kept: values.map(|values| kept(&values)) });
    }
}

/// Mean of the finite values of a range.
fn mean_of(values: &[f64], range: std::ops::Range<usize>) -> f64 {
    crate::statistics::mean(values.get(range).unwrap_or(&[]))
}

/// Time, in samples, at which a signal passes a level, between two samples; the first such.
fn first_passage(values: &[f64], level: f64, rising: bool) -> Option<f64> {
    values.windows(2).enumerate().find_map(|(i, pair)| {
        let (before, after) = (pair[0] - level, pair[1] - level);
        let passes = if rising { before < 0.0 && after >= 0.0 } else { before > 0.0 && after <= 0.0 };
        passes.then(|| i as f64 + before / (before - after))
    })
}

#[cfg(test)]
mod tests {
    /// A car for the procedures' tests.
    pub(super) const CAR: super::CarFacts = super::CarFacts {
        steering_ratio: 16.0,
        wheelbase_m: 2.7,
        mass_kg: 1500.0,
        width_m: 1.8,
        front_m: 2.2,
        rear_m: 2.3,
    };
}
