"""Which bandwidths are tried, and which candidate is chosen; the matching itself is replaced."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from gcs_autotune.control import ReferenceModel, settling_time
from gcs_autotune.design import Margins, Prediction, Spec, StepMetrics, selection
from gcs_autotune.design.matching import DesignProblem
from gcs_autotune.design.selection import GainCandidate, choose
from gcs_autotune.errors import NoGainsMeetSpec

FINE = Margins(gain=5.0, phase=1.2, delay=10.0, stable=True)


def problem(
    *,
    spec: Spec | None = None,
    delay: float = 0.0,
    beyond: float = 0.0,
    use: float = 0.1,
    velocity: float = 0.1,
    needs: Callable[[float], float] = lambda omega: omega,
) -> DesignProblem:
    """Return a craft that needs *use* of its actuator and *velocity* per rad/s of the bandwidth; its limit is 1 m/s."""
    law = SimpleNamespace(
        name="heading",
        velocity_limit=lambda settings, speed: 1.0,
        fixed={"FIXED": 3.0},
        free_overshoot=0.0,
        loop_period=lambda settings: 0.02,
    )

    def demand(model: Any, wanted: ReferenceModel) -> tuple[float, float]:
        return use * needs(wanted.omega_0), velocity * needs(wanted.omega_0)

    return cast(
        DesignProblem,
        SimpleNamespace(
            spec=spec or Spec(),
            law=law,
            model=SimpleNamespace(delay=delay, delta=0.3),
            delay=beyond,
            settings={"GAIN": 1.0, "OTHER": 2.0},
            demand=demand,
            present_overshoot=0.0,
        ),
    )


def promise(itae: float, overshoot: float = 0.0) -> Prediction:
    nothing = np.zeros(2)
    return Prediction(nothing, nothing, nothing, nothing, nothing, StepMetrics(itae, overshoot, 1.0, 2.0, 0.0, 0.1))


class Bench:
    """Replaces matching and judging: the k-th bandwidth gets the k-th prediction; keeps the calls."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, promises: Sequence[tuple[float, str]]) -> None:
        self.promises = promises
        self.tried: list[ReferenceModel] = []
        self.starts: list[Any] = []
        self.spans: list[float] = []
        self.low = FINE
        monkeypatch.setattr(selection, "match", self.match)
        monkeypatch.setattr(selection, "judge", self.judge)

    def match(self, given: DesignProblem, wanted: ReferenceModel, start: Any) -> dict[str, float]:
        self.starts.append(start)
        return {"GAIN": 10.0 + len(self.tried)}

    def judge(self, given: DesignProblem, wanted: ReferenceModel, settings: Any, span: float) -> GainCandidate:
        itae, objection = self.promises[min(len(self.tried), len(self.promises) - 1)]
        self.tried.append(wanted)
        self.spans.append(span)
        return GainCandidate(wanted, settings, FINE, self.low, promise(itae), (objection,) * bool(objection))

    def speeds(self) -> list[float]:
        return [w.omega_0 for w in self.tried]


FASTER_IS_WORSE = [(10.0, "")]


@pytest.mark.parametrize(
    ("given", "fastest"),
    [
        (problem(use=0.2, velocity=0.01), 4.0),
        (problem(use=0.01, velocity=0.5), 2.0),
        (problem(use=1e-9, velocity=1e-9), 20.0),
        (problem(use=1e-9, velocity=1e-9, delay=0.25), 4.0),
        (problem(use=1e-9, velocity=1e-9, beyond=0.5), 2.0),
        (problem(use=1e-9, velocity=1e-9, delay=0.3, beyond=0.2), 2.0),
        (problem(use=100.0, velocity=1e-9), 0.008),
    ],
    ids=["actuator", "velocity", "nothing", "own delay", "delay beyond", "both delays", "a weak actuator"],
)
def test_the_first_bandwidth_is_the_fastest_that_actuator_velocity_and_delay_allow(
    given: DesignProblem, fastest: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(monkeypatch, FASTER_IS_WORSE)
    choose(given)
    assert bench.speeds()[0] == pytest.approx(fastest, rel=1e-6)


def test_a_craft_whose_constant_force_needs_the_whole_actuator_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    Bench(monkeypatch, FASTER_IS_WORSE)
    with pytest.raises(NoGainsMeetSpec, match=r"30% of full output.*limit 80%"):
        choose(problem(needs=lambda omega: 8.1))
    with pytest.raises(NoGainsMeetSpec, match="too little"):
        choose(problem(use=0.0, velocity=1.0, needs=lambda omega: 1.1))


def test_bandwidths_fall_by_a_fifth_until_two_are_no_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench(monkeypatch, [(8.0, "too close"), (6.0, ""), (5.5, ""), (5.41, ""), (1.0, "")])
    best = choose(problem())
    assert bench.speeds() == pytest.approx([8.0, 6.4, 5.12, 4.096])
    assert best.wanted.omega_0 == pytest.approx(6.4)
    assert bench.starts[0] is None
    assert [s["GAIN"] for s in bench.starts[1:]] == [10.0, 11.0, 12.0]
    assert best.settings == {"GAIN": 11.0, "OTHER": 2.0, "FIXED": 3.0}
    assert bench.spans == pytest.approx([8.0 * settling_time("bessel", 8.0)] * 4)


def test_a_slower_bandwidth_is_chosen_if_its_step_is_noticeably_better(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, [(6.0, ""), (5.41, ""), (5.39, ""), (5.3, ""), (5.2, "")])
    assert choose(problem()).prediction.metrics.itae == 5.39
    assert len(bench.tried) == 4


def test_a_user_specification_is_the_only_one_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, FASTER_IS_WORSE)
    choose(problem(spec=Spec(omega_0=3.0, step_duration=12.0)))
    choose(problem(spec=Spec(settling_time=4.0)))
    assert bench.speeds()[0] == 3.0
    assert settling_time("bessel", bench.speeds()[1]) == pytest.approx(4.0, rel=1e-3)
    assert bench.spans == pytest.approx([12.0, 32.0], rel=1e-3)


