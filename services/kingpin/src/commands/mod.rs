//! The commands, one file a group.

mod configuration;
pub mod console;
mod log;
mod model;
pub mod monitor;
pub mod param;
mod procedure;
mod run;
mod service;
mod summary;
mod suspension;
mod table;

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
        Command::Console(args) => console::console(&args),
        Command::Monitor(args) => monitor::monitor(&args),
        Command::Param(args) => param::param(&args),
        Command::Operate(args) => param::operate(&args),
        Command::Clean(args) => table::clean(&args),
        Command::Completions { shell } => {
            clap_complete::generate(shell, &mut Args::command(), "kingpin", &mut std::io::stdout());
            Exit::Done
        }
        Command::Service(args) => service::service(&args),
    }
}
