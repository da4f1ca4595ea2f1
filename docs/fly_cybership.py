"""Fly zig-zag, circle and steps on the simulated CyberShip II without the sign check, which rejects it:

python3 docs/fly_cybership.py runs/cybership2
python3 docs/draw_manoeuvres.py runs/cybership2 docs/pictures/cybership2.svg

The craft is not stable on its course, so the check cannot read its response to a pulse. It can still fly a zig-zag, a
circle and steps. For a simulated vehicle only.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

from gcs_autotune.limits import limit_of
from gcs_autotune.link import MemoryLink, Session, open_craft
from gcs_autotune.manoeuvres import MANOEUVRES, Envelope, Sequencer, restore_on_exit
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow.connection import telemetry_rates
from gcs_autotune.workflow.record import RunDirectory
from sitl import open_vehicle

ANY_HEADING = Envelope(heading_excursion=math.inf)
ASKED = {"throttle": 0.2, "speed": 0.4, "side": 1.0, "keep-still": 0.0}
"""A fifth of full thrust, 0.4 m/s at its scale."""


def main(run: Path) -> None:
    """Fly them one after the other, each from rest, and leave *run* as a flight does."""
    record = RunDirectory(run)
    record.make()
    for name in ("zig-zag", "turning-circle", "steps"):
        kind = MANOEUVRES[name]
        rows = {option: limit_of(option, kind.axis) for option in kind.options}
        usual = {option: row.default * row.factor for option, row in rows.items() if row.default is not None}
        assert kind.make is not None
        manoeuvre = kind.make({**usual, "steering": 0.6, **ASKED})
        with Session(MemoryLink(open_vehicle("cybership2", seed=1))) as session:
            craft = open_craft(session, wanted_rates=telemetry_rates(10.0))
            with restore_on_exit(craft, SilentObserver()):
                craft.set_mode(craft.firmware.manual_mode)
                craft.arm()
                Sequencer(craft, ANY_HEADING, SilentObserver(), record.keep).fly(manoeuvre)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
