//! What is written is what is read: bit for bit, by name, across files, and by other people's software.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use std::path::Path;
use std::process::Command;

use record::{CsvOptions, LogError, LogReader, LogWriter, compare, export_csv};
use regions::RegionId;
use support::{header, logged, words, write_log, write_ticks};

#[test]
fn every_word_of_every_region_comes_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_log(&path, 0..230);
    let log = LogReader::open(&path).unwrap();
    assert_eq!(log.header, header(false));
    assert!(log.header.configuration_intact());
    assert!(log.intact());
    assert_eq!(log.regions().len(), logged().count());
    for id in logged() {
        let region = log.region(id.region().name).unwrap();
        assert_eq!(region.ticks, (0..230).collect::<Vec<_>>());
        for tick in 0..230 {
            assert_eq!(region.at_tick(tick).unwrap(), words(id, tick), "{} {tick}", region.name);
        }
        let expected = id.region().layout.columns();
        assert!(expected.iter().zip(&region.columns).all(|(e, c)| e.name == c.name && e.unit == c.unit));
    }
    assert_eq!(log.events.len(), 2);
    assert_eq!((log.events[1].tick, log.events[1].kind.as_str()), (7, "trip"));
    assert_eq!(log.events[1].detail["limit_n"], 9000.0);
    let left = log.column("rig_measurement", "tie_rod_force_n.left").unwrap();
    let word = RegionId::RigMeasurement.region().layout.columns();
    let word = word.iter().find(|c| c.name == "tie_rod_force_n.left").unwrap().word;
    assert_eq!(left[17].to_bits(), words(RegionId::RigMeasurement, 17)[word]);
}

#[test]
fn misspelt_names_get_suggestions() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_log(&path, 0..3);
    let log = LogReader::open(&path).unwrap();
    let error = log.signal("rig_measurement.tie_rod_force").unwrap_err().to_string();
    assert!(error.contains("rig_measurement.tie_rod_force_n.left"), "{error}");
    assert!(log.column("rig_measurment", "tick").unwrap_err().to_string().contains("rig_measurement"));
}

#[test]
fn nothing_is_overwritten_and_only_files_are_logs() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    std::fs::write(&path, "mine").unwrap();
    assert!(matches!(LogWriter::create(&path, &header(false)), Err(LogError::Exists(_))));
    assert_eq!(std::fs::read(&path).unwrap(), b"mine");
    let dangling = dir.path().join("link.mcap");
    std::os::unix::fs::symlink(dir.path().join("nowhere"), &dangling).unwrap();
    assert!(matches!(LogWriter::create(&dangling, &header(false)), Err(LogError::Exists(_))));
    let nowhere = dir.path().join("no/such/dir/log.mcap");
    assert!(matches!(LogWriter::create(&nowhere, &header(false)), Err(LogError::Io { .. })));

    assert!(matches!(LogReader::open(&path), Err(LogError::NotALog { .. })));
    assert!(matches!(LogReader::open(&dir.path().join("none")), Err(LogError::Io { .. })));
    let empty = tempfile::tempdir().unwrap();
    assert!(matches!(LogReader::open(empty.path()), Err(LogError::NoLogIn(_))));
    // Opening a pipe for reading would wait for ever.
    let pipe = dir.path().join("pipe");
    rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
    assert!(matches!(LogReader::open(&pipe), Err(LogError::NotRegularFile(_))));
    assert!(matches!(LogReader::open(Path::new("/dev/null")), Err(LogError::NotRegularFile(_))));
}

#[test]
fn missing_ticks_stay_visible() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_log(&path, (0..100).filter(|t| !(20..=24).contains(t) && *t != 60));
    let log = LogReader::open(&path).unwrap();
    let region = log.region("vehicle_state").unwrap();
    assert_eq!(region.missing(), [(20, 24), (60, 60)]);
    assert_eq!(region.missing_count(), 6);
    assert_eq!(region.at_tick(22), None);
}

