//! `console`: the operator's page, on a live bench or on a log.

use crate::exit::Exit;
use crate::output;
use clap::Args;
use console_service::{Console, ConsoleError, Options, Token};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use table::Bench;

/// Arguments of `console`.
#[derive(Debug, Args)]
#[command(after_help = "\
Open the address it prints in any browser; it works offline. The part behind # is the token: with it the page may \
write (start and stop runs, tune, steer), without it it may look only.

It listens on this machine alone. From a tablet, use a tunnel (ssh -L 8470:localhost:8470 rig), or --listen with an \
address of this machine: then everybody on that network can look, and what is sent is not encrypted.

Examples:
  kingpin console                                live on bench `bench`, whenever it runs
  kingpin console runs/growing_slalom_80-20260101-120000
  kingpin run growing_slalom_80 --console        a run with its console")]
pub struct ConsoleArgs {
    /// Directory of a run, or a log file, to replay first
    pub log: Option<PathBuf>,
    /// Name of the bench
    #[arg(long, default_value = "bench", value_name = "NAME")]
    pub name: String,
    /// Address to listen on
    #[arg(long, default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST), value_name = "ADDRESS")]
    pub listen: IpAddr,
    /// Port; 0 is a free one
    #[arg(long, default_value_t = 8470, value_name = "PORT")]
    pub port: u16,
    /// A further name under which the page is asked for, with its port; may be repeated
    #[arg(long, value_name = "HOST:PORT")]
    pub host: Vec<String>,
    /// Directory of the runs that are listed and of those that are started here
    #[arg(long, default_value = "runs", value_name = "DIR")]
    pub runs: PathBuf,
    /// Replace a value in the runs that are started here, as in `kingpin run`; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    pub set: Vec<String>,
    /// File with the token instead of a random one: at least 16 letters and digits
    #[arg(long, value_name = "FILE")]
    pub token_file: Option<PathBuf>,
}

/// `kingpin console`.
pub fn console(args: &ConsoleArgs) -> Exit {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        let _ = signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&stop));
        let _ = signal_hook::flag::register(signal, Arc::clone(&stop));
    }
    let bench = match Bench::new(&args.name) {
        Ok(bench) => bench,
        Err(error) => return refuse(Exit::BadInput, error),
    };
    if let Some(log) = &args.log
        && let Err(error) = record::log_files(log)
    {
        return refuse(Exit::BadInput, error);
    }
    let token = match &args.token_file {
        None => Token::random().map_err(|e| (Exit::Unavailable, e.to_string())),
        Some(file) => std::fs::read_to_string(file)
            .map_err(|e| (Exit::BadInput, format!("{}: {e}", file.display())))
            .and_then(|text| {
                let rule = "must hold at least 16 letters and digits";
                Token::given(text.trim()).ok_or((Exit::BadInput, format!("{}: {rule}", file.display())))
            }),
    };
    let token = match token {
        Ok(token) => token,
        Err((exit, error)) => return refuse(exit, error),
    };
    let executable = match std::env::current_exe() {
        Ok(path) => path,
        Err(error) => return refuse(Exit::Unavailable, error),
    };
    let options = Options {
        bench,
        listen: SocketAddr::new(args.listen, args.port),
        hosts: args.host.clone(),
        token: token.clone(),
        runs: args.runs.clone(),
        log: args.log.clone(),
        executable,
        set: args.set.clone(),
    };
    let console = match Console::new(options) {
        Ok(console) => console,
        Err(error @ ConsoleError::Listen(..)) => {
            return refuse(Exit::Unavailable, format!("{error}; choose another port with --port"));
        }
        Err(error) => return refuse(Exit::Unavailable, error),
    };
    let address = console.address();
    if !address.ip().is_loopback() {
        output::note("everybody on that network can look at this bench; what is sent is not encrypted");
    }
    output::line(format!("console: http://{address}/#token={}", token.text()));
    match console.serve(&stop) {
        Ok(()) => Exit::Done,
        Err(error) => refuse(Exit::Failed, error),
    }
}

fn refuse(exit: Exit, error: impl std::fmt::Display) -> Exit {
    output::note(error);
    exit
}

/// The console of a run, as a process of its own that ends with the run.
pub struct Beside(std::process::Child);

impl Beside {
    /// Starts it; it prints its address itself, on standard error.
    pub fn start(name: &str, port: u16) -> std::io::Result<Self> {
        use std::os::fd::AsFd;
        use std::os::unix::process::CommandExt;
        // Standard output belongs to the run's own answer.
        let said = std::io::stderr().as_fd().try_clone_to_owned()?;
        std::process::Command::new(std::env::current_exe()?)
            .args(["console", "--name", name, "--port", &port.to_string()])
            .stdin(std::process::Stdio::null())
            .stdout(said)
            .process_group(0)
            .spawn()
            .map(Beside)
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        if let Some(pid) = rustix::process::Pid::from_raw(self.0.id() as i32) {
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
        }
        let _ = self.0.wait();
    }
}
