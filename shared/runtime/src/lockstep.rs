//! Lockstep: tick by tick, as fast as it goes, with results that depend on nothing but the inputs.
//!
//! In one process [`Chain`] steps all nodes in order. As the process set each service runs [`follow`]: it
//! waits for the same-tick inputs of its node, steps, rings. The wall clock is read for one thing only, to
//! end a wait.

use crate::clock::{self, SECOND};
use crate::{Bound, Model, TickError};
use table::Wait;

/// Models in one process, stepped node by node.
pub struct Chain {
    models: Vec<Bound<dyn Model>>,
    order: Vec<(usize, usize)>,
}

impl Chain {
    /// Puts models together; `order` lists (model, node) in the order in which they run within a tick.
    pub fn new(models: Vec<Bound<dyn Model>>, order: Vec<(usize, usize)>) -> Self {
        for &(model, node) in &order {
            assert!(node < models[model].node_count(), "no node {node} in model {model}");
        }
        Chain { models, order }
    }

    /// Steps every node for tick `n`.
    ///
    /// # Errors
    /// [`TickError::NotReady`] if the order is not that of the data.
    pub fn tick(&mut self, n: u64) -> Result<(), TickError> {
        for &(model, node) in &self.order {
            self.models[model].tick(node, n, false)?;
        }
        Ok(())
    }

    /// The models, in the order given, for who takes the chain apart.
    pub fn into_models(self) -> Vec<Bound<dyn Model>> {
        self.models
    }
}

/// How a lockstep service waits.
#[derive(Debug, Clone, Copy)]
pub struct Patience {
    /// Spin this long for an input before sleeping on the bell; 0 when services share a core. [ns]
    pub spin_ns: u64,
    /// Give up after this long. [ns]
    pub limit_ns: u64,
}

/// Steps a service's nodes for each tick from `first` on, until `end(n)` says that tick n is not part of the run.
///
/// # Errors
/// [`TickError::TimedOut`] naming the region that did not come.
pub fn follow(
    bound: &mut Bound<dyn Model>,
    first: u64,
    patience: Patience,
    mut end: impl FnMut(u64) -> bool,
) -> Result<u64, TickError> {
    let mut n = first;
    while !end(n) {
        for node in 0..bound.node_count() {
            let start = clock::now();
            while let Some((region, awaited)) = bound.missing(node, n) {
                let spec = *bound.spec(node);
                let Some(reader) = bound.reader(node, region) else {
                    return Err(TickError::NotReady { node: spec.name, region, tick: n });
                };
                let now = clock::now();
                let limit = start + patience.limit_ns;
                // Slices, so that a run that was ended meanwhile is noticed.
                let wait = Wait {
                    spin_from_ns: now,
                    spin_until_ns: now + patience.spin_ns,
                    deadline_ns: (now + SECOND / 10).min(limit),
                };
                if reader.wait_for(awaited, &wait) {
                    continue;
                }
                if end(n) {
                    return Ok(n);
                }
                if clock::now() >= limit {
                    let waited_s = (clock::now() - start) as f64 * 1e-9;
                    return Err(TickError::TimedOut { node: spec.name, region, tick: n, waited_s });
                }
            }
            bound.tick(node, n, false)?;
            bound.ring(node);
        }
        n += 1;
    }
    Ok(n)
}
