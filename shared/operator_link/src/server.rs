//! The supervisor's end.

use crate::domain::{self, Service};
use crate::{Answer, LinkError, REQUEST_MAX, Request};
use iceoryx2::port::server;
use iceoryx2::prelude::*;
use table::Bench;

/// Most requests answered in one go, so that a flood of them does not keep the supervisor from its look.
const BATCH: usize = 32;

/// The end that answers.
pub struct Server {
    // Dropped in this order.
    port: server::Server<ipc::Service, [u8], (), [u8], ()>,
    _service: Service,
    _node: Node<ipc::Service>,
}

impl Server {
    /// Opens the link of a bench; the caller holds the bench's lock.
    ///
    /// # Errors
    /// [`LinkError::Transport`].
    pub fn new(bench: &Bench) -> Result<Self, LinkError> {
        let node = domain::node(bench, "supervisor")?;
        let service = domain::service(&node, true)?;
        let port = service
            .server_builder()
            .initial_max_slice_len(REQUEST_MAX)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| LinkError::Transport(format!("{e:?}")))?;
        Ok(Server { port, _service: service, _node: node })
    }

    /// Answers what has come, never waiting. Returns how many requests that were.
    ///
    /// # Errors
    /// [`LinkError::Transport`]; what was asked until then is answered.
    pub fn serve(&self, mut answer: impl FnMut(Request) -> Answer) -> Result<usize, LinkError> {
        let transport = |e: &dyn std::fmt::Debug| LinkError::Transport(format!("{e:?}"));
        for done in 0..BATCH {
            let Some(request) = self.port.receive().map_err(|e| transport(&e))? else { return Ok(done) };
            let said = match postcard::from_bytes::<Request>(request.payload()) {
                Ok(asked) => answer(asked),
                Err(error) => Answer::refused("request", format!("not understood: {error}")),
            };
            let bytes = postcard::to_allocvec(&said).map_err(|e| LinkError::Garbled(e.to_string()))?;
            // An asker that has gone meanwhile gets no answer and harms nobody.
            if let Ok(response) = request.loan_slice_uninit(bytes.len()) {
                let _ = response.write_from_slice(&bytes).send();
            }
        }
        Ok(BATCH)
    }
}
