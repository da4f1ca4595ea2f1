"""Heading and depth steps with the gains of several tuning rules: ``python3 -m benchmarks.rivals``.

Needs ArduPilot's own SITL: ``ARDUPILOT_ROVER`` and ``ARDUPILOT_SUB`` name the binaries. It is the study
``benchmarks/studies/rivals.toml``; a stopped run continues. Our simulator supplies the hulls as external physics. Step
and measurement are the same for all. The gains come from

* the firmware's defaults,
* QuikTune's published rule, with the ratio measured in a steady circle (boats only),
* Ziegler-Nichols from the first relay of the tune,
* ``gcs-autotune tune``: the gains that a whole tune leaves on the vehicle,
* an oracle, without a limit of the overshoot and with that of a tune's proof. It is a Nelder-Mead search on the steps
  themselves, with the firmware's loop and inside the documented ranges. It starts at the gains of all others and at the
  best gains of a global search on a simulation of the true hull.

It prints ITAE per unit step (mean of step and step back; errors below 0.1 deg or 1 cm count as zero), the larger
overshoot, settling time to 5 %, actuator travel and vehicle time. Goal on every vessel: our gains are the best except
for the oracle, or within 10 % of it, and not worse than the defaults. The exit status is 1 if the goal is missed, and 2
without ArduPilot.

The steps start with the integral that soft gains have left. Gains without integral action thus do not show this
weakness. ``--again`` flies the stored gains again with an empty integral.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from pathlib import Path

from benchmarks.results import Figure, count, headline
from benchmarks.rivals.contest import Entry, entries_of, flown_again, has_goal, is_first
from benchmarks.rivals.firmware_loop import BINARIES
from benchmarks.rivals.fleet import FLEET
from benchmarks.studies import rows_of

_ROW = "{:16} {:8} {:16} {:>9} {:>7} {:>6} {:>8} {:>8} {:>8}  {}"


def _number(value: float, form: str = ".3g") -> str:
    return "-" if not math.isfinite(value) else format(value, form)


def _show(vessel: str, axis: str, entries: list[Entry]) -> Figure:
    """Print the entries and whether the goal is met; return our ITAE, with that of the limited oracle in its name."""
    oracle = entries[-1].metrics
    assert oracle is not None
    for entry in entries:
        m = entry.metrics
        assert m is not None
        ratio = m.itae / oracle.itae
        print(
            _ROW.format(
                vessel, axis, entry.rival, _number(m.itae), _number(ratio, ".2f"), _number(100 * m.overshoot, ".0f"),
                _number(m.settling, ".1f"), _number(m.travel), f"{entry.seconds:.0f}", entry.note,
            ).rstrip()
        )  # fmt: skip
    by_name = {entry.rival: entry.metrics for entry in entries}
    ours, held = (by_name[name] for name in ("ours", "oracle, held"))
    assert ours is not None
    assert held is not None
    good, first = has_goal(entries), is_first(entries)
    words = [
        f"{ours.itae / oracle.itae - 1.0:+.0%} to the oracle, {ours.itae / held.itae - 1.0:+.0%} to the limited one"
    ]
    words += ["best of the others" if first else "not the best"]
    print(f"{'':26}goal {'met' if good else 'missed'}: ours {', '.join(words)}\n", flush=True)
    name = f"{vessel}, {axis}, our ITAE (best gains with limited overshoot: {held.itae:.3g})"
    return Figure(name, ours.itae, "s^2")


def main() -> int:
    """Run the contest and return the exit status."""
    parser = argparse.ArgumentParser(prog="benchmarks.rivals", description=__doc__.splitlines()[0])
    parser.add_argument("--only", default=",".join(FLEET), help=f"vessels, separated by commas: {', '.join(FLEET)}")
    parser.add_argument("--axis", choices=("heading", "depth"), help="only this axis")
    parser.add_argument("--budget", type=int, default=120, help="steps that both oracles may fly together (120)")
    parser.add_argument("--workers", type=int, default=1, help="contests at a time (1)")
    parser.add_argument("--again", action="store_true", help="fly the stored gains again with an empty integral")
    args = parser.parse_args()
    chosen = [name for name in args.only.split(",") if name in FLEET]
    needed = {BINARIES[FLEET[name].data.firmware] for name in chosen}
    lacking = sorted(name for name in needed if not Path(os.environ.get(name) or ".").is_file())
    if lacking:
        print(f"benchmarks.rivals needs ArduPilot's firmware: set {' and '.join(lacking)} to its binaries")
        return 2
    jobs = tuple(f"{n} {j.axis}" for n in chosen for j in FLEET[n].jobs if args.axis in (None, j.axis))
    fixed = {"argument.budget": args.budget}
    rows = rows_of("rivals", args.workers, only={"argument.job": jobs}, fixed=fixed)
    header = ("vessel", "axis", "rival", "ITAE s^2", "/oracle", "over %", "settle s", "travel/s", "flown s", "")
    print(_ROW.format(*header).rstrip(), flush=True)
    contests = {row["argument.job"]: entries_of(row["entries"]) for row in rows}
    if args.again:
        contests = {job: flown_again(job, entries) for job, entries in contests.items()}
    errors = [_show(*job.split(), entries) for job, entries in contests.items()]
    ahead = sum(has_goal(entries) for entries in contests.values())
    first = sum(is_first(entries) for entries in contests.values())
    figures = [
        count("vessels and axes on which the goal is met", ahead, len(contests), least=1.0),
        count("vessels and axes on which our gains are better than defaults and rules", first, len(contests)),
        *errors,
    ]
    headline("rivals", "heading and depth steps on ArduPilot's firmware with the gains of each rule", figures)
    return 0 if ahead == len(contests) else 1


if __name__ == "__main__":
    sys.exit(main())
