//! A mapping file, a DBC file and the bench's variables, joined into a plan; or everything that does not fit.
//!
//! Every fault names message and signal, and the key of the mapping that says it.

mod protect;

use crate::database::{Database, Message, Signal, exclusive};
use crate::e2e::Protection;
use crate::frame::{FD_LENGTHS, Id};
use crate::signal::Codec;
use crate::units;
use config::Broken;
use config::can::{Can, FrameKind, ReceiveSignal, SendSignal};
use protect::protect;

/// A variable that signals are joined with; its index in the list given is what the plan speaks of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Variable {
    /// Name, as in the mapping.
    pub name: String,
    /// Unit, as the table writes it.
    pub unit: String,
}

/// What is sent and received, checked.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Messages sent.
    pub send: Vec<SendPlan>,
    /// Messages received.
    pub receive: Vec<ReceivePlan>,
}

/// A message sent.
#[derive(Debug, Clone)]
pub struct SendPlan {
    /// Name in the DBC.
    pub name: String,
    /// Identifier.
    pub id: Id,
    /// CAN FD.
    pub fd: bool,
    /// With the faster bit rate.
    pub brs: bool,
    /// Payload. [bytes]
    pub len: usize,
    /// Cycle time. [ns]
    pub cycle_ns: u64,
    /// First time. [ns]
    pub offset_ns: u64,
    /// Counter and checksum.
    pub protection: Option<Protection>,
    /// Signals from variables.
    pub fields: Vec<SendField>,
    /// Payload with the fixed values in place.
    pub template: Vec<u8>,
}

/// A signal sent from a variable.
#[derive(Debug, Clone)]
pub struct SendField {
    /// Bits and scale.
    pub codec: Codec,
    /// Index of the variable.
    pub source: usize,
    /// DBC's value = variable · factor + offset.
    pub factor: f64,
    /// See `factor`.
    pub offset: f64,
    /// Least and greatest value sent, in the DBC's unit.
    pub limits: (f64, f64),
    /// Raw value for an absent variable.
    pub absent_raw: Option<u64>,
}

/// A message received.
#[derive(Debug, Clone)]
pub struct ReceivePlan {
    /// Name in the DBC.
    pub name: String,
    /// Identifier.
    pub id: Id,
    /// Payload. [bytes]
    pub len: usize,
    /// Time-out. [ns]
    pub timeout_ns: u64,
    /// Counter and checksum.
    pub protection: Option<Protection>,
    /// Signals to variables.
    pub fields: Vec<ReceiveField>,
    /// The message, for its multiplexing.
    pub message: Message,
}

/// A signal received into a variable.
#[derive(Debug, Clone)]
pub struct ReceiveField {
    /// Index of the signal in its message.
    pub signal: usize,
    /// Bits and scale.
    pub codec: Codec,
    /// Index of the variable.
    pub target: usize,
    /// Variable = DBC's value · factor + offset.
    pub factor: f64,
    /// See `factor`.
    pub offset: f64,
    /// Least plausible value of the variable.
    pub min: f64,
    /// Greatest plausible value of the variable.
    pub max: f64,
    /// Greatest plausible change. [1/s]
    pub rate_max: f64,
}

struct Faults(Vec<Broken>);

impl Faults {
    fn note(&mut self, key: String, message: &str, signal: Option<&str>, rule: impl std::fmt::Display) {
        let about = signal.map_or(String::new(), |signal| format!(", signal {signal}"));
        self.0.push(Broken { key, rule: format!("message {message}{about}: {rule}") });
    }
}

fn meant<'a>(name: &str, all: impl Iterator<Item = &'a str>) -> String {
    let distance = |other: &str| strsim::damerau_levenshtein(&name.to_lowercase(), &other.to_lowercase());
    let best = all.map(|other| (distance(other), other)).min();
    match best {
        Some((distance, other)) if distance <= 2.max(name.len() / 3) => format!(" (did you mean `{other}`?)"),
        _ => String::new(),
    }
}

