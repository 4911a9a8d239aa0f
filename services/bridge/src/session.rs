//! One client: its subscriptions, and what it says.
//!
//! The client's task reads the table when it sends: nothing is queued for a client that is slow, and one that takes
//! nothing for [`SEND_MAX`] is let go. Ticks that left the table's history meanwhile are skipped and counted.

use crate::protocol::{
    Level, Parameter, Said, Subscription, advertise, begin_data, parameter_values, region_of, server_info,
    status,
};
use crate::server::Hub;
use crate::source::Live;
use axum::extract::ws::{Message, WebSocket};
use futures_util::SinkExt;
use operator_link::{Answer, Entry, Request};
use params::Setting;
use regions::RegionId;
use serde_json::Value;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};

/// Bursts a second.
pub const BEAT_HZ: f64 = 60.0;
/// Longest message taken. \[B\]
pub const MESSAGE_MAX: usize = 64 * 1024;
/// Bytes that wait for a client.
pub(crate) const WRITE_BUFFER_MAX: usize = 16 << 20;
/// A client that takes nothing for this long is let go.
const SEND_MAX: Duration = Duration::from_secs(10);
/// Time between two looks at the parameters a client follows.
const FOLLOW: Duration = Duration::from_millis(500);
/// Messages a second that are listened to; more wait.
const MESSAGES_HZ: f64 = 500.0;
/// Most ticks of a burst; a client further behind skips to the present.
const TICKS_MAX: u64 = 1000;
/// Subscriptions of a client.
const SUBSCRIPTIONS_MAX: usize = 256;

/// A channel that the client wants.
struct Wanted {
    id: u32,
    region: RegionId,
    /// Next tick to send; none before the first burst of a run.
    next: Option<u64>,
}

struct Session {
    hub: Arc<Hub>,
    may_write: bool,
    wanted: Vec<Wanted>,
    run_id: Option<u64>,
    /// Parameters that the client wants to hear of; empty names stand for all.
    followed: Option<BTreeSet<String>>,
    followed_version: u64,
    skipped: u64,
    words: Vec<u64>,
}

/// Counts the client while it is there.
struct Counted(Arc<Hub>);

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Serves a client until it goes.
pub(crate) async fn serve(hub: Arc<Hub>, mut socket: WebSocket, may_write: bool) {
    hub.clients.fetch_add(1, Ordering::Relaxed);
    let _counted = Counted(Arc::clone(&hub));
    let hello = [server_info(hub.bench.name().as_str()), advertise()];
    let mut session = Session {
        hub,
        may_write,
        wanted: Vec::new(),
        run_id: None,
        followed: None,
        followed_version: 0,
        skipped: 0,
        words: Vec::new(),
    };
    if send(&mut socket, hello.into_iter().map(text).collect()).await.is_err() {
        return;
    }
    let mut beat = interval(Duration::from_secs_f64(1.0 / BEAT_HZ));
    beat.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut follow = interval(FOLLOW);
    follow.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut allowance = 0.0_f64;
    let mut listened = Instant::now();
    loop {
        let answer = tokio::select! {
            biased;
            _ = beat.tick() => session.burst(),
            _ = follow.tick(), if session.followed.is_some() => session.news().await,
            said = socket.recv() => {
                // Too long, not text, cut off: the connection is beyond repair.
                let Some(Ok(said)) = said else { return };
                let now = Instant::now();
                allowance = (allowance + (now - listened).as_secs_f64() * MESSAGES_HZ).min(MESSAGES_HZ);
                listened = now;
                if allowance < 1.0 {
                    tokio::time::sleep(Duration::from_secs_f64(1.0 / MESSAGES_HZ)).await;
                } else {
                    allowance -= 1.0;
                }
                match said {
                    Message::Text(said) => match serde_json::from_str(said.as_str()) {
                        Ok(said) => session.answer(said).await.into_iter().map(text).collect(),
                        Err(error) => vec![text(status(Level::Error, format!("not understood: {error}")))],
                    },
                    Message::Binary(_) => {
                        vec![text(status(Level::Error, "this bridge takes no messages from clients"))]
                    }
                    Message::Close(_) => return,
                    Message::Ping(_) | Message::Pong(_) => continue,
                }
            }
        };
        if send(&mut socket, answer).await.is_err() {
            return;
        }
    }
}

fn text(value: Value) -> Message {
    Message::Text(value.to_string().into())
}

/// Sends messages in one go.
async fn send(socket: &mut WebSocket, messages: Vec<Message>) -> Result<(), ()> {
    if messages.is_empty() {
        return Ok(());
    }
    let all = async {
        for message in messages {
            socket.feed(message).await?;
        }
        socket.flush().await
    };
    match timeout(SEND_MAX, all).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(()),
    }
}

impl Session {
    /// Every tick since the last burst, of every channel the client wants, in the order of time.
    fn burst(&mut self) -> Vec<Message> {
        let mut messages = Vec::new();
        let Some(live) = self.hub.live() else { return messages };
        if self.run_id != Some(live.header.run_id) {
            self.run_id = Some(live.header.run_id);
            self.wanted.iter_mut().for_each(|wanted| wanted.next = None);
            self.followed_version = 0;
            messages.push(text(status(Level::Info, format!("run of {}", live.header.scenario))));
        }
        let skipped = self.ticks(&live, &mut messages);
        if skipped > 0 {
            self.skipped += skipped;
            let said = format!("{} ticks skipped so far: this client is too slow", self.skipped);
            messages.push(text(status(Level::Warning, said)));
        }
        messages
    }

