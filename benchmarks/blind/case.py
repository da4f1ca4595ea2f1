"""One case drawn: an effect, a craft and manoeuvres, weighed so that it matters, flown in the tank with noise.

How much an effect matters is the held-out error of the plain model over that of noise alone. That ratio is drawn
(log-uniform) and the sensors' noise set to it, within what sensors have; a size for which that cannot be is drawn
again. What counts for waves is how far their error can be foretold from its own past. So small effects come with good
sensors and large ones with poor, and what counts is known without asking the diagnosis.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.blind.craft import FORCE, SPEED, Craft, draw_craft, log_uniform
from benchmarks.blind.flying import turns_round
from benchmarks.blind.foreign import FOREIGN
from benchmarks.blind.plain import errors_of, misfit, whitened
from benchmarks.blind.process_noise import CALM, drawn_weather, mild_weather, smoothed
from benchmarks.blind.rough import draw_rough
from benchmarks.blind.secret import Hidden, Recipe
from benchmarks.blind.sizes import RECIPES, SURROUNDINGS
from benchmarks.blind.voyage import Case, File, Flown, Voyage, case_of, draw_voyage, fly, noise_levels, trial_of

__all__ = ["BESIDE", "GIVEN", "TRACK", "Case", "NoCase", "draw_case"]

Rng = np.random.Generator

LEAST_RATIO, MOST_RATIO = 1.25, 6.0
"""Held-out error of the plain model over the noise; 1.25: the true extension lowers it by 20 %."""
LEAST_DOUBLE, MOST_DOUBLE = 1.5, 5.0
"""The same of the smaller one of two effects."""
LEAST_NATS = 10.0
"""Log-likelihood that the runs given (the last is kept apart) must hold for an effect, all numbers known."""
LEAST_NOISE, MOST_NOISE = 0.003, 0.1
"""Noise in shares of what each signal does."""
LEAST_FACTOR, MOST_FACTOR = 1.1, 2.0
"""By which a wrong number is too large or too small."""
DRAWS = 200
SEEDED_AS = {
    "process-noise": "weather",
    "correct-model": "honest",
    "correct-model-and-effect": "honest-and-effect",
    "correct-simulation": "honest-simulation",
}
"""Kind of case -> earlier name, from which its random seed is computed. Recorded seeds thus give the same cases."""
_UNFORESEEN = {"wave-disturbance"}
"""No simulation foretells them: knowing them is worth what an error's own past foretells of it."""
_LATE = {"input-delay", "time-offset", "measurement-delay", "actuator-lag", "rate-limit", "time-scale"}
_MEMORYLESS = {"saturation", "dead-zone", "backlash", "quadratic-actuator", "rudder-stall", "asymmetric-thrust"}
_CONSTANT = {"input-bias", "gyro-bias", "net-buoyancy", "tether-pull"}
_SLOWED = {"quadratic-drag", "linear-drag", "advance-speed-loss", "ground-effect"}
_COMPLETE = {"unit-error", "sign-error", "channel-swap"}
_OF_PROPELLERS = {"advance-speed-loss"}
"""No rudder has them."""
_CLASHES = (_LATE, _MEMORYLESS, _CONSTANT, _SLOWED, _COMPLETE)
"""Two effects of one of these sets are too much alike to ask for both."""


class NoCase(RuntimeError):
    """No size of this effect could be drawn that counts."""


def draw_case(kind: str, seed: int, index: int, slug: str = "") -> Case:
    """Return case number *index* of *kind*: ``single``, ``environment``, ``clean``, ``double``, ``foreign``, ``track``,
    ``clean-track``, ``process-noise``, ``mild``, ``rough``, or of :data:`GIVEN`.

    *slug*: the effect of a single or foreign case, or of one beside a given model.

    Raises
    ------
    NoCase
        It could not be made to count.
    """
    rng = np.random.default_rng([seed, zlib.crc32(f"{SEEDED_AS.get(kind, kind)}/{slug}".encode()), index])
    kinds = {
        "single": _single,
        "environment": _surroundings,
        "clean": _clean,
        "double": _double,
        "foreign": _foreign,
        "track": _track,
        "clean-track": _clean_track,
        "process-noise": _weather,
        "mild": _mild,
        "rough": draw_rough,
        **GIVEN,
    }
    drawn = kinds[kind]
    for _ in range(DRAWS):
        case = drawn(rng, slug)
        if case is not None:
            return replace(case, kind=kind, index=index)
    raise NoCase(f"{kind} {slug}: no case that counts in {DRAWS} draws")


