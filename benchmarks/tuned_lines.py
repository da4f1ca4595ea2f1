"""``tune line`` on simulated boats, beside defaults, a hand tune and a search: ``python3 -m benchmarks.tuned_lines``.

Each case is a hull, a water and a seed. A boat is tuned as a user does it: ``tune speed``, ``tune heading``,
``tune line``. The parameters after each are then flown on missions that no tune has seen: a square of 40 m and a
zig-zag of 25 m legs (:mod:`benchmarks.navigation`), in the same water, measured by the true track:

* ``rms``: of the distance from the leg under way, ``late``: the same in the second half of each leg;
* ``corner``: how far the boat goes beyond the new leg at a corner; the mean of the corners. All in metres.

The water is calm, or a current of a fifth of the cruise speed, or waves that push in yaw and surge. Beside the tune, in
calm water:

* ``default``: the parameters of the vehicle's file, with ArduPilot's own gains;
* ``hand``: the rule of :func:`hand_tune`;
* ``oracle``: the best of a random search over the parameters of ``tune line`` that flies both missions itself. The
  inner gains, and so the margins, are those of the tune; later half, corners and time may not exceed the tune's rule.

``--firmware`` tunes on ArduPilot's own firmware instead (``ARDUPILOT_ROVER``), in calm water and once: its clock gives
every run another noise. ``--seeds 1 --water calm --oracle 6`` is the quick form. With ``--save FILE`` every case is a
line in FILE, and known ones are not flown again. ``--untuned`` flies ``tune line`` even if speed or heading have kept
ArduPilot's own gains.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from statistics import fmean

from benchmarks.navigation import TRACKS, Ours, Score, Theirs, mean, sail
from benchmarks.reach import Aboard
from benchmarks.results import Figure, count, headline
from benchmarks.rivals.firmware_loop import BINARIES, FirmwareError
from benchmarks.speed import WAVES
from gcs_autotune.errors import AutotuneError
from gcs_autotune.observer import SilentObserver
from gcs_autotune.report import TuneStory
from gcs_autotune.workflow import TuneSettings, Unattended, tune, tune_line
from sitl import load_vehicle, open_vehicle
from sitl.actuators import TwinThrusterBoat
from sitl.effects import HiddenEffect, make_effect

__all__ = ["HULLS", "hand_tune", "main"]

HULLS = ("blueboat", "blueboat-sway", "charlie", "charlie-sway")
WATERS = ("calm", "current", "waves")
CURRENT = 0.2
"""Speed of the current, as a fraction of the cruise speed; towards north-east."""
SURGE_WAVES = 0.02
"""Rms of the waves along the hull [fraction of full output]."""
WITHIN = 1.15
"""Goal: rms relative to that of the search."""
WORSE = 1.05
"""Ratio above which parameters that were kept count as worse than before: scatter of a mission in waves."""
BOUNDS: Mapping[str, tuple[float, float]] = {
    "WP_ACCEL": (0.03, 1.0),
    "WP_RADIUS": (0.5, 15.0),
    "PSC_POS_P": (0.05, 1.0),
    "PSC_VEL_P": (0.3, 4.0),
    "ATC_STR_RAT_MAX": (10.0, 180.0),
    "ATC_TURN_MAX_G": (0.1, 0.6),
}
"""Ranges of the search, log-uniform; WP_PIVOT_ANGLE is the present one or 0."""
LATER, CORNERS, LONGER = 1.25, 1.05, 1.5
"""Greatest ratios to the mission before, as in ``tune line``."""
_WHEN = "2026-11-26T12:00:00"
_MANUAL, _SETTLED = 0, 40.0
_GRAVITY = 9.81
_WARM_UP = 240.0
"""Time [s] until the heading of the firmware's estimator is steady."""


@dataclass(frozen=True)
class Flight:
    """The mean score of both missions [m], and how long they took [s]."""

    score: Score
    seconds: float


@dataclass(frozen=True)
class Case:
    """How one boat was tuned: the ending of each tune, the result of the proof, and the scores of the parameters.

    ``before``: after speed and heading; ``after``: after the line. ``proof``: rms of both proof missions [m].
    ``offered``: the score of what the line proposed, kept or not; empty without a proposal.
    """

    hull: str
    water: str
    seed: int
    endings: Mapping[str, str]
    reasons: Sequence[str]
    before: Sequence[float]
    after: Sequence[float]
    default: Sequence[float]
    proof: Sequence[float]
    changed: Mapping[str, Sequence[float]] = field(default_factory=dict)
    tuned: Mapping[str, float] = field(default_factory=dict)
    offered: Sequence[float] = ()

    @property
    def ending(self) -> str:
        """The ending of ``tune line``."""
        return self.endings["line"]

    @property
    def judged_rightly(self) -> bool:
        """Whether the missions agree with the proof: better is kept, worse is restored; alike may be either."""
        ratio = self.offered[0] / self.before[0]
        return ratio <= WORSE if self.ending == "kept" else ratio >= 1.0 / WORSE


