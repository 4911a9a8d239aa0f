//! A fault campaign: what is done to a bench, how often, in which random order, and how long it may take to
//! recover. The reactions that are expected belong to the kinds of faults, not to the file: see `kingpin fault --help`.

use crate::can::{CanFault, FaultKind as CanEffect};
use crate::check::{Check, Checker};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A fault campaign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Campaign {
    /// Short name. Letters, digits, `_` and `-`, 1 to 60 of them.
    #[schemars(length(min = 1, max = 60))]
    pub name: String,
    /// What the campaign shows, in a sentence or two.
    pub description: String,
    /// The scenario that is run meanwhile: a path beside this file, or the bare name of a shipped one.
    pub scenario: String,
    /// Values of the scenario replaced, as with `kingpin run --set`.
    pub set: Vec<String>,
    /// By the wall clock as the set of processes, or in lockstep.
    pub drive: CampaignDrive,
    /// Seed of order, targets, times and phases.
    #[schemars(range(max = 9_007_199_254_740_992_u64))]
    pub seed: u64,
    /// Undisturbed running before each fault; up to a tenth of a second more is drawn. [s], [0.05, 60]
    #[schemars(range(min = 0.05, max = 60.0))]
    pub settle_s: f64,
    /// Longest wait for the bench to run again behind a fault. [s], [0.1, 600]
    #[schemars(range(min = 0.1, max = 600.0))]
    pub recover_max_s: f64,
    /// Faults made in one run of the bench before it is ended, judged and begun anew. [1, 500]
    #[schemars(range(min = 1, max = 500))]
    pub faults_per_run: u32,
    /// What is done.
    #[schemars(length(min = 1, max = 64))]
    pub fault: Vec<FaultKind>,
}

/// How the bench is driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CampaignDrive {
    /// The process set by the wall clock.
    Paced,
    /// Lockstep in one process: the same seed gives the same bits.
    Lockstep,
}

/// A process of a bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Target {
    /// The rig service.
    Rig,
    /// The vehicle service.
    Vehicle,
    /// The multibody service.
    Multibody,
    /// The logger.
    Logger,
    /// The supervisor: `kingpin attach` takes over.
    Supervisor,
    /// The CAN service, in a scenario that has one.
    Can,
}

impl Target {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Target::Rig => "rig",
            Target::Vehicle => "vehicle",
            Target::Multibody => "multibody",
            Target::Logger => "logger",
            Target::Supervisor => "supervisor",
            Target::Can => "can",
        }
    }
}

/// What a spoilt region holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Content {
    /// Not-a-number in every floating-point field.
    Nan,
    /// 1e30 in every floating-point field.
    Huge,
    /// Random bits in every field but the tick.
    Random,
}

/// Where in a region's memory somebody writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// The words of the newest tick.
    Payload,
    /// The stamp of the newest tick.
    Stamp,
    /// The count of published ticks.
    Head,
    /// Magic, version, layout, run, period and start.
    Header,
}

/// What a broken sensor says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SensorEffect {
    /// Out of its range: its validity bit is gone.
    Invalid,
    /// The same reading again and again.
    Stuck,
    /// A constant error.
    Offset,
}

/// Sensor of the rig, in the order of its channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SensorChannel {
    /// Hand-wheel angle.
    SteeringAngle,
    /// Hand-wheel torque.
    SteeringTorque,
    /// Torsion-bar torque.
    TorsionBarTorque,
    /// Assist torque.
    AssistTorque,
    /// Rack displacement.
    RackDisplacement,
    /// Left tie-rod force.
    TieRodForceLeft,
    /// Right tie-rod force.
    TieRodForceRight,
    /// Force of the left horizontal cylinder.
    ActuatorForceLeft,
    /// Force of the right horizontal cylinder.
    ActuatorForceRight,
    /// Stroke of the left horizontal cylinder.
    HorizontalStrokeLeft,
    /// Stroke of the right horizontal cylinder.
    HorizontalStrokeRight,
    /// Stroke of the left vertical cylinder.
    VerticalStrokeLeft,
    /// Stroke of the right vertical cylinder.
    VerticalStrokeRight,
}

