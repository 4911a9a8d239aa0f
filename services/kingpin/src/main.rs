//! Kingpin: an open, real-time steering hardware-in-the-loop bench. One executable, many commands.

mod args;
mod commands;
mod exit;
mod heap;
mod output;

use clap::Parser;

fn main() -> std::process::ExitCode {
    // A reader that went away (`kingpin … | head`) ends us quietly, as it does other tools.
    let args = args::Args::parse();
    commands::dispatch(args.command).into()
}