def _effects(hull: str, water: str) -> list[HiddenEffect]:
    speed = open_vehicle(hull).vehicle.parameters["CRUISE_SPEED"]
    if water == "current":
        across = CURRENT * speed / math.sqrt(2.0)
        return [make_effect("steady-current", "", {"V_x": across, "V_y": across})]
    if water == "waves":
        place, rms = WAVES[hull.removesuffix("-sway"), "heading"]
        sizes = {place: rms, "surge": SURGE_WAVES}
        kind = {"frequency": 1.5, "bandwidth": 0.15}
        return [make_effect("wave-disturbance", where, {"amplitude": a, **kind}) for where, a in sizes.items()]
    return []


def fly(hull: str, parameters: Mapping[str, float], water: str, seed: int = 0) -> Flight:
    """Fly both missions and return their mean."""
    scores, seconds = [], 0.0
    for track in TRACKS.values():
        boat = Ours(hull, parameters, _effects(hull, water), seed)
        boat.run(5.0)
        scores.append(sail(boat, track))
        seconds += boat.t
    return Flight(mean(scores), seconds)


def _numbers(flight: Flight) -> tuple[float, float, float]:
    return flight.score.rms, flight.score.late, flight.score.corner


def tune_all(hull: str, water: str, seed: int, *, untuned: bool) -> Case:
    """Tune speed, heading and line of one boat, and fly the missions with what is left on it."""
    own = dict(open_vehicle(hull).vehicle.parameters.values)
    present, endings, reasons = dict(own), {}, []
    before_line: dict[str, float] = {}
    proof: list[float] = []
    proposed: dict[str, float] = {}
    for axis in ("speed", "heading", "line"):
        if axis == "line":
            before_line = dict(present)
        changed = {name: value for name, value in present.items() if value != own[name]}
        server = open_vehicle(hull, seed=seed, parameters=changed, effects=_effects(hull, water))
        with tempfile.TemporaryDirectory() as folder:
            try:
                story = _tuned(
                    axis, TuneSettings(Aboard(server=server), Path(folder) / "run", axis=axis), untuned=untuned
                )
            except AutotuneError as error:
                endings[axis] = "aborted"
                reasons.append(f"{axis}: {error}")
            else:
                endings[axis] = story.ending
                if axis == "line":
                    reasons += story.verdict_reasons or (story.reason,)
                    tracks = (story.track_before, story.track_after)
                    proposed = {change.parameter: change.new for change in story.changes}
                    proof = [math.nan if t is None else t.rms for t in tracks]
        present = dict(server.vehicle.parameters.values)
    changed = {n: v for n, v in before_line.items() if v != own[n]}
    final = {n: v for n, v in present.items() if v != own[n]}
    before = fly(hull, changed, water, seed)
    after = before if final == changed else fly(hull, final, water, seed)
    offered: Sequence[float] = ()
    if proposed and math.isfinite(proof[-1]):
        offered = _numbers(after if final != changed else fly(hull, changed | proposed, water, seed))
    return Case(
        hull,
        water,
        seed,
        endings,
        reasons,
        _numbers(before),
        _numbers(after),
        _numbers(fly(hull, {}, water, seed)),
        proof,
        {n: (before_line[n], present[n]) for n in present if present[n] != before_line[n]},
        changed,
        offered,
    )


def _tuned(axis: str, settings: TuneSettings, *, untuned: bool) -> TuneStory:
    if axis != "line":
        return tune(settings, Unattended(), SilentObserver(), _WHEN)
    line = replace(settings, axis="heading", untuned=untuned)
    return tune_line(line, Unattended(), SilentObserver(), _WHEN)


def hand_tune(hull: str) -> dict[str, float]:
    """Return the parameters of a careful hand tune, by a written rule, for calm water.

    At CRUISE_THROTTLE the boat is steered by half and by all of the output, until it turns steadily (40 s each).
    FF is the output over the turn rate at half, P and I are 0.2 FF: ArduPilot's manual. The turn limits are what the
    boat did at full steering: ATC_STR_RAT_MAX the rate R, TURN_RADIUS V/R, ATC_TURN_MAX_G V R/g. WP_RADIUS is the
    radius, at least 2 m. The missions are then flown with and without the three limits; the better set counts.
    """
    half, _ = _circle(hull, 0.5)
    rate, speed = _circle(hull, 1.0)
    skid = isinstance(open_vehicle(hull).vehicle.actuators, TwinThrusterBoat)
    ratio = 0.5 * (1.0 if skid else max(speed, 1.0)) / half
    steering = {"ATC_STR_RAT_FF": ratio, "ATC_STR_RAT_P": 0.2 * ratio, "ATC_STR_RAT_I": 0.2 * ratio}
    steering["WP_RADIUS"] = max(speed / rate, 2.0)
    limits = {
        "ATC_STR_RAT_MAX": math.degrees(rate),
        "TURN_RADIUS": speed / rate,
        "ATC_TURN_MAX_G": max(speed * rate / _GRAVITY, 0.1),
    }
    return min((steering, steering | limits), key=lambda gains: fly(hull, gains, "calm").score.rms)


