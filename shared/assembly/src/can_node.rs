//! The CAN node: reads regions, keeps the rest-bus going, takes what comes from the ECU into region `can`.
//!
//! Off the loop: nothing in the tick waits for it. With a bus in memory a step is pure, as every other node's,
//! and lockstep runs are equal; with a socket it makes system calls, so that only its own process runs it so.

use crate::AssemblyError;
use can::bus::{Bus, Event};
use can::ecu::{self, MemoryBus, VirtualEcu};
use can::fault::{Faults, Spell};
use can::mapping::{Plan, Variable, compile};
use can::receive::{Receiver, status};
use can::restbus::RestBus;
use can::{Database, database};
use config::can::{Can as Mapping, CanFault, FaultKind};
use config::{Broken, ResolvedBench, TextFile};
use regions::layout::{Column, Kind};
use regions::{Can, Fault, NO_TICK, Payload, RegionId, can_flags, fault_kind};
use runtime::{InputSpec, Inputs, Model, NodeSpec, Step, When};

/// Regions whose fields may be sent, in the order of the node's inputs.
const SOURCES: [RegionId; 4] =
    [RegionId::RigMeasurement, RegionId::VehicleState, RegionId::SuspensionState, RegionId::RigStatus];
const READS: &[InputSpec] = &[
    InputSpec { region: SOURCES[0], when: When::Latest },
    InputSpec { region: SOURCES[1], when: When::Latest },
    InputSpec { region: SOURCES[2], when: When::Latest },
    InputSpec { region: SOURCES[3], when: When::Latest },
];
const NODES: &[NodeSpec] =
    &[NodeSpec { name: "can", reads: READS, writes: RegionId::Can, checkpoint: None, rings: true }];

const _: () = assert!(
    status::NEVER == regions::can_status::NEVER
        && status::TIMEOUT == regions::can_status::TIMEOUT
        && status::CHECKSUM == regions::can_status::CHECKSUM
        && status::REPEATED == regions::can_status::REPEATED
        && status::SEQUENCE == regions::can_status::SEQUENCE
        && status::SOME_LOST == regions::can_status::SOME_LOST
        && status::IMPLAUSIBLE == regions::can_status::IMPLAUSIBLE
        && status::LENGTH == regions::can_status::LENGTH,
    "region and receiver name the same bits"
);

/// Most frames taken in one tick: a bus cannot bring more in a millisecond than a flood would.
const TAKEN_MAX: usize = 256;

fn columns() -> Vec<(usize, String, Column)> {
    SOURCES
        .iter()
        .enumerate()
        .flat_map(|(input, id)| {
            let region = id.region();
            let whole = ["state", "trip_code"];
            region
                .layout
                .columns()
                .into_iter()
                .filter(move |column| {
                    column.kind == Kind::F64
                        || (*id == RegionId::RigStatus && whole.contains(&column.name.as_str()))
                })
                .map(move |column| (input, format!("{}.{}", region.name, column.name), column))
        })
        .collect()
}

/// What a mapping may send: fields of the table's regions.
pub fn can_sources() -> Vec<Variable> {
    columns().into_iter().map(|(_, name, column)| Variable { name, unit: column.unit.to_owned() }).collect()
}

/// What a mapping may receive into: values of region `can`.
pub fn can_targets() -> Vec<Variable> {
    targets()
        .map(|column| Variable { name: format!("can.{}", column.name), unit: column.unit.to_owned() })
        .collect()
}

fn targets() -> impl Iterator<Item = Column> {
    let own = |column: &Column| column.name.starts_with("ecu_") || column.name.starts_with("value.");
    Can::LAYOUT.columns().into_iter().filter(move |column| own(column))
}

/// Everything that a CAN node is made of.
#[derive(Debug, Clone)]
pub struct CanParts {
    /// What is sent and received.
    pub plan: Plan,
    /// Faults injected.
    pub faults: Faults,
}

impl CanParts {
    /// Joins the mapping with its DBC, the regions and the scenario's faults.
    ///
    /// # Errors
    /// Everything that does not fit, naming message and signal.
    pub fn new(resolved: &ResolvedBench) -> Result<Option<Self>, AssemblyError> {
        let (Some(run), Some(can)) = (&resolved.scenario.can, &resolved.can) else { return Ok(None) };
        let plan = join(&can.mapping, &can.dbc, &can_sources(), &can_targets())?;
        if plan.receive.len() > Can::absent().message_status.len() {
            return Err(AssemblyError::new("can", ["more than 16 messages are received"]));
        }
        let wanted = run.faults.as_deref().unwrap_or(&[]);
        let faults = Faults::compile(&plan, wanted).map_err(|broken| faults_of(&broken))?;
        Ok(Some(CanParts { plan, faults }))
    }
}

/// Effects in the order of their codes in an order to the CAN service.
const EFFECTS: [FaultKind; 4] =
    [FaultKind::Drop, FaultKind::Delay, FaultKind::StaleCounter, FaultKind::WrongCrc];