/// One kind of fault, made `count` times, its targets drawn evenly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum FaultKind {
    /// SIGKILL.
    Kill {
        /// How often. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        count: u32,
        /// Whom.
        #[schemars(length(min = 1, max = 6))]
        targets: Vec<Target>,
        /// Lockstep: ticks until the service is there again; in real time it takes what it takes. [1, 1000]
        #[schemars(range(min = 1, max = 1000))]
        away_ticks: u32,
    },
    /// SIGSTOP, then SIGCONT.
    Stop {
        /// How often. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        count: u32,
        /// Whom.
        #[schemars(length(min = 1, max = 6))]
        targets: Vec<Target>,
        /// For how long. [ms], [1, 5000]
        #[schemars(range(min = 1.0, max = 5000.0))]
        duration_ms: f64,
    },
    /// The service computes for nothing before a step. Real time only.
    Stall {
        /// How often. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        count: u32,
        /// Whom: rig, vehicle or multibody.
        #[schemars(length(min = 1, max = 3))]
        targets: Vec<Target>,
        /// For how long. [ms], [1, 1000]
        #[schemars(range(min = 1.0, max = 1000.0))]
        duration_ms: f64,
    },
    /// Steps come only after the rig has applied.
    Late {
        /// How often. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        count: u32,
        /// Whom: vehicle or multibody.
        #[schemars(length(min = 1, max = 2))]
        targets: Vec<Target>,
        /// Ticks in a row. [1, 1000]
        #[schemars(range(min = 1, max = 1000))]
        ticks: u32,
    },
    /// SIGKILL in the middle of the copy into the slot.
    TornWrite {
        /// How often. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        count: u32,
        /// Whom: rig, vehicle or multibody.
        #[schemars(length(min = 1, max = 3))]
        targets: Vec<Target>,
        /// Lockstep: ticks until the service is there again. [1, 1000]
        #[schemars(range(min = 1, max = 1000))]
        away_ticks: u32,
    },
    /// The region that the service publishes holds nonsense.
    Corrupt {
        /// How often. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        count: u32,
        /// Whose region: vehicle or multibody.
        #[schemars(length(min = 1, max = 2))]
        targets: Vec<Target>,
        /// Ticks in a row. [1, 1000]
        #[schemars(range(min = 1, max = 1000))]
        ticks: u32,
        /// What it holds.
        content: Content,
    },
    /// Another program writes random words into the memory of the region that the service publishes. Real time only.
    Scribble {
        /// How often. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        count: u32,
        /// Whose region: rig (its measurement), vehicle or multibody.
        #[schemars(length(min = 1, max = 3))]
        targets: Vec<Target>,
        /// Where.
        place: Place,
        /// Ticks in a row, each once. [1, 1000]
        #[schemars(range(min = 1, max = 1000))]
        ticks: u32,
    },
    /// The logger's disk takes nothing more. Real time only.
    DiskFull {
        /// How often. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        count: u32,
        /// For how long. [ms], [1, 10000]
        #[schemars(range(min = 1.0, max = 10_000.0))]
        duration_ms: f64,
    },
    /// The wall clock of a service steps.
    ClockStep {
        /// How often. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        count: u32,
        /// Whose: rig, vehicle or multibody.
        #[schemars(length(min = 1, max = 3))]
        targets: Vec<Target>,
        /// By how much. [s], [-1e9, 1e9], not 0
        #[schemars(range(min = -1e9, max = 1e9))]
        step_s: f64,
    },
    /// A sensor of the rig breaks.
    Sensor {
        /// How often. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        count: u32,
        /// Which.
        channel: SensorChannel,
        /// How.
        effect: SensorEffect,
        /// The constant error; 0 for the other effects. [SI]
        offset: f64,
        /// Ticks in a row. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        ticks: u32,
    },
    /// A message on the bus is lost, late or wrong; skipped, and said so, in a scenario without a bus.
    Can {
        /// How often. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        count: u32,
        /// Message, sent or received, by its name in the DBC.
        message: String,
        /// What happens to it.
        effect: CanEffect,
        /// For `delay`: by how much; 0 for the other effects. [ms], [0, 10000]
        #[schemars(range(min = 0.0, max = 10_000.0))]
        delay_ms: f64,
        /// Ticks in a row. [1, 10000]
        #[schemars(range(min = 1, max = 10_000))]
        ticks: u32,
    },
}

impl FaultKind {
    /// How often.
    pub fn count(&self) -> u32 {
        match self {
            FaultKind::Kill { count, .. }
            | FaultKind::Stop { count, .. }
            | FaultKind::Stall { count, .. }
            | FaultKind::Late { count, .. }
            | FaultKind::TornWrite { count, .. }
            | FaultKind::Corrupt { count, .. }
            | FaultKind::Scribble { count, .. }
            | FaultKind::DiskFull { count, .. }
            | FaultKind::ClockStep { count, .. }
            | FaultKind::Sensor { count, .. }
            | FaultKind::Can { count, .. } => *count,
        }
    }