#[test]
fn files_of_a_restarted_logger_read_as_one() {
    let dir = tempfile::tempdir().unwrap();
    // The first logger died after tick 119; the second began where the table still had ticks: at 100.
    for (ticks, name) in [(0..120, "log.mcap"), (100..200, "log.1.mcap"), (203..210, "log.2.mcap")] {
        let path = LogWriter::next_path(dir.path());
        assert_eq!(path.file_name().unwrap(), name);
        let mut log = LogWriter::create(&path, &header(false)).unwrap();
        write_ticks(&mut log, ticks);
        log.finish().unwrap();
    }
    let log = LogReader::open(dir.path()).unwrap();
    assert_eq!(log.files.len(), 3);
    assert_eq!(log.files[1].ticks, Some((100, 199)));
    for id in logged() {
        let region = log.region(id.region().name).unwrap();
        assert_eq!((region.duplicates, region.conflicts), (20, 0));
        assert_eq!(region.missing(), [(200, 202)]);
        assert_eq!(region.at_tick(110).unwrap(), words(id, 110));
    }
    // A file of another run in the same directory is refused by name.
    let mut other = header(false);
    other.run_id += 1;
    LogWriter::create(&dir.path().join("log.3.mcap"), &other).unwrap().finish().unwrap();
    let error = LogReader::open(dir.path()).unwrap_err();
    assert!(
        matches!(&error, LogError::DifferentRuns { path, .. } if path.ends_with("log.3.mcap")),
        "{error}"
    );
}

#[test]
fn comparison_finds_one_flipped_bit_and_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let (path_a, path_b) = (dir.path().join("a.mcap"), dir.path().join("b.mcap"));
    write_log(&path_a, 0..80);
    let mut log = LogWriter::create(&path_b, &header(true)).unwrap();
    let column = RegionId::VehicleState.region().layout.columns();
    let column = column.iter().find(|c| c.name == "acceleration_m_s2.y").unwrap();
    for tick in 0..80 {
        for id in logged() {
            let mut words = words(id, tick);
            if id == RegionId::VehicleState && tick >= 40 {
                words[column.word] ^= 1;
            }
            // Timings differ in every run: they are not compared.
            if id == RegionId::RigTiming {
                words[2] ^= 0xff;
            }
            log.write(id, tick, &words);
        }
    }
    log.finish().unwrap();
    let (a, b) = (LogReader::open(&path_a).unwrap(), LogReader::open(&path_b).unwrap());
    assert_eq!(compare(&a, &a), []);
    let differences = compare(&a, &b);
    assert_eq!(differences.len(), 1, "{differences:?}");
    assert_eq!(differences[0].tick, Some(40));
    assert!(differences[0].to_string().starts_with("vehicle_state.acceleration_m_s2.y at tick 40: "));

    let path_c = dir.path().join("c.mcap");
    write_log(&path_c, (0..80).filter(|t| *t != 33));
    let differences = compare(&a, &LogReader::open(&path_c).unwrap());
    let compared = logged().filter(|id| id.region().compared).count();
    assert_eq!(differences.len(), compared, "each compared region: {differences:?}");
    assert!(differences.iter().all(|d| d.tick == Some(33) && d.what == "tick only in the first log"));

    let empty = dir.path().join("empty.mcap");
    LogWriter::create(&empty, &header(false)).unwrap().finish().unwrap();
    let empty = LogReader::open(&empty).unwrap();
    assert!(!compare(&empty, &empty).is_empty(), "two empty logs are not a proof of anything");
}

#[test]
fn csv_has_one_time_names_with_units_and_exact_numbers() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_log(&path, (0..100).filter(|t| *t != 20));
    let log = LogReader::open(&path).unwrap();
    let options = CsvOptions {
        selection: vec!["rig_measurement.tie_rod_force_n".into(), "vehicle_state.yaw_rad".into()],
        decimation: 10,
        unit_row: true,
    };
    let mut out = Vec::new();
    assert_eq!(export_csv(&log, &options, &mut out).unwrap(), 9);
    let text = String::from_utf8(out).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines[0],
        "tick,time_s,rig_measurement.tie_rod_force_n.left,rig_measurement.tie_rod_force_n.right,vehicle_state.yaw_rad"
    );
    assert_eq!(lines[1], "1,s,N,N,rad");
    let right = log.column("rig_measurement", "tie_rod_force_n.right").unwrap();
    for line in &lines[2..] {
        let cells: Vec<&str> = line.split(',').collect();
        let tick: usize = cells[0].parse().unwrap();
        assert_eq!(cells[1].parse::<f64>().unwrap(), tick as f64 * 1e-3);
        let expected = right[if tick > 20 { tick - 1 } else { tick }];
        let cell: f64 = cells[3].parse().unwrap();
        assert!(cell.to_bits() == expected.to_bits() || cell.is_nan() && expected.is_nan(), "{line}");
    }
    let bad = CsvOptions { selection: vec!["rig_measurement.tie_rod_force".into()], ..CsvOptions::default() };
    let error = export_csv(&log, &bad, &mut Vec::new()).unwrap_err();
    assert!(error.to_string().contains("tie_rod_force_n.left"), "{error}");
    let mut all = Vec::new();
    assert_eq!(export_csv(&log, &CsvOptions::default(), &mut all).unwrap(), 99);
}

