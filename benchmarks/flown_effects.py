"""Hide effects in simulated vehicles, fly them over MAVLink, and diagnose the records.

Run: ``python3 -m benchmarks.flown_effects [--only videoray,asymmetric-thrust] [--seed 3] [--flights 2] [--keep DIR]``.

Every case is flown as by a user (``gcs-autotune experiment --connect 'sitl:NAME?effect=...'``, lock-step), twice with
two relay experiments of different size. ``gcs-autotune diagnose`` gets the run directories with the plain base model:
uncoupled, linear drag. The hulls have effects of their own (see ``sitl/vehicles``: quadratic drag, a constant force, a
compass of two degrees, climb rates in whole centimetres per second), which must be found too. A case is found if the
hidden effect is among the causes. It is clean if every cause is hidden or the hull's own. "Alike" are causes that the
runs cannot distinguish.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.results import count, headline
from gcs_autotune.cli import main as command_line

SECOND_OUTPUT = "0.45"
"""Relay output of the second flight; that of the first is 0.3 on these craft."""

OWN: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("charlie", "heading"): ("input-bias",),
    ("videoray", "heading"): ("quadratic-drag", "input-bias", "quantisation"),
    ("automarine", "heading"): ("quadratic-drag", "input-bias"),
    ("falcon", "heading"): ("quadratic-drag",),
    ("falcon", "depth"): ("net-buoyancy", "quadratic-drag", "quantisation"),
    ("videoray", "depth"): ("net-buoyancy", "quantisation"),
}
"""Effects that hulls, sensors and autopilots have themselves."""


@dataclass(frozen=True, slots=True)
class Case:
    """A vehicle, an axis, and the hidden effect: ``SLUG[@PLACE]`` with the simulator's parameters; "" without one."""

    vehicle: str
    axis: str
    slug: str = ""
    place: str = ""
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def hidden(self) -> str:
        """Return the effect as on the command line."""
        numbers = ",".join(f"{n}={v:g}" for n, v in self.values.items())
        return f"{self.slug}{'@' if self.place else ''}{self.place}{'.' if numbers else ''}{numbers}"

    @property
    def uri(self) -> str:
        """Return the connection."""
        return f"sitl:{self.vehicle}{'?effect=' if self.slug else ''}{self.hidden}"


CASES: tuple[Case, ...] = (
    *(Case(vehicle, axis) for vehicle, axis in OWN),
    Case("charlie", "heading", "dead-zone", values={"width": 0.1}),
    Case("charlie", "heading", "actuator-lag", values={"time_constant": 0.5}),
    Case("charlie", "heading", "asymmetric-thrust", values={"ratio": 0.75}),
    Case("charlie", "heading", "gyro-bias", values={"bias": 0.01}),
    Case("charlie", "heading", "compass-deviation", values={"B": 0.1, "C": -0.05}),
    Case("charlie", "heading", "quadratic-drag", "yaw", {"coefficient": 10.0}),
    Case("videoray", "heading", "input-delay", values={"delay": 0.15}),
    Case("videoray", "heading", "asymmetric-thrust", values={"ratio": 0.7}),
    Case("videoray", "heading", "dead-zone", values={"width": 0.1}),
    Case("automarine", "heading", "actuator-lag", values={"time_constant": 0.3}),
    Case("automarine", "heading", "gyro-bias", values={"bias": 0.02}),
    Case("falcon", "heading", "input-bias", values={"bias": 0.05}),
    Case("falcon", "heading", "wind-moment", values={"strength": 0.08, "direction": 1.0}),
    Case("falcon", "depth", "actuator-lag", "vertical", {"time_constant": 0.5}),
    Case("falcon", "depth", "asymmetric-thrust", "vertical", {"ratio": 0.8}),
    Case("videoray", "depth", "dead-zone", "vertical", {"width": 0.1}),
)


