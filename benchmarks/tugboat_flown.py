"""Erunsal2017's sequence, flown on the simulator's tugboat with commands that a user can type, and identified.

    python -m benchmarks.tugboat_flown [--runs DIR] [--seed 1]

The commands are those of ``docs/identify.md``: ``fly docs/tugboat.toml``, and ``identify --plan usv_twin`` with a force
map. The pulls for the map are the vehicle file's law of thrust, with 1 % noise. ``--runs`` reuses a run directory.
Both optimisers of the paper are compared: output error, and the better of two global searches (``--method global``).

The cost is the root of the mean of ``dx^2 + dy^2 + dpsi^2`` [m, rad] over the held-out runs. The paper prints 0.7669
for its real craft in a pool, without units or the length of its runs, so the two numbers only have the same form.

The table shows each estimate with its standard error, and the error over the standard error in brackets.
``benchmarks/notes/tugboat.md`` explains what is not identified.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.published.water import TUG
from benchmarks.results import Figure, headline
from gcs_autotune.cli import main as gcs_autotune
from gcs_autotune.identify import validate
from gcs_autotune.identify.plan import load_plan, run_plan
from gcs_autotune.logs import load_runs
from gcs_autotune.thrusters import TwinThrusters, fit_thruster, read_pull_test
from gcs_autotune.trial import Trial

PLAN = Path(__file__).parents[1] / "docs" / "tugboat.toml"
DELAY, SPACING, AHEAD, ASTERN = 0.2, 0.14, 10.3, 6.2
"""Delay [s] of link and motors; of the vehicle file: distance of the thrusters [m], thrust at full output [N]."""
PRINTED = 0.7669


def thrusters(rng: np.random.Generator) -> TwinThrusters:
    """Return both thrusters with the map from a simulated pull test."""
    commands = np.linspace(-1.0, 1.0, 21)
    pulls = np.where(commands > 0.0, AHEAD, ASTERN) * commands * np.abs(commands) * (1.0 + rng.normal(0.0, 0.01, 21))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pull.csv"
        path.write_text(
            "command[1],T[N]\n" + "".join(f"{c:.1f},{T:.4f}\n" for c, T in zip(commands, pulls, strict=True))
        )
        own = fit_thruster(read_pull_test(path)).map
    return TwinThrusters(own, own, SPACING)


def tilts_of(runs: Sequence[Trial]) -> dict[str, float]:
    """Return the largest roll and pitch [deg] of *runs*."""
    words = {"roll": "phi", "pitch": "theta"}
    return {w: max(float(np.degrees(np.abs(r[n].values).max())) for r in runs if n in r) for w, n in words.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    folder = args.runs
    if folder is None:
        folder = Path(tempfile.mkdtemp()) / "tug"
        options = ["--yes", "--max-heading-excursion", "720", "--out", str(folder)]
        gcs_autotune(["fly", str(PLAN), "--connect", f"sitl:tugboat?seed={args.seed}", *options])
    twin = thrusters(np.random.default_rng(args.seed))
    tilts = tilts_of(load_runs(folder))
    runs = [twin.forces_of(run) for run in load_runs(folder) if {"X", "N"} <= run.channels.keys()]
    plan = load_plan("usv_twin")
    truth = {**TUG, "R_TS": 1.0, "L_TO": 0.0, "R_TO": 0.0}
    figures, table = [], {}
    for method in ("output-error", "global"):
        begin = time.perf_counter()
        found = run_plan(replace(plan, steps=tuple(replace(s, delay=DELAY, method=method) for s in plan.steps)), runs)
        table[method] = found.parameters
        assert found.model is not None and found.final is not None and plan.final is not None
        apart = []
        for run in plan.final.chosen.of(runs):
            kept = {n: c for n, c in run.channels.items() if n not in ("u", "v", "r", "phi", "theta", "p", "q")}
            traces = {
                t.signal: t.measured - t.fitted for t in validate(found.model, replace(run, channels=kept)).traces
            }
            apart.append(sum(np.mean(traces[n] ** 2) for n in ("x", "y", "psi")))
        cost = float(np.sqrt(np.mean(apart)))
        local = ", ".join(f"{s.step.name} {s.validation.fit_percent:.0f} %" for s in found.steps if s.validation)
        print(f"{method}: {time.perf_counter() - begin:.0f} s; local validation: {local}")
        print(f"  final validation {found.final.fit_percent:.1f} %, cost {cost:.4f} (paper {PRINTED})")
        sizes = [100.0 * abs(p.value / truth[n] - 1.0) for n, p in found.parameters.items() if abs(truth[n]) > 1e-3]
        figures += [
            Figure(f"error, median of {len(sizes)} parameters, 1 seed, {method}", float(np.median(sizes)), "%"),
            Figure(f"fit of held-out free driving, {method}", found.final.fit_percent, "%"),
            Figure(f"cost of held-out free driving, {method} (paper {PRINTED}, another craft)", cost, ""),
        ]
    print(f"{'':8}{'truth':>10}" + "".join(f"{m:>28}" for m in table))
    for name in plan.parameters:
        found = [p[name] for p in table.values()]
        row = [f"{p.value:.4f} ± {p.std:.4f} ({(p.value - truth[name]) / p.std:+.1f})" for p in found]
        print(f"{name:8}{truth[name]:10.4f}" + "".join(f"{text:>28}" for text in row))
    figures += [Figure(f"largest {n} of the flown runs, which the plan leaves out", v, "deg") for n, v in tilts.items()]
    headline("tugboat_flown", "a sequence of experiments, flown on the simulator (Erunsal2017)", figures)


if __name__ == "__main__":
    main()
