"""Run the diagnosis on a case, and compare its result with the hidden effects."""

from __future__ import annotations

import json
import math
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from benchmarks.blind.case import WITH_MODEL, Case, NoCase, draw_case
from benchmarks.blind.craft import FORCE, SPEED
from gcs_autotune.diagnose import Diagnosis, diagnose
from gcs_autotune.diagnose.process_noise import search_with_process_noise
from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify.problems import fit_base
from gcs_autotune.identify.problems.base_model import plain_form
from gcs_autotune.identify.signals import prepare_as_recorded
from gcs_autotune.models.coupled import CoupledModel, Form
from sitl.effects import BadEffect

__all__ = ["LONGEST", "NEAR", "Outcome", "form_of", "given_model", "judge", "run_case"]

NEAR = 3.0
"""Standard errors within which a parameter counts as recovered."""

DRIFT = "input-bias"
"""Slug of the effect that is the mean drift force of a sea.

In surge a sea has this force and waves. Reporting both is therefore right, in either order.
"""

LONGEST = math.inf
"""Default time limit of a diagnosis [s]: none. The diagnosis limits its own work."""


@dataclass(frozen=True)
class Outcome:
    """Result of a case. ``pulls``: parameter -> (true value, estimate, standard error) of the effects found."""

    kind: str
    seed: int
    index: int
    slug: str
    truth: list[str]
    places: list[str]
    craft: str
    pace: float
    ratio: float
    noise: float
    verdict: str
    causes: list[str] = field(default_factory=list)
    found_at: list[str] = field(default_factory=list)
    groups: list[list[str]] = field(default_factory=list)
    pulls: dict[str, list[float]] = field(default_factory=dict)
    gain: float = float("nan")
    seconds: float = 0.0
    drawing: float = 0.0
    error: str = ""
    wrong_numbers: list[str] = field(default_factory=list)
    """Parameters of the supplied model that are wrong."""
    reported_numbers: list[str] = field(default_factory=list)
    """Parameters that the diagnosis reports as wrong."""
    doubts: list[str] = field(default_factory=list)
    """Slugs of the doubts that the diagnosis reports."""
    improvement: float = float("nan")
    """Improvement of the log-likelihood by the true effect alone, for cases with process noise."""

    @property
    def first(self) -> str:
        """The first cause, or the verdict if there is none."""
        return self.causes[0] if self.causes else self.verdict

    @property
    def strictly_right(self) -> bool:
        """The true cause is first; both of two are reported; no cause without an effect or for a foreign one."""
        if self.kind in WITH_MODEL:
            return self._numbers_right and (self.causes[:1] == self.truth if self.truth else self._nothing_else)
        if self.slug == "sea" and self.places == ["surge"]:
            both = [(slug, "surge") for slug in sorted([DRIFT, *self.truth])]
            if sorted(zip(self.causes, self.found_at, strict=True)) == both:
                return True
        if self.kind in ("single", "environment", "track"):
            return self.causes[:1] == self.truth
        if self.kind in ("clean", "clean-track"):
            return self.verdict == "no-effect"
        if self.kind == "process-noise":
            return self.causes[:1] == self.truth[:1]
        if self.kind == "double":
            return set(self.truth) <= set(self.causes)
        return self.verdict not in ("effect-found", "error")

    @property
    def _numbers_right(self) -> bool:
        """Exactly the wrong parameters; for a simulator, those of the plain model that they change."""
        if self.kind.endswith("simulation"):
            return set(self.reported_numbers) == {w for n in self.wrong_numbers for w in _as_plain(n)}
        return set(self.reported_numbers) == set(self.wrong_numbers)

    @property
    def _nothing_else(self) -> bool:
        return self.verdict == ("wrong-numbers" if self.wrong_numbers else "no-effect")

    @property
    def right(self) -> bool:
        """The same, but a cause counts as every cause that the runs cannot distinguish from it.

        For a track that the plain model does not fit, a reported doubt is also right.
        """
        if self.strictly_right or self.kind in ("clean", "clean-track", "foreign"):
            return self.strictly_right
        if self.kind == "track" and self.verdict != "effect-found" and (self.verdict != "no-effect" or self.doubts):
            return self.verdict != "error"
        if self.kind in WITH_MODEL and not (self._numbers_right and self.truth):
            return False
        causes = self.causes if self.kind == "double" else self.causes[:1]
        return all(t in causes or any(t in g and set(g) & set(causes) for g in self.groups) for t in self.truth)

    def to_json(self) -> str:
        """Return one line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> Outcome:
        """Read :meth:`to_json`."""
        data: dict[str, Any] = json.loads(line)
        return cls(**data)


def _as_plain(number: str) -> set[str]:
    """Return the parameters of the plain model that a wrong parameter changes."""
    dof = next(d for d, f in FORCE.items() if f == number[0])
    return {f"time constant of {dof}"} | (set() if number.endswith("dot") else {f"gain of {dof}"})


def run_case(
    kind: str, seed: int, index: int, slug: str, longest: float = LONGEST, among: Sequence[str] | None = None
) -> Outcome:
    """Draw a case, diagnose it, and return the outcome; an error of either is an outcome too.

    longest : time limit of the diagnosis [s]. among : the effects it tries; None: all.
    """
    begun = time.perf_counter()
    try:
        case = draw_case(kind, seed, index, slug)
    except (NoCase, BadEffect) as error:
        return Outcome(kind, seed, index, slug, [slug], [], "", 0.0, 0.0, 0.0, "no-case", error=str(error))
    return judge(case, seed, slug, time.perf_counter() - begun, longest, among)


def judge(
    case: Case, seed: int, slug: str, drawing: float, longest: float = LONGEST, among: Sequence[str] | None = None
) -> Outcome:
    """Return the outcome of the diagnosis of *case*."""
    known = Outcome(
        kind=case.kind,
        seed=seed,
        index=case.index,
        slug=slug,
        truth=list(case.slugs),
        places=[place for place, _ in case.truth.values()],
        craft=case.craft.kind,
        pace=case.craft.pace,
        ratio=case.ratio,
        noise=case.noise,
        verdict="error",
        drawing=drawing,
        wrong_numbers=list(case.wrong),
    )
    begun = time.process_time()
    try:
        model = None if case.kind not in WITH_MODEL or case.simulations else given_model(case)
        form = form_of(case) if model is None else None
        runs, unseen = list(case.runs), list(case.unseen)
        diagnosis = diagnose(
            runs,
            unseen=unseen,
            form=form,
            model=model,
            simulations=case.simulations,
            effects=among,
            max_seconds=longest,
        )
    except AutotuneError as error:
        message = f"{type(error).__name__}: {error}"
    except Exception:  # noqa: BLE001  a crash of the diagnosis counts as wrong
        message = traceback.format_exc()
    else:
        return Outcome(**{**asdict(known), **_result(diagnosis, case), "seconds": time.process_time() - begun})
    return Outcome(**{**asdict(known), "error": message, "seconds": time.process_time() - begun})


def form_of(case: Case) -> Form | None:
    """Return the form of the base model if it is not the plain one: without drag."""
    if case.plain != "none":
        return None
    dof = case.craft.main
    force = FORCE[dof]
    channel = case.craft.input
    return Form(
        "plain", f"{dof} without drag", (dof,), (f"{force}_{SPEED[dof]}dot",), {}, {channel: ((force, 1.0),)},
        coriolis=False,
    )  # fmt: skip


def given_model(case: Case) -> ExtendedModel:
    """Return the supplied model of a case: the true parameters, some of them multiplied by a factor."""
    form = plain_form(case.runs)
    values = {}
    for dof in case.craft.dofs:
        inertia = case.craft.inertia[dof] if dof in case.craft.drives.values() else 1.0
        values[f"{FORCE[dof]}_{SPEED[dof]}dot"] = -inertia
        values[f"{FORCE[dof]}_{SPEED[dof]}"] = -case.craft.linear[dof] * inertia / case.craft.inertia[dof]
    values = {n: v * case.wrong.get(n, 1.0) for n, v in values.items() if n in form.parameters}
    return ExtendedModel(CoupledModel(form, values))


def _result(diagnosis: Diagnosis, case: Case) -> dict[str, Any]:
    pulls: dict[str, list[float]] = {}
    for cause in diagnosis.causes:
        if cause.effect.slug in case.truth:
            _, true = case.truth[cause.effect.slug]
            pulls.update(_pulls(cause.effect.slug, cause.parameters, true))
    for number in diagnosis.wrong_numbers:
        if number.name in case.wrong:
            true_value = given_model(case).base[number.name] / case.wrong[number.name]
            pulls[f"number.{number.name}"] = [true_value, number.value, number.std]
    return {
        "verdict": diagnosis.verdict,
        "causes": [c.effect.slug for c in diagnosis.causes],
        "found_at": [c.effect.place for c in diagnosis.causes],
        "groups": [list(g) for g in diagnosis.indistinguishable],
        "pulls": pulls,
        "gain": diagnosis.gain.ratio if diagnosis.gain is not None else float("nan"),
        "doubts": [d.slug for d in diagnosis.doubts],
        "reported_numbers": [n.name for n in diagnosis.wrong_numbers],
        "improvement": _improvement(case) if case.kind == "process-noise" else float("nan"),
    }


def _improvement(case: Case) -> float:
    """Return the improvement by the true effect alone, with process noise modelled; NaN without a hidden effect."""
    if not case.truth:
        return float("nan")
    runs = list(case.runs)
    form = plain_form(runs)
    problem, base = fit_base(form, prepare_as_recorded(runs, form)[0])
    search = search_with_process_noise(problem, base, list(case.truth), (), lambda *_: None)
    judged = [] if search is None else [a for step in search.steps for a in step.judged if a.effect.slug in case.truth]
    return max((a.gained for a in judged), default=0.0)


def _pulls(slug: str, estimates: Mapping[str, Any], true: Mapping[str, float]) -> dict[str, list[float]]:
    """Return (true value, estimate, standard error) of every parameter; angles on the nearest turn."""
    pulls = {}
    for name, value in true.items():
        if name in estimates:
            estimate = estimates[name].value
            if name == "direction":
                estimate = value + float(np.remainder(estimate - value + np.pi, 2.0 * np.pi) - np.pi)
            pulls[f"{slug}.{name}"] = [value, estimate, estimates[name].std]
    return pulls
