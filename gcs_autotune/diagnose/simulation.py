"""Somebody else's simulator: its output modelled, so that it can be compared and extended.

Of it nothing is known but what it does: the plain model is fitted to it and to the runs alike, and its gain, time
constant, delay and trim are compared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.adequacy import correlation_of
from gcs_autotune.diagnose.state import ModelInQuestion, Progress, Question, begin
from gcs_autotune.diagnose.strategies import SEARCH, follow
from gcs_autotune.effects import DataSummary, EffectInstance
from gcs_autotune.errors import UsageError
from gcs_autotune.identify import Doubt, Fitted, Problem, plain_form, prepare_as_recorded
from gcs_autotune.models import CoupledModel, Form
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Trial

__all__ = ["PLAIN", "plain_numbers", "surrogate_of"]

Array = NDArray[np.float64]

FAITHFUL = 0.05
"""Error of the stand-in for a simulator, in shares of the motion, above which it is doubted."""


def surrogate_of(
    simulations: Sequence[Trial],
    runs: Sequence[Trial],
    *,
    dof: str | None,
    use: Sequence[str] | None,
    form: Form | None,
    effects: Sequence[str],
    progress: Progress | None = None,
    jobs: int = 1,
) -> tuple[ModelInQuestion, list[Doubt]]:
    """Return a model that moves as the simulator does with its fit, and what the comparison with the runs says at once.

    simulations : one per run, in the same order; inputs they lack are taken from the run. Within a :func:`.time_limit`
    a doubt says what of it was not looked at.

    Raises
    ------
    UsageError
        Not one simulation per run.
    """
    if len(simulations) != len(runs):
        raise UsageError(
            f"{len(runs)} run(s) but {len(simulations)} simulation(s): give one per run, in the same order"
        )
    flown = [_driven(s, r) for s, r in zip(simulations, runs, strict=True)]
    base = form if form is not None else plain_form(flown, dof)
    segments, doubts = prepare_as_recorded(flown, base, use)

    def told(stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(f"the simulation: {stage}", done, total)

    state = follow(begin(Question(base, segments, effects, progress=told, jobs=jobs)), SEARCH)
    problem, found = state.problem, state.fitted
    if state.cut:
        doubts.append(
            Doubt(
                "simulation-out-of-time",
                "the simulation was not understood to the end in its share of the time: " + "; ".join(state.cut),
                "give it longer (--max-seconds), or its equations as a model file (--model)",
            )
        )
    for name, level in found.levels.items():
        spread = problem.data_summary.spread[name]
        if level > FAITHFUL * spread:
            doubts.append(
                Doubt(
                    "simulation-not-understood",
                    f"the model of the simulator misses its own {name} by {100 * level / spread:.0f} % of the motion",
                    "give its equations as a model file (--model) instead of its output",
                )
            )
    return ModelInQuestion(found.model, theirs=(problem, found)), [*_directly(simulations, runs), *doubts]


def _driven(simulation: Trial, run: Trial) -> Trial:
    """Return a simulation with the inputs of its run where it has none of its own."""
    inputs = {n: c for n, c in run.channels.items() if n not in SIGNALS or n in ("X", "Y", "Z", "K", "M", "N", "delta")}
    return replace(simulation, channels={**inputs, **simulation.channels})


def _directly(simulations: Sequence[Trial], runs: Sequence[Trial]) -> list[Doubt]:
    """Return by how much the simulation, as it stands, misses each signal in the run where it misses it most."""
    worst: dict[str, float] = {}
    for simulation, run in zip(simulations, runs, strict=True):
        for name in ("psi", "r", "u", "v", "w", "x", "y", "z"):
            if name not in simulation or name not in run:
                continue
            theirs, ours = simulation[name], run[name]
            inside = (ours.t >= theirs.t[0]) & (ours.t <= theirs.t[-1])
            if inside.sum() < 2:
                continue
            error = ours.values[inside] - np.interp(ours.t[inside], theirs.t, theirs.values)
            if name == "psi":
                error = np.mod(error + np.pi, 2.0 * np.pi) - np.pi
            worst[name] = max(worst.get(name, 0.0), float(np.sqrt(np.mean(error**2))))
    if not worst:
        return []
    told = ", ".join(f"{n} by {rms:.3g} {SIGNALS[n][0]}" for n, rms in worst.items())
    return [
        Doubt(
            "simulation-off",
            f"errors are those of a model fitted to the simulation; as it stands it misses {told} (rms, its worst run)",
            "give its equations as a model file (--model), or begin its runs where the craft was",
        )
    ]


# -- what the plain model says of both


PLAIN: Mapping[str, str] = {
    "gain": "speed held per unit of command",
    "time constant": "time to 63 % of it after a step",
    "delay": "from command to action",
    "trim": "command that holds it still",
}
"""Numbers of the plain model, and what they mean."""

_START = 0.3
"""Delay to begin from, in shares of the craft's time constant."""


