//! A human's wheel device: its angle in, the steering torque back out as a constant force.
//!
//! A live device has a thread of its own; the 1 ms path only stores and loads two atomic numbers. Recorded events
//! are a function of time, so that lockstep runs with them are equal. [`WheelDevice`] is what the thread needs of a
//! device: the Linux input device, or, in tests, a recording.

use crate::AssemblyError;
use config::wheel::{WheelInput, WheelSource};
use evdev::{
    AbsoluteAxisCode, Device, EventType, FFEffect, FFEffectData, FFEffectKind, FFEnvelope, FFReplay,
    FFTrigger,
};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Pause of the device's thread between two looks.
const LOOK: Duration = Duration::from_millis(2);
/// Smallest change of the force level that is sent to the device.
const LEVEL_STEP: f64 = 0.002;

/// A wheel as the thread sees it.
pub trait WheelDevice: Send {
    /// The newest position since the last call, -1 to 1, + to the left; `None`: it did not move.
    ///
    /// # Errors
    /// The device is gone.
    fn position(&mut self) -> io::Result<Option<f64>>;
    /// Sets the constant force, -1 to 1, + pushes to the left. A device without force feedback does nothing.
    ///
    /// # Errors
    /// The device is gone.
    fn force(&mut self, level: f64) -> io::Result<()>;
}

/// What passes between the thread and the 1 ms path: newest values, never a queue.
#[derive(Debug, Default)]
struct Handover {
    position: AtomicU64,
    level: AtomicU64,
    lost: AtomicBool,
    stop: AtomicBool,
}

/// A device with its thread.
pub struct LiveWheel {
    shared: Arc<Handover>,
    thread: Option<JoinHandle<()>>,
}

impl LiveWheel {
    /// Starts the thread.
    ///
    /// # Errors
    /// No thread can be had.
    pub fn start(mut device: impl WheelDevice + 'static) -> io::Result<Self> {
        let shared = Arc::new(Handover::default());
        let inside = Arc::clone(&shared);
        let work = move || {
            let mut sent = f64::NAN;
            while !inside.stop.load(Ordering::Relaxed) {
                let level = f64::from_bits(inside.level.load(Ordering::Relaxed));
                let moved = device.position().and_then(|position| {
                    if sent.is_nan() || (level - sent).abs() >= LEVEL_STEP {
                        device.force(level)?;
                        sent = level;
                    }
                    Ok(position)
                });
                match moved {
                    Ok(Some(position)) => {
                        inside.position.store(position.clamp(-1.0, 1.0).to_bits(), Ordering::Relaxed);
                    }
                    Ok(None) => {}
                    Err(_) => {
                        inside.lost.store(true, Ordering::Relaxed);
                        return;
                    }
                }
                std::thread::sleep(LOOK);
            }
            let _ = device.force(0.0);
        };
        let thread = std::thread::Builder::new().name("wheel".to_owned()).spawn(work)?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Newest position, -1 to 1; `None` once the device is gone.
    pub fn position(&self) -> Option<f64> {
        let lost = self.shared.lost.load(Ordering::Relaxed);
        (!lost).then(|| f64::from_bits(self.shared.position.load(Ordering::Relaxed)))
    }

    /// Asks for a force, -1 to 1.
    pub fn set_force(&self, level: f64) {
        if level.is_finite() {
            self.shared.level.store(level.clamp(-1.0, 1.0).to_bits(), Ordering::Relaxed);
        }
    }
}

impl Drop for LiveWheel {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A Linux input device: first absolute axis, constant force if it has one.
struct EvdevWheel {
    device: Device,
    low: f64,
    high: f64,
    effect: Option<FFEffect>,
}

impl EvdevWheel {
    fn open(path: &str) -> io::Result<Self> {
        let mut device = Device::open(path)?;
        device.set_nonblocking(true)?;
        let axis = device
            .get_absinfo()?
            .find(|(code, _)| *code == AbsoluteAxisCode::ABS_X)
            .map(|(_, info)| (f64::from(info.minimum()), f64::from(info.maximum())));
        let Some((low, high)) = axis.filter(|(low, high)| high > low) else {
            return Err(io::Error::new(io::ErrorKind::Unsupported, "has no absolute X axis: not a wheel"));
        };
        let effect = device.upload_ff_effect(constant(0.0)).ok().and_then(|mut effect| {
            effect.play(1).ok()?;
            Some(effect)
        });
        Ok(Self { device, low, high, effect })
    }
}

fn constant(level: f64) -> FFEffectData {
    FFEffectData {
        direction: 0x4000,
        trigger: FFTrigger { button: 0, interval: 0 },
        replay: FFReplay { length: u16::MAX, delay: 0 },
        kind: FFEffectKind::Constant {
            level: (level * 32767.0) as i16,
            envelope: FFEnvelope { attack_length: 0, attack_level: 0, fade_length: 0, fade_level: 0 },
        },
    }
}

impl WheelDevice for EvdevWheel {
    fn position(&mut self) -> io::Result<Option<f64>> {
        let events = match self.device.fetch_events() {
            Ok(events) => events,
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(None),
            Err(error) => return Err(error),
        };
        let x = AbsoluteAxisCode::ABS_X.0;
        let newest = events
            .filter(|e| e.event_type() == EventType::ABSOLUTE && e.code() == x)
            .map(|e| e.value())
            .last();
        // Devices count up to the right; a left turn is positive here.
        let middle = 0.5 * (self.low + self.high);
        Ok(newest.map(|value| (middle - f64::from(value)) / (0.5 * (self.high - self.low))))
    }

