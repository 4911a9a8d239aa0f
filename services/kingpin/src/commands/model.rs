//! `model`: functional models away from any bench: checked, described, composed, drawn, run, compared.

mod arguments;
mod compare;
mod series;
mod simulate;

pub use arguments::{ModelArgs, ModelCommand};

use crate::exit::Exit;
use crate::output;
use arguments::{CheckArgs, ComposeArgs, DescribeArgs, DrawArgs};
use config::ModelFiles;
use functional_model::{Model, ModelError, OperatingPoint, Parameters, System};
use serde_json::{Value, json};
use std::path::Path;

/// What ends a command early: all that is wrong, ready to print.
type Wrong = String;

/// `kingpin model`.
pub fn model(args: &ModelArgs) -> Exit {
    let ended = match &args.command {
        ModelCommand::Check(args) => check(args),
        ModelCommand::Describe(args) => describe(args),
        ModelCommand::Compose(args) => compose(args),
        ModelCommand::Simulate(args) => simulate::simulate(args),
        ModelCommand::Plot(args) => simulate::plot(args),
        ModelCommand::Compare(args) => compare::compare(args),
        ModelCommand::Draw(args) => draw(args),
    };
    ended.unwrap_or_else(|wrong| {
        output::note(wrong);
        Exit::BadInput
    })
}

fn lines(errors: &[ModelError]) -> Wrong {
    errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

/// Splits `name=value`.
fn pair<'a>(option: &str, text: &'a str) -> Result<(&'a str, &'a str), Wrong> {
    let (name, value) = text.split_once('=').ok_or_else(|| format!("{option} {text}: must be NAME=VALUE"))?;
    Ok((name.trim(), value.trim()))
}

/// Splits `name=number`.
fn number<'a>(option: &str, text: &'a str) -> Result<(&'a str, f64), Wrong> {
    let (name, value) = pair(option, text)?;
    match value.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok((name, number)),
        _ => Err(format!("{option} {text}: '{value}' must be a finite number, in SI units")),
    }
}

/// The place of a name among those there are.
fn place(option: &str, name: &str, names: &[String], what: &str) -> Result<usize, Wrong> {
    names.iter().position(|n| n == name).ok_or_else(|| {
        let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        format!("{option} {name}: no {what} of that name; there are: {known}")
    })
}

fn parameters(set: &[String]) -> Result<Parameters, Wrong> {
    let mut parameters = Parameters::new();
    for text in set {
        let (name, value) = pair("--set", text)?;
        parameters.set(name, value);
    }
    Ok(parameters)
}

/// What could not be loaded: as text and as JSON.
enum Refused {
    Input(Wrong),
    Model(Vec<ModelError>),
}

impl From<Wrong> for Refused {
    fn from(wrong: Wrong) -> Self {
        Refused::Input(wrong)
    }
}

impl From<Refused> for Wrong {
    fn from(refused: Refused) -> Wrong {
        match refused {
            Refused::Input(wrong) => wrong,
            Refused::Model(errors) => lines(&errors),
        }
    }
}

/// Reads and composes.
fn load(reference: &str, set: &[String]) -> Result<(Model, System), Refused> {
    let parameters = parameters(set)?;
    let files = ModelFiles::load(reference).map_err(|problems| Refused::Input(problems.to_string()))?;
    let model = Model::from_toml(&files.main.text, &files.main.name, &|name| files.part(name))
        .map_err(Refused::Model)?;
    let system = model.compose(&parameters).map_err(Refused::Model)?;
    Ok((model, system))
}

fn write(path: &Path, text: &str) -> Result<(), Wrong> {
    std::fs::write(path, text).map_err(|error| format!("{}: cannot be written: {error}", path.display()))
}

