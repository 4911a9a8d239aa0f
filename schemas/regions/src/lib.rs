//! The table's regions: one flat layout each, described once for table, log, console and manual.
//!
//! [`REGIONS`] is the list; a region is a name, a layout and whether its content must be the same in two
//! lockstep runs of one scenario. Every layout has its test of words and hash in this crate, so that a
//! change of a field is a change somebody decided on.

pub mod layout;
mod payloads;

pub use layout::{Axis, Column, Field, Kind, Layout, Payload};
pub use payloads::*;

/// One region of the table.
#[derive(Debug, Clone, Copy)]
pub struct Region {
    /// Name, unique in a bench.
    pub name: &'static str,
    /// The service that writes it.
    pub writer: &'static str,
    /// What its words mean.
    pub layout: Layout,
    /// Whether two lockstep runs of one scenario must agree on it bit for bit.
    pub compared: bool,
    /// How many ticks it keeps.
    pub history: History,
}

/// How many ticks a region keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum History {
    /// At least four seconds, so that the logger may lag.
    Seconds,
    /// This many ticks, a power of two.
    Ticks(usize),
}

macro_rules! regions {
    ($( $name:literal $id:ident $writer:literal $payload:ident $compared:literal $history:expr; )+) => {
        /// Index of a region in [`REGIONS`].
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(usize)]
        pub enum RegionId { $( #[doc = concat!("`", $name, "`, a [`", stringify!($payload), "`]")] $id, )+ }

        /// Every region of the table, in the order of [`RegionId`].
        pub const REGIONS: &[Region] = &[ $(
            Region { name: $name, writer: $writer, layout: $payload::LAYOUT, compared: $compared, history: $history },
        )+ ];

        /// Every id, in order.
        pub const ALL: [RegionId; REGIONS.len()] = [ $( RegionId::$id, )+ ];
    };
}

use History::{Seconds, Ticks};
regions! {
    "bench" Bench "supervisor" Bench false Seconds;
    "rig_measurement" RigMeasurement "rig" RigMeasurement true Seconds;
    "vehicle_state" VehicleState "vehicle" VehicleState true Seconds;
    "suspension_state" SuspensionState "multibody" SuspensionState true Seconds;
    "rig_status" RigStatus "rig" RigStatus true Seconds;
    "parameters" Parameters "supervisor" Parameters true Seconds;
    "rig_timing" RigTiming "rig" Timing false Seconds;
    "vehicle_timing" VehicleTiming "vehicle" Timing false Seconds;
    "multibody_timing" MultibodyTiming "multibody" Timing false Seconds;
    "can" Can "can" Can true Seconds;
    "fmu_0" Fmu0 "fmu_0" Fmu true Seconds;
    "fmu_1" Fmu1 "fmu_1" Fmu true Seconds;
    "fmu_2" Fmu2 "fmu_2" Fmu true Seconds;
    "fmu_3" Fmu3 "fmu_3" Fmu true Seconds;
    "fmu_0_timing" Fmu0Timing "fmu_0" Timing false Seconds;
    "fmu_1_timing" Fmu1Timing "fmu_1" Timing false Seconds;
    "fmu_2_timing" Fmu2Timing "fmu_2" Timing false Seconds;
    "fmu_3_timing" Fmu3Timing "fmu_3" Timing false Seconds;
    "logger_status" LoggerStatus "logger" LoggerStatus false Ticks(64);
    "vehicle_checkpoint" VehicleCheckpoint "vehicle" VehicleCheckpoint true Ticks(16);
    "multibody_checkpoint" MultibodyCheckpoint "multibody" MultibodyCheckpoint true Ticks(16);
    "faults" Faults "campaign" Fault false Ticks(64);
}

/// Regions of the FMUs, in the scenario's order.
pub const FMUS: [RegionId; 4] = [RegionId::Fmu0, RegionId::Fmu1, RegionId::Fmu2, RegionId::Fmu3];
/// Their timing regions.
pub const FMU_TIMINGS: [RegionId; 4] =
    [RegionId::Fmu0Timing, RegionId::Fmu1Timing, RegionId::Fmu2Timing, RegionId::Fmu3Timing];

impl RegionId {
    /// The region itself.
    pub const fn region(self) -> &'static Region {
        &REGIONS[self as usize]
    }
}

impl Region {
    /// Slots of the ring at a period [s]: a power of two, at least four seconds for [`History::Seconds`].
    pub fn depth(&self, period_s: f64) -> usize {
        match self.history {
            History::Seconds => ((4.0 / period_s).ceil() as usize).next_power_of_two(),
            History::Ticks(ticks) => ticks,
        }
    }

    /// Whether the log carries it: all but the checkpoints, which only a restart needs.
    pub fn logged(&self) -> bool {
        !self.name.ends_with("_checkpoint")
    }
}

/// The region of that name.
pub fn region_by_name(name: &str) -> Option<(RegionId, &'static Region)> {
    ALL.iter().map(|&id| (id, id.region())).find(|(_, region)| region.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_names_and_layouts_are_in_step() {
        for (index, &id) in ALL.iter().enumerate() {
            assert_eq!(id as usize, index);
            assert_eq!(region_by_name(id.region().name).map(|(found, _)| found), Some(id));
        }
        assert_eq!(RegionId::RigTiming.region().layout.name, "Timing");
        assert_eq!(RegionId::SuspensionState.region().layout.name, "SuspensionState");
    }

    #[test]
    fn a_changed_field_changes_the_hash() {
        let layout = RigMeasurement::LAYOUT;
        let mut fields = layout.fields.to_vec();
        fields.swap(4, 5);
        let swapped = Layout { fields: fields.leak(), ..layout };
        assert_eq!(swapped.words(), layout.words());
        assert_ne!(swapped.hash(), layout.hash(), "two fields of the same size swapped must be seen");
        let raised = Layout { version: layout.version + 1, ..layout };
        assert_ne!(raised.hash(), layout.hash());
    }

    #[test]
    fn columns_cover_every_word_once() {
        for region in REGIONS {
            let columns = region.layout.columns();
            assert_eq!(columns.len(), region.layout.words());
            assert!(columns.iter().enumerate().all(|(i, c)| c.word == i));
        }
        let names: Vec<_> = RigMeasurement::LAYOUT.columns().into_iter().map(|c| c.name).collect();
        assert!(names.contains(&"tie_rod_force_n.left".to_owned()));
    }

    #[test]
    fn absent_is_nan_and_zero_never_a_plausible_number() {
        let absent = VehicleState::absent();
        assert!(absent.position_m.iter().all(|v| v.is_nan()));
        assert_eq!(absent.tick, 0);
    }

    #[test]
    fn depth_keeps_four_seconds() {
        let region = RegionId::VehicleState.region();
        assert_eq!(region.depth(1e-3), 4096);
        assert_eq!(region.depth(0.25e-3), 16384);
        assert_eq!(RegionId::VehicleCheckpoint.region().depth(1e-3), 16);
    }
}
