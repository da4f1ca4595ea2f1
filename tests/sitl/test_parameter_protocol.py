from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.firmware import FIRMWARE
from sitl.autopilot.parameters import ParameterStore, parse_table
from tests.sitl.ground import Ground, boat


def _ask_all(ground: Ground) -> list:
    ground.send(mavlink.MAVLink_param_request_list_message(1, 1))
    ground.run(1.0)
    return ground.all("PARAM_VALUE")


def _read(ground: Ground, name: str = "", index: int = -1) -> list:
    ground.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), index))
    return [m for m in ground.run(0.1) if m.get_type() == "PARAM_VALUE"]


def _write(ground: Ground, name: str, value: float) -> list:
    ground.set(name, value)
    return [m for m in ground.run(0.1) if m.get_type() == "PARAM_VALUE"]


@pytest.mark.parametrize("name", ["charlie", "videoray"])
def test_the_list_is_complete_counted_and_in_order(name):
    values = _ask_all(Ground(name))
    assert len(values) >= 120
    assert {m.param_count for m in values} == {len(values)}
    assert [m.param_index for m in values] == list(range(len(values)))
    names = [m.param_id for m in values]
    assert names == sorted(set(names))
    assert max(map(len, names)) <= 16


@pytest.mark.parametrize(("name", "firmware"), [("charlie", "ardurover"), ("falcon", "ardusub")])
def test_every_parameter_used_by_the_tuner_exists(name, firmware):
    known = {m.param_id for m in _ask_all(Ground(name))}
    profile = FIRMWARE[firmware]
    for axis in profile.axes.values():
        assert {gain.parameter for gain in axis.gains} <= known
        assert set(axis.context) <= known
    assert profile.gcs_id_parameters[0] in known
    assert profile.frame_parameter in known | {""}
    channels = {f"RC{n}_{key}" for n in range(1, 9) for key in ("MIN", "MAX", "TRIM", "DZ", "REVERSED")}
    servos = {f"SERVO{n}_{key}" for n in range(1, 9) for key in ("FUNCTION", "MIN", "MAX", "TRIM", "REVERSED")}
    assert channels | servos <= known


def test_a_parameter_is_read_by_name_or_index():
    ground = Ground("charlie")
    (by_name,) = _read(ground, "ATC_STR_ANG_P")
    (by_index,) = _read(ground, index=by_name.param_index)
    assert by_name.param_value == by_index.param_value == 2.0
    assert by_index.param_id == "ATC_STR_ANG_P"
    assert by_name.param_type == 9


@pytest.mark.parametrize(("name", "index"), [("NO_SUCH_PARAM", -1), ("", 30000), ("", -2)])
def test_reading_an_unknown_parameter_gets_no_reply(name, index):
    assert _read(Ground("charlie"), name, index) == []


def test_writing_an_unknown_parameter_gets_no_reply():
    assert _write(Ground("charlie"), "NO_SUCH_PARAM", 1.0) == []


def test_a_write_is_echoed_with_the_stored_single_precision_value():
    (echo,) = _write(Ground("charlie"), "ATC_STR_RAT_P", 0.33)
    assert echo.param_value == 0.33000001311302185
    assert echo.param_id == "ATC_STR_RAT_P"


def test_a_value_out_of_its_documented_range_is_accepted():
    ground = Ground("charlie")
    (echo,) = _write(ground, "ATC_STR_RAT_P", 99.0)
    assert echo.param_value == 99.0
    assert _read(ground, "ATC_STR_RAT_P")[0].param_value == 99.0


@pytest.mark.parametrize(
    ("name", "written", "stored"),
    [
        ("CRUISE_THROTTLE", 45.7, 45.0),
        ("CRUISE_THROTTLE", 44.995, 45.0),
        ("CRUISE_THROTTLE", 300.0, 127.0),
        ("CRUISE_THROTTLE", -200.0, -128.0),
        ("RC1_TRIM", -3.4, -3.0),
        ("RC1_TRIM", 1e9, 32767.0),
        ("ARMING_CHECK", 3e9, 2147483648.0),
    ],
)
def test_an_integer_parameter_is_stored_within_its_type(name, written, stored):
    (echo,) = _write(Ground("charlie"), name, written)
    assert echo.param_value == stored


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_nan_value_is_ignored(value):
    ground = Ground("charlie")
    assert _write(ground, "ATC_STR_RAT_P", value) == []
    assert _read(ground, "ATC_STR_RAT_P")[0].param_value == pytest.approx(0.2)


def test_a_write_to_a_read_only_parameter_is_rejected_and_echoes_its_old_value():
    ground = Ground("charlie")
    (echo,) = _write(ground, "SCHED_LOOP_RATE", 400.0)
    assert echo.param_value == 50.0
    assert "Param write denied (SCHED_LOOP_RATE)" in ground.texts()


def test_the_hash_follows_the_parameter_values():
    ground = Ground("charlie")

    def check() -> float:
        (value,) = _read(ground, "_HASH_CHECK")
        assert value.param_type == 5
        return value.param_value

    before = check()
    _write(ground, "ATC_STR_RAT_I", 0.3)
    assert check() != before
    _write(ground, "ATC_STR_RAT_I", 0.2)
    assert check() == before
    assert before == int(before)


def test_parameters_are_taken_from_any_system():
    ground = Ground("charlie", system=42)
    assert _write(ground, "ATC_STR_RAT_P", 0.5)[0].param_value == 0.5


def test_messages_to_another_vehicle_are_ignored():
    ground = Ground("charlie")
    ground.send(mavlink.MAVLink_param_set_message(7, 1, b"ATC_STR_RAT_P", 0.5, 9))
    ground.send(mavlink.MAVLink_param_set_message(1, 154, b"ATC_STR_RAT_P", 0.5, 9))
    assert [m for m in ground.run(0.2) if m.get_type() == "PARAM_VALUE"] == []


def test_a_new_system_id_takes_effect_at_once():
    ground = Ground("charlie")
    ground.set("MAV_SYSID", 9)
    ground.run(1.5)
    assert ground.last("HEARTBEAT").get_srcSystem() == 9


def test_a_written_gain_changes_the_motion():
    headings = []
    for gain in (0.5, 3.0):
        ground = boat(mode=15)
        ground.set("ATC_STR_RAT_FF", gain)
        ground.hold_heading(1.1)
        ground.run(8.0)
        headings.append(ground.vehicle.state.psi)
    assert headings[1] - headings[0] > 0.05


def test_a_parameter_set_before_boot_is_stored():
    assert _read(Ground("charlie", parameters={"WP_SPEED": 1.0}), "WP_SPEED")[0].param_value == 1.0


def test_a_table_line_gives_name_type_default_and_lock():
    store = ParameterStore(parse_table("B i8 2.6 ro  # comment\n\nA f32 0.1\n"))
    assert [store.name_at(k) for k in range(3)] == ["A", "B", None]
    assert (store["B"], store.kind_of("B")) == (2.0, 2)
