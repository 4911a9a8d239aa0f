//! CAN: which DBC signal carries which variable of the bench, with cycle times, protection and time-outs; and a
//! scenario's wish for a bus and for faults on it.
//!
//! The mapping file names messages and signals as the DBC does and variables as the table does
//! (`vehicle_state.velocity_m_s.x`). Units are converted from the variable's to the DBC's; where the DBC is
//! silent about a unit, the mapping says it. Protection: AUTOSAR E2E profiles 1, 2, 5, 11 (AUTOSAR FO PRS
//! E2EProtocol) and makers' schemes. What does not fit the DBC is found by crate `can`, which reads it.

use crate::check::{Check, Checker};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A mapping file: one bus.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Can {
    /// What this bus is, in a sentence or two.
    pub description: String,
    /// DBC file: a path beside this file, or the name of a shipped one.
    pub dbc_file: String,
    /// Messages sent.
    pub send: Vec<SendMessage>,
    /// Messages received.
    pub receive: Vec<ReceiveMessage>,
}

/// A message sent in a cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SendMessage {
    /// Message by its name in the DBC.
    pub message: String,
    /// Cycle time. [ms], [0.25, 60000]
    #[schemars(range(min = 0.25, max = 60_000.0))]
    pub cycle_ms: f64,
    /// First time it is sent, to spread the load. [ms], [0, 60000]
    #[schemars(range(min = 0.0, max = 60_000.0))]
    pub offset_ms: f64,
    /// How the frame is made.
    pub frame: FrameKind,
    /// Counter and checksum; absent: the message has none.
    pub protection: Option<Protection>,
    /// Its signals; bits of signals that are not named are sent as 0.
    pub signals: Vec<SendSignal>,
}

/// Kinds of CAN frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FrameKind {
    /// Classic CAN, up to 8 bytes.
    Classic,
    /// CAN FD, up to 64 bytes.
    Fd,
    /// CAN FD with the faster bit rate in the data phase.
    FdBrs,
}

/// A signal sent: either from a variable or with a fixed value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SendSignal {
    /// Signal by its name in the DBC.
    pub signal: String,
    /// Variable it carries; absent where `value` is given.
    pub source: Option<String>,
    /// Fixed value in the DBC's unit; absent where `source` is given.
    pub value: Option<f64>,
    /// Unit of the signal where the DBC states none (or another spelling of what it states).
    pub unit: Option<String>,
    /// The signal is this many times the variable, after conversion of units (-1 turns a sign round); absent: once.
    pub gain: Option<f64>,
    /// Raw value that says "not available" while the variable is absent (NaN); without it the whole message is
    /// not sent meanwhile.
    pub absent_raw: Option<u64>,
}

/// A message received.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReceiveMessage {
    /// Message by its name in the DBC.
    pub message: String,
    /// Without a good frame for this long its variables are absent (NaN). [ms], [1, 60000]
    #[schemars(range(min = 1.0, max = 60_000.0))]
    pub timeout_ms: f64,
    /// Counter and checksum; absent: the message has none.
    pub protection: Option<Protection>,
    /// Its signals; those not named are not looked at.
    pub signals: Vec<ReceiveSignal>,
}

/// A signal received.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReceiveSignal {
    /// Signal by its name in the DBC.
    pub signal: String,
    /// Variable it goes to, a field of region `can`.
    pub target: String,
    /// Unit of the signal where the DBC states none.
    pub unit: Option<String>,
    /// The variable is this many times the signal, after conversion of units; absent: once.
    pub gain: Option<f64>,
    /// Least plausible value, in the variable's unit; below it the variable is absent and counted.
    pub min: Option<f64>,
    /// Greatest plausible value, in the variable's unit.
    pub max: Option<f64>,
    /// Greatest plausible change from one good frame to the next, in the variable's unit per second.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub rate_max_per_s: Option<f64>,
}

