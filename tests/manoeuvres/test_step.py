from __future__ import annotations

import math
import re
from collections import deque

import numpy as np
import pytest

from gcs_autotune.craft import DepthTarget, HeadingTarget, TurnRateTarget
from gcs_autotune.manoeuvres import Envelope, Sequencer, Step, StepSettings
from gcs_autotune.observer import SilentObserver

from .toy_craft import PondCraft, at_rest


def fly(step, path, dt=0.1):
    """Feed values of the signal; return the targets commanded."""
    targets = []
    for i, value in enumerate(path):
        seen = at_rest(t=i * dt, psi=value, z=value)
        if i == 0:
            commands = step.commands(seen)
        command = commands.send(None if i == 0 else seen)
        targets.append(command.z if isinstance(command, DepthTarget) else command.psi)
        if step.outcome is not None:
            break
    return targets


def test_a_step_starts_from_a_steady_hold_and_goes_both_ways():
    step = Step(StepSettings("z", 1.0, 5.0))
    targets = fly(step, [2.0] * 400)
    assert targets[0] == 2.0
    assert max(targets) == pytest.approx(3.0)
    assert targets[-1] == pytest.approx(2.0)
    assert step.outcome is not None and step.outcome.ending == "completed"
    assert [m.detail["value"] for m in step.take_marks()] == [2.0, 3.0, 2.0]
    assert step.take_marks() == []


def test_the_wait_for_a_steady_craft_is_limited():
    step = Step(StepSettings("psi", 0.5, 5.0, settle=4.0))
    targets = fly(step, [math.sin(i) for i in range(60)])
    assert targets[45] == pytest.approx(0.5)


def test_a_steady_craft_is_held_for_the_set_time():
    step = Step(StepSettings("z", 1.0, 5.0, hold=12.0))
    fly(step, [2.0] * 400)
    first, second, third = (m.t for m in step.take_marks())
    assert second - first == pytest.approx(12.0, abs=0.11)
    assert third - second == pytest.approx(5.0, abs=0.11)
    assert step.meta_fields["hold"] == 12.0


def test_an_unsteady_craft_is_not_stepped_before_its_hold_is_over_either():
    step = Step(StepSettings("psi", 0.5, 5.0, settle=4.0, hold=8.0))
    targets = fly(step, [math.sin(i) for i in range(90)])
    assert targets[75] == 0.0
    assert targets[85] == pytest.approx(0.5)


def test_the_heading_target_contains_the_speed():
    step = Step(StepSettings("psi", 0.5, 5.0, speed=1.2))
    assert next(step.commands(at_rest())) == HeadingTarget(0.0, 1.2)


def test_a_half_ends_once_the_signal_has_settled_at_its_target():
    step = Step(StepSettings("psi", 0.5, 30.0, enough=5.0))
    targets = []
    seen, commands, psi = 0, None, 0.0
    while step.outcome is None:
        now = at_rest(t=0.1 * seen, psi=psi)
        commands, command = (step.commands(now), None) if commands is None else (commands, now)
        targets.append(commands.send(command).psi)
        psi += 0.1 * (targets[-1] - psi)
        seen += 1
    there, back = step.meta_fields["lasted"]
    assert there == pytest.approx(5.0 + 1.0 * math.log(1.0 / 0.03), abs=0.5)
    assert back == pytest.approx(there, abs=0.2)
    assert step.outcome.ending == "completed"


def test_a_half_that_never_settles_runs_to_its_end():
    step = Step(StepSettings("psi", 0.5, 12.0, enough=5.0))
    fly(step, [0.0] * 31 + [0.5 + 0.05 * math.sin(0.2 * i) for i in range(120)] + [0.02] * 200)
    assert step.meta_fields["lasted"] == [pytest.approx(12.0, abs=0.11), pytest.approx(12.0, abs=0.11)]


