"""A run whose clock jumps back is split; effects that learn from residuals learn before and between fits."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gcs_autotune.effects import EFFECTS
from gcs_autotune.errors import BadFile
from gcs_autotune.identify.problems import Problem
from gcs_autotune.identify.problems import problem as problem_module
from gcs_autotune.identify.signals import parts_of
from gcs_autotune.trial import Channel, Mark, Trial


def channel(name: str, *t: float) -> Channel:
    return Channel(name, "1", np.array(t), 10.0 * np.arange(len(t)))


THRICE = (0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.5, 0.0, 1.0, 2.0, 3.0)


def test_each_part_contains_the_samples_between_two_jumps_and_the_active_input() -> None:
    run = Trial(
        "run",
        {
            "psi": channel("psi", *THRICE),
            "N": channel("N", 0.0, 1.0, 2.0, 3.0, 0.5, 1.5, 2.5, 0.0, 1.0, 2.0),
            "u": channel("u", 0.5, 1.5, 2.75, 0.5, 1.5, 2.5, 0.5, 1.5, 2.25),
        },
        (Mark(1.0, "switch"),),
    )
    first, second, third = parts_of(run)
    assert [part.name for part in (first, second, third)] == [f"run (part {k})" for k in (1, 2, 3)]
    assert [part["psi"].t.tolist() for part in (first, second, third)] == [
        [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.5], [0.0, 1.0, 2.0, 3.0],
    ]  # fmt: skip
    assert [part["psi"].values.tolist() for part in (second, third)] == [[40.0, 50.0, 60.0], [70.0, 80.0, 90.0, 100.0]]
    assert first["N"].t.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert (second["N"].t.tolist(), second["N"].values.tolist()) == ([0.0, 0.5, 1.5, 2.5], [30.0, 40.0, 50.0, 60.0])
    assert (third["N"].t.tolist(), third["N"].values.tolist()) == ([0.0, 1.0, 2.0], [70.0, 80.0, 90.0])
    assert second["u"].t.tolist() == [0.5, 1.5, 2.5], "only what is held is known before its first sample"
    assert first.marks == second.marks == ()
    for part in (first, second, third):
        ((slug, cause, _),) = part.meta["notes"]
        assert slug == "clock-jump"
        assert "the clock of run 'run' jumps back 2 times" in cause


def test_a_run_without_a_jump_is_unchanged_and_a_jump_on_one_channel_is_rejected() -> None:
    whole = Trial("run", {"psi": channel("psi", *range(9)), "few": channel("few", 1.0, 0.0)})
    assert parts_of(whole) == [whole]
    empty = Trial("run", {})
    assert parts_of(empty) == [empty]
    odd = Trial("run", {"psi": channel("psi", *range(9)), "r": channel("r", 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0)})
    with pytest.raises(BadFile, match=r"jumps back after t = 3\.000 s \(channel r\), but not equally on every channel"):
        parts_of(odd)


DISTURBANCE = next(slug for slug, effect in EFFECTS.items() if effect.is_disturbance)
CAUSE = next(slug for slug, effect in EFFECTS.items() if not effect.is_disturbance)


@pytest.mark.parametrize(
    ("slug", "options", "lessons"),
    [
        (DISTURBANCE, {"trials": 1}, [0.0]),
        (DISTURBANCE, {}, [0.0, *range(1, problem_module.LESSONS + 1)]),
        (DISTURBANCE, {"learn": False}, []),
        (CAUSE, {}, []),
    ],
)
def test_a_disturbance_learns_before_the_first_fit_and_after_each(
    monkeypatch: pytest.MonkeyPatch, slug: str, options: dict[str, Any], lessons: list[float]
) -> None:
    learnt: list[float] = []

    class Objective:
        def __init__(self, problem: Any, theta: Any, initial: Any, effects: Any, **given: Any) -> None:
            self.effects = effects

        def limits(self) -> tuple[Any, Any]:
            return np.array([-9.0]), np.array([9.0])

        def pack(self) -> Any:
            return np.zeros(1)

        def learn(self, x: Any, floors: Any) -> None:
            assert floors == "floors"
            learnt.append(float(x[0]))

        def concentrated(self, *_: Any, **__: Any) -> None: ...

    moves: list[float] = []

    def descend(cost: Any, x: Any, low: Any, high: Any, **_: Any) -> Any:
        moves.append(float(x[0]))
        return SimpleNamespace(x=x + 1.0, converged=True)

    monkeypatch.setattr(problem_module, "Objective", Objective)
    monkeypatch.setattr(problem_module, "in_order", lambda effects: effects)
    monkeypatch.setattr(problem_module, "descend", descend)
    monkeypatch.setattr(problem_module, "_fitted", lambda problem, objective, x, converged: float(x[0]))
    own: Any = SimpleNamespace(floors="floors")
    own._refit, own._fit = print, partial(Problem._fit, own)
    found = Problem.fit(own, np.zeros(1), [SimpleNamespace(slug=slug)], [], **options)  # type: ignore[list-item]
    assert learnt == lessons
    fits = max(len(lessons), 1)
    assert moves == [float(k) for k in range(fits)]
    assert found == float(fits)
