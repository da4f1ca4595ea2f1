"""Run whole tunes with random faults, and check the state of the vehicle afterwards.

Run: ``python3 -m benchmarks.faulted_tunes [--cases 1000] [--seed 1] [--jobs 2] [--only KIND,..]``, or one case in full:
``--case N [--keep DIR]``. It is the study ``benchmarks/studies/faulted_tunes.toml``; a stopped run continues.

Every case is a whole tune of a simulated vehicle (all axes; mostly from a model with short steps, one in 50 with the
experiments) with one or two faults of random kind, moment, length and size. A case is right if, fifteen seconds after
the tool ended, the vehicle is neutral, in its earlier mode and armed state, with its earlier parameters or all those
that the journal shows as proved. It is also right if the tool requested ``gcs-autotune restore`` and that command
restores it. In four of ten cases the first ``restore`` meets faults as well; the second must succeed.

Further conditions: every write that arrived was in the journal on disk before, with the true old value; no overrides
continue; no foreign exception; no hang. A killed tool cannot report, so only ``restore`` counts there. A craft that was
armed before and disarmed itself (a reboot, a failsafe) need not be armed again, but its operator must be informed. In a
mode in which its own loops steer, its outputs may be within a tenth of full.

With ``--station`` every case has another ground station on its own wire instead: it orders a mode, disarms, steers
under the tool's own id, writes a gain, or the autopilot restarts. In half of them the tool's computer also pauses. A
case is right if none of this is undone and the reported cause is among the true ones. An order of the tool within 0.3 s
after the station's was already on its way: a tie, which is counted.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.faults import KINDS, STATION_KINDS, Outcome, draw_case, draw_station_case, run_case  # noqa: E402
from benchmarks.results import count, headline  # noqa: E402
from benchmarks.studies import in_main_thread, rows_of  # noqa: E402


def run_row(seed: int, draw: int, only: str, station: bool) -> dict[str, Any]:
    """Run case number *seed*; *draw* is the seed of all random numbers. Return its outcome as a row."""
    # The referee limits time by a signal and the size of files for the whole process.
    outcome = in_main_thread(run_case, (draw_station_case if station else draw_case)(draw, seed, _split(only)))
    return {"outcome": outcome.to_json(), "right": not outcome.failures, "ending": outcome.ending}


def _split(only: str) -> list[str]:
    return [kind for kind in only.split(",") if kind]


def report(outcomes: Sequence[dict[str, Any]]) -> str:
    """Return the table by kind of fault, and the totals."""
    by_kind: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for o in outcomes:
        for kind in {f.split()[0] for f in o["case"]["faults"]}:
            by_kind[kind].append(o)
    lines = [
        f"{'fault':16s} {'cases':>6s} {'wrote':>6s} {'proved':>6s} {'at once':>8s} {'by restore':>10s} {'FAILED':>7s}"
    ]
    for kind in [k for k in (*KINDS, *STATION_KINDS) if k in by_kind]:
        lines.append(f"{kind:16s} {_counts(by_kind[kind])}")
    lines.append(f"{'all':16s} {_counts(outcomes)}")
    if any(o.get("orders") for o in outcomes):
        lines.append(
            f"orders of another station: {sum(o['orders'] for o in outcomes)}, ties {sum(o['ties'] for o in outcomes)}"
        )
    endings = Counter(o["ending"] for o in outcomes)
    lines.append("endings: " + ", ".join(f"{n} {e}" for e, n in endings.most_common()))
    return "\n".join(lines)


def _counts(outcomes: Sequence[dict[str, Any]]) -> str:
    failed = sum(bool(o["failures"]) for o in outcomes)
    numbers = (len(outcomes), sum(o["writes"] > 0 for o in outcomes), sum(o["proved"] for o in outcomes))
    at_once = sum(o["restored_at_once"] for o in outcomes)
    by_restore = sum(not o["restored_at_once"] and not o["failures"] for o in outcomes)
    return f"{numbers[0]:6d} {numbers[1]:6d} {numbers[2]:6d} {at_once:8d} {by_restore:10d} {failed:7d}"


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.faulted_tunes", description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="number of cases (1000)")
    parser.add_argument("--first", type=int, default=0, help="number of the first case (0)")
    parser.add_argument("--seed", type=int, default=1, help="seed of all random numbers (1)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    parser.add_argument("--only", default="", help=f"kinds of faults, separated by commas: {', '.join(KINDS)}")
    parser.add_argument("--station", action="store_true", help="cases with another station that interferes")
    parser.add_argument("--case", type=int, help="run only this case, and print its whole outcome")
    parser.add_argument("--keep", type=Path, help="with --case: folder that keeps its run")
    parser.add_argument("--quiet", action="store_true", help="print only failures and the table")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases, print the table, and return 1 if a case failed."""
    options = _parsed(arguments)
    kinds = _split(options.only)
    if options.case is not None:
        outcome: Outcome = run_case(
            (draw_station_case if options.station else draw_case)(options.seed, options.case, kinds), options.keep
        )
        print(json.dumps(json.loads(outcome.to_json()), indent=1))
        return 1 if outcome.failures else 0
    fixed = {"argument.draw": options.seed, "argument.only": options.only}
    places = {"argument.station": (options.station,)}
    rows = rows_of("faulted_tunes", options.jobs, only=places, fixed=fixed, seed=options.first, repeats=options.cases)
    done: list[dict[str, Any]] = [json.loads(row["outcome"]) for row in rows]
    for o in done:
        if o["failures"] or not options.quiet:
            print(_line(o))
    print(report(done))
    right = sum(not o["failures"] for o in done)
    at_once = sum(o["restored_at_once"] for o in done)
    figures = [
        count("vehicles with old or proven parameters at the end", right, len(done), least=1.0),
        count("right at once", at_once, len(done)),
        count("tunes that wrote gains", sum(o["writes"] > 0 for o in done), len(done)),
    ]
    if options.station:
        headline("faulted_tunes-station", "whole tunes while another station gives orders", figures)
    else:
        headline("faulted_tunes", "whole tunes with random faults, then restore", figures)
    return 1 if any(o["failures"] for o in done) else 0


def _line(o: dict[str, Any]) -> str:
    case = o["case"]
    mark = "FAILED" if o["failures"] else "right "
    faults = "; ".join(case["faults"])
    text = f"{mark} {case['index']:5d} {case['subject']:18s} {o['ending']:14s} {faults} {o['seconds']:.1f} s"
    return "\n        ".join((text, *o["failures"]))


if __name__ == "__main__":
    sys.exit(main())
