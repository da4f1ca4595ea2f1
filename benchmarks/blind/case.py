"""Draw one case: a craft, manoeuvres and hidden effects, simulated with sensor noise of a suitable size.

The size of an effect is measured by the held-out error of the plain model, divided by the error due to noise alone.
This ratio is drawn (log-uniform), and the sensor noise is set to reach it. If no sensor has such a noise, the case is
drawn again. For waves the ratio compares the error with what an autoregression does not predict of it. The diagnosis is
not used for this.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.blind.craft import FORCE, SPEED, Craft, draw_craft, log_uniform
from benchmarks.blind.flight_plan import (
    Case,
    File,
    FlightPlan,
    FlownRuns,
    case_of,
    draw_flight_plan,
    fly,
    noise_levels,
    trial_of,
)
from benchmarks.blind.foreign import FOREIGN, SEEDED_AS
from benchmarks.blind.hidden import Hidden, Recipe
from benchmarks.blind.manoeuvres import can_turn_fully
from benchmarks.blind.plain_model import errors_of, misfit, whitened
from benchmarks.blind.process_noise import CALM, draw_drifting_moment, draw_mild_moment, smoothed
from benchmarks.blind.recipes import ENVIRONMENT, RECIPES
from benchmarks.blind.rough_water import draw_rough

__all__ = ["TRACK", "WITH_MODEL", "WITH_MODEL_EFFECTS", "Case", "NoCase", "draw_case"]

Rng = np.random.Generator

LEAST_RATIO, MOST_RATIO = 1.25, 6.0
"""Range of the held-out error of the plain model over the noise. At 1.25 the true extension lowers it by 20 %."""
LEAST_DOUBLE, MOST_DOUBLE = 1.5, 5.0
"""The same range, for the smaller one of two effects."""
LEAST_NATS = 10.0
"""Smallest improvement of the log-likelihood by the true effect in the supplied runs, with all parameters known."""
LEAST_NOISE, MOST_NOISE = 0.003, 0.1
"""Range of the noise, as a fraction of each signal's size."""
LEAST_FACTOR, MOST_FACTOR = 1.1, 2.0
"""Range of the factor by which a wrong parameter is too large or too small."""
DRAWS = 200
"""Attempts to draw a case."""

_UNPREDICTABLE = {"wave-disturbance"}
"""Effects that no simulation predicts. Their size is what an autoregression predicts of the error."""
_LATE = {"input-delay", "time-offset", "measurement-delay", "actuator-lag", "rate-limit", "time-scale"}
_MEMORYLESS = {"saturation", "dead-zone", "backlash", "quadratic-actuator", "rudder-stall", "asymmetric-thrust"}
_CONSTANT = {"input-bias", "gyro-bias", "net-buoyancy", "tether-pull"}
_SLOWED = {"quadratic-drag", "linear-drag", "advance-speed-loss", "ground-effect"}
_COMPLETE = {"unit-error", "sign-error", "channel-swap"}
_OF_PROPELLERS = {"advance-speed-loss"}
"""Effects that a rudder does not have."""
_CLASHES = (_LATE, _MEMORYLESS, _CONSTANT, _SLOWED, _COMPLETE)
"""Sets of similar effects. A case with two effects has no two from one set."""


class NoCase(RuntimeError):
    """No case with this effect could be drawn in :data:`DRAWS` attempts."""


def draw_case(kind: str, seed: int, index: int, slug: str = "") -> Case:
    """Return case number *index* of *kind*: ``single``, ``environment``, ``clean``, ``double``, ``foreign``, ``track``,
    ``clean-track``, ``process-noise``, ``mild``, ``rough``, or of :data:`WITH_MODEL`.

    *slug*: the hidden effect, for kinds that hide a chosen one.

    Raises
    ------
    NoCase
        The effect was never large enough.
    """
    rng = np.random.default_rng(
        [seed, zlib.crc32(f"{SEEDED_AS.get(kind, kind)}/{SEEDED_AS.get(slug, slug)}".encode()), index]
    )
    kinds = {
        "single": _single,
        "environment": _environment,
        "clean": _clean,
        "double": _double,
        "foreign": _foreign,
        "track": _track,
        "clean-track": _clean_track,
        "process-noise": _process_noise,
        "mild": _mild,
        "rough": draw_rough,
        **WITH_MODEL,
    }
    drawn = kinds[kind]
    for _ in range(DRAWS):
        case = drawn(rng, slug)
        if case is not None:
            return replace(case, kind=kind, index=index)
    raise NoCase(f"{kind} {slug}: effect too small in {DRAWS} draws")


