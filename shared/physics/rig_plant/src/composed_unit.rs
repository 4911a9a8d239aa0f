//! A steering unit composed from a functional-model file, in the place of the built-in one.
//!
//! What the model must have (docs/MODELS.md): scalar ports `hand` (torque on the wheel, left turn positive), `left` and
//! `right` (tension of the tie rods along the rack), the input `vehicle_speed` (and, if it wants, `engine_on`, and
//! `assist_request`: the torque at the pinion that an ECU outside asks of its motor), the
//! parameters `upstream_inertia` (what the rig has fixed to the shaft) and `travel` (of the rack for one turn), and the observations `hand_angle`, `hand_speed`,
//! `torsion_torque`, `rack_position`, `rack_velocity`; `assist_force` (at the rack) where there is an assist.
//!
//! The rig's tie rods are springs on the rack, evaluated once a sub-step. The implicit midpoint rule with a force that is
//! held over the step feeds energy into such a spring (growth h w^2/4); a rack position reported half a sub-step ahead,
//! x + v h/2, makes the pair of them the leapfrog, which does not (Hairer, Lubich, Wanner 2006, Geometric Numerical
//! Integration, I.1.4). The built-in unit's semi-implicit Euler reports the same.

use crate::state::{StateReader, StateWriter};
use crate::unit::{SteeringUnitModel, UnitAccount, UnitInput, UnitOutput};
use config::Broken;
use functional_model::{CompileOptions, Compiled, Model, Parameters, STATE_LEN_MAX};

/// Rack travel per radian may differ from what the unit's file states by this part of it.
const RATIO_TOLERANCE: f64 = 0.3;
/// Numbers of the state beside the model's own.
const OWN_STATE: usize = 4;

/// A composed steering unit.
pub struct ComposedUnit {
    model: Compiled,
    inputs: Vec<f64>,
    /// Places of hand, left, right among the inputs.
    ports: [usize; 3],
    vehicle_speed: usize,
    engine_on: Option<usize>,
    assist_request: Option<usize>,
    /// Places of hand_angle, hand_speed, torsion_torque, rack_position, rack_velocity among the outputs.
    reads: [usize; 5],
    assist: Option<usize>,
    ratio: f64,
    /// Response of the rack's velocity to a force, over the sub-step used to find it. [m/(s·N·s)]
    yielding: f64,
    out: UnitOutput,
    account: UnitAccount,
}

impl ComposedUnit {
    /// Composes the unit at rest. `set` replaces parameters (name, expression with unit); `rack_per_radian_m` is what
    /// the unit's file states, signed; `step_s` the sub-step.
    ///
    /// # Errors
    /// Everything the composer finds, what the interface lacks, a state too long for a checkpoint, a rack that does not
    /// move as the unit's file states.
    pub fn new(
        model: &Model,
        set: &[(String, String)],
        upstream_inertia_kg_m2: f64,
        rack_per_radian_m: f64,
        step_s: f64,
    ) -> Result<Self, Vec<Broken>> {
        let mut parameters = Parameters::new();
        for (name, value) in set {
            parameters.set(name, value);
        }
        parameters.set("travel", &format!("{rack_per_radian_m} m/rad"));
        parameters.set("upstream_inertia", &format!("{upstream_inertia_kg_m2} kg*m^2"));
        let told = |errors: Vec<functional_model::ModelError>| -> Vec<Broken> {
            errors.into_iter().map(|e| Broken { key: "model".to_owned(), rule: e.to_string() }).collect()
        };
        let system = model.compose(&parameters).map_err(told)?;
        let compiled =
            system.compile(CompileOptions { account: true, ..CompileOptions::default() }).map_err(told)?;
        let mut unit = Self::connect(compiled, rack_per_radian_m).map_err(|lacks| {
            lacks
                .into_iter()
                .map(|rule| Broken { key: "model".to_owned(), rule: format!("{}: {rule}", model.name()) })
                .collect::<Vec<_>>()
        })?;
        unit.try_out(step_s).map_err(|rule| {
            vec![Broken {
                key: "rack_travel_m_per_rev".to_owned(),
                rule: format!("{}: {rule}", model.name()),
            }]
        })?;
        Ok(unit)
    }

