//! The payloads: what each service says about a tick.
//!
//! Every payload opens with its tick and flags; the ticks of the inputs it used make a real-time log
//! replay bit-exactly. Wall-clock timings are kept apart in [`Timing`], so that all other regions of two
//! lockstep runs are equal bit for bit. Frames and signs: ISO 8855, see ARCHITECTURE.md.

use crate::layout::payload;

/// An input's tick when none was ever read.
pub const NO_TICK: u64 = u64::MAX;

payload! {
    /// What the operator and the supervisor ask of the bench, and what they know of the services.
    Bench version 1 {
        /// Tick this was published for.
        tick: u64 One "1",
        /// Request: 0 none, 1 arm, 2 start, 3 stop, 4 acknowledge, 5 off.
        request: u64 One "1",
        /// Raised with each new request, so that the same request can be made twice.
        request_count: u64 One "1",
        /// 1 while the emergency stop is pressed.
        emergency_stop: u64 One "1",
        /// First tick that is no longer part of the run, u64::MAX while that is open.
        end_tick: u64 One "1",
        /// Tick at which the manoeuvre's clock starts, u64::MAX until the operator starts it.
        manoeuvre_start_tick: u64 One "1",
        /// 1 for each service that is alive.
        alive: u64 Service "1",
        /// Restarts of each service since the run began.
        restarts: u64 Service "1",
    }
}

payload! {
    /// What the rig's sensors said at the start of the tick.
    RigMeasurement version 2 {
        /// Tick.
        tick: u64 One "1",
        /// Time of the sample since the start of the run.
        time_s: f64 One "s",
        /// Bits: see `rig_flags`.
        flags: u64 One "1",
        /// Sensor plausibility faults as bits, 0 when all are believed.
        sensor_faults: u64 One "1",
        /// Hand-wheel angle, left turn positive.
        steering_wheel_angle_rad: f64 One "rad",
        /// Hand-wheel torque, the driver's, left turn positive.
        steering_wheel_torque_n_m: f64 One "N*m",
        /// Torsion-bar torque.
        torsion_bar_torque_n_m: f64 One "N*m",
        /// Assist torque or force as its motor torque at the pinion.
        assist_torque_n_m: f64 One "N*m",
        /// Rack displacement, left positive: potentiometer and pinion joined, what the models take.
        rack_displacement_m: f64 One "m",
        /// Reading of the rack's potentiometer, left positive.
        rack_potentiometer_m: f64 One "m",
        /// Rack speed, left positive, from the displacement.
        rack_speed_m_s: f64 One "m/s",
        /// Tie-rod axial force, tension positive.
        tie_rod_force_n: f64 Side "N",
        /// Force cell of the horizontal actuator.
        actuator_force_n: f64 Side "N",
        /// Stroke of the horizontal actuator.
        horizontal_stroke_m: f64 Side "m",
        /// Stroke of the vertical actuator: the tie rod's outer ball height relative to the body, minus design.
        vertical_stroke_m: f64 Side "m",
    }
}

