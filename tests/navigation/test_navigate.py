"""The navigation solution of simulated logs compared with the truth, and rejected logs."""

from __future__ import annotations

import functools
import json
import math
import re
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from navigation_logs import log
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.cli import main
from gcs_autotune.identify import fit
from gcs_autotune.logs import load_runs
from gcs_autotune.navigation import Mounting, Navigation, navigate, readings_of, store_of
from gcs_autotune.trial import Channel, Trial, save_trial

BOAT, ROV = ("tugboat", ("gps", "compass")), ("bluerov2-6dof", ("dvl", "compass", "depth"))
HERE = Path("log.csv")


def solved(craft: tuple[str, tuple[str, ...]], seed: int, seconds: float = 60.0):
    """Return (solution, hidden constants, true signals at its stamps)."""
    run, result, true = log(craft[0], seed, seconds, craft[1])
    solution = navigate(readings_of(store_of(run, HERE), HERE), Mounting(tuple(result["centre"])))[0]
    columns = np.hstack([true.at, true.angles, true.velocity, true.rates]).T
    there = {n: np.interp(solution.t, true.t, c) for n, c in zip(solution.values, columns, strict=True)}
    return solution, result, there


@functools.cache
def boat():
    return solved(BOAT, 3)


def off(solution: Navigation, result: dict) -> dict[str, float]:
    """Return constant -> error in standard errors."""
    found = {}
    for name, own in solution.constants.items():
        stem, _, axis = name.rpartition(" ")
        truth = result[stem]["xyzpqr".index(axis) % 3] if stem in result else result[name]
        found[name] = (own.value - truth) / own.std
    return found


def errors(solution: Navigation, there: dict) -> dict[str, np.ndarray]:
    found = {n: solution.values[n] - there[n] for n in there}
    return {n: (e + np.pi) % (2.0 * np.pi) - np.pi if n == "psi" else e for n, e in found.items()}


@pytest.mark.parametrize("craft", [BOAT, ROV], ids=["boat", "rov"])
def test_hidden_biases_lever_arms_and_delays_are_identified(craft):
    solution, result, _ = boat() if craft is BOAT else solved(craft, 1)
    z = off(solution, result)
    assert max(abs(v) for v in z.values()) < 3.5, z
    known = [n for n, c in solution.constants.items() if c.is_determined]
    assert {"gyro bias r", "accelerometer bias x", "compass delay"} <= set(known)
    assert f"{craft[1][0]} delay" in known and f"{craft[1][0]} arm x" in known
    assert {"compass turn x", "compass turn y"} <= set(known)


def test_velocity_at_the_centre_of_gravity_has_the_stated_error():
    solution, _, there = boat()
    missed = errors(solution, there)
    for name in ("u", "v", "w", "phi", "theta", "p", "q", "r"):
        ratio = float(np.sqrt(np.mean((missed[name] / solution.stds[name]) ** 2)))
        assert 0.5 < ratio < 2.0, (name, ratio)
    assert np.std(missed["u"]) < 0.02
    assert 0.8 < solution.nis < 1.2


def test_innovations_of_velocity_errors_match_the_correlation_times():
    solution, _, there = boat()
    assert np.all(solution.memories["r"] < 0.1)
    for name in ("u", "v"):
        error = (solution.values[name] - there[name]) / solution.stds[name]
        alike = np.exp(-np.diff(solution.t) / solution.memories[name][1:])
        new = (error[1:] - alike * error[:-1]) / np.sqrt(1.0 - alike**2)
        assert np.median(alike) > 0.95
        assert np.sqrt(np.mean(new**2)) == pytest.approx(1.0, abs=0.25), name


def test_a_compass_rotation_about_z_is_not_distinguished_from_its_offset():
    solution, result, _ = boat()
    turn, offset = solution.constants["compass turn z"], solution.constants["compass offset"]
    assert turn.std > 0.4 * turn.prior
    there = turn.value - result["compass turn"][2] + offset.value - result["compass offset"]
    assert abs(there) < 0.25 * turn.std


def test_the_first_seconds_have_the_stated_error():
    """The first estimates of a pass are far from the truth, and must not be what later samples are linearised about."""
    solution, _, there = solved(BOAT, 230, 40.0)
    missed = errors(solution, there)
    first = solution.t < solution.t[0] + 5.0
    for name in ("phi", "theta"):
        assert np.sqrt(np.mean((missed[name][first] / solution.stds[name][first]) ** 2)) < 2.0


