"""Sentences and tables of a fitted axis, shared by tune, experiment and identification."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs_autotune.effects import EFFECTS, Characteristic, EffectInstance, effect_words, limit_sentence
from gcs_autotune.identify import DAMPING, AxisFit, IsoEstimate, LimitCycle, Parameter, Remainder, StructureFit, Trace
from gcs_autotune.identify.relay import SCATTER
from gcs_autotune.models import SingleDof
from gcs_autotune.report.toolkit.document import Note, Part, Table
from gcs_autotune.report.toolkit.wording import (
    UNKNOWN,
    format_error,
    format_number,
    format_percent,
    format_quantity,
    format_seconds,
    format_share,
    format_value,
    listed,
    pretty_unit,
    to_people,
)
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.sname import OVERFULL

__all__ = [
    "candidate_table",
    "cycle_table",
    "damping_parts",
    "decision_sentence",
    "effect_meanings",
    "estimate_table",
    "explained_sentence",
    "explains",
    "meanings",
    "model_sentences",
    "model_table",
    "model_words",
    "noise_words",
    "remainder_sentence",
    "short_name",
    "structure_words",
    "with_effects",
]


_DAMPING: Mapping[str, str] = {
    "linear": "Linear damping: drag is proportional to speed.",
    "nonlinear": "Quadratic damping: drag grows with the square of speed.",
    "affine": "Linear and quadratic damping: one part of drag is proportional to speed, one grows with its square.",
}
"""Structure -> explanation of its damping, shown once per report."""


def structure_words(structure: str) -> str:
    """Return the name of a damping structure in words, e.g. ``nonlinear`` -> ``quadratic damping``."""
    return DAMPING.get(structure, structure)


def model_words(fit: AxisFit) -> str:
    """Return the structure of a fitted model in words: its damping and its actuator effects.

    An effect that cannot be distinguished from none is left out, such as a thrust curve that may be straight.
    """
    return structure_words(fit.structure) + with_effects(fit.significant_effects)


def with_effects(effects: Sequence[EffectInstance]) -> str:
    """Return the effects of a model as the end of its title: ``, with input delay``; empty without effects."""
    return f", with {listed([effect_words(e.slug) for e in effects])}" if effects else ""


def decision_sentence(fit: AxisFit) -> str:
    """Return a sentence with the two-experiment decision (Miskovic2010, eq. (7.1)-(7.2)), and with the actual
    criterion.

    The two-experiment criterion is advisory; the structure is chosen from the fits to the whole records.
    """
    decision = fit.decision
    assert decision is not None  # asked by the caller
    gap = decision.sigma_beta - decision.sigma_beta_quadratic
    numbers = (
        f"Difference between the two experiments: linear damping {format_percent(decision.sigma_beta)}, quadratic "
        f"damping {format_percent(decision.sigma_beta_quadratic)}, inertia {format_percent(decision.sigma_alpha)}."
    )
    if decision.verdict == "undecided":
        return (
            f"{numbers} The two damping figures are {format_percent(abs(gap))} apart, within the margin of "
            f"{format_percent(decision.margin)}, so this criterion does not decide. Fly a third experiment with a "
            "clearly different relay output."
        )
    advised = structure_words(decision.verdict)
    steadier = (
        f"{numbers} The smaller damping figure, by {format_percent(abs(gap))} at a margin of "
        f"{format_percent(decision.margin)}, indicates {advised}"
    )
    if fit.structure == decision.verdict:
        return f"{steadier}, and so do the fits." if len(fit.candidates) > 1 else f"{steadier}."
    if len(fit.candidates) <= 1:
        return f"{steadier}. The user requested {structure_words(fit.structure)}."
    return f"{steadier}. The fits to the whole records support {structure_words(fit.structure)}. The latter is used."


def model_sentences(fit: AxisFit) -> tuple[str, ...]:
    """Return sentences on a fitted model: damping, lag, speed at the largest output flown, actuator, residual."""
    model, axis = fit.model, fit.model.axis
    unit = "rad/s" if axis.angular else "m/s"
    said = [_DAMPING[fit.structure]]
    resolved = not any(d.slug == "inertia-unresolved" for d in fit.doubts)
    if model.beta != 0.0 and fit.structure != "nonlinear" and resolved:
        said.extend(_decay_sentence(fit))
    if axis.restored:
        said.extend(_restoring_sentence(model))
    elif model.input_unit == "1":
        said.extend(_top_speed(fit, unit))
    said.extend(_actuator_sentence(fit, own) for own in fit.effects)
    output = _most_flown(fit)
    acting = _acting(fit.effects, output)
    if model.input_unit == "1" and abs(acting - output) > _MUCH:
        by_it = _with_error(fit, lambda moved, effects: moved.alpha / _acting(effects, output))
        per_force = pretty_unit(fit.parameters[axis.parameter_names()[0]].unit)
        said.append(
            f"{_of_full(output)} gives {format_number(acting)} in the table's unit of force. Relative to this force "
            f"the inertia is {format_value(*by_it)} {per_force}, if the thrust curve holds between the outputs flown."
        )
    trace = fit.traces[0] if fit.traces else None
    left = Remainder(fit.residual_rms, fit.residual_rms) if trace is None else fit.remainder[trace.signal]
    shown = trace.unit if trace is not None and trace.unit else axis.position_unit
    return (*said, remainder_sentence(left, shown))


def _decay_sentence(fit: AxisFit) -> list[str]:
    """Return a sentence on how motion decays without input; empty if linear damping may be zero, or if the decay takes
    longer than the runs.

    If the model lacks a term, its linear damping may stand for a dead zone or a thrust curve.
    """
    model, axis = fit.model, fit.model.axis
    if model.input_unit == "1" and fit.lacks_a_term and not fit.effects:
        return [
            "How motion decays without input is uncertain: the model lacks a term. A dead zone or a thrust curve of "
            "the actuator looks like linear damping."
        ]
    time = model.alpha / model.beta
    longest = max((float(np.ptp(trace.t)) for trace in fit.traces), default=math.inf)
    if abs(model.beta) <= HALF_WIDTH * fit.parameters[axis.parameter_names()[1]].std or abs(time) > longest:
        return []
    how = "decays" if time > 0.0 else "grows"
    slow = "at low turn rates" if axis.angular else "at low speed"
    when = "without input" if fit.structure == "linear" else f"without input and {slow}"
    return [f"{when.capitalize()}, motion {how} with a time constant of {format_seconds(abs(time))}."]


def _restoring_sentence(model: SingleDof) -> list[str]:
    """Return a sentence on the natural oscillation of a craft that is pulled back to level, without drag."""
    if not model.restoring * model.alpha > 0.0:
        return ["No restoring moment is visible: the craft does not come back to level by itself."]
    period = math.tau * math.sqrt(model.alpha / model.restoring)
    return [f"Without damping it would oscillate about level with a period of {format_seconds(period)}."]


_MUCH = 0.02
"""Difference between a full force and the actual one [fraction] above which a sentence states the latter.