/// `kingpin model check`.
fn check(args: &CheckArgs) -> Result<Exit, Wrong> {
    let mut exit = Exit::Done;
    let mut listed = Vec::new();
    for reference in &args.models {
        let error = |e: &ModelError| {
            json!({"file": e.file, "line": e.line, "place": e.place,
                   "rule": format!("{:?}", e.rule), "message": e.message})
        };
        match load(reference, &args.set) {
            Ok((model, system)) => {
                let report = system.causality_report();
                let turned = report.ports.iter().filter(|p| p.turned).count();
                let (states, inputs, outputs) =
                    (system.state_names(), system.input_names(), system.output_names());
                listed.push(json!({"model": model.name(), "valid": true, "states": states.len(),
                    "inputs": inputs.len(), "outputs": outputs.len(), "ports_turned_round": turned,
                    "loops": report.loops.len(), "dependent_states": report.dependent_states}));
                if !args.json {
                    output::line(format!(
                        "{reference}: valid; {} states, {} inputs, {} outputs; {turned} ports turned round, \
                         {} loops, {} states rigidly joined; {} between samples",
                        states.len(),
                        inputs.len(),
                        outputs.len(),
                        report.loops.len(),
                        report.dependent_states.len(),
                        if system.is_linear_between_samples() { "linear" } else { "not linear" },
                    ));
                }
            }
            Err(refused) => {
                exit = Exit::BadInput;
                let errors = match &refused {
                    Refused::Model(errors) => errors.iter().map(error).collect(),
                    Refused::Input(wrong) => vec![json!({"file": reference, "message": wrong})],
                };
                listed.push(json!({"model": reference, "valid": false, "errors": errors}));
                if !args.json {
                    output::note(Wrong::from(refused));
                }
            }
        }
    }
    if args.json {
        output::json(&Value::Array(listed));
    }
    Ok(exit)
}

/// `kingpin model describe`.
fn describe(args: &DescribeArgs) -> Result<Exit, Wrong> {
    let (model, system) = load(&args.model, &args.set)?;
    let report = system.causality_report();
    let start = system.start_values();
    let (states, inputs, input_units) = (system.state_names(), system.input_names(), system.input_units());
    let (outputs, output_units) = (system.output_names(), system.output_units());
    if args.json {
        let ports = report.ports.iter().map(|p| {
            json!({"port": p.port, "joint": p.joint, "declared": p.declared, "gives": p.actual, "turned_round": p.turned})
        });
        let parameters = system.parameters().into_iter();
        output::json(&json!({
            "name": model.name(), "about": model.about(),
            "parameters": parameters.map(|p| json!({"name": p.name, "value": p.value, "unit": p.unit})).collect::<Vec<_>>(),
            "states": states.iter().zip(&start).map(|(n, v)| json!({"name": n, "start": v})).collect::<Vec<_>>(),
            "inputs": inputs.iter().zip(&input_units).map(|(n, u)| json!({"name": n, "unit": u})).collect::<Vec<_>>(),
            "outputs": outputs.iter().zip(&output_units).map(|(n, u)| json!({"name": n, "unit": u})).collect::<Vec<_>>(),
            "sampled": system.sampled_names(), "sample_s": system.sample_s(),
            "linear_between_samples": system.is_linear_between_samples(),
            "ports": ports.collect::<Vec<_>>(), "loops": report.loops, "dependent_states": report.dependent_states,
        }));
        return Ok(Exit::Done);
    }
    output::line(format!("{}: {}", model.name(), model.about().unwrap_or("")));
    let show = |title: &str, rows: Vec<Vec<String>>| {
        if !rows.is_empty() {
            output::line(format!("\n{title}"));
            output::line(output::columns(&rows).trim_end());
        }
    };
    let value = |v: f64| format!("{v:.6}").trim_end_matches('0').trim_end_matches('.').to_owned();
    let short =
        |v: f64| if v != 0.0 && !(1e-3..1e6).contains(&v.abs()) { format!("{v:e}") } else { value(v) };
    let parameters = system.parameters().into_iter();
    show(
        "parameters (SI)",
        parameters.map(|p| vec![format!("  {}", p.name), short(p.value), p.unit]).collect(),
    );
    show(
        "states, with their start",
        states.iter().zip(&start).map(|(n, v)| vec![format!("  {n}"), short(*v)]).collect(),
    );
    show("inputs", inputs.iter().zip(&input_units).map(|(n, u)| vec![format!("  {n}"), u.clone()]).collect());
    show(
        "outputs",
        outputs.iter().zip(&output_units).map(|(n, u)| vec![format!("  {n}"), u.clone()]).collect(),
    );
    show(
        "sampled by mechanisms",
        system.sampled_names().into_iter().map(|n| vec![format!("  {n}")]).collect(),
    );
    output::line("\nwho gives what");
    for line in report.to_string().lines() {
        output::line(format!("  {line}"));
    }
    output::line(format!(
        "\n{} between samples",
        if system.is_linear_between_samples() { "linear: the step is exact" } else { "not linear" }
    ));
    Ok(Exit::Done)
}

