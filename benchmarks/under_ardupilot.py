"""Tune and diagnose simulated hulls under unmodified ArduPilot: ``python3 -m benchmarks.under_ardupilot``.

Needs ArduPilot's own SITL (``ARDUPILOT_ROVER``, ``ARDUPILOT_SUB``). Each case starts the firmware at its defaults on a
hull served as external physics, then runs the user's command over MAVLink in simulated lock step:

* ``tune``: the step before and after, as the tool measured them;
* ``hidden``: an effect is added to the physics, ``experiment`` is flown, and ``diagnose`` runs. Goal: the effect is
  among the reported causes, or indistinguishable from one (Charlie's rudder also has an offset, ``input-bias``);
* ``station``: whole tunes in real time with another station. At a random time it orders a mode, disarms, steers or
  writes a gain. In half of the tunes the tool's computer also pauses. Goal: nothing is undone, and the cause is
  reported;
* ``speed``: how fast the physics keep up (``--rate`` 200 and 400). Goal: 10 times real time.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.faults.station import Order, misattributed, order_in, undone_orders
from benchmarks.results import count, headline
from benchmarks.rivals.firmware_loop import BINARIES, FirmwareLoop
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
"""Waiting time [s] after the start: the estimator's heading drifts by a degree until it has the gyro biases."""
FASTEST = 10.0
"""Goal: times real time."""


def _open(vehicle: str, instance: int, port: int, effect: str = "", rate: int | None = None) -> FirmwareLoop:
    effects = [parse_effect(effect)] if effect else []
    return FirmwareLoop(
        load_vehicle(vehicle), instance=instance, ports=range(port, port + 3), effects=effects, rate=rate
    )


def _metrics(metrics: Mapping[str, float | None]) -> str:
    value = {name: math.nan if number is None else number for name, number in metrics.items()}
    return (
        f"ITAE {value['itae']:7.3g} s^2  overshoot {value['overshoot']:4.0%}  settles {value['settling']:5.1f} s  "
        f"left {value['steady_error']:6.1%}"
    )


def show_tune(vehicle: str, axis: str, instance: int, port: int, keep: Path) -> bool:
    """Tune one axis and print the step before and after; return whether new gains were kept."""
    run = keep / f"{vehicle}-{axis}"
    firmware = _open(vehicle, instance, port)
    try:
        firmware.run(_WARM_UP)
        status = firmware.host(
            ["tune", axis, "--connect", firmware.tuner_uri, "--yes", "--out", str(run)], keep / f"{run.name}.txt"
        )
    finally:
        firmware.close()
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
    """Hide *effect*, fly and diagnose; return whether it is reported."""
    run = keep / f"{vehicle}-{effect.partition('.')[0]}"
    firmware = _open(vehicle, instance, port, effect)
    try:
        firmware.run(_WARM_UP)
        command = ["experiment", axis, "--connect", firmware.tuner_uri, "--yes", "--out", str(run)]
        status = firmware.host(command, keep / f"{run.name}.txt")
    finally:
        firmware.close()
    command = [sys.executable, "-m", "gcs_autotune", "diagnose", str(run), "--json"]
    process = subprocess.run(command, capture_output=True, text=True, cwd=keep, check=False)
    slug = effect.partition(".")[0]
    try:
        answer = json.loads(process.stdout)
    except json.JSONDecodeError:
        print(f"{vehicle}, {effect} hidden: exit {status}, no diagnosis: {process.stderr.strip()[-200:]}", flush=True)
        return False
    causes, alike = list(answer["causes"]), [group for group in answer["indistinguishable"] if slug in group]
    found = slug in causes or any(set(group) & set(causes) for group in alike)
    group_note = "" if slug in causes or not alike else f" (indistinguishable here: {', '.join(alike[0])})"
    print(f"{vehicle}, {effect} hidden: {answer['verdict']}, {', '.join(causes) or 'nothing'}{group_note}", flush=True)
    return found


