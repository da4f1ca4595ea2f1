"""Fit the true effect to blind cases, to compare the effects of the catalogue with those of the simulator.

``python3 -m benchmarks.blind.truth [--cases N] [--seed S] [--only SLUG,..]`` draws single cases and fits the base model
with the hidden effect, starting at the true parameters. An error over the noise of 1 is correct. A larger one is a
fault of the simulator's effect, of the catalogue's or of the fit, but not of the search for causes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from benchmarks.blind.case import Case, NoCase, draw_case
from benchmarks.blind.recipes import RECIPES
from benchmarks.blind.referee import form_of
from benchmarks.results import count, headline
from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance
from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify.problems.base_model import base_limits, data_summary_of, plain_form
from gcs_autotune.identify.problems.fitted import Fitted
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.signals.preparation import prepare_as_recorded
from gcs_autotune.sname import DOFS

__all__ = ["fit_truth", "main"]


def fit_truth(case: Case) -> tuple[Fitted | None, EffectInstance]:
    """Return the base model with the true effect, fitted to the runs of *case* from the true parameters."""
    form = form_of(case) or plain_form(case.runs)
    segments, _ = prepare_as_recorded(case.runs, form)
    values = {}
    for dof in form.dofs:
        force, speed = DOFS[dof].force, DOFS[dof].velocity
        values[f"{force}_{speed}dot"] = -case.craft.inertia[dof]
        values[f"{force}_{speed}"] = -case.craft.linear[dof]
    theta = np.array([values[n] if n in form.free else form.known[n] for n in form.parameters])
    known = dict(zip(form.parameters, theta.tolist(), strict=True))
    if "Y_v" in form.free and "Y_vdot" in form.known:
        theta[form.parameters.index("Y_v")] /= case.craft.inertia["sway"]
    summary = data_summary_of(form, segments, known)
    problem = Problem(form, segments, summary, base_limits(form))
    own = _true_effect(case, summary)
    return problem.fit(theta, (own,), problem.first_states(segments), trials=60), own


def _true_effect(case: Case, summary: DataSummary) -> EffectInstance:
    """Return the true effect as an instance of the catalogue, with its place, constants and all parameters."""
    ((slug, (place, values)),) = case.truth.items()
    entry = EFFECTS[slug]
    places = entry.places(summary)
    everything = {"all": "+".join(summary.form.dofs if slug == "mass-change" else summary.signals)}
    required = everything.get(place, place)
    matching = [p for p in places if p == required] or [
        p for p in places if set(p.split("+")) == set(required.split("+"))
    ]
    if not matching:
        raise AutotuneError(f"{slug} is available at {', '.join(places) or 'no place'}, not at {required}")
    start = dict(entry.starts(matching[0], summary)[0])
    return EffectInstance(
        slug, matching[0], {n: values.get(n, v) for n, v in start.items()}, entry.constants(matching[0], summary)
    )


def _rms(fitted: Fitted, name: str) -> float:
    """Return the rms residual of a signal."""
    left = np.concatenate([r.judged for r in fitted.rests if r.signal == name])
    return float(np.sqrt(np.nanmean(left**2)))


def _line(case: Case) -> str:
    slug = case.slugs[0]
    head = f"{slug:24} {case.index:3d} {case.craft.kind:8} T={case.craft.pace:6.2f} x{case.ratio:5.1f}"
    try:
        fitted, own = fit_truth(case)
    except AutotuneError as error:
        return f"{head}  {error}"
    if fitted is None:
        return f"{head}  diverged"
    levels = np.array([_rms(fitted, name) / case.levels[name] for name in fitted.levels])
    now = next(e for e in fitted.effects if e.slug == slug)
    numbers = ", ".join(f"{n} {v:.4g} (true {own.values[n]:.4g})" for n, v in now.values.items())
    flag = "  <-- error" if levels.max() > 1.1 else ""
    return f"{head}  error/noise {levels.min():.2f} to {levels.max():.2f}  {numbers}{flag}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line per case, and return 0."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.blind.truth", description=__doc__)
    parser.add_argument("--cases", type=int, default=1, help="cases of each effect (1)")
    parser.add_argument("--seed", type=int, default=1, help="seed of all random numbers (1)")
    parser.add_argument("--only", default="", help="only these effects; slugs, separated by commas")
    options = parser.parse_args(arguments)
    lines: list[str] = []
    for slug in RECIPES:
        if options.only and slug not in options.only.split(","):
            continue
        for index in range(options.cases):
            try:
                lines.append(_line(draw_case("single", options.seed, index, slug)))
                print(lines[-1], flush=True)
            except NoCase as error:
                print(error, flush=True)
    right = sum("error/noise" in line and "<-- error" not in line for line in lines)
    if not options.only:
        headline(
            "blind.truth", "the true effect fitted to blind cases", [count("error at the noise", right, len(lines))]
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
