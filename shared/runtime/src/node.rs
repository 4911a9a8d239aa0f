//! Nodes: what a service steps, what it reads and the one region it writes.
//!
//! [`Bound::tick`] is the only way a model is stepped; lockstep and paced both call it. It reads the
//! declared inputs of tick n once, steps the model, publishes the one region of the node and, where there
//! is one, the checkpoint. It reads no clock: time is the tick.

use crate::TickError;
use crate::hooks::Hooks;
use regions::{Fault, NO_TICK, Payload, RegionId, fault_kind};
use table::{Read, RegionReader, RegionWriter, Table};

/// When an input is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum When {
    /// The tick being stepped. Not there: the last one read is held.
    SameTick,
    /// The newest there is. In lockstep the tick being stepped, so that runs are equal.
    Latest,
    /// Of a region whose writer itself reads what this node writes: the tick before the one being stepped, never
    /// waited for in real time (then the newest there is, not fresh). In lockstep exactly that one, so that runs are
    /// equal and nobody waits in a circle.
    Previous,
}

impl When {
    /// The tick that has to be there for tick `n`, if one has to.
    fn needed(self, n: u64, lockstep: bool) -> Option<u64> {
        match self {
            When::SameTick => Some(n),
            When::Latest => lockstep.then_some(n),
            When::Previous if lockstep => n.checked_sub(1),
            When::Previous => None,
        }
    }
}

/// A declared input of a node.
#[derive(Debug, Clone, Copy)]
pub struct InputSpec {
    /// Region read.
    pub region: RegionId,
    /// Which tick of it.
    pub when: When,
}

/// A declared node.
#[derive(Debug, Clone, Copy)]
pub struct NodeSpec {
    /// Name, for messages.
    pub name: &'static str,
    /// All it reads, in the order of [`Inputs`].
    pub reads: &'static [InputSpec],
    /// The one region it writes.
    pub writes: RegionId,
    /// Where its complete state goes after each tick.
    pub checkpoint: Option<RegionId>,
    /// Whether another service waits for what it writes.
    pub rings: bool,
}

/// The step being made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// Tick.
    pub n: u64,
    /// Stepped after its time, to catch up.
    pub caught_up: bool,
    /// Ticks left out since the last step.
    pub skipped: u64,
}

/// One input of the step: its words and where they come from.
#[derive(Debug)]
pub struct Input {
    reader: RegionReader,
    words: Box<[u64]>,
    tick: u64,
    fresh: bool,
}

impl Input {
    /// Whether these are the words of the tick being stepped (or, but for [`When::SameTick`], any at all).
    pub fn fresh(&self) -> bool {
        self.fresh
    }

    /// Tick of the words, [`NO_TICK`] when nothing was ever read.
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// Ticks that the words are older than step `n`; `u64::MAX` when nothing was ever read.
    pub fn age(&self, n: u64) -> u64 {
        if self.tick == NO_TICK { u64::MAX } else { n.saturating_sub(self.tick) }
    }

    /// What a process that was there all along would have in its hands behind tick `n`: the newest recorded words
    /// up to it, as far back as [`PRIMED_TICKS_MAX`].
    fn prime(&mut self, n: u64) {
        let newest = self.reader.head().saturating_sub(1).min(n);
        for tick in (newest.saturating_sub(PRIMED_TICKS_MAX)..=newest).rev() {
            if self.reader.read(tick, &mut self.words) == Read::Ready {
                self.tick = tick;
                return;
            }
        }
    }

    fn refresh(&mut self, n: u64, when: When, lockstep: bool) {
        self.fresh = false;
        let exact = match when {
            When::SameTick => Some(n),
            When::Latest => lockstep.then_some(n),
            When::Previous => n.checked_sub(1),
        };
        if let Some(exact) = exact
            && self.reader.read(exact, &mut self.words) == Read::Ready
        {
            (self.tick, self.fresh) = (exact, true);
        } else if !lockstep
            && when != When::SameTick
            && let Some(latest) = self.reader.latest(n, &mut self.words)
        {
            (self.tick, self.fresh) = (latest.tick, when == When::Latest);
        }
    }
}

/// How far back a restarted node looks for its last inputs. [ticks]
const PRIMED_TICKS_MAX: u64 = 64;

