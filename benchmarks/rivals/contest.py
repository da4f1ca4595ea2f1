"""One axis of one vessel: compute the gains of every rule, and fly the same step with each on the true hull."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.rivals.firmware_loop import FirmwareLoop
from benchmarks.rivals.fleet import FLEET, Job, Vessel
from benchmarks.rivals.flights import circle_ratio, fly_step, get_ready
from benchmarks.rivals.global_search import SIMULATED_LAWS, best_simulated
from benchmarks.rivals.oracle import search
from benchmarks.rivals.rules import Cycle, quiktune, ziegler_nichols
from gcs_autotune.design import StepMetrics
from gcs_autotune.firmware import FIRMWARE, Axis, read_named

__all__ = [
    "HELD",
    "Entry",
    "all_entries",
    "entries_of",
    "flown_again",
    "has_goal",
    "is_first",
    "run_row",
]

_FILTERS = ("ATC_STR_RAT_FLTT", "ATC_STR_RAT_FLTD")
_WORKING_DEPTH = 3.0
HELD = 0.15
"""Largest overshoot of the limited oracle, as in the proof of a tune."""


@dataclass(slots=True)
class Entry:
    """Result of one rule: its gains, the vehicle time [s], the metrics of its step, and a ``note``."""

    rival: str
    gains: Mapping[str, float]
    seconds: float
    metrics: StepMetrics | None = None
    note: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {**asdict(self), "metrics": None if self.metrics is None else asdict(self.metrics)}


_WITHIN = 1.10
"""Largest ITAE, relative to the best gains of the search, that meets the goal."""
_SAME = 1.10
"""Ratio of the ITAE of two flights of the same gains, at most."""
_INSTANCES = range(20, 60)
"""Instance numbers of ArduPilot that are tried, so that several contests run at a time."""


def job_of(name: str) -> tuple[Vessel, Job]:
    """Return vessel and axis of a *name* such as ``boat-2s heading``."""
    vessel, axis = name.split()
    return FLEET[vessel], next(job for job in FLEET[vessel].jobs if job.axis == axis)


@contextmanager
def _firmware_of(vessel: Vessel) -> Iterator[FirmwareLoop]:
    """Yield the firmware on the hull of *vessel*, on the first instance number whose ports are free."""
    for instance in _INSTANCES:
        first = 14700 + 3 * (instance - _INSTANCES.start)
        try:
            firmware = FirmwareLoop(vessel.data, instance=instance, ports=range(first, first + 3))
        except OSError:
            if instance == _INSTANCES[-1]:
                raise
            continue
        break
    try:
        yield firmware
    finally:
        firmware.close()


def run_row(seed: int, job: str, budget: int) -> dict[str, Any]:
    """Return the results of a case of the study: all entries as JSON, the ITAE of each rival, and whether the goal is
    The firmware draws its own noise, so *seed* has no effect.
    """
    vessel, axis = job_of(job)
    with _firmware_of(vessel) as firmware:
        entries = all_entries(firmware, vessel, axis, budget=budget)
    itae = {entry.rival: entry.metrics.itae for entry in entries if entry.metrics is not None}
    return {
        "goal": has_goal(entries),
        "over_best": itae["ours"] / itae["oracle"],
        "itae": itae,
        "entries": json.dumps([entry.to_dict() for entry in entries]),
    }


def entries_of(text: str) -> list[Entry]:
    """Return the entries in a result ``entries`` of :func:`run_row`."""
    plain = json.loads(text)
    return [Entry(**{**one, "metrics": one["metrics"] and StepMetrics(**one["metrics"])}) for one in plain]


def flown_again(job: str, entries: Sequence[Entry]) -> list[Entry]:
    """Return *entries* with their steps flown once more on a new firmware, from an empty integral."""
    vessel, axis = job_of(job)
    with _firmware_of(vessel) as firmware:
        firmware.run_while(lambda: firmware.t < 50.0)
        get_ready(firmware, axis)
        base = firmware.psi if axis.axis == "heading" else _WORKING_DEPTH
        return [replace(one, metrics=fly_step(firmware, axis, one.gains, base, fresh=True)) for one in entries]


def is_first(entries: Sequence[Entry]) -> bool:
    """Return whether our gains were kept and have the least ITAE of all that are not searched.

    A tune that was aborted left the defaults. Their second flight may be better than the first by chance.
    """
    itae = {entry.rival: entry.metrics.itae for entry in entries if entry.metrics is not None}
    kept = any(entry.rival == "ours" and entry.note == "kept" for entry in entries)
    return kept and itae["ours"] <= min(value for rival, value in itae.items() if not rival.startswith("oracle"))


def has_goal(entries: Sequence[Entry]) -> bool:
    """Return whether our gains are within 10 % of the search, or best of the others, and not worse than the defaults.

    *entries* end with the result of the search.
    """
    itae = {entry.rival: entry.metrics.itae for entry in entries if entry.metrics is not None}
    close = itae["ours"] <= _WITHIN * itae["oracle"]
    return (close or is_first(entries)) and itae["ours"] <= _SAME * itae["defaults"]


def _axis(firmware: FirmwareLoop, vessel: Vessel, job: Job) -> Axis:
    """Return the firmware's loop, with the ranges documented for the names that this vehicle has."""
    axis = FIRMWARE[f"ardu{vessel.data.firmware}"].axes[job.axis]
    spelled, _ = read_named(firmware, [gain.parameter for gain in axis.gains])
    return axis.called(spelled)


