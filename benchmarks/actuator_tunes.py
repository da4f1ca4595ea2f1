"""How often ``tune actuators`` writes, proves and keeps, and how proportional thrust is before and after.

Each boat is flown as it is and with a hidden dead zone, a hidden thrust curve, and a hidden weakness astern::

    python3 -m benchmarks.actuator_tunes                             # three boats, four cases, five seeds: an hour
    python3 -m benchmarks.actuator_tunes blueboat --seeds 2

It is the study ``benchmarks/studies/actuator_tunes.toml``; a stopped run continues.

A tune that is kept although thrust is less proportional, or tracking worse by more than a tenth, counts as worse.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.reach import Aboard
from benchmarks.results import Figure, count, headline
from benchmarks.studies import rows_of
from gcs_autotune.errors import AutotuneError
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import TuneSettings, Unattended, tune_actuators
from sitl import open_vehicle
from sitl.effects import parse_effect

CASES: Mapping[str, str] = {
    "as it is": "",
    "dead zone": "dead-zone@X.width=0.1",
    "curve": "quadratic-actuator@X.share=0.6",
    "weak astern": "asymmetric-thrust@X.ratio=0.6",
}
WORSE = 1.1


def fly(boat: str, case: str, seed: int) -> dict[str, Any]:
    """Return the ending, the departure from proportional thrust and the ITAE before and after, and what was written."""
    effects = [parse_effect(CASES[case])] if CASES[case] else []
    server = open_vehicle(boat, seed=seed, effects=effects)
    before = dict(server.vehicle.parameters.values)
    with tempfile.TemporaryDirectory() as folder:
        settings = TuneSettings(Aboard(server=server), Path(folder) / "run", axis="speed")
        try:
            story = tune_actuators(settings, Unattended(), SilentObserver(), "2026-11-26T12:00:00")
        except AutotuneError as error:
            left = {n: v for n, v in server.vehicle.parameters.values.items() if v != before[n]}
            return {"ending": "aborted", "reason": str(error), "left": left}
    after = dict(server.vehicle.parameters.values)
    departures = [one and one.departure for one in (story.thrust_before, story.thrust_after)]
    errors = [one and one.itae for one in (story.metrics_before, story.metrics_after)]
    return {
        "ending": story.ending,
        "reason": "; ".join(story.verdict_reasons) or story.reason,
        "departure": departures,
        "itae": errors,
        "proposed": {c.parameter: c.new for c in story.changes},
        "left": {n: v for n, v in after.items() if v != before[n]},
    }


def tuned(seed: int, boat: str, case: str) -> dict[str, Any]:
    """Return the result of one tune, for a row of the study."""
    found = fly(boat, case, seed)
    return {"tune": json.dumps(found), "kept": found["ending"] == "kept", "worse": is_worse(found)}


def is_worse(flown: Mapping[str, Any]) -> bool:
    """Return whether a vehicle was left worse than it was."""
    if flown["ending"] != "kept":
        return bool(flown["left"])
    (old, new), (e_old, e_new) = flown["departure"], flown["itae"]
    return bool(new > old + 0.01 or e_new > WORSE * e_old)


def line_of(name: str, flown: Sequence[Mapping[str, Any]]) -> str:
    """Return one line of the table."""
    proposed = [f for f in flown if f.get("proposed")]
    proved = [f for f in proposed if f["departure"][1] is not None]
    kept = [f for f in flown if f["ending"] == "kept"]
    before, after = (
        100.0 * float(np.median([f["departure"][k] for f in kept])) if kept else float("nan") for k in (0, 1)
    )
    error = float(np.median([f["itae"][1] / f["itae"][0] for f in kept])) if kept else float("nan")
    return (
        f"{name:<28}{len(flown):>4}{len(proposed):>9}{len(proved):>8}{len(kept):>6}{sum(map(is_worse, flown)):>7}"
        f"{before:>9.1f}{after:>8.1f}{error:>8.2f}"
    )


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("boats", nargs="*", metavar="VEHICLE", help="default: those of the study")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args(argv)
    only = {"argument.boat": tuple(args.boats)} if args.boats else {}
    tunes: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows_of("actuator_tunes", args.workers, only=only, repeats=args.seeds):
        tunes.setdefault((row["argument.boat"], row["argument.case"]), []).append(json.loads(row["tune"]))
    print(f"{'':<28}{'runs':>4}{'proposed':>9}{'proved':>8}{'kept':>6}{'worse':>7}{'dep. %':>9}{'after':>8}{'ITAE':>8}")
    for (boat, case), own in tunes.items():
        print(line_of(f"{boat}, {case}", own))
    every = [one for own in tunes.values() for one in own]
    kept = [f for f in every if f["ending"] == "kept"]
    smaller = float(np.median([f["departure"][1] / f["departure"][0] for f in kept])) if kept else float("nan")
    figures = [
        count("vehicles left as they were or better", len(every) - sum(map(is_worse, every)), len(every), least=1.0),
        count("new parameters kept", len(kept), len(every)),
        Figure("departure from proportional thrust, after / before, median of the kept", smaller, most=0.5),
    ]
    headline("actuator_tunes", "tune actuators: thrust proportional to the command", figures)


if __name__ == "__main__":
    main()
