"""Fractions to RC channels by number: limits, trims, dead zones, signs; what is driven, held and released."""

from __future__ import annotations

import math
from collections.abc import Iterable
from types import SimpleNamespace
from typing import cast

import pytest

from gcs_autotune.craft import Actuate
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import Parameters
from gcs_autotune.link.vehicle.vehicle_config import OverrideMap, RateStick, RcChannel, read_override_map, why_deaf

ROVER, SUB = FIRMWARE["ardurover"], FIRMWARE["ardusub"]
LEFT_ALONE, RELEASED = 65535, 0


class ReportedParameters:
    """Parameters that a vehicle reports."""

    def __init__(self, values: dict[str, float]) -> None:
        self.values = values

    def read_all(self, names: Iterable[str]) -> dict[str, float]:
        return {n: self.values[n] for n in names}

    def read_existing(self, names: Iterable[str]) -> dict[str, float]:
        return {n: self.values[n] for n in names if n in self.values}


def reported_parameters(**changes: float) -> Parameters:
    values: dict[str, float] = {"RC_OVERRIDE_TIME": 3.0, "RC_OPTIONS": 0.0}
    for n in range(1, 9):
        values |= {f"RC{n}_MIN": 1100, f"RC{n}_TRIM": 1500, f"RC{n}_MAX": 1900, f"RC{n}_DZ": 30, f"RC{n}_REVERSED": 0}
    return cast(Parameters, ReportedParameters({**values, **changes}))


SUB_MAP = {"RCMAP_PITCH": 1, "RCMAP_ROLL": 2, "RCMAP_THROTTLE": 3, "RCMAP_YAW": 4, "RCMAP_FORWARD": 5}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_fraction_is_scaled_from_the_dead_zone_edge_to_the_limit_of_its_side(sign: float) -> None:
    channel = RcChannel(1000.0, 1400.0, 2000.0, dead_zone=50.0, sign=sign)
    expected = {1.0: 2000, 0.5: 1725, 0.0: 1400, -0.5: 1175, -1.0: 1000, 7.0: 2000, -7.0: 1000}
    assert {f: channel.pwm(sign * f) for f in expected} == expected
    assert channel.pwm(0.0009) == channel.pwm(-0.0009) == 1400
    assert (channel.pwm(sign * 0.002), channel.pwm(sign * -0.002)) == (1451, 1349)


def test_only_driven_and_held_channels_are_released() -> None:
    overrides = OverrideMap({"N": (4, RcChannel(1100, 1500, 1900))}, held={1: 1510, 2: 1490})
    released = overrides.release(255, 190)
    fields = [getattr(released, f"chan{n}_raw") for n in range(1, 9)]
    assert fields == [RELEASED, RELEASED, LEFT_ALONE, RELEASED, *[LEFT_ALONE] * 4]
    assert (released.target_system, released.target_component) == (255, 190)


def test_held_channels_are_sent_and_probed_with_the_driven_ones() -> None:
    overrides = OverrideMap({"N": (4, RcChannel(1100, 1500, 1900))}, held={1: 1510})
    assert overrides.values(Actuate(N=0.5)) == {1: 1510, 4: 1700}
    assert overrides.probe == {1: 1518, 4: 1508}


def test_an_rovs_map_drives_six_forces_and_holds_a_roll_stick_without_travel() -> None:
    known = {**SUB_MAP, "RCMAP_LATERAL": 6}
    every = {"Z": 3, "N": 4, "X": 5, "Y": 6, "K": 2, "M": 1}
    overrides = read_override_map(reported_parameters(**known), SUB)
    assert {force: n for force, (n, _) in overrides.channels.items()} == every
    assert not overrides.held
    overrides = read_override_map(reported_parameters(**known, RC2_TRIM=1493.0, RC2_MIN=1493.0), SUB)
    assert {force: n for force, (n, _) in overrides.channels.items()} == {f: n for f, n in every.items() if f != "K"}
    assert overrides.held == {2: 1493}
    down = overrides.values(Actuate(Z=1.0))
    assert down[3] == 1100, "a stick pulled back dives"


@pytest.mark.parametrize(("pitch", "drives"), [(4, False), (0, False), (9, False), (8, True)])
def test_a_pitch_channel_that_is_shared_or_out_of_range_is_left_alone(pitch: int, drives: bool) -> None:
    overrides = read_override_map(reported_parameters(**{**SUB_MAP, "RCMAP_PITCH": pitch, "RCMAP_LATERAL": 6}), SUB)
    assert ("M" in overrides.channels) is drives
    assert overrides.channels["N"][0] == 4
    assert not overrides.held


