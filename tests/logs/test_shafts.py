"""Shaft speeds of a log as inputs in place of the commands."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from log_writing import BOAT, SKID, mavlink

from gcs_autotune.errors import UsageError
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.logs.channels import drive_channels
from gcs_autotune.logs.dataflash import signals_of
from gcs_autotune.logs.files import load_runs
from gcs_autotune.logs.mavlink_decoder import SIGNALS
from gcs_autotune.logs.sample_store import SampleStore

FULL, DT = 40.0, 0.05


def _logged(lag: float, *, by_speed: bool, weak: float = 1.0, squared: bool = False, numbers=(1, 2)) -> SampleStore:
    """A boat with two thrusters whose shafts lag by *lag* [s], and whose second is *weak*; ESCs report no direction."""
    store = SampleStore("log", "its own", firmware=FIRMWARE["ardurover"], by_speed=by_speed)
    store.parameters = dict(SKID)
    n = [0.0, 0.0]
    for k in range(600):
        t = k * DT
        ahead, side = 0.3 * (1.0 + math.sin(0.3 * t)), 0.4 * (1.0 if math.sin(0.8 * t) > 0.0 else -1.0)
        shares = [ahead + side, (ahead - side)]
        store.take(t, {f"servo.{c}": 1500.0 + 400.0 * share for c, share in zip((1, 3), shares, strict=True)})
        for i, share in enumerate(shares):
            goal = math.copysign(math.sqrt(abs(share)) if squared else abs(share), share) * FULL * (weak if i else 1.0)
            n[i] = goal if lag == 0.0 else goal + math.exp(-DT / lag) * (n[i] - goal)
        store.take(t + 0.001, {f"esc.{number}": abs(speed) for number, speed in zip(numbers, n, strict=True)})
    return store


@pytest.mark.parametrize("numbers", [(1, 2), (1, 3)])
def test_the_thrust_of_a_measured_speed_is_that_of_the_command_with_a_quick_motor(numbers: tuple[int, int]) -> None:
    commanded, _, doubts = drive_channels(_logged(0.0, by_speed=False, squared=True, numbers=numbers))
    measured, origin, _ = drive_channels(_logged(0.0, by_speed=True, squared=True, numbers=numbers))
    assert (origin, doubts) == ("shaft speeds", [])
    for name in "XN":
        there = np.interp(measured[name].t[5:], commanded[name].t, commanded[name].values)
        assert np.median(np.abs(measured[name].values[5:] - there)) < 1e-3


def test_a_speed_proportional_to_the_command_is_a_thrust_proportional_to_its_square() -> None:
    measured, _, _ = drive_channels(_logged(0.0, by_speed=True))
    left = measured["X"].values + measured["N"].values
    commanded, _, _ = drive_channels(_logged(0.0, by_speed=False))
    share = np.interp(measured["X"].t, commanded["X"].t, commanded["X"].values + commanded["N"].values)
    assert np.median(np.abs(left - share * np.abs(share))) < 0.01


def test_a_slow_motor_is_reported_and_its_reversal_has_the_right_direction() -> None:
    _, _, doubts = drive_channels(_logged(0.5, by_speed=False, squared=True))
    assert [code for code, *_ in doubts] == ["shafts-lag"]
    assert float(doubts[0][1].split()[-2]) == pytest.approx(0.5, abs=0.11)
    quick, slow = (drive_channels(_logged(lag, by_speed=True, squared=True))[0]["N"] for lag in (0.0, 0.5))
    assert slow.values.max() == pytest.approx(quick.values.max(), rel=0.1)
    assert float(np.max(np.abs(np.diff(slow.values)))) < 0.2  # the thrust passes zero without a jump


def test_shaft_speeds_that_do_not_follow_the_commands_raise_a_doubt() -> None:
    store = SampleStore("log", "its own", firmware=FIRMWARE["ardurover"], parameters=dict(SKID))
    t = np.arange(0.0, 30.0, DT)
    store.take_all(t, {"servo.1": 1500.0 + 200.0 * np.sin(t), "servo.3": 1500.0 - 200.0 * np.sin(t)})
    store.take_all(t, {"esc.1": 20.0 + 15.0 * np.sin(2.0 * t), "esc.2": 20.0 + 15.0 * np.cos(3.0 * t)})
    ((code, text, _),) = drive_channels(store)[2]
    assert code == "shafts-disagree"
    assert "differ from the commands by" in text


@pytest.mark.parametrize("parameters", [BOAT, SKID])
def test_without_speeds_or_with_a_rudder_the_option_is_rejected(parameters: dict[str, float]) -> None:
    store = _logged(0.0, by_speed=True, numbers=(1, 2) if parameters is BOAT else (7, 8))
    store.parameters = dict(parameters)
    if parameters is SKID:
        store = SampleStore("log", "its own", firmware=store.firmware, parameters=dict(SKID), by_speed=True)
        for k in range(30):
            store.take(0.1 * k, {"servo.1": 1500.0 + k, "servo.3": 1500.0})
    with pytest.raises(UsageError, match="does not contain the speed of each thruster"):
        drive_channels(store)


def test_every_message_of_an_esc_is_read_in_turns_per_second() -> None:
    telemetry = mavlink.MAVLink_esc_telemetry_5_to_8_message(
        [0] * 4, [0] * 4, [0] * 4, [0] * 4, [60, 120, 0, 0], [0] * 4
    )
    assert SIGNALS["ESC_TELEMETRY_5_TO_8"](telemetry) == {"esc.5": 1.0, "esc.6": 2.0, "esc.7": 0.0, "esc.8": 0.0}
    assert SIGNALS["RPM"](mavlink.MAVLink_rpm_message(-600.0, 30.0)) == {"rpm.1": -10.0, "rpm.2": 0.5}
    found = signals_of("ESC", {"Instance": np.array([0.0, 1.0, 0.0]), "RPM": np.array([60.0, 120.0, 180.0])})
    assert found["esc.1"][[0, 2]].tolist() == [1.0, 3.0]
    assert found["esc.2"][1] == 2.0
    assert np.isnan(found["esc.1"][1])


def test_a_table_of_columns_has_no_shaft_speeds(tmp_path: Path) -> None:
    file = tmp_path / "run.csv"
    file.write_text("t[s],psi[rad],N\n" + "".join(f"{0.1 * k},{k},1\n" for k in range(40)), encoding="utf-8")
    with pytest.raises(UsageError, match="is not a log with ESC messages"):
        load_runs(file, by_speed=True)
    with pytest.raises(UsageError, match="contains tables of runs"):
        load_runs(tmp_path, by_speed=True)
