"""Whole tunes of every simulated vehicle, compared with the best gains that a search of the simulator finds.

Every vehicle is tuned on every axis of its firmware, over several seeds of its sensors' noise. A craft that does not
have an axis must refuse it. These tunes are counted by themselves.

The best gains come from a Nelder-Mead search that may fly the simulator itself. Each trial of gains is a step and a
step back under the vehicle's own autopilot, within the margins and the integral action that a design requires, computed
from the true hull and thrust curve. Compared is the ITAE as flown, measured as in a tune.

A search takes minutes and depends only on the simulator: its result is in ``BEST`` below and flown again on each seed.
``--search N`` repeats it. Cases that are not in ``BEST`` are tuned and predicted only. The tunes are the study
``benchmarks/studies/reach.toml``; a stopped run continues.

``--styles`` tunes each craft in every style of ``tune --style`` instead. It prints the step flown by the simulator with
the new gains, and the margins that they have on the true craft.

Goals: every tune kept; every axis that a craft lacks refused; at most 1.3 times the best in 95 % of tunes (if nothing
was kept: the present gains within 1.3); and predicted within 25 % of flown in 90 %.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.results import Figure, count, headline
from benchmarks.studies import rows_of
from gcs_autotune.axes import AXES
from gcs_autotune.control import ReferenceModel
from gcs_autotune.design import STYLES, StepMetrics, combine, step_metrics
from gcs_autotune.design.laws import CEILINGS, LAWS, SKID, THROTTLE, Law
from gcs_autotune.design.margins import Plant, margins_of_each, worst
from gcs_autotune.design.matching import NOISE_LIMIT, DesignProblem, integral_shortfall, output_noise
from gcs_autotune.design.plant import Region
from gcs_autotune.design.selection import MAX_OVERSHOOT, choose
from gcs_autotune.design.spec import Spec
from gcs_autotune.errors import AutotuneError
from gcs_autotune.firmware import FIRMWARE, Axis, Gain
from gcs_autotune.link import MemoryLink, Transport
from gcs_autotune.manoeuvres import common_windows
from gcs_autotune.models import SingleDof
from gcs_autotune.observer import SilentObserver
from gcs_autotune.report import TuneStory
from gcs_autotune.trial import load_trial
from gcs_autotune.workflow import Connection, TuneSettings, Unattended, tune
from sitl import Server, open_vehicle
from sitl.actuators import FRAMES, TwinThrusterBoat
from sitl.autopilot import GuidedTarget
from sitl.catalogue import VEHICLES, load_vehicle
from sitl.plants import Wrench
from sitl.vehicle import Vehicle

__all__ = ["CASES", "main"]

Array = NDArray[np.float64]

PROFILES = {"sub": "ardusub", "rover": "ardurover"}
"""Firmware of a vehicle file -> the tuner's profile of it."""
CASES: Sequence[tuple[str, str]] = tuple(
    (vehicle, axis) for vehicle in VEHICLES for axis in FIRMWARE[PROFILES[load_vehicle(vehicle).firmware]].axes
)
"""(vehicle, axis): every vehicle of the simulator's catalogue, and every axis of its firmware."""
BEST: Mapping[tuple[str, str], Mapping[str, float]] = {
    ("bluerov2", "heading"): {"ATC_RAT_YAW_P": 0.5, "ATC_RAT_YAW_I": 0.05, "ATC_ANG_YAW_P": 5.695},
    ("bluerov2", "yaw"): {"ATC_RAT_YAW_P": 0.5, "ATC_RAT_YAW_I": 0.0442, "ATC_ANG_YAW_P": 2.46},
    ("bluerov2", "depth"): {
        "PSC_POSZ_P": 3.0,
        "PSC_VELZ_P": 8.0,
        "PSC_ACCZ_P": 1.5,
        "PSC_ACCZ_I": 0.439,
        "PSC_ACCZ_FF": 0.5,
    },
    ("bluerov2-loaded", "heading"): {"ATC_RAT_YAW_P": 0.5, "ATC_RAT_YAW_I": 0.05, "ATC_ANG_YAW_P": 3.531},
    ("bluerov2-loaded", "yaw"): {"ATC_RAT_YAW_P": 0.5, "ATC_RAT_YAW_I": 0.0178, "ATC_ANG_YAW_P": 1.94},
    ("bluerov2-loaded", "depth"): {
        "PSC_POSZ_P": 3.0,
        "PSC_VELZ_P": 8.0,
        "PSC_ACCZ_P": 1.5,
        "PSC_ACCZ_I": 0.583,
        "PSC_ACCZ_FF": 0.5,
    },
    ("videoray", "depth"): {
        "PSC_POSZ_P": 3.0,
        "PSC_VELZ_P": 8.0,
        "PSC_ACCZ_P": 1.5,
        "PSC_ACCZ_I": 0.463,
        "PSC_ACCZ_FF": 0.5,
    },
    ("falcon", "heading"): {"ATC_RAT_YAW_P": 0.5, "ATC_RAT_YAW_I": 0.0201, "ATC_ANG_YAW_P": 6.0},
    ("falcon", "depth"): {
        "PSC_POSZ_P": 3.0,
        "PSC_VELZ_P": 8.0,
        "PSC_ACCZ_P": 1.5,
        "PSC_ACCZ_I": 3.0,
        "PSC_ACCZ_FF": 0.5,
    },
    ("videoray", "heading"): {"ATC_RAT_YAW_P": 0.5, "ATC_RAT_YAW_I": 0.0228, "ATC_ANG_YAW_P": 2.77},
    ("automarine", "heading"): {"ATC_RAT_YAW_P": 0.5, "ATC_RAT_YAW_I": 0.0237, "ATC_ANG_YAW_P": 0.805},
    ("charlie", "heading"): {
        "ATC_STR_RAT_FF": 0.626,
        "ATC_STR_RAT_P": 2.0,
        "ATC_STR_RAT_I": 0.0218,
        "ATC_STR_ANG_P": 1.0,
    },
    ("blueboat", "heading"): {
        "ATC_STR_RAT_FF": 1.84,
        "ATC_STR_RAT_P": 2.0,
        "ATC_STR_RAT_I": 0.372,
        "ATC_STR_ANG_P": 2.57,
    },
}
"""(vehicle, axis) -> what ``--search 80 --first-seed 1`` found; of boats, which have four gains, ``--search 160``
(Charlie 240)."""
WITHIN, NEAR = 1.3, 0.25
PRICE, FAR_OUT = 20.0, 1e6
"""Penalty of the search for a missed fraction, and for gains so far out that they are not flown: more than for any
that are, or it would stop at the border. A slow boat's error over time is some hundred s^2."""
_NEUTRAL, _STICK = 1500, 95
_HELD: Mapping[str, float] = {"psi": 10.0, "z": 10.0, "r": 3.0}
"""Signal -> seconds a tune holds it before its step."""
_GUIDED, _ALT_HOLD = 15, 2
_FAILSAFES_OF_A_BOAT = ("FS_THR_ENABLE", "FS_GCS_ENABLE", "ARMING_CHECK")
_FAILSAFES_OF_AN_ROV = ("FS_PILOT_INPUT", "FS_GCS_ENABLE", "ARMING_CHECK")
_UNDER_WAY = 20.0
"""Time [s] for a boat to reach its speed and course: the longest wait of a tune."""
RISE = 2.2
"""Bandwidth times rise time (10 to 90 %) of a first-order response: ln 9."""
USED = 0.5
"""Outputs up to which margins are held, as the design does."""


