//! The bench's rest-bus and the virtual ECU on a bus in memory: cycles, faults, time-outs, plausibility, no heap.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use can::bus::{Bus, BusError, Event};
use can::ecu::{self, MemoryBus, VirtualEcu, state};
use can::fault::Faults;
use can::mapping::{Plan, Variable, compile};
use can::receive::{Receiver, status};
use can::restbus::RestBus;
use can::{Database, Frame, Id};
use config::can::{Can, CanFault, FaultKind};

#[global_allocator]
static ALLOCATOR: assert_no_alloc::AllocDisabler = assert_no_alloc::AllocDisabler;

const MS: u64 = 1_000_000;

/// The unit that a variable's name ends with.
fn unit(name: &str) -> &'static str {
    let name = name.split('.').nth(1).unwrap();
    let ends = [
        ("_m_s2", "m/s^2"),
        ("_rad_s", "rad/s"),
        ("_m_s", "m/s"),
        ("_n_m", "N*m"),
        ("_rad", "rad"),
        ("_k", "K"),
        ("_v", "V"),
        ("_m", "m"),
    ];
    ends.iter().find(|(end, _)| name.ends_with(end)).map_or("1", |(_, unit)| unit)
}

fn variable(name: &str) -> Variable {
    Variable { name: name.to_owned(), unit: unit(name).to_owned() }
}

fn mapping() -> (Can, Database) {
    let (loaded, dbc) = config::load_can("steering_rest_bus").unwrap();
    let (database, faults) = Database::read(&dbc.text);
    assert_eq!(faults, [], "the shipped DBC is without fault");
    (loaded.value, database)
}

fn bench_plan(mapping: &Can, database: &Database) -> (Plan, Vec<String>, Vec<String>) {
    let sources = mapping.send.iter().flat_map(|m| m.signals.iter().filter_map(|s| s.source.clone()));
    let targets = mapping.receive.iter().flat_map(|m| m.signals.iter().map(|s| s.target.clone()));
    let (sources, targets): (Vec<_>, Vec<_>) = (sources.collect(), targets.collect());
    let variables = |names: &[String]| names.iter().map(|name| variable(name)).collect::<Vec<_>>();
    let plan = compile(mapping, database, &variables(&sources), &variables(&targets)).unwrap();
    (plan, sources, targets)
}

fn new_ecu() -> VirtualEcu {
    let (loaded, dbc) = config::load_can("virtual_ecu").unwrap();
    let (database, _) = Database::read(&dbc.text);
    VirtualEcu::new(compile(&loaded.value, &database, &ecu::sources(), &ecu::targets()).unwrap())
}

/// A bus that remembers when what was sent.
struct Tap {
    bus: MemoryBus,
    now_ns: u64,
    sent: Vec<(u64, Frame)>,
    came: Vec<Frame>,
}

impl Bus for Tap {
    fn send(&mut self, frame: &Frame) -> Result<(), BusError> {
        if self.sent.len() < self.sent.capacity() {
            self.sent.push((self.now_ns, *frame));
        }
        self.bus.send(frame)
    }

    fn receive(&mut self) -> Result<Option<Event>, BusError> {
        let event = self.bus.receive()?;
        if let Some(Event::Frame(frame)) = event
            && self.came.len() < self.came.capacity()
        {
            self.came.push(frame);
        }
        Ok(event)
    }

    fn advance(&mut self, now_ns: u64) {
        self.bus.advance(now_ns);
    }
}

struct Bench {
    rest_bus: RestBus,
    receiver: Receiver,
    bus: Tap,
    sources: Vec<f64>,
    names: Vec<String>,
    targets: Vec<f64>,
    target_names: Vec<String>,
    now_ns: u64,
}

