"""Any parameter value is accepted on connection, or refused in one sentence with name and value."""

from __future__ import annotations

import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from scripted_vehicle import BOAT, ROV, ScriptedVehicle

from gcs_autotune.errors import AutotuneError, PreconditionFailed
from gcs_autotune.firmware import FIRMWARE, checked
from gcs_autotune.link import Journal, MemoryLink, Parameters, ParameterTransaction, Session
from gcs_autotune.link.vehicle.handshake import _read_config
from gcs_autotune.link.vehicle.vehicle_config import why_deaf
from gcs_autotune.workflow.autopilot_loop import learn_parameters
from gcs_autotune.workflow.preflight import check_throttle_is_free, remarks_on

BAD = [math.nan, -math.inf, -1.0, 0.0, 0.5, 256.0, 70000.0, 2.0**63]
GENERAL = {"MAV_GCS_SYSID_HI": 0.0, "MAV_OPTIONS": 0.0, "ARMING_CHECK": 1.0, "RC1_OPTION": 0.0, "INS_GYRO_FILTER": 4.0}
KINDS = {
    "ardurover": (BOAT, {"CRUISE_SPEED": 1.2, "MOT_THR_MAX": 100.0, "MANUAL_OPTIONS": 0.0}),
    "ardusub": (ROV, {"ACRO_YAW_P": 3.375, "JS_GAIN_DEFAULT": 0.5, "MAV_GCS_SYSID": 255.0}),
}
LIKE_OTHERS = re.compile(
    r"(RC|SERVO)[5-8]_.*|MOT_[3-8]_.*|(RC2|RC4|SERVO2|SERVO4)_(MIN|MAX|DZ|REVERSED|TRIM)|SERVO\d_MIN"
)
"""Parameters that are read exactly as a similar one is, or not at all; they are not varied."""


def vehicle_of(firmware: str) -> ScriptedVehicle:
    """Return a vehicle with every parameter that the tool reads, each with a plausible value."""
    kind, own = KINDS[firmware]
    vehicle = ScriptedVehicle(kind)
    axes = FIRMWARE[firmware].axes.values()
    for axis in axes:
        vehicle.parameters |= {name: 0.5 for name in axis.context if name not in vehicle.parameters}
        vehicle.parameters |= {g.parameter: 0.5 * (g.low + g.high) for g in axis.gains}
    vehicle.parameters |= GENERAL | own
    return vehicle


class Aboard:
    """Everything that is read from a vehicle between connection and announcement, over one session."""

    def __init__(self, name: str) -> None:
        self.firmware, self.vehicle = FIRMWARE[name], vehicle_of(name)
        self.session = Session(MemoryLink(self.vehicle))
        self.session.discover()
        self.parameters = Parameters(self.session)
        self.own = dict(self.vehicle.parameters)

    def read(self) -> None:
        parameters, tale = self.parameters, SimpleNamespace(say=lambda _: None)
        craft: Any = SimpleNamespace(parameters=parameters, session=self.session, firmware=self.firmware)
        _read_config(self.session, parameters, self.firmware)
        for axis in self.firmware.axes.values():
            learned, own = learn_parameters(craft, axis, tale)  # type: ignore[arg-type]
            learned.names.to_canonical(own)
        check_throttle_is_free(craft, "surge", 0.5)
        remarks_on(craft)

    def refusal(self, name: str, value: float) -> str:
        """Return the refusal when *name* has that *value*; empty when it is accepted."""
        self.vehicle.parameters = {**self.own, name: value}
        obeyed = self.own.get("MAV_GCS_SYSID", 255.0)
        self.session.port.system = int(obeyed)
        try:
            self.read()
            if name.endswith(("SYSID", "SYSID_HI", "MYGCS", "OPTIONS", "OPTION", "RC_OVERRIDE_TIME")):
                why_deaf(self.parameters, self.firmware, 255)
        except AutotuneError as error:
            return str(error)
        return ""


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(KINDS))
def test_no_value_of_any_parameter_ends_in_a_foreign_exception(name: str) -> None:
    aboard = Aboard(name)
    assert aboard.refusal("RC_OPTIONS", aboard.own["RC_OPTIONS"]) == ""
    requested = {str(m.param_id) for m in aboard.vehicle.heard if m.get_type() == "PARAM_REQUEST_READ"}
    cases = [(parameter, value) for parameter in aboard.own for value in BAD if not LIKE_OTHERS.fullmatch(parameter)]
    refusals = {case: aboard.refusal(*case) for case in cases}
    assert len(refusals) > 300
    silent = {parameter for (parameter, value), words in refusals.items() if math.isnan(value) and not words}
    assert not silent & requested
    assert not [case for case, words in refusals.items() if "\n" in words]
    nans = [
        words.startswith(f"{parameter} is nan, not a number")
        for (parameter, value), words in refusals.items()
        if words and math.isnan(value)
    ]
    assert len(nans) >= 20 and all(nans)


def test_a_refusal_contains_name_value_and_plausible_range() -> None:
    with pytest.raises(PreconditionFailed, match=r"^RC1_TRIM is nan, not a number\. Correct .*try again$"):
        checked("RC1_TRIM", math.nan)
    with pytest.raises(PreconditionFailed, match=r"^MAV_GCS_SYSID is 70000, outside the plausible range 1 to 255"):
        checked("MAV_GCS_SYSID", 70000.0)
    with pytest.raises(PreconditionFailed, match=r"^SERVO1_FUNCTION is 26.5, not a whole number"):
        checked("SERVO1_FUNCTION", 26.5)
    with pytest.raises(PreconditionFailed, match=r"^STAT_RUNTIME is inf"):
        checked("STAT_RUNTIME", math.inf)


def test_a_nan_parameter_is_not_borrowed_and_can_be_corrected(tmp_path: Path) -> None:
    aboard = Aboard("ardurover")
    aboard.vehicle.parameters["ATC_STR_RAT_P"] = math.nan
    journal = Journal(tmp_path / "journal.jsonl")
    with pytest.raises(PreconditionFailed, match="ATC_STR_RAT_P is nan"):
        ParameterTransaction(aboard.parameters, journal).lend(["ATC_STR_RAT_P"])
    journal.leave()
    assert math.isnan(aboard.parameters.read_confirmed(["ATC_STR_RAT_P"])["ATC_STR_RAT_P"])
    aboard.parameters.write("ATC_STR_RAT_P", 0.2)
    assert aboard.vehicle.parameters["ATC_STR_RAT_P"] == pytest.approx(0.2)


def test_a_watched_parameter_that_becomes_nan_is_an_intrusion() -> None:
    aboard = Aboard("ardurover")
    aboard.parameters.watch({"WP_SPEED": 2.0})
    aboard.vehicle.parameters["WP_SPEED"] = math.nan
    requested = aboard.vehicle.count("PARAM_REQUEST_READ")
    aboard.vehicle.send_parameter("WP_SPEED")
    aboard.session.pause(2.0)
    assert [name for name, _, _ in aboard.parameters.intrusions] == ["WP_SPEED"]
    assert aboard.vehicle.count("PARAM_REQUEST_READ") == requested + 1
