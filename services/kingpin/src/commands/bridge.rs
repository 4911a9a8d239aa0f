//! `bridge`: a live bench for Foxglove, Lichtblick and PlotJuggler.

use crate::commands::console::{Door, refuse, stop_flag};
use crate::exit::Exit;
use crate::output;
use bridge_service::{Bridge, Options};
use clap::Args;
use console_service::ServeError;

/// Arguments of `bridge`.
#[derive(Debug, Args)]
#[command(after_help = "\
Open the address it prints as a Foxglove WebSocket connection in Lichtblick, Foxglove or PlotJuggler. Every region of \
the table is a topic with all its ticks, named as in the log; live parameters are the program's parameters. With the \
token in the address they can be set, without it they can be read.

Example:
  kingpin run weave_100 &
  kingpin bridge")]
pub struct BridgeArgs {
    #[command(flatten)]
    door: Door,
    /// Port; 0 is a free one
    #[arg(long, default_value_t = 8765, value_name = "PORT")]
    port: u16,
    /// A page from elsewhere that may connect, as its browser names it (https://app.example.org); may be repeated
    #[arg(long, value_name = "ORIGIN")]
    allow_origin: Vec<String>,
}

/// `kingpin bridge`.
pub fn bridge(args: &BridgeArgs) -> Exit {
    let stop = stop_flag();
    let (bench, token) = match args.door.open() {
        Ok(open) => open,
        Err((exit, error)) => return refuse(exit, error),
    };
    let options = Options {
        bench,
        listen: args.door.address(args.port),
        hosts: args.door.host.clone(),
        origins: args.allow_origin.clone(),
        token: token.clone(),
    };
    let bridge = match Bridge::new(options) {
        Ok(bridge) => bridge,
        Err(error @ ServeError::Listen(..)) => {
            return refuse(Exit::Unavailable, format!("{error}; choose another port with --port"));
        }
        Err(error) => return refuse(Exit::Unavailable, error),
    };
    let address = bridge.address();
    args.door.warn(address);
    output::line(format!("bridge: ws://{address}/ to look, ws://{address}/?token={} to tune", token.text()));
    match bridge.serve(&stop) {
        Ok(()) => Exit::Done,
        Err(error) => refuse(Exit::Failed, error),
    }
}
