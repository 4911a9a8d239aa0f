//! A DBC file as messages and signals ready for coding, and everything that is wrong with it, at once.
//!
//! Parsed by crate `can-dbc`, which stops at its first error, cuts standard identifiers to 16 bits and checks no
//! meaning. Hence here: an offending statement is noted and blanked, then the rest is read; identifiers are
//! checked in the text; what a signal needs to be coded is checked signal by signal. An offending signal is left
//! out of the database, so that the others of a foreign file can be used.

use crate::frame::{FD_LENGTHS, Id};
use crate::signal::{Bits, Codec, Number};
use can_dbc::{
    ByteOrder, Dbc, DbcError, MessageId, MultiplexIndicator, NumericValue, SignalExtendedValueType, ValueType,
};
use std::collections::BTreeMap;
use std::fmt;

/// Most syntax errors that are looked for.
const SYNTAX_MAX: usize = 50;

/// One message.
#[derive(Debug, Clone)]
pub struct Message {
    /// Identifier.
    pub id: Id,
    /// Name.
    pub name: String,
    /// Payload. [bytes]
    pub len: usize,
    /// Cycle time the file states (`GenMsgCycleTime`). [ms]
    pub cycle_ms: Option<f64>,
    /// Its signals.
    pub signals: Vec<Signal>,
}

/// One signal.
#[derive(Debug, Clone)]
pub struct Signal {
    /// Name.
    pub name: String,
    /// Its bits and scale.
    pub codec: Codec,
    /// Least and greatest value the file states; `None` where it says nothing (`[0|0]`).
    pub limits: Option<(f64, f64)>,
    /// Unit as written.
    pub unit: String,
    /// Names of raw values.
    pub values: Vec<(i64, String)>,
    /// Whether it selects other signals.
    pub is_multiplexor: bool,
    /// When it is there; `None`: always.
    pub selector: Option<Selector>,
}

/// When a multiplexed signal is there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Selector {
    /// Index of the multiplexor among the message's signals.
    pub multiplexor: usize,
    /// Raw values of it, inclusive ranges.
    pub ranges: Vec<(u64, u64)>,
}

/// How bad a fault of the file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weight {
    /// The statement cannot be used.
    Error,
    /// Strange, but usable.
    Warning,
}

/// Something wrong with the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Line, from 1; 0: the file as a whole.
    pub line: usize,
    /// Message it is about.
    pub message: Option<String>,
    /// Signal it is about.
    pub signal: Option<String>,
    /// How bad.
    pub weight: Weight,
    /// What should be.
    pub rule: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.message, &self.signal) {
            (Some(message), Some(signal)) => write!(f, "message {message}, signal {signal}: ")?,
            (Some(message), None) => write!(f, "message {message}: ")?,
            (None, Some(signal)) => write!(f, "signal {signal}: ")?,
            (None, None) => {}
        }
        write!(f, "{}", self.rule)
    }
}

/// A DBC file.
#[derive(Debug, Clone, Default)]
pub struct Database {
    /// Its messages, in the file's order.
    pub messages: Vec<Message>,
}

impl Message {
    /// A signal and its index, by name.
    pub fn signal(&self, name: &str) -> Option<(usize, &Signal)> {
        self.signals.iter().enumerate().find(|(_, signal)| signal.name == name)
    }

    /// Whether signal `index` is there in this payload (multiplexing).
    pub fn is_there(&self, index: usize, data: &[u8]) -> bool {
        let mut at = index;
        // A chain of multiplexors is at most as long as the list.
        for _ in 0..=self.signals.len() {
            let Some(selector) = &self.signals[at].selector else { return true };
            let raw = self.signals[selector.multiplexor].codec.bits.get(data);
            if !selector.ranges.iter().any(|&(low, high)| (low..=high).contains(&raw)) {
                return false;
            }
            at = selector.multiplexor;
        }
        false
    }
}

impl Database {
    /// The message of that name.
    pub fn message(&self, name: &str) -> Option<&Message> {
        self.messages.iter().find(|message| message.name == name)
    }

    /// The message of that identifier.
    pub fn by_id(&self, id: Id) -> Option<&Message> {
        self.messages.iter().find(|message| message.id == id)
    }