@dataclass(frozen=True)
class Aboard(Connection):
    """A connection to a vehicle in this process."""

    uri: str = "memory"
    server: Server | None = None

    def open(self) -> Transport:
        """Return a link to it."""
        assert self.server is not None
        return MemoryLink(self.server)


@dataclass(frozen=True)
class Tuned:
    """Result of one tune: ITAE before, predicted and flown, NaN without one; ``beside``: of the best gains.

    ``ending`` is that of the story, "aborted" for a tune that ended with an error, or "refused" if the craft does not
    have the axis. ``reason`` is the error, or the verdict of a tune whose gains were not kept.
    """

    vehicle: str
    axis: str
    seed: int
    ending: str
    before: float
    predicted: float
    flown: float
    beside: float
    seconds: float
    reason: str = ""


def tune_once(vehicle: str, axis: str, seed: int) -> Tuned:
    """Tune, fly the best gains, and return the result."""
    began = time.monotonic()
    server = open_vehicle(vehicle, seed=seed)
    ending, before, predicted, after = "aborted" if has_axis(vehicle, axis) else "refused", math.nan, math.nan, math.nan
    windows: tuple[float, ...] = ()
    reason = ""
    with tempfile.TemporaryDirectory() as folder:
        settings = TuneSettings(Aboard(server=server), Path(folder) / "run", axis=axis)
        try:
            story: TuneStory = tune(settings, Unattended(), SilentObserver(), "2026-11-20T12:00:00")
        except AutotuneError as error:
            reason = str(error)
        else:
            ending, reason = story.ending, "" if story.ending == "kept" else story.reason
            predicted = math.nan if story.proposal is None else story.proposal.after.metrics.itae
            before, after = (math.nan if m is None else m.itae for m in (story.metrics_before, story.metrics_after))
            windows = _windows(settings.directory)
    best, beside = BEST.get((vehicle, axis)), math.nan
    if best is not None:
        beside = Bench(vehicle, _axis_of(vehicle, axis), seed).fly(best, windows).itae
    return Tuned(vehicle, axis, seed, ending, before, predicted, after, beside, time.monotonic() - began, reason)


