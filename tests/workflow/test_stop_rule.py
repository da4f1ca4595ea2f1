"""When does a relay end? On craft on paper, and by assessments made up."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from gcs_autotune.clock import ManualClock
from gcs_autotune.control import reference_model
from gcs_autotune.design import ProvisionalGains, Spec
from gcs_autotune.errors import AutotuneError
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.manoeuvres import Relay, RelaySettings
from gcs_autotune.models import SingleDof, simulate
from gcs_autotune.observer import Fact, SilentObserver
from gcs_autotune.trial import Channel, Mark, Trial
from gcs_autotune.workflow import stop_rule
from gcs_autotune.workflow.stop_rule import Assessment, DesignQuestion, KnownDesign, assess

AXIS = FIRMWARE["ardusub"].axes["heading"]
CRAFT = SingleDof("yaw", "1", 0.4, 0.5, 0.0)
STEP = math.radians(30.0)
PRESENT = {g.parameter: 0.5 * (g.low + g.high) for g in AXIS.gains}


def recorded(
    name: str, seconds: float, output: Any, dead: float = 0.0, waves: float = 0.0, seed: int = 1, **meta: Any
) -> Trial:
    """Fly *output* (of the time) on the craft, which does nothing below *dead*, in *waves*; read at 10 Hz."""
    t = np.arange(0.0, seconds, 0.1)
    N = np.array([output(moment) for moment in t])
    acts = np.sign(N) * np.maximum(np.abs(N) - dead, 0.0) + waves * np.sin(1.3 * t)
    motion = simulate(CRAFT, t, acts, t)
    noise = np.random.default_rng(seed).normal(0.0, 0.004, (2, len(t)))
    channels = {
        "N": Channel("N", "1", t, N),
        "psi": Channel("psi", "rad", t, motion.eta + noise[0]),
        "r": Channel("r", "rad/s", t, motion.nu + noise[1]),
    }
    return Trial(name, channels, (), "completed", meta={"signal": "psi", "dof": "yaw", **meta})


def step(**craft: float) -> Trial:
    """A step there and back, as a loop of its own drives the craft: hard first, then to and fro about nothing."""

    def output(t: float) -> float:
        since = t % 12.0
        side = 1.0 if t < 12.0 else -1.0
        return float(side * (0.5 * math.exp(-since) * math.cos(1.5 * since) + 0.05 * math.cos(2.0 * since)))

    return recorded("step-before", 24.0, output, **craft)


def relay_record(seconds: float, half: float = 2.0, **craft: float) -> Trial:
    """A relay with so long a *half* period."""
    trial = recorded("relay-1", seconds, lambda t: 0.4 if int(t / half + 0.5) % 2 == 0 else -0.4, **craft)
    switches = np.arange(0.5 * half, seconds, half)
    return replace(trial, marks=tuple(Mark(float(t), "switch", {"x": 0.0}) for t in switches))


def question(**craft: float) -> DesignQuestion:
    spec = Spec(step=STEP, step_duration=15.0, hold=10.0, noise_std=0.004)
    return DesignQuestion(AXIS, PRESENT, spec, step(**craft))


@pytest.mark.slow
def test_a_step_and_three_reversals_determine_the_gains_of_a_linear_craft() -> None:
    found = assess(question(), relay_record(7.0))
    assert found.lacks == ""
    assert found.gains is not None and found.gains.spread < stop_rule.SPREAD
    assert found.values[:2] == pytest.approx((0.4, 0.5), rel=0.05)


def test_a_dead_zone_explains_the_oscillation_but_not_the_step() -> None:
    found = assess(question(dead=0.1), relay_record(7.0, dead=0.1))
    assert "one model explains" in found.lacks
    assert found.another_size


def test_a_boat_with_an_unexplained_step_needs_five_periods() -> None:
    requested = replace(question(dead=0.1), axis=replace(AXIS, needs_speed=True))
    found = assess(requested, relay_record(7.0, dead=0.1))
    assert found.lacks and not found.another_size


def test_in_waves_the_gains_are_undetermined_and_no_other_size_is_requested() -> None:
    found = assess(question(waves=0.15), relay_record(7.0, waves=0.15, seed=2))
    assert found.lacks and not found.another_size


def test_a_record_too_short_to_be_fitted_is_reported() -> None:
    found = assess(question(), relay_record(1.8, half=0.5))
    assert found.lacks == "18 samples of psi, fewer than 40"
    assert not found.another_size


@pytest.mark.slow
def test_gains_that_remain_uncertain_are_not_determined(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop_rule, "SPREAD", 1e-9)
    assert "the predicted ITAE is uncertain by" in assess(question(), relay_record(7.0)).lacks


def test_gains_that_cannot_be_designed_are_undetermined_and_a_specification_is_refused() -> None:
    requested = question()
    lost = replace(requested, spec=replace(requested.spec, gain_margin=1e9, settling_time=0.1))
    found = assess(lost, relay_record(7.0))
    assert found.lacks.startswith("no gains can be designed yet")
    assert found.refused


GAINS = ProvisionalGains(reference_model("bessel", 1.0), {}, span=15.0, itae=20.0, spread=0.03)
KNOWN = Assessment("", values=(1.0, 2.0), stds=(0.1, 0.1), gains=GAINS)
MOVED = replace(KNOWN, values=(1.0, 2.3))
UNKNOWN = Assessment("too little")
REFUSED = replace(KNOWN, lacks="no gains can be designed yet", refused=True, gains=None)


class Desk:
    """Gives the answers it was given, each after being looked at so many times."""

    def __init__(self, *answers: Assessment | AutotuneError, looks: int = 0) -> None:
        self.answers, self.looks, self.left, self.abandoned = list(answers), looks, 0, 0

    def begin(self, work: Any) -> None:
        self.left = self.looks

    @property
    def done(self) -> bool:
        self.left -= 1
        return self.left < 0

    def result(self) -> Assessment:
        answer = self.answers.pop(0)
        if isinstance(answer, AutotuneError):
            raise answer
        return answer

    def abandon(self) -> None:
        self.abandoned += 1


RELAY = Relay(RelaySettings("psi", "N"))


def ruled(desk: Desk) -> KnownDesign:
    craft: Any = SimpleNamespace(clock=None, recorded_so_far=lambda meta: relay_record(7.0))
    rule = KnownDesign(craft, desk, question())  # type: ignore[arg-type]
    rule.start()
    rule.begin()
    return rule


def ended_after(rule: KnownDesign, reversals: int = 9, ticks: int = 6) -> tuple[int, str]:
    """Tick through half periods of so many *ticks*; return after how many reversals the relay ended, and why."""
    for number in range(reversals):
        for _ in range(ticks):
            why = rule.update(RELAY, number)
            if why:
                return number, why
    return 0, ""


def test_a_relay_ends_once_the_design_was_determined_twice_in_succession() -> None:
    rule = ruled(Desk(UNKNOWN, UNKNOWN, KNOWN, KNOWN, KNOWN))
    number, why = ended_after(rule)
    assert number == 5 and rule.known
    assert (
        why == "the model is accurate enough for the design: its uncertainty changes the predicted ITAE by at most 3%"
    )


def test_the_predicted_cost_is_reported_with_its_worst_case() -> None:
    class Ear(SilentObserver):
        told: ClassVar[list[Fact]] = []

        def note(self, fact: Fact) -> None:
            self.told.append(fact)

    craft: Any = SimpleNamespace(clock=None, recorded_so_far=lambda meta: relay_record(7.0))
    rule = KnownDesign(craft, Desk(UNKNOWN, UNKNOWN, KNOWN, KNOWN), question(), Ear())  # type: ignore[arg-type]
    rule.start()
    rule.begin()
    ended_after(rule)
    assert [(cost.nominal, round(cost.worst, 9)) for cost in Ear.told] == [(20.0, 20.6)] * 2  # type: ignore[union-attr]


def test_the_step_counts_but_a_relay_never_ends_before_three_reversals() -> None:
    assert ended_after(ruled(Desk(*[KNOWN] * 9)))[0] == 3


def test_a_parameter_moved_by_two_standard_errors_is_not_determined() -> None:
    assert ended_after(ruled(Desk(KNOWN, MOVED, MOVED, MOVED)))[0] == 5


def test_a_design_that_is_lost_again_starts_over() -> None:
    assert ended_after(ruled(Desk(KNOWN, UNKNOWN, KNOWN, KNOWN)))[0] == 5


def test_a_specification_refused_twice_by_an_unchanged_model_ends_the_relay() -> None:
    moved = replace(REFUSED, values=(1.0, 2.3))
    rule = ruled(Desk(UNKNOWN, REFUSED, moved, moved, moved))
    number, why = ended_after(rule)
    assert (number, why) == (6, "no gains meet the specification with the present model")
    assert rule.known
    for earlier in (UNKNOWN, REFUSED):
        rule.weigh(earlier)
        assert rule.known is earlier.refused, "a run flown earlier tells as much"


def test_a_request_for_another_size_ends_the_relay_without_gains() -> None:
    rule = ruled(Desk(UNKNOWN, replace(UNKNOWN, another_size=True)))
    number, why = ended_after(rule)
    assert number == 3 and rule.another_size and not rule.known
    assert why.startswith("no model with proportional thrust explains both oscillation and step")


def growing(desk: Desk) -> KnownDesign:
    """A rule whose record grows by ten seconds a snapshot: 10, 20, ... s."""
    lengths = iter(range(10, 1000, 10))
    craft: Any = SimpleNamespace(clock=None, recorded_so_far=lambda meta: relay_record(next(lengths)))
    rule = KnownDesign(craft, desk, question())  # type: ignore[arg-type]
    rule.start()
    rule.begin()
    return rule


ANSWERS = (UNKNOWN, UNKNOWN, KNOWN, KNOWN)
"""Of the step, and of the third to the fifth half period: known at the fifth."""


@pytest.mark.parametrize(("looks", "ends"), [(0, 5), (4, 5), (9, 7), (30, 20)])
def test_a_slow_computer_ends_a_relay_later_with_the_same_half_periods(looks: int, ends: int) -> None:
    rule = growing(Desk(*ANSWERS, looks=looks))
    assert ended_after(rule, reversals=40)[0] == ends
    assert rule.known
    assert rule.counted_to == pytest.approx(relay_record(30).end)


def test_an_assessment_pending_after_five_periods_is_awaited() -> None:
    desk = Desk(*ANSWERS, looks=40)
    rule, run = growing(desk), relay_record(60)
    assert ended_after(rule, reversals=7) == (0, "")
    counted = rule.conclude(run, desk.result)
    assert rule.known and counted.meta["enough"]
    assert counted.end == pytest.approx(relay_record(30).end)
    assert counted.reason.startswith("the model is accurate enough")


def test_a_relay_that_ended_by_itself_counts_whole_without_determined_gains() -> None:
    desk = Desk(*[UNKNOWN] * 9, looks=40)
    rule, run = growing(desk), relay_record(60)
    ended_after(rule, reversals=7)
    assert rule.conclude(run, desk.result) is run
    assert not rule.known


def test_an_assessment_of_a_restarted_oscillation_is_ignored() -> None:
    desk = Desk(KNOWN, replace(UNKNOWN, another_size=True), KNOWN, looks=3)
    rule = ruled(desk)
    assert [rule.update(RELAY, 3) for _ in range(5)] == [""] * 5
    rule.begin()
    assert ended_after(rule)[0] == 3
    assert rule.known and not desk.answers


def test_a_failing_assessment_ends_nothing_and_a_running_one_is_abandoned() -> None:
    desk = Desk(AutotuneError("the computing process ended"), looks=1)
    rule = ruled(desk)
    assert ended_after(rule, reversals=3, ticks=3) == (0, "")
    rule.update(RELAY, 5)
    rule.close()
    rule.close()
    assert desk.abandoned == 1
    assert deepcopy(rule) is rule


def test_in_simulated_time_an_assessment_is_immediate_and_starts_from_the_last_gains(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    requested: list[tuple[int, ProvisionalGains | None]] = []

    def answer(question: DesignQuestion, run: Trial | None, last: ProvisionalGains | None) -> Assessment:
        requested.append((0 if run is None else len(run["psi"]), last))
        return KNOWN

    monkeypatch.setattr(stop_rule, "assess", answer)
    craft: Any = SimpleNamespace(clock=ManualClock(), recorded_so_far=lambda meta: relay_record(7.0))
    rule = KnownDesign(craft, Desk(), question())  # type: ignore[arg-type]
    rule.start()
    rule.begin()
    assert ended_after(rule)[0] == 3
    assert requested == [(0, None), (70, GAINS)]
