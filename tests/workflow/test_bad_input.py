"""Whatever goes wrong: the message the user sees, neutral actuators, the old parameters, the record on disk."""

from __future__ import annotations

import math

import pytest

from gcs_autotune.errors import (
    ArmingRefused,
    GuardTripped,
    LinkLost,
    NoGainsMeetSpec,
    NotAchieved,
    NotAsFound,
    NoVehicle,
    OperatorStopped,
    ParameterMissing,
    ParameterNotAccepted,
    PreconditionFailed,
    TelemetryFault,
    WrongVehicle,
)
from gcs_autotune.link import Journal
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import Unattended, restore_run

from .conftest import taken_plainly
from .sitl_harness import QUICK, SLOW_LOOP, Later, Moored, SitlHarness, StopsAt

pytestmark = pytest.mark.usefixtures("plainly")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """How often a whole tune asks whether the operator wants to stop, and when it ends [s of the vehicle]."""
    operator, harness = StopsAt(10**9), SitlHarness(tmp_path_factory.mktemp("whole"), QUICK)
    with pytest.MonkeyPatch.context() as patched:
        taken_plainly(patched)
        harness.tune(operator)
    return operator.asked, harness.server.now


def silent_after(moment):
    return lambda t, message: () if t > moment else (message,)


def attitude(change, after):
    """Meddle with ATTITUDE messages after a moment: *change* edits the message in place."""

    def meddle(t, message):
        if message.get_type() == "ATTITUDE" and t > after:
            change(t, message)
        return (message,)

    return meddle


def blind(t, m):
    m.yaw = math.nan


def frozen():
    held = {}

    def freeze(t, m):
        for name in ("roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed"):
            setattr(m, name, held.setdefault(name, getattr(m, name)))

    return freeze


def jumping(milliseconds, after):
    def jump(t, message):
        if t > after and hasattr(message, "time_boot_ms"):
            message.time_boot_ms += milliseconds
        return (message,)

    return jump


def parameter(name, value=None):
    """Meddle with PARAM_VALUE of *name*: it always has *value*, or never comes."""

    def meddle(t, message):
        if message.get_type() == "PARAM_VALUE" and message.param_id == name:
            if value is None:
                return ()
            message.param_value = value
        return (message,)

    return meddle


ON_SHORE = {
    "no heartbeat": (NoVehicle, "no HEARTBEAT of an autopilot", {"meddling": lambda t, m: ()}),
    "arming refused": (ArmingRefused, r"[Bb]attery", {"parameters": {"BATT_ARM_VOLT": 60.0}}),
    "parameter missing": (ParameterMissing, "ATC_STR_RAT_FF", {"meddling": parameter("ATC_STR_RAT_FF")}),
    "overrides never expire": (PreconditionFailed, "RC_OVERRIDE_TIME", {"parameters": {"RC_OVERRIDE_TIME": -1.0}}),
}


@pytest.mark.parametrize(("error", "words", "options"), ON_SHORE.values(), ids=ON_SHORE)
def test_an_initial_error_is_reported(tmp_path, error, words, options):
    harness = SitlHarness(tmp_path, QUICK, **options)
    with pytest.raises(error, match=words):
        harness.tune()
    harness.assert_as_found()


UNDER_WAY = {
    "not a number": (TelemetryFault, r"NaN|not a number|finite", lambda end: attitude(blind, 60.0)),
    "frozen": (TelemetryFault, r"frozen|same", lambda end: attitude(frozen(), 0.6 * end)),
    "clock ahead": (TelemetryFault, r"clock|stamp|reboot|jump", lambda end: jumping(60_000, 0.6 * end)),
    "clock back": (TelemetryFault, r"clock|stamp|reboot|jump", lambda end: jumping(-30_000, 0.6 * end)),
    "write not taken": (ParameterNotAccepted, "ATC_STR_ANG_P", lambda end: parameter("ATC_STR_ANG_P", 2.0)),
}


@pytest.mark.slow
@pytest.mark.parametrize(("error", "words", "meddling"), UNDER_WAY.values(), ids=UNDER_WAY)
def test_an_error_during_the_run_is_reported_and_undone(tmp_path, whole, error, words, meddling):
    harness = SitlHarness(tmp_path, QUICK, meddling=meddling(whole[1]))
    with pytest.raises(error, match=words):
        harness.tune()
    harness.assert_as_found()


