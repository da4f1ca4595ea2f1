"""Boats and ROVs whose actuators are wired wrongly: refused before the first relay, with the cure."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.workflow.preflight import check_depth_is_reported
from sitl.effects import parse_effect

from .sitl_harness import SitlHarness

pytestmark = pytest.mark.slow

REVERSED_HEAVE = {"MOT_5_DIRECTION": -1.0, "MOT_6_DIRECTION": -1.0, "MOT_3_DIRECTION": -1.0}

WRONG = {
    "reversed rudder": ("charlie", "heading", {"parameters": {"SERVO1_REVERSED": 1.0}}, "Set SERVO1_REVERSED to 0"),
    "compass turned round": ("charlie", "heading", {"effect": "sign-error@psi"}, "correct AHRS_ORIENTATION"),
    "dead rudder": ("charlie", "heading", {"effect": "dead-zone@steering.width=1"}, "SERVO1 went to 1800 us and 1200"),
    "reversed heave": ("videoray", "depth", {"parameters": REVERSED_HEAVE}, "check MOT_n_DIRECTION"),
    "dead heave": ("videoray", "depth", {"effect": "dead-zone@heave.width=1"}, "The actuator is dead or too weak"),
    "reversed throttle": ("charlie", "speed", {"parameters": {"SERVO3_REVERSED": 1.0}}, "Set SERVO3_REVERSED to 0"),
    "propeller turned round": ("charlie", "speed", {"effect": "sign-error@u"}, "Set SERVO3_REVERSED to 1"),
    "dead throttle": ("charlie", "speed", {"effect": "dead-zone@throttle.width=1"}, "The thruster is dead or too weak"),
    "one thruster of two": (
        "blueboat",
        "speed",
        {"parameters": {"SERVO1_REVERSED": 1.0}},
        "SERVO1 and SERVO3 is probably dead",
    ),
    "astern": (
        "charlie",
        "heading",
        {"parameters": {"SERVO3_REVERSED": 1.0}},
        "mounted turned or the thrust is reversed",
    ),
    "too slow": ("charlie", "heading", {"throttle": 0.02}, "more --throttle"),
}


@pytest.mark.parametrize(("name", "axis", "options", "why"), WRONG.values(), ids=WRONG)
def test_a_wrong_actuator_is_refused_before_the_relay(tmp_path, name, axis, options, why):
    effects = [parse_effect(options["effect"])] if "effect" in options else []
    harness = SitlHarness(tmp_path, name, parameters=options.get("parameters"), effects=effects)
    with pytest.raises(PreconditionFailed, match=r"sign.check") as caught:
        harness.tune(axis=axis, **({"throttle": options["throttle"]} if "throttle" in options else {}))
    assert why in str(caught.value)
    harness.assert_as_found()
    assert [path.stem for path in (harness.directory / "trials").glob("*.csv")] == ["01-sign-check"]


def test_unusual_settings_are_reported_by_the_vehicles_own_names(tmp_path):
    settings = {"ARMING_SKIPCHK": -1.0, "MANUAL_OPTIONS": 1.0, "SERVO1_REVERSED": 1.0}
    harness = SitlHarness(tmp_path, names="4.7", parameters=settings)
    with pytest.raises(PreconditionFailed):
        harness.tune()
    assert any(
        "ARMING_SKIPCHK is -1: this vehicle arms without the autopilot's own checks" in text for text in harness.said
    )
    assert any("MANUAL_OPTIONS" in text for text in harness.said)


def test_a_missing_pressure_is_requested():
    """ArduSub on a link of its own streams none; at 584 m above the sea its simulated depth stays 0 for ever."""
    reported, requested = {}, []

    def send(number):
        requested.append(number)
        reported["pressure"] = -58000.0

    session = SimpleNamespace(request_message=send, wait_for=lambda condition, patience: condition())
    craft = SimpleNamespace(telemetry=SimpleNamespace(latest=reported), session=session)
    check_depth_is_reported(craft, "yaw")
    assert not requested, "a heading needs no depth"
    with pytest.raises(PreconditionFailed, match=r"-580 hPa .* altitude of 0\. Nothing was armed"):
        check_depth_is_reported(craft, "heave")
    assert len(requested) == 1


def test_a_vehicle_that_reports_no_pressure_is_accepted():
    requested = []
    session = SimpleNamespace(request_message=requested.append, wait_for=lambda condition, patience: condition())
    check_depth_is_reported(SimpleNamespace(telemetry=SimpleNamespace(latest={}), session=session), "heave")
    assert len(requested) == 1


def test_an_implausible_pressure_is_refused_before_anything_is_armed(tmp_path):
    def high_above_the_sea(t, message):
        if message.get_type() == "SCALED_PRESSURE2":
            message.press_abs = -580.0
        yield message

    harness = SitlHarness(tmp_path, "videoray", high_above_the_sea)
    with pytest.raises(PreconditionFailed, match=r"-580 hPa .* altitude of 0\. Nothing was armed"):
        harness.tune(axis="depth")
    harness.assert_as_found()
    assert not list((harness.directory / "trials").glob("*.csv"))
