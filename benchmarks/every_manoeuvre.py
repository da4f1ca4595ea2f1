"""Whether every manoeuvre of the table flies to its end at its usual sizes, on every simulated vehicle that can fly it.

Run: ``python3 -m benchmarks.every_manoeuvre [VEHICLE ...] [--only NAME,..] [--force X,..]``. Each is flown over MAVLink
inside the usual limits, by every force that it may drive. Printed: how each ended, what was made of it, what was said;
exit status 1 when one ended early without having been refused, or left the vehicle other than neutral and disarmed.
``hand-release`` (somebody must push) and ``wall-relay`` (needs a wall) are flown where the vehicle has what they need.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from gcs_autotune.errors import AutotuneError, PreconditionFailed, WrongVehicle
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import MemoryLink
from gcs_autotune.manoeuvres import MANOEUVRES
from gcs_autotune.watch import SilentWatcher
from gcs_autotune.workflow import Connection, FlySettings, TuneSettings, Unattended, fly
from sitl import VEHICLES, open_vehicle

BY_HAND = "hand-release"
QUICK = {"SCHED_LOOP_RATE": 100.0}
"""An ArduSub whose 400 Hz do not matter here: a quarter of the work."""


class Ear(SilentWatcher):
    """Hears whether it was armed."""

    armed = False

    def say(self, text: str) -> None:
        """Take what is said once all that comes before arming is over."""
        self.armed = self.armed or text.startswith("found: mode")


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


def flown(vehicle: str, name: str, force: str) -> tuple[bool, str]:
    """Fly one; return whether it came to its end or was refused beforehand, and what is to be said of it."""
    server = open_vehicle(vehicle, seed=1)
    if not server.vehicle.data.is_boat:
        server = open_vehicle(vehicle, seed=1, parameters=QUICK)
    link = MemoryLink(server)
    link.is_simulated = True
    with tempfile.TemporaryDirectory() as place:
        ear = Ear()
        common = TuneSettings("heading", Connection("memory", opened=link), Path(place) / "run")
        try:
            result = fly(FlySettings(name, common, force=force), Unattended(), ear, "")
            models = ", ".join(model.fit.dof for model in result.models) or "no model"
            trial = result.trial
            assert trial is not None  # it was flown
            good, told = True, f"{trial.duration:.0f} s, {models}; {' '.join(result.remarks)}"
        except AutotuneError as error:
            good = isinstance(error, (PreconditionFailed, WrongVehicle)) and not ear.armed
            told = f"{'refused' if good else type(error).__name__}: {error}"
    autopilot = server.vehicle.autopilot
    if autopilot.armed or any(pwm not in (0, 1500) for pwm in autopilot.pwm):
        return False, f"NOT LEFT AS FOUND; {told}"
    return good, told.replace(place, "DIR")


def main() -> int:
    """Fly all of them and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("vehicles", nargs="*", metavar="VEHICLE")
    parser.add_argument("--only", default="", metavar="NAME,..")
    parser.add_argument("--force", default="", metavar="X,..")
    args = parser.parse_args()
    only, forces = ({x for x in text.split(",") if x} for text in (args.only, args.force))
    done = bad = 0
    for vehicle in args.vehicles or sorted(VEHICLES):
        for name, force in cases(vehicle, only, forces):
            good, told = flown(vehicle, name, force)
            done, bad = done + 1, bad + (not good)
            mark = "" if good else "ENDED EARLY "
            sys.stdout.write(f"{vehicle} {name}{f' {force}' if force else ''}: {mark}{told}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{done} flown or refused beforehand, {bad} ended early\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
