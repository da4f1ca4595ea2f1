"""A search is limited by work; one that is stopped reports no cause, lists what was tried and can be resumed."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from open_loop_runs import towed

from gcs_autotune import clock
from gcs_autotune.diagnose import Diagnosis, diagnose, missing_force
from gcs_autotune.diagnose.score import CandidateScore, SearchStep
from gcs_autotune.effects import ExtendedModel, ExtendedSimulator
from gcs_autotune.identify.kalman.filter_bank import FilterBank
from gcs_autotune.kept_results import KeptResults, keeping
from gcs_autotune.models import CoupledModel, Form
from gcs_autotune.report.diagnosis.wording import verdict_of
from gcs_autotune.trial import Trial

SOME = ("quadratic-drag", "dead-zone", "input-bias")


def diagnosed(monkeypatch: pytest.MonkeyPatch, last: str, *, jobs: int = 1) -> Diagnosis:
    """Diagnose a tow with a dead zone, by a clock that leaps to the end as soon as the stage *last* begins."""
    passed = [0.0]

    def watch(stage: str, done: int, total: int) -> None:
        if stage.startswith(last):
            passed[0] = 1e6

    monkeypatch.setattr(clock, "time", SimpleNamespace(monotonic=lambda: time.monotonic() + passed[0]))
    runs = towed(("dead-zone", "N", {"width": 0.2}))
    return diagnose(runs, effects=SOME, jobs=jobs, max_seconds=1e5, progress=watch)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_stopped_search_reports_its_stage_and_what_is_left(monkeypatch: pytest.MonkeyPatch, jobs: int) -> None:
    found = diagnosed(monkeypatch, "cause 1: fitting", jobs=jobs)
    assert (found.verdict, found.causes, found.gain) == ("unfinished", (), None)
    doubt = next(d for d in found.doubts if d.slug == "out-of-time")
    assert "stopped during: cause 1: fitting, 0 of " in doubt.cause
    assert "completed: nothing" in doubt.cause
    assert "model process noise" in doubt.cause.partition("not begun: ")[2]
    assert "--resume" in doubt.cure


def test_a_cause_found_before_a_stop_is_listed_as_tried_but_not_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = diagnosed(monkeypatch, "cause 2")
    assert (found.verdict, found.causes) == ("unfinished", ())
    assert found.extended_model.effects == ()
    assert "dead-zone" in {r.cause for r in found.ranking}
    (doubt,) = (d for d in found.doubts if d.slug == "out-of-time")
    assert "cause 2" in doubt.cause
    assert "dead-zone" in doubt.cause.partition("completed: ")[2]


def test_a_sufficient_time_limit_is_not_mentioned(monkeypatch: pytest.MonkeyPatch) -> None:
    found = diagnosed(monkeypatch, "never")
    assert [c.effect.slug for c in found.causes] == ["dead-zone"]
    assert "out-of-time" not in {d.slug for d in found.doubts}


def answer(found: Diagnosis) -> Any:
    """Return everything in a diagnosis except its duration."""
    result = found.to_dict()
    return {n: v for n, v in result.items() if n != "seconds"}


@pytest.fixture(scope="module")
def whole() -> Diagnosis:
    return diagnose(towed(("dead-zone", "N", {"width": 0.2})), effects=SOME)


@pytest.mark.parametrize("pace", [1e-7, 1e-5, 1e-4, 1e-3])
def test_a_slow_clock_changes_no_cause_and_no_number(
    monkeypatch: pytest.MonkeyPatch, whole: Diagnosis, pace: float
) -> None:
    """Each look at the clock finds it so much later; half a second is given."""
    looks = [0]

    def now() -> float:
        looks[0] += 1
        return pace * looks[0]

    monkeypatch.setattr(clock, "time", SimpleNamespace(monotonic=now))
    found = diagnose(towed(("dead-zone", "N", {"width": 0.2})), effects=SOME, max_seconds=0.5)
    if found.verdict == "unfinished":
        assert found.causes == () and found.wrong_numbers == ()
    else:
        assert answer(found) == answer(whole)
    assert (found.verdict == "unfinished") is (pace > 1e-4)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.8, 0.99])
def test_the_work_limit_stops_at_the_same_point_with_any_number_of_processes(whole: Diagnosis, share: float) -> None:
    runs = towed(("dead-zone", "N", {"width": 0.2}))
    one, two = (diagnose(runs, effects=SOME, jobs=jobs, work=share * whole.work) for jobs in (1, 2))
    assert (one.verdict, one.causes) == ("unfinished", ())
    assert "out-of-work" in {d.slug for d in one.doubts}
    assert answer(one) == answer(two)


def test_a_resumed_search_gives_the_result_of_an_uninterrupted_one(tmp_path: Path, whole: Diagnosis) -> None:
    runs, stops = towed(("dead-zone", "N", {"width": 0.2})), 0
    while True:
        with keeping(KeptResults(tmp_path / "kept", "these runs")):
            found = diagnose(runs, effects=SOME, work=0.4 * whole.work, jobs=1 + stops % 2)
        if found.verdict != "unfinished":
            break
        stops += 1
        assert stops < 6
    assert stops > 1
    assert [c.effect.slug for c in found.causes] == ["dead-zone"]
    assert found.verdict == whole.verdict
    now, then = (d.causes[0].parameters["width"] for d in (found, whole))
    assert (now.value, now.std) == pytest.approx((then.value, then.std), rel=1e-6)
    assert [r.cause for r in found.ranking] == [r.cause for r in whole.ranking]


def test_saved_results_are_not_calculated_again(tmp_path: Path, whole: Diagnosis) -> None:
    runs = towed(("dead-zone", "N", {"width": 0.2}))
    for share in (1.0, 0.3):
        with keeping(KeptResults(tmp_path / "kept", "these runs")):
            found = diagnose(runs, effects=SOME)
        assert found.work <= share * whole.work
        assert found.verdict == whole.verdict


FORM = Form("plain", "yaw", ("yaw",), ("N_rdot", "N_r"), {}, {"N": (("N", 1.0),)}, coriolis=False)

OVERHEAD = 150
"""Passes that a diagnosis of two runs makes however little time it has: a model as it stands, and some starts."""


def passes_of(monkeypatch: pytest.MonkeyPatch, seconds: float, **requested: Any) -> tuple[int, Diagnosis]:
    """Diagnose by a clock on which each pass of a simulation, or of a filter, over a run takes a second."""
    passed = [0]
    for owner in (ExtendedSimulator, FilterBank):
        run = owner.run

        def counted(self: Any, *args: Any, run: Any = run, **named: Any) -> Any:
            passed[0] += 1 if isinstance(self, ExtendedSimulator) else len(self.tracks)
            return run(self, *args, **named)

        monkeypatch.setattr(owner, "run", counted)
    monkeypatch.setattr(clock, "time", SimpleNamespace(monotonic=lambda: float(passed[0])))
    found = diagnose(*requested.pop("runs"), max_seconds=seconds, **requested)
    return passed[0], found


def noisy(seed: int) -> list[Trial]:
    """Return runs of a tow with a drifting force."""
    rng = np.random.default_rng(seed)
    runs = []
    for run in towed(samples=600, full=1.0, seed=seed):
        push = np.cumsum(rng.normal(0.0, 0.03, len(run["psi"].t)))
        psi = replace(run["psi"], values=run["psi"].values + 0.1 * np.cumsum(push - push.mean()) * 0.1)
        runs.append(replace(run, channels={"N": run["N"], "psi": psi}))
    return runs


@pytest.mark.parametrize(
    "seconds", [0.0, 100.0, 1e3, pytest.param(3e3, marks=pytest.mark.slow), pytest.param(1e4, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("requested", ["runs", "process noise", "model", "simulation"])
def test_every_stage_stops_near_the_time_limit(monkeypatch: pytest.MonkeyPatch, requested: str, seconds: float) -> None:
    runs = towed(("dead-zone", "N", {"width": 0.2}), ("quadratic-drag", "yaw", {"coefficient": 1.0}))
    wrong = ExtendedModel(CoupledModel(FORM, {"N_rdot": -3.0, "N_r": -1.0}), ())
    every: dict[str, dict[str, Any]] = {
        "runs": {"runs": (runs,)},
        "process noise": {"runs": (noisy(1),)},
        "model": {"runs": (runs,), "model": wrong},
        "simulation": {"runs": (runs,), "simulations": towed(noise=0.0)},
    }
    passes, found = passes_of(monkeypatch, seconds, **every[requested])
    assert passes <= seconds + OVERHEAD
    assert (found.verdict == "unfinished") is (passes >= seconds)
    if found.verdict == "unfinished":
        assert found.causes == () and found.wrong_numbers == ()
        assert "out-of-time" in {d.slug for d in found.doubts}


def test_a_search_without_time_rules_nothing_out(monkeypatch: pytest.MonkeyPatch) -> None:
    _, found = passes_of(monkeypatch, 0.0, runs=(towed(("dead-zone", "N", {"width": 0.2})),))
    headline = verdict_of(found)
    assert headline.text == "Unfinished: the search reached its time limit and was stopped. Use --resume to continue."
    assert found.left.findings == ("not analysed, because the search was stopped",)
    (doubt,) = (d for d in found.doubts if d.slug == "out-of-time")
    assert doubt.cause.count("not begun") == 1


@pytest.mark.parametrize(
    ("unseen", "holds"),
    [
        ([2.0, 1.5], True),
        ([1.0, 1.5], False),
        ([9.0, -1.0], False),
        ([5.0, 4.0, -0.5], True),
        ([5.0, 1.0, -0.5], False),
        ([20.0, 1.0, -0.5], False),
        ([20.0, 9.0, -0.5, -0.5], False),
        ([0.5, 0.4, 0.3], False),
        ([1.5, 1.4, 1.3], True),
    ],
)
def test_a_cause_holds_if_all_held_out_parts_gain_or_all_but_one_gain_much(unseen: list[float], holds: bool) -> None:
    assert score_of(None, unseen).holds is holds


def score_of(effect: Any, unseen: list[float]) -> CandidateScore[Any]:
    parts = np.array(unseen)
    return CandidateScore(effect, None, 20.0, 5.0, 1, 2.0 * float(parts.sum()), parts=parts, interval=(0.0, math.inf))


def test_rejected_causes_are_reported_with_their_held_out_gain() -> None:
    lag = SimpleNamespace(slug="actuator-lag", place="N")
    drag = SimpleNamespace(slug="quadratic-drag", place="yaw")

    first = SearchStep(None, (score_of(lag, [-3.0, 1.0]), score_of(drag, [-9.0, -2.0])), None)
    delay = SimpleNamespace(slug="input-delay", place="N")
    second = SearchStep(None, (score_of(lag, [6.0, -1.0]), score_of(delay, [0.5, 0.4])), None)
    result = missing_force.words_of(cast(Any, SimpleNamespace(accepted=[], steps=[first, second])), None)
    assert result == (
        "actuator lag (N) improves the log-likelihood of the fitted runs by 20.0 and that of the held-out data by "
        "+5.0, but not of every part of it. It is not reported as a cause",
        "quadratic drag (yaw) improves the log-likelihood of the fitted runs by 20.0, but lowers that of the "
        "held-out runs (-11.0). It is rejected",
        "input delay (N) improves the log-likelihood of the fitted runs by 20.0 and that of the held-out data by "
        "+0.9, which is too little. It is not reported as a cause",
    )