def has_axis(vehicle: str, axis: str) -> bool:
    """Return whether *vehicle* moves in the degree of freedom of *axis*, and its thrusters drive it."""
    data, dof = load_vehicle(vehicle), AXES[axis].dof
    letter = {"roll": "K", "pitch": "M"}.get(dof)
    if letter is None:
        return True
    motors = FRAMES.get(data.tables["actuators"], ())
    return dof in data.make_plant().dofs and any(getattr(motor, letter) for motor in motors)


def show_styles(vehicle: str, axis: str, seed: int) -> None:
    """Tune in each style, and print the flown step and the true margins with the gains that the vehicle then has."""
    bench = Bench(vehicle, _axis_of(vehicle, axis), seed)
    problem = bench.truth.problem
    for style in STYLES:
        with tempfile.TemporaryDirectory() as folder:
            link = Aboard(server=open_vehicle(vehicle, seed=seed))
            settings = TuneSettings(link, Path(folder) / "run", axis=axis, style=style)
            story = tune(settings, Unattended(), SilentObserver(), "2026-11-20T12:00:00")
        has = {**problem.settings, **story.parameters_after}
        flown = bench.fly({g.parameter: has[g.parameter] for g in bench.axis.gains})
        low = worst(margins_of_each(bench.law.controller(has, problem.speed), bench.truth.plants))
        print(
            f"   {vehicle} {axis} seed {seed} {style:<7} {story.ending:<9} rise {flown.rise:6.2f} s, bandwidth "
            f"{RISE / flown.rise:5.2f} rad/s, overshoot {flown.overshoot:5.1%}, travel {flown.travel:.3f} 1/s, "
            f"gain margin {low.gain:5.2f}, phase margin {math.degrees(low.phase):3.0f} deg",
            flush=True,
        )


def _windows(run: Path) -> tuple[float, ...]:
    """Return over how long [s] step and step back of a tune were read; empty where it proved nothing."""
    steps = [load_trial(path) for path in sorted(run.glob("trials/*-step-*.csv"))]
    return common_windows(steps[0], steps[-1]) if len(steps) > 1 else ()


