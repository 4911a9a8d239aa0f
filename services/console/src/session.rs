//! One client: what it says, and what it sees.
//!
//! The client's task sends a frame at the rate asked for, made of what is in the table (or log) at that moment.
//! Sending waits for the client; the frames of that time are never made. Nothing is queued but what the
//! system's own buffers hold, and a client that takes nothing for [`SEND_MAX`] is let go.

use crate::hub::Hub;
use crate::message::{Message as Wanted, Want};
use crate::replay::Replay;
use crate::runs;
use crate::signals::{self, Signal};
use axum::extract::ws::{Message, WebSocket};
use operator_link::{Answer, Request};
use params::{LIST, Setting};
use serde_json::{Value, json};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tokio::time::{Instant, Interval, MissedTickBehavior, interval, timeout};

/// Longest message. \[B\]
pub const MESSAGE_MAX: usize = 8 * 1024;
/// A client that takes nothing for this long is let go.
const SEND_MAX: Duration = Duration::from_secs(10);
/// Messages a second that are listened to; more wait.
const MESSAGES_HZ: f64 = 2000.0;
/// Signals a client may watch.
const TRACES_MAX: usize = 32;
const LATEST_MAX: usize = 256;
/// Most rows of a frame; what is longer ago is left out.
const ROWS_MAX: u64 = 400;

/// What a client watches.
struct Watch {
    traces: Vec<Signal>,
    latest: Vec<Signal>,
    points_hz: f64,
    /// Newest tick sent.
    sent: Option<u64>,
    run_id: u64,
}

struct Session {
    hub: Arc<Hub>,
    may_write: bool,
    watch: Watch,
    replay: Option<Replay>,
    at: Instant,
    seen: u64,
}

/// Counts the client while it is there.
struct Counted(Arc<Hub>);

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Serves a client until it goes.
pub(crate) async fn serve(hub: Arc<Hub>, mut socket: WebSocket) {
    hub.clients.fetch_add(1, Ordering::Relaxed);
    let _counted = Counted(Arc::clone(&hub));
    let watch = Watch { traces: Vec::new(), latest: Vec::new(), points_hz: 100.0, sent: None, run_id: 0 };
    let mut seen = 0;
    hub.news(&mut seen);
    let mut session = Session { hub, may_write: false, watch, replay: None, at: Instant::now(), seen };
    let mut beat = beat_of(20.0);
    let mut allowance = 0.0_f64;
    let mut listened = Instant::now();
    if send(&mut socket, session.greeting()).await.is_err() {
        return;
    }
    loop {
        tokio::select! {
            biased;
            _ = beat.tick() => {
                let frame = session.frame();
                if send(&mut socket, frame).await.is_err() {
                    return;
                }
                session.hub.frames_sent.fetch_add(1, Ordering::Relaxed);
            }
            said = socket.recv() => {
                // Too long, not text, cut off: the connection is beyond repair.
                let Some(Ok(said)) = said else { return };
                let now = Instant::now();
                allowance = (allowance + (now - listened).as_secs_f64() * MESSAGES_HZ).min(0.5 * MESSAGES_HZ);
                listened = now;
                if allowance < 1.0 {
                    tokio::time::sleep(Duration::from_secs_f64(1.0 / MESSAGES_HZ)).await;
                } else {
                    allowance -= 1.0;
                }
                let answer = match said {
                    Message::Text(text) => match serde_json::from_str::<Wanted>(text.as_str()) {
                        Ok(Wanted { id, want }) => {
                            if let Want::Subscribe { rate_hz, .. } = &want {
                                beat = beat_of(*rate_hz);
                            }
                            let mut answer = session.answer(want).await;
                            answer["id"] = json!(id);
                            answer
                        }
                        Err(error) => json!({"error": format!("not understood: {error}"), "id": null}),
                    },
                    Message::Binary(_) => json!({"error": "not understood: binary", "id": null}),
                    Message::Close(_) => return,
                    Message::Ping(_) | Message::Pong(_) => continue,
                };
                if send(&mut socket, answer).await.is_err() {
                    return;
                }
            }
        }
    }
}

