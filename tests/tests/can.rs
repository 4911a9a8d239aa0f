//! CAN across the bench: independent peers (cantools, autosar-e2e, can-utils), broken files, the bus in lockstep,
//! hosts without CAN, and a real AF_CAN bus inside a user-mode Linux (`scripts/can-lab`).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use can::Database;
use can::database::Weight;
use kingpin_tests::support::{kingpin, reference, workspace};
use record::LogReader;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use std::process::{Command, Output, Stdio};

#[path = "can/broken.rs"]
mod broken;
#[path = "can/lab.rs"]
mod lab;

/// A bench name of this run's own, so that runs side by side do not meet.
fn own(name: &str) -> String {
    format!("can-{name}-{}", std::process::id())
}

/// Python with the peers, `None` where it is not there; with `CI=true` that is a failure.
fn python(modules: &str) -> Option<std::ffi::OsString> {
    let python = std::env::var_os("KINGPIN_PEERS").unwrap_or_else(|| "python3".into());
    let found = Command::new(&python).args(["-c", &format!("import {modules}")]).output();
    if found.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    let missing = "Python with the packages in tests/peers.txt (KINGPIN_PEERS names the interpreter)";
    assert!(std::env::var("CI").as_deref() != Ok("true"), "missing: {missing}");
    println!("SKIPPED: missing: {missing}");
    None
}

fn run_with(mut command: Command, input: &str) -> Output {
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let input = input.to_owned();
    let writer = std::thread::spawn(move || stdin.write_all(input.as_bytes()));
    let output = child.wait_with_output().unwrap();
    let _ = writer.join();
    output
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// SplitMix64: frames are random, and the same each time.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
}

/// The files that issue and acceptance name: Nissan, Toyota, Volkswagen, Hyundai, Tesla.
const REAL: [&str; 5] = [
    "nissan_x_trail_2017_generated.dbc",
    "toyota_tnga_k_pt_generated.dbc",
    "vw_mqb.dbc",
    "hyundai_i30_2014.dbc",
    "tesla_model3_party.dbc",
];

/// Decodes and encodes with cantools what kingpin decoded and encoded, and counts where they differ.
const CANTOOLS: &str = r##"
import json, struct, sys
import cantools
db = cantools.database.load_file(sys.argv[1], strict=False)
by_name = {m.name: m for m in db.messages}
s = dict(frames=0, values=0, decode=0, encode=0, encoded=0, names=0, overlapping=0, first=[])
def differ(kind, *what):
    s[kind] += 1
    if len(s["first"]) < 5: s["first"].append([kind] + [str(w) for w in what])
def overlaps(m):
    try:
        m.refresh(strict=True)
        return False
    except cantools.database.errors.Error:
        m.refresh(strict=False)
        return True
def alone(m, signal):
    chain, by = [signal], signal.multiplexer_signal
    while by:
        chain.append(m.get_signal_by_name(by)); by = chain[-1].multiplexer_signal
    return cantools.database.can.Message(m.frame_id, m.name, m.length, chain, is_extended_frame=m.is_extended_frame, strict=False)
# Signals that share bits are more than cantools can decode at once: one by one then, each with its multiplexors.
shared = {m.name: [(x.name, alone(m, x)) for x in m.signals] if overlaps(m) else None for m in db.messages}
def decode(m, data, scaling):
    if shared[m.name] is None:
        return m.decode(data, decode_choices=False, scaling=scaling)
    out = {}
    for name, one in shared[m.name]:
        got = one.decode(data, decode_choices=False, scaling=scaling)
        if name in got: out[name] = got[name]
    return out