/// Whether a message of the mapping is sent or received, and its place there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CanMessage {
    /// Sent by the bench.
    Sent(usize),
    /// Received from the ECU.
    Received(usize),
}

/// What a fault campaign orders of the CAN service: the values of an order of kind `CAN` in region `faults`, and the
/// message meant. `None`: the scenario has no bus.
///
/// # Errors
/// What does not fit the mapping: no such message, or one without the counter or checksum that is to be wrong.
pub fn can_order(
    resolved: &ResolvedBench,
    fault: &CanFault,
) -> Result<Option<([f64; 4], CanMessage)>, AssemblyError> {
    let Some(parts) = CanParts::new(resolved)? else { return Ok(None) };
    Faults::compile(&parts.plan, std::slice::from_ref(fault)).map_err(|broken| faults_of(&broken))?;
    let sent = parts.plan.send.iter().position(|message| message.name == fault.message);
    let received = parts.plan.receive.iter().position(|message| message.name == fault.message);
    let (number, message) = match (sent, received) {
        (Some(k), _) => (k, CanMessage::Sent(k)),
        (None, Some(k)) => (parts.plan.send.len() + k, CanMessage::Received(k)),
        (None, None) => return Ok(None),
    };
    let effect = EFFECTS.iter().position(|effect| *effect == fault.fault).unwrap_or(0);
    let delay_s = fault.delay_ms.map_or(0.0, |ms| ms * 1e-3);
    Ok(Some(([number as f64, effect as f64, delay_s, 0.0], message)))
}

fn faults_of(broken: &[Broken]) -> AssemblyError {
    AssemblyError::new("can", broken.iter().map(|broken| format!("{}: {}", broken.key, broken.rule)))
}

fn join(
    mapping: &Mapping,
    dbc: &TextFile,
    sources: &[Variable],
    targets: &[Variable],
) -> Result<Plan, AssemblyError> {
    let (database, faults) = Database::read(&dbc.text);
    let plan = compile(mapping, &database, sources, targets);
    plan.map_err(|broken| {
        // What is wrong with the DBC explains what the mapping misses in it.
        let named = |fault: &&database::Fault| fault.weight == database::Weight::Error;
        let mut lines: Vec<String> = faults
            .iter()
            .filter(named)
            .map(|fault| format!("{}:{}: {fault}", dbc.name, fault.line))
            .collect();
        lines.extend(broken.iter().map(|broken| format!("{}: {}", broken.key, broken.rule)));
        AssemblyError::new("can", lines)
    })
}

/// The virtual ECU with its shipped mapping.
///
/// # Errors
/// What does not fit, which would be a fault of the shipped files.
pub fn virtual_ecu() -> Result<VirtualEcu, AssemblyError> {
    let (mapping, dbc) =
        config::load_can("virtual_ecu").map_err(|problems| AssemblyError::new("can", [problems]))?;
    Ok(VirtualEcu::new(join(&mapping.value, &dbc, &ecu::sources(), &ecu::targets())?))
}

/// Builds the node of a scenario that asks for a bus, `None` if it does not. Without a `bus` it is one in memory
/// with the virtual ECU on it; `fallback`: that one stands in for an interface.
///
/// # Errors
/// Everything that does not fit.
pub fn build_can(
    resolved: &ResolvedBench,
    bus: Option<Box<dyn Bus>>,
    fallback: bool,
) -> Result<Option<Box<dyn Model>>, AssemblyError> {
    let Some(parts) = CanParts::new(resolved)? else { return Ok(None) };
    let bus = match bus {
        Some(bus) => bus,
        None => Box::new(MemoryBus::new(virtual_ecu()?)),
    };
    Ok(Some(Box::new(CanNode::new(parts, resolved.scenario.timing.period_ns(), bus, fallback))))
}

/// A variable's place: input and word, and whether it is a whole number.
#[derive(Debug, Clone, Copy)]
struct Place {
    input: usize,
    word: usize,
    whole: bool,
}

/// The node.
pub struct CanNode {
    bus: Box<dyn Bus>,
    rest_bus: RestBus,
    receiver: Receiver,
    period_ns: u64,
    fallback: bool,
    /// Places of the variables by the plan's index; only those used are read.
    places: Vec<Place>,
    used: Vec<usize>,
    sources: Vec<f64>,
    targets: Vec<f64>,
    words: Vec<usize>,
    received: u64,
    bus_errors: u64,
    /// Time of the last step. [ns]
    now_ns: u64,
}

impl CanNode {
    /// From its parts.
    pub fn new(parts: CanParts, period_ns: u64, bus: Box<dyn Bus>, fallback: bool) -> Self {
        let places: Vec<Place> = columns()
            .iter()
            .map(|(input, _, column)| Place {
                input: *input,
                word: column.word,
                whole: column.kind == Kind::U64,
            })
            .collect();
        let mut used: Vec<usize> = parts
            .plan
            .send
            .iter()
            .flat_map(|message| message.fields.iter().map(|field| field.source))
            .collect();
        used.sort_unstable();
        used.dedup();
        let words: Vec<usize> = targets().map(|column| column.word).collect();
        CanNode {
            bus,
            rest_bus: RestBus::new(parts.plan.send, &parts.faults),
            receiver: Receiver::new(parts.plan.receive, &parts.faults),
            period_ns,
            fallback,
            sources: vec![f64::NAN; places.len()],
            targets: vec![f64::NAN; words.len()],
            places,
            used,
            words,
            received: 0,
            bus_errors: 0,
            now_ns: 0,
        }
    }
}