    /// Reads a DBC text: all that can be used, and all that is wrong.
    pub fn read(text: &str) -> (Self, Vec<Fault>) {
        let lines = Lines::of(text);
        let mut faults = lines.identifiers();
        let (dbc, syntax) = parse(text, &lines);
        faults.extend(syntax);
        let mut database = Database::default();
        if let Some(dbc) = dbc {
            for message in &dbc.messages {
                build(&dbc, message, &lines, &mut database, &mut faults);
            }
            lost_references(&dbc, &lines, &mut faults);
            if dbc.messages.is_empty() && faults.is_empty() {
                faults.push(Fault {
                    line: 0,
                    message: None,
                    signal: None,
                    weight: Weight::Error,
                    rule: "has no message (BO_)".to_owned(),
                });
            }
        }
        faults.sort_by_key(|fault| fault.line);
        (database, faults)
    }
}

/// Where messages and signals stand in the text.
struct Lines {
    /// Line of each message by its number, bit 31 for extended ones, and its name.
    messages: Vec<(usize, u64, String)>,
    /// Line of each signal: line, name.
    signals: Vec<(usize, String)>,
}

impl Lines {
    fn of(text: &str) -> Self {
        let mut lines = Lines { messages: Vec::new(), signals: Vec::new() };
        for (at, line) in text.lines().enumerate() {
            let mut words =
                line.split(|c: char| c.is_whitespace() || c == ':').filter(|word| !word.is_empty());
            match words.next() {
                Some("BO_") => {
                    let number = words.next().and_then(|word| word.parse().ok()).unwrap_or(u64::MAX);
                    lines.messages.push((at + 1, number, words.next().unwrap_or("").to_owned()));
                }
                Some("SG_") => lines.signals.push((at + 1, words.next().unwrap_or("").to_owned())),
                _ => {}
            }
        }
        lines
    }

    /// The message and, on a signal's line, the signal that line `line` belongs to.
    fn at(&self, line: usize) -> (Option<String>, Option<String>) {
        let signal = self.signals.iter().find(|(at, _)| *at == line).map(|(_, name)| name.clone());
        let message = self.messages.iter().rfind(|(at, ..)| *at <= line).map(|(_, _, name)| name.clone());
        let own = self.messages.iter().any(|(at, ..)| *at == line);
        (message.filter(|_| own || signal.is_some()), signal)
    }

    fn message(&self, name: &str) -> usize {
        self.messages.iter().find(|(.., n)| n == name).map_or(0, |(line, ..)| *line)
    }

    fn signal(&self, message: &str, signal: &str) -> usize {
        let from = self.message(message);
        self.signals
            .iter()
            .find(|(line, name)| *line > from && name == signal)
            .map_or(from, |(line, _)| *line)
    }

    /// What the parser lets pass: identifiers out of range.
    fn identifiers(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        for (line, number, name) in &self.messages {
            let number = *number;
            // Vector tools write 0xC0000000 for the collector of signals without a message.
            let fits =
                number <= 0x7FF || (0x8000_0000..=0x9FFF_FFFF).contains(&number) || number == 0xC000_0000;
            if !fits && number != u64::MAX {
                faults.push(Fault {
                    line: *line,
                    message: Some(name.clone()),
                    signal: None,
                    weight: Weight::Error,
                    rule: format!(
                        "identifier {number} must be at most 2047 (standard), or 2147483648 plus at most 536870911 (extended)"
                    ),
                });
            }
        }
        faults
    }
}

