"""A whole tune over a pseudo-terminal with the rate of a serial radio; the bytes are counted.

``python3 -m benchmarks.serial_radio [--baud 57600 115200] [--vehicle charlie] [--axis heading]``
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks.results import Figure, count, headline
from benchmarks.throttled_pty import ThrottledPty
from gcs_autotune.errors import AutotuneError
from gcs_autotune.link import Transport
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import Connection, TuneSettings, tune
from gcs_autotune.workflow.operator import Unattended
from sitl import open_vehicle


@dataclass(frozen=True)
class Ready(Connection):
    """A connection whose link is already made."""

    link: Transport | None = None

    def open(self) -> Transport:
        assert self.link is not None
        return self.link


def run(vehicle: str, axis: str, baud: int, seed: int) -> tuple[str, bool]:
    """Tune over the wire; return a row of the table, and whether the new gains were kept."""
    link = ThrottledPty(open_vehicle(vehicle, seed=seed), baud)
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        settings = TuneSettings(Ready("serial", link=link), Path(folder) / "run", axis=axis)
        try:
            story = tune(settings, Unattended(), SilentObserver(), "benchmark")
            ending = story.ending
        except AutotuneError as error:
            ending = f"{type(error).__name__}: {error}"
    seconds = link.clock.now()
    share = 100.0 / (seconds * baud / 10)
    row = (
        f"| {vehicle} {axis} | {baud} | {ending} | {seconds:.0f} | {link.down.passed * share:.0f} | "
        f"{link.up.passed * share:.0f} | {1e3 * link.down.longest / link.down.rate:.0f} | "
        f"{1e3 * link.up.longest / link.up.rate:.0f} | {link.down.dropped} | {time.process_time() - begun:.0f} |"
    )
    return row, ending == "kept"


COLUMNS = (
    "tune",
    "baud",
    "ending",
    "s",
    "used down %",
    "up %",
    "longest wait down ms",
    "up ms",
    "not sent",
    "CPU s",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--baud", type=int, nargs="+", default=[57600, 115200])
    parser.add_argument("--vehicle", default="charlie")
    parser.add_argument("--axis", default="heading")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    print("|", " | ".join(COLUMNS), "|")
    print("|---|---|---|---|---|---|---|---|---|---|")
    kept = []
    for baud in args.baud:
        row, was_kept = run(args.vehicle, args.axis, baud, args.seed)
        kept += [baud] if was_kept else []
        print(row, flush=True)
    slowest = Figure(
        f"{args.vehicle} {args.axis}, slowest rate tried at which the tune is kept", min(kept, default=0), "baud"
    )
    measures = "a whole tune through a pseudo-terminal with a limited rate"
    headline("serial_radio", measures, [slowest, count("rates at which it is kept", len(kept), len(args.baud))])


if __name__ == "__main__":
    main()