def plain_numbers(problem: Problem, fitted: Fitted) -> dict[tuple[str, str], tuple[str, tuple[float, float]]]:
    """Return (kind, where) -> unit, (value, standard error) of the plain model with delay and trim, beside effects."""
    form = fitted.form
    driven = {d: _drive(form, d) for d in form.dofs}
    driven = {d: drive for d, drive in driven.items() if drive is not None and _damps(form, d) in form.parameters}
    trims = [f"{DOFS[d].force}_0" for d in driven if f"{DOFS[d].force}_0" not in form.parameters]
    wide = form.freeing(*trims)
    values = dict(zip(form.parameters, fitted.theta.tolist(), strict=True))
    theta = np.array([values.get(n, 0.0) for n in wide.parameters])
    late = {e.place for e in fitted.effects if e.slug == "input-delay"}
    lacking = [c for c in dict.fromkeys(drive[0] for drive in driven.values() if drive) if c not in late]
    more = Problem(wide, problem.segments, problem.data_summary, problem.limits, (*problem.free, *trims))
    best: Fitted | None = None
    for share in (0.0, _START):
        delays = [
            EffectInstance("input-delay", c, {"delay": share * problem.data_summary.time_constant}) for c in lacking
        ]
        fit = more.fit(theta, (*fitted.effects, *delays), fitted.initial, shift=fitted.shift)
        best = fit if fit is not None and (best is None or fit.cost < best.cost) else best
        if not lacking:
            break
    if best is None:
        return {}
    return _read(more.data_summary, best, {d: drive for d, drive in driven.items() if drive is not None})


def _drive(form: Form, dof: str) -> tuple[str, float | str] | None:
    force = DOFS[dof].force
    return next(((c, g) for c, pairs in form.inputs.items() for f, g in pairs if f == force), None)


def _damps(form: Form, dof: str) -> str:
    return f"{DOFS[dof].force}_{DOFS[dof].velocity}"


def _read(
    data_summary: DataSummary, fit: Fitted, driven: Mapping[str, tuple[str, float | str]]
) -> dict[tuple[str, str], tuple[str, tuple[float, float]]]:
    covariance = fit.covariance(correlation_of(fit))
    names = fit.form.parameters
    places = [names.index(n) for n in fit.free]

    def uncertain(of: Callable[[Array], float]) -> tuple[float, float]:
        value, slope = of(fit.theta), np.zeros(len(places))
        for k, i in enumerate(places):
            h = 1e-6 * max(abs(float(fit.theta[i])), 1e-6)
            moved = fit.theta.copy()
            moved[i] += h
            slope[k] = (of(moved) - value) / h
        variance = float(slope @ covariance[: len(places), : len(places)] @ slope)
        return value, math.sqrt(max(variance, 0.0))

    found: dict[tuple[str, str], tuple[str, tuple[float, float]]] = {}
    for dof, (channel, gain) in driven.items():
        axis, unit = DOFS[dof], data_summary.inputs.get(channel, "1")
        force, damps = f"{axis.force}_0", f"{axis.force}_{axis.velocity}"
        rate = "rad/s" if axis.angular else "m/s"

        def at(theta: Array, name: str) -> float:
            return float(theta[names.index(name)])

        def share(theta: Array, gain: float | str = gain) -> float:
            if isinstance(gain, str):
                return math.copysign(at(theta, gain.lstrip("-")), -1.0 if gain.startswith("-") else 1.0)
            return float(gain)

        def mass(theta: Array, dof: str = dof) -> float:
            model = CoupledModel(fit.form, dict(zip(names, theta.tolist(), strict=True)))
            i = fit.form.dofs.index(dof)
            return float(model.inertia[i, i])

        per = rate if unit == "1" else f"{rate}/({unit})"
        found["gain", dof] = per, uncertain(lambda t, d=damps, s=share: s(t) / -at(t, d))  # type: ignore[misc]
        found["time constant", dof] = "s", uncertain(lambda t, d=damps, m=mass: m(t) / -at(t, d))  # type: ignore[misc]
        found["trim", channel] = unit, uncertain(lambda t, f=force, s=share: -at(t, f) / s(t))  # type: ignore[misc]
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    for k, (i, name) in enumerate(fit.free_effects):
        own = fit.effects[i]
        if own.slug == "input-delay":
            found["delay", own.place] = "s", (own.values[name], float(std[len(fit.free) + k]))
    order = list(PLAIN)
    return dict(sorted(found.items(), key=lambda item: order.index(item[0][0])))