def all_entries(firmware: FirmwareLoop, vessel: Vessel, job: Job, *, budget: int) -> list[Entry]:
    """Return the entries of all rules with their flown steps."""
    firmware.run_while(lambda: firmware.t < 50.0)
    axis = _axis(firmware, vessel, job)
    names = [*(gain.parameter for gain in axis.gains), *(_FILTERS if vessel.data.is_boat else ())]
    default = firmware.get(names)
    entries = [Entry("defaults", default, 0.0)]
    ours, cycle = _tune(firmware, job, default, names)
    firmware.set(default)
    get_ready(firmware, job)
    if vessel.data.is_boat:
        entries.append(_quiktune(firmware, vessel, default))
        firmware.rest()
        get_ready(firmware, job)
    if cycle is not None:
        speed = vessel.data.parameters.get("CRUISE_SPEED", 0.0)
        gains = ziegler_nichols(axis.law, cycle[0], speed, default)
        entries.append(Entry("Ziegler-Nichols", {**default, **gains}, cycle[1]))
    entries.append(ours)
    base = firmware.psi if job.axis == "heading" else _WORKING_DEPTH
    for entry in entries:
        entry.metrics = fly_step(firmware, job, entry.gains, base)
    return [*entries, *_oracles(firmware, vessel, job, axis, entries, base, budget)]


def _tune(
    firmware: FirmwareLoop, job: Job, default: Mapping[str, float], names: list[str]
) -> tuple[Entry, tuple[Cycle, float] | None]:
    """Run ``gcs-autotune tune`` over its own link, and read the gains that it left on the vehicle."""
    firmware.set(dict(default))
    firmware.armed_seconds = 0.0
    with tempfile.TemporaryDirectory(prefix="rivals-tune-") as folder:
        run = Path(folder) / "run"
        command = ["tune", job.axis, "--connect", firmware.tuner_uri, "--yes", "--out", str(run)]
        command += ["--max-distance", "2000"] if firmware.data.is_boat else []
        status = firmware.host([*command, "--step-duration", f"{job.duration:g}"], Path(folder) / "said")
        cycle, note = _cycle(run), f"ended with {status}"
        if (run / "summary.json").exists():
            summary = json.loads((run / "summary.json").read_text())
            note = summary["ending"] if summary["ending"] == "kept" else f"{summary['ending']}: {summary['reason']}"
    return Entry("ours", firmware.get(names), firmware.armed_seconds, note=note), cycle


def _cycle(run: Path) -> tuple[Cycle, float] | None:
    """Return the limit cycle of the first relay in a run directory, and its duration [s]."""
    if not (run / "fit.json").exists():
        return None
    cycles = json.loads((run / "fit.json").read_text()).get("iso") or []
    if not cycles:
        return None
    c = cycles[0]["cycle"]
    rows = next(iter(sorted((run / "trials").glob("*-relay-1.csv")))).read_text().splitlines()
    t = [float(row.split(",")[0]) for row in (rows[1], rows[-1])]
    return Cycle(c["C"], c["X_m"], c["x_a_star"], c["omega"]), t[1] - t[0]


def _quiktune(firmware: FirmwareLoop, vessel: Vessel, default: Mapping[str, float]) -> Entry:
    throttle = vessel.data.parameters["CRUISE_THROTTLE"] / 100.0
    demand, rate, seconds = circle_ratio(firmware, throttle, 0.5)
    gains = quiktune(demand / rate, firmware.get(["INS_GYRO_FILTER"])["INS_GYRO_FILTER"])
    is_refused = rate < math.radians(10.0)
    note = "QuikTune refuses turn rates below 10 deg/s at half rudder" if is_refused else ""
    return Entry("QuikTune's rule", {**default, **gains}, seconds, note=note)


def _oracles(
    firmware: FirmwareLoop, vessel: Vessel, job: Job, axis: Axis, entries: list[Entry], base: float, budget: int
) -> list[Entry]:
    """Return the oracle with an overshoot of at most ``HELD`` and the free one, which share all flights."""
    began = firmware.t
    ranges = {gain.parameter: (gain.low, gain.high) for gain in axis.gains}
    others = {name: value for name, value in entries[0].gains.items() if name not in ranges}
    starts = [entry.gains for entry in entries]
    limits = (HELD, math.inf)
    if axis.law in SIMULATED_LAWS:
        context = firmware.get(axis.context)
        starts += [best_simulated(axis.law, vessel, job, ranges, {**context, **others}, limit) for limit in limits]

    def fly(gains: Mapping[str, float]) -> StepMetrics:
        return fly_step(firmware, job, {**others, **gains}, base)

    found, flown = search(fly, ranges, starts, budget, limits)
    answers = []
    for name, flight in zip(("oracle, held", "oracle"), found, strict=True):
        entry = Entry(name, {**others, **flight.gains}, firmware.t - began, note=f"{flown} steps flown")
        entry.metrics = fly(flight.gains)
        answers.append(entry)
    return answers
