//! Messages of the Foxglove WebSocket protocol: JSON one way and the other, data as binary from the server.

use regions::{ALL, RegionId};
use serde::Deserialize;
use serde_json::{Value, json};

/// The names under which the protocol goes, newest first.
pub(crate) const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// First byte of a data message.
const MESSAGE_DATA: u8 = 1;

/// What a client says.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub(crate) enum Said {
    Subscribe { subscriptions: Vec<Subscription> },
    Unsubscribe { subscription_ids: Vec<u32> },
    GetParameters { parameter_names: Vec<String>, id: Option<String> },
    SetParameters { parameters: Vec<Parameter>, id: Option<String> },
    SubscribeParameterUpdates { parameter_names: Vec<String> },
    UnsubscribeParameterUpdates { parameter_names: Vec<String> },
}

/// A client's name for a channel it wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Subscription {
    pub(crate) id: u32,
    pub(crate) channel_id: u64,
}

/// A parameter to be set.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Parameter {
    pub(crate) name: String,
    #[serde(default)]
    pub(crate) value: Value,
}

/// How bad a status is.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Level {
    Info = 0,
    Warning = 1,
    Error = 2,
}

/// Who speaks, and what it can.
pub(crate) fn server_info(bench: &str) -> Value {
    json!({
        "op": "serverInfo", "name": format!("kingpin {bench}"), "capabilities": ["parameters", "parametersSubscribe"],
        "supportedEncodings": [], "metadata": {"kingpin": env!("CARGO_PKG_VERSION")},
    })
}

/// Every region as a channel.
pub(crate) fn advertise() -> Value {
    let channels: Vec<_> = ALL
        .iter()
        .filter(|id| id.region().logged())
        .map(|id| {
            let region = id.region();
            json!({
                "id": channel_id(*id), "topic": record::writer::topic(region), "encoding": "cdr",
                "schemaName": record::writer::schema_name(region), "schema": region.layout.ros2_message(),
                "schemaEncoding": "ros2msg",
            })
        })
        .collect();
    json!({"op": "advertise", "channels": channels})
}

/// Number of a region's channel.
fn channel_id(region: RegionId) -> u64 {
    region as u64 + 1
}

/// The region of a channel.
pub(crate) fn region_of(channel: u64) -> Option<RegionId> {
    ALL.into_iter().find(|id| channel_id(*id) == channel && id.region().logged())
}

/// Something to tell whoever sits before the client.
pub(crate) fn status(level: Level, message: impl Into<String>) -> Value {
    json!({"op": "status", "level": level as u8, "message": message.into()})
}

/// Values of parameters.
pub(crate) fn parameter_values<'a>(
    values: impl Iterator<Item = (&'a str, f64)>,
    id: Option<String>,
) -> Value {
    let parameters: Vec<_> =
        values.map(|(name, value)| json!({"name": name, "value": value, "type": "float64"})).collect();
    let mut message = json!({"op": "parameterValues", "parameters": parameters});
    if let Some(id) = id {
        message["id"] = json!(id);
    }
    message
}

/// Begins a data message; the payload follows.
pub(crate) fn begin_data(subscription: u32, log_time_ns: u64) -> Vec<u8> {
    let mut bytes = vec![MESSAGE_DATA];
    bytes.extend_from_slice(&subscription.to_le_bytes());
    bytes.extend_from_slice(&log_time_ns.to_le_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn what_clients_say_is_understood_and_nothing_else() {
        let said = |text: &str| serde_json::from_str::<Said>(text);
        let subscribe = said(r#"{"op":"subscribe","subscriptions":[{"id":7,"channelId":3}]}"#).unwrap();
        assert_eq!(subscribe, Said::Subscribe { subscriptions: vec![Subscription { id: 7, channel_id: 3 }] });
        let get = said(r#"{"op":"getParameters","parameterNames":[],"id":"a"}"#).unwrap();
        assert_eq!(get, Said::GetParameters { parameter_names: vec![], id: Some("a".to_owned()) });
        for wrong in [
            r#"{"op":"subscribe"}"#,
            r#"{"op":"unsubscribe","subscriptionIds":[-1]}"#,
            r#"{"op":"advertise","channels":[]}"#,
            "[]",
            "",
        ] {
            assert!(said(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn each_channel_is_one_region_and_data_begin_with_opcode_subscription_and_time() {
        let channels = advertise();
        for channel in channels["channels"].as_array().unwrap() {
            let region = region_of(channel["id"].as_u64().unwrap()).unwrap();
            assert_eq!(channel["topic"], format!("/{}", region.region().name));
        }
        assert_eq!(region_of(0), None);
        assert_eq!(region_of(u64::MAX), None);
        assert_eq!(begin_data(0x0102, 3), [1, 2, 1, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0]);
    }
}
