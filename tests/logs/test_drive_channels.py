"""The inputs of a craft from a log: outputs dated midway, else sticks or RC input, and their source."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from log_writing import BOAT, SKID

from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.logs.channels import drive_channels, motion_channels
from gcs_autotune.logs.sample_store import SampleStore

ROVER, SUB = FIRMWARE["ardurover"], FIRMWARE["ardusub"]


def logged(
    values: Mapping[str, Sequence[float]],
    parameters: Mapping[str, float] | None = None,
    t: Sequence[float] | None = None,
    firmware: str = "ardurover",
) -> SampleStore:
    """A store of one kind of message: source -> values, at *t* [s] (every 0.2 s)."""
    count = len(next(iter(values.values()), ()))
    store = SampleStore("log", "its own", firmware=FIRMWARE[firmware] if firmware else None)
    store.parameters = dict(BOAT if parameters is None else parameters)
    for k in range(count):
        store.take(t[k] if t else 0.2 * k, {name: column[k] for name, column in values.items()})
    return store


SERVOS = {"servo.1": [1500.0, 1500.0, 1700.0, 1700.0, 1100.0], "servo.3": [1500.0, 1500.0, 1500.0, 1900.0, 1900.0]}


def test_outputs_are_normalised_and_a_change_is_dated_midway() -> None:
    channels, source, notes = drive_channels(logged({**SERVOS, "servo.2": [0.0] * 5, "servo.4": [1200.0] * 5}))
    assert (source, notes) == ("servo outputs", [])
    assert channels["N"].values == pytest.approx([0.0, 0.0, 0.5, 0.5, -1.0])
    assert channels["X"].values == pytest.approx([0.0, 0.0, 0.0, 1.0, 1.0])
    assert channels["N"].t == pytest.approx([0.0, 0.2, 0.3, 0.6, 0.7])
    assert channels["X"].t == pytest.approx([0.0, 0.2, 0.4, 0.5, 0.8])
    assert {c.unit for n, c in channels.items() if n in "XN"} == {"1"}
    assert channels["servo1"].values.tolist() == SERVOS["servo.1"]
    assert (channels["servo1"].unit, channels["servo1"].t.tolist()) == ("pwm", pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8]))
    assert set(channels) == {"X", "N", "servo1", "servo3", "servo4"}, "an output without a pulse is none"


@pytest.mark.parametrize(("gap", "at"), [(0.375, 1.1875), (0.4375, 1.21875), (0.5, 1.5), (2.0, 3.0)])
def test_after_a_gap_of_half_a_second_a_change_is_dated_by_its_message(gap: float, at: float) -> None:
    times = [0.0, 0.5, 1.0, 1.0 + gap]
    found = drive_channels(logged({n: [*v[:1] * 3, 1700.0] for n, v in SERVOS.items()}, t=times))[0]
    assert found["N"].t.tolist() == [0.0, 0.5, 1.0, at]


def test_both_thrusters_of_skid_steering_are_read() -> None:
    channels, source, _ = drive_channels(logged({"servo.1": [1900.0, 1900.0], "servo.3": [1900.0, 1100.0]}, SKID))
    assert source == "servo outputs"
    assert channels["X"].values == pytest.approx([1.0, 0.0])
    assert channels["N"].values == pytest.approx([0.0, 1.0])


STICKS = {"stick.X": [0.5, 0.25], "stick.N": [-0.5, 0.0]}
PILOT = {"rc.1": [1700.0, 1300.0], "rc.3": [1500.0, 1900.0]}


@pytest.mark.parametrize(
    ("values", "source", "words"),
    [
        ({**STICKS, **PILOT}, "the pilot's sticks", "the log contains no servo outputs"),
        (PILOT, "RC input", "the log contains no servo outputs"),
        ({**STICKS, "servo.1": [1500.0, 1500.0]}, "the pilot's sticks", "the log contains no servo outputs"),
        ({"servo.3": [1500.0, 1500.0]}, "", "no input could be read: the log contains no servo outputs"),
        ({}, "", "no input could be read"),
    ],
)
def test_without_all_outputs_sticks_or_rc_input_are_used_with_a_doubt(
    values: dict[str, list[float]], source: str, words: str
) -> None:
    channels, reported, notes = drive_channels(logged(values))
    assert reported == source
    ((slug, cause, cure),) = notes
    assert slug == ("input-is-command" if source else "no-inputs")
    assert words in cause
    assert f"the inputs are {source}, not the actuator outputs" in cause or not source
    assert "SERVO_OUTPUT_RAW" in cure
    assert ("X" in channels) is bool(source)
    if "sticks" in source:
        assert channels["X"].values.tolist() == [0.5, 0.25]
        assert channels["N"].values.tolist() == [-0.5, 0.0]
    assert ("servo3" in channels) is ("servo.3" in values)


def test_outputs_with_different_stamps_are_not_combined() -> None:
    store = logged({"servo.1": [1500.0, 1700.0, 1700.0]})
    for t in (0.0, 0.2):
        store.take(t, {"servo.3": 1500.0})
    channels, source, (note,) = drive_channels(store)
    assert (source, note[0]) == ("", "no-inputs")
    assert set(channels) == {"servo1", "servo3"}


def test_outputs_with_unknown_functions_are_not_used_and_this_is_reported() -> None:
    _, source, (note,) = drive_channels(logged({**SERVOS, **{n: v * 3 for n, v in STICKS.items()}}, {}))
    assert source == "the pilot's sticks"
    assert "the log contains no parameters, so the functions of its outputs are unknown" in note[1]
    assert "--parameters FILE" in note[2]


def test_a_log_with_some_servo_functions_reports_their_number_without_mention_of_a_link() -> None:
    store = logged(SERVOS, {"SERVO1_FUNCTION": 26.0, "SERVO2_FUNCTION": 0.0, "ATC_STR_RAT_P": 0.2})
    _, source, (note,) = drive_channels(store)
    assert source == ""
    assert "3 parameters, but only 2 of 8 SERVOn_FUNCTION" in note[1]
    assert "--parameters FILE" in note[2]
    assert not any(word in part for part in note for word in ("link", "answer", "set SERVOn_FUNCTION"))


def test_a_log_of_an_unknown_autopilot_has_outputs_and_no_inputs() -> None:
    channels, source, notes = drive_channels(logged(SERVOS, firmware=""))
    assert (set(channels), source, [n[0] for n in notes]) == ({"servo1", "servo3"}, "", ["no-inputs"])


@pytest.mark.parametrize(
    ("limits", "shares"),
    [
        ({}, [0.5, -0.5, 1.0, -1.0]),
        ({"RC1_TRIM": 1600.0}, [0.25, -0.75, 0.75, -1.25]),
        ({"RC1_MIN": 1300.0, "RC1_MAX": 1700.0}, [1.0, -1.0, 2.0, -2.0]),
        ({"RC1_MIN": 1300.0, "RC1_MAX": 1900.0}, [0.5, -1.0, 1.0, -2.0]),
        ({"RC1_MIN": 1100.0, "RC1_TRIM": 1100.0, "RC1_MAX": 1900.0}, [0.5, -0.5, 1.0, -1.0]),
        ({"RC1_MIN": 1000.0, "RC1_TRIM": 1000.0, "RC1_MAX": 1800.0}, [0.75, -0.25, 1.25, -0.75]),
        ({"RC1_MIN": 1900.0, "RC1_MAX": 1100.0}, [0.5, -0.5, 1.0, -1.0]),
        ({"RC1_MIN": 1100.0, "RC1_TRIM": 1900.0, "RC1_MAX": 1900.0}, [0.5, -0.5, 1.0, -1.0]),
        ({"RC1_REVERSED": 1.0}, [-0.5, 0.5, -1.0, 1.0]),
        ({"RC1_REVERSED": 0.0}, [0.5, -0.5, 1.0, -1.0]),
    ],
)
def test_rc_input_is_normalised_by_its_range_on_each_side_of_trim(
    limits: dict[str, float], shares: list[float]
) -> None:
    found = drive_channels(logged({"rc.1": [1700.0, 1300.0, 1900.0, 1100.0]}, limits))[0]
    assert found["N"].values == pytest.approx([ROVER.channel_signs["N"] * share for share in shares])
    assert set(found) == {"N"}


def test_invalid_pulses_are_left_out_of_rc_input() -> None:
    found = drive_channels(logged({"rc.1": [500.0, 501.0, 2499.0, 2500.0, 0.0], "rc.3": [0.0] * 5}, {}))[0]
    assert found["N"].t.tolist() == pytest.approx([0.2, 0.4])
    assert "X" not in found


def test_an_rovs_sticks_have_the_signs_of_its_firmware() -> None:
    n = SUB.channels["Z"]
    found = drive_channels(logged({f"rc.{n}": [1900.0, 1900.0]}, {}, firmware="ardusub"))[0]
    assert found["Z"].values.tolist() == [SUB.channel_signs["Z"]] * 2


def moving(count: int = 30, **sources: float) -> SampleStore:
    """A store with *count* samples of each source, 0.1 s apart; a value of it grows by so much a second."""
    store = SampleStore("log", "its own")
    for name, slope in sources.items():
        for k in range(count):
            store.take(0.1 * k, {name.replace("__", "."): slope * 0.1 * k})
    return store


def test_stamped_turn_rates_are_preferred_to_those_dated_by_arrival() -> None:
    store = moving(attitude__r=0.1, rate__r=0.2, imu__r=0.3)
    assert motion_channels(store)[1]["r"] == "attitude"
    store.dated_by_arrival.add("attitude")
    assert motion_channels(store)[1]["r"] == "rate"
    store.dated_by_arrival |= {"rate", "imu"}
    channels, sources = motion_channels(store)
    assert sources["r"] == "attitude"
    assert channels["r"].values[-1] == pytest.approx(0.29)


def test_the_second_attitude_estimate_replaces_a_missing_first_one() -> None:
    store = SampleStore("log", "its own")
    for k in range(25):
        store.take(0.1 * k, {"ahrs2.phi": 0.1, "ahrs2.theta": 0.2, "ahrs2.psi": 0.3})
        if k < 19:
            store.take(0.1 * k, {"attitude.phi": 0.4, "attitude.theta": 0.4, "attitude.psi": 0.4})
    channels, sources = motion_channels(store)
    assert [channels[n].values[0] for n in ("phi", "theta", "psi")] == [0.1, 0.2, 0.3]
    assert set(sources.values()) == {"ahrs2"}


def test_only_the_first_moving_position_is_used() -> None:
    store = SampleStore("log", "its own")
    for k in range(25):
        store.take(0.1 * k, {"local.x": 1.0, "local.y": 2.0})
        store.take(0.1 * k, {"ekf.x": 1.0, "ekf.y": 0.1 * k})
        store.take(0.1 * k, {"gps.lat": 45.0 + 1e-6 * k, "gps.lon": 5.0, "gps.U": 0.7})
    channels, sources = motion_channels(store)
    assert (sources["x"], sources["y"], sources["U"]) == ("ekf", "ekf", "gps")
    assert channels["y"].values[-1] == pytest.approx(2.4)


def test_latitude_and_longitude_become_metres_from_the_first() -> None:
    store = SampleStore("log", "its own")
    for k in range(25):
        store.take(0.1 * k, {"global.lat": 60.0 + 1e-5 * k, "global.lon": 5.0 + 2e-5 * k})
    channels, sources = motion_channels(store)
    assert sources["x"] == sources["y"] == "global"
    assert (channels["x"].values[0], channels["y"].values[0]) == (0.0, 0.0)
    assert channels["x"].values[-1] == pytest.approx(24e-5 * 111_300.0, rel=0.01)
    assert channels["y"].values[-1] == pytest.approx(48e-5 * 111_300.0 * math.cos(math.radians(60.0)), rel=0.01)


@pytest.mark.parametrize(("heads", "turned"), [(0, False), (20, True), (21, True)])
def test_a_velocity_is_rotated_by_a_heading_within_a_second(heads: int, turned: bool) -> None:
    store = SampleStore("log", "its own")
    for k in range(60):
        store.take(0.125 * k, {"local.x": float(k), "local.y": 0.0, "local.vn": 1.0, "local.ve": 0.0})
        if 16 <= k < 16 + heads:
            store.take(0.125 * k, {"attitude.phi": 0.0, "attitude.theta": 0.0, "attitude.psi": math.pi / 2.0})
    channels, _ = motion_channels(store)
    assert channels["U"].values.tolist() == [1.0] * 60
    assert ("u" in channels) is turned
    if turned:
        assert (channels["u"].t[0], channels["u"].t[-1]) == (1.0, 0.125 * (16 + heads - 1) + 1.0)
        assert channels["u"].values == pytest.approx(np.zeros(len(channels["u"])), abs=1e-12)
        assert channels["v"].values == pytest.approx(-np.ones(len(channels["v"])))


def test_an_empty_store_has_no_channels_and_a_climb_rate_keeps_its_depth_source() -> None:
    assert motion_channels(SampleStore("log", "its own")) == ({}, {})
    store = moving(global__z=0.1, global__w=0.0, local__w=0.5)
    channels, sources = motion_channels(store)
    assert (sources["z"], sources["w"]) == ("global", "global")
    assert channels["w"].values.tolist() == [0.0] * 30
    few = replace(store, _groups={})
    assert motion_channels(few) == ({}, {})
