"""Rechecks of simulated vehicles after a tune: with the tuned gains, and with the original ones.

Each vehicle is tuned on each of its loops, and then rechecked twice. A vehicle with its tuned gains has not changed, so
the recheck must call it good. A vehicle with the gains from before the tune must not be called good, because the tune
has measured that its gains are better.

Goals: each at least 95 %.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.reach import Aboard
from benchmarks.results import count, headline
from gcs_autotune.axes import AXES
from gcs_autotune.errors import AutotuneError
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import CommonSettings, FlightPlan, FlySettings, TuneSettings, Unattended, recheck, tune
from sitl import Server, open_vehicle

BOATS = ("charlie", "blueboat", "launch", "vectored-boat")
ROVS = ("bluerov2", "videoray", "falcon", "bluerov2-6dof")
CASES = (*((boat, axis) for boat in BOATS for axis in ("heading", "speed")), ("automarine", "heading"),
         *((rov, axis) for rov in ROVS for axis in ("heading", "depth")))  # fmt: skip
WHEN = "2026-11-29T12:00:00"


@dataclass(frozen=True)
class Pair:
    """The verdicts with the tuned and with the original gains; a text in brackets is the reason why there is none."""

    vehicle: str
    axis: str
    seed: int
    tuned: str
    original: str


def rechecked(vehicle: str, axis: str, seed: int) -> Pair | None:
    """Tune, and recheck with both sets of gains; None if the tune kept no new gains."""
    with tempfile.TemporaryDirectory() as folder:
        runs = Path(folder)
        settings = TuneSettings(Aboard(server=open_vehicle(vehicle, seed=seed)), runs / "tune", axis=axis)
        story = tune(settings, Unattended(), SilentObserver(), WHEN)
        if story.ending != "kept":
            return None
        gains = {"tuned": {c.parameter: c.new for c in story.changes}, "original": {}}
        servers = {name: open_vehicle(vehicle, seed=seed + 1000, parameters=own) for name, own in gains.items()}
        return Pair(vehicle, axis, seed, *(_verdict(server, axis, runs, name) for name, server in servers.items()))


def _verdict(server: Server, axis: str, runs: Path, name: str) -> str:
    kind = AXES[axis]
    common = CommonSettings(Aboard(server=server), runs / name)
    plan = FlightPlan.of(FlySettings("set-point-relay", common, force=kind.names.force))
    try:
        return recheck(plan, kind, Unattended(), SilentObserver(), WHEN, runs).kind
    except AutotuneError as error:
        return f"({error})"


def _cases(only: Sequence[str]) -> Iterator[tuple[str, str]]:
    for vehicle, axis in CASES:
        if not only or vehicle in only or f"{vehicle}/{axis}" in only:
            yield vehicle, axis


def main() -> None:
    """Print one line per vehicle, loop and seed, and the rates."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", help="vehicle or vehicle/axis (default: all)")
    parser.add_argument("--seeds", type=int, default=2, help="seeds of each case (2)")
    parser.add_argument("--first-seed", type=int, default=1)
    args = parser.parse_args()
    pairs = []
    for seed in range(args.first_seed, args.first_seed + args.seeds):
        for vehicle, axis in _cases(args.cases):
            pair = rechecked(vehicle, axis, seed)
            shown = "the tune kept no gains" if pair is None else f"tuned {pair.tuned}, original {pair.original}"
            print(f"   {vehicle} {axis} seed {seed}: {shown}", flush=True)
            pairs += [pair] * (pair is not None)
    headline("rechecks", "rechecks of tuned vehicles, with the tuned and with the original gains", [
        count("unchanged loops called good", sum(p.tuned == "good" for p in pairs), len(pairs), least=0.95),
        count("loops with the original gains not called good",
              sum(p.original in ("degraded", "poorly damped", "oscillates") for p in pairs), len(pairs), least=0.95),
    ])  # fmt: skip


if __name__ == "__main__":
    main()