# -- kinds without a supplied model


def _single(rng: Rng, slug: str) -> Case | None:
    return _one(rng, RECIPES[slug])


def _environment(rng: Rng, slug: str) -> Case | None:
    return _one(rng, ENVIRONMENT[slug])


def _one(rng: Rng, recipe: Recipe) -> Case | None:
    hidden = recipe.draw(rng, draw_craft(str(rng.choice(recipe.kinds)), rng))
    if _is_impossible(hidden) or (hidden.turns and not can_turn_fully(hidden.craft)):
        return None
    return _scaled(rng, draw_flight_plan(rng, [hidden]), [hidden], coarse=recipe.coarse)


def _track(rng: Rng, slug: str) -> Case | None:
    recipe = RECIPES[slug]
    hidden = recipe.draw(rng, draw_craft(str(rng.choice(recipe.kinds)), rng).on_track)
    if hidden.place.startswith("u+v") or hidden.craft.signals != hidden.craft.on_track.signals:
        return None
    return _scaled(rng, draw_flight_plan(rng, [hidden]), [hidden], coarse=recipe.coarse)


def _is_impossible(hidden: Hidden) -> bool:
    return hidden.slug in _OF_PROPELLERS and hidden.place == "delta"


def _foreign(rng: Rng, slug: str) -> Case | None:
    craft = draw_craft(str(rng.choice(("yaw", "surge", "heave"))), rng)
    hidden = Hidden(slug, craft.input, FOREIGN[slug].drawn(rng, craft), craft)
    plan = draw_flight_plan(rng, [hidden])
    if not any(FOREIGN[slug].differs(commands[craft.input]) for commands in plan.commands[:-1]):
        return None
    return _scaled(rng, plan, [hidden], coarse=False)


def _clean_track(rng: Rng, slug: str) -> Case | None:
    return _without_effect(rng, draw_craft(str(rng.choice(("boat", "raft"))), rng).on_track)


def _clean(rng: Rng, slug: str) -> Case | None:
    return _without_effect(
        rng, draw_craft(str(rng.choice(("yaw", "yaw", "surge", "heave", "steered", "boat", "raft"))), rng)
    )


def _without_effect(rng: Rng, craft: Craft) -> Case | None:
    nothing = Hidden("", "", {}, craft, turns=bool(rng.random() < 0.5))
    plan = draw_flight_plan(rng, [nothing])
    noise = log_uniform(rng, LEAST_NOISE, MOST_NOISE)
    levels = noise_levels(rng, craft, noise)
    files = fly(plan, [], levels)
    return case_of(rng, plan, [], files, 1.0, noise, levels)