def _circle(hull: str, steering: float) -> tuple[float, float]:
    """Return turn rate [rad/s] and speed [m/s] of a steady turn at CRUISE_THROTTLE."""
    vehicle = open_vehicle(hull).vehicle
    for name in ("FS_THR_ENABLE", "FS_GCS_ENABLE", "ARMING_CHECK"):
        vehicle.parameters.preset(name, 0.0)
    autopilot, throttle = vehicle.autopilot, vehicle.parameters["CRUISE_THROTTLE"] / 100.0
    for second in range(round(_SETTLED) + 5):
        if second == 5:
            autopilot.set_mode(_MANUAL)
            autopilot.arm(force=True)
        for channel, share in ((1, steering), (3, throttle)) if second >= 5 else ():
            autopilot.rc.override(channel, 1500 + round(500.0 * share), autopilot.ms)
        for _ in range(round(vehicle.rate)):
            vehicle.move()
            vehicle.control()
    return abs(vehicle.state.r), vehicle.state.u


def search(hull: str, tuned: Mapping[str, float], tries: int, seed: int = 1) -> tuple[Flight, dict[str, float]]:
    """Return the best of *tries* random sets of line parameters beside the gains *tuned*, and these parameters."""
    draw = random.Random(f"{hull}-{seed}")
    present = open_vehicle(hull).vehicle.parameters.values
    begin = fly(hull, tuned, "calm")
    best, where = begin, {}
    for _ in range(tries):
        tried = {n: math.exp(draw.uniform(math.log(low), math.log(high))) for n, (low, high) in BOUNDS.items()}
        tried["WP_PIVOT_ANGLE"] = draw.choice((0.0, present["WP_PIVOT_ANGLE"]))
        for name in ("ATC_STR_RAT_MAX", "ATC_TURN_MAX_G"):
            tried[name] = draw.choice((tried[name], present[name]))
        try:
            found = fly(hull, {**tuned, **tried}, "calm")
        except FirmwareError:
            continue
        allowed = (
            found.score.late <= LATER * max(begin.score.late, 0.4)
            and found.score.corner <= CORNERS * begin.score.corner
            and found.seconds <= LONGER * begin.seconds
        )
        if allowed and found.score.rms < best.score.rms:
            best, where = found, tried
    return best, where


def on_firmware(hull: str, options: argparse.Namespace) -> bool:
    """Tune *hull* under ArduPilot's firmware and print both scores; return whether it is not worse than before."""
    scores: dict[str, Score] = {}
    endings = []
    with tempfile.TemporaryDirectory(prefix="tuned-lines-") as folder:
        os.environ["XDG_STATE_HOME"] = folder
        firmware = Theirs(load_vehicle(hull), {}, [], options)
        try:
            firmware.run(_WARM_UP)
            for axis in ("speed", "heading", "line"):
                if axis == "line":
                    scores["before"] = mean([sail(firmware, track) for track in TRACKS.values()])
                run = (options.keep or Path(folder)) / f"{hull}-{axis}"
                command = ["tune", axis, "--connect", firmware.tuner_uri, "--yes", "--out", str(run)]
                status = firmware.host(command, run.with_suffix(".txt"))
                path = run / "summary.json"
                summary = json.loads(path.read_text()) if path.is_file() else {"ending": f"exit {status}"}
                endings.append(summary["ending"])
                print(f"{hull}: tune {axis}: {endings[-1]}, {run.with_suffix('.txt').read_text()[-600:]}", flush=True)
            scores["after"] = mean([sail(firmware, track) for track in TRACKS.values()])
        finally:
            firmware.close()
    print(f"{hull:14} firmware {'/'.join(endings):24} | {scores['before']} | {scores['after']}", flush=True)
    return scores["after"].rms <= WORSE * scores["before"].rms


