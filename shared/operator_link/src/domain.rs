//! A bench's own iceoryx2 domain: prefix and root directory, so that benches and users do not meet.

use crate::LinkError;
use iceoryx2::config::Config;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::request_response::PortFactory;
use table::{Bench, BenchLock};

pub(crate) type Service = PortFactory<ipc::Service, [u8], (), [u8], ()>;

/// Most clients at a time: consoles, monitors, command lines.
const CLIENTS_MAX: usize = 16;

/// With a character that no bench's name has behind it, so that one is never the beginning of another's.
fn prefix(bench: &Bench) -> String {
    format!("kingpin_link.{}.", bench.name().as_str())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Server;

    #[test]
    fn cleaning_after_a_bench_leaves_one_whose_name_begins_the_same_alone() {
        let base = tempfile::tempdir().unwrap();
        let name = format!("link-{}", std::process::id());
        let neighbours = [format!("{name}_b"), format!("{name}-b"), format!("{name}b")];
        let bench = |name: &str| Bench::with_base(name, base.path()).unwrap();
        let files = |name: &str| {
            let all = std::fs::read_dir("/dev/shm").unwrap().flatten();
            all.filter(|f| f.file_name().to_string_lossy().contains(&format!("{name}."))).count()
        };
        let locks: Vec<_> = neighbours.iter().map(|name| bench(name).lock().unwrap()).collect();
        let servers: Vec<_> = neighbours.iter().map(|name| Server::new(&bench(name)).unwrap()).collect();
        let before: Vec<_> = neighbours.iter().map(|name| files(name)).collect();
        assert!(before.iter().all(|&count| count > 0), "{before:?}");
        remove_left_over(&bench(&name).lock().unwrap());
        let after: Vec<_> = neighbours.iter().map(|name| files(name)).collect();
        assert_eq!(after, before);
        drop(servers);
        locks.iter().for_each(remove_left_over);
        assert!(neighbours.iter().all(|name| files(name) == 0));
    }
}