impl Bench {
    fn new(faults: &[CanFault]) -> Self {
        let (mapping, database) = mapping();
        let (plan, names, target_names) = bench_plan(&mapping, &database);
        let faults = Faults::compile(&plan, faults).unwrap();
        let mut bench = Bench {
            rest_bus: RestBus::new(plan.send, &faults),
            receiver: Receiver::new(plan.receive, &faults),
            bus: Tap {
                bus: MemoryBus::new(new_ecu()),
                now_ns: 0,
                sent: Vec::with_capacity(100_000),
                came: Vec::with_capacity(10_000),
            },
            sources: vec![0.0; names.len()],
            names,
            targets: vec![f64::NAN; target_names.len()],
            target_names,
            now_ns: 0,
        };
        bench.set("vehicle_state.velocity_m_s.x", 20.0);
        bench.set("vehicle_state.engine_speed_rad_s", 200.0);
        bench.set("rig_measurement.torsion_bar_torque_n_m", -3.0);
        bench.set("rig_measurement.steering_wheel_angle_rad", 0.25);
        bench
    }

    fn set(&mut self, name: &str, value: f64) {
        let index = self.names.iter().position(|n| n == name).unwrap();
        self.sources[index] = value;
    }

    fn get(&self, name: &str) -> f64 {
        self.targets[self.target_names.iter().position(|n| n == name).unwrap()]
    }

    fn run_ms(&mut self, ms: u64) {
        for _ in 0..ms {
            let now = self.now_ns;
            self.bus.now_ns = now;
            while let Ok(Some(Event::Frame(frame))) = self.bus.receive() {
                self.receiver.take(now, &frame, &mut self.targets);
            }
            self.receiver.step(now, &mut self.targets);
            self.rest_bus.step(now, &self.sources, &mut self.bus);
            self.bus.advance(now);
            self.now_ns += MS;
        }
    }

    fn ecu(&self) -> &VirtualEcu {
        self.bus.bus.ecu()
    }
}

fn fault(message: &str, fault: FaultKind, start_s: f64, end_s: f64, delay_ms: Option<f64>) -> CanFault {
    CanFault { message: message.to_owned(), fault, start_s, end_s: Some(end_s), delay_ms }
}

#[test]
fn the_whole_chain_stays_free_of_faults_and_carries_the_values() {
    let mut bench = Bench::new(&[]);
    bench.run_ms(1000);
    let seen = bench.ecu().seen();
    assert_eq!((seen.checksum_errors, seen.sequence_errors, seen.lost, seen.timeouts), (0, 0, 0, 0));
    assert_eq!(seen.good, 660, "{seen:?}");
    assert_eq!(bench.ecu().state(), state::ASSISTING);
    let (speed, torque) = bench.ecu().heard();
    assert!((speed - 20.0).abs() <= 0.005 / 3.6 + 1e-12, "{speed}");
    assert_eq!(torque, -3.0);
    assert_eq!(bench.get("can.ecu_state"), 3.0);
    assert!((bench.get("can.ecu_driver_torque_n_m") + 3.0).abs() < 0.0051);
    let assist = bench.get("can.ecu_assist_torque_n_m");
    let wanted = -8.0 / (1.0 + 20.0 / 12.0) * 2.5;
    assert!((assist - wanted).abs() < 0.02, "{assist} against {wanted}");
    assert!((bench.get("can.ecu_steering_angle_rad") - 0.25).abs() < 0.001);
    assert!((bench.get("can.ecu_supply_v") - 13.8).abs() < 0.006, "a page of the multiplexed message");
    assert_eq!(bench.get("can.ecu_checksum_errors"), 0.0, "the other page");
    for index in 0..2 {
        let known = bench.receiver.known(index);
        assert_eq!((known.status, known.wrong, known.sequence, known.lost, known.timeouts), (0, 0, 0, 0, 0));
    }
}

