"""The same missions under ArduPilot's firmware and under the simulated autopilot: ``python3 -m benchmarks.navigation``.

Needs ArduPilot's own SITL (``ARDUPILOT_ROVER``). A hull flies a square of 40 m and a zig-zag of 25 m legs in AUTO, with
WP_RADIUS 2, from five distances: under the real firmware in lock step, and under ours without sensor noise. The gains
are the firmware's defaults, and those of ``tune speed`` followed by ``tune heading``; the water is still, or moves at
0.3 m/s. Measured is the true track, from the first waypoint on:

* ``rms``: of the distance from the leg under way;
* ``late``: the same in the second half of each leg;
* ``corner``: how far the hull goes beyond the new leg at a corner, to the side it comes from; the mean of the corners.

Goal: rms within 10 %, corner within 0.2 m, of the firmware's. Charlie at its defaults weaves across the line in a limit
cycle and never settles: its missions differ as much from each other under the firmware alone. ``--estimator truth``
gives the firmware the true state, so that only the laws are compared.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from statistics import fmean
from typing import Any, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.results import Figure, count, headline
from benchmarks.rivals.firmware_loop import BINARIES, FirmwareError, FirmwareLoop
from sitl import Server, load_vehicle
from sitl.ardupilot_json import HOME as SEA_HOME
from sitl.catalogue import VehicleData
from sitl.effects import HiddenEffect, parse_effect
from sitl.place import HOME, METRES_PER_DEGREE
from sitl.sensors import SensorData
from sitl.vehicle import Vehicle

HULLS = ("charlie", "blueboat")
CURRENT = "steady-current.V_x=0.2121,V_y=0.2121"
RADIUS = 2.0
SQUARE = (0j, 40 + 0j, 40 + 40j, 40j, 0j)
ZIGZAG = tuple(sum((25.0 * (1 + (-1) ** k * 1j) / math.sqrt(2.0) for k in range(n)), 0j) for n in range(6))
TRACKS = {"square": SQUARE, "zig-zag": ZIGZAG}
LEAD = 20.0
"""Metres from where the hull is to the first waypoint, north."""
ESTIMATORS = {"ekf": 3.0, "truth": 10.0}
"""AHRS_EKF_TYPE: the firmware's own filter, whose heading is off by up to a degree; or the simulator's true state."""
WITHIN_RMS, WITHIN_CORNER = 0.1, 0.2
"""Goals: relative, and m."""
_WARM_UP = 240.0
"""Time [s] until the heading of the real estimator is steady."""
_LONGEST = 500.0
"""Seconds a mission may take."""
_ROV_WARM_UP, _ROV_TIME = 60.0, 45.0
_SAMPLE = 0.1
_AUTO = 10
_ALT_HOLD, _GUIDED = 2, 4
_FORCED = 21196.0
_ROV = "bluerov2-sway"
_ROV_CURRENT = "steady-current.V_x=0.06,V_y=0.08"
_ROV_GAINS = {
    "PSC_POSXY_P": 1.0,
    "PSC_VELXY_P": 6.0,
    "PSC_VELXY_I": 0.5,
    "PSC_VELXY_D": 0.0,
    "WPNAV_SPEED": 50.0,
    "PSC_ACCZ_P": 0.5,
    "PSC_ACCZ_I": 0.1,
    "PSC_ACCZ_FF": 0.0,
    "PILOT_SPEED_UP": 200.0,
}
"""The same in both: the two tables of defaults are of different versions."""
_MOVE, _DEEPER = 5 + 3j, 1.0
WITHIN_TRACK = 0.1
"""Goal [m]: how far the two tracks of an ROV may be apart."""


@dataclass
class Track:
    """The true track (time, place) and the time at which each waypoint was reported as reached."""

    places: list[tuple[float, complex]] = field(default_factory=list)
    reached: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Score:
    """Cross-track rms over all, in second halves of legs, and mean corner overshoot [m]."""

    rms: float
    late: float
    corner: float

    def __str__(self) -> str:
        return f"{self.rms:5.2f} {self.late:5.2f} {self.corner:5.2f}"


def mean(scores: Sequence[Score]) -> Score:
    """Return the mean of each figure."""
    rms, late, corner = (fmean(getattr(s, name) for s in scores) for name in ("rms", "late", "corner"))
    return Score(rms, late, corner)


def score(track: Track, waypoints: Sequence[complex]) -> Score:
    """Return how well *track* follows *waypoints*; item 1 of the mission is the first of them.

    A leg that is not finished counts as far as it was flown.
    """
    offsets: list[float] = []
    late: list[float] = []
    beyond: list[float] = []
    for k, (begin, end) in enumerate(itertools.pairwise(waypoints), start=1):
        along = (end - begin) / abs(end - begin)
        since, until = (track.reached.get(n, math.inf) for n in (k, k + 1))
        inside = [p - begin for t, p in track.places if since <= t < until]
        turned = [p / along for p in inside]
        offsets += [p.imag for p in turned]
        late += [p.imag for p in turned if p.real > 0.5 * abs(end - begin)]
        if k > 1:
            came = (begin - waypoints[k - 2]) / along
            beyond.append(max((p.imag * math.copysign(1.0, came.imag) for p in turned), default=0.0))
    return Score(_rms(offsets), _rms(late), fmean(max(distance, 0.0) for distance in beyond))


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(fmean(value**2 for value in values)) if values else 0.0


class Afloat(Protocol):
    """A hull under an autopilot, with a ground station."""

    listener: Callable[[Any], None]

    @property
    def t(self) -> float:
        """Seconds."""

    @property
    def place(self) -> complex:
        """The true place, north + i east of home [m]."""

    def send(self, message: Any) -> None:
        """Send a message."""

    def run(self, seconds: float) -> None:
        """Simulate *seconds*."""

    def globe(self, place: complex) -> tuple[int, int]:
        """Return latitude and longitude [1e-7 deg]."""

    def go(self, mode: int) -> None:
        """Arm and enter *mode*."""

    def rest(self) -> None:
        """Disarm, in MANUAL."""


class Ours:
    """A hull under the simulated autopilot."""

    def __init__(
        self, name: str, parameters: Mapping[str, float], effects: Sequence[HiddenEffect], seed: int = 0
    ) -> None:
        data = load_vehicle(name)
        quiet = SensorData(**dict.fromkeys((f.name for f in fields(SensorData)), 0.0))
        vehicle = Vehicle(replace(data, sensors=quiet), parameters=parameters, effects=effects, seed=seed)
        self._server = Server(vehicle)
        self._mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._ear = mavlink.MAVLink(None)
        self.listener: Callable[[Any], None] = lambda message: None

    @property
    def t(self) -> float:
        return self._server.now

    @property
    def place(self) -> complex:
        return complex(self._server.vehicle.state.x, self._server.vehicle.state.y)

    def send(self, message: Any) -> None:
        self._server.receive(message.pack(self._mav))

    def run(self, seconds: float) -> None:
        end = self.t + seconds
        while self.t < end - 1e-9:
            self.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *[1500] * 6, *[65535] * 2))
            for message in self._ear.parse_buffer(self._server.advance_to(min(end, self.t + 0.1))) or ():
                self.listener(message)

    def globe(self, place: complex) -> tuple[int, int]:
        return _globe(place, *HOME)

    def go(self, mode: int) -> None:
        self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        self._command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, mode)

    def rest(self) -> None:
        self._command(mavlink.MAV_CMD_DO_SET_MODE, 1.0)
        self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, _FORCED)

    def _command(self, number: int, *values: float) -> None:
        padded = [*values, *[0.0] * (7 - len(values))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))
        self.run(0.1)


class Theirs(FirmwareLoop):
    """A hull under ArduPilot's own firmware."""

    def __init__(
        self,
        data: VehicleData,
        parameters: Mapping[str, float],
        effects: Sequence[HiddenEffect],
        options: argparse.Namespace,
    ) -> None:
        data = replace(data, parameters={**data.parameters, **parameters})
        ports = range(options.port, options.port + 3)
        super().__init__(data, instance=options.instance, ports=ports, effects=effects)
        self.listener: Callable[[Any], None] = lambda message: None

    @property
    def place(self) -> complex:
        state = self.physics.craft.plant.state
        return complex(state.x, state.y)

    def _hear(self, message: Any) -> None:
        super()._hear(message)
        self.listener(message)

    def globe(self, place: complex) -> tuple[int, int]:
        latitude, longitude, *_ = map(float, SEA_HOME.split(","))
        return _globe(place, latitude, longitude)


