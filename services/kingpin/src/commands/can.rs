//! `can check|decode|encode`: DBC files and mappings, without a bus.

use super::can_args::{CanArgs, CanCheckArgs, CanCommand, CanDecodeArgs, CanEncodeArgs};
use super::can_bus;
use crate::exit::Exit;
use crate::output;
use can::database::{Fault, Weight};
use can::mapping::compile;
use can::signal::{Encoded, Raw};
use can::{Database, Frame, Message, ecu};
use config::can::Can as Mapping;
use config::{Kind, Mistake, Problems, TextFile, Violation};
use serde_json::{Map, Value, json};
use std::io::BufRead;

/// `kingpin can`.
pub fn can(args: &CanArgs) -> Exit {
    match &args.command {
        CanCommand::Check(args) => check(args),
        CanCommand::Decode(args) => decode(args),
        CanCommand::Encode(args) => encode(args),
        CanCommand::Monitor(args) => can_bus::monitor(args),
        CanCommand::Send(args) => can_bus::send(args),
        CanCommand::Ecu(args) => can_bus::ecu(args),
    }
}

/// A DBC file by path or by the name of a shipped one.
pub fn read_dbc(reference: &str) -> Result<TextFile, String> {
    let path = std::path::Path::new(reference);
    if !path.exists()
        && let Some(shipped) = config::Library::get(Kind::Can, reference)
        && shipped.file_name.ends_with(".dbc")
    {
        return Ok(TextFile {
            name: format!("library:can/{}", shipped.file_name),
            text: shipped.text.to_owned(),
        });
    }
    match std::fs::read(path) {
        // Latin-1 comments are common; they mean nothing to a frame.
        Ok(bytes) => {
            Ok(TextFile { name: reference.to_owned(), text: String::from_utf8_lossy(&bytes).into_owned() })
        }
        Err(error) => Err(format!("{reference}: {error}")),
    }
}

fn violation(file: &str, fault: &Fault) -> Violation {
    Violation {
        line: u32::try_from(fault.line).unwrap_or(0),
        ..Violation::of_file(Mistake::Reference, file, fault.to_string())
    }
}

/// A mapping's faults against its DBC and the variables of whoever it is for: the bench, or the virtual ECU.
pub fn check_mapping(reference: &str) -> Result<(Mapping, can::mapping::Plan), Problems> {
    let (loaded, dbc) = config::load_can(reference)?;
    let (database, faults) = Database::read(&dbc.text);
    let mapping = &loaded.value;
    let names = mapping.send.iter().flat_map(|m| m.signals.iter().filter_map(|s| s.source.as_deref()));
    let names = names.chain(mapping.receive.iter().flat_map(|m| m.signals.iter().map(|s| s.target.as_str())));
    let for_ecu = names.into_iter().any(|name| name.starts_with("ecu."));
    let (sources, targets) = if for_ecu {
        (ecu::sources(), ecu::targets())
    } else {
        (assembly::can_sources(), assembly::can_targets())
    };
    match compile(mapping, &database, &sources, &targets) {
        Ok(plan) => Ok((loaded.value, plan)),
        Err(broken) => {
            let mut problems = Problems::default();
            for fault in faults.iter().filter(|fault| fault.weight == Weight::Error) {
                problems.push(violation(&dbc.name, fault));
            }
            for broken in broken {
                problems.push(loaded.violation(Mistake::Reference, &broken.key, broken.rule));
            }
            Err(problems)
        }
    }
}

fn check(args: &CanCheckArgs) -> Exit {
    let mut problems = Problems::default();
    let mut warnings = Vec::new();
    let mut told = Vec::new();
    for file in &args.files {
        if file.ends_with(".dbc") {
            let text = match read_dbc(file) {
                Ok(text) => text,
                Err(error) => {
                    problems.push(Violation::of_file(Mistake::NotFound, file.as_str(), error));
                    continue;
                }
            };
            let (database, faults) = Database::read(&text.text);
            for fault in &faults {
                match fault.weight {
                    Weight::Error => problems.push(violation(&text.name, fault)),
                    Weight::Warning => warnings.push(violation(&text.name, fault)),
                }
            }
            let signals: usize = database.messages.iter().map(|message| message.signals.len()).sum();
            told.push((file.clone(), format!("{} messages, {signals} signals", database.messages.len())));
        } else {
            match check_mapping(file) {
                Ok((_, plan)) => told.push((
                    file.clone(),
                    format!("{} messages sent, {} received", plan.send.len(), plan.receive.len()),
                )),
                Err(found) => problems.extend(found),
            }
        }
    }
    let bad = !problems.is_empty();
    if args.json {
        let files: Map<String, Value> = told.into_iter().map(|(file, text)| (file, text.into())).collect();
        output::json(&json!({
            "valid": !bad,
            "files": files,
            "violations": problems.violations,
            "more": problems.more,
            "warnings": warnings,
        }));
    } else {
        for warning in warnings {
            output::note(format!("{warning} (warning)"));
        }
        if bad {
            output::note(&problems);
        }
        for (file, text) in told {
            output::line(format!("{file}: {text}"));
        }
    }
    if bad { Exit::BadInput } else { Exit::Done }
}

