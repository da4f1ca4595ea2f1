"""Every parameter under every name it has had: values survive the round trip and have that firmware's unit."""

from __future__ import annotations

import struct
from typing import Any

import pytest

from gcs_autotune.firmware import ALIASES, FIRMWARE, Alias, Names, read_named
from gcs_autotune.link import MemoryLink, Parameters, Session, same_float32
from sitl import open_vehicle
from sitl.autopilot.parameter_dialect import GENERATIONS

SUB = FIRMWARE["ardusub"]
REQUIRED = {axis: [*(g.parameter for g in a.gains), *a.context] for axis, a in SUB.axes.items()}
LATER = {"SURFACE_MAX_THR"}
"""New in 4.7; older firmware has the value built in."""
PAIRS = [(name, alias) for name, aliases in ALIASES.items() for alias in aliases]


def aboard(generation: str, **options: Any) -> tuple[Any, Parameters]:
    server = open_vehicle("videoray", names=generation, **options)
    session = Session(MemoryLink(server))
    session.discover()
    return server.vehicle.parameters.values, Parameters(session)


@pytest.mark.parametrize(("name", "alias"), PAIRS, ids=[alias.name for _, alias in PAIRS])
def test_a_value_survives_the_round_trip_to_the_vehicle(name: str, alias: Alias) -> None:
    names = Names({name: alias})
    for value in (448.0, 64.0) if alias.inverted_bits else (0.0375, 2.02132, 3.0, 110000.0):
        own = names.to_own({name: value})
        wire = {n: struct.unpack("<f", struct.pack("<f", v))[0] for n, v in own.items()}
        assert list(wire) == [alias.name]
        assert same_float32(names.to_canonical(wire)[name], value)


@pytest.mark.parametrize(
    ("checks", "skipped"), [(0, -1), (1, 0), (448, 0x1FFFFE & ~448), (0x1FFFFE, 0)], ids=["none", "all", "some", "each"]
)
def test_arming_checks_to_run_become_checks_to_skip(checks: int, skipped: int) -> None:
    alias = ALIASES["ARMING_CHECK"][0]
    assert alias.to_own(checks) == skipped
    assert (alias.to_canonical(skipped) == 0.0) == (checks == 0)


def test_our_alias_table_agrees_with_the_simulator() -> None:
    words = GENERATIONS["4.7"]
    for name, alias in PAIRS:
        if name in words:
            assert alias.name == words[name].name
            assert alias.to_own(448.0) == pytest.approx(words[name].there(448.0))
    assert {n for n in words if n.startswith(("ATC_", "PILOT_"))} <= set(ALIASES)


@pytest.mark.parametrize("generation", GENERATIONS)
@pytest.mark.parametrize("axis", SUB.axes)
def test_every_gain_of_an_axis_has_the_name_of_its_firmware_generation(generation: str, axis: str) -> None:
    inside, parameters = aboard(generation, parameters={"MOT_THST_HOVER": 0.45})
    begun = parameters.session.clock.now()
    required = [n for n in REQUIRED[axis] if n not in LATER or generation not in ("4.5", "4.6")]
    names, own = read_named(parameters, required)
    assert names.to_canonical(own) == pytest.approx({n: inside[n] for n in required})
    assert parameters.session.clock.now() - begun < 1.0, "absent names must not cause a wait"
    for name in (g.parameter for g in SUB.axes[axis].gains):
        parameters.write(names.own(name), names.own_value(name, 0.37))
        assert inside[name] == pytest.approx(0.37, rel=1e-6)


def test_a_vehicle_between_two_releases_is_resolved_name_by_name() -> None:
    _, parameters = aboard("4.7-dev")
    names, _ = read_named(parameters, [*REQUIRED["depth"], *REQUIRED["heading"]])
    assert names.own("PSC_ACCZ_P") == "PSC_D_ACC_P"
    assert names.own("ATC_ACCEL_Y_MAX") == "ATC_ACCEL_Y_MAX"
    assert names.worded("raise PSC_ACCZ_P, not ATC_SLEW_YAW") == "raise PSC_D_ACC_P, not ATC_SLEW_YAW"


def test_the_range_of_a_gain_is_the_one_documented_for_its_current_name() -> None:
    _, parameters = aboard("4.7")
    names, _ = read_named(parameters, REQUIRED["depth"])
    old = {g.parameter: (g.low, g.high) for g in SUB.axes["depth"].gains}
    new = {g.parameter: (g.low, g.high) for g in SUB.axes["depth"].called(names).gains}
    assert old["PSC_ACCZ_P"] == (0.2, 1.5)
    assert new["PSC_ACCZ_P"] == pytest.approx((0.1, 2.5))


def test_a_parameter_the_vehicle_has_under_no_name_is_omitted() -> None:
    _, parameters = aboard("4.7")
    names, own = read_named(parameters, ["PSC_POSZ_P", "NO_SUCH_THING"])
    assert set(own) == {"PSC_D_POS_P"}
    assert names.own("NO_SUCH_THING") == "NO_SUCH_THING"


def test_parameters_new_in_4_7_do_not_exist_in_4_6() -> None:
    """The list comes from a running ArduSub 4.6.3, whose sticks have fixed channels."""
    _, parameters = aboard("4.6")
    later = ["RCMAP_PITCH", "RC_FS_TIMEOUT", "SURFACE_MAX_THR", "MAV_GCS_SYSID"]
    assert parameters.read_existing([*later, "SYSID_MYGCS"]) == {"SYSID_MYGCS": 255.0}
