//! The WebSocket's door, and the look for another run.

use crate::protocol::SUBPROTOCOLS;
use crate::session;
use crate::source::{self, Live};
use axum::Router;
use axum::extract::State;
use axum::extract::ws::WebSocketUpgrade;
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use console_service::{Door, Operator, ServeError, Token, keep_off};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use table::Bench;

/// Clients at a time.
const CLIENTS_MAX: usize = 16;
/// Where programs on a desktop, made of web pages, come from.
const DESKTOP_ORIGINS: [&str; 2] = ["file://", "app://"];

/// How the bridge is to be.
#[derive(Debug, Clone)]
pub struct Options {
    /// The bench to show.
    pub bench: Bench,
    /// Where to listen; loopback unless somebody decided otherwise. Port 0: a free one.
    pub listen: SocketAddr,
    /// Further names under which the bridge may be asked for, `host:port`.
    pub hosts: Vec<String>,
    /// Pages from elsewhere that may connect, as the browser names them (`https://app.example.org`).
    pub origins: Vec<String>,
    /// The token for whatever writes.
    pub token: Token,
}

/// What all clients share.
pub(crate) struct Hub {
    pub(crate) bench: Bench,
    token: Token,
    hosts: Vec<String>,
    origins: Vec<String>,
    pub(crate) operator: Operator,
    pub(crate) clients: AtomicUsize,
    live: Mutex<Option<Arc<Live>>>,
}

impl Hub {
    /// The run that is there now.
    pub(crate) fn live(&self) -> Option<Arc<Live>> {
        // Replaced whole: a panic of another task leaves nothing half made.
        self.live.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn look(&self) {
        let now = source::run_id(&self.bench);
        if now == self.live().map(|live| live.header.run_id) {
            return;
        }
        let opened = now.and_then(|_| Live::open(&self.bench));
        if let Some(live) = &opened {
            keep_off(&live.cores);
        }
        *self.live.lock().unwrap_or_else(PoisonError::into_inner) = opened.map(Arc::new);
    }

    fn asked_as(&self, host: &str) -> bool {
        self.hosts.iter().any(|known| known.eq_ignore_ascii_case(host))
    }

    /// Whether a page from there may connect: one of this machine, or one that was named.
    fn welcomes(&self, origin: &str) -> bool {
        let named = self.origins.iter().any(|known| known.trim_end_matches('/').eq_ignore_ascii_case(origin));
        named || DESKTOP_ORIGINS.iter().any(|known| origin.starts_with(known)) || of_this_machine(origin)
    }
}

/// Whether an origin is a page served by this machine.
fn of_this_machine(origin: &str) -> bool {
    let host = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://")).unwrap_or_default();
    ["localhost", "127.0.0.1", "[::1]"].iter().any(|name| {
        host.strip_prefix(name).is_some_and(|rest| match rest.strip_prefix(':') {
            Some(port) => port.parse::<u16>().is_ok(),
            None => rest.is_empty(),
        })
    })
}

/// A bridge that listens.
pub struct Bridge {
    door: Door,
    options: Options,
}

impl Bridge {
    /// Takes the address.
    ///
    /// # Errors
    /// [`ServeError`].
    pub fn new(options: Options) -> Result<Self, ServeError> {
        Ok(Bridge { door: Door::open(options.listen)?, options })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.door.address()
    }

    /// Serves until `stop` is set.
    ///
    /// # Errors
    /// [`ServeError::System`].
    pub fn serve(self, stop: &AtomicBool) -> Result<(), ServeError> {
        let o = self.options;
        let hub = Arc::new(Hub {
            operator: Operator::start(o.bench.clone()).map_err(ServeError::System)?,
            bench: o.bench,
            token: o.token,
            hosts: self.door.hosts(o.hosts),
            origins: o.origins,
            clients: AtomicUsize::new(0),
            live: Mutex::new(None),
        });
        let router = Router::new().route("/", get(socket)).with_state(Arc::clone(&hub));
        self.door.serve(router, || hub.look(), stop)
    }
}

/// The token of an address, `/?token=…`: letters and digits, so nothing is escaped.
fn token_of(uri: &Uri) -> Option<&str> {
    uri.query()?.split('&').find_map(|part| part.strip_prefix("token="))
}

async fn socket(
    State(hub): State<Arc<Hub>>,
    uri: Uri,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, axum::extract::ws::rejection::WebSocketUpgradeRejection>,
) -> Response {
    let named = |name| headers.get(name).map(|value| value.to_str().unwrap_or_default());
    if !named(header::HOST).is_some_and(|host| hub.asked_as(host)) {
        return (StatusCode::FORBIDDEN, "this bridge is not asked as that host\n").into_response();
    }
    // Programs say nothing; a browser always says where a page comes from.
    if named(header::ORIGIN).is_some_and(|origin| !hub.welcomes(origin)) {
        return (StatusCode::FORBIDDEN, "a page from elsewhere may not connect; see --allow-origin\n")
            .into_response();
    }
    let upgrade = match upgrade {
        Ok(upgrade) => upgrade.protocols(SUBPROTOCOLS),
        Err(_) => {
            let hint = "this is a bridge for Foxglove, Lichtblick or PlotJuggler: open this address there, as ws://\n";
            return (StatusCode::UPGRADE_REQUIRED, hint).into_response();
        }
    };
    if upgrade.selected_protocol().is_none() {
        return (StatusCode::BAD_REQUEST, "the client must offer the subprotocol foxglove.sdk.v1\n")
            .into_response();
    }
    let may_write = match token_of(&uri) {
        None => false,
        Some(shown) if hub.token.is(shown) => true,
        Some(_) => return (StatusCode::FORBIDDEN, "that is not the token\n").into_response(),
    };
    if hub.clients.load(Ordering::Relaxed) >= CLIENTS_MAX {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many clients\n").into_response();
    }
    upgrade
        .max_message_size(session::MESSAGE_MAX)
        .max_frame_size(session::MESSAGE_MAX)
        .max_write_buffer_size(session::WRITE_BUFFER_MAX)
        .on_upgrade(move |socket| session::serve(hub, socket, may_write))
}

#[cfg(test)]
mod tests {
    use super::of_this_machine;

    #[test]
    fn only_pages_of_this_machine_are_of_this_machine() {
        for own in ["http://localhost", "http://localhost:8080", "https://127.0.0.1:1", "http://[::1]:80"] {
            assert!(of_this_machine(own), "{own}");
        }
        for other in [
            "http://localhost.example.org",
            "http://localhost:80.example.org",
            "http://127.0.0.1.example.org",
            "http://example.org",
            "null",
            "",
        ] {
            assert!(!of_this_machine(other), "{other}");
        }
    }
}