def _saved(file: Path | None) -> list[Case]:
    if file is None or not file.is_file():
        return []
    return [Case(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]


def _cases(options: argparse.Namespace) -> Iterator[Case]:
    """Yield every case of *options*, flown now or known from the file."""
    known = {(c.hull, c.water, c.seed): c for c in _saved(options.save)}
    for water in options.water:
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            for hull in options.hulls:
                case = known.get((hull, water, seed))
                if case is None:
                    began = time.monotonic()
                    case = tune_all(hull, water, seed, untuned=options.untuned)
                    if options.save is not None:
                        with options.save.open("a", encoding="utf-8") as out:
                            out.write(json.dumps(asdict(case)) + "\n")
                    print(f"   ({time.monotonic() - began:.0f} s)", flush=True)
                _show(case)
                yield case


def _shown(numbers: Sequence[float]) -> str:
    return " ".join(f"{value:5.2f}" for value in numbers)


def _show(case: Case) -> None:
    how = "/".join(case.endings[axis] for axis in ("speed", "heading", "line"))
    print(
        f"{case.hull:14} {case.water:8}{case.seed:3} {how:24} | {_shown(case.default)} | {_shown(case.before)} | "
        f"{_shown(case.after)} | {_shown(case.proof)}",
        flush=True,
    )
    if case.ending != "kept":
        offer = f"what was proposed: {_shown(case.offered)}; " if case.offered else ""
        print(f"     {offer}{'; '.join(case.reasons)[:300]}", flush=True)


def _beside(hull: str, cases: Sequence[Case], tries: int) -> float | None:
    """Print hand tune and search of *hull* beside its calm cases; return the rms relative to that of the search."""
    calm = [c for c in cases if c.hull == hull and c.water == "calm"]
    if not calm or not tries:
        return None
    gains = hand_tune(hull)
    hand = fly(hull, gains, "calm")
    best, where = search(hull, calm[0].tuned, tries)
    own = fmean(c.after[0] for c in calm)
    named = ", ".join(f"{name} {value:.3g}" for name, value in where.items()) or "nothing better than before"
    print(f"{hull:14} hand {_shown(_numbers(hand))}   search {_shown(_numbers(best))}   tuned, mean rms {own:.2f}")
    print(f"     hand: {', '.join(f'{n} {v:.3g}' for n, v in gains.items())}; search: {named}", flush=True)
    return own / best.score.rms


def main() -> int:
    """Tune all cases; 0 if every goal is met."""
    parser = argparse.ArgumentParser(prog="benchmarks.tuned_lines", description=__doc__.splitlines()[0])
    parser.add_argument("hulls", nargs="*", default=list(HULLS), help=f"of {', '.join(HULLS)}; default all")
    parser.add_argument("--water", nargs="*", default=list(WATERS), choices=WATERS)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--oracle", type=int, default=20, metavar="TRIES", help="tries of the search; 0: none (20)")
    parser.add_argument("--untuned", action="store_true")
    parser.add_argument("--save", type=Path, metavar="FILE")
    parser.add_argument("--firmware", action="store_true", help="tune ArduPilot's own firmware on these hulls")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="folder that keeps the runs on the firmware")
    parser.add_argument("--instance", type=int, default=33)
    parser.add_argument("--port", type=int, default=14830, help="first of three UDP ports")
    options = parser.parse_args()
    if options.firmware:
        if not os.environ.get(BINARIES["rover"]):
            print(f"this flies ArduPilot's own firmware: set {BINARIES['rover']} to its binary")
            return 2
        good = [on_firmware(hull, options) for hull in options.hulls]
        name = "not worse than before on ArduPilot's firmware"
        headline(
            "tuned_lines-firmware", "tune line on ArduPilot's firmware", [count(name, sum(good), len(good), least=1.0)]
        )
        return 0 if all(good) else 1
    print("hull           water  seed speed/heading/line       | default           | speed+heading     | line")
    cases = list(_cases(options))
    line = [c for c in cases if c.ending in ("kept", "restored", "unchanged")]
    kept = [c for c in line if c.ending == "kept"]
    figures = [
        count("parameters not worse than before", sum(_not_worse(c) for c in line), len(line), least=1.0),
        count("line parameters kept", len(kept), len(cases)),
        count("tunes flown to their end", len(line), len(cases), least=1.0),
    ]
    proved = [c for c in line if c.offered]
    figures.append(
        count("verdicts of the proof that the missions agree with", sum(c.judged_rightly for c in proved), len(proved))
    )
    for column, name in enumerate(("rms", "rms in later halves of legs", "mean corner overshoot")):
        ratios = [c.after[column] / c.before[column] for c in kept if c.before[column] > 0.0]
        if ratios:
            figures.append(Figure(f"{name}, after / before, mean of those kept", fmean(ratios)))
    near = [ratio for hull in options.hulls if (ratio := _beside(hull, cases, options.oracle)) is not None]
    if near:
        figures.append(Figure("rms in calm water / that of a random search, worst hull", max(near), most=WITHIN))
    headline("tuned_lines", "tune line on simulated boats, before and after, beside a search", figures)
    return 0 if all(figure.met is not False for figure in figures) else 1


def _not_worse(case: Case) -> bool:
    return case.after[0] <= WORSE * case.before[0]


if __name__ == "__main__":
    sys.exit(main())