payload! {
    /// The car at the end of the tick.
    VehicleState version 2 {
        /// Tick.
        tick: u64 One "1",
        /// Time the state is valid for: the end of the tick.
        time_s: f64 One "s",
        /// Bits: see `model_flags`.
        flags: u64 One "1",
        /// Tick of the rig measurement used.
        used_rig_measurement: u64 One "1",
        /// Inputs held, late or refused since the start.
        held_count: u64 One "1",
        /// Version of the live parameters this tick was stepped with, 0 before any were read.
        parameters_version: u64 One "1",
        /// 1 while the manoeuvre steers.
        manoeuvre_active: u64 One "1",
        /// Who turns the hand wheel: 0 nobody (hands off, or a human at the rig), 1 the steer actuator to the angle.
        hand_wheel_mode: u64 One "1",
        /// Hand-wheel angle the manoeuvre asks for, left turn positive.
        steering_wheel_angle_command_rad: f64 One "rad",
        /// Its rate.
        steering_wheel_rate_command_rad_s: f64 One "rad/s",
        /// Speed the manoeuvre asks for.
        target_speed_m_s: f64 One "m/s",
        /// Rack displacement used by the model.
        rack_displacement_m: f64 Side "m",
        /// Throttle, 0 to 1.
        throttle_ratio: f64 One "1",
        /// Master-cylinder pressure.
        brake_pressure_pa: f64 One "Pa",
        /// Gear engaged, 0 neutral, negative reverse.
        gear: f64 One "1",
        /// Engine speed.
        engine_speed_rad_s: f64 One "rad/s",
        /// Position of the centre of gravity in the global frame.
        position_m: f64 Xyz "m",
        /// Roll angle, right side down positive.
        roll_rad: f64 One "rad",
        /// Pitch angle, nose down positive.
        pitch_rad: f64 One "rad",
        /// Yaw angle, left positive.
        yaw_rad: f64 One "rad",
        /// Velocity of the centre of gravity in the body frame.
        velocity_m_s: f64 Xyz "m/s",
        /// Angular velocity in the body frame.
        angular_velocity_rad_s: f64 Xyz "rad/s",
        /// Acceleration at the accelerometer: longitudinal, lateral, vertical.
        acceleration_m_s2: f64 Xyz "m/s^2",
        /// Side-slip angle at the centre of gravity.
        side_slip_rad: f64 One "rad",
        /// Tyre force in the tyre's axes.
        tyre_force_n: f64 WheelXyz "N",
        /// Tyre moment in the tyre's axes: overturning, rolling resistance, aligning.
        tyre_moment_n_m: f64 WheelXyz "N*m",
        /// Longitudinal slip, driving positive.
        slip_ratio: f64 Wheel "1",
        /// Slip angle; negative gives a force to the left.
        slip_angle_rad: f64 Wheel "rad",
        /// Road-wheel steer angle, left positive.
        steer_rad: f64 Wheel "rad",
        /// Toe as used by the car, toe-in positive.
        toe_rad: f64 Wheel "rad",
        /// Camber, top outward positive.
        camber_rad: f64 Wheel "rad",
        /// Spin speed.
        wheel_speed_rad_s: f64 Wheel "rad/s",
        /// Brake torque.
        brake_torque_n_m: f64 Wheel "N*m",
        /// Wheel-centre force the wheel hands the knuckle, knuckle frame.
        wheel_centre_force_n: f64 WheelXyz "N",
        /// Wheel-centre moment the wheel hands the knuckle, knuckle frame, without drive-shaft torque.
        wheel_centre_moment_n_m: f64 WheelXyz "N*m",
        /// Wheel-centre height, global frame.
        wheel_centre_height_m: f64 Wheel "m",
        /// Wheel-centre height relative to the body, minus design.
        wheel_travel_m: f64 Wheel "m",
        /// Its rate.
        wheel_travel_speed_m_s: f64 Wheel "m/s",
        /// Vertical acceleration of the wheel.
        wheel_vertical_acceleration_m_s2: f64 Wheel "m/s^2",
        /// Moment about the kingpin by the car's own maps.
        kingpin_moment_n_m: f64 Side "N*m",
        /// The user's outputs in the order of the scenario, each in its unit there; unused ones NaN.
        user_output: f64 Index(16) "user",
    }
}

