"""Changes of payload, hull, thrust or trim are identified from later records; an unchanged craft raises no alarm."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.diagnose import compare_craft
from gcs_autotune.errors import UsageError
from gcs_autotune.identify import fit_axis
from gcs_autotune.models import SingleDof, simulate
from gcs_autotune.trial import Channel, Trial, save_trial

CRAFT = {"alpha": 1.0, "beta": 0.5, "delta": 0.01}


def square_waves(seed: int, mass: float = 1.0, drag: float = 1.0, thrust: float = 1.0, trim: float = 0.0) -> Trial:
    """Two square waves in heading, of a craft changed by these factors; input as normalised output."""
    t = 0.1 * np.arange(1200, dtype=np.float64)
    period = np.where(t < 60.0, 6.0, 14.0)
    force = 0.2 * np.sign(np.sin(2.0 * math.pi * t / period) + 1e-9)
    model = SingleDof(
        "yaw", "1", CRAFT["alpha"] * mass / thrust, CRAFT["beta"] * drag / thrust, 0.0, CRAFT["delta"] + trim
    )
    truth = simulate(model, t, force, t)
    noise = np.random.default_rng(seed).normal(0.0, 2e-3, (2, len(t)))
    channels = {
        "N": Channel("N", "1", t, force),
        "psi": Channel("psi", "rad", t, truth.eta + noise[0]),
        "r": Channel("r", "rad/s", t, truth.nu + noise[1]),
    }
    return Trial(f"run-{seed}", channels)


def fitted(trial: Trial):
    return fit_axis(trial, dof="yaw", structure="linear")


@pytest.fixture(scope="module")
def reference():
    return fitted(square_waves(1))


@pytest.mark.parametrize(
    ("change", "name", "size", "slug"),
    [
        ({"mass": 1.3}, "inertia", 1.3, "mass-change"),
        ({"mass": 0.8}, "inertia", 0.8, "mass-change"),
        ({"drag": 1.4}, "drag", 1.4, "linear-drag"),
        ({"thrust": 0.7}, "thrust", 0.7, "gain-drift"),
        ({"trim": 0.06}, "trim", 0.06, "input-bias"),
    ],
)
def test_each_single_change_is_identified_with_its_size(reference, change, name, size, slug):
    found = compare_craft(reference, fitted(square_waves(2, **change)))
    assert found.changed
    ((cause, result),) = found.causes
    assert (cause.name, cause.slug) == (name, slug)
    assert result == pytest.approx(size, rel=0.08)
    assert slug.replace("-", " ") in found.summary


def test_two_changes_at_once_are_both_identified(reference):
    found = compare_craft(reference, fitted(square_waves(3, mass=1.5, trim=0.08)))
    assert {c.name for c, _ in found.causes} == {"inertia", "trim"}


@pytest.mark.slow
def test_an_unchanged_craft_raises_no_alarm_over_many_runs(reference):
    alarms = [seed for seed in range(10, 30) if compare_craft(reference, fitted(square_waves(seed))).changed]
    assert alarms == []


def test_a_different_motion_or_unit_cannot_be_compared(reference):
    from dataclasses import replace

    with pytest.raises(UsageError, match="cannot compare"):
        compare_craft(reference, replace(reference, model=replace(reference.model, input_unit="N m")))


@pytest.mark.slow
def test_watch_reports_which_log_of_a_craft_differs(tmp_path, capsys):
    days = {"day-1": {}, "day-2": {}, "day-3": {"drag": 1.5}}
    paths = []
    for seed, (name, change) in enumerate(days.items(), start=40):
        save_trial(square_waves(seed, **change), tmp_path / f"{name}.csv")
        paths.append(str(tmp_path / f"{name}.csv"))
    assert main(["watch", *paths, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [row["changed"] for row in rows] == [False, False, True]
    assert rows[2]["causes"][0]["effect"] == "linear-drag"
    assert main(["watch", *paths[:2]]) == 0
    assert "No change: every parameter is within its interval." in capsys.readouterr().out
    assert main(["watch", paths[0]]) == 2
    assert "fewer than two logs given" in capsys.readouterr().err
