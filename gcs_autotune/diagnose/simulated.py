"""Somebody else's simulator: its output modelled, so that it can be compared and extended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs_autotune.diagnose.numbers import Given
from gcs_autotune.diagnose.search import begin_search
from gcs_autotune.errors import UsageError
from gcs_autotune.identify.base_model import fit_base, plain_form
from gcs_autotune.identify.preparation import prepare_as_recorded
from gcs_autotune.identify.result import Doubt
from gcs_autotune.models.coupled import Form
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial

__all__ = ["surrogate_of"]

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
) -> tuple[Given, list[Doubt]]:
    """Return a model that moves as the simulator does with its fit, and what the comparison with the runs says at once.

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
    segments, doubts = prepare_as_recorded(flown, base, use)
    problem, fitted = fit_base(base, segments)
    search = begin_search(problem, fitted, (), effects)
    search.run()
    problem, found = search.problem, search.fitted
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
    return Given(found.model, theirs=(problem, found)), [*_directly(simulations, runs), *doubts]


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