payload! {
    /// The front suspension at the end of the tick, and what it asks of the rig.
    SuspensionState version 1 {
        /// Tick.
        tick: u64 One "1",
        /// Time the state is valid for: the end of the tick.
        time_s: f64 One "s",
        /// Bits: see `model_flags`.
        flags: u64 One "1",
        /// Tick of the rig measurement used.
        used_rig_measurement: u64 One "1",
        /// Tick of the vehicle state used.
        used_vehicle_state: u64 One "1",
        /// Inputs held, late or refused since the start.
        held_count: u64 One "1",
        /// Version of the live parameters this tick was stepped with, 0 before any were read.
        parameters_version: u64 One "1",
        /// Solver status: 0 converged, else the code of what held the last pose.
        solver_status: u64 One "1",
        /// Newton iterations.
        iterations: u64 One "1",
        /// Largest constraint residual left.
        residual_m: f64 One "m",
        /// Rack displacement used.
        rack_displacement_m: f64 One "m",
        /// Tie-rod axial force command, tension positive.
        tie_rod_force_n: f64 Side "N",
        /// Tie rod's outer ball, body frame.
        tie_rod_ball_m: f64 SideXyz "m",
        /// Its velocity.
        tie_rod_ball_velocity_m_s: f64 SideXyz "m/s",
        /// Height of the outer ball minus design: the vertical actuators' command.
        ball_height_m: f64 Side "m",
        /// Its rate.
        ball_height_speed_m_s: f64 Side "m/s",
        /// Wheel centre, body frame.
        wheel_centre_m: f64 SideXyz "m",
        /// Knuckle orientation relative to the body, scalar first.
        knuckle_quaternion: f64 SideQuaternion "1",
        /// Steer angle, left positive.
        steer_rad: f64 Side "rad",
        /// Toe, toe-in positive.
        toe_rad: f64 Side "rad",
        /// Camber, top outward positive.
        camber_rad: f64 Side "rad",
        /// Caster, top rearward positive.
        caster_rad: f64 Side "rad",
        /// Kingpin inclination, top inward positive.
        kingpin_inclination_rad: f64 Side "rad",
        /// Moment of the wheel forces about the kingpin.
        kingpin_moment_n_m: f64 Side "N*m",
        /// Spring or strut force, tension positive.
        spring_force_n: f64 Side "N",
        /// Force the rack drive must apply to the rack, left positive.
        rack_force_n: f64 One "N",
        /// Toe of the car's maps minus the solver's.
        toe_map_error_rad: f64 Side "rad",
        /// Camber of the car's maps minus the solver's.
        camber_map_error_rad: f64 Side "rad",
    }
}

payload! {
    /// What the rig did in the tick: commands that reached the plant, safety, energy.
    RigStatus version 3 {
        /// Tick.
        tick: u64 One "1",
        /// Time the command acted.
        time_s: f64 One "s",
        /// Bits: see `rig_flags`.
        flags: u64 One "1",
        /// Tick of the suspension state applied.
        used_suspension_state: u64 One "1",
        /// Tick of the vehicle state applied.
        used_vehicle_state: u64 One "1",
        /// Tick of the bench request seen.
        used_bench: u64 One "1",
        /// Tick of the word of the ECU on the bus that was used.
        used_can: u64 One "1",
        /// Version of the live parameters this tick was stepped with, 0 before any were read.
        parameters_version: u64 One "1",
        /// Bench state: 0 off, 1 idle, 2 armed, 3 starting, 4 running, 5 holding, 6 resuming, 7 stopping, 8 tripped.
        state: u64 One "1",
        /// Trip code, 0 none.
        trip_code: u64 One "1",
        /// Tick of the trip.
        trip_tick: u64 One "1",
        /// The limit that tripped.
        trip_limit: f64 One "SI",
        /// The value that tripped it.
        trip_value: f64 One "SI",
        /// Output phases in a row without a fresh command.
        stale_count: u64 One "1",
        /// Commands that were not there at the output phase since the start.
        late_command_count: u64 One "1",
        /// Commands clamped by safety, as bits of this tick.
        clamped: u64 One "1",
        /// Fade of the tie-rod force, 0 to 1.
        force_fade_ratio: f64 One "1",
        /// Tie-rod force asked for by the suspension.
        tie_rod_force_command_n: f64 Side "N",
        /// Tie-rod force after fade and clamping, as the controller saw it.
        tie_rod_force_applied_n: f64 Side "N",
        /// Ball height the controller saw.
        ball_height_applied_m: f64 Side "m",
        /// Hand-wheel angle command the steer actuator saw.
        steering_wheel_angle_applied_rad: f64 One "rad",
        /// Valve command of the horizontal actuators.
        horizontal_valve_ratio: f64 Side "1",
        /// Valve command of the vertical actuators.
        vertical_valve_ratio: f64 Side "1",
        /// Torque command of the steer actuator.
        steer_torque_command_n_m: f64 One "N*m",
        /// Torque at the pinion given to the unit's assist motor for the ECU on the bus; NaN where that does not drive it.
        assist_request_n_m: f64 One "N*m",
        /// Energy fed into the steering at the tie-rod ports by the tracking error, since the start.
        port_energy_j: f64 One "J",
        /// The same over the last full steering cycle.
        port_energy_cycle_j: f64 One "J",
        /// The same, per second, over the last second.
        port_power_w: f64 One "W",
        /// Estimated delay from force command to measured force.
        loop_delay_s: f64 One "s",
        /// True tie-rod force of the virtual plant, NaN on hardware.
        true_tie_rod_force_n: f64 Side "N",
        /// True rack displacement of the virtual plant, NaN on hardware.
        true_rack_displacement_m: f64 One "m",
        /// Largest power at one joint of a composed steering unit; NaN where there is none, as for all that follow.
        unit_power_flow_w: f64 One "W",
        /// Largest sum of the powers at one joint of it: 0 but for rounding.
        unit_power_residual_w: f64 One "W",
        /// Energy stored in it.
        unit_stored_j: f64 One "J",
        /// Energy that entered it through hand wheel and rack since the start.
        unit_entered_j: f64 One "J",
        /// Energy its motors and pumps supplied since the start.
        unit_supplied_j: f64 One "J",
        /// Energy it lost since the start.
        unit_lost_j: f64 One "J",
        /// What this account does not explain: 0 but for rounding.
        unit_imbalance_j: f64 One "J",
        /// Sub-steps of it that held a value: a solve failed, or a value was not finite.
        unit_fault_count: u64 One "1",
    }
}

