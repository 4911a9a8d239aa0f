//! Past values of a command held from tick to tick, read back by time.

use rig_plant::state::{StateReader, StateWriter};

/// The last commands, each held for one period.
#[derive(Debug, Clone)]
pub struct History {
    ring: Vec<f64>,
    head: usize,
    period_s: f64,
    whole: usize,
    part: f64,
}

impl History {
    /// A history of zeros that reaches back `delay_s`.
    pub fn new(delay_s: f64, period_s: f64) -> Self {
        let ticks = delay_s / period_s;
        let whole = (ticks + 1e-9).floor();
        Self {
            ring: vec![0.0; whole as usize + 3],
            head: 0,
            period_s,
            whole: whole as usize,
            part: (ticks - whole).max(0.0),
        }
    }

    /// Notes the command of this tick.
    pub fn push(&mut self, value: f64) {
        self.head = (self.head + 1) % self.ring.len();
        self.ring[self.head] = value;
    }

    /// The command `k` ticks before the last one.
    fn back(&self, k: usize) -> f64 {
        self.ring[(self.head + self.ring.len() - k) % self.ring.len()]
    }

    /// Integral of the command from `delay_s` ago until now: what is still on its way.
    pub fn pending(&self) -> f64 {
        let mut sum = self.part * self.back(self.whole);
        for k in 0..self.whole {
            sum += self.back(k);
        }
        sum * self.period_s
    }

    /// Mean of the command over one period that ended `delay_s` ago: what arrived since the last tick.
    pub fn arrived(&self) -> f64 {
        (1.0 - self.part) * self.back(self.whole) + self.part * self.back(self.whole + 1)
    }

    /// Length of the flat state.
    pub fn state_len(&self) -> usize {
        1 + self.ring.len()
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        w.put(self.head as f64);
        w.put_all(&self.ring);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        self.head = (r.take() as usize).min(self.ring.len() - 1);
        r.take_all(&mut self.ring);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_pending_and_what_arrives_add_up_to_what_was_sent() {
        for delay in [0.0, 0.4e-3, 1e-3, 2.7e-3, 6.0e-3] {
            let mut history = History::new(delay, 1e-3);
            let (mut sent, mut arrived) = (0.0, 0.0);
            for i in 0..50 {
                // At a tick: first what arrived since the last one, then the new command.
                arrived += history.arrived() * 1e-3;
                assert!((sent - arrived - history.pending()).abs() < 1e-12, "{delay} {i}");
                let value = f64::from(i * i % 17) - 5.0;
                history.push(value);
                sent += value * 1e-3;
            }
        }
    }
}