def run(arguments: Sequence[str]) -> str:
    """Run one gcs-autotune command and return what it printed.

    Raises
    ------
    RuntimeError
        It failed; the message contains its last line.
    """
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = command_line(list(arguments))
    if code:
        lines = err.getvalue().strip().splitlines() or ["nothing"]
        raise RuntimeError(f"exit code {code}: {lines[-1]}")
    return out.getvalue()


def fly(case: Case, folder: Path, *, seed: int = 3, flights: int = 2) -> list[Path]:
    """Fly *case*, unless it exists, and return the run directories, one per flight of two relay experiments."""
    found = []
    for k in range(flights):
        directory = folder / f"{case.vehicle}-{case.axis}-{case.hidden or 'nothing'}-{seed + k}"
        if not (directory / "fit.json").is_file():
            relay = ["--relay-output", SECOND_OUTPUT] if k else []
            seeded = ["--seed", str(seed + k), "--json", "--out", str(directory)]
            run(["experiment", case.axis, "--connect", case.uri, *relay, *seeded])
        found.append(directory)
    return found


def diagnosed(runs: Sequence[Path], *more: str) -> dict[str, Any]:
    """Return the result of ``diagnose --json`` for *runs*."""
    diagnosis: dict[str, Any] = json.loads(run(["diagnose", *map(str, runs), *more, "--json"]))
    return diagnosis


def judge(case: Case, diagnosis: Mapping[str, Any]) -> tuple[bool, bool, bool]:
    """Return whether the hidden effect is reported, whether it is in a reported group, and if no cause is wrong."""
    causes = set(diagnosis["causes"])
    own = set(OWN[case.vehicle, case.axis]) | {case.slug}
    alike = any(case.slug in group and causes & set(group) for group in diagnosis["indistinguishable"])
    return case.slug in causes, alike, causes <= own


def _numbers(diagnosis: Mapping[str, Any]) -> str:
    parts = []
    for found in diagnosis["found"]:
        numbers = ", ".join(f"{n} {v['value']:.4g} +- {v['std']:.2g}" for n, v in found["parameters"].items())
        parts.append(f"{found['cause']}@{found['place']} ({numbers})")
    return "; ".join(parts)


def main() -> None:
    """Fly and diagnose every case and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--only", default="", help="words that must be in a case's connection or axis, by commas")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--flights", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="folder that keeps the run directories, to use them again")
    args = parser.parse_args()
    words = [w for w in args.only.split(",") if w]
    cases = [c for c in CASES if all(w in f"{c.uri} {c.axis}" for w in words)]
    hidden = reported = alike = clean = silent = 0
    with tempfile.TemporaryDirectory() as scratch:
        for case in cases:
            began = time.perf_counter()
            print(f"{case.vehicle:10} {case.axis:8} {case.hidden or '(its own only)':40}", end=" ", flush=True)
            try:
                diagnosis = diagnosed(fly(case, args.keep or Path(scratch), seed=args.seed, flights=args.flights))
            except RuntimeError as error:
                print(error)
                continue
            found, same, pure = judge(case, diagnosis)
            clean += pure
            if case.slug:
                hidden, reported, alike = hidden + 1, reported + found, alike + (same and not found)
                answer = "FOUND" if found else "ALIKE" if same else "missed"
            else:
                silent += 1
                answer = ""
            seconds = time.perf_counter() - began
            print(f"{answer:6} {diagnosis['verdict']:16} {'' if pure else 'FALSE CAUSE':11} {seconds:4.0f} s")
            print(f"{'':21}{_numbers(diagnosis)}; alike: {diagnosis['indistinguishable']}", flush=True)
    figures = [
        count("hidden effects found", reported, hidden),
        count("hidden effects found in a group", reported + alike, hidden),
        count("records without a false cause", clean, hidden + silent),
    ]
    headline("flown_effects", "diagnosis of flown runs with an effect hidden in the simulated vehicle", figures)


if __name__ == "__main__":
    main()