REFUSED = {
    "requirement": (NoGainsMeetSpec, "settling", "charlie", {"settling_time": 0.3}),
    "envelope": (
        GuardTripped,
        "heading excursion",
        "automarine",
        {"envelope": Envelope(heading_excursion=math.radians(15.0))},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(("error", "words", "name", "settings"), REFUSED.values(), ids=REFUSED)
def test_unmet_requirements_and_tripped_limits_are_reported(tmp_path, error, words, name, settings):
    harness = SitlHarness(tmp_path, name, **(SLOW_LOOP if name == "automarine" else {}))
    with pytest.raises(error, match=words):
        harness.tune(**settings)
    harness.assert_as_found()


def test_a_vehicle_that_is_neither_boat_nor_rov_is_refused(tmp_path):
    def copter(t, message):
        if message.get_type() == "HEARTBEAT":
            message.type = 2
        return (message,)

    harness = SitlHarness(tmp_path, QUICK, meddling=copter)
    with pytest.raises(WrongVehicle, match="QUADROTOR"):
        harness.tune()
    harness.assert_untouched()
    assert not harness.directory.exists()


@pytest.mark.slow
def test_a_missing_context_parameter_is_reported_and_tolerated(tmp_path):
    harness = SitlHarness(tmp_path, QUICK, meddling=parameter("ATC_TURN_MAX_G"))
    harness.tune(dry_run=True)
    assert any("ATC_TURN_MAX_G" in text for text in harness.said)
    harness.assert_as_found()


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.07, 0.2, 0.4, 0.7, 0.95])
def test_a_link_that_falls_silent_leaves_a_neutral_vehicle_and_a_record(tmp_path, whole, share):
    harness = SitlHarness(tmp_path, QUICK, meddling=silent_after(share * whole[1]))
    with pytest.raises((LinkLost, NotAsFound)) as caught:
        harness.tune()
    assert "Lost contact" in str(caught.value)
    harness.assert_recorded()
    harness.server.advance_to(harness.server.now + 10.0)  # what the firmware's own time-outs do meanwhile
    harness.assert_neutral()


@pytest.mark.slow
def test_restore_restores_the_old_gains_after_a_link_lost_in_mid_proof(tmp_path):
    def silent_in_the_proof(t, message):
        harness.peer.deaf = "step with new gains" in harness.said
        return () if harness.peer.deaf else (message,)

    harness = SitlHarness(tmp_path, QUICK, meddling=silent_in_the_proof)
    with pytest.raises(NotAsFound, match="gcs-autotune restore"):
        harness.tune()
    debts = Journal.open_debts(harness.directory / "journal.jsonl")
    now = dict(harness.vehicle.parameters.values)
    changed = {name: old for name, old in harness.parameters.items() if now[name] != old}
    assert changed
    assert debts == pytest.approx(changed)

    again = Moored(peer=Later(harness.server))
    restore_run(again, harness.directory, Unattended(), SilentObserver())
    assert dict(harness.vehicle.parameters.values) == harness.parameters
    assert Journal.open_debts(harness.directory / "journal.jsonl") == {}
    assert not harness.vehicle.autopilot.armed
    assert harness.mode == harness.found
    assert restore_run(again, harness.directory, Unattended(), SilentObserver()) == {}


@pytest.mark.slow
def test_a_limit_cycle_that_never_settles_is_reported(tmp_path):
    def gusts(t, m):
        m.yaw += 0.3 * math.sin(0.61 * t) + 0.2 * math.sin(0.37 * t + 1.0)

    harness = SitlHarness(tmp_path, "automarine", attitude(gusts, 90.0), **SLOW_LOOP)
    with pytest.raises(NotAchieved, match="did not settle"):
        harness.tune(stop_rule="settled")
    harness.assert_as_found()
    assert any(harness.directory.glob("trials/*relay-1.csv"))


@pytest.mark.slow
def test_a_message_from_another_system_is_ignored(tmp_path):
    forged = []

    def forge(t, message):
        if message.get_type() == "PARAM_VALUE":
            forged.append(message.param_id)
        return (message,)

    harness = SitlHarness(tmp_path, QUICK, meddling=forge)
    real = harness.peer.advance_to

    def with_forgeries(t):
        from pymavlink.dialects.v20 import ardupilotmega as mavlink

        other = mavlink.MAVLink(None, srcSystem=9, srcComponent=1)
        lie = mavlink.MAVLink_param_value_message(b"ATC_STR_RAT_P", 77.0, 9, 100, 1)
        return lie.pack(other) + real(t)

    harness.peer.advance_to = with_forgeries
    story = harness.tune(dry_run=True)
    assert story.parameters_before["ATC_STR_RAT_P"] == pytest.approx(0.2)
    harness.assert_as_found()


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.003, 0.01, 0.02, 0.03, 0.1, 0.25, 0.4, 0.6, 0.75, 0.85, 0.9, 0.97])
def test_ctrl_c_at_any_point_leaves_the_vehicle_unchanged(tmp_path, whole, share):
    harness = SitlHarness(tmp_path, QUICK)
    with pytest.raises(OperatorStopped):
        harness.tune(StopsAt(1 + int(share * whole[0])))
    harness.assert_as_found()


@pytest.mark.slow
def test_ctrl_c_during_the_proof_restores_the_old_gains(tmp_path):
    class StopsInTheProof(StopsAt):
        def stop_requested(self):
            return any(text == "new gains written and verified by reading back" for text in harness.said)

    harness = SitlHarness(tmp_path, QUICK)
    with pytest.raises(OperatorStopped):
        harness.tune(StopsInTheProof(0))
    assert "new gains written and verified by reading back" in harness.said
    assert "All parameters have their original values, verified by reading back." in harness.said
    harness.assert_as_found()
