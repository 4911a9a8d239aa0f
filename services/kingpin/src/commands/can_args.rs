//! Arguments of `can`.

use clap::{Args as ClapArgs, Subcommand};
use std::path::PathBuf;

const CAN_HELP: &str = "\
A mapping (TOML) joins signals of a DBC file with variables of the bench: `kingpin list can` lists those shipped,
`kingpin list can --show steering_rest_bus` prints one to start from, `kingpin schema can` its JSON schema. A
scenario takes it with

  [can]
  mapping_file = \"my_bus.toml\"
  interface = \"can0\"               # absent: a bus in memory with the virtual ECU on it
  faults = [ { message = \"VehicleSpeed\", fault = \"wrong_crc\", start_s = 5.0, end_s = 6.0 } ]

Frames are written as can-utils write them: 123#DEADBEEF (standard), 12345678#00 (extended), 123##1AABB (CAN FD
with flags 1: faster data phase).

Examples:
  kingpin can check my_car.dbc my_bus.toml
  kingpin can decode my_car.dbc 0A0#1A00E803F0000000
  kingpin can encode my_car.dbc VehicleSpeed Speed=80 Speed_Valid=1
  kingpin can monitor --interface can0 --dbc my_car.dbc
  kingpin can send --interface can0 123#DEADBEEF --cycle-ms 10 --count 100
  kingpin can ecu --interface vcan0          (and in another terminal: kingpin run ... --set can.interface=vcan0)";

/// Arguments of `can`.
#[derive(Debug, ClapArgs)]
#[command(after_help = CAN_HELP)]
pub struct CanArgs {
    /// What to do.
    #[command(subcommand)]
    pub command: CanCommand,
}

/// Commands of `can`.
#[derive(Debug, Subcommand)]
pub enum CanCommand {
    /// Check DBC files and mappings: all that is wrong, at once, by message and signal
    Check(CanCheckArgs),
    /// Decode frames with a DBC file
    Decode(CanDecodeArgs),
    /// Encode a message with a DBC file
    Encode(CanEncodeArgs),
    /// Show what is on a bus
    Monitor(CanMonitorArgs),
    /// Send frames on a bus
    Send(CanSendArgs),
    /// Play a steering ECU on a bus: hear the rest-bus, answer, count the faults seen
    Ecu(CanEcuArgs),
}

/// Arguments of `can check`.
#[derive(Debug, ClapArgs)]
pub struct CanCheckArgs {
    /// DBC files (.dbc) and mappings (.toml, or the bare name of a shipped one)
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<String>,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `can decode`.
#[derive(Debug, ClapArgs)]
pub struct CanDecodeArgs {
    /// DBC file: a path, or the name of a shipped one
    #[arg(value_name = "FILE.dbc")]
    pub dbc: String,
    /// Frames as `candump -L` or cansend write them; without any they are read from standard input, one a line
    #[arg(value_name = "FRAME")]
    pub frames: Vec<String>,
    /// One JSON object a line: frame, message, signals with raw and physical value
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `can encode`.
#[derive(Debug, ClapArgs)]
pub struct CanEncodeArgs {
    /// DBC file: a path, or the name of a shipped one
    #[arg(value_name = "FILE.dbc")]
    pub dbc: String,
    /// Message; without it lines of JSON are read from standard input:
    /// {"message": "M", "signals": {"A": 1.5, "B": {"raw": 3}}}
    #[arg(value_name = "MESSAGE")]
    pub message: Option<String>,
    /// Physical values in the DBC's unit, SIGNAL=VALUE; bits of signals not named are 0
    #[arg(value_name = "SIGNAL=VALUE")]
    pub signals: Vec<String>,
}

/// Arguments of `can monitor`.
#[derive(Debug, ClapArgs)]
pub struct CanMonitorArgs {
    /// SocketCAN interface
    #[arg(short, long, value_name = "NAME")]
    pub interface: String,
    /// Decode with this DBC file
    #[arg(long, value_name = "FILE.dbc")]
    pub dbc: Option<String>,
    /// Only these messages (by name) or identifiers (hexadecimal); may be repeated
    #[arg(long, value_name = "MESSAGE")]
    pub only: Vec<String>,
    /// End after so many frames
    #[arg(long, value_name = "N")]
    pub count: Option<u64>,
    /// End after this time [s]
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// One JSON object a line
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `can send`.
#[derive(Debug, ClapArgs)]
pub struct CanSendArgs {
    /// SocketCAN interface
    #[arg(short, long, value_name = "NAME")]
    pub interface: String,
    /// Frames, or with --dbc a message and SIGNAL=VALUE
    #[arg(required = true, value_name = "FRAME|MESSAGE SIGNAL=VALUE")]
    pub what: Vec<String>,
    /// Encode with this DBC file
    #[arg(long, value_name = "FILE.dbc")]
    pub dbc: Option<String>,
    /// Send a DBC message as CAN FD
    #[arg(long, requires = "dbc")]
    pub fd: bool,
    /// Time between repetitions [ms]
    #[arg(long, value_name = "MS", default_value_t = 100.0)]
    pub cycle_ms: f64,
    /// Repetitions
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub count: u64,
}

/// Arguments of `can ecu`.
#[derive(Debug, ClapArgs)]
pub struct CanEcuArgs {
    /// SocketCAN interface
    #[arg(short, long, value_name = "NAME")]
    pub interface: String,
    /// Mapping of the ECU's variables (ecu.*), as a file or the name of a shipped one
    #[arg(long, value_name = "FILE", default_value = "virtual_ecu")]
    pub mapping: String,
    /// End after this time [s]; otherwise on Ctrl-C
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Write what it saw there as JSON, at the end
    #[arg(long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// One JSON line of state and faults seen every half second
    #[arg(long)]
    pub json: bool,
}