/// Joins a mapping with its DBC and the variables it may read (`sources`) and write (`targets`).
///
/// # Errors
/// Everything that does not fit, each naming key, message and signal.
pub fn compile(
    mapping: &Can,
    database: &Database,
    sources: &[Variable],
    targets: &[Variable],
) -> Result<Plan, Vec<Broken>> {
    let mut faults = Faults(Vec::new());
    let mut plan = Plan { send: Vec::new(), receive: Vec::new() };
    for (i, wanted) in mapping.send.iter().enumerate() {
        let at = format!("send[{i}]");
        let Some(message) = find(database, &wanted.message, &at, &mut faults) else { continue };
        let classic = wanted.frame == FrameKind::Classic;
        if classic && message.len > 8 {
            let rule = format!("its {} bytes need `fd` or `fd_brs`", message.len);
            faults.note(format!("{at}.frame"), &message.name, None, rule);
        }
        if !classic && !FD_LENGTHS.contains(&message.len) {
            let rule = format!("its {} bytes are no length that CAN FD can carry", message.len);
            faults.note(format!("{at}.frame"), &message.name, None, rule);
        }
        let cycle_ns = (wanted.cycle_ms * 1e6) as u64;
        let mut send = SendPlan {
            name: message.name.clone(),
            id: message.id,
            fd: !classic,
            brs: wanted.frame == FrameKind::FdBrs,
            len: message.len,
            cycle_ns,
            offset_ns: (wanted.offset_ms * 1e6) as u64,
            protection: None,
            fields: Vec::new(),
            template: vec![0; message.len],
        };
        let mut taken = Vec::new();
        send.protection = protect(message, wanted.protection.as_ref(), &at, &mut taken, &mut faults);
        for (j, signal) in wanted.signals.iter().enumerate() {
            send_signal(
                message,
                signal,
                &format!("{at}.signals[{j}]"),
                sources,
                &mut taken,
                &mut send,
                &mut faults,
            );
        }
        fixed_multiplexors(message, wanted.signals.as_slice(), &at, &send.template, &mut faults);
        plan.send.push(send);
    }
    let mut written: Vec<(usize, String)> = Vec::new();
    for (i, wanted) in mapping.receive.iter().enumerate() {
        let at = format!("receive[{i}]");
        let Some(message) = find(database, &wanted.message, &at, &mut faults) else { continue };
        if mapping.send.iter().any(|sent| sent.message == wanted.message) {
            faults.note(
                format!("{at}.message"),
                &message.name,
                None,
                "is sent by this side: must not be received too",
            );
        }
        let mut receive = ReceivePlan {
            name: message.name.clone(),
            id: message.id,
            len: message.len,
            timeout_ns: (wanted.timeout_ms * 1e6) as u64,
            protection: None,
            fields: Vec::new(),
            message: message.clone(),
        };
        let mut taken = Vec::new();
        receive.protection = protect(message, wanted.protection.as_ref(), &at, &mut taken, &mut faults);
        for (j, signal) in wanted.signals.iter().enumerate() {
            let at = format!("{at}.signals[{j}]");
            let Some(field) = receive_signal(message, signal, &at, targets, &taken, &mut faults) else {
                continue;
            };
            if let Some((_, by)) = written.iter().find(|(target, _)| *target == field.target) {
                let rule = format!("{} is already written by {by}", signal.target);
                faults.note(format!("{at}.target"), &message.name, Some(&signal.signal), rule);
            }
            written.push((field.target, format!("message {}, signal {}", message.name, signal.signal)));
            receive.fields.push(field);
        }
        plan.receive.push(receive);
    }
    if faults.0.is_empty() { Ok(plan) } else { Err(faults.0) }
}

fn find<'a>(database: &'a Database, name: &str, at: &str, faults: &mut Faults) -> Option<&'a Message> {
    let found = database.message(name);
    if found.is_none() {
        let hint = meant(name, database.messages.iter().map(|m| m.name.as_str()));
        faults.note(format!("{at}.message"), name, None, format!("is not in the DBC file{hint}"));
    }
    found
}

fn find_signal<'a>(
    message: &'a Message,
    name: &str,
    key: String,
    faults: &mut Faults,
) -> Option<(usize, &'a Signal)> {
    let found = message.signal(name);
    match found {
        None => {
            let hint = meant(name, message.signals.iter().map(|s| s.name.as_str()));
            faults.note(key, &message.name, Some(name), format!("is not in the DBC file{hint}"));
            None
        }
        Some((_, signal)) if signal.selector.as_ref().is_some_and(|s| s.ranges.is_empty()) => {
            faults.note(
                key,
                &message.name,
                Some(name),
                "nothing selects it: its multiplexing in the DBC file is broken",
            );
            None
        }
        found => found,
    }
}