/// A DBC whose faults, if any, were said.
pub fn database(reference: &str) -> Result<Database, String> {
    let text = read_dbc(reference)?;
    let (database, faults) = Database::read(&text.text);
    if database.messages.is_empty() {
        let faults: Vec<_> = faults.iter().map(|fault| violation(&text.name, fault).to_string()).collect();
        return Err(faults.join("\n"));
    }
    Ok(database)
}

fn raw_json(raw: Raw) -> Value {
    match raw {
        Raw::Unsigned(raw) => raw.into(),
        Raw::Signed(raw) => raw.into(),
        Raw::Real(raw) => raw.into(),
    }
}

/// The signals there in a frame, as JSON: name → raw and value.
pub fn decoded(message: &Message, data: &[u8]) -> Map<String, Value> {
    let there = (0..message.signals.len()).filter(|&index| message.is_there(index, data));
    there
        .map(|index| {
            let signal = &message.signals[index];
            let mut entry =
                json!({"raw": raw_json(signal.codec.raw(data)), "value": signal.codec.decode(data)});
            if let Some(word) = word(message, index, data) {
                entry["word"] = word.into();
            }
            (signal.name.clone(), entry)
        })
        .collect()
}

fn word(message: &Message, index: usize, data: &[u8]) -> Option<String> {
    let signal = &message.signals[index];
    let raw = match signal.codec.raw(data) {
        Raw::Unsigned(raw) => i64::try_from(raw).ok()?,
        Raw::Signed(raw) => raw,
        Raw::Real(_) => return None,
    };
    signal.values.iter().find(|(value, _)| *value == raw).map(|(_, word)| word.clone())
}

/// The signals there in a frame, as text.
pub fn decoded_text(message: &Message, data: &[u8]) -> String {
    let there = (0..message.signals.len()).filter(|&index| message.is_there(index, data));
    let parts: Vec<String> = there
        .map(|index| {
            let signal = &message.signals[index];
            let value = signal.codec.decode(data);
            // Nine digits: what a factor such as 0.01 leaves behind is not told.
            let value = (value * 1e9).round() / 1e9;
            match word(message, index, data) {
                Some(word) => format!("{}={value} ({word})", signal.name),
                None if signal.unit.is_empty() => format!("{}={value}", signal.name),
                None => format!("{}={value} {}", signal.name, signal.unit),
            }
        })
        .collect();
    parts.join("  ")
}

/// Frames may stand in lines of `candump -L`: `(time) vcan0 123#00`.
fn frame_of(line: &str) -> Result<Frame, String> {
    let word = line.split_whitespace().find(|word| word.contains('#')).unwrap_or(line.trim());
    Frame::parse(word)
}

fn decode(args: &CanDecodeArgs) -> Exit {
    let database = match database(&args.dbc) {
        Ok(database) => database,
        Err(error) => return refuse(&error),
    };
    let mut all_good = true;
    let mut one = |text: &str| {
        let frame = match frame_of(text) {
            Ok(frame) => frame,
            Err(error) => {
                output::note(error);
                all_good = false;
                return;
            }
        };
        let message = database.by_id(frame.id).filter(|message| frame.data().len() >= message.len);
        match message {
            Some(message) if args.json => output::line(json!({
                "frame": frame.to_string(), "message": message.name, "signals": decoded(message, frame.data())
            })),
            Some(message) => {
                output::line(format!("{frame}  {}: {}", message.name, decoded_text(message, frame.data())));
            }
            None => {
                let rule = match database.by_id(frame.id) {
                    Some(message) => format!("{frame}: message {} needs {} bytes", message.name, message.len),
                    None => format!("{frame}: no message {} in the DBC file", frame.id),
                };
                output::note(rule);
                all_good = false;
            }
        }
    };
    if args.frames.is_empty() {
        for line in
            std::io::stdin().lock().lines().map_while(Result::ok).filter(|line| !line.trim().is_empty())
        {
            one(&line);
        }
    } else {
        args.frames.iter().for_each(|frame| one(frame));
    }
    if all_good { Exit::Done } else { Exit::BadInput }
}