decoded = [json.loads(line) for line in open(sys.argv[2])]
frames = [line.strip() for line in open(sys.argv[3])]
assert len(decoded) == len(frames), (len(decoded), len(frames))
for line, frame in zip(decoded, frames):
    m = by_name[line["message"]]
    text = line["frame"].split("#", 1)[1]
    data = bytes.fromhex(text[2:] if text.startswith("#") else text)
    s["frames"] += 1
    raw, value = decode(m, data, False), decode(m, data, True)
    if set(raw) != set(line["signals"]):
        differ("names", m.name, set(raw) ^ set(line["signals"]))
    for name, ours in line["signals"].items():
        s["values"] += 1
        wide = abs(raw[name]) >= 2**53
        same = ours["value"] == float(value[name]) or (wide and abs(ours["value"] - value[name]) <= 1e-15 * abs(value[name]))
        if ours["raw"] != raw[name] or not same:
            differ("decode", m.name, name, ours, raw[name], value[name])
    text = frame.split("#", 1)[1]
    ours = bytes.fromhex(text[2:] if text.startswith("#") else text)
    # Encoding from the physical values, but for signals so wide that a double cannot tell their raw values apart.
    if shared[m.name] is None:
        wide = any(x.length > 52 for x in m.signals if x.name in raw)
        theirs = m.encode(raw, scaling=False, strict=False) if wide else m.encode(value, scaling=True, strict=False)
    else:
        # What a signal encodes to alone is in the frame, since all of them come from one payload.
        s["overlapping"] += 1
        theirs = bytearray(m.length)
        for name, one in shared[m.name]:
            if name in raw:
                part = {x.name: raw[x.name] for x in one.signals}
                theirs = bytearray(p | q for p, q in zip(theirs, one.encode(part, scaling=False, strict=False)))
    s["encoded"] += 1
    if ours != bytes(theirs):
        differ("encode", m.name, ours.hex(), bytes(theirs).hex())
print(json.dumps(s))
"##;

#[test]
fn cantools_agrees_on_real_files() {
    let Some(python) = python("cantools") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (mut frames, mut values) = (0, 0);
    for name in REAL {
        let Some(path) = reference(&format!("dbc/{name}")) else { return };
        let (database, faults) = Database::read(&std::fs::read_to_string(&path).unwrap());
        let wrong: Vec<_> = faults.iter().filter(|fault| fault.weight == Weight::Error).collect();
        assert!(wrong.is_empty(), "{name}: {wrong:?}");
        let mut random = Random(7);
        let mut lines = String::new();
        for message in &database.messages {
            for _ in 0..40 {
                let mut data: Vec<u8> = (0..message.len).map(|_| random.next() as u8).collect();
                // cantools refuses selections that select nothing: one that is used.
                for signal in &message.signals {
                    if let Some(selector) = &signal.selector
                        && random.next().is_multiple_of(3)
                    {
                        message.signals[selector.multiplexor].codec.bits.set(&mut data, selector.ranges[0].0);
                    }
                }
                for (index, signal) in message.signals.iter().enumerate().filter(|(_, s)| s.is_multiplexor) {
                    let used: Vec<u64> = message
                        .signals
                        .iter()
                        .filter_map(|s| s.selector.as_ref().filter(|s| s.multiplexor == index))
                        .flat_map(|selector| selector.ranges.iter().map(|range| range.0))
                        .collect();
                    if !used.is_empty() && !used.contains(&signal.codec.bits.get(&data)) {
                        signal.codec.bits.set(&mut data, used[(random.next() % used.len() as u64) as usize]);
                    }
                }
                let fd = message.len > 8;
                let Some(frame) = can::Frame::new(message.id, fd, false, &data) else { continue };
                lines += &format!("{frame}\n");
            }
        }
        let mut decode = Command::new(kingpin());
        decode.args(["can", "decode", "--json"]).arg(&path);
        let decoded = run_with(decode, &lines);
        assert!(decoded.status.success(), "{name}: {}", text(&decoded.stderr));
        let decoded = text(&decoded.stdout);
        let mut encode_lines = String::new();
        for line in decoded.lines() {
            let line: Value = serde_json::from_str(line).unwrap();
            let message = database.message(line["message"].as_str().unwrap()).unwrap();
            let signals: serde_json::Map<String, Value> = line["signals"]
                .as_object()
                .unwrap()
                .iter()
                .map(|(name, both)| {
                    let wide = message.signal(name).unwrap().1.codec.bits.size() > 52;
                    let value = if wide { json!({"raw": both["raw"]}) } else { both["value"].clone() };
                    (name.clone(), value)
                })
                .collect();
            encode_lines += &format!("{}\n", json!({"message": message.name, "signals": signals}));
        }
        let mut encode = Command::new(kingpin());
        encode.args(["can", "encode"]).arg(&path);
        let encoded = run_with(encode, &encode_lines);
        assert!(encoded.status.success(), "{name}: {}", text(&encoded.stderr));
        let (a, b) = (folder.path().join("decoded"), folder.path().join("encoded"));
        std::fs::write(&a, decoded).unwrap();
        std::fs::write(&b, &encoded.stdout).unwrap();
        let output =
            Command::new(&python).args(["-c", CANTOOLS]).arg(&path).arg(&a).arg(&b).output().unwrap();
        assert!(output.status.success(), "{name}: {}", text(&output.stderr));
        let said: Value = serde_json::from_slice(&output.stdout).unwrap();
        println!("{name}: {said}");
        assert_eq!(
            (&said["decode"], &said["encode"], &said["names"]),
            (&json!(0), &json!(0), &json!(0)),
            "{said}"
        );
        assert!(said["frames"].as_u64().unwrap() >= 40 * database.messages.len() as u64 - 40);
        frames += said["frames"].as_u64().unwrap();
        values += said["values"].as_u64().unwrap();
    }
    println!("cantools agrees on {frames} frames, {values} values decoded, {frames} frames encoded");
    assert!(frames > 5000 && values > 50_000, "{frames} frames, {values} values");
}