# -- the four kinds


def _single(rng: Rng, slug: str) -> Case | None:
    return _one(rng, RECIPES[slug])


def _surroundings(rng: Rng, slug: str) -> Case | None:
    return _one(rng, SURROUNDINGS[slug])


def _one(rng: Rng, recipe: Recipe) -> Case | None:
    hidden = recipe.draw(rng, draw_craft(str(rng.choice(recipe.kinds)), rng))
    if _cannot_be(hidden) or (hidden.turns and not turns_round(hidden.craft)):
        return None
    return _weighed(rng, draw_voyage(rng, [hidden]), [hidden], coarse=recipe.coarse)


def _track(rng: Rng, slug: str) -> Case | None:
    recipe = RECIPES[slug]
    hidden = recipe.draw(rng, draw_craft(str(rng.choice(recipe.kinds)), rng).on_track)
    if hidden.place.startswith("u+v") or hidden.craft.signals != hidden.craft.on_track.signals:
        return None
    return _weighed(rng, draw_voyage(rng, [hidden]), [hidden], coarse=recipe.coarse)


def _cannot_be(hidden: Hidden) -> bool:
    return hidden.slug in _OF_PROPELLERS and hidden.place == "delta"


def _foreign(rng: Rng, slug: str) -> Case | None:
    craft = draw_craft(str(rng.choice(("yaw", "surge", "heave"))), rng)
    hidden = Hidden(slug, craft.input, FOREIGN[slug].drawn(rng, craft), craft)
    voyage = draw_voyage(rng, [hidden])
    if not any(FOREIGN[slug].differs(told[craft.input]) for told in voyage.commands[:-1]):
        return None
    return _weighed(rng, voyage, [hidden], coarse=False)


def _clean_track(rng: Rng, slug: str) -> Case | None:
    return _nothing(rng, draw_craft(str(rng.choice(("boat", "raft"))), rng).on_track)


def _clean(rng: Rng, slug: str) -> Case | None:
    return _nothing(rng, draw_craft(str(rng.choice(("yaw", "yaw", "surge", "heave", "steered", "boat", "raft"))), rng))


def _nothing(rng: Rng, craft: Craft) -> Case | None:
    nothing = Hidden("", "", {}, craft, turns=bool(rng.random() < 0.5))
    voyage = draw_voyage(rng, [nothing])
    noise = log_uniform(rng, LEAST_NOISE, MOST_NOISE)
    levels = noise_levels(rng, craft, noise)
    files = fly(voyage, [], levels)
    return case_of(rng, voyage, [], files, 1.0, noise, levels)


