"""One session of an unmodified ArduRover, recorded over the link and on board: both give the same run."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.identify import fit_axis
from gcs_autotune.logs import load_runs
from gcs_autotune.trial import Channel, Trial

FLOWN = Path(__file__).parent / "flown"
TRUE_TIME = 0.02
"""What two stamps of one event may differ by [s]: one loop of ArduRover."""
GYRO_BIAS = 0.003
"""What the rates may differ by [rad/s]: ATTITUDE's has the estimator's gyro bias taken off, IMU's has not."""


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trial, Trial]:
    folder = tmp_path_factory.mktemp("flown")
    runs = []
    for suffix in ("tlog", "bin"):
        path = folder / f"charlie.{suffix}"
        path.write_bytes(gzip.decompress((FLOWN / f"{path.name}.gz").read_bytes()))
        (run,) = load_runs(path)
        runs.append(run)
    return runs[0], runs[1]


def held(channel: Channel, t: np.ndarray) -> np.ndarray:
    """Return an input at times *t*, held from sample to sample."""
    return channel.values[np.maximum(np.searchsorted(channel.t, t, side="right") - 1, 0)]


def test_heading_and_rate_agree_within_their_stamps(both: tuple[Trial, Trial]) -> None:
    link, board = both
    t = link["psi"].t[(link["psi"].t > board["psi"].t[0]) & (link["psi"].t < board["psi"].t[-1])]
    assert len(t) > 1000
    for name, bias in (("psi", 0.0), ("r", GYRO_BIAS)):
        a = np.interp(t, link[name].t, np.unwrap(link[name].values))
        b = np.interp(t, board[name].t, np.unwrap(board[name].values))
        a -= 2.0 * math.pi * round(float(np.median(a - b)) / (2.0 * math.pi))
        fastest = float(np.max(np.abs(np.gradient(a, t))))
        assert float(np.max(np.abs(a - b))) < fastest * TRUE_TIME + bias, name


def test_the_inputs_agree_within_their_message_rates(both: tuple[Trial, Trial]) -> None:
    """Outputs are sent at 40 Hz and logged on board at 10 Hz, so a switch is known to 50 ms there."""
    link, board = both
    t = np.arange(board.start + 1.0, board.end - 1.0, 0.01)
    for name in ("N", "X"):
        a, b = held(link[name], t), held(board[name], t)
        assert {round(v, 2) for v in np.unique(a)} == {round(v, 2) for v in np.unique(b)}
        switches = int(np.sum(np.abs(np.diff(a)) > 0.0))
        assert float(np.sum(a != b)) * 0.01 <= max(switches, 1) * 0.1


def test_they_are_identified_as_the_same_craft(both: tuple[Trial, Trial]) -> None:
    link, board = (fit_axis(run, dof="yaw", structure="linear", delay=0.0) for run in both)
    for name in ("alpha_r", "beta_r"):
        a, b = link.parameters[name], board.parameters[name]
        assert abs(a.value - b.value) < 4.0 * math.hypot(a.std, b.std), name
        assert a.value == pytest.approx(b.value, rel=0.03)


def test_each_run_records_its_origin(both: tuple[Trial, Trial]) -> None:
    link, board = both
    assert link.meta["vehicle"] == "ArduRover (system 1)"
    assert board.meta["vehicle"].startswith("ArduRover V4.7.0-dev")
    assert board.meta["filters"]["r"]["cutoff_hz"] == 4.0
    assert board.meta["filters"]["r"]["bias_removed"] is False
    assert (link.meta["sources"]["r"], board.meta["sources"]["r"]) == ("attitude", "imu")
    assert link.meta["damaged"] == board.meta["damaged"] == 0