fn beat_of(rate_hz: f64) -> Interval {
    let rate = if rate_hz.is_finite() { rate_hz.clamp(0.5, 60.0) } else { 20.0 };
    let mut beat = interval(Duration::from_secs_f64(1.0 / rate));
    beat.set_missed_tick_behavior(MissedTickBehavior::Skip);
    beat
}

async fn send(socket: &mut WebSocket, value: Value) -> Result<(), ()> {
    let text = Message::Text(value.to_string().into());
    match timeout(SEND_MAX, socket.send(text)).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(()),
    }
}

fn error(text: impl Into<String>) -> Value {
    json!({ "error": text.into() })
}

impl Session {
    /// What every page is told first.
    fn greeting(&self) -> Value {
        let scenarios: Vec<_> =
            config::Library::list(config::Kind::Scenario).into_iter().map(|s| s.name).collect();
        let trips: serde_json::Map<_, _> = safety::TripCode::ALL
            .into_iter()
            .map(|code| ((code as u8).to_string(), json!([code.describe().0, code.describe().1])))
            .collect();
        json!({"greeting": {
            "trips": trips, "states": regions::STATE_NAMES,
            "bench": self.hub.bench.name().as_str(), "version": env!("CARGO_PKG_VERSION"), "scenarios": scenarios,
            "log": self.hub.log.as_deref().map(crate::hub::log_name),
        }})
    }

    /// What there is to see now.
    fn frame(&mut self) -> Value {
        let now = Instant::now();
        let elapsed = (now - self.at).as_secs_f64();
        self.at = now;
        let note = self.hub.news(&mut self.seen);
        if let Some(replay) = &mut self.replay {
            replay.advance(elapsed);
            let (tick, period) = (replay.tick(), replay.period_s());
            let ticks = self.watch.ticks(tick, period);
            return json!({"frame": {
                "replay": replay.about(), "time_s": times(&ticks, period), "tick": tick,
                "rows": replay.rows(&self.watch.traces, &ticks), "latest": replay.latest(&self.watch.latest),
                "note": note,
            }});
        }
        let Some(live) = self.hub.live() else {
            return json!({"frame": {"live": null, "time_s": [], "rows": [], "latest": [], "note": note}});
        };
        let anew = live.run_id != self.watch.run_id;
        if anew {
            (self.watch.run_id, self.watch.sent) = (live.run_id, None);
        }
        let newest = live.newest();
        let ticks = newest.map(|n| self.watch.ticks(n, live.period_s)).unwrap_or_default();
        json!({"frame": {
            "live": {"run_id": live.run_id.to_string(), "about": if anew { live.about.clone() } else { Value::Null },
                "anew": anew, "supervised": live.supervised((1.0 / live.period_s) as u64)},
            "time_s": times(&ticks, live.period_s), "tick": newest,
            "rows": live.rows(&self.watch.traces, &ticks), "latest": live.latest(&self.watch.latest),
            "clients": self.hub.clients.load(Ordering::Relaxed), "note": note,
        }})
    }

