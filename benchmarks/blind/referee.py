"""The diagnosis asked about a case, and its answer held against the secret."""

from __future__ import annotations

import json
import math
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from benchmarks.blind.case import GIVEN, Case, NoCase, draw_case
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

__all__ = ["LONGEST", "NEAR", "Outcome", "form_of", "given_model", "judge", "play"]

NEAR = 3.0
"""Standard errors within which a parameter counts as recovered."""

DRIFT = "input-bias"
"""Slug of the effect that is the mean drift force of a sea.

A sea for surge contains such a force as well as the waves. Both reported together are therefore right, in either order.
"""

LONGEST = math.inf
"""Seconds after which a diagnosis is stopped, unless asked otherwise: it is limited by its work."""


@dataclass(frozen=True)
class Outcome:
    """What became of a case. ``pulls``: name -> (true, found, standard error) of the rightly named effects."""

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
    numbers: list[str] = field(default_factory=list)
    """Numbers of the given model that are wrong."""
    doubted: list[str] = field(default_factory=list)
    """Those that the diagnosis says are."""
    doubts: list[str] = field(default_factory=list)
    """Names of the doubts the diagnosis has of itself."""
    worth: float = float("nan")
    """Improvement of the log-likelihood by the true effect alone, for cases with process noise."""

    @property
    def first(self) -> str:
        """What the answer comes to in one word: its first cause, or its verdict."""
        return self.causes[0] if self.causes else self.verdict

    @property
    def strictly_right(self) -> bool:
        """The right name first; nothing when there is nothing; both of two; no confident name for what is foreign."""
        if self.kind in GIVEN:
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
        """Exactly the numbers that are wrong; of a simulator the plain model's that they change."""
        if self.kind.endswith("simulation"):
            return set(self.doubted) == {w for n in self.numbers for w in _as_plain(n)}
        return set(self.doubted) == set(self.numbers)

    @property
    def _nothing_else(self) -> bool:
        return self.verdict == ("wrong-numbers" if self.numbers else "no-effect")

    @property
    def right(self) -> bool:
        """The same when a name stands for its group of causes these runs cannot tell apart.

        Of a track that the plain model cannot follow a doubt said aloud is right as well.
        """
        if self.strictly_right or self.kind in ("clean", "clean-track", "foreign"):
            return self.strictly_right
        if self.kind == "track" and self.verdict != "effect-found" and (self.verdict != "no-effect" or self.doubts):
            return self.verdict != "error"
        if self.kind in GIVEN and not (self._numbers_right and self.truth):
            return False
        named = self.causes if self.kind == "double" else self.causes[:1]
        return all(t in named or any(t in g and set(g) & set(named) for g in self.groups) for t in self.truth)

    def to_json(self) -> str:
        """Return one line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> Outcome:
        """Read :meth:`to_json`."""
        data: dict[str, Any] = json.loads(line)
        return cls(**data)


def _as_plain(number: str) -> set[str]:
    """Return what a wrong number changes of the plain model: drag both gain and time constant, inertia the latter."""
    dof = next(d for d, f in FORCE.items() if f == number[0])
    return {f"time constant of {dof}"} | (set() if number.endswith("dot") else {f"gain of {dof}"})


def play(
    kind: str, seed: int, index: int, slug: str, longest: float = LONGEST, among: Sequence[str] | None = None
) -> Outcome:
    """Draw a case, ask, and return the outcome; errors of either are outcomes too.

    longest : seconds after which the diagnosis is stopped. among : the effects it tries, None: all.
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
    """Ask the diagnosis about *case*."""
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
        numbers=list(case.wrong),
    )
    begun = time.process_time()
    try:
        model = None if case.kind not in GIVEN or case.simulations else given_model(case)
        form = form_of(case) if model is None else None
        runs, unseen = list(case.runs), list(case.unseen)
        found = diagnose(
            runs,
            unseen=unseen,
            form=form,
            model=model,
            simulations=case.simulations,
            effects=among,
            max_seconds=longest,
        )
    except AutotuneError as error:
        told = f"{type(error).__name__}: {error}"
    except Exception:  # noqa: BLE001  a crash of the diagnosis is a wrong answer, and the suite goes on
        told = traceback.format_exc()
    else:
        return Outcome(**{**asdict(known), **_answer(found, case), "seconds": time.process_time() - begun})
    return Outcome(**{**asdict(known), "error": told, "seconds": time.process_time() - begun})


def form_of(case: Case) -> Form | None:
    """Return the base model's form when the plain one is not meant: without any drag."""
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
    """Return the model that comes with a case: the true numbers, some of them wrong."""
    form = plain_form(case.runs)
    values = {}
    for dof in case.craft.dofs:
        heavy = case.craft.inertia[dof] if dof in case.craft.drives.values() else 1.0
        values[f"{FORCE[dof]}_{SPEED[dof]}dot"] = -heavy
        values[f"{FORCE[dof]}_{SPEED[dof]}"] = -case.craft.linear[dof] * heavy / case.craft.inertia[dof]
    values = {n: v * case.wrong.get(n, 1.0) for n, v in values.items() if n in form.parameters}
    return ExtendedModel(CoupledModel(form, values))


def _answer(found: Diagnosis, case: Case) -> dict[str, Any]:
    pulls: dict[str, list[float]] = {}
    for cause in found.causes:
        if cause.effect.slug in case.truth:
            _, true = case.truth[cause.effect.slug]
            pulls.update(_pulls(cause.effect.slug, cause.parameters, true))
    for number in found.wrong_numbers:
        if number.name in case.wrong:
            true_one = given_model(case).base[number.name] / case.wrong[number.name]
            pulls[f"number.{number.name}"] = [true_one, number.value, number.std]
    return {
        "verdict": found.verdict,
        "causes": [c.effect.slug for c in found.causes],
        "found_at": [c.effect.place for c in found.causes],
        "groups": [list(g) for g in found.indistinguishable],
        "pulls": pulls,
        "gain": found.gain.ratio if found.gain is not None else float("nan"),
        "doubts": [d.slug for d in found.doubts],
        "doubted": [n.name for n in found.wrong_numbers],
        "worth": _worth(case) if case.kind == "process-noise" else float("nan"),
    }


def _worth(case: Case) -> float:
    """Return what the true effect alone gains under process noise; NaN where nothing is hidden."""
    if not case.truth:
        return float("nan")
    runs = list(case.runs)
    form = plain_form(runs)
    problem, base = fit_base(form, prepare_as_recorded(runs, form)[0])
    found = search_with_process_noise(problem, base, list(case.truth), (), lambda *_: None)
    judged = [] if found is None else [a for step in found.steps for a in step.judged if a.effect.slug in case.truth]
    return max((a.gained for a in judged), default=0.0)


def _pulls(slug: str, found: Mapping[str, Any], true: Mapping[str, float]) -> dict[str, list[float]]:
    """Return (true, found, standard error) of every number the book knows; angles on the near side."""
    pulls = {}
    for name, value in true.items():
        if name in found:
            got = found[name].value
            if name == "direction":
                got = value + float(np.remainder(got - value + np.pi, 2.0 * np.pi) - np.pi)
            pulls[f"{slug}.{name}"] = [value, got, found[name].std]
    return pulls
