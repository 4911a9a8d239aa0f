//! Messages of the page. Anything else is refused by the parser: unknown kinds, unknown keys, wrong types.

use operator_link::Operation;
use params::Setting;
use serde::Deserialize;

/// What a page may say.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Message {
    /// Given back with the answer.
    #[serde(default)]
    pub(crate) id: u64,
    /// What it wants.
    pub(crate) want: Want,
}

/// What a page may want.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum Want {
    /// To be allowed to write.
    Token { token: String },
    /// Signals: rows over time, and the newest value of others.
    Subscribe { traces: Vec<String>, latest: Vec<String>, rate_hz: f64, points_hz: f64 },
    /// The live bench again.
    Live {},
    /// A recorded run.
    Replay { run: String },
    /// Another place in it. [s]
    Seek { to_s: f64 },
    /// Another speed.
    Play { speed: f64, paused: bool },
    /// Runs there are.
    Runs {},
    /// Two runs' figures, and a signal of both.
    Compare { a: String, b: String, signal: String },
    /// Parameters.
    Parameters {},
    /// Signals there are.
    Signals {},
    /// Write: change parameters.
    Set { settings: Vec<(String, Typed)> },
    /// Write: take back.
    Undo {},
    /// Write: save all parameters beside the run.
    Snapshot { name: String },
    /// Snapshots there are.
    Snapshots {},
    /// The settings of a snapshot.
    SnapshotRead { name: String },
    /// Write: steer.
    Steer { mode: u8, angle_rad: f64, torque_n_m: f64 },
    /// Write: operate.
    Operate { operation: Operate },
    /// Write: start a run.
    Launch { scenario: String, duration_s: Option<f64> },
}

impl Want {
    /// Whether it changes anything outside this connection.
    pub(crate) fn writes(&self) -> bool {
        match self {
            Want::Set { .. } | Want::Undo {} | Want::Snapshot { .. } => true,
            Want::Steer { .. } | Want::Operate { .. } | Want::Launch { .. } => true,
            Want::Token { .. } | Want::Subscribe { .. } | Want::Live {} | Want::Replay { .. } => false,
            Want::Seek { .. } | Want::Play { .. } | Want::Runs {} | Want::Compare { .. } => false,
            Want::Parameters {} | Want::Signals {} | Want::Snapshots {} | Want::SnapshotRead { .. } => false,
        }
    }
}

/// A value as JSON has it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub(crate) enum Typed {
    Number(f64),
    Switch(bool),
    Text(String),
}

impl From<Typed> for Setting {
    fn from(typed: Typed) -> Setting {
        match typed {
            Typed::Number(number) => Setting::Number(number),
            Typed::Switch(on) => Setting::Switch(on),
            Typed::Text(text) => Setting::Text(text),
        }
    }
}

/// Operations by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Operate {
    Arm,
    Start,
    Stop,
    Acknowledge,
    EmergencyStop,
    Release,
    End,
}

impl From<Operate> for Operation {
    fn from(operate: Operate) -> Operation {
        match operate {
            Operate::Arm => Operation::Arm,
            Operate::Start => Operation::Start,
            Operate::Stop => Operation::Stop,
            Operate::Acknowledge => Operation::Acknowledge,
            Operate::EmergencyStop => Operation::EmergencyStop,
            Operate::Release => Operation::ReleaseEmergencyStop,
            Operate::End => Operation::End,
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn known_messages_parse_and_others_do_not() {
        let good =
            r#"{"id":3,"want":{"set":{"settings":[["unit.assist_scale",0.5],["human.mode","angle"]]}}}"#;
        let message: Message = serde_json::from_str(good).unwrap();
        assert!(message.want.writes() && message.id == 3);
        for bad in [
            r#"{"want":{"format_disk":{}}}"#,
            r#"{"want":{"undo":{"all":true}}}"#,
            r#"{"want":{"steer":{"mode":300,"angle_rad":0,"torque_n_m":0}}}"#,
            r#"{"want":{"undo":{}},"as":"root"}"#,
            "[]",
            "",
        ] {
            assert!(serde_json::from_str::<Message>(bad).is_err(), "{bad}");
        }
    }
}
