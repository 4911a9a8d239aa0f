//! What a fault on the bus should have caused, read from region `can`: the bench's own counts of a message that it
//! receives; what the ECU says in its diagnosis of one that it was sent. Behind the fault all is as before.

use super::round::Made;
use assembly::CanMessage;
use config::can::FaultKind as Effect;
use record::LogReader;
use regions::can_status;

/// The bus as the log has it.
pub struct Bus<'a> {
    log: &'a LogReader,
    ticks: &'a [u64],
}

impl<'a> Bus<'a> {
    /// Of a log; one without a bus has no ticks.
    pub fn of(log: &'a LogReader) -> Self {
        Bus { log, ticks: log.region("can").map(|region| region.ticks.as_slice()).unwrap_or_default() }
    }

    /// A column's values in the last row before tick `from` and in the last before `over`.
    fn around(&self, column: &str, from: u64, over: u64) -> Option<(f64, f64)> {
        let values = self.log.column("can", column).ok()?;
        let row = |tick: u64| self.ticks.partition_point(|&t| t < tick).checked_sub(1);
        Some((*values.get(row(from)?)?, *values.get(row(over)?)?))
    }

    fn rise(&self, column: &str, from: u64, over: u64) -> f64 {
        // Not a number: the ECU has not said it. Then it has not risen.
        let rise = self.around(column, from, over).map_or(0.0, |(before, after)| after - before);
        if rise.is_finite() { rise } else { 0.0 }
    }

    /// What is not as a fault of `ticks` ticks should have made it.
    pub fn unmet(&self, made: &Made, effect: Effect, ticks: u64, over: u64) -> Vec<String> {
        let Some((_, message)) = made.injection.can else { return Vec::new() };
        let mut unmet = Vec::new();
        let from = made.tick;
        let mut require = |holds: bool, what: String| {
            if !holds {
                unmet.push(what);
            }
        };
        require(
            self.rise("injected_count", from, over) >= 1.0,
            "the CAN service did not obey the order".to_owned(),
        );
        // Counters by what they tell of: wrong frames, frames out of sequence, frames lost, silence.
        let counters = match message {
            CanMessage::Received(k) => ["wrong", "sequence", "lost", "timeout"]
                .map(|what| self.rise(&format!("message_{what}_count.{k}"), from, over)),
            CanMessage::Sent(_) => {
                ["ecu_checksum_errors", "ecu_sequence_errors", "ecu_lost_frames", "ecu_timeouts"]
                    .map(|column| self.rise(column, from, over))
            }
        };
        let [wrong, sequence, lost, silent] = counters;
        let who = if matches!(message, CanMessage::Sent(_)) { "the ECU" } else { "the bench" };
        match effect {
            Effect::WrongCrc => require(wrong >= 1.0, format!("{who} counted no wrong checksum")),
            Effect::StaleCounter => require(sequence >= 1.0, format!("{who} counted no repeated counter")),
            // Late ones are overtaken by those behind them, or leave a silence.
            Effect::Delay | Effect::Drop => require(
                sequence + lost + silent >= 1.0,
                format!("{who} counted no frame lost, late or out of sequence in {ticks} ticks"),
            ),
        }
        if let CanMessage::Received(k) = message {
            let status = self.around(&format!("message_status.{k}"), from, over);
            let absent = (can_status::NEVER | can_status::TIMEOUT) as f64;
            // Both are the only bits that make values absent, and NEVER is the lowest.
            let after = status.map_or(absent, |(_, after)| after) as u64;
            require(
                after & (can_status::NEVER | can_status::TIMEOUT) == 0,
                "the message did not come back".to_owned(),
            );
        } else if let Some((before, after)) = self.around("ecu_state", from, over) {
            require(before == after, format!("the ECU is in state {after}, before the fault in {before}"));
        }
        unmet
    }
}
