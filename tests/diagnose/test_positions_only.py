"""Records of a track without speeds: x, y, the heading and the commands."""

from __future__ import annotations

import numpy as np
import pytest
from open_loop_runs import BOAT, UNITS

from gcs_autotune.diagnose import WORK, diagnose
from gcs_autotune.diagnose.residual_analysis import signature_of
from gcs_autotune.errors import MissingChannel
from gcs_autotune.identify.problems import fit_base, overlooked, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded
from gcs_autotune.trial import Channel, Trial
from sitl.effects.table import make_effect
from sitl.open_loop import open_loop

pytestmark = pytest.mark.slow

COUPLED = make_effect("coriolis-coupling", "surge+sway+yaw", {"X_vr": 7.0, "Y_ur": -5.0, "N_uv": -2.0})


def s_manoeuvre(*effects, measured=("x", "y", "psi"), k=0, samples=150):
    t = 0.2 * np.arange(samples)
    columns = open_loop(
        BOAT,
        {"N": np.sign(np.sin(2.0 * np.pi * t / (14.0 + 4.0 * k))), "X": np.full(samples, 2.5)},
        duration=0.2 * samples,
        interval=0.2,
        measured=measured,
        effects=effects,
        noise={n: 0.005 if n == "psi" else 0.02 for n in measured},
        seed=k,
        initial={"u": 1.0},
    )
    t = columns.pop("t")
    return Trial(f"s{k}", {n: Channel(n, UNITS[n], t, v) for n, v in columns.items()})


@pytest.mark.parametrize("dof", [None, "surge,sway,yaw", "horizontal"])
def test_a_track_shows_surge_and_sway_without_their_speeds(dof):
    run = s_manoeuvre()
    form = plain_form([run], dof)
    assert form.dofs == ("surge", "sway", "yaw")
    segments, _ = prepare_as_recorded([run], form)
    assert set(segments[0].signals) == {"x", "y", "psi"}
    assert overlooked([run], form, dof, None, segments) == []


def test_unmodelled_sideways_momentum_leaves_large_correlated_residuals_in_the_track():
    runs = [s_manoeuvre(COUPLED, k=k) for k in (0, 1)]
    form = plain_form(runs, "horizontal")
    problem, fitted = fit_base(form, prepare_as_recorded(runs, form)[0])
    assert min(fitted.levels["x"], fitted.levels["y"]) > 5.0 * 0.02
    assert signature_of(problem, fitted)[0].whiteness_p < 1e-6


def test_the_plain_model_explains_the_track_of_a_plain_craft():
    result = diagnose([s_manoeuvre(k=k) for k in (0, 1)], effects=["steady-current"])
    assert (result.verdict, result.doubts) == ("no-effect", ())


@pytest.mark.parametrize(("measured", "place"), [(("x", "y", "psi"), "x+y"), (("u", "v", "r", "psi"), "u+v")])
def test_a_sensor_off_the_centre_is_identified_and_not_mistaken_for_sway(measured, place):
    hidden = make_effect("sensor-position", place, {"x_P": 0.5, "y_P": 0.2})
    rivals = ["sensor-position", "sway-yaw-coupling", "coriolis-coupling", "steady-current", "measurement-delay"]
    result = diagnose([s_manoeuvre(hidden, measured=measured, k=k) for k in (0, 1)], effects=rivals)
    (cause,) = result.causes
    assert (result.verdict, cause.effect.slug, cause.effect.place) == ("effect-found", "sensor-position", place)
    for name, truth in (("x_P", 0.5), ("y_P", 0.2)):
        assert abs(cause.parameters[name].value - truth) < 4.0 * cause.parameters[name].std < 0.2, name


def test_a_track_that_cannot_be_analysed_is_reported():
    run = s_manoeuvre(measured=("u", "psi", "x", "y"))  # only the speed ahead: how far it slides is unknown
    form = plain_form([run])
    segments, _ = prepare_as_recorded([run], form)
    assert {"x", "y"}.isdisjoint(segments[0].signals)
    (doubt,) = overlooked([run], form, None, None, segments)
    assert doubt.slug == "not-looked-at" and "x and y" in doubt.cause
    assert overlooked([run], form, "yaw", None, segments) == []


def test_a_requested_degree_of_freedom_that_cannot_be_analysed_is_reported():
    run = s_manoeuvre(measured=("psi",))
    form = plain_form([run], "yaw,heave")
    segments, _ = prepare_as_recorded([run], form)
    (doubt,) = overlooked([run], form, "yaw,heave", None, segments)
    assert doubt.cause.startswith("heave was requested but not analysed")
    with pytest.raises(MissingChannel, match="horizontal"):
        plain_form([run], "yaws")


@pytest.mark.parametrize("k", [0, 2])
def test_sideways_momentum_is_identified_from_a_track_alone(k):
    """A base fit without it diverges from the track; short pieces show the cause."""
    rivals = ["coriolis-coupling", "sway-yaw-coupling", "steady-current", "quadratic-drag", "dead-zone"]
    result = diagnose([s_manoeuvre(COUPLED, k=i) for i in (k, k + 1)], effects=rivals)
    assert result.verdict == "effect-found"
    (cause,) = result.causes
    assert cause.effect.slug == "coriolis-coupling"
    assert cause.effect["X_vr"] == pytest.approx(7.0, rel=0.05)
    assert cause.effect["N_uv"] == pytest.approx(-2.0, rel=0.05)
    assert cause.effect["Y_ur"] == pytest.approx(
        -5.0 / 7.0, rel=0.05
    )  # relative to a mass in sway that is not identifiable


def test_three_s_manoeuvres_are_explained_with_a_twentieth_of_the_allowed_work():
    result = diagnose([s_manoeuvre(COUPLED, k=k) for k in (0, 1, 2)])
    assert result.verdict == "effect-found"
    assert [c.effect.slug for c in result.causes] == ["coriolis-coupling"]
    assert result.causes[0].effect["X_vr"] == pytest.approx(7.0, rel=0.05)
    assert result.work < 0.05 * WORK


@pytest.mark.parametrize("work", [3e6, 1e7])
def test_an_unfinished_analysis_of_three_s_manoeuvres_reports_no_cause(work):
    result = diagnose([s_manoeuvre(COUPLED, k=k) for k in (0, 1, 2)], work=work)
    assert (result.verdict, result.causes) == ("unfinished", ())


@pytest.mark.slow
def test_a_cause_found_from_the_heading_alone_does_not_stop_the_analysis_of_the_track():
    """With every effect as a candidate, the heading alone supports quadratic drag under a drifting moment."""
    result = diagnose([s_manoeuvre(COUPLED, k=k) for k in (0, 1)], dof="horizontal")
    assert result.verdict == "effect-found"
    (cause,) = result.causes
    assert cause.effect.slug == "coriolis-coupling"
    assert cause.effect["X_vr"] == pytest.approx(7.0, rel=0.05)
    assert cause.effect["N_uv"] == pytest.approx(-2.0, rel=0.05)