def _globe(place: complex, latitude: float, longitude: float) -> tuple[int, int]:
    east = METRES_PER_DEGREE * math.cos(math.radians(latitude))
    return round(1e7 * (latitude + place.real / METRES_PER_DEGREE)), round(1e7 * (longitude + place.imag / east))


def sail(boat: Afloat, waypoints: Sequence[complex], lead: float = LEAD) -> Score:
    """Fly a mission over *waypoints*, the first one *lead* [m] north of here, and return its score."""
    first = boat.place + lead
    places = [boat.place, *(first + w - waypoints[0] for w in waypoints)]
    track = Track()
    done = False

    def hear(message: Any) -> None:
        nonlocal done
        kind = message.get_type()
        if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
            x, y = boat.globe(places[message.seq])
            about = (message.seq, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_CMD_NAV_WAYPOINT, 0, 1)
            boat.send(mavlink.MAVLink_mission_item_int_message(1, 1, *about, 0, 0, 0, 0, x, y, 0.0, 0))
        elif kind == "MISSION_ACK":
            done = message.type == mavlink.MAV_MISSION_ACCEPTED
        elif kind == "MISSION_ITEM_REACHED":
            track.reached.setdefault(message.seq, boat.t)

    boat.listener = hear
    for _ in range(5):
        boat.send(mavlink.MAVLink_mission_count_message(1, 1, len(places), 0))
        boat.run(2.0)
        if done:
            break
    else:
        raise FirmwareError("the mission was not taken")
    boat.go(_AUTO)
    end = boat.t + _LONGEST
    while len(waypoints) not in track.reached and boat.t < end:
        boat.run(_SAMPLE)
        track.places.append((boat.t, boat.place))
    boat.rest()
    return score(track, places[1:])