#[test]
fn lockstep_logs_are_the_same_bytes_whenever_they_are_written() {
    let dir = tempfile::tempdir().unwrap();
    let bytes = ["a", "b"].map(|name| {
        let path = dir.path().join(name);
        let mut log = LogWriter::create(&path, &header(true)).unwrap();
        write_ticks(&mut log, 0..60);
        log.finish().unwrap();
        std::fs::read(path).unwrap()
    });
    assert!(bytes[0] == bytes[1]);
}

#[test]
fn speed_is_printed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    let rows: Vec<Vec<Vec<u64>>> = (0..2000).map(|t| logged().map(|id| words(id, t)).collect()).collect();
    let mut log = LogWriter::create(&path, &header(true)).unwrap();
    let start = std::time::Instant::now();
    let mut flush_us = Vec::new();
    for (tick, row) in rows.iter().enumerate() {
        for (id, words) in logged().zip(row) {
            log.write(id, tick as u64, words);
        }
        if tick % 50 == 49 {
            let before = start.elapsed();
            log.flush();
            flush_us.push((start.elapsed() - before).as_micros());
        }
    }
    let written = start.elapsed().as_secs_f64();
    let bytes = log.finish().unwrap().bytes;
    let start = std::time::Instant::now();
    let read = LogReader::open(&path).unwrap();
    assert_eq!(read.region("bench").unwrap().ticks.len(), rows.len());
    flush_us.sort_unstable();
    println!(
        "2000 ticks of all regions, {:.1} MB: written in {:.3} s (flush p50 {} us, max {} us), read in {:.3} s",
        bytes as f64 * 1e-6,
        written,
        flush_us[flush_us.len() / 2],
        flush_us[flush_us.len() - 1],
        start.elapsed().as_secs_f64()
    );
}

/// The Python that KINGPIN_PEERS names, else `python3`, if it has the packages of tests/peers.txt. None, with what is
/// missing printed, where there is no such thing; with CI=true that is a failure.
fn python() -> Option<std::ffi::OsString> {
    let python = std::env::var_os("KINGPIN_PEERS").unwrap_or_else(|| "python3".into());
    let modules = "import mcap.reader, mcap_ros2.decoder";
    if Command::new(&python).args(["-c", modules]).output().is_ok_and(|o| o.status.success()) {
        return Some(python);
    }
    let missing = "Python with the packages in tests/peers.txt (KINGPIN_PEERS names the interpreter)";
    assert!(std::env::var("CI").as_deref() != Ok("true"), "missing: {missing}");
    println!("SKIPPED: missing: {missing}");
    None
}

const DECODE: &str = r#"
import struct, sys
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
with open(sys.argv[1], "rb") as f:
    reader = make_reader(f, decoder_factories=[DecoderFactory()])
    for m in reader.iter_metadata():
        print("metadata", m.name, m.metadata["scenario"], m.metadata["run_id"])
    for a in reader.iter_attachments():
        print("attachment", a.name, len(a.data))
    topics = [c.topic for c in reader.get_summary().channels.values() if c.message_encoding == "cdr"]
    for schema, channel, message, ros in reader.iter_decoded_messages(topics=topics):
        words = []
        for slot in ros.__slots__:
            value = getattr(ros, slot)
            for v in (value if isinstance(value, (list, tuple)) else [value]):
                words.append("%016x" % (v if isinstance(v, int) else struct.unpack("<Q", struct.pack("<d", v))[0]))
        print("message", channel.topic, message.log_time, " ".join(words))
"#;

#[test]
fn python_tools_decode_every_region_exactly() {
    let Some(python) = python() else { return };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_log(&path, 0..120);
    let output = Command::new(python).arg("-c").arg(DECODE).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("metadata kingpin lane_change 123456789abcdef0"));
    assert!(text.contains("attachment configuration.toml 32"), "{}", &text[..400]);
    let mut seen = 0;
    for line in text.lines().filter_map(|line| line.strip_prefix("message /")) {
        let mut parts = line.split(' ');
        let (id, _) = regions::region_by_name(parts.next().unwrap()).unwrap();
        let log_time: u64 = parts.next().unwrap().parse().unwrap();
        let decoded: Vec<u64> = parts.map(|word| u64::from_str_radix(word, 16).unwrap()).collect();
        let tick = decoded[0];
        assert_eq!(decoded, words(id, tick), "{} {tick}", id.region().name);
        assert_eq!(log_time, header(false).wall_start_ns + tick * 1_000_000);
        seen += 1;
    }
    assert_eq!(seen, 120 * logged().count());
}
