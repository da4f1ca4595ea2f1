"""Build the base model that a diagnosis compares with, and summarise the runs before a fit."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.clock import OutOfTime, limited_to
from gcs_autotune.effects import DataSummary, EffectInstance
from gcs_autotune.errors import MissingChannel, NotInformative
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.problems.fitted import Fitted
from gcs_autotune.identify.problems.initial_guess import initial_guess_of
from gcs_autotune.identify.problems.likelihood import Limits
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.quick_fit import first_levels
from gcs_autotune.identify.signals.preparation import INPUTS
from gcs_autotune.identify.signals.segment import MIN_SAMPLES, Segment
from gcs_autotune.models import FORMS, CoupledModel, Form, inertia_of
from gcs_autotune.sensor import moves
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Trial

__all__ = [
    "THRUSTERS",
    "base_limits",
    "by_thrusters",
    "data_summary_of",
    "fit_base",
    "given_base",
    "overlooked",
    "plain_form",
    "requested_dofs",
]

Array = NDArray[np.float64]

STEERED_BY_ANGLE = "delta"

RUDDER = "rad"
"""Unit that identifies an input as a rudder angle."""

THRUSTERS = ("force_left", "force_right")
"""Input channels of a boat with two fixed thrusters, as in the form ``twin-thruster``."""

TRACK = {"x", "y", "psi"}
"""Signals that together show surge and sway if no speed is recorded."""


def plain_form(runs: Sequence[Trial], dof: str | None = None) -> Form:
    """Return the base model of a diagnosis: the recorded degrees of freedom, uncoupled, with linear damping.

    dof : names joined by commas, or a shipped form (``horizontal``) for all of its degrees of freedom. None takes the
        one that all runs declare as oscillated, otherwise all recorded ones.

    A track (x, y and the heading) without speeds shows surge and sway too, if an input drives the heading. Steady
    thrust counts as a surge input if sway can be determined, from a track or from speeds ahead and sideways.

    Raises
    ------
    MissingChannel
        No degree of freedom has both an input and a measured motion.
    """
    there = {n for run in runs for n, c in run.channels.items() if len(c) >= MIN_SAMPLES}
    varies = {
        n for run in runs for n, c in run.channels.items() if len(c) and np.ptp(c.values[np.isfinite(c.values)]) > 0
    }
    requested = requested_dofs(runs, dof)
    if set(THRUSTERS) <= there:
        return _twin_thruster(requested, there)
    steered = any(c in varies for c in INPUTS["yaw"]) and (requested is None or "yaw" in requested)
    track = steered and TRACK <= there and not {"u", "v"} & there
    slides = track or (steered and {"u", "v"} <= varies)
    pushed = {n for run in runs for n, c in run.channels.items() if len(c) and np.any(c.values)} if slides else set()
    dofs, inputs, free = [], {}, []
    for name in ("surge", "sway", "heave", "roll", "pitch", "yaw"):
        d = DOFS[name]
        drives = [c for c in INPUTS[name] if c in there]
        drive = next((c for c in drives if c in varies), None)
        if drive is None and name == "surge":
            drive = next((c for c in drives if c in pushed), None)
        seen = {d.velocity, d.position} & there
        if name == "surge" and d.velocity not in there and "psi" in there and not track:
            seen = set()
        if (requested is not None and name not in requested) or drive is None or not seen:
            continue
        dofs.append(name)
        inputs[drive] = ((d.force, 1.0),)
        free += [f"{d.force}_{d.velocity}dot", f"{d.force}_{d.velocity}"]
    known = {}
    adrift = "sway" not in dofs and {"surge", "yaw"} <= set(dofs) and ("v" in there or track)
    if adrift and (requested is None or "sway" in requested):
        dofs.insert(1, "sway")
        known["Y_vdot"] = -1.0
        free.append("Y_v")
    if not dofs:
        have = ", ".join(sorted(there)) or "nothing"
        raise MissingChannel(
            "no degree of freedom has both a varying input and a measured motion. Yaw needs N[N m] or delta[rad] "
            f"with psi[rad] or r[rad/s]. Surge needs X and u. Heave needs Z and z or w. The runs have {have}"
        )
    title = "uncoupled, linear damping: " + ", ".join(dofs)
    return Form("plain", title, tuple(dofs), tuple(free), known, inputs, coriolis=False)


def requested_dofs(runs: Sequence[Trial], dof: str | None) -> list[str] | None:
    """Return the names of the requested degrees of freedom, or None for all recorded ones; see :func:`plain_form`.

    Raises
    ------
    MissingChannel
        *dof* contains a name that is neither a degree of freedom nor a shipped form.
    """
    if dof is None:
        return swung(runs)
    names = [d.strip() for d in dof.split(",")]
    strange = [d for d in names if d not in DOFS and d not in FORMS]
    if strange:
        raise MissingChannel(
            f"unknown degree of freedom {', '.join(strange)}. Use one of {', '.join(DOFS)}. For several at once use "
            f"{', '.join(FORMS)}"
        )
    return list(dict.fromkeys(d for n in names for d in (FORMS[n].dofs if n in FORMS else (n,))))


def overlooked(
    runs: Sequence[Trial], form: Form, dof: str | None, use: Sequence[str] | None, segments: Sequence[Segment]
) -> list[Doubt]:
    """Return doubts about requested or recorded motion that *form* could not include."""
    requested = requested_dofs(runs, dof)
    doubts = []
    missing = [d for d in requested or () if d not in form.dofs] if dof is not None else []
    if missing:
        columns = "; ".join(
            f"{d}: {' or '.join(INPUTS[d])} and {DOFS[d].velocity} or {DOFS[d].position}" for d in missing
        )
        doubts.append(
            Doubt(
                "not-looked-at",
                f"{', '.join(missing)} was requested but not analysed, because the runs lack its input or its motion",
                f"record the missing channels ({columns})",
            )
        )
    compared = {n for s in segments for n in s.signals}
    moving = {
        n for run in runs for n in ("x", "y") if n in run and len(run[n]) >= MIN_SAMPLES and np.ptp(run[n].values) > 0.0
    }
    left = sorted(moving - compared)
    if left and use is None and (requested is None or {"surge", "sway"} & set(requested)):
        doubts.append(
            Doubt(
                "not-looked-at",
                f"{' and '.join(left)} were recorded but not compared. The recorded channels do not support a model "
                "of motion in the plane. Effects on the track alone were therefore not analysed",
                "record the thrust X and the speeds u and v, or only x, y and psi together with X and N",
            )
        )
    return doubts


def swung(runs: Sequence[Trial]) -> list[str] | None:
    """Return the degree of freedom that all *runs* declare as oscillated, or None if they declare none or different
    ones.

    During such a run a controller held the other degrees of freedom still. Their motion shows the controller's
    performance only.
    """
    stated = {run.meta.get("dof") for run in runs}
    return [str(d) for d in stated] if len(stated) == 1 and stated <= set(DOFS) else None


def by_thrusters(runs: Sequence[Trial], dof: str) -> bool:
    """Return whether two thrusters side by side are the only inputs of a degree of freedom in every run."""
    return (
        dof in ("surge", "yaw")
        and len(runs) > 0
        and all(set(THRUSTERS) <= set(run.channels) and not any(n in run for n in INPUTS[dof]) for run in runs)
    )


def _twin_thruster(requested: Sequence[str] | None, there: Collection[str]) -> Form:
    left, right = THRUSTERS
    dofs = [d for d in ("surge", "yaw") if DOFS[d].velocity in there or (d == "yaw" and "psi" in there)]
    dofs = [d for d in dofs if requested is None or d in requested]
    inputs: dict[str, tuple[tuple[str, float | str], ...]] = {left: (), right: ()}
    free: list[str] = []
    if "surge" in dofs:
        inputs = {c: (*g, ("X", 1.0)) for c, g in inputs.items()}
        free += ["X_udot", "X_u"]
    if "yaw" in dofs:
        inputs = {left: (*inputs[left], ("N", "k_N")), right: (*inputs[right], ("N", "-k_N"))}
        free += ["k_N", "N_r"]
    known = {"I_z": 1.0} if "yaw" in dofs else {}
    if not dofs:
        raise MissingChannel(
            f"two thrusters are recorded, but none of u, r and psi. Recorded: {', '.join(sorted(there))}"
        )
    return Form(
        "plain", "two fixed thrusters with linear damping", tuple(dofs), tuple(free), known, inputs, coriolis=False
    )


def data_summary_of(form: Form, segments: Sequence[Segment], base: Mapping[str, float] | None = None) -> DataSummary:
    """Return a summary of the runs before any effect is fitted.

    base : name -> value of the parameters of the base model, if known.
    """
    signals = {n: SIGNALS[n][0] for r in segments for n in r.signals}
    given = dict(
        zip(segments[0].input_names, segments[0].input_units, strict=True)
    )  # of a part of a form some are not its
    units = {n: given[n] for n in form.inputs}
    values = {n: np.concatenate([r.signals[n].values for r in segments if n in r.signals]) for n in signals}
    measured: dict[str, list[Array]] = {}
    for segment in {s.run: s for s in segments}.values():
        for name, channel in segment.measured.items():
            good = channel.values[np.isfinite(channel.values)]
            if len(good):
                measured.setdefault(name, []).append(good)
    joined = {n: np.concatenate(parts) for n, parts in measured.items()}
    steps = [float(np.median(np.diff(s.t))) for r in segments for s in r.signals.values() if len(s.t) > 1]
    inertia = [(f"{DOFS[d].force}_{DOFS[d].velocity}") for d in form.dofs]
    twins = _twins(form, units)
    time_constants = [abs(base[f"{n}dot"] / base[n]) for n in inertia if base and base.get(n) and f"{n}dot" in base]
    return DataSummary(
        form=form,
        inputs=units,
        signals=signals,
        amplitude={
            n: max(float(np.abs(s.inputs[:, s.input_names.index(n)]).max()) for s in segments) for n in form.inputs
        },
        spread={n: max(float(np.std(v)), 1e-12) for n, v in values.items()},
        level=first_levels(segments),
        channels=frozenset(joined),
        interval=float(np.median(steps)),
        time_constant=float(np.clip(max(time_constants, default=1.0), 1e-2, 1e3)),
        duration=max(float(r.stamps[-1]) - r.start for r in segments),
        quantum={n: max(r.signals[n].step for r in segments if n in r.signals) for n in signals},
        extent={n: (float(v.min()), float(v.max())) for n, v in joined.items()},
        rms={n: float(np.sqrt(np.mean(v**2))) for n, v in joined.items()},
        usual={n: (float(np.quantile(v, 0.1)), float(np.quantile(v, 0.9))) for n, v in joined.items()},
        base=dict(base or {}),
        runs=tuple(dict.fromkeys(s.run for s in segments)),
        still=frozenset(n for n, parts in measured.items() if n in RATES and all(map(_is_still, parts))),
        lags={n: max(s.lags.get(n, 0.0) for s in segments) for n in signals},
        twins=twins,
        commanded_alike=tuple(pair for pair in twins if _commanded_alike(pair, segments)),
    )


RATES = frozenset(d.velocity for d in DOFS.values())
"""Names of the velocities of all degrees of freedom."""


def _is_still(velocity: Array) -> bool:
    """Return whether a measured velocity (n,) is only noise, because the craft stood still."""
    return not moves(velocity) and abs(float(np.mean(velocity))) < float(np.std(velocity))


APART = 0.1
"""Limit of the rms difference between two thrusters' commands, relative to their rms. Project choice.

