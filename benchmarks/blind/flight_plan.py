"""Plan the runs of a case, simulate them in the open-loop simulator, and make the case of their files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.craft import POSITION, Craft, log_uniform
from benchmarks.blind.foreign import FOREIGN
from benchmarks.blind.hidden import Hidden
from benchmarks.blind.manoeuvres import MANOEUVRES, draw_commands
from benchmarks.blind.process_noise import DISTURBANCES
from gcs_autotune.trial import Channel, Trial
from sitl.effects import HiddenEffect, make_effect
from sitl.open_loop import Hull, open_loop

__all__ = [
    "BOTTOM",
    "Case",
    "File",
    "FlightPlan",
    "FlownRuns",
    "case_of",
    "draw_flight_plan",
    "fly",
    "noise_levels",
    "trial_of",
]

Array = NDArray[np.float64]
Rng = np.random.Generator
File = Mapping[str, Array]

BOTTOM = 20.0
"""Depth of the water [m]."""
UNITS = {
    **dict.fromkeys("uvw", "m/s"),
    **dict.fromkeys("xyz", "m"),
    **dict.fromkeys("XYZ", "N"),
    "N": "N m",
    **dict.fromkeys(("psi", "delta"), "rad"),
    "r": "rad/s",
}


@dataclass(frozen=True, eq=False)
class Case:
    """Runs with hidden effects.

    ``ratio``: held-out error of the plain model over the noise. ``noise``: as a fraction of the signals' sizes.
    ``truth``: slug -> (place, parameters as the catalogue defines them).
    """

    kind: str
    index: int
    truth: Mapping[str, tuple[str, Mapping[str, float]]]
    craft: Craft
    runs: tuple[Trial, ...]
    unseen: tuple[Trial, ...]
    plain: str
    ratio: float
    noise: float
    manoeuvres: tuple[str, ...]
    levels: Mapping[str, float]
    """Signal -> standard deviation of its noise."""
    wrong: Mapping[str, float] = field(default_factory=dict)
    """Wrong parameter of the supplied model -> its factor."""
    simulations: tuple[Trial, ...] = ()
    """Simulations of the same commands, for kinds without a model file."""
    circumstances: tuple[str, ...] = ()
    """The further disturbances of :data:`.rough_water.CIRCUMSTANCES` that are present."""
    flown: FlownRuns | None = None
    """The flown runs before smoothing, for kinds with process noise; not passed to the diagnosis."""

    @property
    def slugs(self) -> tuple[str, ...]:
        """Slugs of the hidden effects."""
        return tuple(self.truth)


@dataclass(frozen=True, eq=False)
class FlightPlan:
    """Commands, initial states and seeds of the runs of a case."""

    craft: Craft
    commands: tuple[Mapping[str, Array], ...]
    initial: tuple[Mapping[str, float], ...]
    names: tuple[str, ...]
    seeds: tuple[int, ...]
    plain: str


@dataclass(frozen=True, eq=False)
class FlownRuns:
    """A plan with its hidden effects and disturbances, and the files of all its runs before smoothing.

    They include the runs that are discarded.
    """

    plan: FlightPlan
    hidden: tuple[Hidden, ...]
    files: tuple[File, ...]

    def first(self, runs: int) -> FlownRuns:
        """Return the first *runs* of the runs."""
        plan = self.plan
        fewer = replace(
            plan,
            commands=plan.commands[:runs],
            initial=plan.initial[:runs],
            names=plan.names[:runs],
            seeds=plan.seeds[:runs],
        )
        return replace(self, plan=fewer, files=self.files[:runs])


def draw_flight_plan(rng: Rng, hidden: Sequence[Hidden], names: Sequence[str] = ()) -> FlightPlan:
    """Draw the manoeuvres and initial states of three or four runs of the craft of the last of *hidden*.

    names : the manoeuvres; empty: drawn too.
    """
    craft = hidden[-1].craft
    turns = any(h.turns for h in hidden)
    count = len(names) or int(rng.integers(2, 4)) + 1
    names = tuple(names) or tuple(str(n) for n in rng.choice(list(MANOEUVRES), count, replace=False))
    commands = [draw_commands(rng, craft, name, turns=turns) for name in names]
    initial = []
    for k in range(count):
        start = {"psi": float(rng.uniform(-np.pi, np.pi))} if "yaw" in craft.dofs else {}
        for h in hidden:
            start.update({n: float(rng.normal(mean, spread)) for n, (mean, spread) in h.start.items()})
        if any(h.near_bottom for h in hidden):
            start["z"] = _shallow(craft, commands[k], hidden, craft.top["heave"] * craft.pace * rng.uniform(0.02, 0.2))
        start.update(_near_wall(craft, commands[k], hidden, start))
        initial.append(start)
    seeds = tuple(int(s) for s in rng.integers(0, 2**31, count))
    return FlightPlan(craft, tuple(commands), tuple(initial), names, seeds, hidden[0].plain)


def _shallow(craft: Craft, commands: Mapping[str, Array], hidden: Sequence[Hidden], clear: float) -> float:
    """Return the initial depth of a run whose deepest point is *clear* [m] above the bottom."""
    depth, close = 0.0, 0.0
    effects = [_effect(h, {}) for h in hidden if h.near_bottom]
    for _ in range(8):
        hull = _hull(craft, hidden[0].plain)
        dived = open_loop(hull, commands, **_clock(craft), measured=("z",), initial={"z": depth}, effects=effects)["z"]
        close = BOTTOM - float(dived.max())
        if 0.5 * clear <= close <= 2.0 * clear:
            break
        depth += close - clear
    return depth if close > 0.0 else depth - 2.0 * clear


def _near_wall(
    craft: Craft, commands: Mapping[str, Array], hidden: Sequence[Hidden], start: Mapping[str, float]
) -> dict[str, float]:
    """Return the initial position of a run that comes as close to the wall as the origin is."""
    found: dict[str, float] = {}
    for h in (h for h in hidden if h.near_wall):
        c, s = np.cos(h.values["direction"]), np.sin(h.values["direction"])
        run = open_loop(_hull(craft, hidden[0].plain), commands, **_clock(craft), measured=("x", "y"), initial=start)
        back = float((c * run["x"] + s * run["y"]).max())
        found |= {"x": -back * float(c), "y": -back * float(s)}
    return found


def _hull(craft: Craft, plain: str) -> Hull:
    linear = craft.linear if plain == "linear" else dict.fromkeys(craft.dofs, 0.0)
    return Hull(craft.dofs, craft.inertia, linear, bottom=BOTTOM)


def _clock(craft: Craft) -> dict[str, float]:
    return {"duration": craft.duration, "interval": craft.interval}


def noise_levels(rng: Rng, craft: Craft, noise: float) -> dict[str, float]:
    """Return the noise of every signal: *noise* times its size and a random factor of 0.5 to 2."""
    return {n: noise * craft.scale[n] * log_uniform(rng, 0.5, 2.0) for n in craft.signals}


def fly(
    plan: FlightPlan,
    hidden: Sequence[Hidden],
    noise: Mapping[str, float] | None = None,
    *,
    commands: Sequence[Mapping[str, Array]] = (),
    beside: Sequence[HiddenEffect] = (),
) -> list[File]:
    """Return one file per run; without *noise* the sensors are perfect.

    *commands*: recorded commands instead of the planned ones; *beside*: one more effect of each run.
    """
    full = {c: max(float(np.abs(run[c]).max()) for run in plan.commands[:-1]) for c in plan.craft.drives}
    files = []
    for k, inputs in enumerate(commands or plan.commands):
        effects = [_effect(h, full) for h in hidden if h.slug and (h.in_runs is None or k in h.in_runs)]
        effects += beside[k : k + 1]
        files.append(
            open_loop(
                _hull(plan.craft, plan.plain),
                inputs,
                **_clock(plan.craft),
                measured=plan.craft.signals,
                effects=effects,
                noise=noise,
                seed=plan.seeds[k],
                initial=plan.initial[k],
            )
        )
    return files


def _effect(hidden: Hidden, full: Mapping[str, float]) -> HiddenEffect:
    if hidden.slug in DISTURBANCES:
        return DISTURBANCES[hidden.slug](hidden.place, **hidden.values)
    if hidden.slug in FOREIGN:
        return FOREIGN[hidden.slug](hidden.place, **hidden.values)
    values = dict(hidden.values)
    if hidden.slug == "quadratic-actuator":
        values["u_ref"] = full[hidden.place]
    return make_effect(hidden.slug, hidden.place if hidden.place != "t" else "", values)


def case_of(
    rng: Rng,
    plan: FlightPlan,
    hidden: Sequence[Hidden],
    files: Sequence[File],
    ratio: float,
    noise: float,
    levels: Mapping[str, float],
    *,
    keeps: float = 0.7,
) -> Case:
    """Return the case of a plan's files; *keeps*: probability that the last file is held out instead of discarded."""
    wraps = bool(rng.random() < 0.3) and not any(
        (h.place == "yaw" and h.slug == "tether-pull") or (h.place == "psi" and h.slug != "compass-deviation")
        for h in hidden
    )
    trials = [trial_of(f"run{k + 1}", file, wraps) for k, file in enumerate(files)]
    kept = bool(rng.random() < keeps)
    return Case(
        kind="",
        index=0,
        truth={h.slug: (_place(h), _catalogue_values(h, plan.craft, files[:-1])) for h in hidden},
        craft=plan.craft,
        runs=tuple(trials[:-1]),
        unseen=tuple(trials[-1:] if kept else ()),
        plain=plan.plain,
        ratio=ratio,
        noise=noise,
        manoeuvres=plan.names,
        levels=levels,
    )