/// `kingpin model compose`.
fn compose(args: &ComposeArgs) -> Result<Exit, Wrong> {
    let (model, system) = load(&args.model, &args.set)?;
    if args.symbolic {
        let symbolic = system.symbolic().map_err(|error| error.to_string())?;
        if args.json {
            let pairs = |list: &[(String, String)]| {
                list.iter().map(|(n, e)| json!({"name": n, "is": e})).collect::<Vec<_>>()
            };
            output::json(&json!({"model": model.name(), "definitions": pairs(&symbolic.definitions),
                                 "entries": pairs(&symbolic.entries)}));
        } else {
            output::line(symbolic.to_string().trim_end());
        }
        return Ok(Exit::Done);
    }
    let (states, inputs, sampled) = (system.state_names(), system.input_names(), system.sampled_names());
    let mut point = OperatingPoint {
        states: system.start_values(),
        inputs: vec![0.0; inputs.len()],
        sampled: system.sampled_start_values(),
        time_s: 0.0,
    };
    for text in &args.at {
        let (name, value) = number("--at", text)?;
        let find = |names: &[String]| names.iter().position(|n| n == name);
        match (find(&states), find(&inputs), find(&sampled)) {
            (Some(k), _, _) => point.states[k] = value,
            (_, Some(k), _) => point.inputs[k] = value,
            (_, _, Some(k)) => point.sampled[k] = value,
            _ => {
                let all: Vec<String> = states.iter().chain(&inputs).chain(&sampled).cloned().collect();
                place("--at", name, &all, "state, input or sampled quantity")?;
            }
        }
    }
    let m = system.matrices_at(&point).map_err(|errors| lines(&errors))?;
    if args.json {
        output::json(&json!({
            "model": model.name(), "states": m.states, "inputs": m.inputs, "outputs": m.outputs,
            "E": m.e, "A": m.a, "B": m.b, "state_constant": m.state_constant,
            "C": m.c, "D": m.d, "output_constant": m.output_constant,
            "at": {"states": point.states, "inputs": point.inputs, "sampled": point.sampled},
        }));
        return Ok(Exit::Done);
    }
    let ones = |column: &[f64]| column.iter().map(|v| vec![*v]).collect::<Vec<_>>();
    let rates: Vec<String> = m.states.iter().map(|s| format!("{s}'")).collect();
    let one = ["1".to_owned()];
    for (name, rows, columns, table) in [
        ("E", &m.states, &rates[..], m.e.clone()),
        ("A", &m.states, &m.states[..], m.a.clone()),
        ("B", &m.states, &m.inputs[..], m.b.clone()),
        ("constant of the states", &m.states, &one[..], ones(&m.state_constant)),
        ("C", &m.outputs, &m.states[..], m.c.clone()),
        ("D", &m.outputs, &m.inputs[..], m.d.clone()),
        ("constant of the outputs", &m.outputs, &one[..], ones(&m.output_constant)),
    ] {
        if rows.is_empty() || columns.is_empty() {
            continue;
        }
        let mut shown =
            vec![std::iter::once(name.to_owned()).chain(columns.iter().cloned()).collect::<Vec<_>>()];
        for (row, values) in rows.iter().zip(&table) {
            let numbers = values.iter().map(|v| if *v == 0.0 { "0".to_owned() } else { format!("{v:.6e}") });
            shown.push(std::iter::once(format!("  {row}")).chain(numbers).collect());
        }
        output::line(output::columns(&shown));
    }
    Ok(Exit::Done)
}

/// `kingpin model draw`.
fn draw(args: &DrawArgs) -> Result<Exit, Wrong> {
    let (_, system) = load(&args.model, &args.set)?;
    let svg = system.diagram();
    match &args.output {
        Some(path) => write(path, &svg)?,
        None => output::line(svg),
    }
    Ok(Exit::Done)
}
