//! Broken DBC and mapping files: each error names message and signal, and file and line where there is one.

use super::text;
use kingpin_tests::support::{kingpin, workspace};
use serde_json::Value;
use std::process::Command;

/// A change to the shipped files, and what must be said about it.
struct Case {
    name: &'static str,
    dbc: &'static [(&'static str, &'static str)],
    mapping: &'static [(&'static str, &'static str)],
    message: &'static str,
    /// Empty where the error is about the message as a whole.
    signal: &'static str,
    rule: &'static str,
}

const fn dbc(
    name: &'static str,
    dbc: &'static [(&'static str, &'static str)],
    message: &'static str,
    signal: &'static str,
    rule: &'static str,
) -> Case {
    Case { name, dbc, mapping: &[], message, signal, rule }
}

const fn mapping(
    name: &'static str,
    mapping: &'static [(&'static str, &'static str)],
    message: &'static str,
    signal: &'static str,
    rule: &'static str,
) -> Case {
    Case { name, dbc: &[], mapping, message, signal, rule }
}

const SPEED: &str = "SG_ Speed : 16|16@1+ (0.01,0) [0|655.34] \"km/h\" EPS";

const CASES: &[Case] = &[
    dbc(
        "no byte order",
        &[("YawRate : 23|16@0- ", "YawRate : 23|16@2- ")],
        "Inertial",
        "YawRate",
        "is not DBC",
    ),
    dbc(
        "no scale",
        &[("(0.05,0) [-1638.4|1638.35]", "(0.05) [-1638.4|1638.35]")],
        "SteeringAngle",
        "SteeringWheelAngle",
        "is not DBC",
    ),
    dbc(
        "message without length",
        &[("BO_ 288 Engine: 8 BENCH", "BO_ 288 Engine: BENCH")],
        "Engine",
        "",
        "is not DBC",
    ),
    dbc(
        "too long for the message",
        &[("BO_ 304 Body: 4 BENCH", "BO_ 304 Body: 2 BENCH")],
        "Body",
        "OutsideTemperature",
        "needs byte 3",
    ),
    dbc("65 bits", &[("Throttle : 23|8@0+", "Throttle : 23|65@0+")], "Engine", "Throttle", "1 to 64 bits"),
    dbc(
        "factor 0",
        &[("LateralAcceleration : 39|16@0- (0.001,0)", "LateralAcceleration : 39|16@0- (0,0)")],
        "Inertial",
        "LateralAcceleration",
        "factor 0",
    ),
    dbc(
        "limits upside down",
        &[("(0.02,0) [-40.96|40.94]", "(0.02,0) [40.94|-40.96]")],
        "VehicleSpeed",
        "LongitudinalAcceleration",
        "minimum",
    ),
    dbc(
        "float of 16 bits",
        &[("RackDisplacement : 64|32@1-", "RackDisplacement : 64|16@1-")],
        "SteeringSensors",
        "RackDisplacement",
        "must be 32",
    ),
    dbc(
        "identifier twice",
        &[("BO_ 164 WheelSpeeds", "BO_ 160 WheelSpeeds")],
        "WheelSpeeds",
        "",
        "identifier 0A0 of message VehicleSpeed",
    ),
    dbc("message name twice", &[("BO_ 164 WheelSpeeds", "BO_ 164 Inertial")], "Inertial", "", "occurs twice"),
    dbc(
        "signal twice",
        &[("WheelSpeed_FR :", "WheelSpeed_FL :")],
        "WheelSpeeds",
        "WheelSpeed_FL",
        "occurs twice",
    ),
    dbc("identifier too great", &[("BO_ 304 Body", "BO_ 4096 Body")], "Body", "", "at most 2047"),
    dbc("no multiplexor", &[("Page M :", "Page :")], "EPS_Diagnosis", "Temperature", "the message has none"),
    dbc(
        "impossible selection",
        &[("Timeouts m1 :", "Timeouts m16 :")],
        "EPS_Diagnosis",
        "Timeouts",
        "cannot take",
    ),
    dbc(
        "float of nothing",
        &[("SIG_VALTYPE_ 416 RackDisplacement", "SIG_VALTYPE_ 416 RackDispl")],
        "SteeringSensors",
        "RackDispl",
        "no such signal",
    ),
    mapping(
        "no such message",
        &[("message = \"Inertial\"", "message = \"Inertal\"")],
        "Inertal",
        "",
        "did you mean `Inertial`",
    ),
    mapping(
        "no such signal",
        &[("signal = \"YawRate\"", "signal = \"YawRat\"")],
        "Inertial",
        "YawRat",
        "did you mean `YawRate`",
    ),
    mapping(
        "no such source",
        &[("vehicle_state.velocity_m_s.x", "vehicle_state.velocity_m_s.q")],
        "VehicleSpeed",
        "Speed",
        "there is no variable",
    ),
    mapping(
        "no such target",
        &[("can.ecu_supply_v", "can.ecu_supply")],
        "EPS_Diagnosis",
        "SupplyVoltage",
        "there is no variable",
    ),
    mapping(
        "another quantity",
        &[("vehicle_state.angular_velocity_rad_s.z", "vehicle_state.acceleration_m_s2.z")],
        "Inertial",
        "YawRate",
        "is an acceleration",
    ),
    mapping(
        "another quantity received",
        &[("can.ecu_temperature_k", "can.ecu_supply_a")],
        "EPS_Diagnosis",
        "Temperature",
        "the signal is a temperature",
    ),
    Case {
        name: "unit against the DBC's",
        dbc: &[],
        mapping: &[("signal = \"YawRate\", ", "signal = \"YawRate\", unit = \"rad/s\", ")],
        message: "Inertial",
        signal: "YawRate",
        rule: "is not the DBC's `deg/s`",
    },
    Case {
        name: "no unit at all",
        dbc: &[(SPEED, "SG_ Speed : 16|16@1+ (0.01,0) [0|655.34] \"\" EPS")],
        mapping: &[],
        message: "VehicleSpeed",
        signal: "Speed",
        rule: "states no unit",
    },
    Case {
        name: "unknown unit",
        dbc: &[(SPEED, "SG_ Speed : 16|16@1+ (0.01,0) [0|655.34] \"knots\" EPS")],
        mapping: &[],
        message: "VehicleSpeed",
        signal: "Speed",
        rule: "`knots` is not known",
    },
    mapping(
        "source and value",
        &[(
            "signal = \"Speed_Valid\", value = 1.0",
            "signal = \"Speed_Valid\", value = 1.0, source = \"vehicle_state.time_s\"",
        )],
        "VehicleSpeed",
        "Speed_Valid",
        "either a `source` or a `value`",
    ),
    mapping(
        "value out of range",
        &[("signal = \"Ignition\", value = 2.0", "signal = \"Ignition\", value = 4.0")],
        "Body",
        "Ignition",
        "must be in [0, 3]",
    ),
    mapping(
        "checksum of 4 bits",
        &[("checksum = \"Wheel_Checksum\"", "checksum = \"Wheel_Counter\"")],
        "WheelSpeeds",
        "Wheel_Counter",
        "must have 8 bits",
    ),
    mapping(
        "counter that is not there",
        &[("counter = \"Sensors_Counter\"", "counter = \"SensorsCounter\"")],
        "SteeringSensors",
        "SensorsCounter",
        "is not in the DBC file",
    ),
    mapping(
        "FD as classic",
        &[("frame = \"fd_brs\"", "frame = \"classic\"")],
        "SteeringSensors",
        "",
        "16 bytes need `fd`",
    ),
    mapping(
        "constant forgotten",
        &[("constants = [0x86], ", "")],
        "SteeringAngle",
        "Angle_Checksum",
        "needs the message's constant",
    ),
    mapping(
        "never plausible",
        &[("min = 6.0, max = 18.0", "min = 60.0, max = 180.0")],
        "EPS_Diagnosis",
        "SupplyVoltage",
        "nothing would ever be plausible",
    ),
    mapping(
        "target twice",
        &[("can.ecu_assist_torque_n_m", "can.ecu_driver_torque_n_m")],
        "EPS_Torque",
        "AssistTorque",
        "already written",
    ),
    mapping(
        "counter as a signal",
        &[(
            "signal = \"Throttle\", source = \"vehicle_state.throttle_ratio\"",
            "signal = \"Engine_Counter\", value = 3.0",
        )],
        "Engine",
        "Engine_Counter",
        "filled twice",
    ),
];