def trial_of(name: str, file: File, wraps: bool) -> Trial:
    """Return the run of a file; *wraps*: with the heading between -pi and pi."""
    channels = {}
    for column, values in file.items():
        if column != "t":
            shown = np.remainder(values + np.pi, 2.0 * np.pi) - np.pi if wraps and column == "psi" else values
            channels[column] = Channel(column, UNITS[column], file["t"], shown)
    return Trial(name, channels)


def _place(hidden: Hidden) -> str:
    """Return the place, with the run if only one has the effect."""
    return hidden.place if hidden.in_runs is None else f"{hidden.place}@run{hidden.in_runs[0] + 1}"


def _catalogue_values(hidden: Hidden, craft: Craft, files: Sequence[File]) -> dict[str, float]:
    """Return the parameters as the catalogue defines them; some references come from the files."""
    values = dict(hidden.values)
    if hidden.slug == "speed-dependent-steering":
        rms = float(np.sqrt(np.mean(np.concatenate([f["u"] for f in files]) ** 2)))
        odds = values["share"] / max(1.0 - values["share"], 1e-9) * (rms / values.pop("U_ref")) ** 2
        values["share"] = odds / (1.0 + odds)
    if craft.kind == "boat":  # no sway actuator: the mass of this equation is one
        values = {n: v / craft.inertia["sway"] if n in ("Y_ur", "Y_r", "Y") else v for n, v in values.items()}
        values = {n: v for n, v in values.items() if n not in ("N_v", "Y_rdot")}  # not identifiable: sway follows yaw
    if values.get("gamma"):  # a sea: the catalogue has the amplitude and the varying drift only
        values = {n: values[n] for n in ("amplitude", "drift") if values[n]}
    if hidden.slug == "shallow-water":  # the catalogue refers to the middle of the track
        (x, y), T = ([_middle(f[n] for f in files) for n in "xy"]), values.pop("draught")
        clearance = values.pop("depth") - T + values["north"] * x + values["east"] * y
        for name in ("drag", "sway", "yaw"):
            values[name] *= T / clearance
        values |= {name: values[name] / clearance for name in ("north", "east")}
        values = {n: v for n, v in values.items() if n != "sway" or craft.kind != "boat"}  # no sway actuator
    if hidden.slug == "ground-effect":
        clearance = BOTTOM - max(float(f[POSITION["heave"]].max()) for f in files)
        values["strength"] *= float(np.exp(-clearance / values["length"]))
    return values


def _middle(columns: Iterable[Array]) -> float:
    every = np.concatenate(list(columns))
    return 0.5 * float(every.min() + every.max())
