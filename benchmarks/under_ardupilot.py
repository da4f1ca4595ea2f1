"""Unmodified ArduPilot on our hulls, tuned and diagnosed from the shore: ``python3 -m benchmarks.under_ardupilot``.

Needs ArduPilot's own SITL (``ARDUPILOT_ROVER``, ``ARDUPILOT_SUB``). Each case starts the firmware at its defaults on a
hull served as external physics, then runs the user's command over MAVLink in simulated lock step:

* ``tune``: the step before and after, as the tool measured them;
* ``hidden``: an effect put into the physics, ``experiment`` flown, ``diagnose`` asked for its name. Goal: among the
  causes named, or in a group these runs cannot tell apart (Charlie's rudder is half a degree off besides:
  ``input-bias``);
* ``speed``: how fast the physics keep up (``--rate`` 200 and 400). Goal: 10 times real time.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

from benchmarks.results import count, headline
from benchmarks.rivals.sea import BINARIES, Sea
from sitl import load_vehicle
from sitl.effects import parse_effect

TUNES = (("charlie", "heading"), ("bluerov2", "heading"), ("bluerov2", "depth"))
HIDDEN = (
    ("charlie", "heading", "asymmetric-thrust.ratio=0.6"),
    ("charlie", "heading", "input-delay.delay=0.8"),
    ("charlie", "heading", "dead-zone.width=0.12"),
)
RATES = (200, 400)
_WARM_UP = 240.0
"""Seconds before anybody does anything: the estimator's heading wanders by a degree until it knows its gyros."""
FASTEST = 10.0
"""Goal: times real time."""


def _open(vehicle: str, instance: int, port: int, effect: str = "", rate: int | None = None) -> Sea:
    effects = [parse_effect(effect)] if effect else []
    return Sea(load_vehicle(vehicle), instance=instance, ports=range(port, port + 3), effects=effects, rate=rate)


def _metrics(told: Mapping[str, float | None]) -> str:
    value = {name: math.nan if number is None else number for name, number in told.items()}
    return (
        f"ITAE {value['itae']:7.3g} s^2  overshoot {value['overshoot']:4.0%}  settles {value['settling']:5.1f} s  "
        f"left {value['steady_error']:6.1%}"
    )


def show_tune(vehicle: str, axis: str, instance: int, port: int, keep: Path) -> bool:
    """Tune one axis and print the step before and after; return whether new gains were kept."""
    run = keep / f"{vehicle}-{axis}"
    sea = _open(vehicle, instance, port)
    try:
        sea.run(_WARM_UP)
        status = sea.host(
            ["tune", axis, "--connect", sea.tuner_uri, "--yes", "--out", str(run)], keep / f"{run.name}.txt"
        )
    finally:
        sea.close()
    print(f"{vehicle}, tune {axis}: exit {status}")
    if not (run / "summary.json").exists():
        return False
    summary = json.loads((run / "summary.json").read_text())
    for when in ("before", "after"):
        if summary["metrics"].get(when):
            print(f"  {when:7} {_metrics(summary['metrics'][when])}")
    gains = ", ".join(f"{name} {old:.4g} -> {new:.4g}" for name, (old, new) in summary["gains"].items())
    print(f"  {summary['ending']}: {gains}", flush=True)
    return summary["ending"] == "kept"


def show_hidden(vehicle: str, axis: str, effect: str, instance: int, port: int, keep: Path) -> bool:
    """Hide *effect*, fly, diagnose; return whether it is named."""
    run = keep / f"{vehicle}-{effect.partition('.')[0]}"
    sea = _open(vehicle, instance, port, effect)
    try:
        sea.run(_WARM_UP)
        command = ["experiment", axis, "--connect", sea.tuner_uri, "--yes", "--out", str(run)]
        status = sea.host(command, keep / f"{run.name}.txt")
    finally:
        sea.close()
    command = [sys.executable, "-m", "gcs_autotune", "diagnose", str(run), "--json"]
    told = subprocess.run(command, capture_output=True, text=True, cwd=keep, check=False)
    slug = effect.partition(".")[0]
    try:
        answer = json.loads(told.stdout)
    except json.JSONDecodeError:
        print(f"{vehicle}, {effect} hidden: exit {status}, no diagnosis: {told.stderr.strip()[-200:]}", flush=True)
        return False
    causes, alike = list(answer["causes"]), [group for group in answer["indistinguishable"] if slug in group]
    named = slug in causes or any(set(group) & set(causes) for group in alike)
    told_apart = "" if slug in causes or not alike else f" (not told apart here: {', '.join(alike[0])})"
    print(f"{vehicle}, {effect} hidden: {answer['verdict']}, {', '.join(causes) or 'nothing'}{told_apart}", flush=True)
    return named


def show_speed(rate: int, instance: int, port: int) -> bool:
    """Let ArduPilot run as fast as it can for ten wall seconds; return whether that is fast enough."""
    good = True
    for vehicle in ("charlie", "bluerov2"):
        sea = _open(vehicle, instance, port, rate=rate)
        try:
            sea.run(10.0)
            began, wall = sea.t, time.monotonic()
            sea.run_while(lambda wall=wall: time.monotonic() < wall + 10.0)
            times = (sea.t - began) / (time.monotonic() - wall)
        finally:
            sea.close()
        print(f"{vehicle}: --rate {rate}: {times * rate:.0f} frames/s, {times:.0f} x real time", flush=True)
        good = good and times >= FASTEST
    return good


def main() -> int:
    """Run what is asked for; 0 when every goal is met, 2 without ArduPilot."""
    parser = argparse.ArgumentParser(prog="benchmarks.under_ardupilot", description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="*", help="of tune, hidden, speed; default all")
    parser.add_argument("--instance", type=int, default=20)
    parser.add_argument("--port", type=int, default=14700, help="first of three UDP ports")
    parser.add_argument("--keep", type=Path, help="keep the run directories here")
    args = parser.parse_args()
    what = args.what or ["tune", "hidden", "speed"]
    lacking = [name for name in BINARIES.values() if not os.environ.get(name)]
    if lacking:
        print(f"this flies ArduPilot's own firmware: set {' and '.join(lacking)} to its binaries")
        return 2
    good = True
    with tempfile.TemporaryDirectory(prefix="under-ardupilot-") as folder:
        keep = args.keep or Path(folder)
        keep.mkdir(parents=True, exist_ok=True)
        if "speed" in what:
            good = min(show_speed(rate, args.instance, args.port) for rate in RATES) and good
        if "tune" in what:
            good = min(show_tune(*case, args.instance, args.port, keep) for case in TUNES) and good
        if "hidden" in what:
            named = [show_hidden(*case, args.instance, args.port, keep) for case in HIDDEN]
            good = all(named) and good
            found = count("hidden effects found", sum(named), len(named), least=1.0)
            headline("under_ardupilot", "tunes and hidden effects on ArduPilot's firmware", [found])
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
