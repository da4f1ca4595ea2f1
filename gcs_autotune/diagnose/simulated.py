"""Somebody else's simulator: its output modelled, so that it can be extended; and numbers that are merely off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs_autotune.diagnose.search import Search, begin_search
from gcs_autotune.diagnose.whiteness import correlation_of
from gcs_autotune.effects.extended import ExtendedModel
from gcs_autotune.errors import UsageError
from gcs_autotune.identify.extended.base import fit_base
from gcs_autotune.identify.extended.stretches import plain_form, stretches_of
from gcs_autotune.identify.extended.wish import label_of
from gcs_autotune.identify.result import Doubt
from gcs_autotune.models.coupled import Form
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial

__all__ = ["parameters_off", "surrogate_of"]

FAITHFUL = 0.05
"""Error of the stand-in for a simulator, in shares of the motion, above which it is doubted."""

OFF, SURE = 0.05, 3.0
"""A parameter is off when it differs by this share and by so many standard errors."""


def surrogate_of(
    simulations: Sequence[Trial],
    runs: Sequence[Trial],
    *,
    dof: str | None,
    use: Sequence[str] | None,
    form: Form | None,
    effects: Sequence[str],
) -> tuple[ExtendedModel, list[Doubt]]:
    """Return a model that moves as the simulator does, and what the comparison with the runs says at once.

    simulations : one per run, in the same order; inputs they lack are taken from the run.

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
    stretches, doubts = stretches_of(flown, base, use)
    problem, fitted = fit_base(base, stretches)
    search = begin_search(problem, fitted, (), effects)
    search.run()
    found = search.fitted
    for name, level in found.levels.items():
        spread = problem.scene.spread[name]
        if level > FAITHFUL * spread:
            doubts.append(
                Doubt(
                    "simulation-not-understood",
                    f"the model of the simulator misses its own {name} by {100 * level / spread:.0f} % of the motion",
                    "give its equations as a model file (--model) instead of its output",
                )
            )
    return found.model, [*_directly(simulations, runs), *doubts]


def _driven(simulation: Trial, run: Trial) -> Trial:
    """Return a simulation with the inputs of its run where it has none of its own."""
    inputs = {n: c for n, c in run.channels.items() if n not in SIGNALS or n in ("X", "Y", "Z", "K", "M", "N", "delta")}
    return replace(simulation, channels={**inputs, **simulation.channels})


def _directly(simulations: Sequence[Trial], runs: Sequence[Trial]) -> list[Doubt]:
    found = []
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
            rms, unit = float(np.sqrt(np.mean(error**2))), SIGNALS[name][0]
            found.append(
                Doubt(
                    "simulation-off",
                    f"as it stands the simulation misses {name} of run '{run.name}' by {rms:.3g} {unit} rms",
                    "see the causes found; errors below are those of a model fitted to the simulation",
                )
            )
    return found


def parameters_off(search: Search) -> list[Doubt]:
    """Return which numbers of a given model the runs contradict, when the structure itself is given the benefit."""
    if search.given is None:
        return []
    before, after = search.given, search.fitted
    std = np.sqrt(np.maximum(np.diag(after.covariance(correlation_of(after))), 0.0))
    told = [(n, before.theta[after.form.parameters.index(n)]) for n in after.free]
    known = {(e.slug, e.place): e.values for e in before.effects}
    for i, name in after.free_effects:
        own = after.effects[i]
        told.append((label_of(own, name), known.get((own.slug, own.place), own.values)[name]))
    found = []
    for (name, old), new, sure in zip(told, after.shared.tolist(), std.tolist(), strict=False):
        if abs(new - float(old)) > max(OFF * abs(float(old)), SURE * sure):
            found.append(
                Doubt(
                    "parameter-off",
                    f"the model has {name} = {float(old):.4g}, these runs say {new:.4g} +- {sure:.2g}",
                    "use the extended model's number",
                )
            )
    return found