fn shipped(name: &str) -> String {
    std::fs::read_to_string(workspace().join("schemas/can").join(name)).unwrap()
}

#[test]
fn broken_files_are_named_by_message_and_signal() {
    assert!(CASES.len() >= 20);
    let folder = tempfile::tempdir().unwrap();
    for case in CASES {
        let (mut dbc, mut mapping) = (shipped("kingpin_steering.dbc"), shipped("steering_rest_bus.toml"));
        for (text, changes) in [(&mut dbc, case.dbc), (&mut mapping, case.mapping)] {
            for (from, to) in changes {
                assert!(text.contains(from), "{}: `{from}` is not in the shipped file", case.name);
                *text = text.replacen(from, to, 1);
            }
        }
        let (dbc_path, map_path) = (folder.path().join("bus.dbc"), folder.path().join("bus.toml"));
        std::fs::write(&dbc_path, dbc).unwrap();
        std::fs::write(&map_path, mapping.replace("kingpin_steering.dbc", "bus.dbc")).unwrap();
        let output = Command::new(kingpin())
            .args(["can", "check", "--json"])
            .args([&dbc_path, &map_path])
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2), "{}: {}", case.name, text(&output.stdout));
        let said: Value = serde_json::from_slice(&output.stdout).unwrap();
        let about = if case.signal.is_empty() {
            format!("message {}", case.message)
        } else {
            format!("message {}, signal {}", case.message, case.signal)
        };
        let all = said["violations"].as_array().unwrap();
        let fits = |violation: &&Value| {
            let rule = violation["rule"].as_str().unwrap();
            rule.contains(&about) && rule.contains(case.rule)
        };
        let found = all.iter().find(fits);
        let found =
            found.unwrap_or_else(|| panic!("{}: `{about}: {}` is not in {all:#?}", case.name, case.rule));
        assert!(found["line"].as_u64().unwrap() > 0, "{}: no line: {found}", case.name);
        let ending = if case.mapping.is_empty() && !case.rule.contains("unit") && !case.rule.contains("known")
        {
            "bus.dbc"
        } else {
            "bus.toml"
        };
        assert!(found["file"].as_str().unwrap().ends_with(ending), "{}: {found}", case.name);
    }
}

#[test]
fn all_faults_of_a_file_are_said_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut dbc = shipped("kingpin_steering.dbc");
    for (from, to) in
        [("16|16@1+ (0.01,0)", "16|16@3+ (0.01,0)"), ("23|12@0+", "23|12@0"), ("(0.25,0)", "(0.25;0)")]
    {
        dbc = dbc.replacen(from, to, 1);
    }
    let path = folder.path().join("three.dbc");
    std::fs::write(&path, dbc).unwrap();
    let output = Command::new(kingpin()).args(["can", "check"]).arg(&path).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    for about in [
        "message VehicleSpeed, signal Speed:",
        "message WheelSpeeds, signal WheelSpeed_FL:",
        "message Engine, signal EngineSpeed:",
    ] {
        assert!(said.contains(about), "{about} is not in {said}");
    }
}

#[test]
fn shipped_mappings_are_without_fault() {
    let output = Command::new(kingpin())
        .args(["can", "check", "kingpin_steering.dbc", "steering_rest_bus", "virtual_ecu"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
}
