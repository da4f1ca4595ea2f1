"""The vehicle of a journal is identified by its type, board or calibration."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import pytest

from gcs_autotune.link import Parameters, difference, fingerprint_of
from gcs_autotune.link.vehicle.handshake import FINGERPRINT
from gcs_autotune.mavlink import VehicleIdentity

HERE = VehicleIdentity(system=1, component=1, autopilot=3, vehicle_type=11, firmware="ArduRover", uid="c0ffee")
PRINT = {"INS_ACCOFFS_X": 0.012, "COMPASS_DEV_ID": 97539.0}


class FakeParameters:
    def __init__(self, values: dict[str, float], vehicle: VehicleIdentity | None = HERE) -> None:
        self.values = values
        self.session = SimpleNamespace(vehicle=vehicle)

    def read_existing(self, names: Iterable[str], *, as_is: bool = False) -> dict[str, float]:
        return {n: self.values[n] for n in names if n in self.values}


def having(values: dict[str, float], vehicle: VehicleIdentity | None = HERE) -> Parameters:
    return cast(Parameters, FakeParameters(values, vehicle))


def test_the_same_board_is_the_same_vehicle_whatever_its_parameters() -> None:
    assert difference(HERE.to_dict(), PRINT, HERE, having({})) == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"system": 7}, "system 7 there, 1 here"),
        ({"autopilot": 12}, "autopilot 12 there, 3 here"),
        ({"vehicle_type": 12}, "vehicle_type 12 there, 11 here"),
        ({"uid": "beef"}, "its board is beef there, c0ffee here"),
    ],
)
def test_another_system_type_or_board_is_another_vehicle(change: dict[str, object], words: str) -> None:
    assert difference({**HERE.to_dict(), **change}, {}, HERE, having({})) == words


def test_a_board_without_an_id_is_not_taken_for_one_with_an_id() -> None:
    mute = replace(HERE, uid="")
    assert difference(HERE.to_dict(), PRINT, mute, having(PRINT)) == "its board is c0ffee there, unknown here"


def test_a_vehicle_without_an_id_is_identified_by_its_calibration() -> None:
    """Its journal contains the fingerprint; the vehicle here may report an id by now."""
    known = {**HERE.to_dict(), "uid": ""}
    assert difference(known, PRINT, HERE, having(dict(PRINT))) == ""
    other = {**PRINT, "INS_ACCOFFS_X": 0.013}
    assert difference(known, PRINT, HERE, having(other)) == "INS_ACCOFFS_X 0.012 there, 0.013 here"


def test_a_missing_fingerprint_parameter_is_a_difference() -> None:
    known = {**HERE.to_dict(), "uid": ""}
    assert difference(known, PRINT, HERE, having({"INS_ACCOFFS_X": 0.012})) == "COMPASS_DEV_ID does not exist here"
    found = difference(known, PRINT, HERE, having({"INS_ACCOFFS_X": -0.5}))
    assert found == "INS_ACCOFFS_X 0.012 there, -0.5 here; COMPASS_DEV_ID does not exist here"


def test_a_value_rounded_to_float32_is_the_same() -> None:
    known = {**HERE.to_dict(), "uid": ""}
    assert difference(known, {"INS_ACCOFFS_X": 0.1}, HERE, having({"INS_ACCOFFS_X": 0.10000000149011612})) == ""


def test_an_older_journal_with_fewer_entries_makes_no_difference() -> None:
    assert difference({}, {}, HERE, having({})) == ""
    assert difference({"system": None, "vehicle_type": 11}, {}, HERE, having({})) == ""


@pytest.mark.parametrize("vehicle", [replace(HERE, uid=""), None])
def test_calibration_is_read_only_from_a_board_without_an_id(vehicle: VehicleIdentity | None) -> None:
    values = {**PRINT, "ATC_STR_RAT_P": 0.2}
    assert fingerprint_of(having(values, vehicle)) == PRINT
    assert fingerprint_of(having(values, HERE)) == {}


def test_tuned_parameters_are_not_in_the_fingerprint() -> None:
    assert not {n for n in FINGERPRINT if n.startswith(("ATC_", "PSC_", "WP_"))}
