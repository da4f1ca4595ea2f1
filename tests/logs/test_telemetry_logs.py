"""Telemetry logs: messages of one vehicle become runs for identification; everything else is reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from log_writing import ALPHA, BETA, BOAT, BOOT, SKID, Tlog, beats, heartbeat, parameters, sail, servos, swing
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.cli import main
from gcs_autotune.errors import BadFile, NotInformative, UsageError
from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.logs import load_runs
from gcs_autotune.trial import Trial

REAL = Path(__file__).parents[2] / "../shared/data/ardusub_logs"
needs_real_logs = pytest.mark.skipif(not REAL.is_dir(), reason="the shared data folder is not beside this checkout")


def plain(seconds: float = 40.0) -> Tlog:
    log = Tlog()
    parameters(log, BOAT)
    beats(log, 0.0, seconds, armed=True)
    sail(log, swing(seconds))
    return log


def is_right(found: AxisFit) -> bool:
    pairs = ((found.parameters["alpha_r"], ALPHA), (found.parameters["beta_r"], BETA))
    return all(abs(p.value - truth) < 4.0 * p.std < 0.1 * truth for p, truth in pairs)


def slugs(trial: Trial) -> set[str]:
    return {note[0] for note in trial.meta["notes"]}


def test_a_log_becomes_a_run_with_the_vehicles_own_stamps_and_si_units(tmp_path: Path) -> None:
    (run,) = load_runs(plain().write(tmp_path / "dive.tlog"))
    assert run.name == "dive#1 MANUAL 0-40 s"
    assert run.meta["clock"] == "vehicle (time_boot_ms)"
    assert run["psi"].t[0] == pytest.approx(BOOT, abs=1.1)
    assert (run["N"].unit, run["psi"].unit, run["servo1"].unit) == ("1", "rad", "pwm")
    assert set(run["N"].values) == {-0.4, 0.4}
    assert set(run["X"].values) == {0.25}
    assert is_right(fit_axis(run, dof="yaw", structure="linear"))


def test_the_command_line_identifies_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = plain().write(tmp_path / "dive.tlog")
    assert main(["identify", str(path), "--dof", "yaw", "--no-check", "--no-page"]) == 0
    assert "alpha_r" in capsys.readouterr().out


@pytest.mark.slow
def test_only_armed_and_driven_segments_become_runs_one_per_mode(tmp_path: Path) -> None:
    log = Tlog()
    parameters(log, BOAT)
    sail(log, swing(90.0))
    for start, end, armed, mode in ((0, 10, False, 0), (10, 40, True, 0), (40, 70, True, 15), (70, 90, False, 15)):
        beats(log, start, end, armed=armed, mode=mode)
    path = log.write(tmp_path / "dive.tlog")
    assert [r.name for r in load_runs(path)] == ["dive#1 MANUAL 10-40 s", "dive#2 GUIDED 40-70 s"]
    assert [r.name for r in load_runs(path, pick=[2])] == ["dive#2 GUIDED 40-70 s"]
    assert [m.kind for m in load_runs(path)[1].marks] == ["mode", "disarmed"]
    with pytest.raises(UsageError, match=r"no segment 7.*dive#1"):
        load_runs(path, pick=[7])
    assert is_right(fit_axis(load_runs(path), dof="yaw", structure="linear"))


def test_vehicles_are_never_mixed(tmp_path: Path) -> None:
    log = plain()
    parameters(log, BOAT, system=7)
    beats(log, 0.5, 20.0, system=7, armed=True)
    sail(log, {k: v if k == "t" else -3.0 * v for k, v in swing(20.0).items()}, system=7, start=0.01)
    for t in np.arange(0.0, 40.0, 1.0):
        log.heard(float(t), heartbeat(armed=True, kind=6, autopilot=8), 255, 190)
        log.heard(float(t), mavlink.MAVLink_attitude_message(5, 0.0, 0.0, 9.9, 0.0, 0.0, 9.9), 1, 100)
    path = log.write(tmp_path / "two.tlog")
    (run,) = load_runs(path)
    assert run.meta["system"] == 1
    assert "several-vehicles" in slugs(run)
    assert float(np.max(np.abs(run["psi"].values))) < 1.0
    assert is_right(fit_axis(run, dof="yaw", structure="linear"))
    assert load_runs(path, system=7)[0].meta["system"] == 7
    with pytest.raises(UsageError, match=r"system id 9\. It contains 1, 7"):
        load_runs(path, system=9)


def test_damage_is_skipped_counted_and_reported_as_a_doubt(tmp_path: Path) -> None:
    def spoil(pieces: list[bytes]) -> list[bytes]:
        rng = np.random.default_rng(1)
        hit = {int(i) for i in rng.integers(60, len(pieces), 60)}
        return [p[:-3] + b"\x00\xff\x00" if i in hit else p for i, p in enumerate(pieces)]

    (run,) = load_runs(plain().write(tmp_path / "bad.tlog", spoil))
    found = fit_axis(run, dof="yaw", structure="linear")
    assert run.meta["damaged"] > 30
    assert any(d.slug == "damaged-log" and str(run.meta["damaged"]) in d.cause for d in found.doubts)
    assert found.parameters["alpha_r"].value == pytest.approx(ALPHA, rel=0.05)


@pytest.mark.parametrize("share", [0.3, 0.71, 0.999])
def test_a_truncated_log_is_read_up_to_its_end(tmp_path: Path, share: float) -> None:
    whole = plain().write(tmp_path / "whole.tlog").read_bytes()
    (tmp_path / "cut.tlog").write_bytes(whole[: int(share * len(whole))])
    (run,) = load_runs(tmp_path / "cut.tlog")
    assert run.duration == pytest.approx(40.0 * share, abs=1.5)


def test_a_reboot_splits_the_log(tmp_path: Path) -> None:
    log = plain(30.0)
    again = Tlog()
    sail(again, swing(30.0, seed=1))
    beats(again, 0.0, 30.0, armed=True)
    log.frames += [(t + 60.0, frame) for t, frame in again.frames]
    first, second = load_runs(log.write(tmp_path / "reboot.tlog"))
    assert second["psi"].t[0] < first["psi"].t[-1]
    assert is_right(fit_axis([first, second], dof="yaw", structure="linear"))


def test_skid_steering_gives_surge_and_yaw(tmp_path: Path) -> None:
    log = Tlog()
    parameters(log, SKID)
    beats(log, 0.0, 40.0, armed=True)
    sail(log, swing(40.0), pwms=lambda N: (1500 + round(400 * (0.5 + N)), 0, 1500 + round(400 * (0.5 - N))))
    (run,) = load_runs(log.write(tmp_path / "skid.tlog"))
    assert np.allclose(np.unique(run["X"].values), 0.5)
    assert np.allclose(np.unique(run["N"].values), [-0.4, 0.4])


def test_a_vectored_rov_is_unmixed_by_its_frame(tmp_path: Path) -> None:
    log = Tlog()
    parameters(log, {"FRAME_CONFIG": 2, **{f"SERVO{n}_FUNCTION": 32 + n for n in range(1, 9)}})
    beats(log, 0.0, 40.0, armed=True, mode=19, kind=12)
    signs = (1, -1, -1, 1)
    sail(log, swing(40.0), pwms=lambda N: (*(1500 + round(400 * s * N) for s in signs), 1540, 1540, 1540, 1540))
    (run,) = load_runs(log.write(tmp_path / "rov.tlog"))
    assert run.name == "rov#1 MANUAL 0-40 s"
    assert np.allclose(np.unique(run["N"].values), [-0.4, 0.4])
    assert np.allclose(run["Z"].values, 0.1)
    assert np.allclose(run["X"].values, 0.0)
    assert is_right(fit_axis(run, dof="yaw", structure="linear"))


def test_without_parameters_the_sticks_are_used_with_a_doubt(tmp_path: Path) -> None:
    log = Tlog()
    beats(log, 0.0, 40.0, armed=True, mode=19, kind=12)
    motion = swing(40.0)
    sail(log, motion, outputs=False)
    for t, N in zip(motion["t"], motion["N"], strict=True):
        log.heard(float(t), mavlink.MAVLink_manual_control_message(1, 0, 0, 500, round(1000 * N), 0), 255, 190)
    (run,) = load_runs(log.write(tmp_path / "sticks.tlog"))
    assert run.meta["input_from"] == "the pilot's sticks"
    found = fit_axis(run, dof="yaw", structure="linear")
    assert any(d.slug == "input-is-command" for d in found.doubts)
    assert found.parameters["alpha_r"].value == pytest.approx(ALPHA, rel=0.05)


def test_a_log_without_inputs_is_rejected_with_what_to_record(tmp_path: Path) -> None:
    log = Tlog()
    beats(log, 0.0, 40.0, armed=True)
    sail(log, swing(40.0), outputs=False)
    with pytest.raises(NotInformative, match="SERVO"):
        load_runs(log.write(tmp_path / "mute.tlog"))


def test_a_log_without_vehicle_clock_is_dated_by_the_ground_station(tmp_path: Path) -> None:
    log = Tlog()
    parameters(log, BOAT)
    beats(log, 0.0, 40.0, armed=True)
    for t in np.arange(0.0, 40.0, 0.25):
        log.heard(float(t), mavlink.MAVLink_vfr_hud_message(0.0, 1.0 + 0.1 * np.sin(t), 0, 0, 0.0, 0.0))
        log.heard(float(t), servos(float(t), 1500 + 100 * (int(t) % 2), 0, 1600))
    (run,) = load_runs(log.write(tmp_path / "ground.tlog"))
    assert run.meta["clock"] == "ground station"
    assert run["U"].t[1] - run["U"].t[0] == pytest.approx(0.25, abs=1e-4)


def test_velocity_over_ground_is_rotated_into_the_body_frame(tmp_path: Path) -> None:
    log = plain()
    motion = swing(40.0)
    for t, psi in zip(motion["t"], motion["psi"], strict=True):
        north, east = 1.5 * np.cos(psi) - 0.2 * np.sin(psi), 1.5 * np.sin(psi) + 0.2 * np.cos(psi)
        ms = round((BOOT + float(t)) * 1e3)
        log.heard(float(t), mavlink.MAVLink_local_position_ned_message(ms, float(t), 2.0, 0.5, north, east, 0.0))
    (run,) = load_runs(log.write(tmp_path / "local.tlog"))
    assert np.allclose(run["u"].values, 1.5, atol=1e-3)
    assert np.allclose(run["v"].values, 0.2, atol=1e-3)
    assert run.meta["sources"]["x"] == "local"


@pytest.mark.parametrize("text", [b"\x00" * 300, b"not a log at all, but long enough to be looked at twice", b""])
def test_a_file_that_is_not_a_log_is_a_bad_file(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "x.tlog").write_bytes(text)
    with pytest.raises(BadFile):
        load_runs(tmp_path / "x.tlog")


def test_a_log_without_an_autopilot_heartbeat_is_rejected(tmp_path: Path) -> None:
    log = Tlog()
    log.heard(0.0, heartbeat(armed=False, kind=6, autopilot=8), 255, 190)
    with pytest.raises(BadFile, match="no autopilot's HEARTBEAT"):
        load_runs(log.write(tmp_path / "lonely.tlog"))


@pytest.mark.slow
@needs_real_logs
def test_a_real_log_that_was_never_armed_is_reported_as_such() -> None:
    with pytest.raises(NotInformative, match=r"316 s of ArduSub .* never armed"):
        load_runs(REAL / "2023-04-18_11-03-34.tlog")


@pytest.mark.slow
@needs_real_logs
def test_a_real_rov_at_rest_is_read_and_not_identified() -> None:
    (run,) = load_runs(REAL / "small.tlog")
    assert run.name == "small#1 MANUAL 207-223 s"
    assert (run.meta["damaged"], run.meta["input_from"]) == (4, "servo outputs")
    assert "little-excitation" in slugs(run)
    assert [float(np.max(np.abs(run[n].values))) for n in "XZN"] == pytest.approx([0.5, 0.5, 0.0925], abs=1e-3)
    for dof in ("yaw", "heave"):
        with pytest.raises(NotInformative, match="larger inputs"):
            fit_axis(run, dof=dof)