impl Model for CanNode {
    fn nodes(&self) -> &'static [NodeSpec] {
        NODES
    }

    /// `value`: number of the message (those sent first, then those received), effect by [`EFFECTS`], delay \[s\].
    fn fault(&mut self, order: &Fault) {
        let [number, effect, delay_s, _] = order.value;
        let (number, sent) = (number as usize, self.rest_bus.plan().len());
        let Some(&kind) = EFFECTS.get(effect as usize) else { return };
        if order.kind != fault_kind::CAN {
            return;
        }
        let spell = Spell {
            kind,
            start_ns: order.from_tick.saturating_mul(self.period_ns),
            end_ns: order.end_tick.saturating_mul(self.period_ns),
            delay_ns: (delay_s.clamp(0.0, 3600.0) * 1e9) as u64,
        };
        let now_ns = self.now_ns;
        if let Some(k) = number.checked_sub(sent) {
            self.receiver.inject(k, now_ns, spell);
            return;
        }
        // The pages of a multiplexed message are sent one by one under one name: all of them.
        for k in 0..sent {
            if self.rest_bus.plan()[k].name == self.rest_bus.plan()[number].name {
                self.rest_bus.inject(k, now_ns, spell);
            }
        }
    }

    fn step(&mut self, _node: usize, step: &Step, inputs: &Inputs, output: &mut [u64]) {
        self.now_ns = step.n * self.period_ns;
        let now_ns = step.n * self.period_ns;
        for &index in &self.used {
            let place = self.places[index];
            let (words, input) = inputs.words(place.input);
            let word = words[place.word];
            self.sources[index] = match (input.tick() == NO_TICK, place.whole) {
                (true, _) => f64::NAN,
                (_, true) => word as f64,
                (_, false) => f64::from_bits(word),
            };
        }
        let errors = self.bus_errors;
        let mut taken = 0;
        while taken < TAKEN_MAX {
            match self.bus.receive() {
                Ok(Some(Event::Frame(frame))) => {
                    self.received += 1;
                    self.receiver.take(now_ns, &frame, &mut self.targets);
                }
                Ok(Some(Event::Error(_))) => self.bus_errors += 1,
                Ok(None) => break,
                Err(_) => {
                    self.bus_errors += 1;
                    break;
                }
            }
            taken += 1;
        }
        self.receiver.step(now_ns, &mut self.targets);
        let refused = self.rest_bus.counts().refused;
        self.rest_bus.step(now_ns, &self.sources, &mut *self.bus);
        self.bus.advance(now_ns);

        let mut state = Can::absent();
        let counts = self.rest_bus.counts();
        state.tick = step.n;
        state.time_s = now_ns as f64 * 1e-9;
        state.used_rig_measurement = inputs.words(0).1.tick();
        state.used_vehicle_state = inputs.words(1).1.tick();
        state.sent_count = counts.sent;
        state.received_count = self.received;
        state.refused_count = counts.refused;
        state.withheld_count = counts.withheld;
        state.skipped_count = counts.skipped;
        state.clamped_count = counts.clamped;
        state.injected_count = counts.injected + self.receiver.injected();
        state.unknown_count = self.receiver.unknown();
        state.bus_error_count = self.bus_errors;
        let mut all = 0;
        for index in 0..self.receiver.plan().len() {
            let known = self.receiver.known(index);
            all |= known.status;
            state.message_status[index] = known.status;
            if let Some(last) = known.last_ns {
                state.message_age_s[index] = now_ns.saturating_sub(last) as f64 * 1e-9;
            }
            state.message_good_count[index] = known.good;
            state.message_wrong_count[index] = known.wrong;
            state.message_sequence_count[index] = known.sequence;
            state.message_lost_count[index] = known.lost;
            state.message_implausible_count[index] = known.implausible;
            state.message_timeout_count[index] = known.timeouts;
        }
        let flag = |on: bool, bit: u64| if on { bit } else { 0 };
        state.flags = flag(self.bus.in_memory(), can_flags::IN_MEMORY)
            | flag(self.fallback, can_flags::FALLBACK)
            | flag(self.bus_errors > errors || counts.refused > refused, can_flags::BUS_ERROR)
            | flag(all & status::ABSENT != 0, can_flags::MESSAGE_ABSENT)
            | flag(all & status::IMPLAUSIBLE != 0, can_flags::IMPLAUSIBLE)
            | flag(state.injected_count > 0, can_flags::INJECTED);
        let words = state.words_mut();
        for (&word, value) in self.words.iter().zip(&self.targets) {
            words[word] = value.to_bits();
        }
        output.copy_from_slice(state.words());
    }
}
