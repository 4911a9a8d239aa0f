//! `can monitor|send|ecu`: on a bus.

use super::can::{check_mapping, database, decoded, decoded_text, encode_words, refuse};
use super::can_args::{CanEcuArgs, CanMonitorArgs, CanSendArgs};
use crate::exit::Exit;
use crate::output;
use can::bus::{Bus, Event};
use can::ecu::VirtualEcu;
use can::socket::SocketBus;
use can::{Database, Frame};
use runtime::clock;
use serde_json::json;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Longest wait between two looks at Ctrl-C.
const LOOK: Duration = Duration::from_millis(100);
/// The virtual ECU's own cycle. [ns]
const ECU_CYCLE_NS: u64 = 1_000_000;

fn open(name: &str) -> Result<SocketBus, Exit> {
    SocketBus::open(name).map_err(|error| {
        output::note(error);
        Exit::Unavailable
    })
}

fn interrupt() -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        let _ = signal_hook::flag::register(signal, Arc::clone(&flag));
    }
    flag
}

fn end_of(duration_s: Option<f64>) -> Result<u64, Exit> {
    match duration_s {
        None => Ok(u64::MAX),
        Some(s) if s.is_finite() && s > 0.0 => Ok(clock::now() + (s * 1e9) as u64),
        Some(_) => {
            output::note("--duration: must be more than 0 s");
            Err(Exit::BadInput)
        }
    }
}

/// `kingpin can monitor`.
pub fn monitor(args: &CanMonitorArgs) -> Exit {
    let database = match args.dbc.as_deref().map(database).transpose() {
        Ok(database) => database.unwrap_or_default(),
        Err(error) => return refuse(&error),
    };
    let mut bus = match open(&args.interface) {
        Ok(bus) => bus,
        Err(exit) => return exit,
    };
    let end = match end_of(args.duration) {
        Ok(end) => end,
        Err(exit) => return exit,
    };
    let stop = interrupt();
    let begin = clock::now();
    let mut shown = 0;
    while !stop.load(Ordering::Relaxed) && clock::now() < end {
        let left = Duration::from_nanos(end.saturating_sub(clock::now())).min(LOOK);
        match bus.wait(left) {
            Ok(true) => {}
            Ok(false) => continue,
            Err(error) => {
                output::note(error);
                return Exit::Failed;
            }
        }
        loop {
            let event = match bus.receive() {
                Ok(Some(event)) => event,
                Ok(None) => break,
                Err(error) => {
                    output::note(error);
                    return Exit::Failed;
                }
            };
            let at_s = (clock::now() - begin) as f64 * 1e-9;
            if show(args, &database, event, at_s) {
                shown += 1;
            }
            if args.count.is_some_and(|count| shown >= count) {
                return Exit::Done;
            }
        }
    }
    // What a duration or Ctrl-C ends has ended as asked, unless a number of frames was waited for.
    if args.count.is_some() && !stop.load(Ordering::Relaxed) {
        output::note(format!("only {shown} frames came"));
        return Exit::Failed;
    }
    Exit::Done
}

fn show(args: &CanMonitorArgs, database: &Database, event: Event, at_s: f64) -> bool {
    let frame = match event {
        Event::Frame(frame) => frame,
        Event::Error(class) => {
            output::note(format!("{at_s:10.6} error frame, class {class:#X}"));
            return false;
        }
    };
    let message = database.by_id(frame.id).filter(|message| message.len <= frame.data().len());
    let named = |only: &String| {
        message.is_some_and(|message| message.name == *only)
            || u32::from_str_radix(only, 16).is_ok_and(|id| id == frame.id.number())
    };
    if !args.only.is_empty() && !args.only.iter().any(named) {
        return false;
    }
    if args.json {
        let signals = message.map(|message| decoded(message, frame.data()));
        output::line(json!({
            "time_s": at_s, "frame": frame.to_string(), "message": message.map(|m| &m.name), "signals": signals
        }));
    } else {
        let text =
            message.map_or(String::new(), |m| format!("  {}: {}", m.name, decoded_text(m, frame.data())));
        output::line(format!("{at_s:10.6}  {frame}{text}"));
    }
    true
}