/// The unit of the signal: the mapping's word where the DBC is silent; both only when they mean the same.
fn unit_of(
    message: &Message,
    signal: &Signal,
    said: Option<&str>,
    other: Option<units::Unit>,
    at: &str,
    faults: &mut Faults,
) -> Option<units::Unit> {
    let name = Some(signal.name.as_str());
    let own = units::parse(&signal.unit);
    match said {
        Some(said) => {
            let Some(unit) = units::parse(said) else {
                faults.note(format!("{at}.unit"), &message.name, name, format!("unit `{said}` is not known"));
                return None;
            };
            if own.is_some_and(|own| own != unit) {
                let rule = format!("unit `{said}` is not the DBC's `{}`", signal.unit);
                faults.note(format!("{at}.unit"), &message.name, name, rule);
                return None;
            }
            Some(unit)
        }
        // Codes and counts have no unit on either side.
        None if signal.unit.is_empty() && other.is_some_and(|other| other.quantity == "number") => other,
        None if signal.unit.is_empty() => {
            faults.note(
                format!("{at}.unit"),
                &message.name,
                name,
                "the DBC states no unit: must be given (`1` for a number or a code)",
            );
            None
        }
        None => {
            if own.is_none() {
                let rule = format!("the DBC's unit `{}` is not known: must be given", signal.unit);
                faults.note(format!("{at}.unit"), &message.name, name, rule);
            }
            own
        }
    }
}

fn variable(
    name: &str,
    all: &[Variable],
    key: String,
    message: &Message,
    signal: &Signal,
    faults: &mut Faults,
) -> Option<(usize, units::Unit)> {
    let Some(index) = all.iter().position(|variable| variable.name == name) else {
        let hint = meant(name, all.iter().map(|v| v.name.as_str()));
        faults.note(key, &message.name, Some(&signal.name), format!("there is no variable `{name}`{hint}"));
        return None;
    };
    let unit = units::parse(&all[index].unit);
    if unit.is_none() {
        let rule = format!("variable `{name}` has unit `{}`, which signals cannot carry", all[index].unit);
        faults.note(key, &message.name, Some(&signal.name), rule);
    }
    unit.map(|unit| (index, unit))
}

fn send_signal(
    message: &Message,
    wanted: &SendSignal,
    at: &str,
    sources: &[Variable],
    taken: &mut Vec<usize>,
    send: &mut SendPlan,
    faults: &mut Faults,
) {
    let Some((index, signal)) = find_signal(message, &wanted.signal, format!("{at}.signal"), faults) else {
        return;
    };
    let name = Some(signal.name.as_str());
    for &other in taken.iter() {
        if other == index {
            faults.note(format!("{at}.signal"), &message.name, name, "is filled twice");
            return;
        }
        let mut a = vec![0; message.len];
        signal.codec.bits.mark(&mut a);
        let mut b = vec![0; message.len];
        message.signals[other].codec.bits.mark(&mut b);
        if a.iter().zip(&b).any(|(a, b)| a & b != 0) {
            let rule = if exclusive(&message.signals, index, other) {
                format!(
                    "is never sent together with signal {}: a multiplexed message is sent with one selection",
                    message.signals[other].name
                )
            } else {
                format!("shares bits with signal {}, which is filled too", message.signals[other].name)
            };
            faults.note(format!("{at}.signal"), &message.name, name, rule);
            return;
        }
    }
    taken.push(index);
    let codec = signal.codec;
    let bits = codec.range();
    let limits = signal.limits.map_or(bits, |(min, max)| (min.max(bits.0), max.min(bits.1)));
    // A range that the bits cannot reach at all is no range.
    let limits = if limits.0 <= limits.1 { limits } else { bits };
    if let Some(raw) = wanted.absent_raw
        && raw > u64::MAX >> (64 - codec.bits.size())
    {
        let rule = format!("raw value {raw} does not fit {} bits", codec.bits.size());
        faults.note(format!("{at}.absent_raw"), &message.name, name, rule);
    }
    match (&wanted.source, wanted.value) {
        (Some(source), None) => {
            let from = variable(source, sources, format!("{at}.source"), message, signal, faults);
            let other = from.map(|(_, unit)| unit);
            let own = unit_of(message, signal, wanted.unit.as_deref(), other, at, faults);
            let (Some(own), Some((index, from))) = (own, from) else { return };
            let Some((factor, offset)) = units::conversion(from, own) else {
                let rule = format!(
                    "variable `{source}` is {} [{}], the signal is {} [{}]",
                    article(from.quantity),
                    sources[index].unit,
                    article(own.quantity),
                    wanted.unit.as_deref().unwrap_or(&signal.unit)
                );
                faults.note(format!("{at}.source"), &message.name, name, rule);
                return;
            };
            let gain = wanted.gain.unwrap_or(1.0);
            send.fields.push(SendField {
                codec,
                source: index,
                factor: factor * gain,
                offset: offset * gain,
                limits,
                absent_raw: wanted.absent_raw,
            });
        }
        (None, Some(value)) => {
            if value < limits.0 || value > limits.1 {
                let rule = format!("value {value} must be in [{}, {}] {}", limits.0, limits.1, signal.unit);
                faults.note(format!("{at}.value"), &message.name, name, rule);
                return;
            }
            codec.encode(&mut send.template, value);
        }
        // Said by the mapping's own check.
        _ => {}
    }
}

