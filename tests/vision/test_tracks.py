"""A run from a video from above and a log: camera, marker, clocks, and rejections."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.diagnose import diagnose
from gcs_autotune.errors import BadFile, MissingChannel, NotInformative
from gcs_autotune.trial import Channel, Trial, load_trial
from gcs_autotune.vision import (
    MARKERS,
    FloorCamera,
    Track,
    calibrate_camera,
    clock_offset,
    joined,
    load_camera,
    save_camera,
    track,
)
from sitl.camera import PoolCamera, pool_dive, write_png
from sitl.camera.__main__ import main as render
from sitl.effects import BadEffect, parse_effect

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed (gcs-autotune[vision])")

SECONDS = 8


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of pictures of a short dive, with its log, floor and boards."""
    folder = tmp_path_factory.mktemp("pool")
    assert render(["pool", str(folder), "--seconds", str(SECONDS), "--seed", "1"]) == 0
    return folder


@pytest.fixture(scope="module")
def camera(pool: Path) -> FloorCamera:
    return calibrate_camera(pool / "floor.csv", str(pool / "boards"))[0]


def dive_of(seed: int = 1, seconds: int = 40) -> tuple[Track, Trial, float]:
    """Return track and log of a dive, without pictures."""
    dive = pool_dive(seed, seconds)
    x, y, psi = dive.seen.T
    rows = dict(zip(("X", "N", "r"), dive.log[:, 1:].T, strict=True))
    units = {"X": "N", "N": "N m", "r": "rad/s"}
    log = Trial("log", {n: Channel(n, units[n], dive.log[:, 0], v) for n, v in rows.items()})
    return Track("video", dive.video_t, x, y, psi, 0, True), log, dive.offset


def test_an_effect_hidden_in_a_dive_moves_the_craft_but_is_not_in_the_log() -> None:
    plain, late = pool_dive(1, 10), pool_dive(1, 10, [parse_effect("input-delay@N.delay=0.3")])
    assert late.log[:, :3] == pytest.approx(plain.log[:, :3])
    assert np.abs(late.seen[:, 2] - plain.seen[:, 2]).max() > 0.1
    with pytest.raises(BadEffect, match=r"quantisation: a camera has no such error\. Use an effect on thrusters"):
        pool_dive(1, 10, [parse_effect("quantisation@psi.step=0.1")])


@pytest.mark.slow
def test_a_delay_is_found_in_the_run_of_a_track() -> None:
    dive = pool_dive(2, 25, [parse_effect("input-delay@N.delay=0.3")])
    x, y, psi = dive.seen.T + np.random.default_rng(1).normal(0.0, 1e-3, (3, len(dive.seen)))
    rows = dict(zip(("X", "N", "r"), dive.log[:, 1:].T, strict=True))
    units = {"X": "N", "N": "N m", "r": "rad/s"}
    log = Trial("log", {n: Channel(n, units[n], dive.log[:, 0], v) for n, v in rows.items()})
    run = joined(Track("video", dive.video_t, x, y, psi, 0, True), log).run
    (cause,) = diagnose(run, dof="yaw", effects=["input-delay", "dead-zone", "actuator-lag"]).causes
    assert cause.effect.slug == "input-delay"
    assert cause.parameters["delay"].value == pytest.approx(0.3, abs=0.02)


@pytest.mark.slow
def test_a_bias_is_found_from_a_wrong_plain_model() -> None:
    runs, units = [], {"X": "N", "N": "N m", "r": "rad/s"}
    for seed in (110, 111, 112):
        dive = pool_dive(seed, 25, [parse_effect("input-bias@yaw.bias=0.015")])
        noise = np.random.default_rng(seed).normal(0.0, [[1.5e-3], [1.5e-3], [4.4e-3]], (3, len(dive.seen)))
        x, y, psi = dive.seen.T + noise
        rows = dict(zip(units, dive.log[:, 1:].T, strict=True))
        log = Trial("log", {n: Channel(n, units[n], dive.log[:, 0], v) for n, v in rows.items()})
        runs.append(joined(Track("video", dive.video_t, x, y, psi, 0, True), log).run)
    (cause,) = diagnose(runs, dof="yaw").causes
    assert cause.effect.slug == "input-bias"
    assert cause.parameters["bias"].value == pytest.approx(0.015, rel=0.05)


