//! `model compare`: a model run on a measured drive, aligned with the measurement and compared (patent Fig. 2).

use super::arguments::CompareArgs;
use super::series::{Series, means};
use super::simulate::{Keep, ended, input, run, thinned};
use super::{Wrong, load, pair, place, write};
use crate::commands::suspension::page::{Figure, Table, html};
use crate::exit::Exit;
use crate::output;
use functional_model::comparison::{Agreement, Analysis, Signal, agreement, analyse, lag_s};
use serde_json::json;

/// `kingpin model compare`.
pub fn compare(args: &CompareArgs) -> Result<Exit, Wrong> {
    let (model, system) = load(&args.drive.model, &args.drive.set)?;
    let (inputs, input_units) = (system.input_names(), system.input_units());
    let (outputs, output_units) = (system.output_names(), system.output_units());
    let mut mapped: Vec<(usize, String)> = Vec::new();
    for text in &args.signal {
        let (output, column) = pair("--signal", text)?;
        mapped.push((place("--signal", output, &outputs, "output")?, column.to_owned()));
    }
    let output_of = |header: &str| {
        let by_hand = mapped.iter().find(|(_, column)| means(header, column)).map(|m| m.0);
        by_hand.or_else(|| outputs.iter().position(|n| means(header, n)))
    };
    let measured = Series::read(&args.measured, |header| {
        let as_input = inputs.iter().position(|n| means(header, n)).map(|k| input_units[k].clone());
        output_of(header).map(|k| output_units[k].clone()).or(as_input)
    })?;
    for (_, column) in &mapped {
        if !measured.columns.iter().any(|c| means(&c.header, column)) {
            return Err(format!(
                "{}: --signal names the column '{column}', which is not there",
                measured.name
            ));
        }
    }
    let compared: Vec<(usize, usize)> = measured
        .columns
        .iter()
        .enumerate()
        .filter_map(|(c, column)| output_of(&column.header).map(|k| (k, c)))
        .collect();
    if compared.is_empty() {
        return Err(format!(
            "{}: no column is an output of the model; outputs are: {}; map others with --signal OUTPUT=COLUMN",
            measured.name,
            outputs.join(", ")
        ));
    }
    let separate = input(&args.drive, &system)?;
    let drive = separate.as_ref().unwrap_or(&measured);
    let run = run(&args.drive, &system, Some(drive), &Keep { every: 1, states: false, account: false })?;

    let signals = |(output, column): (usize, usize)| {
        (
            Signal { time_s: &run.time_s, value: &run.columns[output].1 },
            Signal { time_s: &measured.time_s, value: &measured.columns[column].value },
        )
    };
    let (first, against) = signals(compared[0]);
    let lag = lag_s(first, against, args.lag_max);
    let results: Vec<(usize, usize, Agreement, Analysis)> = compared
        .iter()
        .map(|&(k, c)| {
            let (simulated, seen) = signals((k, c));
            (k, c, agreement(simulated, seen, lag), analyse(seen))
        })
        .collect();

    let mut rows = vec![
        ["signal", "unit", "rms error", "relative", "largest", "gain", "bias", "correlation", "samples"]
            .map(str::to_owned)
            .to_vec(),
    ];
    let mut seen = vec![
        ["measured", "unit", "samples", "spacing s", "gap s", "min", "max", "mean", "rms", "Hz"]
            .map(str::to_owned)
            .to_vec(),
    ];
    let digits = |v: f64| format!("{v:.4e}");
    for (k, c, g, a) in &results {
        let unit = output_units[*k].clone();
        let percent = format!("{:.2} %", 100.0 * g.relative);
        rows.push(vec![
            outputs[*k].clone(),
            unit.clone(),
            digits(g.rms_error),
            percent,
            digits(g.max_error),
            format!("{:.4}", g.gain),
            digits(g.bias),
            format!("{:.5}", g.correlation),
            g.samples.to_string(),
        ]);
        seen.push(vec![
            measured.columns[*c].header.clone(),
            unit,
            a.samples.to_string(),
            digits(a.spacing_s),
            digits(a.gap_s),
            digits(a.min),
            digits(a.max),
            digits(a.mean),
            digits(a.rms),
            format!("{:.3}", a.frequency_hz),
        ]);
    }
    if args.json {
        let signals = results.iter().map(|(k, c, g, a)| {
            json!({"output": outputs[*k], "column": measured.columns[*c].header, "unit": output_units[*k],
                   "rms_error": g.rms_error, "relative": g.relative, "max_error": g.max_error, "gain": g.gain,
                   "bias": g.bias, "correlation": g.correlation, "samples": g.samples,
                   "measured": {"samples": a.samples, "duration_s": a.duration_s, "spacing_s": a.spacing_s,
                                "gap_s": a.gap_s, "min": a.min, "max": a.max, "mean": a.mean, "rms": a.rms,
                                "frequency_hz": a.frequency_hz}})
        });
        output::json(&json!({"model": model.name(), "measured": measured.name, "lag_s": lag,
                             "signals": signals.collect::<Vec<_>>()}));
    } else {
        output::line(format!("the measurement lies {:.2} ms behind the model; taken out\n", lag * 1e3));
        output::line(output::columns(&rows));
        output::line(output::columns(&seen).trim_end());
    }
    if let Some(path) = &args.output {
        let mut figures = Vec::new();
        for &(k, c) in &compared {
            let mut figure = Figure::new(&outputs[k], "time [s]", &run.columns[k].0);
            let shifted: Vec<f64> = measured.time_s.iter().map(|t| t - lag).collect();
            let (x, y) = thinned(&shifted, &measured.columns[c].value);
            figure.curve("measured", &x, &y, 0, "solid");
            let (x, y) = thinned(&run.time_s, &run.columns[k].1);
            figure.curve("model", &x, &y, 2, "dash");
            figures.push(figure);
        }
        let about = format!("{} against {}, lag {:.2} ms taken out", model.name(), measured.name, lag * 1e3);
        let tables = [
            Table { title: "Agreement".to_owned(), rows },
            Table { title: "The measurement".to_owned(), rows: seen },
        ];
        write(path, &html(model.name(), &about, &tables, &figures))?;
    }
    Ok(ended(&run))
}