def _axis_of(vehicle: str, axis: str) -> Axis:
    return FIRMWARE[PROFILES[load_vehicle(vehicle).firmware]].axes[axis]


class Bench:
    """The vehicle without a link: its own autopilot holds, steps and steps back with any gains; a boat under way."""

    def __init__(self, name: str, axis: Axis, seed: int) -> None:
        self.name, self.axis, self.seed = name, axis, seed
        self.law: Law = LAWS[axis.law]
        kind = AXES[axis.name]
        self.signal = kind.stepped
        self.size, self.duration = kind.step, 3.5 if self.signal == "r" else kind.step_duration
        craft = open_vehicle(name).vehicle
        self.speed = craft.parameters["CRUISE_SPEED"] if craft.data.is_boat else None
        sensors = craft.data.sensors
        self.quantum = sensors.heading_quantum if self.signal == "psi" else 0.0
        self.noise = {"psi": sensors.heading_noise, "z": sensors.depth_noise}.get(self.signal, 0.0)
        self.noise = max(self.noise, self.quantum / math.sqrt(12.0))

    def fly(self, gains: Mapping[str, float], windows: Sequence[float] = ()) -> StepMetrics:
        """Return the metrics of the step and the step back, as a tune reads them: over *windows* [s] where it did."""
        vehicle = open_vehicle(self.name, seed=self.seed, parameters=gains).vehicle
        sub = vehicle.autopilot
        for name in _FAILSAFES_OF_A_BOAT if self.speed else _FAILSAFES_OF_AN_ROV:
            vehicle.parameters.preset(name, 0.0)
        _run(vehicle, 5.0)
        sub.set_mode(_GUIDED if self.speed else _ALT_HOLD)
        sub.arm(force=True)
        low = (
            -_stick_rate(vehicle)
            if self.signal == "r"
            else sub.estimate.yaw
            if self.signal == "psi"
            else sub.estimate.z
        )
        high = -low if self.signal == "r" else low + self.size
        _hold(vehicle, self.signal, low, _HELD[self.signal] if self.speed is None else _UNDER_WAY, self.speed)
        parts = []
        for start, end, seconds in zip((low, high), (high, low), windows or [self.duration] * 2, strict=True):
            t, x, u = _hold(vehicle, self.signal, end, seconds, self.speed)
            t, x, u = (np.concatenate([v[:1], v]) for v in (t, x, u))
            target = np.full_like(t, end)
            target[0] = start
            noise = self.noise or _noise_in(x)
            parts.append(step_metrics(t, target, x, u, noise_std=noise, quantum=self.quantum))
        return combine(parts)

    @cached_property
    def truth(self) -> Truth:
        """The true craft as a design would have it, had it identified everything exactly."""
        step = self.size if self.signal != "r" else 2.0 * _stick_rate(open_vehicle(self.name).vehicle)
        spec = Spec(speed=self.speed, noise_std=self.noise, quantum=self.quantum)
        return true_craft(self.name, self.axis, step, spec)

    def shortfall(self, gains: Mapping[str, float]) -> float:
        """Return by how much the true craft misses the specification of the design, as a sum of fractions.

        Margins, integral action, noise on the output and the ceilings of gains, each as the design states it.
        """
        spec, problem = self.truth.problem.spec, self.truth.problem
        settings = {**problem.settings, **gains}
        period = self.law.loop_period(settings)
        low = worst(margins_of_each(self.law.controller(settings, problem.speed), self.truth.plants))
        above = (max(0.0, gains[g.parameter] / g.high - 1.0) for g in problem.gains if g.parameter in gains)
        return (
            integral_shortfall(problem, settings, self.truth.wanted)
            + max(0.0, output_noise(problem, settings) / NOISE_LIMIT - 1.0)
            + max(0.0, 1.0 - low.gain / spec.gain_margin)
            + max(0.0, 1.0 - low.phase / spec.phase_margin)
            + max(0.0, 1.0 - low.delay / (2.0 * period))
            + sum(above)
        )