/// `kingpin can send`.
pub fn send(args: &CanSendArgs) -> Exit {
    let frames: Result<Vec<Frame>, String> = match &args.dbc {
        Some(dbc) => database(dbc).and_then(|database| {
            encode_words(&database, &args.what[0], &args.what[1..], args.fd)
                .map(|frame| vec![frame])
                .map_err(|faults| faults.join("\n"))
        }),
        None => args.what.iter().map(|text| Frame::parse(text)).collect(),
    };
    let frames = match frames {
        Ok(frames) => frames,
        Err(error) => return refuse(&error),
    };
    if !(args.cycle_ms.is_finite() && args.cycle_ms >= 0.0) {
        return refuse("--cycle-ms: must be 0 or more");
    }
    let mut bus = match open(&args.interface) {
        Ok(bus) => bus,
        Err(exit) => return exit,
    };
    let stop = interrupt();
    let begin = clock::now();
    for turn in 0..args.count {
        clock::sleep_until(begin + (turn as f64 * args.cycle_ms * 1e6) as u64, 0);
        if stop.load(Ordering::Relaxed) {
            return Exit::Interrupted;
        }
        for frame in &frames {
            if let Err(error) = bus.send(frame) {
                output::note(format!("{frame}: {error}"));
                return Exit::Failed;
            }
        }
    }
    Exit::Done
}

/// `kingpin can ecu`.
pub fn ecu(args: &CanEcuArgs) -> Exit {
    let plan = match check_mapping(&args.mapping) {
        Ok((_, plan)) => plan,
        Err(problems) => return refuse(&problems.to_string()),
    };
    let mut bus = match open(&args.interface) {
        Ok(bus) => bus,
        Err(exit) => return exit,
    };
    let end = match end_of(args.duration) {
        Ok(end) => end,
        Err(exit) => return exit,
    };
    let stop = interrupt();
    let mut ecu = VirtualEcu::new(plan);
    let begin = clock::now();
    let mut said = 0;
    let mut next = begin;
    output::note(format!("virtual ECU on {}: Ctrl-C ends it", args.interface));
    while !stop.load(Ordering::Relaxed) && clock::now() < end {
        clock::sleep_until(next, 0);
        let now = clock::now();
        next = (next + ECU_CYCLE_NS).max(now);
        loop {
            match bus.receive() {
                Ok(Some(Event::Frame(frame))) => ecu.take(now - begin, &frame),
                Ok(Some(Event::Error(class))) => output::note(format!("error frame, class {class:#X}")),
                Ok(None) => break,
                Err(error) => {
                    output::note(error);
                    return Exit::Failed;
                }
            }
        }
        ecu.step(now - begin, &mut bus);
        if args.json && now - begin >= said {
            said += 500_000_000;
            output::line(status(&ecu, now - begin));
        }
    }
    let status = status(&ecu, clock::now() - begin);
    if let Some(path) = &args.output
        && let Err(error) = std::fs::write(path, format!("{status}\n"))
    {
        output::note(format!("{}: {error}", path.display()));
        return Exit::Unavailable;
    }
    output::note(format!("virtual ECU: {status}"));
    Exit::Done
}

fn status(ecu: &VirtualEcu, at_ns: u64) -> serde_json::Value {
    let (speed_m_s, torque_n_m) = ecu.heard();
    json!({
        "time_s": at_ns as f64 * 1e-9,
        "state": ecu.state(),
        "assist_n_m": ecu.assist_n_m(),
        "vehicle_speed_m_s": speed_m_s,
        "torsion_bar_torque_n_m": torque_n_m,
        "seen": ecu.seen(),
    })
}
