"""Kingpin from Python: logs as numpy arrays, lockstep runs in this process, tyres, suspensions, models, studies.

>>> import kingpin
>>> run = kingpin.run("weave_100", {"car.body.sprung_mass_kg": 1500}, duration_s=12)
>>> run["rig_measurement.steering_wheel_torque_n_m"].value      # a numpy array, unit in .unit
>>> run.metrics["peaks"]["lateral_acceleration_m_s2"]
>>> run.to_pandas(["vehicle_state.*", "rig_measurement.tie_rod_force_n"])
>>> kingpin.open_log("runs/weave_100-20260101-120000")
>>> kingpin.sweep("assist_feel", client=dask_client)

Names of signals, units and signs are those of ``kingpin export``; overrides those of ``kingpin run --set``. Wrong input
raises :class:`ConfigError`, whose ``violations`` tell file, line, key, value and rule of everything that is wrong.
"""

from __future__ import annotations

from ._log import Log, Run, Signal, open_log, run
from ._native import ConfigError, KingpinError, LogError, RunError, __version__
from ._physics import Model, Suspension, Trajectory, evaluate_tyre, model, suspension
from ._sweep import Sweep, sweep

__all__ = [
    "ConfigError", "KingpinError", "Log", "LogError", "Model", "Run", "RunError", "Signal", "Suspension", "Sweep",
    "Trajectory", "__version__", "evaluate_tyre", "model", "open_log", "run", "suspension", "sweep",
]