Project choice.
"""


def _top_speed(fit: AxisFit, unit: str) -> list[str]:
    """Return the steady speed at the largest output flown; empty if outputs are not normalised or it is unstable."""
    if _largest(fit) > OVERFULL or (fit.structure == "linear" and fit.model.alpha * fit.model.beta < 0.0):
        return []
    output = _most_flown(fit)
    # The trim does not belong to what the craft can do: the constant that steady_velocity adds is taken off before.
    top, error = _with_error(fit, lambda m, effects: abs(m.steady_velocity(_acting(effects, output) - m.delta)))
    if not math.isfinite(top):
        return []
    error = math.hypot(error, _by_shape(fit, top))
    shown, factor = to_people(unit)
    speed = f"{format_value(top * factor, error * factor)}{'' if shown.startswith('°') else ' '}{pretty_unit(shown)}"
    more = "" if output == 1.0 else ", the largest of the fitted runs,"
    trimmed = abs(_with_error(fit, lambda m, effects: m.steady_velocity(_acting(effects, output)))[0])
    without = ", without the constant disturbance" if abs(trimmed - top) > error else ""
    return [f"{_of_full(output)}{more} sustains {speed}{without}."]


def _by_shape(fit: AxisFit, top: float) -> float:
    """Return the standard error of a steady speed *top* due to the shape of damping, which the fit treats as known.

    Up to the fastest motion flown, the runs determine the shape. At higher speeds damping may be linear or quadratic,
    and the speed is between the two results.
    """
    fastest = max((_fastest(trace, fit.model.axis.velocity) for trace in fit.traces), default=math.nan)
    if not 0.0 < fastest < top:
        return 0.0

    def drag(nu: float) -> float:
        return abs(fit.model.beta * nu) + abs(fit.model.beta_quadratic) * nu * nu

    more = drag(top) / drag(fastest)
    return fastest * abs(more - math.sqrt(more)) / math.sqrt(12.0)


def _fastest(trace: Trace, velocity: str) -> float:
    """Return the largest model speed on a trace, from its velocity or its position."""
    if trace.signal == velocity:
        return float(np.max(np.abs(trace.fitted), initial=0.0))
    dt = np.diff(trace.t)
    forward = dt > 0.0
    return float(np.max(np.abs(np.diff(trace.fitted)[forward] / dt[forward]), initial=0.0))


def _most_flown(fit: AxisFit) -> float:
    """Return the largest output flown, 1 if unknown. Above it the thrust curve is an extrapolation.

    A BlueBoat turned at 33.7 deg/s at full output in a spiral, where doublets of 63 % predicted 36.3: its thrusters
    are weaker astern.
    """
    flown = _largest(fit)
    return flown if flown < 1.0 - _MUCH else 1.0


def _largest(fit: AxisFit) -> float:
    largest = fit.extra.get("largest", {})
    return float(largest.get(fit.model.axis.force, largest.get("delta", 1.0)))


def _of_full(output: float) -> str:
    return "Full output" if output == 1.0 else f"An output of {format_share(output)}"


def _acting(effects: Sequence[EffectInstance], output: float) -> float:
    """Return the force due to *output* in the model, including the dead zone."""
    acting = np.full(1, output)
    for effect in effects:
        law = EFFECTS[effect.slug]
        if isinstance(law, Characteristic):
            acting = law.acting(effect, acting)
    return float(acting[0])


def _with_error(fit: AxisFit, told: Callable[[SingleDof, Sequence[EffectInstance]], float]) -> tuple[float, float]:
    """Return *told*, a number computed from the model and its actuator effects, with its standard error to first
    order."""
    fields = ("alpha", "beta", "beta_quadratic", "delta", "delay")
    value, slopes = told(fit.model, fit.effects), np.zeros(len(fit.parameters))
    for k, (name, parameter) in enumerate(fit.parameters.items()):
        if not parameter.std > 0.0:
            continue
        small = 1e-4 * max(abs(parameter.value), parameter.std)
        model, effects = fit.model, list(fit.effects)
        if k < len(fields):
            model = replace(model, **{fields[k]: getattr(model, fields[k]) + small})
        else:
            effects = [_moved(e, name, small) for e in effects]
        slopes[k] = (told(model, effects) - value) / small
    return value, math.sqrt(max(float(slopes @ fit.covariance @ slopes), 0.0))


def _moved(effect: EffectInstance, label: str, by: float) -> EffectInstance:
    """Return *effect* with the parameter of that *label* shifted, if it has one."""
    return effect.with_values({n: v + by for n, v in effect.values.items() if effect.label_of(n) == label})


def explains(percent: float) -> str:
    """Return the text ``explains 74 % of``, or ``explains nothing of`` if *percent* is 0 or less."""
    if percent > 0.0:
        return f"explains {format_percent(percent)} of"
    return "explains nothing of"


def explained_sentence(percent: float, motion: str = "the motion used for the fit", also: str = "") -> str:
    """Return a sentence on how much [%] of *motion* a model explains in a free run. The text *also* is appended."""
    return f"Simulated from the inputs alone, the model {explains(percent)} {motion}{also}."


def noise_words(*left: Remainder) -> str:
    """Return words for residuals that are mostly noise. They state it if the whiteness test finds a correlation."""
    if all(each.is_only_noise for each in left):
        return "mostly white, like measurement noise"
    return "mostly white, but not only noise: it has a small correlated part"


def remainder_sentence(left: Remainder, unit: str) -> str:
    """Return a sentence on the RMS residual: its white noise, and its correlated, unexplained remainder."""
    rms = format_error(left.rms, unit, 2)
    if not math.isfinite(left.rms):
        return ""
    if left.unexplained <= 0.0:
        return f"The residual ({rms} rms) is {noise_words(left)}."
    noise, rest = format_error(left.noise, unit, 2), format_error(left.unexplained, unit, 2)
    return f"The residual is {rms} rms: {noise} white (noise), {rest} correlated and unexplained."


def _actuator_sentence(fit: AxisFit, own: EffectInstance) -> str:
    """Return a sentence on an actuator effect, with its number rounded to its standard error.

    If more than noise is unexplained, the model lacks a term. The standard error is then too small, and is left out.
    """

    def number(name: str) -> str:
        if fit.lacks_a_term:
            return f"about {format_number(own[name], 2)}"
        parameter = fit.parameters.get(own.label_of(name))
        return format_value(own[name], math.nan if parameter is None else parameter.std)

    if own.slug == "quadratic-actuator":
        largest = own.constants["u_ref"]
        over = "" if largest == 1.0 else f"/{format_number(largest, 3)}"
        beyond = " beyond the dead zone" if any(e.slug == "dead-zone" for e in fit.effects) else ""
        return (
            f"The force at output x{beyond} is (1 - q) x + q x²{over} with q = {number('share')}. q = 0 is "
            "proportional; q = 1 is quadratic, like a plain propeller."
        )
    if own.slug == "dead-zone":
        return f"The model has a dead zone: no force below {number('width')} of full output."
    if own.slug == "saturation":
        return f"{limit_sentence(number('limit'))}. Thrust that flattens gradually gives such a limit too."
    values = ", ".join(f"{name} {number(name)}" for name in own.values)
    return f"Actuator: {effect_words(own.slug)}, {values}."


_STATUS: Mapping[str, str] = {
    "fitted": "",
    "absent": "not fitted",
    "fixed": "fixed",
    "at_bound": "AT ITS BOUND: not reliable",
}
"""Parameter status -> remark."""


def model_table(fit: AxisFit) -> Table:
    """Return a table of the identified parameters, rounded to their standard errors."""
    meaning = meanings(fit)
    rows = tuple(
        (
            short_name(p.name),
            _parameter_value(p),
            pretty_unit(p.unit) or "1",
            meaning.get(p.name, ""),
            _STATUS[p.status],
        )
        for p in fit.parameters.values()
    )
    return Table(("parameter", "value ± std", "unit", "meaning", "remark"), "lrlll", rows)


def _parameter_value(parameter: Parameter) -> str:
    if parameter.status == "absent":
        return "0"
    return format_value(parameter.value, parameter.std)


def meanings(fit: AxisFit) -> dict[str, str]:
    """Return name -> meaning of the parameters of one axis."""
    words = ("inertia with added mass", "linear damping", "quadratic damping", "constant disturbance")
    by_name = {**dict(zip(fit.model.axis.parameter_names(), words, strict=True)), "delay": "input delay"}
    by_name[fit.model.axis.restoring_name] = "restoring moment per angle"
    return by_name | effect_meanings(fit.effects)


def effect_meanings(effects: Sequence[EffectInstance]) -> dict[str, str]:
    """Return name -> meaning of the parameters of *effects*."""
    meaning = {effect.label_of(q.name): q.meaning for effect in effects for q in EFFECTS[effect.slug].parameters}
    # A thrust curve of throttle steps refers to full output, even if no step reached it.
    curves = (e for e in effects if e.slug == "quadratic-actuator" and e.constants.get("u_ref") == 1.0)
    return meaning | {e.label_of("share"): "quadratic fraction of the thrust at full output" for e in curves}


def short_name(name: str) -> str:
    """Return the name of a parameter in a table: ``dead-zone@N.width`` is ``width``."""
    return name.rpartition(".")[2] if "@" in name else name


def cycle_table(fit: AxisFit) -> Table:
    """Return a table of the limit cycles that IS-O evaluated in the relay experiments."""
    unit = fit.model.axis.position_unit
    rows = tuple(_cycle_row(e, unit, fit.model.input_unit) for e in fit.iso)
    heads = ("output C", "x_a set", "x_a* real", "amplitude", "bias", "period", "periods", "scatter", "valid")
    return Table(heads, "rrrrrrrrl", rows)


def _cycle_row(estimate: IsoEstimate, unit: str, input_unit: str) -> tuple[str, ...]:
    cycle = estimate.cycle
    period = 2.0 * math.pi / cycle.omega if cycle.omega > 0.0 else math.nan
    return (
        _output(cycle.C, input_unit),
        format_quantity(cycle.x_a, unit),
        format_quantity(cycle.x_a_star, unit),
        format_quantity(cycle.X_m, unit),
        format_quantity(cycle.x_0, unit, 2),
        format_seconds(period),
        str(cycle.periods),
        format_share(cycle.scatter) if math.isfinite(cycle.scatter) else UNKNOWN,  # one period scatters about nothing
        _cycle_verdict(cycle),
    )


def _cycle_verdict(cycle: LimitCycle) -> str:
    """Return whether a limit cycle fulfils (7.12) and the 10 % rule of (6.7), Miskovic2010."""
    if not cycle.valid:
        return "NO (7.12)"
    return "uneven" if math.isfinite(cycle.scatter) and cycle.scatter > SCATTER else "yes"


def _output(value: float, input_unit: str) -> str:
    return format_share(value) if input_unit == "1" else format_quantity(value, input_unit)


def estimate_table(fit: AxisFit) -> Table:
    """Return a table with the estimates of IS-O from each experiment, and of the refined fit."""
    names = fit.model.axis.parameter_names()
    rows = [
        (f"IS-O {i}", *(format_number(round(v, 9)) for v in (e.alpha, e.beta, e.beta_quadratic, e.delta)))
        for i, e in enumerate(fit.iso, start=1)
    ]
    rows.append(("refined", *(_parameter_value(fit.parameters[n]) for n in names)))
    return Table(("", *names), "lrrrr", tuple(rows))


def candidate_table(fit: AxisFit) -> Table:
    """Return a table of the damping structures compared by BIC; the smallest BIC is best."""
    best = min((c.bic for c in fit.candidates), default=math.nan)
    unit = fit.traces[0].unit if fit.traces and fit.traces[0].unit else fit.model.axis.position_unit
    taken = min((c.bic for c in fit.candidates if c.structure == fit.structure), default=best)
    rows = tuple(_candidate_row(c, best, unit, fit.structure, taken) for c in fit.candidates)
    return Table(("structure", "meaning", "misfit rms", "fitted", "BIC - best", "verdict"), "llrrrl", rows)


def _candidate_row(candidate: StructureFit, best: float, unit: str, chosen: str, taken: float) -> tuple[str, ...]:
    """Return the row of a candidate.

    If it fits better than the *chosen* one (BIC *taken*), add why it was not chosen.
    """
    pushes = min(candidate.model.beta, candidate.model.beta_quadratic) * candidate.model.alpha < 0.0
    passed_over = "negative damping" if pushes and candidate.bic < taken else ""
    return (
        candidate.structure,
        structure_words(candidate.structure),
        format_quantity(candidate.rms, unit, 4),
        str(candidate.free_parameters),
        f"{candidate.bic - best + 0.0:.1f}",
        "chosen" if candidate.structure == chosen else passed_over,
    )


_HOW_TO_READ_BIC = (
    "BIC weighs the misfit against the number of fitted parameters. A structure more than 10 above the best explains "
    "the record clearly worse. Negative damping is not physical: such a structure is chosen only if there is no other."
)


def damping_parts(fit: AxisFit) -> tuple[Part, ...]:
    """Return notes and tables on the choice of the damping: the decision from two experiments, and the structures
    compared.
    """
    decided = () if fit.decision is None else (Note(decision_sentence(fit)),)
    if not fit.candidates:
        return decided
    return (*decided, candidate_table(fit), Note(_HOW_TO_READ_BIC, kind="quiet"))
