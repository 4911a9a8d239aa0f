//! `console`: the operator's page, on a live bench or on a log.

use crate::exit::Exit;
use crate::output;
use clap::Args;
use console_service::{Console, Options, ServeError, Token};
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
    #[command(flatten)]
    door: Door,
    /// Port; 0 is a free one
    #[arg(long, default_value_t = 8470, value_name = "PORT")]
    pub port: u16,
    /// Directory of the runs that are listed and of those that are started here
    #[arg(long, default_value = "runs", value_name = "DIR")]
    pub runs: PathBuf,
    /// Replace a value in the runs that are started here, as in `kingpin run`; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    pub set: Vec<String>,
}

/// Where a server of a bench listens and whom it lets write.
#[derive(Debug, Args)]
pub struct Door {
    /// Name of the bench
    #[arg(long, default_value = "bench", value_name = "NAME")]
    name: String,
    /// Address to listen on
    #[arg(long, default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST), value_name = "ADDRESS")]
    listen: IpAddr,
    /// A further name under which it is asked for, with its port; may be repeated
    #[arg(long, value_name = "HOST:PORT")]
    pub host: Vec<String>,
    /// File with the token instead of a random one: at least 16 letters and digits
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
}

impl Door {
    /// The bench and the token.
    ///
    /// # Errors
    /// In words, with the exit code.
    pub fn open(&self) -> Result<(Bench, Token), (Exit, String)> {
        let bench = Bench::new(&self.name).map_err(|e| (Exit::BadInput, e.to_string()))?;
        let token = match &self.token_file {
            None => Token::random().map_err(|e| (Exit::Unavailable, e.to_string()))?,
            Some(file) => {
                let bad = |reason: String| (Exit::BadInput, format!("{}: {reason}", file.display()));
                let text = std::fs::read_to_string(file).map_err(|e| bad(e.to_string()))?;
                let rule = "must hold at least 16 letters and digits";
                Token::given(text.trim()).ok_or_else(|| bad(rule.to_owned()))?
            }
        };
        Ok((bench, token))
    }

    /// Where to listen.
    pub fn address(&self, port: u16) -> SocketAddr {
        SocketAddr::new(self.listen, port)
    }

    /// Says so when others can look.
    pub fn warn(&self, address: SocketAddr) {
        if !address.ip().is_loopback() {
            output::note("everybody on that network can look at this bench; what is sent is not encrypted");
        }
    }
}

/// Set when the process is asked to end; asked a second time, it ends at once.
pub fn stop_flag() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        let _ = signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&stop));
        let _ = signal_hook::flag::register(signal, Arc::clone(&stop));
    }
    stop
}

/// `kingpin console`.
pub fn console(args: &ConsoleArgs) -> Exit {
    let stop = stop_flag();
    let (bench, token) = match args.door.open() {
        Ok(open) => open,
        Err((exit, error)) => return refuse(exit, error),
    };
    if let Some(log) = &args.log
        && let Err(error) = record::log_files(log)
    {
        return refuse(Exit::BadInput, error);
    }
    let executable = match std::env::current_exe() {
        Ok(path) => path,
        Err(error) => return refuse(Exit::Unavailable, error),
    };
    let options = Options {
        bench,
        listen: args.door.address(args.port),
        hosts: args.door.host.clone(),
        token: token.clone(),
        runs: args.runs.clone(),
        log: args.log.clone(),
        executable,
        set: args.set.clone(),
    };
    let console = match Console::new(options) {
        Ok(console) => console,
        Err(error @ ServeError::Listen(..)) => {
            return refuse(Exit::Unavailable, format!("{error}; choose another port with --port"));
        }
        Err(error) => return refuse(Exit::Unavailable, error),
    };
    let address = console.address();
    args.door.warn(address);
    output::line(format!("console: http://{address}/#token={}", token.text()));
    match console.serve(&stop) {
        Ok(()) => Exit::Done,
        Err(error) => refuse(Exit::Failed, error),
    }
}

/// Ends with an error in words.
pub fn refuse(exit: Exit, error: impl std::fmt::Display) -> Exit {
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