/// Package autosar-e2e, written from the standard by others, protects and checks the same bytes.
const AUTOSAR: &str = r#"
import json, sys
import e2e.p01 as p01, e2e.p02 as p02, e2e.p05 as p05, e2e.p11 as p11
modes = {"both": p01.E2E_P01_DATAID_BOTH, "alternating": p01.E2E_P01_DATAID_ALT, "low": p01.E2E_P01_DATAID_LOW, "nibble": p01.E2E_P01_DATAID_NIBBLE}
modes11 = {"both": p11.E2E_P11_DATAID_BOTH, "nibble": p11.E2E_P11_DATAID_NIBBLE}
n = {}
for line in sys.stdin:
    c = json.loads(line); ours = bytearray(c["data"]); theirs = bytearray(ours); k = c["profile"]
    for i in c["checksum"]: theirs[i] = 0
    if k == "1": a = dict(data_id_mode=modes[c["mode"]]); p01.e2e_p01_protect(theirs, c["id"], increment_counter=False, **a); good = p01.e2e_p01_check(ours, c["id"], **a)
    if k == "11": a = dict(data_id_mode=modes11[c["mode"]]); p11.e2e_p11_protect(theirs, c["id"], increment_counter=False, **a); good = p11.e2e_p11_check(ours, c["id"], **a)
    if k == "2": l = bytes(c["list"]); p02.e2e_p02_protect(theirs, l, increment_counter=False); good = p02.e2e_p02_check(ours, l)
    if k == "5": a = dict(offset=c["offset"]); p05.e2e_p05_protect(theirs, c["id"], increment_counter=False, **a); good = p05.e2e_p05_check(ours, c["id"], **a)
    assert ours == theirs and good, (c, bytes(theirs).hex())
    n[k] = n.get(k, 0) + 1
print(json.dumps(n))
"#;