    async fn answer(&mut self, want: Want) -> Value {
        if want.writes() && !self.may_write {
            return error("the token is needed for this: open the address that the console printed");
        }
        match want {
            Want::Token { token } => {
                self.may_write = self.hub.token.is(&token);
                json!({ "may_write": self.may_write })
            }
            Want::Subscribe { traces, latest, points_hz, .. } => self.subscribe(&traces, &latest, points_hz),
            Want::Live {} => {
                self.replay = None;
                (self.watch.sent, self.watch.run_id) = (None, 0);
                json!({ "live": true })
            }
            Want::Replay { run } => {
                let hub = Arc::clone(&self.hub);
                let name = run.clone();
                let opened = tokio::task::spawn_blocking(move || hub.open_log(&name)).await;
                match opened {
                    Ok(Ok((log, period_s))) => {
                        let resolved = config::ResolvedBench::from_json(&log.header.configuration).ok();
                        let about = resolved.map(|resolved| {
                            json!({"scenario": resolved.scenario.name, "description": resolved.scenario.description,
                                "geometry": resolved.front_axle.geometry, "wheelbase_m": resolved.car.body.wheelbase_m})
                        });
                        let replay = Replay::new(run, log, period_s);
                        let told = json!({"replay": replay.about(), "about": about});
                        (self.replay, self.watch.sent) = (Some(replay), None);
                        told
                    }
                    Ok(Err(reason)) => error(reason),
                    Err(_) => error("the log could not be read"),
                }
            }
            Want::Seek { to_s } => match &mut self.replay {
                Some(replay) if to_s.is_finite() => {
                    replay.seek(to_s);
                    self.watch.sent = None;
                    json!({ "replay": replay.about() })
                }
                _ => error("no log is being played"),
            },
            Want::Play { speed, paused } => match &mut self.replay {
                Some(replay) if speed.is_finite() => {
                    replay.play(speed, paused);
                    json!({ "replay": replay.about() })
                }
                _ => error("no log is being played"),
            },
            Want::Runs {} => json!({ "runs": runs::list(&self.hub) }),
            Want::Compare { a, b, signal } => {
                let hub = Arc::clone(&self.hub);
                match tokio::task::spawn_blocking(move || runs::compare(&hub, &a, &b, &signal)).await {
                    Ok(Ok(compared)) => json!({ "compare": compared }),
                    Ok(Err(reason)) => error(reason),
                    Err(_) => error("the logs could not be compared"),
                }
            }
            Want::Signals {} => json!({ "signals": signals::catalogue() }),
            Want::Parameters {} => self.ask(Request::List).await,
            Want::Set { settings } => {
                let settings =
                    settings.into_iter().map(|(path, value)| (path, Setting::from(value))).collect();
                self.ask(Request::Set { settings, source: "console".to_owned() }).await
            }
            Want::Undo {} => self.ask(Request::Undo { source: "console".to_owned() }).await,
            Want::Steer { mode, angle_rad, torque_n_m } => {
                self.ask(Request::Steer { mode, angle_rad, torque_n_m }).await
            }
            Want::Operate { operation } => self.ask(Request::Operate(operation.into())).await,
            Want::Launch { scenario, duration_s } => match self.hub.launch(&scenario, duration_s) {
                Ok(run) => json!({ "launched": run }),
                Err(reason) => error(reason),
            },
            Want::Snapshot { name } => self.snapshot(&name).await,
            Want::Snapshots {} => json!({ "snapshots": self.snapshots() }),
            Want::SnapshotRead { name } => match self
                .snapshot_path(&name)
                .and_then(|path| std::fs::read_to_string(path).map_err(|e| format!("snapshot {name}: {e}")))
            {
                Ok(text) => match params::read_snapshot(&text) {
                    Ok(settings) => json!({"snapshot": name, "settings": settings.into_iter()
                        .map(|(path, setting)| json!([path, setting_json(setting)])).collect::<Vec<_>>()}),
                    Err(reason) => error(reason.to_string()),
                },
                Err(reason) => error(reason),
            },
        }
    }

    fn subscribe(&mut self, traces: &[String], latest: &[String], points_hz: f64) -> Value {
        if traces.len() > TRACES_MAX || latest.len() > LATEST_MAX {
            return error(format!("at most {TRACES_MAX} traces and {LATEST_MAX} values"));
        }
        let mut unknown = Vec::new();
        let mut found = |names: &[String]| -> Vec<Signal> {
            names
                .iter()
                .filter_map(|name| {
                    let signal = signals::find(name);
                    if signal.is_none() {
                        unknown.push(name.clone());
                    }
                    signal
                })
                .collect()
        };
        let (traces, latest) = (found(traces), found(latest));
        if !unknown.is_empty() {
            return error(format!("there is no signal {}", unknown.join(", ")));
        }
        let points_hz = if points_hz.is_finite() { points_hz.clamp(1.0, 1000.0) } else { 100.0 };
        let run_id = self.watch.run_id;
        self.watch = Watch { traces, latest, points_hz, sent: None, run_id };
        json!({ "subscribed": self.watch.traces.len() })
    }

    /// Asks the supervisor.
    async fn ask(&self, request: Request) -> Value {
        match self.hub.operator.ask(request).await {
            Ok(answer) => told(answer),
            Err(reason) => error(reason),
        }
    }

