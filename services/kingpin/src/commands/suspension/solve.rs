//! `suspension solve`: every row of a CSV.

use super::arguments::{SuspensionMethod, SuspensionSolveArgs};
use super::columns::{Column, columns};
use super::input::{Row, Rows, read};
use super::{Wrong, assemble, load_axle};
use crate::commands::log::write_whole;
use crate::exit::Exit;
use crate::output;
use config::axle::Axle;
use multibody::methods::{MappedSide, OlderForces, OlderMethods};
use multibody::{Reason, Status, Suspension, SuspensionInput, SuspensionOutput};
use std::io::Write;

/// Most failed rows that are told one by one.
const TOLD_MAX: usize = 100;

/// A solved row.
pub struct Solved {
    /// Step.
    pub step: f64,
    /// What was asked.
    pub input: SuspensionInput,
    /// The multibody solution: as the axle is; with a stabiliser, also without it. Empty where not asked for.
    pub variants: Vec<SuspensionOutput>,
    /// The older methods' forces.
    pub older: OlderForces,
    /// The pose by the maps, where asked for.
    pub mapped: Option<[MappedSide; 2]>,
    /// 0 solved, else the reason's number.
    pub status: u32,
}

/// An axle's solvers.
pub struct Solver {
    variants: Vec<(&'static str, Suspension)>,
    older: Option<OlderMethods>,
    design: SuspensionOutput,
    /// Starting again from design forgets nothing: no friction.
    restartable: bool,
}

impl Solver {
    /// Assembles what a method needs.
    ///
    /// # Errors
    /// What is wrong with the axle, or that its springs cannot be locked.
    pub fn new(
        reference: &str,
        axle: &Axle,
        method: SuspensionMethod,
        lock_springs: bool,
    ) -> Result<Self, Wrong> {
        let older = method != SuspensionMethod::Multibody;
        let older = older
            .then(|| OlderMethods::new(axle))
            .transpose()
            .map_err(|error| format!("{reference}: {error}"))?;
        let mut first = assemble(reference, axle)?;
        let mut design = SuspensionOutput::default();
        first.step(&SuspensionInput::DESIGN, &mut design);
        let mut variants = Vec::new();
        if matches!(method, SuspensionMethod::Multibody | SuspensionMethod::All) {
            let bar = axle.stabiliser.is_some();
            variants.push((if bar { "with stabiliser" } else { "" }, first));
            if bar {
                variants.push(("without stabiliser", assemble(reference, &axle.without_stabiliser())?));
            }
        }
        if lock_springs {
            let lengths = design.side.map(|side| side.spring_length_m);
            for (_, solver) in &mut variants {
                if !solver.lock_springs(Some(lengths)) {
                    return Err(format!("{reference}: --lock-springs: needs an axle with bushings"));
                }
            }
        }
        Ok(Self { variants, older, design, restartable: axle.kingpin_friction.is_none() })
    }

    /// The unloaded pose at design.
    pub fn design(&self) -> &SuspensionOutput {
        &self.design
    }

    /// Solves a row; says of each variant that could not be solved why.
    pub fn solve(&mut self, row: &Row, wrong: &mut Vec<String>) -> Solved {
        let mut solved = Solved {
            step: row.step,
            input: row.input,
            variants: Vec::with_capacity(self.variants.len()),
            older: OlderForces::default(),
            mapped: None,
            status: 0,
        };
        for (name, solver) in &mut self.variants {
            let mut output = SuspensionOutput::default();
            solver.step(&row.input, &mut output);
            if output.status != Status::Converged && self.restartable {
                // The straight way from the row before may lead through poses that do not exist.
                let mut before = vec![0.0; solver.state_len()];
                solver.save_state(&mut before);
                let held = output;
                solver.reset();
                solver.step(&row.input, &mut output);
                if output.status != Status::Converged {
                    solver.load_state(&before);
                    output = held;
                }
            }
            if let Status::Held { reason, constraint } = output.status {
                let at = constraint.and_then(|index| solver.constraint_name(index));
                let at = at.map_or_else(String::new, |at| format!(": {at}, off by {:.1e}", output.residual));
                let name = if name.is_empty() { String::new() } else { format!(" ({name})") };
                wrong.push(format!("{}: step {}{name}: {}{at}", row.line, row.step, reason.text()));
            }
            if solved.status == 0 {
                solved.status = output.status.code();
            }
            solved.variants.push(output);
        }
        if let Some(older) = &self.older {
            let input = &row.input;
            let maps = older.maps();
            solved.older = older.evaluate(input);
            solved.mapped = Some([0, 1].map(|k| maps.at(k, input.wheel_height_m[k], input.rack_m)));
            let within = |x: f64, range: [f64; 2]| x >= range[0] && x <= range[1];
            let mapped = within(input.rack_m, maps.rack_range_m())
                && input.wheel_height_m.iter().all(|z| within(*z, maps.travel_range_m()));
            if !mapped && self.variants.is_empty() {
                solved.status = Reason::OutOfReach as u32;
                wrong.push(format!("{}: step {}: beyond the alignment maps", row.line, row.step));
            }
        }
        solved
    }