def test_a_dvl_adds_no_information_about_the_heading():
    solution, _, _ = solved(ROV, 2, 30.0)
    own = solution.constants["compass offset"]
    assert own.std > 0.9 * own.prior
    assert not own.is_determined


def test_a_longer_gap_of_the_inertial_sensor_splits_the_log():
    run, _, _ = log(*BOAT[:1], 3, 60.0, BOAT[1])
    kept = {
        n: replace(c, t=c.t[keep], values=c.values[keep]) if n.startswith("imu") else c
        for n, c in run.channels.items()
        for keep in [(c.t < 25.0) | (c.t > 28.0)]
    }
    found = readings_of(store_of(replace(run, channels=kept), HERE), HERE)
    assert [round(part.samples[-1, 0] - part.samples[0, 0]) for part in found.stretches] == [25, 32]


def table(tmp_path: Path, **changes) -> Path:
    """Return the file of a simulated log. changes : channel, with _ for the dot -> its replacement, or None."""
    run, _, _ = log("tugboat", 3, 60.0, BOAT[1])
    channels = dict(run.channels)
    for name, change in changes.items():
        for own in [n for n in channels if n.replace(".", "_").startswith(name)]:
            channel = channels.pop(own)
            if change is not None:
                channels[own] = change(channel)
    save_trial(Trial("log", channels), tmp_path / "log.csv")
    return tmp_path / "log.csv"


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main(["navigate", *map(str, arguments)]) != 0
    result = capsys.readouterr().err
    assert result.count("\n") == 1
    return result