def test_boards_and_four_points_give_lens_and_floor(camera: FloorCamera) -> None:
    made = PoolCamera()
    places = np.array([(0.0, 0.0), (1.0, -0.7), (-0.9, 1.1)])
    pixels = np.array([made.pixel(*p) for p in places])
    assert camera.to_floor(pixels) == pytest.approx(places, abs=0.002)
    assert camera.distortion[0] == pytest.approx(-0.22, abs=0.02)


def test_the_page_shows_the_recorded_error_functions() -> None:
    from benchmarks import vision

    assert vision.PAGE.read_text(encoding="utf-8") == vision.page(), "run: python3 -m benchmarks.vision --page"


def test_a_camera_of_half_the_width_has_the_same_view(tmp_path: Path) -> None:
    whole, half = PoolCamera(), PoolCamera.of_width(320)
    assert half.picture(0.0, 0.0, 0.0).shape == (240, 320, 3)
    for at in ((0.0, 0.0), (1.0, -0.7), (-0.9, 1.1)):
        assert (np.array(half.pixel(*at)) + 0.5) * 2.0 == pytest.approx(np.array(whole.pixel(*at)) + 0.5)
    with pytest.raises(SystemExit):
        render(["pool", str(tmp_path), "--width", "100"])


@pytest.mark.parametrize(("noise", "most"), [("clear", 0.003), ("turbid", 0.004)])
def test_a_red_line_gives_position_and_heading(noise: str, most: float, camera: FloorCamera) -> None:
    made = PoolCamera(noise, seed=7)
    for x, y, psi in ((0.1, -0.4, 0.3), (-0.9, 0.8, 2.0), (0.7, 0.9, -1.2)):
        seen = MARKERS["red-line"](np.ascontiguousarray(made.picture(x, y, psi)[:, :, ::-1]), camera)
        assert seen is not None
        assert (seen.x, seen.y) == pytest.approx((x, y), abs=most)
        assert math.remainder(seen.psi - psi, math.pi) == pytest.approx(0.0, abs=math.radians(0.5))


def test_a_tag_gives_position_and_heading_with_its_bow(camera: FloorCamera) -> None:
    made = PoolCamera()
    x, y, psi, half = 0.2, -0.3, 2.5, 0.15
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    tag = np.pad(cv2.aruco.generateImageMarker(book, 3, 160), 20, constant_values=255)
    ahead, right = np.array([math.cos(psi), math.sin(psi)]), np.array([-math.sin(psi), math.cos(psi)])
    corners = [np.array([x, y]) + half * (a * ahead + b * right) for a, b in ((1, -1), (1, 1), (-1, 1), (-1, -1))]
    inside = np.float32([(20, 20), (179, 20), (179, 179), (20, 179)])
    to = cv2.getPerspectiveTransform(inside, np.float32([made.pixel(*c) for c in corners]))
    picture = cv2.warpPerspective(tag, to, (640, 480), borderValue=128)
    seen = MARKERS["apriltag"](cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), camera)
    assert seen is not None
    assert (seen.x, seen.y) == pytest.approx((x, y), abs=0.01)
    assert math.remainder(seen.psi - psi, math.tau) == pytest.approx(0.0, abs=0.05)
    assert MARKERS["apriltag"](np.full((480, 640, 3), 128, np.uint8), camera) is None