#[test]
fn each_message_comes_in_its_cycle_and_says_so_in_its_counter() {
    let mut bench = Bench::new(&[]);
    bench.run_ms(1000);
    for message in bench.rest_bus.plan() {
        let times: Vec<u64> =
            bench.bus.sent.iter().filter(|(_, frame)| frame.id == message.id).map(|(at, _)| *at).collect();
        assert_eq!(times[0], message.offset_ns, "{}", message.name);
        assert!(times.windows(2).all(|pair| pair[1] - pair[0] == message.cycle_ns), "{}", message.name);
        assert_eq!(times.len() as u64, (1000 * MS - message.offset_ns).div_ceil(message.cycle_ns));
        let counter = message.protection.as_ref().unwrap().counter.unwrap();
        let max = message.protection.as_ref().unwrap().counter_max;
        let counters = bench.bus.sent.iter().filter(|(_, frame)| frame.id == message.id);
        for (n, (_, frame)) in counters.enumerate() {
            assert_eq!(counter.get(frame.data()), n as u64 % (max + 1), "{}", message.name);
        }
    }
    let fd: Vec<_> = bench.bus.sent.iter().filter(|(_, frame)| frame.fd).collect();
    assert!(
        fd.iter().all(|(_, frame)| frame.brs && frame.data().len() == 16 && frame.id == Id::Standard(0x1A0))
    );
    assert_eq!(fd.len(), 200);
}

#[test]
fn a_sender_that_was_stopped_leaves_cycles_out_and_never_bursts() {
    let mut bench = Bench::new(&[]);
    bench.run_ms(100);
    let sent = bench.bus.sent.len();
    bench.now_ns += 200 * MS;
    bench.run_ms(1);
    assert!(bench.bus.sent.len() - sent <= bench.rest_bus.plan().len(), "one of each at most");
    let skipped = bench.rest_bus.counts().skipped;
    // 4 messages of 10 ms, one of 20, of 100 and of 5 ms, over 200 ms.
    assert!((4 * 19 + 9 + 1 + 39..=4 * 20 + 10 + 2 + 40).contains(&skipped), "{skipped}");
}

#[test]
fn wrong_checksums_are_counted_and_make_the_speed_absent_until_they_end() {
    let mut bench = Bench::new(&[fault("VehicleSpeed", FaultKind::WrongCrc, 0.5, 0.8, None)]);
    bench.run_ms(500);
    assert_eq!(bench.ecu().state(), state::ASSISTING);
    let before = bench.ecu().assist_n_m();
    bench.run_ms(200);
    assert_eq!(bench.ecu().state(), state::DEGRADED);
    assert!(bench.ecu().assist_n_m().abs() < before.abs(), "the fall-back speed is higher: less assist");
    assert!(bench.ecu().heard().0.is_nan());
    bench.run_ms(400);
    let seen = bench.ecu().seen();
    assert_eq!((seen.checksum_errors, seen.timeouts, seen.sequence_errors), (30, 1, 0));
    assert_eq!(bench.ecu().state(), state::ASSISTING, "recovers");
    assert_eq!(bench.get("can.ecu_checksum_errors"), 30.0, "and the bench is told");
    assert_eq!(bench.rest_bus.counts().injected, 30);
}

#[test]
fn a_counter_that_stands_still_is_a_repetition() {
    let mut bench = Bench::new(&[fault("SteeringSensors", FaultKind::StaleCounter, 0.5, 0.7, None)]);
    bench.run_ms(650);
    assert_eq!(bench.ecu().state(), state::FAULT, "no torque, no assist");
    assert!(bench.get("can.ecu_driver_torque_n_m").is_nan(), "the ECU says that it has none");
    bench.run_ms(350);
    let seen = bench.ecu().seen();
    // 40 frames in 200 ms, the first with the next counter; the first one after them repeats it once more.
    assert_eq!((seen.sequence_errors, seen.checksum_errors, seen.timeouts), (40, 0, 1));
    assert_eq!(bench.ecu().state(), state::ASSISTING);
}