/// Counter and checksum of a message: the DBC's signals that hold them and the rule that fills them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Protection {
    /// AUTOSAR E2E profile 1: CRC-8 SAE J1850 (start 0, no final XOR) over Data ID and data, counter 0 to 14.
    AutosarP01 {
        /// 8-bit signal of the CRC.
        checksum: String,
        /// 4-bit signal of the counter.
        counter: String,
        /// 4-bit signal of the Data ID's nibble, in mode `nibble` only.
        data_id_nibble: Option<String>,
        /// Data ID.
        data_id: u16,
        /// Which part of the Data ID the CRC covers.
        data_id_mode: DataIdMode,
        /// Largest step of the counter that is still accepted. [frames], [1, 14]
        #[schemars(range(min = 1, max = 14))]
        max_delta_counter: u8,
    },
    /// AUTOSAR E2E profile 2: CRC-8H2F over the data behind the CRC and the counter's entry of the Data ID list,
    /// counter 0 to 15. CRC in byte 0, counter in the low nibble of byte 1.
    AutosarP02 {
        /// 8-bit signal of the CRC.
        checksum: String,
        /// 4-bit signal of the counter.
        counter: String,
        /// Data ID of each counter value.
        #[schemars(length(min = 16, max = 16))]
        data_id_list: Vec<u8>,
        /// Largest step of the counter that is still accepted. [frames], [1, 15]
        #[schemars(range(min = 1, max = 15))]
        max_delta_counter: u8,
    },
    /// AUTOSAR E2E profile 5: CRC-16 CCITT-FALSE, low byte first, over data and Data ID, counter 0 to 255.
    AutosarP05 {
        /// 16-bit signal of the CRC, little endian.
        checksum: String,
        /// 8-bit signal of the counter.
        counter: String,
        /// Data ID.
        data_id: u16,
        /// Largest step of the counter that is still accepted. [frames], [1, 254]
        #[schemars(range(min = 1, max = 254))]
        max_delta_counter: u8,
    },
    /// AUTOSAR E2E profile 11: bus-compatible with profile 1 in modes `both` and `nibble`.
    AutosarP11 {
        /// 8-bit signal of the CRC.
        checksum: String,
        /// 4-bit signal of the counter.
        counter: String,
        /// 4-bit signal of the Data ID's nibble, in mode `nibble` only.
        data_id_nibble: Option<String>,
        /// Data ID.
        data_id: u16,
        /// `both` or `nibble`.
        data_id_mode: DataIdMode,
        /// Largest step of the counter that is still accepted. [frames], [1, 14]
        #[schemars(range(min = 1, max = 14))]
        max_delta_counter: u8,
    },
    /// A car maker's scheme.
    Maker {
        /// Which.
        scheme: MakerScheme,
        /// Signal of the checksum.
        checksum: String,
        /// Signal of the counter; absent: the message has none.
        counter: Option<String>,
        /// Greatest counter value before it starts again at 0; absent: all its bits. [1, 255]
        #[schemars(range(min = 1, max = 255))]
        counter_max: Option<u8>,
        /// For `vw_mqb`: the message's constant, one for all counter values or one for each.
        constants: Option<Vec<u8>>,
        /// Largest step of the counter that is still accepted. [frames], [1, 254]
        #[schemars(range(min = 1, max = 254))]
        max_delta_counter: u8,
    },
    /// A counter without checksum.
    CounterOnly {
        /// Signal of the counter.
        counter: String,
        /// Greatest counter value before it starts again at 0; absent: all its bits. [1, 255]
        #[schemars(range(min = 1, max = 255))]
        counter_max: Option<u8>,
        /// Largest step of the counter that is still accepted. [frames], [1, 254]
        #[schemars(range(min = 1, max = 254))]
        max_delta_counter: u8,
    },
}

/// Data ID inclusion modes of AUTOSAR profiles 1 and 11.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DataIdMode {
    /// Both bytes, low first (1A, 11A).
    Both,
    /// Low byte with even counters, high byte with odd ones (1B).
    Alternating,
    /// Low byte only.
    Low,
    /// Low byte in the CRC, the high byte's low nibble in the data (1C, 11C).
    Nibble,
}

/// Car makers' checksums, as reverse engineered by the opendbc project.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MakerScheme {
    /// Toyota: sum of length, address bytes and data but the last byte, which holds it.
    Toyota,
    /// Nissan: CRC-8 SAE J1850 (start 0xFF, final XOR 0xFF) over all but the last byte, which holds it.
    Nissan,
    /// Volkswagen MQB: CRC-8H2F over bytes 1 to last, then the message's constant; held by byte 0.
    VwMqb,
    /// Hyundai/Kia: CRC-8 poly 0x1D (start 0x22, final XOR 0xDF) over all bytes but the one that holds it.
    HyundaiCrc8,
    /// Hyundai/Kia: sum of the first six bytes.
    HyundaiSum6,
    /// Hyundai/Kia: sum of the first six bytes and the eighth.
    HyundaiSum7,
    /// Hyundai/Kia: 16 minus the sum of all nibbles, modulo 16.
    HyundaiNibble,
    /// Tesla: sum of address bytes and data but the byte that holds it.
    Tesla,
}