#[test]
fn autosar_e2e_agrees_on_profiles_1_2_5_and_11() {
    use can::e2e::{Protection, Rule};
    use can::signal::Bits;
    use config::can::DataIdMode;
    let Some(python) = python("e2e.p11") else { return };
    let mut random = Random(11);
    let bits = |start, size| Some(Bits::new(start, size, false).unwrap());
    let mut lines = String::new();
    for turn in 0..2000u64 {
        let len = 8 + (random.next() % 24) as usize;
        let mut data: Vec<u8> = (0..len).map(|_| random.next() as u8).collect();
        let data_id = random.next() as u16;
        let list: [u8; 16] = std::array::from_fn(|_| random.next() as u8);
        let offset = random.next() % (len as u64 - 3);
        let (mode, word) = [
            (DataIdMode::Both, "both"),
            (DataIdMode::Nibble, "nibble"),
            (DataIdMode::Low, "low"),
            (DataIdMode::Alternating, "alternating"),
        ][(random.next() % 4) as usize];
        let (profile, rule, word) = match turn % 4 {
            0 => ("1", Rule::J1850WithId { data_id: data_id & 0xFFF, mode }, word),
            1 => ("2", Rule::H2fWithList { list }, ""),
            2 => ("5", Rule::CcittWithId { data_id }, ""),
            _ => {
                let (mode, word) =
                    [(DataIdMode::Both, "both"), (DataIdMode::Nibble, "nibble")][(turn / 4 % 2) as usize];
                ("11", Rule::J1850WithId { data_id: data_id & 0xFFF, mode }, word)
            }
        };
        let five = profile == "5";
        let at = if five { 8 * offset } else { 0 };
        let protection = Protection {
            rule,
            checksum: bits(at, if five { 16 } else { 8 }),
            counter: if five { bits(at + 16, 8) } else { bits(8, 4) },
            nibble: if word == "nibble" { bits(12, 4) } else { None },
            counter_max: match profile {
                "5" => 255,
                "2" => 15,
                _ => 14,
            },
            delta_max: 1,
        };
        let counter = random.next() % (protection.counter_max + 1);
        protection.protect(can::Id::Standard(1), &mut data, counter);
        let id = if profile == "5" { data_id } else { data_id & 0xFFF };
        let checksum = if five { vec![offset, offset + 1] } else { vec![0] };
        let case = json!({"profile": profile, "id": id, "mode": word, "list": list, "offset": offset,
            "data": data, "checksum": checksum});
        lines += &format!("{case}\n");
    }
    let mut command = Command::new(&python);
    command.args(["-c", AUTOSAR]);
    let output = run_with(command, &lines);
    assert!(output.status.success(), "{}", text(&output.stderr));
    println!("autosar-e2e agrees: {}", text(&output.stdout));
    assert_eq!(
        serde_json::from_slice::<Value>(&output.stdout).unwrap(),
        json!({"1": 500, "2": 500, "5": 500, "11": 500})
    );
}

#[test]
fn every_real_file_can_be_read() {
    let Some(folder) = reference("dbc") else { return };
    let (mut messages, mut signals) = (0, 0);
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "dbc") {
            continue;
        }
        let (database, faults) = Database::read(&std::fs::read_to_string(&path).unwrap());
        let wrong = faults.iter().filter(|fault| fault.weight == Weight::Error).count();
        println!(
            "{}: {} messages, {wrong} errors, {} warnings",
            path.display(),
            database.messages.len(),
            faults.len() - wrong
        );
        // Two of them have mistakes of their own (signals outside their message, limits upside down): named, left out.
        let known = ["mazda_2017.dbc", "vw_pq.dbc"].iter().any(|name| path.ends_with(name));
        assert!(database.messages.len() >= 20 && (wrong == 0) != known, "{}: {faults:?}", path.display());
        messages += database.messages.len();
        signals += database.messages.iter().map(|m| m.signals.len()).sum::<usize>();
    }
    assert!(messages > 1000 && signals > 7000, "{messages} messages, {signals} signals");
}

fn run_bench(folder: &Path, scenario: &str, name: &str, extra: &[&str]) -> Output {
    Command::new(kingpin())
        .args(["run", scenario, "--no-report", "--json", "--name", &own(name), "--out"])
        .arg(folder.join(name))
        .args(extra)
        .output()
        .unwrap()
}