def test_one_outlier_does_not_prolong_a_half_and_two_do():
    path = [0.0] * 31 + [0.5] * 20 + [0.7] + [0.5] * 29
    one, two = (Step(StepSettings("psi", 0.5, 30.0, enough=5.0)) for _ in range(2))
    fly(one, [*path, *[0.0] * 300])
    fly(two, [*path[:51], 0.7, 0.7, *path[53:], *[0.5] * 50])
    assert one.meta_fields["lasted"][0] == pytest.approx(5.0, abs=0.21)
    assert two.meta_fields["lasted"][0] == pytest.approx(7.2, abs=0.31)


def test_noise_and_a_coarse_compass_widen_the_settling_band():
    quiet, coarse = (Step(StepSettings("psi", 0.5, 30.0, enough=5.0)) for _ in range(2))
    rough = [0.0, 0.03, -0.03, 0.0, 0.03, 0.0, -0.03, 0.03]
    for step, held in ((quiet, [0.0]), (coarse, rough)):
        fly(step, [*held * 31][:60] + [0.52] * 60)
    assert quiet.meta_fields["band"] == pytest.approx(0.015)
    assert coarse.meta_fields["band"] > 0.03
    assert quiet.meta_fields["lasted"] == [] and coarse.meta_fields["lasted"] != []


def waited(held, output=lambda t: 0.06, size=1.0, seconds=60.0):
    """Return how long [s] a step held and its halves lasted; *held*: depth until the step, by time."""
    step = Step(StepSettings("z", size, 30.0, hold=10.0, enough=6.0, least_hold=3.0, least_enough=3.0))
    rough = 0.003 * np.random.default_rng(4).standard_normal((2, round(10.0 * seconds)))
    commands = None
    for i, (x, y) in enumerate(rough.T):
        t = 0.1 * i
        z = held(t) if i == 0 or step.phase == "settling" else step.target
        now = at_rest(t=t, z=z + x, output={"Z": output(t) + y})
        commands, sent = (step.commands(now), None) if commands is None else (commands, now)
        commands.send(sent)
        if step.outcome is not None:
            break
    first, second, *_ = (m.t for m in step.take_marks())
    return second - first, step.meta_fields["lasted"]


def test_the_wait_for_a_craft_at_rest_is_short():
    hold, lasted = waited(lambda t: 2.0)
    assert 3.0 <= hold <= 4.5
    assert all(3.0 <= seconds <= 4.5 for seconds in lasted)


@pytest.mark.parametrize(
    ("held", "output", "least"),
    [
        (lambda t: 2.0 + 0.006 * t, lambda t: 0.06, 7.5),  # creeps: 1 % of the step in less than 2 s
        (lambda t: 2.0, lambda t: 0.06 + 0.006 * t, 7.5),  # an integral winds
        (lambda t: 2.0 + 0.03 * math.sin(1.5 * t), lambda t: 0.06, 9.4),  # waves
        (lambda t: 2.0, lambda t: 0.06 + 0.03 * math.copysign(1.0, math.sin(3.0 * t)), 9.9),  # hunts in a dead band
        (lambda t: 2.0, lambda t: math.nan, 9.9),  # the output is not reported
    ],
)
def test_the_wait_is_longer_while_signal_or_output_still_change(held, output, least):
    hold, _ = waited(held, output)
    assert least <= hold <= 10.11


def test_every_wait_has_its_full_length_if_early_ends_are_disabled():
    step = Step(StepSettings("z", 1.0, 30.0, hold=10.0, enough=6.0))
    fly(step, [2.0] * 101 + [3.0] * 61 + [2.0] * 70)
    marks = [m.t for m in step.take_marks()]
    assert marks[1] - marks[0] == pytest.approx(10.0, abs=0.11)
    assert step.meta_fields["lasted"] == [pytest.approx(6.0, abs=0.21)] * 2
    assert "least_hold" not in step.meta_fields