    /// Its name in the file.
    pub fn name(&self) -> &'static str {
        match self {
            FaultKind::Kill { .. } => "kill",
            FaultKind::Stop { .. } => "stop",
            FaultKind::Stall { .. } => "stall",
            FaultKind::Late { .. } => "late",
            FaultKind::TornWrite { .. } => "torn_write",
            FaultKind::Corrupt { .. } => "corrupt",
            FaultKind::Scribble { .. } => "scribble",
            FaultKind::DiskFull { .. } => "disk_full",
            FaultKind::ClockStep { .. } => "clock_step",
            FaultKind::Sensor { .. } => "sensor",
            FaultKind::Can { .. } => "can",
        }
    }

    /// To whom.
    pub fn targets(&self) -> &[Target] {
        match self {
            FaultKind::Kill { targets, .. }
            | FaultKind::Stop { targets, .. }
            | FaultKind::Stall { targets, .. }
            | FaultKind::Late { targets, .. }
            | FaultKind::TornWrite { targets, .. }
            | FaultKind::Corrupt { targets, .. }
            | FaultKind::Scribble { targets, .. }
            | FaultKind::ClockStep { targets, .. } => targets,
            FaultKind::DiskFull { .. } => &[Target::Logger],
            FaultKind::Sensor { .. } => &[Target::Rig],
            FaultKind::Can { .. } => &[Target::Can],
        }
    }

    /// The fault of a message as a scenario would state it, but for its time.
    pub fn can_fault(&self) -> Option<CanFault> {
        let FaultKind::Can { message, effect, delay_ms, .. } = self else { return None };
        Some(CanFault {
            message: message.clone(),
            fault: *effect,
            start_s: 0.0,
            end_s: None,
            delay_ms: (*effect == CanEffect::Delay).then_some(*delay_ms),
        })
    }
}

impl Campaign {
    /// Faults in all.
    pub fn faults(&self) -> u64 {
        self.fault.iter().map(|kind| u64::from(kind.count())).sum()
    }
}

impl Check for Campaign {
    fn check(&self, c: &mut Checker) {
        let plain = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '-';
        c.require(self.name.chars().all(plain), "name", "must consist of letters, digits, `_` and `-`");
        for (i, text) in self.set.iter().enumerate() {
            c.require(text.contains('='), &format!("set[{i}]"), "must be of the form path=value");
        }
        c.require(self.faults() <= 100_000, "fault", "must not be more than 100000 faults in all");
        let lockstep = self.drive == CampaignDrive::Lockstep;
        for (i, kind) in self.fault.iter().enumerate() {
            c.within(&format!("fault[{i}]"), |c| {
                use Target::{Can, Logger, Multibody, Rig, Supervisor, Vehicle};
                let can: &[Target] = match kind {
                    FaultKind::Kill { .. } | FaultKind::Stop { .. } if !lockstep => {
                        &[Rig, Vehicle, Multibody, Logger, Supervisor, Can]
                    }
                    FaultKind::Late { .. } | FaultKind::Corrupt { .. } => &[Vehicle, Multibody],
                    FaultKind::DiskFull { .. } => &[Logger],
                    FaultKind::Can { .. } => &[Can],
                    _ => &[Rig, Vehicle, Multibody],
                };
                for (k, target) in kind.targets().iter().enumerate() {
                    let names: Vec<_> = can.iter().map(|t| t.name()).collect();
                    let drive = if lockstep { " in lockstep" } else { "" };
                    let rule = format!("must be one of {}{drive}", names.join(", "));
                    c.require(can.contains(target), &format!("targets[{k}]"), rule);
                    let twice = kind.targets()[..k].contains(target);
                    c.require(!twice, &format!("targets[{k}]"), "must not be named twice");
                }
                match kind {
                    FaultKind::Stall { .. } | FaultKind::DiskFull { .. } | FaultKind::Scribble { .. } => {
                        c.require(!lockstep, "type", "needs drive = \"paced\"");
                    }
                    FaultKind::ClockStep { step_s, .. } => {
                        c.require(*step_s != 0.0, "step_s", "must not be 0");
                    }
                    FaultKind::Sensor { effect, offset, .. } => {
                        let fits = (*effect == SensorEffect::Offset) == (*offset != 0.0);
                        c.require(fits, "offset", "must be 0 except for effect = \"offset\"");
                    }
                    FaultKind::Can { effect, delay_ms, .. } => {
                        let fits = (*effect == CanEffect::Delay) == (*delay_ms > 0.0);
                        c.require(fits, "delay_ms", "must be 0 except for effect = \"delay\"");
                    }
                    _ => {}
                }
            });
        }
    }
}