payload! {
    /// When a service ran, by the wall clock. Never part of a comparison of lockstep runs.
    Timing version 1 {
        /// Tick.
        tick: u64 One "1",
        /// Writer's epoch: raised by each restart.
        epoch: u64 One "1",
        /// Wake-up after the time aimed at.
        wake_lateness_s: f64 One "s",
        /// Start of the step after the start of the tick.
        start_s: f64 One "s",
        /// Time the step took.
        compute_s: f64 One "s",
        /// End of the step after the start of the tick.
        done_s: f64 One "s",
        /// Time left before what was published is used, negative when late; NaN for the rig.
        margin_s: f64 One "s",
        /// Rig only: start of the output phase's work after the phase.
        output_lateness_s: f64 One "s",
        /// Rig only: time the output phase's work took.
        output_compute_s: f64 One "s",
        /// Wake-ups later than a tenth of the period since the start.
        late_wake_count: u64 One "1",
        /// Steps that ran past their share of the period since the start.
        overrun_count: u64 One "1",
        /// Ticks stepped from held inputs, or skipped, since the start.
        missed_count: u64 One "1",
        /// Ticks stepped late to catch up since the start.
        caught_up_count: u64 One "1",
    }
}

payload! {
    /// What the CAN bus brought and how it does. Values are NaN while their message is absent or implausible.
    Can version 1 {
        /// Tick.
        tick: u64 One "1",
        /// Time of the look at the bus since the start of the run.
        time_s: f64 One "s",
        /// Bits: see `can_flags`.
        flags: u64 One "1",
        /// Tick of the rig measurement sent.
        used_rig_measurement: u64 One "1",
        /// Tick of the vehicle state sent.
        used_vehicle_state: u64 One "1",
        /// Frames sent since the start.
        sent_count: u64 One "1",
        /// Frames received since the start.
        received_count: u64 One "1",
        /// Frames that the bus refused.
        refused_count: u64 One "1",
        /// Cycles of messages not sent because a variable was absent.
        withheld_count: u64 One "1",
        /// Cycles of messages left out because the service came late.
        skipped_count: u64 One "1",
        /// Signals clamped to their range.
        clamped_count: u64 One "1",
        /// Frames touched by injected faults.
        injected_count: u64 One "1",
        /// Frames of messages that the mapping does not name.
        unknown_count: u64 One "1",
        /// Error frames of the controller and failed accesses.
        bus_error_count: u64 One "1",
        /// Status of each message received, in the mapping's order, as bits: see `can_status`.
        message_status: u64 Index(16) "1",
        /// Age of each message's last good frame, NaN before the first.
        message_age_s: f64 Index(16) "s",
        /// Good frames.
        message_good_count: u64 Index(16) "1",
        /// Frames with wrong checksum, counter value, Data ID or length.
        message_wrong_count: u64 Index(16) "1",
        /// Frames repeated or out of sequence.
        message_sequence_count: u64 Index(16) "1",
        /// Frames known to be lost from the steps of the counter.
        message_lost_count: u64 Index(16) "1",
        /// Implausible values.
        message_implausible_count: u64 Index(16) "1",
        /// Times the message timed out.
        message_timeout_count: u64 Index(16) "1",
        /// State of the ECU as its message says.
        ecu_state: f64 One "1",
        /// Driver's torque by the ECU, left positive.
        ecu_driver_torque_n_m: f64 One "N*m",
        /// Assist torque by the ECU, left positive.
        ecu_assist_torque_n_m: f64 One "N*m",
        /// Steering angle by the ECU, left positive.
        ecu_steering_angle_rad: f64 One "rad",
        /// Rack force estimated by the ECU, left positive.
        ecu_rack_force_n: f64 One "N",
        /// Temperature of the ECU.
        ecu_temperature_k: f64 One "K",
        /// Supply voltage at the ECU.
        ecu_supply_v: f64 One "V",
        /// Supply current of the ECU.
        ecu_supply_a: f64 One "A",
        /// Checksum errors that the ECU counted on what it received.
        ecu_checksum_errors: f64 One "1",
        /// Sequence errors that the ECU counted.
        ecu_sequence_errors: f64 One "1",
        /// Time-outs that the ECU counted.
        ecu_timeouts: f64 One "1",
        /// Lost frames that the ECU counted.
        ecu_lost_frames: f64 One "1",
        /// Values for whatever else the mapping receives.
        value: f64 Index(16) "SI",
    }
}

