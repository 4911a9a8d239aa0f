"""Parameter studies on the local cores or on a Dask cluster.

A run is a pure function of the study and of its number (parameters and seed follow from them), so it does not matter who
makes it, or how often: the table is that of ``kingpin sweep``, whatever dies on the way.
"""

from __future__ import annotations

import json
import math
import os
import time
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from functools import lru_cache
from itertools import islice
from typing import TYPE_CHECKING, Any, Callable, Mapping, Sequence

import numpy as np

from . import _native
from ._log import Path, overrides_of

if TYPE_CHECKING:
    import pandas

Progress = Callable[[int, int], None]


class Sweep:
    """The table of a study; runs that went wrong have their ``error`` there."""

    def __init__(self, native: Any, rows: list[str], directory: str | None, tasks: int) -> None:
        self.rows: list[dict[str, Any]] = sorted((json.loads(row) for row in rows), key=lambda row: row["run"])
        self.parameters: list[str] = native.parameters
        self.metrics: list[str] = native.metrics
        self.directory = directory
        """Where results.parquet, results.csv and report.html were written."""
        self.tasks = tasks
        """Tasks that were given out (each some runs)."""

    @property
    def errors(self) -> dict[int, str]:
        """What is wrong with runs, by number."""
        return {row["run"]: row["error"] for row in self.rows if row["error"]}

    def columns(self) -> dict[str, np.ndarray]:
        """The table: run, seed, parameters, figures (NaN where there is none), error."""
        table: dict[str, np.ndarray] = {
            "run": np.array([row["run"] for row in self.rows], dtype=np.uint64),
            "seed": np.array([row["seed"] for row in self.rows], dtype=np.uint64),
        }
        for place, name in enumerate(self.parameters):
            table[name] = np.array([row["parameters"][place] for row in self.rows])
        for place, name in enumerate(self.metrics):
            values = [row["metrics"][place] for row in self.rows]
            table[name] = np.array([math.nan if value is None else value for value in values], dtype=float)
        table["error"] = np.array([row["error"] for row in self.rows], dtype=object)
        return table

    def to_pandas(self) -> "pandas.DataFrame":
        """The table as a DataFrame by run."""
        import pandas

        return pandas.DataFrame(self.columns()).set_index("run")

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        return f"<Sweep: {len(self.rows)} runs, {len(self.errors)} with an error>"


@lru_cache(maxsize=4)
def _prepared(reference: str, overrides: tuple[str, ...]) -> Any:
    return _native.NativeStudy(reference, list(overrides))


def _evaluate(reference: str, overrides: tuple[str, ...], expected: str, runs: Sequence[int]) -> tuple[list[str], float]:
    """Some runs, on a worker: their rows, and how long they took together."""
    study = _prepared(reference, overrides)
    if study.hash != expected:
        raise _native.RunError("this worker has another version of kingpin, or of the study's files")
    begin = time.perf_counter()
    rows = [study.evaluate(run) for run in runs]
    return rows, time.perf_counter() - begin


def sweep(
    study: Path,
    *,
    client: Any = None,
    out: Path | None = None,
    overrides: Mapping[str, Any] | Sequence[str] | None = None,
    jobs: int | None = None,
    batch_s: float = 0.5,
    progress: Progress | None = None,
) -> Sweep:
    """Makes the runs of a study (a TOML file, or a shipped name) and returns their table.

    ``client``: a ``distributed.Client``; without it ``jobs`` threads of this process (the interpreter is let go). Runs
    are gathered into tasks of at least ``batch_s`` seconds and taken over as each task completes, so a dead worker costs
    the runs it was at, which the scheduler gives to another. ``out``: a directory for results.parquet, results.csv,
    report.html and the journal, with which an interrupted sweep goes on. On a cluster every worker needs this package in
    the same version, and the study's files (if they are not shipped ones) at the same path.
    """
    given = tuple(overrides_of(overrides))
    reference = os.fspath(study)
    if os.path.exists(reference):
        reference = os.path.abspath(reference)
    native = _native.NativeStudy(reference, list(given))
    rows = {} if out is None else {json.loads(row)["run"]: row for row in native.finished(os.fspath(out))}
    left = [run for run in range(native.runs) if run not in rows]

    def keep(made: list[str], wall_s: float) -> None:
        for row in made:
            number = json.loads(row)["run"]
            if out is not None and number not in rows:
                native.keep(os.fspath(out), row, wall_s / len(made))
            rows[number] = row
        if progress is not None:
            progress(len(rows), native.runs)

    if client is None:
        tasks = _threads(native, left, jobs or os.cpu_count() or 1, keep)
    else:
        tasks = _cluster(client, native, (reference, given, native.hash), left, batch_s, keep)
    if out is not None:
        native.write(list(rows.values()), os.fspath(out))
    return Sweep(native, list(rows.values()), None if out is None else os.fspath(out), tasks)


def _threads(native: Any, left: list[int], jobs: int, keep: Callable[[list[str], float], None]) -> int:
    def one(run: int) -> tuple[str, float]:
        begin = time.perf_counter()
        return native.evaluate(run), time.perf_counter() - begin

    queue = iter(left)
    with ThreadPoolExecutor(jobs) as pool:
        try:
            pending = {pool.submit(one, run) for run in islice(queue, jobs)}
            while pending:
                # A bounded wait, so that Ctrl-C is seen.
                done, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
                for future in done:
                    row, wall_s = future.result()
                    keep([row], wall_s)
                    run = next(queue, None)
                    if run is not None:
                        pending.add(pool.submit(one, run))
        except BaseException:
            native.stop()
            raise
    return len(left)


def _cluster(
    client: Any,
    native: Any,
    about: tuple[str, tuple[str, ...], str],
    left: list[int],
    batch_s: float,
    keep: Callable[[list[str], float], None],
) -> int:
    from distributed import as_completed

    queue = left[::-1]
    batch = 1
    tasks = 0
    runs_of: dict[str, list[int]] = {}

    def submit(runs: list[int]) -> Any:
        nonlocal tasks
        tasks += 1
        future = client.submit(_evaluate, *about, runs, pure=False)
        runs_of[future.key] = runs
        return future

    def fill() -> Any:
        runs = [queue.pop() for _ in range(min(batch, len(queue)))]
        return submit(runs) if runs else None

    # Two tasks a thread keep every thread busy while results travel.
    threads = max(1, sum(client.nthreads().values()))
    first = [future for future in (fill() for _ in range(2 * threads)) if future is not None]
    if not first:
        return 0
    running = as_completed(first)
    for future in running:
        runs = runs_of.pop(future.key)
        if future.status == "finished":
            made, wall_s = future.result()
            batch = max(1, min(1000, math.ceil(batch_s * len(runs) / max(wall_s, 1e-6))))
            keep(made, wall_s)
        elif len(runs) > 1:
            # One of them breaks whoever makes it: find out which.
            for run in runs:
                running.add(submit([run]))
        else:
            keep([native.failed(runs[0], f"its worker failed: {future.exception()!r}")], 0.0)
        # What is taken over need not be kept, or made again should its worker die.
        future.release()
        more = fill()
        if more is not None:
            running.add(more)
    return tasks
