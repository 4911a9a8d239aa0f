//! The commands, one file a group.

pub mod bench;
mod blackbox;
pub mod bridge;
mod can;
pub mod can_args;
mod can_bus;
mod configuration;
pub mod console;
mod doctor;
pub mod fault;
pub mod fmu;
mod fmu_export;
mod history;
mod log;
mod model;
pub mod monitor;
pub mod param;
mod procedure;
pub mod rig;
mod run;
mod service;
mod summary;
pub mod suspension;
pub mod sweep;
mod table;
pub mod tyre;
pub mod vehicle;

pub use model::ModelArgs;

use crate::args::{Args, Command};
use crate::exit::Exit;
use clap::CommandFactory;

/// Runs a command.
pub fn dispatch(command: Command) -> Exit {
    match command {
        Command::Run(args) => run::run(&args),
        Command::Report(args) => log::report(&args),
        Command::List(args) => configuration::list(&args),
        Command::Check(args) => configuration::check(&args),
        Command::Schema(args) => configuration::schema(&args),
        Command::Table(args) => table::table(&args),
        Command::Recover(args) => log::recover(&args),
        Command::Export(args) => log::export(&args),
        Command::Compare(args) => log::compare(&args),
        Command::Procedure(args) => procedure::procedure(&args),
        Command::Suspension(args) => suspension::suspension(&args),
        Command::Model(args) => model::model(&args),
        Command::Tyre(args) => tyre::tyre(&args),
        Command::Vehicle(args) => vehicle::vehicle(&args),
        Command::Rig(args) => rig::rig(&args),
        Command::Can(args) => can::can(&args),
        Command::Bench(args) => bench::bench(&args),
        Command::Doctor(args) => doctor::doctor(&args),
        Command::Fmu(args) => fmu::fmu(&args),
        Command::Sweep(args) => sweep::sweep(&args),
        Command::Fault(args) => fault::fault(&args),
        Command::Attach(args) => run::attach(&args),
        Command::Blackbox(args) => blackbox::blackbox(&args),
        Command::Clean(args) => blackbox::clean(&args),
        Command::Bridge(args) => bridge::bridge(&args),
        Command::Console(args) => console::console(&args),
        Command::Monitor(args) => monitor::monitor(&args),
        Command::Param(args) => param::param(&args),
        Command::Operate(args) => param::operate(&args),
        Command::Completions { shell } => {
            clap_complete::generate(shell, &mut Args::command(), "kingpin", &mut std::io::stdout());
            Exit::Done
        }
        Command::Service(args) => service::service(&args),
    }
}