def _double(rng: Rng, slug: str) -> Case | None:
    craft = draw_craft(str(rng.choice(("yaw", "yaw", "surge", "heave", "boat"))), rng)
    fitting = [s for s, recipe in RECIPES.items() if craft.kind in recipe.kinds and s != "linear-drag"]
    one, two = (str(s) for s in rng.choice(fitting, 2, replace=False))
    if any({one, two} <= clash for clash in _CLASHES):
        return None
    pair = [RECIPES[one].draw(rng, craft), RECIPES[two].draw(rng, craft)]
    if any(map(_is_impossible, pair)) or (pair[0].place == pair[1].place and pair[0].place in craft.signals):
        return None
    plan = draw_flight_plan(rng, pair)
    sizes = noise_levels(rng, craft, 1.0)
    alone = [_misfit(plan, fly(plan, [hidden]), sizes) for hidden in pair]
    coarse = [RECIPES[h.slug].coarse for h in pair]
    scaled = [e for e, only_size in zip(alone, coarse, strict=True) if not only_size] or alone
    if min(alone) <= 0.0 or (not any(coarse) and max(alone) > 5.0 * min(alone)):
        return None
    noise = min(scaled) / np.sqrt(log_uniform(rng, LEAST_DOUBLE, MOST_DOUBLE) ** 2 - 1.0)
    if not LEAST_NOISE <= noise <= MOST_NOISE or min(alone) / noise < np.sqrt(LEAST_DOUBLE**2 - 1.0):
        return None
    levels = {n: noise * s for n, s in sizes.items()}
    files = fly(plan, pair, levels)
    return case_of(rng, plan, pair, files, _misfit(plan, files, sizes) / noise, noise, levels)


def _process_noise(rng: Rng, slug: str) -> Case | None:
    """Return a case with a drifting moment, and one effect or none."""
    return _with_process_noise(rng, slug, draw_drifting_moment)


MILD = ("relay", "relay", "steps")
"""Manoeuvres with mild process noise."""


def _mild(rng: Rng, slug: str) -> Case | None:
    """Return a case of two relays and steps, with a drifting moment of about 30 % of full command."""
    return _with_process_noise(rng, slug, draw_mild_moment, MILD)


def _with_process_noise(
    rng: Rng, slug: str, draw_moment: Callable[[Rng, Craft], Mapping[str, float]], names: Sequence[str] = ()
) -> Case | None:
    """Return a case with process noise of *draw_moment*; None if it cannot be drawn.

    With *names*, one more run than these is flown and left out.
    """
    craft = draw_craft("yaw", rng)
    hidden = [] if slug == CALM else [RECIPES[slug].draw(rng, craft)]
    if any(map(_is_impossible, hidden)):
        return None
    plan = draw_flight_plan(rng, hidden or [Hidden("", "", {}, craft)], (*names, "steps") if names else ())
    noise = log_uniform(rng, LEAST_NOISE, 0.1 * MOST_NOISE)
    levels = {"psi": noise * craft.scale["psi"]}
    moment = Hidden("drifting-moment", craft.input, draw_moment(rng, craft), craft)
    width = int(rng.integers(1, 4))
    everything = (*hidden, moment)
    flown = FlownRuns(plan, everything, tuple(fly(plan, everything, levels)))
    files = [smoothed(f, width) for f in flown.files]
    noise_share = moment.values["spread"] / craft.full[craft.input]
    case = case_of(rng, plan, hidden, files, noise_share, noise, levels, **({"keeps": 0.0} if names else {}))
    return replace(case, runs=(*case.runs, *case.unseen), unseen=(), flown=flown)


# -- kinds with a supplied model


def _wrong_numbers(rng: Rng, slug: str) -> Case | None:
    """Return a case with one or two wrong parameters and no effect."""
    return _with_model(rng, None, int(rng.integers(1, 3)))


def _wrong_numbers_and_effect(rng: Rng, slug: str) -> Case | None:
    """Return a case with one wrong parameter and one effect."""
    return _with_model(rng, slug, 1)


def _correct_model(rng: Rng, slug: str) -> Case | None:
    """Return a case with a correct model and no effect."""
    return _with_model(rng, None, 0)


def _correct_model_and_effect(rng: Rng, slug: str) -> Case | None:
    """Return a case with a correct model and one effect."""
    return _with_model(rng, slug, 0)


def _simulation(rng: Rng, slug: str) -> Case | None:
    """Return a case with the output of a simulator that has one or two wrong parameters."""
    return _with_model(rng, None, int(rng.integers(1, 3)), as_file=False)


def _correct_simulation(rng: Rng, slug: str) -> Case | None:
    """Return a case with the output of a correct simulator."""
    return _with_model(rng, None, 0, as_file=False)


