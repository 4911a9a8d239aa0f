"""Logs and runs."""

from __future__ import annotations

import json
import os
import time
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from typing import TYPE_CHECKING, Any, Callable, Iterable, Mapping, Sequence, Union

import numpy as np

from . import _native

if TYPE_CHECKING:
    import pandas

Path = Union[str, "os.PathLike[str]"]


def toml(value: Any) -> str:
    """A value as ``kingpin run --set`` takes it."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    elif isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml(entry) for entry in value) + "]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(str(key))} = {toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, (int, float)):
        return repr(value)
    return json.dumps(os.fspath(value) if isinstance(value, os.PathLike) else str(value), ensure_ascii=False)


def overrides_of(overrides: Mapping[str, Any] | Sequence[str] | None) -> list[str]:
    if overrides is None:
        return []
    if isinstance(overrides, Mapping):
        return [f"{key}={toml(value)}" for key, value in overrides.items()]
    return [str(override) for override in overrides]


@dataclass(frozen=True)
class Signal:
    """A signal over time."""

    name: str
    """``region.field`` or ``region.field.label``."""
    unit: str
    """Unit symbol; ``1`` for counters, codes and ratios."""
    comment: str
    """What it is."""
    tick: np.ndarray
    """Tick of each value."""
    time_s: np.ndarray
    """Start of that tick since tick 0, in s."""
    value: np.ndarray
    """Values: float64 (NaN where absent) or uint64."""

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return self.value.astype(dtype, copy=bool(copy)) if dtype is not None or copy else self.value

    def __len__(self) -> int:
        return len(self.value)


class Log:
    """A log. ``log[name]`` is a :class:`Signal`; ``log.names`` are all there are."""

    def __init__(self, native: Any) -> None:
        self._native = native
        self._columns = {
            f"{region}.{column}": (region, column, counter, unit, comment)
            for region, column, counter, unit, comment in native.columns()
        }
        self._ticks: dict[str, np.ndarray] = {}

    @cached_property
    def header(self) -> dict[str, Any]:
        """What the log says about its run: scenario, bench, period_ns, seed, lockstep, versions, configuration_hash."""
        return json.loads(self._native.header())

    @cached_property
    def configuration(self) -> dict[str, Any]:
        """The resolved configuration: scenario, car, front_axle, rig, unit and so on."""
        return json.loads(self._native.configuration())

    @property
    def sources(self) -> dict[str, str]:
        """The configuration's files as they were, by name."""
        return dict(self._native.sources())

    @property
    def scenario(self) -> str:
        """Name of the scenario."""
        return self.header["scenario"]

    @property
    def period_s(self) -> float:
        """Period of a tick in s."""
        return self.header["period_ns"] / 1e9

    @property
    def events(self) -> list[tuple[int, float, str, str]]:
        """What happened: tick, time in s, kind, detail."""
        return self._native.events()

    @property
    def names(self) -> list[str]:
        """Names of all signals."""
        return list(self._columns)

    def select(self, *patterns: str) -> list[str]:
        """Names of the signals that are, lie in, or match any of the patterns (``vehicle_state``, ``*force_n*``)."""
        found: dict[str, None] = {}
        for pattern in patterns:
            names = [
                name for name in self._columns
                if name == pattern or name.startswith(pattern + ".") or fnmatchcase(name, pattern)
            ]
            if not names:
                self._unknown(pattern)
            found.update(dict.fromkeys(names))
        return list(found)

    def _unknown(self, name: str) -> None:
        region, _, column = name.partition(".")
        # The same search by name gives the error its suggestions.
        self._native.ticks(region)
        self._native.column(region, column)
        raise _native.LogError(f"{name}: no such signal in the log")

    def _ticks_of(self, region: str) -> np.ndarray:
        if region not in self._ticks:
            self._ticks[region] = np.frombuffer(self._native.ticks(region), dtype="<u8")
        return self._ticks[region]

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    def __getitem__(self, name: str) -> Signal:
        if name not in self._columns:
            self._unknown(name)
        region, column, counter, unit, comment = self._columns[name]
        value = np.frombuffer(self._native.column(region, column), dtype="<u8" if counter else "<f8")
        tick = self._ticks_of(region)
        return Signal(name, unit, comment, tick, tick * self.header["period_ns"] / 1e9, value)

    def to_pandas(self, signals: str | Iterable[str] | None = None) -> "pandas.DataFrame":
        """Signals (names, regions, patterns; default all) as a DataFrame over ``time_s``; units and comments in ``attrs``.

        Counters become floats where a region has not every tick (NaN there).
        """
        import pandas

        patterns = [signals] if isinstance(signals, str) else list(signals or [])
        names = self.select(*patterns) if patterns else self.names
        regions = list(dict.fromkeys(self._columns[name][0] for name in names))
        ticks = np.unique(np.concatenate([self._ticks_of(region) for region in regions]))
        columns = {}
        for name in names:
            signal = self[name]
            if len(signal.tick) == len(ticks):
                columns[name] = signal.value
            else:
                full = np.full(len(ticks), np.nan)
                full[np.searchsorted(ticks, signal.tick)] = signal.value
                columns[name] = full
        index = pandas.Index(ticks * self.header["period_ns"] / 1e9, name="time_s")
        frame = pandas.DataFrame(columns, index=index)
        frame.attrs = {
            "units": {name: self._columns[name][3] for name in names},
            "comments": {name: self._columns[name][4] for name in names},
            "scenario": self.scenario,
        }
        return frame

    def summary(self) -> dict[str, Any]:
        """The figures of ``summary.json``."""
        return json.loads(self._native.summary())

    def assess(self) -> dict[str, Any]:
        """Figures, conditions and rules of the standard's procedure that the scenario is driven for."""
        return json.loads(self._native.assess())

    def export(
        self, path: Path, format: str | None = None, select: Iterable[str] = (), every: int = 1, method: str = "pick"
    ) -> int:
        """Writes the log as csv, mf4, parquet or mcap (default: by the extension); the number of rows."""
        path = os.fspath(path)
        if method not in ("pick", "mean"):
            raise ValueError(f"method = {method}: must be pick or mean")
        return self._native.export(path, format or path.rsplit(".", 1)[-1], list(select), every, method == "mean")

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.scenario}: {len(self._columns)} signals>"