/// Parses, blanking each offending statement.
fn parse(text: &str, lines: &Lines) -> (Option<Dbc>, Vec<Fault>) {
    let mut faults = Vec::new();
    let mut rest: Vec<&str> = text.lines().collect();
    for _ in 0..SYNTAX_MAX {
        let mut whole = rest.join("\n");
        whole.push('\n');
        let error = match Dbc::try_from(whole.as_str()) {
            Ok(dbc) => return (Some(dbc), faults),
            Err(error) => error,
        };
        let DbcError::Pest(pest) = &error else {
            faults.push(Fault {
                line: 0,
                message: None,
                signal: None,
                weight: Weight::Error,
                rule: error.to_string(),
            });
            return (None, faults);
        };
        let (at, column) = line_of(pest);
        // The grammar often fails behind the line's end: the statement that is wrong starts above.
        let start =
            (1..=at.min(rest.len())).rev().find(|&line| !rest[line - 1].trim().is_empty()).unwrap_or(at);
        if start == 0 || start > rest.len() {
            faults.push(Fault {
                line: at,
                message: None,
                signal: None,
                weight: Weight::Error,
                rule: error.to_string(),
            });
            return (None, faults);
        }
        let (message, signal) = lines.at(start);
        let statement = rest[start - 1].trim();
        let shown: String = statement.chars().take(60).collect();
        faults.push(Fault {
            line: start,
            message,
            signal,
            weight: Weight::Error,
            rule: format!("is not DBC from column {column} on: `{shown}`"),
        });
        rest[start - 1] = "";
        if statement.starts_with("BO_ ") {
            // Its signals go with it: they would be taken for the message before.
            for line in rest.iter_mut().skip(start) {
                if !line.trim_start().starts_with("SG_ ") {
                    break;
                }
                *line = "";
            }
        }
    }
    (None, faults)
}

fn line_of(error: &dyn std::fmt::Display) -> (usize, usize) {
    // pest writes ` --> line:column` in its first line; its type is not part of can-dbc's interface.
    let text = error.to_string();
    let place = text.split("-->").nth(1).unwrap_or("").lines().next().unwrap_or("");
    let mut numbers = place.split(':').map(|number| number.trim().parse().unwrap_or(0));
    (numbers.next().unwrap_or(0), numbers.next().unwrap_or(0))
}

fn number(value: NumericValue) -> f64 {
    match value {
        NumericValue::Uint(value) => value as f64,
        NumericValue::Int(value) => value as f64,
        NumericValue::Double(value) => value,
    }
}

fn id_of(id: MessageId) -> Id {
    match id {
        MessageId::Standard(id) => Id::Standard(id),
        MessageId::Extended(id) => Id::Extended(id),
    }
}

