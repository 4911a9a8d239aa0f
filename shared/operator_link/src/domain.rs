//! A bench's own iceoryx2 domain: prefix and root directory, so that benches and users do not meet.

use crate::LinkError;
use iceoryx2::config::Config;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::request_response::PortFactory;
use table::{Bench, BenchLock};

pub(crate) type Service = PortFactory<ipc::Service, [u8], (), [u8], ()>;

/// Most clients at a time: consoles, monitors, command lines.
const CLIENTS_MAX: usize = 16;

fn prefix(bench: &Bench) -> String {
    format!("kingpin_link_{}_", bench.name().as_str())
}

fn config(bench: &Bench) -> Result<Config, LinkError> {
    let mut config = Config::default();
    let text = |e: &dyn std::fmt::Debug| LinkError::Transport(format!("{e:?}"));
    config.global.prefix = FileName::new(prefix(bench).as_bytes()).map_err(|e| text(&e))?;
    let root = bench.directory().join("link");
    let root = Path::new(root.to_string_lossy().as_bytes()).map_err(|e| text(&e))?;
    config.global.set_root_path(&root);
    Ok(config)
}

/// A node in the bench's domain. Coming and going it cleans up after nodes that were killed.
pub(crate) fn node(bench: &Bench, name: &str) -> Result<Node<ipc::Service>, LinkError> {
    iceoryx2::prelude::set_log_level(LogLevel::Fatal);
    let transport = |e: &dyn std::fmt::Debug| LinkError::Transport(format!("{e:?}"));
    let config = config(bench)?;
    NodeBuilder::new()
        .name(&NodeName::new(name).map_err(|e| transport(&e))?)
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(|e| transport(&e))
}

/// The bench's one service: made by the supervisor, opened by whoever asks.
pub(crate) fn service(node: &Node<ipc::Service>, make: bool) -> Result<Service, LinkError> {
    let transport = |e: &dyn std::fmt::Debug| LinkError::Transport(format!("{e:?}"));
    let name: ServiceName = "operator".try_into().map_err(|e| transport(&e))?;
    let builder = node.service_builder(&name).request_response::<[u8], [u8]>();
    if make {
        builder
            .max_clients(CLIENTS_MAX)
            .max_servers(2)
            .max_nodes(CLIENTS_MAX + 4)
            .open_or_create()
            .map_err(|e| transport(&e))
    } else {
        builder.open().map_err(|e| transport(&e))
    }
}

/// Removes all that the link has left in shared memory and on disk. The lock says that nobody serves it.
pub fn remove_left_over(lock: &BenchLock) {
    let bench = lock.bench();
    let prefix = prefix(bench);
    for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(&prefix) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
    let _ = std::fs::remove_dir_all(bench.directory().join("link"));
}