/// The inputs of a step, in the order declared.
#[derive(Debug)]
pub struct Inputs(Box<[Input]>);

impl Inputs {
    /// Input `index` and its provenance; all zero before anything was read.
    pub fn get<P: Payload>(&self, index: usize) -> (&P, &Input) {
        let input = &self.0[index];
        let payload: &[P] = bytemuck::cast_slice(&input.words);
        (&payload[0], input)
    }

    /// Input `index` as words, for who looks fields up by their place.
    pub fn words(&self, index: usize) -> (&[u64], &Input) {
        let input = &self.0[index];
        (&input.words, input)
    }
}

/// A model that is stepped node by node. A service is one model; the rig's has two nodes.
pub trait Model: Send {
    /// Its nodes, in the order in which they run within a tick.
    fn nodes(&self) -> &'static [NodeSpec];

    /// Steps node `node` and fills its region. No allocation, lock, clock or log.
    fn step(&mut self, node: usize, step: &Step, inputs: &Inputs, output: &mut [u64]);

    /// Writes the complete state behind step `n` into a checkpoint's words.
    fn save(&self, n: u64, words: &mut [u64]) {
        let _ = (n, words);
    }

    /// A fault that a campaign asks of the model itself (a sensor, a message on the bus). Most have none.
    fn fault(&mut self, order: &Fault) {
        let _ = order;
    }

    /// The tick just stepped was published by a dead predecessor already: what it had to say is to be said with the next.
    fn unpublished(&mut self) {}

    /// Takes a checkpoint's state over; `false` when it is not one of this model.
    fn restore(&mut self, words: &[u64]) -> bool {
        let _ = words;
        false
    }
}

struct BoundNode {
    spec: NodeSpec,
    inputs: Inputs,
    output: Box<[u64]>,
    writer: RegionWriter,
    checkpoint: Option<(RegionWriter, Box<[u64]>)>,
    refused: u64,
}

/// A model bound to a table: its inputs opened, its regions claimed, all buffers there.
pub struct Bound<M: Model + ?Sized> {
    nodes: Box<[BoundNode]>,
    lockstep: bool,
    last: Option<u64>,
    hooks: Option<Hooks>,
    model: Box<M>,
}

impl<M: Model + ?Sized> Bound<M> {
    /// Opens what the model reads and claims what it writes.
    ///
    /// # Errors
    /// [`TickError::Table`] when a region is held by another writer.
    pub fn new(model: Box<M>, table: &Table, lockstep: bool) -> Result<Self, TickError> {
        let nodes = model.nodes();
        let mut bound = Vec::with_capacity(nodes.len());
        for spec in nodes {
            let inputs = spec
                .reads
                .iter()
                .map(|input| Input {
                    reader: table.reader(input.region as usize).clone(),
                    words: vec![0; input.region.region().layout.words()].into(),
                    tick: NO_TICK,
                    fresh: false,
                })
                .collect();
            let claim = |region: RegionId| table.claim_writer(region as usize).map_err(TickError::Table);
            let words = |region: RegionId| vec![0; region.region().layout.words()].into_boxed_slice();
            bound.push(BoundNode {
                spec: *spec,
                inputs: Inputs(inputs),
                output: words(spec.writes),
                writer: claim(spec.writes)?,
                checkpoint: match spec.checkpoint {
                    Some(region) => Some((claim(region)?, words(region))),
                    None => None,
                },
                refused: 0,
            });
        }
        Ok(Bound { nodes: bound.into(), lockstep, last: None, hooks: None, model })
    }

    /// Takes over the newest checkpoint of the first node that has one. Returns its tick.
    pub fn restore(&mut self, table: &Table) -> Option<u64> {
        let node = self.nodes.iter().find(|node| node.checkpoint.is_some())?;
        let region = node.spec.checkpoint?;
        let mut words = vec![0; region.region().layout.words()];
        let reader = table.reader(region as usize);
        let latest = reader.latest(reader.head(), &mut words)?;
        let restored = self.model.restore(&words).then_some(latest.tick)?;
        self.last = Some(restored);
        for node in &mut self.nodes {
            for input in &mut node.inputs.0 {
                input.prime(restored);
            }
        }
        Some(restored)
    }

