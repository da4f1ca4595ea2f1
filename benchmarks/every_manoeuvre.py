"""Every manoeuvre at its default sizes, on every simulated vehicle, against the announced space and time.

Run: ``python3 -m benchmarks.every_manoeuvre [VEHICLE ...] [--only NAME,..] [--force X,..] [--tunes] [--seed S]
[--quick]``. Each is flown over MAVLink inside the default limits, by every force that it may drive. It prints the
ending, the result and the messages. Exit status 1 if one ended early without having been rejected, or left the vehicle
other than neutral and disarmed.

A table then compares announced and used: the greatest distance from the starting point (of the true hull, until it has
stopped), and the time from arming until everything is restored. Goal: never less than used, at most 1.5 times it. For a
loop two numbers are announced: used is compared with the larger one, and the usual one with 1.5 times used.
``--tunes`` adds tunes and experiments, ``--quick`` leaves out figures and models.
``hand-release`` (a person must push) and ``wall-relay`` (needs a wall) are flown if the vehicle has what they need.
"""

from __future__ import annotations

import argparse
import importlib
import math
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.results import count, headline
from gcs_autotune.errors import AutotuneError, PreconditionFailed, WrongVehicle
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import MemoryLink
from gcs_autotune.manoeuvres import MANOEUVRES
from gcs_autotune.observer import Progress, SilentObserver
from gcs_autotune.report import Document
from gcs_autotune.workflow import (
    CommonSettings,
    Connection,
    FlightResult,
    FlySettings,
    TuneSettings,
    Unattended,
    experiment,
    fly,
    tune,
)
from sitl import VEHICLES, Server, open_vehicle

fly_module = importlib.import_module("gcs_autotune.workflow.fly")

BY_HAND = "hand-release"
POINTS = ((20.0, 15.0, 0.0), (40.0, 30.0, 8.0))
"""Timed points of a trajectory: seconds, metres ahead, metres to starboard."""
SLOW_LOOP = {"SCHED_LOOP_RATE": 100.0}
"""Parameters of an ArduSub at 100 Hz, which needs a quarter of the processor time of 400 Hz."""


class Monitor(SilentObserver):
    """Record whether the vehicle was armed, what was announced, and the largest distance of *server*'s hull."""

    def __init__(self, server: Server) -> None:
        self._vehicle = server.vehicle
        self.armed, self.announced = False, ""
        self._began, self._home, self.far = math.nan, (0.0, 0.0), 0.0

    def say(self, text: str) -> None:
        """Record the announcements, and the state before the run."""
        if text.startswith("will "):
            self.announced += f"{text} "
        if text.startswith("State before the run: mode"):
            self.armed = True
            self._began, self._home = self._vehicle.seconds, (self._vehicle.state.x, self._vehicle.state.y)

    def update(self, progress: Progress) -> None:
        """Update the largest distance."""
        if self.armed:
            self.far = max(self.far, self._away)

    @property
    def _away(self) -> float:
        return math.hypot(self._vehicle.state.x - self._home[0], self._vehicle.state.y - self._home[1])

    def used(self) -> tuple[float, float]:
        """Return the time [s] by now, and the distance [m] once the hull has stopped."""
        seconds, vehicle = self._vehicle.seconds - self._began, self._vehicle
        until = vehicle.seconds + COASTS
        while vehicle.seconds < until and abs(vehicle.state.u) > STOPPED:
            vehicle.move()
            vehicle.control()
            self.far = max(self.far, self._away)
        return seconds, self.far


COASTS, STOPPED = 60.0, 0.02
"""Longest time [s] to wait for a coasting hull, and speed [m/s] below which it has stopped. Project choice."""
MOST = 1.5
"""Goal: largest ratio of announced to used."""
_TIME = r"(?:(\d+) min ?)?(?:(\d+) s)?"


@dataclass(frozen=True)
class Announcement:
    """Announced values (largest, usual) and used ones: time [s] and distance [m]; NaN if not announced."""

    most: tuple[float, float]
    usual: tuple[float, float]
    used: tuple[float, float]

    @property
    def misses(self) -> str:
        """Return which announced values are too small or too large."""
        found = []
        for name, most, usual, used in zip(("time", "distance"), self.most, self.usual, self.used, strict=True):
            if math.isfinite(most) and used > most:
                found.append(f"{name} LOW")
            if math.isfinite(usual) and usual > MOST * used:
                found.append(f"{name} HIGH {usual / used:.1f}" if used else f"{name} HIGH")
        return ", ".join(found)


def parse_announcement(text: str, used: tuple[float, float]) -> Announcement:
    """Return the announced values in *text*."""
    far = re.search(r"needs? up to ([\d.]+) m\b", text)
    metres = float(far[1]) if far else math.nan
    whole = re.search(rf"(?:and|needs) up to (?!\d+ m\b){_TIME}", text) or re.search(rf"take about {_TIME}", text)
    longest = re.search(rf"vehicle's time, up to {_TIME}", text) or whole
    usual = re.search(rf"usually (?:need )?(?:(?:about|only) .*? and )?(?:about )?(?=\d+ (?:min|s)\b){_TIME}", text)
    near = re.search(r"usually (?:need )?about (\d+) m\b", text)
    seconds, most = (_seconds(found.groups()) if found else math.nan for found in (whole, longest))
    usually = _seconds(usual.groups()) if usual else seconds, float(near[1]) if near else metres
    return Announcement((most, metres), usually, used)


def _seconds(pair: Sequence[str | None]) -> float:
    return 60.0 * float(pair[0] or 0.0) + float(pair[1] or 0.0)