/// A scenario with the virtual ECU on a bus in memory and a fault of each kind.
fn scenario(folder: &Path) -> String {
    let path = folder.join("with_can.toml");
    let text = r#"
extends = "slalom_120"
name = "with_can"
[can]
mapping_file = "steering_rest_bus"
assist = "ecu"
faults = [
    { message = "VehicleSpeed", fault = "wrong_crc", start_s = 1.5, end_s = 1.7 },
    { message = "SteeringSensors", fault = "stale_counter", start_s = 2.0, end_s = 2.1 },
    { message = "Engine", fault = "delay", delay_ms = 30.0, start_s = 2.2, end_s = 2.4 },
    { message = "EPS_Torque", fault = "drop", start_s = 2.5, end_s = 2.8 },
]
"#;
    std::fs::write(&path, text).unwrap();
    path.to_string_lossy().into_owned()
}

#[test]
fn in_lockstep_the_bus_is_in_memory_and_runs_are_equal_in_one_process_and_as_the_set() {
    let folder = tempfile::tempdir().unwrap();
    let file = scenario(folder.path());
    for (name, mode) in [("one", "--lockstep"), ("set", "--lockstep=set")] {
        let output = run_bench(folder.path(), &file, name, &[mode, "--duration", "3.5"]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    }
    let compared = Command::new(kingpin())
        .args(["compare", "--json"])
        .args([folder.path().join("one"), folder.path().join("set")])
        .output()
        .unwrap();
    assert_eq!(compared.status.code(), Some(0), "{}", text(&compared.stdout));

    let log = LogReader::open(&folder.path().join("one")).unwrap();
    let column = |region: &str, name: &str| log.column(region, name).unwrap();
    let torque = column("can", "ecu_driver_torque_n_m");
    let measured = column("rig_measurement", "torsion_bar_torque_n_m");
    assert_eq!(torque.len(), measured.len(), "every tick");
    // Torque goes out every 5 ms, comes back every 10 ms: at most some 20 ms old, in a slalom at 0.3 Hz.
    let settled = 3200..3400;
    for n in settled {
        let near = measured[n - 25..=n].iter().any(|m| (m - torque[n]).abs() < 0.02);
        assert!(near, "tick {n}: the ECU says {}, measured {}", torque[n], measured[n]);
    }
    assert!(torque[2600].is_nan() && torque[2700].is_nan(), "absent while its message is dropped");
    let state = column("can", "ecu_state");
    assert_eq!((state[1400], state[1650], state[1900], state[2090]), (3.0, 4.0, 3.0, 5.0));
    let last = torque.len() - 1;
    assert_eq!(column("can", "ecu_checksum_errors")[last], 20.0, "what the ECU counted came back on the bus");
    assert_eq!(column("can", "message_timeout_count.0")[last], 1.0);
    assert_eq!(column("can", "withheld_count")[last], 0.0);
    assert!(column("can", "sent_count")[last] > 2200.0);
}

/// The loop over CAN: the unit's motor gives what the ECU on the bus asks for, and nothing where that has a reason not
/// to. What the driver feels says so: torsion bar and assist together carry what the bar alone carries without assist.
#[test]
fn the_ecu_on_the_bus_drives_the_assist_and_its_silence_is_safe() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, faults: &str| {
        let path = folder.path().join(format!("{name}.toml"));
        let text = format!(
            "extends = \"slalom_120\"\nname = \"{name}\"\nduration_s = 12.0\n[can]\n\
             mapping_file = \"steering_rest_bus\"\nassist = \"ecu\"\nfaults = [{faults}]\n"
        );
        std::fs::write(&path, text).unwrap();
        path.to_string_lossy().into_owned()
    };
    // Without the engine's message the ECU is there, and does not assist.
    let unassisted = "{ message = \"Engine\", fault = \"drop\", start_s = 0.0 }";
    // A gap it gets over, then silence.
    let silent = "{ message = \"EPS_Torque\", fault = \"drop\", start_s = 6.0, end_s = 6.3 }, \
                  { message = \"EPS_Torque\", fault = \"drop\", start_s = 9.0 }";
    let logs: Vec<LogReader> = [("assisted", "", 0), ("unassisted", unassisted, 0), ("silent", silent, 1)]
        .into_iter()
        .map(|(name, faults, code)| {
            let file = write(name, faults);
            let output = run_bench(folder.path(), &file, &format!("ecu-{name}"), &["--lockstep"]);
            assert_eq!(output.status.code(), Some(code), "{name}: {}", text(&output.stderr));
            LogReader::open(&folder.path().join(format!("ecu-{name}"))).unwrap()
        })
        .collect();
    let column = |run: usize, region: &str, name: &str| logs[run].column(region, name).unwrap();
    let window = 5000..10_000;
    let rms = |run: usize, name: &str| {
        let v = column(run, "rig_measurement", name);
        (window.clone().map(|n| v[n] * v[n]).sum::<f64>() / window.len() as f64).sqrt()
    };
    let (with, without) = (rms(0, "torsion_bar_torque_n_m"), rms(1, "torsion_bar_torque_n_m"));
    let assist = rms(0, "assist_torque_n_m");
    println!("torsion bar {with:.3} N·m rms with the ECU, {without:.3} without; assist {assist:.3}");
    assert!(rms(1, "assist_torque_n_m") < 0.02, "the unit's own ECU is out");
    assert!(with < 0.7 * without && assist > 0.5 * with, "the driver is helped");
    // In phase at 0.3 Hz, so that the rms add up; friction and the assist's lag take the rest.
    assert!(((with + assist) / without - 1.0).abs() < 0.15, "{with} + {assist} against {without}");

    // What is asked for is what the ECU said, one tick and the output phase later, within the rate limit.
    let (said, used) = (column(0, "can", "ecu_assist_torque_n_m"), column(0, "rig_status", "used_can"));
    let asked = column(0, "rig_status", "assist_request_n_m");
    for n in window.clone() {
        assert_eq!(used[n], n as f64 - 1.0);
        assert!((asked[n] - said[n - 1]).abs() < 1e-9, "tick {n}: {} asked, {} said", asked[n], said[n - 1]);
    }

    // The gap: 50 ms until the message counts as absent, then out within 0.1 s, back with the message; no trip.
    let (asked, state) = (column(2, "rig_status", "assist_request_n_m"), column(2, "rig_status", "state"));
    assert!(asked[6180..6300].iter().all(|a| *a == 0.0) && asked[6400..9000].iter().any(|a| a.abs() > 0.5));
    assert!(state[6000..9500].iter().all(|s| *s == 4.0), "the bench runs on without assist");
    // Silence: half a second after that it trips.
    let (code, tick) = (column(2, "rig_status", "trip_code"), column(2, "rig_status", "trip_tick"));
    let last = code.len() - 1;
    assert_eq!(code[last], 50.0, "ECU on the bus absent");
    println!("silent from 9 s, tripped at tick {}", tick[last]);
    assert!((9500.0..9575.0).contains(&tick[last]), "tripped at tick {}", tick[last]);
}