    /// Solves all rows, in file order; tells on standard error what could not be solved.
    pub fn solve_all(&mut self, rows: &Rows) -> (Vec<Solved>, usize) {
        let mut wrong = Vec::new();
        let solved: Vec<Solved> = rows.rows.iter().map(|row| self.solve(row, &mut wrong)).collect();
        for line in wrong.iter().take(TOLD_MAX) {
            output::note(format!("{}:{line}", rows.name));
        }
        if wrong.len() > TOLD_MAX {
            output::note(format!("... and {} more", wrong.len() - TOLD_MAX));
        }
        let failed = solved.iter().filter(|row| row.status != 0).count();
        (solved, failed)
    }
}

/// Writes header and rows; numbers in the shortest form that reads back as the same number.
pub fn write_csv(
    to: &mut dyn Write,
    header: &[String],
    rows: impl Iterator<Item = Vec<String>>,
) -> Result<(), String> {
    writeln!(to, "{}", header.join(",")).map_err(|e| e.to_string())?;
    for row in rows {
        writeln!(to, "{}", row.join(",")).map_err(|e| e.to_string())?;
    }
    Ok(())
}

/// A number in the shortest form that reads back as the same number.
pub fn number(value: f64) -> String {
    let text = format!("{value:?}");
    text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
}

/// `kingpin suspension solve`.
pub fn solve(args: &SuspensionSolveArgs) -> Result<Exit, Wrong> {
    // Both files are looked at before either ends the command, so that all that is wrong is told at once.
    let axle = load_axle(&args.axle);
    let rows = read(&args.input, !args.lock_springs, |_| false);
    let (axle, rows) = match (axle, rows) {
        (Ok(axle), Ok(rows)) => (axle, rows),
        (axle, rows) => {
            let wrong: Vec<Wrong> = [axle.err(), rows.err()].into_iter().flatten().collect();
            return Err(wrong.join("\n"));
        }
    };
    let mut solver = Solver::new(&args.axle, &axle, args.method, args.lock_springs)?;
    let columns: Vec<Column> = columns(&axle, args.method, solver.design());
    let (solved, failed) = solver.solve_all(&rows);
    let mut header: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    header.push("status".to_owned());
    let lines = solved.iter().map(|row| {
        let mut line: Vec<String> = columns.iter().map(|c| number((c.read)(row))).collect();
        line.push(row.status.to_string());
        line
    });
    write_whole(&args.output, |to| write_csv(to, &header, lines))?;
    if failed > 0 {
        output::note(format!("{failed} of {} rows not solved; see their status", solved.len()));
        return Ok(Exit::Failed);
    }
    Ok(Exit::Done)
}

#[cfg(test)]
mod tests {
    use super::number;

    #[test]
    fn numbers_read_back_as_they_were() {
        assert_eq!([0.0, -0.0, 3.0, 1e-20, 0.1].map(number), ["0", "-0", "3", "1e-20", "0.1"]);
        for value in [1.0 / 3.0, 6.02e23, -5e-324, f64::MAX] {
            assert_eq!(number(value).parse::<f64>().unwrap().to_bits(), value.to_bits());
        }
    }
}
