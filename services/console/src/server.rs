//! The web server: files, reports, the WebSocket's door.

use crate::door::{Door, ServeError};
use crate::hub::Hub;
use crate::operator::Operator;
use crate::page::FILES;
use crate::session;
use crate::token::Token;
use axum::Router;
use axum::body::Body;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use table::Bench;

/// Clients at a time.
const CLIENTS_MAX: usize = 32;
/// A report may run its own scripts, in an origin of its own: it cannot act as the page.
const REPORT_POLICY: &str = "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; \
    style-src 'unsafe-inline'; img-src data: blob:";
const PAGE_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; \
    img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// How the console is to be.
#[derive(Debug, Clone)]
pub struct Options {
    /// The bench to show and to operate.
    pub bench: Bench,
    /// Where to listen; loopback unless somebody decided otherwise. Port 0: a free one.
    pub listen: SocketAddr,
    /// Further names under which the page may be asked for, `host` or `host:port`.
    pub hosts: Vec<String>,
    /// The token for whatever writes.
    pub token: Token,
    /// Where runs are, and where runs that are started here go.
    pub runs: PathBuf,
    /// A log to show first.
    pub log: Option<PathBuf>,
    /// The executable that runs scenarios.
    pub executable: PathBuf,
    /// Values replaced in the runs that are started here, as in `kingpin run --set`.
    pub set: Vec<String>,
}

#[derive(Clone)]
struct Shared {
    hub: Arc<Hub>,
    hosts: Arc<Vec<String>>,
}

/// A console that listens.
pub struct Console {
    door: Door,
    options: Options,
}

impl Console {
    /// Takes the address.
    ///
    /// # Errors
    /// [`ServeError`].
    pub fn new(options: Options) -> Result<Self, ServeError> {
        Ok(Console { door: Door::open(options.listen)?, options })
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
        let operator = Operator::start(o.bench.clone()).map_err(ServeError::System)?;
        let hub = Arc::new(Hub::new(o.bench, o.token, o.runs, o.log, o.executable, o.set, operator));
        let shared = Shared { hub: Arc::clone(&hub), hosts: Arc::new(self.door.hosts(o.hosts)) };
        let mut router = Router::new();
        for file in FILES {
            router = router.route(file.path, get(move || async move { asset(file.kind, file.content) }));
        }
        let plotly = || async { asset("text/javascript; charset=utf-8", report::plotly_js()) };
        let router = router
            .route("/plotly.js", get(plotly))
            .route("/report/{run}", get(run_report))
            .route("/compare/{a}/{b}", get(compared))
            .route("/socket", get(socket))
            .layer(middleware::from_fn_with_state(shared.clone(), guard))
            .with_state(shared);
        self.door.serve(router, || hub.look(), stop)
    }
}

fn asset(kind: &'static str, content: &'static str) -> Response {
    ([(header::CONTENT_TYPE, kind), (header::CONTENT_SECURITY_POLICY, PAGE_POLICY)], content).into_response()
}

/// Whether a host is one that this console is asked as.
fn ours(shared: &Shared, host: &str) -> bool {
    shared.hosts.iter().any(|known| known.eq_ignore_ascii_case(host))
}

/// Nobody gets in under another name than the console's own: a page elsewhere, whose name was made to point
/// here, is refused.
async fn guard(State(shared): State<Shared>, request: Request, next: Next) -> Response {
    let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok());
    if !host.is_some_and(|host| ours(&shared, host)) {
        return (StatusCode::FORBIDDEN, "this console is not asked as that host\n").into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

async fn run_report(State(shared): State<Shared>, Path(run): Path<String>) -> Response {
    let found = shared.hub.run_directory(&run).map(|directory| {
        let directory = if directory.is_dir() { directory } else { directory.with_file_name("") };
        directory.join("report.html")
    });
    let read = match found {
        Ok(path) => tokio::task::spawn_blocking(move || std::fs::read(path)).await,
        Err(error) => return (StatusCode::NOT_FOUND, error).into_response(),
    };
    match read {
        Ok(Ok(bytes)) => {
            let headers = [
                (header::CONTENT_TYPE, "text/html; charset=utf-8"),
                (header::CONTENT_SECURITY_POLICY, REPORT_POLICY),
            ];
            (headers, Body::from(bytes)).into_response()
        }
        _ => (StatusCode::NOT_FOUND, "this run has no report\n").into_response(),
    }
}

/// Two runs on one page, made when it is asked for.
async fn compared(State(shared): State<Shared>, Path((a, b)): Path<(String, String)>) -> Response {
    let made = tokio::task::spawn_blocking(move || crate::runs::comparison(&shared.hub, &a, &b)).await;
    match made {
        Ok(Ok(page)) => {
            let headers = [
                (header::CONTENT_TYPE, "text/html; charset=utf-8"),
                (header::CONTENT_SECURITY_POLICY, REPORT_POLICY),
            ];
            (headers, Body::from(page)).into_response()
        }
        Ok(Err(error)) => (StatusCode::NOT_FOUND, error).into_response(),
        Err(_) => (StatusCode::INTERNAL_SERVER_ERROR, "the comparison could not be made\n").into_response(),
    }
}

async fn socket(State(shared): State<Shared>, headers: HeaderMap, upgrade: WebSocketUpgrade) -> Response {
    // A browser always says where a page comes from; only this console's own may connect.
    let origin = headers.get(header::ORIGIN).and_then(|origin| origin.to_str().ok());
    let host = origin.and_then(|o| o.strip_prefix("http://").or_else(|| o.strip_prefix("https://")));
    if !host.is_some_and(|host| ours(&shared, host)) {
        return (StatusCode::FORBIDDEN, "a page from elsewhere may not connect\n").into_response();
    }
    if shared.hub.clients.load(Ordering::Relaxed) >= CLIENTS_MAX {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many clients\n").into_response();
    }
    upgrade
        .max_message_size(session::MESSAGE_MAX)
        .max_frame_size(session::MESSAGE_MAX)
        .write_buffer_size(0)
        .max_write_buffer_size(4 << 20)
        .on_upgrade(move |socket| session::serve(shared.hub, socket))
}
