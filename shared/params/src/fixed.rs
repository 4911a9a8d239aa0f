//! Parameters that would change nothing on a bench, and why: they are refused instead of silently ignored.
//!
//! `unit.*` tunes the built-in column EPS. A unit from a model file has parameters of its own, set before the run
//! (`[model.set]` in the unit's file): the composer folds them into the equations, so they cannot move while it runs.

use crate::{Id, LIST, Values};
use config::ResolvedBench;
use config::unit::Assist;

/// For each parameter of the list why it cannot be changed on this bench; `None` where it can.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fixed([Option<&'static str>; 62]);

impl Fixed {
    /// Everything can be changed.
    pub const NOTHING: Fixed = Fixed([None; 62]);

    /// What is fixed on a bench.
    pub fn on(resolved: &ResolvedBench) -> Self {
        const MODEL: &str = "the steering unit is a model file, whose parameters are set before the run ([model.set] in \
                             the unit's file); only the built-in unit can be tuned while it runs";
        const NO_ASSIST: &str = "the steering unit has no assist";
        let mut fixed = Self::NOTHING;
        let mut fix = |ids: &[Id], reason| ids.iter().for_each(|id| fixed.0[*id as usize] = Some(reason));
        let assist = [Id::AssistScale, Id::AssistDampingScale, Id::AssistReturnScale];
        if resolved.unit.model.is_some() {
            fix(&assist, MODEL);
            fix(&[Id::RackFriction, Id::ColumnFriction], MODEL);
        } else if matches!(resolved.unit.assist, Assist::None {}) {
            fix(&assist, NO_ASSIST);
        }
        fixed
    }

    /// Why a parameter of the list cannot be changed.
    pub fn reason(&self, index: usize) -> Option<&'static str> {
        self.0.get(index).copied().flatten()
    }

    /// Paths of what is fixed.
    pub fn paths(&self) -> Vec<&'static str> {
        LIST.iter().filter(|p| self.reason(p.id as usize).is_some()).map(|p| p.path).collect()
    }

    /// Every change from `base` to `wanted` that this bench does not make, with the reason.
    pub(crate) fn check(&self, index: usize, values: &Values, wanted: f64) -> Option<&'static str> {
        self.reason(index).filter(|_| values[index] != wanted)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::{Book, Setting, defaults};

    fn refused(overrides: &[&str], path: &str) -> Option<String> {
        let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
        let bench = ResolvedBench::load("slalom_120", &overrides).unwrap();
        let mut book = Book::new(defaults(&bench)).with_fixed(Fixed::on(&bench));
        let before = (*book.values(), book.version());
        let found =
            book.set(&[(path.to_owned(), Setting::Number(0.5))], None).err().map(|r| r[0].reason.clone());
        assert!(found.is_none() || before == (*book.values(), book.version()));
        found
    }

    #[test]
    fn what_a_unit_does_not_have_is_refused_with_the_reason() {
        assert_eq!(refused(&[], "unit.assist_scale"), None);
        for path in ["unit.assist_scale", "unit.rack_friction_n", "unit.column_friction_n_m"] {
            let reason = refused(&["unit_file=rack_eps"], path).unwrap();
            assert!(reason.contains("[model.set]"), "{path}: {reason}");
        }
        assert_eq!(refused(&["unit_file=rack_eps"], "control.steer.torque_gain"), None);
        let reason = refused(&[r#"unit.assist={type="none"}"#], "unit.assist_damping_scale").unwrap();
        assert!(reason.contains("no assist"), "{reason}");
        assert_eq!(refused(&[r#"unit.assist={type="none"}"#], "unit.rack_friction_n"), None);
    }

    #[test]
    fn a_value_in_force_is_no_change() {
        let bench = ResolvedBench::load("slalom_120", &["unit_file=rack_eps".to_owned()]).unwrap();
        let values = defaults(&bench);
        let mut book = Book::new(values).with_fixed(Fixed::on(&bench));
        let same = Setting::Number(values[Id::RackFriction as usize]);
        assert!(book.set(&[("unit.rack_friction_n".to_owned(), same)], None).is_ok());
    }
}