def _with_model(rng: Rng, slug: str | None, count: int, *, as_file: bool = True) -> Case | None:
    """Return a case with a model that has *count* wrong parameters.

    *as_file*: the model is supplied; otherwise only its simulation of the runs.
    """
    if slug is None:
        craft = draw_craft(str(rng.choice(("yaw", "yaw", "surge", "heave", "steered", "boat", "raft"))), rng)
        hidden = Hidden("", "", {}, craft, turns=bool(rng.random() < 0.5))
    else:
        recipe = RECIPES[slug]
        hidden = recipe.draw(rng, draw_craft(str(rng.choice(recipe.kinds)), rng))
        if _is_impossible(hidden) or (hidden.turns and not can_turn_fully(hidden.craft)):
            return None
    plan = draw_flight_plan(rng, [hidden])
    craft = plan.craft
    sizes = noise_levels(rng, craft, 1.0)
    dofs = [d for d in craft.dofs if d in craft.drives.values()]
    choices = [(kind, dof) for dof in dofs for kind in ("inertia", "linear")]
    chosen = [choices[int(i)] for i in rng.permutation(len(choices))[:count]]
    wrong = {at: log_uniform(rng, LEAST_FACTOR, MOST_FACTOR) ** (1 if rng.random() < 0.5 else -1) for at in chosen}
    plain = fly(plan, [])
    errors = [_difference(plain, fly(_with_factors(plan, {at: by}), []), sizes) for at, by in wrong.items()]
    if slug is not None:
        errors.append(_misfit(plan, fly(plan, [hidden]), sizes))
    noise = log_uniform(rng, LEAST_NOISE, MOST_NOISE)
    if errors:
        noise = min(errors) / np.sqrt(log_uniform(rng, LEAST_DOUBLE, MOST_DOUBLE) ** 2 - 1.0)
    if not LEAST_NOISE <= noise <= MOST_NOISE:
        return None
    levels = {n: noise * s for n, s in sizes.items()}
    effects = [] if slug is None else [hidden]
    if effects and not _is_visible(plan, effects, levels):
        return None
    files = fly(plan, effects, levels)
    ratio = float(np.hypot(1.0, max(errors, default=0.0) / noise))
    case = case_of(rng, plan, effects, files, ratio, noise, levels)
    simulations = (
        ()
        if as_file
        else tuple(trial_of(f"sim{k + 1}", f, False) for k, f in enumerate(fly(_with_factors(plan, wrong), [])))
    )
    names = {_parameter_name(craft, *at): by for at, by in wrong.items()}
    return replace(case, wrong=names, simulations=simulations[:-1], unseen=case.unseen if as_file else ())


def _parameter_name(craft: Craft, kind: str, dof: str) -> str:
    return f"{FORCE[dof]}_{SPEED[dof]}" + ("dot" if kind == "inertia" else "")


def _with_factors(plan: FlightPlan, wrong: Mapping[tuple[str, str], float]) -> FlightPlan:
    """Return the plan for a craft with some parameters multiplied by a factor."""
    numbers = {"inertia": dict(plan.craft.inertia), "linear": dict(plan.craft.linear)}
    for (kind, dof), by in wrong.items():
        numbers[kind][dof] *= by
    return replace(plan, craft=replace(plan.craft, **numbers))


def _difference(files: Sequence[File], others: Sequence[File], sizes: Mapping[str, float]) -> float:
    """Return the rms difference of two sets of files over all signals, each divided by its size."""
    errors = [(f[n] - o[n]) / sizes[n] for f, o in zip(files, others, strict=True) for n in sizes]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


WITH_MODEL = {
    "wrong-numbers": _wrong_numbers,
    "wrong-numbers-and-effect": _wrong_numbers_and_effect,
    "correct-model": _correct_model,
    "correct-model-and-effect": _correct_model_and_effect,
    "simulation": _simulation,
    "correct-simulation": _correct_simulation,
}
"""Kinds of cases with a supplied model or the output of a simulator."""

TRACK = ("coriolis-coupling", "sway-yaw-coupling", "sensor-position")
"""Effects hidden in runs with measured positions and heading only. Each causes sideslip, or an apparent one."""