def test_the_commands_make_a_run(pool: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, run = tmp_path / "camera.json", tmp_path / "track.csv"
    floor, boards = str(pool / "floor.csv"), str(pool / "boards")
    assert main(["calibrate", "camera", floor, "--boards", boards, "--out", str(out)]) == 0
    assert "rms error of the points 0.0 mm" in capsys.readouterr().out
    line = ["track", str(pool), str(pool / "log.csv"), "--camera", str(out), "--out", str(run)]
    assert main([*line, "--offset", "60", "--bow", "30"]) == 0
    assert "The log's clock is +60.000 s from the video's.\n" in capsys.readouterr().out
    trial, true = load_trial(run), pool_dive(1, SECONDS)
    assert set(trial.channels) == {"x", "y", "psi", "X", "N"}
    seen = np.column_stack([trial[n].values for n in ("x", "y", "psi")])
    assert trial["x"].t[0] == 60.0
    assert seen == pytest.approx(true.seen[: len(seen)], abs=0.01)


def test_the_clocks_are_aligned_by_the_yaw_rates_within_a_hundredth_of_a_second() -> None:
    for seed in range(4):
        seen, log, offset = dive_of(seed)
        found, correlation = clock_offset(seen, log)
        assert found == pytest.approx(offset, abs=0.01)
        assert correlation > 0.95


def test_turns_that_repeat_are_not_aligned_by_chance() -> None:
    t = np.arange(0.0, 40.0, 0.1)
    psi = np.sin(1.5 * t)
    seen = Track("video", t, np.zeros(len(t)), np.zeros(len(t)), psi, 0, True)
    log = Trial("log", {"psi": Channel("psi", "rad", t + 7.0, psi), "N": Channel("N", "1", t, psi)})
    with pytest.raises(NotInformative, match=r"at offsets of .* because the turns repeat\. Use --offset"):
        clock_offset(seen, log)


def test_bow_and_stern_of_a_line_follow_from_the_surge_command() -> None:
    seen, log, _ = dive_of()
    wrong_end = replace(seen, psi=seen.psi + math.pi)
    turned = joined(wrong_end, log).run["psi"].values - joined(seen, log).run["psi"].values
    assert np.cos(turned) == pytest.approx(np.ones(len(turned)))


def without(log: Trial, *names: str) -> Trial:
    return replace(log, channels={n: c for n, c in log.channels.items() if n not in names})


def gapped(log: Trial) -> Trial:
    keep = np.abs(log["r"].t - log["r"].t.mean()) > 2.0
    return replace(log, channels={n: replace(c, t=c.t[keep], values=c.values[keep]) for n, c in log.channels.items()})


def test_logs_that_cannot_be_joined_are_rejected() -> None:
    seen, log, offset = dive_of()
    with pytest.raises(MissingChannel, match=r"log: no command \(X, Y, N, delta"):
        joined(seen, without(log, "X", "N"))
    with pytest.raises(MissingChannel, match="no yaw rate r or heading psi"):
        joined(seen, without(log, "r"))
    with pytest.raises(BadFile, match=r"log: no r from \d+\.\d\d to \d+\.\d\d s"):
        joined(seen, gapped(log), offset=offset)
    with pytest.raises(NotInformative, match="in common"):
        joined(seen, log, offset=offset + 500.0)
    with pytest.raises(NotInformative, match="which end of the line is the bow"):
        joined(seen, without(log, "X"), offset=offset)
    noise = np.random.default_rng(1).normal(size=len(log["r"]))
    with pytest.raises(NotInformative, match="do not match"):
        joined(seen, replace(log, channels={**log.channels, "r": replace(log["r"], values=noise)}))


def test_a_video_without_a_craft_or_with_a_gap_is_rejected(camera: FloorCamera, pool: Path, tmp_path: Path) -> None:
    made = PoolCamera(seed=3)
    write_png(tmp_path / "0.png", made.empty())
    with pytest.raises(NotInformative, match="contains one picture only"):
        track(str(tmp_path), camera)
    for number in range(3):
        write_png(tmp_path / f"{number}.png", made.empty())
    with pytest.raises(NotInformative, match=r"0 of 3 pictures show the marker .* is picture 1"):
        track(str(tmp_path), camera)
    (tmp_path / "times.csv").write_text("t[s]\n0\n0.1\n3.5\n")
    with pytest.raises(BadFile, match=r"picture 3: the time jumps by 3\.40 s"):
        track(str(tmp_path), camera)


@pytest.mark.parametrize(
    ("change", "words"),
    [({"matrix": None}, "matrix"), ({"floor": [[0.0] * 3] * 3}, "floor cannot be inverted"), ({"schema": 2}, "not a")],
)
def test_bad_camera_files_are_reported(change: dict[str, Any], words: str, camera: FloorCamera, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    save_camera(camera, path)
    data = {k: v for k, v in {**json.loads(path.read_text()), **change}.items() if v is not None}
    path.write_text(json.dumps(data))
    with pytest.raises(BadFile, match=words):
        load_camera(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("column,row,x[m],y[m]\n0,0,1,1\n9,0,1,2\n", "2 points do not define the floor"),
        ("column,row,x[m],y[m]\n0,0,1,2\n9,0,1,1\n9,9,0,1\n0,9,0,2\n", "the floor is mirrored"),
        ("column,x[m],y[m]\n0,1,1\n", "no column row"),
    ],
)
def test_bad_floors_are_reported(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "floor.csv").write_text(text)
    with pytest.raises((BadFile, NotInformative), match=words):
        calibrate_camera(tmp_path / "floor.csv")


def test_images_without_a_board_are_counted(pool: Path, tmp_path: Path) -> None:
    write_png(tmp_path / "1.png", PoolCamera(seed=3).empty())
    with pytest.raises(NotInformative, match="0 of 1 pictures show a board"):
        calibrate_camera(pool / "floor.csv", str(tmp_path))
