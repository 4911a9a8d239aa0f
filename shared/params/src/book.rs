//! The supervisor's book: values in force, their version, what was changed, and how to undo it.

use crate::{Fixed, Kind, LIST, Parameter, Values, by_path, closest};
use serde::{Deserialize, Serialize};

/// Most changes that can be undone.
const UNDO_MAX: usize = 256;

/// A value as it is asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Setting {
    /// A number.
    Number(f64),
    /// A switch.
    Switch(bool),
    /// The name of a choice, or anything typed.
    Text(String),
}

impl Setting {
    /// What somebody typed: a number, `on`, `off`, `true`, `false`, or a name.
    pub fn typed(text: &str) -> Setting {
        match text.trim() {
            "on" | "true" => Setting::Switch(true),
            "off" | "false" => Setting::Switch(false),
            other => other.parse().map_or_else(|_| Setting::Text(other.to_owned()), Setting::Number),
        }
    }
}

/// Why a change is refused.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// Which parameter, as it was named.
    pub path: String,
    /// The rule that was broken.
    pub reason: String,
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.path, self.reason)
    }
}

/// A change that was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Which parameter.
    pub path: String,
    /// Value before.
    pub from: f64,
    /// Value after.
    pub to: f64,
}

/// Values in force and how they came about.
#[derive(Debug, Clone)]
pub struct Book {
    defaults: Values,
    values: Values,
    version: u64,
    undo: Vec<Vec<(usize, f64)>>,
    fixed: Fixed,
}

impl Book {
    /// With the values that the configuration gives, as version 1.
    pub fn new(defaults: Values) -> Self {
        Book { defaults, values: defaults, version: 1, undo: Vec::new(), fixed: Fixed::NOTHING }
    }

    /// Goes on where a supervisor that died had left off.
    pub fn resume(defaults: Values, values: Values, version: u64) -> Self {
        Book { defaults, values, version, undo: Vec::new(), fixed: Fixed::NOTHING }
    }

    /// The same on a bench where some parameters change nothing.
    #[must_use]
    pub fn with_fixed(mut self, fixed: Fixed) -> Self {
        self.fixed = fixed;
        self
    }

    /// Why a parameter of the list cannot be changed on this bench.
    pub fn fixed(&self, index: usize) -> Option<&'static str> {
        self.fixed.reason(index)
    }

    /// Values in force.
    pub fn values(&self) -> &Values {
        &self.values
    }

    /// Values of the configuration.
    pub fn defaults(&self) -> &Values {
        &self.defaults
    }

    /// Raised with every accepted change.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// Changes that can be undone.
    pub fn undo_depth(&self) -> usize {
        self.undo.len()
    }

    /// What a setting of a parameter comes to.
    ///
    /// # Errors
    /// Unknown path, wrong type, no such thing on this bench, out of range.
    pub fn check(&self, path: &str, setting: &Setting) -> Result<(usize, f64), Refusal> {
        let refuse = |reason: String| Refusal { path: path.to_owned(), reason };
        let Some(parameter) = by_path(path) else {
            let hint = closest(path).map(|near| format!("; did you mean {near}?")).unwrap_or_default();
            return Err(refuse(format!("no such parameter{hint}")));
        };
        let index = parameter.id as usize;
        let value = typed(parameter, setting).map_err(&refuse)?;
        if let Some(reason) = self.fixed.check(index, &self.values, value) {
            return Err(refuse(reason.to_owned()));
        }
        let (min, max) = parameter.range(self.defaults[index]);
        if !(min..=max).contains(&value) {
            let unit = if parameter.unit == "1" { String::new() } else { format!(" {}", parameter.unit) };
            return Err(refuse(format!("{value} is out of range: must be in [{min}, {max}]{unit}")));
        }
        Ok((index, value))
    }

    /// Makes several changes at once or, if one is refused, none. `state`: the bench's, by its code; `None`
    /// leaves the state out of account (a scenario's own changes).
    ///
    /// # Errors
    /// Every refusal.
    pub fn set(
        &mut self,
        settings: &[(String, Setting)],
        state: Option<u64>,
    ) -> Result<Vec<Change>, Vec<Refusal>> {
        let wanted = self.admit(settings, state)?;
        let before: Vec<_> = wanted.iter().map(|&(index, _)| (index, self.values[index])).collect();
        let changes = self.put(&wanted);
        if self.undo.len() == UNDO_MAX {
            self.undo.remove(0);
        }
        self.undo.push(before);
        Ok(changes)
    }

    /// The same without a place among what can be undone: steering by hand, many times a second.
    ///
    /// # Errors
    /// Every refusal.
    pub fn steer(&mut self, settings: &[(String, Setting)], state: Option<u64>) -> Result<(), Vec<Refusal>> {
        let wanted = self.admit(settings, state)?;
        if wanted.iter().any(|&(index, value)| self.values[index] != value) {
            self.put(&wanted);
        }
        Ok(())
    }

    /// Takes the last change back. `None` if there is none.
    ///
    /// # Errors
    /// When the state forbids it.
    pub fn undo(&mut self, state: Option<u64>) -> Result<Option<Vec<Change>>, Vec<Refusal>> {
        let Some(last) = self.undo.last() else { return Ok(None) };
        let refused: Vec<_> = last.iter().filter_map(|&(index, _)| forbidden(index, state)).collect();
        if !refused.is_empty() {
            return Err(refused);
        }
        let mut last = self.undo.pop().unwrap_or_default();
        // A parameter that one change set twice goes back to what it was before the first.
        last.reverse();
        Ok(Some(self.put(&last)))
    }

    fn admit(
        &self,
        settings: &[(String, Setting)],
        state: Option<u64>,
    ) -> Result<Vec<(usize, f64)>, Vec<Refusal>> {
        let mut refused = Vec::new();
        let mut wanted = Vec::new();
        for (path, setting) in settings {
            match self.check(path, setting) {
                Ok((index, value)) => {
                    // A value that is in force already changes nothing, whatever the state.
                    if self.values[index] != value {
                        refused.extend(forbidden(index, state));
                    }
                    wanted.push((index, value));
                }
                Err(refusal) => refused.push(refusal),
            }
        }
        if refused.is_empty() { Ok(wanted) } else { Err(refused) }
    }

    fn put(&mut self, wanted: &[(usize, f64)]) -> Vec<Change> {
        let changes = wanted
            .iter()
            .map(|&(index, to)| {
                let from = std::mem::replace(&mut self.values[index], to);
                Change { path: LIST[index].path.to_owned(), from, to }
            })
            .collect();
        self.version += 1;
        changes
    }
}