WITH_MODEL_EFFECTS = (
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
"""Effects of cases with a supplied model. None of them is equivalent to another value of a model parameter."""


def _scaled(rng: Rng, plan: FlightPlan, hidden: Sequence[Hidden], *, coarse: bool) -> Case | None:
    """Return the case with the noise that gives the drawn ratio; None if no sensor has that noise."""
    sizes = noise_levels(rng, plan.craft, 1.0)
    if not {"u", "v"} & set(plan.craft.signals) and len(plan.craft.dofs) > 1:
        return _scaled_on_track(rng, plan, hidden, sizes)
    required = log_uniform(rng, LEAST_RATIO, MOST_RATIO)
    if coarse:
        noise = log_uniform(rng, LEAST_NOISE, MOST_NOISE)
    elif hidden[0].slug in _UNPREDICTABLE:
        noise = _noise_for_prediction(plan, fly(plan, hidden), sizes, required)
    else:
        noise = _misfit(plan, fly(plan, hidden), sizes) / np.sqrt(required**2 - 1.0)
    if not LEAST_NOISE <= noise <= MOST_NOISE:
        return None
    levels = {n: noise * s for n, s in sizes.items()}
    if not _is_visible(plan, hidden, levels):
        return None
    files = fly(plan, hidden, levels)
    ratio = _misfit(plan, files, sizes) / noise
    return case_of(rng, plan, hidden, files, ratio, noise, levels) if ratio >= LEAST_RATIO else None


def _scaled_on_track(rng: Rng, plan: FlightPlan, hidden: Sequence[Hidden], sizes: Mapping[str, float]) -> Case | None:
    """Return the case of a track without speeds. Its ratio is that of the track dead-reckoned from the plain model."""
    craft = plan.craft
    with_speeds = craft.measuring("u", "v", "r", *craft.signals)
    perfect = {**{n: with_speeds.scale[n] for n in with_speeds.signals}, **sizes}
    files = fly(replace(plan, craft=with_speeds), hidden)
    drag = plan.plain != "none"
    error = misfit(errors_of(with_speeds, files[:-1], files[-1:], perfect, drag=drag, of=craft.signals))
    noise = error / np.sqrt(log_uniform(rng, LEAST_RATIO, MOST_RATIO) ** 2 - 1.0)
    if not LEAST_NOISE <= noise <= MOST_NOISE:
        return None
    levels = {n: noise * s for n, s in sizes.items()}
    ratio = float(np.hypot(1.0, error / noise))
    return case_of(rng, plan, hidden, fly(plan, hidden, levels), ratio, noise, levels)


def _misfit(plan: FlightPlan, files: Sequence[File], sizes: Mapping[str, float]) -> float:
    return misfit(errors_of(plan.craft, files[:-1], files[-1:], sizes, drag=plan.plain != "none"))


def _is_visible(plan: FlightPlan, hidden: Sequence[Hidden], levels: Mapping[str, float]) -> bool:
    """Return whether the supplied runs show *hidden* if all parameters are known.

    A limit that only the last, held-out run reaches is not visible in them.
    """
    pairs = zip(fly(plan, hidden)[:-1], fly(plan, [])[:-1], strict=True)
    improvement = sum(float(np.sum(((f[n] - o[n]) / size) ** 2)) for f, o in pairs for n, size in levels.items()) / 2.0
    return not improvement < LEAST_NATS


def _noise_for_prediction(plan: FlightPlan, files: Sequence[File], sizes: Mapping[str, float], ratio: float) -> float:
    """Return the noise with which an autoregression lowers the error by the factor *ratio*; 0 if none does."""
    errors = errors_of(plan.craft, files[:-1], files[-1:], sizes)
    low, high = np.log(LEAST_NOISE), np.log(MOST_NOISE)
    if not whitened(errors, np.exp(high)) < ratio < whitened(errors, np.exp(low)):
        return 0.0
    for _ in range(10):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if whitened(errors, float(np.exp(middle))) > ratio else (low, middle)
    return float(np.exp(low))