#[test]
fn who_drives_the_motor_must_be_there() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("wrong.toml");
    let text_of = "extends = \"slalom_120\"\nname = \"wrong\"\nunit_file = \"rack_eps\"\n[can]\n\
                   mapping_file = \"steering_rest_bus\"\nassist = \"ecu\"\n";
    std::fs::write(&file, text_of).unwrap();
    let output = run_bench(folder.path(), &file.to_string_lossy(), "wrong-ecu", &["--lockstep"]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr) + &text(&output.stdout);
    assert!(said.contains("no motor that takes a torque from outside"), "{said}");
}

#[test]
fn a_mapping_that_does_not_fit_stops_the_run_before_it_begins() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("wrong.toml");
    let text_of = "extends = \"slalom_120\"\nname = \"wrong\"\n[can]\nmapping_file = \"steering_rest_bus\"\n\
                   faults = [{ message = \"Nonsense\", fault = \"drop\", start_s = 1.0 }]\n";
    std::fs::write(&file, text_of).unwrap();
    let output =
        run_bench(folder.path(), &file.to_string_lossy(), "wrong", &["--lockstep", "--duration", "3.5"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stdout).contains("message Nonsense"), "{}", text(&output.stdout));
    let checked = Command::new(kingpin()).arg("check").arg(&file).output().unwrap();
    assert_eq!(checked.status.code(), Some(2));
}