def test_the_command_writes_runs_that_identify_reads(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run, result, true = log("tugboat", 3, 60.0, BOAT[1])
    force = Channel("N", "1", true.t[::100], np.sin(true.t[::100]))
    save_trial(replace(run, channels={**run.channels, "N": force}), tmp_path / "log.csv")
    centre = ",".join(f"{x:.4f}" for x in result["centre"])
    assert main(["navigate", "log.csv", f"--centre={centre}"]) == 0
    assert "expected 1" in capsys.readouterr().out
    (got,) = load_runs(tmp_path / "runs" / "navigated-log")
    assert {"u", "std_u", "memory_u", "common1_u", "r", "std_r", "memory_r", "common1_r", "N"} <= set(got.channels)
    assert (got["std_u"].unit, got["memory_u"].unit, got["common1_u"].unit) == ("m/s", "s", "m/s")


def test_json_contains_every_constant(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["navigate", str(table(tmp_path)), "--json", "--out", "runs"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["solutions"][0]["constants"]["gps delay"]["determined"] is True
    assert result["not_determined"] == []


def test_a_log_without_an_inertial_sensor_is_rejected(tmp_path, capsys):
    result = refused(capsys, table(tmp_path, imu=None))
    assert "log.csv contains no inertial sensor" in result and "LOG_BITMASK" in result


def test_a_log_without_an_accelerometer_is_rejected(tmp_path, capsys):
    assert "a gyro but no accelerometer" in refused(capsys, table(tmp_path, imu_a=None))


def test_a_log_without_a_heading_is_rejected(tmp_path, capsys):
    result = refused(capsys, table(tmp_path, compass=None))
    assert "contains no heading" in result and "compass" in result


def test_an_accelerometer_in_g_is_rejected(tmp_path, capsys):
    result = refused(capsys, table(tmp_path, imu_a=lambda c: replace(c, values=c.values / 9.81)))
    assert "check the unit of imu.ax" in result.lower()


def test_a_slow_inertial_sensor_is_rejected(tmp_path, capsys):
    result = refused(capsys, table(tmp_path, imu=lambda c: replace(c, t=c.t[::10], values=c.values[::10])))
    assert "5 Hz" in result and "10 Hz" in result


def held(after: float):
    """Return a change of a channel: its values stay as they are at *after* [s] for 12 s."""

    def change(channel: Channel) -> Channel:
        values, still = channel.values.copy(), (channel.t >= after) & (channel.t < after + 12.0)
        values[still] = values[still][0]
        return replace(channel, values=values)

    return change


@pytest.mark.parametrize(("sensor", "name"), [("compass", "compass"), ("gps", "GPS velocity"), ("imu_r", "imu.r")])
def test_a_stuck_sensor_is_left_out_and_reported(sensor, name, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["navigate", str(table(tmp_path, **{sensor: held(25.0)}))]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    (start, end), *_ = re.findall(rf"{name} did not change from ([\d.]+) to ([\d.]+) s", shown)
    assert (float(start), float(end)) == pytest.approx((25.0, 37.0), abs=0.25)


def test_a_sensor_that_lacks_a_number_at_some_times_is_used_at_the_others():
    run, _, _ = log("tugboat", 3, 60.0, BOAT[1])
    north, turn = run["gps.x"], run["imu.r"]
    north = replace(north, values=np.where(north.t < 20.0, 1e300, north.values))
    turn = replace(turn, values=np.where(np.abs(turn.t - 30.0) < 0.05, np.nan, turn.values))
    run = replace(run, channels={**run.channels, "gps.x": north, "imu.r": turn})
    found = readings_of(store_of(run, HERE), HERE)
    assert len(found.series["GPS position"].t) == int(np.sum(north.t >= 20.0))
    assert len(found.stretches) == 1 and found.stuck == {}


@pytest.mark.parametrize("columns", ["imu_r", "imu"])
def test_a_dead_inertial_sensor_is_rejected(columns, tmp_path, capsys):
    dead = {columns: lambda c: replace(c, values=np.full_like(c.values, c.values[0]))}
    result = refused(capsys, table(tmp_path, **dead))
    assert "log.csv: " in result and "imu.r" in result and "never changes" in result


def test_a_clock_that_goes_back_is_rejected(tmp_path, capsys):
    path = table(tmp_path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:2000], *lines[1000:]]) + "\n")
    result = refused(capsys, path)
    assert "log.csv" in result and "back" in result


@pytest.mark.parametrize("place", ["400,0,-600", "0.4,0", "a,b,c", "nan,0,0"])
def test_a_lever_arm_that_is_not_in_metres_is_rejected(tmp_path, capsys, place):
    result = refused(capsys, tmp_path / "log.csv", "--arm", f"gps={place}")
    assert "--arm gps" in result
    assert "Write 0.4,0,-0.6" in result or "Write e.g. 0.4,0,-0.6" in result


def test_samples_with_a_larger_standard_deviation_weigh_less_in_identify():
    """Half of the velocity is useless, and its std column reports it."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 60.0, 0.1)
    force = np.where((t // 5.0) % 2 == 0, 1.0, -1.0)
    r = np.zeros(len(t))
    for i in range(len(t) - 1):
        r[i + 1] = r[i] + 0.1 * (force[i] - 2.0 * r[i]) / 3.0
    std = np.where(t < 30.0, 0.005, 0.2)
    noisy = r + std * rng.standard_normal(len(t))
    plain = {"N": Channel("N", "N m", t, force), "r": Channel("r", "rad/s", t, noisy)}
    result = {**plain, "std_r": Channel("std_r", "rad/s", t, std)}
    fits = [fit(Trial("run", c), dof="yaw", structure="linear") for c in (plain, result)]
    errors = [abs(f.model.alpha - 3.0) for f in fits]
    stds = [f.parameters["alpha_r"].std for f in fits]
    assert stds[1] < 0.3 * stds[0]
    assert errors[1] < 4.0 * stds[1] + 0.15


def test_intervals_cover_the_truth_if_the_run_contains_the_correlation_time_of_its_errors():
    """The errors of a turn rate last for 20 s, and its moment changes every second."""
    t = np.arange(0.0, 60.0, 0.1)
    force = np.where(t.astype(int) % 2 == 0, 1.0, -1.0)
    r, alike, size = np.zeros(len(t)), math.exp(-0.1 / 20.0), 0.05
    for i in range(len(t) - 1):
        r[i + 1] = 0.5 * force[i] + (r[i] - 0.5 * force[i]) * math.exp(-0.1 * 2.0 / 3.0)
    misses, inside = np.zeros((8, 2)), np.zeros((8, 2))
    for seed in range(8):
        new = np.random.default_rng(seed).standard_normal(len(t))
        error = np.zeros(len(t))
        error[0] = new[0]
        for i in range(1, len(t)):
            error[i] = alike * error[i - 1] + math.sqrt(1.0 - alike**2) * new[i]
        plain = {"N": Channel("N", "N m", t, force), "r": Channel("r", "rad/s", t, r + size * error)}
        plain["std_r"] = Channel("std_r", "rad/s", t, np.full(len(t), size))
        result = {**plain, "memory_r": Channel("memory_r", "s", t, np.full(len(t), 20.0))}
        for j, channels in enumerate((plain, result)):
            alpha = fit(Trial("run", channels), dof="yaw", structure="linear").parameters["alpha_r"]
            misses[seed, j], inside[seed, j] = alpha.value - 3.0, abs(alpha.value - 3.0) < 2.5 * alpha.std
    assert np.all(inside[:, 1])
    assert np.sqrt(np.mean(misses[:, 1] ** 2)) < 0.7 * np.sqrt(np.mean(misses[:, 0] ** 2))


def test_common_errors_are_part_of_the_standard_deviations():
    solution, *_ = boat()
    causes = {own.shape for own in solution.common.values()}
    assert len(causes) == 1
    assert 0 < causes.pop()[1] <= 6
    for name, own in solution.common.items():
        assert np.all(np.sum(own**2, axis=1) <= solution.stds[name] ** 2 * (1.0 + 1e-6)), name
    bias = np.linalg.norm(solution.common["r"], axis=1)
    assert bias.mean() == pytest.approx(solution.constants["gyro bias r"].std, rel=0.2)
    assert np.ptp(bias) < 0.3 * bias.mean()  # its drift


def test_an_error_common_to_all_samples_counts_once_in_identify():
    """A bias of the turn rate grows with time; without its column it passes for inertia, drag and constant force."""
    t = np.arange(0.0, 40.0, 0.1)
    force = np.where((t // 2.0).astype(int) % 2 == 0, 1.0, -1.0)
    r = np.zeros(len(t))
    for i in range(len(t) - 1):
        r[i + 1] = 0.5 * force[i] + (r[i] - 0.5 * force[i]) * math.exp(-0.1 * 2.0 / 3.0)
    shape, noise = 0.1 * np.sin(0.3 * t) * t / 40.0, 0.005
    z = {name: [] for name in ("with", "without")}
    for seed in range(8):
        rng = np.random.default_rng(seed)
        measured = r + shape * rng.standard_normal() + noise * rng.standard_normal(len(t))
        std = Channel("std_r", "rad/s", t, np.hypot(shape, noise))
        plain = {"N": Channel("N", "N m", t, force), "r": Channel("r", "rad/s", t, measured), "std_r": std}
        more = {**plain, "common1_r": Channel("common1_r", "rad/s", t, shape)}
        for name, channels in (("with", more), ("without", plain)):
            alpha = fit(Trial("run", channels), dof="yaw", structure="linear").parameters["alpha_r"]
            z[name].append((alpha.value - 3.0, alpha.std))
    errors, stds = (np.array(z["with"]).T[i] for i in (0, 1))
    others = np.array(z["without"]).T[0]
    assert np.all(np.abs(errors) < 3.0 * stds)
    assert np.sqrt(np.mean(errors**2)) < 0.5 * np.sqrt(np.mean(others**2))


ROWS = {
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", "imu", ("p", "q", "r", "ax", "ay", "az")),
    "MAG": ("QBfff", "TimeUS,I,MagX,MagY,MagZ", "compass", ("mx", "my", "mz")),
    "VISO": ("Qffff", "TimeUS,dt,PosDX,PosDY,PosDZ", "dvl", ("u", "v", "w")),
    "BARO": ("QBf", "TimeUS,I,Alt", "depth", ("z",)),
}


def onboard(run: Trial, path: Path) -> Path:
    """Write a simulated dive as the text of an onboard log, with a second pressure sensor in the water."""
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns", "FMT, 129, 40, MSG, QZ, TimeUS,Message"]
    lines += [f"FMT, {130 + i}, 40, {kind}, {row[0]}, {row[1]}" for i, (kind, row) in enumerate(ROWS.items())]
    rows = [(0.01, "MSG, 10000, ArduSub V4.5.0")]
    for kind, (_, columns, group, names) in ROWS.items():
        table = np.column_stack([run[f"{group}.{n}"].values for n in names])
        table = {"VISO": 0.25 * table, "BARO": -table}.get(kind, table)
        middle = {"VISO": "0.25, ", "BARO": "1, "}.get(kind, "0, " if ",I," in columns else "")
        for t, values in zip(run[f"{group}.{names[0]}"].t, table, strict=True):
            result = ", ".join(f"{v:.9g}" for v in values)
            rows.append((t, f"{kind}, {round(t * 1e6)}, {middle}{result}"))
            if kind == "BARO":
                rows.append((t, f"{kind}, {round(t * 1e6)}, 0, 3.5"))
    path.write_text("\n".join([*lines, *(row for _, row in sorted(rows, key=lambda r: r[0]))]) + "\n")
    return path


def test_an_onboard_log_gives_the_same_solution_as_its_table(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run, _, _ = log(ROV[0], 2, 30.0, ROV[1])
    expected = navigate(readings_of(store_of(run, HERE), HERE))[0]
    assert main(["navigate", str(onboard(run, tmp_path / "dive.log")), "--json"]) == 0
    (result,) = json.loads(capsys.readouterr().out)["solutions"]
    assert set(result["sensors"]) == {"compass", "DVL", "depth"}
    for name in ("gyro bias r", "dvl delay", "depth delay"):
        assert result["constants"][name]["value"] == pytest.approx(expected.constants[name].value, abs=1e-3)


def telemetry(run: Trial, path: Path, every: int = 1) -> Path:
    """Write a simulated trip as a telemetry log. every : keep each such sample of the inertial sensor."""
    writer, frames = mavlink.MAVLink(None, 1, 1), []

    def received(t: float, message) -> None:
        frames.append((t, bytes(message.pack(writer))))

    def rows(group: str, *names: str) -> np.ndarray:
        return np.column_stack([run[f"{group}.{n}"].values for n in names])

    for t in np.arange(0.0, 30.0, 1.0):
        received(t, mavlink.MAVLink_heartbeat_message(11, 3, 128, 0, 4, 3))
    t = run["imu.p"].t[::every]
    rates, forces = rows("imu", "p", "q", "r")[::every] * 1e3, rows("imu", "ax", "ay", "az")[::every] / 9.80665e-3
    stamps, field = run["compass.mx"].t, rows("compass", "mx", "my", "mz") * 10.0
    fields = np.column_stack([np.interp(t, stamps, column) for column in field.T])
    for own, *values in zip(t, *(np.round(a).astype(int) for a in (forces, rates, fields)), strict=True):
        received(own, mavlink.MAVLink_raw_imu_message(round(own * 1e6), *np.concatenate(values).tolist()))
        received(own, mavlink.MAVLink_attitude_message(round(own * 1e3), 0.0, 0.0, 0.3, 0.0, 0.0, 0.0))
    for own, (x, y, vn, ve, _) in zip(run["gps.x"].t, rows("gps", "x", "y", "vn", "ve", "vd"), strict=True):
        lat, lon = (round(value / 111319.5 * 1e7) for value in (x, y))
        course = round(math.degrees(math.atan2(ve, vn)) * 100.0) % 36000
        speed = round(100.0 * math.hypot(vn, ve))
        received(
            own, mavlink.MAVLink_gps_raw_int_message(round(own * 1e6), 3, lat + 1, lon + 1, 0, 0, 0, speed, course, 9)
        )
        received(own, mavlink.MAVLink_local_position_ned_message(round(own * 1e3), x, y, 0.0, vn, ve, 0.0))
    frames.sort(key=lambda frame: frame[0])
    path.write_bytes(b"".join(struct.pack(">Q", round((1.6e9 + t) * 1e6)) + frame for t, frame in frames))
    return path


def test_a_telemetry_log_with_a_fast_inertial_sensor_is_navigated(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run, result, _ = log("tugboat", 3, 30.0, BOAT[1])
    assert main(["navigate", str(telemetry(run, tmp_path / "trip.tlog", 2)), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (solution,) = found["solutions"]
    assert solution["constants"]["gyro bias r"]["value"] == pytest.approx(result["gyro bias"][2], abs=2e-3)
    assert solution["constants"]["gps delay"]["value"] == pytest.approx(result["gps delay"], abs=0.1)
    assert set(found["autopilot_rms_difference"]) == {"phi", "theta", "psi", "vn", "ve", "x", "y", "z"}
    assert 0.1 < found["autopilot_rms_difference"]["x"] < 1.5


def test_a_telemetry_log_at_the_usual_rate_is_rejected_with_the_parameter_to_set(tmp_path, capsys):
    run, _, _ = log("tugboat", 3, 30.0, BOAT[1])
    result = refused(capsys, telemetry(run, tmp_path / "trip.tlog", 25))
    assert "2 Hz" in result and "SR0_RAW_SENS" in result