/// Says why nothing was done.
pub fn refuse(error: &str) -> Exit {
    output::note(error);
    Exit::BadInput
}

/// What a signal is to be.
enum Wanted {
    Value(f64),
    Raw(u64),
}

/// A message with the given values, `fd` or as short as classic.
fn encode_message(
    database: &Database,
    name: &str,
    wanted: &[(String, Wanted)],
    fd: bool,
) -> Result<Frame, Vec<String>> {
    let Some(message) = database.message(name) else {
        return Err(vec![format!("message {name}: is not in the DBC file")]);
    };
    let mut data = vec![0; message.len];
    let mut faults = Vec::new();
    for (signal_name, wanted) in wanted {
        let Some((_, signal)) = message.signal(signal_name) else {
            faults.push(format!("message {name}, signal {signal_name}: is not in the DBC file"));
            continue;
        };
        let (low, high) = signal.codec.range();
        match wanted {
            Wanted::Raw(raw) => signal.codec.bits.set(&mut data, *raw),
            Wanted::Value(value) => {
                if signal.codec.encode(&mut data, *value) != Encoded::Exact {
                    faults.push(format!(
                        "message {name}, signal {signal_name}: {value} must be in [{low}, {high}] {}",
                        signal.unit
                    ));
                }
            }
        }
    }
    for (signal_name, _) in wanted {
        if let Some((index, signal)) = message.signal(signal_name)
            && !message.is_there(index, &data)
        {
            let by = signal.selector.as_ref().map_or("", |s| message.signals[s.multiplexor].name.as_str());
            faults.push(format!(
                "message {name}, signal {signal_name}: the value of multiplexor {by} does not select it"
            ));
        }
    }
    if !faults.is_empty() {
        return Err(faults);
    }
    Frame::new(message.id, fd || message.len > 8, false, &data)
        .ok_or_else(|| vec![format!("message {name}: no frame carries {} bytes", message.len)])
}

/// `SIGNAL=VALUE` words with a message, as a frame.
pub fn encode_words(
    database: &Database,
    name: &str,
    words: &[String],
    fd: bool,
) -> Result<Frame, Vec<String>> {
    let mut wanted = Vec::new();
    let mut faults = Vec::new();
    for word in words {
        match word.split_once('=').map(|(name, value)| (name, value.parse::<f64>())) {
            Some((signal, Ok(value))) => wanted.push((signal.to_owned(), Wanted::Value(value))),
            _ => faults.push(format!("`{word}`: must be SIGNAL=VALUE")),
        }
    }
    if faults.is_empty() { encode_message(database, name, &wanted, fd) } else { Err(faults) }
}

fn encode(args: &CanEncodeArgs) -> Exit {
    let database = match database(&args.dbc) {
        Ok(database) => database,
        Err(error) => return refuse(&error),
    };
    if let Some(name) = &args.message {
        return match encode_words(&database, name, &args.signals, false) {
            Ok(frame) => {
                output::line(frame);
                Exit::Done
            }
            Err(faults) => refuse(&faults.join("\n")),
        };
    }
    let mut all_good = true;
    for line in std::io::stdin().lock().lines().map_while(Result::ok).filter(|line| !line.trim().is_empty()) {
        match encode_line(&database, &line) {
            Ok(frame) => output::line(frame),
            Err(faults) => {
                output::note(faults.join("\n"));
                all_good = false;
            }
        }
    }
    if all_good { Exit::Done } else { Exit::BadInput }
}

fn encode_line(database: &Database, line: &str) -> Result<Frame, Vec<String>> {
    let value: Value = serde_json::from_str(line).map_err(|error| vec![format!("`{line}`: {error}")])?;
    let (Some(name), Some(signals)) = (value["message"].as_str(), value["signals"].as_object()) else {
        return Err(vec![format!("`{line}`: must have `message` and `signals`")]);
    };
    let mut wanted = Vec::new();
    for (signal, value) in signals {
        let raw = &value["raw"];
        let raw = raw.as_u64().or_else(|| raw.as_i64().map(|raw| raw as u64));
        match (value.as_f64(), raw) {
            (Some(value), _) => wanted.push((signal.clone(), Wanted::Value(value))),
            (None, Some(raw)) => wanted.push((signal.clone(), Wanted::Raw(raw))),
            _ => {
                return Err(vec![format!(
                    "message {name}, signal {signal}: must be a number or {{\"raw\": n}}"
                )]);
            }
        }
    }
    encode_message(database, name, &wanted, false)
}
