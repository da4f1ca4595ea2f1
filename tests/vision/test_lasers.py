"""Distance and angle to a wall, read from simulated pictures of two laser dots."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.errors import BadFile, NotInformative
from gcs_autotune.trial import load_trial
from gcs_autotune.vision import DotFinder, LaserModule, calibrate_laser, laser_run, load_lasers, read_lasers
from sitl.camera import WallCamera, write_png
from sitl.camera.__main__ import main as render

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed (gcs-autotune[vision])")


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of pictures at 10 to 100 cm, with the table of the distances."""
    folder = tmp_path_factory.mktemp("wall")
    assert render(["wall", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def module(wall: Path) -> LaserModule:
    return calibrate_laser(wall / "truth.csv", str(wall), apart=0.2).module


def seen(camera: WallCamera, distance: float, angle: float = 0.0) -> Any:
    return np.ascontiguousarray(camera.picture(distance, angle)[:, :, ::-1])


@pytest.mark.parametrize("noise", ["clear", "turbid"])
def test_dots_are_found_within_a_third_of_a_pixel(noise: str) -> None:
    camera, finder = WallCamera(noise, seed=3), DotFinder()
    for distance, angle in ((0.3, 0.1), (0.32, 0.1), (0.9, -0.1)):
        dots = finder.find(seen(camera, distance, angle))
        centre = np.array([319.5, 239.5])
        assert np.array([dots.port, dots.starboard]) + centre == pytest.approx(camera.dots(distance, angle), abs=0.35)


def test_windows_follow_the_dots_and_the_whole_image_is_searched_after_a_loss() -> None:
    camera, finder = WallCamera(seed=1), DotFinder()
    searched = [finder.find(seen(camera, d)).searched for d in (0.5, 0.48, 0.46, 0.15, 0.16)]
    assert searched == ["picture", "windows", "windows", "picture", "windows"]


def test_a_calibration_from_images_gives_distance_and_angle(module: LaserModule) -> None:
    camera = WallCamera("turbid", seed=5)
    finder = DotFinder("red", module.lines)
    for distance, angle in ((0.3, 0.15), (0.6, -0.12), (0.8, 0.05)):
        port, starboard = module.beams(finder.find(seen(camera, distance, angle)))
        assert 0.5 * (port + starboard) == pytest.approx(distance, abs=0.012)
        assert math.atan2(starboard - port, 0.2) == pytest.approx(angle, abs=math.radians(3.5))


def test_the_commands_calibrate_and_measure(wall: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, run = tmp_path / "lasers.json", tmp_path / "run.csv"
    assert main(["calibrate", "laser", str(wall / "truth.csv"), "--pictures", str(wall), "--out", str(out)]) == 0
    assert "19 distances from 10 to 100 cm" in capsys.readouterr().out
    assert load_lasers(out).width == 640
    assert main(["laser", str(wall), "--calibration", str(out), "--out", str(run), "--quiet"]) == 0
    assert "19 pictures, 0 without a distance" in capsys.readouterr().out
    trial = load_trial(run)
    assert trial["d"].t[1] == 0.5
    assert trial["d_starboard"].values == pytest.approx(np.arange(0.1, 1.001, 0.05), abs=0.01)


def test_a_reflection_off_the_line_of_a_dot_is_not_the_dot(module: LaserModule) -> None:
    camera = WallCamera(seed=2)
    places = np.vstack([camera.dots(0.5, 0.0), [150.0, 100.0]])
    picture = np.ascontiguousarray(camera.with_dots(places, [4.0, 4.0, 9.0])[:, :, ::-1])
    dots = DotFinder("red", module.lines).find(picture)
    assert dots.port == pytest.approx(camera.dots(0.5, 0.0)[0] - [319.5, 239.5], abs=0.5)


@pytest.mark.parametrize(("count", "words"), [(0, "shows no laser dot"), (1, "one laser dot, on the port side")])
def test_images_without_two_dots_are_reported(count: int, words: str, module: LaserModule, tmp_path: Path) -> None:
    camera = WallCamera(seed=4)
    write_png(tmp_path / "1.png", camera.with_dots(camera.dots(0.5, 0.0)[:count], [4.0] * count))
    with pytest.raises(NotInformative, match=words):
        laser_run(list(read_lasers(module, str(tmp_path))), "dive")


def bad_folder(folder: Path, wall: Path, kind: str) -> None:
    """Make a folder of two pictures with one fault."""
    for name in ("0001.png", "0002.png"):
        shutil.copy(wall / name, folder / name)
    if kind == "empty file":
        (folder / "0002.png").write_bytes(b"")
    elif kind == "other size":
        write_png(folder / "0002.png", WallCamera(width=320, height=240).picture(0.5))
    elif kind == "times back":
        (folder / "times.csv").write_text("t[s]\n1.0\n0.5\n")
    elif kind == "times missing":
        (folder / "times.csv").write_text("t[s]\n1.0\n")
    elif kind == "no picture":
        (folder / "0001.png").unlink()
        (folder / "0002.png").unlink()


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("empty file", r"0002\.png cannot be read as a picture \(0 bytes\)"),
        ("other size", "picture 2: its size differs"),
        ("times back", "picture 2: its time 0.5 s does not follow 1 s"),
        ("times missing", r"times\.csv has 1 times for 2 pictures"),
        ("no picture", "contains no picture"),
    ],
)
def test_bad_images_are_reported(kind: str, words: str, module: LaserModule, wall: Path, tmp_path: Path) -> None:
    bad_folder(tmp_path, wall, kind)
    with pytest.raises(BadFile, match=words):
        list(read_lasers(module, str(tmp_path)))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("d,x_L,x_R\n10,300,300\n", r"d has no unit\. Write d\[cm\]"),
        ("x_L,x_R\n300,300\n", r"no column d\[cm\]"),
        ("d[cm],x_L,x_R\n10,300,300\n-5,200,200\n", "row 3: d is -0.05 m"),
        ("d[cm],x_L,x_R\n", r"no samples\. It needs a header line like d\[cm\],x_L,x_R"),
        ("d[cm],x_L\n10,300\n", "no pixel positions x_L and x_R"),
        ("d[cm],x_L,x_R\n10,300,300\n20,200,200\n", "port dot: a laser calibration needs at least five"),
    ],
)
def test_bad_tables_are_reported(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises((BadFile, NotInformative), match=words):
        calibrate_laser(tmp_path / "table.csv", apart=0.2)


def test_a_table_with_another_number_of_rows_than_images_is_reported(wall: Path, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("d[cm]\n10\n20\n")
    with pytest.raises(BadFile, match="2 rows for 19 pictures"):
        calibrate_laser(tmp_path / "table.csv", str(wall), apart=0.2)


def test_a_calibration_that_is_not_json_is_reported_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "lasers.json"
    path.write_text('{"schema": 1,\n d[cm],x_L\n')
    with pytest.raises(BadFile, match=r"lasers\.json cannot be read as a calibration of lasers: line 2 is not JSON"):
        load_lasers(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"port": None}, "port"),
        ({"apart": -1.0}, "apart is -1 m"),
        ({"starboard": {"a": 1.0, "b": 0.1, "c": 1.0, "d": -0.1}}, "curve of starboard does not fall"),
    ],
)
def test_bad_calibration_files_are_reported(
    change: dict[str, Any], words: str, module: LaserModule, tmp_path: Path
) -> None:
    import json

    import msgspec

    path = tmp_path / "lasers.json"
    path.write_text(json.dumps({"schema": 1, **msgspec.to_builtins(module), **change}))
    with pytest.raises(BadFile, match=words):
        load_lasers(path)


def test_a_video_is_read_like_a_folder(module: LaserModule, tmp_path: Path) -> None:
    path = tmp_path / "dive.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 5.0, (640, 480))
    camera = WallCamera(seed=6)
    for distance in (0.5, 0.48, 0.46):
        writer.write(seen(camera, distance))
    writer.release()
    readings = list(read_lasers(module, str(path)))
    assert [r.t for r in readings] == pytest.approx([0.0, 0.2, 0.4])
    assert [r.distance for r in readings] == pytest.approx([0.5, 0.48, 0.46], abs=0.01)
    (tmp_path / "cut.avi").write_bytes(path.read_bytes()[:100])
    with pytest.raises(BadFile, match=r"cut\.avi cannot be opened as a video"):
        list(read_lasers(module, str(tmp_path / "cut.avi")))