    fn connect(model: Compiled, ratio: f64) -> Result<Self, Vec<String>> {
        let mut lacks = Vec::new();
        let names = model.input_names();
        let mut port = |name: &str| {
            let of = |n: &&String| n.split_once('.').is_some_and(|(first, _)| first == name);
            let places: Vec<usize> = (0..names.len()).filter(|k| of(&&names[*k])).collect();
            if let [one] = places[..] {
                return one;
            }
            lacks.push(format!("a steering unit needs a scalar port '{name}' that takes a torque or force"));
            0
        };
        let ports = ["hand", "left", "right"].map(&mut port);
        let input = |name: &str| names.iter().position(|n| n == name);
        let vehicle_speed = input("vehicle_speed").unwrap_or_else(|| {
            lacks.push("a steering unit needs the input 'vehicle_speed' in m/s".to_owned());
            0
        });
        let engine_on = input("engine_on");
        let assist_request = input("assist_request");
        for (k, name) in names.iter().enumerate() {
            if !ports.contains(&k)
                && k != vehicle_speed
                && ![engine_on, assist_request].contains(&Some(k))
                && lacks.is_empty()
            {
                lacks.push(format!(
                    "the rig gives nothing to '{name}': a steering unit takes hand, left, right, vehicle_speed, engine_on and assist_request"
                ));
            }
        }
        let mut read = |name: &str| {
            model.output_index(name).unwrap_or_else(|| {
                lacks.push(format!("a steering unit needs the observation '{name}'"));
                0
            })
        };
        let reads =
            ["hand_angle", "hand_speed", "torsion_torque", "rack_position", "rack_velocity"].map(&mut read);
        if model.state_len() + OWN_STATE > STATE_LEN_MAX {
            lacks.push(format!(
                "the state takes {} numbers, at most {STATE_LEN_MAX} fit a checkpoint",
                model.state_len() + OWN_STATE
            ));
        }
        if !lacks.is_empty() {
            return Err(lacks);
        }
        let assist = model.output_index("assist_force");
        let mut inputs = vec![0.0; names.len()];
        if let Some(k) = engine_on {
            inputs[k] = 1.0;
        }
        let mut unit = Self {
            inputs,
            ports,
            vehicle_speed,
            engine_on,
            assist_request,
            reads,
            assist,
            ratio,
            yielding: 0.0,
            out: UnitOutput::default(),
            account: UnitAccount::default(),
            model,
        };
        unit.rest();
        Ok(unit)
    }

    /// Finds how the rack yields to a force, and whether it follows the wheel as stated.
    fn try_out(&mut self, step_s: f64) -> Result<(), String> {
        let speed_after = |unit: &mut Self, force: f64| {
            unit.rest();
            let input = UnitInput { rack_force_n: force, engine_on: true, ..UnitInput::default() };
            unit.step(&input, step_s);
            unit.out.rack_velocity_m_s
        };
        let (idle, pushed) = (speed_after(self, 0.0), speed_after(self, 1.0));
        self.yielding = (pushed - idle).abs() / step_s;
        self.rest();
        let turn = UnitInput { hand_wheel_torque_n_m: 8.0, engine_on: true, ..UnitInput::default() };
        let most = (1.0 / step_s) as usize;
        for _ in 0..most.min(100_000) {
            self.step(&turn, step_s);
            if self.out.hand_wheel_angle_rad.abs() > 1.0 {
                break;
            }
        }
        let (angle, rack) = (self.out.hand_wheel_angle_rad, self.out.rack_displacement_m);
        self.rest();
        let mut faults = Vec::new();
        if angle.is_nan() || angle < 0.1 {
            faults.push(format!(
                "a torque of 8 N*m to the left on the wheel turned it by {angle:.3} rad within 1 s: \
                 a steering unit turns left"
            ));
        }
        // A pinion of the wrong hand against an assist of the right one may turn the wheel either way: that is told too.
        let moved = rack / angle;
        let off = (moved / self.ratio - 1.0).abs();
        if angle.abs() >= 0.1 && (off.is_nan() || off > RATIO_TOLERANCE) {
            let turn = core::f64::consts::TAU;
            faults.push(format!(
                "the model's rack moves {:.4} m for one turn of the wheel; the unit's file states {:.4} m/rev",
                moved * turn,
                self.ratio * turn
            ));
        }
        if faults.is_empty() { Ok(()) } else { Err(faults.join("; ")) }
    }