@dataclass(frozen=True)
class Truth:
    """The true craft as a design's own problem, its reference model, and the plants that margins are held on."""

    problem: DesignProblem
    wanted: ReferenceModel
    plants: Sequence[Plant]


def true_craft(name: str, axis: Axis, step: float, spec: Spec) -> Truth:
    """Return the specification of a design for the true craft *name*, for a boat at cruise throttle."""
    law, speed = LAWS[axis.law], spec.speed
    data = open_vehicle(name).vehicle
    dof = {"yaw": "N", "heave": "Z"}[axis.dof]
    settings = dict(data.parameters.values)
    shares = {"N": 0.0, "X": 0.0, "Z": 0.0}
    if speed is not None:
        shares["X"] = settings["CRUISE_THROTTLE"] / 100.0
        if isinstance(data.actuators, TwinThrusterBoat):
            settings |= {SKID: 1.0, THROTTLE: shares["X"]}

    def force(u: float) -> float:
        wrench = Wrench()
        data.actuators.apply({**shares, dof: u}, data.plant.parameters, wrench)
        return float(getattr(wrench, dof))

    full = data.actuators.full[axis.dof]
    u = np.linspace(0.0, USED, 201)
    share = (np.array([force(v) for v in u]) - force(0.0)) / full
    # The hull of a boat with a rudder depends on its propeller speed, which is only known now.
    hull = data.plant.axis(axis.dof)
    dead = int(np.argmax(share > 0.0))
    slopes = np.gradient(share[dead:], u[dead:])[1:-1]
    period = law.loop_period(settings)
    plants = [
        Plant(float(slope), hull.alpha / full, drag / full, 1.5 * period)
        for slope in (max(slopes.min(), 0.25), slopes.max())
        for drag in (hull.beta, hull.beta + hull.beta2 * 0.3)
    ]
    used = full * float(share[-1]) / USED
    model = SingleDof(axis.dof, "1", hull.alpha / used, hull.beta / used, hull.beta2 / used)
    ceilings = CEILINGS[law.name](model, settings, speed) if law.name in CEILINGS else {}
    by_name = {g.parameter: replace(g, high=min(g.high, ceilings.get(g.parameter, math.inf))) for g in axis.gains}
    gains, region = [by_name[n] for n in law.tuned], Region(model, np.zeros((5, 5)), ())
    problem = DesignProblem(law, gains, region, settings, spec, step, 1.5 * period)
    return Truth(problem, choose(problem).wanted, plants)


def _noise_in(x: Array) -> float:
    """Return the noise of a turn rate (n,) by its second differences, as a tune reads it off a step."""
    return 1.4826 * float(np.median(np.abs(np.diff(x, n=2)))) / math.sqrt(6.0)


def _stick_rate(vehicle: Vehicle) -> float:
    """Return the turn rate [rad/s] that a stick deflection of :data:`_STICK` commands."""
    dead = vehicle.parameters["RC4_DZ"] * 0.5
    return math.radians(int(4500 * (_STICK - dead) / (400.0 - dead)) * vehicle.parameters["ACRO_YAW_P"] / 100.0)


def _run(vehicle: Vehicle, seconds: float) -> None:
    for _ in range(round(seconds * vehicle.rate)):
        vehicle.move()
        vehicle.control()