def _double(rng: Rng, slug: str) -> Case | None:
    craft = draw_craft(str(rng.choice(("yaw", "yaw", "surge", "heave", "boat"))), rng)
    fitting = [s for s, recipe in RECIPES.items() if craft.kind in recipe.kinds and s != "linear-drag"]
    one, two = (str(s) for s in rng.choice(fitting, 2, replace=False))
    if any({one, two} <= clash for clash in _CLASHES):
        return None
    pair = [RECIPES[one].draw(rng, craft), RECIPES[two].draw(rng, craft)]
    if any(map(_cannot_be, pair)) or (pair[0].place == pair[1].place and pair[0].place in craft.signals):
        return None
    voyage = draw_voyage(rng, pair)
    sizes = noise_levels(rng, craft, 1.0)
    alone = [_misfit(voyage, fly(voyage, [hidden]), sizes) for hidden in pair]
    coarse = [RECIPES[h.slug].coarse for h in pair]
    matters = [e for e, only_size in zip(alone, coarse, strict=True) if not only_size] or alone
    if min(alone) <= 0.0 or (not any(coarse) and max(alone) > 5.0 * min(alone)):
        return None
    noise = min(matters) / np.sqrt(log_uniform(rng, LEAST_DOUBLE, MOST_DOUBLE) ** 2 - 1.0)
    if not LEAST_NOISE <= noise <= MOST_NOISE or min(alone) / noise < np.sqrt(LEAST_DOUBLE**2 - 1.0):
        return None
    levels = {n: noise * s for n, s in sizes.items()}
    files = fly(voyage, pair, levels)
    return case_of(rng, voyage, pair, files, _misfit(voyage, files, sizes) / noise, noise, levels)


def _weather(rng: Rng, slug: str) -> Case | None:
    """An effect (or none) with a drifting moment; how much that hides it is not chosen."""
    return _in_weather(rng, slug, drawn_weather)


MILD = ("relay", "relay", "steps")
"""Manoeuvres with mild process noise."""


def _mild(rng: Rng, slug: str) -> Case | None:
    """An effect (or none) with a drifting moment of some 30 % of full command, in two relays and steps."""
    return _in_weather(rng, slug, mild_weather, MILD)


def _in_weather(
    rng: Rng, slug: str, weather_of: Callable[[Rng, Craft], Mapping[str, float]], names: Sequence[str] = ()
) -> Case | None:
    """Return a case with process noise of *weather_of*; None if it cannot be drawn.

    With *names*, one more run than these is flown and left out.
    """
    craft = draw_craft("yaw", rng)
    hidden = [] if slug == CALM else [RECIPES[slug].draw(rng, craft)]
    if any(map(_cannot_be, hidden)):
        return None
    voyage = draw_voyage(rng, hidden or [Hidden("", "", {}, craft)], (*names, "steps") if names else ())
    noise = log_uniform(rng, LEAST_NOISE, 0.1 * MOST_NOISE)
    levels = {"psi": noise * craft.scale["psi"]}
    weather = Hidden("weather", craft.input, weather_of(rng, craft), craft)
    width = int(rng.integers(1, 4))
    everything = (*hidden, weather)
    flown = Flown(voyage, everything, tuple(fly(voyage, everything, levels)))
    files = [smoothed(f, width) for f in flown.files]
    rough = weather.values["spread"] / craft.full[craft.input]
    case = case_of(rng, voyage, hidden, files, rough, noise, levels, **({"keeps": 0.0} if names else {}))
    return replace(case, runs=(*case.runs, *case.unseen), unseen=(), flown=flown)


# -- kinds with a model given, whose numbers are right or wrong


def _numbers(rng: Rng, slug: str) -> Case | None:
    """One or two wrong numbers, no effect."""
    return _given(rng, None, int(rng.integers(1, 3)))


def _numbers_beside(rng: Rng, slug: str) -> Case | None:
    """One wrong number beside an effect, each of which counts."""
    return _given(rng, slug, 1)


def _honest(rng: Rng, slug: str) -> Case | None:
    """Every number right, no effect."""
    return _given(rng, None, 0)


def _honest_beside(rng: Rng, slug: str) -> Case | None:
    """Every number right, beside an effect."""
    return _given(rng, slug, 0)


def _simulation(rng: Rng, slug: str) -> Case | None:
    """One or two wrong numbers of a simulator whose output alone is given."""
    return _given(rng, None, int(rng.integers(1, 3)), told=False)


def _honest_simulation(rng: Rng, slug: str) -> Case | None:
    """A simulator that does as the craft, its output alone given."""
    return _given(rng, None, 0, told=False)