@pytest.mark.parametrize(("low", "trim", "high"), [(1471.0, 1500.0, 1900.0), (1100.0, 1500.0, 1529.0)])
def test_a_stick_side_within_the_dead_zone_has_no_travel(low: float, trim: float, high: float) -> None:
    """A dead zone of 30 us: one microsecond more on either side leaves travel."""
    narrow = {"RC1_MIN": low, "RC1_TRIM": trim, "RC1_MAX": high}
    with pytest.raises(PreconditionFailed, match=r"RC1_MIN .* DZ 30 leave no travel on both sides"):
        read_override_map(reported_parameters(**narrow), ROVER)
    wide = {"RC1_MIN": low - 2.0 * (low > 1400), "RC1_TRIM": trim, "RC1_MAX": high + 2.0 * (high < 1600)}
    assert read_override_map(reported_parameters(**wide), ROVER).channels["N"][1].dead_zone == 30.0


def test_a_dead_zone_that_the_firmware_does_not_apply_takes_no_travel() -> None:
    assert not SUB.manual_dead_zone
    overrides = read_override_map(reported_parameters(**SUB_MAP, RC4_MIN=1480.0), SUB)
    assert overrides.channels["N"][1] == RcChannel(1480.0, 1500.0, 1900.0)


def test_a_reversed_channel_changes_the_sign() -> None:
    overrides = read_override_map(reported_parameters(RC1_REVERSED=1.0), ROVER)
    assert overrides.channels["N"][1].sign == -1.0
    assert overrides.channels["X"][1].sign == 1.0
    assert overrides.values(Actuate(N=1.0, X=1.0)) == {1: 1100, 3: 1900}


@pytest.mark.parametrize(
    ("expiry", "words"),
    [
        (0.0, "ignores overrides"),
        (-1.0, "forever"),
        (10.5, "for 10.5 s after a loss of the link"),
    ],
)
def test_overrides_that_never_act_or_outlive_the_link_are_refused(expiry: float, words: str) -> None:
    with pytest.raises(PreconditionFailed, match=words):
        read_override_map(reported_parameters(RC_OVERRIDE_TIME=expiry), ROVER)


@pytest.mark.parametrize("expiry", [0.1, 3.0, 10.0])
def test_overrides_that_expire_soon_are_accepted(expiry: float) -> None:
    assert set(read_override_map(reported_parameters(RC_OVERRIDE_TIME=expiry), ROVER).channels) == {"N", "X"}


@pytest.mark.parametrize("number", [0, 9])
def test_a_channel_beyond_the_overrides_is_refused(number: int) -> None:
    with pytest.raises(PreconditionFailed, match=f"RCMAP_ROLL is {number}"):
        read_override_map(reported_parameters(RCMAP_ROLL=float(number)), ROVER)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_turn_rate_stick_position_includes_the_scaled_dead_zone(sign: float) -> None:
    stick = RateStick(full_rate=2.0, dead_zone=0.1, usual_gain=0.5)
    assert stick.deflection(sign * 1.0, 1.0) == pytest.approx(sign * (0.1 + 0.5 * 0.9))
    assert stick.deflection(sign * 1.0, math.nan) == pytest.approx(sign * (0.05 + 0.5 * 0.95))
    assert stick.deflection(sign * 1.0, 0.2) == pytest.approx(sign * (0.02 + 0.5 * 0.98))
    assert stick.deflection(sign * 9.0, 1.0) == sign
    assert stick.deflection(0.0, 1.0) == 0.0


@pytest.mark.parametrize(
    ("aboard", "words"),
    [
        ({}, "the vehicle does not answer requests either"),
        ({"MAV_GCS_SYSID": 42.0}, "MAV_GCS_SYSID is 42, but this tool's system id is 255. Use --source-system 42"),
        ({"MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 254.0}, "MAV_GCS_SYSID is 250, but this tool's system id"),
        ({"MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 255.0}, "show no reason (MAV_GCS_SYSID 250, RC_OPTIONS 0)"),
        ({"MAV_GCS_SYSID": 255.0, "RC_OPTIONS": 6.0}, "RC_OPTIONS is 6: its bit 1"),
        ({"MAV_GCS_SYSID": 255.0, "RC_OPTIONS": 5.0}, "RC_OPTIONS 5)"),
        ({"MAV_GCS_SYSID": 255.0, "RC_OVERRIDE_TIME": 0.0}, "RC_OVERRIDE_TIME is 0"),
        ({"MAV_GCS_SYSID": 255.0, "RC1_OPTION": 46.0}, "RC1_OPTION is 46: this transmitter switch disables overrides"),
        (
            {"MAV_GCS_SYSID": 255.0, "RC16_OPTION": 46.0},
            "RC16_OPTION is 46: this transmitter switch disables overrides",
        ),
        ({"MAV_GCS_SYSID": 255.0, "RC16_OPTION": 45.0, "MAV_OPTIONS": 3.0}, "RC_OPTIONS 0; MAV_OPTIONS bit 0 is set)"),
        ({"MAV_GCS_SYSID": 255.0, "MAV_OPTIONS": 2.0}, "RC_OPTIONS 0)"),
    ],
)
def test_the_reason_for_ignored_overrides_is_read_from_the_parameters(aboard: dict[str, float], words: str) -> None:
    parameters = SimpleNamespace(read_existing=lambda names: {n: aboard[n] for n in names if n in aboard})
    assert words in why_deaf(cast(Parameters, parameters), ROVER, 255)
