"""The true extension fitted: does the book's effect, at the right place, explain what the simulator's did?

``python3 -m benchmarks.blind.truth [--cases N] [--seed S] [--only SLUG,..]`` draws single cases and fits the base model
with the hidden effect, begun at the true numbers. Where all is well the error over the noise is 1 and the numbers come
back. What is not points at the simulator's effect, at the book's, or at the fit, but not at the reasoning.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from benchmarks.blind.case import Case, NoCase, draw_case
from benchmarks.blind.referee import form_of
from benchmarks.blind.sizes import RECIPES
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
    """Return the base model with the true effect fitted to *case*'s runs, begun at the truth."""
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
    own = _applied(case, summary)
    return problem.fit(theta, (own,), problem.first_states(segments), trials=60), own


def _applied(case: Case, summary: DataSummary) -> EffectInstance:
    """Return the truth as the book writes it: its name for the place, its constants, all its parameters."""
    ((slug, (place, values)),) = case.truth.items()
    entry = EFFECTS[slug]
    places = entry.places(summary)
    everything = {"all": "+".join(summary.form.dofs if slug == "mass-change" else summary.signals)}
    wanted = everything.get(place, place)
    named = [p for p in places if p == wanted] or [p for p in places if set(p.split("+")) == set(wanted.split("+"))]
    if not named:
        raise AutotuneError(f"the book offers {slug} at {', '.join(places) or 'no place'} here, not at {wanted}")
    start = dict(entry.starts(named[0], summary)[0])
    return EffectInstance(
        slug, named[0], {n: values.get(n, v) for n, v in start.items()}, entry.constants(named[0], summary)
    )


def _rms(fitted: Fitted, name: str) -> float:
    """Return what is left of a signal, samples that a disturbance accounts for left out."""
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
        return f"{head}  runs away"
    levels = np.array([_rms(fitted, name) / case.levels[name] for name in fitted.levels])
    now = next(e for e in fitted.effects if e.slug == slug)
    numbers = ", ".join(f"{n} {v:.4g} (true {own.values[n]:.4g})" for n, v in now.values.items())
    flag = "  <-- error" if levels.max() > 1.1 else ""
    return f"{head}  error/noise {levels.min():.2f} to {levels.max():.2f}  {numbers}{flag}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line per case."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.blind.truth", description=__doc__)
    parser.add_argument("--cases", type=int, default=1, help="per effect (1)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="")
    asked = parser.parse_args(arguments)
    lines: list[str] = []
    for slug in RECIPES:
        if asked.only and slug not in asked.only.split(","):
            continue
        for index in range(asked.cases):
            try:
                lines.append(_line(draw_case("single", asked.seed, index, slug)))
                print(lines[-1], flush=True)
            except NoCase as error:
                print(error, flush=True)
    right = sum("error/noise" in line and "<-- error" not in line for line in lines)
    if not asked.only:
        headline(
            "blind.truth", "the true effect fitted to blind cases", [count("error at the noise", right, len(lines))]
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
