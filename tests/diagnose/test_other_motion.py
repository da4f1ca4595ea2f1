"""Records of a yaw oscillation: other motion in them is reported, with the option that analyses it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from open_loop_runs import BOAT, UNITS

from gcs_autotune.diagnose import diagnose
from gcs_autotune.identify import MOVED_TOO, moved_besides, moved_too
from gcs_autotune.report.diagnosis.wording import verdict_of
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow import StudySettings, study
from sitl.effects.table import make_effect
from sitl.open_loop import open_loop

COUPLED = make_effect("coriolis-coupling", "surge+sway+yaw", {"X_vr": 7.0, "Y_ur": -5.0, "N_uv": -2.0})


def flown(*effects, measured=("u", "v", "r", "psi"), thrust=2.5, samples=300, noise=0.01):
    t = 0.2 * np.arange(samples)
    columns = open_loop(
        BOAT,
        {"N": 0.3 * np.sign(np.sin(2.0 * np.pi * t / 20.0)), "X": np.full(samples, thrust)},
        duration=0.2 * samples,
        interval=0.2,
        measured=measured,
        effects=effects,
        noise={n: 0.005 if n in ("psi", "r") else noise for n in measured},
        initial={"u": 1.25 if thrust else 0.0},
    )
    t = columns.pop("t")
    channels = {n: Channel(n, UNITS[n], t, v) for n, v in columns.items()}
    return Trial("s", channels, meta={"dof": "yaw", "manoeuvre": "s-manoeuvre"})


@pytest.mark.parametrize("measured", [("u", "v", "r", "psi"), ("x", "y", "psi")])
def test_a_boat_that_slides_moves_in_sway_too(measured):
    run = flown(COUPLED, measured=measured)
    assert "sway" in moved_besides([run], {"yaw"})
    (doubt,) = moved_too([run], ("yaw",))
    assert doubt.slug == MOVED_TOO
    assert doubt.cause.startswith("only yaw was analysed") and "sway moved too" in doubt.cause
    assert "--dof horizontal" in doubt.cure
    assert moved_too([run], ("surge", "sway", "yaw")) == []


@pytest.mark.parametrize("measured", [("u", "v", "r", "psi"), ("x", "y", "psi")])
def test_a_boat_that_turns_without_sliding_at_steady_speed_moves_in_yaw_only(measured):
    assert moved_too([flown(measured=measured)], ("yaw",)) == []


def test_a_motion_without_recorded_inputs_is_reported_with_the_inputs_to_record():
    run = flown(COUPLED)
    without = replace(run, channels={n: c for n, c in run.channels.items() if n != "X"})
    (doubt,) = moved_too([without], ("yaw",))
    assert "sway moved too" in doubt.cause
    assert doubt.cure == "record their inputs (X)"


def test_noise_on_a_speed_is_not_motion():
    assert moved_besides([flown(thrust=0.0, noise=0.5)], {"yaw"}) == {}


@pytest.mark.slow
def test_a_diagnosis_of_yaw_alone_states_so_in_its_verdict():
    run = flown(COUPLED)
    result = diagnose(run, effects=["input-bias"])
    assert MOVED_TOO in {d.slug for d in result.doubts}
    assert verdict_of(result).sentences[-1].startswith("Only yaw was analysed, but ")
    requested = diagnose(run, dof="yaw", effects=["input-bias"])
    assert MOVED_TOO not in {d.slug for d in requested.doubts}
    whole = diagnose(run, dof="horizontal", effects=["input-bias"])
    assert MOVED_TOO not in {d.slug for d in whole.doubts}


def test_an_identification_of_yaw_alone_has_a_doubt():
    run = flown(COUPLED)
    result = study([run], [], StudySettings(check=False), "")
    assert [d.slug for d in result.fit.doubts if d.slug == MOVED_TOO]
    requested = study([run], [], StudySettings(dof="yaw", check=False), "")
    assert not [d.slug for d in requested.fit.doubts if d.slug == MOVED_TOO]