#[test]
fn few_lost_frames_are_counted_and_many_time_out() {
    let mut bench = Bench::new(&[fault("VehicleSpeed", FaultKind::Drop, 0.5, 0.52, None)]);
    bench.run_ms(1000);
    let seen = bench.ecu().seen();
    assert_eq!((seen.lost, seen.timeouts, seen.sequence_errors), (2, 0, 0));
    let mut bench = Bench::new(&[fault("Body", FaultKind::Drop, 0.5, 2.0, None)]);
    bench.run_ms(1500);
    assert_eq!(
        (bench.ecu().seen().timeouts, bench.ecu().state()),
        (1, state::OFF),
        "no ignition, no steering assist"
    );
}

#[test]
fn late_frames_come_late_and_in_order() {
    let mut bench = Bench::new(&[fault("Engine", FaultKind::Delay, 0.5, 0.7, Some(35.0))]);
    bench.run_ms(1000);
    let engine = Id::Standard(288);
    let times: Vec<u64> =
        bench.bus.sent.iter().filter(|(_, f)| f.id == engine).map(|(at, _)| at / MS).collect();
    assert_eq!(
        times.iter().filter(|&&at| (541..=735).contains(&at)).count(),
        10 + 1,
        "10 late ones, 1 in time"
    );
    assert!(times.contains(&540) && !times.contains(&505) && !times.contains(&525), "{times:?}");
    let seen = bench.ecu().seen();
    assert!(seen.sequence_errors > 0, "what overtakes is out of sequence: {seen:?}");
}

#[test]
fn what_the_bench_receives_can_be_spoiled_too_and_is_absent_when_it_times_out() {
    let mut bench = Bench::new(&[
        fault("EPS_Torque", FaultKind::Drop, 0.5, 0.7, None),
        fault("EPS_Torque", FaultKind::WrongCrc, 1.0, 1.02, None),
    ]);
    bench.run_ms(540);
    assert!(bench.get("can.ecu_driver_torque_n_m").is_finite(), "not yet timed out");
    bench.run_ms(60);
    assert!(bench.get("can.ecu_driver_torque_n_m").is_nan());
    assert_eq!(bench.receiver.known(0).status & status::TIMEOUT, status::TIMEOUT);
    assert!(bench.get("can.ecu_supply_v").is_finite(), "the other message is not touched");
    bench.run_ms(600);
    assert!(bench.get("can.ecu_driver_torque_n_m").is_finite());
    let known = bench.receiver.known(0);
    assert_eq!((known.timeouts, known.wrong, known.status), (1, 2, 0));
}

#[test]
fn absent_variables_are_not_sent_as_numbers() {
    let mut bench = Bench::new(&[]);
    bench.run_ms(300);
    bench.set("vehicle_state.velocity_m_s.x", f64::NAN);
    let sent = bench.bus.sent.len();
    bench.run_ms(200);
    let speed = Id::Standard(160);
    assert!(bench.bus.sent[sent..].iter().all(|(_, frame)| frame.id != speed), "the message is withheld");
    assert_eq!(bench.rest_bus.counts().withheld, 20);
    assert_eq!(bench.ecu().state(), state::DEGRADED);
    // The ECU in turn says "not available" with the raw value agreed on; that is implausible, hence absent.
    bench.set("rig_measurement.torsion_bar_torque_n_m", f64::NAN);
    bench.run_ms(200);
    assert!(bench.get("can.ecu_driver_torque_n_m").is_nan());
    assert!(bench.get("can.ecu_assist_torque_n_m").is_finite());
    assert_eq!(bench.receiver.known(0).status, status::IMPLAUSIBLE);
}

#[test]
fn values_out_of_range_are_clamped_and_counted() {
    let mut bench = Bench::new(&[]);
    bench.set("vehicle_state.engine_speed_rad_s", 5000.0);
    bench.run_ms(100);
    let engine = bench.bus.sent.iter().rfind(|(_, frame)| frame.id == Id::Standard(288)).unwrap().1;
    let (_, database) = mapping();
    let message = database.message("Engine").unwrap();
    assert_eq!(message.signal("EngineSpeed").unwrap().1.codec.decode(engine.data()), 16383.5);
    assert_eq!(bench.rest_bus.counts().clamped, 5);
}

