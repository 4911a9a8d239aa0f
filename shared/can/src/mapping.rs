//! A mapping file, a DBC file and the bench's variables, joined into a plan; or everything that does not fit.
//!
//! Every fault names message and signal, and the key of the mapping that says it.

use crate::database::{Database, Message, Signal, exclusive};
use crate::e2e::{Protection, Rule};
use crate::frame::{FD_LENGTHS, Id};
use crate::signal::Codec;
use crate::units;
use config::Broken;
use config::can::{Can, DataIdMode, FrameKind, MakerScheme, Protection as Wanted, ReceiveSignal, SendSignal};

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

/// The signals that hold counter and checksum, as their rule needs them.
fn protect(
    message: &Message,
    wanted: Option<&Wanted>,
    at: &str,
    taken: &mut Vec<usize>,
    faults: &mut Faults,
) -> Option<Protection> {
    let wanted = wanted?;
    let before = faults.0.len();
    let mut hold = |name: &str, key: &str, size: Option<u32>, faults: &mut Faults| {
        let key = format!("{at}.protection.{key}");
        let (index, signal) = find_signal(message, name, key.clone(), faults)?;
        let bits = signal.codec.bits;
        if let Some(size) = size
            && bits.size() != size
        {
            faults.note(
                key,
                &message.name,
                Some(name),
                format!("must have {size} bits for this protection, has {}", bits.size()),
            );
            return None;
        }
        taken.push(index);
        Some(bits)
    };
    let protection = match wanted {
        Wanted::AutosarP01 {
            checksum,
            counter,
            data_id_nibble,
            data_id,
            data_id_mode,
            max_delta_counter,
        }
        | Wanted::AutosarP11 {
            checksum,
            counter,
            data_id_nibble,
            data_id,
            data_id_mode,
            max_delta_counter,
        } => {
            let eleven = matches!(wanted, Wanted::AutosarP11 { .. });
            let checksum_bits = hold(checksum, "checksum", Some(8), faults);
            if checksum_bits.is_some_and(|bits| bits.whole_bytes().is_none()) {
                faults.note(
                    format!("{at}.protection.checksum"),
                    &message.name,
                    Some(checksum),
                    "must be one whole byte",
                );
            }
            let counter = hold(counter, "counter", Some(4), faults);
            if eleven && !matches!(data_id_mode, DataIdMode::Both | DataIdMode::Nibble) {
                faults.note(
                    format!("{at}.protection.data_id_mode"),
                    &message.name,
                    Some(checksum),
                    "profile 11 knows `both` and `nibble` only",
                );
            }
            let nibble = match (data_id_nibble, data_id_mode) {
                (Some(name), DataIdMode::Nibble) => hold(name, "data_id_nibble", Some(4), faults),
                (None, DataIdMode::Nibble) => {
                    faults.note(
                        format!("{at}.protection.data_id_nibble"),
                        &message.name,
                        Some(checksum),
                        "mode `nibble` needs the signal of the nibble",
                    );
                    None
                }
                (Some(name), _) => {
                    faults.note(
                        format!("{at}.protection.data_id_nibble"),
                        &message.name,
                        Some(name),
                        "is for mode `nibble` only",
                    );
                    None
                }
                (None, _) => None,
            };
            if *data_id_mode == DataIdMode::Nibble && data_id >> 12 != 0 {
                faults.note(
                    format!("{at}.protection.data_id"),
                    &message.name,
                    Some(checksum),
                    format!("data ID {data_id} must be below 4096 in mode `nibble`"),
                );
            }
            Protection {
                rule: Rule::J1850WithId { data_id: *data_id, mode: *data_id_mode },
                checksum: checksum_bits,
                counter,
                nibble,
                counter_max: 14,
                delta_max: u64::from(*max_delta_counter),
            }
        }
        Wanted::AutosarP02 { checksum, counter, data_id_list, max_delta_counter } => {
            let checksum_bits = hold(checksum, "checksum", Some(8), faults);
            let counter_bits = hold(counter, "counter", Some(4), faults);
            layout_two(message, checksum, checksum_bits, counter, counter_bits, at, faults);
            let mut list = [0; 16];
            list.iter_mut().zip(data_id_list).for_each(|(to, from)| *to = *from);
            Protection {
                rule: Rule::H2fWithList { list },
                checksum: checksum_bits,
                counter: counter_bits,
                nibble: None,
                counter_max: 15,
                delta_max: u64::from(*max_delta_counter),
            }
        }
        Wanted::AutosarP05 { checksum, counter, data_id, max_delta_counter } => {
            let checksum_bits = hold(checksum, "checksum", Some(16), faults);
            if checksum_bits.is_some_and(|bits| bits.whole_bytes().is_none() || !bits.low_byte_first()) {
                faults.note(
                    format!("{at}.protection.checksum"),
                    &message.name,
                    Some(checksum),
                    "must be two whole bytes, little endian",
                );
            }
            Protection {
                rule: Rule::CcittWithId { data_id: *data_id },
                checksum: checksum_bits,
                counter: hold(counter, "counter", Some(8), faults),
                nibble: None,
                counter_max: 255,
                delta_max: u64::from(*max_delta_counter),
            }
        }
        Wanted::Maker { scheme, checksum, counter, counter_max, constants, max_delta_counter } => {
            let size = if *scheme == MakerScheme::HyundaiNibble { 4 } else { 8 };
            let checksum_bits = hold(checksum, "checksum", Some(size), faults);
            let counter_bits = counter.as_ref().and_then(|name| hold(name, "counter", None, faults));
            let last = message.len.saturating_sub(1);
            let byte = checksum_bits.and_then(|bits| bits.whole_bytes()).map(|bytes| bytes.start);
            let wrong = match scheme {
                MakerScheme::Toyota | MakerScheme::Nissan
                    if checksum_bits.is_some() && byte != Some(last) =>
                {
                    Some("must be the last byte")
                }
                MakerScheme::VwMqb if checksum_bits.is_some() && byte != Some(0) => Some("must be byte 0"),
                MakerScheme::HyundaiCrc8 | MakerScheme::Tesla
                    if checksum_bits.is_some() && byte.is_none() =>
                {
                    Some("must be one whole byte")
                }
                MakerScheme::HyundaiSum6 | MakerScheme::HyundaiSum7 if message.len != 8 => {
                    Some("needs a message of 8 bytes")
                }
                _ => None,
            };
            if let Some(rule) = wrong {
                faults.note(format!("{at}.protection.checksum"), &message.name, Some(checksum), rule);
            }
            let rule = match (scheme, constants) {
                (MakerScheme::VwMqb, Some(constants)) if constants.len() == 1 => {
                    Rule::H2fWithList { list: [constants[0]; 16] }
                }
                (MakerScheme::VwMqb, Some(constants)) if constants.len() == 16 => {
                    let mut list = [0; 16];
                    list.copy_from_slice(constants);
                    Rule::H2fWithList { list }
                }
                (MakerScheme::VwMqb, _) => {
                    faults.note(
                        format!("{at}.protection.constants"),
                        &message.name,
                        Some(checksum),
                        "`vw_mqb` needs the message's constant: one, or one for each of 16 counter values",
                    );
                    Rule::None
                }
                (_, Some(_)) => {
                    faults.note(
                        format!("{at}.protection.constants"),
                        &message.name,
                        Some(checksum),
                        "is for `vw_mqb` only",
                    );
                    Rule::None
                }
                (scheme, None) => Rule::Maker(*scheme),
            };
            let counter_max = greatest(message, counter.as_deref(), counter_bits, *counter_max, at, faults);
            Protection {
                rule,
                checksum: checksum_bits,
                counter: counter_bits,
                nibble: None,
                counter_max,
                delta_max: u64::from(*max_delta_counter),
            }
        }
        Wanted::CounterOnly { counter, counter_max, max_delta_counter } => {
            let bits = hold(counter, "counter", None, faults);
            let counter_max = greatest(message, Some(counter), bits, *counter_max, at, faults);
            Protection {
                rule: Rule::None,
                checksum: None,
                counter: bits,
                nibble: None,
                counter_max,
                delta_max: u64::from(*max_delta_counter),
            }
        }
    };
    (faults.0.len() == before).then_some(protection)
}