    /// Obeys the orders of a fault campaign from now on.
    pub fn set_hooks(&mut self, hooks: Hooks) {
        self.hooks = Some(hooks);
    }

    /// Takes in new orders before tick `n`; the hooks then say what the driver has to do about them.
    pub fn look_at_orders(&mut self, n: u64) -> Option<&mut Hooks> {
        let hooks = self.hooks.as_mut()?;
        while let Some(order) = hooks.look(n) {
            if matches!(order.kind, fault_kind::SENSOR | fault_kind::CAN) {
                self.model.fault(&order);
            }
        }
        Some(hooks)
    }

    /// Node `node`, as declared.
    pub fn spec(&self, node: usize) -> &NodeSpec {
        &self.nodes[node].spec
    }

    /// The model's nodes.
    pub fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// Epoch of the first region claimed: 1 at the start of a run, more after restarts.
    pub fn epoch(&self) -> u64 {
        self.nodes[0].writer.epoch()
    }

    /// Ticks that were already published when written again, after a restart.
    pub fn refused(&self) -> u64 {
        self.nodes.iter().map(|node| node.refused).sum()
    }

    /// The model itself.
    pub fn model(&self) -> &M {
        &self.model
    }

    /// Whether all same-tick inputs of node `node` are published for tick `n`.
    pub fn ready(&self, node: usize, n: u64) -> bool {
        self.missing(node, n).is_none()
    }

    /// The first input of node `node` that has to be there for tick `n` and is not, with the tick of it that is needed.
    pub fn missing(&self, node: usize, n: u64) -> Option<(RegionId, u64)> {
        let node = &self.nodes[node];
        node.spec.reads.iter().zip(&node.inputs.0).find_map(|(spec, input)| {
            let needed = spec.when.needed(n, self.lockstep)?;
            (input.reader.head() <= needed).then_some((spec.region, needed))
        })
    }

    /// The reader to wait on for `region`.
    pub fn reader(&self, node: usize, region: RegionId) -> Option<&RegionReader> {
        let node = &self.nodes[node];
        let index = node.spec.reads.iter().position(|spec| spec.region == region)?;
        Some(&node.inputs.0[index].reader)
    }

    /// Steps node `node` for tick `n`: the only path.
    ///
    /// # Errors
    /// In lockstep, [`TickError::NotReady`] when an input of the tick is not there: the caller's mistake.
    pub fn tick(&mut self, node: usize, n: u64, caught_up: bool) -> Result<(), TickError> {
        let skipped = if node == 0 {
            let skipped = self.last.map_or(n, |last| n.saturating_sub(last + 1));
            self.last = Some(n);
            skipped
        } else {
            0
        };
        let bound = &mut self.nodes[node];
        for (spec, input) in bound.spec.reads.iter().zip(&mut bound.inputs.0) {
            input.refresh(n, spec.when, self.lockstep);
            if self.lockstep && !input.fresh && spec.when.needed(n, true).is_some() {
                return Err(TickError::NotReady { node: bound.spec.name, region: spec.region, tick: n });
            }
        }
        self.model.step(node, &Step { n, caught_up, skipped }, &bound.inputs, &mut bound.output);
        if node == 0
            && let Some(hooks) = &self.hooks
        {
            hooks.corrupt(n, &bound.spec.writes.region().layout, &mut bound.output);
            // Not for a tick that is caught up: its order has already killed the process that was to write it.
            if hooks.torn(n) && !caught_up {
                let _ = bound.writer.write_interrupted(n, &bound.output);
                hooks.die();
                return Ok(());
            }
        }
        if bound.writer.write(n, &bound.output).is_err() {
            // Only after a restart: the dead writer had published this tick before its checkpoint.
            bound.refused += 1;
            self.model.unpublished();
        }
        if let Some((writer, words)) = &mut bound.checkpoint {
            self.model.save(n, words);
            let _ = writer.write(n, words);
        }
        Ok(())
    }

    /// Wakes who waits for what node `node` wrote. A system call, hence apart.
    pub fn ring(&mut self, node: usize) {
        if self.nodes[node].spec.rings {
            self.nodes[node].writer.ring();
        }
    }
}
