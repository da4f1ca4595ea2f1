"""Speed: the lock-stepped vehicle against real time, a whole ``tune heading``, and the duration of a tune.

Run: ``python3 -m benchmarks.speed``. The first tune on a machine also compiles the kernels; both are shown.

``python3 -m benchmarks.speed water [CASE ...] [--seeds 5] [--waves] [--save FILE]`` tunes each craft twice: with the
design rule (end once the gains are known) and with ``--stop-rule settled``. It prints the vehicle's seconds of both,
both endings, and the ITAE of the proved gains over what both recorded. Goals: the seconds of each case, at most 5 %
more ITAE, equal endings. With ``--save FILE`` every pair is a line in FILE, and known ones are not flown again
(``--seeds 0`` prints their table). Quick: ``--seeds 1``, six pairs.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.reach import Aboard
from benchmarks.results import Figure, count, headline
from gcs_autotune.craft import Actuate
from gcs_autotune.errors import AutotuneError
from gcs_autotune.link import Session, open_craft, open_link
from gcs_autotune.manoeuvres import common_windows
from gcs_autotune.observer import SilentObserver
from gcs_autotune.report import TuneStory
from gcs_autotune.trial import load_trial
from gcs_autotune.workflow import TuneSettings, Unattended, tune
from gcs_autotune.workflow.connection import SERVO_RATE
from gcs_autotune.workflow.experiments import measure, resolution
from gcs_autotune.workflow.noise_estimate import noise_while_held
from gcs_autotune.workflow.settings import STOP_RULES
from sitl import make_effect, open_vehicle

CONTROL_RATE = 10.0
SIMULATED = 600.0
GOALS: Mapping[tuple[str, str], float] = {
    ("charlie", "heading"): 210.0,
    ("blueboat", "heading"): 95.0,
    ("bluerov2", "heading"): 85.0,
    ("bluerov2", "depth"): 65.0,
    ("videoray", "depth"): 66.0,
    ("blueboat", "speed"): 72.0,
}
"""(vehicle, axis) -> longest duration of a tune in calm water [s]."""
WAVES: Mapping[tuple[str, str], tuple[str, float]] = {
    ("charlie", "heading"): ("yaw", 0.2),
    ("blueboat", "heading"): ("yaw", 0.05),
    ("bluerov2", "heading"): ("yaw", 0.02),
    ("bluerov2", "depth"): ("heave", 0.05),
    ("videoray", "depth"): ("heave", 0.05),
    ("blueboat", "speed"): ("surge", 0.02),
}
"""(vehicle, axis) -> where the waves push, and their rms as a fraction of full output. Chosen: such that a step is
still seen, at 1.5 rad/s and a damping ratio of 0.15."""
WORSE = 1.05


def real_time_factor(vehicle: str) -> float:
    """Fly *vehicle* in manual mode at 10 Hz control for ten simulated minutes; return simulated over wall time."""
    with open_link(f"sitl:{vehicle}") as link, Session(link) as session:
        rates = {
            "ATTITUDE": CONTROL_RATE,
            "SERVO_OUTPUT_RAW": SERVO_RATE,
            "GLOBAL_POSITION_INT": 10.0,
            "VFR_HUD": 5.0,
        }
        craft = open_craft(session, wanted_rates=rates)
        craft.set_mode(craft.firmware.manual_mode)
        craft.arm()
        begun, start = time.perf_counter(), session.clock.now()
        sign = 1.0
        while session.clock.now() - start < SIMULATED:
            seen = craft.observe()
            sign = -sign if abs(seen.r) > 0.1 and seen.r * sign > 0 else sign
            craft.send(Actuate(X=0.3, N=0.3 * sign))
        return (session.clock.now() - start) / (time.perf_counter() - begun)


def tune_seconds(axis: str, directory: Path) -> float:
    """Return the wall seconds of one ``gcs-autotune tune`` on the embedded vehicle, report included."""
    begun = time.perf_counter()
    command = [sys.executable, "-m", "gcs_autotune", "tune", axis, "--out", str(directory)]
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - begun


@dataclass(frozen=True)
class Pair:
    """One craft tuned with both rules, the new one first: durations, endings, ITAE [s^2]."""

    vehicle: str
    axis: str
    seed: int
    waves: bool
    seconds: Sequence[float]
    endings: Sequence[str]
    itae: Sequence[float]
    stages: str


def tune_pair(vehicle: str, axis: str, seed: int, *, waves: bool) -> Pair:
    """Tune with both rules and compare."""
    seconds, endings, stories, stages = [], [], [], []
    for rule in STOP_RULES:
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / "run"
            story, ending = _story(vehicle, axis, seed, waves, rule, run)
            trials = [load_trial(path) for path in sorted(run.glob("trials/*.csv")) if "lead-in" not in path.name]
        stories.append(story)
        endings.append(ending)
        seconds.append(max(t.end for t in trials) - min(t.start for t in trials) if trials else math.nan)
        stages.append(", ".join(f"{t.name} {t.duration:.0f}" for t in trials))
    return Pair(vehicle, axis, seed, waves, seconds, endings, _proved(*stories), stages[0])


def _story(vehicle: str, axis: str, seed: int, waves: bool, rule: str, run: Path) -> tuple[TuneStory | None, str]:
    place, rms = WAVES[vehicle, axis]
    sea = [make_effect("wave-disturbance", place, {"amplitude": rms, "frequency": 1.5, "bandwidth": 0.15})]
    server = open_vehicle(vehicle, seed=seed, effects=sea if waves else ())
    settings = TuneSettings(Aboard(server=server), run, axis=axis, stop_rule=rule)
    try:
        story = tune(settings, Unattended(), SilentObserver(), "2026-11-23T12:00:00")
    except AutotuneError as error:
        print(f"   {vehicle} {axis} {seed} {rule}: {error}")
        return None, "aborted"
    return story, story.ending


def _proved(new: TuneStory | None, old: TuneStory | None) -> list[float]:
    """Return the ITAE of both steps with new gains, read alike; NaN where there are not two."""
    if new is None or old is None or new.step_after is None or old.step_after is None or old.step_before is None:
        return [math.nan, math.nan]
    windows = common_windows(new.step_after, old.step_after)
    grain = resolution(old.step_before)
    noise = noise_while_held(old.step_before, grain)
    return [measure(story.step_after, noise, grain, windows).itae for story in (new, old) if story.step_after]


def water(cases: Sequence[str], seeds: int, waves: bool, file: Path | None) -> None:
    """Tune *cases* (``vehicle/axis``; all) over *seeds* and print the table."""
    found: list[Pair] = []
    if file is not None and file.is_file():
        found = [Pair(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]
    there = {(p.vehicle, p.axis, p.seed, p.waves) for p in found}
    for seed in range(1, seeds + 1):
        for vehicle, axis in GOALS:
            if (cases and f"{vehicle}/{axis}" not in cases) or (vehicle, axis, seed, waves) in there:
                continue
            pair = tune_pair(vehicle, axis, seed, waves=waves)
            found.append(pair)
            if file is not None:
                with file.open("a", encoding="utf-8") as stream:
                    print(json.dumps(asdict(pair)), file=stream, flush=True)
            print(f"   {vehicle} {axis} {seed}: {pair.stages}", flush=True)
    print(
        f"{'case':<25}{'seeds':>5}{'settled':>9}{'known':>7}{'(worst)':>9}{'goal':>6}  ITAE new/old  endings new (old)"
    )
    figures: list[Figure] = []
    for case, goal in GOALS.items():
        for sea in (False, True):
            own = [p for p in found if (p.vehicle, p.axis) == case and p.waves is sea]
            if own:
                figures += _figures(f"{' '.join(case)}{', waves' if sea else ''}", own, None if sea else goal)
                _show(f"{' '.join(case)}{' waves' if sea else ''}", own, math.nan if sea else goal)
    calm = [p for p in found if not p.waves]
    both = count(
        "tunes in calm water kept by both rules", sum(p.endings == ("kept", "kept") for p in calm), len(calm), least=1.0
    )
    headline("speed", "duration of a tune by the design rule, and with --stop-rule settled", [both, *figures])


def _figures(name: str, pairs: Sequence[Pair], goal: float | None) -> list[Figure]:
    over = [p for p in pairs if "aborted" not in p.endings] or list(pairs)
    ratios = [p.itae[0] / p.itae[1] for p in pairs if math.isfinite(p.itae[0]) and p.itae[1] > 0.0]
    settled = float(np.mean([p.seconds[1] for p in over]))
    mean = Figure(
        f"{name}, mean (settled: {settled:.0f} s)", float(np.mean([p.seconds[0] for p in over])), "s", most=goal
    )
    ratio = (
        [Figure(f"{name}, median ITAE over settled", float(np.median(ratios)), most=goal and WORSE)] if ratios else []
    )
    return [mean, *ratio]


def _show(name: str, pairs: Sequence[Pair], goal: float) -> None:
    over = [p for p in pairs if "aborted" not in p.endings]  # an aborted tune has no duration
    new, old = (np.array([p.seconds[i] for p in over] or [math.nan]) for i in (0, 1))
    ratios = [p.itae[0] / p.itae[1] for p in pairs if math.isfinite(p.itae[0]) and p.itae[1] > 0.0]
    shown = f"{np.mean(ratios):.2f} ({max(ratios):.2f})" if ratios else "-"
    same = "same" if all(p.endings[0] == p.endings[1] for p in pairs) else "DIFFERENT"
    endings = ", ".join(sorted({f"{p.endings[0]} ({p.endings[1]})" for p in pairs}))
    missed = [w for w, bad in (("time", np.nanmax(new) > goal), ("error", max(ratios, default=0.0) > WORSE)) if bad]
    print(
        f"{name:<25}{len(pairs):>5}{np.nanmean(old):>9.0f}{np.nanmean(new):>7.0f}{np.nanmax(new):>9.0f}{goal:>6.0f}"
        f"  {shown:<13} {same}: {endings}{'; missed: ' + ', '.join(missed) if missed else ''}"
    )


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", choices=("machine", "water"), default="machine")
    parser.add_argument("cases", nargs="*", help="vehicle/axis; default: all")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--waves", action="store_true")
    parser.add_argument(
        "--save", type=Path, metavar="FILE", help="write one line per pair; pairs in the file are not flown again"
    )
    args = parser.parse_args(argv)
    if args.what == "water":
        water(args.cases, args.seeds, args.waves, args.save)
        return
    for vehicle in ("charlie", "videoray"):
        factor = real_time_factor(vehicle)
        print(f"{vehicle:10s} lock-step, {CONTROL_RATE:g} Hz control: {factor:7.0f} x real time (goal 100)")
    with tempfile.TemporaryDirectory() as folder:
        for axis in ("heading", "depth"):
            times = [tune_seconds(axis, Path(folder) / f"{axis}-{i}") for i in range(3)]
            shown = ", ".join(f"{t:.1f}" for t in times)
            print(f"tune {axis:8s} wall: {shown} s (goal under 15)")


if __name__ == "__main__":
    main()