Below it the commands count as equal.
"""


def _twins(form: Form, units: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """Return pairs of inputs in the same unit that drive the same equations with gains equal except for the sign."""
    gains = {
        n: {force: str(gain).lstrip("-") for force, gain in pairs}
        for n, pairs in form.inputs.items()
        if pairs and units.get(n) != RUDDER
    }
    return tuple((a, b) for a, b in combinations(gains, 2) if gains[a] == gains[b] and units.get(a) == units.get(b))


def _commanded_alike(pair: tuple[str, str], segments: Sequence[Segment]) -> bool:
    a, b = (np.concatenate([s.inputs[:, s.input_names.index(n)] for s in segments]) for n in pair)
    return float(np.mean((a - b) ** 2)) < APART**2 * float(np.mean(0.5 * (a * a + b * b)))


def base_limits(form: Form) -> Limits:
    """Return the limits of the base parameters: positive inertia, positive drag, and either sign for a rudder."""
    limits = Limits.physical(form)
    rows = {force for force, _ in form.inputs.get(STEERED_BY_ANGLE, ())}
    low = {n: v for n, v in limits.low.items() if n[0] not in rows}
    high = {n: v for n, v in limits.high.items() if n[0] not in rows}
    for name in list(high):
        if name.endswith("dot") and inertia_of(name) is not None:
            high[name] = -1e-9
    return Limits(low, high)


def fit_base(form: Form, segments: Sequence[Segment], *, trials: int = 30) -> tuple[Problem, Fitted]:
    """Return *form* as a problem on *segments*, and the best fit from several starts.

    trials : maximum number of steps per start.

    If an :class:`.Effort` is used up, return the best fit so far or, without any, the best start.

    Raises
    ------
    NotInformative
        The simulation diverges from every start.
    """
    limits = base_limits(form)
    ground = initial_guess_of(form, segments)
    problem = Problem(form, segments, data_summary_of(form, segments), limits)
    low, high = limits.of(form.parameters)
    starts = ((np.clip(theta, low, high), ground.initial, 0.0) for theta in ground.starts(limits))
    best = _best_from(problem, starts, (), trials)
    if best is None:
        raise NotInformative(
            f"no simulation of '{form.title}' follows these runs. Check columns and units, or use --dof with fewer "
            "degrees of freedom"
        )
    return _known(form, segments, limits, best), best


def given_base(
    model: CoupledModel, effects: Sequence[EffectInstance], segments: Sequence[Segment]
) -> tuple[Problem, Fitted | None, Fitted]:
    """Return the problem, the fit of a supplied *model* with its own parameters, and its refit with all parameters
    free.

    The first fit has only its initial states fitted. It is None if the model diverges on these runs. The refit starts
    at the supplied parameters and at the usual starts. One wrong parameter therefore cannot keep the others in a local
    minimum.

    Raises
    ------
    NotInformative
        The simulation diverges from every start.
    """
    form, limits = model.form, base_limits(model.form)
    problem = Problem(form, segments, data_summary_of(form, segments, model.values), limits)
    ground = initial_guess_of(form, segments)
    low, high = limits.of(form.parameters)
    with np.errstate(over="ignore", invalid="ignore"), limited_to(None):  # what it is compared with, come what may
        given = problem.states(model.theta, effects, ground.initial)
    own = (model.theta, given.initial if given else ground.initial, given.shift if given else 0.0)
    starts = ((np.clip(theta, low, high), ground.initial, 0.0) for theta in ground.starts(limits))
    best = _best_from(problem, chain([own], starts), effects)
    if best is None:
        raise NotInformative(
            f"the model '{form.title}' diverges on these runs for all parameter values. Check that it describes this "
            "craft and uses the units of the runs"
        )
    return _known(form, segments, limits, best), given, best


def _best_from(
    problem: Problem,
    begins: Iterable[tuple[Array, Sequence[Array], float]],
    effects: Sequence[EffectInstance],
    trials: int = 30,
) -> Fitted | None:
    """Return the best fit from these parameters, initial states and shifts, or None if all diverge.

    If the time is too short for a single fit, return the best start unchanged.
    """
    begun, fits = [], []
    with np.errstate(over="ignore", invalid="ignore"):  # a start may run away; what it leads to is judged by its cost
        try:
            for theta, initial, shift in begins:
                begun.append((theta, initial, shift))
                fits.append(problem.fit(theta, effects, initial, trials=trials, shift=shift))
        except OutOfTime:
            if not any(fits):
                with limited_to(None):
                    fits = [problem.fit(x, effects, initial, trials=0, shift=s) for x, initial, s in begun]
    return min((fit for fit in fits if fit is not None), key=lambda fit: fit.cost, default=None)


def _known(form: Form, segments: Sequence[Segment], limits: Limits, fitted: Fitted) -> Problem:
    """Return the problem whose data summary contains the fitted values of the base model."""
    values = dict(zip(form.parameters, fitted.theta.tolist(), strict=True))
    return Problem(form, segments, data_summary_of(form, segments, values), limits)
