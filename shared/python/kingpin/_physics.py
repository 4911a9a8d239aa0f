"""Tyres, suspensions and functional models on their own."""

from __future__ import annotations

import io
import os
from dataclasses import dataclass
from typing import Any, Mapping, Sequence

import numpy as np

from . import _native
from ._log import Path, overrides_of, toml

_CONTACT = ["Fz_N", "kappa", "alpha_rad", "gamma_rad", "phit_1pm", "Vx_mps", "p_Pa"]


def _broadcast(*columns: Any) -> list[np.ndarray]:
    arrays = np.broadcast_arrays(*(np.asarray(column, dtype="<f8") for column in columns))
    return [np.ascontiguousarray(array.reshape(-1)) for array in arrays]


def evaluate_tyre(
    tyre: Path,
    Fz_N: Any,
    kappa: Any = 0.0,
    alpha_rad: Any = 0.0,
    gamma_rad: Any = 0.0,
    phit_1pm: Any = 0.0,
    Vx_mps: Any = 16.7,
    p_Pa: Any = 0.0,
    use_mode: int = 211,
) -> dict[str, np.ndarray]:
    """Forces, moments, radii and stiffnesses of a tyre, steady state; arguments are numbers or arrays, broadcast.

    The same columns, signs (ISO-W) and digits as ``kingpin tyre evaluate``: ``Fx_N``, ``Fy_N``, ``Mz_Nm`` and so on.
    ``tyre``: a .tir file, a table tyre, a shipped name. ``p_Pa`` 0: the file's pressure.
    """
    shape = np.broadcast_shapes(*(np.shape(c) for c in (Fz_N, kappa, alpha_rad, gamma_rad, phit_1pm, Vx_mps, p_Pa)))
    columns = _broadcast(Fz_N, kappa, alpha_rad, gamma_rad, phit_1pm, Vx_mps, p_Pa)
    rows = [",".join(map(repr, row)) for row in zip(*(column.tolist() for column in columns))]
    text = _native.evaluate_tyre(os.fspath(tyre), "\n".join([",".join(_CONTACT), *rows]) + "\n", use_mode)
    header, _, body = text.partition("\n")
    table = np.loadtxt(io.StringIO(body), delimiter=",", ndmin=2)
    return {name: table[:, i].reshape(shape) for i, name in enumerate(header.split(","))}


class Suspension:
    """An axle's multibody solver. Frames and signs: ``kingpin suspension --help``."""

    def __init__(self, axle: Path, overrides: Mapping[str, Any] | Sequence[str] | None = None) -> None:
        self._native = _native.NativeSuspension(os.fspath(axle), overrides_of(overrides))

    @property
    def name(self) -> str:
        """Its name."""
        return self._native.name

    def solve(
        self,
        rack_m: Any = 0.0,
        wheel_height_m: Any = (0.0, 0.0),
        wheel_force_n: Any = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        wheel_moment_n_m: Any = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ) -> dict[str, np.ndarray]:
        """Poses, tie-rod and rack forces, row by row from the pose before.

        ``rack_m``: (n) or a number; ``wheel_height_m``: (..., 2) left and right; forces and moments of the wheel on the
        knuckle at the wheel centre in the knuckle's axes: (..., 2, 3). ``status`` 0 is solved.
        """
        heights = np.asarray(wheel_height_m, dtype=float)
        forces = np.asarray(wheel_force_n, dtype=float)
        moments = np.asarray(wheel_moment_n_m, dtype=float)
        columns = _broadcast(
            rack_m,
            *(heights[..., k] for k in range(2)),
            *(forces[..., k, c] for k in range(2) for c in range(3)),
            *(moments[..., k, c] for k in range(2) for c in range(3)),
        )
        solved = self._native.solve([column.tobytes() for column in columns])
        return {name: np.frombuffer(values, dtype="<f8") for name, values in solved.items()}

    def curve(self, over: str, places_m: Any) -> dict[str, np.ndarray]:
        """Alignment of both sides over ``"rack"`` displacement or ``"travel"`` of both wheels, as far as it reaches."""
        places = np.ascontiguousarray(np.asarray(places_m, dtype="<f8").reshape(-1))
        found = self._native.curve(over, places.tobytes())
        return {name: np.frombuffer(values, dtype="<f8") for name, values in found.items()}


def suspension(axle: Path, overrides: Mapping[str, Any] | Sequence[str] | None = None) -> Suspension:
    """Assembles an axle: a TOML file, or a shipped name."""
    return Suspension(axle, overrides)


@dataclass(frozen=True)
class Trajectory:
    """What a model gave."""

    time_s: np.ndarray
    """End of each step."""
    outputs: dict[str, np.ndarray]
    """Outputs after each step, by name."""
    units: dict[str, str]
    """Their units."""
    faults: int
    """Steps that did not converge or held a state."""

    def __getitem__(self, name: str) -> np.ndarray:
        return self.outputs[name]


class Model:
    """A functional model (docs/MODELS.md), composed."""

    def __init__(self, model: Path, parameters: Mapping[str, Any] | None = None) -> None:
        given = [(name, toml(value)) for name, value in (parameters or {}).items()]
        self._native = _native.NativeModel(os.fspath(model), given)

    @property
    def name(self) -> str:
        """Its name."""
        return self._native.name

    @property
    def inputs(self) -> dict[str, str]:
        """Inputs and their units."""
        return dict(self._native.inputs)

    @property
    def outputs(self) -> dict[str, str]:
        """Outputs and their units."""
        return dict(self._native.outputs)

    @property
    def states(self) -> dict[str, str]:
        """States and their units."""
        return dict(self._native.states)

    @property
    def parameters(self) -> dict[str, tuple[float, str]]:
        """Parameters: value in SI, and unit."""
        return {name: (value, unit) for name, value, unit in self._native.parameters}

    def simulate(
        self,
        inputs: Mapping[str, Any] | None = None,
        step_s: float = 1e-4,
        duration_s: float | None = None,
        start: Mapping[str, float] | None = None,
    ) -> Trajectory:
        """Steps from the model's start. An input is a number or an array with one value a step; absent: 0."""
        given = dict(inputs or {})
        unknown = [name for name in given if name not in self.inputs]
        if unknown:
            raise ValueError(f"no input {', '.join(unknown)}; there are {', '.join(self.inputs)}")
        lengths = {np.size(value) for value in given.values() if np.ndim(value)}
        if duration_s is not None:
            lengths.add(round(duration_s / step_s))
        if len(lengths) != 1:
            raise ValueError("one length is needed: duration_s, or arrays that are equally long")
        steps = lengths.pop()
        columns = [
            np.ascontiguousarray(np.broadcast_to(np.asarray(given.get(name, 0.0), dtype="<f8"), steps)).tobytes()
            for name in self.inputs
        ]
        values, faults = self._native.simulate(columns, steps, step_s, list((start or {}).items()))
        outputs = {name: np.frombuffer(value, dtype="<f8") for name, value in zip(self.outputs, values)}
        return Trajectory(step_s * np.arange(1, steps + 1), outputs, self.outputs, faults)


def model(model: Path, parameters: Mapping[str, Any] | None = None) -> Model:
    """Composes a functional model: a TOML file, or a shipped name."""
    return Model(model, parameters)