def _hold(
    vehicle: Vehicle, signal: str, target: float, seconds: float, speed: float | None = None
) -> tuple[Array, Array, Array]:
    """Hold *target*, sent again every 0.1 s, a boat at *speed* [m/s]; return t, signal and output (n,) at 10 Hz."""
    sub, rows, start = vehicle.autopilot, [], vehicle.seconds
    first = target
    for _ in range(round(10.0 * seconds)):
        if speed is not None:
            sub.guided.target = GuidedTarget(sub.ms, speed, target)  # type: ignore[attr-defined]
        elif signal == "psi":
            sub.set_heading_target(target)  # type: ignore[attr-defined]
        elif signal == "r":
            sub.rc.override(4, _NEUTRAL + (_STICK if target > 0.0 else -_STICK), sub.ms)
        else:
            sub.set_depth_target(-target)  # type: ignore[attr-defined]
        e = sub.estimate
        value = {"psi": first + math.remainder(e.yaw - first, math.tau), "z": e.z, "r": e.yaw_rate}[signal]
        shares = vehicle.actuators.read(vehicle.autopilot.pwm)
        rows.append((vehicle.seconds - start, value, shares["Z" if signal == "z" else "N"]))
        _run(vehicle, 0.1)
    table = np.array(rows)
    return table[:, 0], table[:, 1], table[:, 2]


def search(bench: Bench, evaluations: int) -> tuple[float, dict[str, float]]:
    """Return the least ITAE with margins kept that a Nelder-Mead search over the documented ranges finds."""
    present = open_vehicle(bench.name).vehicle.parameters.values
    gains: list[Gain] = [g for g in bench.axis.gains if g.parameter in bench.law.tuned]

    def values(x: Array) -> dict[str, float]:
        part = np.square(np.clip(x, 0.0, 1.0))
        return {g.parameter: g.low + float(p) * (g.high - g.low) for g, p in zip(gains, part, strict=True)}

    def cost(x: Array) -> float:
        missed = bench.shortfall(values(x))
        if missed > 0.5:
            return FAR_OUT * (1.0 + missed)
        m = bench.fly(values(x))
        over = max(0.0, m.overshoot - 0.15) / MAX_OVERSHOOT
        return m.itae * (1.0 + PRICE * (missed + over))

    own = np.sqrt([(present[g.parameter] - g.low) / (g.high - g.low) for g in gains])
    starts = [np.clip(own, 0.05, 0.95), np.full(len(gains), 0.6)]
    best, where = math.inf, starts[0]
    for start in starts:
        simplex = np.tile(start, (len(start) + 1, 1))
        for i in range(len(start)):
            simplex[i + 1, i] += 0.25 if start[i] < 0.6 else -0.25
        found = minimize(
            cost,
            start,
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": evaluations // len(starts)},
        )
        if found.fun < best:
            best, where = float(found.fun), np.asarray(found.x)
    return best, values(where)


def _cases(only: Sequence[str]) -> Iterator[tuple[str, str]]:
    for vehicle, axis in CASES:
        if not only or vehicle in only or f"{vehicle}/{axis}" in only:
            yield vehicle, axis


def _share(tuned: Sequence[Tuned], good: Callable[[Tuned], bool]) -> str:
    return f"{sum(good(t) for t in tuned)}/{len(tuned)}"


def tuned_case(seed: int, case: str) -> dict[str, Any]:
    """Return the result of the tune of *case*, ``VEHICLE/AXIS``, as a row of the study."""
    one = tune_once(*case.split("/"), seed)
    return {"tuned": json.dumps(asdict(one)), "kept": one.ending == "kept", "itae": _has(one) / one.beside}


def _show_table(tuned: Sequence[Tuned], cases: Iterator[tuple[str, str]]) -> None:
    print(f"{'case':<26}{'beside':>7}{'kept':>7}{'<=1.3':>7}{'ITAE before -> flown (median)':>32}{'predicted':>11}")
    for case in cases:
        every = [t for t in tuned if (t.vehicle, t.axis) == case]
        own = [t for t in every if t.ending != "refused"]
        if not own:
            if every:
                print(f"{' '.join(case):<26}{'refused':>14} {_share(every, lambda t: t.ending == 'refused')}")
            continue
        near = [t for t in own if math.isfinite(t.flown)]
        searched = [t for t in own if math.isfinite(t.beside)]
        print(
            f"{' '.join(case):<26}{_median([t.beside for t in own])}"
            f"{_share(own, lambda t: t.ending == 'kept'):>7}"
            f"{_share(searched, lambda t: _has(t) <= WITHIN * t.beside) if searched else '-':>7}"
            f"{_median([t.before for t in own]):>21} -> {_median([_has(t) for t in own]).strip()}"
            f"{_share(near, lambda t: abs(t.predicted - t.flown) <= NEAR * t.flown):>11}   "
            f"{sum(t.seconds for t in own):.0f} s"
        )


