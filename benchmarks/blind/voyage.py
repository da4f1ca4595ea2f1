"""One voyage: the flying of a case's runs in the tank, and what becomes of the files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.craft import POSITION, Craft, log_uniform
from benchmarks.blind.flying import MANOEUVRES, draw_commands
from benchmarks.blind.foreign import FOREIGN
from benchmarks.blind.process_noise import WEATHER
from benchmarks.blind.secret import Hidden
from gcs_autotune.trial import Channel, Trial
from sitl.effects import HiddenEffect, make_effect
from sitl.open_loop import Hull, open_loop

__all__ = ["BOTTOM", "Case", "File", "Flown", "Voyage", "case_of", "draw_voyage", "fly", "noise_levels", "trial_of"]

Array = NDArray[np.float64]
Rng = np.random.Generator
File = Mapping[str, Array]

BOTTOM = 20.0
"""Depth of the tank [m]."""
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
    """Runs with a secret. ``ratio``: held-out error of the plain model over the noise; ``noise``: share of the signals.

    ``truth``: slug -> (place, numbers as the book counts them).
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
    """Standard deviation of the noise of every signal."""
    wrong: Mapping[str, float] = field(default_factory=dict)
    """Number of the given model that is wrong -> by which factor."""
    simulations: tuple[Trial, ...] = ()
    """What the given model makes of the same commands, for kinds that give no model file."""
    circumstances: tuple[str, ...] = ()
    """The further disturbances of :data:`.rough.CIRCUMSTANCES` that are present."""
    flown: Flown | None = None
    """The flown runs before smoothing, for kinds with process noise; not passed to the diagnosis."""

    @property
    def slugs(self) -> tuple[str, ...]:
        """Names of what is hidden."""
        return tuple(self.truth)


@dataclass(frozen=True, eq=False)
class Voyage:
    """Everything about the flying that is drawn before any noise."""

    craft: Craft
    commands: tuple[Mapping[str, Array], ...]
    initial: tuple[Mapping[str, float], ...]
    names: tuple[str, ...]
    seeds: tuple[int, ...]
    plain: str


@dataclass(frozen=True, eq=False)
class Flown:
    """A voyage with all that was hidden in it, weather too, in the tank's order, and its files before any smoothing.

    All runs of it, those that are thrown away as well.
    """

    voyage: Voyage
    hidden: tuple[Hidden, ...]
    files: tuple[File, ...]

    def first(self, runs: int) -> Flown:
        """Return the first *runs* of it."""
        v = self.voyage
        fewer = replace(
            v, commands=v.commands[:runs], initial=v.initial[:runs], names=v.names[:runs], seeds=v.seeds[:runs]
        )
        return replace(self, voyage=fewer, files=self.files[:runs])