    fn force(&mut self, level: f64) -> io::Result<()> {
        match &mut self.effect {
            Some(effect) => effect.update(constant(level)),
            None => Ok(()),
        }
    }
}

enum Feed {
    Live(LiveWheel),
    Recorded { time_s: Vec<f64>, position: Vec<f64> },
}

/// The wheel of a bench: smooth angle and rate of the steer command, and the torque fed back.
pub struct Wheel {
    feed: Feed,
    angle_at_end_rad: f64,
    torque_at_full_force_n_m: f64,
    smoothing_rad_s: f64,
    period_s: f64,
    angle_rad: f64,
    rate_rad_s: f64,
}

impl Wheel {
    /// Opens the device or the recording.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn new(input: &WheelInput, period_s: f64) -> Result<Self, AssemblyError> {
        let feed = match &input.source {
            WheelSource::Evdev { device } => {
                let wheel = EvdevWheel::open(device).and_then(LiveWheel::start);
                Feed::Live(wheel.map_err(|e| AssemblyError::new("wheel", [format!("{device}: {e}")]))?)
            }
            WheelSource::Recorded { file } => {
                let (time_s, position) = recorded(file).map_err(|e| AssemblyError::new("wheel", [e]))?;
                Feed::Recorded { time_s, position }
            }
        };
        Ok(Self {
            feed,
            angle_at_end_rad: input.angle_at_end_rad,
            torque_at_full_force_n_m: input.torque_at_full_force_n_m,
            smoothing_rad_s: input.smoothing_rad_s,
            period_s,
            angle_rad: 0.0,
            rate_rad_s: 0.0,
        })
    }

