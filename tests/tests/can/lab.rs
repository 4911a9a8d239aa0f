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
    let sent = Command::new(kingpin()).args(["can", "send", "--interface", "vcan0"]).args(frames).output().unwrap();
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
    let mut monitor = start(kingpin(), &["can", "monitor", "-i", "vcan0", "--dbc", "kingpin_steering.dbc", "--json", "--count", "3"]);
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
    let lines: Vec<Value> =
        BufReader::new(monitor.stdout.take().unwrap()).lines().map(|line| serde_json::from_str(&line.unwrap()).unwrap()).collect();
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
        frames.push(Frame::new(Id::Standard(0x100 + len as u16), false, false, &vec![len as u8; len]).unwrap());
    }
    for len in can::frame::FD_LENGTHS {
        frames.push(Frame::new(Id::Extended(0x1800_0000 + len as u32), true, len % 2 == 0, &vec![len as u8; len]).unwrap());
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
        let output = Command::new(kingpin()).args(["can", "monitor", "-i", bus, "--duration", "0.1"]).output().unwrap();
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

/// The whole chain in real time: bench as processes, rest-bus on vcan0, the ECU as a process of its own, candump as
/// witness. User-mode Linux keeps no 1 ms beat: what is tested is the content, not the timing.
#[test]
#[ignore = "needs vcan0: run by on_a_real_bus inside scripts/can-lab"]
fn the_bench_and_the_virtual_ecu_talk_and_faults_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("bus.toml");
    let text_of = "extends = \"slalom_120\"\nname = \"bus\"\n[can]\nmapping_file = \"steering_rest_bus\"\n\
                   interface = \"vcan0\"\n\
                   faults = [{ message = \"VehicleSpeed\", fault = \"wrong_crc\", start_s = 2.0, end_s = 2.5 }]\n";
    std::fs::write(&scenario, text_of).unwrap();
    let seen_path = folder.path().join("seen.json");
    let mut ecu = start(kingpin(), &["can", "ecu", "-i", "vcan0", "--output", &seen_path.to_string_lossy()]);
    until_listening("vcan0", 1);
    let dump = start("candump", &["-L", "-T", "2500", "vcan0"]);
    until_listening("vcan0", 2);
    let out = folder.path().join("run");
    let run = Command::new(kingpin())
        .args(["run", &scenario.to_string_lossy(), "--duration", "4", "--no-report", "--name", &own("lab"), "--out"])
        .arg(&out)
        .output()
        .unwrap();
    let id = ecu.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let ecu_said = text(&ecu.stderr.take().map(|mut e| {
        let mut bytes = Vec::new();
        let _ = std::io::Read::read_to_end(&mut e, &mut bytes);
        bytes
    }).unwrap());
    assert!(ecu.wait().unwrap().success(), "{ecu_said}");
    let about = format!("{ecu_said}\n{}", text(&run.stderr));

    let seen: Value = serde_json::from_str(&std::fs::read_to_string(&seen_path).unwrap()).unwrap();
    println!("the ECU saw {seen}");
    assert!(seen["seen"]["good"].as_u64().unwrap() > 200, "{about}");
    let wrong = seen["seen"]["checksum_errors"].as_u64().unwrap();
    assert!((1..=51).contains(&wrong), "{wrong} of at most 51 spoiled frames counted: {about}");

    let log = LogReader::open(&out).unwrap();
    let flags = log.column("can", "flags").unwrap();
    let memory = regions::can_flags::IN_MEMORY | regions::can_flags::FALLBACK;
    assert!(flags.iter().all(|&flags| flags as u64 & memory == 0), "a real bus");
    let good = log.column("can", "message_good_count.0").unwrap();
    assert!(good.last().copied().unwrap() > 50.0, "{about}");
    let said = log.column("can", "ecu_checksum_errors").unwrap();
    let said = said.iter().copied().filter(|errors| errors.is_finite()).fold(0.0, f64::max);
    assert!(said >= 1.0, "what the ECU counted came back over the bus: {about}");
    let wrong = log.column("can", "message_wrong_count.0").unwrap();
    assert_eq!(wrong.last().copied(), Some(0.0));

    // The witness decodes with the DBC, and every checksum on the wire that was not spoiled is right.
    let dumped = text(&dump.wait_with_output().unwrap().stdout);
    let frames: Vec<Frame> = dumped
        .lines()
        .filter_map(|line| Frame::parse(line.split_whitespace().nth(2)?).ok())
        .collect();
    for id in [160u16, 164, 168, 192, 288, 304, 416, 240] {
        assert!(frames.iter().any(|frame| frame.id == Id::Standard(id)), "no frame {id:03X} seen by candump");
    }
    assert!(frames.iter().filter(|frame| frame.id == Id::Standard(416)).all(|frame| frame.fd));
    assert!(frames.iter().any(|frame| frame.id == Id::Extended(0x18FF_0101)));
}