def _given(rng: Rng, slug: str | None, count: int, *, told: bool = True) -> Case | None:
    """Return a case with a model of which *count* numbers are wrong, each so that it counts; *told*: as a file."""
    if slug is None:
        craft = draw_craft(str(rng.choice(("yaw", "yaw", "surge", "heave", "steered", "boat", "raft"))), rng)
        hidden = Hidden("", "", {}, craft, turns=bool(rng.random() < 0.5))
    else:
        recipe = RECIPES[slug]
        hidden = recipe.draw(rng, draw_craft(str(rng.choice(recipe.kinds)), rng))
        if _cannot_be(hidden) or (hidden.turns and not turns_round(hidden.craft)):
            return None
    voyage = draw_voyage(rng, [hidden])
    craft = voyage.craft
    sizes = noise_levels(rng, craft, 1.0)
    dofs = [d for d in craft.dofs if d in craft.drives.values()]
    choices = [(kind, dof) for dof in dofs for kind in ("inertia", "linear")]
    chosen = [choices[int(i)] for i in rng.permutation(len(choices))[:count]]
    wrong = {at: log_uniform(rng, LEAST_FACTOR, MOST_FACTOR) ** (1 if rng.random() < 0.5 else -1) for at in chosen}
    plain = fly(voyage, [])
    weights = [_apart(plain, fly(_with(voyage, {at: by}), []), sizes) for at, by in wrong.items()]
    if slug is not None:
        weights.append(_misfit(voyage, fly(voyage, [hidden]), sizes))
    noise = log_uniform(rng, LEAST_NOISE, MOST_NOISE)
    if weights:
        noise = min(weights) / np.sqrt(log_uniform(rng, LEAST_DOUBLE, MOST_DOUBLE) ** 2 - 1.0)
    if not LEAST_NOISE <= noise <= MOST_NOISE:
        return None
    levels = {n: noise * s for n, s in sizes.items()}
    effects = [] if slug is None else [hidden]
    if effects and not _shows(voyage, effects, levels):
        return None
    files = fly(voyage, effects, levels)
    ratio = float(np.hypot(1.0, max(weights, default=0.0) / noise))
    case = case_of(rng, voyage, effects, files, ratio, noise, levels)
    theirs = (
        () if told else tuple(trial_of(f"sim{k + 1}", f, False) for k, f in enumerate(fly(_with(voyage, wrong), [])))
    )
    names = {_name(craft, *at): by for at, by in wrong.items()}
    return replace(case, wrong=names, simulations=theirs[:-1], unseen=case.unseen if told else ())


def _name(craft: Craft, kind: str, dof: str) -> str:
    return f"{FORCE[dof]}_{SPEED[dof]}" + ("dot" if kind == "inertia" else "")


def _with(voyage: Voyage, wrong: Mapping[tuple[str, str], float]) -> Voyage:
    """Return a voyage of a craft with other numbers."""
    numbers = {"inertia": dict(voyage.craft.inertia), "linear": dict(voyage.craft.linear)}
    for (kind, dof), by in wrong.items():
        numbers[kind][dof] *= by
    return replace(voyage, craft=replace(voyage.craft, **numbers))


def _apart(files: Sequence[File], others: Sequence[File], sizes: Mapping[str, float]) -> float:
    """Return how far two sets of files differ: rms over all signals, each in its *sizes*."""
    errors = [(f[n] - o[n]) / sizes[n] for f, o in zip(files, others, strict=True) for n in sizes]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


GIVEN = {
    "wrong-numbers": _numbers,
    "wrong-numbers-and-effect": _numbers_beside,
    "correct-model": _honest,
    "correct-model-and-effect": _honest_beside,
    "simulation": _simulation,
    "correct-simulation": _honest_simulation,
}
"""Kinds of cases with a model (or a simulator's output) given, whose numbers are to be judged."""

TRACK = ("coriolis-coupling", "sway-yaw-coupling", "sensor-position")
"""What makes a craft slide, or look like it, hidden where its positions and heading alone are measured."""