    /// One tick at `time_s`: takes the position, gives the torque back. Angle and rate of the command [rad],
    /// [rad/s]; `None` once the device is gone.
    pub fn step(&mut self, time_s: f64, torque_n_m: f64) -> Option<(f64, f64)> {
        let position = match &self.feed {
            Feed::Live(wheel) => {
                // What the driver has to hold pushes the wheel the other way.
                wheel.set_force(-torque_n_m / self.torque_at_full_force_n_m);
                wheel.position()?
            }
            Feed::Recorded { time_s: times, position } => {
                let next = times.partition_point(|t| *t <= time_s);
                if next == 0 { 0.0 } else { position[next - 1] }
            }
        };
        // Critically damped, implicit: stable at any period.
        let (w, h) = (self.smoothing_rad_s, self.period_s);
        let wanted = position * self.angle_at_end_rad;
        self.rate_rad_s =
            (self.rate_rad_s + h * w * w * (wanted - self.angle_rad)) / (1.0 + 2.0 * h * w + h * h * w * w);
        self.angle_rad += h * self.rate_rad_s;
        Some((self.angle_rad, self.rate_rad_s))
    }
}

fn recorded(file: &str) -> Result<(Vec<f64>, Vec<f64>), String> {
    let mut reader = csv::Reader::from_path(file).map_err(|e| format!("{file}: {e}"))?;
    let heads = reader.headers().map_err(|e| format!("{file}: {e}"))?.clone();
    let find = |name: &str| {
        heads.iter().position(|h| h.trim() == name).ok_or_else(|| format!("{file}: column {name} is missing"))
    };
    let (t, p) = (find("time_s")?, find("position")?);
    let (mut time_s, mut position) = (Vec::new(), Vec::new());
    for (row, record) in reader.records().enumerate() {
        let record = record.map_err(|e| format!("{file}: {e}"))?;
        let number = |column: usize| {
            record.get(column).and_then(|v| v.trim().parse::<f64>().ok()).filter(|v| v.is_finite())
        };
        let (Some(time), Some(at)) = (number(t), number(p)) else {
            return Err(format!("{file}:{}: time_s and position must be numbers", row + 2));
        };
        if at.abs() > 1.0 || time_s.last().is_some_and(|last| time < *last) {
            return Err(format!("{file}:{}: position must be in [-1, 1] and time_s must not fall", row + 2));
        }
        time_s.push(time);
        position.push(at);
    }
    Ok((time_s, position))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use std::sync::Mutex;

    /// Plays positions back, one a look, and keeps the forces it was given.
    struct Recording {
        positions: Vec<f64>,
        forces: Arc<Mutex<Vec<f64>>>,
    }

    impl WheelDevice for Recording {
        fn position(&mut self) -> io::Result<Option<f64>> {
            if self.positions.is_empty() {
                return Err(io::Error::other("unplugged"));
            }
            Ok(Some(self.positions.remove(0)))
        }
        fn force(&mut self, level: f64) -> io::Result<()> {
            self.forces.lock().unwrap().push(level);
            Ok(())
        }
    }

    #[test]
    fn positions_come_in_forces_go_out_and_a_lost_device_is_seen() {
        let forces = Arc::new(Mutex::new(Vec::new()));
        let mut positions = vec![0.25; 400];
        positions.push(0.75);
        positions.extend(vec![0.75; 50]);
        let wheel = LiveWheel::start(Recording { positions, forces: Arc::clone(&forces) }).unwrap();
        wheel.set_force(-0.5);
        let mut seen = Vec::new();
        for _ in 0..20_000 {
            match wheel.position() {
                Some(at) => seen.push(at),
                None => break,
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(wheel.position().is_none(), "the end of the recording is a lost device");
        assert!(seen.contains(&0.25) && seen.contains(&0.75));
        assert!(forces.lock().unwrap().contains(&-0.5));
    }

    #[test]
    fn recorded_events_become_a_smooth_angle() {
        let file = std::env::temp_dir().join(format!("kingpin-wheel-{}.csv", std::process::id()));
        std::fs::write(&file, "time_s,position\n0.0,0.0\n0.1,0.5\n0.6,-0.5\n").unwrap();
        let input = WheelInput {
            source: WheelSource::Recorded { file: file.display().to_string() },
            angle_at_end_rad: 4.0,
            torque_at_full_force_n_m: 8.0,
            smoothing_rad_s: 60.0,
        };
        let mut wheel = Wheel::new(&input, 1e-3).unwrap();
        std::fs::remove_file(&file).unwrap();
        let mut last = 0.0;
        for n in 0..1000 {
            let (angle, rate) = wheel.step(f64::from(n) * 1e-3, 1.0).unwrap();
            assert!((angle - last - 1e-3 * rate).abs() < 1e-12 && rate.abs() < 100.0);
            last = angle;
            if n == 590 {
                assert!((angle - 2.0).abs() < 1e-3, "{angle}");
            }
        }
        assert!((last + 2.0).abs() < 1e-3, "{last}");
    }
}
