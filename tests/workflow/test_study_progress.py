"""An identification reports its stage and its progress."""

from __future__ import annotations

import importlib
import math

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.errors import NotInformative
from gcs_autotune.trial import Channel, Trial, save_trial
from gcs_autotune.workflow import StudySettings, study


def square_wave_run(name: str, half: int) -> Trial:
    """Return 40 s at 10 Hz of 0.04 r' + 0.02 r = N under a square wave of *half* ticks each way."""
    n = np.where(np.arange(400) // half % 2, -0.06, 0.06)
    psi, r = np.zeros(400), np.zeros(400)
    decay = math.exp(-0.05)
    for k in range(399):
        steady = n[k] / 0.02
        psi[k + 1] = psi[k] + steady * 0.1 + (r[k] - steady) * 2.0 * (1.0 - decay)
        r[k + 1] = steady + (r[k] - steady) * decay
    t = 0.1 * np.arange(400)
    channels = {"psi": ("rad", psi), "r": ("rad/s", r), "N": ("N m", n)}
    return Trial(name, {c: Channel(c, unit, t, values) for c, (unit, values) in channels.items()})


def stages_of(runs, settings: StudySettings, unseen=()) -> list[tuple[str, int, int]]:
    stages: list[tuple[str, int, int]] = []
    study(runs, unseen, settings, "", lambda *stage: stages.append(stage))
    return stages


RUNS = (square_wave_run("a", 40), square_wave_run("b", 25))


def test_each_fit_and_each_held_out_check_is_a_stage():
    assert stages_of(RUNS, StudySettings(dof="yaw", structure="linear", delay=0.0)) == [
        ("output-error: fitting", 0, 3),
        ("output-error: checking", 1, 3),
        ("output-error: checking", 2, 3),
    ]


def test_without_a_check_there_is_one_stage_and_planning_is_reported_too():
    stages = stages_of(RUNS[:1], StudySettings(dof="yaw", structure="linear", delay=0.0, check=False, plan_next=20.0))
    assert stages == [("output-error: fitting", 0, 1), ("planning the next manoeuvre", 0, 1)]


def test_a_refusing_method_skips_its_checks(monkeypatch):
    study_module = importlib.import_module("gcs_autotune.workflow.study")
    real = study_module.fit

    def choosy(trials, structure, method, **options):
        if method == "two":
            raise NotInformative("not for me")
        return real(trials, structure, "output-error", **options)

    row = study_module.METHODS["output-error"]
    monkeypatch.setattr(study_module, "METHODS", dict.fromkeys(("one", "two", "three"), row))
    monkeypatch.setattr(study_module, "_methods", lambda settings: ["one", "two", "three"])
    monkeypatch.setattr(study_module, "fit", choosy)
    stages = stages_of(RUNS[:1], StudySettings(dof="yaw", structure="linear", delay=0.0), unseen=RUNS[1:])
    assert stages == [
        ("one: fitting", 0, 6),
        ("one: checking", 1, 6),
        ("two: fitting", 2, 6),
        ("three: fitting", 4, 6),
        ("three: checking", 5, 6),
    ]


@pytest.mark.parametrize(("json", "quiet"), [((), False), (("--json",), True)])
def test_progress_is_shown_on_standard_error_unless_json_is_requested(json, quiet, monkeypatch, tmp_path, capsys):
    seen: list[str] = []

    class Bar:
        def __init__(self, console, *, verbose, given):
            assert console.stderr and not verbose and given == math.inf
            assert console.quiet == quiet

        def __enter__(self):
            return lambda stage, done, total: seen.append(stage)

        def __exit__(self, *error):
            pass

    monkeypatch.setattr("gcs_autotune.report.StageBar", Bar)
    monkeypatch.chdir(tmp_path)
    save_trial(RUNS[0], tmp_path / "a.csv")
    assert main(["identify", "a.csv", "--structure", "linear", "--delay", "0", *json]) == 0
    assert seen == ["output-error: fitting", "output-error: checking"]
