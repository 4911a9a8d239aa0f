//! An instance that is stepped: inputs in, a step, outputs out. No heap of ours in a step.

use crate::FmuError;
use crate::binary::{Interpreter, Slave};
use crate::bind::{Port, Setup, Value};
use crate::description::Kind;
use crate::units::Conversion;

/// What a step of an FMU cost.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cost {
    /// Time in the FMU: set, step, get. [s], NaN where no clock was read
    pub seconds: f64,
    /// Calls of malloc, calloc, realloc and their like in the process during the step.
    pub allocations: u64,
}

/// Whatever steps an FMU: here, in a process of its own, or something that takes its place.
pub trait Stepper: Send {
    /// Steps from `time_s` by `step_s`. `inputs` and `outputs` are in the bench's units.
    ///
    /// # Errors
    /// [`FmuError`]; the instance is of no use behind it.
    fn step(
        &mut self,
        time_s: f64,
        step_s: f64,
        inputs: &[f64],
        outputs: &mut [f64],
    ) -> Result<Cost, FmuError>;
}

/// Ports of one direction: Float64 in one call, the others one by one.
#[derive(Debug)]
struct Ports {
    floats: Vec<u32>,
    at: Vec<(usize, Conversion)>,
    values: Vec<f64>,
    others: Vec<(usize, Port)>,
}

impl Ports {
    fn new(ports: &[Port]) -> Self {
        let of =
            |float: bool| ports.iter().enumerate().filter(move |(_, p)| (p.kind == Kind::Float64) == float);
        let floats: Vec<u32> = of(true).map(|(_, p)| p.reference).collect();
        Ports {
            values: vec![0.0; floats.len()],
            floats,
            at: of(true).map(|(i, p)| (i, p.conversion)).collect(),
            others: of(false).map(|(i, p)| (i, p.clone())).collect(),
        }
    }
}

/// An initialised instance in this process.
#[derive(Debug)]
pub struct Runner {
    // Before the interpreter: what it loaded goes first.
    slave: Slave,
    inputs: Ports,
    outputs: Ports,
    _interpreter: Option<Interpreter>,
}

impl Runner {
    /// Loads, instantiates, sets start values and initialises.
    ///
    /// # Errors
    /// [`FmuError`].
    pub fn new(setup: &Setup) -> Result<Self, FmuError> {
        let interpreter = setup.interpreter.as_deref().map(Interpreter::load).transpose()?;
        let library = setup.folder.join(&setup.binary);
        let resources = setup.folder.join("resources");
        let slave = Slave::new(setup.version, &library, &setup.name, &setup.token, &resources)?;
        let mut runner = Runner {
            slave,
            inputs: Ports::new(&setup.inputs),
            outputs: Ports::new(&setup.outputs),
            _interpreter: interpreter,
        };
        runner.initialise(setup)?;
        Ok(runner)
    }

    fn initialise(&mut self, setup: &Setup) -> Result<(), FmuError> {
        for (reference, kind, value) in &setup.start {
            match value {
                Value::Number(number) => self.slave.set(*kind, *reference, *number)?,
                Value::Text(text) => self.slave.set_text(*reference, text)?,
            }
        }
        self.slave.enter(setup.start_s)?;
        self.slave.exit()
    }

    /// Begins anew, as behind the instantiation with the same start values.
    ///
    /// # Errors
    /// [`FmuError`].
    pub fn reset(&mut self, setup: &Setup) -> Result<(), FmuError> {
        self.slave.reset()?;
        self.initialise(setup)
    }

    /// What the binary calls its version of FMI.
    #[must_use]
    pub fn version(&self) -> String {
        self.slave.version()
    }
}

impl Stepper for Runner {
    fn step(
        &mut self,
        time_s: f64,
        step_s: f64,
        inputs: &[f64],
        outputs: &mut [f64],
    ) -> Result<Cost, FmuError> {
        let ports = &mut self.inputs;
        for (value, (at, conversion)) in ports.values.iter_mut().zip(&ports.at) {
            *value = conversion.apply(inputs[*at]);
        }
        self.slave.set_floats(&ports.floats, &ports.values)?;
        for (at, port) in &ports.others {
            self.slave.set(port.kind, port.reference, port.conversion.apply(inputs[*at]))?;
        }
        self.slave.step(time_s, step_s)?;
        let ports = &mut self.outputs;
        self.slave.get_floats(&ports.floats, &mut ports.values)?;
        for (value, (at, conversion)) in ports.values.iter().zip(&ports.at) {
            outputs[*at] = conversion.apply(*value);
        }
        for (at, port) in &ports.others {
            outputs[*at] = port.conversion.apply(self.slave.get(port.kind, port.reference)?);
        }
        Ok(Cost { seconds: f64::NAN, allocations: 0 })
    }
}

/// The shared library of the Python that `python3` is, for FMUs that need an interpreter in their process.
#[must_use]
pub fn interpreter() -> Option<std::path::PathBuf> {
    let script = "import os, sysconfig as s; print(os.path.join(s.get_config_var('LIBDIR'), \
                  s.get_config_var('INSTSONAME')))";
    let told = std::process::Command::new("python3").args(["-c", script]).output().ok()?;
    let path = std::path::PathBuf::from(String::from_utf8_lossy(&told.stdout).trim());
    path.is_file().then_some(path)
}