def _median(values: Sequence[float]) -> str:
    """Return the median of the finite *values* to three places, ``-`` if there are none."""
    known = [value for value in values if math.isfinite(value)]
    return f"{np.median(known):>7.3f}" if known else f"{'-':>7}"


def _has(tuned: Tuned) -> float:
    """Return the ITAE with what the vehicle has now."""
    return tuned.flown if tuned.ending == "kept" else tuned.before


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "cases", nargs="*", help="vehicle or vehicle/axis; default: all, for a search or styles those in BEST"
    )
    parser.add_argument("--seeds", type=int, default=20, help="seeds of each case (20)")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1, help="processes (1)")
    parser.add_argument(
        "--search", type=int, default=0, metavar="N", help="only search for BEST, with N steps per case"
    )
    parser.add_argument("--styles", action="store_true", help="only tune in every style, once per seed")
    args = parser.parse_args(argv)
    if args.styles:
        for seed in range(args.first_seed, args.first_seed + args.seeds):
            for vehicle, name in _cases(args.cases or ["/".join(case) for case in BEST]):
                show_styles(vehicle, name, seed)
        return
    if args.search:
        for vehicle, name in _cases(args.cases or ["/".join(case) for case in BEST]):
            best, gains = search(Bench(vehicle, _axis_of(vehicle, name), args.first_seed), args.search)
            print(f"   {vehicle} {name}: best by search {best:.3f} s^2 at {_shown(gains)}", flush=True)
        return
    only = {"argument.case": tuple("/".join(case) for case in _cases(args.cases))}
    rows = rows_of("reach", args.workers, only=only, seed=args.first_seed, repeats=args.seeds)
    tuned = [Tuned(**json.loads(row["tuned"])) for row in rows]
    for one in tuned:
        print(
            f"   {one.vehicle} {one.axis} seed {one.seed}: {one.ending}, {one.before:.3f} -> {one.flown:.3f}, "
            f"predicted {one.predicted:.3f}; best {one.beside:.3f}{one.reason and f'; {one.reason}'}"
        )
    _show_table(tuned, _cases(args.cases))
    headline("reach", "whole tunes compared with the best gains of a search", _figures(tuned))


def _figures(tuned: Sequence[Tuned]) -> list[Figure]:
    """Return the headline figures, without those of which there was no case."""
    own = [t for t in tuned if t.ending != "refused"]
    near = [t for t in own if math.isfinite(t.flown)]
    searched = [t for t in own if math.isfinite(t.beside)]
    lacking = [t for t in tuned if not has_axis(t.vehicle, t.axis)]
    figures = [
        count("tunes kept", sum(t.ending == "kept" for t in own), len(own), least=1.0),
        count("refused without the axis", sum(t.ending == "refused" for t in lacking), len(lacking), least=1.0),
        count(
            f"within {WITHIN:g} times the best",
            sum(_has(t) <= WITHIN * t.beside for t in searched),
            len(searched),
            least=0.9,
        ),
        count(
            f"predicted within {NEAR:.0%}",
            sum(abs(t.predicted - t.flown) <= NEAR * t.flown for t in near),
            len(near),
            least=0.9,
        ),
    ]
    return [figure for figure in figures if figure.of]


def _shown(gains: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in gains.items())


if __name__ == "__main__":
    main()
