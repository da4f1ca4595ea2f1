"""The diagnosis asked about a case, and its answer held against the secret."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from benchmarks.blind.case import Case, NoCase, draw_case
from benchmarks.blind.craft import FORCE, SPEED
from gcs_autotune.diagnose import Diagnosis, diagnose
from gcs_autotune.errors import AutotuneError
from gcs_autotune.models.coupled import Form
from sitl.effects import BadEffect

__all__ = ["NEAR", "Outcome", "form_of", "judge", "play"]

NEAR = 3.0
"""Standard errors within which a parameter counts as recovered."""


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

    @property
    def first(self) -> str:
        """What the answer comes to in one word: its first cause, or its verdict."""
        return self.causes[0] if self.causes else self.verdict

    @property
    def strictly_right(self) -> bool:
        """The right name first; nothing when there is nothing; both of two; no confident name for what is foreign."""
        if self.kind == "single":
            return self.causes[:1] == self.truth
        if self.kind == "clean":
            return self.verdict == "no-effect"
        if self.kind == "double":
            return set(self.truth) <= set(self.causes)
        return self.verdict not in ("effect-found", "error")

    @property
    def right(self) -> bool:
        """The same when a name stands for its group of causes these runs cannot tell apart."""
        if self.strictly_right or self.kind in ("clean", "foreign"):
            return self.strictly_right
        named = self.causes[:1] if self.kind == "single" else self.causes
        return all(t in named or any(t in g and set(g) & set(named) for g in self.groups) for t in self.truth)

    def to_json(self) -> str:
        """Return one line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> Outcome:
        """Read :meth:`to_json`."""
        data: dict[str, Any] = json.loads(line)
        return cls(**data)


def play(kind: str, seed: int, index: int, slug: str) -> Outcome:
    """Draw a case, ask, and return the outcome; errors of either are outcomes too."""
    begun = time.perf_counter()
    try:
        case = draw_case(kind, seed, index, slug)
    except (NoCase, BadEffect) as error:
        return Outcome(kind, seed, index, slug, [slug], [], "", 0.0, 0.0, 0.0, "no-case", error=str(error))
    return judge(case, seed, slug, time.perf_counter() - begun)


def judge(case: Case, seed: int, slug: str, drawing: float) -> Outcome:
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
    )
    begun = time.process_time()
    try:
        found = diagnose(list(case.runs), unseen=list(case.unseen), form=form_of(case))
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


def _answer(found: Diagnosis, case: Case) -> dict[str, Any]:
    pulls: dict[str, list[float]] = {}
    for cause in found.causes:
        if cause.applied.slug in case.truth:
            _, true = case.truth[cause.applied.slug]
            pulls.update(_pulls(cause.applied.slug, cause.parameters, true))
    return {
        "verdict": found.verdict,
        "causes": [c.applied.slug for c in found.causes],
        "found_at": [c.applied.place for c in found.causes],
        "groups": [list(g) for g in found.indistinguishable],
        "pulls": pulls,
        "gain": found.gain.ratio if found.gain is not None else float("nan"),
    }


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
