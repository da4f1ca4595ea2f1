"""Entry points of identification.

:func:`fit` accepts any structure and method. :func:`fit_axis` is for one degree of freedom.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import DataError, NotInformative, UsageError
from gcs_autotune.identify.axis.form import FREE, Structure, axis_form, structure_of
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.cramer_rao import with_bounds
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.extended.by_output_error import fit_with_effects
from gcs_autotune.identify.extended.effect_spec import effect_spec_of
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.methods import METHODS
from gcs_autotune.identify.problems.base_model import by_thrusters, plain_form
from gcs_autotune.identify.relay.limit_cycle import find_cycles
from gcs_autotune.identify.result import AxisFit, Fit, LimitCycle, Model
from gcs_autotune.identify.signals.cleaning import noted
from gcs_autotune.identify.signals.intake import CONTRADICTION, prepared_runs, take_in
from gcs_autotune.identify.signals.preparation import (
    form_driven,
    guess_dof,
    prepare,
    prepare_as_recorded,
    prepare_form,
    since_release,
)
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import FORMS, LEVER_ARM, RIGID_BODY, Form, load_form
from gcs_autotune.registry import lookup
from gcs_autotune.sname import DOFS, Dof
from gcs_autotune.trial import Trial

__all__ = ["fit", "fit_axis", "form_of", "scaled_form"]


def fit(
    runs: Trial | Sequence[Trial],
    structure: str | Form | Path | None = None,
    method: str = "output-error",
    *,
    dof: str | None = None,
    delay: Literal["auto"] | float = "auto",
    use: Sequence[str] | None = None,
    loss: Literal["linear", "soft_l1"] = "linear",
    effects: Sequence[str] = (),
    start: ExtendedModel | Mapping[str, float] | None = None,
    **options: Any,
) -> Fit[Model]:
    """Identify a model from one or more recorded runs.

    Parameters
    ----------
    structure : for one degree of freedom its damping: ``linear``, ``nonlinear`` (quadratic) or ``affine`` (both). None
        chooses by the Bayesian information criterion. For several degrees of freedom it is a name in ``FORMS``
        (``horizontal``, ``6dof`` and so on), a form file (TOML) or a ``Form``.
    method : name in ``METHODS``.
    dof : name in ``DOFS`` or ``FORMS``; None derives it from *structure* and from the motion.
    delay : delay between input and motion [s]. ``auto`` fits one and keeps it only if the evidence is strong.
    use : names of the signals to fit; None chooses them.
    loss : ``soft_l1`` reduces the weight of outliers.
    effects : effects to fit with the model, each as ``slug`` or ``slug@place`` (``quadratic-drag@yaw``). Without
        *structure* the base model is then uncoupled, with linear damping and the degrees of freedom that the runs show.
    start : model to start from, including its structure and effects (see :mod:`gcs_autotune.identify.model_file`). Some
        methods also accept a mapping of start values by name.
    options : keyword arguments for this *method* only, as listed in ``METHODS[method].options``.

    Returns
    -------
    Fit
        An ``AxisFit`` for one degree of freedom. A poor fit has doubts.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        The runs cannot be used. The message states why and what to try.
    UsageError
        An argument contradicts the runs or another argument.
    """
    if start is not None and not isinstance(start, ExtendedModel):
        options, start = {**options, "start": start}, None
    if effects or start is not None:
        _refuse_what_effects_cannot(method, options, structure if start is not None else None)
        case = _case_with_effects(_all_as_they_are(runs), structure, dof, delay, use, effects, start)
        return fit_with_effects(replace(case, robust=loss == "soft_l1"))
    runs = _all(runs, use)
    form = form_of(structure, dof, runs)
    if form is not None:
        return _fit_coupled(runs, form, method, delay, use, loss, options)
    drag = None if structure is None else structure_of(str(structure))
    return fit_axis(runs, dof=dof, structure=drag, delay=delay, method=method, use=use, loss=loss, **options)


def form_of(structure: str | Form | Path | None, dof: str | None, runs: Sequence[Trial] = ()) -> Form | None:
    """Return the requested coupled form, or None for one degree of freedom.

    If no form is requested, the inputs of *runs* determine it.
    """
    if isinstance(structure, Form):
        return structure
    if isinstance(structure, Path) or (isinstance(structure, str) and structure.endswith(".toml")):
        return load_form(Path(structure))
    if structure is not None and structure not in FREE:
        return lookup({**FORMS, **dict.fromkeys(FREE)}, structure, "structure")
    if dof is not None and dof not in DOFS:
        return lookup({**FORMS, **dict.fromkeys(DOFS)}, dof, "degree of freedom")
    if dof is not None and structure is None and by_thrusters(runs, dof):
        return plain_form(runs, dof)
    return form_driven(runs) if structure is None and dof is None else None


def _refuse_what_effects_cannot(method: str, options: dict[str, Any], structure: object) -> None:
    """Raise UsageError for arguments that a fit with effects does not support."""
    if method != "output-error":
        raise UsageError(f"effects and start values need method 'output-error', not '{method}'")
    if options:
        raise UsageError(f"a fit with effects has no option {', '.join(options)}. Omit it")
    if structure is not None:
        raise UsageError("the start model already determines the structure. Omit --structure")


def _case_with_effects(
    runs: tuple[Trial, ...],
    structure: str | Form | Path | None,
    dof: str | None,
    delay: Literal["auto"] | float,
    use: Sequence[str] | None,
    effects: Sequence[str],
    start: ExtendedModel | None,
) -> Case:
    """Return the identification task of a form with effects, on runs without corrections."""
    form = start.base.form if start is not None else form_of(structure, dof)
    if form is None and structure is not None:
        drag = structure_of(str(structure))
        axis = _common_axis(runs, dof)
        record = prepare(runs[0], axis)[0]
        form = axis_form(axis, record.input_names[0], drag, normalised=record.input_units[0] == "1")
    if form is None:
        form = plain_form(runs, dof)
    elif start is None:
        form = form.driven_by({name for run in runs for name in run.channels})
    specs = tuple(effect_spec_of(e) for e in effects)
    known_delay = _known(delay)
    if known_delay:
        form = form.fixing({"delay": known_delay})
    chosen = None if use is None else tuple(use)
    records, doubts = prepare_as_recorded(runs, form, chosen)
    return Case(
        form=form,
        records=tuple(records),
        names=tuple(run.name for run in runs),
        trials=runs,
        delay=known_delay,
        use=chosen,
        notes=tuple(doubts),
        effects=specs,
        start=start,
    )


def _fit_coupled(
    runs: tuple[Trial, ...],
    form: Form,
    method: str,
    delay: Literal["auto"] | float,
    use: Sequence[str] | None,
    loss: str,
    options: dict[str, Any],
) -> Fit[Model]:
    chosen = _method(method, loss, options)
    if chosen.coupled is None:
        raise UsageError(_no_answer(method, f"structure '{form.name}'", [n for n, m in METHODS.items() if m.coupled]))
    arm = [n for n in LEVER_ARM if n in form.parameters]
    if arm and "lever arm" not in chosen.bears:
        raise UsageError(
            f"method {method} assumes a sensor at the origin and cannot use {' and '.join(arm)}. Use one of "
            f"{', '.join(n for n, m in METHODS.items() if 'lever arm' in m.bears)}"
        )
    driven, unscaled = scaled_form(form.driven_by({name for run in runs for name in run.channels}), runs)
    with _contradictions_named(runs):
        runs, records, doubts = prepared_runs(runs, lambda run: prepare_form(run, driven, use))
    case = Case(
        form=driven,
        records=tuple(records),
        delay=_known(delay),
        use=None if use is None else tuple(use),
        robust=loss == "soft_l1",
        names=tuple(run.name for run in runs),
        trials=runs,
        options=options,
    )
    with _contradictions_named(runs):
        fitted = with_bounds(chosen.coupled(case), runs)
    return _with_doubts(
        fitted, [*doubts, *unscaled, *_not_borne(chosen, records, loss), *(d for r in records for d in r.notes)]
    )


def scaled_form(form: Form, runs: Sequence[Trial]) -> tuple[Form, list[Doubt]]:
    """Return *form*, with free gains such as ``k_X`` if inputs are normalised and an inertia is known, and doubts about
    it.

    If inputs are normalised and no inertia is known, each equation is scaled to full output of its own force. A doubt
    reports this. Only the sum of mass and added mass appears in the equations. A known mass alone therefore does not
    determine a force, and a doubt reports this too.
    """
    units = {run[c].unit for run in runs for c in form.inputs if c in run}
    if form.normalised or form.per_inertia or units != {"1"}:
        return form, []
    if not form.coriolis or len(form.dofs) < 2:
        return form, [] if form.is_in_newtons else _masses_beside_shares(form, form)
    if form.is_in_newtons:
        return form.scaling_inputs(), []
    inertia = next(f"{DOFS[d].force}_{DOFS[d].velocity}dot" for d in form.dofs)
    own = form.in_shares
    mixed = "coupling forces mix normalised outputs of different actuators"
    apart = "no force is in newtons, and an equation without input is per unit of its inertia"
    doubt = Doubt(
        "forces-in-shares",
        "the inputs are normalised outputs (-1 to 1). Inertia and drag are therefore per full output of their own "
        "equation, and " + (mixed if own is None else apart),
        "supply the force at full output (--full-scale X=85,N=23), or an inertia with its added mass (--known "
        f"{inertia}=-20)",
    )
    return form if own is None else own, [doubt, *_masses_beside_shares(form, own or form)]


def _masses_beside_shares(form: Form, own: Form) -> list[Doubt]:
    """Return a doubt about known masses and moments of inertia of *form* if no force is in newtons.

    *own* is the form that is fitted.
    """
    masses = [n for n, value in form.known.items() if n in RIGID_BODY and value != 0.0]
    if not masses:
        return []
    given = ", ".join(f"{n} = {form.known[n]:g}" for n in masses)
    kept = any(n in own.known for n in masses)
    effect = "is in kg, but nothing else is" if kept else "was not used"
    letters = [DOFS[d].force for d in form.dofs if any(DOFS[d].force in (c, *dict(g)) for c, g in form.inputs.items())]
    return [
        Doubt(
            "mass-without-newtons",
            f"the inputs are normalised outputs (-1 to 1) and no force is in newtons. The known {given} {effect}",
            f"supply the force at full output (--full-scale {','.join(f'{f}=...' for f in letters)})",
        )
    ]


def fit_axis(
    trials: Trial | Sequence[Trial],
    *,
    dof: str | None = None,
    structure: Structure | None = None,
    delay: Literal["auto"] | float = "auto",
    method: str = "output-error",
    use: Sequence[str] | None = None,
    loss: Literal["linear", "soft_l1"] = "linear",
    **options: Any,
) -> AxisFit:
    """Identify one degree of freedom.

    Parameters and errors are those of :func:`fit`.

    Returns
    -------
    AxisFit
        Its parameters are ``alpha_*``, ``beta_*``, ``beta_**``, ``delta`` and ``delay``.
    """
    runs = _all(trials, use)
    chosen = _method(method, loss, options)
    if chosen.axis is None:
        raise UsageError(_no_answer(method, "one degree of freedom", [n for n, m in METHODS.items() if m.axis]))
    if structure is not None:
        structure_of(structure)
    known_delay = _known(delay)
    axis = _common_axis(runs, dof)
    if axis.restored and chosen.coupled is None:
        others = [n for n, m in METHODS.items() if m.axis and m.coupled]
        raise UsageError(_no_answer(method, f"the restoring moment of {axis.name}", others))
    with _contradictions_named(runs):
        runs, records, doubts = prepared_runs(runs, lambda run: prepare(run, axis))
    if not all(any(mark.kind == "release" for mark in run.marks) for run in runs):
        records = since_release(runs, records)  # another run shows the inertia
    _check_one_input({r.input_names[0] for r in records}, {r.input_units[0] for r in records})
    case = Case(
        records=tuple(records),
        cycles=tuple(_cycles(runs, axis)),
        structure=structure,
        delay=known_delay,
        use=None if use is None else tuple(use),
        robust=loss == "soft_l1",
        names=tuple(run.name for run in runs),
        dropped_rows=sum(int(run.meta.get("dropped_rows", 0)) for run in runs),
        trials=runs,
        options=options,
    )
    with _contradictions_named(runs):
        fitted = chosen.axis(case)
    return _with_doubts(
        with_bounds(fitted, runs), [*doubts, *_not_borne(chosen, records, loss), *(d for r in records for d in r.notes)]
    )


@contextmanager
def _contradictions_named(runs: Sequence[Trial]) -> Iterator[None]:
    """Replace a DataError by an error that lists contradictory columns, if the runs have any."""
    try:
        yield
    except DataError as error:
        contrary = [d for run in runs for d in noted(run) if d.slug == CONTRADICTION]
        if not contrary:
            raise
        causes = "; ".join(f"{d.cause}: {d.cure}" for d in contrary)
        raise NotInformative(f"{causes}. Nothing could be identified: {error}") from error


ModelT = TypeVar("ModelT", bound=Model)


def _with_doubts(fit: Fit[ModelT], doubts: Sequence[Doubt]) -> Fit[ModelT]:
    """Return *fit* with the doubts about the runs, each once."""
    known = {(d.slug, d.cause) for d in fit.doubts}
    new = {(d.slug, d.cause): d for d in doubts if (d.slug, d.cause) not in known}
    return replace(fit, doubts=(*new.values(), *fit.doubts)) if new else fit


def _not_borne(method: Method, segments: Sequence[Segment], loss: str) -> list[Doubt]:
    """Return a doubt for each requirement of the runs or arguments that *method* does not support."""
    doubts = []
    dating = max(s.dating for s in segments)
    if dating > 0.0 and "stamps" not in method.bears:
        doubts.append(
            Doubt(
                "stamps-taken-as-exact",
                f"all input time stamps may be off by up to {1000.0 * dating:.0f} ms. Method {method.name} cannot "
                "model this, so its standard errors do not include it",
                "use output-error, which fits the time shift, and compare",
            )
        )
    if loss == "soft_l1" and "robust" not in method.bears:
        doubts.append(
            Doubt(
                "outliers-not-weighed",
                f"{method.name} is sensitive to outliers, because robust weighting is applied only after smoothing",
                "use output-error, or repair the sensor",
            )
        )
    return doubts


def _all(runs: Trial | Sequence[Trial], use: Sequence[str] | None) -> tuple[Trial, ...]:
    return take_in(_all_as_they_are(runs), use)


def _all_as_they_are(runs: Trial | Sequence[Trial]) -> tuple[Trial, ...]:
    together = (runs,) if isinstance(runs, Trial) else tuple(runs)
    if not together:
        raise NotInformative("there is no run to identify from. Supply at least one run file")
    return together


def _method(name: str, loss: str, options: dict[str, Any]) -> Method:
    method = lookup(METHODS, name, "identification method")
    if loss not in ("linear", "soft_l1"):
        raise UsageError(f"unknown loss '{loss}'. Use linear or soft_l1")
    known = {option for option, _ in method.options}
    for option in options:
        if option not in known:
            has = ", ".join(sorted(known)) or "none"
            raise UsageError(f"method '{name}' has no option '{option}'. Its options: {has}")
    return method


def _no_answer(method: str, what: str, others: list[str]) -> str:
    return f"method '{method}' does not fit {what}. Use one of {', '.join(others)}"


def _known(delay: Literal["auto"] | float) -> float | None:
    """Return a known delay [s], or None for ``auto``: a delay to be fitted."""
    return None if delay == "auto" else _seconds(delay)


def _seconds(delay: float | str) -> float:
    if not 0.0 <= float(delay) < 60.0:
        raise UsageError(f"a delay of {delay} s is not valid. Use 0 s or more")
    return float(delay)


def _common_axis(runs: Sequence[Trial], dof: str | None) -> Dof:
    if dof is not None:
        return lookup(DOFS, dof, "degree of freedom")
    guesses = [guess_dof(run) for run in runs]
    if any(g != guesses[0] for g in guesses):
        names = ", ".join(f"{r.name}: {g.name}" for r, g in zip(runs, guesses, strict=True))
        raise UsageError(
            f"the runs excite different degrees of freedom ({names}). Select one with --dof, or use fewer runs"
        )
    return guesses[0]


def _check_one_input(names: set[str], units: set[str]) -> None:
    if len(names) > 1 or len(units) > 1:
        raise UsageError(
            f"the runs have different inputs ({', '.join(sorted(names))} in {', '.join(sorted(units))}). Identify "
            "runs of one input at a time"
        )


def _cycles(runs: Sequence[Trial], axis: Dof) -> list[LimitCycle]:
    return [cycle for run in runs for cycle in find_cycles(run, axis)]
