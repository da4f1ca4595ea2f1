"""The pulse ahead before throttle is stepped, on vehicles whose thrust saturates and on one whose does not."""

from __future__ import annotations

import re
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_autotune.errors import NotAsFound, PreconditionFailed
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import MemoryLink, Session, open_craft
from gcs_autotune.manoeuvres import Envelope, Sequencer, ThrustCheck
from gcs_autotune.observer import SilentObserver
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.preflight import check_throttle_is_free, sign_check_for
from sitl import open_vehicle
from sitl.effects import parse_effect

from .sitl_harness import Meddler, SitlHarness

WORKING = 0.8
"""Throttle that a tune of Charlie's speed goes up to; the check tries half of it, then all."""


def pulse(*, effect: str = "", stuck: float = 0.0, **parameters: float) -> tuple[ThrustCheck, Trial]:
    """Fly the check; for its first *stuck* seconds the throttle output stands at its upper stop."""
    flying_since: list[float] = []

    def meddling(t: float, message: Any) -> Iterable[Any]:
        if message.get_type() == "SERVO_OUTPUT_RAW" and flying_since and t < flying_since[0] + stuck:
            message.servo3_raw = 1980
        yield message

    effects = [parse_effect(effect)] if effect else []
    server = open_vehicle("charlie", seed=1, effects=effects, parameters=parameters)
    craft = open_craft(Session(MemoryLink(Meddler(server, meddling))))
    craft.session.pause(45.0)  # its position filter is ready then
    craft.set_mode("MANUAL")
    craft.arm()
    check = sign_check_for("surge", craft, WORKING, needs_speed=False)
    assert isinstance(check, ThrustCheck)
    flying_since.append(server.now)
    return check, Sequencer(craft, Envelope(), SilentObserver(), lambda trial: None).fly(check)


def pulses(flown: Trial) -> list[float]:
    return [float(mark.detail["X"]) for mark in flown.marks if mark.kind == "pulse"]


def test_free_thrust_passes_on_the_first_half_pulse() -> None:
    check, flown = pulse()
    assert flown.ending == "completed"
    assert check.answer is not None
    assert check.answer.command == WORKING / 2
    assert check.answer.obeyed == pytest.approx(1.0, abs=0.02)
    assert check.answer.moved > 0.2
    assert flown.reason.endswith("X acts in the right direction")


@pytest.mark.slow
def test_thrust_that_saturates_below_the_pulse_passes_with_less_speed_gained() -> None:
    free, _ = pulse()
    check, flown = pulse(effect="saturation@throttle.limit=0.3")
    assert flown.ending == "completed"
    assert free.answer is not None
    assert check.answer is not None
    assert 0.06 < check.answer.moved < 0.75 * free.answer.moved
    assert check.answer.obeyed == pytest.approx(1.0, abs=0.02), (
        "the outputs are what was commanded: the limit is hidden"
    )


@pytest.mark.slow
@pytest.mark.parametrize("limit", [0.02, 0.1])
def test_thrust_that_saturates_too_low_is_refused_after_both_pulses_with_the_output_shown(
    limit: float,
) -> None:
    check, flown = pulse(effect=f"saturation@throttle.limit={limit}")
    assert flown.ending == "aborted"
    assert pulses(flown) == [WORKING / 2, WORKING]
    assert check.answer is not None
    assert check.answer.moved < 0.06
    assert re.search(r"though SERVO3 went to 1(889|890) us\. The thruster is dead or too weak", flown.reason)


@pytest.mark.slow
def test_throttle_limited_by_the_autopilot_is_refused_with_the_limiting_parameter() -> None:
    check, flown = pulse(MOT_THR_MAX=10.0)
    assert flown.ending == "aborted"
    assert check.answer is not None
    assert check.answer.obeyed == pytest.approx(0.25, abs=0.02)
    assert "commanded +0.40 of full X output, but the outputs show +0.10: SERVO3 is limited" in flown.reason
    assert "MOT_THR_MAX" in flown.reason


@pytest.mark.slow
def test_a_throttle_saturated_without_a_command_is_refused_before_any_pulse() -> None:
    check, flown = pulse(stuck=4.0)
    assert flown.ending == "aborted"
    assert check.answer is None
    assert pulses(flown) == []
    assert "X is at +0.96 of full output without any command: SERVO3 is saturated" in flown.reason


@pytest.mark.slow
def test_a_throttle_that_stays_saturated_is_reported_as_not_neutral() -> None:
    with pytest.raises(NotAsFound, match=r"not neutral after 5 s: X \+0\.96 of full output\. Take over by hand"):
        pulse(stuck=60.0)


def test_a_cap_below_the_working_throttle_is_refused_before_arming_with_a_possible_throttle(tmp_path) -> None:
    harness = SitlHarness(tmp_path, parameters={"MOT_THR_MAX": 25.0})
    with pytest.raises(PreconditionFailed, match=r"MOT_THR_MAX is 25 %.* Use --throttle 0\.25"):
        harness.tune(axis="speed")
    harness.assert_as_found()
    assert not list((harness.directory / "trials").glob("*.csv"))


def test_a_sufficient_cap_or_one_on_another_axis_is_accepted() -> None:
    craft = open_craft(Session(MemoryLink(open_vehicle("charlie", parameters={"MOT_THR_MAX": 80.0}))))
    check_throttle_is_free(craft, "surge", WORKING)
    check_throttle_is_free(craft, "yaw", 1.0)
    with pytest.raises(PreconditionFailed, match="MOT_THR_MAX is 80 %"):
        check_throttle_is_free(craft, "surge", WORKING + 0.01)


@pytest.mark.parametrize(("firmware", "throttle"), [("ardusub", 0.0), ("ardurover", 0.25)])
def test_steering_is_checked_at_rest_where_a_craft_needs_no_headway(firmware: str, throttle: float) -> None:
    """With headway many an ROV turns by itself, which hides its thrusters."""
    craft: Any = SimpleNamespace(firmware=FIRMWARE[firmware], servos=SimpleNamespace(driving=lambda force: []))
    check = sign_check_for("yaw", craft, 0.25, needs_speed=False)
    assert check.meta_fields["throttle"] == throttle
