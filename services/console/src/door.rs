//! Where a server of a bench listens, and how it serves until it is told to stop: the console's and the bridge's.

use axum::Router;
use axum::serve::ListenerExt;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::net::TcpListener;

/// Time between two looks for another run.
const LOOK: Duration = Duration::from_millis(250);

/// Why there is no server.
#[derive(Debug)]
pub enum ServeError {
    /// The address cannot be had.
    Listen(SocketAddr, std::io::Error),
    /// Threads or sockets.
    System(std::io::Error),
}

impl std::fmt::Display for ServeError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ServeError::Listen(address, error) => write!(f, "cannot listen on {address}: {error}"),
            ServeError::System(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for ServeError {}

/// An address that is listened on.
pub struct Door {
    runtime: tokio::runtime::Runtime,
    listener: TcpListener,
    address: SocketAddr,
}

impl Door {
    /// Takes the address.
    ///
    /// # Errors
    /// [`ServeError`].
    pub fn open(listen: SocketAddr) -> Result<Self, ServeError> {
        // One thread: what a client needs is little, and the cores belong to the bench.
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .max_blocking_threads(2)
            .build()
            .map_err(ServeError::System)?;
        let listener =
            runtime.block_on(TcpListener::bind(listen)).map_err(|e| ServeError::Listen(listen, e))?;
        let address = listener.local_addr().map_err(ServeError::System)?;
        Ok(Door { runtime, listener, address })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Names, `host:port`, under which it may be asked for: its own and the `further` ones.
    pub fn hosts(&self, further: Vec<String>) -> Vec<String> {
        let mut hosts = further;
        hosts.push(self.address.to_string());
        if self.address.ip().is_loopback() {
            let port = self.address.port();
            hosts.extend(["localhost", "127.0.0.1", "[::1]"].map(|name| format!("{name}:{port}")));
        }
        hosts
    }

    /// Serves until `stop` is set; `look` is called four times a second.
    ///
    /// # Errors
    /// [`ServeError::System`].
    pub fn serve(self, router: Router, look: impl Fn(), stop: &AtomicBool) -> Result<(), ServeError> {
        // Whoever waits for a millisecond comes first.
        let _ = rustix::process::nice(10);
        self.runtime.block_on(async move {
            let looking = async {
                loop {
                    look();
                    tokio::time::sleep(LOOK).await;
                }
            };
            let stopped = async {
                while !stop.load(Ordering::Relaxed) {
                    tokio::time::sleep(Duration::from_millis(50)).await;
                }
            };
            // What is sent is whole when it is flushed: waiting for more to send would only delay it.
            let listener = self.listener.tap_io(|stream| {
                let _ = stream.set_nodelay(true);
            });
            tokio::select! {
                served = axum::serve(listener, router).into_future() => served.map_err(ServeError::System),
                () = looking => Ok(()),
                () = stopped => Ok(()),
            }
        })
    }
}