def tuned_gains(name: str, folder: Path) -> dict[str, float]:
    """Return the gains of ``tune speed`` followed by ``tune heading`` on the simulated hull *name*."""
    gains: dict[str, float] = {}
    for axis in ("speed", "heading"):
        vehicle = folder / f"{name}-{axis}.toml"
        rows = "".join(f'{n} = {{ value = {v!r}, unit = "", source = "tune" }}\n' for n, v in gains.items())
        vehicle.write_text(f'like = "{name}"\n[parameters]\n{rows}')
        out = folder / f"{name}-{axis}"
        command = [sys.executable, "-m", "gcs_autotune", "tune", axis, "--connect", f"sitl:{vehicle}?seed=1", "--yes"]
        subprocess.run([*command, "--out", str(out)], check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        changed = json.loads((out / "summary.json").read_text())["gains"]
        gains |= {n: new for n, (_, new) in changed.items()}
    return gains


def fly(boat: Afloat, options: argparse.Namespace) -> dict[str, list[Score]]:
    """Fly every track :attr:`starts` times, each time from another distance."""
    boat.run(_WARM_UP)
    leads = [LEAD + 2.0 * k for k in range(options.starts)]
    return {track: [sail(boat, TRACKS[track], lead) for lead in leads] for track in options.tracks}


def show(
    hull: str, gains: Mapping[str, float], how: str, water: str, options: argparse.Namespace
) -> list[tuple[bool, bool, bool]]:
    """Fly both tracks under both autopilots and print the scores.

    Return for each track whether rms and corner are within their goals, and rms within the spread of the firmware's.
    """
    effects = [CURRENT] if water else []
    needed = {**gains, "WP_RADIUS": RADIUS, "AHRS_EKF_TYPE": ESTIMATORS[options.estimator]}
    firmware = Theirs(load_vehicle(hull), needed, [parse_effect(e) for e in effects], options)
    try:
        theirs = fly(firmware, options)
    finally:
        firmware.close()
    ours = fly(Ours(hull, {**gains, "WP_RADIUS": RADIUS}, [parse_effect(e) for e in effects]), options)
    good: list[tuple[bool, bool, bool]] = []
    for track in options.tracks:
        real, mine = mean(theirs[track]), mean(ours[track])
        rms, corner = mine.rms / real.rms - 1.0, mine.corner - real.corner
        low, high = min(s.rms for s in theirs[track]), max(s.rms for s in theirs[track])
        good.append((abs(rms) <= WITHIN_RMS, abs(corner) <= WITHIN_CORNER, low <= mine.rms <= high))
        spread = f"{low:.2f} to {high:.2f}"
        print(
            f"{hull:9} {how:8} {water or 'still':8} {track:8} {real}  | {mine}  {rms:+6.1%} {corner:+6.2f} m  "
            f"(the firmware's rms: {spread})",
            flush=True,
        )
    return good


def show_rov(water: str, options: argparse.Namespace) -> float:
    """Move an ROV in GUIDED under both autopilots; return the largest distance between the tracks [m]."""
    effects = [parse_effect(_ROV_CURRENT)] if water else []
    needed = {**_ROV_GAINS, "AHRS_EKF_TYPE": ESTIMATORS[options.estimator]}
    firmware = Theirs(load_vehicle(_ROV), needed, effects, options)
    try:
        theirs = _move(firmware)
    finally:
        firmware.close()
    ours = _move(Ours(_ROV, _ROV_GAINS, [parse_effect(_ROV_CURRENT)] if water else []))
    apart = max(abs(a - b) for a, b in zip(theirs, ours, strict=True))
    left = abs(theirs[-1] - _MOVE), abs(ours[-1] - _MOVE)
    print(
        f"{_ROV:18} {water or 'still':8} apart {apart:.2f} m; at the end off by {left[0]:.2f} | {left[1]:.2f} m",
        flush=True,
    )
    return apart


def _move(rov: Afloat) -> list[complex]:
    """Dive, hold, go to :data:`_MOVE` from there, and return the way in steps of :data:`_SAMPLE`."""
    rov.run(_ROV_WARM_UP)
    rov.go(_ALT_HOLD)
    for _ in range(20):
        rov.send(_target(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, -4.0))
        rov.run(1.0)
    rov.go(_GUIDED)
    rov.run(20.0)
    begin = rov.place
    offset, only_place = mavlink.MAV_FRAME_LOCAL_OFFSET_NED, 0b110111111000
    way = (_MOVE.real, _MOVE.imag, _DEEPER)
    rov.send(mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, offset, only_place, *way, *[0.0] * 8))
    places, began = [], rov.t
    for k in range(1, round(_ROV_TIME / _SAMPLE) + 1):
        rov.run(began + k * _SAMPLE - rov.t)
        places.append(rov.place - begin)
    return places


