//! A scenario's own changes: a pure function of the tick, so that lockstep runs are equal however driven.

use crate::{Book, Fixed, Refusal, Setting, Values, defaults};
use config::ResolvedBench;
use config::live::ParameterChange;

/// Values by tick.
#[derive(Debug, Clone)]
pub struct Schedule {
    /// From tick on, these values with this version; the first from tick 0.
    steps: Vec<(u64, u64, Values)>,
}

impl Schedule {
    /// Of a resolved scenario.
    ///
    /// # Errors
    /// Every change that is refused, named by its place in the file.
    pub fn new(resolved: &ResolvedBench) -> Result<Self, Vec<Refusal>> {
        let scenario = &resolved.scenario;
        let mut book = Book::new(defaults(resolved)).with_fixed(Fixed::on(resolved));
        let mut steps = vec![(0, book.version(), *book.values())];
        let mut refused = Vec::new();
        for (place, change) in scenario.parameters.iter().flatten().enumerate() {
            let at = ((change.at_s() + scenario.warm_up_s) / scenario.timing.period_s()).round();
            if at < 0.0 {
                let reason = format!("at_s = {}: lies before the begin of the run", change.at_s());
                refused.push(Refusal { path: format!("parameters[{place}]"), reason });
                continue;
            }
            // The state is left out of account: whoever writes the scenario knows when it is where.
            let made = match change {
                ParameterChange::Set { path, value, .. } => {
                    book.set(&[(path.clone(), Setting::Number(*value))], None).map(drop)
                }
                ParameterChange::Undo { .. } => match book.undo(None) {
                    Ok(Some(_)) => Ok(()),
                    Ok(None) => Err(vec![Refusal {
                        path: "undo".to_owned(),
                        reason: "there is no change to undo at this time".to_owned(),
                    }]),
                    Err(refused) => Err(refused),
                },
            };
            match made {
                Ok(()) => {
                    let step = (at as u64, book.version(), *book.values());
                    match steps.last_mut() {
                        Some(last) if last.0 == step.0 => *last = step,
                        _ => steps.push(step),
                    }
                }
                Err(reasons) => {
                    refused.extend(reasons.into_iter().map(|r| Refusal {
                        path: format!("parameters[{place}]: {}", r.path),
                        reason: r.reason,
                    }))
                }
            }
        }
        if refused.is_empty() { Ok(Schedule { steps }) } else { Err(refused) }
    }

    /// Version and values in force at tick `n`.
    pub fn at(&self, n: u64) -> (u64, &Values) {
        let index = self.steps.partition_point(|step| step.0 <= n).saturating_sub(1);
        let (_, version, values) = &self.steps[index];
        (*version, values)
    }

    /// The ticks at which something changes, with version and values.
    pub fn changes(&self) -> impl Iterator<Item = (u64, u64, &Values)> {
        self.steps.iter().skip(1).map(|(tick, version, values)| (*tick, *version, values))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::{Id, value};

    fn load(changes: &str) -> ResolvedBench {
        let overrides = [format!("parameters={changes}"), "warm_up_s=1.0".to_owned()];
        ResolvedBench::load("growing_slalom_80", &overrides).unwrap()
    }

    #[test]
    fn values_hold_from_their_tick_on() {
        let schedule = Schedule::new(&load(
            r#"[{type="set", at_s=-0.5, path="unit.assist_scale", value=0.5},
                {type="set", at_s=2.0, path="unit.assist_scale", value=0.7}, {type="undo", at_s=2.001}]"#,
        ))
        .unwrap();
        let scale = |n: u64| value(schedule.at(n).1, Id::AssistScale);
        assert_eq!([0, 499, 500, 2999, 3000, 3001, 90000].map(scale), [1.0, 1.0, 0.5, 0.5, 0.7, 0.5, 0.5]);
        assert_eq!(schedule.at(3001).0, 4);
    }

    #[test]
    fn what_is_refused_is_named_by_its_place() {
        let refused = Schedule::new(&load(
            r#"[{type="undo", at_s=0.0}, {type="set", at_s=1.0, path="unit.assist_scal", value=0.5},
                {type="set", at_s=2.0, path="unit.assist_scale", value=50.0}]"#,
        ))
        .unwrap_err();
        let text: Vec<_> = refused.iter().map(ToString::to_string).collect();
        assert_eq!(text.len(), 3, "{text:?}");
        assert!(text[0].starts_with("parameters[0]: undo"), "{}", text[0]);
        assert!(text[1].contains("did you mean unit.assist_scale"), "{}", text[1]);
        assert!(text[2].contains("out of range"), "{}", text[2]);
    }
}