def cases(vehicle: str, only: set[str], forces: set[str]) -> Iterator[tuple[str, str]]:
    """Yield manoeuvre and force (empty: its own) of all that the vehicle's firmware can fly."""
    boat = open_vehicle(vehicle, seed=1).vehicle.data.is_boat
    firmware = FIRMWARE["ardurover" if boat else "ardusub"]
    for kind in MANOEUVRES.values():
        if kind.make is None or kind.name == BY_HAND or (only and kind.name not in only):
            continue
        for force in firmware.channels if kind.for_force else ("",):
            if forces and force and force not in forces:
                continue
            try:
                suits = kind.of(force).suits(firmware)
            except AutotuneError:
                continue  # this manoeuvre does not drive that force
            if suits:
                yield kind.name, force


def flown(vehicle: str, name: str, force: str, seed: int = 1) -> tuple[bool, str, Announcement | None]:
    """Fly one; return whether it was completed or rejected, a summary, and its announcement (None if not completed)."""
    server = open_vehicle(vehicle, seed=seed)
    if not server.vehicle.data.is_boat:
        server = open_vehicle(vehicle, seed=seed, parameters=SLOW_LOOP)
    link = MemoryLink(server)
    link.is_simulated = True
    with tempfile.TemporaryDirectory() as place:
        monitor, announcement = Monitor(server), None
        verb, _, axis = name.rpartition(" ")
        where = Connection("memory", opened=link), Path(place) / "run"
        try:
            if verb:
                settings = TuneSettings(*where, axis=axis)
                {"tune": tune, "experiment": experiment}[verb](settings, Unattended(), monitor, "")
                good, text = True, "done"
            else:
                points = POINTS if MANOEUVRES[name].timed else ()
                result = fly(
                    FlySettings(name, CommonSettings(*where), force=force, points=points), Unattended(), monitor, ""
                )
                models = ", ".join(model.fit.dof for model in result.models) or "no model"
                trial = result.trial
                assert trial is not None  # it was flown
                good, text = True, f"{trial.duration:.0f} s, {models}; {' '.join(result.remarks)}"
            announcement = parse_announcement(monitor.announced, monitor.used()) if monitor.armed else None
        except AutotuneError as error:
            good = isinstance(error, (PreconditionFailed, WrongVehicle)) and not monitor.armed
            text = f"{'rejected' if good else type(error).__name__}: {error}"
    autopilot = server.vehicle.autopilot
    if autopilot.armed or any(pwm not in (0, 1500) for pwm in autopilot.pwm):
        return False, f"NOT RESTORED; {text}", announcement
    return good, text.replace(place, "DIR"), announcement


def tunes(vehicle: str) -> Iterator[tuple[str, str]]:
    """Yield the tunes and experiments of the vehicle's firmware."""
    boat = open_vehicle(vehicle, seed=1).vehicle.data.is_boat
    for axis in FIRMWARE["ardurover" if boat else "ardusub"].axes:
        yield f"tune {axis}", ""
    yield from (("experiment heading", ""), ("experiment surge", ""))


def show(announcements: Sequence[tuple[str, Announcement]]) -> None:
    """Print the table of announced against used."""
    sys.stdout.write(f"\n{'':<34}{'time used':>10}{'usual':>7}{'most':>7}{'distance':>10}{'usual':>7}{'most':>7}\n")
    for case, announcement in announcements:
        pairs = zip(announcement.used, announcement.usual, announcement.most, strict=True)
        (s, s_usual, s_most), (m, m_usual, m_most) = pairs
        numbers = f"{s:>8.0f} s{s_usual:>7.0f}{s_most:>7.0f}{m:>8.1f} m{m_usual:>7.0f}{m_most:>7.0f}"
        sys.stdout.write(f"{case:<34}{numbers}  {announcement.misses}\n")
    low, high = (sum(word in one.misses for _, one in announcements) for word in ("LOW", "HIGH"))
    sys.stdout.write(f"{len(announcements)} runs: {low} used more than announced, {high} less than 1/{MOST:g} of it\n")


def main() -> int:
    """Fly all of them and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("vehicles", nargs="*", metavar="VEHICLE")
    parser.add_argument("--only", default="", metavar="NAME,..")
    parser.add_argument("--force", default="", metavar="X,..")
    parser.add_argument("--tunes", action="store_true", help="also fly tunes and experiments")
    parser.add_argument("--seed", type=int, default=1, help="seed of the simulator's noise and wind (1)")
    parser.add_argument("--quick", action="store_true", help="without figures and models of the records")
    args = parser.parse_args()
    if args.quick:
        fly_module.read_flight = lambda *flight: FlightResult(flight[3][:1], Path(), Document("", ()))  # type: ignore[attr-defined]
    only, forces = ({x for x in text.split(",") if x} for text in (args.only, args.force))
    done = bad = 0
    announcements: list[tuple[str, Announcement]] = []
    for vehicle in args.vehicles or sorted(VEHICLES):
        for name, force in (*cases(vehicle, only, forces), *(tunes(vehicle) if args.tunes else ())):
            good, text, announcement = flown(vehicle, name, force, args.seed)
            if announcement is not None:
                announcements.append((f"{vehicle} {name} {force}", announcement))
            done, bad = done + 1, bad + (not good)
            mark = "" if good else "ENDED EARLY "
            sys.stdout.write(f"{vehicle} {name}{f' {force}' if force else ''}: {mark}{text}\n")
            sys.stdout.flush()
    show(announcements)
    enough = sum("LOW" not in one.misses for _, one in announcements)
    figures = [
        count("runs within the announced distance and time", enough, len(announcements), least=1.0),
        count("flown to their end, or rejected before arming", done - bad, done),
    ]
    headline("every_manoeuvre", "every manoeuvre on every simulated vehicle", figures)
    sys.stdout.write(f"{done} flown or rejected, {bad} ended early\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