def oscillated(amplitude, period=4.2, enough=6.0):
    """Return the step after 60 s of a heading that oscillates about its target by *amplitude* rad."""
    step = Step(StepSettings("psi", 0.5, 30.0, hold=10.0, enough=enough, least_hold=3.0, least_enough=3.0))
    rough = 0.002 * np.random.default_rng(7).standard_normal(900)
    commands = None
    for i, noise in enumerate(rough):
        target = 0.0 if commands is None else step.target
        now = at_rest(t=0.1 * i, psi=target + amplitude * math.sin(math.tau * 0.1 * i / period) + noise)
        commands, sent = (step.commands(now), None) if commands is None else (commands, now)
        commands.send(sent)
        if step.outcome is not None:
            break
    return step, [m.t for m in step.take_marks()]


def test_a_craft_moved_by_waves_has_settled_once_it_oscillates_about_its_target():
    step, (begun, stepped, *_) = oscillated(0.1)
    assert stepped - begun == pytest.approx(10.5, abs=0.6), "it is never steady, and longer waiting changes nothing"
    assert step.meta_fields["band"] == pytest.approx(3.0 * 0.1 / math.sqrt(2.0), rel=0.1)
    assert step.meta_fields["lasted"] == [pytest.approx(6.0, abs=0.3)] * 2


@pytest.mark.parametrize(
    ("amplitude", "period", "enough"),
    [(0.2, 4.2, 6.0), (0.1, 25.0, 6.0), (0.1, 4.2, math.inf)],
    ids=["large", "slow", "no early end"],
)
def test_large_or_slow_oscillations_are_recorded_for_the_full_time(amplitude, period, enough):
    step, (begun, stepped, *_) = oscillated(amplitude, period, enough)
    assert stepped - begun == pytest.approx(20.0, abs=0.11)
    assert step.meta_fields["lasted"] == [pytest.approx(30.0, abs=0.11)] * 2


class Turning(PondCraft):
    """A craft whose rate loop follows at once, over a link that is *late* [s] both ways together."""

    def __init__(self, late: float) -> None:
        super().__init__()
        self.lateness = late
        self._sent = deque([0.0] * round(late / 0.1))

    def send(self, command):
        self.command = command
        self._sent.append(command.r if isinstance(command, TurnRateTarget) else 0.0)

    def _demand(self):
        return 0.0, 0.0, 0.0

    def _advance(self, dt):
        self.r += dt / 0.3 * (self._sent[0] - self.r)
        self.psi += dt * self.r

    def observe(self):
        seen = super().observe()
        if len(self._sent) > 1:
            self._sent.popleft()
        return seen


@pytest.mark.parametrize("late", [0.1, 1.0, 2.0])
@pytest.mark.parametrize("rate", [27.0, 50.0])
def test_a_turn_rate_step_stays_within_the_heading_limit_over_any_link(late, rate):
    size = math.radians(2.0 * rate)
    step = Step(StepSettings("r", size, 6.0, base=-0.5 * size, settle=5.0, steady_time=1.5, hold=5.0, diverged=9.0))
    flown = Sequencer(Turning(late), Envelope(), SilentObserver(), lambda trial: None).fly(step)
    assert flown.ending in ("completed", "stopped")
    assert len([m for m in flown.marks if m.kind == "target"]) == 3
    assert len(flown.meta["lasted"]) == 2
    assert math.degrees(np.abs(flown["psi"].values).max()) < 118.0


def test_part_of_a_turn_rate_step_ends_before_the_limit_and_is_recorded_so():
    size = math.radians(40.0)
    step = Step(StepSettings("r", size, 12.0, base=-0.5 * size, settle=3.0, steady_time=1.5, hold=3.0, diverged=9.0))
    flown = Sequencer(Turning(0.1), Envelope(), SilentObserver(), lambda trial: None).fly(step)
    assert flown.ending == "stopped"
    assert flown.meta["lasted"][0] < 9.0
    assert re.search(r"ended after \d\.\d s: \d+ deg from its start, limit 120 deg \(--max-head", flown.reason)