    fn ticks(&mut self, live: &Live, messages: &mut Vec<Message>) -> u64 {
        let mut skipped = 0;
        let mut until = 0;
        for wanted in &mut self.wanted {
            let head = live.head(wanted.region);
            let next = wanted.next.get_or_insert(head.saturating_sub(1));
            if head.saturating_sub(*next) > TICKS_MAX {
                skipped += head - TICKS_MAX - *next;
                *next = head - TICKS_MAX;
            }
            until = until.max(head);
        }
        let first = self.wanted.iter().filter_map(|wanted| wanted.next).min().unwrap_or(until);
        for tick in first..until {
            let time = live.header.log_time_ns(tick);
            for wanted in &mut self.wanted {
                // Regions are not published all at once: each goes on from where it was.
                if wanted.next == Some(tick) && tick < live.head(wanted.region) {
                    let mut message = begin_data(wanted.id, time);
                    if live.message(wanted.region, tick, &mut self.words, &mut message) {
                        messages.push(Message::Binary(message.into()));
                    }
                    wanted.next = Some(tick + 1);
                }
            }
        }
        skipped
    }

    async fn answer(&mut self, said: Said) -> Vec<Value> {
        match said {
            Said::Subscribe { subscriptions } => {
                subscriptions.into_iter().filter_map(|asked| self.subscribe(asked).err()).collect()
            }
            Said::Unsubscribe { subscription_ids } => {
                self.wanted.retain(|wanted| !subscription_ids.contains(&wanted.id));
                Vec::new()
            }
            Said::GetParameters { parameter_names, id } => match self.list().await {
                Ok((_, entries)) => vec![values_of(&entries, &parameter_names, id)],
                Err(error) => vec![status(Level::Error, error), parameter_values([].into_iter(), id)],
            },
            Said::SetParameters { parameters, id } => self.set(parameters, id).await,
            Said::SubscribeParameterUpdates { parameter_names } => {
                self.followed.get_or_insert_default().extend(parameter_names);
                self.followed_version = 0;
                Vec::new()
            }
            Said::UnsubscribeParameterUpdates { parameter_names } => {
                if let Some(followed) = &mut self.followed {
                    followed.retain(|name| !parameter_names.contains(name));
                }
                self.followed = self.followed.take().filter(|left| !left.is_empty());
                Vec::new()
            }
        }
    }

    fn subscribe(&mut self, asked: Subscription) -> Result<(), Value> {
        let refuse = |text: String| Err(status(Level::Error, text));
        let Some(region) = region_of(asked.channel_id) else {
            return refuse(format!("there is no channel {}", asked.channel_id));
        };
        if self.wanted.iter().any(|wanted| wanted.id == asked.id) {
            return refuse(format!("subscription {} is there already", asked.id));
        }
        if self.wanted.len() >= SUBSCRIPTIONS_MAX {
            return refuse("too many subscriptions".to_owned());
        }
        self.wanted.push(Wanted { id: asked.id, region, next: None });
        Ok(())
    }

    async fn list(&self) -> Result<(u64, Vec<Entry>), String> {
        match self.hub.operator.ask(Request::List).await? {
            Answer::Parameters { version, entries, .. } => Ok((version, entries)),
            other => Err(format!("the bench answered {other:?}")),
        }
    }

    async fn set(&self, parameters: Vec<Parameter>, id: Option<String>) -> Vec<Value> {
        let names: Vec<String> = parameters.iter().map(|parameter| parameter.name.clone()).collect();
        let mut said = match self.change(parameters).await {
            Ok(()) => Vec::new(),
            Err(reasons) => reasons.into_iter().map(|reason| status(Level::Error, reason)).collect(),
        };
        // The client shows what is in force, whatever it had hoped for.
        match self.list().await {
            Ok((_, entries)) => said.push(values_of(&entries, &names, id)),
            Err(error) => said.push(status(Level::Error, error)),
        }
        said
    }

    async fn change(&self, parameters: Vec<Parameter>) -> Result<(), Vec<String>> {
        if !self.may_write {
            return Err(vec![
                "setting parameters needs the token: connect to the address that ends in ?token=…".into(),
            ]);
        }
        let mut settings = Vec::new();
        let mut reasons = Vec::new();
        for Parameter { name, value } in parameters {
            let setting = match &value {
                Value::Bool(on) => Some(Setting::Switch(*on)),
                Value::Number(number) => number.as_f64().map(Setting::Number),
                Value::String(text) => Some(Setting::Text(text.clone())),
                _ => None,
            };
            match setting {
                Some(setting) => settings.push((name, setting)),
                None => reasons.push(format!("{name}: {value} is no number, switch or name")),
            }
        }
        if !reasons.is_empty() {
            return Err(reasons);
        }
        match self.hub.operator.ask(Request::Set { settings, source: "bridge".to_owned() }).await {
            Ok(Answer::Refused(refusals)) => Err(refusals.iter().map(ToString::to_string).collect()),
            Ok(_) => Ok(()),
            Err(error) => Err(vec![error]),
        }
    }

    /// The parameters that the client follows, if any has changed.
    async fn news(&mut self) -> Vec<Message> {
        let Some(followed) = &self.followed else { return Vec::new() };
        let names: Vec<String> = followed.iter().cloned().collect();
        match self.list().await {
            Ok((version, entries)) if version != self.followed_version => {
                self.followed_version = version;
                vec![text(values_of(&entries, &names, None))]
            }
            _ => Vec::new(),
        }
    }
}

/// The values of these names; of all if there are none.
fn values_of(entries: &[Entry], names: &[String], id: Option<String>) -> Value {
    let asked = entries.iter().filter(|entry| names.is_empty() || names.contains(&entry.path));
    parameter_values(asked.map(|entry| (entry.path.as_str(), entry.value)), id)
}
