"""Time that a self-planned trial saves against a fixed standard plan, on random swaying craft.

Run: ``python3 -m benchmarks.self_planned_trials [--seeds 20] [--first 1] [--workers 1]``. It is the study
``benchmarks/studies/self_planned_trials.toml``; a stopped run continues. Each craft is the coupled VideoRay of
``sitl`` with every inertia and damping of surge, sway and yaw multiplied by a random factor between 0.6 and 1.7
(logarithmically uniform), flown over MAVLink. The standard plan is zig-zag, turning circle, S-manoeuvre and steps. The
precision that it reaches for ``REQUIRED`` (1 % at best) is required of the other trial. It prints the seconds of runs
until each reaches it, both identified after each run, and their ratio (goal 60 %).
"""

from __future__ import annotations

import argparse
import math
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import sitl
from benchmarks.results import Figure, count, headline
from benchmarks.studies import rows_of
from gcs_autotune.errors import AutotuneError
from gcs_autotune.experiments import relative_errors
from gcs_autotune.identify import fit
from gcs_autotune.link import MemoryLink
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.observer import SilentObserver
from gcs_autotune.trial import Trial
from gcs_autotune.workflow import (
    CommonSettings,
    Connection,
    FlightPlan,
    FlightResult,
    FlySettings,
    Precision,
    Unattended,
    first_run,
    fly_plan,
    load_flight_plan,
)
from sitl import open_vehicle

REQUIRED = ("X_u", "Y_v", "N_r", "N_rdot")
FINEST, COARSEST = 0.01, 0.5
"""Range of required relative standard errors; a parameter with a larger one is not required."""
LONGEST = 1800.0
STANDARD = "[defaults]\nthrottle = 0.25\nsteering = 0.75\n" + "".join(
    f'[[run]]\nmanoeuvre = "{name}"\n' for name in ("zig-zag", "turning-circle", "s-manoeuvre", "steps")
)
BASE = Path(sitl.__file__).parent / "vehicles" / "videoray_coupled.toml"
WIDE = Envelope(heading_excursion=math.inf, depth_excursion=20.0)


def drawn(seed: int, place: Path) -> Path:
    """Write the vehicle file of a craft."""
    random = np.random.default_rng(seed)
    base, plain = tomllib.loads(BASE.read_text()), tomllib.loads((BASE.parent / "videoray.toml").read_text())
    text = f'title = "drawn {seed}"\nlike = "videoray-coupled"\n'
    text += '[coupling]\ncoriolis = { value = true, unit = "1", source = "drawn" }\n'
    for axis in ("surge", "sway", "yaw"):
        text += f"[{axis}]\n"
        for name in ("alpha", "beta", "beta2"):
            entry = base.get(axis, plain.get(axis, {}))[name]
            value = entry["value"] * math.exp(random.uniform(math.log(0.6), math.log(1.7)))
            text += f'{name} = {{ value = {value!r}, unit = "{entry["unit"]}", source = "drawn" }}\n'
    path = place / f"drawn{seed}.toml"
    path.write_text(text)
    return path


def flown(path: Path, seed: int, plan: FlightPlan, common: CommonSettings) -> FlightResult:
    """Fly a plan on the craft of that file."""
    link = MemoryLink(open_vehicle(str(path), seed=seed, parameters={"SCHED_LOOP_RATE": 100.0}))
    link.is_simulated = True
    common = replace(common, connection=Connection("memory", opened=link))

    def here(run: FlySettings) -> FlySettings:
        return replace(run, common=replace(run.common, connection=common.connection))

    plan = replace(plan, runs=tuple(here(run) for run in plan.runs))
    return fly_plan(plan, common, Unattended(), SilentObserver(), "")


def seconds_of(result: FlightResult, until: Precision) -> float:
    """Return the duration of a self-planned trial; infinite if it missed the precision."""
    reached = until.reached(result.steps[-1].outlook.relative)
    return sum(step.seconds for step in result.steps) if reached else math.inf


def precision_of(runs: Sequence[Trial]) -> Precision:
    """Return the precision of the required parameters that *runs* reach."""
    errors = relative_errors(fit(list(runs), dof="horizontal"), REQUIRED)
    required = {n: max(e, FINEST) for n, e in errors.items() if e < COARSEST}
    return Precision(required, "horizontal", LONGEST)


def seconds_until(runs: Sequence[Trial], until: Precision) -> float:
    """Return the duration of *runs* until the precision is reached; infinite if it is not."""
    for k in range(1, len(runs) + 1):
        if until.reached(relative_errors(fit(list(runs[:k]), dof=until.form), until.wanted)):
            return sum(run.duration for run in runs[:k])
    return math.inf


def compared(seed: int, place: Path) -> tuple[float, str]:
    """Fly both on one craft, with records in *place*; return the ratio of durations and a summary."""
    path = drawn(seed, place)
    common = CommonSettings(Connection("memory"), place / "standard", envelope=WIDE)
    (place / "plan.toml").write_text(STANDARD)
    standard = load_flight_plan(place / "plan.toml", common, None, None)
    runs = [run.trial for run in flown(path, seed, standard, common).runs if run.trial is not None]
    until = precision_of(runs)
    fixed = seconds_until(runs, until)
    common = replace(common, directory=place / "self")
    plan = replace(FlightPlan.of(first_run(until, common)), until=until)
    result = flown(path, seed, plan, common)
    own = seconds_of(result, until)
    names = ", ".join(step.run for step in result.steps)
    why = "" if math.isfinite(own) else f": {result.steps[-1].ended}"
    return own / fixed, f"{until.title}: by itself {own:.0f} s ({names}){why}, standard plan {fixed:.0f} s"


def trial(seed: int) -> dict[str, Any]:
    """Compare both on one craft. Return the story and the ratio, which is left out if it is infinite."""
    with tempfile.TemporaryDirectory() as directory:
        try:
            ratio, story = compared(seed, Path(directory))
        except AutotuneError as error:
            ratio, story = math.inf, str(error)
    return {"ratio": ratio, "story": story, "finished": math.isfinite(ratio)}


def main() -> None:
    """Fly both on each craft and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    rows = rows_of("self_planned_trials", args.workers, seed=args.first, repeats=args.seeds)
    ratios = [row["ratio"] if row["finished"] else math.inf for row in rows]
    for row, ratio in zip(rows, ratios, strict=True):
        print(f"craft {row['seed']}: {row['story']}, ratio {ratio:.2f}")
    within = sum(ratio <= 0.6 for ratio in ratios)
    figures = [
        count("craft with at most 60 % of the plan's time", within, args.seeds),
        Figure("fraction of the plan's time, median", float(np.median(ratios)), most=0.6),
        Figure("fraction of the plan's time, worst", max(ratios)),
    ]
    headline("self_planned_trials", "fly --until compared with a fixed plan", figures)


if __name__ == "__main__":
    main()