def _target(frame: int, altitude: float) -> Any:
    only_depth = 0b110111111011
    return mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, only_depth, 0, 0, altitude, *[0.0] * 8
    )


def main() -> int:
    """Run all cases; 0 when every goal is met, 2 without ArduPilot."""
    parser = argparse.ArgumentParser(prog="benchmarks.navigation", description=__doc__.splitlines()[0])
    parser.add_argument("hulls", nargs="*", default=list(HULLS), help=f"of {', '.join(HULLS)}; default all")
    parser.add_argument("--tracks", nargs="*", default=list(TRACKS), choices=list(TRACKS))
    parser.add_argument("--gains", nargs="*", default=["default", "tuned"], choices=["default", "tuned"])
    parser.add_argument("--water", nargs="*", default=["", "current"], choices=["", "current"])
    parser.add_argument("--starts", type=int, default=5, help="flights of each track, averaged (5)")
    parser.add_argument("--estimator", default="ekf", choices=list(ESTIMATORS), help="estimator of the firmware (ekf)")
    parser.add_argument("--instance", type=int, default=30)
    parser.add_argument("--port", type=int, default=14800, help="first of three UDP ports")
    options = parser.parse_args()
    if not os.environ.get(BINARIES["rover"]):
        print(f"this needs ArduPilot's firmware: set {BINARIES['rover']} to its binary")
        return 2
    print("hull      gains    water    track      rms  late corner | ours: the same          difference")
    good: list[tuple[bool, bool, bool]] = []
    with tempfile.TemporaryDirectory(prefix="navigation-") as folder:
        for hull in options.hulls:
            tuned = tuned_gains(hull, Path(folder)) if "tuned" in options.gains else {}
            for how, water in itertools.product(options.gains, options.water):
                good += show(hull, tuned if how == "tuned" else {}, how, water, options)
    rms, corners, inside = (sum(column) for column in zip(*good, strict=True))
    figures = [
        count("missions with a cross-track rms within 10 % of the firmware's", rms, len(good), least=1.0),
        count("missions with the firmware's corner overshoot within 0.2 m", corners, len(good), least=1.0),
    ]
    if options.starts > 1:
        figures.append(count("missions with an rms within the spread of the firmware's own", inside, len(good)))
    if os.environ.get(BINARIES["sub"]):
        apart = max(show_rov(water, options) for water in options.water)
        figures.append(Figure("ROV in GUIDED, greatest distance between the two tracks", apart, "m", most=WITHIN_TRACK))
    else:
        print(f"the ROV is left out: set {BINARIES['sub']} to the binary of ArduPilot's firmware")
    name = "navigation" if options.estimator == "ekf" else f"navigation-{options.estimator}"
    headline(name, "missions of the simulated autopilot compared with ArduPilot's firmware", figures)
    return 0 if all(figure.met is not False for figure in figures) else 1


if __name__ == "__main__":
    sys.exit(main())