fn forbidden(index: usize, state: Option<u64>) -> Option<Refusal> {
    let parameter = &LIST[index];
    let state = state.filter(|&state| !parameter.states.allow(state))?;
    Some(Refusal {
        path: parameter.path.to_owned(),
        reason: format!(
            "not in state {}: may be changed in {} only",
            regions::state_name(state),
            parameter.states.text()
        ),
    })
}

/// A setting as the parameter's number.
fn typed(parameter: &Parameter, setting: &Setting) -> Result<f64, String> {
    match (parameter.kind, setting) {
        (_, Setting::Number(number)) if !number.is_finite() => {
            Err(format!("{number} is not a finite number"))
        }
        (Kind::Number, Setting::Number(number)) => Ok(*number),
        (Kind::Switch, Setting::Switch(on)) => Ok(f64::from(u8::from(*on))),
        (Kind::Switch, Setting::Number(number)) if *number == 0.0 || *number == 1.0 => Ok(*number),
        (Kind::Choice(names), Setting::Text(text)) => {
            let found = names.iter().position(|name| name == text);
            found.map(|at| at as f64).ok_or_else(|| format!("`{text}` is not one of {}", names.join(", ")))
        }
        // `off` is a switch to whoever types it, and the first of many choices.
        (Kind::Choice(names), Setting::Switch(false)) if names.first() == Some(&"off") => Ok(0.0),
        (Kind::Choice(names), Setting::Number(number)) if number.fract() == 0.0 => {
            if (0.0..names.len() as f64).contains(number) {
                Ok(*number)
            } else {
                Err(format!("{number} is out of range: must be one of {}", names.join(", ")))
            }
        }
        (kind, setting) => {
            let got = match setting {
                Setting::Number(number) => format!("the number {number}"),
                Setting::Switch(on) => format!("the switch value {}", if *on { "on" } else { "off" }),
                Setting::Text(text) => format!("the text `{text}`"),
            };
            let wanted = match kind {
                Kind::Number => format!("a number in {}", parameter.unit),
                Kind::Switch => "on or off".to_owned(),
                Kind::Choice(names) => format!("one of {}", names.join(", ")),
            };
            Err(format!("wrong type: {got} was given, must be {wanted}"))
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::Id;

    const RUNNING: u64 = 4;
    const TRIPPED: u64 = 8;

    fn book() -> Book {
        Book::new(crate::defaults(&config::ResolvedBench::load("growing_slalom_80", &[]).unwrap()))
    }

    fn set(book: &mut Book, path: &str, setting: Setting, state: u64) -> Result<Vec<Change>, String> {
        book.set(&[(path.to_owned(), setting)], Some(state))
            .map_err(|refused| refused.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))
    }

    #[test]
    fn changes_are_refused_with_the_reason_and_leave_no_trace() {
        let mut book = book();
        let before = *book.values();
        for (path, setting, state, said) in [
            ("control.force.bandwidth_rad_s", Setting::Number(1e4), RUNNING, "must be in [10, 300] rad/s"),
            ("control.force.bandwidth_rad_s", Setting::Number(f64::NAN), RUNNING, "not a finite number"),
            (
                "control.force.bandwidth_rad_s",
                Setting::Text("fast".into()),
                RUNNING,
                "wrong type: the text `fast`",
            ),
            ("control.force.bandwidth_rad_s", Setting::Switch(true), RUNNING, "must be a number in rad/s"),
            ("control.switches.delay_compensation", Setting::Number(0.5), RUNNING, "must be on or off"),
            ("control.switches.force_conversion", Setting::Switch(false), RUNNING, "not in state running"),
            ("control.force.bandwidth_rad_s", Setting::Number(90.0), TRIPPED, "not in state tripped"),
            ("human.mode", Setting::Text("feet".into()), RUNNING, "not one of off, angle, torque"),
            ("human.mode", Setting::Number(3.0), RUNNING, "must be one of"),
            (
                "control.force.bandwith_rad_s",
                Setting::Number(90.0),
                RUNNING,
                "did you mean control.force.bandwidth_rad_s",
            ),
        ] {
            let refused = set(&mut book, path, setting, state).unwrap_err();
            assert!(refused.contains(said), "{path}: {refused}");
        }
        assert_eq!((book.values(), book.version(), book.undo_depth()), (&before, 1, 0));
    }

    #[test]
    fn several_changes_are_made_all_or_none() {
        let mut book = book();
        let wish = |scale: f64| {
            vec![
                ("tyre.front.friction_scale".to_owned(), Setting::Number(0.4)),
                ("tyre.rear.friction_scale".to_owned(), Setting::Number(scale)),
            ]
        };
        assert_eq!(book.set(&wish(9.0), Some(RUNNING)).unwrap_err().len(), 1);
        assert_eq!(crate::value(book.values(), Id::FrontFriction), 1.0);
        assert_eq!(book.set(&wish(0.5), Some(RUNNING)).unwrap().len(), 2);
        assert_eq!(crate::value(book.values(), Id::RearFriction), 0.5);
        assert_eq!(book.undo(Some(RUNNING)).unwrap().unwrap().len(), 2);
        assert_eq!(book.values(), book.defaults());
        assert_eq!(book.version(), 3);
        assert_eq!(book.undo(Some(RUNNING)), Ok(None));
    }

    #[test]
    fn undo_goes_back_step_by_step_and_obeys_the_state() {
        let mut book = book();
        let default = crate::value(book.defaults(), Id::ForceBandwidth);
        for value in [90.0, 80.0, 70.0] {
            set(&mut book, "control.force.bandwidth_rad_s", Setting::Number(value), RUNNING).unwrap();
        }
        assert!(book.undo(Some(TRIPPED)).is_err());
        for expected in [80.0, 90.0, default] {
            book.undo(Some(RUNNING)).unwrap();
            assert_eq!(crate::value(book.values(), Id::ForceBandwidth), expected);
        }
    }

    #[test]
    fn steering_by_hand_is_not_undone() {
        let mut book = book();
        let wish = [("human.steering_wheel_angle_rad".to_owned(), Setting::Number(0.3))];
        book.steer(&wish, Some(RUNNING)).unwrap();
        let version = book.version();
        book.steer(&wish, Some(RUNNING)).unwrap();
        assert_eq!((book.version(), book.undo_depth()), (version, 0), "the same angle again is no change");
    }

    #[test]
    fn what_is_typed_becomes_a_setting() {
        assert_eq!(Setting::typed(" 1e2 "), Setting::Number(100.0));
        assert_eq!(Setting::typed("off"), Setting::Switch(false));
        assert_eq!(Setting::typed("torque"), Setting::Text("torque".to_owned()));
    }
}
