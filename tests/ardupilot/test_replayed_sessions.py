"""Recorded sessions with unmodified ArduRover and ArduSub: connection, parameters, rates, identification."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from replayed import Recording, Replayed

from gcs_autotune.errors import CommandDenied, ParameterMissing
from gcs_autotune.firmware import FIRMWARE, Firmware
from gcs_autotune.identify import fit_axis
from gcs_autotune.link import Commands, MemoryLink, Parameters, Rates, Session, open_craft

KINDS = ("rover", "sub", "rover-4.6", "sub-4.6")
"""Recordings: of 4.7.0-dev, and of 4.6.3 (whose ArduSub calls itself 4.6.0-dev)."""
GAIN = {"rover": "ATC_STR_RAT_P", "sub": "ATC_RAT_YAW_P"}
TRUTH = {"rover": lambda speed: 1.0 / (1.174 * speed), "sub": lambda _: 1.0 / 2.696}
"""Steering per turn rate [s/rad] of the stock models (SIM_Sailboat, SIM_Submarine; see docs/ardupilot.md)."""
HOME_BELOW_ORIGIN = {"sub": -0.049, "sub-4.6": -0.059}
"""Metres, by LOCAL_POSITION_NED.z + GLOBAL_POSITION_INT.relative_alt of one moment."""

recording = cache(Recording)


def vessel(kind: str) -> str:
    """Return the vehicle type of a recording."""
    return kind.split("-")[0]


def firmware_of(kind: str) -> Firmware:
    return FIRMWARE[f"ardu{vessel(kind)}"]


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


def before_the_first_relay(kind: str) -> float:
    return recording(kind).relays[0]["from_t"] - 5.0


@pytest.fixture
def peer(kind):
    return Replayed(recording(kind), before_the_first_relay(kind))


@pytest.fixture
def session(peer):
    with Session(MemoryLink(peer)) as session:
        yield session


@pytest.fixture
def aboard(session):
    session.discover()
    return session


def test_the_vehicle_is_discovered_with_its_version(aboard, kind):
    vehicle = aboard.vehicle
    types = {"rover": mavlink.MAV_TYPE_SURFACE_BOAT, "sub": mavlink.MAV_TYPE_SUBMARINE}
    assert (vehicle.autopilot, vehicle.vehicle_type) == (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, types[vessel(kind)])
    assert vehicle.version == recording(kind).version


def test_connecting_reads_the_output_mapping_and_receives_the_attitude(session, peer, kind):
    craft = open_craft(session, wanted_rates={"ATTITUDE": 25.0, "SERVO_OUTPUT_RAW": 40.0})
    assert craft.rates.granted["ATTITUDE"].granted == 25.0
    now = craft.observe()
    assert set(now.output) >= {"N", "X"}
    assert now.t == pytest.approx(before_the_first_relay(kind), abs=15.0)
    written = {"PARAM_SET", "RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"}
    assert not written & {m.get_type() for m in peer.received}


def test_a_gain_is_written_and_restored_and_the_float_echo_is_accepted(aboard, kind):
    parameters, name = Parameters(aboard), GAIN[vessel(kind)]
    old = parameters.read(name)
    parameters.write(name, 0.33)
    assert parameters.known[name] == pytest.approx(0.33, abs=1e-7)
    assert parameters.known[name] != 0.33
    parameters.write(name, old)


def test_an_unknown_name_ends_with_an_error_or_after_three_tries(aboard, kind, monkeypatch):
    """PARAM_ERROR is new in 4.7; older firmware sends no reply."""
    monkeypatch.setattr(type(aboard), "lossy", lambda self: "")  # recordings are thinned out: numbers are missing
    begun = aboard.clock.now()
    with pytest.raises(ParameterMissing):
        Parameters(aboard).read("NO_SUCH_GAIN")
    assert aboard.clock.now() - begun < (1.0 if recording(kind).version.startswith("4.7") else 6.0)


def test_every_heading_gain_exists_under_a_known_name(aboard, kind):
    firmware = firmware_of(kind)
    held = Parameters(aboard).read_full()
    assert set(held) == recording(kind).names()
    required = [gain.parameter for gain in firmware.axes["heading"].gains]
    assert set(required) <= set(held)


def test_rates_that_the_loop_cannot_send_are_denied_and_halved(aboard, kind):
    firmware = firmware_of(kind)
    rates = Rates(aboard, Commands(aboard, firmware))
    granted = rates.request({"ATTITUDE": 400.0, "WHEEL_DISTANCE": 10.0})
    assert granted["ATTITUDE"] == (25.0 if vessel(kind) == "rover" else 200.0)
    assert granted["WHEEL_DISTANCE"] == 0.0
    assert any("ATTITUDE: requested 400 Hz" in note for note in aboard.notes)


def test_a_mode_that_does_not_exist_is_refused(aboard, kind):
    firmware = firmware_of(kind)
    with pytest.raises(CommandDenied) as refused:
        Commands(aboard, firmware).command_long(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 99.0)
    assert refused.value.result in (mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED)


@cache
def replayed_trial(kind: str, number: int):
    """Return the trial that the link module makes of the recorded telemetry of a relay experiment."""
    flown = recording(kind).relays[number]
    with Session(MemoryLink(Replayed(recording(kind), flown["from_t"] - 10.0), quantum=0.02)) as session:
        craft = open_craft(session, system_id=1, wanted_rates={"ATTITUDE": 25.0, "SERVO_OUTPUT_RAW": 40.0})
        craft.start_recording(f"relay-{number + 1}")
        while craft.observe().t < flown["to_t"]:
            pass
        return craft.stop_recording("completed").between(flown["from_t"], flown["to_t"])


@pytest.mark.parametrize("number", [0, 1])
def test_the_measured_servo_output_equals_the_relay_output(kind, number):
    """The stick's dead zone is compensated: the output measured at the servo is the relay's own."""
    output = np.abs(replayed_trial(kind, number)["N"].values[10:])
    assert np.median(output) == pytest.approx(recording(kind).relays[number]["C"], abs=0.005)


def test_samples_carry_the_vehicles_own_time_stamps(kind):
    gaps = np.diff(replayed_trial(kind, 0)["psi"].t)
    assert np.mean(gaps) == pytest.approx(0.04, rel=0.03)
    assert 0.015 < np.min(gaps) <= np.max(gaps) < 0.065


@cache
def fitted(kind: str):
    return fit_axis([replayed_trial(kind, number) for number in (0, 1)], dof="yaw")


def test_the_recorded_relays_give_the_steady_turn_rate_of_the_simulated_craft(kind):
    speed = float(np.mean([replayed_trial(kind, number)["U"].values.mean() for number in (0, 1)]))
    assert fitted(kind).parameters["beta_r"].value == pytest.approx(TRUTH[vessel(kind)](speed), rel=0.06)


@pytest.mark.parametrize("kind", ["rover", "rover-4.6"])
def test_a_boat_without_yaw_inertia_is_reported_as_inertia_unresolved(kind):
    assert "inertia-unresolved" in {doubt.slug for doubt in fitted(kind).doubts}


@pytest.mark.parametrize("kind", ["sub", "sub-4.6"])
def test_the_depth_offset_of_home_is_found_from_ardupilots_messages(session, kind):
    """It sends the depth below home before the depth below the origin, of the same moment."""
    craft = open_craft(session, system_id=1)
    until = craft.observe().t + 3.0
    while craft.observe().t < until:
        pass
    assert craft.telemetry.depth_offset == pytest.approx(HOME_BELOW_ORIGIN[kind], abs=0.005)
