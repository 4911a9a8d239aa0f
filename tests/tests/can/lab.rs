//! On a real AF_CAN bus, run inside `scripts/can-lab` by `on_a_real_bus`: can-utils as independent peers.

use super::{own, text};
use can::bus::{Bus, Event};
use can::socket::SocketBus;
use can::{Frame, Id};
use kingpin_tests::support::kingpin;
use record::LogReader;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

fn start(program: impl AsRef<std::ffi::OsStr>, args: &[&str]) -> Child {
    Command::new(program).args(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Waits until somebody listens on the bus: what a sender says before is lost.
fn until_listening(bus: &str, listeners: usize) {
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(20) {
        let lists = ["rcvlist_all", "rcvlist_fil", "rcvlist_sff", "rcvlist_eff", "rcvlist_inv"];
        let count: usize = lists
            .iter()
            .filter_map(|list| std::fs::read_to_string(format!("/proc/net/can/{list}")).ok())
            .map(|text| text.lines().filter(|line| line.split_whitespace().next() == Some(bus)).count())
            .sum();
        if count >= listeners {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    panic!("nobody listens on {bus}");
}

#[test]
#[ignore = "needs vcan0: run by on_a_real_bus inside scripts/can-lab"]
fn candump_sees_what_kingpin_sends() {
    let dump = start("candump", &["-L", "-n", "5", "vcan0"]);
    until_listening("vcan0", 1);
    let frames = ["123#DEADBEEF", "00ABCDEF#01", "7FF#", "321##1001122334455667788990011", "0A0##0AABBCC"];
    let sent =
        Command::new(kingpin()).args(["can", "send", "--interface", "vcan0"]).args(frames).output().unwrap();
    assert!(sent.status.success(), "{}", text(&sent.stderr));
    let seen = text(&dump.wait_with_output().unwrap().stdout);
    let seen: Vec<&str> = seen.lines().map(|line| line.split_whitespace().nth(2).unwrap()).collect();
    // Newer kernels mark FD frames with a flag of their own (4), which candump shows.
    let plain: Vec<String> = seen
        .iter()
        .map(|frame| match frame.split_once("##") {
            Some((id, rest)) => format!("{id}##{}{}", rest[..1].parse::<u8>().unwrap() & 1, &rest[1..]),
            None => (*frame).to_owned(),
        })
        .collect();
    assert_eq!(plain, frames);
}

#[test]
#[ignore = "needs vcan0: run by on_a_real_bus inside scripts/can-lab"]
fn kingpin_sees_what_cansend_sends_and_vcan1_stays_silent() {
    let mut monitor = start(
        kingpin(),
        &["can", "monitor", "-i", "vcan0", "--dbc", "kingpin_steering.dbc", "--json", "--count", "3"],
    );
    let mut other = start(kingpin(), &["can", "monitor", "-i", "vcan1", "--json"]);
    until_listening("vcan0", 1);
    until_listening("vcan1", 1);
    let encoded = Command::new(kingpin())
        .args(["can", "encode", "kingpin_steering.dbc", "VehicleSpeed", "Speed=123.45", "Speed_Valid=1"])
        .output()
        .unwrap();
    for frame in [text(&encoded.stdout).trim(), "18FF0101#01.0A.00.02.00.01.30.00", "7FF##1AABB"] {
        assert!(Command::new("cansend").args(["vcan0", frame]).status().unwrap().success(), "{frame}");
    }
    let lines: Vec<Value> = BufReader::new(monitor.stdout.take().unwrap())
        .lines()
        .map(|line| serde_json::from_str(&line.unwrap()).unwrap())
        .collect();
    assert!(monitor.wait().unwrap().success());
    assert_eq!(lines[0]["message"], "VehicleSpeed");
    assert_eq!(lines[0]["signals"]["Speed"]["value"], 123.45);
    assert_eq!(lines[1]["message"], "EPS_Diagnosis");
    assert_eq!(lines[1]["signals"]["ChecksumErrors"]["value"], 10.0);
    assert_eq!(lines[1]["signals"]["SequenceErrors"]["value"], 2.0);
    assert!(lines[1]["signals"].get("Temperature").is_none(), "the other page of the multiplexed message");
    assert_eq!(lines[2]["frame"], "7FF##1AABB");
    other.kill().unwrap();
    assert_eq!(text(&other.wait_with_output().unwrap().stdout), "", "buses are apart");
}

#[test]
#[ignore = "needs vcan0: run by on_a_real_bus inside scripts/can-lab"]
fn sockets_carry_every_kind_of_frame() {
    let (mut a, mut b) = (SocketBus::open("vcan1").unwrap(), SocketBus::open("vcan1").unwrap());
    let mut frames: Vec<Frame> = Vec::new();
    for len in 0..=8 {
        frames
            .push(Frame::new(Id::Standard(0x100 + len as u16), false, false, &vec![len as u8; len]).unwrap());
    }
    for len in can::frame::FD_LENGTHS {
        frames.push(
            Frame::new(Id::Extended(0x1800_0000 + len as u32), true, len % 2 == 0, &vec![len as u8; len])
                .unwrap(),
        );
    }
    for frame in &frames {
        a.send(frame).unwrap();
    }
    for frame in &frames {
        assert!(b.wait(Duration::from_secs(5)).unwrap());
        assert_eq!(b.receive().unwrap(), Some(Event::Frame(*frame)));
    }
    assert!(b.receive().unwrap().is_none() && a.receive().unwrap().is_none(), "own frames do not come back");
}

#[test]
#[ignore = "needs vcan0: run by on_a_real_bus inside scripts/can-lab"]
fn a_missing_interface_and_one_that_is_down_are_told_apart() {
    let said = |bus: &str| {
        let output = Command::new(kingpin())
            .args(["can", "monitor", "-i", bus, "--duration", "0.1"])
            .output()
            .unwrap();
        (output.status.code(), text(&output.stderr))
    };
    let (code, error) = said("vcan7");
    assert_eq!(code, Some(3));
    assert!(error.contains("errno 19, ENODEV"), "{error}");
    assert!(Command::new("ip").args(["link", "set", "vcan1", "down"]).status().unwrap().success());
    let sent = Command::new(kingpin()).args(["can", "send", "-i", "vcan1", "123#00"]).output().unwrap();
    assert!(Command::new("ip").args(["link", "set", "vcan1", "up"]).status().unwrap().success());
    assert_ne!(sent.status.code(), Some(0), "{}", text(&sent.stderr));
    assert_eq!(said("vcan1").0, Some(0), "and works again");
}

/// Rest-bus and virtual ECU as processes of their own on vcan0, until each has told the other what it must: the
/// values, then the checksum errors that the ECU counted and reports on the bus. By conditions, not by the clock:
/// user-mode Linux on a busy machine keeps no beat.
#[test]
#[ignore = "needs vcan0: run by on_a_real_bus inside scripts/can-lab"]
fn rest_bus_and_virtual_ecu_talk_and_faults_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let seen_path = folder.path().join("seen.json");
    let mut ecu = start(kingpin(), &["can", "ecu", "-i", "vcan0", "--output", &seen_path.to_string_lossy()]);
    until_listening("vcan0", 1);
    let mut dump = start("candump", &["-L", "vcan0"]);
    until_listening("vcan0", 2);

    let (loaded, dbc) = config::load_can("steering_rest_bus").unwrap();
    let (database, _) = can::Database::read(&dbc.text);
    let (sources, targets) = (assembly::can_sources(), assembly::can_targets());
    let plan = can::mapping::compile(&loaded.value, &database, &sources, &targets).unwrap();
    let spoiled = [config::can::CanFault {
        message: "VehicleSpeed".to_owned(),
        fault: config::can::FaultKind::WrongCrc,
        start_s: 1000.0,
        end_s: None,
        delay_ms: None,
    }];
    let faults = can::fault::Faults::compile(&plan, &spoiled).unwrap();
    let mut rest_bus = can::restbus::RestBus::new(plan.send.clone(), &faults);
    let mut receiver = can::receive::Receiver::new(plan.receive.clone(), &faults);
    let mut bus = SocketBus::open("vcan0").unwrap();
    let mut values = vec![0.0; sources.len()];
    let mut said = vec![f64::NAN; targets.len()];
    let place =
        |list: &[can::mapping::Variable], name: &str| list.iter().position(|v| v.name == name).unwrap();
    values[place(&sources, "rig_measurement.torsion_bar_torque_n_m")] = 4.0;
    values[place(&sources, "vehicle_state.engine_speed_rad_s")] = 250.0;
    let torque = place(&targets, "can.ecu_driver_torque_n_m");
    let assist = place(&targets, "can.ecu_assist_torque_n_m");
    let errors = place(&targets, "can.ecu_checksum_errors");

    let begin = Instant::now();
    let (mut told_values, mut told_errors) = (false, false);
    // From where on the fault is in force: the clock of the rest-bus is set forward, as its cycles allow.
    let mut ahead_ns = 0;
    while begin.elapsed() < Duration::from_secs(60) && !told_errors {
        let now_ns = begin.elapsed().as_nanos() as u64 + ahead_ns;
        while let Some(event) = bus.receive().unwrap() {
            if let Event::Frame(frame) = event {
                receiver.take(now_ns, &frame, &mut said);
            }
        }
        receiver.step(now_ns, &mut said);
        rest_bus.step(now_ns, &values, &mut bus);
        if !told_values && said[torque] == 4.0 && said[assist] > 1.0 {
            told_values = true;
            ahead_ns = 1_000_000_000_000;
        }
        told_errors = told_values && said[errors] >= 5.0;
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(told_values, "torque {} assist {}", said[torque], said[assist]);
    assert!(told_errors, "checksum errors {}", said[errors]);
    assert_eq!(receiver.known(0).wrong, 0, "what the ECU sends is right");
    assert!(Command::new("kill").args(["-INT", &ecu.id().to_string()]).status().unwrap().success());
    assert!(ecu.wait().unwrap().success());
    let seen: Value = serde_json::from_str(&std::fs::read_to_string(&seen_path).unwrap()).unwrap();
    println!("the ECU saw {seen}");
    assert!(seen["seen"]["checksum_errors"].as_u64().unwrap() >= 5);
    assert!(seen["seen"]["good"].as_u64().unwrap() > 20);

    // The witness: every message of the plan was on the wire, as the kind of frame it should be.
    dump.kill().unwrap();
    let dumped = text(&dump.wait_with_output().unwrap().stdout);
    let frames: Vec<Frame> =
        dumped.lines().filter_map(|line| Frame::parse(line.split_whitespace().nth(2)?).ok()).collect();
    for id in plan.send.iter().map(|m| m.id).chain(plan.receive.iter().map(|m| m.id)) {
        assert!(frames.iter().any(|frame| frame.id == id), "no frame {id} seen by candump");
    }
    assert!(frames.iter().filter(|frame| frame.id == Id::Standard(416)).all(|frame| frame.fd));
    assert!(frames.iter().any(|frame| frame.id == Id::Extended(0x18FF_0101)));
}

/// The bench itself as processes, its rest-bus on vcan0, the ECU as a process of its own. Its 1 ms beat is beyond a
/// user-mode Linux: the run may trip; that the service was on the bus and heard the ECU is what counts.
#[test]
#[ignore = "needs vcan0: run by on_a_real_bus inside scripts/can-lab"]
fn a_run_of_the_bench_is_on_the_bus() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("bus.toml");
    let text_of = "extends = \"slalom_120\"\nname = \"bus\"\n[can]\nmapping_file = \"steering_rest_bus\"\n\
                   interface = \"vcan0\"\nassist = \"ecu\"\n";
    std::fs::write(&scenario, text_of).unwrap();
    let seen_path = folder.path().join("seen.json");
    let mut ecu = start(kingpin(), &["can", "ecu", "-i", "vcan0", "--output", &seen_path.to_string_lossy()]);
    until_listening("vcan0", 1);
    let out = folder.path().join("run");
    let run = Command::new(kingpin())
        .args([
            "run",
            &scenario.to_string_lossy(),
            "--duration",
            "3.2",
            "--no-report",
            "--name",
            &own("lab"),
            "--out",
        ])
        .arg(&out)
        .output()
        .unwrap();
    assert!(Command::new("kill").args(["-INT", &ecu.id().to_string()]).status().unwrap().success());
    assert!(ecu.wait().unwrap().success());
    let about = text(&run.stderr);
    let seen: Value = serde_json::from_str(&std::fs::read_to_string(&seen_path).unwrap()).unwrap();
    println!("the ECU saw {seen}");
    assert!(seen["seen"]["good"].as_u64().unwrap() > 0, "{about}");
    assert_eq!(seen["seen"]["checksum_errors"], 0, "{about}");
    let log = LogReader::open(&out).unwrap();
    let flags = log.column("can", "flags").unwrap();
    let memory = regions::can_flags::IN_MEMORY | regions::can_flags::FALLBACK;
    assert!(flags.iter().all(|&flags| flags as u64 & memory == 0), "a real bus");
    let good = log.column("can", "message_good_count.0").unwrap();
    assert!(good.last().copied().unwrap() > 0.0, "{about}");
    let wrong = log.column("can", "message_wrong_count.0").unwrap();
    assert_eq!(wrong.last().copied(), Some(0.0));
    // The rig acts on it: from the first word on, what the motor is asked for is what the ECU process said, within the
    // limits and the fade.
    let (used, said) =
        (log.column("rig_status", "used_can").unwrap(), log.column("can", "ecu_assist_torque_n_m").unwrap());
    let asked = log.column("rig_status", "assist_request_n_m").unwrap();
    let words = used.iter().filter(|&&tick| tick < 1e12).count();
    let most = |values: &[f64]| values.iter().filter(|v| v.is_finite()).fold(0.0, |m: f64, v| m.max(v.abs()));
    println!(
        "{words} ticks with a word of the ECU; it said up to {} N·m, the motor was asked for {}",
        most(&said),
        most(&asked)
    );
    assert!(words > 0 && asked.iter().all(|a| a.is_finite()), "the rig hears the ECU: {about}");
    assert!(most(&asked) <= most(&said) + 1e-9, "never more than was said");
}