def draw_voyage(rng: Rng, hidden: Sequence[Hidden], names: Sequence[str] = ()) -> Voyage:
    """Draw manoeuvres and beginnings of the three or four runs that the last of *hidden* is flown in.

    names : of the manoeuvres, drawn as well when empty.
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
        start.update(_beside(craft, commands[k], hidden, start))
        initial.append(start)
    seeds = tuple(int(s) for s in rng.integers(0, 2**31, count))
    return Voyage(craft, tuple(commands), tuple(initial), names, seeds, hidden[0].plain)


def _shallow(craft: Craft, commands: Mapping[str, Array], hidden: Sequence[Hidden], clear: float) -> float:
    """Return the depth to start at for a run that reaches down to *clear* [m] above the bottom, and not below."""
    depth, close = 0.0, 0.0
    effects = [_made(h, {}) for h in hidden if h.near_bottom]
    for _ in range(8):
        hull = _hull(craft, hidden[0].plain)
        dived = open_loop(hull, commands, **_clock(craft), measured=("z",), initial={"z": depth}, effects=effects)["z"]
        close = BOTTOM - float(dived.max())
        if 0.5 * clear <= close <= 2.0 * clear:
            break
        depth += close - clear
    return depth if close > 0.0 else depth - 2.0 * clear


def _beside(
    craft: Craft, commands: Mapping[str, Array], hidden: Sequence[Hidden], start: Mapping[str, float]
) -> dict[str, float]:
    """Return the position to start at for a run whose plain track comes as close to the wall as the origin is."""
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
    """Return the noise of every signal: that share of what it does, one sensor better than the other."""
    return {n: noise * craft.scale[n] * log_uniform(rng, 0.5, 2.0) for n in craft.signals}


def fly(
    voyage: Voyage,
    hidden: Sequence[Hidden],
    noise: Mapping[str, float] | None = None,
    *,
    told: Sequence[Mapping[str, Array]] = (),
    beside: Sequence[HiddenEffect] = (),
) -> list[File]:
    """Return one file per run; without *noise* what perfect sensors would report.

    *told*: commands that the runs had in the end, where somebody at the helm changed the plan; *beside*: one more
    effect of each run.
    """
    full = {c: max(float(np.abs(run[c]).max()) for run in voyage.commands[:-1]) for c in voyage.craft.drives}
    files = []
    for k, commands in enumerate(told or voyage.commands):
        effects = [_made(h, full) for h in hidden if h.slug and (h.in_runs is None or k in h.in_runs)]
        effects += beside[k : k + 1]
        files.append(
            open_loop(
                _hull(voyage.craft, voyage.plain),
                commands,
                **_clock(voyage.craft),
                measured=voyage.craft.signals,
                effects=effects,
                noise=noise,
                seed=voyage.seeds[k],
                initial=voyage.initial[k],
            )
        )
    return files


def _made(hidden: Hidden, full: Mapping[str, float]) -> HiddenEffect:
    if hidden.slug in WEATHER:
        return WEATHER[hidden.slug](hidden.place, **hidden.values)
    if hidden.slug in FOREIGN:
        return FOREIGN[hidden.slug](hidden.place, **hidden.values)
    values = dict(hidden.values)
    if hidden.slug == "quadratic-actuator":
        values["u_ref"] = full[hidden.place]
    return make_effect(hidden.slug, hidden.place if hidden.place != "t" else "", values)


def case_of(
    rng: Rng,
    voyage: Voyage,
    hidden: Sequence[Hidden],
    files: Sequence[File],
    ratio: float,
    noise: float,
    levels: Mapping[str, float],
    *,
    keeps: float = 0.7,
) -> Case:
    """Return the case of a voyage's files; *keeps*: how often the last of them is kept apart, not thrown away."""
    wraps = bool(rng.random() < 0.3) and not any(
        (h.place == "yaw" and h.slug == "tether-pull") or (h.place == "psi" and h.slug != "compass-deviation")
        for h in hidden
    )
    trials = [trial_of(f"run{k + 1}", file, wraps) for k, file in enumerate(files)]
    kept = bool(rng.random() < keeps)
    return Case(
        kind="",
        index=0,
        truth={h.slug: (_told(h), _counted(h, voyage.craft, files[:-1])) for h in hidden},
        craft=voyage.craft,
        runs=tuple(trials[:-1]),
        unseen=tuple(trials[-1:] if kept else ()),
        plain=voyage.plain,
        ratio=ratio,
        noise=noise,
        manoeuvres=voyage.names,
        levels=levels,
    )


def trial_of(name: str, file: File, wraps: bool) -> Trial:
    channels = {}
    for column, values in file.items():
        if column != "t":
            shown = np.remainder(values + np.pi, 2.0 * np.pi) - np.pi if wraps and column == "psi" else values
            channels[column] = Channel(column, UNITS[column], file["t"], shown)
    return Trial(name, channels)


def _told(hidden: Hidden) -> str:
    """Return the place, with the run when only one has it."""
    return hidden.place if hidden.in_runs is None else f"{hidden.place}@run{hidden.in_runs[0] + 1}"


def _counted(hidden: Hidden, craft: Craft, files: Sequence[File]) -> dict[str, float]:
    """Return the numbers as the book's entry counts them, which has to read its references off the files."""
    values = dict(hidden.values)
    if hidden.slug == "speed-dependent-steering":
        rms = float(np.sqrt(np.mean(np.concatenate([f["u"] for f in files]) ** 2)))
        odds = values["share"] / max(1.0 - values["share"], 1e-9) * (rms / values.pop("U_ref")) ** 2
        values["share"] = odds / (1.0 + odds)
    if craft.kind == "boat":  # nothing drives its sway: the mass in that equation is counted as one
        values = {n: v / craft.inertia["sway"] if n in ("Y_ur", "Y_r", "Y") else v for n, v in values.items()}
        values = {n: v for n, v in values.items() if n not in ("N_v", "Y_rdot")}  # sway follows yaw: not to be told
    if values.get("gamma"):  # a sea: the book knows the band, the drift by its variation, and its mean by another name
        values = {n: values[n] for n in ("amplitude", "drift") if values[n]}
    if hidden.slug == "shallow-water":  # the book counts from the middle of the track
        (x, y), T = ([_middle(f[n] for f in files) for n in "xy"]), values.pop("draught")
        under = values.pop("depth") - T + values["north"] * x + values["east"] * y
        for name in ("drag", "sway", "yaw"):
            values[name] *= T / under
        values |= {name: values[name] / under for name in ("north", "east")}
        values = {n: v for n, v in values.items() if n != "sway" or craft.kind != "boat"}  # nothing drives its sway
    if hidden.slug == "ground-effect":
        off = BOTTOM - max(float(f[POSITION["heave"]].max()) for f in files)
        values["strength"] *= float(np.exp(-off / values["length"]))
    return values


def _middle(columns: Iterable[Array]) -> float:
    every = np.concatenate(list(columns))
    return 0.5 * float(every.min() + every.max())
