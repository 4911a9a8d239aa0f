//! The end that asks.

use crate::domain::{self, Service};
use crate::{Answer, LinkError, REQUEST_MAX, Request};
use iceoryx2::port::client;
use iceoryx2::prelude::*;
use std::time::{Duration, Instant};
use table::Bench;

/// Time between two looks for the answer.
const LOOK: Duration = Duration::from_micros(500);

/// The end that asks. Belongs to one thread.
pub struct Client {
    // Dropped in this order.
    port: client::Client<ipc::Service, [u8], (), [u8], ()>,
    _service: Service,
    _node: Node<ipc::Service>,
    bench: String,
}

impl Client {
    /// Opens the link to a running bench.
    ///
    /// # Errors
    /// [`LinkError::NobodyThere`], [`LinkError::Transport`].
    pub fn new(bench: &Bench) -> Result<Self, LinkError> {
        let nobody = || LinkError::NobodyThere { bench: bench.name().as_str().to_owned() };
        // Looking first keeps a request to a bench that is not there from leaving anything behind.
        if !bench.directory().join("link").is_dir() {
            return Err(nobody());
        }
        let node = domain::node(bench, "operator")?;
        let service = domain::service(&node, false).map_err(|_| nobody())?;
        let port = service
            .client_builder()
            .initial_max_slice_len(REQUEST_MAX)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| LinkError::Transport(format!("{e:?}")))?;
        Ok(Client { port, _service: service, _node: node, bench: bench.name().as_str().to_owned() })
    }

    /// Asks and waits for the answer, at most `patience`.
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn ask(&self, request: &Request, patience: Duration) -> Result<Answer, LinkError> {
        let transport = |e: &dyn std::fmt::Debug| LinkError::Transport(format!("{e:?}"));
        let bytes = postcard::to_allocvec(request).map_err(|e| LinkError::Garbled(e.to_string()))?;
        if bytes.len() > REQUEST_MAX {
            return Err(LinkError::Garbled(format!(
                "a request of {} bytes, at most {REQUEST_MAX}",
                bytes.len()
            )));
        }
        let loan = self.port.loan_slice_uninit(bytes.len()).map_err(|e| transport(&e))?;
        let pending = loan.write_from_slice(&bytes).send().map_err(|e| transport(&e))?;
        if pending.number_of_server_connections() == 0 {
            // Nobody has it: the supervisor of this link has gone.
            return Err(LinkError::NobodyThere { bench: self.bench.clone() });
        }
        let begin = Instant::now();
        loop {
            if let Some(answer) = pending.receive().map_err(|e| transport(&e))? {
                return postcard::from_bytes(answer.payload()).map_err(|e| LinkError::Garbled(e.to_string()));
            }
            let waited = begin.elapsed();
            if waited >= patience {
                return Err(LinkError::TimedOut { waited_ms: waited.as_millis() as u64 });
            }
            std::thread::sleep(LOOK);
        }
    }
}