fn build(
    dbc: &Dbc,
    from: &can_dbc::Message,
    lines: &Lines,
    database: &mut Database,
    faults: &mut Vec<Fault>,
) {
    if from.id.raw() == 0xC000_0000 || from.name == "VECTOR__INDEPENDENT_SIG_MSG" {
        return;
    }
    let mut note = |signal: Option<&str>, weight: Weight, rule: String| {
        let line =
            signal.map_or_else(|| lines.message(&from.name), |signal| lines.signal(&from.name, signal));
        faults.push(Fault {
            line,
            message: Some(from.name.clone()),
            signal: signal.map(str::to_owned),
            weight,
            rule,
        });
    };
    let id = id_of(from.id);
    if let Some(other) = database.by_id(id) {
        note(None, Weight::Error, format!("has the identifier {id} of message {}", other.name));
        return;
    }
    if database.message(&from.name).is_some() {
        note(None, Weight::Error, "occurs twice".to_owned());
        return;
    }
    let len = from.size as usize;
    if len > 64 {
        note(None, Weight::Error, format!("length {len} must be at most 64 bytes"));
        return;
    }
    if len > 8 && !FD_LENGTHS.contains(&len) {
        note(None, Weight::Warning, format!("length {len} is none that CAN FD can carry"));
    }
    let mut signals: Vec<Signal> = Vec::new();
    let mut selectors: Vec<(usize, MultiplexIndicator)> = Vec::new();
    for signal in &from.signals {
        let name = signal.name.as_str();
        let mut wrong = |rule: String| note(Some(name), Weight::Error, rule);
        if signals.iter().any(|other| other.name == name) {
            wrong("occurs twice".to_owned());
            continue;
        }
        let big_endian = signal.byte_order == ByteOrder::BigEndian;
        let Some(bits) = Bits::new(signal.start_bit, signal.size, big_endian) else {
            wrong(format!(
                "start bit {} and size {}: the size must be 1 to 64 bits, the start below 512",
                signal.start_bit, signal.size
            ));
            continue;
        };
        if bits.end() > len {
            wrong(format!("needs byte {} of the payload, which has {len}", bits.end()));
            continue;
        }
        if signal.factor == 0.0 || !signal.factor.is_finite() || !signal.offset.is_finite() {
            wrong(format!("factor {} must not be 0", signal.factor));
            continue;
        }
        let number_kind = match (dbc.extended_value_type_for_signal(from.id, name), signal.value_type) {
            (Some(SignalExtendedValueType::IEEEfloat32Bit), _) if signal.size == 32 => Number::Float,
            (Some(SignalExtendedValueType::IEEEdouble64bit), _) if signal.size == 64 => Number::Double,
            (Some(SignalExtendedValueType::IEEEfloat32Bit | SignalExtendedValueType::IEEEdouble64bit), _) => {
                wrong(format!(
                    "is a float (SIG_VALTYPE_) of {} bits: must be 32 for type 1, 64 for type 2",
                    signal.size
                ));
                continue;
            }
            (_, ValueType::Signed) => Number::Signed,
            (_, ValueType::Unsigned) => Number::Unsigned,
        };
        let (min, max) = (number(signal.min), number(signal.max));
        if min > max {
            wrong(format!("minimum {min} must not be above maximum {max}"));
            continue;
        }
        let values = dbc.value_descriptions_for_signal(from.id, name).unwrap_or(&[]);
        selectors.push((signals.len(), signal.multiplexer_indicator));
        signals.push(Signal {
            name: name.to_owned(),
            codec: Codec { bits, number: number_kind, factor: signal.factor, offset: signal.offset },
            limits: (min < max).then_some((min, max)),
            unit: signal.unit.trim().to_owned(),
            values: values.iter().map(|value| (value.id, value.description.clone())).collect(),
            is_multiplexor: matches!(
                signal.multiplexer_indicator,
                MultiplexIndicator::Multiplexor | MultiplexIndicator::MultiplexorAndMultiplexedSignal(_)
            ),
            selector: None,
        });
    }
    let unusable = select(dbc, from, &mut signals, &selectors, &mut note);
    overlaps(&signals, len, &mut note);
    for index in unusable {
        // Never there: no value of the multiplexor selects it.
        signals[index].selector = Some(Selector { multiplexor: index, ranges: Vec::new() });
    }
    let cycle_ms = match dbc.resolved_message_attribute(from.id, "GenMsgCycleTime") {
        Some(can_dbc::AttributeValue::Uint(ms)) => Some(*ms as f64),
        Some(can_dbc::AttributeValue::Double(ms)) => Some(*ms),
        _ => None,
    };
    database.messages.push(Message {
        id,
        name: from.name.clone(),
        len,
        cycle_ms: cycle_ms.filter(|ms| *ms > 0.0),
        signals,
    });
}

/// Finds each multiplexed signal's selector. Returns the signals that have none though they need one.
fn select(
    dbc: &Dbc,
    from: &can_dbc::Message,
    signals: &mut [Signal],
    indicators: &[(usize, MultiplexIndicator)],
    note: &mut impl FnMut(Option<&str>, Weight, String),
) -> Vec<usize> {
    let plain: Vec<usize> = indicators
        .iter()
        .filter(|(_, indicator)| *indicator == MultiplexIndicator::Multiplexor)
        .map(|(index, _)| *index)
        .collect();
    let mut unusable = Vec::new();
    for &(index, indicator) in indicators {
        let name = signals[index].name.clone();
        let extended = dbc
            .extended_multiplex
            .iter()
            .find(|extended| extended.message_id == from.id && extended.signal_name == name);
        let value = match indicator {
            MultiplexIndicator::MultiplexedSignal(value) => Some(value),
            MultiplexIndicator::MultiplexorAndMultiplexedSignal(value) => Some(value),
            MultiplexIndicator::Multiplexor | MultiplexIndicator::Plain => None,
        };
        let (multiplexor, ranges) = match (extended, value) {
            (Some(extended), _) => {
                let by = &extended.multiplexor_signal_name;
                let Some(multiplexor) = signals.iter().position(|s| s.name == *by && s.is_multiplexor) else {
                    note(
                        Some(&name),
                        Weight::Error,
                        format!("is selected by {by} (SG_MUL_VAL_), which is no multiplexor of the message"),
                    );
                    unusable.push(index);
                    continue;
                };
                (multiplexor, extended.mappings.iter().map(|m| (m.min_value, m.max_value)).collect())
            }
            (None, Some(value)) => match plain.as_slice() {
                [one] => (*one, vec![(value, value)]),
                [] => {
                    note(
                        Some(&name),
                        Weight::Error,
                        format!("is selected by value {value} of a multiplexor, but the message has none"),
                    );
                    unusable.push(index);
                    continue;
                }
                _ => {
                    note(Some(&name), Weight::Error, "is multiplexed, and the message has several multiplexors without saying which (SG_MUL_VAL_)".to_owned());
                    unusable.push(index);
                    continue;
                }
            },
            (None, None) => continue,
        };
        let top = signals[multiplexor].codec.bits.size();
        let limit = u64::MAX >> (64 - top);
        if let Some((low, _)) = ranges.iter().find(|(low, high)| low > high || *low > limit) {
            note(
                Some(&name),
                Weight::Error,
                format!(
                    "is selected by value {low}, which {} with its {top} bits cannot take",
                    signals[multiplexor].name
                ),
            );
            unusable.push(index);
            continue;
        }
        if multiplexor == index {
            note(Some(&name), Weight::Error, "selects itself".to_owned());
            unusable.push(index);
            continue;
        }
        signals[index].selector = Some(Selector { multiplexor, ranges });
    }
    unusable
}

