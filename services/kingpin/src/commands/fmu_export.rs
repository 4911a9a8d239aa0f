//! `fmu export`: the car or the suspension packed as an FMU for other tools.

use crate::exit::Exit;
use crate::output;
use clap::Args as ClapArgs;
use config::ResolvedCar;
use config::axle::Axle;
use fmu_export::{IDENTIFIER, Model, Resource, Role, description};
use sha2::{Digest, Sha256};
use std::io::Write;
use std::path::{Path, PathBuf};

const EXPORT_HELP: &str = "\
Writes an FMU of FMI 2.0 for co-simulation on Linux. Its step is --step-ms; a master's step must be a multiple of it.

Car: parameters steer_by (0 delta_road_rad_in, 1 steering_wheel_rad_in, 2 rack_disp_m_in), speed_control (true: holds \
target_speed_mps_in; false: throttle_in and brake_pa_in drive, from initial_speed_mps on). Outputs are the columns of \
`kingpin vehicle simulate`. The steering inputs are those of the step's end, the others those of its beginning: set \
so, the trajectory is that of `kingpin vehicle simulate` bit for bit.

Suspension: inputs rack, wheel heights, wheel forces and moments of both sides; outputs tie-rod forces, angles, wheel \
centres.

The model's library, libfmu_export.so, is built with the executable and is looked for beside it.

Examples:
  kingpin fmu export --car sedan --out sedan.fmu
  kingpin fmu export --suspension sedan_double_wishbone --out front.fmu
  kingpin fmu check sedan.fmu";

/// Arguments of `fmu export`.
#[derive(Debug, ClapArgs)]
#[command(after_help = EXPORT_HELP)]
pub struct ExportArgs {
    /// Car: TOML file or shipped name
    #[arg(long, value_name = "CAR", required_unless_present = "suspension", conflicts_with = "suspension")]
    car: Option<String>,
    /// Suspension: TOML file or shipped name
    #[arg(long, value_name = "AXLE")]
    suspension: Option<String>,
    /// Where to write the FMU
    #[arg(long, value_name = "FILE.fmu")]
    out: PathBuf,
    /// Length of a step [ms]
    #[arg(long, default_value_t = 1.0, value_name = "MS")]
    step_ms: f64,
    /// Replace a value of the car: `body.sprung_mass_kg=1500`; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// The model's library, if it does not lie beside the executable
    #[arg(long, value_name = "FILE.so")]
    library: Option<PathBuf>,
}

/// `kingpin fmu export`.
pub fn export(args: &ExportArgs) -> Exit {
    match packed(args) {
        Ok(text) => {
            output::note(text);
            Exit::Done
        }
        Err((exit, text)) => {
            output::note(text);
            exit
        }
    }
}

fn packed(args: &ExportArgs) -> Result<String, (Exit, String)> {
    let bad = |text: String| (Exit::BadInput, text);
    if !(args.step_ms > 0.0 && args.step_ms <= 10.0) {
        return Err(bad(format!("--step-ms = {}: must be in (0, 10] ms", args.step_ms)));
    }
    let step_s = args.step_ms * 1e-3;
    let (name, text, resource) = match (&args.car, &args.suspension) {
        (Some(car), _) => {
            let resolved = ResolvedCar::load(car, &args.set).map_err(|p| bad(p.to_string()))?;
            if resolved.driveline_model.is_some() {
                output::note(format!(
                    "{car}: its driveline model runs on the bench only; here its own powertrain drives"
                ));
            }
            (car, "car with 27 degrees of freedom", Resource::Car { car: Box::new(resolved), step_s })
        }
        (None, Some(axle)) => {
            let loaded = config::load_with::<Axle>(axle, &args.set).map_err(|p| bad(p.to_string()))?;
            (axle, "front suspension", Resource::Suspension { axle: Box::new(loaded.value), step_s })
        }
        (None, None) => return Err(bad("--car or --suspension must be given".to_owned())),
    };
    let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let model = Model::new(resource.clone()).map_err(|error| bad(format!("{name}: {error}")))?;
    let json = serde_json::to_value(&resource).unwrap_or_default();
    let digest = Sha256::digest(json.to_string().as_bytes());
    let hex: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
    let guid =
        format!("{{{}-{}-{}-{}-{}}}", &hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..32]);
    let xml = description(&stem, text, &guid, step_s, model.variables());
    let library = library(args.library.as_deref()).map_err(|text| (Exit::Unavailable, text))?;
    let bytes = std::fs::read(&library)
        .map_err(|error| (Exit::Unavailable, format!("{}: {error}", library.display())))?;
    let whole = serde_json::json!({ "guid": guid, "model": json });
    let entries = [
        ("modelDescription.xml".to_owned(), xml.into_bytes()),
        (format!("binaries/{}/{IDENTIFIER}.so", fmu::platform(fmu::Version::Two)), bytes),
        ("resources/model.json".to_owned(), whole.to_string().into_bytes()),
    ];
    write(&args.out, &entries)
        .map_err(|error| (Exit::Unavailable, format!("{}: {error}", args.out.display())))?;
    let count = |role| model.variables().iter().filter(|v| v.role == role).count();
    Ok(format!(
        "{}: FMI 2.0, {} inputs, {} outputs, step {} ms",
        args.out.display(),
        count(Role::Input),
        count(Role::Output),
        args.step_ms
    ))
}

/// The library that is packed: beside the executable, or where cargo puts it.
fn library(given: Option<&Path>) -> Result<PathBuf, String> {
    if let Some(given) = given {
        return Ok(given.to_owned());
    }
    let file = "libfmu_export.so";
    let executable = std::env::current_exe().map_err(|error| error.to_string())?;
    let folder = executable.parent().unwrap_or(Path::new("."));
    let places = [folder.join(file), folder.join("deps").join(file), folder.join("../lib").join(file)];
    places.iter().find(|place| place.is_file()).cloned().ok_or_else(|| {
        format!("{file} is not beside the executable ({}): give it with --library", folder.display())
    })
}

/// Whole or not at all.
fn write(out: &Path, entries: &[(String, Vec<u8>)]) -> Result<(), String> {
    let draft = out.with_extension(format!("fmu.{}", std::process::id()));
    let written = (|| {
        let file = std::fs::File::create(&draft).map_err(|e| e.to_string())?;
        let mut zip = zip::ZipWriter::new(file);
        for (name, bytes) in entries {
            zip.start_file(name, zip::write::SimpleFileOptions::default()).map_err(|e| e.to_string())?;
            zip.write_all(bytes).map_err(|e| e.to_string())?;
        }
        zip.finish().map_err(|e| e.to_string())?;
        std::fs::rename(&draft, out).map_err(|e| e.to_string())
    })();
    if written.is_err() {
        let _ = std::fs::remove_file(&draft);
    }
    written
}