#[test]
fn implausible_values_are_absent_and_counted() {
    let (mapping, database) = mapping();
    let (plan, _, targets) = bench_plan(&mapping, &database);
    let faults = Faults::none(&plan);
    let mut receiver = Receiver::new(plan.receive.clone(), &faults);
    let mut values = vec![f64::NAN; targets.len()];
    let message = database.message("EPS_Torque").unwrap();
    let protection = plan.receive[0].protection.clone().unwrap();
    let mut counter = 0;
    let mut frame = |torque: f64| {
        let mut data = vec![0; 8];
        message.signal("AssistTorque").unwrap().1.codec.encode(&mut data, torque);
        protection.protect(message.id, &mut data, counter);
        counter = protection.next(counter);
        Frame::new(message.id, false, false, &data).unwrap()
    };
    let assist = targets.iter().position(|name| name == "can.ecu_assist_torque_n_m").unwrap();
    receiver.take(0, &frame(10.0), &mut values);
    assert_eq!(values[assist], 10.0);
    receiver.take(10 * MS, &frame(59.0), &mut values);
    assert_eq!(values[assist], 59.0, "49 N·m in 10 ms is just plausible");
    receiver.take(20 * MS, &frame(-5.0), &mut values);
    assert!(values[assist].is_nan(), "64 N·m in 10 ms is not");
    receiver.take(30 * MS, &frame(-6.0), &mut values);
    assert_eq!(values[assist], -6.0, "a settled value is believed again");
    receiver.take(40 * MS, &frame(-101.0), &mut values);
    assert!(values[assist].is_nan(), "out of range");
    assert_eq!(receiver.known(0).implausible, 2);
    receiver.take(50 * MS, &Frame::new(message.id, false, false, &[0; 4]).unwrap(), &mut values);
    assert_eq!(receiver.known(0).status, status::LENGTH);
    receiver.take(50 * MS, &Frame::parse("7FF#00").unwrap(), &mut values);
    assert_eq!((receiver.known(0).wrong, receiver.unknown()), (1, 1));
}

#[test]
fn two_runs_are_equal_bit_for_bit() {
    let run = || {
        let mut bench = Bench::new(&[fault("Inertial", FaultKind::WrongCrc, 0.2, 0.3, None)]);
        bench.run_ms(700);
        let bits: Vec<u64> = bench.targets.iter().map(|value| value.to_bits()).collect();
        (bench.bus.sent, bench.bus.came, bits)
    };
    let (a, b) = (run(), run());
    assert!(a == b && !a.1.is_empty());
}

#[test]
fn steps_allocate_nothing() {
    let mut bench = Bench::new(&[
        fault("Engine", FaultKind::Delay, 0.1, 0.4, Some(35.0)),
        fault("EPS_Torque", FaultKind::Delay, 0.1, 0.4, Some(12.0)),
        fault("VehicleSpeed", FaultKind::WrongCrc, 0.5, 0.6, None),
    ]);
    bench.run_ms(50);
    let before = assert_no_alloc::violation_count();
    assert_no_alloc::assert_no_alloc(|| bench.run_ms(1000));
    assert_eq!(assert_no_alloc::violation_count() - before, 0);
    assert!(bench.receiver.known(0).good > 90);
}

#[test]
fn a_fault_must_name_what_the_plan_has() {
    let (mapping, database) = mapping();
    let (plan, ..) = bench_plan(&mapping, &database);
    let wanted = [
        fault("Nonsense", FaultKind::Drop, 0.0, 1.0, None),
        fault("Body", FaultKind::WrongCrc, 0.0, 1.0, None),
        fault("EPS_Diagnosis", FaultKind::StaleCounter, 0.0, 1.0, None),
    ];
    let broken = Faults::compile(&plan, &wanted).unwrap_err();
    assert_eq!(broken.len(), 3);
    assert!(broken[0].rule.contains("message Nonsense"));
    assert!(broken[1].rule.contains("message Body: has no checksum"));
    assert!(broken[2].rule.contains("message EPS_Diagnosis: has no counter"));
}