/// Notes signals that share bits though both can be there at once.
fn overlaps(signals: &[Signal], len: usize, note: &mut impl FnMut(Option<&str>, Weight, String)) {
    let marks: Vec<Vec<u8>> = signals
        .iter()
        .map(|signal| {
            let mut marks = vec![0; len];
            signal.codec.bits.mark(&mut marks);
            marks
        })
        .collect();
    for (i, signal) in signals.iter().enumerate() {
        for j in 0..i {
            let shares = marks[i].iter().zip(&marks[j]).any(|(a, b)| a & b != 0);
            if shares && !exclusive(signals, i, j) {
                note(
                    Some(&signal.name),
                    Weight::Warning,
                    format!("shares bits with signal {}", signals[j].name),
                );
                break;
            }
        }
    }
}

/// Whether two signals are never there together: selected by different values of the same multiplexor.
pub fn exclusive(signals: &[Signal], i: usize, j: usize) -> bool {
    let (Some(a), Some(b)) = (&signals[i].selector, &signals[j].selector) else { return false };
    let apart =
        |a: &Selector, b: &Selector| a.ranges.iter().all(|x| b.ranges.iter().all(|y| x.1 < y.0 || y.1 < x.0));
    if a.multiplexor == b.multiplexor {
        return apart(a, b);
    }
    // Nested: their multiplexors may exclude each other.
    (a.multiplexor != j && signals[a.multiplexor].selector.is_some() && exclusive(signals, a.multiplexor, j))
        || (b.multiplexor != i
            && signals[b.multiplexor].selector.is_some()
            && exclusive(signals, i, b.multiplexor))
}

/// Statements about messages and signals that are not there.
fn lost_references(dbc: &Dbc, lines: &Lines, faults: &mut Vec<Fault>) {
    let names: BTreeMap<u32, &can_dbc::Message> = dbc.messages.iter().map(|m| (m.id.raw(), m)).collect();
    let mut note = |id: MessageId, signal: &str, what: &str| {
        let message = names.get(&id.raw());
        if message.is_some_and(|message| message.signals.iter().any(|s| s.name == signal)) {
            return;
        }
        let known = message.map_or_else(|| id_of(id).to_string(), |message| message.name.clone());
        let line = message.map_or(0, |message| lines.message(&message.name));
        let rule = match message {
            Some(_) => format!("{what} speaks of it, but the message has no such signal"),
            None => format!("{what} speaks of it, but there is no such message"),
        };
        // A broken statement elsewhere has its own fault; this one follows from it.
        if faults.iter().all(|f| f.signal.as_deref() != Some(signal) && f.message.as_ref() != Some(&known)) {
            faults.push(Fault {
                line,
                message: Some(known),
                signal: Some(signal.to_owned()),
                weight: Weight::Error,
                rule,
            });
        }
    };
    for float in &dbc.signal_extended_value_type_list {
        note(float.message_id, &float.signal_name, "SIG_VALTYPE_");
    }
    for extended in &dbc.extended_multiplex {
        note(extended.message_id, &extended.signal_name, "SG_MUL_VAL_");
    }
}
