//! The services' entry. What they say goes to the file the supervisor gave them.

use crate::args::{ServiceArgs, ServiceName};
use crate::exit::Exit;
use crate::output;
use table::Bench;

/// Runs one service.
pub fn service(args: &ServiceArgs) -> Exit {
    let bench = match Bench::new(&args.bench) {
        Ok(bench) => bench,
        Err(error) => {
            output::note(error);
            return Exit::BadInput;
        }
    };
    if args.service == ServiceName::Load {
        runtime::realtime::relax();
    }
    let note = |line: &str| output::note(line);
    let done = match args.service {
        ServiceName::Rig => rig_service::run(&bench, note).map_err(|e| e.to_string()),
        ServiceName::Vehicle => vehicle_service::run(&bench, note).map_err(|e| e.to_string()),
        ServiceName::Multibody => multibody_service::run(&bench, note).map_err(|e| e.to_string()),
        ServiceName::Can => can_service::run(&bench, note).map_err(|e| e.to_string()),
        ServiceName::Fmu0 => fmu_service::run(&bench, 0, note).map_err(|e| e.to_string()),
        ServiceName::Fmu1 => fmu_service::run(&bench, 1, note).map_err(|e| e.to_string()),
        ServiceName::Fmu2 => fmu_service::run(&bench, 2, note).map_err(|e| e.to_string()),
        ServiceName::Fmu3 => fmu_service::run(&bench, 3, note).map_err(|e| e.to_string()),
        ServiceName::FmuHost => fmu_host().map_err(|e| e.to_string()),
        ServiceName::Probe => probe(&bench),
        ServiceName::Load => super::bench::load::load(),
        ServiceName::Logger => logger::serve(&bench, note).map(drop).map_err(|e| e.to_string()),
    };
    match done {
        Ok(()) => Exit::Done,
        Err(error) => {
            output::note(format!("{:?}: {error}", args.service));
            Exit::Failed
        }
    }
}

/// Runs an FMU for the process at the other end of standard input.
fn fmu_host() -> std::io::Result<()> {
    use std::os::fd::AsFd;
    let socket = std::io::stdin().as_fd().try_clone_to_owned()?;
    crate::heap::count_from_now();
    fmu::serve(socket.into(), crate::heap::calls)
}

/// Reads the manifest and maps the table, as every service does before its own work, and ends.
fn probe(bench: &Bench) -> Result<(), String> {
    let manifest = assembly::manifest::Manifest::read(&bench.directory()).map_err(|e| e.to_string())?;
    assembly::service::open_table(bench, &manifest).map(drop).map_err(|e| e.to_string())
}
