"""One time axis for a log: two counters of one boot, messages without stamps, uneven arrival, silence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from log_writing import BOAT, Tlog, attitude, beats, heartbeat, parameters, sail, swing
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.logs import load_runs, record


def test_microseconds_that_wrap_after_71_minutes_stay_aligned_with_milliseconds(tmp_path: Path) -> None:
    log = Tlog()
    parameters(log, BOAT)
    beats(log, 0.0, 40.0, armed=True)
    wrap = 2**32 * 1e-6 - 20.02
    for i in range(800):
        t = 0.05 * i
        log.heard(
            t, mavlink.MAVLink_attitude_message(round((wrap + t) * 1e3), 0, 0, 0.3 * np.sin(t), 0, 0, 0.3 * np.cos(t))
        )
        us = round((wrap + t) * 1e6) % 2**32
        log.heard(
            t, mavlink.MAVLink_servo_output_raw_message(us, 0, 1500 + 100 * (i // 40 % 2), 0, 1600, 0, 0, 0, 0, 0)
        )
    (run,) = load_runs(log.write(tmp_path / "long.tlog"))
    assert run["servo1"].t[0] == pytest.approx(run["psi"].t[0], abs=2e-3)
    assert np.allclose(np.diff(run["servo1"].t), 0.05, atol=1e-5)


def test_uneven_stamps_of_the_vehicle_are_unchanged(tmp_path: Path) -> None:
    """40 Hz of ArduRover come as 20 and 40 ms by turns; the ground hears them later, and jittered."""
    log = Tlog()
    parameters(log, BOAT)
    beats(log, 0.0, 30.0, armed=True)
    stamps = np.cumsum([0.02 if i % 2 else 0.04 for i in range(900)])
    late = np.random.default_rng(3).uniform(0.0, 0.15, len(stamps))
    for t, more in zip(stamps, np.maximum.accumulate(stamps + late), strict=True):
        log.heard(float(more), attitude(float(t), 0.2 * np.sin(float(t)), 0.2 * np.cos(float(t))))
        log.heard(float(more), mavlink.MAVLink_servo_output_raw_message(
            round((100.0 + t) * 1e6), 0, 1500 + 100 * (int(t) % 2), 0, 1600, 0, 0, 0, 0, 0))  # fmt: skip
    (run,) = load_runs(log.write(tmp_path / "uneven.tlog"))
    assert set(np.round(np.diff(run["psi"].t), 3)) == {0.02, 0.04}


def test_sources_without_stamps_are_listed(tmp_path: Path) -> None:
    log = Tlog()
    parameters(log, BOAT)
    beats(log, 0.0, 20.0, armed=True)
    sail(log, swing(20.0))
    for i in range(100):
        log.heard(0.2 * i, mavlink.MAVLink_vfr_hud_message(0.0, 1.0 + 0.01 * i, 0, 0, 0.0, 0.0))
    (run,) = load_runs(log.write(tmp_path / "hud.tlog"))
    assert run.meta["dated_by_arrival"] == ["hud"]
    assert run.meta["sources"]["U"] == "hud"


def test_a_long_gap_splits_a_run_and_a_short_one_does_not(tmp_path: Path) -> None:
    log = Tlog()
    parameters(log, BOAT)
    beats(log, 0.0, 60.0, armed=True)
    motion = swing(60.0)
    for gap, runs in (((20.0, 22.0), 1), ((20.0, 30.0), 2)):
        heard = Tlog()
        heard.frames = list(log.frames)
        keep = (motion["t"] < gap[0]) | (motion["t"] > gap[1])
        sail(heard, {k: v[keep] for k, v in motion.items()})
        assert len(load_runs(heard.write(tmp_path / f"{runs}.tlog"))) == runs


def test_arming_is_dated_by_the_status_text_before_the_next_heartbeat(tmp_path: Path) -> None:
    log = Tlog()
    parameters(log, BOAT)
    sail(log, swing(30.0))
    log.heard(0.0, heartbeat(armed=False))
    log.heard(5.2, mavlink.MAVLink_statustext_message(6, b"Throttle armed"))
    beats(log, 6.0, 20.0, armed=True)
    log.heard(20.3, mavlink.MAVLink_statustext_message(6, b"Throttle disarmed"))
    beats(log, 21.0, 30.0, armed=False)
    (run,) = load_runs(log.write(tmp_path / "armed.tlog"))
    assert (run.start, run.end) == pytest.approx((105.2, 120.3), abs=0.1)


def test_the_simulators_truth_is_listed_and_never_read(tmp_path: Path) -> None:
    log = Tlog()
    parameters(log, BOAT)
    beats(log, 0.0, 20.0, armed=True)
    motion = swing(20.0)
    sail(log, motion)
    for t in motion["t"]:
        log.heard(float(t), mavlink.MAVLink_simstate_message(0, 0, 3.0, 0, 0, 0, 0, 0, 9.0, 0, 0))
    found = record(log.write(tmp_path / "sim.tlog"))
    assert found is not None
    assert "SIMSTATE" in found.census.seen
    assert float(np.max(np.abs(found.stores[0].series("attitude.psi")[1]))) < 1.0


def test_the_second_estimate_replaces_a_missing_first_one(tmp_path: Path) -> None:
    log = Tlog()
    parameters(log, BOAT)
    beats(log, 0.0, 20.0, armed=True)
    motion = swing(20.0)
    for t, psi, N in zip(motion["t"], motion["psi"], motion["N"], strict=True):
        log.heard(float(t), mavlink.MAVLink_system_time_message(0, round((100.0 + t) * 1e3)))
        log.heard(float(t), mavlink.MAVLink_ahrs2_message(0.0, 0.0, psi, 0.0, 0, 0))
        log.heard(float(t), mavlink.MAVLink_servo_output_raw_message(
            round((100.0 + t) * 1e6), 0, 1500 + round(400 * N), 0, 1600, 0, 0, 0, 0, 0))  # fmt: skip
    (run,) = load_runs(log.write(tmp_path / "second.tlog"))
    assert run.meta["sources"]["psi"] == "ahrs2"
    assert "ahrs2" in run.meta["dated_by_arrival"]