    fn rest(&mut self) {
        self.model.reset();
        self.out = UnitOutput::default();
        self.account = UnitAccount::default();
        self.read(0.0);
    }

    /// Outputs, the rack half a sub-step ahead.
    fn read(&mut self, step_s: f64) {
        let v = self.model.outputs();
        let [angle, rate, torque, rack, speed] = self.reads.map(|k| v[k]);
        let o = &mut self.out;
        if step_s > 0.0 {
            o.hand_wheel_acceleration_rad_s2 = (rate - o.hand_wheel_rate_rad_s) / step_s;
        }
        o.hand_wheel_angle_rad = angle;
        o.hand_wheel_rate_rad_s = rate;
        o.torsion_bar_torque_n_m = torque;
        o.rack_displacement_m = rack + 0.5 * step_s * speed;
        o.rack_velocity_m_s = speed;
        o.assist_force_n = self.assist.map_or(0.0, |k| v[k]);
        if let Some(a) = self.model.account() {
            let to = &mut self.account;
            (to.power_flow_w, to.power_residual_w) = (0.0, 0.0);
            for (residual, flow) in a.residual_w.iter().zip(&a.flowing_w) {
                to.power_residual_w = to.power_residual_w.max(residual.abs());
                to.power_flow_w = to.power_flow_w.max(*flow);
            }
            to.stored_j = a.stored_j;
            to.entered_j = a.entered_j;
            to.supplied_j = a.supplied_j;
            to.lost_j = a.lost_j;
            to.imbalance_j = a.imbalance_j();
        }
    }
}

impl SteeringUnitModel for ComposedUnit {
    fn step(&mut self, input: &UnitInput, step_s: f64) {
        let [hand, left, right] = self.ports;
        self.inputs[hand] = input.hand_wheel_torque_n_m;
        // Both ends of the rack move alike: how the force is shared between them changes nothing.
        self.inputs[left] = 0.5 * input.rack_force_n;
        self.inputs[right] = -0.5 * input.rack_force_n;
        self.inputs[self.vehicle_speed] = input.vehicle_speed_m_s;
        if let Some(k) = self.engine_on {
            self.inputs[k] = f64::from(u8::from(input.engine_on));
        }
        if let Some(k) = self.assist_request {
            self.inputs[k] = input.assist_request_n_m.unwrap_or(0.0);
        }
        let status = self.model.step(&self.inputs, step_s);
        let fault = status.not_converged || status.state_held || status.input_held;
        self.account.fault_count += f64::from(u8::from(fault));
        self.read(step_s);
    }

    fn output(&self) -> &UnitOutput {
        &self.out
    }

    fn takes_assist_request(&self) -> bool {
        self.assist_request.is_some()
    }

    fn rack_per_radian_m(&self) -> f64 {
        self.ratio
    }

    fn frequency_max_rad_s(&self, rack_stiffness_n_m: f64) -> f64 {
        // Inside, the step is implicit: only the spring of the rig against the rack limits the sub-step.
        (rack_stiffness_n_m * self.yielding).sqrt()
    }

    fn state_len(&self) -> usize {
        self.model.state_len() + OWN_STATE
    }

    fn save(&self, out: &mut StateWriter) {
        let mut saved = [0.0; STATE_LEN_MAX];
        let saved = &mut saved[..self.model.state_len()];
        self.model.save_state(saved);
        out.put_all(saved);
        out.put_all(&[
            1.0,
            self.out.hand_wheel_acceleration_rad_s2,
            self.out.rack_displacement_m,
            self.account.fault_count,
        ]);
    }

    /// A state of zeros is the state at rest, as the rig uses it.
    fn load(&mut self, from: &mut StateReader) {
        let mut saved = [0.0; STATE_LEN_MAX];
        let saved = &mut saved[..self.model.state_len()];
        from.take_all(saved);
        let [valid, acceleration, rack, faults] = from.take_array();
        if valid == 0.0 {
            self.rest();
            return;
        }
        self.model.load_state(saved);
        self.read(0.0);
        self.out.hand_wheel_acceleration_rad_s2 = acceleration;
        self.out.rack_displacement_m = rack;
        self.account.fault_count = faults;
    }

    fn account(&self) -> Option<&UnitAccount> {
        Some(&self.account)
    }
}