def test_without_a_valid_candidate_the_fastest_safe_one_near_the_best_is_offered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    missed = [(9.0, "slow"), (5.5, "slow"), (5.0, "slow"), *[(7.0, "slow")] * 20]
    bench = Bench(monkeypatch, missed)
    assert choose(problem()).prediction.metrics.itae == 5.5
    assert len(bench.tried) == selection.TRIES
    bench = Bench(monkeypatch, missed)
    bench.low = replace(FINE, gain=1.9)
    with pytest.raises(NoGainsMeetSpec, match=r"The last attempt, settling in .* failed: slow"):
        choose(problem())
    Bench(monkeypatch, missed)
    with pytest.raises(NoGainsMeetSpec, match="heading loop"):
        choose(problem(spec=Spec(omega_0=3.0)))


def test_margins_of_the_craft_and_the_worst_of_the_region_are_both_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [Margins(5.0, 0.9, 0.3, True), Margins(3.0, 1.0, 0.2, True)]
    requested: list[Any] = []
    given = SimpleNamespace(
        spec=Spec(),
        law=SimpleNamespace(free_overshoot=0.07, loop_period=lambda settings: 0.02),
        model="craft",
        region=SimpleNamespace(samples=["sample"]),
        margins=lambda settings, wanted, models: requested.append(models) or found,
        present_overshoot=0.0,
    )
    monkeypatch.setattr(selection, "predict", lambda *given: promise(2.0))
    monkeypatch.setattr(selection, "objections", lambda *given: iter(["a", "b"]))
    candidate = selection.judge(cast(DesignProblem, given), cast(Any, "target"), {"GAIN": 1.0}, 5.0)
    assert requested == [["craft", "sample"]]
    assert (candidate.margins, candidate.worst_margins) == (found[0], Margins(3.0, 0.9, 0.2, True))
    assert candidate.objections == ("a", "b")
    assert candidate.free_overshoot == 0.07


@pytest.mark.parametrize(("noise", "is_said"), [(0.05, False), (0.0501, True)])
def test_noise_that_moves_the_actuator_too_much_is_an_objection(
    noise: float, is_said: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(selection, "output_noise", lambda given, settings: noise)
    found = list(selection.objections(problem(), {}, FINE, promise(1.0, overshoot=0.12)))
    assert bool(found) is is_said
    assert not found or "5.0% rms, which is more than 5%" in found[0]


RESERVES = Spec()


@pytest.mark.parametrize(
    ("low", "overshoot", "words"),
    [
        (Margins(RESERVES.gain_margin, RESERVES.phase_margin, 0.34, True), 0.12, ""),
        (Margins(RESERVES.gain_margin - 0.01, 1.5, 1.0, True), 0.0, "gain margin"),
        (Margins(9.0, RESERVES.phase_margin - 0.01, 1.0, True), 0.0, "phase margin"),
        (Margins(9.0, 1.5, 0.33, True), 0.0, "delay margin 0.33 s is less than the required 0.34 s"),
        (Margins(9.0, 1.5, 1.0, True), 0.121, "predicted overshoot 12% is more than 12%"),
        (Margins(0.1, 0.0, 0.0, False), 0.0, "unstable for part of the 95 % region"),
    ],
)
def test_objections_begin_just_beyond_each_limit(
    monkeypatch: pytest.MonkeyPatch, low: Margins, overshoot: float, words: str
) -> None:
    monkeypatch.setattr(selection, "output_noise", lambda *given: selection.NOISE_LIMIT)
    given = problem(delay=0.3)
    found = list(selection.objections(given, {}, low, promise(1.0, overshoot)))
    assert len(found) == (1 if words else 0)
    assert words in " ".join(found)