BESIDE = (
    "dead-zone",
    "input-delay",
    "saturation",
    "backlash",
    "quadratic-drag",
    "gain-drift",
    "input-bias",
    "wind-moment",
    "gyro-bias",
    "steady-current",
)
"""Effects that wrong numbers are hidden beside: of every family, none that is another value of the same numbers."""


def _weighed(rng: Rng, voyage: Voyage, hidden: Sequence[Hidden], *, coarse: bool) -> Case | None:
    """Return the case with noise such that the effect counts as drawn; None when no sensor has that noise."""
    sizes = noise_levels(rng, voyage.craft, 1.0)
    if not {"u", "v"} & set(voyage.craft.signals) and len(voyage.craft.dofs) > 1:
        return _weighed_on_track(rng, voyage, hidden, sizes)
    wanted = log_uniform(rng, LEAST_RATIO, MOST_RATIO)
    if coarse:
        noise = log_uniform(rng, LEAST_NOISE, MOST_NOISE)
    elif hidden[0].slug in _UNFORESEEN:
        noise = _veiling(voyage, fly(voyage, hidden), sizes, wanted)
    else:
        noise = _misfit(voyage, fly(voyage, hidden), sizes) / np.sqrt(wanted**2 - 1.0)
    if not LEAST_NOISE <= noise <= MOST_NOISE:
        return None
    levels = {n: noise * s for n, s in sizes.items()}
    if not _shows(voyage, hidden, levels):
        return None
    files = fly(voyage, hidden, levels)
    ratio = _misfit(voyage, files, sizes) / noise
    return case_of(rng, voyage, hidden, files, ratio, noise, levels) if ratio >= LEAST_RATIO else None


def _weighed_on_track(rng: Rng, voyage: Voyage, hidden: Sequence[Hidden], sizes: Mapping[str, float]) -> Case | None:
    """Return the case of a track without speeds: what counts is where the plain model's speeds would have led it."""
    craft = voyage.craft
    told = craft.measuring("u", "v", "r", *craft.signals)
    perfect = {**{n: told.scale[n] for n in told.signals}, **sizes}
    files = fly(replace(voyage, craft=told), hidden)
    weight = misfit(told, files[:-1], files[-1:], perfect, drag=voyage.plain != "none", of=craft.signals)
    noise = weight / np.sqrt(log_uniform(rng, LEAST_RATIO, MOST_RATIO) ** 2 - 1.0)
    if not LEAST_NOISE <= noise <= MOST_NOISE:
        return None
    levels = {n: noise * s for n, s in sizes.items()}
    ratio = float(np.hypot(1.0, weight / noise))
    return case_of(rng, voyage, hidden, fly(voyage, hidden, levels), ratio, noise, levels)


def _misfit(voyage: Voyage, files: Sequence[File], sizes: Mapping[str, float]) -> float:
    return misfit(voyage.craft, files[:-1], files[-1:], sizes, drag=voyage.plain != "none")


def _shows(voyage: Voyage, hidden: Sequence[Hidden], levels: Mapping[str, float]) -> bool:
    """Return whether the runs that are given tell of *hidden* at all, to somebody who knows every number.

    The last run is kept apart, and a limit that only its commands reach leaves no trace in the others.
    """
    given = zip(fly(voyage, hidden)[:-1], fly(voyage, [])[:-1], strict=True)
    told = sum(float(np.sum(((f[n] - o[n]) / size) ** 2)) for f, o in given for n, size in levels.items()) / 2.0
    return not told < LEAST_NATS


def _veiling(voyage: Voyage, files: Sequence[File], sizes: Mapping[str, float], wanted: float) -> float:
    """Return the noise with which foreseeing an error from its own past lowers it by *wanted*."""
    errors = errors_of(voyage.craft, files[:-1], files[-1:], sizes)
    low, high = np.log(LEAST_NOISE), np.log(MOST_NOISE)
    if not whitened(errors, np.exp(high)) < wanted < whitened(errors, np.exp(low)):
        return 0.0
    for _ in range(10):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if whitened(errors, float(np.exp(middle))) > wanted else (low, middle)
    return float(np.exp(low))