def show_station(seed: int, instance: int, port: int, keep: Path) -> bool:
    """Let another station interfere with a tune, drawn by *seed*; return whether its order stands and is reported."""
    draw = random.Random(f"sea-station-{seed}")
    vehicle, axis = draw.choice((*TUNES, TUNES[0]))
    kind = draw.choice(("mode", "mode", "write", "disarm", "sticks"))
    at = draw.uniform(0.0, 150.0 if vehicle == "charlie" else 60.0)
    pause = draw.choice((0.0, draw.uniform(0.2, 1.5)))
    mode = draw.choice((4, 4, 5) if vehicle == "charlie" else (0, 2))
    gain = {"charlie": "ATC_STR_RAT_P", "bluerov2": "ATC_RAT_YAW_P"}[vehicle] if axis == "heading" else "PSC_ACCZ_P"
    run, output = keep / f"station-{seed}", keep / f"station-{seed}.txt"
    station = mavlink.MAVLink(None, srcSystem=255 if kind == "sticks" else 200, srcComponent=100)
    orders: list[Order] = []
    ours: list[Order] = []
    os.environ["XDG_STATE_HOME"] = str(keep / f"state-{seed}")  # a run left open refuses the next on this vehicle
    firmware = _open(vehicle, instance, port)
    began, seen, until, next_stick = math.inf, 0, math.inf, 0.0

    def hear(message: Any) -> None:
        order = order_in(message, firmware.t)
        if order is not None:
            ours.append(order)

    def while_running(process: int) -> None:
        nonlocal began, next_stick, seen, until
        began = min(began, firmware.t if firmware.armed else math.inf)
        if (
            firmware.t - began >= at and not orders and not (kind == "mode" and firmware.mode == mode)
        ):  # that changes nothing
            seen = output.stat().st_size
            value = {"mode": float(mode), "write": 0.1234, "disarm": 0.0, "sticks": 3.0}[kind]
            what = {"disarm": "armed"}.get(kind, kind)
            orders.append(Order(firmware.t, what, value, gain if kind == "write" else "", firmware.mode))
            until = firmware.t + pause
            if pause:
                os.kill(process, signal.SIGSTOP)
            if kind == "mode":
                firmware.send(_command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, value), station)
            elif kind == "disarm":
                firmware.send(_command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0), station)
            elif kind == "write":
                firmware.send(mavlink.MAVLink_param_set_message(1, 1, gain.encode(), value, 9), station)
        if orders and kind == "sticks" and next_stick <= firmware.t < orders[0].t + orders[0].value:
            next_stick = firmware.t + draw.uniform(0.03, 0.07)  # a joystick keeps no step with the vehicle's clock
            firmware.send(
                mavlink.MAVLink_rc_channels_override_message(1, 1, 1640, 1500, 1420, 1630, 1500, 1580, 0, 0), station
            )
        if firmware.t >= until:
            until = math.inf
            os.kill(process, signal.SIGCONT)

    try:
        firmware.run(_WARM_UP)
        firmware.add_listener(hear)
        status = firmware.host(
            ["tune", axis, "--connect", firmware.tuner_uri, "--yes", "--out", str(run)],
            output,
            while_running=while_running,
        )
        firmware.run(5.0)
        left = firmware.get([gain]).get(gain, math.nan)
        ended_in = firmware.mode
    finally:
        firmware.close()
    about = f"{vehicle} {axis}, {kind} {mode if kind == 'mode' else ''} at {at:.0f} s, pause {pause:.1f} s: {status}"
    if not orders:
        print(f"{seed}: {about}; the tune ended before", flush=True)
        return True
    wrong, ties = undone_orders(orders, ours, (4, 5) if vehicle == "charlie" else ())
    if kind == "mode" and ended_in != mode and not ties:
        wrong.append(f"ended in mode {ended_in}")
    if kind == "write" and not math.isclose(left, 0.1234, rel_tol=1e-4) and not ties:
        wrong.append(f"{gain} ended as {left:g}")
    text = " ".join(output.read_bytes()[seen:].decode().split())
    mismatch = misattributed(text, [f"station-{kind}"]) if status else "ended well"
    wrong += [f"{mismatch}: {text[-300:]}"] if mismatch else []
    print(f"{seed}: {about}, ties {ties}; {'; '.join(wrong) or 'right'}", flush=True)
    return not wrong


def _command(number: int, *values: float) -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *values, *[0.0] * (7 - len(values)))


def show_speed(rate: int, instance: int, port: int) -> bool:
    """Run ArduPilot at full speed for ten wall seconds; return whether that is fast enough."""
    good = True
    for vehicle in ("charlie", "bluerov2"):
        firmware = _open(vehicle, instance, port, rate=rate)
        try:
            firmware.run(10.0)
            began, wall = firmware.t, time.monotonic()
            firmware.run_while(lambda wall=wall: time.monotonic() < wall + 10.0)
            times = (firmware.t - began) / (time.monotonic() - wall)
        finally:
            firmware.close()
        print(f"{vehicle}: --rate {rate}: {times * rate:.0f} frames/s, {times:.0f} x real time", flush=True)
        good = good and times >= FASTEST
    return good


def main() -> int:
    """Run the parts; return 0 if every goal is met, 2 without ArduPilot."""
    parser = argparse.ArgumentParser(prog="benchmarks.under_ardupilot", description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="*", help="parts to run: tune, hidden, station, speed (all)")
    parser.add_argument("--instance", type=int, default=20)
    parser.add_argument("--port", type=int, default=14700, help="first of three UDP ports")
    parser.add_argument("--keep", type=Path, help="keep the run directories here")
    parser.add_argument("--cases", type=int, default=12, help="cases of station (12)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the first case of station (1)")
    args = parser.parse_args()
    what = args.what or ["tune", "hidden", "station", "speed"]
    lacking = [name for name in BINARIES.values() if not os.environ.get(name)]
    if lacking:
        print(f"this needs ArduPilot's firmware: set {' and '.join(lacking)} to its binaries")
        return 2
    good = True
    with tempfile.TemporaryDirectory(prefix="under-ardupilot-") as folder:
        keep = args.keep or Path(folder)
        keep.mkdir(parents=True, exist_ok=True)
        if "speed" in what:
            good = min(show_speed(rate, args.instance, args.port) for rate in RATES) and good
        if "tune" in what:
            good = min(show_tune(*case, args.instance, args.port, keep) for case in TUNES) and good
        if "station" in what:
            seeds = range(args.seed, args.seed + args.cases)
            right = sum(show_station(seed, args.instance, args.port, keep) for seed in seeds)
            good = right == args.cases and good
            stands = count("tunes in which the order stands and its cause is reported", right, args.cases, least=1.0)
            headline("under_ardupilot-station", "tunes on ArduPilot's firmware beside another station", [stands])
        if "hidden" in what:
            found = [show_hidden(*case, args.instance, args.port, keep) for case in HIDDEN]
            good = all(found) and good
            figure = count("hidden effects found", sum(found), len(found), least=1.0)
            headline("under_ardupilot", "tunes and hidden effects on ArduPilot's firmware", [figure])
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