fn kernel_has_can() -> bool {
    !matches!(can::socket::SocketBus::open("no-such-bus"), Err(can::socket::OpenError::NoCan))
}

#[test]
fn a_host_without_the_interface_is_told_why_and_the_bench_runs_on() {
    let told = if kernel_has_can() { "errno 19, ENODEV" } else { "errno 97, EAFNOSUPPORT" };
    println!("this kernel: {told}");
    for command in [&["can", "monitor"][..], &["can", "ecu"], &["can", "send", "123#00"]] {
        let output =
            Command::new(kingpin()).args(command).args(["--interface", "no-such-bus"]).output().unwrap();
        assert_eq!(output.status.code(), Some(3), "{command:?}");
        assert!(text(&output.stderr).contains(told), "{command:?}: {}", text(&output.stderr));
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bus.toml");
    let text_of = "extends = \"slalom_120\"\nname = \"bus\"\n[can]\nmapping_file = \"steering_rest_bus\"\n\
                   interface = \"no-such-bus\"\n";
    std::fs::write(&file, text_of).unwrap();
    let output = run_bench(folder.path(), &file.to_string_lossy(), "fallback", &["--duration", "3.2"]);
    let said = std::fs::read_to_string(folder.path().join("fallback/services.txt")).unwrap_or_default();
    assert!(said.contains(told) && said.contains("the run goes on"), "{said}\n{}", text(&output.stderr));
    let log = LogReader::open(&folder.path().join("fallback")).unwrap();
    let flags = log.column("can", "flags").unwrap();
    let wanted = regions::can_flags::FALLBACK | regions::can_flags::IN_MEMORY;
    assert!(flags.iter().all(|&flags| flags as u64 & wanted == wanted));
    assert!(log.column("can", "ecu_driver_torque_n_m").unwrap().iter().any(|torque| torque.is_finite()));
    assert!(log.column("vehicle_state", "time_s").unwrap().len() > 2000, "the bench ran");
}

/// Runs the `lab_` tests of this file inside a user-mode Linux with vcan0 and vcan1.
#[test]
fn on_a_real_bus() {
    if std::env::var_os("KINGPIN_CAN_LAB").is_some() {
        return;
    }
    let tools = ["linux.uml", "candump", "cansend", "insmod", "ip"];
    let paths = std::env::var("PATH").unwrap_or_default() + ":/usr/sbin:/sbin";
    let there = |tool: &&str| paths.split(':').any(|folder| Path::new(folder).join(tool).exists());
    if let Some(tool) = tools.iter().find(|tool| !there(tool)) {
        let missing = format!("{tool} (Debian: user-mode-linux can-utils kmod iproute2)");
        assert!(std::env::var("CI").as_deref() != Ok("true"), "missing: {missing}");
        println!("SKIPPED: missing: {missing}");
        return;
    }
    let begin = std::time::Instant::now();
    let output = Command::new(workspace().join("scripts/can-lab"))
        .arg(std::env::current_exe().unwrap())
        .args(["lab::", "--ignored", "--test-threads=1", "--nocapture"])
        .env("KINGPIN_EXECUTABLE", kingpin())
        .output()
        .unwrap();
    println!("{}\n{}", text(&output.stdout), text(&output.stderr));
    println!("CAN lab: {:.1} s", begin.elapsed().as_secs_f64());
    assert_eq!(output.status.code(), Some(0));
    let passed = text(&output.stdout);
    assert!(passed.contains("test result: ok") && !passed.contains("0 passed"), "no test ran in the lab");
}