class Run(Log):
    """A run that was made in this process: a log, with what it was made from."""

    def __init__(self, native: Any, overrides: list[str], wall_s: float) -> None:
        super().__init__(native)
        self.overrides = overrides
        """What was laid over the scenario."""
        self.wall_s = wall_s
        """How long it took, in s."""

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """The figures of ``summary.json``."""
        return self.summary()

    @cached_property
    def figures(self) -> dict[str, float | None]:
        """Figures of the standard's procedure, by name; ``None`` where withheld."""
        return {figure["name"]: figure.get("value") for figure in self.assess()["figures"]}


def open_log(path: Path, regions: Iterable[str] | None = None) -> Log:
    """Opens a log file, or all of a run's directory as one; of all regions, or of some.

    Raises :class:`LogError` for what is not a log.
    """
    return Log(_native.open_log(os.fspath(path), None if regions is None else list(regions)))


def run(
    scenario: Path,
    overrides: Mapping[str, Any] | Sequence[str] | None = None,
    duration_s: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """Runs a scenario (a shipped name or a file) in lockstep in this process.

    The same bits as ``kingpin run SCENARIO --lockstep`` with ``--set`` for each override. The interpreter is free
    meanwhile; Ctrl-C ends the run with ``KeyboardInterrupt``. ``progress(done, all)`` is told of ticks.

    Raises :class:`ConfigError` for wrong input, :class:`RunError` for a loop that breaks off.
    """
    given = overrides_of(overrides)
    if duration_s is not None:
        given.append(f"duration_s={float(duration_s)!r}")
    begin = time.perf_counter()
    native = _native.run(os.fspath(scenario), given, progress)
    return Run(native, given, time.perf_counter() - begin)
