"""The pulse ahead before throttle is stepped, on a scripted craft: what counts as a response, and every rejection."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from gcs_autotune.craft import Observation
from gcs_autotune.manoeuvres import Outlet, ThrustCheck, ThrustCheckSettings
from gcs_autotune.manoeuvres.sign_check import NOISES
from gcs_autotune.manoeuvres.thrust_check import LONGEST_REST, SHORTEST, UNKNOWN

from .toy_craft import answered, at_rest


class Pushed:
    """A craft that gains *push* [m/s^2] at full output and starts at *way* [m/s]; 10 s at rest are enough."""

    def __init__(self, push: float, *, way: float = 0.0, noise: float = 0.0, shown: Callable[[float], float] = float):
        self.push, self.way, self.shown, self.u, self.t = push, way, shown, 0.0, 0.0
        self.rng, self.noise = np.random.default_rng(1), noise

    def __call__(self, t: float, command) -> Observation:
        self.u += self.push * command.X * (t - self.t)
        self.t = t
        u = self.way + self.u + self.noise * float(self.rng.normal())
        return at_rest(t=t, u=u, speed=abs(u), output={"X": self.shown(command.X)})


def fly(craft, **changes) -> tuple[ThrustCheck, list]:
    check = ThrustCheck(ThrustCheckSettings(**{"outputs": (0.25, 0.5), **changes}))
    return check, answered(check, craft, tick=0.1)


@pytest.mark.parametrize("way", [0.0, 0.4, -0.4])
def test_a_craft_that_gains_speed_passes_on_the_first_pulse_at_any_initial_speed(way: float) -> None:
    check, rows = fly(Pushed(1.0, way=way))
    assert check.outcome is not None
    assert check.outcome.ending == "completed"
    assert check.outcome.reason.endswith("X acts in the right direction")
    assert [m.detail["X"] for m in check.take_marks()] == [0.25]
    assert check.answer is not None
    assert check.answer.moved == pytest.approx(0.3, abs=0.1)
    assert check.answer.obeyed == pytest.approx(1.0, abs=0.05)
    assert check.answer.seconds >= SHORTEST
    assert rows[-1][1].X == 0.0, "it lets go with its last command"
    assert check.settings["speed"] == pytest.approx(way)
    assert check.settings["gained"] == check.answer.moved


def test_an_inconclusive_small_pulse_is_followed_by_a_larger_one_after_a_rest() -> None:
    check, rows = fly(Pushed(0.02))
    assert [m.detail["X"] for m in check.take_marks()] == [0.25, 0.5]
    assert check.outcome is not None
    assert check.outcome.ending == "completed", "0.5 of full for 8 s gains 0.08 m/s"
    pushing = [row.t for row, c in rows if c.X > 0.0]
    between = [b - a for a, b in pairwise(pushing) if b - a > 0.15]
    assert len(between) == 1
    assert 2.5 < between[0] < 4.0
    assert check.settings["output"] == 0.5


@pytest.mark.parametrize(
    ("push", "why"), [(-1.0, "the wrong way"), (0.005, "The thruster is dead or too weak"), (0.0, "dead")]
)
def test_motion_astern_and_no_motion_are_rejected(push: float, why: str) -> None:
    outlets = (Outlet(3, 1500.0, 400.0),)
    check, _ = fly(Pushed(push), outlets=outlets, cure="turn the propeller round")
    assert check.outcome is not None
    assert check.outcome.ending == "aborted"
    assert why in check.outcome.reason
    assert ("turn the propeller round" in check.outcome.reason) is (push < -0.5)
    assert ("SERVO3 went to 1700 us" in check.outcome.reason) is (push >= 0.0)


@pytest.mark.parametrize(("noise", "least"), [(0.0, 0.06), (0.1, None)])
def test_the_speed_threshold_is_the_set_value_or_above_the_noise(noise, least) -> None:
    check, _ = fly(Pushed(0.0, noise=noise))
    assert check._least == pytest.approx(NOISES * check._noise if least is None else least)
    assert check._noise == pytest.approx(noise, rel=0.35, abs=1e-12)
    assert check.outcome is not None
    assert check.outcome.ending == "aborted"


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("turn", "ending"), [(0.2, "aborted"), (0.02, "completed")])
def test_a_craft_that_turns_under_thrust_is_rejected_but_not_for_its_initial_drift(sign, turn, ending) -> None:
    craft, drift = Pushed(0.03), 0.3

    def seen(t: float, command) -> Observation:
        now = craft(t, command)
        twist = turn * max(t - 3.0, 0.0) if craft.u else 0.0
        return at_rest(t=t, u=now.u, speed=now.speed, output=now.output, psi=drift * t + sign * twist)

    check, _ = fly(seen, crooked="see to the left propeller")
    assert check.outcome is not None
    assert check.outcome.ending == ending
    assert ("see to the left propeller" in check.outcome.reason) is (ending == "aborted")


def test_an_output_that_does_not_follow_or_is_saturated_is_rejected() -> None:
    cut, _ = fly(Pushed(1.0, shown=lambda X: 0.4 * X))
    assert cut.outcome is not None
    assert "commanded +0.25 of full X output, but the outputs show +0.10" in cut.outcome.reason
    for stop in (0.95, -0.95):
        standing, rows = fly(Pushed(1.0, shown=lambda X, stop=stop: stop))
        assert standing.outcome is not None
        assert f"X is at {stop:+.2f} of full output" in standing.outcome.reason
        assert {c.X for _, c in rows} == {0.0}
    lying, _ = fly(Pushed(1.0, shown=lambda X: 0.85 + X))
    assert lying.outcome is not None
    assert lying.outcome.ending == "completed", "an idle output is taken off what is shown"


def test_a_vehicle_that_reports_no_speed_is_aborted_in_time() -> None:
    check, rows = fly(lambda t, command: at_rest(t=t, u=math.nan))
    assert check.outcome is not None
    assert "reports no speed" in check.outcome.reason
    assert rows[-1][0].t == pytest.approx(UNKNOWN + 0.1)


def test_the_wait_for_rest_before_the_pulse_is_limited() -> None:
    _, rows = fly(lambda t, command: at_rest(t=t, u=0.05 * t, output={"X": command.X}))
    first = next(row.t for row, c in rows if c.X > 0.0)
    assert first == pytest.approx(LONGEST_REST + 0.1, abs=0.11)
    _, rows = fly(lambda t, command: at_rest(t=t, u=0.02 * t, output={"X": command.X}))
    assert next(row.t for row, c in rows if c.X > 0.0) < 4.0


def test_an_rov_holds_its_depth_only_on_request() -> None:
    sinking = lambda t, command: at_rest(t=t, u=0.0, z=2.0 + 0.3 * (t > 0.0), output={"X": command.X})  # noqa: E731
    kept, rows = fly(sinking, keep_still=True)
    assert rows[5][1].Z < -0.05
    assert kept.phase in ("at rest", "pulse ahead")
    assert fly(sinking)[1][5][1].Z == 0.0


def test_the_wait_for_rest_after_a_pulse_is_limited() -> None:
    def seen(t: float, command) -> Observation:
        return at_rest(t=100.0 + t, u=0.0 if t < 11.5 else 0.05 * t, output={"X": command.X})

    _, rows = fly(seen, least=2.0)
    pushing = [row.t for row, c in rows if c.X > 0.0]
    first_end = next(b for a, b in pairwise(pushing) if b - a > 1.0)
    ended = max(t for t in pushing if t < first_end)
    assert first_end - ended == pytest.approx(30.2, abs=0.15)
