//! The car's driveline as a functional model: it takes the wheels' speeds and gives the torques of the half shafts, one
//! tick later. Transmission control (gear, lock-up, pedal) stays the car's. The half shafts' stiffness against the
//! wheels' inertia is slow against the tick, so the exchange is stable.

use crate::AssemblyError;
use config::ResolvedBench;
use config::car::DrivenAxle;
use functional_model::{CompileOptions, Compiled, Model, Parameters};
use vehicle::{DriveDemand, OutsideDrive, WHEELS};

/// How long it may run before the car, to find its place at the first speed. [s]
const SETTLE_S: f64 = 3.0;
/// Inputs, outputs.
const TAKES: [&str; 5] = ["pedal", "ratio", "lock_up", "left", "right"];
const GIVES: [&str; 4] = ["left_torque", "right_torque", "engine_speed", "engine_torque"];

/// A composed driveline on one axle.
pub(crate) struct ComposedDriveline {
    model: Compiled,
    inputs: Vec<f64>,
    takes: [usize; 5],
    gives: [usize; 4],
    first_wheel: usize,
    neutral: bool,
}

impl ComposedDriveline {
    /// The car's driveline model, if its file names one.
    ///
    /// # Errors
    /// Everything that is wrong with the model, and what it lacks.
    pub fn new(resolved: &ResolvedBench) -> Result<Option<Self>, AssemblyError> {
        let (Some(named), Some(files)) = (&resolved.car.driveline, &resolved.driveline_model) else {
            return Ok(None);
        };
        let refused = |errors: Vec<functional_model::ModelError>| AssemblyError::new("driveline", errors);
        let model = Model::from_toml(&files.main.text, &files.main.name, &|name| files.part(name))
            .map_err(refused)?;
        let mut parameters = Parameters::new();
        for (name, value) in named.set.iter().flatten() {
            parameters.set(name, value);
        }
        let model = model
            .compose(&parameters)
            .and_then(|system| system.compile(CompileOptions::default()))
            .map_err(refused)?;
        let mut lacks = Vec::new();
        let takes = TAKES.map(|wanted| {
            let is = |n: &String| n == wanted || n.split_once('.').is_some_and(|(port, _)| port == wanted);
            model.input_names().iter().position(is).unwrap_or_else(|| {
                lacks.push(format!("{}: a driveline needs the input or port '{wanted}'", files.main.name));
                0
            })
        });
        let gives = GIVES.map(|wanted| {
            model.output_index(wanted).unwrap_or_else(|| {
                lacks.push(format!("{}: a driveline needs the observation '{wanted}'", files.main.name));
                0
            })
        });
        if !lacks.is_empty() {
            return Err(AssemblyError::new("driveline", lacks));
        }
        let first_wheel = match named.driven {
            DrivenAxle::Front => 0,
            DrivenAxle::Rear => 2,
        };
        let inputs = vec![0.0; model.input_names().len()];
        Ok(Some(Self { model, inputs, takes, gives, first_wheel, neutral: false }))
    }

    /// From its start values to rest at the wheels' speeds.
    pub fn settle(&mut self, spin: &[f64; WHEELS], demand: &DriveDemand, period_s: f64) -> OutsideDrive {
        self.model.reset();
        let steps = (SETTLE_S / period_s) as u32;
        for _ in 0..steps {
            self.step(spin, demand, period_s);
        }
        self.drive()
    }

    /// One tick at the wheels' speeds.
    pub fn step(&mut self, spin: &[f64; WHEELS], demand: &DriveDemand, period_s: f64) -> OutsideDrive {
        let wheels = [spin[self.first_wheel], spin[self.first_wheel + 1]];
        let values = [demand.pedal, demand.ratio, demand.lock_up, wheels[0], wheels[1]];
        for (at, value) in self.takes.iter().zip(values) {
            self.inputs[*at] = value;
        }
        self.neutral = demand.ratio == 0.0;
        self.model.step(&self.inputs, period_s);
        self.drive()
    }

    fn drive(&self) -> OutsideDrive {
        let [left, right, engine_rad_s, engine_n_m] = self.gives.map(|k| self.model.outputs()[k]);
        let mut wheel_n_m = [0.0; WHEELS];
        if !self.neutral {
            (wheel_n_m[self.first_wheel], wheel_n_m[self.first_wheel + 1]) = (left, right);
        }
        OutsideDrive { wheel_n_m, engine_rad_s, engine_n_m }
    }

    /// Numbers of its state.
    pub fn state_len(&self) -> usize {
        self.model.state_len() + 1
    }

    /// Writes its state.
    pub fn save_state(&self, to: &mut [f64]) {
        let len = self.model.state_len();
        self.model.save_state(&mut to[..len]);
        to[len] = f64::from(u8::from(self.neutral));
    }

    /// Continues from a state.
    pub fn load_state(&mut self, from: &[f64]) -> OutsideDrive {
        let len = self.model.state_len();
        self.model.load_state(&from[..len]);
        self.neutral = from[len] != 0.0;
        self.drive()
    }
}
