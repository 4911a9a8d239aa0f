//! What is done to whom, in which order and when: a function of the campaign and its seed alone.

use assembly::{AssemblyError, CanMessage, can_order};
use config::ResolvedBench;
use config::campaign::{Campaign, Content, FaultKind, SensorChannel, SensorEffect, Target};
use regions::fault_kind;

/// Pseudo-random numbers [Steele, Lea, Flood 2014: SplitMix64]: equal everywhere for a seed.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Random(seed)
    }

    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In [0, end).
    pub fn below(&mut self, end: usize) -> usize {
        ((self.unit() * end as f64) as usize).min(end.saturating_sub(1))
    }
}

/// One fault to be made.
#[derive(Debug, Clone, PartialEq)]
pub struct Injection {
    /// Number in the campaign, from 0.
    pub number: usize,
    /// What.
    pub kind: FaultKind,
    /// To whom.
    pub target: Target,
    /// Undisturbed running before it. [s]
    pub settle_s: f64,
    /// When in the tick. [fraction of the period]
    pub phase: f64,
    /// For what is random in the fault itself.
    pub seed: u64,
    /// How often it was made already without saying anything, because the host stalled.
    pub tries: u32,
    /// Of a CAN fault what is ordered and the message meant, once it is known which scenario it is for.
    pub can: Option<([f64; 4], CanMessage)>,
}

/// Finds the messages of the CAN faults in the scenario's mapping.
///
/// # Errors
/// A message that is not in the mapping, or lacks what is to be wrong with it.
pub fn bind(all: &mut [Injection], resolved: &ResolvedBench) -> Result<(), AssemblyError> {
    for injection in all {
        if let Some(fault) = injection.kind.can_fault() {
            injection.can = can_order(resolved, &fault)?;
        }
    }
    Ok(())
}

/// All faults of a campaign in the order in which they are made.
pub fn schedule(campaign: &Campaign) -> Vec<Injection> {
    let mut random = Random::new(campaign.seed);
    let mut all = Vec::new();
    for kind in &campaign.fault {
        let targets = kind.targets();
        for i in 0..kind.count() as usize {
            // Evenly over the targets; who gets the odd ones does not matter.
            let target = targets[i % targets.len()];
            all.push(Injection {
                number: 0,
                kind: kind.clone(),
                target,
                settle_s: 0.0,
                phase: 0.0,
                seed: 0,
                tries: 0,
                can: None,
            });
        }
    }
    // Fisher and Yates.
    for i in (1..all.len()).rev() {
        all.swap(i, random.below(i + 1));
    }
    for (number, injection) in all.iter_mut().enumerate() {
        injection.number = number;
        injection.settle_s = campaign.settle_s + 0.1 * random.unit();
        injection.phase = random.unit();
        injection.seed = random.bits() >> 12;
    }
    all
}

/// The order that a service itself obeys, for the kinds that have one: code, ticks, value.
pub fn order(injection: &Injection, period_s: f64, output_phase: f64) -> Option<(u64, u64, [f64; 4])> {
    Some(match &injection.kind {
        FaultKind::Stall { duration_ms, .. } => (fault_kind::STALL, 100, [duration_ms * 1e-3, 0.0, 0.0, 0.0]),
        FaultKind::Late { ticks, .. } => {
            let phase = output_phase + 0.6 * (1.0 - output_phase);
            (fault_kind::LATE, u64::from(*ticks), [phase, 0.0, 0.0, 0.0])
        }
        // Not obeyed in a tick that is caught up: the next one will do.
        FaultKind::TornWrite { .. } => (fault_kind::TORN_WRITE, (0.2 / period_s) as u64, [0.0; 4]),
        FaultKind::Corrupt { ticks, content, .. } => {
            let content = match content {
                Content::Nan => 0.0,
                Content::Huge => 1.0,
                Content::Random => 2.0,
            };
            (fault_kind::CORRUPT, u64::from(*ticks), [content, injection.seed as f64, 0.0, 0.0])
        }
        FaultKind::ClockStep { step_s, .. } => (fault_kind::CLOCK_STEP, 100, [*step_s, 0.0, 0.0, 0.0]),
        FaultKind::Sensor { channel, effect, offset, ticks, .. } => {
            let effect = match effect {
                SensorEffect::Invalid => 0.0,
                SensorEffect::Stuck => 1.0,
                SensorEffect::Offset => 2.0,
            };
            (fault_kind::SENSOR, u64::from(*ticks), [f64::from(number_of(*channel)), effect, *offset, 0.0])
        }
        FaultKind::Can { ticks, .. } => (fault_kind::CAN, u64::from(*ticks), injection.can?.0),
        FaultKind::Kill { .. }
        | FaultKind::Stop { .. }
        | FaultKind::Scribble { .. }
        | FaultKind::DiskFull { .. } => return None,
    })
}

/// The channel's place in a measurement.
fn number_of(channel: SensorChannel) -> u8 {
    channel as u8
}

/// Ticks for which the service itself is away or wrong, where the campaign says so.
pub fn fault_ticks(kind: &FaultKind, period_s: f64) -> u64 {
    let of_ms = |ms: f64| (ms * 1e-3 / period_s).round() as u64;
    match kind {
        FaultKind::Kill { away_ticks, .. } | FaultKind::TornWrite { away_ticks, .. } => {
            u64::from(*away_ticks)
        }
        FaultKind::Stop { duration_ms, .. }
        | FaultKind::Stall { duration_ms, .. }
        | FaultKind::DiskFull { duration_ms, .. } => of_ms(*duration_ms),
        FaultKind::Late { ticks, .. }
        | FaultKind::Corrupt { ticks, .. }
        | FaultKind::Scribble { ticks, .. }
        | FaultKind::Sensor { ticks, .. }
        | FaultKind::Can { ticks, .. } => u64::from(*ticks),
        FaultKind::ClockStep { .. } => 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_faults_and_every_target_its_share() {
        let campaign = config::load::<config::campaign::Campaign>("kills_1000").map(|l| l.value);
        let campaign = campaign.unwrap_or_else(|problems| panic!("{problems}"));
        let all = schedule(&campaign);
        assert_eq!(all, schedule(&campaign));
        assert_eq!(all.len(), 1000);
        for target in [Target::Rig, Target::Vehicle, Target::Multibody, Target::Logger, Target::Supervisor] {
            assert_eq!(all.iter().filter(|i| i.target == target).count(), 200);
        }
        assert!(all.windows(2).any(|w| w[0].target == w[1].target), "shuffled, not in turn");
        let other = Campaign { seed: campaign.seed + 1, ..campaign };
        assert_ne!(all, schedule(&other));
    }
}