payload! {
    /// How far the logger is.
    LoggerStatus version 1 {
        /// Count of this status: it is published when there is news, not each tick.
        tick: u64 One "1",
        /// Ticks below this one are read of each region that is written every tick.
        read_tick: u64 One "1",
        /// Ticks below this one are flushed to the file.
        written_tick: u64 One "1",
        /// Messages written.
        message_count: u64 One "1",
        /// Ticks overwritten before they were read: lost.
        lost_count: u64 One "1",
        /// Ticks their writers skipped.
        missing_count: u64 One "1",
        /// Writes the disk refused.
        write_error_count: u64 One "1",
        /// Bytes written.
        byte_count: u64 One "B",
    }
}

payload! {
    /// The vehicle service's complete state at the end of the tick.
    VehicleCheckpoint version 1 {
        /// Tick.
        tick: u64 One "1",
        /// Words of `state` in use.
        len: u64 One "1",
        /// Counters that go on after a restart.
        counters: u64 Index(6) "1",
        /// State of vehicle and manoeuvre, in the order the models define.
        state: f64 Index(248) "SI",
    }
}

payload! {
    /// The multibody service's complete state at the end of the tick.
    MultibodyCheckpoint version 1 {
        /// Tick.
        tick: u64 One "1",
        /// Words of `state` in use.
        len: u64 One "1",
        /// Counters that go on after a restart.
        counters: u64 Index(6) "1",
        /// State of the suspension, in the order the model defines.
        state: f64 Index(504) "SI",
    }
}

payload! {
    /// Live parameters: the values in force from the tick on.
    Parameters version 1 {
        /// Tick from which they hold.
        tick: u64 One "1",
        /// Raised with every accepted change.
        version: u64 One "1",
        /// Values in the order of the parameter list.
        value: f64 Index(62) "SI",
    }
}

payload! {
    /// A fault that a campaign asks of a service, obeyed by the service itself at the ticks named.
    Fault version 1 {
        /// Number of the order.
        tick: u64 One "1",
        /// Service: 0 rig, 1 vehicle, 2 multibody, 3 logger, 4 CAN.
        target: u64 One "1",
        /// What: see `fault_kind`.
        kind: u64 One "1",
        /// First tick of it.
        from_tick: u64 One "1",
        /// First tick after it.
        end_tick: u64 One "1",
        /// What it needs to know, by kind.
        value: f64 Index(4) "SI",
    }
}

/// Kinds of [`Fault::kind`] and what [`Fault::value`] holds for each.
pub mod fault_kind {
    /// Compute for `value[0]` seconds before the step of the first tick.
    pub const STALL: u64 = 1;
    /// Start each step only at the fraction `value[0]` of the period.
    pub const LATE: u64 = 2;
    /// Die in the middle of writing the first tick.
    pub const TORN_WRITE: u64 = 3;
    /// Publish nonsense: `value[0]` = 0 not-a-number, 1 huge numbers, 2 random bits (seed `value[1]`).
    pub const CORRUPT: u64 = 4;
    /// The wall clock steps by `value[0]` seconds.
    pub const CLOCK_STEP: u64 = 5;
    /// Rig only: sensor channel `value[0]`; `value[1]` = 0 invalid, 1 stuck, 2 offset by `value[2]` (SI).
    pub const SENSOR: u64 = 6;
    /// For the CAN service: its own codes in `value`.
    pub const CAN: u64 = 7;
}

