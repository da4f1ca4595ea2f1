"""Navigate a file: its solution as runs for ``identify``, and beside the autopilot's own estimator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile
from gcs_autotune.logs import Recording, SampleStore, cut_runs, record
from gcs_autotune.navigation.sensors import readings_of, store_of
from gcs_autotune.navigation.solution import RATE, Mounting, Navigation, navigate
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel, Trial, load_trial

__all__ = ["NavigatedLog", "navigate_file"]

Array = NDArray[np.float64]

ESTIMATORS = {
    **dict.fromkeys(("phi", "theta", "psi"), ("ekf", "attitude")),
    **dict.fromkeys(("vn", "ve"), ("ekf", "local", "global")),
    **dict.fromkeys("xyz", ("ekf", "local")),
}
"""Signal -> sources of the autopilot's own estimator in a store, preferred first."""
NONE: tuple[Array, Array] = (np.zeros(0), np.zeros(0))
LATE = 0.01
"""Largest fraction of samples older than their predecessor in a usable log. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class NavigatedLog(Displayed):
    """Solution of a file: one ``Navigation`` per stretch, the runs with its signals, and the rms differences from the
    autopilot's estimator by signal (SI units; empty without one). ``lacks``: signals that the sensors do not determine.
    ``stuck``: measurement -> start and end [s] of each stretch in which it did not change.
    """

    name: str
    solutions: tuple[Navigation, ...]
    runs: tuple[Trial, ...]
    differences: Mapping[str, float]
    lacks: tuple[str, ...]
    stuck: Mapping[str, tuple[tuple[float, float], ...]]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "schema": 1,
            "source": self.name,
            "solutions": [s.to_dict() for s in self.solutions],
            "runs": [run.name for run in self.runs],
            "autopilot_rms_difference": dict(self.differences),
            "not_determined": list(self.lacks),
            "stuck": {name: [list(stretch) for stretch in stretches] for name, stretches in self.stuck.items()},
        }


def navigate_file(
    path: Path,
    mounting: Mounting | None = None,
    rate: float = RATE,
    *,
    system: int | None = None,
    columns: Mapping[str, str] | None = None,
) -> NavigatedLog:
    """Return the navigation solution of an onboard log or of a table whose headings are names of sources.

    rate : of the result [Hz]. system : of the vehicle, in a log with several. columns : as :func:`.trial.load_trial`.

    Raises
    ------
    BadFile
        The file cannot be read, has no usable inertial sensor or no heading, or its clock goes back.
    NotInformative
        The filter diverges.
    """
    log = record(path, system)
    if log is None:
        return _of_table(path, load_trial(path, columns), mounting, rate)
    solutions: list[Navigation] = []
    failures: list[BadFile] = []
    squares: dict[str, list[Array]] = {}
    still: dict[str, tuple[tuple[float, float], ...]] = {}
    for store in log.stores:
        _check_clock(store, path)
        try:
            readings = readings_of(store, path)
            navigation = navigate(readings, mounting, rate)
        except BadFile as error:  # another boot may have what this one lacks
            failures.append(error)
            continue
        for solution in navigation:
            store.take_all(solution.t, _sources(solution))
            for name, difference in _beside(store, solution):
                squares.setdefault(name, []).append(difference**2)
        solutions += navigation
        for name, stretches in readings.stuck.items():
            still[name] = (*still.get(name, ()), *stretches)
    if not solutions:
        raise failures[0]
    differences = {name: float(np.sqrt(np.mean(np.concatenate(rows)))) for name, rows in squares.items()}
    return NavigatedLog(path.name, tuple(solutions), tuple(_runs(log)), differences, _lacks(solutions), still)


def _of_table(path: Path, table: Trial, mounting: Mounting | None, rate: float) -> NavigatedLog:
    readings = readings_of(store_of(table, path), path)
    solutions = navigate(readings, mounting, rate)
    runs = []
    for number, solution in enumerate(solutions, start=1):
        inputs = {n: c for n, c in table.channels.items() if "." not in n and n not in solution.values}
        name = table.name if len(solutions) == 1 else f"{table.name}-{number}"
        meta = {**table.meta, "stretch": number, "mode": "navigated"}
        runs.append(replace(table, name=name, channels={**channels_of(solution), **inputs}, meta=meta))
    return NavigatedLog(path.name, solutions, tuple(runs), {}, _lacks(solutions), readings.stuck)


def channels_of(solution: Navigation) -> dict[str, Channel]:
    """Return the signals as channels, with standard deviations (``std_u``), correlation times (``memory_u`` [s]) and
    common errors (``common1_u`` ...).
    """
    channels = {}
    for name, values in solution.values.items():
        unit = SIGNALS[name].unit
        channels[name] = Channel(name, unit, solution.t, values)
        channels[f"std_{name}"] = Channel(f"std_{name}", unit, solution.t, solution.stds[name])
        channels[f"memory_{name}"] = Channel(f"memory_{name}", "s", solution.t, solution.memories[name])
        for number, column in enumerate(solution.common[name].T, start=1):
            channels[f"common{number}_{name}"] = Channel(f"common{number}_{name}", unit, solution.t, column)
    return channels


def _sources(solution: Navigation) -> dict[str, Array]:
    return {f"navigation.{name}": channel.values for name, channel in channels_of(solution).items()}


def _runs(log: Recording) -> Iterator[Trial]:
    """Yield all runs of a navigated log, those without input or motion too, in order of time."""
    cut = cut_runs(log)
    every = [*cut.runs, *(left.run for left in cut.left_out)]
    yield from sorted((run for run in every if "phi" in run), key=lambda run: int(run.meta["stretch"]))


def _beside(store: SampleStore, solution: Navigation) -> Iterator[tuple[str, Array]]:
    """Yield signal -> difference (k,) from the autopilot's estimator, where both have it.

    That of a position is without its mean, because the origins differ.
    """
    signals = {**solution.values, **solution.over_ground()}
    if "heading" in solution.noise:
        del signals["psi"]  # it is the autopilot's own
    for name, sources in ESTIMATORS.items():
        t, values = next((s for s in (store.series(f"{source}.{name}") for source in sources) if len(s[0]) > 1), NONE)
        inside = (solution.t >= t[0]) & (solution.t <= t[-1]) if len(t) > 1 else np.zeros(len(solution.t), dtype=bool)
        own = signals.get(name)
        if own is None or not np.any(inside):
            continue
        theirs = np.interp(solution.t[inside], t, np.unwrap(values) if name in ("phi", "theta", "psi") else values)
        error = own[inside] - theirs
        if name in ("phi", "theta", "psi"):
            error = (error + np.pi) % (2.0 * np.pi) - np.pi
        yield name, error - np.mean(error) if name in "xyz" else error


def _lacks(solutions: tuple[Navigation, ...] | list[Navigation]) -> tuple[str, ...]:
    return tuple(n for n in ("x", "y", "u", "v") if any(n not in s.values for s in solutions))


def _check_clock(store: SampleStore, path: Path) -> None:
    count = len(store.series("imu.p")[0])
    if store.late > LATE * count > 0.0:
        raise BadFile(
            f"{path}: the clock goes back at {store.late} samples, and the inertial sensor has {count}. The log is "
            "damaged; fetch it again"
        )