fn article(quantity: &str) -> String {
    let vowel = quantity.starts_with(['a', 'e', 'i', 'o', 'u']);
    format!("{} {quantity}", if vowel { "an" } else { "a" })
}

/// A multiplexed signal is sent only if its multiplexor is a fixed value that selects it.
fn fixed_multiplexors(
    message: &Message,
    wanted: &[SendSignal],
    at: &str,
    template: &[u8],
    faults: &mut Faults,
) {
    for (j, said) in wanted.iter().enumerate() {
        let Some((index, signal)) = message.signal(&said.signal) else { continue };
        let Some(selector) = &signal.selector else { continue };
        if selector.ranges.is_empty() {
            continue;
        }
        let multiplexor = &message.signals[selector.multiplexor];
        let fixed = wanted.iter().any(|other| other.signal == multiplexor.name && other.value.is_some());
        if !fixed || !message.is_there(index, template) {
            let rule = format!(
                "is multiplexed: signal {} must be given as a `value` that selects it",
                multiplexor.name
            );
            faults.note(format!("{at}.signals[{j}].signal"), &message.name, Some(&signal.name), rule);
        }
    }
}

fn receive_signal(
    message: &Message,
    wanted: &ReceiveSignal,
    at: &str,
    targets: &[Variable],
    taken: &[usize],
    faults: &mut Faults,
) -> Option<ReceiveField> {
    let (index, signal) = find_signal(message, &wanted.signal, format!("{at}.signal"), faults)?;
    let name = Some(signal.name.as_str());
    if taken.contains(&index) {
        faults.note(format!("{at}.signal"), &message.name, name, "is the message's counter or checksum");
    }
    let to = variable(&wanted.target, targets, format!("{at}.target"), message, signal, faults);
    let own = unit_of(message, signal, wanted.unit.as_deref(), to.map(|(_, unit)| unit), at, faults);
    let (own, (target, to)) = (own?, to?);
    // A variable for whatever the user likes takes SI values of any quantity.
    let to = if to.quantity == units::ANY.quantity {
        units::Unit { quantity: own.quantity, ..units::ANY }
    } else {
        to
    };
    let Some((factor, offset)) = units::conversion(own, to) else {
        let rule = format!(
            "the signal is {} [{}], variable `{}` is {} [{}]",
            article(own.quantity),
            wanted.unit.as_deref().unwrap_or(&signal.unit),
            wanted.target,
            article(to.quantity),
            targets[target].unit
        );
        faults.note(format!("{at}.target"), &message.name, name, rule);
        return None;
    };
    let gain = wanted.gain.unwrap_or(1.0);
    let (factor, offset) = (factor * gain, offset * gain);
    let (low, high) = signal.codec.range();
    let (a, b) = (low * factor + offset, high * factor + offset);
    let reach = (a.min(b), a.max(b));
    let (min, max) = (wanted.min.unwrap_or(f64::NEG_INFINITY), wanted.max.unwrap_or(f64::INFINITY));
    if min > reach.1 || max < reach.0 {
        let rule = format!(
            "can only be {} to {} {}: nothing would ever be plausible",
            reach.0, reach.1, targets[target].unit
        );
        let key = if min > reach.1 { "min" } else { "max" };
        faults.note(format!("{at}.{key}"), &message.name, name, rule);
        return None;
    }
    Some(ReceiveField {
        signal: index,
        codec: signal.codec,
        target,
        factor,
        offset,
        min,
        max,
        rate_max: wanted.rate_max_per_s.unwrap_or(f64::INFINITY),
    })
}