/// A scenario's wish for a bus.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CanRun {
    /// Mapping file: a path beside this file, or the bare name of a shipped one.
    pub mapping_file: String,
    /// SocketCAN interface (`can0`, `vcan0`) with the ECU on it. Absent, in lockstep, and where the kernel has no
    /// such interface: a bus in memory with the virtual ECU on it.
    #[schemars(length(min = 1, max = 15))]
    pub interface: Option<String>,
    /// Who drives the steering unit's assist motor; absent: the unit's own ECU.
    pub assist: Option<AssistSource>,
    /// Faults put on the bus.
    pub faults: Option<Vec<CanFault>>,
}

/// Who drives the steering unit's assist motor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AssistSource {
    /// The ECU of the unit's own file.
    Unit,
    /// The ECU on the bus: the motor gives what is received into `can.ecu_assist_torque_n_m`, as far as the rig's
    /// limits allow.
    Ecu,
}

/// A fault of one message in a spell of time: made by the bench on what it sends, or on what it receives before
/// that is checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CanFault {
    /// Message, sent or received, by its name in the DBC.
    pub message: String,
    /// What happens to it.
    pub fault: FaultKind,
    /// Begin, from tick 0. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// End; absent: to the end of the run. [s], [0, 86400]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub end_s: Option<f64>,
    /// For `delay`: by how much. [ms], (0, 10000]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 10_000.0))]
    pub delay_ms: Option<f64>,
}

/// What can happen to a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// Frames are lost.
    Drop,
    /// Frames come late.
    Delay,
    /// The counter stands still; the checksum fits it.
    StaleCounter,
    /// The checksum is wrong.
    WrongCrc,
}

impl Check for Can {
    fn check(&self, c: &mut Checker) {
        c.require(
            !self.send.is_empty() || !self.receive.is_empty(),
            "send",
            "must have at least one message, here or in `receive`",
        );
        let mut seen = Vec::new();
        for (i, message) in self.send.iter().enumerate() {
            c.within(&format!("send[{i}]"), |c| {
                // The pages of a multiplexed message are sent one by one; a counter could not follow them.
                let rule = format!(
                    "message {}: sent twice, which only one without protection can be",
                    message.message
                );
                let protected = message.protection.is_some();
                let twice =
                    seen.iter().any(|(name, before)| *name == &message.message && (*before || protected));
                c.require(!twice, "message", rule);
                seen.push((&message.message, protected));
                for (j, signal) in message.signals.iter().enumerate() {
                    let both = signal.source.is_some() == signal.value.is_some();
                    let rule = format!(
                        "message {}, signal {}: must have either a `source` or a `value`",
                        message.message, signal.signal
                    );
                    c.require(!both, &format!("signals[{j}].source"), rule);
                    let rule =
                        format!("message {}, signal {}: must not be 0", message.message, signal.signal);
                    c.require(signal.gain != Some(0.0), &format!("signals[{j}].gain"), rule);
                }
            });
        }
        let mut seen = Vec::new();
        for (i, message) in self.receive.iter().enumerate() {
            c.within(&format!("receive[{i}]"), |c| {
                let rule = format!("message {}: received twice", message.message);
                c.require(!seen.contains(&&message.message), "message", rule);
                seen.push(&message.message);
                for (j, signal) in message.signals.iter().enumerate() {
                    let name = format!("message {}, signal {}", message.message, signal.signal);
                    let rule = format!("{name}: must not be 0");
                    c.require(signal.gain != Some(0.0), &format!("signals[{j}].gain"), rule);
                    if let (Some(min), Some(max)) = (signal.min, signal.max) {
                        let rule = format!("{name}: must be greater than min ({min})");
                        c.require(max > min, &format!("signals[{j}].max"), rule);
                    }
                }
            });
        }
    }
}

impl Check for CanRun {
    fn check(&self, c: &mut Checker) {
        for (i, fault) in self.faults.iter().flatten().enumerate() {
            c.within(&format!("faults[{i}]"), |c| {
                let after = fault.end_s.is_none_or(|end| end > fault.start_s);
                c.require(after, "end_s", "must be later than start_s");
                let fits = (fault.fault == FaultKind::Delay) == fault.delay_ms.is_some();
                c.require(fits, "delay_ms", "must be given for `delay`, and for nothing else");
            });
        }
    }
}