/// Bits of `flags` in vehicle and suspension state.
pub mod model_flags {
    /// An input was not there in time: the last one was used.
    pub const HELD_INPUT: u64 = 1 << 0;
    /// The tick was stepped late, to catch up.
    pub const CAUGHT_UP: u64 = 1 << 1;
    /// An input was not finite or out of range and was replaced by the last good one.
    pub const REFUSED_INPUT: u64 = 1 << 2;
    /// The solver held its last good pose.
    pub const HELD_POSE: u64 = 1 << 3;
    /// The model was restored from a checkpoint before this tick.
    pub const RESTORED: u64 = 1 << 4;
    /// The model met a non-finite state and fell back to its last good one.
    pub const MODEL_FAULT: u64 = 1 << 5;
    /// An input was older than its limit: the last outputs are held.
    pub const STALE: u64 = 1 << 6;
    /// A user's expression gave no finite number: its last value is kept.
    pub const EQUATION_FAULT: u64 = 1 << 7;
    /// A wheel is beyond the grid of the road's surface, or in a hole of it.
    pub const OFF_SURFACE: u64 = 1 << 8;
}

/// Bits of `flags` in rig measurement and status.
pub mod rig_flags {
    /// The command of this tick was not there at the output phase.
    pub const LATE_COMMAND: u64 = 1 << 0;
    /// The bench request is older than its limit.
    pub const NO_SUPERVISOR: u64 = 1 << 1;
    /// The rig itself had stalled before this tick.
    pub const STALLED: u64 = 1 << 2;
    /// The command was not finite or flagged: counted as stale.
    pub const REFUSED_COMMAND: u64 = 1 << 3;
    /// The plant is virtual.
    pub const VIRTUAL: u64 = 1 << 4;
}

/// Bits of `flags` in the CAN region.
pub mod can_flags {
    /// The bus is in memory, with the virtual ECU on it.
    pub const IN_MEMORY: u64 = 1 << 0;
    /// An interface was asked for and could not be had: the bus in memory stands in for it.
    pub const FALLBACK: u64 = 1 << 1;
    /// The bus failed in this tick: error frame, interface down, queue full.
    pub const BUS_ERROR: u64 = 1 << 2;
    /// At least one message received is absent: never seen, or timed out.
    pub const MESSAGE_ABSENT: u64 = 1 << 3;
    /// A value of the last frames was implausible.
    pub const IMPLAUSIBLE: u64 = 1 << 4;
    /// A fault is being injected, or was.
    pub const INJECTED: u64 = 1 << 5;
}

/// Bits of `message_status` in the CAN region.
pub mod can_status {
    /// No good frame was ever received.
    pub const NEVER: u64 = 1 << 0;
    /// The last good frame is older than the time-out.
    pub const TIMEOUT: u64 = 1 << 1;
    /// The last frame's checksum, counter value or Data ID was wrong.
    pub const CHECKSUM: u64 = 1 << 2;
    /// The last frame repeated the counter.
    pub const REPEATED: u64 = 1 << 3;
    /// The last frame was out of sequence.
    pub const SEQUENCE: u64 = 1 << 4;
    /// Frames before the last one were lost, within what is allowed.
    pub const SOME_LOST: u64 = 1 << 5;
    /// A value of the last good frame was implausible.
    pub const IMPLAUSIBLE: u64 = 1 << 6;
    /// The last frame was too short.
    pub const LENGTH: u64 = 1 << 7;
}

/// Bench states by the code of [`RigStatus::state`].
pub const STATE_NAMES: [&str; 9] =
    ["off", "idle", "armed", "starting", "running", "holding", "resuming", "stopping", "tripped"];

/// Name of a bench state's code.
pub fn state_name(code: u64) -> &'static str {
    usize::try_from(code).ok().and_then(|code| STATE_NAMES.get(code)).copied().unwrap_or("unknown")
}