fn layout_two(
    message: &Message,
    checksum: &str,
    checksum_bits: Option<crate::signal::Bits>,
    counter: &str,
    counter_bits: Option<crate::signal::Bits>,
    at: &str,
    faults: &mut Faults,
) {
    if checksum_bits.is_some_and(|bits| bits.whole_bytes() != Some(0..1)) {
        faults.note(format!("{at}.protection.checksum"), &message.name, Some(checksum), "must be byte 0");
    }
    if counter_bits.is_some_and(|bits| bits.lowest() != (1, 0)) {
        faults.note(
            format!("{at}.protection.counter"),
            &message.name,
            Some(counter),
            "must be the low nibble of byte 1",
        );
    }
}

fn greatest(
    message: &Message,
    name: Option<&str>,
    bits: Option<crate::signal::Bits>,
    said: Option<u8>,
    at: &str,
    faults: &mut Faults,
) -> u64 {
    let Some(bits) = bits else { return 0 };
    if bits.size() > 8 {
        faults.note(
            format!("{at}.protection.counter"),
            &message.name,
            name,
            format!("a counter has at most 8 bits, not {}", bits.size()),
        );
        return 0;
    }
    let top = u64::MAX >> (64 - bits.size());
    let max = said.map_or(top, u64::from);
    if max > top {
        faults.note(
            format!("{at}.protection.counter_max"),
            &message.name,
            name,
            format!("{max} does not fit {} bits", bits.size()),
        );
    }
    max
}
