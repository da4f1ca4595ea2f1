"""Heading and depth steps under the gains of every rival: ``python3 -m benchmarks.rivals``.

Needs ArduPilot's own SITL: ``ARDUPILOT_ROVER`` and ``ARDUPILOT_SUB`` name the binaries. The hulls are ours, served as
external physics; step and ruler are the same for all; gains come from

* the firmware's defaults,
* QuikTune's published rule, computed from the ratio measured in a steady circle (boats; there is none for ROVs),
* Ziegler-Nichols from our own first relay,
* ``gcs-autotune tune``, from start to what it left on the vehicle,
* an oracle, free and held to the overshoot a tune's proof allows: Nelder-Mead on the steps themselves, with the
  firmware's loop, inside the documented ranges, from all the others' gains and from the best of a global search on a
  simulation of the true hull.

Printed: error over time (ITAE per unit step, mean of step and step back; errors below 0.1 deg or 1 cm count as none),
overshoot (the worse), settling to 5 %, actuator travel, vehicle time spent. Goal: ours best of all but the oracle, or
within 10 % of it, on every vessel, never worse than the defaults. Exit status 1 when it is missed, 2 without ArduPilot.

The steps begin with the integral that calm gains have worked off, so that gains without integral action look as good as
any; ``--again FILE`` flies what ``--save FILE`` saved once more from an empty integral, as when a vehicle is sent off.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from pathlib import Path
from typing import Any

from benchmarks.results import count, headline
from benchmarks.rivals.contest import Entry, compete, fly_again
from benchmarks.rivals.fleet import FLEET
from benchmarks.rivals.sea import BINARIES, Sea

_ROW = "{:16} {:8} {:16} {:>9} {:>7} {:>6} {:>8} {:>8} {:>8}  {}"
_WITHIN = 1.10
_SAME = 1.10
"""Two flights of the same gains differ by as much."""


def _number(value: float, form: str = ".3g") -> str:
    return "-" if not math.isfinite(value) else format(value, form)


def _show(vessel: str, axis: str, entries: list[Entry]) -> bool:
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
    ours, defaults, held = (by_name[name] for name in ("ours", "defaults", "oracle, held"))
    assert ours is not None
    assert defaults is not None
    assert held is not None
    best = min(m.itae for name, m in by_name.items() if m is not None and not name.startswith(("ours", "oracle")))
    close, first = ours.itae <= _WITHIN * oracle.itae, ours.itae <= best
    good = (close or first) and ours.itae <= _SAME * defaults.itae
    words = [f"{ours.itae / oracle.itae - 1.0:+.0%} of the oracle, {ours.itae / held.itae - 1.0:+.0%} of the held one"]
    words += ["best of the others" if first else "not the best"]
    print(f"{'':26}goal {'met' if good else 'missed'}: ours {', '.join(words)}\n", flush=True)
    return good


def _told(file: Path, vessel: str, axis: str) -> list[dict[str, Any]]:
    lines = map(json.loads, file.read_text().splitlines())
    return [line for line in lines if (line["vessel"], line["axis"]) == (vessel, axis)]


def main() -> int:
    """Run the contest and return the exit status."""
    parser = argparse.ArgumentParser(prog="benchmarks.rivals", description=__doc__.splitlines()[0])
    parser.add_argument("--only", default=",".join(FLEET), help=f"of {', '.join(FLEET)}, joined by commas")
    parser.add_argument("--axis", choices=("heading", "depth"), help="only this axis")
    parser.add_argument("--budget", type=int, default=120, help="steps the oracles may fly together; default 120")
    parser.add_argument("--instance", type=int, default=20, help="ArduPilot's instance number; default 20")
    parser.add_argument("--port", type=int, default=14700, help="first of three UDP ports; default 14700")
    parser.add_argument("--save", type=Path, help="write everything as JSON lines")
    parser.add_argument("--again", type=Path, help="fly the gains of this file once more, from an empty integral")
    args = parser.parse_args()
    wanted = [name for name in args.only.split(",") if name in FLEET]
    lacking = {BINARIES[FLEET[name].data.firmware] for name in wanted} - {n for n in os.environ if os.environ[n]}
    if lacking:
        print(f"benchmarks.rivals flies ArduPilot's own firmware: set {' and '.join(sorted(lacking))} to its binaries")
        return 2
    header = ("vessel", "axis", "rival", "ITAE s^2", "/oracle", "over %", "settle s", "travel/s", "flown s", "")
    print(_ROW.format(*header).rstrip(), flush=True)
    ahead: list[bool] = []
    for name in wanted:
        vessel = FLEET[name]
        for job in vessel.jobs:
            if args.axis in (None, job.axis) and (not args.again or _told(args.again, name, job.axis)):
                sea = Sea(vessel.data, instance=args.instance, ports=range(args.port, args.port + 3))
                try:
                    if args.again:
                        entries = fly_again(sea, job, _told(args.again, name, job.axis))
                    else:
                        entries = compete(sea, vessel, job, budget=args.budget)
                finally:
                    sea.close()
                if args.save:
                    with args.save.open("a") as file:
                        lines = (json.dumps({"vessel": name, "axis": job.axis, **e.to_dict()}) for e in entries)
                        file.write("\n".join(lines) + "\n")
                ahead.append(_show(name, job.axis, entries))
    met = count("vessels and axes on which the goal is met", sum(ahead), len(ahead), least=1.0)
    headline("rivals", "heading and depth steps on ArduPilot's firmware with the gains of each rule", [met])
    return 0 if all(ahead) else 1


if __name__ == "__main__":
    sys.exit(main())