    fn snapshot_path(&self, name: &str) -> Result<std::path::PathBuf, String> {
        let plain = (1..=60).contains(&name.len())
            && name.chars().all(|c| c.is_ascii_alphanumeric() || "_-".contains(c));
        if !plain {
            return Err("a snapshot's name is letters, digits, _ and -, at most 60".to_owned());
        }
        Ok(self.hub.runs.join("snapshots").join(format!("{name}.toml")))
    }

    fn snapshots(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.hub.runs.join("snapshots")).into_iter().flatten().flatten();
        let mut names: Vec<_> = entries
            .filter_map(|entry| entry.file_name().to_string_lossy().strip_suffix(".toml").map(str::to_owned))
            .collect();
        names.sort();
        names
    }

    async fn snapshot(&self, name: &str) -> Value {
        let path = match self.snapshot_path(name) {
            Ok(path) => path,
            Err(reason) => return error(reason),
        };
        match self.hub.operator.ask(Request::List).await {
            Ok(Answer::Parameters { version, entries, .. }) => {
                let mut values = [0.0; 62];
                values.iter_mut().zip(&entries).for_each(|(value, entry)| *value = entry.value);
                let title = format!("bench {}, version {version}", self.hub.bench.name());
                let text = params::write_snapshot(&values, &title);
                let written = std::fs::create_dir_all(self.hub.runs.join("snapshots"))
                    .and_then(|()| std::fs::write(&path, text));
                match written {
                    Ok(()) => json!({ "saved": name }),
                    Err(e) => error(format!("snapshot {name}: {e}")),
                }
            }
            Ok(_) => error("the supervisor gave an answer to another question"),
            Err(reason) => error(reason),
        }
    }
}

impl Watch {
    /// Ticks to send up to the newest, in steps of the rate asked for, none of them twice.
    fn ticks(&mut self, newest: u64, period_s: f64) -> Vec<u64> {
        if self.traces.is_empty() {
            return Vec::new();
        }
        let step = ((1.0 / (period_s * self.points_hz)).round() as u64).max(1);
        // A replay that was turned back starts anew.
        let sent = self.sent.filter(|&sent| sent <= newest);
        let from = sent.map_or(newest.saturating_sub(ROWS_MAX * step), |sent| sent + 1);
        let from = from.max(newest.saturating_sub(ROWS_MAX * step)).next_multiple_of(step);
        let ticks: Vec<u64> = (from..=newest).step_by(step as usize).collect();
        self.sent = ticks.last().copied().or(sent);
        ticks
    }
}

fn times(ticks: &[u64], period_s: f64) -> Vec<f64> {
    ticks.iter().map(|&tick| tick as f64 * period_s).collect()
}

fn setting_json(setting: Setting) -> Value {
    match setting {
        Setting::Number(number) => json!(number),
        Setting::Switch(on) => json!(on),
        Setting::Text(text) => json!(text),
    }
}

/// An answer of the supervisor, for the page.
fn told(answer: Answer) -> Value {
    match answer {
        Answer::Parameters { version, undo_depth, entries } => {
            let rows: Vec<_> = LIST
                .iter()
                .zip(&entries)
                .map(|(parameter, entry)| {
                    let choices = match parameter.kind {
                        params::Kind::Choice(names) => json!(names),
                        params::Kind::Switch => json!(["off", "on"]),
                        params::Kind::Number => Value::Null,
                    };
                    json!({"path": entry.path, "unit": parameter.unit, "doc": parameter.doc, "value": entry.value,
                        "default": entry.default, "min": entry.min, "max": entry.max, "choices": choices,
                        "states": parameter.states.text(), "fixed": entry.fixed, "service": parameter.tuner.name()})
                })
                .collect();
            json!({"parameters": {"version": version, "undo_depth": undo_depth, "rows": rows}})
        }
        Answer::Changed { version, tick, changes } => {
            let rows: Vec<_> =
                changes.iter().map(|c| json!({"path": c.path, "from": c.from, "to": c.to})).collect();
            json!({"changed": {"version": version, "tick": tick, "changes": rows}})
        }
        Answer::Done { tick } => json!({ "done": { "tick": tick } }),
        Answer::Refused(reasons) => {
            let lines: Vec<_> = reasons.iter().map(ToString::to_string).collect();
            json!({ "refused": lines, "error": lines.join("; ") })
        }
    }
}
